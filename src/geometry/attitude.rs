//! Attitude angles that say their axis order and sense, turned into rotations at once.
//!
//! Angles never travel as bare triples: a [`YawPitchRoll`] or an [`OmegaPhiKappa`] is what a file said,
//! a [`Rotation`] is what the program computes with.

use super::frames::Frame;
use super::pose::Rotation;
use crate::units::Radians;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Yaw, pitch, roll: `R = Rz(yaw)·Ry(pitch)·Rx(roll)`, active, column vectors.
///
/// For a UAV (`Ned` from `Body`): yaw clockwise from true north seen from above, pitch positive nose up,
/// roll positive right wing down.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct YawPitchRoll {
    /// About z (down): clockwise from true north seen from above.
    pub yaw: Radians,
    /// About the turned y (right): positive nose up.
    pub pitch: Radians,
    /// About the turned x (nose): positive right wing down.
    pub roll: Radians,
}

impl YawPitchRoll {
    /// From radians.
    #[must_use]
    pub const fn new(yaw: Radians, pitch: Radians, roll: Radians) -> Self {
        Self { yaw, pitch, roll }
    }
    /// From degrees.
    #[must_use]
    pub const fn from_degrees(yaw: f64, pitch: f64, roll: f64) -> Self {
        Self::new(Radians::from_degrees(yaw), Radians::from_degrees(pitch), Radians::from_degrees(roll))
    }
    /// The rotation these angles describe.
    ///
    /// # Source
    /// Hemerly (2014), conventions restated in `CONVENTIONS.md`.
    #[must_use]
    pub fn rotation<To: Frame, From: Frame>(&self) -> Rotation<To, From> {
        Rotation::from_rotation(rz(self.yaw.get()) * ry(self.pitch.get()) * rx(self.roll.get()))
    }
    /// The angles of a rotation; pitch in [-90°, 90°]. At the poles of pitch (±90°) roll is set to 0.
    #[must_use]
    pub fn of<To: Frame, From: Frame>(rotation: &Rotation<To, From>) -> Self {
        let m = rotation.matrix();
        let pitch = (-m[(2, 0)]).clamp(-1.0, 1.0).asin();
        let (yaw, roll) = if m[(2, 0)].abs() < 1.0 - 1e-12 {
            (m[(1, 0)].atan2(m[(0, 0)]), m[(2, 1)].atan2(m[(2, 2)]))
        } else {
            ((-m[(0, 1)]).atan2(m[(1, 1)]), 0.0)
        };
        Self::new(Radians::new(yaw), Radians::new(pitch), Radians::new(roll))
    }
    /// Unit axes about which a small increase of yaw, pitch and roll turns the rotation, in `To`.
    ///
    /// `dR = [axis]× R · dangle` for each angle: the analytic derivative used by error propagation.
    #[must_use]
    pub fn increment_axes(&self) -> [Vector3<f64>; 3] {
        let z = Vector3::z();
        let y = rz(self.yaw.get()) * Vector3::y();
        let x = rz(self.yaw.get()) * ry(self.pitch.get()) * Vector3::x();
        [z, y, x]
    }
}

/// Photogrammetric angles: `R = Rx(ω)·Ry(φ)·Rz(κ)`, from a camera with x right, y up, z backwards, to
/// an east-north-up (or map grid) frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OmegaPhiKappa {
    /// About east.
    pub omega: Radians,
    /// About the once-turned north.
    pub phi: Radians,
    /// About the twice-turned up.
    pub kappa: Radians,
}

impl OmegaPhiKappa {
    /// The angles of `ned_from_camera` (camera x right, y down, z forward) against a grid whose north is
    /// turned by `convergence` from true north (positive: grid north lies east of true north).
    #[must_use]
    pub fn of_ned_from_camera<To: Frame, From: Frame>(
        ned_from_camera: &Rotation<To, From>,
        convergence: Radians,
    ) -> Self {
        let enu_from_ned = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        let camera_from_photo = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
        let grid_from_enu = rz(convergence.get());
        let m = grid_from_enu * enu_from_ned * ned_from_camera.matrix() * camera_from_photo;
        Self {
            omega: Radians::new((-m[(1, 2)]).atan2(m[(2, 2)])),
            phi: Radians::new(m[(0, 2)].clamp(-1.0, 1.0).asin()),
            kappa: Radians::new((-m[(0, 1)]).atan2(m[(0, 0)])),
        }
    }
}

/// Rotation about x by `angle` radians.
pub(crate) fn rx(angle: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::x_axis(), angle)
}
/// Rotation about y by `angle` radians.
pub(crate) fn ry(angle: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::y_axis(), angle)
}
/// Rotation about z by `angle` radians.
pub(crate) fn rz(angle: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), angle)
}

#[cfg(test)]
mod tests {
    use super::super::{Body, Ned};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn axes_mean_what_the_doc_says() {
        let turn = |y, p, r| YawPitchRoll::from_degrees(y, p, r).rotation::<Ned, Body>().matrix();
        assert!((turn(90.0, 0.0, 0.0) * Vector3::x() - Vector3::y()).norm() < 1e-12, "nose east");
        assert!((turn(0.0, 90.0, 0.0) * Vector3::x() + Vector3::z()).norm() < 1e-12, "nose up");
        assert!((turn(0.0, 0.0, 90.0) * Vector3::y() - Vector3::z()).norm() < 1e-12, "right wing down");
    }

    proptest! {
        #[test]
        fn angles_survive_the_round_trip(y in -179.0..179.0f64, p in -89.0..89.0f64, r in -179.0..179.0f64) {
            let back = YawPitchRoll::of(&YawPitchRoll::from_degrees(y, p, r).rotation::<Ned, Body>());
            prop_assert!((back.yaw.degrees() - y).abs() < 1e-9);
            prop_assert!((back.pitch.degrees() - p).abs() < 1e-9);
            prop_assert!((back.roll.degrees() - r).abs() < 1e-9);
        }

        #[test]
        fn increment_axes_are_the_derivative(y in -179.0..179.0f64, p in -80.0..80.0f64, r in -179.0..179.0f64) {
            let at = |d: [f64; 3]| YawPitchRoll::new(
                Radians::new(Radians::from_degrees(y).get() + d[0]),
                Radians::new(Radians::from_degrees(p).get() + d[1]),
                Radians::new(Radians::from_degrees(r).get() + d[2]),
            );
            let r0 = at([0.0; 3]).rotation::<Ned, Body>().matrix();
            for (k, axis) in at([0.0; 3]).increment_axes().iter().enumerate() {
                let mut step = [0.0; 3];
                step[k] = 1e-6;
                let numeric = (at(step).rotation::<Ned, Body>().matrix() - r0) / 1e-6;
                prop_assert!((numeric - axis.cross_matrix() * r0).norm() < 1e-5);
            }
        }
    }
}
