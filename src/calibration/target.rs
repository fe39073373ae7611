//! The planar targets: which points of the board can be found in a photo, and what is printed on it.

mod april_grid;
mod charuco;
mod chessboard;
mod circles;
mod dictionary;
mod squares;

pub use april_grid::{AprilGridTarget, TagOrder, TagPrint};
pub use charuco::CharucoTarget;
pub use chessboard::ChessboardTarget;
pub use circles::{CircleLayout, CirclesTarget};
pub use dictionary::Dictionary;
pub(super) use dictionary::quarter_turned;
pub use squares::{Marker, SquaresTarget};

use crate::camera::ImagePoint;
use crate::geometry::Frame;

/// The target's own frame: x right and y down over the board as it is read, z into the board; metres. Each
/// kind of target says where its origin is.
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
    /// How the point moves when what is printed dark is larger than declared: m per m of side. Zero when it
    /// does not.
    pub growth: BoardPoint,
    /// Where it was seen.
    pub pixel: ImagePoint,
}

/// A point of a target that calibration uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetPoint {
    /// Row of the square, inner corner, tag or circle, from 0 at the top.
    pub row: usize,
    /// Column of it, from 0 at the left.
    pub column: usize,
    /// Corner of the square or tag: 0 upper left, 1 upper right, 2 lower right, 3 lower left; 0 for others.
    pub corner: usize,
    /// Where it is on the board.
    pub board: BoardPoint,
    /// See [`Observation::growth`].
    pub growth: BoardPoint,
}

/// Something printed on the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ink {
    /// Its outline.
    pub shape: Shape,
    /// Black; white otherwise (printed over black).
    pub dark: bool,
}

/// An outline on the board, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A rectangle along the board's axes.
    Rectangle {
        /// Upper left corner.
        from: BoardPoint,
        /// Lower right corner.
        to: BoardPoint,
    },
    /// A circular disc.
    Disc {
        /// Its centre.
        centre: BoardPoint,
        /// Its radius.
        radius_m: f64,
    },
}

impl Shape {
    /// A square from its upper left corner and side.
    #[must_use]
    pub const fn square(x_m: f64, y_m: f64, side_m: f64) -> Self {
        Self::Rectangle {
            from: BoardPoint { x_m, y_m },
            to: BoardPoint { x_m: x_m + side_m, y_m: y_m + side_m },
        }
    }
    /// Whether a point lies in it.
    #[must_use]
    pub fn contains(&self, p: BoardPoint) -> bool {
        match self {
            Self::Rectangle { from, to } => {
                p.x_m >= from.x_m && p.y_m >= from.y_m && p.x_m < to.x_m && p.y_m < to.y_m
            }
            Self::Disc { centre, radius_m } => f64::hypot(p.x_m - centre.x_m, p.y_m - centre.y_m) < *radius_m,
        }
    }
    /// Upper left and lower right corners of the box around it.
    #[must_use]
    pub fn bounds(&self) -> (BoardPoint, BoardPoint) {
        match *self {
            Self::Rectangle { from, to } => (from, to),
            Self::Disc { centre, radius_m: r } => (
                BoardPoint { x_m: centre.x_m - r, y_m: centre.y_m - r },
                BoardPoint { x_m: centre.x_m + r, y_m: centre.y_m + r },
            ),
        }
    }
}

/// Why a description is no target.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TargetError {
    /// Too few rows or columns.
    #[error("the target has {rows} × {columns} {what}, at least {least} × {least} are needed")]
    TooFew {
        /// What is counted, for example `squares`.
        what: &'static str,
        /// Rows of them.
        rows: usize,
        /// Columns of them.
        columns: usize,
        /// Rows and columns needed.
        least: usize,
    },
    /// More rows or columns than any printed target has.
    #[error("the target has {rows} × {columns} {what}, at most 100 × 100 can be found")]
    TooMany {
        /// What is counted.
        what: &'static str,
        /// Rows of them.
        rows: usize,
        /// Columns of them.
        columns: usize,
    },
    /// A length is not a positive number.
    #[error("the target's {what} is {metres} m, it must be positive")]
    Length {
        /// For example `square` or `gap`.
        what: &'static str,
        /// What was given.
        metres: f64,
    },
    /// Two lengths that do not go together.
    #[error("the target's {what} ({metres} m) must be smaller than its {whole} ({whole_metres} m)")]
    TooLong {
        /// The part.
        what: &'static str,
        /// Its length.
        metres: f64,
        /// What it must fit into.
        whole: &'static str,
        /// That one's length.
        whole_metres: f64,
    },
    /// More markers than the dictionary has.
    #[error("the target needs the markers {first} to {last}, its dictionary ends at {end}")]
    MarkersRunOut {
        /// First marker.
        first: usize,
        /// Last marker.
        last: usize,
        /// Last of the dictionary.
        end: usize,
    },
    /// A marker's border of no usual width.
    #[error("the tags' border is {cells} cells wide, it must be 1 or 2")]
    Border {
        /// What was given.
        cells: usize,
    },
}

