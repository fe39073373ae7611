//! A calibrated camera: interior orientation, image size and covariance; and pixels that a program turned.

use super::ImagePoint;
use super::lens::{CameraError, InteriorCovariance, Lens, MAX_INTERIOR};
use crate::geometry::{Camera as CameraFrame, Displacement};
use nalgebra::{Matrix2, SMatrix};

/// A camera as the later stages use it.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Interior orientation and lens.
    pub lens: Lens,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Covariance of the interior parameters in the order of the lens's names, when the calibration knows
    /// it.
    pub covariance: Option<InteriorCovariance>,
}

impl Camera {
    /// From interior orientation and image size.
    ///
    /// # Errors
    /// [`CameraError::EmptyImage`].
    pub fn new(
        lens: impl Into<Lens>,
        width: u32,
        height: u32,
        covariance: Option<InteriorCovariance>,
    ) -> Result<Self, CameraError> {
        if width == 0 || height == 0 {
            return Err(CameraError::EmptyImage { width, height });
        }
        Ok(Self { lens: lens.into(), width, height, covariance })
    }

    /// The middle of the image (not the principal point).
    #[must_use]
    pub fn image_centre(&self) -> ImagePoint {
        ImagePoint::new(0.5 * (f64::from(self.width) - 1.0), 0.5 * (f64::from(self.height) - 1.0))
    }

    /// True when the pixel lies on the sensor: within half a pixel of a pixel centre.
    #[must_use]
    pub fn contains(&self, pixel: ImagePoint) -> bool {
        pixel.column >= -0.5
            && pixel.row >= -0.5
            && pixel.column <= f64::from(self.width) - 0.5
            && pixel.row <= f64::from(self.height) - 0.5
    }

    /// Viewing ray of a pixel: a direction whose component along the optical axis is 1, or `None` where
    /// the lens has no inverse. What a fisheye sees 89° and more off axis has no such ray: see
    /// [`Lens::direction_from_pixel`].
    #[must_use]
    pub fn ray_from_pixel(&self, pixel: ImagePoint) -> Option<Displacement<CameraFrame>> {
        self.lens.ideal_from_pixel(pixel).map(|ideal| Displacement::new(ideal.x, ideal.y, 1.0))
    }

    /// Pixel in which a direction is seen, or `None` behind the camera or past the fold of the lens. The
    /// pixel may lie outside the image: see [`Camera::contains`].
    #[must_use]
    pub fn pixel_from_ray(&self, ray: Displacement<CameraFrame>) -> Option<ImagePoint> {
        if ray.z() <= 0.0 {
            return None;
        }
        self.lens.pixel_from_point(&ray.vector())
    }

    /// True unless the lens squeezes the scene there to less than a quarter of its size elsewhere.
    ///
    /// Just inside its fold a lens still has an inverse, but a pixel there covers ever more ground and a
    /// pixel's error grows without bound: such a pixel can be located, but it is no material for a map.
    #[must_use]
    pub fn resolves(&self, ray: Displacement<CameraFrame>) -> bool {
        const LEAST_MAGNIFICATION: f64 = 0.25;
        self.lens.magnification(&ray.vector()) >= LEAST_MAGNIFICATION
    }

    /// Derivatives of the viewing ray's (x, y) by the pixel (2×2) and by the interior parameters (in the
    /// order of the lens's names, then zeros), or `None` where the lens has no inverse.
    ///
    /// # Source
    /// Implicit function theorem on [`Lens::project`].
    #[must_use]
    pub fn ray_derivatives(
        &self,
        pixel: ImagePoint,
    ) -> Option<(Matrix2<f64>, SMatrix<f64, 2, MAX_INTERIOR>)> {
        let projected = self.lens.project(&self.lens.ideal_from_pixel(pixel)?.push(1.0))?;
        let by_pixel = projected.by_point.fixed_columns::<2>(0).into_owned().try_inverse()?;
        Some((by_pixel, -by_pixel * projected.by_interior))
    }
}

/// How the pixels of a file were turned, clockwise, after the camera wrote them.
///
/// Viewers that "rotate" a photo move the pixels but not the lens: the interior orientation belongs to
/// the sensor, so a stored pixel is turned back before it is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelRotation {
    /// As the camera wrote them.
    #[default]
    None,
    /// A quarter turn clockwise.
    Clockwise90,
    /// Upside down.
    Half,
    /// A quarter turn counter-clockwise.
    Clockwise270,
}

