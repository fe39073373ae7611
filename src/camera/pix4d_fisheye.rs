//! Pix4D's fisheye, which Parrot's Sequoia writes into its photos: the image radius is a polynomial of the
//! off-axis angle with odd and even powers, over a full affine image plane.
//!
//! ```text
//! θ = angle between the point and the optical axis, 0 … π;  t = 2 θ / π
//! θ_d = θ (1 + rho2 t + rho3 t² + rho4 t³)
//! (x_d, y_d) = θ_d (X, Y) / √(X² + Y²)
//! column = fx x_d + skew y_d + cx,  row = row_skew x_d + fy y_d + cy
//! ```
//!
//! Pix4D writes ρ = p0 + p1 t + p2 t² + p3 t³ + p4 t⁴ with p0 = 0 and p1 = 1, and the affine matrix C D E F:
//! rho2, rho3, rho4 are its p2, p3, p4, and [`Pix4dFisheye::from_pix4d`] takes its numbers as they are.
//! fx is the focal length on the axis, Pix4D's F = 2 C / π.
//!
//! # Source
//! Pix4D, "Camera internals for fisheye lens", eqs. (1)–(5), and the article "How are the Internal and External
//! Camera Parameters defined?", where p4 is the last coefficient.

use super::ImagePoint;
use super::angular::{self, Polar};
use super::lens::{CameraError, LensFunction, LensKind, Projected, check_interior};
use super::plane;
use super::roots::first_root;
use crate::units::Radians;
use nalgebra::{Matrix2, SMatrix, Vector2, Vector3};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, PI};

/// Number of interior parameters.
const N: usize = 9;

/// Pix4D's fisheye over an affine image plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pix4dFisheye {
    interior: [f64; N],
    /// Off-axis angle at which the polynomial turns over, radians; infinite when it does not up to 180°.
    fold: f64,
}

impl Pix4dFisheye {
    /// Names of the interior parameters in the order of every vector and covariance of them.
    pub const NAMES: [&'static str; N] =
        ["fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "row_skew_px", "rho2", "rho3", "rho4"];

    /// From the parameters in the order of [`Pix4dFisheye::NAMES`]; lengths in pixels, terms dimensionless.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`], [`CameraError::FocalLength`] and [`CameraError::Affine`].
    pub fn new(interior: [f64; N]) -> Result<Self, CameraError> {
        // Of a camera it is near 0.5; far less could not be inverted to the accuracy that a proof asks for.
        const LEAST_SHARE: f64 = 1e-3;
        check_interior(&Self::NAMES, &interior)?;
        let affine = affine(&interior);
        let determinant = affine.determinant();
        if determinant.is_nan() || determinant <= LEAST_SHARE * affine.norm_squared() {
            return Err(CameraError::Affine { determinant });
        }
        let slope = slope_terms(&interior);
        Ok(Self { interior, fold: first_root(&slope, PI) })
    }

    /// From Pix4D's own numbers; the principal point in our pixels, (0, 0) the centre of the top-left one.
    ///
    /// - `affine`: C, D, E, F, px.
    /// - `polynomial`: p0, p1, p2, p3, p4.
    ///
    /// # Errors
    /// As [`Pix4dFisheye::new`], and [`CameraError::Polynomial`] when p0 is not 0 or p1 not positive: the axis
    /// would have no image, or all of the scene lie behind it.
    pub fn from_pix4d(
        affine: [f64; 4],
        polynomial: [f64; 5],
        principal_point: ImagePoint,
    ) -> Result<Self, CameraError> {
        let [p0, p1, p2, p3, p4] = polynomial;
        if p0 != 0.0 || p1.is_nan() || p1 <= 0.0 {
            return Err(CameraError::Polynomial { p0, p1 });
        }
        let [c, d, e, f] = affine.map(|v| v * p1 * FRAC_2_PI);
        let ImagePoint { column, row } = principal_point;
        Self::new([c, f, d, column, row, e, p2 / p1, p3 / p1, p4 / p1])
    }

    /// Pix4D's affine matrix C, D, E, F, px.
    #[must_use]
    pub fn pix4d_affine(&self) -> [f64; 4] {
        let [fx, fy, skew, _, _, row_skew, ..] = self.interior;
        [fx, skew, row_skew, fy].map(|v| v * FRAC_PI_2)
    }

    /// The parameters in the order of [`Pix4dFisheye::NAMES`].
    #[must_use]
    pub const fn interior(&self) -> [f64; N] {
        self.interior
    }

    /// Off-axis angle beyond which the lens folds back; infinite if not up to 180°.
    #[must_use]
    pub const fn fold_angle(&self) -> Radians {
        Radians::new(self.fold)
    }

    /// Pixel of a point in the camera frame, or `None` past the fold; points beside and behind the camera
    /// are seen too.
    #[must_use]
    pub fn pixel_from_point(&self, point: &Vector3<f64>) -> Option<ImagePoint> {
        let seen = point.xy().norm().atan2(point.z) < self.fold;
        if seen { Self::pixel_with(&self.interior, point) } else { None }
    }

    /// Unit direction that a pixel sees, or `None` where the lens has no inverse.
    #[must_use]
    pub fn direction_from_pixel(&self, pixel: ImagePoint) -> Option<Vector3<f64>> {
        let distorted = self.distorted_from_pixel(pixel)?;
        angular::direction(distorted, self.fold, |theta| polynomial(&self.interior, theta))
    }

    /// (X/Z, Y/Z) of the direction that a pixel sees, or `None` where the lens has no inverse or sees 89°
    /// and more off axis.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        angular::ideal(&self.direction_from_pixel(pixel)?)
    }

    /// As [`super::Fisheye::magnification`].
    #[must_use]
    pub fn magnification(&self, point: &Vector3<f64>) -> f64 {
        let (factor, slope) = polynomial(&self.interior, point.xy().norm().atan2(point.z));
        factor * slope
    }

    /// Distorted point of a pixel; `None` when the pixel is not finite.
    pub(super) fn distorted_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        let [_, _, _, cx, cy, ..] = self.interior;
        let offset = Vector2::new(pixel.column - cx, pixel.row - cy);
        let m = affine(&self.interior);
        let adjugate = Matrix2::new(m.m22, -m.m12, -m.m21, m.m11);
        (offset.x.is_finite() && offset.y.is_finite()).then(|| adjugate * offset / m.determinant())
    }

