//! OpenCV's lens of twelve terms: the rational one and a thin prism, for sensors that stand askew.
//!
//! ```text
//! (x_d, y_d) = rational lens of k1 … k6, p1, p2
//! x_d += s1 r² + s2 r⁴,  y_d += s3 r² + s4 r⁴
//! column = fx x_d + skew y_d + cx,  row = fy y_d + cy
//! ```
//!
//! # Source
//! Weng, Cohen and Herniou (1992), "Camera Calibration with Distortion Models and Accuracy Evaluation", in the form
//! and order of parameters of OpenCV's `CALIB_THIN_PRISM_MODEL`; the skew is added.

use super::ImagePoint;
use super::inverse::{IdealMap, ideal_from_distorted};
use super::lens::{CameraError, LensFunction, LensKind, Projected, check_interior, pixel_from_distorted};
use super::plane;
use super::rational::{Quotient, first_fold};
use nalgebra::{Matrix2, Vector2, Vector3};

/// Number of interior parameters.
const N: usize = 17;

/// The rational lens with a thin prism over an affine image plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThinPrism {
    interior: [f64; N],
    /// Square of the ideal radius of the radial factor's first fold or pole; infinite when there is none.
    fold_radius_squared: f64,
}

impl ThinPrism {
    /// Names of the interior parameters in the order of every vector and covariance of them.
    pub const NAMES: [&'static str; N] = [
        "fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1",
        "s2", "s3", "s4",
    ];

    /// From the parameters in the order of [`ThinPrism::NAMES`]; lengths in pixels, terms dimensionless.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::FocalLength`].
    pub fn new(interior: [f64; N]) -> Result<Self, CameraError> {
        check_interior(&Self::NAMES, &interior)?;
        Ok(Self { interior, fold_radius_squared: first_fold(&Terms::of(&interior).radial) })
    }

    /// The parameters in the order of [`ThinPrism::NAMES`].
    #[must_use]
    pub const fn interior(&self) -> [f64; N] {
        self.interior
    }

    /// Ideal radius (tangent of the off-axis angle) beyond which the radial factor folds back or where its
    /// denominator vanishes; infinite if never.
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

/// The lens terms by their roles.
struct Terms {
    /// k1 … k6.
    radial: [f64; 6],
    p1: f64,
    p2: f64,
    /// s1 and s3.
    by_r2: Vector2<f64>,
    /// s2 and s4.
    by_r4: Vector2<f64>,
}

impl Terms {
    #[inline]
    fn of(interior: &[f64; N]) -> Self {
        let [.., k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = *interior;
        Self {
            radial: [k1, k2, k3, k4, k5, k6],
            p1,
            p2,
            by_r2: Vector2::new(s1, s3),
            by_r4: Vector2::new(s2, s4),
        }
    }

    /// Distorted point and d(distorted)/d(ideal), which the prism makes unsymmetric.
    #[inline]
    fn distort(&self, ideal: Vector2<f64>, quotient: &Quotient) -> (Vector2<f64>, Matrix2<f64>) {
        let r2 = ideal.norm_squared();
        let (distorted, jacobian) = plane::distort(ideal, quotient.radial(), self.p1, self.p2);
        let shift = (self.by_r2 + self.by_r4 * r2) * r2;
        let slope = (self.by_r2 + self.by_r4 * (2.0 * r2)) * 2.0;
        (distorted + shift, jacobian + slope * ideal.transpose())
    }
}

impl IdealMap for ThinPrism {
    #[inline]
    fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let terms = Terms::of(&self.interior);
        terms.distort(ideal, &Quotient::at(&terms.radial, ideal.norm_squared()))
    }

    #[inline]
    fn is_single_valued(&self, ideal: Vector2<f64>, jacobian: &Matrix2<f64>) -> bool {
        ideal.norm_squared() < self.fold_radius_squared && jacobian.determinant() > 0.0
    }
}

impl LensFunction<N> for ThinPrism {
    const KIND: LensKind = LensKind::ThinPrism;

    #[inline]
    fn pixel_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<ImagePoint> {
        let terms = Terms::of(interior);
        let ideal = plane::ideal(point)?;
        let quotient = Quotient::at(&terms.radial, ideal.norm_squared());
        let (distorted, _) = terms.distort(ideal, &quotient);
        (quotient.denominator > 0.0).then(|| pixel_from_distorted(interior, distorted))
    }

    #[inline]
    fn project_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<Projected<N>> {
        const RATIONAL: usize = 5;
        const PRISM: usize = 13;
        let terms = Terms::of(interior);
        let ideal = plane::ideal(point)?;
        let r2 = ideal.norm_squared();
        let quotient = Quotient::at(&terms.radial, r2);
        if quotient.denominator.is_nan() || quotient.denominator <= 0.0 {
            return None;
        }
        let (d, jacobian) = terms.distort(ideal, &quotient);
        let mut projected = plane::project(interior, ideal, point.z, d, &jacobian);
        let affine = plane::affine(interior);
        for (k, term) in quotient.by_terms(ideal).into_iter().enumerate() {
            projected.by_interior.set_column(RATIONAL + k, &(affine * term));
        }
        let [x, y] = [affine.column(0) * r2, affine.column(1) * r2];
        for (k, term) in [x, x * r2, y, y * r2].into_iter().enumerate() {
            projected.by_interior.set_column(PRISM + k, &term);
        }
        Some(projected)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Rational, check::jacobians_match_differences};
    use super::*;
    use proptest::prelude::*;

