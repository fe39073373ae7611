//! An elevation model: ellipsoidal heights on a map grid, bilinear between posts.

use super::{NoGround, Terrain};
use crate::geodesy::{Geodetic, MapPoint, MapProjection};
use crate::raster::{GridTransform, Raster};
use crate::units::{Metres, Radians};
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
        self.height_at_pixel(self.grid.pixel_from_map(at))
    }

    fn height_at_pixel(&self, (column, row): (f64, f64)) -> Result<f64, NoGround> {
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

/// Batches from this size on are worth a [`Patch`].
const LARGE_BATCH: usize = 256;
/// A patch may be this far off, in postings.
const PATCH_TOLERANCE: f64 = 1e-4;

/// The way from latitude and longitude to the model's pixels over a small area: exact at nine nodes,
/// quadratic in between, checked against the projection itself.
struct Patch {
    south: f64,
    west: f64,
    half_height: f64,
    half_width: f64,
    /// Column and row of the model, node by node from the south-west, eastwards first.
    nodes: [(f64, f64); 9],
}

impl Patch {
    /// Around all positions; `None` where the projection is too rough for one patch, or fails.
    fn around(positions: &[Geodetic], dem: &Dem) -> Option<Self> {
        // Wider than a unit of the last place of any angle, should all positions be one.
        const LEAST: f64 = 1e-9;
        let range = |pick: fn(&Geodetic) -> f64| {
            let low = positions.iter().map(pick).fold(f64::INFINITY, f64::min);
            let high = positions.iter().map(pick).fold(f64::NEG_INFINITY, f64::max);
            (low, (0.5 * (high - low)).max(LEAST))
        };
        let (south, half_height) = range(|g| g.latitude.get());
        let (west, half_width) = range(|g| g.longitude.get());
        let at = |x: f64, y: f64| Geodetic {
            latitude: Radians::new(south + y * half_height),
            longitude: Radians::new(west + x * half_width),
            height: Metres::new(0.0),
        };
        let exact = |places: &[(f64, f64)]| -> Option<Vec<(f64, f64)>> {
            let places: Vec<Geodetic> = places.iter().map(|(x, y)| at(*x, *y)).collect();
            let map = dem.projection.map_from_geodetic(&places).ok()?;
            Some(map.into_iter().map(|p| dem.grid.pixel_from_map(p)).collect())
        };
        let steps = [0.0, 1.0, 2.0];
        let places: Vec<_> = steps.iter().flat_map(|y| steps.map(|x| (x, *y))).collect();
        let nodes = exact(&places)?.try_into().ok()?;
        let patch = Self { south, west, half_height, half_width, nodes };
        let checks = [(0.5, 0.5), (1.5, 0.5), (0.5, 1.5), (1.5, 1.5), (1.0, 0.4), (0.4, 1.0)];
        exact(&checks)?
            .iter()
            .zip(checks)
            .all(|(exact, (x, y))| {
                let near = patch.pixel(&at(x, y));
                (near.0 - exact.0).hypot(near.1 - exact.1) <= PATCH_TOLERANCE
            })
            .then_some(patch)
    }

    fn pixel(&self, g: &Geodetic) -> (f64, f64) {
        let weights = |t: f64| [0.5 * (t - 1.0) * (t - 2.0), t * (2.0 - t), 0.5 * t * (t - 1.0)];
        let by_x = weights((g.longitude.get() - self.west) / self.half_width);
        let by_y = weights((g.latitude.get() - self.south) / self.half_height);
        let (mut column, mut row) = (0.0, 0.0);
        for (nodes, wy) in self.nodes.chunks_exact(3).zip(by_y) {
            for (node, wx) in nodes.iter().zip(by_x) {
                column += wx * wy * node.0;
                row += wx * wy * node.1;
            }
        }
        (column, row)
    }
}

impl Terrain for Dem {
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
        if positions.len() >= LARGE_BATCH
            && let Some(patch) = Patch::around(positions, self)
        {
            return positions.iter().map(|g| self.height_at_pixel(patch.pixel(g))).collect();
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::ProjectionError;

    /// A transverse stretch with a twist: smooth, not linear.
    struct Curved;
    impl MapProjection for Curved {
        fn map_from_geodetic(&self, positions: &[Geodetic]) -> Result<Vec<MapPoint>, ProjectionError> {
            let map = |g: &Geodetic| {
                let (lat, lon) = (g.latitude.get(), g.longitude.get());
                MapPoint { easting: 6.4e6 * lon * lat.cos(), northing: 6.4e6 * (lat + 0.1 * lon * lon) }
            };
            Ok(positions.iter().map(map).collect())
        }
        fn geodetic_from_map(&self, at: &[MapPoint]) -> Result<Vec<Geodetic>, ProjectionError> {
            Err(ProjectionError::NoInverse {
                easting: at[0].easting,
                northing: at[0].northing,
                crs: "one way".to_owned(),
            })
        }
    }

    #[test]
    fn large_batches_give_the_heights_of_small_ones() {
        let (south, west) = (0.7, 0.02);
        let corner = Curved
            .map_from_geodetic(&[Geodetic {
                latitude: Radians::new(south),
                longitude: Radians::new(west),
                height: Metres::new(0.0),
            }])
            .unwrap()[0];
        let posts = (0..400 * 400).map(|i| 5.0 * ((i % 400) as f32 * 0.2).sin() + (i / 400) as f32 * 0.5);
        let heights = Raster::new(400, 400, posts.collect()).unwrap();
        // Off the grid lines: on the model's very rim the last bit decides between a height and none.
        let corner = MapPoint { easting: corner.easting - 20.0, northing: corner.northing + 601.3 };
        let dem = Dem::new(heights, GridTransform::north_up(corner, 2.0), Arc::new(Curved), 2.0).unwrap();
        for metres in [50.0, 500.0, 2000.0] {
            let positions: Vec<Geodetic> = (0..40 * 40)
                .map(|i| Geodetic {
                    latitude: Radians::new(south + f64::from(i / 40) / 40.0 * metres / 6.4e6),
                    longitude: Radians::new(west + f64::from(i % 40) / 40.0 * metres / 6.4e6),
                    height: Metres::new(0.0),
                })
                .collect();
            for (position, height) in positions.iter().zip(dem.heights(&positions)) {
                match (height, dem.heights(&[*position])[0]) {
                    (Ok(a), Ok(b)) => assert!((a - b).abs() < 1e-3, "{a} {b}"),
                    (a, b) => assert_eq!(a, b),
                }
            }
        }
    }
}
