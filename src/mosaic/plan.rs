//! What will be rendered: the grid, its tiles, and which frames may touch which tile.

use super::weight::EdgeWeight;
use crate::geodesy::{MapPoint, MapProjection, ProjectionError};
use crate::georeference::GeoreferencedFrame;
use crate::raster::{GridTransform, Kernel};
use std::sync::Arc;

/// Side of a tile, pixels. A multiple of 16 (the mapping's coarsest cell) and the block size of the file.
pub const TILE: usize = 512;
/// Most pixels a mosaic may have: what 32-bit software still opens.
const MOST_PIXELS: f64 = 2_147_483_648.0;
/// A mosaic this many times larger than all its footprints together is no survey but a wild pose.
const MOST_AREA_OVER_FOOTPRINTS: f64 = 200.0;

/// How frames that overlap are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Blend {
    /// Each pixel from the one frame in which it lies farthest from the edge; the first frame when equal.
    None,
    /// Mean of all frames, weighted by the square of the distance to each frame's edge.
    #[default]
    Feather,
}

/// A rectangle on the map, in map units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapBounds {
    /// Least easting.
    pub west: f64,
    /// Least northing.
    pub south: f64,
    /// Greatest easting.
    pub east: f64,
    /// Greatest northing.
    pub north: f64,
}

impl MapBounds {
    /// The smallest rectangle around points; `None` without points.
    #[must_use]
    pub fn around(points: &[MapPoint]) -> Option<Self> {
        let first = points.first()?;
        let start =
            Self { west: first.easting, south: first.northing, east: first.easting, north: first.northing };
        Some(points.iter().fold(start, |b, p| Self {
            west: b.west.min(p.easting),
            south: b.south.min(p.northing),
            east: b.east.max(p.easting),
            north: b.north.max(p.northing),
        }))
    }
    /// The smallest rectangle around both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self {
            west: self.west.min(other.west),
            south: self.south.min(other.south),
            east: self.east.max(other.east),
            north: self.north.max(other.north),
        }
    }
    /// Extent along the easting.
    #[must_use]
    pub fn width(&self) -> f64 {
        self.east - self.west
    }
    /// Extent along the northing.
    #[must_use]
    pub fn height(&self) -> f64 {
        self.north - self.south
    }
    fn widened(&self, by: f64) -> Self {
        Self { west: self.west - by, south: self.south - by, east: self.east + by, north: self.north + by }
    }
}

/// What the user decides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanSettings {
    /// Ground sample distance in metres; `None`: the median of the frames' own, rounded down to two
    /// significant digits.
    pub gsd_m: Option<f64>,
    /// Part of the map to render; `None`: everything the frames see.
    pub bounds: Option<MapBounds>,
    /// Metres in one map unit.
    pub metres_per_unit: f64,
    /// 1 for a grey mosaic, 3 for colour.
    pub channels: usize,
    /// Resampling.
    pub kernel: Kernel,
    /// Blending.
    pub blend: Blend,
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Nothing to render.
    #[error("there are no frames to make a mosaic of")]
    NoFrames,
    /// The ground sample distance is unusable.
    #[error("a ground sample distance of {gsd_m} m is unusable: it must be finite and positive")]
    Gsd {
        /// Asked for, or found.
        gsd_m: f64,
    },
    /// A frame lies outside the map projection.
    #[error("frame {frame} does not fit on the map: {source}")]
    Projection {
        /// Its name.
        frame: String,
        /// Why.
        source: ProjectionError,
    },
    /// The bounds are empty.
    #[error("the bounds west {west}, south {south}, east {east}, north {north} enclose nothing")]
    EmptyBounds {
        /// As given.
        west: f64,
        /// As given.
        south: f64,
        /// As given.
        east: f64,
        /// As given.
        north: f64,
    },
    /// No frame sees anything inside the bounds.
    #[error("no frame sees anything inside the bounds")]
    NothingInside,
    /// The mosaic would be absurdly large.
    #[error(
        "the mosaic would be {width:.0} × {height:.0} pixels ({over_footprints:.0} times the area of all \
         footprints together); without frame {frame} it would be {other_width:.0} × {other_height:.0}: \
         check that frame's pose, choose a larger gsd, or give bounds"
    )]
    TooLarge {
        /// Columns.
        width: f64,
        /// Rows.
        height: f64,
        /// Area of the canvas over the sum of the footprints' areas.
        over_footprints: f64,
        /// The frame whose absence shrinks the mosaic most.
        frame: String,
        /// Columns without it.
        other_width: f64,
        /// Rows without it.
        other_height: f64,
    },
}

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub column: usize,
    /// First row.
    pub row: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// One tile of the mosaic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tile {
    /// Its place in the mosaic.
    pub window: Window,
    /// Frames that may touch it, ascending.
    pub frames: Vec<usize>,
}