impl PixelRotation {
    /// From whole quarter turns clockwise, any sign.
    #[must_use]
    pub const fn from_quarter_turns(turns: i64) -> Self {
        match turns.rem_euclid(4) {
            0 => Self::None,
            1 => Self::Clockwise90,
            2 => Self::Half,
            _ => Self::Clockwise270,
        }
    }
    /// Degrees clockwise.
    #[must_use]
    pub const fn degrees(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Clockwise90 => 90,
            Self::Half => 180,
            Self::Clockwise270 => 270,
        }
    }
    /// Size of the stored image for a sensor of this size.
    #[must_use]
    pub const fn stored_size(self, width: u32, height: u32) -> (u32, u32) {
        match self {
            Self::None | Self::Half => (width, height),
            Self::Clockwise90 | Self::Clockwise270 => (height, width),
        }
    }
    /// Stored pixel of a sensor pixel; `width` and `height` are the sensor's.
    #[must_use]
    pub fn stored_from_sensor(self, p: ImagePoint, width: u32, height: u32) -> ImagePoint {
        let (right, bottom) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        match self {
            Self::None => p,
            Self::Clockwise90 => ImagePoint::new(bottom - p.row, p.column),
            Self::Half => ImagePoint::new(right - p.column, bottom - p.row),
            Self::Clockwise270 => ImagePoint::new(p.row, right - p.column),
        }
    }
    /// Sensor pixel of a stored pixel; `width` and `height` are the sensor's.
    #[must_use]
    pub fn sensor_from_stored(self, p: ImagePoint, width: u32, height: u32) -> ImagePoint {
        let (right, bottom) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        match self {
            Self::None => p,
            Self::Clockwise90 => ImagePoint::new(p.row, bottom - p.column),
            Self::Half => ImagePoint::new(right - p.column, bottom - p.row),
            Self::Clockwise270 => ImagePoint::new(right - p.row, p.column),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Fisheye, Pix4dFisheye, Rational, ThinPrism};
    use super::*;
    use proptest::prelude::*;

    /// A camera of each lens.
    fn cameras() -> [Camera; 5] {
        let brown = Brown::new([744.0, 749.0, -0.8, 566.0, 345.0, -0.2, 0.1, 1e-3, -2e-3, -0.02]).unwrap();
        let rational =
            Rational::new([520.0, 523.0, 0.5, 566.0, 345.0, 0.4, 0.1, 5e-4, -4e-4, 0.01, 0.7, 0.2, 0.03])
                .unwrap();
        let fisheye = Fisheye::new([250.0, 251.0, 0.3, 566.0, 345.0, 0.03, -0.008, 0.003, -6e-4]).unwrap();
        let prism = ThinPrism::new([
            520.0, 523.0, 0.5, 566.0, 345.0, 0.4, 0.1, 5e-4, -4e-4, 0.01, 0.7, 0.2, 0.03, 2e-3, -1e-3, 3e-3,
            1e-3,
        ])
        .unwrap();
        let pix4d = Pix4dFisheye::new([250.0, 251.0, 0.3, 566.0, 345.0, -0.7, -0.13, 0.03, -0.02]).unwrap();
        [Lens::from(brown), rational.into(), prism.into(), pix4d.into(), fisheye.into()]
            .map(|lens| Camera::new(lens, 1152, 648, None).unwrap())
    }

    #[test]
    fn a_fisheye_gives_rays_up_to_89_degrees() {
        let [.., camera] = cameras();
        let at = |degrees: f64| {
            let (s, c) = crate::units::Radians::from_degrees(degrees).get().sin_cos();
            camera.lens.pixel_from_point(&nalgebra::Vector3::new(s, 0.0, c)).unwrap()
        };
        let ray = camera.ray_from_pixel(at(88.9)).unwrap();
        assert_eq!(ray.z(), 1.0);
        assert!((ray.x() - 52.0807).abs() < 1e-3, "{}", ray.x());
        assert!(camera.ray_from_pixel(at(89.1)).is_none() && camera.ray_from_pixel(at(120.0)).is_none());
        assert!(camera.lens.direction_from_pixel(at(120.0)).is_some());
        assert!(camera.pixel_from_ray(Displacement::new(1.0, 0.0, -0.1)).is_none());
    }

    proptest! {
        #[test]
        fn rays_derivatives_match_differences(column in 400.0..740.0f64, row in 200.0..500.0f64) {
            const STEP: f64 = 1e-4;
            for camera in cameras() {
                let pixel = ImagePoint::new(column, row);
                let (by_pixel, by_interior) = camera.ray_derivatives(pixel).unwrap();
                let ray = |lens: &Lens, p: ImagePoint| lens.ideal_from_pixel(p).unwrap();
                let size = by_pixel.norm();
                for (axis, (c, r)) in [(STEP, 0.0), (0.0, STEP)].into_iter().enumerate() {
                    let at = |sign: f64| ray(&camera.lens, ImagePoint::new(column + sign * c, row + sign * r));
                    let numeric = (at(1.0) - at(-1.0)) / (2.0 * STEP);
                    prop_assert!((numeric - by_pixel.column(axis)).norm() < 1e-5 * size);
                }
                for k in 0..camera.lens.names().len() {
                    let step = if k < 5 { STEP } else { 1e-7 };
                    let at = |sign: f64| {
                        let mut interior = camera.lens.interior();
                        interior[k] += sign * step;
                        ray(&Lens::new(camera.lens.kind(), &interior).unwrap(), pixel)
                    };
                    let numeric = (at(1.0) - at(-1.0)) / (2.0 * step);
                    let error = (numeric - by_interior.column(k)).norm();
                    prop_assert!(error < 1e-5 * (size + numeric.norm()), "{}: {error}", camera.lens.names()[k]);
                }
            }
        }
    }

    #[test]
    fn the_rim_of_a_folding_lens_is_no_material_for_a_map() {
        let paper =
            [743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018];
        let camera = Camera::new(Brown::new(paper).unwrap(), 1152, 648, None).unwrap();
        assert!(camera.resolves(Displacement::new(0.0, 0.0, 1.0)));
        assert!(camera.resolves(Displacement::new(0.8, 0.2, 1.0)));
        let rim = Displacement::new(0.945, 0.0, 1.0);
        assert!(camera.pixel_from_ray(rim).is_some() && !camera.resolves(rim));
    }

    #[test]
    fn turning_pixels_and_turning_back_is_nothing() {
        for turns in 0..4 {
            let rotation = PixelRotation::from_quarter_turns(turns);
            let sensor = ImagePoint::new(7.25, 3.5);
            let stored = rotation.stored_from_sensor(sensor, 40, 30);
            assert_eq!(rotation.sensor_from_stored(stored, 40, 30), sensor);
        }
        // A quarter turn clockwise brings the top-left pixel to the top right.
        let corner = PixelRotation::Clockwise90.stored_from_sensor(ImagePoint::new(0.0, 0.0), 40, 30);
        assert_eq!(corner, ImagePoint::new(29.0, 0.0));
    }
}
