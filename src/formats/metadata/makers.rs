//! Skydio, Parrot ANAFI, MicaSense.

use super::dji::gimbal;
use super::draft::{Draft, Height, SEA_LEVEL};
use super::optics::SkydioCalibration;
use super::values::{number, numbers};
use super::xmp::Namespace::{Dls, Parrot, Skydio};
use crate::formats::flight::{LoggedAttitude, North, plausible_angles};
use crate::geodesy::HeightKind;
use crate::geometry::attitude::YawPitchRoll;
use crate::navigation::GimbalAngles;
use crate::units::Seconds;

/// Skydio: camera orientation in north-east-down, pitch -90° at nadir.
pub(super) fn skydio(draft: &mut Draft) {
    if !draft.xmp.has(Skydio) {
        return;
    }
    draft.take_place(Skydio, "Latitude", "Longitude");
    skydio_height(draft);
    if let Some(height) = draft.metres(Skydio, "RelativeAltitude") {
        draft.out.exposure.height_above_takeoff_m = Some(height);
        draft.origin(
            "height above take-off",
            "drone-skydio:RelativeAltitude, metres",
            "above the take-off point",
        );
    }
    if let Some([yaw, pitch, roll]) = members(draft, "CameraOrientationNED", ["Yaw", "Pitch", "Roll"]) {
        let checked = plausible_angles(YawPitchRoll::from_degrees(yaw, pitch, roll));
        if let Some(angles) = draft.or_warn("drone-skydio:CameraOrientationNED", checked) {
            let said = GimbalAngles { pan: angles.yaw, elevation: angles.pitch, roll: angles.roll };
            gimbal(draft, said, "drone-skydio:CameraOrientationNED, degrees");
        }
    }
    let sigmas = [draft.sigma(Skydio, "GpsHorizontalAccuracy"), draft.sigma(Skydio, "GpsVerticalAccuracy")];
    if sigmas.iter().any(Option::is_some) {
        let std = &mut draft.out.exposure.std;
        (std.north_m, std.east_m, std.up_m) = (sigmas[0], sigmas[0], sigmas[1]);
        draft.origin(
            "position sigma",
            "drone-skydio:GpsHorizontalAccuracy, GpsVerticalAccuracy, metres",
            "taken as one sigma north, east and up: the tags state no level",
        );
    }
    let distortion = draft.xmp.text(Skydio, "DewarpData").map(numbers);
    let distortion = distortion.and_then(|parsed| draft.or_warn("drone-skydio:DewarpData", parsed));
    if let Some(focal_length_px) = members(draft, "CalibratedFocalLength", ["X", "Y"]) {
        draft.out.optics.skydio = Some(SkydioCalibration {
            focal_length_px,
            optical_centre: members(draft, "CalibratedOpticalCenter", ["X", "Y"]),
            radial: distortion.unwrap_or_default(),
        });
    }
}

fn skydio_height(draft: &mut Draft) {
    if draft.height.is_some() {
        return;
    }
    // Models of the X10: VT300-Z, VT300-L and V100-L, a field of view behind.
    let is_x10 = draft.out.model.as_deref().is_some_and(|m| m.starts_with("VT300") || m.starts_with("V100"));
    if is_x10 && let Some(height) = draft.exif.gps_height {
        draft.height = Some(Height {
            metres: height.metres,
            kind: HeightKind::Ellipsoid,
            from: "EXIF GPSAltitude, metres".to_owned(),
            meaning: "above the ellipsoid, as Skydio documents for the X10, whatever GPSAltitudeRef says"
                .to_owned(),
        });
    } else if let Some(metres) = draft.number(Skydio, "AbsoluteAltitude") {
        draft.height = Some(Height {
            metres,
            kind: SEA_LEVEL,
            from: "drone-skydio:AbsoluteAltitude, metres".to_owned(),
            meaning:
                "assumed to be above sea level (EGM96): other programs disagree whether it is the ellipsoid; \
                      declare the height's kind if the ground disagrees"
                    .to_owned(),
        });
    }
}

/// Numbers of a structure, all or none.
fn members<const N: usize>(draft: &mut Draft, structure: &str, names: [&str; N]) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    for (slot, name) in out.iter_mut().zip(names) {
        let parsed = number(draft.xmp.member(Skydio, structure, name)?);
        *slot = draft.or_warn(&format!("drone-skydio:{structure}/{name}"), parsed)?;
    }
    Some(out)
}

/// Parrot ANAFI: camera and drone angles in north-east-down, camera pitch -90° at nadir.
pub(super) fn parrot(draft: &mut Draft) {
    if !draft.xmp.has(Parrot) {
        return;
    }
    if let Some(angles) = draft.angles(Parrot, ["CameraYawDegree", "CameraPitchDegree", "CameraRollDegree"]) {
        let said = GimbalAngles { pan: angles.yaw, elevation: angles.pitch, roll: angles.roll };
        gimbal(draft, said, "drone-parrot:Camera{Yaw,Pitch,Roll}Degree, degrees");
    }
    if let Some(angles) = draft.angles(Parrot, ["DroneYawDegree", "DronePitchDegree", "DroneRollDegree"]) {
        draft.out.exposure.attitude = Some(LoggedAttitude::Body { angles, north: North::True });
        draft.origin(
            "UAV yaw, pitch, roll",
            "drone-parrot:Drone{Yaw,Pitch,Roll}Degree, degrees",
            "of the UAV, Z-Y-X, yaw from true north",
        );
    }
    let model = draft.out.model.clone().unwrap_or_default().to_ascii_lowercase().replace([' ', '-', '_'], "");
    if draft.height.is_none()
        && model.contains("anafi")
        && let Some(height) = draft.exif.gps_height
    {
        let (kind, meaning) = if model.contains("anafiai") {
            (HeightKind::Ellipsoid, "above the ellipsoid, as Parrot documents for ANAFI Ai")
        } else {
            (SEA_LEVEL, "above sea level (EGM96), as Parrot documents for ANAFI 4K, Thermal and USA")
        };
        let from = "EXIF GPSAltitude, metres".to_owned();
        draft.height = Some(Height { metres: height.metres, kind, from, meaning: meaning.to_owned() });
    }
}

/// MicaSense: the irradiance sensor's attitude is not the camera's; its clock keeps UTC.
pub(super) fn micasense(draft: &mut Draft) {
    if draft.is_made_by("micasense")
        && let Some(civil) = &mut draft.out.times.civil
    {
        civil.utc_offset.get_or_insert(Seconds::new(0.0));
    }
    let exposure = &draft.out.exposure;
    if draft.xmp.text(Dls, "Yaw").is_some() && exposure.attitude.is_none() && exposure.gimbal.is_none() {
        draft.note(
            "DLS:Yaw, Pitch, Roll (radians) are the irradiance sensor's on top of the aircraft, not the camera's: \
             they are not used as an attitude",
        );
    }
}
