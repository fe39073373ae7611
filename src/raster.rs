//! Rasters in memory, pixel grids and resampling.
