//! From observed points to a calibration: start, adjustment, outliers, covariance, and what to say about it.
//!
//! # Source
//! Hemerly (2014), eqs. (1)–(5).

use super::adjust::{
    AdjustError, Adjusted, NormalEquations, Problem, Sight, State, adjust, cost, inverse_scaled,
};
use super::board::{BOARD_TERMS, BoardEquations, BoardExtent, BoardShape, SIDE};
use super::error::CalibrationError;
use super::mixed::{Mixture, mixture};
use super::model::{FX, FY, LensModel, SKEW, TERMS};
use super::outliers::{outliers, reweigh, robust_sigma, suspects};
use super::product::{Calibration, PointResidual, View, ViewPoints};
use super::start::{Start, StartError, starts};
use super::support::support;
use super::zhang::{BoardPose, ClosedForm};
use crate::camera::{
    Brown, Camera, Fisheye, Interior, InteriorCovariance, Lens, LensFunction, LensKind, MAX_INTERIOR,
    Pix4dFisheye, Rational, ThinPrism,
};
use crate::geometry::{Point, Pose, Rotation};
use nalgebra::{Matrix6, SMatrix, SVector, Vector2};

/// What to do with points that do not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OutlierPolicy {
    /// All points weigh the same; outliers are named.
    #[default]
    Keep,
    /// Points beyond what the noise of the others explains lose weight, and are named.
    WeighDown,
}

/// How a calibration is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// What is estimated.
    pub model: LensModel,
    /// What to do with points that do not fit.
    pub outliers: OutlierPolicy,
}

/// Calibrates a camera from three or more views of a planar target.
///
/// - `views`: observed points, pixels about the centre of the top-left pixel, board coordinates in metres.
/// - `width`, `height`: image size, pixels.
///
/// Starts from a closed form and needs no hint. All coordinates weigh the same.
///
/// # Errors
/// [`CalibrationError`].
///
/// # Source
/// Hemerly (2014), eqs. (1)–(5).
pub fn calibrate(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    model: LensModel,
) -> Result<Calibration, CalibrationError> {
    calibrate_with(views, width, height, Options { model, outliers: OutlierPolicy::Keep })
}

/// As [`calibrate`], with a choice of what to do about outliers.
///
/// # Errors
/// [`CalibrationError`].
pub fn calibrate_with(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    options: Options,
) -> Result<Calibration, CalibrationError> {
    let starts = starts(views, width, height, &options.model)?;
    check_extent(views, width, height)?;
    let solved = solve(views, width, height, options, starts)?;
    finish(views, width, height, options.model, solved)
}

/// The board's points all lie in one small part of the frame: what is outside would be extrapolated.
fn check_extent(views: &[ViewPoints], width: u32, height: u32) -> Result<(), CalibrationError> {
    /// A fifth of each side.
    const LEAST_SHARE: f64 = 0.04;
    let pixels = || views.iter().flat_map(|view| &view.observations).map(|o| o.pixel);
    let span = |values: &mut dyn Iterator<Item = f64>| {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        high - low
    };
    let across = span(&mut pixels().map(|p| p.column)) / f64::from(width.max(1));
    let down = span(&mut pixels().map(|p| p.row)) / f64::from(height.max(1));
    let share = across * down;
    if share < LEAST_SHARE { Err(CalibrationError::SmallPart { share }) } else { Ok(()) }
}

/// Distances of a view's points, px, when the view is placed by other points of it and the lens stays as it was
/// adjusted to other views.
///
/// - `pose`: start of the placing.
pub(super) fn placed_distances(
    solved: &Solved,
    model: &LensModel,
    pose: BoardPose,
    fitted: &[Sight],
    judged: &[Sight],
) -> Result<Vec<f64>, CalibrationError> {
    match model.kind {
        LensKind::Brown => placed::<Brown, 10>(solved, model, pose, fitted, judged),
        LensKind::Rational => placed::<Rational, 13>(solved, model, pose, fitted, judged),
        LensKind::ThinPrism => placed::<ThinPrism, 17>(solved, model, pose, fitted, judged),
        LensKind::Fisheye => placed::<Fisheye, 9>(solved, model, pose, fitted, judged),
        LensKind::Pix4dFisheye => placed::<Pix4dFisheye, 9>(solved, model, pose, fitted, judged),
    }
}

