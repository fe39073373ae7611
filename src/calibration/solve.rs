//! The adjustment: Levenberg–Marquardt on the ten interior parameters and six per view, with covariance.
//!
//! The normal equations are block sparse (interior, one block per view), so the views are eliminated one
//! by one and a 10 × 10 system remains; work grows with the number of points, not with its square.
//!
//! # Source
//! Hemerly (2014), eq. (5): J(θ) = Σ ‖observed − predicted‖², θ of 10 + 6 n parameters.

use super::product::{Calibration, PointResidual, Support, View, ViewPoints};
use super::target::{BoardPoint, Observation};
use super::zhang::{self, BoardPose, StartError};
use crate::camera::{Brown, Camera, CameraError, INTERIOR_NAMES, ImagePoint, InteriorCovariance};
use crate::geometry::{Point, Pose, Rotation};
use nalgebra::{Matrix2x3, Matrix6, Rotation3, SMatrix, SVector, Vector2, Vector3, Vector6};

/// Parameters common to all views: the interior, then the excess of the squares' side (m).
const SHARED: usize = 11;
const SIDE: usize = 10;
type Shared = SVector<f64, SHARED>;
type SharedMatrix = SMatrix<f64, SHARED, SHARED>;
type SharedByPose = SMatrix<f64, SHARED, 6>;

/// Lens terms that are estimated; the others stay zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lens {
    /// k1, k2.
    Radial2,
    /// k1, k2, p1, p2.
    Radial2Tangential2,
    /// k1, k2, p1, p2, k3: the paper's.
    Brown5,
}

/// Which interior parameters are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LensModel {
    /// Lens terms.
    pub lens: Lens,
    /// Whether the skew is estimated; zero otherwise.
    pub skew: bool,
    /// Whether the squares' apparent side is estimated along; as declared otherwise. Not part of the camera:
    /// ink spreads and bright paper blooms over the black, which moves all corners of a square in or out.
    pub side: bool,
}

impl LensModel {
    /// The paper's model: all ten interior parameters, squares as declared.
    pub const PAPER: Self = Self { lens: Lens::Brown5, skew: true, side: false };

    /// Which interior parameters are estimated, in the order of [`INTERIOR_NAMES`].
    #[must_use]
    pub const fn free(&self) -> [bool; 10] {
        let tangential = !matches!(self.lens, Lens::Radial2);
        let k3 = matches!(self.lens, Lens::Brown5);
        [true, true, self.skew, true, true, true, true, tangential, tangential, k3]
    }
}

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
}

