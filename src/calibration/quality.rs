//! What a photo of the target is worth: blur, exposure, contrast, size; and which photos show the same view.

use super::detect::{DetectedCorner, Detection};
use super::grey::Grey;
use crate::camera::ImagePoint;
use std::collections::BTreeMap;

/// A photo is called blurred from this blur on, pixels, unless the whole set is as blurred.
const BLURRED_PX: f64 = 2.0;
/// … and when its edges are this many times as wide as the median of the set.
const BLURRED_TIMES: f64 = 2.5;
/// A photo is over-exposed when this share of the light parts around the points has no detail left.
const CLIPPED_SHARE: f64 = 0.95;
/// … and dark and light differ by less than this share of the range, or the blooming has closed in on the dark.
const LEAST_CONTRAST: f64 = 0.06;
/// Photos whose points differ by less than this share of the image's width show the same view.
const SAME_VIEW: f64 = 5e-4;

/// Measures of one photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoQuality {
    /// Standard deviation of the blur across edges, pixels: median over the target's points.
    pub blur_px: f64,
    /// Difference between light and dark beside the edges as a share of what the file can store: median.
    pub contrast: f64,
    /// Share of the light parts around the points that are as bright as the file can store.
    pub clipped_share: f64,
    /// Area of the box around the points as a share of the photo's.
    pub extent_share: f64,
}

/// Why a photo in which the target was found should not be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PhotoFault {
    /// Edges much wider than in the other photos.
    #[error(
        "blurred: its edges have a standard deviation of {blur_px:.1} px, the median of the photos is {median_px:.1} px"
    )]
    Blurred {
        /// Of this photo.
        blur_px: f64,
        /// Of all.
        median_px: f64,
    },
    /// No detail in the light parts.
    #[error(
        "over-exposed: {:.0} % of the light parts are clipped and their light spreads over the dark ones",
        100.0 * clipped_share
    )]
    OverExposed {
        /// See [`PhotoQuality::clipped_share`].
        clipped_share: f64,
    },
    /// Dark and light hardly differ.
    #[error("too little contrast: dark and light differ by {:.1} % of the range", 100.0 * contrast)]
    Faint {
        /// See [`PhotoQuality::contrast`].
        contrast: f64,
    },
    /// Another photo shows the same view.
    #[error("shows the same view as {other} (points differ by {rms_px:.2} px), which is kept")]
    Duplicate {
        /// The one that is kept.
        other: String,
        /// Root mean square distance between the points of both.
        rms_px: f64,
    },
}

/// Measures the parts of a photo around the target's points.
///
/// - `white`: the brightest value that the photo's file can store.
#[must_use]
pub fn photo_quality(image: &Grey, white: f32, detection: &Detection) -> PhotoQuality {
    let reach = reach(&detection.corners);
    let (mut blurs, mut contrasts) = (Vec::new(), Vec::new());
    let (mut light_pixels, mut clipped) = (0_usize, 0_usize);
    for corner in &detection.corners {
        let patch = Patch::around(image, corner.sharp, reach);
        let (dark, light) = patch.levels();
        let contrast = light - dark;
        contrasts.push(f64::from(contrast / white));
        if let Some(blur) = patch.blur_px(contrast) {
            blurs.push(blur);
        }
        let middle = 0.5 * (dark + light);
        for &value in patch.values.iter().filter(|v| **v > middle) {
            light_pixels += 1;
            clipped += usize::from(value >= 0.998 * white);
        }
    }
    let columns = extent(detection.corners.iter().map(|c| c.sharp.column));
    let rows = extent(detection.corners.iter().map(|c| c.sharp.row));
    PhotoQuality {
        blur_px: median(blurs),
        contrast: median(contrasts),
        clipped_share: clipped as f64 / light_pixels.max(1) as f64,
        extent_share: columns * rows / (image.width() * image.height()) as f64,
    }
}

