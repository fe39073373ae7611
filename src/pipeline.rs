//! The run: which stages in which order, the folder they fill, the manifest that says what is in it.
//!
//! Knows nothing of photos or poses: a stage is something that runs with a context and leaves a record.

pub mod execute;
pub mod folder;
pub mod inputs;
mod line;
pub mod manifest;
pub mod plan;
mod timed;

pub use execute::{Outcome, RunOptions, Stages, execute};
pub use plan::{Action, Plan};
