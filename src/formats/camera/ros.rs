//! ROS camera_info files, as `camera_calibration_parsers` reads them.

use super::opencv::row;
use super::{Exported, skew_loss};
use crate::camera::{Camera, LensKind};

/// The camera as a ROS camera_info file of a camera that is not rectified: rectification the identity,
/// projection the camera matrix.
///
/// - `name`: what ROS shall call the camera.
#[must_use]
pub fn camera_ros_yaml(camera: &Camera, name: &str) -> Exported {
    let interior = camera.lens.interior();
    let [fx, fy, skew, cx, cy, ..] = interior;
    let terms = &interior[5..camera.lens.names().len()];
    let model = match camera.lens.kind() {
        LensKind::Brown => "plumb_bob",
        LensKind::Rational => "rational_polynomial",
        LensKind::Fisheye => "equidistant",
    };
    let mut losses = Vec::new();
    if skew != 0.0 {
        losses.push(skew_loss(camera, "ROS has no skew; it is left out"));
    }
    if camera.covariance.is_some() {
        losses.push("ROS has no place for the covariance: it is in camera.json".to_owned());
    }
    let comments: String = losses.iter().map(|loss| format!("# {loss}\n")).collect();
    // A name in quotes may hold anything but these two.
    let name = name.replace('\\', "\\\\").replace('"', "\\\"");
    let matrix = |rows: usize, cols: usize, data: &[f64]| {
        format!("  rows: {rows}\n  cols: {cols}\n  data: [{}]\n", row(data))
    };
    let text = format!(
        "{comments}image_width: {}\nimage_height: {}\ncamera_name: \"{name}\"\ncamera_matrix:\n{}distortion_model: \
         {model}\ndistortion_coefficients:\n{}rectification_matrix:\n{}projection_matrix:\n{}",
        camera.width,
        camera.height,
        matrix(3, 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        matrix(1, terms.len(), terms),
        matrix(3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        matrix(3, 4, &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    );
    Exported { text, losses }
}
