//! Camera files: our JSON with covariance, and the formats of others; recognised by their content, written both ways.
//!
//! What each format counts pixels and lengths in, and how that becomes our pixels, (0, 0) the centre of the top-left
//! one, of an image of `w` × `h` pixels:
//!
//! | format | lengths | principal point | in our pixels | read | written |
//! |---|---|---|---|---|---|
//! | boresight JSON | px | centre of the top-left pixel | as it is | all lenses | all lenses |
//! | OpenCV YAML | px | centre of the top-left pixel | as it is | 4, 5, 8, 12 terms, fisheye | as read |
//! | ROS camera_info | px | as OpenCV | as it is | plumb_bob, rational_polynomial, equidistant | as read |
//! | Kalibr camchain | px | as OpenCV | as it is | pinhole with none, radtan, equidistant | as read |
//! | OpenSfM, ODM JSON | max(w, h) | offset from the middle | (w − 1) / 2 + c_x · max(w, h) | perspective, simple_radial, radial, brown, fisheye, fisheye_opencv | brown, fisheye_opencv |
//! | orthority YAML | sensor_size, or max(w, h) | offset from the middle, max(w, h) | (w − 1) / 2 + cx · max(w, h) | pinhole, brown, fisheye, opencv | brown, fisheye, opencv |
//! | Metashape XML | px | offset from w / 2, corner (0, 0) | (w − 1) / 2 + cx | frame, fisheye | as read |
//! | Pix4D .cam | mm | image corner | Px · w / sensor width − ½ | perspective | perspective |
//! | COLMAP cameras.txt | px | image corner | cx − ½ | nine models | PINHOLE, OPENCV, FULL_OPENCV, OPENCV_FISHEYE |
//! | DJI DewarpData | px | offset from w / 2, used as OpenCV's | w / 2 + cx | 9 or 12 numbers | not |
//!
//! What a format cannot hold is said in [`Exported::losses`]; a lens that it has no place for is refused.

mod choice;
mod colmap;
mod dji;
mod export;
mod kalibr;
mod metashape;
mod opencv;
mod opensfm;
mod orthority;
mod own;
mod pix4d;
mod ros;

pub use choice::CameraChoice;
pub use colmap::camera_colmap_txt;
pub use dji::camera_from_dewarp_data;
pub use export::{CameraFormat, ExportError, Exported, export};
pub use kalibr::camera_kalibr_yaml;
pub use metashape::camera_metashape_xml;
pub use opencv::camera_opencv_yaml;
pub use opensfm::camera_opensfm_json;
pub use orthority::camera_orthority_yaml;
pub use own::camera_json;
pub use pix4d::camera_pix4d_cam;
pub use ros::camera_ros_yaml;

use super::InputError;
use crate::camera::{Camera, Interior, InteriorCovariance, Lens, LensKind, MAX_INTERIOR};
use export::common_losses;
use std::path::Path;

/// Reads the camera of a file that holds one, of any of the formats, recognised by its content.
///
/// # Errors
/// [`InputError`]: unreadable, of no known format, a key missing or unknown, a number that is no camera's, a lens
/// this program has no model for, or several cameras.
pub fn read_camera(file: &Path) -> Result<Camera, InputError> {
    read_chosen_camera(file, &CameraChoice::default())
}

/// Reads a camera of a file of any of the formats, recognised by its content.
///
/// # Errors
/// As [`read_camera`]; and the choice does not fit the file.
pub fn read_chosen_camera(file: &Path, choice: &CameraChoice) -> Result<Camera, InputError> {
    let text = std::fs::read_to_string(file).map_err(|error| match error.kind() {
        std::io::ErrorKind::InvalidData => {
            InputError::new(file, "is not UTF-8 text, so it is no camera file").help(KNOWN)
        }
        _ => InputError::new(file, format!("cannot be read ({error})")),
    })?;
    camera_from_text(file, &text, choice)
}

const KNOWN: &str = "give a camera.json that `boresight run` wrote, an OpenCV or ROS YAML file with camera_matrix and \
                     distortion_coefficients, a Kalibr camchain, an ODM cameras.json, an orthority YAML file with \
                     im_size, a Metashape calibration XML, a Pix4D .cam, a COLMAP cameras.txt or DJI DewarpData";

/// The camera in the text of a file of any of the formats; `file` is for messages.
///
/// # Errors
/// As [`read_chosen_camera`].
pub fn camera_from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let start = text.trim_start();
    let has_key = |key: &str| text.lines().any(|line| line.trim_start().starts_with(key));
    if start.starts_with(['{', '[']) {
        let read =
            if opensfm::is_it(text) && !own::is_it(text) { opensfm::from_text } else { own::from_text };
        read(file, text, choice)
    } else if start.starts_with('<') {
        metashape::from_text(file, text, choice)
    } else if start.starts_with(pix4d::FIRST_WORDS) {
        pix4d::from_text(file, text, choice)
    } else if start.starts_with(pix4d::OTHER_FILE) {
        Err(pix4d::refuse_other_file(file))
    } else if start.starts_with("%YAML") || text.contains("camera_matrix") {
        opencv::from_text(file, text, choice)
    } else if has_key("im_size:") {
        orthority::from_text(file, text, choice)
    } else if has_key("camera_model:") || has_key("intrinsics:") {
        kalibr::from_text(file, text, choice)
    } else if colmap::is_it(text) {
        colmap::from_text(file, text, choice)
    } else if dji::is_it(text) {
        camera_from_dewarp_data(file, text, choice)
    } else {
        Err(InputError::new(file, "is no camera file of a known format").help(KNOWN))
    }
}

/// What YAML says, with the place where it says something else.
fn yaml<T: serde::de::DeserializeOwned>(file: &Path, text: &str, what: &str) -> Result<T, InputError> {
    // OpenCV's first line is not legal YAML; lines are kept so that places stay right.
    let legal: String = text
        .lines()
        .map(|line| if line.starts_with("%YAML") { "" } else { line })
        .flat_map(|line| [line, "\n"])
        .collect();
    serde_saphyr::from_str(&legal).map_err(|error| {
        let refused = InputError::new(file, format!("is no {what} file: {}", error.without_snippet()));
        match error.location() {
            Some(location) => refused.line(location.line()),
            None => refused,
        }
    })
}

/// A name as a double-quoted text of JSON and YAML.
fn quoted(name: &str) -> String {
    serde_json::Value::from(name).to_string()
}

/// fx, fy, skew, cx, cy and the lens terms, as many as there are; zeros after them.
fn interior(affine: [f64; 5], terms: &[f64]) -> Interior {
    let mut interior = [0.0; MAX_INTERIOR];
    for (value, given) in interior.iter_mut().zip(affine.iter().chain(terms)) {
        *value = *given;
    }
    interior
}

fn camera(
    file: &Path,
    kind: LensKind,
    interior: Interior,
    width: u32,
    height: u32,
    covariance: Option<InteriorCovariance>,
) -> Result<Camera, InputError> {
    Lens::new(kind, &interior)
        .and_then(|lens| Camera::new(lens, width, height, covariance))
        .map_err(|error| InputError::new(file, error.to_string()))
}

#[cfg(test)]
mod golden;
#[cfg(test)]
mod round_trips;
#[cfg(test)]
mod tests;