fn placed<L: LensFunction<N>, const N: usize>(
    solved: &Solved,
    model: &LensModel,
    pose: BoardPose,
    fitted: &[Sight],
    judged: &[Sight],
) -> Result<Vec<f64>, CalibrationError> {
    let model = LensModel { free: [false; MAX_INTERIOR], ..*model };
    let problem = |sights: &[Sight]| Problem {
        views: vec![sights.to_vec()],
        extent: solved.extent,
        model,
        board_free: [false; BOARD_TERMS],
    };
    let interior: [f64; N] = std::array::from_fn(|k| solved.interior[k]);
    let state = State { interior, board: solved.board, poses: vec![pose] };
    let adjusted = adjust::<L, N, N>(&problem(fitted), state).map_err(|error| said(error, L::KIND))?;
    Ok(distances::<L, N>(&problem(judged), &adjusted.state).into_iter().flatten().collect())
}

/// Everything an adjustment leaves, for any lens.
pub(super) struct Solved {
    pub interior: Interior,
    pub board: [f64; BOARD_TERMS],
    pub board_free: [bool; BOARD_TERMS],
    pub poses: Vec<BoardPose>,
    pub weights: Vec<Vec<f64>>,
    pub extent: BoardExtent,
    pub form: ClosedForm,
    pub iterations: usize,
    pub cost: f64,
    /// Observed coordinates less parameters.
    pub freedom: usize,
    /// Covariance of the interior parameters, px² and so on.
    pub covariance: InteriorCovariance,
    /// Variances of the board's terms that are estimated.
    pub board_variances: [f64; BOARD_TERMS],
    /// Covariance of each pose, and of the interior parameters with it.
    pub pose_covariances: Vec<(Matrix6<f64>, SMatrix<f64, MAX_INTERIOR, 6>)>,
    pub shape: BoardShape,
}

/// Adjusts from the start with the least cost.
pub(super) fn solve(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    options: Options,
    mut starts: Vec<Start>,
) -> Result<Solved, CalibrationError> {
    let problem = problem(views, options.model)?;
    for start in &mut starts {
        start.interior = options.model.constrained(start.interior, width, height);
    }
    let with_board = problem.board_free.contains(&true);
    let weigh_down = options.outliers == OutlierPolicy::WeighDown;
    match (options.model.kind, with_board) {
        (LensKind::Brown, false) => solve_lens::<Brown, 10, 10, 14>(problem, starts, weigh_down),
        (LensKind::Brown, true) => solve_lens::<Brown, 10, 14, 14>(problem, starts, weigh_down),
        (LensKind::Rational, false) => solve_lens::<Rational, 13, 13, 17>(problem, starts, weigh_down),
        (LensKind::Rational, true) => solve_lens::<Rational, 13, 17, 17>(problem, starts, weigh_down),
        (LensKind::ThinPrism, false) => solve_lens::<ThinPrism, 17, 17, 21>(problem, starts, weigh_down),
        (LensKind::ThinPrism, true) => solve_lens::<ThinPrism, 17, 21, 21>(problem, starts, weigh_down),
        (LensKind::Fisheye, false) => solve_lens::<Fisheye, 9, 9, 13>(problem, starts, weigh_down),
        (LensKind::Fisheye, true) => solve_lens::<Fisheye, 9, 13, 13>(problem, starts, weigh_down),
        (LensKind::Pix4dFisheye, false) => solve_lens::<Pix4dFisheye, 9, 9, 13>(problem, starts, weigh_down),
        (LensKind::Pix4dFisheye, true) => solve_lens::<Pix4dFisheye, 9, 13, 13>(problem, starts, weigh_down),
    }
}

fn problem(views: &[ViewPoints], model: LensModel) -> Result<Problem, CalibrationError> {
    let sights: Vec<Vec<Sight>> =
        views.iter().map(|view| view.observations.iter().map(Sight::of).collect()).collect();
    let extent = BoardExtent::of(sights.iter().flatten().map(|sight| &sight.board));
    // Points that do not move with the side cannot tell it.
    let side = model.side && sights.iter().flatten().any(|sight| sight.growth != Vector2::zeros());
    let board_free = [side, false, model.bend, model.bend];
    let problem = Problem { views: sights, extent, model, board_free };
    let coordinates = 2 * problem.points();
    let parameters = parameters(&problem);
    if coordinates <= parameters {
        return Err(CalibrationError::TooFewPoints { coordinates, parameters });
    }
    Ok(problem)
}

