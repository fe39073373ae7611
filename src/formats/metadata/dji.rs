//! DJI's namespace, which Autel's newer firmware writes too: gimbal, flight attitude, RTK, calibration.

use super::draft::{Draft, Height, SEA_LEVEL};
use super::optics::Dewarp;
use super::optics::DjiCalibration;
use super::xmp::Namespace::Dji;
use crate::formats::flight::{LoggedAttitude, LoggedGimbal, North, plausible_speed};
use crate::geodesy::HeightKind;
use crate::navigation::{GimbalAngles, GimbalReference};
use crate::units::Radians;

/// The same rotation with its roll within ±90°: a gimbal that went past nadir is reported by its maker with the roll
/// turned by 180° and pan flipped; here its elevation goes on beyond -90° instead.
///
/// `Rz(pan)·Ry(elevation)·Rx(roll) = Rz(pan + 180°)·Ry(180° - elevation)·Rx(roll + 180°)`.
#[must_use]
pub fn normalised_gimbal(angles: GimbalAngles) -> GimbalAngles {
    let half = Radians::from_degrees(180.0);
    let roll = angles.roll.wrapped();
    if roll.get().abs() <= half.get() / 2.0 {
        return GimbalAngles { pan: angles.pan.wrapped(), elevation: angles.elevation, roll };
    }
    GimbalAngles {
        pan: (angles.pan + half).wrapped(),
        elevation: (half - angles.elevation).wrapped(),
        roll: (roll + half).wrapped(),
    }
}

pub(super) fn apply(draft: &mut Draft) {
    if !draft.xmp.has(Dji) {
        return;
    }
    position(draft);
    attitude(draft);
    motion(draft);
    draft.utc(Dji, "UTCAtExposure", "drone-dji:UTCAtExposure, UTC");
    draft.out.vehicle_serial = draft.text(Dji, "DroneSerialNumber");
    if let Some(serial) = draft.text(Dji, "CameraSerialNumber") {
        draft.out.camera_serial = Some(serial);
    }
    for tag in ["CamReverse", "GimbalReverse"] {
        if draft.number(Dji, tag) == Some(1.0) {
            draft.warn(format!(
                "drone-dji:{tag} is 1: the camera hung upside down; whether the stored pixels or the angles account \
                 for that is not documented, so check the direction of one photo"
            ));
        }
    }
    calibration(draft);
}

fn position(draft: &mut Draft) {
    if draft.text(Dji, "GpsStatus").is_some_and(|s| s.eq_ignore_ascii_case("invalid")) {
        draft.warn("drone-dji:GpsStatus is Invalid: the position may be an old one");
    }
    for (latitude, longitude) in
        [("GpsLatitude", "GpsLongitude"), ("GpsLatitude", "GpsLongtitude"), ("Latitude", "Longitude")]
    {
        if draft.xmp.text(Dji, latitude).is_some() && draft.xmp.text(Dji, longitude).is_some() {
            draft.take_place(Dji, latitude, longitude);
        }
    }
    draft.height = height(draft);
    if let Some(relative) = draft.metres(Dji, "RelativeAltitude") {
        draft.out.exposure.height_above_takeoff_m = Some(relative);
        draft.origin(
            "height above take-off",
            "drone-dji:RelativeAltitude, metres",
            "above the take-off point",
        );
    }
    let sigmas = ["RtkStdLat", "RtkStdLon", "RtkStdHgt"].map(|tag| draft.sigma(Dji, tag));
    if let [Some(north), Some(east), Some(up)] = sigmas {
        let std = &mut draft.out.exposure.std;
        (std.north_m, std.east_m, std.up_m) = (Some(north), Some(east), Some(up));
        draft.origin("position sigma", "drone-dji:RtkStdLat, RtkStdLon, RtkStdHgt, metres", "one sigma each");
    }
}

/// `AbsoluteAltitude`, or EXIF's height when that is the same number with more digits.
fn height(draft: &mut Draft) -> Option<Height> {
    let metres = draft.number(Dji, "AbsoluteAltitude")?;
    let kind = draft.text(Dji, "AltitudeType");
    let flag = draft.number(Dji, "RtkFlag");
    let by_rtk = match kind.as_deref() {
        Some(kind) => kind.eq_ignore_ascii_case("RtkAlt"),
        None => flag.is_some_and(|f| f > 0.0),
    };
    if by_rtk {
        let why = match (&kind, flag) {
            (Some(_), _) => "AltitudeType is RtkAlt".to_owned(),
            (None, flag) => format!("RtkFlag is {}", flag.unwrap_or_default()),
        };
        if flag.is_some_and(|f| f < 50.0) {
            draft.warn(format!(
                "drone-dji:RtkFlag is {}, not 50: the position is no fixed RTK solution",
                flag.unwrap_or_default()
            ));
        }
        return Some(Height {
            metres,
            kind: HeightKind::Ellipsoid,
            from: "drone-dji:AbsoluteAltitude, metres".to_owned(),
            meaning: format!("above the ellipsoid of the RTK service: {why}"),
        });
    }
    let meaning = format!(
        "assumed to be above sea level (EGM96){}: DJI documents an absolute height without a datum, and some models \
         write ellipsoidal or drifting barometric heights; declare the height's kind if the ground disagrees",
        kind.map_or_else(String::new, |k| format!("; AltitudeType is {}", Draft::shown(&k)))
    );
    let fine = draft.exif.gps_height.map(|h| h.metres).filter(|fine| is_finer(draft, *fine, metres));
    let (metres, from) = match fine {
        Some(fine) => (fine, "EXIF GPSAltitude, metres (drone-dji:AbsoluteAltitude is the same, rounded)"),
        None => (metres, "drone-dji:AbsoluteAltitude, metres"),
    };
    Some(Height { metres, kind: SEA_LEVEL, from: from.to_owned(), meaning })
}

