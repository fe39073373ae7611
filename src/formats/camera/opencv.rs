//! OpenCV's camera files: FileStorage YAML as its calibration samples write and read it. ROS camera_info files,
//! which use the same keys, are read here too.

use super::{Exported, camera, skew_loss};
use crate::camera::{Camera, Interior, LensKind, MAX_INTERIOR};
use crate::formats::InputError;
use serde::Deserialize;
use std::path::Path;

/// The camera as OpenCV's FileStorage writes it, for OpenCV's own programs.
///
/// The covariance is left out, and OpenCV's functions take the skew as zero although it stands in the matrix.
#[must_use]
pub fn camera_opencv_yaml(camera: &Camera) -> Exported {
    let interior = camera.lens.interior();
    let [fx, fy, skew, cx, cy, ..] = interior;
    let terms = &interior[5..camera.lens.names().len()];
    let mut losses = Vec::new();
    if skew != 0.0 {
        losses.push(skew_loss(camera, "OpenCV's functions ignore the skew in row 1, column 2 of the matrix"));
    }
    if camera.covariance.is_some() {
        losses.push("OpenCV has no place for the covariance: it is in camera.json".to_owned());
    }
    let comments: String = losses.iter().map(|loss| format!("# {loss}\n")).collect();
    let fisheye = if camera.lens.kind() == LensKind::Fisheye { "fisheye_model: 1\n" } else { "" };
    let text = format!(
        "%YAML:1.0\n---\n{comments}image_width: {}\nimage_height: {}\n{fisheye}camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {},\n       0., {},\n       \
         0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: {}\n   cols: 1\n   dt: d\n   \
         data: [ {} ]\n",
        camera.width,
        camera.height,
        row(&[fx, skew, cx]),
        row(&[fy, cy]),
        terms.len(),
        row(terms),
    );
    Exported { text, losses }
}

/// Numbers with commas between.
pub(super) fn row(values: &[f64]) -> String {
    values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(", ")
}

/// Shortest text that reads back to the same bits, with the decimal point that OpenCV needs to see a real.
fn number(value: f64) -> String {
    let text = format!("{value:?}");
    match text.strip_suffix(".0") {
        Some(whole) => format!("{whole}."),
        None => text,
    }
}

/// The camera in an OpenCV file.
pub(super) fn from_text(file: &Path, text: &str) -> Result<Camera, InputError> {
    #[derive(Deserialize)]
    struct Matrix {
        rows: usize,
        cols: usize,
        data: Vec<f64>,
    }
    #[derive(Deserialize)]
    struct OpenCv {
        image_width: Option<u32>,
        image_height: Option<u32>,
        camera_matrix: Option<Matrix>,
        distortion_coefficients: Option<Matrix>,
        fisheye_model: Option<i64>,
        distortion_model: Option<String>,
    }
    // OpenCV's first line and its tag are not legal YAML; lines are kept so that places stay right.
    let yaml: String = text
        .lines()
        .map(|line| if line.starts_with("%YAML") { "" } else { line })
        .flat_map(|line| [line, "\n"])
        .collect::<String>()
        .replace("!!opencv-matrix", "");
    let parsed: OpenCv = serde_saphyr::from_str(&yaml).map_err(|error| {
        let cause = format!("is no OpenCV camera file: {}", error.without_snippet());
        let refused = InputError::new(file, cause);
        match error.location() {
            Some(location) => refused.line(location.line()),
            None => refused,
        }
    })?;
    let missing = |key: &str| {
        InputError::new(file, format!("`{key}` is missing"))
            .help("OpenCV's calibration writes image_width, image_height, camera_matrix and distortion_coefficients")
    };
    let width = parsed.image_width.ok_or_else(|| missing("image_width"))?;
    let height = parsed.image_height.ok_or_else(|| missing("image_height"))?;
    let k = parsed.camera_matrix.ok_or_else(|| missing("camera_matrix"))?;
    if (k.rows, k.cols, k.data.len()) != (3, 3, 9) {
        let cause =
            format!("`camera_matrix` is {} × {} with {} numbers, not 3 × 3", k.rows, k.cols, k.data.len());
        return Err(InputError::new(file, cause));
    }
    let [fx, skew, cx, zero_a, fy, cy, zero_b, zero_c, one] = std::array::from_fn(|i| k.data[i]);
    if [zero_a, zero_b, zero_c, one] != [0.0, 0.0, 0.0, 1.0] {
        return Err(InputError::new(
            file,
            "`camera_matrix` is not upper triangular with 1 in its last place",
        ));
    }
    let lens = parsed.distortion_coefficients.ok_or_else(|| missing("distortion_coefficients"))?;
    let coefficients = lens.data;
    let named = parsed.distortion_model.as_deref();
    if let Some(unknown) = named.filter(|n| !["plumb_bob", "rational_polynomial", "equidistant"].contains(n))
    {
        let cause = format!("`distortion_model` is \"{unknown}\": this program has no such lens");
        return Err(InputError::new(file, cause));
    }
    let fisheye = parsed.fisheye_model.is_some_and(|flag| flag != 0) || named == Some("equidistant");
    let lengths: &[usize] = if fisheye { &[4] } else { &[0, 4, 5, 8, 12, 14] };
    if lens.rows * lens.cols != coefficients.len() || !lengths.contains(&coefficients.len()) {
        let cause = format!(
            "`distortion_coefficients` is {} × {} with {} numbers; OpenCV writes {} for this model",
            lens.rows,
            lens.cols,
            coefficients.len(),
            if fisheye { "4" } else { "4, 5, 8, 12 or 14" }
        );
        return Err(InputError::new(file, cause));
    }
    let beyond = ["s1", "s2", "s3", "s4", "τx", "τy"];
    if let Some((name, value)) =
        beyond.iter().zip(coefficients.iter().skip(8)).find(|(_, value)| **value != 0.0)
    {
        let cause =
            format!("`distortion_coefficients` has {name} = {value}: this program's lens ends with k6");
        return Err(InputError::new(file, cause)
            .help("calibrate again with 8 coefficients (k1 k2 p1 p2 k3 k4 k5 k6) or fewer"));
    }
    let kind = if fisheye {
        LensKind::Fisheye
    } else if coefficients.iter().skip(5).any(|value| *value != 0.0) {
        LensKind::Rational
    } else {
        LensKind::Brown
    };
    let affine = [fx, fy, skew, cx, cy];
    let mut interior: Interior = [0.0; MAX_INTERIOR];
    for (value, given) in interior.iter_mut().zip(affine.iter().chain(&coefficients)) {
        *value = *given;
    }
    camera(file, kind, interior, width, height, None)
}