/// A frame as the plan sees it.
#[derive(Debug, Clone)]
pub struct PlannedFrame {
    /// The frame.
    pub frame: GeoreferencedFrame,
    /// The outline of its footprint on the map.
    pub outline: Vec<MapPoint>,
    /// A rectangle that holds every map position it can see.
    pub reach: MapBounds,
    /// Area of its footprint, square map units.
    pub area: f64,
    /// How its pixels count; shared by the frames of one camera.
    pub(super) weight: Arc<EdgeWeight>,
}

/// Everything needed to render any tile, but for the pixels of the frames.
#[derive(Clone)]
pub struct MosaicPlan {
    /// Frames in the order of blending.
    pub frames: Vec<PlannedFrame>,
    /// The map.
    pub projection: Arc<dyn MapProjection>,
    /// Where the pixels lie: north up, square, corners at whole multiples of the cell.
    pub grid: GridTransform,
    /// Side of a pixel, map units.
    pub cell: f64,
    /// Side of a pixel, metres.
    pub gsd_m: f64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1 or 3.
    pub channels: usize,
    /// Resampling.
    pub kernel: Kernel,
    /// Blending.
    pub blend: Blend,
    /// Tiles, row by row from the north-west.
    pub tiles: Vec<Tile>,
}

impl std::fmt::Debug for MosaicPlan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MosaicPlan")
            .field("grid", &self.grid)
            .field("width", &self.width)
            .field("height", &self.height)
            .field("frames", &self.frames.len())
            .finish_non_exhaustive()
    }
}

impl MosaicPlan {
    /// Lays the grid and deals the frames out to the tiles. No image is opened.
    ///
    /// The grid's lines lie at whole multiples of the cell (GDAL's `-tap`), so that mosaics of the same
    /// GSD register with each other. The canvas is bounded before anything is allocated.
    ///
    /// # Errors
    /// [`PlanError`].
    pub fn new(
        frames: Vec<GeoreferencedFrame>,
        projection: Arc<dyn MapProjection>,
        settings: &PlanSettings,
    ) -> Result<Self, PlanError> {
        let gsd_m = match settings.gsd_m {
            Some(gsd_m) => gsd_m,
            None => automatic_gsd_m(&frames)?,
        };
        let cell = gsd_m / settings.metres_per_unit;
        if !(gsd_m > 0.0 && gsd_m.is_finite() && cell > 0.0 && cell.is_finite()) {
            return Err(PlanError::Gsd { gsd_m });
        }
        let mut planned: Vec<PlannedFrame> = Vec::with_capacity(frames.len());
        for frame in frames {
            let known = planned.iter().find(|p| {
                Arc::ptr_eq(&p.frame.camera, &frame.camera) && p.frame.pixel_rotation == frame.pixel_rotation
            });
            let weight = known.map_or_else(|| Arc::new(EdgeWeight::of(&frame)), |p| Arc::clone(&p.weight));
            planned.push(PlannedFrame::new(frame, weight, projection.as_ref(), cell)?);
        }
        let frames = planned;
        let canvas = canvas(&frames, settings.bounds.as_ref(), cell)?;
        let width = (canvas.width() / cell).round() as usize;
        let height = (canvas.height() / cell).round() as usize;
        let corner = MapPoint { easting: canvas.west, northing: canvas.north };
        let mut plan = Self {
            frames,
            projection,
            grid: GridTransform::north_up(corner, cell),
            cell,
            gsd_m,
            width,
            height,
            channels: settings.channels,
            kernel: settings.kernel,
            blend: settings.blend,
            tiles: Vec::new(),
        };
        plan.tiles = plan.deal();
        Ok(plan)
    }

