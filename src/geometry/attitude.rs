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
        Self::of_grid_from_photo(
            &(rz(convergence.get()) * ENU_FROM_NED * ned_from_camera.matrix() * CAMERA_FROM_PHOTO),
        )
    }

    /// Camera (x right, y down, z forward) in north-east-down from these angles against a grid whose north is turned by
    /// `convergence` from true north (positive: grid north lies east of true north): undoes
    /// [`OmegaPhiKappa::of_ned_from_camera`].
    #[must_use]
    pub fn ned_from_camera<To: Frame, From: Frame>(&self, convergence: Radians) -> Rotation<To, From> {
        // Both changes of axes are their own inverses.
        Rotation::from_matrix_unchecked(
            ENU_FROM_NED * rz(-convergence.get()) * self.grid_from_photo() * CAMERA_FROM_PHOTO,
        )
    }

    /// `Rx(ω)·Ry(φ)·Rz(κ)`: from the photo (x right, y up, z back) to the grid (east, north, up).
    #[must_use]
    pub fn grid_from_photo(&self) -> Matrix3<f64> {
        (rx(self.omega.get()) * ry(self.phi.get()) * rz(self.kappa.get())).into_inner()
    }

    /// The angles of a rotation from the photo (x right, y up, z back) to the grid (east, north, up); φ in [-90°, 90°].
    #[must_use]
    pub fn of_grid_from_photo(m: &Matrix3<f64>) -> Self {
        let omega = (-m[(1, 2)]).atan2(m[(2, 2)]);
        // κ from what is left once ω is undone: the two stay consistent where φ comes near ±90° and ω means little.
        let (sin, cos) = omega.sin_cos();
        let kappa = (cos * m[(1, 0)] + sin * m[(2, 0)]).atan2(cos * m[(1, 1)] + sin * m[(2, 1)]);
        Self {
            omega: Radians::new(omega),
            phi: Radians::new(m[(0, 2)].atan2(m[(0, 0)].hypot(m[(0, 1)]))),
            kappa: Radians::new(kappa),
        }
    }

    /// From angles of the order φ, ω, κ (Inpho, UltraMap): `R = Ry(φ)·Rx(ω)·Rz(κ)`, the same axes.
    #[must_use]
    pub fn of_phi_omega_kappa(phi: Radians, omega: Radians, kappa: Radians) -> Self {
        Self::of_grid_from_photo((ry(phi.get()) * rx(omega.get()) * rz(kappa.get())).matrix())
    }
}

