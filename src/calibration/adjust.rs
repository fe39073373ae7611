//! Levenberg–Marquardt on the interior parameters, the board's shape and six parameters per view.
//!
//! The normal equations are block sparse (what all views share, one block per view), so the views are
//! eliminated one by one and a small system remains; work grows with the number of points, not with its
//! square. Everything is generic over the lens, so that each lens has its own code without branches.
//!
//! # Source
//! Hemerly (2014), eq. (5): J(θ) = Σ ‖observed − predicted‖², θ of 10 + 6 n parameters.

use super::board::{BOARD_TERMS, BoardExtent};
use super::model::{FX, FY, LensModel};
use super::target::Observation;
use super::zhang::BoardPose;
use crate::camera::{ImagePoint, LensFunction};
use nalgebra::{Matrix6, Rotation3, SMatrix, SVector, Vector2, Vector3, Vector6};

/// One observed point, ready for the inner loop.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    /// Declared place on the board, metres.
    pub board: Vector2<f64>,
    /// How it moves with the squares' side: m per m.
    pub growth: Vector2<f64>,
    /// Observed column and row.
    pub pixel: Vector2<f64>,
    /// Weight of its squared residual.
    pub weight: f64,
}

impl Sight {
    /// An observation, with weight 1.
    pub fn of(o: &Observation) -> Self {
        Self {
            board: Vector2::new(o.board.x_m, o.board.y_m),
            growth: Vector2::new(o.growth.x_m, o.growth.y_m),
            pixel: Vector2::new(o.pixel.column, o.pixel.row),
            weight: 1.0,
        }
    }
}

/// The observations, view by view, and what is estimated from them.
#[derive(Debug, Clone)]
pub(super) struct Problem {
    /// Points of each view.
    pub views: Vec<Vec<Sight>>,
    /// Middle and half size of the board.
    pub extent: BoardExtent,
    /// What is estimated.
    pub model: LensModel,
    /// Which of the board's terms are estimated.
    pub board_free: [bool; BOARD_TERMS],
}

/// Everything that is estimated.
#[derive(Debug, Clone)]
pub(super) struct State<const N: usize> {
    pub interior: [f64; N],
    /// The board's terms: see [`BoardExtent::place`].
    pub board: [f64; BOARD_TERMS],
    pub poses: Vec<BoardPose>,
}

/// JᵀJ and Jᵀr of one view's pose, and its coupling to what the views share.
#[derive(Clone)]
struct ViewBlock<const S: usize> {
    block: Matrix6<f64>,
    coupling: SMatrix<f64, S, 6>,
    right: Vector6<f64>,
}

/// JᵀJ and Jᵀr by blocks. `S` is the number of shared parameters: the lens's, or the lens's and the board's.
#[derive(Clone)]
pub(super) struct NormalEquations<const S: usize> {
    shared: SMatrix<f64, S, S>,
    shared_right: SVector<f64, S>,
    views: Vec<ViewBlock<S>>,
    /// Σ weight · ‖residual‖², px².
    pub cost: f64,
}

/// (JᵀJ)⁻¹ by blocks: what the views share, and per view the pose and its coupling to that.
pub(super) struct Cofactors<const S: usize> {
    pub shared: SMatrix<f64, S, S>,
    pub poses: Vec<(Matrix6<f64>, SMatrix<f64, S, 6>)>,
}

/// Why an adjustment has no answer.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum AdjustError {
    /// A point has no image under the start.
    NoImage,
    /// The cost did not come to rest.
    NotConverged { iterations: usize, rms_px: f64 },
    /// A shared parameter (its place), or a pose (its view), is not determined.
    Undetermined(usize),
    /// As above, for the pose of a view.
    UndeterminedPose(usize),
}

impl Problem {
    /// Number of points.
    pub fn points(&self) -> usize {
        self.views.iter().map(Vec::len).sum()
    }

    /// Which of `S` shared parameters, lens's then board's, are estimated.
    fn free<const N: usize, const S: usize>(&self) -> [bool; S] {
        std::array::from_fn(|k| if k < N { self.model.free[k] } else { self.board_free[k - N] })
    }

