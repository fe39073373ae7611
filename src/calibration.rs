//! Camera calibration from photos of a planar target.
//!
//! ```text
//! photo ──detect──▶ corners (blunt, refined, sharp) ──zhang──▶ closed-form start ──solve──▶ Calibration
//! ```
//!
//! [`detect`] finds the target's points, puts them on its lattice and locates them in the paper's three
//! steps; [`calibrate`] takes the corners of three or more views to the ten interior
//! parameters, one pose per view and their covariance. Nothing here reads a file.
//!
//! # Source
//! Hemerly (2014), "Automatic Georeferencing of Images Acquired by UAV's", section 2, eqs. (1)–(5).

mod detect;
mod grey;
mod product;
mod solve;
mod target;
mod zhang;

#[cfg(test)]
mod rendered;

pub use detect::{DetectError, DetectedCorner, Detection, LatticeError, MarkerSeen, count, detect};
pub use grey::{Grey, GreyError};
pub use product::{Calibration, PointResidual, Support, View, ViewPoints};
pub use solve::{CalibrationError, Lens, LensModel, calibrate};
pub use target::{
    Board, BoardPoint, ChessboardTarget, Ink, Marker, Observation, Shape, SquaresTarget, Target, TargetError,
    TargetPoint,
};
pub use zhang::{ClosedForm, StartError};
