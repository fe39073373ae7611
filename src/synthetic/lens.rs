//! The synthetic camera's own lens: forward model, inverse by damped Newton, and where it is single-valued.
//!
//! Ideal coordinates are `x = X/Z`, `y = Y/Z` in camera axes (x right, y down, z along the optical axis).

use nalgebra::{Matrix2, Vector2};

use super::scenario::Camera;

/// Newton stops below this step in ideal coordinates: about a billionth of a pixel.
const STEP_LIMIT: f64 = 1e-12;

/// The camera with what is worth knowing in advance about its lens.
pub(super) struct Lens {
    camera: Camera,
    /// Within this ideal radius the lens is single-valued in every direction.
    safe_radius: f64,
}

impl Lens {
    pub fn new(camera: &Camera) -> Self {
        let mut lens = Self { camera: camera.clone(), safe_radius: 0.0 };
        // Rings a thousandth apart, out to 79 degrees off the axis.
        for ring in 1..5000 {
            let radius = f64::from(ring) * 1e-3;
            let folds = |step: i32| {
                let (sin, cos) = (f64::from(step) * std::f64::consts::TAU / 72.0).sin_cos();
                lens.distort(Vector2::new(cos, sin) * radius).1.determinant() <= 0.0
            };
            if (0..72).any(folds) {
                break;
            }
            // The fold runs smoothly from one direction looked at to the next.
            lens.safe_radius = 0.98 * radius;
        }
        lens
    }

    /// Whether a ray is well inside the lens's fold, where a pixel still spans a usual angle.
    pub fn is_well_inside(&self, ideal: Vector2<f64>) -> bool {
        ideal.norm() < 0.9 * self.safe_radius
    }

    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Distorted coordinates and their derivative by the ideal ones.
    ///
    /// # Source
    /// Brown's model as in Hemerly, eq. (2) and (3), with the squares that eq. (3) misses.
    fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let Camera { k1, k2, p1, p2, k3, .. } = self.camera;
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
        let derivative = Matrix2::new(
            radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (distorted, derivative)
    }

    /// Column and row of a ray given in ideal coordinates, whether or not the lens is single-valued there.
    pub fn pixel_from_ideal(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let Camera { fx_px, fy_px, skew_px, cx_px, cy_px, .. } = self.camera;
        let (distorted, _) = self.distort(ideal);
        Vector2::new(fx_px * distorted.x + skew_px * distorted.y + cx_px, fy_px * distorted.y + cy_px)
    }

    /// Whether the lens has not folded back anywhere between the principal point and this ray.
    pub fn is_single_valued(&self, ideal: Vector2<f64>) -> bool {
        ideal.norm_squared() < self.safe_radius * self.safe_radius
            || (1..=24).all(|step| self.distort(ideal * (f64::from(step) / 24.0)).1.determinant() > 0.0)
    }

    /// The ideal coordinates seen by a pixel, or `None` where the lens has no inverse.
    pub fn ideal_from_pixel(&self, column: f64, row: f64) -> Option<Vector2<f64>> {
        let Camera { fx_px, fy_px, skew_px, cx_px, cy_px, .. } = self.camera;
        let y = (row - cy_px) / fy_px;
        let wanted = Vector2::new((column - cx_px - skew_px * y) / fx_px, y);
        let mut ideal = if self.is_single_valued(wanted) { wanted } else { Vector2::zeros() };
        for _ in 0..100 {
            let (distorted, derivative) = self.distort(ideal);
            let mut step = derivative.try_inverse()? * (wanted - distorted);
            // Stepping over the fold would end in the lens's second branch, so approach it from inside.
            while step.norm() > STEP_LIMIT && self.distort(ideal + step).1.determinant() <= 0.0 {
                step *= 0.5;
            }
            ideal += step;
            if step.norm() <= STEP_LIMIT {
                let residual = (self.distort(ideal).0 - wanted).norm();
                return (residual < 100.0 * STEP_LIMIT && self.is_single_valued(ideal)).then_some(ideal);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_returns_the_ray_all_over_the_frame() {
        let lens = Lens::new(&Camera::default());
        for row in (0..648).step_by(9) {
            for column in (0..1152).step_by(9) {
                let (column, row) = (f64::from(column), f64::from(row));
                if let Some(ideal) = lens.ideal_from_pixel(column, row) {
                    let back = lens.pixel_from_ideal(ideal);
                    assert!(
                        (back - Vector2::new(column, row)).norm() < 1e-7,
                        "pixel {column}, {row} came back as {back}"
                    );
                }
            }
        }
    }

    #[test]
    fn derivative_matches_differences() {
        let lens = Lens::new(&Camera::default());
        for ideal in [Vector2::new(0.3, -0.2), Vector2::new(-0.7, 0.4), Vector2::new(0.0, 0.0)] {
            let (_, derivative) = lens.distort(ideal);
            for axis in 0..2 {
                let mut step = Vector2::zeros();
                step[axis] = 1e-6;
                let difference = (lens.distort(ideal + step).0 - lens.distort(ideal - step).0) / 2e-6;
                assert!((difference - derivative.column(axis)).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn the_safe_radius_ends_just_inside_the_fold() {
        let lens = Lens::new(&Camera::default());
        // Without its tangential part the paper's lens folds at 0.9578.
        assert!((0.88..0.9578).contains(&lens.safe_radius), "{}", lens.safe_radius);
        let pinhole = Camera { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0, ..Camera::default() };
        assert!(Lens::new(&pinhole).safe_radius > 4.8);
    }

    /// The paper's lens folds back inside the frame; an independent count found 5707 pixels without inverse,
    /// 2605, 2775, 125 and 202 of them in the corners upper left, upper right, lower left, lower right.
    #[test]
    fn pixels_without_inverse_are_those_of_the_folded_corners() {
        let lens = Lens::new(&Camera::default());
        let mut corners = [0_i32; 4];
        for row in 0..648 {
            for column in 0..1152 {
                // The middle of the frame is far from the fold.
                if (200..952).contains(&column)
                    || lens.ideal_from_pixel(f64::from(column), f64::from(row)).is_some()
                {
                    continue;
                }
                corners[usize::from(column >= 576) + 2 * usize::from(row >= 324)] += 1;
            }
        }
        for (count, expected) in corners.into_iter().zip([2605, 2775, 125, 202]) {
            assert!((count - expected).abs() <= 20, "{corners:?}");
        }
    }
}
