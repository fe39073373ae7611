//! A camera in any program's format.

use super::{
    camera_colmap_txt, camera_kalibr_yaml, camera_metashape_xml, camera_opencv_yaml, camera_opensfm_json,
    camera_orthority_yaml, camera_pix4d_cam, camera_ros_yaml,
};
use crate::camera::Camera;

/// A camera in another program's format, and what that format cannot hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// The file's text.
    pub text: String,
    /// What was lost, in sentences; also in the text where the format has comments.
    pub losses: Vec<String>,
}

/// A format cannot hold a lens.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// There is no such lens.
    #[error("{format} has no {lens} lens")]
    NoLens {
        /// The lens.
        lens: &'static str,
        /// The format.
        format: &'static str,
    },
    /// There is the lens, but without one of its terms.
    #[error("{format} has no {term}, which is {value} here")]
    NoTerm {
        /// The term.
        term: &'static str,
        /// Its value.
        value: f64,
        /// The format.
        format: &'static str,
    },
}

/// The formats of other programs that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraFormat {
    /// OpenCV's FileStorage YAML.
    OpenCv,
    /// ROS camera_info YAML.
    Ros,
    /// OpenSfM's and OpenDroneMap's cameras.json.
    OpenSfm,
    /// Kalibr's camchain YAML.
    Kalibr,
    /// orthority's interior parameter YAML.
    Orthority,
    /// Metashape's calibration XML.
    Metashape,
    /// Pix4D's .cam.
    Pix4d,
    /// COLMAP's cameras.txt.
    Colmap,
}

impl CameraFormat {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::OpenCv,
        Self::Ros,
        Self::OpenSfm,
        Self::Kalibr,
        Self::Orthority,
        Self::Metashape,
        Self::Pix4d,
        Self::Colmap,
    ];

    /// The word for it on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::OpenCv => "opencv",
            Self::Ros => "ros",
            Self::OpenSfm => "odm",
            Self::Kalibr => "kalibr",
            Self::Orthority => "orthority",
            Self::Metashape => "metashape",
            Self::Pix4d => "pix4d",
            Self::Colmap => "colmap",
        }
    }

    /// The format of a word.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// What such a file is usually called.
    #[must_use]
    pub const fn file_name(self) -> &'static str {
        match self {
            Self::OpenCv => "camera-opencv.yaml",
            Self::Ros => "camera-ros.yaml",
            Self::OpenSfm => "cameras.json",
            Self::Kalibr => "camchain.yaml",
            Self::Orthority => "camera-orthority.yaml",
            Self::Metashape => "camera-metashape.xml",
            Self::Pix4d => "camera_pix4d_calibrated_internal_camera_parameters.cam",
            Self::Colmap => "cameras.txt",
        }
    }
}

/// The camera in another program's format.
///
/// - `name`: what the program shall call the camera, where its format has names.
///
/// # Errors
/// [`ExportError`]: the format cannot hold the lens.
pub fn export(camera: &Camera, format: CameraFormat, name: &str) -> Result<Exported, ExportError> {
    match format {
        CameraFormat::OpenCv => camera_opencv_yaml(camera),
        CameraFormat::Ros => camera_ros_yaml(camera, name),
        CameraFormat::OpenSfm => camera_opensfm_json(camera, name),
        CameraFormat::Kalibr => camera_kalibr_yaml(camera),
        CameraFormat::Orthority => camera_orthority_yaml(camera, name),
        CameraFormat::Metashape => camera_metashape_xml(camera),
        CameraFormat::Pix4d => camera_pix4d_cam(camera),
        CameraFormat::Colmap => camera_colmap_txt(camera),
    }
}

/// What no other format holds: the skew, where it has none, and the covariance.
pub(super) fn common_losses(camera: &Camera, format: &str, skew_is_lost: bool) -> Vec<String> {
    let mut losses = Vec::new();
    if skew_is_lost && camera.lens.interior()[2] != 0.0 {
        losses.push(skew_loss(camera, &format!("{format} has no skew; it is left out")));
    }
    if camera.covariance.is_some() {
        losses.push(format!("{format} has no place for the covariance: it is in camera.json"));
    }
    losses
}

/// Says that the skew is lost, and by how much it moves pixels at the frame's upper and lower border.
pub(super) fn skew_loss(camera: &Camera, what: &str) -> String {
    let [_, fy, skew, _, cy, ..] = camera.lens.interior();
    let farthest = cy.abs().max((f64::from(camera.height) - 1.0 - cy).abs());
    format!("{what}: {skew:.4} px, which moves columns by up to {:.2} px", (skew * farthest / fy).abs())
}
