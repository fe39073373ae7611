//! Chessboards: crossings of edges, linked along the edges between them, put on the board's lattice.
//!
//! Two crossings are neighbours when an edge leads from one to the other with dark on the same side all the
//! way; along it dark and light change sides at every crossing, so that a link over a hidden crossing or out of
//! the board fails. Labels are given only when the block of crossings has the declared rows and columns.

mod links;
mod placement;

#[cfg(test)]
mod tests;

use super::crossings::{self, Crossing};
use super::lattice::{Block, Cells, LatticeError, closed, components};
use super::saddle;
use super::strays::without_strays;
use super::{DetectError, DetectedCorner, Detection, MarkerSeen};
use crate::calibration::grey::Grey;
use crate::calibration::target::{ChessboardTarget, STILL};
use crate::camera::ImagePoint;
use nalgebra::Vector2;
use placement::{Labels, place};

/// Photos are searched at about this size first.
const SEARCH_SIZE_PX: usize = 400;
/// A photo reduced to less than this shows no board.
const LEAST_SEARCH_PX: usize = 160;
/// A crossing is located within this share of the distance to the next edge.
const REACH_SHARE: f64 = 0.6;
const LEAST_REACH_PX: f64 = 2.5;
/// Share of the corners that must be located.
const REQUIRED_SHARE: f64 = 0.5;

/// Lattices of one photo that are looked at, the largest first.
const MAX_LATTICES: usize = 8;

const CORNERS: &str = "inner corners";
const SINGLE: &str = "crossings of edges";

/// The photo at one size, with the crossings in it.
struct Search {
    smooth: Grey,
    crossings: Vec<Crossing>,
    /// Pixels of the photo per pixel.
    factor: usize,
}

impl Search {
    fn new(image: &Grey, factor: usize) -> Self {
        let smooth = if factor > 1 { image.reduced(factor).smoothed() } else { image.smoothed() };
        let crossings = crossings::find(&smooth);
        Self { smooth, crossings, factor }
    }

    /// Lattices of crossings, the largest first.
    fn lattices(&mut self) -> Vec<Cells> {
        let mut lattices = components(&closed(&links::neighbours(&self.smooth, &self.crossings)));
        lattices.truncate(MAX_LATTICES);
        for cells in &mut lattices {
            links::grow(cells, &self.smooth, &mut self.crossings);
        }
        lattices
    }

    /// The only place where the board fits.
    fn board(&mut self, target: &ChessboardTarget) -> Result<Labels, LatticeError> {
        let single = self.crossings.len();
        let lattices = self.lattices();
        let mut placed: Vec<_> = lattices.iter().map(|cells| place(cells, &self.crossings, target)).collect();
        if placed.is_empty() {
            return Err(LatticeError::NoLattice { what: SINGLE, single });
        }
        match placed.iter().filter(|labels| labels.is_ok()).count() {
            0 => placed.swap_remove(0),
            1 => placed
                .into_iter()
                .find(Result::is_ok)
                .unwrap_or(Err(LatticeError::Ambiguous { what: CORNERS })),
            targets => Err(LatticeError::Several { targets }),
        }
    }

    fn full(&self, p: Vector2<f64>) -> Vector2<f64> {
        // Pixel (0, 0) is a centre in both images.
        (p + Vector2::repeat(0.5)) * self.factor as f64 - Vector2::repeat(0.5)
    }
}

/// By how much the photo is reduced for each search, in this order.
fn factors(image: &Grey) -> Vec<usize> {
    let longest = image.width().max(image.height());
    let first = longest.div_ceil(SEARCH_SIZE_PX);
    // Twice and four times as fine for boards that are small in the photo, coarser for blurred ones.
    let mut factors = vec![first, first.div_ceil(2), first.div_ceil(4)];
    factors.dedup();
    if longest / (2 * first) >= LEAST_SEARCH_PX {
        factors.push(2 * first);
    }
    factors
}

/// Finds the inner corners of the board. What is hidden is listed as missing; all rows and columns must be seen.
pub(super) fn detect(image: &Grey, target: &ChessboardTarget) -> Result<Detection, DetectError> {
    let mut best: Option<(Search, Result<Labels, LatticeError>)> = None;
    for factor in factors(image) {
        let mut search = Search::new(image, factor);
        let labels = search.board(target);
        let rank = |labels: &Result<Labels, LatticeError>| match labels {
            Ok(labels) => 2 + labels.len(),
            Err(LatticeError::NoLattice { .. }) => 0,
            Err(_) => 1,
        };
        if best.as_ref().is_none_or(|(_, so_far)| rank(&labels) > rank(so_far)) {
            best = Some((search, labels));
        }
        let complete = |labels: &Labels| labels.len() == target.rows() * target.columns();
        if best.as_ref().is_some_and(|(_, labels)| labels.as_ref().is_ok_and(complete)) {
            break;
        }
    }
    let (search, labels) = best.ok_or(DetectError::NoContrast)?;
    locate(image, &search, &labels?, target)
}