/// Calibrates a camera from three or more views of a planar target.
///
/// - `views`: observed points, pixels about the centre of the top-left pixel, board coordinates in metres.
/// - `width`, `height`: image size, pixels.
///
/// Starts from Zhang's closed form and needs no hint. All coordinates weigh the same.
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
    let starts = zhang::starts(views, width, height, model.skew)?;
    let interior_free = model.free();
    // Points that do not move with the side cannot tell it.
    let grows = |o: &Observation| o.growth.x_m != 0.0 || o.growth.y_m != 0.0;
    let side = model.side && views.iter().flat_map(|view| &view.observations).any(grows);
    let free: [bool; SHARED] = std::array::from_fn(|k| interior_free.get(k).copied().unwrap_or(side));
    let free_count = free.iter().filter(|f| **f).count();
    let points: usize = views.iter().map(|view| view.observations.len()).sum();
    let (coordinates, parameters) = (2 * points, free_count + 6 * views.len());
    if coordinates <= parameters {
        return Err(CalibrationError::TooFewPoints { coordinates, parameters });
    }
    let (start, state) = starts
        .into_iter()
        .filter_map(|s| {
            let mut interior = s.interior;
            for (value, free) in interior.iter_mut().zip(free) {
                if !free {
                    *value = 0.0;
                }
            }
            let state = State { brown: Brown::new(interior).ok()?, side_excess_m: 0.0, poses: s.poses };
            let cost = cost(&state, views)?;
            Some((cost, s.form, state))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, form, state)| (form, state))
        .ok_or(StartError::NoCamera)?;
    let (state, iterations) = minimise(state, views, &free)?;
    let normal = NormalEquations::new(&state, views, &free).ok_or(StartError::NoCamera)?;
    let j_total = normal.cost;
    let variance = j_total / (coordinates - parameters) as f64;
    let (shared_cofactor, pose_cofactors) = normal.cofactors(&free)?;

    let mut shared_covariance = shared_cofactor * variance;
    for k in (0..SHARED).filter(|&k| !free[k]) {
        shared_covariance.fill_row(k, 0.0);
        shared_covariance.fill_column(k, 0.0);
    }
    let covariance: InteriorCovariance = shared_covariance.fixed_view::<10, 10>(0, 0).into_owned();
    let side_excess_m = side.then(|| (state.side_excess_m, shared_covariance[(SIDE, SIDE)].sqrt()));
    let std: [f64; 10] = std::array::from_fn(|k| covariance[(k, k)].sqrt());
    let correlation = InteriorCovariance::from_fn(|i, j| {
        let scale = std[i] * std[j];
        if scale > 0.0 { covariance[(i, j)] / scale } else { f64::from(u8::from(i == j && free[i])) }
    });
    let values = state.brown.interior();
    // Focal lengths and principal point are never zero; only skew and lens terms can be.
    let insignificant = [2, 5, 6, 7, 8, 9]
        .into_iter()
        .filter(|&k| free[k] && values[k].abs() < 2.0 * std[k])
        .map(|k| INTERIOR_NAMES[k])
        .collect();
    let camera = Camera::new(state.brown, width, height, Some(covariance))?;
    let views: Vec<View> = views
        .iter()
        .zip(&state.poses)
        .zip(pose_cofactors)
        .map(|((view, pose), (pose_cofactor, cross))| {
            let points: Vec<PointResidual> = view
                .observations
                .iter()
                .map(|o| PointResidual {
                    board: o.board,
                    observed: o.pixel,
                    predicted: state.brown.project(ideal(pose, state.place(o)).0).pixel,
                })
                .collect();
            let mut cross = cross.fixed_rows::<10>(0) * variance;
            for k in (0..10).filter(|&k| !free[k]) {
                cross.fill_row(k, 0.0);
            }
            View {
                name: view.name.clone(),
                camera_from_board: Pose::new(
                    Rotation::from_rotation(pose.rotation),
                    Point::from_vector(pose.translation),
                ),
                pose_covariance: pose_cofactor * variance,
                interior_pose_covariance: cross,
                rms_px: root_mean_square(&points),
                points,
            }
        })
        .collect();
    let support = support(&camera, &views);
    Ok(Calibration {
        camera,
        model,
        start,
        sigma0_px: variance.sqrt(),
        j_total,
        j_per_point: j_total / points as f64,
        rms_px: (j_total / points as f64).sqrt(),
        iterations,
        std,
        correlation,
        side_excess_m,
        insignificant,
        support,
        views,
    })
}

fn root_mean_square(points: &[PointResidual]) -> f64 {
    let sum: f64 = points.iter().map(|p| p.distance_px().powi(2)).sum();
    (sum / points.len() as f64).sqrt()
}

/// Everything that is being estimated.
#[derive(Clone)]
struct State {
    brown: Brown,
    side_excess_m: f64,
    poses: Vec<BoardPose>,
}

impl State {
    /// Where a point is on the board, given how large the squares really are.
    fn place(&self, o: &Observation) -> BoardPoint {
        BoardPoint {
            x_m: o.board.x_m + o.growth.x_m * self.side_excess_m,
            y_m: o.board.y_m + o.growth.y_m * self.side_excess_m,
        }
    }
}

/// Ideal image point of a board point, the point in the camera, and its rotated part.
fn ideal(pose: &BoardPose, board: BoardPoint) -> (Vector2<f64>, Vector3<f64>, Vector3<f64>) {
    let rotated = pose.rotation * Vector3::new(board.x_m, board.y_m, 0.0);
    let p = rotated + pose.translation;
    (Vector2::new(p.x / p.z, p.y / p.z), p, rotated)
}

