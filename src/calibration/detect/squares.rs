//! Separated squares: threshold, quadrilaterals, lattice, three estimates of every corner.

mod labels;

use super::lattice::LatticeError;
use super::localise;
use super::quads::{Quad, find_quads};
use super::sharp::sharp;
use super::strays::without_strays;
use super::{DetectError, DetectedCorner, Detection};
use crate::calibration::grey::Grey;
use crate::calibration::target::SquaresTarget;
use crate::camera::ImagePoint;
use nalgebra::Vector2;

/// Photos are searched at about this size first, then at twice the size; corners are then located in the full photo.
const SEARCH_SIZE_PX: usize = 800;
/// Half widths of the local threshold's window, as shares of the longer image side, tried in this order.
const WINDOWS: [f64; 3] = [1.0 / 12.0, 1.0 / 30.0, 1.0 / 5.0];
/// A square is darker than its surroundings by at least this share of the photo's brightness range.
const CONTRAST_SHARE: f32 = 0.06;
/// Share of the squares that must be located.
const REQUIRED_SHARE: f64 = 0.5;

/// The photo at one size.
struct Search {
    image: Grey,
    smooth: Grey,
    /// Pixels of the photo per pixel.
    factor: usize,
}

impl Search {
    fn new(image: &Grey, factor: usize) -> Self {
        let image = image.reduced(factor);
        Self { smooth: image.smoothed(), image, factor }
    }
}

/// By how much the photo is reduced for each search, in this order.
fn factors(image: &Grey) -> impl Iterator<Item = usize> {
    let first = image.width().max(image.height()).div_ceil(SEARCH_SIZE_PX);
    [first, first / 2].into_iter().filter(|factor| *factor > 0)
}

/// Finds the squares of the target: every one, or it is listed as missing. At least half are needed, among
/// them a quarter of each border row and column, so that labels are certain.
pub(super) fn detect(image: &Grey, target: &SquaresTarget) -> Result<Detection, DetectError> {
    let rank = |labels: &Result<labels::Labels, LatticeError>| match labels {
        Ok(labels) => 2 + labels.squares.len(),
        Err(LatticeError::NoLattice { .. }) => 0,
        Err(_) => 1,
    };
    let mut best: Option<(usize, Vec<Quad>, Result<labels::Labels, LatticeError>)> = None;
    let searches = factors(image).map(|factor| Search::new(image, factor));
    let mut kept = Vec::new();
    'sizes: for (i, search) in searches.enumerate() {
        for share in WINDOWS {
            let quads = quads_in(&search.smooth, share);
            let labels = labels::label(&quads, target);
            let complete = labels.as_ref().is_ok_and(|l| l.squares.len() == target.used_squares());
            if best.as_ref().is_none_or(|(_, _, so_far)| rank(&labels) > rank(so_far)) {
                best = Some((i, quads, labels));
            }
            if complete {
                kept.push(search);
                break 'sizes;
            }
        }
        kept.push(search);
    }
    let (i, quads, labels) = best.ok_or(DetectError::NoContrast)?;
    locate(image, &kept[i], &quads, &labels?, target)
}

/// Rows and columns of the lattice of squares; the search that shows most of it decides.
pub(super) fn count(image: &Grey, target: &SquaresTarget) -> Result<(usize, usize), DetectError> {
    let counts = factors(image).flat_map(|factor| {
        let smooth = Search::new(image, factor).smooth;
        WINDOWS.map(|share| labels::count(&quads_in(&smooth, share), target))
    });
    let most = |best: Result<(usize, usize), LatticeError>, next| match (&best, &next) {
        (Ok((r, c)), Ok((rows, columns))) if rows * columns <= r * c => best,
        (_, Ok(_)) => next,
        _ => best,
    };
    counts.reduce(most).unwrap_or(Err(LatticeError::NoMarker)).map_err(DetectError::from)
}

fn quads_in(smooth: &Grey, share: f64) -> Vec<Quad> {
    let longest = smooth.width().max(smooth.height()) as f64;
    let radius = (share * longest).round().max(2.0) as usize;
    find_quads(smooth, radius, CONTRAST_SHARE * smooth.range())
}

/// The three estimates for every labelled square.
fn locate(
    image: &Grey,
    search: &Search,
    quads: &[Quad],
    labels: &labels::Labels,
    target: &SquaresTarget,
) -> Result<Detection, DetectError> {
    // Pixel (0, 0) is a centre in both images.
    let scale = search.factor as f64;
    let full = |p: Vector2<f64>| (p + Vector2::repeat(0.5)) * scale - Vector2::repeat(0.5);
    let point = |p: Vector2<f64>| ImagePoint::new(p.x, p.y);
    let gap = target.pitch_in_sides() - 1.0;
    let mut corners = Vec::with_capacity(4 * labels.squares.len());
    for square in &labels.squares {
        let quad = &quads[square.quad];
        let side = quad.area().sqrt();
        let blunt = localise::blunt(quad);
        let refined = blunt.map(|corner| localise::refined(&search.image, corner, side));
        // Dirt, glare or print can hold a stronger Harris maximum than the corner: the search starts from the
        // sides of the outline.
        let start = quad.corners.map(full);
        let Some(sharp) = sharp(image, start, scale, gap) else {
            continue;
        };
        for corner in 0..4 {
            let k = (corner + square.first_corner) % 4;
            corners.push(DetectedCorner {
                row: square.row,
                column: square.column,
                corner,
                board: target.corner(square.row, square.column, corner),
                growth: SquaresTarget::growth(corner),
                blunt: point(full(blunt[k])),
                refined: point(full(refined[k])),
                sharp: point(sharp[k]),
            });
        }
    }
    without_strays(&mut corners, 1);
    let located = corners.len() / 4;
    if (located as f64) < REQUIRED_SHARE * target.used_squares() as f64 {
        let found = labels.squares.len();
        return Err(DetectError::Unsharp { what: "squares", located, found });
    }
    let mut missing = Vec::new();
    for row in 0..target.rows() {
        for column in (0..target.columns()).filter(|&column| target.is_used(row, column)) {
            if !corners.iter().any(|c| (c.row, c.column) == (row, column)) {
                missing.push((row, column));
            }
        }
    }
    Ok(Detection { corners, missing, marker: labels.marker })
}

#[cfg(test)]
mod tests;
