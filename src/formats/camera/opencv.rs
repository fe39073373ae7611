//! OpenCV's camera files: FileStorage YAML as its calibration samples write and read it. ROS camera_info files,
//! which use the same keys, are read here too.

use super::export::skew_loss;
use super::{CameraChoice, ExportError, Exported, camera, common_losses, interior, yaml};
use crate::camera::{Camera, Interior, LensKind};
use crate::formats::InputError;
use serde::Deserialize;
use std::path::Path;

/// The camera as OpenCV's FileStorage writes it, for OpenCV's own programs.
///
/// The covariance is left out, and OpenCV's functions take the skew as zero although it stands in the matrix.
///
/// # Errors
/// [`ExportError`]: OpenCV has no such lens.
pub fn camera_opencv_yaml(camera: &Camera) -> Result<Exported, ExportError> {
    const FORMAT: &str = "OpenCV";
    if camera.lens.kind() == LensKind::Pix4dFisheye {
        return Err(ExportError::NoLens { lens: camera.lens.kind().word(), format: FORMAT });
    }
    let interior = camera.lens.interior();
    let [fx, fy, skew, cx, cy, ..] = interior;
    let terms = &interior[5..camera.lens.names().len()];
    let mut losses = common_losses(camera, FORMAT, false);
    if skew != 0.0 {
        losses.insert(
            0,
            skew_loss(camera, "OpenCV's functions ignore the skew in row 1, column 2 of the matrix"),
        );
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
    Ok(Exported { text, losses })
}

/// Numbers with commas between.
pub(super) fn row(values: &[f64]) -> String {
    values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(", ")
}

/// Shortest text that reads back to the same bits, with the decimal point that OpenCV needs to see a real, and the
/// point before and the sign in the exponent that Python's YAML asks for.
fn number(value: f64) -> String {
    let text = format!("{value:?}");
    let (mantissa, exponent) = text.split_once('e').map_or((text.as_str(), None), |(m, e)| (m, Some(e)));
    let mantissa = mantissa.strip_suffix('0').filter(|m| m.ends_with('.')).unwrap_or(mantissa);
    let point = if mantissa.contains('.') { "" } else { "." };
    match exponent {
        None => format!("{mantissa}{point}"),
        Some(exponent) if exponent.starts_with('-') => format!("{mantissa}{point}e{exponent}"),
        Some(exponent) => format!("{mantissa}{point}e+{exponent}"),
    }
}

/// The lens of OpenCV's coefficients k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 τx τy, or the first of them: the simplest
/// that has all that are not zero.
pub(super) fn from_coefficients(
    affine: [f64; 5],
    coefficients: &[f64],
) -> Result<(LensKind, Interior), String> {
    const NAMES: [&str; 2] = ["τx", "τy"];
    if let Some((name, value)) =
        NAMES.iter().zip(coefficients.iter().skip(12)).find(|(_, value)| **value != 0.0)
    {
        return Err(format!("{name} = {value}: this program has no tilted sensor, its lens ends with s4"));
    }
    let beyond = |place: usize| coefficients.iter().skip(place).any(|value| *value != 0.0);
    let kind = match (beyond(8), beyond(5)) {
        (true, _) => LensKind::ThinPrism,
        (false, true) => LensKind::Rational,
        (false, false) => LensKind::Brown,
    };
    let count = (kind.names().len() - 5).min(coefficients.len());
    Ok((kind, interior(affine, &coefficients[..count])))
}

/// The camera in an OpenCV file.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
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
    choice.expects_one(file, "OpenCV or ROS")?;
    // The tag is not declared: YAML would refuse it.
    let parsed: OpenCv = yaml(file, &text.replace("!!opencv-matrix", ""), "OpenCV camera")?;
    let missing = |key: &str| {
        InputError::new(file, format!("`{key}` is missing"))
            .help("OpenCV's calibration writes image_width, image_height, camera_matrix and distortion_coefficients")
    };
    let width = parsed.image_width.ok_or_else(|| missing("image_width"))?;
    let height = parsed.image_height.ok_or_else(|| missing("image_height"))?;
    let (width, height) = choice.size(file, Some((width, height)))?;
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
    if lens.rows.checked_mul(lens.cols) != Some(coefficients.len()) || !lengths.contains(&coefficients.len())
    {
        let cause = format!(
            "`distortion_coefficients` is {} × {} with {} numbers; OpenCV writes {} for this model",
            lens.rows,
            lens.cols,
            coefficients.len(),
            if fisheye { "4" } else { "4, 5, 8, 12 or 14" }
        );
        return Err(InputError::new(file, cause));
    }
    let affine = [fx, fy, skew, cx, cy];
    let (kind, interior) = if fisheye {
        (LensKind::Fisheye, interior(affine, &coefficients))
    } else {
        from_coefficients(affine, &coefficients).map_err(|cause| {
            InputError::new(file, format!("`distortion_coefficients` has {cause}"))
                .help("calibrate again without CALIB_TILTED_MODEL")
        })?
    };
    camera(file, kind, interior, width, height, None)
}