    /// θ_d/θ and dθ_d/dθ by powers of θ.
    pub(super) fn terms(&self) -> [[f64; 4]; 2] {
        [factor_terms(&self.interior), slope_terms(&self.interior)]
    }
}

/// θ_d/θ by powers of θ.
#[inline]
fn factor_terms(interior: &[f64; N]) -> [f64; 4] {
    let [.., rho2, rho3, rho4] = *interior;
    [1.0, rho2 * FRAC_2_PI, rho3 * FRAC_2_PI * FRAC_2_PI, rho4 * FRAC_2_PI * FRAC_2_PI * FRAC_2_PI]
}

/// dθ_d/dθ by powers of θ.
#[inline]
fn slope_terms(interior: &[f64; N]) -> [f64; 4] {
    let [one, a, b, c] = factor_terms(interior);
    [one, 2.0 * a, 3.0 * b, 4.0 * c]
}

/// θ_d/θ and dθ_d/dθ.
#[inline]
fn polynomial(interior: &[f64; N], theta: f64) -> (f64, f64) {
    let value = |[one, a, b, c]: [f64; 4]| one + theta * (a + theta * (b + theta * c));
    (value(factor_terms(interior)), value(slope_terms(interior)))
}

/// d(column, row)/d(distorted).
#[inline]
fn affine(interior: &[f64; N]) -> Matrix2<f64> {
    let [fx, fy, skew, _, _, row_skew, ..] = *interior;
    Matrix2::new(fx, skew, row_skew, fy)
}

#[inline]
fn pixel_from_distorted(interior: &[f64; N], d: Vector2<f64>) -> ImagePoint {
    let [_, _, _, cx, cy, ..] = *interior;
    let offset = affine(interior) * d;
    ImagePoint::new(offset.x + cx, offset.y + cy)
}

impl LensFunction<N> for Pix4dFisheye {
    const KIND: LensKind = LensKind::Pix4dFisheye;

    #[inline]
    fn pixel_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<ImagePoint> {
        let polar = Polar::of(point)?;
        let (factor, _) = polynomial(interior, polar.theta);
        Some(pixel_from_distorted(interior, point.xy() * (factor * polar.theta_by_r)))
    }

