//! The chain of frames from the Earth to the camera, kept link by link.

use crate::geodesy::LocalTangent;
use crate::geometry::{Body, Camera, Displacement, Ecef, Gimbal, Ned, Point, Pose, Rotation};
use crate::navigation::{GimbalReference, Mount, NavigationRecord};

/// Every link of eq. (8) for one frame; the local tangent frame stands at the antenna.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chain {
    /// NAV at the antenna's position.
    pub tangent: LocalTangent,
    /// `C_nb`: attitude of the UAV.
    pub ned_from_body: Rotation<Ned, Body>,
    /// `C_bg`: gimbal angles and boresight together.
    pub body_from_gimbal: Rotation<Body, Gimbal>,
    /// `C_gc`: fixed change of axes.
    pub gimbal_from_camera: Rotation<Gimbal, Camera>,
    /// Antenna seen from the UAV's reference point.
    pub antenna_in_body: Displacement<Body>,
    /// `ArmG`: gimbal centre seen from the UAV's reference point.
    pub gimbal_in_body: Displacement<Body>,
    /// `ArmC`: projection centre seen from the gimbal centre.
    pub camera_in_gimbal: Displacement<Gimbal>,
}

impl Chain {
    /// Links the chain for one record.
    ///
    /// With gimbal angles counted from the body, the boresight stands between body and gimbal base; with
    /// angles counted from north and the horizon, the UAV's attitude only carries the lever arms and the
    /// boresight turns the camera head about the gimbal's own axes.
    #[must_use]
    pub fn new(record: &NavigationRecord, mount: &Mount) -> Self {
        let ned_from_body = record.attitude.rotation::<Ned, Body>();
        let angles = record.gimbal.unwrap_or(mount.gimbal);
        let body_from_gimbal = match mount.gimbal_reference {
            GimbalReference::Body => mount.boresight.rotation::<Body, Body>() * angles.rotation::<Body>(),
            GimbalReference::Nav => {
                ned_from_body.inverse()
                    * angles.rotation::<Ned>()
                    * mount.boresight.rotation::<Gimbal, Gimbal>()
            }
        };
        Self {
            tangent: LocalTangent::at(record.antenna),
            ned_from_body,
            body_from_gimbal,
            gimbal_from_camera: Mount::gimbal_from_camera_axes(),
            antenna_in_body: mount.antenna_in_body,
            gimbal_in_body: mount.gimbal_in_body,
            camera_in_gimbal: mount.camera_in_gimbal,
        }
    }

    /// The camera in the local tangent frame at the antenna.
    ///
    /// # Source
    /// Hemerly (2014), eq. (8); the antenna's lever arm is added because the log gives the antenna.
    #[must_use]
    pub fn ned_from_camera(&self) -> Pose<Ned, Camera> {
        let antenna_to_camera_in_body =
            self.gimbal_in_body + self.antenna_in_body * -1.0 + self.body_from_gimbal * self.camera_in_gimbal;
        Pose::new(
            self.ned_from_body * self.body_from_gimbal * self.gimbal_from_camera,
            Point::origin() + self.ned_from_body * antenna_to_camera_in_body,
        )
    }

    /// The camera in ECEF.
    #[must_use]
    pub fn ecef_from_camera(&self) -> Pose<Ecef, Camera> {
        *self.tangent.ecef_from_ned() * self.ned_from_camera()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::Geodetic;
    use crate::geometry::attitude::YawPitchRoll;
    use crate::navigation::GimbalAngles;
    use crate::units::Radians;
    use nalgebra::Matrix3;

    fn record(yaw: f64, pitch: f64, roll: f64) -> NavigationRecord {
        NavigationRecord {
            line: 1,
            time: None,
            antenna: Geodetic::from_degrees(-23.0, -46.0, 1000.0),
            attitude: YawPitchRoll::from_degrees(yaw, pitch, roll),
            gimbal: None,
            height_above_ground_m: None,
            ground_speed_m_s: None,
            velocity: None,
            pixel_rotation: None,
        }
    }
    fn close(rotation: Matrix3<f64>, expected: [[f64; 3]; 3]) {
        let expected = Matrix3::from_fn(|r, c| expected[r][c]);
        assert!((rotation - expected).abs().max() < 1e-6, "{rotation} expected {expected}");
    }

    #[test]
    fn indoor_test_of_the_paper() {
        // Sect. 4.1: tripod with pan -14.08° and ELEVATION -32.08°, UAV axes along north.
        let mount = Mount {
            gimbal: GimbalAngles {
                pan: Radians::from_degrees(-14.08),
                elevation: Radians::from_degrees(-32.08),
                roll: Radians::new(0.0),
            },
            ..Mount::default()
        };
        let chain = Chain::new(&record(0.0, 0.0, 0.0), &mount);
        close(
            chain.ned_from_camera().rotation.matrix(),
            [[0.243276, -0.515147, 0.821852], [0.969957, 0.129205, -0.206130], [0.0, 0.847307, 0.531103]],
        );
    }

    #[test]
    fn flight_test_of_the_paper() {
        // Sect. 4.3: pan -π/2, tilt π/2 DOWN, attitude in radians.
        let mount = Mount {
            gimbal: GimbalAngles {
                pan: Radians::from_degrees(-90.0),
                elevation: Radians::from_degrees(-90.0),
                roll: Radians::new(0.0),
            },
            ..Mount::default()
        };
        let mut flight = record(0.0, 0.0, 0.0);
        flight.attitude = YawPitchRoll::new(Radians::new(3.166), Radians::new(0.057), Radians::new(0.0356));
        let chain = Chain::new(&flight, &mount);
        close(
            (chain.body_from_gimbal * chain.gimbal_from_camera).matrix(),
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        );
        close(
            chain.ned_from_camera().rotation.matrix(),
            [
                [-0.998079, 0.022362, -0.057785],
                [-0.024365, -0.999118, 0.034192],
                [-0.056969, 0.035535, 0.997743],
            ],
        );
    }

    #[test]
    fn lever_arms_follow_the_rotations() {
        let mount = Mount {
            antenna_in_body: Displacement::new(0.0, 0.0, -0.5),
            gimbal_in_body: Displacement::new(0.2, 0.0, 0.1),
            // The gimbal's x axis is the optical axis: the camera sits 3 cm further down when it looks down.
            camera_in_gimbal: Displacement::new(0.03, 0.0, 0.0),
            ..Mount::default()
        };
        let c = Chain::new(&record(90.0, 0.0, 0.0), &mount).ned_from_camera().origin;
        assert!(c.distance_to(&Point::new(0.0, 0.2, 0.63)) < 1e-12, "{c:?}");
    }

    #[test]
    fn absolute_gimbal_angles_ignore_the_attitude_but_for_the_lever_arms() {
        let mount = Mount {
            gimbal_reference: GimbalReference::Nav,
            gimbal_in_body: Displacement::new(0.1, 0.0, 0.0),
            ..Mount::default()
        };
        let level = Chain::new(&record(0.0, 0.0, 0.0), &mount).ned_from_camera();
        let tilted = Chain::new(&record(30.0, 8.0, -12.0), &mount).ned_from_camera();
        assert!((level.rotation.matrix() - tilted.rotation.matrix()).norm() < 1e-12);
        assert!(level.origin.distance_to(&tilted.origin) > 0.05);
    }
}