    /// The same problem with about `least` or more of every view's points, evenly taken; `None` when that
    /// would save little.
    fn thinned(&self, least: usize) -> Option<Self> {
        let thin = |view: &Vec<Sight>| {
            let step = (view.len() / least).max(1);
            view.iter().step_by(step).copied().collect::<Vec<_>>()
        };
        let thinned = Self { views: self.views.iter().map(thin).collect(), ..self.clone() };
        (2 * thinned.points() <= self.points()).then_some(thinned)
    }
}

fn observed_minus(observed: &Vector2<f64>, predicted: ImagePoint) -> Vector2<f64> {
    Vector2::new(observed.x - predicted.column, observed.y - predicted.row)
}

/// Σ weight · ‖residual‖², px²; `None` when a point has no image.
pub(super) fn cost<L: LensFunction<N>, const N: usize>(problem: &Problem, state: &State<N>) -> Option<f64> {
    let mut sum = 0.0;
    for (pose, view) in state.poses.iter().zip(&problem.views) {
        for sight in view {
            let place = problem.extent.place(sight, &state.board);
            let p = pose.rotation * place + pose.translation;
            sum += sight.weight
                * observed_minus(&sight.pixel, L::pixel_with(&state.interior, &p)?).norm_squared();
        }
    }
    sum.is_finite().then_some(sum)
}

impl<const S: usize> NormalEquations<S> {
    /// At a state, over every parameter whether it is estimated or not; `None` when a point has no image.
    fn assemble<L: LensFunction<N>, const N: usize>(problem: &Problem, state: &State<N>) -> Option<Self> {
        let mut shared = SMatrix::<f64, S, S>::zeros();
        let mut shared_right = SVector::<f64, S>::zeros();
        let mut views = Vec::with_capacity(problem.views.len());
        let mut cost = 0.0;
        for (pose, view) in state.poses.iter().zip(&problem.views) {
            let rotation = pose.rotation.matrix();
            // Columns 0–5 the pose, column 6 the residual.
            let mut block = SMatrix::<f64, 7, 7>::zeros();
            let mut coupling = SMatrix::<f64, S, 7>::zeros();
            for sight in view {
                let place = problem.extent.place(sight, &state.board);
                let rotated = rotation * place;
                let projected = L::project_with(&state.interior, &(rotated + pose.translation))?;
                let residual = observed_minus(&sight.pixel, projected.pixel);
                cost += sight.weight * residual.norm_squared();
                let root = sight.weight.sqrt();
                let by_point = projected.by_point * root;
                let mut lens = SMatrix::<f64, S, 2>::zeros();
                for k in 0..N {
                    lens[(k, 0)] = projected.by_interior[(0, k)] * root;
                    lens[(k, 1)] = projected.by_interior[(1, k)] * root;
                }
                if let Some(ratio) = problem.model.aspect {
                    lens[(FY, 0)] += ratio * lens[(FX, 0)];
                }
                if S > N {
                    let by_board = by_point * (rotation * problem.extent.place_by_terms(sight, &state.board));
                    for k in 0..BOARD_TERMS.min(S - N) {
                        lens[(N + k, 0)] = by_board[(0, k)];
                        lens[(N + k, 1)] = by_board[(1, k)];
                    }
                }
                // exp(δ)·R: d(rotated) = δ × rotated.
                let mut pose_rows = SMatrix::<f64, 7, 2>::zeros();
                for axis in 0..2 {
                    let row = Vector3::new(by_point[(axis, 0)], by_point[(axis, 1)], by_point[(axis, 2)]);
                    let turn = rotated.cross(&row);
                    for k in 0..3 {
                        pose_rows[(k, axis)] = turn[k];
                        pose_rows[(3 + k, axis)] = row[k];
                    }
                    pose_rows[(6, axis)] = residual[axis] * root;
                }
                accumulate_symmetric(&mut shared, &lens);
                accumulate(&mut coupling, &lens, &pose_rows);
                accumulate_symmetric(&mut block, &pose_rows);
            }
            block.fill_lower_triangle_with_upper_triangle();
            shared_right += coupling.column(6);
            views.push(ViewBlock {
                block: block.fixed_view::<6, 6>(0, 0).into_owned(),
                coupling: coupling.fixed_columns::<6>(0).into_owned(),
                right: block.fixed_view::<6, 1>(0, 6).into_owned(),
            });
        }
        shared.fill_lower_triangle_with_upper_triangle();
        cost.is_finite().then_some(Self { shared, shared_right, views, cost })
    }

