//! COLMAP's `cameras.txt`: one line per camera, "id MODEL width height parameters".
//!
//! COLMAP counts pixels from the image's corner: half a pixel is taken off the principal point. Terms have OpenCV's
//! meanings; cameras are chosen by their id.
//!
//! # Source
//! COLMAP's documentation, "Output Format" and "Camera Models", and its list of models with their parameters.

use super::{CameraChoice, ExportError, Exported, camera, common_losses, interior};
use crate::camera::{Camera, LensKind};
use crate::formats::InputError;
use std::path::Path;

/// From the corner of the top-left pixel to its centre.
const HALF: f64 = 0.5;

/// A model's name, its number of focal lengths, its lens, and where its terms stand among the lens's.
type Model = (&'static str, usize, LensKind, &'static [usize]);

/// The models that are lenses of ours.
const MODELS: [Model; 9] = [
    ("SIMPLE_PINHOLE", 1, LensKind::Brown, &[]),
    ("PINHOLE", 2, LensKind::Brown, &[]),
    ("SIMPLE_RADIAL", 1, LensKind::Brown, &[0]),
    ("RADIAL", 1, LensKind::Brown, &[0, 1]),
    ("OPENCV", 2, LensKind::Brown, &[0, 1, 2, 3]),
    ("FULL_OPENCV", 2, LensKind::Rational, &[0, 1, 2, 3, 4, 5, 6, 7]),
    ("SIMPLE_RADIAL_FISHEYE", 1, LensKind::Fisheye, &[0]),
    ("RADIAL_FISHEYE", 1, LensKind::Fisheye, &[0, 1]),
    ("OPENCV_FISHEYE", 2, LensKind::Fisheye, &[0, 1, 2, 3]),
];

/// True of a text whose first line that is no comment begins like a camera's: id, MODEL, width, height.
pub(super) fn is_it(text: &str) -> bool {
    let Some((_, line)) = lines(text).next() else { return false };
    let mut words = line.split_whitespace();
    let number = |word: Option<&str>| word.is_some_and(|w| w.parse::<u64>().is_ok());
    let capitals =
        |word: &str| word.chars().all(|c| c == '_' || c.is_ascii_uppercase() || c.is_ascii_digit());
    number(words.next())
        && words.next().is_some_and(|w| w.starts_with(|c: char| c.is_ascii_uppercase()) && capitals(w))
        && number(words.next())
        && number(words.next())
}

/// Lines that hold a camera, with their numbers.
fn lines(text: &str) -> impl Iterator<Item = (u64, &str)> {
    (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#'))
}

/// The camera in a `cameras.txt`.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    let cameras = lines(text)
        .map(|(number, line)| (line.split_whitespace().next().unwrap_or_default().to_owned(), (number, line)))
        .collect();
    let (_, (number, line)) = choice.of(file, cameras)?;
    let refused = |cause: String| InputError::new(file, cause).line(number);
    let mut words = line.split_whitespace().skip(1);
    let model = words.next().unwrap_or_default();
    let mut side = |name: &str| {
        let word = words.next().unwrap_or_default();
        word.parse::<u32>().map_err(|_| refused(format!("the {name} is \"{word}\", not a number of pixels")))
    };
    let size = (side("width")?, side("height")?);
    let (width, height) = choice.size(file, Some(size))?;
    let Some((_, focals, kind, places)) = MODELS.into_iter().find(|(name, ..)| *name == model) else {
        let known = MODELS.map(|(name, ..)| name).join(", ");
        return Err(refused(format!("the model is \"{model}\"; this program knows {known}")));
    };
    let values: Vec<f64> = words
        .map(|word| word.parse().map_err(|_| refused(format!("a parameter is \"{word}\", not a number"))))
        .collect::<Result<_, _>>()?;
    let needed = focals + 2 + places.len();
    if values.len() != needed {
        return Err(refused(format!("{model} has {needed} parameters, here are {}", values.len())));
    }
    let (focal, rest) = values.split_at(focals);
    let (centre, given) = rest.split_at(2);
    let affine = [focal[0], focal[focals - 1], 0.0, centre[0] - HALF, centre[1] - HALF];
    let mut terms = [0.0; 8];
    for (place, value) in places.iter().zip(given) {
        terms[*place] = *value;
    }
    // Without k4, k5, k6 the full model is Brown's.
    let kind = if kind == LensKind::Rational && terms[5..] == [0.0; 3] { LensKind::Brown } else { kind };
    let count = kind.names().len() - 5;
    camera(file, kind, interior(affine, &terms[..count]), width, height, None)
}

/// The camera as a `cameras.txt` with this one camera, number 1.
///
/// # Errors
/// [`ExportError`]: COLMAP has no such lens.
pub fn camera_colmap_txt(camera: &Camera) -> Result<Exported, ExportError> {
    const FORMAT: &str = "COLMAP";
    let interior = camera.lens.interior();
    let [fx, fy, _, cx, cy, ..] = interior;
    let terms = &interior[5..];
    let (model, terms) = match camera.lens.kind() {
        LensKind::Brown if terms[..5] == [0.0; 5] => ("PINHOLE", &terms[..0]),
        LensKind::Brown if terms[4] == 0.0 => ("OPENCV", &terms[..4]),
        LensKind::Brown | LensKind::Rational => ("FULL_OPENCV", &terms[..8]),
        LensKind::Fisheye => ("OPENCV_FISHEYE", &terms[..4]),
        kind => return Err(ExportError::NoLens { lens: kind.word(), format: FORMAT }),
    };
    let losses = common_losses(camera, FORMAT, true);
    let comments: String = losses.iter().map(|loss| format!("# {loss}\n")).collect();
    let values: String =
        [fx, fy, cx + HALF, cy + HALF].iter().chain(terms).map(|value| format!(" {value:?}")).collect();
    let text = format!(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n{comments}1 \
         {model} {} {}{values}\n",
        camera.width, camera.height
    );
    Ok(Exported { text, losses })
}
