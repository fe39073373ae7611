//! The planar target: an n × m lattice of separated black squares on a light board.

use crate::camera::ImagePoint;
use crate::geometry::Frame;

/// The target's own frame: origin at the upper left corner of the upper left square, x right and y down
/// over the board as it is read, z into the board; metres.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Board;

impl Frame for Board {
    const NAME: &'static str = "board";
}

/// A point of the board's plane z = 0, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardPoint {
    /// To the right.
    pub x_m: f64,
    /// Downwards.
    pub y_m: f64,
}

/// One point of the board and the pixel it was seen in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Where the point is on the board.
    pub board: BoardPoint,
    /// How the point moves when squares are larger than declared: m per m of side. Zero when it does not.
    pub growth: BoardPoint,
    /// Where it was seen.
    pub pixel: ImagePoint,
}

/// What tells the target's upper left corner from the other three.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// Nothing. Views are then assumed not mirrored, and the target's upper left is taken to be the
    /// lattice corner nearest to the image's upper left corner. Turning the board by such a symmetry moves
    /// the board's frame, not the camera's parameters.
    None,
    /// The upper left square is hollow (light inside a black outline) or left out. Its corners are not
    /// used for calibration.
    UpperLeft,
}

/// Why a description is no target.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TargetError {
    /// Fewer than two rows or columns of squares.
    #[error("the target has {rows} × {columns} squares, at least 2 × 2 are needed")]
    TooFewSquares {
        /// Rows of squares.
        rows: usize,
        /// Columns of squares.
        columns: usize,
    },
    /// More rows or columns than any printed target has.
    #[error("the target has {rows} × {columns} squares, at most 100 × 100 can be found")]
    TooManySquares {
        /// Rows of squares.
        rows: usize,
        /// Columns of squares.
        columns: usize,
    },
    /// A length is not a positive number.
    #[error("the target's {what} is {metres} m, it must be positive")]
    Length {
        /// `square` or `gap`.
        what: &'static str,
        /// What was given.
        metres: f64,
    },
}

/// An n × m lattice of separated black squares.
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
        if rows < 2 || columns < 2 {
            return Err(TargetError::TooFewSquares { rows, columns });
        }
        if rows > 100 || columns > 100 {
            return Err(TargetError::TooManySquares { rows, columns });
        }
        for (what, metres) in [("square", side_m), ("gap", gap_m)] {
            if !(metres.is_finite() && metres > 0.0) {
                return Err(TargetError::Length { what, metres });
            }
        }
        Ok(Self { rows, columns, side_m, gap_m, marker })
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
        let pitch = self.side_m + self.gap_m;
        let (right, down) = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)][corner % 4];
        BoardPoint {
            x_m: column as f64 * pitch + right * self.side_m,
            y_m: row as f64 * pitch + down * self.side_m,
        }
    }
    /// How a corner moves when the squares are larger than declared, about their centres: m per m of side.
    #[must_use]
    pub fn growth(corner: usize) -> BoardPoint {
        let (x_m, y_m) = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)][corner % 4];
        BoardPoint { x_m, y_m }
    }
    /// All calibration points, row by row, square by square, clockwise from each upper left corner.
    #[must_use]
    pub fn points(&self) -> Vec<BoardPoint> {
        let mut points = Vec::with_capacity(4 * self.used_squares());
        for row in 0..self.rows {
            for column in (0..self.columns).filter(|&column| self.is_used(row, column)) {
                points.extend((0..4).map(|corner| self.corner(row, column, corner)));
            }
        }
        points
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
        assert!(matches!(new(1, 0.03), Err(TargetError::TooFewSquares { .. })));
        assert!(matches!(new(101, 0.03), Err(TargetError::TooManySquares { .. })));
        assert!(matches!(new(3, f64::NAN), Err(TargetError::Length { .. })));
        assert!(new(3, 0.03).is_ok());
    }
}