/// Which photos of a set should be left out, and why; `None` for those to be used.
///
/// - `photos`: name, measures and points of each.
///
/// Of photos that show the same view the sharpest is kept. Nothing is left out for being blurred when all are.
#[must_use]
pub fn photo_faults(photos: &[(&str, PhotoQuality, &Detection)], width: usize) -> Vec<Option<PhotoFault>> {
    let median_px = median(photos.iter().map(|(_, quality, _)| quality.blur_px).collect());
    let mut faults: Vec<Option<PhotoFault>> = photos
        .iter()
        .map(|(_, quality, _)| {
            let &PhotoQuality { blur_px, contrast, clipped_share, .. } = quality;
            if contrast < LEAST_CONTRAST {
                return Some(if clipped_share > CLIPPED_SHARE {
                    PhotoFault::OverExposed { clipped_share }
                } else {
                    PhotoFault::Faint { contrast }
                });
            }
            (blur_px > BLURRED_PX && blur_px > BLURRED_TIMES * median_px)
                .then_some(PhotoFault::Blurred { blur_px, median_px })
        })
        .collect();
    for i in 0..photos.len() {
        for j in 0..i {
            if faults[i].is_some() || faults[j].is_some() {
                continue;
            }
            let Some(rms_px) = distance(photos[i].2, photos[j].2) else { continue };
            if rms_px > SAME_VIEW * width as f64 {
                continue;
            }
            let (kept, left) = if photos[i].1.blur_px < photos[j].1.blur_px { (i, j) } else { (j, i) };
            faults[left] = Some(PhotoFault::Duplicate { other: photos[kept].0.to_owned(), rms_px });
        }
    }
    faults
}

/// Root mean square distance of the points that both photos show; `None` when they share less than half.
fn distance(a: &Detection, b: &Detection) -> Option<f64> {
    let key = |c: &DetectedCorner| (c.row, c.column, c.corner);
    let places: BTreeMap<_, ImagePoint> = a.corners.iter().map(|c| (key(c), c.sharp)).collect();
    let (mut sum, mut count) = (0.0, 0_usize);
    for corner in &b.corners {
        if let Some(place) = places.get(&key(corner)) {
            sum += (place.column - corner.sharp.column).powi(2) + (place.row - corner.sharp.row).powi(2);
            count += 1;
        }
    }
    (2 * count >= a.corners.len().max(b.corners.len()).max(1)).then(|| (sum / count as f64).sqrt())
}

/// How far around a point its own edges go, pixels: a third of the distance to the next point, within bounds.
fn reach(corners: &[DetectedCorner]) -> usize {
    let spacing = |i: usize| {
        let at = corners[i].sharp;
        let distance = |c: &DetectedCorner| f64::hypot(c.sharp.column - at.column, c.sharp.row - at.row);
        let others = corners.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, c)| distance(c));
        others.fold(f64::INFINITY, f64::min)
    };
    // A sample of the points is enough, and keeps the work linear.
    let stride = corners.len().div_ceil(16).max(1);
    let typical = median((0..corners.len()).step_by(stride).map(spacing).collect());
    if typical.is_finite() { ((typical / 3.0) as usize).clamp(3, 12) } else { 3 }
}

/// The pixels around a point.
struct Patch {
    size: usize,
    values: Vec<f32>,
}

impl Patch {
    fn around(image: &Grey, at: ImagePoint, reach: usize) -> Self {
        let (c0, r0, reach) = (at.column.round() as isize, at.row.round() as isize, reach as isize);
        let values = (-reach..=reach)
            .flat_map(|dr| (-reach..=reach).map(move |dc| (dc, dr)))
            .map(|(dc, dr)| image.at(c0 + dc, r0 + dr))
            .collect();
        Self { size: (2 * reach + 1) as usize, values }
    }

    /// Dark and light: the 4th and the 96th percentile.
    fn levels(&self) -> (f32, f32) {
        let mut sorted = self.values.clone();
        sorted.sort_by(f32::total_cmp);
        let last = sorted.len() - 1;
        (sorted[last / 25], sorted[last - last / 25])
    }

