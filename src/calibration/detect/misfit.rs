//! Points of the board that do not lie where those around them say.

use super::plane::{homography, mapped};
use nalgebra::{Matrix3, Vector2};

/// Points up to this far away, in steps, make up the local homography: far enough to see perspective, near
/// enough to follow the lens.
const REACH: f64 = 2.9;
/// Fewest points for it.
const LEAST: usize = 8;
/// Rounds in which misfits are left out.
const MAX_ROUNDS: usize = 12;
/// A point's distance from where the others put it is allowed at least and at most this, in steps ...
const LEAST_MISS: f64 = 0.015;
const MOST_MISS: f64 = 0.12;
/// ... and within these bounds this many times the median.
pub(super) const USUAL: f64 = 6.0;

/// A point of the board, any unit, and its pixel.
pub(super) type Pair = (Vector2<f64>, Vector2<f64>);

/// Board to image around a point, from the points near it; the point is the origin on the board.
///
/// - `step`: distance of neighbours on the board.
/// - `asked`: which points may be among them.
pub(super) fn local(
    pairs: &[Pair],
    at: usize,
    step: f64,
    asked: impl Fn(usize) -> bool,
) -> Option<Matrix3<f64>> {
    let offsets = || {
        let others = pairs.iter().enumerate().filter(|&(other, _)| asked(other));
        others.map(|(_, pair)| (pair.0 - pairs[at].0, pair.1))
    };
    let wanted = LEAST.min(offsets().count());
    let mut reach = REACH * step;
    loop {
        let near: Vec<Pair> = offsets().filter(|(offset, _)| offset.norm() <= reach).collect();
        if near.len() >= wanted {
            return homography(&near);
        }
        reach *= 1.5;
    }
}

/// How far each point is from where the others put it, as a multiple of what is allowed; the homographies of
/// the others. Where there is none, nothing is known against the point.
///
/// - `independent`: whether two points were located independently; only such judge each other.
pub(super) fn misfits(
    pairs: &[Pair],
    step: f64,
    independent: impl Fn(usize, usize) -> bool,
) -> Vec<(f64, Option<Matrix3<f64>>)> {
    let locals: Vec<Option<Matrix3<f64>>> =
        (0..pairs.len()).map(|at| local(pairs, at, step, |other| independent(at, other))).collect();
    let misses: Vec<Option<(f64, f64)>> = pairs
        .iter()
        .zip(&locals)
        .map(|(pair, h)| {
            let h = h.as_ref()?;
            let here = mapped(h, Vector2::zeros());
            let beside = mapped(h, Vector2::new(step, 0.0)) - here;
            let below = mapped(h, Vector2::new(0.0, step)) - here;
            Some(((pair.1 - here).norm(), beside.norm().min(below.norm())))
        })
        .collect();
    let usual = median(misses.iter().flatten().map(|miss| miss.0));
    let misfit =
        |(miss, pitch): (f64, f64)| miss / (USUAL * usual).clamp(LEAST_MISS * pitch, MOST_MISS * pitch);
    misses.into_iter().zip(locals).map(|(miss, h)| (miss.map_or(0.0, misfit), h)).collect()
}

/// Which points stay when those whose misfit is above 1 go. What is wrong disturbs its neighbours: only the
/// worst among neighbours go, then all is seen anew.
///
/// - `misfits`: of the points that are still there.
pub(super) fn fitting(pairs: &[Pair], step: f64, misfits: impl Fn(&[usize]) -> Vec<f64>) -> Vec<bool> {
    let mut kept = vec![true; pairs.len()];
    for _ in 0..MAX_ROUNDS {
        let at: Vec<usize> = (0..pairs.len()).filter(|&k| kept[k]).collect();
        let misfits = misfits(&at);
        let worst = |k: usize| {
            let near = |other: usize| (pairs[at[other]].0 - pairs[at[k]].0).norm() <= REACH * step;
            misfits[k] > 1.0 && (0..at.len()).all(|other| misfits[other] <= misfits[k] || !near(other))
        };
        let dropped: Vec<usize> = (0..at.len()).filter(|&k| worst(k)).map(|k| at[k]).collect();
        if dropped.is_empty() {
            break;
        }
        dropped.into_iter().for_each(|k| kept[k] = false);
    }
    kept
}

/// Which points lie where those around them say. See [`misfits`].
pub(super) fn in_place(pairs: &[Pair], step: f64, independent: impl Fn(usize, usize) -> bool) -> Vec<bool> {
    fitting(pairs, step, |at| {
        let there: Vec<Pair> = at.iter().map(|&k| pairs[k]).collect();
        let misfits = misfits(&there, step, |a, b| independent(at[a], at[b]));
        misfits.into_iter().map(|(misfit, _)| misfit).collect()
    })
}

/// The middle value, 0 of none.
pub(super) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_points_off_their_places_are_left_out_and_no_others() {
        let truth = Matrix3::new(30.0, -3.0, 200.0, 4.0, 25.0, 90.0, 0.01, -0.02, 1.0);
        let mut pairs: Vec<Pair> = (0..48)
            .map(|k| Vector2::new(f64::from(k % 8), f64::from(k / 8)))
            .map(|p| (p, mapped(&truth, p) + Vector2::new((p.x * 7.3).sin(), (p.y * 5.1).sin()) * 0.02))
            .collect();
        for at in [0, 19, 20] {
            pairs[at].1.x += 2.5;
        }
        let kept = in_place(&pairs, 1.0, |a, b| a != b);
        let dropped: Vec<usize> = (0..48).filter(|&k| !kept[k]).collect();
        assert_eq!(dropped, [0, 19, 20]);
    }
}
