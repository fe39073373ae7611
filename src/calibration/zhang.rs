//! Closed-form start: homographies of the views, then interior orientation, poses and two lens terms.
//!
//! # Source
//! Zhang (2000), "A Flexible New Technique for Camera Calibration", sections 3.1 and 3.3 and appendices A
//! and B. Pixels are taken about the image centre in units of the image size first.

use super::product::ViewPoints;
use super::target::Observation;
use crate::units::Radians;
use nalgebra::{DMatrix, Matrix2, Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};

/// Board normals closer than this give the same constraint on the camera twice.
const PARALLEL: Radians = Radians::from_degrees(2.0);

/// Which closed form gave the start of the adjustment: the one with the least cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClosedForm {
    /// All five parameters of the affine image plane.
    WithSkew,
    /// Skew zero.
    NoSkew,
    /// Skew zero, principal point at the image centre.
    Centred,
}

/// Why there is no closed-form start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StartError {
    /// Too few views.
    #[error("{views} usable views, at least 3 are needed; photograph the target from more directions")]
    TooFewViews {
        /// Views given.
        views: usize,
    },
    /// A view with too few points.
    #[error("view {view} has {points} points, at least 6 that are not on one line are needed")]
    TooFewPoints {
        /// Name of the photo.
        view: String,
        /// Points given.
        points: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("view {view} has a point that is not finite")]
    NotFinite {
        /// Name of the photo.
        view: String,
    },
    /// The board was parallel to itself in too many views.
    #[error(
        "the board stood in only {directions} different direction(s) ({widest_deg:.1}° apart at most), \
         {needed} are needed; tilt the target by 20° to 45° to different sides"
    )]
    Parallel {
        /// Directions of the board's normal more than 2° apart.
        directions: usize,
        /// Largest angle between two normals, degrees.
        widest_deg: f64,
        /// Directions needed.
        needed: usize,
    },
    /// No camera explains the homographies.
    #[error("no camera explains the views: the points are labelled wrongly, or the target is not flat")]
    NoCamera,
}

/// Pose of a board in a view: `camera = rotation · board + translation`.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoardPose {
    pub rotation: Rotation3<f64>,
    pub translation: Vector3<f64>,
}

/// A start for the adjustment.
#[derive(Debug, Clone)]
pub(super) struct Start {
    pub form: ClosedForm,
    pub interior: [f64; 10],
    pub poses: Vec<BoardPose>,
}

/// Candidate starts, for the adjustment to choose from by their cost.
pub(super) fn starts(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    skew: bool,
) -> Result<Vec<Start>, StartError> {
    if views.len() < 3 {
        return Err(StartError::TooFewViews { views: views.len() });
    }
    let centre = Vector2::new(0.5 * (f64::from(width) - 1.0), 0.5 * (f64::from(height) - 1.0));
    let unit = f64::from(width.max(height));
    let mut homographies = Vec::with_capacity(views.len());
    for view in views {
        let finite = view
            .observations
            .iter()
            .all(|o| [o.board.x_m, o.board.y_m, o.pixel.column, o.pixel.row].iter().all(|v| v.is_finite()));
        if !finite {
            return Err(StartError::NotFinite { view: view.name.clone() });
        }
        let homography = homography(&view.observations, centre, unit);
        homographies.push(homography.ok_or_else(|| StartError::TooFewPoints {
            view: view.name.clone(),
            points: view.observations.len(),
        })?);
    }
    // Two directions fix a camera without skew, three one with it.
    directions(&homographies, if skew { 3 } else { 2 })?;
    let mut forms = vec![ClosedForm::NoSkew, ClosedForm::Centred];
    if skew {
        forms.insert(0, ClosedForm::WithSkew);
    }
    let mut starts = Vec::new();
    for form in forms {
        let Some(k) = interior(&homographies, form) else {
            continue;
        };
        let Some(poses) = homographies.iter().map(|h| pose(&k, h)).collect::<Option<Vec<_>>>() else {
            continue;
        };
        let plain = [
            k[(0, 0)] * unit,
            k[(1, 1)] * unit,
            k[(0, 1)] * unit,
            k[(0, 2)] * unit + centre.x,
            k[(1, 2)] * unit + centre.y,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ];
        let mut with_lens = plain;
        (with_lens[5], with_lens[6]) = radial_terms(&plain, &poses, views);
        for interior in [with_lens, plain] {
            starts.push(Start { form, interior, poses: poses.clone() });
        }
    }
    if starts.is_empty() { Err(StartError::NoCamera) } else { Ok(starts) }
}

