//! From the centre of an ellipse to the image of the circle's centre.
//!
//! A circle seen at a slant is an ellipse whose centre lies nearer to the camera's side of the board than the
//! image of the circle's centre, by up to a pixel for large discs. The difference follows from the homography
//! H around the disc: the dual conic of a circle of radius r about the origin, diag(r², r², −1), is seen as
//! H diag(r², r², −1) Hᵀ, and the last column of a dual conic is its centre.

use super::super::plane::{homography, mapped};
use super::outline::Ellipse;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Circles up to this far away, in steps, make up the local homography: far enough to see perspective, near
/// enough to follow the lens.
const REACH: f64 = 2.9;
/// Fewest circles for it.
const LEAST: usize = 8;
/// A circle's distance from where the others put it is allowed at least and at most this, in steps ...
const LEAST_MISS: f64 = 0.015;
const MOST_MISS: f64 = 0.12;
/// ... and within these bounds, as its change of size, this many times the median.
const USUAL: f64 = 6.0;
/// Radii may differ by this share in any case.
const LEAST_CHANGE: f64 = 0.04;
/// Rounds in which misfits are left out.
const MAX_ROUNDS: usize = 12;

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
    let mut kept = vec![true; placed.len()];
    // What is wrong disturbs its neighbours: only the worst among neighbours go, then all is seen anew.
    for _ in 0..MAX_ROUNDS {
        let at: Vec<usize> = (0..placed.len()).filter(|&k| kept[k]).collect();
        let there: Vec<Placed> = at.iter().map(|&k| placed[k]).collect();
        let misfits = misfits(&there, step);
        let worst = |k: usize| {
            misfits[k] > 1.0
                && there.iter().zip(&misfits).all(|(other, misfit)| {
                    (other.board - there[k].board).norm() > REACH * step || *misfit <= misfits[k]
                })
        };
        let dropped: Vec<usize> = (0..there.len()).filter(|&k| worst(k)).map(|k| at[k]).collect();
        if dropped.is_empty() {
            break;
        }
        dropped.into_iter().for_each(|k| kept[k] = false);
    }
    kept
}

/// How far each circle is from fitting in with the others, as a multiple of what is allowed.
fn misfits(placed: &[Placed], step: f64) -> Vec<f64> {
    let centres: Vec<_> = placed.iter().map(|p| p.ellipse.centre).collect();
    let seen: Vec<Option<(f64, f64, f64)>> = (0..placed.len())
        .map(|at| {
            let h = homography(&nearby(placed, &centres, at, step, false))?;
            let here = mapped(&h, Vector2::zeros());
            let beside = mapped(&h, Vector2::new(step, 0.0)) - here;
            let below = mapped(&h, Vector2::new(0.0, step)) - here;
            let radius = (placed[at].ellipse.area() / plane_scale(&h)).sqrt();
            Some(((centres[at] - here).norm(), beside.norm().min(below.norm()), radius))
        })
        .collect();
    let usual_miss = median(seen.iter().flatten().map(|s| s.0));
    let usual_radius = median(seen.iter().flatten().map(|s| s.2));
    let usual_change = median(seen.iter().flatten().map(|s| (s.2 - usual_radius).abs()));
    let misfit = |&(miss, pitch, radius): &(f64, f64, f64)| {
        let allowed_miss = (USUAL * usual_miss).clamp(LEAST_MISS * pitch, MOST_MISS * pitch);
        let allowed_change = (USUAL * usual_change).max(LEAST_CHANGE * usual_radius);
        (miss / allowed_miss).max((radius - usual_radius).abs() / allowed_change)
    };
    seen.iter().map(|s| s.as_ref().map_or(0.0, misfit)).collect()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Pixels² per unit² of the board around the origin.
fn plane_scale(h: &Matrix3<f64>) -> f64 {
    (h.determinant() / h[(2, 2)].powi(3)).abs()
}

/// Images of the circles' centres. `step`: distance of neighbours on the board.
pub(super) fn centres(placed: &[Placed], step: f64) -> Vec<Vector2<f64>> {
    let mut centres: Vec<_> = placed.iter().map(|p| p.ellipse.centre).collect();
    // The homography is first fitted to centres of ellipses, then to those of circles.
    for _ in 0..2 {
        let local: Vec<Option<Matrix3<f64>>> =
            (0..placed.len()).map(|at| homography(&nearby(placed, &centres, at, step, true))).collect();
        let radius = radius(placed, &local);
        for (at, h) in local.iter().enumerate() {
            if let Some(h) = h {
                centres[at] = placed[at].ellipse.centre + shift(h, radius);
            }
        }
    }
    centres
}

/// Neighbours' places on the board, seen from the circle, and their pixels.
fn nearby(
    placed: &[Placed],
    centres: &[Vector2<f64>],
    at: usize,
    step: f64,
    with_itself: bool,
) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let offsets = || {
        placed
            .iter()
            .zip(centres)
            .enumerate()
            .filter(|&(other, _)| with_itself || other != at)
            .map(|(_, (p, centre))| (p.board - placed[at].board, *centre))
    };
    let mut reach = REACH * step;
    loop {
        let near: Vec<_> = offsets().filter(|(offset, _)| offset.norm() <= reach).collect();
        if near.len() >= LEAST.min(placed.len() - usize::from(!with_itself)) {
            return near;
        }
        reach *= 1.5;
    }
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
