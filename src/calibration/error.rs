//! Why there is no calibration, and what to do about it.

use super::start::StartError;
use crate::camera::CameraError;

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// No start for the adjustment.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The image has no size.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Fewer observed coordinates than parameters.
    #[error("{coordinates} observed coordinates do not determine {parameters} parameters")]
    TooFewPoints {
        /// Two per point.
        coordinates: usize,
        /// Interior and six per view.
        parameters: usize,
    },
    /// The cost did not come to rest.
    #[error("the adjustment did not converge in {iterations} steps (root mean square {rms_px:.3} px)")]
    NotConverged {
        /// Steps taken.
        iterations: usize,
        /// Where it stood.
        rms_px: f64,
    },
    /// The views do not determine a parameter.
    #[error(
        "the views do not determine {parameter}; add views tilted to other sides, or estimate fewer \
         parameters"
    )]
    Undetermined {
        /// The parameter with the largest share in the undetermined combination.
        parameter: &'static str,
    },
    /// The target shows too little perspective.
    #[error(
        "the focal length is {focal_px:.0} px give or take {std_px:.0} px: the target shows too little \
         perspective"
    )]
    WeakFocalLength {
        /// Focal length, px.
        focal_px: f64,
        /// Its standard deviation, px.
        std_px: f64,
    },
    /// The photos are of more than one camera, or of one at several zooms.
    #[error(
        "the photos are not of one camera at one zoom: the focal length of {longer} is {percent:.0} % longer than \
         that of {shorter}"
    )]
    MixedCameras {
        /// Names of photos with the longer focal length.
        longer: String,
        /// Names of photos with the shorter one.
        shorter: String,
        /// How much longer, per cent.
        percent: f64,
    },
    /// No model was given to compare.
    #[error("no lens model was given to compare")]
    NothingToCompare,
    /// The target is always in the same small part of the frame.
    #[error("all corners of all photos lie in {:.0} % of the frame", 100.0 * .share)]
    SmallPart {
        /// Share of the frame's area that encloses all corners.
        share: f64,
    },
}

/// An adjustment that came so near and still did not settle has too many parameters, not wrong points.
const CLOSE_PX: f64 = 2.0;

impl CalibrationError {
    /// What to do about it; what to photograph next is said by [`super::advice()`].
    #[must_use]
    pub const fn help(&self) -> &'static str {
        match self {
            Self::Start(StartError::TooFewViews { .. } | StartError::Parallel { .. }) => {
                "photograph the target filling the frame, tilted by 20° to 45° to all four sides"
            }
            Self::Start(StartError::Repeated { .. }) => {
                "move and tilt the target, or the camera, between photos: copies of one photo tell nothing new"
            }
            Self::Start(StartError::TooFewPoints { .. } | StartError::NotFinite { .. }) => {
                "leave this photo out, or photograph all of the target"
            }
            Self::NotConverged { rms_px, .. } if *rms_px < CLOSE_PX => {
                "the lens terms play against each other: estimate fewer, or take a simpler lens"
            }
            Self::Start(StartError::NoCamera) | Self::NotConverged { .. } => {
                "check the target's description, and that all photos are of one camera at one zoom and one focus"
            }
            Self::Camera(_) | Self::NothingToCompare => "correct the settings",
            Self::TooFewPoints { .. } => "add photos, or show more of the target in them",
            Self::Undetermined { .. } => {
                "estimate fewer parameters, or add photos with the target tilted and near the frame's border"
            }
            Self::WeakFocalLength { .. } => {
                "photograph the target from nearer and tilted by 30° to 45°, so that its far edge looks shorter"
            }
            Self::SmallPart { .. } => {
                "photograph the target from nearer and in all parts of the frame: beyond its corners the lens is \
                 only guessed"
            }
            Self::MixedCameras { .. } => {
                "calibrate each camera, and each zoom, from its own photos; switch off zoom and autofocus"
            }
        }
    }
}
