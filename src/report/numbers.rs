//! The accuracy stage's numbers: what `accuracy.json` holds and the page shows.
//!
//! Lengths in metres, angles in degrees, as the keys say; σ is one standard deviation.

use serde::{Deserialize, Serialize};

/// Name of the format in `accuracy.json`.
pub const FORMAT: &str = "boresight-accuracy";
/// Its version.
pub const VERSION: u32 = 1;

/// Everything the accuracy stage says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AccuracyNumbers {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`].
    pub version: u32,
    /// The error model as stated.
    pub sigmas: Vec<Sigma>,
    /// What the numbers take for granted, in words.
    pub assumptions: Vec<String>,
    /// CE90 over the map.
    pub map: Option<MapNumbers>,
    /// Frames at their centre and at their worst corner, by name.
    pub frames: Vec<FrameNumbers>,
    /// Frames without numbers, with the reason.
    pub frames_without: Vec<Without>,
    /// Eq. (11) over the reference frame.
    pub budget: BudgetNumbers,
    /// Share of each source in the variance at the reference frame's centre and worst corner.
    pub shares: Vec<Share>,
    /// The error map by drawing.
    pub monte_carlo: Option<MonteCarloNumbers>,
    /// Recovered lengths.
    pub lengths: Vec<LengthNumbers>,
    /// Check points.
    pub check_points: Option<CheckNumbers>,
    /// The requirement and whether it is met.
    pub requirement: Option<RequirementNumbers>,
    /// Pictures over the image, files beside `accuracy.json`.
    pub figures: Vec<FigureFile>,
}

/// A picture beside `accuracy.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FigureFile {
    /// SVG file; a PNG of the same name stands beside it.
    pub file: String,
    /// For readers who cannot see it.
    pub title: String,
    /// What it shows.
    pub caption: String,
}

/// 1σ of one measurement, as stated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sigma {
    /// Which, in words.
    pub what: String,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
}

/// A 1σ ellipse.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EllipseNumbers {
    /// Larger principal σ.
    pub semi_major_m: f64,
    /// Smaller principal σ.
    pub semi_minor_m: f64,
    /// Direction of the larger one, clockwise from true north.
    pub azimuth_deg: f64,
}

/// The accuracy of one pixel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaceNumbers {
    /// "image centre", "upper left", …
    pub place: String,
    /// Stored pixel.
    pub column: f64,
    /// Stored pixel.
    pub row: f64,
    /// Ground point.
    pub latitude_deg: f64,
    /// Ground point.
    pub longitude_deg: f64,
    /// Radius that holds half of the errors.
    pub cep50_m: f64,
    /// Radius that holds ninety percent.
    pub ce90_m: f64,
    /// 1σ.
    pub ellipse: EllipseNumbers,
}

/// A frame's accuracy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameNumbers {
    /// The image's file name.
    pub frame: String,
    /// At its centre.
    pub centre: PlaceNumbers,
    /// At the worst of its corners; absent when no corner has numbers.
    pub worst_corner: Option<PlaceNumbers>,
    /// How far out the corners were taken: 1 is the corner pixel.
    pub corner_fraction: f64,
}

/// Something without numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Without {
    /// What.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// CE90 over the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapNumbers {
    /// Half of the area is better.
    pub ce90_median_m: f64,
    /// 95 % of the area is better.
    pub ce90_p95_m: f64,
    /// Nothing is worse.
    pub ce90_worst_m: f64,
    /// CE90 that the first and the last colour of `ce90.png` stand for.
    pub colour_range_m: [f64; 2],
    /// Area seen.
    pub area_m2: f64,
    /// Side of a cell, in the CRS's unit.
    pub cell: f64,
    /// CRS as stated or chosen.
    pub crs: String,
}

/// Eq. (11) at one pixel, radii that hold half of the errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BudgetPointNumbers {
    /// Where in the image.
    pub place: String,
    /// Stored pixel.
    pub column: f64,
    /// Stored pixel.
    pub row: f64,
    /// ε from attitude.
    pub epsilon_attitude_m: f64,
    /// ε from attitude and heights.
    pub epsilon_m: f64,
    /// CEP + ε, as the paper prints it.
    pub linear_m: f64,
    /// Root of the sum of squares.
    pub quadrature_m: f64,
    /// Exact for unequal axes.
    pub cep50_m: f64,
    /// Under the whole model.
    pub full_cep50_m: f64,
    /// Under the whole model.
    pub full_ce90_m: f64,
}

