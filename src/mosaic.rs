//! Georeferenced frames to one mosaic, tile by tile.
//!
//! ```text
//! frames + grid ──plan──▶ tiles ──render_tile──▶ pixels of one tile
//!                          each: which frames     map → ground → frame pixel → sample → blend
//! ```
//!
//! The plan is made before any image is decoded. A tile is a pure function of the plan and the tile's
//! index: tiles may be rendered in any order, on any thread or machine, and come out the same. Every
//! output pixel is made in one resampling step from the source frames; there are no intermediate orthos.
//!
//! An output pixel takes part of a frame only where its ground point is seen by that frame's lens inside
//! that frame's image; everything else is transparent. Whether the ground in between hides the point is
//! not asked.

mod ground;
mod mapping;
mod plan;
mod render;
mod schedule;
mod weight;

#[cfg(test)]
mod tests;

pub use plan::{
    Blend, MapBounds, MosaicPlan, PlanError, PlanSettings, PlannedFrame, TILE, Tile, Window, automatic_gsd_m,
};
pub use render::{FrameFailure, FrameSource, RenderError, TilePixels, render_tile, stored_channels};
pub use schedule::{ScheduleError, render_all};