fn parameters(problem: &Problem) -> usize {
    let board = problem.board_free.iter().filter(|free| **free).count();
    problem.model.parameters() + board + 6 * problem.views.len()
}

/// `S`: shared parameters of the adjustment; `B`: the lens's and all of the board's.
fn solve_lens<L: LensFunction<N>, const N: usize, const S: usize, const B: usize>(
    mut problem: Problem,
    starts: Vec<Start>,
    weigh_down: bool,
) -> Result<Solved, CalibrationError> {
    let (form, state) = best_start::<L, N>(&problem, starts)?;
    let said = |error| said(error, L::KIND);
    let mut adjusted = adjust::<L, N, S>(&problem, state).map_err(said)?;
    if weigh_down {
        adjusted = without_outliers::<L, N, S>(&mut problem, adjusted).map_err(said)?;
    }
    let cofactors = adjusted.cofactors(&problem).map_err(said)?;
    let used = problem.views.iter().flatten().filter(|sight| sight.weight > 0.0).count();
    let freedom = (2 * used).saturating_sub(parameters(&problem)).max(1);
    let variance = adjusted.cost / freedom as f64;
    let aspect = problem.model.aspect;
    let free = |k: usize| problem.model.free[k];
    let covariance = spread(aspect, |i, j| {
        if i < N && j < N && free(i) && free(j) { cofactors.shared[(i, j)] * variance } else { 0.0 }
    });
    let pose_covariances = cofactors
        .poses
        .iter()
        .map(|(pose, cross)| {
            let mut padded = SMatrix::<f64, MAX_INTERIOR, 6>::zeros();
            for k in (0..N).filter(|&k| free(k)) {
                padded.set_row(k, &(cross.row(k) * variance));
            }
            if let Some(ratio) = aspect {
                padded.set_row(FX, &(padded.row(FY) * ratio));
            }
            (pose * variance, padded)
        })
        .collect();
    let board_variances = std::array::from_fn(|k| {
        if S > N && problem.board_free[k] { cofactors.shared[(N + k, N + k)] * variance } else { 0.0 }
    });
    let shape = shape::<L, N, B>(&problem, &adjusted.state, freedom);
    let Adjusted { state, iterations, cost, .. } = adjusted;
    Ok(Solved {
        interior: std::array::from_fn(|k| state.interior.get(k).copied().unwrap_or(0.0)),
        board: state.board,
        board_free: problem.board_free,
        poses: state.poses,
        weights: problem.views.iter().map(|view| view.iter().map(|s| s.weight).collect()).collect(),
        extent: problem.extent,
        form,
        iterations,
        cost,
        freedom,
        covariance,
        board_variances,
        pose_covariances,
        shape,
    })
}

/// A covariance by its elements, with fx following fy where their ratio is known.
fn spread(aspect: Option<f64>, element: impl Fn(usize, usize) -> f64) -> InteriorCovariance {
    let (source, factor) = match aspect {
        Some(ratio) => (FY, ratio),
        None => (FX, 1.0),
    };
    let place = |k: usize| if k == FX { (source, factor) } else { (k, 1.0) };
    InteriorCovariance::from_fn(|i, j| {
        let ((i, a), (j, b)) = (place(i), place(j));
        a * b * element(i, j)
    })
}

/// The start with the least cost over some of the points of every view.
fn best_start<L: LensFunction<N>, const N: usize>(
    problem: &Problem,
    starts: Vec<Start>,
) -> Result<(ClosedForm, State<N>), StartError> {
    const POINTS_PER_VIEW: usize = 12;
    let thin = |view: &Vec<Sight>| {
        view.iter().step_by((view.len() / POINTS_PER_VIEW).max(1)).copied().collect::<Vec<_>>()
    };
    let sample = Problem { views: problem.views.iter().map(thin).collect(), ..problem.clone() };
    starts
        .into_iter()
        .filter_map(|start| {
            let interior: [f64; N] = std::array::from_fn(|k| start.interior[k]);
            let state = State { interior, board: [0.0; BOARD_TERMS], poses: start.poses };
            Some((cost::<L, N>(&sample, &state)?, start.form, state))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, form, state)| (form, state))
        .ok_or(StartError::NoCamera)
}