/// East-north-up and north-east-down: each is the other's inverse.
const ENU_FROM_NED: Matrix3<f64> = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
/// The photo's axes of photogrammetry (x right, y up, z back) in the camera (x right, y down, z forward); its own inverse.
const CAMERA_FROM_PHOTO: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);

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
    use super::super::{Body, Camera, Ned};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn axes_mean_what_the_doc_says() {
        let turn = |y, p, r| YawPitchRoll::from_degrees(y, p, r).rotation::<Ned, Body>().matrix();
        assert!((turn(90.0, 0.0, 0.0) * Vector3::x() - Vector3::y()).norm() < 1e-12, "nose east");
        assert!((turn(0.0, 90.0, 0.0) * Vector3::x() + Vector3::z()).norm() < 1e-12, "nose up");
        assert!((turn(0.0, 0.0, 90.0) * Vector3::y() - Vector3::z()).norm() < 1e-12, "right wing down");
    }

    #[test]
    fn omega_phi_kappa_turn_the_photo_as_their_signs_say() {
        let turn = |o, p, k, gamma| {
            let [omega, phi, kappa, gamma] = [o, p, k, gamma].map(Radians::from_degrees);
            OmegaPhiKappa { omega, phi, kappa }.ned_from_camera::<Ned, Camera>(gamma).matrix()
        };
        // All zero: image right is east, image bottom south, the view down.
        let level = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        assert!((turn(0.0, 0.0, 0.0, 0.0) - level).abs().max() < 1e-15);
        // κ counts anticlockwise seen from above: +90° puts image right to the north.
        assert!((turn(0.0, 0.0, 90.0, 0.0) * Vector3::x() - Vector3::x()).norm() < 1e-12);
        // ω = +90° looks at the northern horizon, φ = +90° at the western one.
        assert!((turn(90.0, 0.0, 0.0, 0.0) * Vector3::z() - Vector3::x()).norm() < 1e-12);
        assert!((turn(0.0, 90.0, 0.0, 0.0) * Vector3::z() + Vector3::y()).norm() < 1e-12);
        // Grid north 10° east of true north: a photo that looks at grid north looks 10° east of north.
        let north_10_east = Vector3::new(0.984_807_753_012_208, 0.173_648_177_666_930_35, 0.0);
        assert!((turn(90.0, 0.0, 0.0, 10.0) * Vector3::z() - north_10_east).norm() < 1e-12);
    }

    #[test]
    fn golden_omega_phi_kappa_back_to_yaw_pitch_roll() {
        // Yaw, pitch counted from nadir, roll; ω, φ, κ to 0.001° at 36°N 15°E and 60°N 17.9°E of UTM 33N, from two
        // independent derivations.
        let cases = [
            ((0.0, 0.0, 0.0), [[0.0, 0.0, 0.0], [0.0, 0.0, 2.512]]),
            ((90.0, 0.0, 0.0), [[0.0, 0.0, -90.0], [0.0, 0.0, -87.488]]),
            ((30.0, 5.0, -3.0), [[2.832, -5.097, -30.005], [3.053, -4.968, -27.487]]),
            ((-120.0, 10.0, 0.0), [[-5.038, 8.649, 120.381], [-5.414, 8.420, 122.911]]),
            ((30.0, 40.0, 0.0), [[36.005, -18.747, -23.859], [36.663, -17.259, -21.731]]),
        ];
        for (place, gamma) in [0.0, 2.512].into_iter().enumerate() {
            for ((yaw, pitch, roll), expected) in cases {
                let [omega, phi, kappa] = expected[place].map(Radians::from_degrees);
                let turn = OmegaPhiKappa { omega, phi, kappa }
                    .ned_from_camera::<Ned, Camera>(Radians::from_degrees(gamma));
                let level = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
                let body = YawPitchRoll::from_degrees(yaw, pitch, roll).rotation::<Ned, Body>().matrix();
                let off = (turn.matrix() - body * level).abs().max();
                assert!(off < 3e-5, "γ {gamma} yaw {yaw} pitch {pitch} roll {roll}: off by {off}");
            }
        }
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
        fn omega_phi_kappa_survive_the_round_trip(
            o in -180.0..180.0f64, p in -90.0..90.0f64, k in -180.0..180.0f64, gamma in -10.0..10.0f64,
        ) {
            let [omega, phi, kappa, gamma] = [o, p, k, gamma].map(Radians::from_degrees);
            let turn = OmegaPhiKappa { omega, phi, kappa }.ned_from_camera::<Ned, Camera>(gamma);
            let again = OmegaPhiKappa::of_ned_from_camera(&turn, gamma).ned_from_camera::<Ned, Camera>(gamma);
            prop_assert!((turn.matrix() - again.matrix()).abs().max() < 1e-12);
            let other_order = OmegaPhiKappa::of_phi_omega_kappa(phi, omega, kappa).grid_from_photo();
            let direct = (ry(phi.get()) * rx(omega.get()) * rz(kappa.get())).into_inner();
            prop_assert!((other_order - direct).abs().max() < 1e-12);
            // As near to φ = 90° as the draw of γ makes it.
            let phi = Radians::new(std::f64::consts::FRAC_PI_2 - 10f64.powf(gamma.degrees() - 6.0));
            let steep = OmegaPhiKappa { omega, phi, kappa }.grid_from_photo();
            prop_assert!((OmegaPhiKappa::of_grid_from_photo(&steep).grid_from_photo() - steep).abs().max() < 1e-12);
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
