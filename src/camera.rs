//! The camera: interior orientation and lens, both ways, with Jacobians.
//!
//! A [`Lens`] is Brown's (the paper's), OpenCV's rational one without or with a thin prism, a Kannala–Brandt
//! fisheye or Pix4D's. Affinity and skew of other programs (B1, B2) are fx, fy and skew of every lens.
//! `pixel_from_ray` projects, `ray_from_pixel` inverts, and a pixel whose lens has no inverse is an
//! `Option::None`, never an extrapolation. Pixel (0, 0) is the centre of the top-left pixel; column runs
//! right, row runs down.

mod angular;
mod brown;
mod fisheye;
mod interval;
mod inverse;
mod invertibility;
mod lens;
mod pix4d_fisheye;
mod plane;
mod rational;
mod roots;
mod sensor;
mod thin_prism;

#[cfg(test)]
mod check;

pub use brown::Brown;
pub use fisheye::Fisheye;
pub use invertibility::{FoldMask, Invertibility};
pub use lens::{
    CameraError, Interior, InteriorCovariance, Lens, LensFunction, LensKind, MAX_INTERIOR, Projected,
};
pub use pix4d_fisheye::Pix4dFisheye;
pub use rational::Rational;
pub use sensor::{Camera, PixelRotation};
pub use thin_prism::ThinPrism;

/// A position in an image: (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePoint {
    /// Pixels to the right.
    pub column: f64,
    /// Pixels down.
    pub row: f64,
}

impl ImagePoint {
    /// From column and row.
    #[must_use]
    pub const fn new(column: f64, row: f64) -> Self {
        Self { column, row }
    }
}
