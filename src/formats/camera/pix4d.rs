//! Pix4D's `…_pix4d_calibrated_internal_camera_parameters.cam`: one block of lines per camera.
//!
//! Lengths are millimetres on a sensor whose size the block states, the principal point is counted from the image's
//! top-left corner: half a pixel is taken off. K1, K2, K3, T1, T2 are k1, k2, k3, p1, p2. The same camera's matrix in
//! Pix4D's `calibrated_camera_parameters.txt` is what these millimetres give with width / sensor width. The files do
//! not say how many pixels the image has; ours do, in a comment after the numbers.
//!
//! The `…_calibrated_internal_camera_parameters.cam` beside it holds polynomials of another kind, the way from the
//! photo back to the ideal plane in millimetres: it is refused.
//!
//! # Source
//! Pix4D's articles "How are the Internal and External Camera Parameters defined?" and "What does the Output Params
//! Folder contain?"; origin and signs from a project's own camera matrices.

use super::{CameraChoice, ExportError, Exported, camera, common_losses, interior};
use crate::camera::{Camera, LensKind};
use crate::formats::InputError;
use std::path::Path;

/// First words of a camera's block; its number follows.
pub(super) const FIRST_WORDS: &str = "Pix4D camera calibration file";
/// First words of the file that is refused.
pub(super) const OTHER_FILE: &str = "camera_calibration_file";
const SENSOR: &str = "#Focal Length mm assuming a sensor width of ";
const IMAGE: &str = "#Image size ";
/// From the corner of the top-left pixel to its centre.
const HALF: f64 = 0.5;
const KEYS: [&str; 8] = ["F", "Px", "Py", "K1", "K2", "T1", "T2", "K3"];

/// A camera's lines.
#[derive(Default)]
struct Block<'a> {
    line: u64,
    sensor: Option<&'a str>,
    image: Option<&'a str>,
    values: [Option<f64>; KEYS.len()],
}

/// The refusal of the file with the polynomials of the other kind.
pub(super) fn refuse_other_file(file: &Path) -> InputError {
    InputError::new(file, "holds polynomials from the photo back to the ideal plane, not the lens itself")
        .help("give the file beside it whose name ends in _pix4d_calibrated_internal_camera_parameters.cam")
}

/// The camera in a `.cam` file.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    let (_, block) = choice.of(file, blocks(file, text)?)?;
    let refused = |cause: String| InputError::new(file, cause).line(block.line);
    let pair = |text: &str| -> Option<(f64, f64)> {
        let (across, down) = text.split_once('x')?;
        Some((across.trim().parse().ok()?, down.trim().parse().ok()?))
    };
    let stated = block.image.map(|words| {
        let (across, down) = words.trim().trim_end_matches("pixel").split_once('x').unwrap_or_default();
        match (across.trim().parse(), down.trim().parse()) {
            (Ok(width), Ok(height)) => Ok((width, height)),
            _ => Err(refused(format!("the image size is \"{}\"", words.trim()))),
        }
    });
    let (width, height) = choice.size(file, stated.transpose()?)?;
    let sensor = block.sensor.ok_or_else(|| refused("the sensor's size in mm is missing".to_owned()))?;
    let (across, down) = pair(sensor.trim().trim_end_matches("mm"))
        .filter(|(across, down)| *across > 0.0 && *down > 0.0)
        .ok_or_else(|| refused(format!("the sensor's size is \"{}\"", sensor.trim())))?;
    let mut values = [0.0; KEYS.len()];
    for ((value, given), key) in values.iter_mut().zip(block.values).zip(KEYS) {
        *value = given.ok_or_else(|| refused(format!("{key} is missing")))?;
    }
    let [f, px, py, terms @ ..] = values;
    let (per_mm_x, per_mm_y) = (f64::from(width) / across, f64::from(height) / down);
    let affine = [f * per_mm_x, f * per_mm_y, 0.0, px * per_mm_x - HALF, py * per_mm_y - HALF];
    camera(file, LensKind::Brown, interior(affine, &terms), width, height, None)
}

fn blocks<'a>(file: &Path, text: &'a str) -> Result<Vec<(String, Block<'a>)>, InputError> {
    let mut blocks: Vec<(String, Block)> = Vec::new();
    for (line, words) in (1..).zip(text.lines()) {
        let words = words.trim();
        if let Some(name) = words.strip_prefix(FIRST_WORDS) {
            blocks.push((name.trim().to_owned(), Block { line, ..Block::default() }));
            continue;
        }
        let Some((_, block)) = blocks.last_mut() else { continue };
        if let Some(size) = words.strip_prefix(SENSOR) {
            block.sensor = Some(size);
        } else if let Some(size) = words.strip_prefix(IMAGE) {
            block.image = Some(size);
        } else if let Some((key, value)) = words.split_once(char::is_whitespace)
            && let Some(place) = KEYS.iter().position(|known| *known == key)
        {
            let value = value.trim();
            let number = value.parse().map_err(|_| {
                InputError::new(file, format!("{key} is \"{value}\", not a number")).line(line)
            })?;
            block.values[place] = Some(number);
        }
    }
    Ok(blocks)
}

/// The camera as a `.cam` file with this one camera, number 0, on a sensor whose pixels are 1 µm wide.
///
/// # Errors
/// [`ExportError`]: such files hold Brown's lens only.
pub fn camera_pix4d_cam(camera: &Camera) -> Result<Exported, ExportError> {
    const FORMAT: &str = "Pix4D's .cam";
    const MM_PER_PIXEL: f64 = 1e-3;
    if camera.lens.kind() != LensKind::Brown {
        return Err(ExportError::NoLens { lens: camera.lens.kind().word(), format: FORMAT });
    }
    let [fx, fy, _, cx, cy, k1, k2, p1, p2, k3, ..] = camera.lens.interior();
    let mut losses = common_losses(camera, FORMAT, true);
    losses.push("the sensor's size in mm is not known: pixels are taken to be 0.001 mm wide".to_owned());
    if fx != fy {
        losses.push(format!(
            "{FORMAT} has one focal length: fx / fy = {:?} stands in the sensor's height, where a program that takes \
             pixels for square does not see it",
            fx / fy
        ));
    }
    // One focal length in mm is fx and fy px where pixels are as much higher than wide as fx is longer.
    let (across, down) = (MM_PER_PIXEL, MM_PER_PIXEL * fx / fy);
    let text = format!(
        "{FIRST_WORDS} 0\n{SENSOR}{:?}x{:?}mm\nF {:?}\n#Principal Point mm\nPx {:?}\nPy {:?}\n#Symmetrical Lens \
         Distortion Coeffs\nK1 {k1:?}\nK2 {k2:?}\nK3 {k3:?}\n#Tangential Lens Distortion Coeffs\nT1 {p1:?}\nT2 \
         {p2:?}\n{IMAGE}{}x{} pixel\n",
        f64::from(camera.width) * across,
        f64::from(camera.height) * down,
        fx * across,
        (cx + HALF) * across,
        (cy + HALF) * down,
        camera.width,
        camera.height,
    );
    Ok(Exported { text, losses })
}
