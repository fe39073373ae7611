//! What a calibration is made of and what it returns.

use super::board::BoardShape;
use super::model::LensModel;
use super::outliers::{Outlier, SuspectView};
use super::target::{Board, BoardPoint, Observation};
use super::zhang::ClosedForm;
use crate::camera::{Camera, ImagePoint, Interior, InteriorCovariance, MAX_INTERIOR};
use crate::geometry::{Camera as CameraFrame, Pose};
use crate::units::Radians;
use nalgebra::{Matrix6, SMatrix};

/// The points of one photo that go into a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewPoints {
    /// Name of the photo, for messages and reports.
    pub name: String,
    /// Points of the board and the pixels they were seen in.
    pub observations: Vec<Observation>,
}

/// A point after the adjustment; residual = observed − predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointResidual {
    /// Where it is on the board.
    pub board: BoardPoint,
    /// Where it was seen.
    pub observed: ImagePoint,
    /// Where the calibrated camera sees it.
    pub predicted: ImagePoint,
    /// Weight that its square had in the adjustment: 1 unless it was taken for an outlier.
    pub weight: f64,
}

impl PointResidual {
    /// Distance between observed and predicted, px.
    #[must_use]
    pub fn distance_px(&self) -> f64 {
        f64::hypot(self.observed.column - self.predicted.column, self.observed.row - self.predicted.row)
    }
}

/// One photo after the adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Name of the photo.
    pub name: String,
    /// Where the board stood, seen from the camera.
    pub camera_from_board: Pose<CameraFrame, Board>,
    /// Covariance of the pose: rotation vector in camera axes (rad), then board origin in the camera (m).
    pub pose_covariance: Matrix6<f64>,
    /// Covariance between the interior parameters (rows, in the order of the lens's names) and the pose
    /// (columns).
    pub interior_pose_covariance: SMatrix<f64, MAX_INTERIOR, 6>,
    /// Root mean square distance between observed and predicted points, px.
    pub rms_px: f64,
    /// The points.
    pub points: Vec<PointResidual>,
}

/// Where in the frame points of the board have supported the lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    /// Largest off-axis angle with a point.
    pub max_angle: Radians,
    /// Its tangent, the ideal radius; infinite from 90° on.
    pub max_ideal_radius: f64,
    /// Ideal radius at which the lens folds back; infinite when it never does.
    pub fold_radius: f64,
    /// Share of the frame whose pixels lie within `max_angle`.
    pub supported_share: f64,
    /// Share of the frame whose pixels have no inverse: the lens has folded back there.
    pub folded_share: f64,
    /// Share of the frame's 8 × 6 cells that hold a point.
    pub covered_cells: f64,
}

/// A camera calibrated from views of a planar target, with everything needed to judge it.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The camera, with the covariance of its interior parameters.
    pub camera: Camera,
    /// Which parameters were estimated.
    pub model: LensModel,
    /// How the closed-form start was found.
    pub start: ClosedForm,
    /// The views, in the order given.
    pub views: Vec<View>,
    /// Standard deviation of one coordinate of one point, px: √(J / (observations − parameters)).
    pub sigma0_px: f64,
    /// The paper's cost J of eq. (5): sum of squared distances, px².
    pub j_total: f64,
    /// J per point, px² (the paper's 0.0943).
    pub j_per_point: f64,
    /// Root mean square distance over all points, px.
    pub rms_px: f64,
    /// Levenberg–Marquardt steps taken.
    pub iterations: usize,
    /// Standard deviations of the interior parameters in the order of the lens's names; 0 when fixed.
    pub std: Interior,
    /// Correlations of the interior parameters; 0 with fixed ones.
    pub correlation: InteriorCovariance,
    /// How much larger than declared the squares look, and its standard deviation, metres; `None` when not
    /// estimated with the camera. Ink spreads and bright paper blooms, so a tenth of a millimetre is common.
    pub side_excess_m: Option<(f64, f64)>,
    /// What the photos say about the board: its squares, its pitches, its flatness.
    pub board: BoardShape,
    /// Standard deviation of one coordinate by the median distance of the points, px: the noise of the bulk
    /// of them, however far off the others are.
    pub robust_sigma_px: f64,
    /// Points much farther off than the bulk, the farthest first; in the adjustment with the weight that is
    /// said there.
    pub outliers: Vec<Outlier>,
    /// Views that fit much worse than the others, the worst first.
    pub suspects: Vec<SuspectView>,
    /// Estimated parameters that differ from zero by less than two standard deviations.
    pub insignificant: Vec<&'static str>,
    /// Where the lens is supported by points.
    pub support: Support,
}

impl Calibration {
    /// Number of points in all views.
    #[must_use]
    pub fn points(&self) -> usize {
        self.views.iter().map(|view| view.points.len()).sum()
    }
}
