//! A grey image in memory and the few filters that finding targets needs.

use nalgebra::Vector2;

/// Why pixels are no image.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GreyError {
    /// Width × height is not the number of values, or is zero.
    #[error("{values} values do not fill an image of {width} × {height} px")]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Values given.
        values: usize,
    },
    /// A value is NaN or infinite.
    #[error("the pixel in column {column}, row {row} is {value}")]
    NotFinite {
        /// Column.
        column: usize,
        /// Row.
        row: usize,
        /// What was given.
        value: f32,
    },
}

/// Row-major brightness, any linear scale (0–255 for 8-bit photos).
#[derive(Debug, Clone, PartialEq)]
pub struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Grey {
    /// From row-major values.
    ///
    /// # Errors
    /// [`GreyError`].
    pub fn new(width: usize, height: usize, values: Vec<f32>) -> Result<Self, GreyError> {
        if values.is_empty() || width.checked_mul(height) != Some(values.len()) {
            let values = values.len();
            return Err(GreyError::Size { width, height, values });
        }
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            return Err(GreyError::NotFinite { column: at % width, row: at / width, value: values[at] });
        }
        Ok(Self { width, height, values })
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
    /// Row-major values.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }
    /// The value of one pixel, the nearest one for positions outside.
    #[must_use]
    pub(super) fn at(&self, column: isize, row: isize) -> f32 {
        let c = column.clamp(0, self.width as isize - 1) as usize;
        let r = row.clamp(0, self.height as isize - 1) as usize;
        self.values[r * self.width + c]
    }

    /// Bilinear between the four pixels around a point, the nearest ones for points outside.
    #[inline]
    pub(super) fn between(&self, p: Vector2<f64>) -> f32 {
        let x = (p.x as f32).clamp(0.0, (self.width - 1) as f32);
        let y = (p.y as f32).clamp(0.0, (self.height - 1) as f32);
        let (c, r) = (x as usize, y as usize);
        let (u, v) = (x - c as f32, y - r as f32);
        let right = usize::from(c + 1 < self.width);
        let down = if r + 1 < self.height { self.width } else { 0 };
        let at = r * self.width + c;
        let upper = self.values[at] * (1.0 - u) + self.values[at + right] * u;
        let lower = self.values[at + down] * (1.0 - u) + self.values[at + down + right] * u;
        upper * (1.0 - v) + lower * v
    }

    /// Mean of `factor` × `factor` blocks; what does not fill a block at the right and bottom is cut.
    pub(super) fn reduced(&self, factor: usize) -> Self {
        let (width, height) = (self.width / factor, self.height / factor);
        let share = 1.0 / (factor * factor) as f32;
        let mut values = vec![0.0; width * height];
        for (row, line) in values.chunks_exact_mut(width).enumerate() {
            for source in 0..factor {
                let start = (row * factor + source) * self.width;
                let pixels = &self.values[start..start + width * factor];
                for (value, block) in line.iter_mut().zip(pixels.chunks_exact(factor)) {
                    *value += share * block.iter().sum::<f32>();
                }
            }
        }
        Self { width, height, values }
    }

    /// Dark for light.
    pub(super) fn negative(&self) -> Self {
        Self { width: self.width, height: self.height, values: self.values.iter().map(|v| -v).collect() }
    }

    /// Binomial 3 × 3 smoothing (1 2 1), edges repeated.
    pub(super) fn smoothed(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let mut across = vec![0.0; w * h];
        for (out, line) in across.chunks_exact_mut(w).zip(self.values.chunks_exact(w)) {
            for c in 0..w {
                let (left, right) = (line[c.saturating_sub(1)], line[(c + 1).min(w - 1)]);
                out[c] = 0.25 * (left + 2.0 * line[c] + right);
            }
        }
        let mut values = vec![0.0; w * h];
        for (r, out) in values.chunks_exact_mut(w).enumerate() {
            let line = |r: usize| &across[r * w..(r + 1) * w];
            let (up, here, down) = (line(r.saturating_sub(1)), line(r), line((r + 1).min(h - 1)));
            for c in 0..w {
                out[c] = 0.25 * (up[c] + 2.0 * here[c] + down[c]);
            }
        }
        Self { width: w, height: h, values }
    }

    /// Brightness range that leaves out the darkest and the brightest 1 %.
    pub(super) fn range(&self) -> f32 {
        let stride = if self.values.len() > 40_000 { (self.values.len() / 10_000) | 1 } else { 1 };
        let mut sample: Vec<f32> = self.values.iter().step_by(stride).copied().collect();
        let share = sample.len() / 100;
        let top = sample.len() - 1 - share;
        let high = *sample.select_nth_unstable_by(top, f32::total_cmp).1;
        high - *sample.select_nth_unstable_by(share, f32::total_cmp).1
    }

    /// True where a pixel is darker than the mean of the window around it by more than `margin`.
    pub(super) fn darker_than_surroundings(&self, radius: usize, margin: f32) -> Vec<bool> {
        let (w, h) = (self.width, self.height);
        // Column sums slide down, a window sum slides right: constant work per pixel for any radius.
        let mut columns = vec![0.0_f64; w];
        let line = |r: usize| &self.values[r * w..(r + 1) * w];
        for r in 0..radius.min(h) {
            columns.iter_mut().zip(line(r)).for_each(|(s, v)| *s += f64::from(*v));
        }
        let mut dark = vec![false; w * h];
        for (r, out) in dark.chunks_exact_mut(w).enumerate() {
            if r + radius < h {
                let entering = line(r + radius);
                columns.iter_mut().zip(entering).for_each(|(s, v)| *s += f64::from(*v));
            }
            if r > radius {
                let leaving = line(r - radius - 1);
                columns.iter_mut().zip(leaving).for_each(|(s, v)| *s -= f64::from(*v));
            }
            let rows = (r + radius).min(h - 1) + 1 - r.saturating_sub(radius);
            let here = line(r);
            let mut sum: f64 = columns[..radius.min(w)].iter().sum();
            for c in 0..w {
                if c + radius < w {
                    sum += columns[c + radius];
                }
                if c > radius {
                    sum -= columns[c - radius - 1];
                }
                let across = (c + radius).min(w - 1) + 1 - c.saturating_sub(radius);
                out[c] = here[c] + margin < (sum / (rows * across) as f64) as f32;
            }
        }
        dark
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn window_means_are_means_up_to_the_border() {
        let image = Grey::new(7, 5, (0..35).map(|v| ((v * 13) % 31) as f32).collect()).unwrap();
        for (radius, margin) in [(1, 0.0), (2, 1.5), (9, 0.0)] {
            let dark = image.darker_than_surroundings(radius, margin);
            for r in 0..5_usize {
                for c in 0..7_usize {
                    let window: Vec<f32> = (r.saturating_sub(radius)..=(r + radius).min(4))
                        .flat_map(|y| (c.saturating_sub(radius)..=(c + radius).min(6)).map(move |x| (y, x)))
                        .map(|(y, x)| image.values[y * 7 + x])
                        .collect();
                    let mean = window.iter().sum::<f32>() / window.len() as f32;
                    let gap = mean - margin - image.values[r * 7 + c];
                    if gap.abs() > 1e-3 {
                        assert_eq!(dark[r * 7 + c], gap > 0.0, "column {c}, row {r}");
                    }
                }
            }
        }
    }

    #[test]
    fn bad_sizes_and_values_are_refused() {
        assert!(matches!(Grey::new(3, 2, vec![0.0; 5]), Err(GreyError::Size { .. })));
        assert!(matches!(Grey::new(0, 0, vec![]), Err(GreyError::Size { .. })));
        let nan = Grey::new(2, 2, vec![0.0, 0.0, f32::NAN, 0.0]);
        assert!(matches!(nan, Err(GreyError::NotFinite { column: 0, row: 1, .. })));
    }
}
