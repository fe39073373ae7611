//! Which pixel of a frame belongs to each pixel of a tile.
//!
//! The exact chain (map → ground → ECEF → camera → lens) is evaluated at the corners, edge middles and
//! centre of square cells. Where bilinear interpolation between the corners meets the other five points
//! within [`CHECK_TOLERANCE_PX`], the cell is interpolated; otherwise it is divided; the smallest cells are
//! evaluated exactly at every pixel. So are cells only part of which the lens sees, which makes the edges
//! of folded lenses, horizons and holes in the terrain exact to the pixel.
//!
//! The error of a smooth map is largest at one of the five points. A terrain model bends between them: its
//! heights are looked at about once per posting, and a cell is divided where they leave the plane through
//! the cell's corners by more than [`BEND_TOLERANCE_PX`] in the frame. A peak of a single post is seen by such
//! a look to a quarter at least, so interpolated positions are within 0.05 px of the exact ones.

use super::ground::{TerrainIndex, TileGround, raised};
use super::plan::Window;
use crate::georeference::GeoreferencedFrame;

/// Largest cell, pixels.
pub(super) const CELL: usize = 16;
/// Smallest interpolated cell, pixels.
const SMALLEST_CELL: usize = 4;
/// Half of the 0.05 px that are promised.
const CHECK_TOLERANCE_PX: f64 = 0.025;
/// A quarter of them.
const BEND_TOLERANCE_PX: f64 = 0.0125;

/// A position in a frame, stored pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FramePoint {
    pub(super) column: f64,
    pub(super) row: f64,
}

impl FramePoint {
    fn middle(a: &Self, b: &Self) -> Self {
        Self { column: 0.5 * (a.column + b.column), row: 0.5 * (a.row + b.row) }
    }
    fn off(&self, other: &Self) -> f64 {
        (self.column - other.column).hypot(self.row - other.row)
    }
}

/// A square of tile pixels over which the map to the frame is bilinear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// First column in the tile.
    pub(super) column: usize,
    /// First row in the tile.
    pub(super) row: usize,
    /// Pixels along a side.
    pub(super) side: usize,
    /// Frame positions of the tile pixels at `(0, 0)`, `(side, 0)`, `(0, side)`, `(side, side)` from the
    /// first.
    pub(super) corners: [FramePoint; 4],
}

/// A single tile pixel with its exact frame position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ExactPixel {
    pub(super) column: usize,
    pub(super) row: usize,
    pub(super) at: FramePoint,
}

/// Where a frame lands in a tile.
#[derive(Debug, Default)]
pub(super) struct FrameMap {
    pub(super) cells: Vec<Cell>,
    pub(super) pixels: Vec<ExactPixel>,
}

impl FrameMap {
    pub(super) fn is_empty(&self) -> bool {
        self.cells.is_empty() && self.pixels.is_empty()
    }
}

/// The nine points of a cell: corners, edge middles, centre, row by row.
struct Nine([Option<FramePoint>; 9]);

enum Verdict {
    Skip,
    Interpolate([FramePoint; 4]),
    Divide,
}

impl Nine {
    fn verdict(&self, (width, height): (f64, f64)) -> Verdict {
        let mut seen = [FramePoint { column: 0.0, row: 0.0 }; 9];
        for (slot, point) in seen.iter_mut().zip(&self.0) {
            match point {
                Some(point) => *slot = *point,
                None if self.0.iter().all(Option::is_none) => return Verdict::Skip,
                None => return Verdict::Divide,
            }
        }
        let extent = |pick: fn(&FramePoint) -> f64| {
            let low = seen.iter().map(pick).fold(f64::INFINITY, f64::min);
            let high = seen.iter().map(pick).fold(f64::NEG_INFINITY, f64::max);
            // What lies between the nine points stays within their own extent of them.
            (low - (high - low), high + (high - low))
        };
        let (left, right) = extent(|p| p.column);
        let (top, bottom) = extent(|p| p.row);
        if right < -0.5 || bottom < -0.5 || left > width - 0.5 || top > height - 0.5 {
            return Verdict::Skip;
        }
        let [ul, u, ur, l, c, r, ll, d, lr] = seen;
        let (upper, lower) = (FramePoint::middle(&ul, &ur), FramePoint::middle(&ll, &lr));
        let worst = u
            .off(&upper)
            .max(d.off(&lower))
            .max(l.off(&FramePoint::middle(&ul, &ll)))
            .max(r.off(&FramePoint::middle(&ur, &lr)))
            .max(c.off(&FramePoint::middle(&upper, &lower)));
        if worst <= CHECK_TOLERANCE_PX { Verdict::Interpolate([ul, ur, ll, lr]) } else { Verdict::Divide }
    }
}

struct Mapper<'a> {
    ground: &'a mut TileGround,
    terrain: TerrainIndex,
    frame: &'a GeoreferencedFrame,
}

impl Mapper<'_> {
    fn exact(&self, column: usize, row: usize) -> Option<FramePoint> {
        let height = self.ground.height(self.terrain, column, row)?;
        let point = raised(&self.ground.surface(column, row), height);
        let pixel = self.frame.pixel_from_ecef(&point)?;
        Some(FramePoint { column: pixel.column, row: pixel.row })
    }
}