    fn lens(terms: [f64; 8], prism: [f64; 4]) -> ThinPrism {
        let mut interior =
            [800.0, 790.0, 2.0, 500.0, 400.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        interior[5..13].copy_from_slice(&terms);
        interior[13..].copy_from_slice(&prism);
        ThinPrism::new(interior).unwrap()
    }

    #[test]
    fn without_a_prism_it_is_the_rational_lens() {
        let terms = [-0.2, 0.1, 1e-3, -2e-3, 0.05, 0.3, -0.05, 0.02];
        let prism = lens(terms, [0.0; 4]);
        let mut interior = [800.0, 790.0, 2.0, 500.0, 400.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        interior[5..].copy_from_slice(&terms);
        let rational = Rational::new(interior).unwrap();
        for (x, y) in [(0.0, 0.0), (0.5, -0.3), (-0.7, 0.4)] {
            let ideal = Vector2::new(x, y);
            assert_eq!(prism.pixel_from_ideal(ideal), rational.pixel_from_ideal(ideal));
        }
        assert_eq!(prism.fold_radius(), rational.fold_radius());
    }

    #[test]
    fn it_agrees_with_opencv() {
        // cv2.projectPoints (5.0.0) of (x, y, 1) with these twelve terms; it has no skew.
        let lens = ThinPrism::new([
            800.0, 790.0, 0.0, 500.0, 400.0, -0.2, 0.1, 1e-3, -2e-3, 0.05, 0.3, -0.05, 0.02, 1e-2, -3e-3,
            -8e-3, 2e-3,
        ])
        .unwrap();
        let published = [
            ((1.0, 0.0), (1_099.225_196_850_393_8, 396.05)),
            ((0.5, -0.7), (810.368_846_258_026_5, -27.581_338_751_721_546)),
            ((-0.3, 0.4), (286.746_741_474_788_7, 681.408_873_724_861_6)),
        ];
        for ((x, y), (column, row)) in published {
            let pixel = lens.pixel_from_ideal(Vector2::new(x, y)).unwrap();
            assert!((pixel.column - column).abs() < 1e-9 && (pixel.row - row).abs() < 1e-9, "{pixel:?}");
        }
    }

    #[test]
    fn a_strong_prism_folds_the_plane() {
        // x + 0.5 r² turns over at x = −1 although there is no radial distortion.
        let lens = lens([0.0; 8], [0.5, 0.0, 0.0, 0.0]);
        assert!(lens.fold_radius().is_infinite());
        assert!(lens.pixel_from_ideal(Vector2::new(-0.99, 0.0)).is_some());
        assert!(lens.pixel_from_ideal(Vector2::new(-1.01, 0.0)).is_none());
        // No pixel left of 500 − 800/2 is the image of anything.
        assert!(lens.ideal_from_pixel(ImagePoint::new(99.0, 400.0)).is_none());
        assert!(lens.ideal_from_pixel(ImagePoint::new(110.0, 400.0)).is_some());
    }

    proptest! {
        #[test]
        fn inverse_returns_every_visible_point(
            k in proptest::array::uniform6(-0.4..0.4f64), p1 in -0.01..0.01f64, p2 in -0.01..0.01f64,
            s in proptest::array::uniform4(-0.02..0.02f64), x in -0.7..0.7f64, y in -0.5..0.5f64,
        ) {
            let lens = lens([k[0], k[1], p1, p2, k[2], k[3], k[4], k[5]], s);
            let ideal = Vector2::new(x, y);
            if ideal.norm() < 0.9 * lens.fold_radius() && let Some(pixel) = lens.pixel_from_ideal(ideal) {
                let back = lens.ideal_from_pixel(pixel);
                prop_assert!(back.is_some_and(|b| (b - ideal).norm() < 1e-8), "{back:?} for {ideal:?}");
            }
        }

        #[test]
        fn derivatives_match_differences(
            k in proptest::array::uniform6(-0.4..0.4f64), p1 in -0.01..0.01f64, p2 in -0.01..0.01f64,
            s in proptest::array::uniform4(-0.02..0.02f64),
            x in -0.5..0.5f64, y in -0.5..0.5f64, z in 0.5..2.0f64,
        ) {
            let lens = lens([k[0], k[1], p1, p2, k[2], k[3], k[4], k[5]], s);
            jacobians_match_differences::<ThinPrism, N>(&lens.interior(), &(Vector3::new(x, y, 1.0) * z))?;
        }
    }
}
