//! AprilGrids: tags by their numbers, their four edges, corners where these intersect.

use super::grid::other_size;
use super::lattice::MarkerSeen;
use super::sharp::sharp;
use super::tags::{Found, Kind, Tag, agreeing, find_tags, vertical_step};
use super::{DetectError, DetectedCorner, Detection, GridError, LatticeError, localise, misfit};
use crate::calibration::grey::Grey;
use crate::calibration::target::{AprilGridTarget, TagOrder};
use crate::camera::ImagePoint;
use nalgebra::Vector2;
use std::borrow::Cow;

/// Photos are searched at this size at most; edges are then located in the full photo.
const SEARCH_SIZE_PX: usize = 1600;
/// What the target is counted in.
const UNIT: &str = "tags";
/// Share of a border of one cell next to an edge in which the edge is searched: cells behind it are white.
const SEARCHED_BORDER: f64 = 0.75;

/// Finds the tags of the target. Any part of the board will do that shows two tags next to each other.
pub(super) fn detect(image: &Grey, target: &AprilGridTarget) -> Result<Detection, DetectError> {
    let (search, factor) = searched(image);
    let found = find_tags(&search, &kind(target));
    check_layout(&found, target)?;
    let groups = agreeing(&found.tags, |tag| corners_of(target, tag));
    let expected = target.rows() * target.columns();
    let [first, others @ ..] = &groups[..] else {
        return Err(
            LatticeError::Incomplete { what: UNIT, found: found.tags.len().min(expected), expected }.into()
        );
    };
    if others.first().is_some_and(|other| 2 * other.len() > first.len()) {
        return Err(LatticeError::Several { targets: 2 }.into());
    }
    let tags: Vec<&Tag> = first.iter().map(|&at| &found.tags[at]).collect();
    locate(image, &search, factor, &tags, target)
}

/// Rows and columns of tags: the numbers grow by one to the right and by the number of columns from row to row.
pub(super) fn count(image: &Grey, target: &AprilGridTarget) -> Result<(usize, usize), DetectError> {
    let found = find_tags(&searched(image).0, &kind(target));
    counted(&found, target)
}

fn kind(target: &AprilGridTarget) -> Kind {
    let surround = target.gap_m() / target.tag_m();
    Kind { dictionary: target.print().family, borders: &[1, 2], surround }
}

/// The image in which tags are searched, and how many pixels of the photo one of its pixels is wide.
fn searched(image: &Grey) -> (Cow<'_, Grey>, usize) {
    let factor = image.width().max(image.height()).div_ceil(SEARCH_SIZE_PX);
    let search = if factor > 1 { Cow::Owned(image.reduced(factor)) } else { Cow::Borrowed(image) };
    (search, factor)
}

fn board(target: &AprilGridTarget, row: usize, column: usize, corner: usize) -> Vector2<f64> {
    let p = target.corner(row, column, corner);
    Vector2::new(p.x_m, p.y_m) / target.tag_m()
}

fn corners_of(target: &AprilGridTarget, tag: usize) -> Option<[Vector2<f64>; 4]> {
    let (row, column) = target.place(tag)?;
    Some(std::array::from_fn(|k| board(target, row, column, k)))
}

fn counted(found: &Found, target: &AprilGridTarget) -> Result<(usize, usize), DetectError> {
    let tags = found.readable(UNIT)?;
    let pitch = 1.0 + target.gap_m() / target.tag_m();
    let step = vertical_step(tags, pitch).ok_or(GridError::OneRow { what: UNIT })?;
    let columns = step.unsigned_abs() as usize;
    // Only those that lie right tell how far the board goes on: single ones may be misread.
    let endless = target.endless(columns.max(1));
    let groups = agreeing(tags, |tag| corners_of(&endless, tag));
    let index = |&at: &usize| tags[at].marker - target.print().first;
    let last = groups.first().into_iter().flatten().map(index).max();
    Ok((last.unwrap_or(0) / columns.max(1) + 1, columns))
}

/// Whether the tags' numbers grow from row to row as declared.
fn check_layout(found: &Found, target: &AprilGridTarget) -> Result<(), DetectError> {
    let (found_rows, found_columns) = match counted(found, target) {
        // Tags of one row still have their numbers.
        Err(DetectError::Grid(GridError::OneRow { .. })) => return Ok(()),
        counted => counted?,
    };
    let (rows, columns) = (target.rows(), target.columns());
    if found_columns != columns || found_rows > rows {
        return Err(other_size(UNIT, (found_rows, found_columns), (rows, columns)).into());
    }
    let pitch = 1.0 + target.gap_m() / target.tag_m();
    let downwards = vertical_step(&found.tags, pitch).is_some_and(|step| step > 0);
    if downwards != (target.print().order == TagOrder::FromUpperLeft) {
        return Err(GridError::Order { from: if downwards { "upper" } else { "lower" } }.into());
    }
    Ok(())
}

/// The three estimates for every tag.
fn locate(
    image: &Grey,
    search: &Grey,
    factor: usize,
    tags: &[&Tag],
    target: &AprilGridTarget,
) -> Result<Detection, DetectError> {
    // Pixel (0, 0) is a centre in both images.
    let scale = factor as f64;
    let full = |p: Vector2<f64>| (p + Vector2::repeat(0.5)) * scale - Vector2::repeat(0.5);
    let point = |p: Vector2<f64>| ImagePoint::new(p.x, p.y);
    // White cells begin one cell inside the edge at the earliest; `sharp` stays within 0.45 of what it is given.
    let cell = 1.0 / (target.print().family.side() + 2) as f64;
    let free = (target.gap_m() / target.tag_m()).min(SEARCHED_BORDER * cell / 0.45);
    let mut corners = Vec::with_capacity(4 * tags.len());
    for tag in tags {
        let Some((row, column)) = target.place(tag.marker) else {
            continue;
        };
        let Some(sharp) = sharp(image, tag.quad.corners.map(full), scale, free) else {
            continue;
        };
        let blunt = localise::blunt(&tag.quad);
        for corner in 0..4 {
            corners.push(DetectedCorner {
                row,
                column,
                corner,
                board: target.corner(row, column, corner),
                growth: AprilGridTarget::growth(corner),
                blunt: point(full(blunt[corner])),
                refined: point(full(localise::refined(search, blunt[corner], tag.side()))),
                sharp: point(sharp[corner]),
            });
        }
    }
    let pairs: Vec<_> = corners
        .iter()
        .map(|c| (board(target, c.row, c.column, c.corner), Vector2::new(c.sharp.column, c.sharp.row)))
        .collect();
    // Four points per tag lie half a pitch apart in the mean. What hides an edge moves two corners alike.
    let step = 0.5 * (1.0 + target.gap_m() / target.tag_m());
    let of_other_tags = |a: usize, b: usize| {
        let [a, b] = [a, b].map(|at| (corners[at].row, corners[at].column));
        a != b
    };
    let fits = misfit::in_place(&pairs, step, of_other_tags);
    let mut fits = fits.into_iter();
    corners.retain(|_| fits.next() == Some(true));
    let located = corners.len().div_ceil(4);
    if corners.len() < 6 {
        return Err(DetectError::Unsharp { what: UNIT, located, found: tags.len() });
    }
    corners.sort_by_key(|c| (c.row, c.column, c.corner));
    let missing = (0..target.rows())
        .flat_map(|row| (0..target.columns()).map(move |column| (row, column)))
        .filter(|&cell| !corners.iter().any(|c| (c.row, c.column) == cell))
        .collect();
    Ok(Detection { corners, missing, marker: MarkerSeen::None })
}

#[cfg(test)]
mod tests;
