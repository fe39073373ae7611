//! How much a frame counts at one of its pixels: the farther from its edge, the more.

use crate::camera::ImagePoint;
use crate::georeference::GeoreferencedFrame;
use crate::raster::{Raster, Run};

/// Step of the grid on which the distance to a folded lens's edge is known, pixels.
const FOLD_GRID_PX: f64 = 16.0;
/// Even a pixel on the very edge counts, so that every seen place is filled.
const LEAST: f32 = 1e-6;

/// Distance of a frame's pixels to its edge, as a weight.
///
/// The edge is the nearest of the four sides of the image and, where the lens has no inverse inside the
/// image, of the region it cannot see: that distance is known on a grid of 16 px and interpolated, so it
/// is off by some pixels, which moves a feather's weights but no pixel.
#[derive(Debug)]
pub(super) struct EdgeWeight {
    right: f32,
    bottom: f32,
    per_px: f32,
    fold: Option<Raster<f32>>,
}

impl EdgeWeight {
    pub(super) fn of(frame: &GeoreferencedFrame) -> Self {
        let (width, height) = frame.stored_size();
        Self {
            right: width as f32 - 0.5,
            bottom: height as f32 - 0.5,
            per_px: 2.0 / width.min(height) as f32,
            fold: fold_distances(frame),
        }
    }

    /// Weights at positions along a run, in (0, 1]: the squared distance to the edge over the greatest
    /// possible one. Positions must lie on the image.
    pub(super) fn along(&self, run: &Run, weights: &mut [f32]) {
        let (column, row) = (run.column as f32, run.row as f32);
        let (column_step, row_step) = (run.column_step as f32, run.row_step as f32);
        for (i, weight) in weights.iter_mut().enumerate() {
            let (column, row) = (column + i as f32 * column_step, row + i as f32 * row_step);
            let distance = (column + 0.5).min(self.right - column).min((row + 0.5).min(self.bottom - row));
            *weight = self.weight(distance);
        }
        if let Some(fold) = &self.fold {
            for (i, weight) in weights.iter_mut().enumerate() {
                let (column, row) = (column + i as f32 * column_step, row + i as f32 * row_step);
                *weight = weight.min(self.weight(bilinear(fold, column, row)));
            }
        }
    }

    fn weight(&self, distance_px: f32) -> f32 {
        let share = distance_px.max(0.0) * self.per_px;
        (share * share).clamp(LEAST, 1.0)
    }
}

fn bilinear(grid: &Raster<f32>, column: f32, row: f32) -> f32 {
    let place = |at: f32, count: usize| {
        let at = (at / FOLD_GRID_PX as f32).clamp(0.0, (count - 1) as f32);
        let low = (at as usize).min(count.saturating_sub(2));
        (low, (low + 1).min(count - 1), at - low as f32)
    };
    let (c0, c1, fc) = place(column, grid.width());
    let (r0, r1, fr) = place(row, grid.height());
    let upper = grid.at(c0, r0) + fc * (grid.at(c1, r0) - grid.at(c0, r0));
    let lower = grid.at(c0, r1) + fc * (grid.at(c1, r1) - grid.at(c0, r1));
    upper + fr * (lower - upper)
}

/// Distance in pixels from each grid point to the nearest one without an inverse; `None` when all have one.
fn fold_distances(frame: &GeoreferencedFrame) -> Option<Raster<f32>> {
    let (width, height) = frame.stored_size();
    let count = |size: u32| (f64::from(size) / FOLD_GRID_PX).ceil() as usize + 1;
    let (columns, rows) = (count(width), count(height));
    let seen = |c: usize, r: usize| {
        let at = |i: usize, size: u32| (i as f64 * FOLD_GRID_PX).min(f64::from(size) - 0.5);
        let stored = ImagePoint::new(at(c, width), at(r, height));
        frame.resolves(stored)
    };
    let blind: Vec<(usize, usize)> =
        (0..rows).flat_map(|r| (0..columns).map(move |c| (c, r))).filter(|(c, r)| !seen(*c, *r)).collect();
    if blind.is_empty() {
        return None;
    }
    let distances = (0..rows)
        .flat_map(|r| (0..columns).map(move |c| (c, r)))
        .map(|(c, r)| {
            let nearest = blind
                .iter()
                .map(|(bc, br)| {
                    let (dc, dr) = (bc.abs_diff(c) as f64, br.abs_diff(r) as f64);
                    dc * dc + dr * dr
                })
                .fold(f64::INFINITY, f64::min);
            (nearest.sqrt() * FOLD_GRID_PX) as f32
        })
        .collect();
    Raster::new(columns, rows, distances)
}
