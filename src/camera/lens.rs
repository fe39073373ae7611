//! What all lenses share: kinds, parameters, projection with derivatives, and the one that a camera has.

use super::ImagePoint;
use super::brown::Brown;
use super::fisheye::Fisheye;
use super::pix4d_fisheye::Pix4dFisheye;
use super::plane;
use super::rational::Rational;
use super::thin_prism::ThinPrism;
use crate::units::Radians;
use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};

/// The most interior parameters that any lens has.
pub const MAX_INTERIOR: usize = 17;

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
    /// The affine matrix of a fisheye is flat or mirrors the image.
    #[error(
        "the affine matrix of the image plane has the determinant {determinant} px²: it is flat or mirrored"
    )]
    Affine {
        /// Of d(column, row)/d(distorted), px².
        determinant: f64,
    },
    /// A fisheye polynomial that does not start on the axis or does not rise from it.
    #[error("the fisheye polynomial begins with {p0} and {p1}: it must begin with 0 and a positive number")]
    Polynomial {
        /// Constant term.
        p0: f64,
        /// Linear term.
        p1: f64,
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
    /// OpenCV's rational lens with a thin prism: twelve terms.
    ThinPrism,
    /// Kannala–Brandt fisheye: an odd polynomial of the off-axis angle.
    Fisheye,
    /// Pix4D's fisheye, the Sequoia's: a polynomial of the off-axis angle over a full affine plane.
    Pix4dFisheye,
}

impl LensKind {
    /// All of them, simplest first.
    pub const ALL: [Self; 5] =
        [Self::Brown, Self::Fisheye, Self::Pix4dFisheye, Self::Rational, Self::ThinPrism];

    /// Names of the interior parameters in the order of every vector and covariance of them; the first five
    /// are `fx_px`, `fy_px`, `skew_px`, `cx_px`, `cy_px` for every kind.
    #[must_use]
    pub const fn names(self) -> &'static [&'static str] {
        match self {
            Self::Brown => &Brown::NAMES,
            Self::Rational => &Rational::NAMES,
            Self::Fisheye => &Fisheye::NAMES,
            Self::ThinPrism => &ThinPrism::NAMES,
            Self::Pix4dFisheye => &Pix4dFisheye::NAMES,
        }
    }

    /// True of the lenses that see by angles, to the side and backwards; false of those on the ideal plane.
    #[must_use]
    pub const fn is_fisheye(self) -> bool {
        matches!(self, Self::Fisheye | Self::Pix4dFisheye)
    }

    /// The word for it in camera files.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Brown => "brown",
            Self::Rational => "rational",
            Self::Fisheye => "fisheye",
            Self::ThinPrism => "thin_prism",
            Self::Pix4dFisheye => "pix4d_fisheye",
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
    /// OpenCV's rational lens with a thin prism.
    ThinPrism(ThinPrism),
    /// Pix4D's fisheye.
    Pix4dFisheye(Pix4dFisheye),
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

impl From<ThinPrism> for Lens {
    fn from(lens: ThinPrism) -> Self {
        Self::ThinPrism(lens)
    }
}

impl From<Pix4dFisheye> for Lens {
    fn from(lens: Pix4dFisheye) -> Self {
        Self::Pix4dFisheye(lens)
    }
}

impl Lens {
    /// Of a kind, from its parameters in the order of [`LensKind::names`]; what follows them is not used.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`], [`CameraError::FocalLength`] and [`CameraError::Affine`].
    pub fn new(kind: LensKind, interior: &Interior) -> Result<Self, CameraError> {
        Ok(match kind {
            LensKind::Brown => Self::Brown(Brown::new(leading(interior))?),
            LensKind::Rational => Self::Rational(Rational::new(leading(interior))?),
            LensKind::Fisheye => Self::Fisheye(Fisheye::new(leading(interior))?),
            LensKind::ThinPrism => Self::ThinPrism(ThinPrism::new(leading(interior))?),
            LensKind::Pix4dFisheye => Self::Pix4dFisheye(Pix4dFisheye::new(leading(interior))?),
        })
    }