/// J of eq. (5), px²; `None` when a point is not in front of the camera or not finite.
fn cost(state: &State, views: &[ViewPoints]) -> Option<f64> {
    let mut sum = 0.0;
    for (pose, view) in state.poses.iter().zip(views) {
        for o in &view.observations {
            let (at, p, _) = ideal(pose, state.place(o));
            if p.z <= 0.0 {
                return None;
            }
            let residual = residual(o.pixel, state.brown.project(at).pixel);
            sum += residual.norm_squared();
        }
    }
    sum.is_finite().then_some(sum)
}

fn residual(observed: ImagePoint, predicted: ImagePoint) -> Vector2<f64> {
    Vector2::new(observed.column - predicted.column, observed.row - predicted.row)
}

/// JᵀJ and Jᵀr by blocks.
struct NormalEquations {
    shared: SharedMatrix,
    shared_right: Shared,
    /// Per view: pose block, coupling to the shared parameters, right-hand side.
    views: Vec<(Matrix6<f64>, SharedByPose, Vector6<f64>)>,
    cost: f64,
}

impl NormalEquations {
    fn new(state: &State, views: &[ViewPoints], free: &[bool; SHARED]) -> Option<Self> {
        let mut sums = Self {
            shared: SharedMatrix::zeros(),
            shared_right: Shared::zeros(),
            views: Vec::with_capacity(views.len()),
            cost: 0.0,
        };
        for (pose, view) in state.poses.iter().zip(views) {
            let mut block = Matrix6::zeros();
            let mut coupling = SharedByPose::zeros();
            let mut right = Vector6::zeros();
            for o in &view.observations {
                let (at, p, rotated) = ideal(pose, state.place(o));
                if p.z <= 0.0 {
                    return None;
                }
                let projected = state.brown.project(at);
                let by_camera = projected.by_ideal * Matrix2x3::new(1.0, 0.0, -at.x, 0.0, 1.0, -at.y) / p.z;
                // exp(δ)·R: d(rotated) = δ × rotated.
                let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
                by_pose.fixed_columns_mut::<3>(0).copy_from(&(-by_camera * rotated.cross_matrix()));
                by_pose.fixed_columns_mut::<3>(3).copy_from(&by_camera);
                let by_side = by_camera * (pose.rotation * Vector3::new(o.growth.x_m, o.growth.y_m, 0.0));
                let residual = residual(o.pixel, projected.pixel);
                for axis in 0..2 {
                    let mut shared_row = Shared::zeros();
                    shared_row
                        .fixed_rows_mut::<10>(0)
                        .copy_from(&projected.by_interior.row(axis).transpose());
                    shared_row[SIDE] = by_side[axis];
                    let pose_row: Vector6<f64> = by_pose.row(axis).transpose();
                    sums.shared.ger(1.0, &shared_row, &shared_row, 1.0);
                    coupling.ger(1.0, &shared_row, &pose_row, 1.0);
                    block.ger(1.0, &pose_row, &pose_row, 1.0);
                    sums.shared_right.axpy(residual[axis], &shared_row, 1.0);
                    right.axpy(residual[axis], &pose_row, 1.0);
                }
                sums.cost += residual.norm_squared();
            }
            for k in (0..SHARED).filter(|&k| !free[k]) {
                coupling.fill_row(k, 0.0);
            }
            sums.views.push((block, coupling, right));
        }
        for k in (0..SHARED).filter(|&k| !free[k]) {
            sums.shared.fill_row(k, 0.0);
            sums.shared.fill_column(k, 0.0);
            sums.shared[(k, k)] = 1.0;
            sums.shared_right[k] = 0.0;
        }
        sums.cost.is_finite().then_some(sums)
    }

