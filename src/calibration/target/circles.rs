//! A grid of black discs; its points are their centres.

use super::{BoardPoint, Ink, STILL, Shape, TargetError, TargetPoint, checked_length, checked_size};

/// How the circles of a grid lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CircleLayout {
    /// Rows and columns at right angles, `spacing` apart both ways.
    Symmetric,
    /// Rows `spacing` apart, circles of a row twice that; every second row is moved right by `spacing`.
    Asymmetric,
}

/// A grid of black discs. Origin at the centre of the upper left one.
///
/// A symmetric grid is turned so that its first circle is the one nearest to the image's upper left corner.
/// An asymmetric grid of an even number of rows looks the same after half a turn: the same rule decides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CirclesTarget {
    rows: usize,
    columns: usize,
    spacing_m: f64,
    diameter_m: f64,
    layout: CircleLayout,
}

impl CirclesTarget {
    /// From the number of circles in a column and in a row, spacing (see [`CircleLayout`]) and diameter, metres.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn new(
        rows: usize,
        columns: usize,
        spacing_m: f64,
        diameter_m: f64,
        layout: CircleLayout,
    ) -> Result<Self, TargetError> {
        checked_size("circles", rows, columns, 2)?;
        checked_length("spacing", spacing_m)?;
        checked_length("diameter", diameter_m)?;
        let (whole, whole_metres) = match layout {
            CircleLayout::Symmetric => ("spacing", spacing_m),
            CircleLayout::Asymmetric => ("diagonal spacing", spacing_m * std::f64::consts::SQRT_2),
        };
        if diameter_m >= whole_metres {
            return Err(TargetError::TooLong { what: "diameter", metres: diameter_m, whole, whole_metres });
        }
        Ok(Self { rows, columns, spacing_m, diameter_m, layout })
    }
    pub(super) fn resized(&self, rows: usize, columns: usize) -> Result<Self, TargetError> {
        Self::new(rows, columns, self.spacing_m, self.diameter_m, self.layout)
    }
    /// Circles in a column of the grid.
    #[must_use]
    pub const fn rows(&self) -> usize {
        self.rows
    }
    /// Circles in a row.
    #[must_use]
    pub const fn columns(&self) -> usize {
        self.columns
    }
    /// Distance between rows, metres.
    #[must_use]
    pub const fn spacing_m(&self) -> f64 {
        self.spacing_m
    }
    /// Diameter of a disc, metres.
    #[must_use]
    pub const fn diameter_m(&self) -> f64 {
        self.diameter_m
    }
    /// How they lie.
    #[must_use]
    pub const fn layout(&self) -> CircleLayout {
        self.layout
    }
    /// A circle's centre.
    #[must_use]
    pub fn centre(&self, row: usize, column: usize) -> BoardPoint {
        let across = match self.layout {
            CircleLayout::Symmetric => column,
            CircleLayout::Asymmetric => 2 * column + row % 2,
        };
        BoardPoint { x_m: across as f64 * self.spacing_m, y_m: row as f64 * self.spacing_m }
    }
    pub(in crate::calibration) fn points(&self) -> Vec<TargetPoint> {
        (0..self.rows)
            .flat_map(|row| (0..self.columns).map(move |column| (row, column)))
            .map(|(row, column)| TargetPoint {
                row,
                column,
                corner: 0,
                board: self.centre(row, column),
                growth: STILL,
            })
            .collect()
    }
    pub(in crate::calibration) fn ink(&self) -> Vec<Ink> {
        let radius_m = 0.5 * self.diameter_m;
        self.points()
            .into_iter()
            .map(|p| Ink { shape: Shape::Disc { centre: p.board, radius_m }, dark: true })
            .collect()
    }
}