/// Maps the pixels of `part`, which is in pixels of the tile, into a frame.
///
/// Cells may stick out over `part` and the tile; the caller clips. Cells and pixels that cannot lie on the
/// image are left out, those that may are kept: the caller still tests each pixel.
pub(super) fn map_frame(ground: &mut TileGround, frame: &GeoreferencedFrame, part: &Window) -> FrameMap {
    let terrain = ground.terrain(&frame.ground);
    // Pixels between looks at the terrain's heights; `None` where the surface does not bend.
    let look = frame.ground.spacing().map(|spacing| {
        let posting_px = spacing / ground.pixel_m;
        [8, 4, 2].into_iter().find(|step| *step as f64 <= posting_px).unwrap_or(1)
    });
    let size = frame.stored_size();
    let size = (f64::from(size.0), f64::from(size.1));
    let mut mapper = Mapper { ground, terrain, frame };
    let mut map = FrameMap::default();
    // Squares that are still to be judged, all of one size.
    let mut squares: Vec<(usize, usize)> = Vec::new();
    for row in (part.row / CELL * CELL..part.row + part.height).step_by(CELL) {
        for column in (part.column / CELL * CELL..part.column + part.width).step_by(CELL) {
            squares.push((column, row));
        }
    }
    let mut side = CELL;
    while side >= SMALLEST_CELL {
        let nodes = mapper.nodes(&squares, side);
        let mut divided = Vec::new();
        let mut smooth = Vec::new();
        for (square, nine) in squares.iter().zip(nodes) {
            match nine.verdict(size) {
                Verdict::Skip => {}
                Verdict::Interpolate(corners) => {
                    smooth.push(Cell { column: square.0, row: square.1, side, corners });
                }
                Verdict::Divide => divided.push(*square),
            }
        }
        match look {
            // At such distances the nine points have looked already.
            Some(step) if step < side / 2 => {
                mapper.ground.prepare(terrain, smooth.iter().flat_map(|cell| looks(cell, step)));
                for cell in smooth {
                    if mapper.is_flat(&cell, step) {
                        map.cells.push(cell);
                    } else {
                        divided.push((cell.column, cell.row));
                    }
                }
            }
            _ => map.cells.append(&mut smooth),
        }
        squares = divided;
        if side > SMALLEST_CELL {
            let half = side / 2;
            squares = squares
                .iter()
                .flat_map(|(c, r)| {
                    [(0, 0), (half, 0), (0, half), (half, half)].map(|(dc, dr)| (c + dc, r + dr))
                })
                .collect();
        }
        side /= 2;
    }
    let inside = |(c, r): &(usize, usize)| {
        (part.column..part.column + part.width).contains(c) && (part.row..part.row + part.height).contains(r)
    };
    let pixels: Vec<(usize, usize)> = squares
        .iter()
        .flat_map(|(c, r)| {
            (0..SMALLEST_CELL * SMALLEST_CELL).map(move |i| (c + i % SMALLEST_CELL, r + i / SMALLEST_CELL))
        })
        .filter(inside)
        .collect();
    mapper.ground.prepare(terrain, pixels.iter().copied());
    map.pixels.extend(
        pixels
            .into_iter()
            .filter_map(|(column, row)| mapper.exact(column, row).map(|at| ExactPixel { column, row, at })),
    );
    map
}

/// The pixels of a cell at which the terrain is looked at, its far sides included.
fn looks(cell: &Cell, step: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
    let (column, row, count) = (cell.column, cell.row, cell.side / step + 1);
    (0..count * count).map(move |i| (column + i % count * step, row + i / count * step))
}

impl Mapper<'_> {
    /// Whether the terrain, at prepared looks, stays as close to the plane through the cell's corners as the
    /// frame can tell.
    fn is_flat(&self, cell: &Cell, step: usize) -> bool {
        let height = |c: usize, r: usize| self.ground.height(self.terrain, cell.column + c, cell.row + r);
        let side = cell.side;
        let corners = (height(0, 0), height(side, 0), height(0, side), height(side, side));
        let (Some(ul), Some(ur), Some(ll), Some(lr)) = corners else { return false };
        let mut bend = 0.0_f64;
        for (c, r) in looks(cell, step) {
            let (c, r) = (c - cell.column, r - cell.row);
            let Some(h) = height(c, r) else { return false };
            let (x, y) = (c as f64 / side as f64, r as f64 / side as f64);
            let plane = (1.0 - y) * (ul + x * (ur - ul)) + y * (ll + x * (lr - ll));
            bend = bend.max((h - plane).abs());
        }
        // How far a metre of height moves the pixel.
        let raised_by = |metres: f64| {
            let surface = self.ground.surface(cell.column, cell.row);
            self.frame.pixel_from_ecef(&raised(&surface, ul + metres))
        };
        let (Some(low), Some(high)) = (raised_by(0.0), raised_by(1.0)) else { return false };
        bend * (high.column - low.column).hypot(high.row - low.row) <= BEND_TOLERANCE_PX
    }

    /// Exact positions at the nine points of each square; a point that squares share is evaluated once.
    fn nodes(&mut self, squares: &[(usize, usize)], side: usize) -> Vec<Nine> {
        let half = side / 2;
        let stride = self.ground.side() / half + 1;
        let nine = |(c, r): (usize, usize)| {
            let (c, r) = (c / half, r / half);
            (0..9).map(move |i| (c + i % 3, r + i / 3))
        };
        let mut asked = vec![false; stride * stride];
        let mut points: Vec<(usize, usize)> = Vec::new();
        for (c, r) in squares.iter().flat_map(|s| nine(*s)) {
            if !std::mem::replace(&mut asked[r * stride + c], true) {
                points.push((c, r));
            }
        }
        self.ground.prepare(self.terrain, points.iter().map(|(c, r)| (c * half, r * half)));
        let mut lattice = vec![None; stride * stride];
        for (c, r) in points {
            lattice[r * stride + c] = self.exact(c * half, r * half);
        }
        squares
            .iter()
            .map(|square| {
                let mut points = [None; 9];
                for (slot, (c, r)) in points.iter_mut().zip(nine(*square)) {
                    *slot = lattice[r * stride + c];
                }
                Nine(points)
            })
            .collect()
    }
}
