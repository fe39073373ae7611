//! Kannala–Brandt fisheye: the image radius is a polynomial of the off-axis angle.
//!
//! ```text
//! θ = angle between the point and the optical axis, 0 … π
//! θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)
//! (x_d, y_d) = θ_d (X, Y) / √(X² + Y²)
//! column = fx x_d + skew y_d + cx,  row = fy y_d + cy
//! ```
//!
//! # Source
//! Kannala and Brandt (2006), "A Generic Camera Model and Calibration Method for Conventional, Wide-Angle,
//! and Fish-Eye Lenses", eq. (6), scaled as OpenCV's `fisheye` module does (its α is skew / fx).

use super::ImagePoint;
use super::angular::{self, Polar};
use super::lens::{CameraError, LensFunction, LensKind, Projected, check_interior, pixel_from_distorted};
use super::plane;
use super::roots::first_root;
use crate::units::Radians;
use nalgebra::{SMatrix, Vector2, Vector3};

/// Number of interior parameters.
const N: usize = 9;

/// A fisheye over an affine image plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fisheye {
    interior: [f64; N],
    /// Off-axis angle at which the polynomial turns over, radians; infinite when it does not up to 180°.
    fold: f64,
}

impl Fisheye {
    /// Names of the interior parameters in the order of every vector and covariance of them.
    pub const NAMES: [&'static str; N] =
        ["fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "k1", "k2", "k3", "k4"];

    /// From the parameters in the order of [`Fisheye::NAMES`]; lengths in pixels, terms dimensionless.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::FocalLength`].
    pub fn new(interior: [f64; N]) -> Result<Self, CameraError> {
        check_interior(&Self::NAMES, &interior)?;
        let [.., k1, k2, k3, k4] = interior;
        // dθ_d/dθ in t = θ².
        let slope = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4];
        let half_turn = std::f64::consts::PI;
        Ok(Self { interior, fold: first_root(&slope, half_turn * half_turn).sqrt() })
    }

    /// The parameters in the order of [`Fisheye::NAMES`].
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
        let distorted = plane::distorted_from_pixel(&self.interior, pixel)?;
        angular::direction(distorted, self.fold, |theta| polynomial(&self.interior, theta))
    }

    /// (X/Z, Y/Z) of the direction that a pixel sees, or `None` where the lens has no inverse or sees 89°
    /// and more off axis.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        angular::ideal(&self.direction_from_pixel(pixel)?)
    }

    /// Image area that a piece of the scene covers, relative to the equidistant fisheye: 1 on the axis,
    /// falling to 0 where the lens folds.
    #[must_use]
    pub fn magnification(&self, point: &Vector3<f64>) -> f64 {
        let theta = point.xy().norm().atan2(point.z);
        let (factor, slope) = polynomial(&self.interior, theta);
        factor * slope
    }
}

/// θ_d/θ and dθ_d/dθ.
#[inline]
fn polynomial(interior: &[f64; N], theta: f64) -> (f64, f64) {
    let [.., k1, k2, k3, k4] = *interior;
    let t = theta * theta;
    let factor = 1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)));
    let slope = 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)));
    (factor, slope)
}

impl LensFunction<N> for Fisheye {
    const KIND: LensKind = LensKind::Fisheye;

    #[inline]
    fn pixel_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<ImagePoint> {
        let polar = Polar::of(point)?;
        let (factor, _) = polynomial(interior, polar.theta);
        Some(pixel_from_distorted(interior, point.xy() * (factor * polar.theta_by_r)))
    }