    /// Standard deviation of the blur from the steepest step: contrast / (√(2π) · slope), less what taking the
    /// slope adds. `None` without a step.
    fn blur_px(&self, contrast: f32) -> Option<f64> {
        // Sobel: (1 2 1) across has a variance of 1/2 along an edge that is not upright, which a straight edge
        // does not feel; the central difference is a box two pixels wide, of variance 1/3.
        const OWN_VARIANCE: f64 = 1.0 / 3.0;
        let n = self.size;
        let at = |c: usize, r: usize| self.values[r * n + c];
        let mut steepest = 0.0_f32;
        for r in 1..n - 1 {
            for c in 1..n - 1 {
                let across = |r: usize| at(c + 1, r) - at(c - 1, r);
                let down = |c: usize| at(c, r + 1) - at(c, r - 1);
                let gx = (across(r - 1) + 2.0 * across(r) + across(r + 1)) / 8.0;
                let gy = (down(c - 1) + 2.0 * down(c) + down(c + 1)) / 8.0;
                steepest = steepest.max(gx.hypot(gy));
            }
        }
        (contrast > 0.0 && steepest > 0.0).then(|| {
            let measured = f64::from(contrast) / (f64::from(steepest) * std::f64::consts::TAU.sqrt());
            (measured * measured - OWN_VARIANCE).max(0.0).sqrt()
        })
    }
}

fn extent(values: impl Iterator<Item = f64>) -> f64 {
    let (low, high) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    (high - low).max(0.0)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::super::detect::detect;
    use super::super::rendered::{Look, paper_camera, paper_poses, photo};
    use super::super::target::{SquaresTarget, Target};
    use super::*;

    fn seen(pose: usize, look: Look) -> (PhotoQuality, Detection) {
        let target = Target::Squares(SquaresTarget::paper());
        let image = photo(&paper_camera(), &paper_poses()[pose], &target, look);
        let detection = detect(&image, &target).unwrap();
        (photo_quality(&image, 255.0, &detection), detection)
    }

    #[test]
    fn blur_contrast_and_extent_are_those_drawn() {
        for blur_px in [0.8, 1.5, 3.0] {
            let (quality, _) = seen(0, Look { blur_px, noise: 1.0, ..Look::PAPER });
            // A pixel's own box adds 1/12 px² to the blur drawn.
            let drawn = (blur_px * blur_px + 1.0 / 12.0_f64).sqrt();
            assert!((quality.blur_px / drawn - 1.0).abs() < 0.2, "{quality:?} for {drawn}");
            assert!((quality.contrast - 185.0 / 255.0).abs() < 0.05, "{quality:?}");
            assert!(quality.clipped_share < 1e-3 && quality.extent_share > 0.25, "{quality:?}");
        }
    }

    #[test]
    fn the_blurred_and_the_doubled_photo_are_left_out_with_the_reason() {
        let looks = [
            (0, Look::PAPER),
            (1, Look::PAPER),
            (2, Look { blur_px: 2.9, ..Look::PAPER }),
            (0, Look { seed: 7, blur_px: 0.6, ..Look::PAPER }),
        ];
        let seen: Vec<_> = looks.into_iter().map(|(pose, look)| seen(pose, look)).collect();
        let names = ["a", "b", "c", "d"];
        let photos: Vec<_> = names.iter().zip(&seen).map(|(name, (q, d))| (*name, *q, d)).collect();
        let faults = photo_faults(&photos, 1152);
        assert!(
            matches!(&faults[0], Some(PhotoFault::Duplicate { other, rms_px }) if other == "d" && *rms_px < 0.1),
            "{faults:?}"
        );
        assert!(faults[1].is_none() && faults[3].is_none(), "{faults:?}");
        let said = faults[2].as_ref().unwrap().to_string();
        assert!(said.starts_with("blurred: its edges have a standard deviation of "), "{said}");
        // All as blurred as that: none is left out.
        let (quality, detection) = &seen[2];
        let alone = photo_faults(&[("c", *quality, detection)], 1152);
        assert_eq!(alone, [None]);
    }
}
