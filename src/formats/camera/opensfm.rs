//! OpenSfM's and OpenDroneMap's `cameras.json`.
//!
//! Lengths are in units of the larger side of the image, the principal point is counted from its middle,
//! (width − 1) / 2 and (height − 1) / 2 in our pixels.

use super::{ExportError, Exported, skew_loss};
use crate::camera::{Camera, LensKind};
use serde_json::{Map, Value, json};

/// The camera as a `cameras.json` with this one camera.
///
/// - `name`: OpenSfM's key of the camera: "v2 make model width height projection focal".
///
/// # Errors
/// [`ExportError`]: OpenSfM has no rational lens.
pub fn camera_opensfm_json(camera: &Camera, name: &str) -> Result<Exported, ExportError> {
    let interior = camera.lens.interior();
    let [fx, fy, skew, cx, cy, ..] = interior;
    let projection = match camera.lens.kind() {
        LensKind::Brown => "brown",
        LensKind::Fisheye => "fisheye_opencv",
        LensKind::Rational => {
            return Err(ExportError { lens: camera.lens.kind().word(), format: "cameras.json" });
        }
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
    let mut losses = Vec::new();
    if skew != 0.0 {
        losses.push(skew_loss(camera, "cameras.json has no skew; it is left out"));
    }
    if camera.covariance.is_some() {
        losses.push("cameras.json has no place for the covariance: it is in camera.json".to_owned());
    }
    let mut text = serde_json::to_string_pretty(&json!({ name: entry })).unwrap_or_default();
    text.push('\n');
    Ok(Exported { text, losses })
}
