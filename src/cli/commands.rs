//! One file per command: load, call, print.

pub mod camera;
pub mod check;
pub mod completions;
pub mod explain;
pub mod init;
pub mod locate;
pub mod run;
pub mod schema;
pub mod simulate;
pub mod target;
