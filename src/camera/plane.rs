//! What Brown's and the rational lens share: a radial factor and decentring on the ideal plane.

use super::ImagePoint;
use super::lens::{Projected, pixel_from_distorted};
use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};

/// Square of an ideal radius past which (89.94° off axis) a pinhole-type lens sees nothing.
pub(super) const FAR: f64 = 1e6;

/// Radial factor of a lens at one radius, and its derivative by r².
#[derive(Clone, Copy)]
pub(super) struct Radial {
    pub factor: f64,
    pub by_r2: f64,
}

/// (X/Z, Y/Z) of a point in front of the camera.
#[inline]
pub(super) fn ideal(point: &Vector3<f64>) -> Option<Vector2<f64>> {
    (point.z > 0.0).then(|| Vector2::new(point.x / point.z, point.y / point.z))
}

/// Distorted point and d(distorted)/d(ideal), which is symmetric.
#[inline]
pub(super) fn distort(ideal: Vector2<f64>, radial: Radial, p1: f64, p2: f64) -> (Vector2<f64>, Matrix2<f64>) {
    let (x, y) = (ideal.x, ideal.y);
    let r2 = x * x + y * y;
    let Radial { factor, by_r2 } = radial;
    let distorted = Vector2::new(
        x * factor + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * factor + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let cross = 2.0 * x * y * by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
    let jacobian = Matrix2::new(
        factor + 2.0 * x * x * by_r2 + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
        cross,
        factor + 2.0 * y * y * by_r2 + 6.0 * p1 * y + 2.0 * p2 * x,
    );
    (distorted, jacobian)
}

/// d(distorted)/d(p1) and d(distorted)/d(p2).
#[inline]
pub(super) fn decentring_terms(ideal: Vector2<f64>) -> [Vector2<f64>; 2] {
    let (x, y) = (ideal.x, ideal.y);
    let r2 = x * x + y * y;
    [Vector2::new(2.0 * x * y, r2 + 2.0 * y * y), Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y)]
}

/// d(column, row)/d(distorted).
#[inline]
pub(super) fn affine<const N: usize>(interior: &[f64; N]) -> Matrix2<f64> {
    Matrix2::new(interior[0], interior[2], 0.0, interior[1])
}

/// Distorted point of a pixel; `None` when the pixel is not finite.
#[inline]
pub(super) fn distorted_from_pixel<const N: usize>(
    interior: &[f64; N],
    pixel: ImagePoint,
) -> Option<Vector2<f64>> {
    if !(pixel.column.is_finite() && pixel.row.is_finite()) {
        return None;
    }
    let y = (pixel.row - interior[4]) / interior[1];
    Some(Vector2::new((pixel.column - interior[3] - interior[2] * y) / interior[0], y))
}

/// The part of a projection that does not depend on which lens terms there are: the columns of the lens
/// terms stay zero.
///
/// - `depth`: Z of the point.
/// - `d`, `jacobian`: distorted point and its derivative by the ideal one.
#[inline]
pub(super) fn project<const N: usize>(
    interior: &[f64; N],
    ideal: Vector2<f64>,
    depth: f64,
    d: Vector2<f64>,
    jacobian: &Matrix2<f64>,
) -> Projected<N> {
    let by_ideal = affine(interior) * jacobian / depth;
    let along = -(by_ideal * ideal);
    Projected {
        pixel: pixel_from_distorted(interior, d),
        by_point: Matrix2x3::from_columns(&[by_ideal.column(0).into(), by_ideal.column(1).into(), along]),
        by_interior: by_affine(d),
    }
}

/// d(column, row) by fx, fy, skew, cx, cy in the first five columns, zeros in the others.
#[inline]
pub(super) fn by_affine<const N: usize>(d: Vector2<f64>) -> SMatrix<f64, 2, N> {
    let mut by_interior = SMatrix::<f64, 2, N>::zeros();
    by_interior[(0, 0)] = d.x;
    by_interior[(1, 1)] = d.y;
    by_interior[(0, 2)] = d.y;
    by_interior[(0, 3)] = 1.0;
    by_interior[(1, 4)] = 1.0;
    by_interior
}
