//! Square markers: dark quadrilaterals whose cells make up a word of a dictionary.

mod agreement;
mod mask;
mod reading;

pub(super) use agreement::{agreeing, vertical_step};

use super::areas::{Area, dark_areas};
use super::quads::{Quad, four_sides};
use super::{DetectError, GridError, LatticeError};
use crate::calibration::grey::Grey;
use crate::calibration::target::Dictionary;
use mask::{Look, dark_mask};
use nalgebra::Vector2;
use reading::{Read, Reader};

/// Smallest side of a marker, pixels of the searched image.
const LEAST_SIDE_PX: usize = 8;
/// A marker covers no more than this share of the image.
const MOST_SHARE: f64 = 0.6;
/// Most quadrilaterals read in one look: bounds the work on photos full of clutter.
const MAX_QUADS: usize = 2000;

/// A marker as found.
#[derive(Debug, Clone)]
pub(super) struct Tag {
    /// Its number.
    pub marker: usize,
    /// Corners clockwise from the upper left as it is read, pixels of the searched image.
    pub quad: Quad,
    /// Cells read otherwise than printed.
    misread: usize,
}

impl Tag {
    /// Mean of the sides, px.
    pub fn side(&self) -> f64 {
        self.quad.area().max(0.0).sqrt()
    }
}

/// What is looked for.
pub(super) struct Kind {
    pub dictionary: &'static Dictionary,
    /// Widths of the black border, in cells, that are tried.
    pub borders: &'static [usize],
    /// White around a marker, in its sides.
    pub surround: f64,
}

/// What was found.
pub(super) struct Found {
    /// Every marker once for every place where it was seen.
    pub tags: Vec<Tag>,
    /// Quadrilaterals, readable or not, in the look that showed most.
    pub quads: usize,
    /// Quadrilaterals that are markers in a mirror.
    pub mirrored: usize,
}

impl Found {
    /// The markers; an error when there are none, or when most can be read in a mirror only. Some markers look
    /// like others there.
    pub fn readable(&self, what: &'static str) -> Result<&[Tag], DetectError> {
        if self.mirrored > 1 && self.mirrored > 2 * self.tags.len() {
            return Err(GridError::Mirrored { what, found: self.mirrored }.into());
        }
        if self.tags.is_empty() {
            return Err(LatticeError::NoLattice { what, single: self.quads }.into());
        }
        Ok(&self.tags)
    }
}

/// Finds all markers of a dictionary.
pub(super) fn find_tags(image: &Grey, kind: &Kind) -> Found {
    let reader = Reader::new(kind);
    let smooth = image.smoothed();
    let mut found = Found { tags: Vec::new(), quads: 0, mirrored: 0 };
    for look in Look::ALL {
        let quads = quads(if look.smoothed { &smooth } else { image }, look);
        let mut mirrored = 0;
        for quad in &quads {
            match reader.read(image, &quad.corners) {
                Some(Read::Marker { marker, first_corner, misread }) => {
                    let mut quad = quad.clone();
                    quad.corners.rotate_left(first_corner);
                    keep(&mut found.tags, Tag { marker, quad, misread });
                }
                Some(Read::Mirrored) => mirrored += 1,
                None => {}
            }
        }
        found.quads = found.quads.max(quads.len());
        found.mirrored = found.mirrored.max(mirrored);
    }
    found.tags.sort_by_key(|tag| tag.marker);
    found
}

/// Adds a marker, or puts it in the place of the same one read worse.
fn keep(tags: &mut Vec<Tag>, tag: Tag) {
    let same = |other: &&mut Tag| {
        other.marker == tag.marker && (other.quad.centre() - tag.quad.centre()).norm() < 0.5 * tag.side()
    };
    match tags.iter_mut().find(same) {
        Some(other) if tag.misread < other.misread => *other = tag,
        Some(_) => {}
        None => tags.push(tag),
    }
}

/// Dark quadrilaterals.
fn quads(image: &Grey, look: Look) -> Vec<Quad> {
    let dark = dark_mask(image, look);
    let most = (MOST_SHARE * dark.len() as f64) as usize;
    let mut quads: Vec<Quad> = dark_areas(&dark, image.width(), 2 * LEAST_SIDE_PX, most)
        .iter()
        .filter(|area| area.rows.len() >= LEAST_SIDE_PX && area.filled >= LEAST_SIDE_PX * LEAST_SIDE_PX)
        .filter_map(|area| {
            let outline = outline(area);
            four_sides(&outline).map(|corners| Quad { corners, outline, hollow: false })
        })
        .collect();
    quads.sort_by(|a, b| b.area().total_cmp(&a.area()));
    quads.truncate(MAX_QUADS);
    quads
}

/// Midpoints of the outer pixel edges of an area, clockwise; exact for convex ones.
fn outline(area: &Area) -> Vec<Vector2<f64>> {
    let (left, right) = area.columns();
    let mut ends = vec![(usize::MAX, 0); right + 1 - left];
    let mut points = Vec::with_capacity(2 * (ends.len() + area.rows.len()));
    for (row, &(first, last)) in area.rows.iter().enumerate() {
        let row = area.top + row;
        points.push(Vector2::new(first as f64 - 0.5, row as f64));
        points.push(Vector2::new(last as f64 + 0.5, row as f64));
        for end in &mut ends[first - left..=last - left] {
            *end = (end.0.min(row), end.1.max(row));
        }
    }
    for (column, &(top, bottom)) in ends.iter().enumerate().filter(|(_, end)| end.0 <= end.1) {
        let column = (left + column) as f64;
        points.push(Vector2::new(column, top as f64 - 0.5));
        points.push(Vector2::new(column, bottom as f64 + 0.5));
    }
    let angle = |p: Vector2<f64>| (f64::atan2(p.y - area.centre.y, p.x - area.centre.x), p);
    let mut turned: Vec<(f64, Vector2<f64>)> = points.into_iter().map(angle).collect();
    turned.sort_by(|a, b| a.0.total_cmp(&b.0));
    turned.into_iter().map(|(_, p)| p).collect()
}
