//! One georeferenced frame: its pose, its ground, and the two questions everything else asks of it,
//! "where is this pixel?" and "which pixel sees this place?".

use super::chain::Chain;
use super::footprint::Footprint;
use crate::camera::{Camera, ImagePoint, PixelRotation};
use crate::geodesy::{Geodetic, WGS84};
use crate::geometry::{Camera as CameraFrame, Displacement, Ecef, Point, Pose};
use crate::navigation::{Mount, NavigationRecord};
use crate::terrain::{ConstantHeight, GroundMiss, Ray, Terrain, ground_from_ray};
use std::sync::Arc;

/// A frame with a pose and ground under it.
#[derive(Clone)]
pub struct GeoreferencedFrame {
    /// The image's file name.
    pub name: String,
    /// The record that the pose came from, at the instant of exposure.
    pub record: NavigationRecord,
    /// How the camera that took it is mounted.
    pub mount: Mount,
    /// The chain of frames.
    pub chain: Chain,
    /// The camera that took it.
    pub camera: Arc<Camera>,
    /// How its stored pixels are turned against the sensor.
    pub pixel_rotation: PixelRotation,
    /// The ground under it.
    pub ground: Arc<dyn Terrain>,
    /// Ground farther than this from the camera is not used, metres.
    pub max_range_m: f64,
    /// What it sees of the ground.
    pub footprint: Footprint,
    ecef_from_camera: Pose<Ecef, CameraFrame>,
    camera_from_ecef: Pose<CameraFrame, Ecef>,
}

impl std::fmt::Debug for GeoreferencedFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GeoreferencedFrame").field("name", &self.name).finish_non_exhaustive()
    }
}

/// Why a frame cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// The pose is not finite.
    #[error("the pose is not finite")]
    NotFinite,
    /// No pixel of it sees usable ground.
    #[error("no pixel sees the ground: at the image centre, {cause}")]
    NoGround {
        /// What happens at the image centre.
        cause: LocateError,
    },
}

/// Why a pixel has no ground point.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LocateError {
    /// Outside the image.
    #[error("pixel ({column}, {row}) lies outside the {width} × {height} image")]
    OutsideImage {
        /// Asked for.
        column: f64,
        /// Asked for.
        row: f64,
        /// Stored width.
        width: u32,
        /// Stored height.
        height: u32,
    },
    /// The lens has no inverse there.
    #[error("the lens has no inverse at pixel ({column}, {row})")]
    NoRay {
        /// Asked for.
        column: f64,
        /// Asked for.
        row: f64,
    },
    /// The ray misses the ground.
    #[error(transparent)]
    Miss(#[from] GroundMiss),
}

/// A ground point and the view that gave it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundPoint {
    /// Where.
    pub position: Geodetic,
    /// Viewing ray in ECEF.
    pub ray: Ray,
    /// Distance from the projection centre, metres.
    pub range_m: f64,
}

impl GeoreferencedFrame {
    /// Links the chain and finds the footprint.
    ///
    /// # Errors
    /// [`FrameError`] when the pose is not finite or nothing of the ground is seen.
    pub fn new(
        name: String,
        record: NavigationRecord,
        mount: &Mount,
        camera: Arc<Camera>,
        ground: Arc<dyn Terrain>,
        max_range_m: f64,
    ) -> Result<Self, FrameError> {
        let chain = Chain::new(&record, mount);
        let ecef_from_camera = chain.ecef_from_camera();
        let finite = ecef_from_camera.origin.is_finite()
            && ecef_from_camera.rotation.matrix().iter().all(|v| v.is_finite());
        if !finite {
            return Err(FrameError::NotFinite);
        }
        let pixel_rotation = record.pixel_rotation.unwrap_or(mount.pixel_rotation);
        let mut frame = Self {
            name,
            record,
            mount: *mount,
            chain,
            camera,
            pixel_rotation,
            ground,
            max_range_m,
            footprint: Footprint::default(),
            ecef_from_camera,
            camera_from_ecef: ecef_from_camera.inverse(),
        };
        frame.footprint = Footprint::of(&frame).map_err(|cause| FrameError::NoGround { cause })?;
        Ok(frame)
    }

    /// Pose of the camera in ECEF.
    #[must_use]
    pub const fn ecef_from_camera(&self) -> &Pose<Ecef, CameraFrame> {
        &self.ecef_from_camera
    }

