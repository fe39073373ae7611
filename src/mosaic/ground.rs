//! The ground under one tile, in ECEF, at any of its pixels.
//!
//! A map position's point on the ellipsoid and the direction straight up are smooth over a tile, so they
//! are projected exactly at a few nodes and interpolated quadratically in between, checked against exact
//! values. With the ground's height `h`, the ground point is `surface + h · up` without approximation.

use super::plan::Window;
use super::render::RenderError;
use crate::geodesy::{Geodetic, MapPoint, MapProjection, ProjectionError, WGS84};
use crate::geometry::{Ecef, Point};
use crate::raster::GridTransform;
use crate::terrain::Terrain;
use crate::units::{Metres, Radians};
use nalgebra::{SVector, Vector3};
use std::sync::Arc;

/// The interpolated surface may be this fraction of a pixel off.
const SURFACE_TOLERANCE_PX: f64 = 0.002;
/// Smallest patch tried before the projection is called unfit, pixels.
const SMALLEST_PATCH: usize = 8;

/// Surface point (3), up vector (3), latitude, longitude relative to the tile's first node.
type Node = SVector<f64, 8>;

/// The ground under one tile. Positions are in pixels of the tile: (0, 0) is the centre of its top-left
/// pixel, and the right and bottom padding of a partial tile belongs to it.
pub(super) struct TileGround {
    patch: f64,
    patches: usize,
    nodes: Vec<Node>,
    first_longitude: f64,
    /// Side of the padded tile, pixels.
    side: usize,
    heights: Vec<(Arc<dyn Terrain>, HeightField)>,
    /// Length of one pixel on the ground, metres.
    pub(super) pixel_m: f64,
}

/// Heights of one terrain at whole pixels of the padded tile, found when first needed.
enum HeightField {
    Constant(f64),
    /// NaN: not asked yet; -∞: no ground there.
    Sampled(Vec<f64>),
}

/// One terrain of a tile: see [`TileGround::terrain`].
#[derive(Clone, Copy)]
pub(super) struct TerrainIndex(usize);

impl TileGround {
    pub(super) fn new(
        projection: &dyn MapProjection,
        grid: &GridTransform,
        window: &Window,
        side: usize,
    ) -> Result<Self, RenderError> {
        let project = |positions: &[(f64, f64)]| -> Result<Vec<Geodetic>, ProjectionError> {
            let map: Vec<MapPoint> = positions
                .iter()
                .map(|(c, r)| grid.map_from_pixel(window.column as f64 + c, window.row as f64 + r))
                .collect();
            projection.geodetic_from_map(&map)
        };
        let mut patches = 1;
        loop {
            let patch = side as f64 / patches as f64;
            let at = |count: usize, offset: f64, step: f64| {
                (0..count * count)
                    .map(|i| (offset + step * (i % count) as f64, offset + step * (i / count) as f64))
                    .collect::<Vec<_>>()
            };
            let exact = project(&at(2 * patches + 1, 0.0, 0.5 * patch))?;
            let first_longitude = exact[0].longitude.get();
            let nodes: Vec<Node> = exact.iter().map(|g| node(g, first_longitude)).collect();
            let pixel_m = (nodes[1].fixed_rows::<3>(0) - nodes[0].fixed_rows::<3>(0)).norm() / (0.5 * patch);
            let ground = Self { patch, patches, nodes, first_longitude, side, heights: Vec::new(), pixel_m };
            let checks = at(2 * patches, 0.25 * patch, 0.5 * patch);
            let worst = project(&checks)?
                .iter()
                .zip(&checks)
                .map(|(g, (c, r))| {
                    let off = node(g, first_longitude) - ground.interpolate(*c, *r);
                    // Up by as many metres as the highest ground could be off the ellipsoid.
                    off.fixed_rows::<3>(0).norm() + 9000.0 * off.fixed_rows::<3>(3).norm()
                })
                .fold(0.0, f64::max);
            if worst <= SURFACE_TOLERANCE_PX * pixel_m {
                return Ok(ground);
            }
            patches *= 2;
            if side / patches < SMALLEST_PATCH {
                return Err(RenderError::RoughProjection {
                    column: window.column,
                    row: window.row,
                    off_m: worst,
                });
            }
        }
    }

    fn interpolate(&self, column: f64, row: f64) -> Node {
        self.interpolate_rows::<8>(column, row, 0)
    }

