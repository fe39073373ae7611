//! Mounting: lever arms, boresight, gimbal.

use crate::camera::PixelRotation;
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Body, Camera, Displacement, Frame, Gimbal, Rotation};
use crate::units::Radians;
use nalgebra::Matrix3;

/// Gimbal angles: `R = Rz(pan)·Ry(elevation)·Rx(roll)`, the gimbal's x axis being the optical axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GimbalAngles {
    /// About the reference's z (down): clockwise seen from above.
    pub pan: Radians,
    /// Positive up from the reference's x-y plane; -90° looks straight down. (The paper's tilt of
    /// sect. 4.3 is the negative of this; its tilt of sect. 4.1 is this.)
    pub elevation: Radians,
    /// About the optical axis: positive clockwise seen along it.
    pub roll: Radians,
}

impl GimbalAngles {
    /// Straight down with the image's top towards the nose.
    pub const NADIR: Self =
        Self { pan: Radians::new(0.0), elevation: Radians::from_degrees(-90.0), roll: Radians::new(0.0) };

    /// Rotation from the gimbal's inner frame to the frame its angles are counted from.
    ///
    /// # Source
    /// Hemerly (2014), `C_bg` of eq. (8): `Rz(pan)·Ry(-tilt)`, here with a third axis.
    #[must_use]
    pub fn rotation<Reference: Frame>(&self) -> Rotation<Reference, Gimbal> {
        self.as_yaw_pitch_roll().rotation()
    }

    /// The same angles under the names of the attitude: pan turns like yaw, elevation like pitch.
    #[must_use]
    pub const fn as_yaw_pitch_roll(&self) -> YawPitchRoll {
        YawPitchRoll::new(self.pan, self.elevation, self.roll)
    }
}

/// What gimbal angles are counted from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GimbalReference {
    /// The UAV's axes: encoders of a gimbal, or a camera fixed to the airframe.
    #[default]
    Body,
    /// North and the horizon: a stabilised gimbal with its own attitude (DJI).
    Nav,
}

/// How antenna, gimbal and camera sit on the UAV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// From the UAV's reference point to the antenna whose position is logged.
    pub antenna_in_body: Displacement<Body>,
    /// `ArmG` of eq. (8): from the UAV's reference point to the gimbal's centre.
    pub gimbal_in_body: Displacement<Body>,
    /// `ArmC` of eq. (8): from the gimbal's centre to the projection centre.
    pub camera_in_gimbal: Displacement<Gimbal>,
    /// Misalignment `Rz(yaw)·Ry(pitch)·Rx(roll)` between the attitude unit and the camera's mount, about
    /// the axes that the gimbal angles are counted from (body axes), or about the gimbal's own axes when
    /// they are counted from north and the horizon.
    pub boresight: YawPitchRoll,
    /// Gimbal angles of every frame whose record has none of its own.
    pub gimbal: GimbalAngles,
    /// What gimbal angles are counted from.
    pub gimbal_reference: GimbalReference,
    /// How the stored pixels of every frame are turned; a record's own turn already includes this one.
    pub pixel_rotation: PixelRotation,
}

impl Default for Mount {
    fn default() -> Self {
        Self {
            antenna_in_body: Displacement::zero(),
            gimbal_in_body: Displacement::zero(),
            camera_in_gimbal: Displacement::zero(),
            boresight: YawPitchRoll::default(),
            gimbal: GimbalAngles::NADIR,
            gimbal_reference: GimbalReference::Body,
            pixel_rotation: PixelRotation::None,
        }
    }
}

impl Mount {
    /// The fixed change of axes between the gimbal and the camera: image right is the gimbal's y, image
    /// bottom its z, the optical axis its x.
    ///
    /// # Source
    /// Hemerly (2014), `C_gc` of eq. (8).
    #[must_use]
    pub fn gimbal_from_camera_axes() -> Rotation<Gimbal, Camera> {
        Rotation::from_matrix_unchecked(Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    }
}