fn said(error: AdjustError, kind: LensKind) -> CalibrationError {
    const BOARD: [&str; BOARD_TERMS] =
        ["the squares' side", "the board's pitch", "the board's sag across", "the board's sag down"];
    let names = kind.names();
    match error {
        AdjustError::NoImage => CalibrationError::Start(StartError::NoCamera),
        AdjustError::NotConverged { iterations, rms_px } => {
            CalibrationError::NotConverged { iterations, rms_px }
        }
        AdjustError::Undetermined(k) => CalibrationError::Undetermined {
            parameter: names.get(k).or_else(|| BOARD.get(k - names.len())).copied().unwrap_or("the lens"),
        },
        AdjustError::UndeterminedPose(_) => CalibrationError::Undetermined { parameter: "a pose" },
    }
}

/// Adjusts anew with the weights that the residuals suggest, until they stay as they are.
fn without_outliers<L: LensFunction<N>, const N: usize, const S: usize>(
    problem: &mut Problem,
    mut adjusted: Adjusted<N, S>,
) -> Result<Adjusted<N, S>, AdjustError> {
    const ROUNDS: u32 = 30;
    const SETTLED: f64 = 1e-3;
    for _ in 0..ROUNDS {
        let distances = distances::<L, N>(problem, &adjusted.state);
        if reweigh(&mut problem.views, &distances) < SETTLED {
            break;
        }
        let iterations = adjusted.iterations;
        adjusted = adjust::<L, N, S>(problem, adjusted.state)?;
        adjusted.iterations += iterations;
    }
    Ok(adjusted)
}

/// Distances between observed and predicted points, px; infinite for a point without image.
fn distances<L: LensFunction<N>, const N: usize>(problem: &Problem, state: &State<N>) -> Vec<Vec<f64>> {
    let distance = |pose: &BoardPose, sight: &Sight| {
        let p = pose.rotation * problem.extent.place(sight, &state.board) + pose.translation;
        L::pixel_with(&state.interior, &p)
            .map_or(f64::INFINITY, |at| f64::hypot(sight.pixel.x - at.column, sight.pixel.y - at.row))
    };
    let poses = state.poses.iter().zip(&problem.views);
    poses.map(|(pose, view)| view.iter().map(|sight| distance(pose, sight)).collect()).collect()
}

/// The board's shape from one more set of normal equations at the solution.
fn shape<L: LensFunction<N>, const N: usize, const B: usize>(
    problem: &Problem,
    state: &State<N>,
    freedom: usize,
) -> BoardShape {
    let nothing = BoardShape { side_excess_m: None, pitch_excess: None, bend: None };
    let equations = || {
        let normal = NormalEquations::<B>::with_board::<L, N>(problem, state)?;
        let (matrix, right) = normal.reduced()?;
        let lens = inverse_scaled(matrix.fixed_view::<N, N>(0, 0).into_owned())?;
        let coupling = matrix.fixed_view::<BOARD_TERMS, N>(N, 0).into_owned();
        let share = coupling * lens;
        let lens_right: SVector<f64, N> = right.fixed_rows::<N>(0).into_owned();
        let own = matrix.fixed_view::<BOARD_TERMS, BOARD_TERMS>(N, N).into_owned();
        let reduced = own - share * coupling.transpose();
        // A term of which elimination leaves nothing but rounding cannot be told.
        let visible = std::array::from_fn(|k| reduced[(k, k)] > 1e-10 * own[(k, k)]);
        Some(BoardEquations {
            matrix: reduced,
            right: right.fixed_rows::<BOARD_TERMS>(N) - share * lens_right,
            cost: normal.cost,
            freedom: freedom as f64,
            at: state.board,
            estimated: problem.board_free,
            visible,
        })
    };
    equations().map_or(nothing, |equations| equations.shape())
}

