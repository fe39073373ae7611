//! OpenCV's rational lens: Brown's with a radial denominator, for wide-angle lenses.
//!
//! ```text
//! q = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
//! x_d = x q + 2 p1 x y + p2 (r² + 2 x²),  y_d = y q + p1 (r² + 2 y²) + 2 p2 x y
//! column = fx x_d + skew y_d + cx,  row = fy y_d + cy
//! ```
//!
//! # Source
//! Claus and Fitzgibbon (2005), "A Rational Function Lens Distortion Model for General Cameras", in the form
//! and order of parameters of OpenCV's `CALIB_RATIONAL_MODEL`; the skew is added.

use super::ImagePoint;
use super::inverse::{IdealMap, ideal_from_distorted};
use super::lens::{CameraError, LensFunction, LensKind, Projected, check_interior, pixel_from_distorted};
use super::plane::{self, Radial};
use super::roots::{derivative, first_root, product};
use nalgebra::{Matrix2, Vector2, Vector3};

/// Number of interior parameters.
const N: usize = 13;

/// The rational lens over an affine image plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rational {
    interior: [f64; N],
    /// Square of the ideal radius of the first fold or pole; infinite when there is none.
    fold_radius_squared: f64,
}

impl Rational {
    /// Names of the interior parameters in the order of every vector and covariance of them.
    pub const NAMES: [&'static str; N] =
        ["fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];

    /// From the parameters in the order of [`Rational::NAMES`]; lengths in pixels, terms dimensionless.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::FocalLength`].
    pub fn new(interior: [f64; N]) -> Result<Self, CameraError> {
        check_interior(&Self::NAMES, &interior)?;
        let [.., k1, k2, _, _, k3, k4, k5, k6] = interior;
        Ok(Self { interior, fold_radius_squared: first_fold(&[k1, k2, k3, k4, k5, k6]) })
    }

    /// The parameters in the order of [`Rational::NAMES`].
    #[must_use]
    pub const fn interior(&self) -> [f64; N] {
        self.interior
    }

    /// Ideal radius (tangent of the off-axis angle) beyond which the lens folds back or where its denominator
    /// vanishes; infinite if never.
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

    /// As [`super::Brown::magnification`].
    #[must_use]
    pub fn magnification(&self, ideal: Vector2<f64>) -> f64 {
        self.distort(ideal).1.determinant()
    }

    /// As [`super::Brown::ideal_from_pixel`].
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        ideal_from_distorted(self, plane::distorted_from_pixel(&self.interior, pixel)?)
    }
}

impl IdealMap for Rational {
    fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [.., p1, p2, _, _, _, _] = self.interior;
        plane::distort(
            ideal,
            Quotient::at(&radial_terms(&self.interior), ideal.norm_squared()).radial(),
            p1,
            p2,
        )
    }

    fn is_single_valued(&self, ideal: Vector2<f64>, jacobian: &Matrix2<f64>) -> bool {
        ideal.norm_squared() < self.fold_radius_squared && jacobian.determinant() > 0.0
    }
}

impl LensFunction<N> for Rational {
    const KIND: LensKind = LensKind::Rational;

    #[inline]
    fn pixel_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<ImagePoint> {
        let [.., p1, p2, _, _, _, _] = *interior;
        let ideal = plane::ideal(point)?;
        let quotient = Quotient::at(&radial_terms(interior), ideal.norm_squared());
        let (distorted, _) = plane::distort(ideal, quotient.radial(), p1, p2);
        (quotient.denominator > 0.0).then(|| pixel_from_distorted(interior, distorted))
    }

    #[inline]
    fn project_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<Projected<N>> {
        let [.., p1, p2, _, _, _, _] = *interior;
        let ideal = plane::ideal(point)?;
        let quotient = Quotient::at(&radial_terms(interior), ideal.norm_squared());
        if quotient.denominator.is_nan() || quotient.denominator <= 0.0 {
            return None;
        }
        let (d, jacobian) = plane::distort(ideal, quotient.radial(), p1, p2);
        let mut projected = plane::project(interior, ideal, point.z, d, &jacobian);
        let affine = plane::affine(interior);
        for (k, term) in quotient.by_terms(ideal).into_iter().enumerate() {
            projected.by_interior.set_column(5 + k, &(affine * term));
        }
        Some(projected)
    }
}

/// k1 … k6, without the decentring between them.
#[inline]
fn radial_terms(interior: &[f64; N]) -> [f64; 6] {
    let [.., k1, k2, _, _, k3, k4, k5, k6] = *interior;
    [k1, k2, k3, k4, k5, k6]
}

/// Numerator and denominator of the radial factor at one radius, with their derivatives by r².
#[derive(Clone, Copy)]
pub(super) struct Quotient {
    numerator: f64,
    numerator_by_r2: f64,
    pub denominator: f64,
    denominator_by_r2: f64,
}

impl Quotient {
    /// Of k1 … k6 at a radius.
    #[inline]
    pub fn at(terms: &[f64; 6], r2: f64) -> Self {
        let [k1, k2, k3, k4, k5, k6] = *terms;
        Self {
            numerator: 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)),
            numerator_by_r2: k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3),
            denominator: 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)),
            denominator_by_r2: k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6),
        }
    }

    /// The factor and its derivative.
    #[inline]
    pub fn radial(&self) -> Radial {
        let factor = self.numerator / self.denominator;
        let by_r2 = (self.numerator_by_r2 - factor * self.denominator_by_r2) / self.denominator;
        Radial { factor, by_r2 }
    }

    /// d(distorted) by k1, k2, p1, p2, k3, k4, k5, k6.
    #[inline]
    pub fn by_terms(&self, ideal: Vector2<f64>) -> [Vector2<f64>; 8] {
        let r2 = ideal.norm_squared();
        let [by_p1, by_p2] = plane::decentring_terms(ideal);
        let above = ideal * (r2 / self.denominator);
        let below = above * -self.radial().factor;
        [above, above * r2, by_p1, by_p2, above * (r2 * r2), below, below * r2, below * (r2 * r2)]
    }
}