    #[inline]
    fn project_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<Projected<N>> {
        let polar = Polar::of(point)?;
        let Polar { theta, theta_by_r, .. } = polar;
        let (factor, slope) = polynomial(interior, theta);
        let distorted: Vector2<f64> = point.xy() * (factor * theta_by_r);
        let by_point = polar.derivative(point, factor, slope);
        let affine = plane::affine(interior);
        let mut by_interior: SMatrix<f64, 2, N> = plane::by_affine(distorted);
        let t = theta * theta;
        let mut term = affine * point.xy() * theta_by_r;
        for k in 5..N {
            term *= t;
            by_interior.set_column(k, &term);
        }
        Some(Projected {
            pixel: pixel_from_distorted(interior, distorted),
            by_point: affine * by_point,
            by_interior,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::jacobians_match_differences;
    use super::*;
    use proptest::prelude::*;

    fn lens(terms: [f64; 4]) -> Fisheye {
        let [k1, k2, k3, k4] = terms;
        Fisheye::new([300.0, 298.0, 0.4, 500.0, 400.0, k1, k2, k3, k4]).unwrap()
    }

    #[test]
    fn it_agrees_with_opencv() {
        // cv2.fisheye.projectPoints (5.0.0) with α = 0.001.
        let camera = Fisheye::new([
            558.478_087_865_323,
            560.506_767_351_568,
            0.558_478_087_865_323,
            620.458_515_360_843,
            381.939_667_848_348,
            -0.001_461_331_998_176_8,
            -0.003_298_611_105_804_01,
            0.006_057_600_885_901_83,
            -0.003_742_093_807_223_71,
        ])
        .unwrap();
        let published = [
            (Vector3::new(2.0, 0.0, 2.0), (1_058.526_250_886_269_7, 381.939_667_848_348)),
            (Vector3::new(0.5, -0.7, 1.0), (850.499_374_304_729_8, 58.259_435_697_218_46)),
            (Vector3::new(-3.0, 1.0, 0.4), (-119.289_023_151_056_2, 629.500_415_370_766_6)),
        ];
        for (point, (column, row)) in published {
            let pixel = camera.pixel_from_point(&point).unwrap();
            assert!((pixel.column - column).abs() < 1e-9 && (pixel.row - row).abs() < 1e-9, "{pixel:?}");
        }
    }

    #[test]
    fn it_sees_backwards_but_gives_no_ray_there() {
        let lens = lens([0.0; 4]);
        let back = Vector3::new(1.0, 0.0, -0.2);
        let pixel = lens.pixel_from_point(&back).unwrap();
        let direction = lens.direction_from_pixel(pixel).unwrap();
        assert!((direction - back.normalize()).norm() < 1e-12);
        assert!(lens.ideal_from_pixel(pixel).is_none());
    }

    #[test]
    fn the_axis_is_no_special_place() {
        let lens = lens([0.1, -0.02, 0.0, 0.0]);
        let at = |x: f64| Fisheye::project_with(&lens.interior(), &Vector3::new(x, 0.0, 2.0)).unwrap();
        assert_eq!(at(0.0).pixel, ImagePoint::new(500.0, 400.0));
        assert!((at(0.0).by_point - at(1e-6).by_point).norm() < 1e-3);
        assert_eq!(lens.direction_from_pixel(ImagePoint::new(500.0, 400.0)), Some(Vector3::z()));
        assert!(lens.pixel_from_point(&Vector3::new(0.0, 0.0, -1.0)).is_none());
    }

    #[test]
    fn a_fisheye_that_folds_sees_nothing_past_it() {
        // θ (1 − θ²/3) turns over at θ = 1.
        let lens = lens([-1.0 / 3.0, 0.0, 0.0, 0.0]);
        assert!((lens.fold_angle().get() - 1.0).abs() < 1e-12);
        let at = |theta: f64| lens.pixel_from_point(&Vector3::new(theta.sin(), 0.0, theta.cos()));
        assert!(at(0.99).is_some() && at(1.01).is_none());
        assert!(lens.direction_from_pixel(ImagePoint::new(500.0 + 300.0 * 0.67, 400.0)).is_none());
    }

    proptest! {
        #[test]
        fn inverse_returns_every_visible_point(
            k in proptest::array::uniform4(-0.1..0.1f64), theta in 0.0..3.0f64, turn in 0.0..std::f64::consts::TAU,
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
            k in proptest::array::uniform4(-0.1..0.1f64), theta in 0.01..2.5f64, turn in 0.0..std::f64::consts::TAU,
            distance in 0.5..2.0f64,
        ) {
            let point = Vector3::new(theta.sin() * turn.cos(), theta.sin() * turn.sin(), theta.cos());
            jacobians_match_differences::<Fisheye, N>(&lens(k).interior(), &(point * distance))?;
        }
    }
}
