//! From a photo to the labelled points of the target, each with the paper's three estimates.

mod april_grid;
mod areas;
mod charuco;
mod chessboard;
mod circles;
mod crossings;
mod grid;
mod lattice;
mod localise;
mod misfit;
mod plane;
mod quads;
mod saddle;
mod sharp;
mod squares;
mod step;
mod strays;
mod tags;

pub use grid::GridError;
pub use lattice::{LatticeError, MarkerSeen};

use super::grey::Grey;
use super::target::{BoardPoint, Observation, Target};
use crate::camera::ImagePoint;

/// Smallest photo that can hold a target, pixels.
const LEAST_SIZE_PX: usize = 32;

/// Why a photo gives no corners.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DetectError {
    /// Too small to hold a target.
    #[error("the photo is {width} × {height} px, too small to hold a target")]
    TooSmall {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Nothing to see.
    #[error("the photo has no contrast")]
    NoContrast,
    /// What was found does not make up the target.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
    /// The same for targets other than separated squares.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The target was found but its edges are not sharp enough.
    #[error(
        "only {located} of the {found} {what} found could be located exactly: the photo is blurred or the target is too small in it"
    )]
    Unsharp {
        /// What is counted, for example `squares`.
        what: &'static str,
        /// Located exactly.
        located: usize,
        /// Found.
        found: usize,
    },
}

/// One point of the target as found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectedCorner {
    /// Row on the target, from 0: see [`super::TargetPoint`].
    pub row: usize,
    /// Column on the target, from 0.
    pub column: usize,
    /// 0 upper left, 1 upper right, 2 lower right, 3 lower left corner of a square or tag; 0 for others.
    pub corner: usize,
    /// Where it is on the board.
    pub board: BoardPoint,
    /// See [`Observation::growth`].
    pub growth: BoardPoint,
    /// First estimate: from the bounding box; of an inner corner the pixel of the strongest response.
    pub blunt: ImagePoint,
    /// Second estimate: strongest Harris response, or centroid; of an inner corner where a ring meets its edges.
    pub refined: ImagePoint,
    /// Final estimate: from the edges.
    pub sharp: ImagePoint,
}

/// The target as seen in one photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// Points, row by row.
    pub corners: Vec<DetectedCorner>,
    /// Squares, inner corners, tags or circles of the target (row, column) that were hidden or not sharp enough.
    pub missing: Vec<(usize, usize)>,
    /// What stood at the marker's place.
    pub marker: MarkerSeen,
}

impl Detection {
    /// The sharp corners as observations for [`super::calibrate`].
    #[must_use]
    pub fn observations(&self) -> Vec<Observation> {
        self.corners
            .iter()
            .map(|corner| Observation { board: corner.board, growth: corner.growth, pixel: corner.sharp })
            .collect()
    }
}

/// Finds the target in a photo and locates its points.
///
/// - `image`: brightness as stored in the file, not turned by any orientation tag.
///
/// Whatever of the target is not found is listed as missing; enough must be found for the labels to be certain.
///
/// # Errors
/// [`DetectError`], with what was found.
///
/// # Source
/// Hemerly (2014), section 2: blunt, refined and sharp estimates.
pub fn detect(image: &Grey, target: &Target) -> Result<Detection, DetectError> {
    check(image)?;
    match target {
        Target::Squares(target) => squares::detect(image, target),
        Target::AprilGrid(target) => april_grid::detect(image, target),
        Target::Charuco(target) => charuco::detect(image, target),
        Target::Circles(target) => circles::detect(image, target),
        Target::Chessboard(target) => chessboard::detect(image, target),
    }
}

/// Rows and columns of the target that a photo shows, when they are not known.
///
/// - `target`: what is known of it; its own numbers of rows and columns are not looked at.
///
/// # Errors
/// [`DetectError`].
pub fn count(image: &Grey, target: &Target) -> Result<(usize, usize), DetectError> {
    check(image)?;
    match target {
        Target::Squares(target) => squares::count(image, target),
        Target::AprilGrid(target) => april_grid::count(image, target),
        Target::Charuco(target) => charuco::count(image, target),
        Target::Circles(target) => circles::count(image, target),
        Target::Chessboard(target) => chessboard::count(image, target),
    }
}

fn check(image: &Grey) -> Result<(), DetectError> {
    let (width, height) = (image.width(), image.height());
    if width.min(height) < LEAST_SIZE_PX {
        return Err(DetectError::TooSmall { width, height });
    }
    if image.range() <= f32::EPSILON {
        return Err(DetectError::NoContrast);
    }
    Ok(())
}
