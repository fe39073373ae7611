//! What three columns of angles mean: the one place where the senses of other programs' angles become ours.

use super::{LoggedAttitude, North, plausible_angles};
use crate::geometry::attitude::{OmegaPhiKappa, YawPitchRoll};
use crate::units::Radians;
use nalgebra::Matrix3;

/// How three columns of angles turn the camera or the UAV.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngleSystem {
    /// ω, φ, κ: `Rx(ω)·Ry(φ)·Rz(κ)` from the photo (x right, y up, z back) to the grid; all zero looks straight down with
    /// the top of the image to grid north.
    OmegaPhiKappa,
    /// φ, ω, κ: `Ry(φ)·Rx(ω)·Rz(κ)`, the same axes (Inpho, UltraMap).
    PhiOmegaKappa,
    /// Yaw, pitch, roll of the camera: pitch 0 looks straight down, +90° at the horizon (Pix4D, Metashape, ODM,
    /// orthority).
    CameraYawPitchRoll(North),
    /// Yaw, pitch, roll of the UAV: pitch 0 is level flight (autopilots, senseFly).
    BodyYawPitchRoll(North),
}

impl AngleSystem {
    /// The names of the three angles in the order in which a table without a header holds them.
    #[must_use]
    pub const fn names(self) -> [&'static str; 3] {
        match self {
            Self::OmegaPhiKappa => ["omega", "phi", "kappa"],
            Self::PhiOmegaKappa => ["phi", "omega", "kappa"],
            Self::CameraYawPitchRoll(_) | Self::BodyYawPitchRoll(_) => ["yaw", "pitch", "roll"],
        }
    }

    /// Words for `explain`.
    #[must_use]
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::OmegaPhiKappa => {
                "Rx(ω)·Ry(φ)·Rz(κ), photo axes x right, y up, z back; 0 looks straight down"
            }
            Self::PhiOmegaKappa => {
                "Ry(φ)·Rx(ω)·Rz(κ), photo axes x right, y up, z back; 0 looks straight down"
            }
            Self::CameraYawPitchRoll(_) => {
                "of the camera: Rz(yaw)·Ry(pitch)·Rx(roll), pitch 0 looks straight down, +90° at the horizon"
            }
            Self::BodyYawPitchRoll(_) => {
                "of the UAV: Rz(yaw)·Ry(pitch)·Rx(roll), nose up and right wing down positive"
            }
        }
    }
}

/// The unit of a table's angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AngleUnit {
    /// 360 to a turn.
    #[default]
    Degrees,
    /// 400 to a turn.
    Gon,
    /// 2π to a turn.
    Radians,
}

impl AngleUnit {
    /// An angle of so many units.
    #[must_use]
    pub const fn angle(self, value: f64) -> Radians {
        match self {
            Self::Degrees => Radians::from_degrees(value),
            Self::Gon => Radians::from_degrees(value * 0.9),
            Self::Radians => Radians::new(value),
        }
    }
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Degrees => "degrees",
            Self::Gon => "gon",
            Self::Radians => "radians",
        }
    }
}

/// The axes that ω, φ, κ are counted from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axes {
    /// East, north, up of the log's CRS.
    Grid,
    /// East, north, up of the ellipsoid at the position itself.
    Local,
}

/// The attitude that three angles state, in the order of [`AngleSystem::names`].
///
/// # Errors
/// Words for angles that are not finite or so large that their unit must be wrong.
pub(super) fn attitude(
    system: AngleSystem,
    angles: [Radians; 3],
    axes: Axes,
) -> Result<LoggedAttitude, String> {
    for (name, angle) in system.names().into_iter().zip(angles) {
        if !(-720.0..=720.0).contains(&angle.degrees()) {
            return Err(format!("{name} {:.1}° lies outside ±720°: is its unit right?", angle.degrees()));
        }
    }
    let against = |angles: OmegaPhiKappa| match axes {
        Axes::Grid => LoggedAttitude::CameraOnGrid(angles),
        Axes::Local => LoggedAttitude::CameraInNed(angles.ned_from_camera(Radians::new(0.0))),
    };
    let [a, b, c] = angles;
    Ok(match system {
        AngleSystem::OmegaPhiKappa => against(OmegaPhiKappa { omega: a, phi: b, kappa: c }),
        AngleSystem::PhiOmegaKappa => against(OmegaPhiKappa::of_phi_omega_kappa(a, b, c)),
        AngleSystem::BodyYawPitchRoll(north) => {
            LoggedAttitude::Body { angles: plausible_angles(YawPitchRoll::new(a, b, c))?, north }
        }
        AngleSystem::CameraYawPitchRoll(north) => {
            LoggedAttitude::Camera { angles: plausible_angles(YawPitchRoll::new(a, b, c))?, north }
        }
    })
}

/// Checks that the matrix a row prints beside its angles says the same; programs print it from the photo to the grid or
/// the other way about.
///
/// # Errors
/// Words with the largest disagreement of an element.
pub(super) fn agree(system: AngleSystem, angles: [Radians; 3], matrix: &Matrix3<f64>) -> Result<(), String> {
    const TOLERANCE: f64 = 1e-4;
    let [a, b, c] = angles;
    let angles = match system {
        AngleSystem::OmegaPhiKappa => OmegaPhiKappa { omega: a, phi: b, kappa: c },
        AngleSystem::PhiOmegaKappa => OmegaPhiKappa::of_phi_omega_kappa(a, b, c),
        // Nobody prints the matrix beside yaw, pitch and roll.
        AngleSystem::CameraYawPitchRoll(_) | AngleSystem::BodyYawPitchRoll(_) => return Ok(()),
    };
    let own = angles.grid_from_photo();
    let off = (own - matrix).abs().max().min((own.transpose() - matrix).abs().max());
    if off <= TOLERANCE {
        return Ok(());
    }
    let meant = OmegaPhiKappa::of_grid_from_photo(&matrix.transpose());
    Err(format!(
        "omega {:.4}°, phi {:.4}°, kappa {:.4}° and the matrix r11 … r33 differ by {off:.2e}; the matrix means {:.4}°, \
         {:.4}°, {:.4}°",
        angles.omega.degrees(),
        angles.phi.degrees(),
        angles.kappa.degrees(),
        meant.omega.degrees(),
        meant.phi.degrees(),
        meant.kappa.degrees(),
    ))
}
