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

mod adjust;
mod board;
mod detect;
mod grey;
mod model;
mod outliers;
mod product;
mod quality;
mod solve;
mod start;
mod support;
mod target;
mod uncertainty;
mod zhang;

#[cfg(test)]
mod rendered;

pub use board::{Bend, BoardShape, Measured};
pub use detect::{DetectError, DetectedCorner, Detection, LatticeError, MarkerSeen, count, detect};
pub use grey::{Grey, GreyError};
pub use model::LensModel;
pub use outliers::{Outlier, SuspectView};
pub use product::{Calibration, PointResidual, Support, View, ViewPoints};
pub use quality::{PhotoFault, PhotoQuality, photo_faults, photo_quality};
pub use solve::{CalibrationError, Options, OutlierPolicy, calibrate, calibrate_with};
pub use start::StartError;
pub use target::{
    Board, BoardPoint, ChessboardTarget, Ink, Marker, Observation, Shape, SquaresTarget, Target, TargetError, TargetPoint,
};
pub use uncertainty::{ProjectionSpread, UncertaintyMap, UncertaintyNode, projection_uncertainty};
pub use zhang::ClosedForm;
