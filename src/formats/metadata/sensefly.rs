//! senseFly's autopilot record: attitude of the aircraft, GPS and filtered heights, course.

use super::draft::{Draft, Height, SEA_LEVEL};
use super::xmp::Namespace::SenseflyFlight;
use crate::formats::flight::{LoggedAttitude, North, plausible_speed};

pub(super) fn apply(draft: &mut Draft) {
    if !draft.xmp.has(SenseflyFlight) {
        return;
    }
    draft.take_place(SenseflyFlight, "Latitude", "Longitude");
    height(draft);
    attitude(draft);
    if let Some(speed) = draft.number(SenseflyFlight, "GroundSpeed") {
        let speed = plausible_speed(speed);
        if let Some(speed) = draft.or_warn("sensefly:GroundSpeed", speed) {
            draft.out.exposure.ground_speed_m_s = Some(speed);
            draft.origin("ground speed", "sensefly:GroundSpeed, m/s", "over ground");
        }
    }
    draft.utc(SenseflyFlight, "UTCTime", "sensefly:UTCTime, UTC");
    draft.out.vehicle_serial = draft.text(SenseflyFlight, "AutopilotSN");
}

fn height(draft: &mut Draft) {
    let filtered = draft.number(SenseflyFlight, "AltitudeAMSL");
    let by_gps = draft.number(SenseflyFlight, "AltitudeWGS84");
    if draft.height.is_none()
        && let Some(metres) = filtered
    {
        draft.height = Some(Height {
            metres,
            kind: SEA_LEVEL,
            from: "sensefly:AltitudeAMSL, metres".to_owned(),
            meaning: "above sea level (EGM96), filtered by the autopilot".to_owned(),
        });
        if let Some(h) = by_gps {
            let said = format!("{h:.3} m above the ellipsoid by the receiver alone; not used");
            draft.origin("height by GPS", "sensefly:AltitudeWGS84, metres", said);
        }
    }
    if let Some(metres) = draft.metres(SenseflyFlight, "Height") {
        draft.out.exposure.height_above_takeoff_m = Some(metres);
        draft.origin("height above take-off", "sensefly:Height, metres", "above the take-off point");
    }
}

fn attitude(draft: &mut Draft) {
    let Some(angles) = draft.angles(SenseflyFlight, ["Heading", "PitchAngle", "RollAngle"]) else { return };
    let (north, meaning) = heading_kind(draft, angles.yaw.degrees());
    draft.out.exposure.attitude = Some(LoggedAttitude::Body { angles, north });
    draft.origin("UAV yaw", "sensefly:Heading, degrees", meaning);
    draft.origin(
        "UAV pitch, roll",
        "sensefly:PitchAngle, RollAngle, degrees",
        "of the aircraft, not the camera; pitch nose up, roll right wing down",
    );
}

/// Whether `Heading` is where the nose points or where the aircraft goes.
///
/// Autopilots without a magnetometer (Swinglet) fly by the GPS course. Two signs tell: EXIF `GPSTrack`, by its
/// definition the direction of movement, repeats `Heading`; or `sensefly:Course` is exactly 0 in every photo because
/// the unit keeps no course beside its heading.
fn heading_kind(draft: &mut Draft, heading_deg: f64) -> (North, &'static str) {
    let apart = |other: f64| ((other - heading_deg).rem_euclid(360.0) + 180.0).rem_euclid(360.0) - 180.0;
    let repeats = draft.exif.track_deg.is_some_and(|(track, _)| apart(track).abs() < 0.01);
    let no_course = draft.number(SenseflyFlight, "Course") == Some(0.0) && heading_deg != 0.0;
    if repeats {
        (
            North::Course,
            "the course over ground, true north: EXIF GPSTrack, the direction of movement, is the same",
        )
    } else if no_course {
        (
            North::Course,
            "the course over ground, true north: sensefly:Course is 0, so the unit keeps no other",
        )
    } else {
        (North::True, "of the nose, from true north")
    }
}
