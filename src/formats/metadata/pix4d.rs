//! Pix4D's camera namespace, and senseFly's of the same tags: Sequoia, S.O.D.A., MicaSense, Autel's older firmware.

use super::draft::Draft;
use super::optics::Pix4dCamera;
use super::values::{number, numbers};
use super::xmp::Namespace::{self, Pix4d, SenseflyCamera};
use crate::formats::flight::{LoggedAttitude, North};

pub(super) fn apply(draft: &mut Draft) {
    for namespace in [Pix4d, SenseflyCamera] {
        if draft.xmp.has(namespace) {
            attitude(draft, namespace);
            accuracy(draft, namespace);
            if draft.out.optics.pix4d.is_none() {
                draft.out.optics.pix4d = camera(draft, namespace);
            }
        }
    }
}

fn attitude(draft: &mut Draft, namespace: Namespace) {
    let exposure = &draft.out.exposure;
    if exposure.gimbal.is_some() || exposure.attitude.is_some() {
        return;
    }
    let Some(angles) = draft.angles(namespace, ["Yaw", "Pitch", "Roll"]) else { return };
    draft.out.exposure.attitude = Some(LoggedAttitude::Camera { angles, north: North::True });
    if angles.pitch.degrees() < -60.0 {
        draft.warn(format!(
            "Camera:Pitch is {:.1}°: by Pix4D's definition, with 0° at nadir, the camera looked backwards; if it \
             looked down, the writer counts from the horizon and the angles must be declared as a gimbal's",
            angles.pitch.degrees()
        ));
    }
    draft.origin(
        "camera yaw, pitch, roll",
        "Camera:Yaw, Pitch, Roll, degrees",
        "of the camera: all zero at nadir with the image's top to the north, pitch +90° at the horizon (Pix4D)",
    );
    if namespace == SenseflyCamera || draft.is_made_by("sensefly") {
        draft.warn(
            "the sign of Camera:Roll is disputed for senseFly cameras: here right wing down is positive, as Pix4D \
             defines it, OpenDroneMap takes the opposite; compare two strips before relying on it",
        );
    }
    if draft.is_made_by("sensefly") && draft.height.is_none() {
        draft.note(
            "on senseFly's Swinglet the EXIF height was the receiver's, above the ellipsoid: compare with the ground",
        );
    }
    if draft.is_made_by("autel") {
        draft.warn(
            "Autel's older firmware writes heights above sea level even where its tags name the ellipsoid: compare \
             with the ground",
        );
    }
}

fn accuracy(draft: &mut Draft, namespace: Namespace) {
    let (horizontal, vertical) =
        (draft.sigma(namespace, "GPSXYAccuracy"), draft.sigma(namespace, "GPSZAccuracy"));
    let std = &mut draft.out.exposure.std;
    if std.north_m.is_none() && std.up_m.is_none() && (horizontal.is_some() || vertical.is_some()) {
        (std.north_m, std.east_m, std.up_m) = (horizontal, horizontal, vertical);
        draft.origin(
            "position sigma",
            "Camera:GPSXYAccuracy, GPSZAccuracy, metres",
            "taken as one sigma north, east and up: the tags state no level",
        );
    }
    if let Some(height) =
        draft.number(namespace, "AboveGroundAltitude").filter(|h| (0.0..60_000.0).contains(h))
    {
        draft.out.exposure.height_above_ground_m = Some(height);
        draft.origin("height above ground", "Camera:AboveGroundAltitude, metres", "above the ground below");
    }
}

/// Lens and band, as far as the tags go.
fn camera(draft: &mut Draft, namespace: Namespace) -> Option<Pix4dCamera> {
    let in_pixels =
        draft.text(namespace, "PerspectiveFocalLengthUnits").is_some_and(|u| !u.eq_ignore_ascii_case("mm"));
    let focal = draft.number(namespace, "PerspectiveFocalLength").filter(|f| *f > 0.0);
    let bands = draft.xmp.items(namespace, "BandName").iter().take(64).cloned().collect();
    let wavelengths = list(draft, namespace, "CentralWavelength");
    let camera = Pix4dCamera {
        model: draft.text(namespace, "ModelType"),
        focal_length_mm: focal.filter(|_| !in_pixels),
        focal_length_px: focal.filter(|_| in_pixels),
        principal_point_mm: fixed(draft, namespace, "PrincipalPoint"),
        perspective_distortion: fixed(draft, namespace, "PerspectiveDistortion"),
        fisheye_polynomial: list(draft, namespace, "FisheyePolynomial"),
        fisheye_affine: fixed(draft, namespace, "FisheyeAffineMatrix"),
        bands,
        wavelengths_nm: wavelengths,
        rig: draft.text(namespace, "RigName"),
        rig_camera: draft.text(namespace, "RigCameraIndex"),
        rig_relatives_deg: fixed(draft, namespace, "RigRelatives"),
        capture: draft.text(namespace, "CaptureUUID"),
        imu_time_offset: draft.number(namespace, "IMUTimeOffset"),
        line_readout_time: draft.number(namespace, "LineReadoutTime"),
    };
    (camera != Pix4dCamera::default()).then_some(camera)
}

/// Numbers of a list, or between commas in one text; what is broken is reported and empty.
fn list(draft: &mut Draft, namespace: Namespace, name: &str) -> Vec<f64> {
    let parsed = match draft.xmp.items(namespace, name) {
        [one] => numbers(one),
        many => many.iter().take(64).map(|t| number(t)).collect(),
    };
    draft.or_warn(&format!("Camera:{name}"), parsed).unwrap_or_default()
}

/// Exactly so many numbers; another count is reported.
fn fixed<const N: usize>(draft: &mut Draft, namespace: Namespace, name: &str) -> Option<[f64; N]> {
    draft.xmp.text(namespace, name)?;
    let values = list(draft, namespace, name);
    if values.is_empty() {
        return None;
    }
    let fitted = <[f64; N]>::try_from(values).map_err(|v| format!("{} numbers instead of {N}", v.len()));
    draft.or_warn(&format!("Camera:{name}"), fitted)
}
