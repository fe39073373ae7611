//! orthority's interior parameter YAML: one entry per camera.
//!
//! Focal lengths are in the unit of `sensor_size`, or, without it, in units of the image's larger side. The principal
//! point is counted from the image's middle, (width − 1) / 2 and (height − 1) / 2 in our pixels, in units of the
//! larger side. Coefficients have OpenCV's names and meanings.
//!
//! # Source
//! orthority's documentation, "Orthority interior parameters" (0.7). Of images that are higher than wide it says
//! that a focal length without `sensor_size` is in units of the larger side, but takes it in units of the width: such
//! a file is refused.

use super::opencv::{from_coefficients, row};
use super::{CameraChoice, ExportError, Exported, camera, common_losses, interior, yaml};
use crate::camera::{Camera, LensKind};
use crate::formats::InputError;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// A focal length, or one for columns and one for rows.
#[derive(Deserialize)]
#[serde(untagged)]
enum Focal {
    Both(f64),
    Each(Vec<f64>),
}

#[derive(Deserialize)]
struct Entry {
    r#type: String,
    #[serde(default, rename = "name")]
    _name: Option<String>,
    im_size: [u32; 2],
    focal_len: Focal,
    sensor_size: Option<[f64; 2]>,
    #[serde(default)]
    cx: f64,
    #[serde(default)]
    cy: f64,
    /// Every other key.
    #[serde(flatten)]
    terms: BTreeMap<String, f64>,
}

/// The terms of each type, in the order of our interior parameters or of OpenCV's coefficients.
fn terms_of(kind: &str) -> Option<&'static [&'static str]> {
    match kind {
        "pinhole" => Some(&[]),
        "brown" => Some(&["k1", "k2", "p1", "p2", "k3"]),
        "fisheye" => Some(&["k1", "k2", "k3", "k4"]),
        "opencv" => {
            Some(&["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty"])
        }
        _ => None,
    }
}

/// The camera in an interior parameter file.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    let cameras: BTreeMap<String, Entry> = yaml(file, text, "orthority interior parameter")?;
    let (name, entry) = choice.of(file, cameras.into_iter().collect())?;
    let refused = |cause: String| InputError::new(file, format!("camera \"{name}\": {cause}"));
    let Some(terms) = terms_of(&entry.r#type) else {
        return Err(refused(format!("`type` is \"{}\": this program has no such lens", entry.r#type)));
    };
    if let Some(alien) = entry.terms.keys().find(|key| !terms.contains(&key.as_str())) {
        return Err(refused(format!("`{alien}` is no key of a {} camera", entry.r#type)));
    }
    let [width, height] = entry.im_size;
    let (width, height) = choice.size(file, Some((width, height)))?;
    let larger = f64::from(width.max(height));
    let [fx, fy] = match entry.focal_len {
        Focal::Both(f) => [f, f],
        Focal::Each(ref each) => match each[..] {
            [fx, fy] => [fx, fy],
            _ => return Err(refused(format!("`focal_len` has {} numbers, not 1 or 2", each.len()))),
        },
    };
    let [pixels_per_unit_x, pixels_per_unit_y] = match entry.sensor_size {
        Some([across, down]) => [f64::from(width) / across, f64::from(height) / down],
        None if height > width => {
            return Err(refused(format!(
                "the image, {width} × {height} px, is higher than wide and there is no `sensor_size`: orthority \
                 itself takes the focal length in units of the width, its documentation in units of the height"
            ))
            .help("add sensor_size"));
        }
        None => [larger, larger],
    };
    let middle = |side: u32| 0.5 * (f64::from(side) - 1.0);
    let affine = [
        fx * pixels_per_unit_x,
        fy * pixels_per_unit_y,
        0.0,
        middle(width) + entry.cx * larger,
        middle(height) + entry.cy * larger,
    ];
    let values: Vec<f64> = terms.iter().map(|term| entry.terms.get(*term).copied().unwrap_or(0.0)).collect();
    if entry.r#type == "opencv" {
        let (kind, interior) = from_coefficients(affine, &values).map_err(refused)?;
        return camera(file, kind, interior, width, height, None);
    }
    let kind = if entry.r#type == "fisheye" { LensKind::Fisheye } else { LensKind::Brown };
    camera(file, kind, interior(affine, &values), width, height, None)
}

/// The camera as an interior parameter file with this one camera.
///
/// - `name`: what orthority shall call the camera.
///
/// # Errors
/// [`ExportError`]: orthority has no such lens.
pub fn camera_orthority_yaml(camera: &Camera, name: &str) -> Result<Exported, ExportError> {
    const FORMAT: &str = "orthority";
    let interior = camera.lens.interior();
    let [fx, fy, _, cx, cy, ..] = interior;
    let kind = match camera.lens.kind() {
        LensKind::Brown => "brown",
        LensKind::Fisheye => "fisheye",
        LensKind::Rational | LensKind::ThinPrism => "opencv",
        kind @ LensKind::Pix4dFisheye => {
            return Err(ExportError::NoLens { lens: kind.word(), format: FORMAT });
        }
    };
    let losses = common_losses(camera, FORMAT, true);
    let comments: String = losses.iter().map(|loss| format!("# {loss}\n")).collect();
    let larger = f64::from(camera.width.max(camera.height));
    let middle = camera.image_centre();
    let terms: String = camera
        .lens
        .names()
        .iter()
        .zip(interior)
        .skip(5)
        .map(|(term, value)| format!("  {term}: {}\n", row(&[value])))
        .collect();
    // The sensor's size in pixels makes the focal lengths pixels.
    let text = format!(
        "{comments}{}:\n  type: {kind}\n  im_size: [{width}, {height}]\n  sensor_size: [{width}.0, {height}.0]\n  \
         focal_len: [{}]\n  cx: {}\n  cy: {}\n{terms}",
        super::quoted(name),
        row(&[fx, fy]),
        row(&[(cx - middle.column) / larger]),
        row(&[(cy - middle.row) / larger]),
        width = camera.width,
        height = camera.height,
    );
    Ok(Exported { text, losses })
}