    /// The step for a damping, and its length in pixels: √(δᵀJᵀr), the norm of the change of all
    /// residuals when the damping is small.
    fn step(&self, damping: f64) -> Option<(Shared, Vec<Vector6<f64>>, f64)> {
        let mut reduced = self.shared;
        for k in 0..SHARED {
            reduced[(k, k)] *= 1.0 + damping;
        }
        let mut right = self.shared_right;
        let mut inverses = Vec::with_capacity(self.views.len());
        for (block, coupling, view_right) in &self.views {
            let mut block = *block;
            for k in 0..6 {
                block[(k, k)] *= 1.0 + damping;
            }
            let inverse = inverse_scaled(block)?;
            let share = coupling * inverse;
            reduced -= share * coupling.transpose();
            right -= share * view_right;
            inverses.push(inverse);
        }
        let shared = inverse_scaled(reduced)? * right;
        let mut length = shared.dot(&self.shared_right);
        let mut poses = Vec::with_capacity(self.views.len());
        for ((_, coupling, view_right), inverse) in self.views.iter().zip(inverses) {
            let pose = inverse * (view_right - coupling.transpose() * shared);
            length += pose.dot(view_right);
            poses.push(pose);
        }
        Some((shared, poses, length.max(0.0).sqrt()))
    }

    /// (JᵀJ)⁻¹ by blocks: shared parameters, and per view the pose and its coupling to them.
    #[expect(clippy::type_complexity, reason = "used once, next to its definition")]
    fn cofactors(
        &self,
        free: &[bool; SHARED],
    ) -> Result<(SharedMatrix, Vec<(Matrix6<f64>, SharedByPose)>), CalibrationError> {
        let unfound = |k: usize| CalibrationError::Undetermined {
            parameter: INTERIOR_NAMES.get(k).copied().unwrap_or("the squares' side"),
        };
        let mut reduced = self.shared;
        let mut parts = Vec::with_capacity(self.views.len());
        for (block, coupling, _) in &self.views {
            let inverse =
                inverse_scaled(*block).ok_or(CalibrationError::Undetermined { parameter: "a pose" })?;
            let share = coupling * inverse;
            reduced -= share * coupling.transpose();
            parts.push((inverse, share));
        }
        // With unit diagonal, a vanishing eigenvalue is a combination of parameters that nothing fixes.
        for k in (0..SHARED).filter(|&k| free[k]) {
            let kept = reduced[(k, k)] / self.shared[(k, k)];
            if kept.is_nan() || kept <= 1e-12 {
                return Err(unfound(k));
            }
        }
        let scale = Shared::from_fn(|k, _| 1.0 / reduced[(k, k)].sqrt());
        let scaled = SharedMatrix::from_fn(|i, j| scale[i] * scale[j] * reduced[(i, j)]);
        let eigen = scaled.symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        if eigen.eigenvalues[least] <= 1e-13 * eigen.eigenvalues.max() {
            return Err(unfound(eigen.eigenvectors.column(least).iamax()));
        }
        let shared = inverse_scaled(reduced).ok_or_else(|| unfound(0))?;
        let poses = parts
            .into_iter()
            .map(|(inverse, share)| {
                let cross = -shared * share;
                (inverse - share.transpose() * cross, cross)
            })
            .collect();
        Ok((shared, poses))
    }
}

/// Inverse of a symmetric positive definite matrix whose rows differ widely in scale.
fn inverse_scaled<const N: usize>(matrix: SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let mut scale = SVector::<f64, N>::zeros();
    for k in 0..N {
        if matrix[(k, k)] <= 0.0 {
            return None;
        }
        scale[k] = 1.0 / matrix[(k, k)].sqrt();
    }
    let scaled = SMatrix::<f64, N, N>::from_fn(|i, j| scale[i] * scale[j] * matrix[(i, j)]);
    let inverse = scaled.cholesky()?.inverse();
    Some(SMatrix::from_fn(|i, j| scale[i] * scale[j] * inverse[(i, j)]))
}

