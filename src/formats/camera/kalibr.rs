//! Kalibr's camchain YAML: one entry per camera, `cam0`, `cam1`, …
//!
//! Pixels are OpenCV's: (0, 0) is the centre of the top-left one. `radtan` is k1, k2, p1, p2 in OpenCV's meaning,
//! `equidistant` the Kannala–Brandt fisheye.
//!
//! # Source
//! Kalibr's wiki, "Supported models" and "YAML formats".

use super::{CameraChoice, ExportError, Exported, camera, common_losses, interior, opencv::row, yaml};
use crate::camera::{Camera, LensKind};
use crate::formats::InputError;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

const FORMAT: &str = "Kalibr's camchain";

#[derive(Deserialize)]
struct Entry {
    camera_model: Option<String>,
    intrinsics: Option<Vec<f64>>,
    distortion_model: Option<String>,
    distortion_coeffs: Option<Vec<f64>>,
    resolution: Option<Vec<u32>>,
}

/// The camera in a camchain.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    let chain: BTreeMap<String, Entry> = yaml(file, text, "Kalibr camchain")?;
    let (name, entry) = choice.of(file, chain.into_iter().collect())?;
    let refused = |cause: String| InputError::new(file, format!("camera \"{name}\": {cause}"));
    let missing = |key: &str| refused(format!("`{key}` is missing"));
    let model = entry.camera_model.ok_or_else(|| missing("camera_model"))?;
    if model != "pinhole" {
        return Err(refused(format!("`camera_model` is \"{model}\": this program has no such lens"))
            .help("calibrate with the models pinhole-radtan or pinhole-equi"));
    }
    let intrinsics = entry.intrinsics.ok_or_else(|| missing("intrinsics"))?;
    let &[fx, fy, cx, cy] = intrinsics.as_slice() else {
        return Err(refused(format!(
            "`intrinsics` has {} numbers; a pinhole has fu, fv, pu, pv",
            intrinsics.len()
        )));
    };
    let resolution = entry.resolution.map(|r| match r[..] {
        [width, height] => Ok((width, height)),
        _ => Err(refused(format!("`resolution` has {} numbers, not columns and rows", r.len()))),
    });
    let (width, height) = choice.size(file, resolution.transpose()?)?;
    let terms = entry.distortion_coeffs.unwrap_or_default();
    let (kind, needed) = match entry.distortion_model.as_deref() {
        Some("radtan") => (LensKind::Brown, 4),
        Some("equidistant") => (LensKind::Fisheye, 4),
        None | Some("none") => (LensKind::Brown, 0),
        Some(other) => {
            return Err(refused(format!("`distortion_model` is \"{other}\": this program has no such lens")));
        }
    };
    if terms.len() != needed {
        return Err(refused(format!("`distortion_coeffs` has {} numbers, not {needed}", terms.len())));
    }
    camera(file, kind, interior([fx, fy, 0.0, cx, cy], &terms), width, height, None)
}

/// The camera as a camchain with this one camera, `cam0`.
///
/// # Errors
/// [`ExportError`]: Kalibr has neither k3 nor any lens but `radtan` and `equidistant`.
pub fn camera_kalibr_yaml(camera: &Camera) -> Result<Exported, ExportError> {
    let interior = camera.lens.interior();
    let [fx, fy, _, cx, cy, ..] = interior;
    let (model, terms) = match camera.lens.kind() {
        LensKind::Brown if interior[5..10] == [0.0; 5] => ("none", &interior[..0]),
        LensKind::Brown if interior[9] != 0.0 => {
            return Err(ExportError::NoTerm { term: "k3", value: interior[9], format: FORMAT });
        }
        LensKind::Brown => ("radtan", &interior[5..9]),
        LensKind::Fisheye => ("equidistant", &interior[5..9]),
        kind => return Err(ExportError::NoLens { lens: kind.word(), format: FORMAT }),
    };
    let losses = common_losses(camera, FORMAT, true);
    let comments: String = losses.iter().map(|loss| format!("# {loss}\n")).collect();
    let text = format!(
        "{comments}cam0:\n  camera_model: pinhole\n  intrinsics: [{}]\n  distortion_model: {model}\n  \
         distortion_coeffs: [{}]\n  resolution: [{}, {}]\n  rostopic: /cam0/image_raw\n",
        row(&[fx, fy, cx, cy]),
        row(terms),
        camera.width,
        camera.height,
    );
    Ok(Exported { text, losses })
}
