//! Points that do not lie where their neighbours on the board say: something covered them, or a shadow's edge
//! passed for theirs.

use super::DetectedCorner;
use nalgebra::{Matrix6, Vector2, Vector6};
use std::collections::{BTreeMap, BTreeSet};

/// A point may be this far from where its neighbours expect it: a tilted board and a bending lens leave less
/// of the distance to the nearest neighbour, and noise leaves less than so many pixels.
const SHARE_OF_PITCH: f64 = 0.04;
const LEAST_PX: f64 = 0.6;
/// In photos that are worse, a multiple of the median miss.
const MEDIANS: f64 = 6.0;
/// A prediction needs this many neighbours.
const LEAST_NEIGHBOURS: usize = 8;

/// Removes stray points; of a square or tag all four corners go when one strays. Returns what was removed.
///
/// - `span`: rows and columns on each side from which neighbours are taken.
pub(super) fn without_strays(corners: &mut Vec<DetectedCorner>, span: usize) -> Vec<(usize, usize)> {
    const ROUNDS: usize = 8;
    let mut removed = BTreeSet::new();
    for _ in 0..ROUNDS {
        let misses = misses(corners, span);
        let mut sorted: Vec<f64> = misses.iter().flatten().map(|m| m.px / m.reach).collect();
        if sorted.is_empty() {
            break;
        }
        sorted.sort_by(f64::total_cmp);
        let usual = MEDIANS * sorted[sorted.len() / 2];
        // A stray point spoils its neighbours' predictions: of those around it only the worst goes at once.
        let mut strays = BTreeMap::new();
        for (corner, miss) in corners.iter().zip(&misses) {
            if let Some(Miss { px, pitch, reach }) = *miss {
                let excess = px / (reach * usual.max(LEAST_PX).max(SHARE_OF_PITCH * pitch));
                let worst = strays.entry((corner.row, corner.column)).or_insert(0.0_f64);
                *worst = worst.max(excess);
            }
        }
        let near = |at: usize| at.saturating_sub(span)..=at + span;
        let is_worst = |&(row, column): &(usize, usize), excess: f64| {
            let mut around = near(row).flat_map(|r| near(column).map(move |c| (r, c)));
            around.all(|place| strays.get(&place).is_none_or(|&other| other <= excess))
        };
        let worst: Vec<_> = strays
            .iter()
            .filter(|&(place, &e)| e > 1.0 && is_worst(place, e))
            .map(|(place, _)| *place)
            .collect();
        if worst.is_empty() {
            break;
        }
        corners.retain(|c| !worst.contains(&(c.row, c.column)));
        removed.extend(worst);
    }
    removed.into_iter().collect()
}

/// How far a point is from where its neighbours expect it.
#[derive(Clone, Copy)]
struct Miss {
    /// That distance, px.
    px: f64,
    /// Distance to the nearest neighbour, px.
    pitch: f64,
    /// How far the expectation reaches beyond the neighbours: 1 among them; more at the board's border and most at
    /// its corners, where what the surface cannot follow grows with the same factor.
    reach: f64,
}

fn misses(corners: &[DetectedCorner], span: usize) -> Vec<Option<Miss>> {
    let mut places = BTreeMap::<(usize, usize), Vec<usize>>::new();
    for (i, corner) in corners.iter().enumerate() {
        places.entry((corner.row, corner.column)).or_default().push(i);
    }
    let neighbours = |corner: &DetectedCorner, span: usize| -> Vec<&DetectedCorner> {
        let (row, column) = (corner.row, corner.column);
        (row.saturating_sub(span)..=row + span)
            .flat_map(|r| places.range((r, column.saturating_sub(span))..=(r, column + span)))
            // Not the other corners of the same square: what covers one moves the others.
            .filter(|&(place, _)| *place != (row, column))
            .flat_map(|(_, members)| members.iter().map(|&i| &corners[i]))
            .collect()
    };
    let miss = |corner: &DetectedCorner| {
        // Where much is hidden, neighbours farther away must do.
        (span..=span + 2).find_map(|span| {
            let near = neighbours(corner, span);
            let here = pixel(corner);
            let (expected, reach) = expected(corner, &near)?;
            let pitch = near.iter().map(|c| (pixel(c) - here).norm()).fold(f64::INFINITY, f64::min);
            Some(Miss { px: (expected - here).norm(), pitch, reach })
        })
    };
    corners.iter().map(miss).collect()
}

fn pixel(corner: &DetectedCorner) -> Vector2<f64> {
    Vector2::new(corner.sharp.column, corner.sharp.row)
}

/// Second order surface through the neighbours, at the point, and its reach: see [`Miss`].
fn expected(corner: &DetectedCorner, near: &[&DetectedCorner]) -> Option<(Vector2<f64>, f64)> {
    if near.len() < LEAST_NEIGHBOURS {
        return None;
    }
    let offset =
        |c: &DetectedCorner| Vector2::new(c.board.x_m - corner.board.x_m, c.board.y_m - corner.board.y_m);
    let size = near.iter().map(|c| offset(c).norm()).fold(0.0, f64::max);
    let mut matrix = Matrix6::zeros();
    let mut right = [Vector6::zeros(); 2];
    for other in near {
        let (x, y) = (offset(other).x / size, offset(other).y / size);
        let row = Vector6::new(1.0, x, y, x * x, x * y, y * y);
        matrix += row * row.transpose();
        let p = pixel(other);
        right[0] += row * p.x;
        right[1] += row * p.y;
    }
    // Neighbours in one line do not span a surface.
    let scale = 1e-9 * near.len() as f64;
    let cholesky = matrix.cholesky().filter(|c| c.l().diagonal().iter().all(|d| d * d > scale))?;
    // Variance of the miss in units of a neighbour's: one and the leverage, which is small among the neighbours.
    let leverage = cholesky.solve(&Vector6::x())[0];
    let at = Vector2::new(cholesky.solve(&right[0])[0], cholesky.solve(&right[1])[0]);
    Some((at, (1.0 + leverage).sqrt()))
}
