//! DJI's `DewarpData`: the line of XMP in which a DJI camera says its own calibration.
//!
//! "date;fx,fy,cx,cy,k1,k2,p1,p2,k3" in pixels, and `DewarpDataK6` with k4, k5, k6 after it. cx and cy are counted
//! from the middle of the photo. DJI's image processing guide adds them to the optical centre, which its photos give
//! as half of width and height, and uses the sum with OpenCV's `undistort`, whose (0, 0) is the centre of the
//! top-left pixel: cx in our pixels is width / 2 + cx, without half a pixel taken off.
//!
//! # Source
//! DJI, "Mavic 3M Image Processing Guide" (2023), step 2; Matrice 4 user manual, table of XMP fields.

use super::{CameraChoice, camera, interior};
use crate::camera::{Camera, LensKind};
use crate::formats::InputError;
use std::path::Path;

/// True of a text that is one line with a date, a semicolon and numbers with commas between.
pub(super) fn is_it(text: &str) -> bool {
    parts(text).is_some()
}

/// The numbers' part of the line.
fn parts(text: &str) -> Option<&str> {
    let line = text.trim().trim_matches('"').trim();
    let (date, numbers) = line.split_once(';')?;
    let is_date = (8..=10).contains(&date.len()) && date.chars().all(|c| c.is_ascii_digit() || c == '-');
    (is_date && !numbers.contains('\n') && numbers.split(',').count() >= 9).then_some(numbers)
}

/// The camera of a `DewarpData` or `DewarpDataK6`; `file` is for messages.
///
/// - `choice`: the image size has to be given.
///
/// # Errors
/// [`InputError`]: not such a line, or its numbers are no camera's (zeros where the camera was never calibrated).
pub fn camera_from_dewarp_data(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    choice.expects_one(file, "DJI DewarpData")?;
    let Some(numbers) = parts(text) else {
        return Err(InputError::new(file, "is no DewarpData: \"date;fx,fy,cx,cy,k1,k2,p1,p2,k3\""));
    };
    let values: Vec<f64> = numbers
        .split(',')
        .map(|word| {
            let word = word.trim();
            word.parse().map_err(|_| InputError::new(file, format!("DewarpData has \"{word}\" for a number")))
        })
        .collect::<Result<_, _>>()?;
    let kind = match values.len() {
        9 => LensKind::Brown,
        12 => LensKind::Rational,
        count => return Err(InputError::new(file, format!("DewarpData has {count} numbers, not 9 or 12"))),
    };
    if values.iter().all(|value| *value == 0.0) {
        return Err(InputError::new(file, "DewarpData is all zeros: this camera was not calibrated"));
    }
    let (width, height) = choice.size(file, None)?;
    let affine =
        [values[0], values[1], 0.0, 0.5 * f64::from(width) + values[2], 0.5 * f64::from(height) + values[3]];
    camera(file, kind, interior(affine, &values[4..]), width, height, None)
}
