//! Interior orientation with the Brown lens: the paper's K and five distortion terms.
//!
//! ```text
//! x = X/Z, y = Y/Z, r² = x² + y²
//! x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
//! y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y
//! column = fx x_d + skew y_d + cx,  row = fy y_d + cy
//! ```
//!
//! # Source
//! Hemerly (2014), eqs. (2)–(4), with k3, k4, k5 of the paper named p1, p2, k3 as Bouguet and OpenCV do,
//! and the squares that eq. (3) lost in print restored (2x², 2y²).

use super::ImagePoint;
use super::inverse::{IdealMap, ideal_from_distorted};
use super::lens::{CameraError, LensFunction, LensKind, Projected, check_interior, pixel_from_distorted};
use super::plane::{self, Radial};
use super::roots::first_root;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Number of interior parameters.
const N: usize = 10;

/// Brown's lens over an affine image plane: the ten interior parameters of the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brown {
    interior: [f64; N],
    /// Square of the ideal radius at which the radial polynomial turns over; infinite when it never does.
    fold_radius_squared: f64,
}

impl Brown {
    /// Names of the interior parameters in the order of every vector and covariance of them.
    pub const NAMES: [&'static str; N] =
        ["fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3"];

    /// From the parameters in the order of [`Brown::NAMES`]; lengths in pixels, terms dimensionless.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::FocalLength`].
    pub fn new(interior: [f64; N]) -> Result<Self, CameraError> {
        check_interior(&Self::NAMES, &interior)?;
        let [.., k1, k2, _, _, k3] = interior;
        // d/dr [r (1 + k1 r² + k2 r⁴ + k3 r⁶)] in s = r².
        let slope = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3];
        Ok(Self { interior, fold_radius_squared: first_root(&slope, plane::FAR) })
    }

    /// The parameters in the order of [`Brown::NAMES`].
    #[must_use]
    pub const fn interior(&self) -> [f64; N] {
        self.interior
    }

    /// Ideal radius (tangent of the off-axis angle) beyond which the lens folds back; infinite if never.
    #[must_use]
    pub fn fold_radius(&self) -> f64 {
        self.fold_radius_squared.sqrt()
    }

    /// Pixel of the ideal point (x, y), or `None` where the lens has folded back.
    #[must_use]
    pub fn pixel_from_ideal(&self, ideal: Vector2<f64>) -> Option<ImagePoint> {
        let (distorted, jacobian) = self.distort(ideal);
        self.is_single_valued(ideal, &jacobian).then(|| pixel_from_distorted(&self.interior, distorted))
    }

    /// Image area per area of the ideal plane, relative to a lens without distortion: 1 on the axis of most
    /// lenses, falling to 0 where the lens folds.
    #[must_use]
    pub fn magnification(&self, ideal: Vector2<f64>) -> f64 {
        self.distort(ideal).1.determinant()
    }

    /// Pixel of the ideal point with derivatives, without asking whether the lens folds there: the
    /// calibration may pass through such points on its way.
    #[must_use]
    pub fn project(&self, ideal: Vector2<f64>) -> Projected<N> {
        project(&self.interior, ideal, 1.0)
    }

    /// Ideal point (x, y) = (X/Z, Y/Z) of a pixel, or `None` where the lens has no inverse: the point
    /// connected to the axis, never one beyond the fold.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        ideal_from_distorted(self, plane::distorted_from_pixel(&self.interior, pixel)?)
    }
}

impl IdealMap for Brown {
    #[inline]
    fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [.., k1, k2, p1, p2, k3] = self.interior;
        plane::distort(ideal, radial(k1, k2, k3, ideal.norm_squared()), p1, p2)
    }

    #[inline]
    fn is_single_valued(&self, ideal: Vector2<f64>, jacobian: &Matrix2<f64>) -> bool {
        ideal.norm_squared() < self.fold_radius_squared && jacobian.determinant() > 0.0
    }
}

impl LensFunction<N> for Brown {
    const KIND: LensKind = LensKind::Brown;

    #[inline]
    fn pixel_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<ImagePoint> {
        let [.., k1, k2, p1, p2, k3] = *interior;
        let ideal = plane::ideal(point)?;
        let (distorted, _) = plane::distort(ideal, radial(k1, k2, k3, ideal.norm_squared()), p1, p2);
        Some(pixel_from_distorted(interior, distorted))
    }

    #[inline]
    fn project_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<Projected<N>> {
        plane::ideal(point).map(|ideal| project(interior, ideal, point.z))
    }
}

#[inline]
fn radial(k1: f64, k2: f64, k3: f64, r2: f64) -> Radial {
    Radial { factor: 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), by_r2: k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3) }
}

