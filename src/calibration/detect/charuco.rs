//! ChArUco boards: markers by their numbers, inner corners where the markers around say they are.

use super::grid::other_size;
use super::lattice::MarkerSeen;
use super::misfit::{Pair, in_place};
use super::plane::{homography, mapped};
use super::tags::{Found, Kind, Tag, agreeing, find_tags, vertical_step};
use super::{DetectError, DetectedCorner, Detection, GridError, LatticeError, crossings, saddle};
use crate::calibration::grey::Grey;
use crate::calibration::target::{BoardPoint, CharucoTarget};
use crate::camera::ImagePoint;
use nalgebra::{Matrix3, Vector2};
use std::borrow::Cow;

/// Photos are searched at this size at most; corners are then located in the full photo.
const SEARCH_SIZE_PX: usize = 1600;
/// What the target is counted in, and what is read and located.
const UNIT: &str = "squares";
const MARKERS: &str = "markers";
const CORNERS: &str = "inner corners";
/// Markers up to this far from a corner, in squares, tell where it is.
const REACH: f64 = 2.2;
/// A corner lies within this share of a square of where they say.
const MOST_MISS: f64 = 0.2;
/// Edges run within 10° of where the markers say.
const MOST_TURN_SINE: f64 = 0.17;
/// Fewest corners that are of use.
const LEAST_CORNERS: usize = 6;
/// Light and dark squares differ by at least this share of the photo's brightness range.
const CONTRAST_SHARE: f32 = 0.05;

/// Finds the inner corners of the board that have a readable marker next to them. Any part of the board will do.
pub(super) fn detect(image: &Grey, target: &CharucoTarget) -> Result<Detection, DetectError> {
    let (search, factor) = searched(image);
    let found = find_tags(&search, &kind(target));
    check_size(&found, target)?;
    let groups = agreeing(&found.tags, |marker| marker_corners(target, marker));
    let [first, others @ ..] = &groups[..] else {
        let expected = target.markers();
        let found = found.tags.len().min(expected);
        return Err(LatticeError::Incomplete { what: MARKERS, found, expected }.into());
    };
    let other_layout = target.other_layout();
    let as_other = agreeing(&found.tags, |marker| marker_corners(&other_layout, marker));
    if let Some(all) = as_other.first().filter(|all| all.len() > first.len()) {
        return Err(GridError::Layout { what: MARKERS, found: all.len() }.into());
    }
    if others.first().is_some_and(|other| 2 * other.len() > first.len()) {
        return Err(LatticeError::Several { targets: groups.len() }.into());
    }
    let tags: Vec<&Tag> = first.iter().map(|&at| &found.tags[at]).collect();
    locate(image, &Search { smooth: search.smoothed(), factor }, &tags, target)
}

/// Rows and columns of squares: the numbers of markers grow by the number of columns every two rows.
pub(super) fn count(image: &Grey, target: &CharucoTarget) -> Result<(usize, usize), DetectError> {
    counted(&find_tags(&searched(image).0, &kind(target)), target)
}

fn kind(target: &CharucoTarget) -> Kind {
    let surround = 0.5 * (target.square_m() - target.marker_m()) / target.marker_m();
    Kind { dictionary: target.dictionary(), borders: &[1], surround }
}

/// The image in which markers are searched, and how many pixels of the photo one of its pixels is wide.
fn searched(image: &Grey) -> (Cow<'_, Grey>, usize) {
    let factor = image.width().max(image.height()).div_ceil(SEARCH_SIZE_PX);
    let search = if factor > 1 { Cow::Owned(image.reduced(factor)) } else { Cow::Borrowed(image) };
    (search, factor)
}

/// In squares from the upper left inner corner.
fn in_squares(target: &CharucoTarget, p: BoardPoint) -> Vector2<f64> {
    Vector2::new(p.x_m, p.y_m) / target.square_m()
}

fn marker_corners(target: &CharucoTarget, marker: usize) -> Option<[Vector2<f64>; 4]> {
    let (row, column) = target.place(marker)?;
    Some(std::array::from_fn(|k| in_squares(target, target.marker_corner(row, column, k))))
}

fn counted(found: &Found, target: &CharucoTarget) -> Result<(usize, usize), DetectError> {
    let tags = found.readable(MARKERS)?;
    let two_rows = 2.0 * target.square_m() / target.marker_m();
    let step = vertical_step(tags, two_rows).filter(|step| *step > 0);
    let columns = step.ok_or(GridError::OneRow { what: MARKERS })? as usize;
    // Only those that lie right tell how far the board goes on: single ones may be misread.
    let endless = target.endless(columns);
    let groups = agreeing(tags, |marker| marker_corners(&endless, marker));
    let last = groups.first().into_iter().flatten().filter_map(|&at| endless.place(tags[at].marker)).max();
    Ok((last.map_or(0, |(row, _)| row) + 1, columns))
}

fn check_size(found: &Found, target: &CharucoTarget) -> Result<(), DetectError> {
    let (rows, columns) = match counted(found, target) {
        // Markers of a row or two still have their numbers.
        Err(DetectError::Grid(GridError::OneRow { .. })) => return Ok(()),
        counted => counted?,
    };
    let declared = (target.rows(), target.columns());
    if columns != declared.1 || rows > declared.0 {
        return Err(other_size(UNIT, (rows, columns), declared).into());
    }
    Ok(())
}

/// The searched image.
struct Search {
    smooth: Grey,
    /// Pixels of the photo in one of its pixels, both ways.
    factor: usize,
}

