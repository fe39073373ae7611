//! boresight turns the photos of a UAV and the log of its attitude-and-position unit (ADAHRS) into a
//! georeferenced mosaic with a stated accuracy, without ground control points.
//!
//! The modules stand in the order of a run. Reading them from top to bottom follows a pixel from the
//! photo to the map; each module may import only what stands above it (`ARCHITECTURE.md` holds the
//! table, and a test enforces it).
//!
//! The frames, axes, units, pixel origin, heights and angle senses are those of [`conventions`].

#[doc = include_str!("../CONVENTIONS.md")]
pub mod conventions {}

// Floor 0: scalars.
pub mod units;
// Floor 1: frames, points, poses.
pub mod geometry;
// Floor 2: the Earth, and rasters.
pub mod geodesy;
pub mod raster;
// Floor 3: what the run is given.
pub mod camera;
pub mod navigation;
pub mod terrain;
// Floor 4: one module per product, in the order of a run.
pub mod accuracy;
pub mod calibration;
pub mod georeference;
pub mod mosaic;
// Floor 4': scenes with known truth. Its renderer shares no geometry with the modules above.
pub mod synthetic;
// Floor 5: bytes and text.
pub mod config;
pub mod formats;
pub mod report;
// Floor 6: load, call, save.
pub mod stages;
// Floor 7: the run.
pub mod pipeline;
// Floor 8: the command line.
pub mod cli;