/// Homography from board (m) to centred pixels in units of the image size; `None` when undetermined.
///
/// Direct linear transform with both sides shifted to their centroid and scaled to spread 1 (Hartley).
fn homography(observations: &[Observation], centre: Vector2<f64>, unit: f64) -> Option<Matrix3<f64>> {
    if observations.len() < 6 {
        return None;
    }
    let board: Vec<_> = observations.iter().map(|o| Vector2::new(o.board.x_m, o.board.y_m)).collect();
    let image: Vec<_> =
        observations.iter().map(|o| (Vector2::new(o.pixel.column, o.pixel.row) - centre) / unit).collect();
    let normalise = |points: &[Vector2<f64>]| {
        let n = points.len() as f64;
        let mean = points.iter().sum::<Vector2<f64>>() / n;
        let spread = (points.iter().map(|p| (p - mean).norm_squared()).sum::<f64>() / n).sqrt();
        (spread > 0.0).then(|| {
            let s = 1.0 / spread;
            Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0)
        })
    };
    let (board_norm, image_norm) = (normalise(&board)?, normalise(&image)?);
    let mut ata = SMatrix::<f64, 9, 9>::zeros();
    for (b, i) in board.iter().zip(&image) {
        let b = board_norm * b.push(1.0);
        let i = image_norm * i.push(1.0);
        let rows = [
            SVector::<f64, 9>::from_column_slice(&[
                b.x,
                b.y,
                1.0,
                0.0,
                0.0,
                0.0,
                -i.x * b.x,
                -i.x * b.y,
                -i.x,
            ]),
            SVector::<f64, 9>::from_column_slice(&[
                0.0,
                0.0,
                0.0,
                b.x,
                b.y,
                1.0,
                -i.y * b.x,
                -i.y * b.y,
                -i.y,
            ]),
        ];
        for row in rows {
            ata += row * row.transpose();
        }
    }
    let eigen = ata.symmetric_eigen();
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    // A second vanishing value means points on a line.
    if eigen.eigenvalues[order[1]] < 1e-10 * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let h = image_norm.try_inverse()? * h * board_norm;
    // The board lies in front of the camera: its points have a positive third coordinate.
    let depth = (h * board[0].push(1.0)).z;
    Some(h * (depth.signum() / h.norm()))
}

/// Counts the directions of the board's normal.
///
/// Parallel boards share their vanishing line, hence the normal computed with any interior orientation:
/// a nominal one will do before the true one is known.
fn directions(homographies: &[Matrix3<f64>], needed: usize) -> Result<(), StartError> {
    const NOMINAL_FOCAL: f64 = 1.0;
    let back = Matrix3::from_diagonal(&Vector3::new(1.0 / NOMINAL_FOCAL, 1.0 / NOMINAL_FOCAL, 1.0));
    let normals: Vec<Vector3<f64>> =
        homographies.iter().map(|h| (back * h.column(0)).cross(&(back * h.column(1))).normalize()).collect();
    let angle = |a: &Vector3<f64>, b: &Vector3<f64>| a.cross(b).norm().atan2(a.dot(b).abs());
    let mut kept: Vec<Vector3<f64>> = Vec::new();
    let mut widest = 0.0_f64;
    for (i, normal) in normals.iter().enumerate() {
        for other in &normals[..i] {
            widest = widest.max(angle(normal, other));
        }
        if kept.iter().all(|other| angle(normal, other) > PARALLEL.get()) {
            kept.push(*normal);
        }
    }
    let directions = kept.len();
    if directions < needed {
        let widest_deg = Radians::new(widest).degrees();
        return Err(StartError::Parallel { directions, widest_deg, needed });
    }
    Ok(())
}

