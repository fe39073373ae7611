//! What a run has to say, as numbers with names ([`numbers`]), as pictures ([`figures`]) and as one
//! self-contained page ([`page`]).
//!
//! Nothing is computed here: the page and the JSON show the same numbers, and the page rounds them to what
//! is known.

pub mod calibration;
pub mod contours;
pub mod coverage;
pub mod figures;
pub mod lens_figures;
pub mod match_figure;
pub mod numbers;
pub mod page;
pub mod sheet;

pub use calibration::CalibrationNumbers;
pub use figures::{Figure, FigureError};
pub use numbers::AccuracyNumbers;
pub use page::{Page, PageError, render};
pub use sheet::{Sheet, SheetError};
