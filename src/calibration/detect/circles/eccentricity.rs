//! From the centre of an ellipse to the image of the circle's centre.
//!
//! A circle seen at a slant is an ellipse whose centre lies nearer to the camera's side of the board than the
//! image of the circle's centre, by up to a pixel for large discs. The difference follows from the homography
//! H around the disc: the dual conic of a circle of radius r about the origin, diag(r², r², −1), is seen as
//! H diag(r², r², −1) Hᵀ, and the last column of a dual conic is its centre.

use super::super::misfit::{Pair, USUAL, fitting, local, median, misfits};
use super::super::plane::mapped;
use super::outline::Ellipse;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Radii may differ by this share in any case.
const LEAST_CHANGE: f64 = 0.04;

/// A located circle of the board, both in units of the board and pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    /// Where its centre is on the board, any unit.
    pub board: Vector2<f64>,
    pub ellipse: Ellipse,
}

/// Whether each circle lies where its neighbours expect it and has the size of the others: one with something
/// in front of it does not. `step`: distance of neighbours on the board.
pub(super) fn consistent(placed: &[Placed], step: f64) -> Vec<bool> {
    let pairs: Vec<Pair> = placed.iter().map(|p| (p.board, p.ellipse.centre)).collect();
    fitting(&pairs, step, |at| {
        let there: Vec<Pair> = at.iter().map(|&k| pairs[k]).collect();
        let (misses, locals): (Vec<f64>, Vec<_>) = misfits(&there, step, |a, b| a != b).into_iter().unzip();
        let radii: Vec<Option<f64>> = at
            .iter()
            .zip(&locals)
            .map(|(&k, h)| h.as_ref().map(|h| (placed[k].ellipse.area() / plane_scale(h)).sqrt()))
            .collect();
        let usual = median(radii.iter().flatten().copied());
        let usual_change = median(radii.iter().flatten().map(|radius| (radius - usual).abs()));
        let allowed = (USUAL * usual_change).max(LEAST_CHANGE * usual);
        let change = |radius: &Option<f64>| radius.map_or(0.0, |radius| (radius - usual).abs() / allowed);
        misses.iter().zip(&radii).map(|(miss, radius)| miss.max(change(radius))).collect()
    })
}

/// Pixels² per unit² of the board around the origin.
fn plane_scale(h: &Matrix3<f64>) -> f64 {
    (h.determinant() / h[(2, 2)].powi(3)).abs()
}

/// Images of the circles' centres. `step`: distance of neighbours on the board.
pub(super) fn centres(placed: &[Placed], step: f64) -> Vec<Vector2<f64>> {
    let mut pairs: Vec<Pair> = placed.iter().map(|p| (p.board, p.ellipse.centre)).collect();
    // The homography is first fitted to centres of ellipses, then to those of circles.
    for _ in 0..2 {
        let locals: Vec<_> = (0..placed.len()).map(|at| local(&pairs, at, step, |_| true)).collect();
        let radius = radius(placed, &locals);
        for ((pair, placed), h) in pairs.iter_mut().zip(placed).zip(&locals) {
            if let Some(h) = h {
                pair.1 = placed.ellipse.centre + shift(h, radius);
            }
        }
    }
    pairs.into_iter().map(|pair| pair.1).collect()
}

/// Radius of the circles on the board, as the ellipses' areas show it.
fn radius(placed: &[Placed], local: &[Option<Matrix3<f64>>]) -> f64 {
    let squares = placed.iter().zip(local).filter_map(|(p, h)| {
        let square = p.ellipse.area() / (std::f64::consts::PI * plane_scale(h.as_ref()?));
        square.is_finite().then_some(square)
    });
    median(squares).sqrt()
}

/// Image of the centre of a circle at the origin minus the centre of its ellipse.
fn shift(h: &Matrix3<f64>, radius: f64) -> Vector2<f64> {
    let circle = Matrix3::from_diagonal(&Vector3::new(radius * radius, radius * radius, -1.0));
    let dual = h * circle * h.transpose();
    let ellipse = Vector2::new(dual[(0, 2)], dual[(1, 2)]) / dual[(2, 2)];
    mapped(h, Vector2::zeros()) - ellipse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shift_is_that_of_points_on_the_circle() {
        let h = Matrix3::new(90.0, -8.0, 300.0, 12.0, 70.0, 200.0, 0.09, -0.12, 1.0);
        let radius = 1.3;
        // The chord through the centre along the direction of steepest perspective is an axis of symmetry of
        // nothing, but the middle of any pair of parallel tangents' points of contact is the ellipse's centre:
        // extremes in column and row do.
        let seen: Vec<_> = (0..40_000)
            .map(|k| f64::from(k) * std::f64::consts::TAU / 40_000.0)
            .map(|t| mapped(&h, Vector2::new(t.cos(), t.sin()) * radius))
            .collect();
        let (low, high) = seen.iter().fold((seen[0], seen[0]), |(l, u), p| (l.inf(p), u.sup(p)));
        let expected = mapped(&h, Vector2::zeros()) - 0.5 * (low + high);
        assert!(expected.norm() > 1.0);
        assert!((shift(&h, radius) - expected).norm() < 1e-4);
    }
}