    /// With the parameters that are not estimated taken out.
    fn restricted(mut self, free: &[bool; S]) -> Self {
        for k in (0..S).filter(|&k| !free[k]) {
            self.shared.fill_row(k, 0.0);
            self.shared.fill_column(k, 0.0);
            self.shared[(k, k)] = 1.0;
            self.shared_right[k] = 0.0;
            for view in &mut self.views {
                view.coupling.fill_row(k, 0.0);
            }
        }
        self
    }

    /// At a state, for the estimated parameters.
    pub fn at<L: LensFunction<N>, const N: usize>(problem: &Problem, state: &State<N>) -> Option<Self> {
        Some(Self::assemble::<L, N>(problem, state)?.restricted(&problem.free::<N, S>()))
    }

    /// At a state, for the estimated parameters and all of the board's terms.
    pub fn with_board<L: LensFunction<N>, const N: usize>(
        problem: &Problem,
        state: &State<N>,
    ) -> Option<Self> {
        let mut free = problem.free::<N, S>();
        free[N..].fill(true);
        Some(Self::assemble::<L, N>(problem, state)?.restricted(&free))
    }

    /// What remains of the shared parameters' equations when the poses are eliminated.
    pub fn reduced(&self) -> Option<(SMatrix<f64, S, S>, SVector<f64, S>)> {
        let (mut matrix, mut right) = (self.shared, self.shared_right);
        for view in &self.views {
            let share = view.coupling * inverse_scaled(view.block)?;
            matrix -= share * view.coupling.transpose();
            right -= share * view.right;
        }
        Some((matrix, right))
    }

    /// The step for a damping, and its length in pixels: √(δᵀJᵀr), the norm of the change of all
    /// residuals when the damping is small.
    fn step(&self, damping: f64) -> Option<(SVector<f64, S>, Vec<Vector6<f64>>, f64)> {
        let mut reduced = self.shared;
        for k in 0..S {
            reduced[(k, k)] *= 1.0 + damping;
        }
        let mut right = self.shared_right;
        let mut inverses = Vec::with_capacity(self.views.len());
        for view in &self.views {
            let mut block = view.block;
            for k in 0..6 {
                block[(k, k)] *= 1.0 + damping;
            }
            let inverse = inverse_scaled(block)?;
            let share = view.coupling * inverse;
            reduced -= share * view.coupling.transpose();
            right -= share * view.right;
            inverses.push(inverse);
        }
        let shared = inverse_scaled(reduced)? * right;
        let mut length = shared.dot(&self.shared_right);
        let mut poses = Vec::with_capacity(self.views.len());
        for (view, inverse) in self.views.iter().zip(inverses) {
            let pose = inverse * (view.right - view.coupling.transpose() * shared);
            length += pose.dot(&view.right);
            poses.push(pose);
        }
        Some((shared, poses, length.max(0.0).sqrt()))
    }

    /// (JᵀJ)⁻¹ by blocks; `free` says which shared parameters are estimated.
    fn cofactors(&self, free: &[bool; S]) -> Result<Cofactors<S>, AdjustError> {
        let mut reduced = self.shared;
        let mut parts = Vec::with_capacity(self.views.len());
        for (index, view) in self.views.iter().enumerate() {
            let inverse = inverse_scaled(view.block).ok_or(AdjustError::UndeterminedPose(index))?;
            let share = view.coupling * inverse;
            reduced -= share * view.coupling.transpose();
            parts.push((inverse, share));
        }
        // With unit diagonal, a vanishing eigenvalue is a combination of parameters that nothing fixes.
        for k in (0..S).filter(|&k| free[k]) {
            let kept = reduced[(k, k)] / self.shared[(k, k)];
            if kept.is_nan() || kept <= 1e-12 {
                return Err(AdjustError::Undetermined(k));
            }
        }
        let scale = SVector::<f64, S>::from_fn(|k, _| 1.0 / reduced[(k, k)].sqrt());
        let scaled = SMatrix::<f64, S, S>::from_fn(|i, j| scale[i] * scale[j] * reduced[(i, j)]);
        let smallest = smallest_eigenvalue(&scaled).unwrap_or((0.0, 0));
        if smallest.0 <= 1e-13 {
            return Err(AdjustError::Undetermined(smallest.1));
        }
        let shared = inverse_scaled(reduced).ok_or(AdjustError::Undetermined(0))?;
        let poses = parts
            .into_iter()
            .map(|(inverse, share)| {
                let cross = -shared * share;
                (inverse - share.transpose() * cross, cross)
            })
            .collect();
        Ok(Cofactors { shared, poses })
    }
}

