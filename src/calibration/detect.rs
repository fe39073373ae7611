//! From a photo to the labelled corners of the target, each with the paper's three estimates.

use super::grey::Grey;
use super::lattice::{self, LatticeError};
use super::localise;
use super::quads::{Quad, find_quads};
use super::sharp::sharp;
use super::target::{BoardPoint, Observation, SquaresTarget};
use crate::camera::ImagePoint;
use nalgebra::Vector2;

pub use super::lattice::MarkerSeen;

/// Photos are searched at this size at most; corners are then located in the full photo.
const SEARCH_SIZE_PX: usize = 1600;
/// Half widths of the local threshold's window, as shares of the longer image side, tried in this order.
const WINDOWS: [f64; 3] = [1.0 / 12.0, 1.0 / 30.0, 1.0 / 5.0];
/// A square is darker than its surroundings by at least this share of the photo's brightness range.
const CONTRAST_SHARE: f32 = 0.06;
/// Smallest photo that can hold a target, pixels.
const LEAST_SIZE_PX: usize = 32;

/// Why a photo gives no corners.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DetectError {
    /// Too small to hold a target.
    #[error("the photo is {width} × {height} px, too small to hold a target")]
    TooSmall {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Nothing to see.
    #[error("the photo has no contrast")]
    NoContrast,
    /// The squares do not make up the target.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// Squares were found but their edges are not sharp enough.
    #[error(
        "the edges of only {located} of {squares} squares could be located: the photo is blurred or the squares are too small"
    )]
    Unsharp {
        /// Squares with four located corners.
        located: usize,
        /// Squares found.
        squares: usize,
    },
}

/// One corner of one square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectedCorner {
    /// The square's row on the target, from 0.
    pub square_row: usize,
    /// The square's column on the target, from 0.
    pub square_column: usize,
    /// 0 upper left, 1 upper right, 2 lower right, 3 lower left.
    pub corner: usize,
    /// Where it is on the board.
    pub board: BoardPoint,
    /// First estimate: corner of the square's bounding box.
    pub blunt: ImagePoint,
    /// Second estimate: strongest Harris response.
    pub refined: ImagePoint,
    /// Final estimate: intersection of the edges found by the gradient search.
    pub sharp: ImagePoint,
}

/// The target as seen in one photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// Corners, square by square.
    pub corners: Vec<DetectedCorner>,
    /// Squares of the target (row, column) that were hidden or not sharp enough.
    pub missing: Vec<(usize, usize)>,
    /// What stood at the marker's place.
    pub marker: MarkerSeen,
}

impl Detection {
    /// The sharp corners as observations for [`super::calibrate`].
    #[must_use]
    pub fn observations(&self) -> Vec<Observation> {
        self.corners
            .iter()
            .map(|corner| Observation {
                board: corner.board,
                growth: SquaresTarget::growth(corner.corner),
                pixel: corner.sharp,
            })
            .collect()
    }
}

/// Finds the target in a photo and locates its corners.
///
/// - `image`: brightness as stored in the file, not turned by any orientation tag.
///
/// Every square of the target is found or listed as missing; at least three quarters are needed, among
/// them half of each border row and column, so that labels are certain.
///
/// # Errors
/// [`DetectError`], with what was found.
///
/// # Source
/// Hemerly (2014), section 2: blunt, refined and sharp estimates.
pub fn detect(image: &Grey, target: &SquaresTarget) -> Result<Detection, DetectError> {
    let (width, height) = (image.width(), image.height());
    if width.min(height) < LEAST_SIZE_PX {
        return Err(DetectError::TooSmall { width, height });
    }
    let range = image.range();
    if range <= f32::EPSILON {
        return Err(DetectError::NoContrast);
    }
    let factor = width.max(height).div_ceil(SEARCH_SIZE_PX);
    let reduced = (factor > 1).then(|| image.reduced(factor));
    let search = reduced.as_ref().unwrap_or(image);
    let smooth = search.smoothed();
    let longest = smooth.width().max(smooth.height()) as f64;
    let mut best: Option<(Vec<Quad>, Result<lattice::Labels, LatticeError>)> = None;
    for share in WINDOWS {
        let radius = (share * longest).round().max(2.0) as usize;
        let quads = find_quads(&smooth, radius, CONTRAST_SHARE * range);
        let labels = lattice::label(&quads, target);
        let rank = |labels: &Result<lattice::Labels, LatticeError>| match labels {
            Ok(labels) => 2 + labels.squares.len(),
            Err(LatticeError::NoLattice { .. }) => 0,
            Err(_) => 1,
        };
        if best.as_ref().is_none_or(|(_, so_far)| rank(&labels) > rank(so_far)) {
            best = Some((quads, labels));
        }
        let complete = |labels: &lattice::Labels| labels.squares.len() == target.used_squares();
        if best.as_ref().is_some_and(|(_, labels)| labels.as_ref().is_ok_and(complete)) {
            break;
        }
    }
    let (quads, labels) = best.ok_or(DetectError::NoContrast)?;
    locate(image, search, factor, &quads, &labels?, target)
}

/// The three estimates for every labelled square.
fn locate(
    image: &Grey,
    search: &Grey,
    factor: usize,
    quads: &[Quad],
    labels: &lattice::Labels,
    target: &SquaresTarget,
) -> Result<Detection, DetectError> {
    // Pixel (0, 0) is a centre in both images.
    let scale = factor as f64;
    let full = |p: Vector2<f64>| (p + Vector2::repeat(0.5)) * scale - Vector2::repeat(0.5);
    let point = |p: Vector2<f64>| ImagePoint::new(p.x, p.y);
    let gap = target.pitch_in_sides() - 1.0;
    let mut corners = Vec::with_capacity(4 * labels.squares.len());
    for square in &labels.squares {
        let quad = &quads[square.quad];
        let side = quad.area().sqrt();
        let blunt = localise::blunt(quad);
        let refined = blunt.map(|corner| localise::refined(search, corner, side));
        // A Harris maximum that is not this corner's (dirt, glare, print) would lead the search astray:
        // there it starts from the outline's corner instead.
        let start = std::array::from_fn(|k| {
            let outline = quad.corners[k];
            let astray = (refined[k] - outline).norm() > 2.0 + 0.1 * side;
            full(if astray { outline } else { refined[k] })
        });
        let Some(sharp) = sharp(image, start, scale, gap) else {
            continue;
        };
        for corner in 0..4 {
            let k = (corner + square.first_corner) % 4;
            corners.push(DetectedCorner {
                square_row: square.row,
                square_column: square.column,
                corner,
                board: target.corner(square.row, square.column, corner),
                blunt: point(full(blunt[k])),
                refined: point(full(refined[k])),
                sharp: point(sharp[k]),
            });
        }
    }
    let located = corners.len() / 4;
    if 4 * located < 3 * target.used_squares() {
        let squares = labels.squares.len();
        return Err(DetectError::Unsharp { located, squares });
    }
    let mut missing = Vec::new();
    for row in 0..target.rows() {
        for column in (0..target.columns()).filter(|&column| target.is_used(row, column)) {
            if !corners.iter().any(|c| (c.square_row, c.square_column) == (row, column)) {
                missing.push((row, column));
            }
        }
    }
    Ok(Detection { corners, missing, marker: labels.marker })
}

#[cfg(test)]
mod tests;