/// Square of the ideal radius at which r N/D of k1 … k6 turns over or D vanishes.
///
/// With s = r², d(r N/D)/dr has the sign of N D + 2 s (N′ D − N D′).
pub(super) fn first_fold(terms: &[f64; 6]) -> f64 {
    let [k1, k2, k3, k4, k5, k6] = *terms;
    let (numerator, denominator) = (&[1.0, k1, k2, k3], &[1.0, k4, k5, k6]);
    let mut slope = product(numerator, denominator);
    let rising = product(&derivative(numerator), denominator);
    let falling = product(numerator, &derivative(denominator));
    for (k, (up, down)) in rising.iter().zip(&falling).enumerate() {
        slope[k + 1] += 2.0 * (up - down);
    }
    first_root(&slope, plane::FAR).min(first_root(denominator, plane::FAR))
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, check::jacobians_match_differences};
    use super::*;
    use proptest::prelude::*;

    fn lens(terms: [f64; 8]) -> Rational {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = terms;
        Rational::new([800.0, 790.0, 1.5, 500.0, 400.0, k1, k2, p1, p2, k3, k4, k5, k6]).unwrap()
    }

    #[test]
    fn without_a_denominator_it_is_browns_lens() {
        let rational = lens([-0.2, 0.1, 1e-3, -2e-3, 0.05, 0.0, 0.0, 0.0]);
        let brown = Brown::new(std::array::from_fn(|k| rational.interior()[k])).unwrap();
        for (x, y) in [(0.0, 0.0), (0.3, -0.2), (-0.6, 0.5)] {
            let ideal = Vector2::new(x, y);
            assert_eq!(rational.pixel_from_ideal(ideal), brown.pixel_from_ideal(ideal));
        }
        assert_eq!(rational.fold_radius(), brown.fold_radius());
    }

    #[test]
    fn it_agrees_with_opencv() {
        // cv2.projectPoints (5.0.0), which has no skew.
        let lens =
            Rational::new([800.0, 790.0, 0.0, 500.0, 400.0, -0.2, 0.1, 1e-3, -2e-3, 0.05, 0.3, -0.05, 0.02])
                .unwrap();
        let published = [
            ((1.0, 0.0), (1_093.625_196_850_393_6, 400.79)),
            ((0.5, -0.7), (805.763_086_258_026_4, -23.769_746_751_721_527)),
        ];
        for ((x, y), (column, row)) in published {
            let pixel = lens.pixel_from_ideal(Vector2::new(x, y)).unwrap();
            assert!((pixel.column - column).abs() < 1e-9 && (pixel.row - row).abs() < 1e-9, "{pixel:?}");
        }
    }

    #[test]
    fn nothing_is_seen_past_the_pole() {
        // 1 − 4 r² vanishes at r = 0.5.
        let lens = lens([0.0, 0.0, 0.0, 0.0, 0.0, -4.0, 0.0, 0.0]);
        assert!((lens.fold_radius() - 0.5).abs() < 1e-9, "{}", lens.fold_radius());
        assert!(lens.pixel_from_ideal(Vector2::new(0.49, 0.0)).is_some());
        assert!(lens.pixel_from_ideal(Vector2::new(0.51, 0.0)).is_none());
        let behind_the_pole = Vector3::new(0.51, 0.0, 1.0);
        assert!(Rational::project_with(&lens.interior(), &behind_the_pole).is_none());
        assert!(Rational::pixel_with(&lens.interior(), &behind_the_pole).is_none());
        // However far out a pixel lies, its ray lies within the pole.
        for column in [900.0, 5e3, 1e6] {
            let ideal = lens.ideal_from_pixel(ImagePoint::new(column, 400.0));
            assert!(ideal.is_none_or(|ideal| ideal.norm() < 0.5), "{ideal:?}");
        }
    }

    proptest! {
        #[test]
        fn inverse_returns_every_visible_point(
            k in proptest::array::uniform6(-0.4..0.4f64), p1 in -0.01..0.01f64, p2 in -0.01..0.01f64,
            x in -0.7..0.7f64, y in -0.5..0.5f64,
        ) {
            let lens = lens([k[0], k[1], p1, p2, k[2], k[3], k[4], k[5]]);
            let ideal = Vector2::new(x, y);
            if ideal.norm() < 0.9 * lens.fold_radius() && let Some(pixel) = lens.pixel_from_ideal(ideal) {
                let back = lens.ideal_from_pixel(pixel);
                prop_assert!(back.is_some_and(|b| (b - ideal).norm() < 1e-8), "{back:?} for {ideal:?}");
            }
        }

        #[test]
        fn derivatives_match_differences(
            k in proptest::array::uniform6(-0.4..0.4f64), p1 in -0.01..0.01f64, p2 in -0.01..0.01f64,
            x in -0.5..0.5f64, y in -0.5..0.5f64, z in 0.5..2.0f64,
        ) {
            let lens = lens([k[0], k[1], p1, p2, k[2], k[3], k[4], k[5]]);
            jacobians_match_differences::<Rational, N>(&lens.interior(), &(Vector3::new(x, y, 1.0) * z))?;
        }
    }
}
