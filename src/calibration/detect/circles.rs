//! Circle grids: threshold, ellipses, lattice, outline of every disc, centre.
//!
//! Where no black discs on white are found, white ones on black are looked for.

mod discs;
mod eccentricity;
mod labels;
mod lattice;
mod outline;

use super::lattice::MarkerSeen;
use super::{DetectError, DetectedCorner, Detection, LatticeError};
use crate::calibration::grey::Grey;
use crate::calibration::target::{BoardPoint, CircleLayout, CirclesTarget};
use crate::camera::ImagePoint;
use discs::{Disc, find_discs};
use eccentricity::Placed;
use labels::{Labelled, UNIT};
use lattice::Cells;
use nalgebra::Vector2;
use outline::{Ellipse, outline};
use std::borrow::Cow;

/// Photos are searched at this size at most; discs are then located in the full photo.
const SEARCH_SIZE_PX: usize = 1600;
/// Half widths of the local threshold's window, as shares of the longer image side, tried in this order.
const WINDOWS: [f64; 3] = [1.0 / 12.0, 1.0 / 30.0, 1.0 / 5.0];
/// A disc is darker than its surroundings by at least this share of the photo's brightness range.
const CONTRAST_SHARE: f32 = 0.06;

/// Discs and which circles of the target they are.
struct Labels {
    discs: Vec<Disc>,
    labelled: Vec<Labelled>,
}

/// Finds the circles of the target. At least three quarters are needed, on every side of the grid half of the
/// outermost ones among them, so that labels are certain.
pub(super) fn detect(image: &Grey, target: &CirclesTarget) -> Result<Detection, DetectError> {
    match detect_dark(image, target) {
        Err(error) => detect_dark(&image.negative(), target).map_err(|_| error),
        found => found,
    }
}

/// Rows and columns of the grid of circles; the window that shows most of it decides.
pub(super) fn count(image: &Grey, target: &CirclesTarget) -> Result<(usize, usize), DetectError> {
    let count_dark = |image: &Grey| {
        let smooth = searched(image).0.smoothed();
        let counts = WINDOWS.iter().filter_map(|&share| {
            lattice::lattices(&discs_in(&smooth, share))
                .first()
                .and_then(|cells| labels::count(cells, target.layout()))
        });
        counts.max_by_key(|(rows, columns)| rows * columns)
    };
    count_dark(image)
        .or_else(|| count_dark(&image.negative()))
        .ok_or(DetectError::Lattice(LatticeError::NoLattice { what: UNIT, single: 0 }))
}

fn detect_dark(image: &Grey, target: &CirclesTarget) -> Result<Detection, DetectError> {
    let (search, factor) = searched(image);
    let smooth = search.smoothed();
    let mut best: Result<Labels, DetectError> = Err(LatticeError::NoLattice { what: UNIT, single: 0 }.into());
    for share in WINDOWS {
        let discs = discs_in(&smooth, share);
        let labels = label(&lattice::lattices(&discs), &discs, target);
        best = match (best, labels) {
            (Ok(best), Ok(next)) if next.len() <= best.labelled.len() => Ok(best),
            (_, Ok(labelled)) => Ok(Labels { discs, labelled }),
            (Err(DetectError::Lattice(LatticeError::NoLattice { .. })), Err(next)) => Err(next),
            (best, Err(_)) => best,
        };
        if best.as_ref().is_ok_and(|labels| labels.labelled.len() == target.rows() * target.columns()) {
            break;
        }
    }
    locate(image, factor, &best?, target)
}

/// The image in which discs are searched, and how many pixels of the photo one of its pixels is wide.
fn searched(image: &Grey) -> (Cow<'_, Grey>, usize) {
    let factor = image.width().max(image.height()).div_ceil(SEARCH_SIZE_PX);
    let search = if factor > 1 { Cow::Owned(image.reduced(factor)) } else { Cow::Borrowed(image) };
    (search, factor)
}