    #[inline]
    fn project_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<Projected<N>> {
        const ROW_SKEW: usize = 5;
        let polar = Polar::of(point)?;
        let Polar { theta, theta_by_r, .. } = polar;
        let (factor, slope) = polynomial(interior, theta);
        let distorted: Vector2<f64> = point.xy() * (factor * theta_by_r);
        let affine = affine(interior);
        let mut by_interior: SMatrix<f64, 2, N> = plane::by_affine(distorted);
        by_interior[(1, ROW_SKEW)] = distorted.x;
        let mut term = affine * point.xy() * theta_by_r;
        for k in ROW_SKEW + 1..N {
            term *= theta * FRAC_2_PI;
            by_interior.set_column(k, &term);
        }
        Some(Projected {
            pixel: pixel_from_distorted(interior, distorted),
            by_point: affine * polar.derivative(point, factor, slope),
            by_interior,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::jacobians_match_differences;
    use super::*;
    use proptest::prelude::*;

    fn lens(terms: [f64; 3]) -> Pix4dFisheye {
        let [rho2, rho3, rho4] = terms;
        Pix4dFisheye::new([1140.0, 1135.0, 2.0, 640.5, 480.25, -1.5, rho2, rho3, rho4]).unwrap()
    }

    #[test]
    fn it_agrees_with_pix4ds_formula() {
        // Numbers like a Sequoia's; python3 with numpy, the document's eqs. (1)–(4) in the frame x right, y down, z
        // forward, and half a pixel from the corner to the pixel's centre:
        //   t = 2/pi*arctan2(hypot(X, Y), Z); rho = t + p2*t**2 + p3*t**3; xh, yh = rho*X/R, rho*Y/R
        //   column = C*xh + D*yh + 626.66 - 0.5; row = E*xh + F*yh + 497.22 - 0.5
        let lens = Pix4dFisheye::from_pix4d(
            [1762.95, 0.8, -1.2, 1759.5],
            [0.0, 1.0, -0.13122419, -0.031571, 0.0],
            ImagePoint::new(626.66 - 0.5, 497.22 - 0.5),
        )
        .unwrap();
        let published = [
            ([0.0, 0.25, 1.0], (626.282_117_389_644_2, 765.301_933_848_729_7)),
            ([0.5, -0.7, 1.0], (1_058.815_075_033_249_7, -108.490_736_801_759_34)),
            ([-3.0, 1.0, 0.4], (-685.333_719_968_903_9, 933.987_911_172_771_6)),
        ];
        for (point, (column, row)) in published {
            let pixel = lens.pixel_from_point(&Vector3::from(point)).unwrap();
            assert!((pixel.column - column).abs() < 1e-9 && (pixel.row - row).abs() < 1e-9, "{pixel:?}");
        }
        let back = lens.pix4d_affine();
        assert!(back.iter().zip([1762.95, 0.8, -1.2, 1759.5]).all(|(a, b)| (a - b).abs() < 1e-9), "{back:?}");
    }

    #[test]
    fn a_polynomial_that_starts_elsewhere_is_scaled_or_refused() {
        let at = ImagePoint::new(500.0, 400.0);
        let plain = Pix4dFisheye::from_pix4d([800.0, 1.0, 2.0, 810.0], [0.0, 1.0, -0.1, 0.02, 0.01], at);
        let scaled = Pix4dFisheye::from_pix4d([400.0, 0.5, 1.0, 405.0], [0.0, 2.0, -0.2, 0.04, 0.02], at);
        let point = Vector3::new(0.7, -0.4, 1.0);
        let (plain, scaled) =
            (plain.unwrap().pixel_from_point(&point), scaled.unwrap().pixel_from_point(&point));
        assert!((plain.unwrap().column - scaled.unwrap().column).abs() < 1e-9);
        for polynomial in
            [[0.1, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0], [0.0, f64::NAN, 0.0, 0.0, 0.0]]
        {
            let refused = Pix4dFisheye::from_pix4d([800.0, 0.0, 0.0, 800.0], polynomial, at).unwrap_err();
            assert!(matches!(refused, CameraError::Polynomial { .. }), "{refused}");
        }
    }

    #[test]
    fn a_plane_that_is_flattened_or_mirrored_is_refused() {
        for row_skew in [800.0, 900.0] {
            let interior = [800.0, 800.0, 800.0, 500.0, 400.0, row_skew, 0.0, 0.0, 0.0];
            assert!(matches!(Pix4dFisheye::new(interior), Err(CameraError::Affine { .. })));
        }
    }

    #[test]
    fn the_axis_is_no_special_place() {
        let lens = lens([0.1, -0.02, 0.0]);
        let centre = ImagePoint::new(640.5, 480.25);
        assert_eq!(lens.pixel_from_point(&Vector3::new(0.0, 0.0, 2.0)), Some(centre));
        assert_eq!(lens.direction_from_pixel(centre), Some(Vector3::z()));
    }

    #[test]
    fn it_sees_nothing_past_its_fold() {
        // θ (1 − t/2) turns over at t = 1, θ = 90°.
        let lens = lens([-0.5, 0.0, 0.0]);
        assert!((lens.fold_angle().degrees() - 90.0).abs() < 1e-9, "{}", lens.fold_angle().degrees());
        let at = |theta: f64| lens.pixel_from_point(&Vector3::new(theta.sin(), 0.0, theta.cos()));
        assert!(at(1.55).is_some() && at(1.58).is_none());
        assert!(lens.direction_from_pixel(ImagePoint::new(640.5 + 1140.0 * 0.79, 480.25)).is_none());
    }

    proptest! {
        #[test]
        fn inverse_returns_every_visible_point(
            k in proptest::array::uniform3(-0.1..0.1f64), theta in 0.0..3.0f64, turn in 0.0..std::f64::consts::TAU,
        ) {
            let lens = lens(k);
            let direction =
                Vector3::new(theta.sin() * turn.cos(), theta.sin() * turn.sin(), theta.cos());
            if theta < 0.95 * lens.fold_angle().get() {
                let back = lens.pixel_from_point(&direction).and_then(|p| lens.direction_from_pixel(p));
                prop_assert!(back.is_some_and(|b| (b - direction).norm() < 1e-8), "{back:?} for {direction:?}");
            }
        }

        #[test]
        fn derivatives_match_differences(
            k in proptest::array::uniform3(-0.1..0.1f64), theta in 0.01..2.5f64, turn in 0.0..std::f64::consts::TAU,
            distance in 0.5..2.0f64,
        ) {
            let point = Vector3::new(theta.sin() * turn.cos(), theta.sin() * turn.sin(), theta.cos());
            jacobians_match_differences::<Pix4dFisheye, N>(&lens(k).interior(), &(point * distance))?;
        }
    }
}
