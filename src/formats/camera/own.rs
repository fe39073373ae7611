//! Our camera format: JSON with covariance.
//!
//! It names its units in the keys, says where pixel (0, 0) is, and gives every number in the shortest form that reads
//! back to the same bits:
//!
//! ```json
//! { "format": "boresight-camera", "version": 1, "model": "brown",
//!   "pixel_origin": "centre_of_top_left_pixel", "image_width_px": 1152, "image_height_px": 648,
//!   "fx_px": 743.7937, "…": 0, "covariance": null, "source": { "method": "photos" } }
//! ```
//!
//! `model` is `brown` (k1 k2 p1 p2 k3), `rational` (k1 k2 p1 p2 k3 k4 k5 k6), `thin_prism` (those and s1 s2 s3 s4),
//! `fisheye` (k1 k2 k3 k4) or `pix4d_fisheye` (row_skew_px rho2 rho3 rho4).

use super::{CameraChoice, camera};
use crate::camera::{Camera, InteriorCovariance, LensKind, MAX_INTERIOR};
use crate::formats::InputError;
use serde::{Deserialize, Serialize};
use std::path::Path;

const FORMAT: &str = "boresight-camera";
const VERSION: u32 = 1;
const PIXEL_ORIGIN: &str = "centre_of_top_left_pixel";

/// Our format, key by key; which lens terms there are depends on the model.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    format: String,
    version: u32,
    model: String,
    pixel_origin: String,
    image_width_px: u32,
    image_height_px: u32,
    fx_px: f64,
    fy_px: f64,
    skew_px: f64,
    cx_px: f64,
    cy_px: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    k1: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    k2: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    p1: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    p2: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    k3: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    k4: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    k5: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    k6: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    s1: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    s2: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    s3: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    s4: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    row_skew_px: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rho2: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rho3: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rho4: Option<f64>,
    /// Rows and columns in the order of `covariance_order`; null when not known.
    covariance: Option<Vec<Vec<f64>>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    covariance_order: Option<Vec<String>>,
    /// Where the numbers come from; free form, for readers.
    #[serde(default)]
    source: serde_json::Value,
}

impl CameraFile {
    /// The value of a parameter by its name; `None` when the file does not hold it.
    fn parameter(&self, name: &str) -> Option<f64> {
        match name {
            "fx_px" => Some(self.fx_px),
            "fy_px" => Some(self.fy_px),
            "skew_px" => Some(self.skew_px),
            "cx_px" => Some(self.cx_px),
            "cy_px" => Some(self.cy_px),
            "k1" => self.k1,
            "k2" => self.k2,
            "p1" => self.p1,
            "p2" => self.p2,
            "k3" => self.k3,
            "k4" => self.k4,
            "k5" => self.k5,
            "k6" => self.k6,
            "s1" => self.s1,
            "s2" => self.s2,
            "s3" => self.s3,
            "s4" => self.s4,
            "row_skew_px" => self.row_skew_px,
            "rho2" => self.rho2,
            "rho3" => self.rho3,
            "rho4" => self.rho4,
            _ => None,
        }
    }
}

/// The camera in our format, ending in a line feed.
///
/// - `source`: where the numbers come from, for readers; any JSON.
#[must_use]
pub fn camera_json(camera: &Camera, source: serde_json::Value) -> String {
    let names = camera.lens.names();
    let interior = camera.lens.interior();
    let term = |name: &str| names.iter().position(|n| *n == name).map(|k| interior[k]);
    let [fx_px, fy_px, skew_px, cx_px, cy_px, ..] = interior;
    let count = names.len();
    let covariance: Option<Vec<Vec<f64>>> = camera
        .covariance
        .map(|matrix| (0..count).map(|i| (0..count).map(|j| matrix[(i, j)]).collect()).collect());
    let covariance_order =
        covariance.is_some().then(|| names.iter().map(|name| (*name).to_owned()).collect());
    let file = CameraFile {
        format: FORMAT.to_owned(),
        version: VERSION,
        model: camera.lens.kind().word().to_owned(),
        pixel_origin: PIXEL_ORIGIN.to_owned(),
        image_width_px: camera.width,
        image_height_px: camera.height,
        fx_px,
        fy_px,
        skew_px,
        cx_px,
        cy_px,
        k1: term("k1"),
        k2: term("k2"),
        p1: term("p1"),
        p2: term("p2"),
        k3: term("k3"),
        k4: term("k4"),
        k5: term("k5"),
        k6: term("k6"),
        s1: term("s1"),
        s2: term("s2"),
        s3: term("s3"),
        s4: term("s4"),
        row_skew_px: term("row_skew_px"),
        rho2: term("rho2"),
        rho3: term("rho3"),
        rho4: term("rho4"),
        covariance,
        covariance_order,
        source,
    };
    let mut text = serde_json::to_string_pretty(&file).unwrap_or_default();
    text.push('\n');
    text
}