    /// Which kind it is.
    #[must_use]
    pub const fn kind(&self) -> LensKind {
        match self {
            Self::Brown(_) => LensKind::Brown,
            Self::Rational(_) => LensKind::Rational,
            Self::Fisheye(_) => LensKind::Fisheye,
            Self::ThinPrism(_) => LensKind::ThinPrism,
            Self::Pix4dFisheye(_) => LensKind::Pix4dFisheye,
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
            Self::ThinPrism(lens) => padded(lens.interior()),
            Self::Pix4dFisheye(lens) => padded(lens.interior()),
        }
    }

    /// Off-axis angle beyond which the lens folds back or has a pole; infinite if it never does.
    #[must_use]
    pub fn fold_angle(&self) -> Radians {
        match self {
            Self::Brown(lens) => angle_of(lens.fold_radius()),
            Self::Rational(lens) => angle_of(lens.fold_radius()),
            Self::Fisheye(lens) => lens.fold_angle(),
            Self::ThinPrism(lens) => angle_of(lens.fold_radius()),
            Self::Pix4dFisheye(lens) => lens.fold_angle(),
        }
    }

    /// Ideal radius (tangent of the off-axis angle) beyond which the lens folds back; infinite when it does
    /// not within 90° of the axis.
    #[must_use]
    pub fn fold_radius(&self) -> f64 {
        match self {
            Self::Brown(lens) => lens.fold_radius(),
            Self::Rational(lens) => lens.fold_radius(),
            Self::ThinPrism(lens) => lens.fold_radius(),
            Self::Fisheye(lens) => tangent_of(lens.fold_angle()),
            Self::Pix4dFisheye(lens) => tangent_of(lens.fold_angle()),
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
            Self::ThinPrism(lens) => plane::ideal(point).and_then(|ideal| lens.pixel_from_ideal(ideal)),
            Self::Pix4dFisheye(lens) => lens.pixel_from_point(point),
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
            Self::ThinPrism(lens) => lens.ideal_from_pixel(pixel).map(|ideal| ideal.push(1.0)),
            Self::Pix4dFisheye(lens) => lens.direction_from_pixel(pixel),
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
            Self::ThinPrism(lens) => lens.ideal_from_pixel(pixel),
            Self::Pix4dFisheye(lens) => lens.ideal_from_pixel(pixel),
        }
    }

    /// Distorted point of a pixel; `None` when the pixel is not finite.
    pub(super) fn distorted_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        match self {
            Self::Pix4dFisheye(lens) => lens.distorted_from_pixel(pixel),
            _ => plane::distorted_from_pixel(&self.interior(), pixel),
        }
    }

    /// Pixel of a point in the camera frame with derivatives, whether the lens folds there or not.
    #[must_use]
    pub fn project(&self, point: &Vector3<f64>) -> Option<Projected<MAX_INTERIOR>> {
        match self {
            Self::Brown(lens) => Brown::project_with(&lens.interior(), point).map(padded_projection),
            Self::Rational(lens) => Rational::project_with(&lens.interior(), point).map(padded_projection),
            Self::Fisheye(lens) => Fisheye::project_with(&lens.interior(), point).map(padded_projection),
            Self::ThinPrism(lens) => ThinPrism::project_with(&lens.interior(), point).map(padded_projection),
            Self::Pix4dFisheye(lens) => {
                Pix4dFisheye::project_with(&lens.interior(), point).map(padded_projection)
            }
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
            Self::ThinPrism(lens) => lens.magnification(ideal()),
            Self::Pix4dFisheye(lens) => lens.magnification(point),
        }
    }
}

fn angle_of(radius: f64) -> Radians {
    Radians::new(if radius.is_finite() { radius.atan() } else { f64::INFINITY })
}

fn tangent_of(angle: Radians) -> f64 {
    if angle.get() < std::f64::consts::FRAC_PI_2 { angle.get().tan() } else { f64::INFINITY }
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
