//! An elevation model: ellipsoidal heights on a map grid, bilinear between posts.

use super::{NoGround, Terrain};
use crate::geodesy::{Geodetic, MapPoint, MapProjection};
use crate::raster::{GridTransform, Raster};
use std::sync::Arc;

/// Ellipsoidal heights on a regular map grid.
#[derive(Clone)]
pub struct Dem {
    heights: Raster<f32>,
    grid: GridTransform,
    projection: Arc<dyn MapProjection>,
    range: (f64, f64),
    spacing_m: f64,
}

impl std::fmt::Debug for Dem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dem").field("grid", &self.grid).field("range", &self.range).finish_non_exhaustive()
    }
}

impl Dem {
    /// From ellipsoidal heights in metres (NaN: no data), the grid they lie on and the grid's projection.
    ///
    /// `spacing_m` is the posting in metres, for grids whose own unit is not the metre. `None` when no
    /// post holds data.
    #[must_use]
    pub fn new(
        heights: Raster<f32>,
        grid: GridTransform,
        projection: Arc<dyn MapProjection>,
        spacing_m: f64,
    ) -> Option<Self> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for h in heights.samples().iter().filter(|h| h.is_finite()) {
            low = low.min(f64::from(*h));
            high = high.max(f64::from(*h));
        }
        (low <= high).then_some(Self { heights, grid, projection, range: (low, high), spacing_m })
    }

    /// Height at a map position: bilinear between the four posts around it; within half a cell of the
    /// outermost posts the nearest post is used. A position any of whose posts holds no data has no height.
    fn height_at(&self, at: MapPoint) -> Result<f64, NoGround> {
        let (column, row) = self.grid.pixel_from_map(at);
        let (w, h) = (self.heights.width() as f64, self.heights.height() as f64);
        if !(column >= -0.5 && row >= -0.5 && column <= w - 0.5 && row <= h - 0.5) {
            return Err(NoGround::Outside);
        }
        let (column, row) = (column.clamp(0.0, w - 1.0), row.clamp(0.0, h - 1.0));
        let (c0, r0) = (column.floor() as usize, row.floor() as usize);
        let (c1, r1) = ((c0 + 1).min(self.heights.width() - 1), (r0 + 1).min(self.heights.height() - 1));
        let (fc, fr) = (column - c0 as f64, row - r0 as f64);
        let post = |c, r| f64::from(self.heights.at(c, r));
        let mut height = 0.0;
        for (c, r, weight) in [
            (c0, r0, (1.0 - fc) * (1.0 - fr)),
            (c1, r0, fc * (1.0 - fr)),
            (c0, r1, (1.0 - fc) * fr),
            (c1, r1, fc * fr),
        ] {
            // A post without weight may be empty: the position lies exactly on its neighbours.
            if weight > 0.0 {
                height += weight * post(c, r);
            }
        }
        if height.is_finite() { Ok(height) } else { Err(NoGround::NoData) }
    }
}

impl Terrain for Dem {
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
        match self.projection.map_from_geodetic(positions) {
            Ok(map) => map.into_iter().map(|p| self.height_at(p)).collect(),
            // One position without an image must not take its neighbours with it.
            Err(_) if positions.len() > 1 => {
                positions.iter().flat_map(|p| self.heights(std::slice::from_ref(p))).collect()
            }
            Err(_) => vec![Err(NoGround::Outside)],
        }
    }
    fn height_range(&self) -> (f64, f64) {
        self.range
    }
    fn spacing(&self) -> Option<f64> {
        Some(self.spacing_m)
    }
}

/// An elevation model with a stated constant height wherever it has none.
pub struct Filled<T> {
    /// The model.
    pub model: T,
    /// Ellipsoidal height used where the model has none, metres.
    pub fallback_m: f64,
}

impl<T: Terrain> Terrain for Filled<T> {
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
        self.model.heights(positions).into_iter().map(|h| Ok(h.unwrap_or(self.fallback_m))).collect()
    }
    fn height_range(&self) -> (f64, f64) {
        let (low, high) = self.model.height_range();
        (low.min(self.fallback_m), high.max(self.fallback_m))
    }
    fn spacing(&self) -> Option<f64> {
        self.model.spacing()
    }
}