/// Levenberg–Marquardt from a start to the least cost.
fn minimise(
    mut state: State,
    views: &[ViewPoints],
    free: &[bool; SHARED],
) -> Result<(State, usize), CalibrationError> {
    const MAX_STEPS: usize = 300;
    const LARGEST_DAMPING: f64 = 1e14;
    let mut damping = 1e-3;
    let mut normal = NormalEquations::new(&state, views, free).ok_or(StartError::NoCamera)?;
    let points: usize = views.iter().map(|view| view.observations.len()).sum();
    let mut iterations = 0;
    while iterations < MAX_STEPS {
        iterations += 1;
        let trial = normal.step(damping).and_then(|(shared, poses, length)| {
            let mut interior = state.brown.interior();
            interior.iter_mut().zip(shared.iter()).for_each(|(value, step)| *value += step);
            let next = State {
                brown: Brown::new(interior).ok()?,
                side_excess_m: state.side_excess_m + shared[SIDE],
                poses: state
                    .poses
                    .iter()
                    .zip(&poses)
                    .map(|(pose, step)| BoardPose {
                        rotation: Rotation3::new(step.fixed_rows::<3>(0).into_owned()) * pose.rotation,
                        translation: pose.translation + step.fixed_rows::<3>(3),
                    })
                    .collect(),
            };
            let next_cost = cost(&next, views)?;
            Some((next, next_cost, length))
        });
        // A step that would change the residuals by less than a billionth of themselves, or by less than
        // 1e-10 px over all points, is the end; so is one of a ten millionth when rounding hides whether
        // it still lowers the cost.
        let at_rest = |length: f64, share: f64| length <= share * normal.cost.sqrt() + 1e-10;
        match trial {
            Some((next, next_cost, length)) if next_cost < normal.cost => {
                let done = at_rest(length, 1e-9);
                normal = NormalEquations::new(&next, views, free).ok_or(StartError::NoCamera)?;
                state = next;
                // Undamped near the solution, so that convergence is quadratic.
                damping = if damping < 1e-9 { 0.0 } else { damping * 0.1 };
                if done {
                    return Ok((state, iterations));
                }
            }
            Some((_, _, length)) if damping < 1e-3 && at_rest(length, 1e-7) => {
                return Ok((state, iterations));
            }
            _ => {
                damping = (damping * 10.0).max(1e-9);
                if damping > LARGEST_DAMPING {
                    break;
                }
            }
        }
    }
    let rms_px = (normal.cost / points as f64).sqrt();
    Err(CalibrationError::NotConverged { iterations, rms_px })
}

/// Where in the frame the lens is supported by points.
fn support(camera: &Camera, views: &[View]) -> Support {
    const CELLS: (usize, usize) = (8, 6);
    const GRID: (u32, u32) = (64, 48);
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let mut covered = [false; CELLS.0 * CELLS.1];
    let mut max_ideal_radius = 0.0_f64;
    for view in views {
        let rotation = view.camera_from_board.rotation.matrix();
        let origin = view.camera_from_board.origin.vector();
        for point in &view.points {
            let p = rotation * Vector3::new(point.board.x_m, point.board.y_m, 0.0) + origin;
            max_ideal_radius = max_ideal_radius.max(f64::hypot(p.x, p.y) / p.z);
            let cell = |at: f64, size: f64, cells: usize| {
                let share = (at + 0.5) / size;
                (0.0..1.0).contains(&share).then_some((share * cells as f64) as usize)
            };
            let column = cell(point.observed.column, width, CELLS.0);
            let row = cell(point.observed.row, height, CELLS.1);
            if let (Some(column), Some(row)) = (column, row) {
                covered[row * CELLS.0 + column] = true;
            }
        }
    }
    let (mut supported, mut folded) = (0_u32, 0_u32);
    for r in 0..GRID.1 {
        for c in 0..GRID.0 {
            let at = |k: u32, cells: u32, size: f64| f64::from(k) / f64::from(cells - 1) * (size - 1.0);
            let pixel = ImagePoint::new(at(c, GRID.0, width), at(r, GRID.1, height));
            match camera.brown.ideal_from_pixel(pixel) {
                None => folded += 1,
                Some(ideal) if ideal.norm() <= max_ideal_radius => supported += 1,
                Some(_) => {}
            }
        }
    }
    let cells = f64::from(GRID.0 * GRID.1);
    Support {
        max_ideal_radius,
        fold_radius: camera.brown.fold_radius(),
        supported_share: f64::from(supported) / cells,
        folded_share: f64::from(folded) / cells,
        covered_cells: covered.iter().filter(|c| **c).count() as f64 / covered.len() as f64,
    }
}

#[cfg(test)]
mod tests;