    /// Size of the stored image, columns and rows.
    #[must_use]
    pub fn stored_size(&self) -> (u32, u32) {
        self.pixel_rotation.stored_size(self.camera.width, self.camera.height)
    }

    /// Middle of the stored image.
    #[must_use]
    pub fn image_centre(&self) -> ImagePoint {
        let (w, h) = self.stored_size();
        ImagePoint::new(0.5 * (f64::from(w) - 1.0), 0.5 * (f64::from(h) - 1.0))
    }

    /// Sensor pixel of a stored pixel.
    #[must_use]
    pub fn sensor_from_stored(&self, stored: ImagePoint) -> ImagePoint {
        self.pixel_rotation.sensor_from_stored(stored, self.camera.width, self.camera.height)
    }

    /// True when a stored pixel is material for a map: see [`Camera::resolves`].
    #[must_use]
    pub fn resolves(&self, stored: ImagePoint) -> bool {
        self.camera
            .ray_from_pixel(self.sensor_from_stored(stored))
            .is_some_and(|ray| self.camera.resolves(ray))
    }

    /// Viewing ray of a stored pixel in ECEF.
    ///
    /// # Errors
    /// [`LocateError::OutsideImage`] and [`LocateError::NoRay`].
    pub fn ray_from_pixel(&self, stored: ImagePoint) -> Result<Ray, LocateError> {
        let sensor = self.sensor_from_stored(stored);
        if !self.camera.contains(sensor) {
            let (width, height) = self.stored_size();
            return Err(LocateError::OutsideImage { column: stored.column, row: stored.row, width, height });
        }
        let ray = self
            .camera
            .ray_from_pixel(sensor)
            .ok_or(LocateError::NoRay { column: stored.column, row: stored.row })?;
        Ok(Ray::new(self.ecef_from_camera.origin, self.ecef_from_camera * ray))
    }

    /// Ground point seen by a stored pixel: eqs. (8)–(10).
    ///
    /// # Errors
    /// [`LocateError`]: outside the image, no inverse lens, or no ground there.
    pub fn ground_from_pixel(&self, stored: ImagePoint) -> Result<GroundPoint, LocateError> {
        self.ground_from_pixel_over(stored, self.ground.as_ref())
    }

    /// As [`Self::ground_from_pixel`], at a given ellipsoidal height instead of the frame's own ground.
    ///
    /// # Errors
    /// As [`Self::ground_from_pixel`].
    pub fn ground_from_pixel_at_height(
        &self,
        stored: ImagePoint,
        height_m: f64,
    ) -> Result<GroundPoint, LocateError> {
        self.ground_from_pixel_over(stored, &ConstantHeight { height_m })
    }

    fn ground_from_pixel_over(
        &self,
        stored: ImagePoint,
        ground: &dyn Terrain,
    ) -> Result<GroundPoint, LocateError> {
        let ray = self.ray_from_pixel(stored)?;
        let position = ground_from_ray(&ray, ground, self.max_range_m)?;
        let range_m = ray.origin.distance_to(&WGS84.ecef_from_geodetic(&position));
        Ok(GroundPoint { position, ray, range_m })
    }

    /// Stored pixel that sees an ECEF point, which may lie outside the image; `None` behind the camera, at or
    /// past the fold of the lens ([`Camera::resolves`]), or beyond the range limit. Whether the ground in between hides the point
    /// is not asked.
    #[must_use]
    pub fn pixel_from_ecef(&self, point: &Point<Ecef>) -> Option<ImagePoint> {
        let in_camera = self.camera_from_ecef * *point;
        let ray = Displacement::from_vector(in_camera.vector());
        if ray.vector().norm() > self.max_range_m {
            return None;
        }
        let sensor = self.camera.pixel_from_ray(ray)?;
        if !self.camera.resolves(ray) {
            return None;
        }
        Some(self.pixel_rotation.stored_from_sensor(sensor, self.camera.width, self.camera.height))
    }

    /// True when a stored pixel lies on the image: within half a pixel of a pixel centre.
    #[must_use]
    pub fn contains(&self, stored: ImagePoint) -> bool {
        self.camera.contains(self.sensor_from_stored(stored))
    }
}