    /// `N` of a node's components, from `first` on.
    fn interpolate_rows<const N: usize>(&self, column: f64, row: f64, first: usize) -> SVector<f64, N> {
        let along = |at: f64| {
            let index = ((at / self.patch) as usize).min(self.patches - 1);
            let t = 2.0 * (at / self.patch - index as f64);
            let weights = [0.5 * (t - 1.0) * (t - 2.0), t * (2.0 - t), 0.5 * t * (t - 1.0)];
            (2 * index, weights)
        };
        let (c0, by_column) = along(column);
        let (r0, by_row) = along(row);
        let stride = 2 * self.patches + 1;
        let mut sum = SVector::<f64, N>::zeros();
        for (r, wr) in by_row.iter().enumerate() {
            for (c, wc) in by_column.iter().enumerate() {
                let node = &self.nodes[(r0 + r) * stride + c0 + c];
                sum += node.fixed_rows::<N>(first) * (wr * wc);
            }
        }
        sum
    }

    /// Side of the padded tile, pixels.
    pub(super) const fn side(&self) -> usize {
        self.side
    }

    /// Surface point and up vector at a pixel.
    pub(super) fn surface(&self, column: usize, row: usize) -> (Vector3<f64>, Vector3<f64>) {
        let node = self.interpolate_rows::<6>(column as f64, row as f64, 0);
        (node.fixed_rows::<3>(0).into_owned(), node.fixed_rows::<3>(3).into_owned())
    }

    /// Makes a terrain known to the tile; frames that share one share its heights.
    pub(super) fn terrain(&mut self, terrain: &Arc<dyn Terrain>) -> TerrainIndex {
        let address = |t: &Arc<dyn Terrain>| Arc::as_ptr(t).cast::<()>();
        let known = self.heights.iter().position(|(t, _)| address(t) == address(terrain));
        TerrainIndex(known.unwrap_or_else(|| {
            let field = if terrain.spacing().is_none() {
                HeightField::Constant(terrain.height_range().1)
            } else {
                HeightField::Sampled(vec![f64::NAN; (self.side + 1) * (self.side + 1)])
            };
            self.heights.push((Arc::clone(terrain), field));
            self.heights.len() - 1
        }))
    }

    /// Finds the heights of a terrain at pixels, in one batch.
    pub(super) fn prepare(&mut self, terrain: TerrainIndex, pixels: impl Iterator<Item = (usize, usize)>) {
        let side = self.side;
        let HeightField::Sampled(known) = &mut self.heights[terrain.0].1 else {
            return;
        };
        let mut wanted: Vec<(usize, usize)> = Vec::new();
        for (c, r) in pixels {
            let slot = &mut known[r * (side + 1) + c];
            if slot.is_nan() {
                // Marked at once so that a pixel asked for twice is looked up once.
                *slot = f64::NEG_INFINITY;
                wanted.push((c, r));
            }
        }
        if wanted.is_empty() {
            return;
        }
        let positions: Vec<Geodetic> = wanted
            .iter()
            .map(|(c, r)| {
                let node = self.interpolate_rows::<2>(*c as f64, *r as f64, 6);
                Geodetic {
                    latitude: Radians::new(node[0]),
                    longitude: Radians::new(node[1] + self.first_longitude).wrapped(),
                    height: Metres::new(0.0),
                }
            })
            .collect();
        let (terrain, field) = &mut self.heights[terrain.0];
        if let HeightField::Sampled(known) = field {
            for ((c, r), height) in wanted.into_iter().zip(terrain.heights(&positions)) {
                known[r * (side + 1) + c] = height.unwrap_or(f64::NEG_INFINITY);
            }
        }
    }

    /// Ground height at a pixel that was prepared; `None` where there is no ground.
    pub(super) fn height(&self, terrain: TerrainIndex, column: usize, row: usize) -> Option<f64> {
        let height = match &self.heights[terrain.0].1 {
            HeightField::Constant(height) => *height,
            HeightField::Sampled(known) => known[row * (self.side + 1) + column],
        };
        height.is_finite().then_some(height)
    }
}

/// The ground point of height `h` over a surface point.
pub(super) fn raised(surface: &(Vector3<f64>, Vector3<f64>), h: f64) -> Point<Ecef> {
    Point::from_vector(surface.0 + surface.1 * h)
}

fn node(g: &Geodetic, first_longitude: f64) -> Node {
    let surface = WGS84.ecef_from_geodetic(&g.at_height(0.0)).vector();
    let up = g.up().vector();
    let longitude = Radians::new(g.longitude.get() - first_longitude).wrapped();
    Node::from([surface.x, surface.y, surface.z, up.x, up.y, up.z, g.latitude.get(), longitude.get()])
}
