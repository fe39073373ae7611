//! The paper's target: an n × m lattice of separated black squares on a light board.

use super::{BoardPoint, Ink, Shape, TargetError, TargetPoint, checked_length, checked_size, square_corner};

/// What tells the target's upper left corner from the other three.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// Nothing. Views are then assumed not mirrored, and the target's upper left is taken to be the
    /// lattice corner nearest to the image's upper left corner. Turning the board by such a symmetry moves
    /// the board's frame, not the camera's parameters.
    None,
    /// The upper left square is hollow (light inside a black outline) or left out. Its corners are not
    /// used for calibration. With as many rows as columns a mirrored photo cannot be told from a turned one.
    UpperLeft,
}

/// An n × m lattice of separated black squares. Origin at the upper left corner of the upper left square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SquaresTarget {
    rows: usize,
    columns: usize,
    side_m: f64,
    gap_m: f64,
    marker: Marker,
}

impl SquaresTarget {
    /// From the number of squares, the side of a square and the gap between neighbours, metres.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn new(
        rows: usize,
        columns: usize,
        side_m: f64,
        gap_m: f64,
        marker: Marker,
    ) -> Result<Self, TargetError> {
        checked_size("squares", rows, columns, 2)?;
        checked_length("square", side_m)?;
        checked_length("gap", gap_m)?;
        Ok(Self { rows, columns, side_m, gap_m, marker })
    }
    pub(super) fn resized(&self, rows: usize, columns: usize) -> Result<Self, TargetError> {
        Self::new(rows, columns, self.side_m, self.gap_m, self.marker)
    }

    /// The target of the paper: 7 × 7 squares, side and gap 15.7 mm, the upper left one hollow.
    ///
    /// # Source
    /// Hemerly (2014), section 2.
    #[must_use]
    pub const fn paper() -> Self {
        Self { rows: 7, columns: 7, side_m: 0.0157, gap_m: 0.0157, marker: Marker::UpperLeft }
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
    pub const fn side_m(&self) -> f64 {
        self.side_m
    }
    /// What tells the upper left corner.
    #[must_use]
    pub const fn marker(&self) -> Marker {
        self.marker
    }
    /// Distance between neighbouring squares' centres as a multiple of the side.
    #[must_use]
    pub fn pitch_in_sides(&self) -> f64 {
        (self.side_m + self.gap_m) / self.side_m
    }
    /// True when the corners of this square are calibration points: all but the marker's.
    #[must_use]
    pub fn is_used(&self, row: usize, column: usize) -> bool {
        row < self.rows
            && column < self.columns
            && !(self.marker == Marker::UpperLeft && row == 0 && column == 0)
    }
    /// Squares whose corners are calibration points.
    #[must_use]
    pub fn used_squares(&self) -> usize {
        self.rows * self.columns - usize::from(self.marker == Marker::UpperLeft)
    }
    /// Corner of a square: 0 upper left, 1 upper right, 2 lower right, 3 lower left (modulo 4).
    #[must_use]
    pub fn corner(&self, row: usize, column: usize, corner: usize) -> BoardPoint {
        square_corner((row, column), corner, self.side_m, self.gap_m)
    }
    /// How a corner moves when the squares are larger than declared, about their centres: m per m of side.
    #[must_use]
    pub fn growth(corner: usize) -> BoardPoint {
        let (x_m, y_m) = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)][corner % 4];
        BoardPoint { x_m, y_m }
    }
    /// All calibration points, row by row, square by square, clockwise from each upper left corner.
    pub(in crate::calibration) fn points(&self) -> Vec<TargetPoint> {
        let mut points = Vec::with_capacity(4 * self.used_squares());
        for row in 0..self.rows {
            for column in (0..self.columns).filter(|&column| self.is_used(row, column)) {
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
    /// The marker's outline is a quarter of a square's side wide.
    pub(in crate::calibration) fn ink(&self) -> Vec<Ink> {
        let mut ink = Vec::new();
        for row in 0..self.rows {
            for column in 0..self.columns {
                let BoardPoint { x_m, y_m } = self.corner(row, column, 0);
                ink.push(Ink { shape: Shape::square(x_m, y_m, self.side_m), dark: true });
                if !self.is_used(row, column) {
                    let edge = 0.25 * self.side_m;
                    let hole = Shape::square(x_m + edge, y_m + edge, 0.5 * self.side_m);
                    ink.push(Ink { shape: hole, dark: false });
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
    fn the_papers_target_has_192_points() {
        let target = SquaresTarget::paper();
        assert_eq!(target.points().len(), 192);
        let last = target.corner(6, 6, 2);
        assert!((last.x_m - 13.0 * 0.0157).abs() < 1e-15 && last.x_m == last.y_m);
    }

    #[test]
    fn impossible_targets_are_refused() {
        let new = |rows, side| SquaresTarget::new(rows, 4, side, 0.03, Marker::None);
        assert!(matches!(new(1, 0.03), Err(TargetError::TooFew { .. })));
        assert!(matches!(new(101, 0.03), Err(TargetError::TooMany { .. })));
        assert!(matches!(new(3, f64::NAN), Err(TargetError::Length { .. })));
        assert!(new(3, 0.03).is_ok());
    }
}