/// A target of any kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Target {
    /// Separated black squares: the paper's.
    Squares(SquaresTarget),
    /// AprilTags in rows and columns.
    AprilGrid(AprilGridTarget),
    /// Black discs in rows and columns.
    Circles(CirclesTarget),
    /// A chessboard with a marker in every white square.
    Charuco(CharucoTarget),
    /// A chessboard.
    Chessboard(ChessboardTarget),
}

impl Target {
    /// What its rows and columns count.
    #[must_use]
    pub const fn unit(&self) -> &'static str {
        match self {
            Self::Squares(_) | Self::Charuco(_) => "squares",
            Self::AprilGrid(_) => "tags",
            Self::Circles(_) => "circles",
            Self::Chessboard(_) => "inner corners",
        }
    }
    /// Side of its squares or tags, metres, for targets whose points are their corners.
    #[must_use]
    pub const fn side_m(&self) -> Option<f64> {
        match self {
            Self::Squares(t) => Some(t.side_m()),
            Self::AprilGrid(t) => Some(t.tag_m()),
            Self::Chessboard(_) | Self::Charuco(_) | Self::Circles(_) => None,
        }
    }
    /// Rows and columns of [`Self::unit`].
    #[must_use]
    pub const fn size(&self) -> (usize, usize) {
        match self {
            Self::Squares(t) => (t.rows(), t.columns()),
            Self::AprilGrid(t) => (t.rows(), t.columns()),
            Self::Circles(t) => (t.rows(), t.columns()),
            Self::Charuco(t) => (t.rows(), t.columns()),
            Self::Chessboard(t) => (t.rows(), t.columns()),
        }
    }
    /// The same target with other numbers of rows and columns.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn resized(&self, rows: usize, columns: usize) -> Result<Self, TargetError> {
        Ok(match self {
            Self::Squares(t) => Self::Squares(t.resized(rows, columns)?),
            Self::AprilGrid(t) => Self::AprilGrid(t.resized(rows, columns)?),
            Self::Circles(t) => Self::Circles(t.resized(rows, columns)?),
            Self::Charuco(t) => Self::Charuco(t.resized(rows, columns)?),
            Self::Chessboard(t) => Self::Chessboard(t.resized(rows, columns)?),
        })
    }
    /// All points that calibration uses, row by row.
    #[must_use]
    pub fn points(&self) -> Vec<TargetPoint> {
        match self {
            Self::Squares(t) => t.points(),
            Self::AprilGrid(t) => t.points(),
            Self::Circles(t) => t.points(),
            Self::Charuco(t) => t.points(),
            Self::Chessboard(t) => t.points(),
        }
    }
    /// What is printed, in printing order: what comes later covers what came before.
    #[must_use]
    pub fn ink(&self) -> Vec<Ink> {
        match self {
            Self::Squares(t) => t.ink(),
            Self::AprilGrid(t) => t.ink(),
            Self::Circles(t) => t.ink(),
            Self::Charuco(t) => t.ink(),
            Self::Chessboard(t) => t.ink(),
        }
    }
}

/// Checks numbers of rows and columns.
fn checked_size(what: &'static str, rows: usize, columns: usize, least: usize) -> Result<(), TargetError> {
    if rows < least || columns < least {
        return Err(TargetError::TooFew { what, rows, columns, least });
    }
    if rows > 100 || columns > 100 {
        return Err(TargetError::TooMany { what, rows, columns });
    }
    Ok(())
}

/// Corner of a square in a lattice of squares `gap_m` apart: 0 upper left, 1 upper right, 2 lower right, 3 lower left
/// (modulo 4). Origin at the first square's upper left corner.
fn square_corner((row, column): (usize, usize), corner: usize, side_m: f64, gap_m: f64) -> BoardPoint {
    let pitch = side_m + gap_m;
    let (right, down) = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)][corner % 4];
    BoardPoint { x_m: column as f64 * pitch + right * side_m, y_m: row as f64 * pitch + down * side_m }
}

/// Checks that a length is positive.
fn checked_length(what: &'static str, metres: f64) -> Result<(), TargetError> {
    if metres.is_finite() && metres > 0.0 { Ok(()) } else { Err(TargetError::Length { what, metres }) }
}

pub(super) const STILL: BoardPoint = BoardPoint { x_m: 0.0, y_m: 0.0 };