#[inline]
fn project(interior: &[f64; N], ideal: Vector2<f64>, depth: f64) -> Projected<N> {
    let [.., k1, k2, p1, p2, k3] = *interior;
    let r2 = ideal.norm_squared();
    let (d, jacobian) = plane::distort(ideal, radial(k1, k2, k3, r2), p1, p2);
    let mut projected = plane::project(interior, ideal, depth, d, &jacobian);
    let affine = plane::affine(interior);
    let [by_p1, by_p2] = plane::decentring_terms(ideal);
    let terms = [ideal * r2, ideal * (r2 * r2), by_p1, by_p2, ideal * (r2 * r2 * r2)];
    for (k, term) in terms.into_iter().enumerate() {
        projected.by_interior.set_column(5 + k, &(affine * term));
    }
    projected
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Eqs. (6) and (7) of the paper.
    fn paper() -> Brown {
        Brown::new([
            743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018,
        ])
        .unwrap()
    }

    #[test]
    fn the_papers_lens_folds_where_the_reference_says() {
        assert!((paper().fold_radius() - 0.9578).abs() < 1e-4, "{}", paper().fold_radius());
    }

    #[test]
    fn the_papers_corner_pixels_have_no_inverse() {
        let camera = paper();
        let invalid = |columns: std::ops::Range<u32>, rows: std::ops::Range<u32>| {
            rows.flat_map(|r| columns.clone().map(move |c| (c, r)))
                .filter(|&(c, r)| {
                    camera.ideal_from_pixel(ImagePoint::new(f64::from(c), f64::from(r))).is_none()
                })
                .count() as i64
        };
        // paper-numbers: upper left, upper right, lower left, lower right, each ±20.
        for (columns, rows, expected) in [
            (0..576, 0..324, 2605_i64),
            (576..1152, 0..324, 2775),
            (0..576, 324..648, 125),
            (576..1152, 324..648, 202),
        ] {
            let found = invalid(columns, rows);
            assert!((found - expected).abs() <= 20, "{found} invalid pixels, {expected} expected");
        }
    }

    #[test]
    fn points_past_the_fold_do_not_reappear_inside_the_frame() {
        assert!(paper().pixel_from_ideal(Vector2::new(0.9, 0.5)).is_none());
        assert!(paper().pixel_from_ideal(Vector2::new(0.5, 0.3)).is_some());
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let mut p = paper().interior();
        p[6] = f64::NAN;
        assert!(Brown::new(p).unwrap_err().to_string().contains("k2"));
        p = paper().interior();
        p[1] = -3.0;
        assert!(matches!(Brown::new(p), Err(CameraError::FocalLength { name: "fy_px", .. })));
    }

    proptest! {
        #[test]
        fn inverse_returns_every_visible_point(
            k1 in -0.4..0.4f64, k2 in -0.3..0.3f64, k3 in -0.3..0.3f64,
            p1 in -0.01..0.01f64, p2 in -0.01..0.01f64, skew in -5.0..5.0f64,
            x in -0.7..0.7f64, y in -0.5..0.5f64,
        ) {
            let camera = Brown::new([800.0, 790.0, skew, 500.0, 400.0, k1, k2, p1, p2, k3]).unwrap();
            let ideal = Vector2::new(x, y);
            if let Some(pixel) = camera.pixel_from_ideal(ideal) {
                // Well inside the first sheet the inverse exists and is the same point.
                if ideal.norm() < 0.9 * camera.fold_radius() {
                    let back = camera.ideal_from_pixel(pixel);
                    prop_assert!(back.is_some_and(|b| (b - ideal).norm() < 1e-8), "{back:?} for {ideal:?}");
                }
            }
        }

        #[test]
        fn jacobians_match_differences(
            k1 in -0.4..0.4f64, k2 in -0.3..0.3f64, k3 in -0.3..0.3f64, p1 in -0.01..0.01f64,
            p2 in -0.01..0.01f64, skew in -5.0..5.0f64, x in -0.5..0.5f64, y in -0.5..0.5f64,
        ) {
            let interior = [800.0, 790.0, skew, 500.0, 400.0, k1, k2, p1, p2, k3];
            let at = |interior: [f64; 10], x: f64, y: f64| {
                let p = Brown::new(interior).unwrap().project(Vector2::new(x, y)).pixel;
                Vector2::new(p.column, p.row)
            };
            let projected = Brown::new(interior).unwrap().project(Vector2::new(x, y));
            let h = 1e-6;
            for k in 0..10 {
                let (mut up, mut down) = (interior, interior);
                up[k] += h;
                down[k] -= h;
                let numeric = (at(up, x, y) - at(down, x, y)) / (2.0 * h);
                prop_assert!((numeric - projected.by_interior.column(k)).norm() < 1e-5);
            }
            let by_x = (at(interior, x + h, y) - at(interior, x - h, y)) / (2.0 * h);
            let by_y = (at(interior, x, y + h) - at(interior, x, y - h)) / (2.0 * h);
            prop_assert!((by_x - projected.by_point.column(0)).norm() < 1e-4);
            prop_assert!((by_y - projected.by_point.column(1)).norm() < 1e-4);
        }
    }
}