/// True of a text that names our format.
pub(super) fn is_it(text: &str) -> bool {
    text.contains(FORMAT)
}

/// The camera in a file of our format.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    /// What says whether the rest can be understood at all.
    #[derive(Deserialize)]
    struct Kind {
        format: Option<String>,
        version: Option<u32>,
        model: Option<String>,
        pixel_origin: Option<String>,
    }
    let malformed = |error: serde_json::Error| {
        InputError::new(file, format!("is no camera file: {error}")).line(error.line() as u64)
    };
    let kind: Kind = serde_json::from_str(text).map_err(malformed)?;
    let expect = |key: &str, found: Option<String>, expected: &str| match found {
        Some(found) if found == expected => Ok(()),
        Some(found) => Err(InputError::new(file, format!("`{key}` is \"{found}\", not \"{expected}\""))),
        None => Err(InputError::new(file, format!("`{key}` is missing; it must be \"{expected}\""))),
    };
    expect("format", kind.format, FORMAT)?;
    choice.expects_one(file, "boresight")?;
    match kind.version {
        Some(VERSION) => {}
        Some(other) => {
            return Err(InputError::new(file, format!("`version` is {other}; this program reads {VERSION}"))
                .help("use the version of boresight that wrote it, or calibrate again"));
        }
        None => return Err(InputError::new(file, format!("`version` is missing; it must be {VERSION}"))),
    }
    let model = LensKind::ALL.into_iter().find(|model| kind.model.as_deref() == Some(model.word()));
    let Some(model) = model else {
        let known = LensKind::ALL.map(LensKind::word).join(", ");
        let found = kind.model.map_or("missing".to_owned(), |found| format!("\"{found}\""));
        return Err(InputError::new(file, format!("`model` is {found}; this program knows {known}")));
    };
    expect("pixel_origin", kind.pixel_origin, PIXEL_ORIGIN)?;
    let f: CameraFile = serde_json::from_str(text).map_err(malformed)?;
    let names = model.names();
    if f.covariance_order.as_ref().is_some_and(|order| order != names) {
        return Err(InputError::new(file, format!("`covariance_order` must be {}", names.join(", "))));
    }
    let mut all = LensKind::ALL.into_iter().flat_map(LensKind::names);
    if let Some(alien) = all.find(|name| f.parameter(name).is_some() && !names.contains(name)) {
        return Err(InputError::new(file, format!("`{alien}` is no parameter of a {} lens", model.word())));
    }
    let mut interior = [0.0; MAX_INTERIOR];
    for (value, name) in interior.iter_mut().zip(names) {
        *value =
            f.parameter(name).ok_or_else(|| InputError::new(file, format!("`{name}` is missing or null")))?;
    }
    let covariance = f.covariance.map(|rows| covariance(file, names, &rows)).transpose()?;
    let (width, height) = choice.size(file, Some((f.image_width_px, f.image_height_px)))?;
    camera(file, model, interior, width, height, covariance)
}

fn covariance(file: &Path, names: &[&str], rows: &[Vec<f64>]) -> Result<InteriorCovariance, InputError> {
    let failed = |cause: String| InputError::new(file, format!("`covariance` {cause}"));
    let count = names.len();
    if rows.len() != count || rows.iter().any(|row| row.len() != count) {
        return Err(failed(format!("must have {count} rows of {count} numbers, it has {} rows", rows.len())));
    }
    let element = |i: usize, j: usize| rows.get(i).and_then(|row| row.get(j)).copied().unwrap_or(0.0);
    let matrix = InteriorCovariance::from_fn(element);
    for (i, name) in names.iter().enumerate() {
        if !matrix.row(i).iter().all(|v| v.is_finite()) || matrix[(i, i)] < 0.0 {
            return Err(failed(format!("gives {name} the variance {}", matrix[(i, i)])));
        }
        for (j, other) in names.iter().enumerate().take(i) {
            let (a, b) = (matrix[(i, j)], matrix[(j, i)]);
            let bound = (matrix[(i, i)] * matrix[(j, j)]).sqrt();
            if (a - b).abs() > 1e-9 * bound {
                return Err(failed(format!("is not symmetric for {other} and {name}")));
            }
            if a.abs() > bound * (1.0 + 1e-9) {
                return Err(failed(format!(
                    "gives {other} and {name} a correlation of {}, beyond ±1",
                    a / bound
                )));
            }
        }
    }
    Ok(matrix)
}
