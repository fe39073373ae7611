//! AprilTags in rows and columns; its points are the corners of the tags.

use super::{
    BoardPoint, Dictionary, Ink, Shape, TargetError, TargetPoint, checked_length, checked_size, square_corner,
};

/// Where the first tag is; the others follow to the right and then row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TagOrder {
    /// Lower left, as Kalibr prints them.
    FromLowerLeft,
    /// Upper left.
    FromUpperLeft,
}

/// What an [`AprilGridTarget`] has printed besides its size. It matters for drawing and for the labels; tags are
/// read with borders of one or two cells whatever is said here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TagPrint {
    /// The tags.
    pub family: &'static Dictionary,
    /// Number of the first tag.
    pub first: usize,
    /// Where it is.
    pub order: TagOrder,
    /// Cells of a tag's black border: 1 or 2.
    pub border: usize,
    /// A black square in every gap between four tags, touching their corners.
    pub corner_squares: bool,
}

impl TagPrint {
    /// As Kalibr's target generator prints: 36h11 from 0 at the lower left, two cells of border, corner squares.
    #[must_use]
    pub fn kalibr() -> Self {
        Self {
            family: Dictionary::tag36h11(),
            first: 0,
            order: TagOrder::FromLowerLeft,
            border: 2,
            corner_squares: true,
        }
    }
}

/// A grid of AprilTags. Origin at the upper left corner of the upper left tag as the tags are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AprilGridTarget {
    rows: usize,
    columns: usize,
    tag_m: f64,
    gap_m: f64,
    print: TagPrint,
}

impl AprilGridTarget {
    /// From the number of tags, the side of a tag with its black border, and the gap between tags, metres.
    /// Kalibr states the gap as a share of the side.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn new(
        rows: usize,
        columns: usize,
        tag_m: f64,
        gap_m: f64,
        print: TagPrint,
    ) -> Result<Self, TargetError> {
        checked_size("tags", rows, columns, 1)?;
        checked_length("tag", tag_m)?;
        checked_length("gap", gap_m)?;
        if !(1..=2).contains(&print.border) {
            return Err(TargetError::Border { cells: print.border });
        }
        let (last, end) = (print.first.saturating_add(rows * columns - 1), print.family.markers() - 1);
        if last > end {
            return Err(TargetError::MarkersRunOut { first: print.first, last, end });
        }
        Ok(Self { rows, columns, tag_m, gap_m, print })
    }
    pub(in crate::calibration) fn resized(&self, rows: usize, columns: usize) -> Result<Self, TargetError> {
        Self::new(rows, columns, self.tag_m, self.gap_m, self.print)
    }
    /// Rows of tags.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }
    /// Columns of tags.
    #[must_use]
    pub const fn columns(&self) -> usize {
        self.columns
    }
    /// Side of a tag with its black border, metres.
    #[must_use]
    pub const fn tag_m(&self) -> f64 {
        self.tag_m
    }
    /// Gap between tags, metres.
    #[must_use]
    pub const fn gap_m(&self) -> f64 {
        self.gap_m
    }
    /// What is printed besides.
    #[must_use]
    pub const fn print(&self) -> TagPrint {
        self.print
    }
    /// Number of the tag at a place on the board.
    #[must_use]
    pub const fn tag(&self, row: usize, column: usize) -> usize {
        let from_first = match self.print.order {
            TagOrder::FromLowerLeft => self.rows.saturating_sub(row + 1),
            TagOrder::FromUpperLeft => row,
        };
        self.print.first + from_first * self.columns + column
    }
    /// Row and column of a tag.
    #[must_use]
    pub fn place(&self, tag: usize) -> Option<(usize, usize)> {
        let index = tag.checked_sub(self.print.first)?;
        let (from_first, column) = (index / self.columns, index % self.columns);
        (from_first < self.rows).then(|| match self.print.order {
            TagOrder::FromLowerLeft => (self.rows - 1 - from_first, column),
            TagOrder::FromUpperLeft => (from_first, column),
        })
    }
    /// The same board with another number of columns, going on without end.
    pub(in crate::calibration) const fn endless(&self, columns: usize) -> Self {
        Self { columns, rows: 1000, ..*self }
    }
    /// Corner of a tag: 0 upper left, 1 upper right, 2 lower right, 3 lower left (modulo 4).
    #[must_use]
    pub fn corner(&self, row: usize, column: usize, corner: usize) -> BoardPoint {
        square_corner((row, column), corner, self.tag_m, self.gap_m)
    }
    /// How a corner moves when the tags are larger than declared, about their centres: m per m of side.
    #[must_use]
    pub fn growth(corner: usize) -> BoardPoint {
        super::SquaresTarget::growth(corner)
    }
    /// All calibration points, row by row, tag by tag, clockwise from each upper left corner.
    pub(in crate::calibration) fn points(&self) -> Vec<TargetPoint> {
        let mut points = Vec::with_capacity(4 * self.rows * self.columns);
        for row in 0..self.rows {
            for column in 0..self.columns {
                points.extend((0..4).map(|corner| TargetPoint {
                    row,
                    column,
                    corner,
                    board: self.corner(row, column, corner),
                    growth: Self::growth(corner),
                }));
            }
        }
        points
    }
    pub(in crate::calibration) fn ink(&self) -> Vec<Ink> {
        let TagPrint { family, border, corner_squares, .. } = self.print;
        let mut ink = Vec::new();
        for row in 0..self.rows {
            for column in 0..self.columns {
                let at = self.corner(row, column, 0);
                ink.extend(family.ink(self.tag(row, column), at, self.tag_m, border));
            }
        }
        if corner_squares {
            let pitch = self.tag_m + self.gap_m;
            for row in 0..=self.rows {
                for column in 0..=self.columns {
                    let (x, y) = (column as f64 * pitch - self.gap_m, row as f64 * pitch - self.gap_m);
                    ink.push(Ink { shape: Shape::square(x, y, self.gap_m), dark: true });
                }
            }
        }
        ink
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kalibrs_tags_count_from_the_lower_left() {
        let target = AprilGridTarget::new(6, 7, 0.088, 0.0264, TagPrint::kalibr()).unwrap();
        assert_eq!((target.tag(5, 0), target.tag(5, 6), target.tag(4, 0), target.tag(0, 6)), (0, 6, 7, 41));
        assert!((0..42).all(|tag| target.place(tag).map(|(r, c)| target.tag(r, c)) == Some(tag)));
        assert_eq!(target.place(42), None);
        assert_eq!(target.points().len(), 168);
    }

    #[test]
    fn tags_run_out() {
        let print = TagPrint { first: 580, ..TagPrint::kalibr() };
        assert!(AprilGridTarget::new(2, 3, 0.1, 0.03, print).is_ok());
        let error = AprilGridTarget::new(2, 4, 0.1, 0.03, print).unwrap_err();
        assert_eq!(error, TargetError::MarkersRunOut { first: 580, last: 587, end: 586 });
        let print = TagPrint { border: 3, ..TagPrint::kalibr() };
        assert!(AprilGridTarget::new(2, 3, 0.1, 0.03, print).is_err());
    }
}