    fn deal(&self) -> Vec<Tile> {
        let mut tiles: Vec<Tile> = Vec::new();
        for row in (0..self.height).step_by(TILE) {
            for column in (0..self.width).step_by(TILE) {
                let window = Window {
                    column,
                    row,
                    width: TILE.min(self.width - column),
                    height: TILE.min(self.height - row),
                };
                let frames =
                    (0..self.frames.len()).filter(|i| self.pixels_of(*i, &window).is_some()).collect();
                tiles.push(Tile { window, frames });
            }
        }
        tiles
    }

    /// The part of a window that a frame can reach.
    pub(super) fn pixels_of(&self, frame: usize, window: &Window) -> Option<Window> {
        let reach = &self.frames[frame].reach;
        let (west, north) = self.grid.pixel_from_map(MapPoint { easting: reach.west, northing: reach.north });
        let (east, south) = self.grid.pixel_from_map(MapPoint { easting: reach.east, northing: reach.south });
        let clip = |low: f64, high: f64, first: usize, count: usize| {
            let low = low.ceil().max(first as f64);
            let high = high.floor().min((first + count) as f64 - 1.0);
            (low <= high).then(|| (low as usize, (high - low) as usize + 1))
        };
        let (column, width) = clip(west, east, window.column, window.width)?;
        let (row, height) = clip(north, south, window.row, window.height)?;
        Some(Window { column, row, width, height })
    }

    /// Tile indices in an order in which neighbours follow each other, so that a frame once decoded serves
    /// the tiles it touches: a snake whose strokes run along the shorter side.
    #[must_use]
    pub fn order(&self) -> Vec<usize> {
        let (columns, rows) = (self.width.div_ceil(TILE), self.height.div_ceil(TILE));
        let (strokes, length, along_rows) =
            if columns <= rows { (rows, columns, true) } else { (columns, rows, false) };
        (0..strokes)
            .flat_map(|stroke| {
                (0..length).map(move |step| {
                    let step = if stroke % 2 == 0 { step } else { length - 1 - step };
                    if along_rows { stroke * columns + step } else { step * columns + stroke }
                })
            })
            .collect()
    }
}

impl PlannedFrame {
    fn new(
        frame: GeoreferencedFrame,
        weight: Arc<EdgeWeight>,
        projection: &dyn MapProjection,
        cell: f64,
    ) -> Result<Self, PlanError> {
        let on_map = |positions: &[_]| {
            projection
                .map_from_geodetic(positions)
                .map_err(|source| PlanError::Projection { frame: frame.name.clone(), source })
        };
        let corners: Vec<_> = frame.footprint.outline.iter().map(|v| v.position).collect();
        let outline = on_map(&corners)?;
        let mut seen = outline.clone();
        // Over relief the outline stops at the first ridge, yet ground anywhere between the lowest and the
        // highest level may project into the image: the rays of the border at those two levels bound it.
        if frame.ground.spacing().is_some() {
            let (lowest, highest) = frame.ground.height_range();
            let levels: Vec<_> = frame
                .footprint
                .outline
                .iter()
                .flat_map(|v| [lowest, highest].map(|h| (v.pixel, h)))
                .filter_map(|(pixel, h)| frame.ground_from_pixel_at_height(pixel, h).ok())
                .map(|ground| ground.position)
                .collect();
            seen.extend(on_map(&levels)?);
        }
        let reach = MapBounds::around(&seen).ok_or(PlanError::NoFrames)?;
        // The outline is a polygon through points of a curve: a hundredth of its size covers the bulges.
        let margin = 2.0 * cell + 0.01 * reach.width().max(reach.height());
        let area = area(&outline);
        Ok(Self { reach: reach.widened(margin), outline, area, weight, frame })
    }

    fn extent(&self) -> MapBounds {
        MapBounds::around(&self.outline).unwrap_or(self.reach)
    }
}

/// Area of a polygon, by the shoelace formula about its first vertex.
fn area(outline: &[MapPoint]) -> f64 {
    let Some(origin) = outline.first() else {
        return 0.0;
    };
    let twice: f64 = outline
        .iter()
        .zip(outline.iter().cycle().skip(1))
        .map(|(a, b)| {
            (a.easting - origin.easting) * (b.northing - origin.northing)
                - (b.easting - origin.easting) * (a.northing - origin.northing)
        })
        .sum();
    0.5 * twice.abs()
}

