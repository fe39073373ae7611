//! Rasters in memory, the grids they lie on, and resampling.
//!
//! A raster's pixel (0, 0) is the *centre* of its top-left cell, here as in images; the corner that
//! GeoTIFF counts from is converted in `formats` and nowhere else.

mod grid;
mod image;
mod resample;

pub use grid::GridTransform;
pub use image::{Image8, ImagePyramid};
pub use resample::{Kernel, Run, sample_run};

/// Samples of one band, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster<T> {
    width: usize,
    height: usize,
    samples: Vec<T>,
}

impl<T: Copy> Raster<T> {
    /// From samples row by row; `None` when their number is not width × height.
    #[must_use]
    pub fn new(width: usize, height: usize, samples: Vec<T>) -> Option<Self> {
        (width.checked_mul(height)? == samples.len()).then_some(Self { width, height, samples })
    }
    /// One value everywhere.
    #[must_use]
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, samples: vec![value; width * height] }
    }
    /// Columns.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }
    /// Rows.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }
    /// The sample at a column and row inside the raster.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> T {
        self.samples[row * self.width + column]
    }
    /// Sets the sample at a column and row inside the raster.
    pub fn set(&mut self, column: usize, row: usize, value: T) {
        self.samples[row * self.width + column] = value;
    }
    /// All samples, row by row.
    #[must_use]
    pub fn samples(&self) -> &[T] {
        &self.samples
    }
}
