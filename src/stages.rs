//! Thin stage adapters: load, call, save.

pub mod context;

pub use context::{
    ErrorClass, FrameStatus, NoProgress, Progress, RunContext, Stage, StageError, StageRecord, TaskProgress,
};