fn discs_in(smooth: &Grey, share: f64) -> Vec<Disc> {
    let longest = smooth.width().max(smooth.height()) as f64;
    let radius = (share * longest).round().max(2.0) as usize;
    find_discs(smooth, radius, CONTRAST_SHARE * smooth.range())
}

/// The one lattice that is the target.
fn label(lattices: &[Cells], discs: &[Disc], target: &CirclesTarget) -> Result<Vec<Labelled>, DetectError> {
    let mut labels = lattices.iter().map(|cells| labels::label(cells, discs, target));
    let Some(first) = labels.next() else {
        return Err(LatticeError::NoLattice { what: UNIT, single: discs.len() }.into());
    };
    match (first, labels.find(Result::is_ok)) {
        (Ok(_), Some(_)) => {
            Err(LatticeError::Several { targets: 2 + labels.filter(Result::is_ok).count() }.into())
        }
        (Err(_), Some(other)) => other,
        (first, _) => first,
    }
}

/// The three estimates for every labelled disc.
fn locate(
    image: &Grey,
    factor: usize,
    labels: &Labels,
    target: &CirclesTarget,
) -> Result<Detection, DetectError> {
    // Pixel (0, 0) is a centre in both images.
    let scale = factor as f64;
    let full = |p: Vector2<f64>| (p + Vector2::repeat(0.5)) * scale - Vector2::repeat(0.5);
    let point = |p: Vector2<f64>| ImagePoint::new(p.x, p.y);
    let board = |l: &Labelled| {
        let BoardPoint { x_m, y_m } = target.centre(l.row, l.column);
        Vector2::new(x_m, y_m) / target.spacing_m()
    };
    // Distance of neighbours, in spacings.
    let step = if target.layout() == CircleLayout::Symmetric { 1.0 } else { std::f64::consts::SQRT_2 };
    let (mut kept, mut placed) = (Vec::new(), Vec::new());
    for label in &labels.labelled {
        let disc = &labels.discs[label.disc];
        let start = Ellipse { centre: full(disc.centre), rounding: disc.rounding / scale };
        if let Some(ellipse) = outline(image, start, scale, free_radii(labels, label)) {
            kept.push(*label);
            placed.push(Placed { board: board(label), ellipse });
        }
    }
    let mut agrees = eccentricity::consistent(&placed, step).into_iter();
    kept.retain(|_| agrees.next() == Some(true));
    placed.retain(|p| kept.iter().any(|label| board(label) == p.board));
    let expected = target.rows() * target.columns();
    if 4 * kept.len() < 3 * expected {
        let (located, found) = (kept.len(), labels.labelled.len());
        return Err(DetectError::Unsharp { what: UNIT, located, found });
    }
    let corners: Vec<DetectedCorner> = kept
        .iter()
        .zip(eccentricity::centres(&placed, step))
        .map(|(label, sharp)| DetectedCorner {
            row: label.row,
            column: label.column,
            corner: 0,
            board: target.centre(label.row, label.column),
            growth: BoardPoint { x_m: 0.0, y_m: 0.0 },
            blunt: point(full(labels.discs[label.disc].middle)),
            refined: point(full(labels.discs[label.disc].centre)),
            sharp: point(sharp),
        })
        .collect();
    let missing = (0..target.rows())
        .flat_map(|row| (0..target.columns()).map(move |column| (row, column)))
        .filter(|&cell| !corners.iter().any(|c| (c.row, c.column) == cell))
        .collect();
    Ok(Detection { corners, missing, marker: MarkerSeen::None })
}

/// From a disc's outline to its nearest neighbour's, in radii as seen from above.
fn free_radii(labels: &Labels, label: &Labelled) -> f64 {
    let here = &labels.discs[label.disc];
    let nearest = labels
        .labelled
        .iter()
        .filter(|other| other.disc != label.disc)
        .map(|other| (here.rounding * (labels.discs[other.disc].centre - here.centre)).norm())
        .fold(f64::INFINITY, f64::min);
    (nearest - 2.0).max(0.1)
}

#[cfg(test)]
mod tests;
