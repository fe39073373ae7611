//! The calibration target that a pipeline declares, as the library knows it.

use super::context::StageError;
use crate::calibration::{ChessboardTarget, Marker, SquaresTarget, Target};
use crate::config::target::{HollowSquare, Pattern, Target as Declared};

/// The target; with a number of rows and columns that means nothing when they are to be counted.
///
/// # Errors
/// [`StageError`] when the numbers are no target's.
pub fn target(declared: &Declared) -> Result<Target, StageError> {
    let (rows, columns) = declared.size.map_or((4, 4), |(rows, columns)| (rows as usize, columns as usize));
    let made = match &declared.pattern {
        Pattern::Squares { square_m, gap_m, hollow } => {
            let marker = match hollow {
                HollowSquare::UpperLeft => Marker::UpperLeft,
                HollowSquare::None => Marker::None,
            };
            SquaresTarget::new(rows, columns, *square_m, *gap_m, marker).map(Target::Squares)
        }
        Pattern::Chessboard { square_m } => {
            ChessboardTarget::new(rows, columns, *square_m).map(Target::Chessboard)
        }
        _ => unimplemented!(),
    };
    made.map_err(|e| StageError::pipeline(format!("[calibrate.target]: {e}")))
}