impl Search {
    /// As a position in the photo; pixel (0, 0) is a centre in both images.
    fn full(&self, p: Vector2<f64>) -> Vector2<f64> {
        (p + Vector2::repeat(0.5)) * self.factor as f64 - Vector2::repeat(0.5)
    }
}

/// The three estimates for every corner with a marker next to it.
fn locate(
    image: &Grey,
    search: &Search,
    tags: &[&Tag],
    target: &CharucoTarget,
) -> Result<Detection, DetectError> {
    let least_contrast = CONTRAST_SHARE * search.smooth.range();
    let pairs: Vec<Pair> = tags
        .iter()
        .filter_map(|tag| Some((marker_corners(target, tag.marker)?, tag)))
        .flat_map(|(board, tag)| board.into_iter().zip(tag.quad.corners))
        .collect();
    let places: Vec<(usize, usize)> = (0..target.rows() - 1)
        .flat_map(|row| (0..target.columns() - 1).map(move |column| (row, column)))
        .collect();
    let confirmed = |&&(row, column): &&(usize, usize)| {
        let around = [(row, column), (row, column + 1), (row + 1, column), (row + 1, column + 1)];
        tags.iter().any(|tag| target.place(tag.marker).is_some_and(|place| around.contains(&place)))
    };
    let mut found = 0;
    let mut corners = Vec::with_capacity(places.len());
    for &(row, column) in places.iter().filter(confirmed) {
        let board = target.corner(row, column);
        let Some(expected) = Expected::new(&pairs, in_squares(target, board), target) else {
            continue;
        };
        found += 1;
        if let Some([blunt, refined, sharp]) = expected.located(image, search, least_contrast) {
            let growth = BoardPoint { x_m: 0.0, y_m: 0.0 };
            corners.push(DetectedCorner { row, column, corner: 0, board, growth, blunt, refined, sharp });
        }
    }
    let located: Vec<Pair> = corners
        .iter()
        .map(|c| (in_squares(target, c.board), Vector2::new(c.sharp.column, c.sharp.row)))
        .collect();
    let mut fits = in_place(&located, 1.0, |a, b| a != b).into_iter();
    corners.retain(|_| fits.next() == Some(true));
    let flat = |of: &dyn Fn(&DetectedCorner) -> usize| corners.iter().all(|c| of(c) == of(&corners[0]));
    if corners.len() < LEAST_CORNERS || flat(&|c| c.row) || flat(&|c| c.column) {
        return Err(DetectError::Unsharp { what: CORNERS, located: corners.len(), found });
    }
    let missing =
        places.into_iter().filter(|&place| !corners.iter().any(|c| (c.row, c.column) == place)).collect();
    Ok(Detection { corners, missing, marker: MarkerSeen::None })
}

/// A corner where the markers around it say it is, in the searched image.
struct Expected {
    place: Vector2<f64>,
    /// One square to the right and down.
    steps: [Vector2<f64>; 2],
    /// Distance to the nearest marker's corner as a share of a square.
    free: f64,
}

impl Expected {
    fn new(pairs: &[Pair], board: Vector2<f64>, target: &CharucoTarget) -> Option<Self> {
        let near: Vec<Pair> = pairs
            .iter()
            .map(|pair| (pair.0 - board, pair.1))
            .filter(|(offset, _)| offset.norm() < REACH)
            .collect();
        let h: Matrix3<f64> = homography(&near)?;
        let place = mapped(&h, Vector2::zeros());
        let steps = [(1.0, 0.0), (0.0, 1.0)].map(|(x, y)| {
            let to = |s: f64| mapped(&h, Vector2::new(x, y) * s);
            (to(0.25) - to(-0.25)) * 2.0
        });
        let margin = 0.5 * (1.0 - target.marker_m() / target.square_m());
        Some(Self { place, steps, free: margin * std::f64::consts::SQRT_2 })
    }
    /// Length of the shorter step, px.
    fn square_px(&self) -> f64 {
        self.steps[0].norm().min(self.steps[1].norm())
    }
    /// Expected, near the saddle of the smoothed photo, and exact; pixels of the photo.
    fn located(&self, image: &Grey, search: &Search, least_contrast: f32) -> Option<[ImagePoint; 3]> {
        let scale = search.factor as f64;
        let reach = (MOST_MISS * self.square_px()).max(1.5);
        let crossing = crossings::near(&search.smooth, self.place, reach, least_contrast);
        let start = crossing.map_or(self.place, |crossing| crossing.saddle);
        // Blur carries the markers' ink a little way towards the corner.
        let window = (self.free * self.square_px() * scale).max(LEAST_WINDOW_PX);
        let saddle = saddle::refine(image, search.full(start), self.steps, window)?;
        // Where something in front of the board crosses one of its edges, the edges run otherwise.
        let turned = saddle.edges().iter().zip(&self.steps).any(|(edge, step)| {
            let sine = edge.perp(step) / step.norm();
            sine.abs() > MOST_TURN_SINE
        });
        let miss = (saddle.pixel - search.full(self.place)).norm();
        (!turned && miss < (reach + 0.5) * scale).then(|| {
            [search.full(self.place), search.full(start), saddle.pixel].map(|p| ImagePoint::new(p.x, p.y))
        })
    }
}

/// Radius of the smallest window in which a corner can be told from noise, px.
const LEAST_WINDOW_PX: f64 = 3.5;

#[cfg(test)]
mod tests;
