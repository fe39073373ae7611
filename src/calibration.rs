//! Camera calibration from photos of a planar target.
//!
//! ```text
//! photo ──detect──▶ corners (blunt, refined, sharp) ──start──▶ closed form ──adjust──▶ Calibration
//!                                                                                    │
//!                compare: which lens · uncertainty: how well, where · advice: what to photograph next
//! ```
//!
//! [`detect`] finds the target's points, puts them on its lattice and locates them in the paper's three
//! steps; [`calibrate`] takes the points of three or more views to the interior parameters of
//! a lens, one pose per view and their covariance; [`compare`] does so with several lenses and chooses one;
//! [`projection_uncertainty`] says what the covariance means over the frame; [`advice()`] what would make it
//! smaller. Nothing here reads a file.
//!
//! # Source
//! Hemerly (2014), "Automatic Georeferencing of Images Acquired by UAV's", section 2, eqs. (1)–(5).

mod adjust;
mod advice;
mod board;
mod compare;
mod detect;
mod error;
mod grey;
mod mixed;
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
#[cfg(test)]
mod simulated;

pub use advice::{Advice, FramePart, NearEdge, NextPhoto, advice, next_photo};
pub use board::{Bend, BoardShape, Measured};
pub use compare::{Candidate, Comparison, Judgement, compare};
pub use detect::{
    DetectError, DetectedCorner, Detection, GridError, LatticeError, MarkerSeen, count, detect,
};
pub use error::CalibrationError;
pub use grey::{Grey, GreyError};
pub use model::LensModel;
pub use outliers::{Outlier, SuspectView};
pub use product::{Calibration, PointResidual, Support, View, ViewPoints};
pub use quality::{PhotoFault, PhotoQuality, photo_faults, photo_quality};
pub use solve::{Options, OutlierPolicy, calibrate, calibrate_with};
pub use start::StartError;
pub use target::{
    AprilGridTarget, Board, BoardPoint, CharucoTarget, ChessboardTarget, CircleLayout, CirclesTarget,
    Dictionary, Ink, Marker, Observation, Shape, SquaresTarget, TagOrder, TagPrint, Target, TargetError,
    TargetPoint,
};
pub use uncertainty::{ProjectionSpread, UncertaintyMap, UncertaintyNode, projection_uncertainty};
pub use zhang::ClosedForm;
