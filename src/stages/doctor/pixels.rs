//! The photos' pixels, made small: sharpness, and pictures to compare on the ground.

use crate::calibration::Grey;
use crate::camera::ImagePoint;
use crate::formats::photo;
use crate::georeference::GeoreferencedFrame;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// A photo's brightness, averaged over blocks of `factor` × `factor` pixels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Small {
    pub width: usize,
    pub height: usize,
    /// Row by row.
    pub values: Vec<f32>,
    /// Side of a block, pixels of the stored image.
    pub factor: usize,
}

impl Small {
    /// Averages blocks; what does not fill a block at the right and bottom is cut. `None` for an image of less than a
    /// block.
    pub(super) fn of(width: usize, height: usize, values: &[f32], factor: usize) -> Option<Self> {
        let (columns, rows) = (width / factor, height / factor);
        if columns == 0 || rows == 0 || values.len() != width * height {
            return None;
        }
        let share = 1.0 / (factor * factor) as f32;
        let mut small = vec![0.0; columns * rows];
        for (row, line) in small.chunks_exact_mut(columns).enumerate() {
            for source in row * factor..(row + 1) * factor {
                let pixels = &values[source * width..source * width + columns * factor];
                for (value, block) in line.iter_mut().zip(pixels.chunks_exact(factor)) {
                    *value += share * block.iter().sum::<f32>();
                }
            }
        }
        Some(Self { width: columns, height: rows, values: small, factor })
    }

    /// The same, smaller again.
    pub(super) fn smaller(&self, by: usize) -> Option<Self> {
        let small = Self::of(self.width, self.height, &self.values, by)?;
        Some(Self { factor: small.factor * self.factor, ..small })
    }

    /// Brightness at a pixel of the stored image, bilinear; `None` outside.
    pub(super) fn at(&self, stored: ImagePoint) -> Option<f32> {
        let place = |v: f64| (v - 0.5 * (self.factor as f64 - 1.0)) / self.factor as f64;
        let (x, y) = (place(stored.column), place(stored.row));
        let (right, bottom) = ((self.width - 1) as f64, (self.height - 1) as f64);
        if !(x >= 0.0 && y >= 0.0 && x <= right && y <= bottom) {
            return None;
        }
        let (c, r) = (x as usize, y as usize);
        let (u, v) = ((x - c as f64) as f32, (y - r as f64) as f32);
        let (c1, r1) = ((c + 1).min(self.width - 1), (r + 1).min(self.height - 1));
        let value = |c: usize, r: usize| self.values[r * self.width + c];
        let upper = value(c, r) * (1.0 - u) + value(c1, r) * u;
        let lower = value(c, r1) * (1.0 - u) + value(c1, r1) * u;
        Some(upper * (1.0 - v) + lower * v)
    }
}

fn decoded(frame: &GeoreferencedFrame, folder: &Path) -> Option<Grey> {
    photo::decode_grey(&folder.join(&frame.name)).ok()
}

/// Photos with at most about `side` pixels along the longer side; `None` for one that cannot be decoded.
pub(super) fn small(frames: &[GeoreferencedFrame], folder: &Path, side: usize) -> Vec<Option<Small>> {
    frames
        .par_iter()
        .map(|frame| {
            let grey = decoded(frame, folder)?;
            let factor = (grey.width().max(grey.height()) / side).max(1);
            Small::of(grey.width(), grey.height(), grey.values(), factor)
        })
        .collect()
}

/// Sharpness of each photo against the median of the set: variance of the four-neighbour Laplacian of the brightness,
/// averaged over blocks of 2 × 2 pixels, which keeps noise and the sensor's colour mosaic out.
pub(super) fn sharpness(frames: &[GeoreferencedFrame], folder: &Path) -> BTreeMap<String, f64> {
    let measured: Vec<(String, f64)> = frames
        .par_iter()
        .filter_map(|frame| {
            let grey = decoded(frame, folder)?;
            let small = Small::of(grey.width(), grey.height(), grey.values(), 2)?;
            Some((frame.name.clone(), laplacian_variance(&small)?))
        })
        .collect();
    let Some(median) = super::view::median(measured.iter().map(|(_, v)| *v).collect()).filter(|m| *m > 0.0)
    else {
        return BTreeMap::new();
    };
    measured.into_iter().map(|(name, value)| (name, value / median)).collect()
}

fn laplacian_variance(image: &Small) -> Option<f64> {
    let (w, h) = (image.width, image.height);
    if w < 3 || h < 3 {
        return None;
    }
    let (mut sum, mut squares) = (0.0, 0.0);
    for row in 1..h - 1 {
        for column in 1..w - 1 {
            let at = row * w + column;
            let v = |k: usize| f64::from(image.values[k]);
            let laplacian = v(at - 1) + v(at + 1) + v(at - w) + v(at + w) - 4.0 * v(at);
            sum += laplacian;
            squares += laplacian * laplacian;
        }
    }
    let count = ((w - 2) * (h - 2)) as f64;
    Some(squares / count - (sum / count) * (sum / count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_keep_their_place() {
        // Brightness is the column: it stays so wherever it is asked for.
        let values: Vec<f32> = (0..60).map(|i| (i % 10) as f32).collect();
        let small = Small::of(10, 6, &values, 2).unwrap();
        assert_eq!((small.width, small.height), (5, 3));
        for column in [0.5, 2.0, 7.25, 8.5] {
            let at = small.at(ImagePoint::new(column, 2.0)).unwrap();
            assert!((f64::from(at) - column).abs() < 1e-6, "{at} at {column}");
        }
        assert_eq!(small.at(ImagePoint::new(0.2, 2.0)), None);
        assert_eq!(small.at(ImagePoint::new(f64::NAN, 2.0)), None);
        let again = small.smaller(2).unwrap();
        assert_eq!(again.factor, 4);
        assert!((again.at(ImagePoint::new(3.0, 1.5)).unwrap() - 3.0).abs() < 1e-6);
        assert!(Small::of(1, 1, &[0.0], 2).is_none());
    }

    #[test]
    fn a_blurred_picture_has_less_variance() {
        let sharp: Vec<f32> =
            (0..40 * 40).map(|i| if (i % 40 / 4 + i / 160) % 2 == 0 { 200.0 } else { 50.0 }).collect();
        let of = |values: &[f32]| laplacian_variance(&Small::of(40, 40, values, 1).unwrap()).unwrap();
        let blurred: Vec<f32> = (0..40 * 40_i32)
            .map(|i| {
                let (c, r) = (i % 40, i / 40);
                let at = |c: i32, r: i32| sharp[(r.clamp(0, 39) * 40 + c.clamp(0, 39)) as usize];
                (-1..=1)
                    .flat_map(|y| (-1..=1).map(move |x| (x, y)))
                    .map(|(x, y)| at(c + x, r + y))
                    .sum::<f32>()
                    / 9.0
            })
            .collect();
        assert!(of(&blurred) < 0.3 * of(&sharp), "{} {}", of(&blurred), of(&sharp));
        assert_eq!(of(&[7.0; 1600]), 0.0);
    }
}
