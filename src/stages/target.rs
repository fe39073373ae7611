//! The calibration target that a pipeline declares, as the library knows it.

use super::context::StageError;
use crate::calibration::{
    AprilGridTarget, CharucoTarget, ChessboardTarget, CircleLayout, CirclesTarget, Dictionary, Marker,
    SquaresTarget, TagOrder, TagPrint, Target,
};
use crate::config::target::{FirstTag, HollowSquare, Pattern, Target as Declared};

/// The target; with a number of rows and columns that means nothing when they are to be counted.
///
/// # Errors
/// [`StageError`] when the numbers are no target's, or a dictionary is not known.
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
        Pattern::Charuco { square_m, marker_m, dictionary, first_marker, legacy } => {
            let dictionary = named(dictionary)?;
            let first = *first_marker as usize;
            CharucoTarget::new(rows, columns, *square_m, *marker_m, dictionary, first, *legacy)
                .map(Target::Charuco)
        }
        Pattern::AprilGrid { tag_m, gap_m, dictionary, first_marker, first_tag, border_cells, joints } => {
            let print = TagPrint {
                family: named(dictionary)?,
                first: *first_marker as usize,
                order: match first_tag {
                    FirstTag::LowerLeft => TagOrder::FromLowerLeft,
                    FirstTag::UpperLeft => TagOrder::FromUpperLeft,
                },
                border: *border_cells as usize,
                corner_squares: *joints,
            };
            AprilGridTarget::new(rows, columns, *tag_m, *gap_m, print).map(Target::AprilGrid)
        }
        Pattern::Circles { spacing_m, diameter_m, asymmetric } => {
            let layout = if *asymmetric { CircleLayout::Asymmetric } else { CircleLayout::Symmetric };
            CirclesTarget::new(rows, columns, *spacing_m, *diameter_m, layout).map(Target::Circles)
        }
    };
    made.map_err(|e| StageError::pipeline(format!("[calibrate.target]: {e}")))
}

fn named(name: &str) -> Result<&'static Dictionary, StageError> {
    Dictionary::named(name).ok_or_else(|| {
        let known = Dictionary::names().collect::<Vec<_>>();
        let near = known.iter().copied().max_by(|a, b| {
            let closeness = |k: &str| strsim::jaro_winkler(&k.to_lowercase(), &name.to_lowercase());
            closeness(a).total_cmp(&closeness(b))
        });
        StageError::pipeline(format!("[calibrate.target]: there is no dictionary \"{name}\""))
            .help(near.map_or_else(String::new, |near| format!("did you mean `{near}`?")))
            .help(format!("known are {}", known.join(", ")))
    })
}
