//! Which circle of the target a disc of the lattice is.

use super::super::grid::other_size as size_error;
use super::super::{DetectError, GridError, LatticeError};
use super::discs::Disc;
use super::lattice::Cells;
use crate::calibration::target::{CircleLayout, CirclesTarget};

/// Share of the circles that must be found for the labels to be certain.
const REQUIRED_SHARE: f64 = 0.75;
/// What the target is counted in.
pub(super) const UNIT: &str = "circles";

/// A circle of the target and the disc it was seen as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Labelled {
    pub row: usize,
    pub column: usize,
    /// Index into the discs.
    pub disc: usize,
}

/// Discs at steps of the spacing from the upper left corner of the box around them.
struct Sheet {
    /// Right, down, disc.
    places: Vec<(i32, i32, usize)>,
    width: i32,
    height: i32,
}

impl Sheet {
    fn new(places: Vec<(i32, i32, usize)>) -> Self {
        let bounds = |values: &dyn Fn(&(i32, i32, usize)) -> i32| {
            let low = places.iter().map(values).min().unwrap_or(0);
            (low, places.iter().map(values).max().map_or(0, |high| high - low + 1))
        };
        let ((left, width), (top, height)) = (bounds(&|p| p.0), bounds(&|p| p.1));
        let places = places.into_iter().map(|(x, y, disc)| (x - left, y - top, disc)).collect();
        Self { places, width, height }
    }
    /// The lattice as it lies on a sheet of this layout, in one of its four turns.
    fn of(cells: &Cells, layout: CircleLayout) -> Self {
        // The asymmetric grid's neighbours are half a column to the side and a row down.
        let place = |(&(x, y), &disc): (&(i32, i32), &usize)| match layout {
            CircleLayout::Symmetric => (x, y, disc),
            CircleLayout::Asymmetric => (x - y, x + y, disc),
        };
        Self::new(cells.iter().map(place).collect()).trimmed(layout)
    }
    /// Without border lines of which less than half is there: those are clutter.
    fn trimmed(self, layout: CircleLayout) -> Self {
        let (right, bottom) = (self.width - 1, self.height - 1);
        let sparse = |on_line: &dyn Fn(&(i32, i32, usize)) -> bool, length: i32| {
            let there = self.places.iter().filter(|p| on_line(p)).count() as i32;
            let whole = if layout == CircleLayout::Symmetric { length } else { length / 2 };
            2 * there < whole
        };
        let kept: &dyn Fn(&(i32, i32, usize)) -> bool = if sparse(&|p| p.0 == 0, self.height) {
            &|p| p.0 != 0
        } else if sparse(&|p| p.0 == right, self.height) {
            &|p| p.0 != right
        } else if sparse(&|p| p.1 == 0, self.width) {
            &|p| p.1 != 0
        } else if sparse(&|p| p.1 == bottom, self.width) {
            &|p| p.1 != bottom
        } else {
            return self;
        };
        Self::new(self.places.iter().copied().filter(|p| kept(p)).collect()).trimmed(layout)
    }
    /// Turned by a quarter, anticlockwise as seen.
    fn turned(self) -> Self {
        Self::new(self.places.into_iter().map(|(x, y, disc)| (y, -x, disc)).collect())
    }
    /// Rows and columns in this turn, if the layout can look like this.
    fn size(&self, layout: CircleLayout) -> Option<(usize, usize)> {
        let (rows, width) = (self.height as usize, self.width as usize);
        match layout {
            CircleLayout::Symmetric => Some((rows, width)),
            CircleLayout::Asymmetric => {
                let upper_left = self.places.iter().all(|(x, y, _)| (x + y) % 2 == 0);
                (width % 2 == 0 && upper_left).then_some((rows, width / 2))
            }
        }
    }
    /// The four turns.
    fn turns(self) -> impl Iterator<Item = Self> {
        let mut next = Some(self);
        (0..4).filter_map(move |_| {
            let sheet = next.take()?;
            next = Some(Self::new(sheet.places.clone()).turned());
            Some(sheet)
        })
    }
    fn labels(&self, layout: CircleLayout) -> Vec<Labelled> {
        let across = |x: i32| if layout == CircleLayout::Symmetric { x } else { x / 2 };
        let mut labels: Vec<Labelled> = self
            .places
            .iter()
            .map(|&(x, y, disc)| Labelled { row: y as usize, column: across(x) as usize, disc })
            .collect();
        labels.sort_by_key(|label| (label.row, label.column));
        labels
    }
}

/// Rows and columns of a lattice. A symmetric one has no fewer columns than rows.
pub(super) fn count(cells: &Cells, layout: CircleLayout) -> Option<(usize, usize)> {
    let sizes = Sheet::of(cells, layout).turns().filter_map(|sheet| sheet.size(layout));
    sizes.filter(|&(rows, columns)| rows >= 2 && columns >= 2).min()
}

/// Labels every disc of a lattice that is the target, row by row.
pub(super) fn label(
    cells: &Cells,
    discs: &[Disc],
    target: &CirclesTarget,
) -> Result<Vec<Labelled>, DetectError> {
    let layout = target.layout();
    let declared = (target.rows(), target.columns());
    let upper_left = |labels: &[Labelled]| {
        let first = labels.iter().min_by_key(|label| (label.row + label.column, label.row));
        first.map_or(f64::INFINITY, |label| discs[label.disc].centre.norm())
    };
    let chosen = Sheet::of(cells, layout)
        .turns()
        .filter(|sheet| sheet.size(layout) == Some(declared))
        .map(|sheet| sheet.labels(layout))
        .min_by(|a, b| upper_left(a).total_cmp(&upper_left(b)));
    let Some(labels) = chosen else {
        return Err(other_size(cells, target));
    };
    let expected = declared.0 * declared.1;
    if (labels.len() as f64) < REQUIRED_SHARE * expected as f64 {
        return Err(LatticeError::Incomplete { what: UNIT, found: labels.len(), expected }.into());
    }
    Ok(labels)
}

/// What was found, the way round that the target is declared.
fn other_size(cells: &Cells, target: &CirclesTarget) -> DetectError {
    let layout = target.layout();
    let upright = |&(rows, columns): &(usize, usize)| {
        (rows.cmp(&columns) == target.rows().cmp(&target.columns()), rows.min(columns))
    };
    let seen = Sheet::of(cells, layout).turns().filter_map(|sheet| sheet.size(layout)).max_by_key(upright);
    match seen {
        Some(found) => size_error(UNIT, found, (target.rows(), target.columns())).into(),
        None => GridError::Layout { what: UNIT, found: cells.len() }.into(),
    }
}
