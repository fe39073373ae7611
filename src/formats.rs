//! Files to types and back: the only user of the file system below the engine.
//!
//! Whatever a file says in its own units, senses, datums, CRS and pixel origin leaves here in ours
//! (`CONVENTIONS.md`).

pub mod atomic;
pub mod crs;
pub mod files;
pub mod geoid;
