//! Thin stage adapters: load, call, save.

pub mod context;
pub mod explain;
pub mod georeference;
pub mod mosaic;
pub mod simulate;

pub use context::{
    ErrorClass, FrameStatus, NoProgress, Progress, RunContext, Stage, StageError, StageRecord, TaskProgress,
};
