//! OpenSfM's and OpenDroneMap's `cameras.json`, and the cameras of a `reconstruction.json`.
//!
//! Lengths are in units of the larger side of the image, the principal point is counted from its middle,
//! (width − 1) / 2 and (height − 1) / 2 in our pixels. ODM resizes photos: the size there may not be the files'.
//!
//! # Source
//! OpenSfM's documentation, "Geometric Models", and its `io` module for the keys of each projection type.

use super::{CameraChoice, ExportError, Exported, camera, common_losses, interior};
use crate::camera::{Camera, LensKind};
use crate::formats::InputError;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::Path;

const FORMAT: &str = "cameras.json";
/// What OpenSfM puts before the names of its cameras.
const VERSION_PREFIX: &str = "v2 ";

/// A camera; keys that are not here say how it was found, not what it is.
#[derive(Deserialize)]
struct Entry {
    projection_type: String,
    width: u32,
    height: u32,
    focal: Option<f64>,
    focal_x: Option<f64>,
    focal_y: Option<f64>,
    #[serde(default)]
    c_x: f64,
    #[serde(default)]
    c_y: f64,
    #[serde(default)]
    k1: f64,
    #[serde(default)]
    k2: f64,
    #[serde(default)]
    k3: f64,
    #[serde(default)]
    k4: f64,
    #[serde(default)]
    p1: f64,
    #[serde(default)]
    p2: f64,
}

#[derive(Deserialize)]
struct Reconstruction {
    cameras: BTreeMap<String, Entry>,
}

/// True of a text that is OpenSfM's.
pub(super) fn is_it(text: &str) -> bool {
    text.contains("\"projection_type\"")
}

/// The camera in a `cameras.json` or `reconstruction.json`.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    let malformed = |error: serde_json::Error| {
        InputError::new(file, format!("is no {FORMAT}: {error}")).line(error.line() as u64)
    };
    let cameras: BTreeMap<String, Entry> = if text.trim_start().starts_with('[') {
        let parts: Vec<Reconstruction> = serde_json::from_str(text).map_err(malformed)?;
        let Ok([reconstruction]) = <[Reconstruction; 1]>::try_from(parts) else {
            return Err(InputError::new(file, "does not hold exactly one reconstruction")
                .help("give the cameras.json of the same project"));
        };
        reconstruction.cameras
    } else {
        serde_json::from_str(text).map_err(malformed)?
    };
    let plain = |name: String| name.strip_prefix(VERSION_PREFIX).map_or(name.clone(), str::to_owned);
    let wanted = choice.name.map(|name| name.strip_prefix(VERSION_PREFIX).unwrap_or(name));
    let cameras = cameras.into_iter().map(|(name, entry)| (plain(name), entry)).collect();
    let (name, entry) = CameraChoice { name: wanted, ..*choice }.of(file, cameras)?;
    let refused = |cause: String| InputError::new(file, format!("camera \"{name}\": {cause}"));
    let (width, height) = choice.size(file, Some((entry.width, entry.height)))?;
    let [fx, fy] = match (entry.focal, entry.focal_x, entry.focal_y) {
        (Some(focal), None, None) => [focal, focal],
        (None, Some(x), Some(y)) => [x, y],
        _ => return Err(refused("neither `focal` alone nor `focal_x` with `focal_y`".to_owned())),
    };
    let Entry { k1, k2, k3, k4, p1, p2, .. } = entry;
    let (kind, terms) = match entry.projection_type.as_str() {
        "perspective" | "radial" => (LensKind::Brown, vec![k1, k2]),
        "simple_radial" => (LensKind::Brown, vec![k1]),
        "brown" => (LensKind::Brown, vec![k1, k2, p1, p2, k3]),
        "fisheye" => (LensKind::Fisheye, vec![k1, k2]),
        "fisheye_opencv" => (LensKind::Fisheye, vec![k1, k2, k3, k4]),
        other => {
            return Err(refused(format!("`projection_type` is \"{other}\": this program has no such lens")));
        }
    };
    let size = f64::from(width.max(height));
    let middle = |side: u32| 0.5 * (f64::from(side) - 1.0);
    let centre = [middle(width) + entry.c_x * size, middle(height) + entry.c_y * size];
    let affine = [fx * size, fy * size, 0.0, centre[0], centre[1]];
    camera(file, kind, interior(affine, &terms), width, height, None)
}

/// The camera as a `cameras.json` with this one camera.
///
/// - `name`: OpenSfM's key of the camera: "v2 make model width height projection focal".
///
/// # Errors
/// [`ExportError`]: OpenSfM has no such lens.
pub fn camera_opensfm_json(camera: &Camera, name: &str) -> Result<Exported, ExportError> {
    let interior = camera.lens.interior();
    let [fx, fy, _, cx, cy, ..] = interior;
    let projection = match camera.lens.kind() {
        LensKind::Brown => "brown",
        LensKind::Fisheye => "fisheye_opencv",
        kind => return Err(ExportError::NoLens { lens: kind.word(), format: FORMAT }),
    };
    let size = f64::from(camera.width.max(camera.height));
    let middle = camera.image_centre();
    let mut entry = Map::new();
    let mut put = |key: &str, value: Value| entry.insert(key.to_owned(), value);
    put("projection_type", json!(projection));
    put("width", json!(camera.width));
    put("height", json!(camera.height));
    put("focal_x", json!(fx / size));
    put("focal_y", json!(fy / size));
    put("c_x", json!((cx - middle.column) / size));
    put("c_y", json!((cy - middle.row) / size));
    for (name, value) in camera.lens.names().iter().zip(interior).skip(5) {
        put(name, json!(value));
    }
    let losses = common_losses(camera, FORMAT, true);
    let mut text = serde_json::to_string_pretty(&json!({ name: entry })).unwrap_or_default();
    text.push('\n');
    Ok(Exported { text, losses })
}
