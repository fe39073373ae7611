//! The error model and what it takes for granted, in words for the page and the JSON.

use crate::accuracy::Source;
use crate::accuracy::circular::CEP50_PER_SIGMA;
use crate::config::accuracy::{Accuracy, CameraSpread};
use crate::georeference::GeoreferencedFrame;
use crate::navigation::GimbalReference;
use crate::report::numbers::{MonteCarloNumbers, Sigma};
use crate::units::Radians;

/// A source as the page names it.
pub(super) fn source(source: Source, frame: &GeoreferencedFrame) -> &'static str {
    match source {
        Source::Position => "antenna position",
        Source::Height => "antenna height",
        Source::Yaw => "yaw",
        Source::Pitch => "pitch",
        Source::Roll => "roll",
        Source::Gimbal => match frame.mount.gimbal_reference {
            GimbalReference::Body => "gimbal angles",
            GimbalReference::Nav => "attitude of the stabilised camera",
        },
        Source::Boresight => "boresight",
        Source::LeverArm => "lever arm",
        Source::Time => "time of exposure",
        Source::GroundHeight => "ground height",
        Source::Interior => "camera calibration",
        Source::Picking => "picking of the pixel",
    }
}

/// The stated sigmas that are not zero.
pub(super) fn sigmas(declared: &Accuracy) -> Vec<Sigma> {
    let s = &declared.sigmas;
    let degrees = |r: f64| Radians::new(r).degrees();
    let position =
        format!("antenna position, along north and along east (CEP {:.3} m)", CEP50_PER_SIGMA * s.position_m);
    [
        (position.as_str(), s.position_m, "m"),
        ("antenna height", s.height_m, "m"),
        ("roll", degrees(s.roll_rad), "°"),
        ("pitch", degrees(s.pitch_rad), "°"),
        ("yaw", degrees(s.yaw_rad), "°"),
        ("boresight roll", degrees(s.boresight_roll_rad), "°"),
        ("boresight pitch", degrees(s.boresight_pitch_rad), "°"),
        ("boresight yaw", degrees(s.boresight_yaw_rad), "°"),
        ("gimbal, each angle", degrees(s.gimbal_rad), "°"),
        ("time of exposure", s.time_s, "s"),
        ("lever arm from antenna to camera, each axis", s.lever_arm_m, "m"),
        ("ground height", s.ground_height_m, "m"),
        ("picking of a pixel, along columns and along rows", s.picking_px, "px"),
    ]
    .into_iter()
    .filter(|(_, value, _)| *value > 0.0)
    .map(|(what, value, unit): (&str, f64, &str)| Sigma {
        what: what.to_owned(),
        value,
        unit: unit.to_owned(),
    })
    .collect()
}

/// What the numbers take for granted.
pub(super) fn assumptions(declared: &Accuracy, frames: &[GeoreferencedFrame]) -> Vec<String> {
    let mut lines = vec![
        "Errors of different sources are independent and normally distributed, without bias; what is not in \
         the table counts as exact."
            .to_owned(),
        "Position, attitude, gimbal and time err anew for every frame; boresight, lever arm, camera and ground \
         height have one error for the whole survey."
            .to_owned(),
    ];
    let calibrated = frames.iter().any(|f| f.camera.covariance.is_some());
    lines.push(
        match (declared.sigmas.camera, calibrated) {
            (CameraSpread::None, _) => {
                "The camera's parameters are taken as exact, as the pipeline file says."
            }
            (CameraSpread::FromCalibration, true) => {
                "The camera's parameters spread as their calibration says, with all correlations."
            }
            (CameraSpread::FromCalibration, false) => {
                "The camera's parameters are taken as exact: the camera states no covariance."
            }
        }
        .to_owned(),
    );
    let head = frames.iter().any(|f| f.mount.gimbal_reference == GimbalReference::Nav);
    if head && declared.sigmas.gimbal_rad == 0.0 {
        lines.push(
            "The gimbal's angles are counted from north and the horizon, so the spread of roll, pitch and yaw \
             is that of the camera's own attitude."
                .to_owned(),
        );
    }
    let slow = |f: &GeoreferencedFrame| f.record.velocity.is_none() && f.record.ground_speed_m_s.is_some();
    if declared.sigmas.time_s > 0.0 && frames.iter().any(slow) {
        lines.push(
            "Where the log gives a speed without direction, a timing error acts in all directions alike."
                .to_owned(),
        );
    }
    if !declared.lengths.is_empty() {
        lines.push(
            "Recovered lengths are horizontal distances on the ground of the pipeline file.".to_owned(),
        );
    }
    lines
}

/// How far drawing and first order agree, in words.
pub(super) fn monte_carlo(drawn: Option<&MonteCarloNumbers>) -> Option<String> {
    let difference = drawn?.first_order_difference_percent?;
    // Three standard deviations of a drawn CE90 with the smallest number of draws in use are about this.
    const NOTABLE_PERCENT: f64 = 5.0;
    Some(if difference <= NOTABLE_PERCENT {
        format!(
            "Covariances are first order; drawing through the whole chain differs by at most {difference:.1} % in CE90."
        )
    } else {
        format!(
            "Covariances are first order; drawing through the whole chain differs by up to {difference:.0} % in CE90, \
             so the far parts of this view are only roughly described."
        )
    })
}