/// The affine image plane K in the units of the homographies, or `None` when this form gives no camera.
fn interior(homographies: &[Matrix3<f64>], form: ClosedForm) -> Option<Matrix3<f64>> {
    // Unknowns b11 b12 b22 b13 b23 b33 of B = K⁻ᵀK⁻¹; those fixed at zero are left out.
    let free: &[usize] = match form {
        ClosedForm::WithSkew => &[0, 1, 2, 3, 4, 5],
        ClosedForm::NoSkew => &[0, 2, 3, 4, 5],
        ClosedForm::Centred => &[0, 2, 5],
    };
    let mut v = DMatrix::zeros(2 * homographies.len(), free.len());
    for (view, h) in homographies.iter().enumerate() {
        let (h1, h2) = (h.column(0), h.column(1));
        // Views count alike whatever their scale.
        let scale = 1.0 / (h1.norm() * h2.norm());
        let row = |a: &dyn Fn(usize) -> f64, b: &dyn Fn(usize) -> f64| {
            [
                a(0) * b(0),
                a(0) * b(1) + a(1) * b(0),
                a(1) * b(1),
                a(2) * b(0) + a(0) * b(2),
                a(2) * b(1) + a(1) * b(2),
                a(2) * b(2),
            ]
        };
        let (one, two) = (|i: usize| h1[i], |i: usize| h2[i]);
        let (v12, v11, v22) = (row(&one, &two), row(&one, &one), row(&two, &two));
        for (column, &unknown) in free.iter().enumerate() {
            v[(2 * view, column)] = scale * v12[unknown];
            v[(2 * view + 1, column)] = scale * (v11[unknown] - v22[unknown]);
        }
    }
    let svd = v.svd(false, true);
    let least = svd.singular_values.imin();
    let solution = svd.v_t?;
    let mut b = [0.0; 6];
    for (column, &unknown) in free.iter().enumerate() {
        b[unknown] = solution[(least, column)];
    }
    let [b11, b12, b22, b13, b23, b33] = b;
    let determinant = b11 * b22 - b12 * b12;
    let cy = (b12 * b13 - b11 * b23) / determinant;
    let lambda = b33 - (b13 * b13 + cy * (b12 * b13 - b11 * b23)) / b11;
    let fx_squared = lambda / b11;
    let fy_squared = lambda * b11 / determinant;
    if !(fx_squared > 0.0 && fy_squared > 0.0) {
        return None;
    }
    let (fx, fy) = (fx_squared.sqrt(), fy_squared.sqrt());
    let skew = -b12 * fx_squared * fy / lambda;
    let cx = skew * cy / fy - b13 * fx_squared / lambda;
    // Fields of view between 1° and 170°, and a principal point no farther out than the frame is wide.
    let plausible = |f: f64| (0.04..60.0).contains(&f);
    (plausible(fx) && plausible(fy) && cx.abs() < 1.0 && cy.abs() < 1.0 && skew.abs() < 0.2 * fx)
        .then(|| Matrix3::new(fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0))
}

/// Pose of the board from its homography (Zhang, section 3.1), with the nearest rotation (appendix C).
fn pose(k: &Matrix3<f64>, homography: &Matrix3<f64>) -> Option<BoardPose> {
    let m = k.try_inverse()? * homography;
    let scale = 2.0 / (m.column(0).norm() + m.column(1).norm());
    let (r1, r2) = (m.column(0) * scale, m.column(1) * scale);
    let svd = Matrix3::from_columns(&[r1, r2, r1.cross(&r2)]).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let turn = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    Some(BoardPose {
        rotation: Rotation3::from_matrix_unchecked(u * turn * v_t),
        translation: m.column(2) * scale,
    })
}

/// k1 and k2 by linear least squares (Zhang, section 3.3); zeros when they are not determined.
fn radial_terms(interior: &[f64; 10], poses: &[BoardPose], views: &[ViewPoints]) -> (f64, f64) {
    let [fx, fy, skew, cx, cy, ..] = *interior;
    let mut matrix = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for (pose, view) in poses.iter().zip(views) {
        for o in &view.observations {
            let p = pose.rotation * Vector3::new(o.board.x_m, o.board.y_m, 0.0) + pose.translation;
            let (x, y) = (p.x / p.z, p.y / p.z);
            let r2 = x * x + y * y;
            let offsets = [(fx * x + skew * y, o.pixel.column - cx), (fy * y, o.pixel.row - cy)];
            for (ideal, seen) in offsets {
                let row = Vector2::new(ideal * r2, ideal * r2 * r2);
                matrix += row * row.transpose();
                right += row * (seen - ideal);
            }
        }
    }
    let k = matrix.cholesky().map_or(Vector2::zeros(), |cholesky| cholesky.solve(&right));
    if k.iter().all(|v| v.is_finite()) { (k.x, k.y) } else { (0.0, 0.0) }
}
