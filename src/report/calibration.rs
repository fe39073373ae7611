//! The calibrate stage's numbers: what `calibrate.json` holds and the page shows.
//!
//! Lengths in metres, distances in the image in pixels, as the keys say; σ is one standard deviation.

use super::numbers::FigureFile;
use serde::{Deserialize, Serialize};

/// Name of the format in `calibrate.json`.
pub const FORMAT: &str = "boresight-calibrate";
/// Its version.
pub const VERSION: u32 = 2;

/// Everything the calibrate stage says about a camera that it has calibrated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationNumbers {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`].
    pub version: u32,
    /// Width of the image.
    pub image_width_px: u32,
    /// Height of the image.
    pub image_height_px: u32,
    /// The target in the photos, when photos were given.
    pub target: Option<TargetNumbers>,
    /// The lens and what of it was estimated, in words.
    pub model: String,
    /// How the lens was chosen, when several were compared.
    pub choice: Option<ChoiceNumbers>,
    /// Interior parameters.
    pub parameters: Vec<ParameterNumbers>,
    /// Correlations of the interior parameters, in their order.
    pub correlation: Vec<Vec<f64>>,
    /// Points in all photos used.
    pub points: usize,
    /// The paper's J: sum of squared distances between observed and predicted points.
    pub j_px2: f64,
    /// J per point.
    pub j_per_point_px2: f64,
    /// Root mean square distance.
    pub rms_px: f64,
    /// Standard deviation of one coordinate of a point.
    pub sigma0_px: f64,
    /// The same from the median distance: of the bulk of the points.
    pub robust_sigma_px: f64,
    /// Steps of the adjustment.
    pub iterations: usize,
    /// The closed form that the adjustment started from.
    pub closed_form: String,
    /// The three estimates of the paper, over all photos; absent for given corners.
    pub steps: Option<StepNumbers>,
    /// What the photos say about the board.
    pub board: BoardNumbers,
    /// Where the lens is supported.
    pub support: SupportNumbers,
    /// How well the camera is known over the frame.
    pub uncertainty: UncertaintyNumbers,
    /// The photos used, in the order of the adjustment.
    pub views: Vec<ViewNumbers>,
    /// Points much farther off than the bulk.
    pub outliers: Vec<OutlierNumbers>,
    /// Photos that are not used.
    pub rejected_photos: Vec<RejectedNumbers>,
    /// What would make the camera better known.
    pub advice: Vec<String>,
    /// The photo that fits worst: whose overlay the page shows.
    pub overlay_of: Option<String>,
    /// Pictures beside `calibrate.json`.
    pub figures: Vec<FigureFile>,
    /// What the user should know before trusting the camera.
    pub notes: Vec<String>,
}

/// The target as looked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TargetNumbers {
    /// What rows and columns count: "squares", "inner corners", …
    pub unit: String,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Whether they were counted in the photos.
    pub counted: bool,
}

/// How the lens was chosen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChoiceNumbers {
    /// Why, in a sentence or two.
    pub explanation: String,
    /// The lenses compared.
    pub candidates: Vec<CandidateNumbers>,
}

/// One of the lenses compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CandidateNumbers {
    /// The lens and what of it was estimated.
    pub model: String,
    /// Estimated interior parameters.
    pub parameters: usize,
    /// Root mean square distance of the points it was fitted to.
    pub rms_px: Option<f64>,
    /// Root mean square distance of points in photos that took no part in the fit.
    pub held_out_rms_px: Option<f64>,
    /// Whether it was chosen.
    pub chosen: bool,
    /// Why it could not be fitted.
    pub failed: Option<String>,
}

/// An interior parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterNumbers {
    /// Its name, with the unit.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// 1σ; absent when it was not estimated.
    pub std: Option<f64>,
    /// Whether it was estimated.
    pub estimated: bool,
    /// Differs from zero by less than two standard deviations.
    pub insignificant: bool,
    /// Its value in the camera compared with.
    pub reference: Option<f64>,
}

/// Root mean square distances of the paper's three estimates from the calibrated camera's prediction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StepNumbers {
    /// From bounding boxes.
    pub blunt_rms_px: f64,
    /// From the strongest Harris response.
    pub refined_rms_px: f64,
    /// From the edges.
    pub sharp_rms_px: f64,
}

