//! The mapping between a plane and its image, fitted to points.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Homography that takes each pair's first point to its second, by least squares; `None` when the points do
/// not determine it or lie on both sides of the plane's horizon.
pub(super) fn homography(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Matrix3<f64>> {
    if pairs.len() < 4 {
        return None;
    }
    let (from, to) = (normaliser(pairs.iter().map(|p| p.0))?, normaliser(pairs.iter().map(|p| p.1))?);
    let apply = |(centre, scale): &(Vector2<f64>, f64), p: Vector2<f64>| (p - centre) * *scale;
    // Unknowns h11 h12 h13, h21 h22 h23, h31 h32 with h33 = 1. The first two blocks of the normal equations are
    // alike and do not mix.
    let mut block = Matrix3::zeros();
    let mut mixed = SMatrix::<f64, 6, 2>::zeros();
    let mut last = Matrix2::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    for pair in pairs {
        let (a, b) = (apply(&from, pair.0), apply(&to, pair.1));
        let along = a.push(1.0);
        let product = along * along.transpose();
        block += product;
        for (at, seen) in [(0, b.x), (3, b.y)] {
            for i in 0..3 {
                for j in 0..2 {
                    mixed[(at + i, j)] -= seen * product[(i, j)];
                }
                right[at + i] += seen * along[i];
            }
        }
        let square = b.norm_squared();
        last += a * a.transpose() * square;
        right[6] -= square * a.x;
        right[7] -= square * a.y;
    }
    let mut matrix = SMatrix::<f64, 8, 8>::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&block);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&block);
    matrix.fixed_view_mut::<2, 6>(6, 0).copy_from(&mixed.transpose());
    matrix.fixed_view_mut::<2, 2>(6, 6).copy_from(&last);
    // Only the lower triangle is read.
    let h = matrix.cholesky()?.solve(&right);
    let middle = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0);
    let into = Matrix3::new(from.1, 0.0, -from.1 * from.0.x, 0.0, from.1, -from.1 * from.0.y, 0.0, 0.0, 1.0);
    let back = Matrix3::new(1.0 / to.1, 0.0, to.0.x, 0.0, 1.0 / to.1, to.0.y, 0.0, 0.0, 1.0);
    let whole = back * middle * into;
    let in_front = pairs.iter().all(|(a, _)| (whole * a.push(1.0)).z > 1e-9);
    (in_front && whole.iter().all(|v| v.is_finite())).then_some(whole)
}

/// Where a homography takes a point.
pub(super) fn mapped(homography: &Matrix3<f64>, p: Vector2<f64>) -> Vector2<f64> {
    let q: Vector3<f64> = homography * p.push(1.0);
    Vector2::new(q.x / q.z, q.y / q.z)
}

/// Mean of points and the factor that makes their root mean square distance from it 1.
fn normaliser(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<(Vector2<f64>, f64)> {
    let n = points.clone().count() as f64;
    let mean = points.clone().sum::<Vector2<f64>>() / n;
    let spread = (points.map(|p| (p - mean).norm_squared()).sum::<f64>() / n).sqrt();
    (spread > 1e-12 && spread.is_finite()).then_some((mean, 1.0 / spread))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_homography_comes_back_from_its_points() {
        let truth = Matrix3::new(90.0, -8.0, 300.0, 12.0, 70.0, 200.0, 0.05, -0.08, 1.0);
        let points = (0..9).map(|k| Vector2::new(f64::from(k % 3), f64::from(k / 3)));
        let pairs: Vec<_> = points.map(|p| (p, mapped(&truth, p))).collect();
        let found = homography(&pairs).unwrap();
        let there = Vector2::new(2.5, -1.0);
        assert!((mapped(&found, there) - mapped(&truth, there)).norm() < 1e-6);
    }

    #[test]
    fn points_on_a_line_or_at_one_place_give_none() {
        let line: Vec<_> = (0..6).map(|k| Vector2::repeat(f64::from(k))).map(|p| (p, p * 3.0)).collect();
        assert!(homography(&line).is_none());
        assert!(homography(&[(Vector2::zeros(), Vector2::zeros()); 5]).is_none());
    }
}