/// `sum += a bᵀ` over the two rows of a residual.
#[inline]
fn accumulate<const A: usize, const B: usize>(
    sum: &mut SMatrix<f64, A, B>,
    a: &SMatrix<f64, A, 2>,
    b: &SMatrix<f64, B, 2>,
) {
    for j in 0..B {
        let (x, y) = (b[(j, 0)], b[(j, 1)]);
        for i in 0..A {
            sum[(i, j)] += a[(i, 0)] * x + a[(i, 1)] * y;
        }
    }
}

/// The upper triangle of `sum += a aᵀ` over the two rows of a residual.
#[inline]
fn accumulate_symmetric<const A: usize>(sum: &mut SMatrix<f64, A, A>, a: &SMatrix<f64, A, 2>) {
    for j in 0..A {
        let (x, y) = (a[(j, 0)], a[(j, 1)]);
        for i in 0..=j {
            sum[(i, j)] += a[(i, 0)] * x + a[(i, 1)] * y;
        }
    }
}

/// Smallest eigenvalue of a symmetric positive matrix by inverse iteration, and the largest component of its
/// vector; `None` when the matrix is singular.
fn smallest_eigenvalue<const S: usize>(matrix: &SMatrix<f64, S, S>) -> Option<(f64, usize)> {
    const ROUNDS: usize = 12;
    let inverse = matrix.cholesky()?.inverse();
    // The column with the largest diagonal leans towards the wanted vector already.
    let mut vector: SVector<f64, S> = inverse.column(inverse.diagonal().imax()).into_owned();
    let mut largest = 0.0;
    for _ in 0..ROUNDS {
        vector /= vector.norm();
        let next = inverse * vector;
        largest = vector.dot(&next);
        vector = next;
    }
    (largest.is_finite() && largest > 0.0).then(|| (1.0 / largest, vector.iamax()))
}

/// Inverse of a symmetric positive definite matrix whose rows differ widely in scale.
pub(super) fn inverse_scaled<const M: usize>(matrix: SMatrix<f64, M, M>) -> Option<SMatrix<f64, M, M>> {
    let mut scale = SVector::<f64, M>::zeros();
    for k in 0..M {
        if matrix[(k, k)] <= 0.0 {
            return None;
        }
        scale[k] = 1.0 / matrix[(k, k)].sqrt();
    }
    let scaled = SMatrix::<f64, M, M>::from_fn(|i, j| scale[i] * scale[j] * matrix[(i, j)]);
    let inverse = scaled.cholesky()?.inverse();
    Some(SMatrix::from_fn(|i, j| scale[i] * scale[j] * inverse[(i, j)]))
}

impl<const N: usize> State<N> {
    fn moved<const S: usize>(
        &self,
        model: &LensModel,
        shared: &SVector<f64, S>,
        poses: &[Vector6<f64>],
    ) -> Option<Self> {
        let mut interior = self.interior;
        interior.iter_mut().zip(shared.iter()).for_each(|(value, step)| *value += step);
        if let Some(ratio) = model.aspect {
            interior[FX] = ratio * interior[FY];
        }
        if !(interior[FX] > 0.0 && interior[FY] > 0.0) {
            return None;
        }
        let mut board = self.board;
        board.iter_mut().zip(shared.iter().skip(N)).for_each(|(value, step)| *value += step);
        let poses = self
            .poses
            .iter()
            .zip(poses)
            .map(|(pose, step)| BoardPose {
                rotation: Rotation3::new(step.fixed_rows::<3>(0).into_owned()) * pose.rotation,
                translation: pose.translation + step.fixed_rows::<3>(3),
            })
            .collect();
        Some(Self { interior, board, poses })
    }
}