/// The product of an adjustment.
fn finish(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    model: LensModel,
    solved: Solved,
) -> Result<Calibration, CalibrationError> {
    let lens = Lens::new(model.kind, &solved.interior)?;
    let covariance = solved.covariance;
    let std: Interior = std::array::from_fn(|k| covariance[(k, k)].sqrt());
    if std[FY] > WEAK_FOCAL * solved.interior[FY] {
        let (focal_px, std_px) = (solved.interior[FY], std[FY]);
        return Err(CalibrationError::WeakFocalLength { focal_px, std_px });
    }
    let correlation = InteriorCovariance::from_fn(|i, j| {
        let scale = std[i] * std[j];
        if scale > 0.0 { covariance[(i, j)] / scale } else { f64::from(u8::from(i == j && model.free[i])) }
    });
    let camera = Camera::new(lens, width, height, Some(covariance))?;
    let adjusted: Vec<View> = views
        .iter()
        .enumerate()
        .map(|(index, view)| finished_view(view, index, &lens, &solved))
        .collect::<Option<_>>()
        .ok_or(StartError::NoCamera)?;
    check_mixture(&lens, &adjusted)?;
    let points: usize = views.iter().map(|view| view.observations.len()).sum();
    let j_total: f64 = adjusted.iter().flat_map(|v| &v.points).map(|p| p.distance_px().powi(2)).sum();
    let robust_sigma_px =
        robust_sigma(adjusted.iter().flat_map(|v| &v.points).map(PointResidual::distance_px));
    // Focal lengths and principal point are never zero; only skew and lens terms can be.
    let insignificant = std::iter::once(SKEW)
        .chain(TERMS..MAX_INTERIOR)
        .filter(|&k| model.free[k] && solved.interior[k].abs() < 2.0 * std[k])
        .map(|k| model.kind.names()[k])
        .collect();
    Ok(Calibration {
        support: support(&camera, &adjusted),
        outliers: outliers(&adjusted, robust_sigma_px),
        suspects: suspects(&adjusted),
        camera,
        model,
        start: solved.form,
        views: adjusted,
        sigma0_px: (solved.cost / solved.freedom as f64).sqrt(),
        j_total,
        j_per_point: j_total / points as f64,
        rms_px: (j_total / points as f64).sqrt(),
        iterations: solved.iterations,
        std,
        correlation,
        side_excess_m: solved.board_free[SIDE]
            .then(|| (solved.board[SIDE], solved.board_variances[SIDE].sqrt())),
        board: solved.shape,
        robust_sigma_px,
        insignificant,
    })
}

/// Looks for photos of other cameras where the fit is poor.
fn check_mixture(lens: &Lens, views: &[View]) -> Result<(), CalibrationError> {
    /// Photos of one camera fit better than this.
    const POOR_PX: f64 = 0.5;
    const NAMED: usize = 3;
    let poor = views.iter().filter(|view| view.rms_px > POOR_PX).count();
    let Some(Mixture { shorter, longer, ratio }) =
        (2 * poor >= views.len()).then(|| mixture(lens, views)).flatten()
    else {
        return Ok(());
    };
    let list = |names: Vec<String>| {
        let more = names.len().saturating_sub(NAMED);
        let named = names[..names.len() - more].join(", ");
        if more > 0 { format!("{named} and {more} more") } else { named }
    };
    Err(CalibrationError::MixedCameras {
        longer: list(longer),
        shorter: list(shorter),
        percent: 100.0 * (ratio - 1.0),
    })
}

/// Share of the focal length that its standard deviation may reach.
const WEAK_FOCAL: f64 = 0.05;

fn finished_view(view: &ViewPoints, index: usize, lens: &Lens, solved: &Solved) -> Option<View> {
    let pose = &solved.poses[index];
    let points: Vec<PointResidual> = view
        .observations
        .iter()
        .zip(&solved.weights[index])
        .map(|(o, &weight)| {
            let p = pose.rotation * solved.extent.place(&Sight::of(o), &solved.board) + pose.translation;
            let predicted = lens.project(&p)?.pixel;
            Some(PointResidual { board: o.board, observed: o.pixel, predicted, weight })
        })
        .collect::<Option<_>>()?;
    let sum: f64 = points.iter().map(|p| p.distance_px().powi(2)).sum();
    let (pose_covariance, interior_pose_covariance) = solved.pose_covariances[index];
    Some(View {
        name: view.name.clone(),
        camera_from_board: Pose::new(
            Rotation::from_rotation(pose.rotation),
            Point::from_vector(pose.translation),
        ),
        pose_covariance,
        interior_pose_covariance,
        rms_px: (sum / points.len() as f64).sqrt(),
        points,
    })
}

#[cfg(test)]
mod tests;
