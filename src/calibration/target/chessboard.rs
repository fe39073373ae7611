//! A chessboard; its points are the inner corners, where four squares meet.

use super::{BoardPoint, Ink, STILL, Shape, TargetError, TargetPoint, checked_length, checked_size};

/// A chessboard, counted by its inner corners. Origin at the upper left inner corner; the square up and left
/// of it is black.
///
/// With an odd number of inner corners in one direction and an even one in the other the board has a single
/// upright position. Otherwise turning it by half (two odd or two even numbers), or by a quarter (equal
/// numbers), changes nothing: then the corner that the image's upper left is nearest to is the first one.
/// A mirrored photo shows a board too: views are assumed not mirrored. Whole rows and columns must be in view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChessboardTarget {
    rows: usize,
    columns: usize,
    square_m: f64,
}

impl ChessboardTarget {
    /// From the number of inner corners and the side of a square, metres.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn new(rows: usize, columns: usize, square_m: f64) -> Result<Self, TargetError> {
        checked_size("inner corners", rows, columns, 2)?;
        checked_length("square", square_m)?;
        Ok(Self { rows, columns, square_m })
    }
    pub(super) fn resized(&self, rows: usize, columns: usize) -> Result<Self, TargetError> {
        Self::new(rows, columns, self.square_m)
    }
    /// Rows of inner corners.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }
    /// Columns of inner corners.
    #[must_use]
    pub const fn columns(&self) -> usize {
        self.columns
    }
    /// Side of a square, metres.
    #[must_use]
    pub const fn square_m(&self) -> f64 {
        self.square_m
    }
    /// An inner corner.
    #[must_use]
    pub const fn corner(&self, row: usize, column: usize) -> BoardPoint {
        BoardPoint { x_m: column as f64 * self.square_m, y_m: row as f64 * self.square_m }
    }
    pub(super) fn points(&self) -> Vec<TargetPoint> {
        (0..self.rows)
            .flat_map(|row| (0..self.columns).map(move |column| (row, column)))
            .map(|(row, column)| TargetPoint {
                row,
                column,
                corner: 0,
                board: self.corner(row, column),
                growth: STILL,
            })
            .collect()
    }
    pub(super) fn ink(&self) -> Vec<Ink> {
        let mut ink = Vec::new();
        for row in 0..=self.rows {
            for column in (row % 2..=self.columns).step_by(2) {
                let (x, y) = ((column as f64 - 1.0) * self.square_m, (row as f64 - 1.0) * self.square_m);
                ink.push(Ink { shape: Shape::square(x, y, self.square_m), dark: true });
            }
        }
        ink
    }
}