/// True when `fine` rounds to what the XMP's digits say; a greater difference is reported.
fn is_finer(draft: &mut Draft, fine: f64, coarse: f64) -> bool {
    let digits = draft
        .xmp
        .text(Dji, "AbsoluteAltitude")
        .and_then(|t| t.split_once('.'))
        .map_or(0, |(_, fraction)| fraction.len().min(9));
    let apart = (fine - coarse).abs();
    let half_a_digit = 0.5 * 10f64.powi(-i32::try_from(digits).unwrap_or(0)) + 1e-9;
    if apart > 1.0 {
        draft.note(format!(
            "EXIF GPSAltitude ({fine:.2} m) and drone-dji:AbsoluteAltitude ({coarse:.2} m) differ; the latter is used"
        ));
    }
    apart <= half_a_digit
}

fn attitude(draft: &mut Draft) {
    if let Some(angles) = draft.angles(Dji, ["GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"]) {
        let said = GimbalAngles { pan: angles.yaw, elevation: angles.pitch, roll: angles.roll };
        gimbal(draft, said, "drone-dji:Gimbal{Yaw,Pitch,Roll}Degree, degrees");
    }
    if let Some(angles) = draft.angles(Dji, ["FlightYawDegree", "FlightPitchDegree", "FlightRollDegree"]) {
        draft.out.exposure.attitude = Some(LoggedAttitude::Body { angles, north: North::True });
        draft.origin(
            "UAV yaw, pitch, roll",
            "drone-dji:Flight{Yaw,Pitch,Roll}Degree, degrees",
            "of the UAV in north-east-down, Z-Y-X, yaw from true north",
        );
    }
}

/// Takes gimbal angles counted from north and the horizon, elevation -90° at nadir.
pub(super) fn gimbal(draft: &mut Draft, said: GimbalAngles, from: &str) {
    let angles = normalised_gimbal(said);
    if said.roll.degrees().abs() > 90.0 {
        draft.note(format!(
            "gimbal roll {:.1}° at elevation {:.1}°: the same rotation is elevation {:.1}°, yaw {:.1}°, roll {:.1}°",
            said.roll.degrees(),
            said.elevation.degrees(),
            angles.elevation.degrees(),
            angles.pan.degrees(),
            angles.roll.degrees()
        ));
    }
    draft.out.exposure.gimbal = Some(LoggedGimbal { angles, reference: GimbalReference::Nav });
    draft.origin(
        "gimbal yaw, elevation, roll",
        from,
        "from true north and the horizon, Z-Y-X, elevation -90° at nadir; composed as a rotation",
    );
}

fn motion(draft: &mut Draft) {
    let (north, east) = (draft.number(Dji, "FlightXSpeed"), draft.number(Dji, "FlightYSpeed"));
    let Some((north, east)) = north.zip(east) else { return };
    let speed = plausible_speed(north.hypot(east));
    if let Some(speed) = draft.or_warn("drone-dji:FlightXSpeed, FlightYSpeed", speed) {
        draft.out.exposure.ground_speed_m_s = Some(speed);
        draft.origin(
            "ground speed",
            "drone-dji:FlightXSpeed, FlightYSpeed, m/s",
            "towards north and east; FlightZSpeed is not used, because DJI does not say which way it counts",
        );
    }
}

fn calibration(draft: &mut Draft) {
    let focal_length_px = draft.number(Dji, "CalibratedFocalLength").filter(|f| *f > 0.0);
    let x = draft.number(Dji, "CalibratedOpticalCenterX");
    let y = draft.number(Dji, "CalibratedOpticalCenterY");
    if let Some(focal_length_px) = focal_length_px {
        draft.out.optics.dji = Some(DjiCalibration { focal_length_px, optical_centre: x.zip(y) });
    }
    let Some(text) = draft.xmp.text(Dji, "DewarpData") else { return };
    let parsed = Dewarp::parse(text);
    let applied = draft.number(Dji, "DewarpFlag").map(|f| f != 0.0);
    if let Some(mut dewarp) = draft.or_warn("drone-dji:DewarpData", parsed) {
        dewarp.applied = applied;
        if applied == Some(true) {
            draft.note(
                "drone-dji:DewarpFlag is 1: the stored pixels are corrected already, the lens numbers of DewarpData \
                 must not be applied again",
            );
        }
        draft.out.optics.dewarp = Some(dewarp);
    }
}
