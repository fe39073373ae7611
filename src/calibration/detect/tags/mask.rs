//! Which pixels are dark next to light ones.

use crate::calibration::grey::Grey;

/// A pixel whose surroundings differ by less than this share of the photo's brightness range is neither.
const CONTRAST_SHARE: f32 = 0.08;

/// How the photo is looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// Side of a tile as a share of the longer image side. A pixel is compared with its tile and those around.
    tile: f64,
    /// Dark is below this share of the way from the darkest to the lightest there.
    level: f32,
    /// Whether noise is smoothed away first; thin gaps between dark areas go with it.
    pub smoothed: bool,
}

impl Look {
    /// At the middle, dark areas that touch at their corners are one, for blur makes a saddle there; below it,
    /// thin borders break.
    pub const ALL: [Self; 5] = [
        Self { tile: 1.0 / 64.0, level: 0.36, smoothed: true },
        Self { tile: 1.0 / 160.0, level: 0.36, smoothed: true },
        Self { tile: 1.0 / 64.0, level: 0.24, smoothed: true },
        Self { tile: 1.0 / 24.0, level: 0.36, smoothed: true },
        Self { tile: 1.0 / 64.0, level: 0.5, smoothed: false },
    ];
}

/// True for dark pixels next to light ones. Pixels far from any are not marked, dark or not.
pub(super) fn dark_mask(image: &Grey, look: Look) -> Vec<bool> {
    let (w, h) = (image.width(), image.height());
    let tile = ((look.tile * w.max(h) as f64).round() as usize).max(2);
    let (across, down) = (w.div_ceil(tile), h.div_ceil(tile));
    let mut ranges = vec![(f32::INFINITY, f32::NEG_INFINITY); across * down];
    for (row, line) in image.values().chunks_exact(w).enumerate() {
        for (range, pixels) in ranges[row / tile * across..].iter_mut().zip(line.chunks(tile)) {
            for &value in pixels {
                *range = (range.0.min(value), range.1.max(value));
            }
        }
    }
    let ranges = spread(&ranges, across, down);
    let least = CONTRAST_SHARE * image.range();
    let mut dark = vec![false; w * h];
    for ((row, out), line) in dark.chunks_exact_mut(w).enumerate().zip(image.values().chunks_exact(w)) {
        let ranges = &ranges[row / tile * across..];
        for ((out, pixels), &(low, high)) in out.chunks_mut(tile).zip(line.chunks(tile)).zip(ranges) {
            if high - low > least {
                let limit = low + look.level * (high - low);
                out.iter_mut().zip(pixels).for_each(|(out, value)| *out = *value < limit);
            }
        }
    }
    dark
}

/// The range over each tile and the eight around it.
fn spread(ranges: &[(f32, f32)], across: usize, down: usize) -> Vec<(f32, f32)> {
    let joined = |a: (f32, f32), b: (f32, f32)| (a.0.min(b.0), a.1.max(b.1));
    let mut out = Vec::with_capacity(ranges.len());
    for row in 0..down {
        for column in 0..across {
            let mut range = ranges[row * across + column];
            for r in row.saturating_sub(1)..=(row + 1).min(down - 1) {
                for c in column.saturating_sub(1)..=(column + 1).min(across - 1) {
                    range = joined(range, ranges[r * across + c]);
                }
            }
            out.push(range);
        }
    }
    out
}