/// A finished adjustment.
pub(super) struct Adjusted<const N: usize, const S: usize> {
    pub state: State<N>,
    pub iterations: usize,
    /// Σ weight · ‖residual‖², px².
    pub cost: f64,
    normal: NormalEquations<S>,
}

impl<const N: usize, const S: usize> Adjusted<N, S> {
    /// Cofactors of what was estimated.
    pub fn cofactors(&self, problem: &Problem) -> Result<Cofactors<S>, AdjustError> {
        self.normal.cofactors(&problem.free::<N, S>())
    }
}

/// From a start to the least cost: first on a part of the points, where there are plenty, then on all.
pub(super) fn adjust<L: LensFunction<N>, const N: usize, const S: usize>(
    problem: &Problem,
    mut state: State<N>,
) -> Result<Adjusted<N, S>, AdjustError> {
    /// Points of a view that bring it near its place.
    const COARSE_POINTS: usize = 16;
    /// The coarse stage need not come nearer to its end than its own noise.
    const COARSE_REST: f64 = 1e-2;
    /// A step of a millionth leaves less than that of a standard deviation.
    const REST: f64 = 1e-6;
    let (mut iterations, mut damping) = (0, 1e-3);
    if let Some(coarse) = problem.thinned(COARSE_POINTS)
        && let Ok(adjusted) = minimise::<L, N, S>(&coarse, state.clone(), damping, COARSE_REST)
    {
        // Near its end the adjustment needs no damping.
        (iterations, damping) = (adjusted.iterations, 1e-8);
        state = adjusted.state;
    }
    let mut adjusted = minimise::<L, N, S>(problem, state, damping, REST)?;
    adjusted.iterations += iterations;
    Ok(adjusted)
}

/// Levenberg–Marquardt until a step would change the residuals by less than `rest` of themselves.
fn minimise<L: LensFunction<N>, const N: usize, const S: usize>(
    problem: &Problem,
    mut state: State<N>,
    mut damping: f64,
    rest: f64,
) -> Result<Adjusted<N, S>, AdjustError> {
    const MAX_STEPS: usize = 300;
    const LARGEST_DAMPING: f64 = 1e14;
    let mut normal = NormalEquations::<S>::at::<L, N>(problem, &state).ok_or(AdjustError::NoImage)?;
    let mut iterations = 0;
    while iterations < MAX_STEPS {
        iterations += 1;
        // A step that would change the residuals by less than that share of themselves, or by less than
        // 1e-10 px over all points, is the end, also when rounding hides whether it still lowers the cost.
        let at_rest = |length: f64, share: f64| length <= share * normal.cost.sqrt() + 1e-10;
        let step = normal.step(damping);
        let trial = step.as_ref().and_then(|(shared, poses, length)| {
            let next = state.moved(&problem.model, shared, poses)?;
            let next_normal = NormalEquations::<S>::at::<L, N>(problem, &next)?;
            Some((next, next_normal, *length))
        });
        match trial {
            Some((next, next_normal, length)) if next_normal.cost < normal.cost => {
                let done = at_rest(length, rest);
                state = next;
                normal = next_normal;
                // Undamped near the solution, so that convergence is quadratic.
                damping = if damping < 1e-9 { 0.0 } else { damping * 0.1 };
                if done {
                    return Ok(Adjusted { state, iterations, cost: normal.cost, normal });
                }
            }
            Some((_, _, length)) if damping < 1e-3 && at_rest(length, rest) => {
                return Ok(Adjusted { state, iterations, cost: normal.cost, normal });
            }
            _ => {
                damping = (damping * 10.0).max(1e-9);
                if damping > LARGEST_DAMPING {
                    break;
                }
            }
        }
    }
    let rms_px = (normal.cost / problem.points() as f64).sqrt();
    Err(AdjustError::NotConverged { iterations, rms_px })
}
