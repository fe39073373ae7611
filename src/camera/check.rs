//! Derivatives of a lens against differences, for the tests of every lens.

use super::LensFunction;
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

/// Compares the derivatives by parameters and point with central differences.
pub(super) fn jacobians_match_differences<L: LensFunction<N>, const N: usize>(
    interior: &[f64; N],
    point: &Vector3<f64>,
) -> Result<(), TestCaseError> {
    const STEP: f64 = 1e-6;
    let at = |interior: &[f64; N], point: &Vector3<f64>| {
        L::pixel_with(interior, point).map(|p| Vector2::new(p.column, p.row))
    };
    let Some(projected) = L::project_with(interior, point) else { return Ok(()) };
    prop_assert_eq!(Some(projected.pixel), L::pixel_with(interior, point));
    // Derivatives grow towards a pole: errors of the differences with them.
    let tolerance = |size: f64| 1e-6 * (1.0 + size) * (1.0 + projected.by_point.norm() * 1e-3);
    let differ = |up: Option<Vector2<f64>>, down: Option<Vector2<f64>>| Some((up? - down?) / (2.0 * STEP));
    for k in 0..N {
        let (mut up, mut down) = (*interior, *interior);
        up[k] += STEP;
        down[k] -= STEP;
        let Some(numeric) = differ(at(&up, point), at(&down, point)) else { continue };
        let error = (numeric - projected.by_interior.column(k)).norm();
        prop_assert!(error < tolerance(numeric.norm()) * 10.0, "parameter {k}: {error}");
    }
    for k in 0..3 {
        let mut step = Vector3::zeros();
        step[k] = STEP;
        let Some(numeric) = differ(at(interior, &(point + step)), at(interior, &(point - step))) else {
            continue;
        };
        let error = (numeric - projected.by_point.column(k)).norm();
        prop_assert!(error < tolerance(numeric.norm()) * 10.0, "point {k}: {error}");
    }
    Ok(())
}