/// Eq. (11) over a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BudgetNumbers {
    /// The reference frame.
    pub frame: String,
    /// Circular error of the antenna's position, CEP50.
    pub position_cep50_m: f64,
    /// How far out the corners were taken: 1 is the corner pixel.
    pub corner_fraction: f64,
    /// Centre and corners.
    pub points: Vec<BudgetPointNumbers>,
    /// Corners without a budget.
    pub missing: Vec<Without>,
}

/// Share of a source in the variance, percent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Name of the source.
    pub source: String,
    /// At the reference frame's centre.
    pub centre_percent: f64,
    /// At its worst corner.
    pub corner_percent: Option<f64>,
}

/// The error map by drawing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MonteCarloNumbers {
    /// The frame.
    pub frame: String,
    /// What was drawn, in words.
    pub drawn: String,
    /// How many times.
    pub draws: u32,
    /// Seed of the generator.
    pub seed: u64,
    /// Grid points across and down.
    pub grid: [usize; 2],
    /// CE90 at the grid point nearest the middle.
    pub centre_ce90_m: Option<f64>,
    /// Largest CE90 on the grid.
    pub worst_ce90_m: Option<f64>,
    /// Largest relative difference between drawn and first-order CE90 on the grid, percent.
    pub first_order_difference_percent: Option<f64>,
    /// Grid points some of whose draws missed the ground.
    pub points_with_misses: usize,
}

/// A recovered length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LengthNumbers {
    /// What was measured.
    pub name: String,
    /// Frames of its ends.
    pub frames: [String; 2],
    /// Horizontal length.
    pub length_m: f64,
    /// 1σ.
    pub std_m: f64,
    /// Interval at `confidence`.
    pub interval_m: [f64; 2],
    /// Probability of the interval.
    pub confidence: f64,
    /// The known length.
    pub truth_m: Option<f64>,
    /// (recovered − known) / σ; absent without truth or spread.
    pub z_score: Option<f64>,
}

/// Figures of a set of residuals (observed − predicted).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckFigures {
    /// Observations.
    pub count: usize,
    /// Mean north.
    pub mean_north_m: f64,
    /// Mean east.
    pub mean_east_m: f64,
    /// Root mean square north.
    pub rmse_north_m: f64,
    /// Root mean square east.
    pub rmse_east_m: f64,
    /// Root mean square of the radial residual.
    pub rmse_radial_m: f64,
    /// Median radial residual.
    pub cep50_sample_m: f64,
    /// 90th percentile of the radial residuals.
    pub ce90_sample_m: f64,
    /// Largest radial residual.
    pub worst_m: f64,
    /// Which.
    pub worst_point: String,
    /// Seen in.
    pub worst_frame: String,
    /// Mean of rᵀ Σ⁻¹ r: 2 when the claimed covariance is honest.
    pub mean_normalised_squared: Option<f64>,
    /// Fewer than 30 observations: no firm statement.
    pub few: bool,
}

/// Figures of one frame's check points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckFrame {
    /// The frame.
    pub frame: String,
    /// Its figures.
    pub figures: CheckFigures,
}

/// Check points under one kind of ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckVariant {
    /// "each point's own height" or "the frame's ground".
    pub ground: String,
    /// All observations together.
    pub all: CheckFigures,
    /// Median CE90 that the error model claims for these pixels.
    pub claimed_ce90_median_m: Option<f64>,
    /// Share of the residuals inside the CE90 claimed for their pixel, percent.
    pub inside_claimed_ce90_percent: Option<f64>,
    /// By frame.
    pub frames: Vec<CheckFrame>,
}

/// Check points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheckNumbers {
    /// Number of different points.
    pub points: usize,
    /// Which variant the pipeline file asks to judge by: index into `variants`.
    pub judged_by: usize,
    /// Own height and frame's ground.
    pub variants: Vec<CheckVariant>,
    /// Observations that could not be used.
    pub without: Vec<Without>,
}

/// The requirement and whether it is met.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RequirementNumbers {
    /// CE90 required.
    pub ce90_m: f64,
    /// CE90 claimed for the worst place of the map.
    pub worst_ce90_m: f64,
    /// Share of the area that meets it, percent.
    pub area_percent: f64,
    /// True when all of it does.
    pub met: bool,
}
