//! The camera: interior orientation and lens, both ways, with Jacobians.
//!
//! `pixel_from_ray` projects, `ray_from_pixel` inverts, and a pixel whose lens has no inverse is an
//! `Option::None`, never an extrapolation. Pixel (0, 0) is the centre of the top-left pixel; column runs
//! right, row runs down.

mod brown;
mod sensor;

pub use brown::{Brown, CameraError, INTERIOR_NAMES, InteriorCovariance};
pub use sensor::{Camera, PixelRotation};

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