/// Rows and columns of inner corners, no fewer columns than rows; the search that shows most of them decides.
pub(super) fn count(image: &Grey, _: &ChessboardTarget) -> Result<(usize, usize), DetectError> {
    let mut best = Err(LatticeError::NoLattice { what: SINGLE, single: 0 });
    for factor in factors(image) {
        let mut search = Search::new(image, factor);
        let found = search.lattices().first().and_then(|cells| Block::around(cells).trimmed(cells));
        let Some(block) = found else { continue };
        let (rows, columns) = (block.rows as usize, block.columns as usize);
        if best.as_ref().is_ok_and(|(r, c)| r * c >= rows * columns) {
            continue;
        }
        best = Ok((rows.min(columns), rows.max(columns)));
    }
    Ok(best?)
}

/// Locates every labelled corner in the photo.
fn locate(
    image: &Grey,
    search: &Search,
    labels: &Labels,
    target: &ChessboardTarget,
) -> Result<Detection, DetectError> {
    let point = |p: Vector2<f64>| ImagePoint::new(p.x, p.y);
    let mut corners = Vec::with_capacity(labels.len());
    let mut missing = Vec::new();
    for row in 0..target.rows() {
        for column in 0..target.columns() {
            let corner = labels.get(&(row, column)).and_then(|&index| {
                let crossing = &search.crossings[index];
                let start = search.full(crossing.saddle);
                let (edges, reach) = surroundings(search, labels, (row, column), crossing);
                let found = saddle::refine(image, start, edges, reach)?;
                Some(DetectedCorner {
                    row,
                    column,
                    corner: 0,
                    board: target.corner(row, column),
                    growth: STILL,
                    blunt: point(search.full(crossing.peak)),
                    refined: point(start),
                    sharp: point(found.pixel),
                })
            });
            match corner {
                Some(corner) => corners.push(corner),
                None => missing.push((row, column)),
            }
        }
    }
    missing.extend(without_strays(&mut corners, 2));
    missing.sort_unstable();
    let (located, found) = (corners.len(), labels.len());
    if (located as f64) < REQUIRED_SHARE * (target.rows() * target.columns()) as f64 {
        return Err(DetectError::Unsharp { what: CORNERS, located, found });
    }
    Ok(Detection { corners, missing, marker: MarkerSeen::None })
}

/// Directions of the edges through a corner, and how far around it nothing else is printed, px of the photo.
fn surroundings(
    search: &Search,
    labels: &Labels,
    (row, column): (usize, usize),
    crossing: &Crossing,
) -> ([Vector2<f64>; 2], f64) {
    let at = |r: Option<usize>, c: Option<usize>| labels.get(&(r?, c?)).map(|&i| search.crossings[i].saddle);
    let across = [at(Some(row), column.checked_sub(1)), at(Some(row), Some(column + 1))];
    let down = [at(row.checked_sub(1), Some(column)), at(Some(row + 1), Some(column))];
    let edges = [across, down].map(|[before, after]| {
        let here = crossing.saddle;
        (after.unwrap_or(here) - before.unwrap_or(here)).try_normalize(0.0)
    });
    // With both neighbours of an edge hidden, the ring's arms serve.
    let most_unlike = |edge: Vector2<f64>| {
        let [one, other, ..] = crossing.arms;
        if one.perp(&edge).abs() > other.perp(&edge).abs() { one } else { other }
    };
    let [one, other] = match edges {
        [Some(one), Some(other)] => [one, other],
        [Some(edge), None] => [edge, most_unlike(edge)],
        [None, Some(edge)] => [most_unlike(edge), edge],
        [None, None] => [crossing.arms[0], crossing.arms[1]],
    };
    // The next edges run through the neighbours.
    let free = |neighbours: [Option<Vector2<f64>>; 2], edge: Vector2<f64>| {
        let distances = neighbours.into_iter().flatten().map(|p| (p - crossing.saddle).perp(&edge).abs());
        distances.fold(f64::INFINITY, f64::min)
    };
    let free_px = free(across, other).min(free(down, one)) * search.factor as f64;
    ([one, other], (REACH_SHARE * free_px).max(LEAST_REACH_PX))
}
