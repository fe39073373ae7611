//! From light to grey values: blur that ignores blind pixels, and sensor noise that does not depend on threads.

use rand::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

/// Light on the sensor: `channels` values per pixel in [0, 1], row by row; `None` where the lens shows nothing.
pub(super) struct Light<const CHANNELS: usize> {
    pub width: usize,
    pub pixels: Vec<Option<[f32; CHANNELS]>>,
}

/// Brightness of pixels that see nothing.
const BLIND: f32 = 0.5;

impl<const CHANNELS: usize> Light<CHANNELS> {
    /// Blurs with a Gaussian of standard deviation `sigma_px`. Blind pixels neither give nor take light, and the
    /// frame's edge is treated as blind.
    pub fn blur(&mut self, sigma_px: f64) {
        if sigma_px <= 0.0 {
            return;
        }
        let reach = (3.5 * sigma_px).ceil() as usize;
        let kernel: Vec<f32> =
            (0..=reach).map(|distance| (-0.5 * (distance as f64 / sigma_px).powi(2)).exp() as f32).collect();
        let width = self.width;
        let height = self.pixels.len() / width;
        let rows: Vec<_> = self
            .pixels
            .par_chunks(width)
            .flat_map_iter(|row| {
                (0..width).map(|column| weighted(&kernel, column, width, row[column], |index| row[index]))
            })
            .collect();
        self.pixels = (0..height)
            .into_par_iter()
            .flat_map_iter(|row| {
                let (rows, kernel) = (&rows, &kernel);
                (0..width).map(move |column| {
                    weighted(kernel, row, height, rows[row * width + column], |index| {
                        rows[index * width + column]
                    })
                })
            })
            .collect();
    }

    /// Grey values with Gaussian noise of `noise_std` grey values; one random stream per row.
    pub fn expose(&self, noise_std: f64, seed: u64, stream: u64) -> Vec<u8> {
        let noise_std = noise_std as f32;
        self.pixels
            .par_chunks(self.width)
            .enumerate()
            .flat_map_iter(|(row, pixels)| {
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                random.set_stream(stream + row as u64);
                pixels.iter().flat_map(move |pixel| pixel.unwrap_or([BLIND; CHANNELS])).map(move |value| {
                    let noise: f32 = if noise_std > 0.0 { random.sample(StandardNormal) } else { 0.0 };
                    (value * 255.0 + noise_std * noise).round().clamp(0.0, 255.0) as u8
                })
            })
            .collect()
    }
}

fn weighted<const CHANNELS: usize>(
    kernel: &[f32],
    centre: usize,
    count: usize,
    own: Option<[f32; CHANNELS]>,
    pixel: impl Fn(usize) -> Option<[f32; CHANNELS]>,
) -> Option<[f32; CHANNELS]> {
    own?;
    let reach = kernel.len() - 1;
    let (mut sum, mut total) = ([0.0; CHANNELS], 0.0);
    for index in centre.saturating_sub(reach)..=(centre + reach).min(count - 1) {
        if let Some(value) = pixel(index) {
            let weight = kernel[index.abs_diff(centre)];
            total += weight;
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += weight * value;
            }
        }
    }
    Some(sum.map(|sum| sum / total))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_keeps_light_and_centre() {
        let mut light = Light { width: 21, pixels: vec![Some([0.0_f32]); 21 * 21] };
        light.pixels[10 * 21 + 10] = Some([1.0]);
        light.blur(1.0);
        let values: Vec<f32> = light.pixels.iter().map(|pixel| pixel.unwrap()[0]).collect();
        assert!((values.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let spread: f32 =
            values.iter().enumerate().map(|(index, v)| v * (index as f32 % 21.0 - 10.0).powi(2)).sum();
        assert!((spread - 1.0).abs() < 0.02, "{spread}");
    }

    #[test]
    fn blind_pixels_take_no_part_in_the_blur() {
        let mut light = Light { width: 9, pixels: vec![Some([0.8_f32]); 81] };
        light.pixels[40] = None;
        light.blur(1.5);
        assert_eq!(light.pixels[40], None);
        assert!(light.pixels.iter().flatten().all(|value| (value[0] - 0.8).abs() < 1e-6));
    }

    #[test]
    fn noise_has_its_spread() {
        let light = Light { width: 200, pixels: vec![Some([0.5_f32]); 40_000] };
        let values = light.expose(3.0, 1, 0);
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / 4e4;
        let variance = values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / 4e4;
        // Rounding adds 1/12.
        assert!((variance - 9.0 - 1.0 / 12.0).abs() < 0.3 && (mean - 127.5).abs() < 0.1, "{mean} {variance}");
    }
}
