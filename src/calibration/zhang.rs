//! Closed forms: homographies, interior orientation, poses and two lens terms.
//!
//! # Source
//! Zhang (2000), "A Flexible New Technique for Camera Calibration", sections 3.1 and 3.3 and appendices A
//! and B. Pixels are taken about the image centre in units of the image size first.

use super::product::ViewPoints;
use crate::camera::Interior;
use nalgebra::{Matrix2, Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};

/// Which closed form gave the start of the adjustment: the one with the least cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClosedForm {
    /// All five parameters of the affine image plane.
    WithSkew,
    /// Skew zero.
    NoSkew,
    /// Skew zero, principal point at the image centre.
    Centred,
    /// Poses in closed form for a ladder of focal lengths, principal point at the image centre.
    Ladder,
}

/// Pose of a board in a view: `camera = rotation · board + translation`.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoardPose {
    pub rotation: Rotation3<f64>,
    pub translation: Vector3<f64>,
}

/// Homography H with `bearing ∥ H (x, y, 1)`; `None` when the board's points lie on a line.
///
/// Direct linear transform: Σ ‖bearing × H (x, y, 1)‖² is least for ‖H‖ = 1, the board's points shifted to
/// their centroid and scaled to spread 1 (Hartley). Bearings may point anywhere, backwards too.
pub(super) fn homography(points: &[(Vector2<f64>, Vector3<f64>)]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean = points.iter().map(|(board, _)| board).sum::<Vector2<f64>>() / n;
    let mut spread = Matrix2::zeros();
    for (board, _) in points {
        spread += (board - mean) * (board - mean).transpose();
    }
    const ON_A_LINE: f64 = 1e-8;
    let size = spread.trace();
    if size.is_nan() || size <= 0.0 || spread.determinant() < ON_A_LINE * size * size {
        return None;
    }
    let scale = (n / size).sqrt();
    // Σ (‖d‖² I − d dᵀ) ⊗ b bᵀ, its upper triangle of blocks.
    let mut ata = SMatrix::<f64, 9, 9>::zeros();
    for (board, d) in points {
        let b = ((board - mean) * scale).push(1.0);
        let bb = b * b.transpose();
        let square = d.norm_squared();
        for i in 0..3 {
            for j in i..3 {
                let factor = if i == j { square - d[i] * d[i] } else { -d[i] * d[j] };
                let mut block = ata.fixed_view_mut::<3, 3>(3 * i, 3 * j);
                block += bb * factor;
            }
        }
    }
    ata.fill_lower_triangle_with_upper_triangle();
    let h = least_vector(ata)?;
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let to_unit = Matrix3::new(scale, 0.0, -scale * mean.x, 0.0, scale, -scale * mean.y, 0.0, 0.0, 1.0);
    let h = h * to_unit;
    // Bearings and board agree in direction, not only in line.
    let agreement: f64 = points.iter().map(|(board, d)| d.dot(&(h * board.push(1.0))).signum()).sum();
    Some(h * (agreement.signum() / h.norm()))
}

/// Unit vector that a symmetric positive semidefinite matrix shortens most, by inverse iteration.
fn least_vector<const M: usize>(mut matrix: SMatrix<f64, M, M>) -> Option<SVector<f64, M>> {
    const ROUNDS: u32 = 6;
    // Keeps the decomposition of an exactly singular matrix possible.
    const SHIFT: f64 = 1e-14;
    let shift = SHIFT * matrix.trace();
    for k in 0..M {
        matrix[(k, k)] += shift;
    }
    let cholesky = matrix.cholesky()?;
    let mut vector = SVector::<f64, M>::from_fn(|k, _| 1.0 + 0.1 * k as f64);
    for _ in 0..ROUNDS {
        cholesky.solve_mut(&mut vector);
        let norm = vector.norm();
        if !(norm.is_finite() && norm > 0.0) {
            return None;
        }
        vector /= norm;
    }
    Some(vector)
}

/// The affine image plane K in the units of the homographies, or `None` when this form gives no camera.
pub(super) fn interior(homographies: &[Matrix3<f64>], form: ClosedForm) -> Option<Matrix3<f64>> {
    // Unknowns b11 b12 b22 b13 b23 b33 of B = K⁻ᵀK⁻¹; those fixed at zero are left out.
    let unknown: [bool; 6] = match form {
        ClosedForm::WithSkew => [true; 6],
        ClosedForm::NoSkew => [true, false, true, true, true, true],
        ClosedForm::Centred | ClosedForm::Ladder => [true, false, true, false, false, true],
    };
    let mut vtv = SMatrix::<f64, 6, 6>::zeros();
    for h in homographies {
        let (one, two) = (h.column(0), h.column(1));
        // Views count alike whatever their scale.
        let scale = 1.0 / (one.norm() * two.norm());
        let row = |a: usize, b: usize| {
            let (a, b) = (h.column(a), h.column(b));
            SVector::<f64, 6>::new(
                a[0] * b[0],
                a[0] * b[1] + a[1] * b[0],
                a[1] * b[1],
                a[2] * b[0] + a[0] * b[2],
                a[2] * b[1] + a[1] * b[2],
                a[2] * b[2],
            ) * scale
        };
        for row in [row(0, 1), row(0, 0) - row(1, 1)] {
            vtv += row * row.transpose();
        }
    }
    let trace = vtv.trace();
    for k in (0..6).filter(|&k| !unknown[k]) {
        vtv.fill_row(k, 0.0);
        vtv.fill_column(k, 0.0);
        vtv[(k, k)] = trace;
    }
    let [b11, b12, b22, b13, b23, b33]: [f64; 6] = least_vector(vtv)?.into();
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

/// Pose of the board from K⁻¹ H (Zhang, section 3.1), with the two axes made orthogonal symmetrically.
pub(super) fn pose(homography: &Matrix3<f64>) -> Option<BoardPose> {
    let scale = 2.0 / (homography.column(0).norm() + homography.column(1).norm());
    let (r1, r2): (Vector3<f64>, Vector3<f64>) =
        (homography.column(0).normalize(), homography.column(1).normalize());
    let (sum, difference) = (r1 + r2, r1 - r2);
    let (sum, difference) =
        (sum.try_normalize(1e-9)? * 0.5_f64.sqrt(), difference.try_normalize(1e-9)? * 0.5_f64.sqrt());
    let (r1, r2) = (sum + difference, sum - difference);
    let translation = homography.column(2) * scale;
    translation.iter().all(|t| t.is_finite()).then(|| BoardPose {
        rotation: Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[r1, r2, r1.cross(&r2)])),
        translation,
    })
}

/// k1 and k2 by linear least squares (Zhang, section 3.3); zeros when they are not determined.
pub(super) fn radial_terms(interior: &Interior, poses: &[BoardPose], views: &[ViewPoints]) -> (f64, f64) {
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
