//! Thin stage adapters: load, call, save.

pub mod accuracy;
pub mod calibrate;
pub mod camera;
pub mod context;
pub mod doctor;
pub mod explain;
pub mod georeference;
pub mod init;
pub mod locate;
pub mod mosaic;
pub mod page;
pub mod session;
pub mod simulate;
pub mod target;

pub use context::{
    ErrorClass, FrameStatus, NoProgress, Progress, RunContext, Stage, StageError, StageRecord, TaskProgress,
};
