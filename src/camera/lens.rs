//! What all lenses share: kinds, parameters, projection with derivatives, and the one that a camera has.

use super::ImagePoint;
use super::brown::Brown;
use super::fisheye::Fisheye;
use super::plane;
use super::rational::Rational;
use crate::units::Radians;
use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};

/// The most interior parameters that any lens has.
pub const MAX_INTERIOR: usize = 13;

/// Interior parameters of any lens in the order of its names, then zeros.
pub type Interior = [f64; MAX_INTERIOR];

/// Covariance of the interior parameters in the order of the lens's names, units squared, then zeros.
///
/// One size for all lenses, so that it is copied and used without allocation.
pub type InteriorCovariance = SMatrix<f64, MAX_INTERIOR, MAX_INTERIOR>;

/// Why a set of interior parameters is no camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A parameter is NaN or infinite.
    #[error("camera parameter {name} is {value}")]
    NotFinite {
        /// One of the lens's names.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A focal length is not positive.
    #[error("focal length {name} is {value} px, it must be positive")]
    FocalLength {
        /// `fx_px` or `fy_px`.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// The image has no pixels.
    #[error("camera image size {width} × {height} px has no pixels")]
    EmptyImage {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// The kinds of lens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LensKind {
    /// Brown: the paper's five terms.
    Brown,
    /// OpenCV's rational lens: Brown with a radial denominator.
    Rational,
    /// Kannala–Brandt fisheye: a polynomial of the off-axis angle.
    Fisheye,
}

impl LensKind {
    /// All of them, simplest first.
    pub const ALL: [Self; 3] = [Self::Brown, Self::Fisheye, Self::Rational];

    /// Names of the interior parameters in the order of every vector and covariance of them; the first five
    /// are `fx_px`, `fy_px`, `skew_px`, `cx_px`, `cy_px` for every kind.
    #[must_use]
    pub const fn names(self) -> &'static [&'static str] {
        match self {
            Self::Brown => &Brown::NAMES,
            Self::Rational => &Rational::NAMES,
            Self::Fisheye => &Fisheye::NAMES,
        }
    }

    /// The word for it in camera files.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Brown => "brown",
            Self::Rational => "rational",
            Self::Fisheye => "fisheye",
        }
    }
}

/// A forward projection with its derivatives, of a lens with `N` interior parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projected<const N: usize> {
    /// Where the point is seen.
    pub pixel: ImagePoint,
    /// d(column, row) / d(X, Y, Z) of the point in the camera frame, px per unit of the point.
    pub by_point: Matrix2x3<f64>,
    /// d(column, row) / d(interior), columns in the order of the lens's names.
    pub by_interior: SMatrix<f64, 2, N>,
}

/// A lens as a function of its parameters: what a calibration estimates.
///
/// Neither function asks whether the lens folds back there: an adjustment may pass through such points on
/// its way.
pub trait LensFunction<const N: usize>: Copy + Send + Sync {
    /// Which lens it is.
    const KIND: LensKind;

    /// Pixel of a point in the camera frame, or `None` where the lens has no image of it at all: behind a
    /// pinhole, or at a pole.
    fn pixel_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<ImagePoint>;

    /// As [`LensFunction::pixel_with`], with derivatives.
    fn project_with(interior: &[f64; N], point: &Vector3<f64>) -> Option<Projected<N>>;
}

/// Checks what all lenses ask of their parameters.
pub(super) fn check_interior(names: &[&'static str], interior: &[f64]) -> Result<(), CameraError> {
    for (&name, &value) in names.iter().zip(interior) {
        if !value.is_finite() {
            return Err(CameraError::NotFinite { name, value });
        }
    }
    for (&name, &value) in names.iter().zip(interior).take(2) {
        if value <= 0.0 {
            return Err(CameraError::FocalLength { name, value });
        }
    }
    Ok(())
}

/// Pixel of a distorted point, fx, fy, skew, cx, cy leading the interior parameters.
#[inline]
pub(super) fn pixel_from_distorted(interior: &[f64], d: Vector2<f64>) -> ImagePoint {
    let [fx, fy, skew, cx, cy, ..] = *interior else { return ImagePoint::new(f64::NAN, f64::NAN) };
    ImagePoint::new(fx * d.x + skew * d.y + cx, fy * d.y + cy)
}

/// The lens of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Brown.
    Brown(Brown),
    /// OpenCV's rational lens.
    Rational(Rational),
    /// Kannala–Brandt fisheye.
    Fisheye(Fisheye),
}

impl From<Brown> for Lens {
    fn from(lens: Brown) -> Self {
        Self::Brown(lens)
    }
}

impl From<Rational> for Lens {
    fn from(lens: Rational) -> Self {
        Self::Rational(lens)
    }
}

impl From<Fisheye> for Lens {
    fn from(lens: Fisheye) -> Self {
        Self::Fisheye(lens)
    }
}

impl Lens {
    /// Of a kind, from its parameters in the order of [`LensKind::names`]; what follows them is not used.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::FocalLength`].
    pub fn new(kind: LensKind, interior: &Interior) -> Result<Self, CameraError> {
        Ok(match kind {
            LensKind::Brown => Self::Brown(Brown::new(leading(interior))?),
            LensKind::Rational => Self::Rational(Rational::new(leading(interior))?),
            LensKind::Fisheye => Self::Fisheye(Fisheye::new(leading(interior))?),
        })
    }

