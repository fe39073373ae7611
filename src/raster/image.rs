//! Images of 8 bits per sample, and their reductions by averaging.

use std::sync::OnceLock;

/// An image of 1 (grey), 3 (red, green, blue) or 4 channels, samples interleaved, row by row. The fourth is
/// not seen: it pads a pixel to 32 bits, which is half the time when resampling.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image8 {
    width: usize,
    height: usize,
    channels: usize,
    samples: Vec<u8>,
}

impl Image8 {
    /// From interleaved samples; `None` unless there are 1, 3 or 4 channels, at least one pixel, and
    /// `width × height × channels` samples.
    #[must_use]
    pub fn new(width: usize, height: usize, channels: usize, samples: Vec<u8>) -> Option<Self> {
        let expected = width.checked_mul(height)?.checked_mul(channels)?;
        (matches!(channels, 1 | 3 | 4) && expected > 0 && expected == samples.len()).then_some(Self {
            width,
            height,
            channels,
            samples,
        })
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
    /// Samples per pixel: 1, 3 or 4.
    #[must_use]
    pub const fn channels(&self) -> usize {
        self.channels
    }
    /// All samples.
    #[must_use]
    pub fn samples(&self) -> &[u8] {
        &self.samples
    }
    /// The same image with three channels: a grey value repeated, padding dropped.
    #[must_use]
    pub fn into_rgb(self) -> Self {
        let samples = match self.channels {
            1 => self.samples.iter().flat_map(|v| [*v; 3]).collect(),
            4 => self.samples.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect(),
            _ => return self,
        };
        Self { channels: 3, samples, ..self }
    }
    /// The same image with padded colour pixels, a grey value repeated.
    #[must_use]
    pub fn into_padded(self) -> Self {
        let samples = match self.channels {
            1 => self.samples.iter().flat_map(|v| [*v, *v, *v, u8::MAX]).collect(),
            3 => self.samples.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], u8::MAX]).collect(),
            _ => return self,
        };
        Self { channels: 4, samples, ..self }
    }

    /// Every 2 × 2 block averaged into one pixel, rounded to nearest. Blocks that stick out over an odd
    /// last column or row average the pixels they have, so nothing from outside the image comes in.
    ///
    /// Pixel centres move: position `c` here lies at `(c + 0.5) / 2 - 0.5` there.
    #[must_use]
    pub fn halved(&self) -> Self {
        match self.channels {
            1 => self.halved_channels::<1>(),
            3 => self.halved_channels::<3>(),
            _ => self.halved_channels::<4>(),
        }
    }

    fn halved_channels<const CH: usize>(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut samples = Vec::with_capacity(width * height * CH);
        let stride = self.width * CH;
        for row in 0..height {
            let upper = &self.samples[2 * row * stride..][..stride];
            let lower_row = (2 * row + 1).min(self.height - 1);
            let lower = &self.samples[lower_row * stride..][..stride];
            for column in 0..width {
                let left = 2 * column * CH;
                let right = (2 * column + 1).min(self.width - 1) * CH;
                for k in 0..CH {
                    // An odd last column or row is taken twice, which is the mean of what exists.
                    let sum = u16::from(upper[left + k])
                        + u16::from(upper[right + k])
                        + u16::from(lower[left + k])
                        + u16::from(lower[right + k]);
                    samples.push(((sum + 2) / 4) as u8);
                }
            }
        }
        Self { width, height, channels: CH, samples }
    }
}

/// Most reductions a pyramid holds: 2¹² times coarser than the image.
const MOST_LEVELS: usize = 12;

/// An image with its reductions by 2, 4, 8 …, each made when first asked for.
#[derive(Debug)]
pub struct ImagePyramid {
    base: Image8,
    reduced: [OnceLock<Image8>; MOST_LEVELS],
}

impl ImagePyramid {
    /// Level 0 is the image itself.
    #[must_use]
    pub const fn new(base: Image8) -> Self {
        Self { base, reduced: [const { OnceLock::new() }; MOST_LEVELS] }
    }
    /// The image itself.
    #[must_use]
    pub const fn base(&self) -> &Image8 {
        &self.base
    }
    /// The image reduced `level` times by 2, or the coarsest there is.
    #[must_use]
    pub fn level(&self, level: usize) -> &Image8 {
        let mut image = &self.base;
        for slot in self.reduced.iter().take(level) {
            image = slot.get_or_init(|| image.halved());
        }
        image
    }
    /// The level whose pixels suit an output that steps over `scale` pixels of the image at a time: 0 up
    /// to 1.5, then so that one step is 0.75 to 1.5 pixels of the level.
    #[must_use]
    pub fn level_for_scale(scale: f64) -> usize {
        if scale <= 1.5 {
            return 0;
        }
        ((scale / 1.5).log2().ceil() as usize).min(MOST_LEVELS)
    }
    /// Memory that the image takes with all its reductions, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.base.samples.len() / 3 * 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_must_agree() {
        assert!(Image8::new(2, 2, 3, vec![0; 12]).is_some());
        assert!(Image8::new(2, 2, 3, vec![0; 11]).is_none());
        assert!(Image8::new(2, 2, 2, vec![0; 8]).is_none());
        assert!(Image8::new(0, 2, 1, vec![]).is_none());
        assert!(Image8::new(usize::MAX, 2, 1, vec![]).is_none());
    }

    #[test]
    fn padding_keeps_the_colours() {
        let grey = Image8::new(2, 1, 1, vec![7, 9]).unwrap().into_padded();
        assert_eq!((grey.channels(), grey.samples()), (4, [7, 7, 7, 255, 9, 9, 9, 255].as_slice()));
        let colour = Image8::new(1, 1, 3, vec![1, 2, 3]).unwrap().into_padded();
        assert_eq!(colour.samples(), [1, 2, 3, 255]);
        assert_eq!(colour.into_rgb().samples(), [1, 2, 3]);
    }

    #[test]
    fn halving_averages_blocks_and_what_is_left_of_them() {
        let image = Image8::new(3, 3, 1, vec![10, 20, 30, 30, 40, 50, 100, 102, 7]).unwrap();
        let half = image.halved();
        assert_eq!((half.width(), half.height()), (2, 2));
        assert_eq!(half.samples(), [25, 40, 101, 7]);
    }

    #[test]
    fn a_level_samples_at_about_its_own_pitch() {
        for (scale, level) in [(0.3, 0), (1.5, 0), (1.6, 1), (3.0, 1), (3.1, 2), (1e9, 12)] {
            assert_eq!(ImagePyramid::level_for_scale(scale), level, "scale {scale}");
        }
        let pyramid = ImagePyramid::new(Image8::new(4, 4, 3, vec![9; 48]).unwrap());
        assert_eq!(pyramid.level(2).width(), 1);
        assert_eq!(pyramid.level(12).samples(), [9, 9, 9]);
    }
}
