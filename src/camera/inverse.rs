//! The inverse of a lens that is a map of the ideal plane, on the sheet connected to the axis.

use nalgebra::{Matrix2, Vector2};

/// A lens as a map of the ideal plane (x, y) = (X/Z, Y/Z).
pub(super) trait IdealMap {
    /// Distorted point and its derivative by the ideal one.
    fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>);
    /// True on the first sheet: within the fold and with a positive determinant.
    fn is_single_valued(&self, ideal: Vector2<f64>, jacobian: &Matrix2<f64>) -> bool;
}

/// Ideal point of a distorted one, or `None` where the lens has no inverse.
///
/// Newton's method from the undistorted guess; where that leaves the lens's first sheet, the point is
/// approached from the principal point along the image in small steps, so that the answer is always
/// the one connected to the axis.
pub(super) fn ideal_from_distorted(lens: &impl IdealMap, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
    if let Some(ideal) = newton(lens, distorted, distorted) {
        return Some(ideal);
    }
    const STEPS: u32 = 32;
    let mut ideal = Vector2::zeros();
    for step in 1..=STEPS {
        ideal = newton(lens, distorted * (f64::from(step) / f64::from(STEPS)), ideal)?;
    }
    Some(ideal)
}

fn newton(lens: &impl IdealMap, target: Vector2<f64>, start: Vector2<f64>) -> Option<Vector2<f64>> {
    const ROUNDS: u32 = 25;
    const TOLERANCE: f64 = 1e-14;
    let mut ideal = start;
    let (mut distorted, mut jacobian) = lens.distort(ideal);
    for _ in 0..ROUNDS {
        if !lens.is_single_valued(ideal, &jacobian) {
            return None;
        }
        let step = jacobian.try_inverse()? * (target - distorted);
        ideal += step;
        (distorted, jacobian) = lens.distort(ideal);
        if step.norm_squared() < TOLERANCE * TOLERANCE * (1.0 + ideal.norm_squared()) {
            break;
        }
    }
    let reached = (target - distorted).norm() < 1e-10 * (1.0 + target.norm());
    (reached && lens.is_single_valued(ideal, &jacobian)).then_some(ideal)
}
