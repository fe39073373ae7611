//! A chessboard with a marker in every white square; its points are the inner corners.

use super::{
    BoardPoint, Dictionary, Ink, STILL, Shape, TargetError, TargetPoint, checked_length, checked_size,
};

/// A ChArUco board as OpenCV prints it. Origin at the upper left inner corner.
///
/// Markers are numbered row by row from the upper left. The upper left square is black; in the layout that
/// OpenCV printed before version 4.6 (`legacy`) it is white when the number of rows is even.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CharucoTarget {
    rows: usize,
    columns: usize,
    square_m: f64,
    marker_m: f64,
    dictionary: &'static Dictionary,
    first: usize,
    legacy: bool,
}

impl CharucoTarget {
    /// From the number of squares, the sides of a square and of a marker with its black border, metres, and the
    /// number of the first marker.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn new(
        rows: usize,
        columns: usize,
        square_m: f64,
        marker_m: f64,
        dictionary: &'static Dictionary,
        first: usize,
        legacy: bool,
    ) -> Result<Self, TargetError> {
        checked_size("squares", rows, columns, 3)?;
        checked_length("square", square_m)?;
        checked_length("marker", marker_m)?;
        if marker_m >= square_m {
            let (what, whole) = ("marker", "square");
            return Err(TargetError::TooLong { what, metres: marker_m, whole, whole_metres: square_m });
        }
        let target = Self { rows, columns, square_m, marker_m, dictionary, first, legacy };
        let (last, end) = (first.saturating_add(target.markers() - 1), dictionary.markers() - 1);
        if last > end {
            return Err(TargetError::MarkersRunOut { first, last, end });
        }
        Ok(target)
    }
    pub(super) fn resized(&self, rows: usize, columns: usize) -> Result<Self, TargetError> {
        let Self { square_m, marker_m, dictionary, first, legacy, .. } = *self;
        Self::new(rows, columns, square_m, marker_m, dictionary, first, legacy)
    }
    /// Rows of squares.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }
    /// Columns of squares.
    #[must_use]
    pub const fn columns(&self) -> usize {
        self.columns
    }
    /// Side of a square, metres.
    #[must_use]
    pub const fn square_m(&self) -> f64 {
        self.square_m
    }
    /// Side of a marker, metres.
    #[must_use]
    pub const fn marker_m(&self) -> f64 {
        self.marker_m
    }
    /// Where the markers come from.
    #[must_use]
    pub const fn dictionary(&self) -> &'static Dictionary {
        self.dictionary
    }
    /// Number of the first marker.
    #[must_use]
    pub const fn first(&self) -> usize {
        self.first
    }
    /// Whether this is the old layout.
    #[must_use]
    pub const fn legacy(&self) -> bool {
        self.legacy
    }
    /// The same board in the other layout.
    pub(in crate::calibration) const fn other_layout(&self) -> Self {
        Self { legacy: !self.legacy, ..*self }
    }
    /// Whether a square is white, and has a marker.
    #[must_use]
    pub const fn is_white(&self, row: usize, column: usize) -> bool {
        let shift = if self.legacy && self.rows.is_multiple_of(2) { 1 } else { 0 };
        (row + column + shift) % 2 == 1
    }
    /// White squares in the rows above a row.
    const fn white_above(&self, row: usize) -> usize {
        // Of two rows one has the larger half of an odd number of columns.
        let first = if self.is_white(0, 0) { self.columns.div_ceil(2) } else { self.columns / 2 };
        row / 2 * self.columns + if row % 2 == 1 { first } else { 0 }
    }
    /// Markers on the board.
    #[must_use]
    pub const fn markers(&self) -> usize {
        self.white_above(self.rows)
    }
    /// Number of the marker in a white square.
    #[must_use]
    pub fn marker(&self, row: usize, column: usize) -> Option<usize> {
        let inside = row < self.rows && column < self.columns && self.is_white(row, column);
        inside.then(|| self.first + self.white_above(row) + column / 2)
    }
    /// Row and column of a marker's square.
    #[must_use]
    pub fn place(&self, marker: usize) -> Option<(usize, usize)> {
        let index = marker.checked_sub(self.first).filter(|index| *index < self.markers())?;
        let row = (2 * index / self.columns..self.rows).find(|&row| self.white_above(row + 1) > index)?;
        let column = 2 * (index - self.white_above(row)) + usize::from(!self.is_white(row, 0));
        Some((row, column))
    }
    /// The same board with another number of columns, going on downwards.
    pub(in crate::calibration) const fn endless(&self, columns: usize) -> Self {
        // Whether the first square is white depends on the number of rows being even.
        Self { columns, rows: 1000 + self.rows % 2, ..*self }
    }
    /// Corner of a marker: 0 upper left, 1 upper right, 2 lower right, 3 lower left (modulo 4).
    #[must_use]
    pub fn marker_corner(&self, row: usize, column: usize, corner: usize) -> BoardPoint {
        let margin = 0.5 * (self.square_m - self.marker_m);
        let (right, down) = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)][corner % 4];
        BoardPoint {
            x_m: (column as f64 - 1.0) * self.square_m + margin + right * self.marker_m,
            y_m: (row as f64 - 1.0) * self.square_m + margin + down * self.marker_m,
        }
    }
    /// An inner corner; (0, 0) is the upper left one.
    #[must_use]
    pub const fn corner(&self, row: usize, column: usize) -> BoardPoint {
        BoardPoint { x_m: column as f64 * self.square_m, y_m: row as f64 * self.square_m }
    }
    /// All inner corners, row by row.
    pub(in crate::calibration) fn points(&self) -> Vec<TargetPoint> {
        (0..self.rows - 1)
            .flat_map(|row| (0..self.columns - 1).map(move |column| (row, column)))
            .map(|(row, column)| TargetPoint {
                row,
                column,
                corner: 0,
                board: self.corner(row, column),
                growth: STILL,
            })
            .collect()
    }
    pub(in crate::calibration) fn ink(&self) -> Vec<Ink> {
        let mut ink = Vec::new();
        for row in 0..self.rows {
            for column in 0..self.columns {
                if let Some(marker) = self.marker(row, column) {
                    let at = self.marker_corner(row, column, 0);
                    ink.extend(self.dictionary.ink(marker, at, self.marker_m, 1));
                } else {
                    let (x, y) = ((column as f64 - 1.0) * self.square_m, (row as f64 - 1.0) * self.square_m);
                    ink.push(Ink { shape: Shape::square(x, y, self.square_m), dark: true });
                }
            }
        }
        ink
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(rows: usize, columns: usize, legacy: bool) -> CharucoTarget {
        let dictionary = Dictionary::named("DICT_5X5_100").unwrap();
        CharucoTarget::new(rows, columns, 0.03, 0.022, dictionary, 7, legacy).unwrap()
    }

    #[test]
    fn markers_are_numbered_row_by_row() {
        for (rows, columns) in [(7, 5), (6, 5), (5, 8), (4, 4)] {
            for legacy in [false, true] {
                let target = board(rows, columns, legacy);
                let mut next = 7;
                for row in 0..rows {
                    for column in 0..columns {
                        if target.is_white(row, column) {
                            assert_eq!(target.marker(row, column), Some(next));
                            assert_eq!(target.place(next), Some((row, column)));
                            next += 1;
                        }
                    }
                }
                assert_eq!(target.markers(), next - 7);
                assert_eq!(target.place(next), None);
            }
        }
        assert!(board(6, 5, true).is_white(0, 0) && !board(7, 5, true).is_white(0, 0));
    }

    #[test]
    fn the_marker_must_fit() {
        let dictionary = Dictionary::named("DICT_4X4_50").unwrap();
        let new = |rows, marker_m| CharucoTarget::new(rows, 9, 0.03, marker_m, dictionary, 0, false);
        assert!(matches!(new(5, 0.03), Err(TargetError::TooLong { .. })));
        assert!(matches!(new(12, 0.02), Err(TargetError::MarkersRunOut { first: 0, last: 53, end: 49 })));
    }
}