/// A value with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeasuredNumbers {
    /// The value.
    pub value: f64,
    /// 1σ.
    pub std: f64,
    /// Differs from zero by more than it would by chance.
    pub significant: bool,
}

/// What the photos say about the board. Absent where they cannot tell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BoardNumbers {
    /// How much larger than declared the squares look.
    pub side_excess_m: Option<MeasuredNumbers>,
    /// By how much the pitch to the right is longer than the pitch downwards, as a share of it.
    pub pitch_excess: Option<MeasuredNumbers>,
    /// How deep the board bends, from its middle to its edge.
    pub bend_m: Option<f64>,
    /// Probability that a flat board gives a bend like that by chance.
    pub flat_probability: Option<f64>,
    /// Whether the bend was estimated along with the camera.
    pub bend_estimated: bool,
}

/// Where the lens is supported by points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SupportNumbers {
    /// Largest tangent of an off-axis angle with a point; absent from 90° on.
    pub max_ideal_radius: Option<f64>,
    /// Tangent of the off-axis angle at which the lens folds back; absent when it never does.
    pub fold_radius: Option<f64>,
    /// Share of the frame within the largest angle.
    pub supported_share_of_frame: f64,
    /// Share of the frame whose pixels have no inverse.
    pub folded_share_of_frame: f64,
    /// Share of the frame's 8 × 6 cells with a point.
    pub share_of_48_cells_with_corners: f64,
    /// What is proved of the inverse over the frame, in words.
    pub invertible: String,
}

/// Standard deviation, in the worse direction, of where the camera projects, after the best common rotation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UncertaintyNumbers {
    /// Cells across.
    pub columns: usize,
    /// Cells down.
    pub rows: usize,
    /// Row by row at the centres of equal cells; absent where the lens has no inverse.
    pub std_px: Vec<Option<f64>>,
    /// In the middle of the image.
    pub centre_px: Option<f64>,
    /// Median over the frame.
    pub median_px: f64,
    /// Largest.
    pub worst_px: f64,
    /// Height above ground for the figures in metres, camera looking straight down.
    pub height_m: f64,
    /// Median on the ground.
    pub median_m: f64,
    /// Largest on the ground.
    pub worst_m: f64,
}

/// A photo of the adjustment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewNumbers {
    /// File name.
    pub file: String,
    /// Points.
    pub points: usize,
    /// Root mean square distance.
    pub rms_px: f64,
    /// The paper's three estimates; absent for given corners.
    pub steps: Option<StepNumbers>,
    /// Measures of the photo; absent for given corners.
    pub quality: Option<QualityNumbers>,
    /// Squares, inner corners, tags or circles (row, column) that were not seen.
    pub hidden: Vec<[usize; 2]>,
    /// What stood at the marker's place: "none", "hollow", "absent".
    pub marker: Option<String>,
    /// Why it is suspected of being bad.
    pub suspect: Option<String>,
    /// Rotation from the board to the camera, row by row.
    pub camera_from_board_rotation: Vec<Vec<f64>>,
    /// The board's origin in the camera.
    pub board_origin_in_camera_m: [f64; 3],
    /// Picture of the photo with the points as the calibrated camera sees them.
    pub overlay: Option<String>,
}

/// Measures of a photo.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct QualityNumbers {
    /// Standard deviation of the blur across edges.
    pub blur_px: f64,
    /// Difference between light and dark as a share of what the file can store.
    pub contrast: f64,
    /// Share of the light parts that is clipped.
    pub clipped_share: f64,
    /// Share of the frame that the target's box fills.
    pub extent_share: f64,
}

/// A point far off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutlierNumbers {
    /// File name of the photo.
    pub file: String,
    /// Observed column.
    pub column: f64,
    /// Observed row.
    pub row: f64,
    /// Distance from the prediction.
    pub distance_px: f64,
    /// Weight that its squares had.
    pub weight: f64,
}

/// A photo that is not used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RejectedNumbers {
    /// File name.
    pub file: String,
    /// Why.
    pub reason: String,
    /// Picture of the photo with the points found, when the target was found.
    pub overlay: Option<String>,
}