/// The ground sample distance of a mosaic that was given none: the median of the frames' own, rounded down
/// to two significant digits, metres.
///
/// # Errors
/// [`PlanError::NoFrames`] and [`PlanError::Gsd`].
pub fn automatic_gsd_m(frames: &[GeoreferencedFrame]) -> Result<f64, PlanError> {
    let mut all: Vec<f64> = frames.iter().map(|f| f.footprint.gsd_m).collect();
    all.sort_by(f64::total_cmp);
    let median = match all.len() {
        0 => return Err(PlanError::NoFrames),
        n if n % 2 == 1 => all[n / 2],
        n => 0.5 * (all[n / 2 - 1] + all[n / 2]),
    };
    if !(median > 0.0 && median.is_finite()) {
        return Err(PlanError::Gsd { gsd_m: median });
    }
    // Steps of 10^(exponent - 1), as a quotient of whole numbers so that 0.05 comes out as 0.05.
    let exponent = median.log10().floor() as i32 - 1;
    let step = 10.0_f64.powi(exponent.abs());
    Ok(if exponent < 0 {
        (median * step * (1.0 + 1e-12)).floor() / step
    } else {
        (median / step * (1.0 + 1e-12)).floor() * step
    })
}

/// The rectangle to render, its sides at whole multiples of the cell.
fn canvas(frames: &[PlannedFrame], bounds: Option<&MapBounds>, cell: f64) -> Result<MapBounds, PlanError> {
    let seen = union(frames.iter()).ok_or(PlanError::NoFrames)?;
    let wanted = match bounds {
        None => seen,
        Some(b) => {
            let sides = [b.west, b.south, b.east, b.north];
            if !(sides.iter().all(|s| s.is_finite()) && b.width() > 0.0 && b.height() > 0.0) {
                return Err(PlanError::EmptyBounds {
                    west: b.west,
                    south: b.south,
                    east: b.east,
                    north: b.north,
                });
            }
            let touched = frames.iter().any(|f| {
                let e = f.extent();
                e.west < b.east && e.east > b.west && e.south < b.north && e.north > b.south
            });
            if !touched {
                return Err(PlanError::NothingInside);
            }
            *b
        }
    };
    // A side that lies on a grid line up to rounding is on it.
    let down = |v: f64| (v / cell + 1e-6).floor() * cell;
    let up = |v: f64| (v / cell - 1e-6).ceil() * cell;
    let canvas = MapBounds {
        west: down(wanted.west),
        south: down(wanted.south),
        east: up(wanted.east),
        north: up(wanted.north),
    };
    let size = |b: &MapBounds| ((b.width() / cell).ceil(), (b.height() / cell).ceil());
    let (width, height) = size(&canvas);
    let footprints: f64 = frames.iter().map(|f| f.area).sum();
    let over_footprints = canvas.width() * canvas.height() / footprints;
    let sprawling = bounds.is_none() && over_footprints > MOST_AREA_OVER_FOOTPRINTS;
    if sprawling || width * height > MOST_PIXELS || !(width * height).is_finite() {
        let without = |left_out: usize| {
            let others = frames.iter().enumerate().filter(|(i, _)| *i != left_out);
            union(others.map(|(_, f)| f)).map_or((0.0, 0.0), |b| size(&b))
        };
        let (culprit, (other_width, other_height)) = (0..frames.len())
            .map(|i| (i, without(i)))
            .min_by(|(_, a), (_, b)| (a.0 * a.1).total_cmp(&(b.0 * b.1)))
            .ok_or(PlanError::NoFrames)?;
        return Err(PlanError::TooLarge {
            width,
            height,
            over_footprints,
            frame: frames[culprit].frame.name.clone(),
            other_width,
            other_height,
        });
    }
    Ok(canvas)
}

fn union<'a>(frames: impl Iterator<Item = &'a PlannedFrame>) -> Option<MapBounds> {
    frames.map(PlannedFrame::extent).reduce(|a, b| a.union(&b))
}