    /// Which kind it is.
    #[must_use]
    pub const fn kind(&self) -> LensKind {
        match self {
            Self::Brown(_) => LensKind::Brown,
            Self::Rational(_) => LensKind::Rational,
            Self::Fisheye(_) => LensKind::Fisheye,
        }
    }

    /// Names of its parameters: see [`LensKind::names`].
    #[must_use]
    pub const fn names(&self) -> &'static [&'static str] {
        self.kind().names()
    }

    /// Its parameters in the order of [`Lens::names`], then zeros.
    #[must_use]
    pub fn interior(&self) -> Interior {
        match self {
            Self::Brown(lens) => padded(lens.interior()),
            Self::Rational(lens) => padded(lens.interior()),
            Self::Fisheye(lens) => padded(lens.interior()),
        }
    }

    /// Off-axis angle beyond which the lens folds back or has a pole; infinite if it never does.
    #[must_use]
    pub fn fold_angle(&self) -> Radians {
        match self {
            Self::Brown(lens) => angle_of(lens.fold_radius()),
            Self::Rational(lens) => angle_of(lens.fold_radius()),
            Self::Fisheye(lens) => lens.fold_angle(),
        }
    }

    /// Ideal radius (tangent of the off-axis angle) beyond which the lens folds back; infinite when it does
    /// not within 90° of the axis.
    #[must_use]
    pub fn fold_radius(&self) -> f64 {
        match self {
            Self::Brown(lens) => lens.fold_radius(),
            Self::Rational(lens) => lens.fold_radius(),
            Self::Fisheye(lens) => {
                let angle = lens.fold_angle().get();
                if angle < std::f64::consts::FRAC_PI_2 { angle.tan() } else { f64::INFINITY }
            }
        }
    }

    /// Pixel of a point in the camera frame, or `None` where the lens does not see it: behind a pinhole or
    /// past the fold.
    #[must_use]
    pub fn pixel_from_point(&self, point: &Vector3<f64>) -> Option<ImagePoint> {
        match self {
            Self::Brown(lens) => plane::ideal(point).and_then(|ideal| lens.pixel_from_ideal(ideal)),
            Self::Rational(lens) => plane::ideal(point).and_then(|ideal| lens.pixel_from_ideal(ideal)),
            Self::Fisheye(lens) => lens.pixel_from_point(point),
        }
    }

    /// Direction that a pixel sees, or `None` where the lens has no inverse. Unit length for a fisheye,
    /// which sees to the side and backwards; component 1 along the axis for the others.
    #[must_use]
    pub fn direction_from_pixel(&self, pixel: ImagePoint) -> Option<Vector3<f64>> {
        match self {
            Self::Brown(lens) => lens.ideal_from_pixel(pixel).map(|ideal| ideal.push(1.0)),
            Self::Rational(lens) => lens.ideal_from_pixel(pixel).map(|ideal| ideal.push(1.0)),
            Self::Fisheye(lens) => lens.direction_from_pixel(pixel),
        }
    }

    /// (X/Z, Y/Z) of the direction that a pixel sees, or `None` where the lens has no inverse or sees 89°
    /// and more off axis.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        match self {
            Self::Brown(lens) => lens.ideal_from_pixel(pixel),
            Self::Rational(lens) => lens.ideal_from_pixel(pixel),
            Self::Fisheye(lens) => lens.ideal_from_pixel(pixel),
        }
    }

    /// Pixel of a point in the camera frame with derivatives, whether the lens folds there or not.
    #[must_use]
    pub fn project(&self, point: &Vector3<f64>) -> Option<Projected<MAX_INTERIOR>> {
        match self {
            Self::Brown(lens) => Brown::project_with(&lens.interior(), point).map(padded_projection),
            Self::Rational(lens) => Rational::project_with(&lens.interior(), point).map(padded_projection),
            Self::Fisheye(lens) => Fisheye::project_with(&lens.interior(), point).map(padded_projection),
        }
    }

    /// Image area that a piece of the scene covers, relative to the same lens without distortion: 1 on the
    /// axis of most lenses, falling to 0 where the lens folds. The undistorted fisheye is the equidistant
    /// one, the undistorted lens of the others a pinhole.
    ///
    /// - `point`: in the camera frame.
    #[must_use]
    pub fn magnification(&self, point: &Vector3<f64>) -> f64 {
        let ideal = || Vector2::new(point.x / point.z, point.y / point.z);
        match self {
            Self::Brown(lens) => lens.magnification(ideal()),
            Self::Rational(lens) => lens.magnification(ideal()),
            Self::Fisheye(lens) => lens.magnification(point),
        }
    }
}

fn angle_of(radius: f64) -> Radians {
    Radians::new(if radius.is_finite() { radius.atan() } else { f64::INFINITY })
}

fn leading<const N: usize>(interior: &Interior) -> [f64; N] {
    std::array::from_fn(|k| interior[k])
}

fn padded<const N: usize>(interior: [f64; N]) -> Interior {
    std::array::from_fn(|k| interior.get(k).copied().unwrap_or(0.0))
}

fn padded_projection<const N: usize>(projected: Projected<N>) -> Projected<MAX_INTERIOR> {
    let mut by_interior = SMatrix::<f64, 2, MAX_INTERIOR>::zeros();
    for k in 0..N {
        by_interior.set_column(k, &projected.by_interior.column(k));
    }
    Projected { pixel: projected.pixel, by_point: projected.by_point, by_interior }
}
