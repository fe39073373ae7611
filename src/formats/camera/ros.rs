//! ROS camera_info files, as `camera_calibration_parsers` reads them.

use super::opencv::row;
use super::{ExportError, Exported, common_losses, quoted};
use crate::camera::{Camera, LensKind};

/// The camera as a ROS camera_info file of a camera that is not rectified: rectification the identity,
/// projection the camera matrix.
///
/// - `name`: what ROS shall call the camera.
///
/// # Errors
/// [`ExportError`]: ROS has no such lens.
pub fn camera_ros_yaml(camera: &Camera, name: &str) -> Result<Exported, ExportError> {
    const FORMAT: &str = "ROS";
    let interior = camera.lens.interior();
    let [fx, fy, _, cx, cy, ..] = interior;
    let terms = &interior[5..camera.lens.names().len()];
    let model = match camera.lens.kind() {
        LensKind::Brown => "plumb_bob",
        LensKind::Rational => "rational_polynomial",
        LensKind::Fisheye => "equidistant",
        kind @ (LensKind::ThinPrism | LensKind::Pix4dFisheye) => {
            return Err(ExportError::NoLens { lens: kind.word(), format: FORMAT });
        }
    };
    let losses = common_losses(camera, FORMAT, true);
    let comments: String = losses.iter().map(|loss| format!("# {loss}\n")).collect();
    let matrix = |rows: usize, cols: usize, data: &[f64]| {
        format!("  rows: {rows}\n  cols: {cols}\n  data: [{}]\n", row(data))
    };
    let text = format!(
        "{comments}image_width: {}\nimage_height: {}\ncamera_name: {}\ncamera_matrix:\n{}distortion_model: \
         {model}\ndistortion_coefficients:\n{}rectification_matrix:\n{}projection_matrix:\n{}",
        camera.width,
        camera.height,
        quoted(name),
        matrix(3, 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        matrix(1, terms.len(), terms),
        matrix(3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        matrix(3, 4, &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    );
    Ok(Exported { text, losses })
}
