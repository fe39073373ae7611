//! Places where two edges cross and dark and light change places: candidates for inner corners.
//!
//! Around a crossing brightness is a saddle, so det(Hessian) is strongly negative; on edges it is zero. The
//! strongest saddles are looked at on a ring around them: it must cross exactly four edges, two by two opposite.

use crate::calibration::grey::Grey;
use nalgebra::Vector2;

/// Most saddles looked at, the strongest first: bounds the work on photos full of clutter.
const MAX_PEAKS: usize = 4000;
/// Distance of the pixels that second differences are taken over: averages noise, sees squares of 6 px.
const STEP: usize = 2;
/// Pixels along the frame where no crossing is looked for.
pub(super) const FRAME_PX: usize = 4;
/// Radius of the ring, px: between the blur and the next crossing.
const RING_PX: f64 = 4.0;
const RING_SAMPLES: usize = 32;
/// Angle between neighbouring samples.
const TURN: f64 = std::f64::consts::TAU / RING_SAMPLES as f64;
/// Light minus dark on the ring as a share of the photo's brightness range.
const CONTRAST_SHARE: f32 = 0.04;

/// A crossing of two edges.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    /// The pixel of the strongest response.
    pub peak: Vector2<f64>,
    /// Where its edges meet, from the ring.
    pub saddle: Vector2<f64>,
    /// Unit vectors along the four edges that leave it, clockwise as seen; dark between the first and the second.
    pub arms: [Vector2<f64>; 4],
    /// Light minus dark.
    pub contrast: f32,
}

/// All crossings in a smoothed photo, the strongest first.
pub(super) fn find(smooth: &Grey) -> Vec<Crossing> {
    let least = CONTRAST_SHARE * smooth.range();
    let ring = offsets();
    peaks(smooth)
        .into_iter()
        .filter(|&(column, row)| is_four_sided(smooth, column, row))
        .filter_map(|(column, row)| crossing(smooth, Vector2::new(column as f64, row as f64), least, &ring))
        .collect()
}

/// Whether opposite places on a circle are more alike than places a quarter apart: true of crossings, false of
/// edges, corners and most noise. Sixteen pixels tell it before the ring is looked at closely.
///
/// # Source
/// Bennett and Lasenby (2014), "ChESS – Quick and Robust Detection of Chess-board Features": sum and difference
/// responses.
fn is_four_sided(image: &Grey, column: usize, row: usize) -> bool {
    const CIRCLE: [(isize, isize); 16] = [
        (4, 0),
        (4, 2),
        (3, 3),
        (2, 4),
        (0, 4),
        (-2, 4),
        (-3, 3),
        (-4, 2),
        (-4, 0),
        (-4, -2),
        (-3, -3),
        (-2, -4),
        (0, -4),
        (2, -4),
        (3, -3),
        (4, -2),
    ];
    // No peak is nearer to the frame than the circle is wide.
    let (w, values) = (image.width() as isize, image.values());
    let at = |k: usize| values[((row as isize + CIRCLE[k].1) * w + column as isize + CIRCLE[k].0) as usize];
    let circle: [f32; 16] = std::array::from_fn(at);
    let (mut quarters, mut halves) = (0.0, 0.0);
    for k in 0..4 {
        quarters += (circle[k] + circle[k + 8] - circle[k + 4] - circle[k + 12]).abs();
        halves += (circle[k] - circle[k + 8]).abs() + (circle[k + 4] - circle[k + 12]).abs();
    }
    quarters > halves
}

/// Directions of the ring's samples, clockwise as seen, times its radius.
type Offsets = [Vector2<f64>; RING_SAMPLES];

fn offsets() -> Offsets {
    std::array::from_fn(|i| {
        let (sin, cos) = (i as f64 * TURN).sin_cos();
        RING_PX * Vector2::new(cos, sin)
    })
}

/// The crossing near a place where one is expected, within `reach` px.
pub(super) fn near(smooth: &Grey, place: Vector2<f64>, reach: f64, least_contrast: f32) -> Option<Crossing> {
    let mut best: Option<(f32, Vector2<f64>)> = None;
    let size = reach.ceil() as isize;
    let (column, row) = (place.x.round() as isize, place.y.round() as isize);
    for r in row - size..=row + size {
        for c in column - size..=column + size {
            if !is_inside(smooth, c, r) {
                continue;
            }
            let pixel = Vector2::new(c as f64, r as f64);
            let strength = response(smooth, c, r);
            if (pixel - place).norm() <= reach && best.is_none_or(|(most, _)| strength > most) {
                best = Some((strength, pixel));
            }
        }
    }
    let (_, peak) = best.filter(|&(strength, _)| strength > 0.0)?;
    crossing(smooth, peak, least_contrast, &offsets())
}

fn is_inside(image: &Grey, column: isize, row: isize) -> bool {
    let frame = FRAME_PX as isize;
    column >= frame
        && row >= frame
        && column < image.width() as isize - frame
        && row < image.height() as isize - frame
}

/// −det(Hessian) at a pixel.
fn response(image: &Grey, column: isize, row: isize) -> f32 {
    let s = STEP as isize;
    let at = |c: isize, r: isize| image.at(column + c, row + r);
    let xx = at(s, 0) - 2.0 * at(0, 0) + at(-s, 0);
    let yy = at(0, s) - 2.0 * at(0, 0) + at(0, -s);
    let xy = 0.25 * (at(s, s) - at(-s, s) - at(s, -s) + at(-s, -s));
    xy * xy - xx * yy
}

/// −det(Hessian) of one row of pixels, zero at both ends.
fn responses(image: &Grey, row: usize, out: &mut [f32]) {
    let w = image.width();
    let line = |r: usize| &image.values()[r * w..(r + 1) * w];
    let (up, here, down) = (line(row - STEP), line(row), line(row + STEP));
    let count = w - 2 * STEP;
    let (u0, u1, u2) = (&up[..count], &up[STEP..STEP + count], &up[2 * STEP..]);
    let (h0, h1, h2) = (&here[..count], &here[STEP..STEP + count], &here[2 * STEP..]);
    let (d0, d1, d2) = (&down[..count], &down[STEP..STEP + count], &down[2 * STEP..]);
    for (i, value) in out[STEP..STEP + count].iter_mut().enumerate() {
        let twice = 2.0 * h1[i];
        let xx = h0[i] - twice + h2[i];
        let yy = u1[i] - twice + d1[i];
        let xy = 0.25 * (d2[i] - d0[i] - u2[i] + u0[i]);
        *value = xy * xy - xx * yy;
    }
}

/// Pixels (column, row) whose response is the largest within 2 px, the strongest first.
fn peaks(image: &Grey) -> Vec<(usize, usize)> {
    const REACH: usize = 2;
    let (w, h) = (image.width(), image.height());
    if w.min(h) <= 2 * FRAME_PX + 1 {
        return vec![];
    }
    let mut response = vec![0.0_f32; w * h];
    for (row, line) in response.chunks_exact_mut(w).enumerate().take(h - STEP).skip(STEP) {
        responses(image, row, line);
    }
    let floor = (0.15 * CONTRAST_SHARE * image.range()).powi(2);
    let mut peaks = Vec::new();
    for row in FRAME_PX..h - FRAME_PX {
        let line = &response[row * w..(row + 1) * w];
        for column in FRAME_PX..w - FRAME_PX {
            let value = line[column];
            if value <= floor || value < line[column - 1] || value < line[column + 1] {
                continue;
            }
            let is_peak = (row - REACH..=row + REACH).all(|r| {
                let window = &response[r * w + column - REACH..=r * w + column + REACH];
                // Of equal neighbours the first in reading order is the peak.
                window.iter().enumerate().all(|(i, other)| {
                    let earlier = (r, i) < (row, REACH);
                    *other < value || *other == value && !earlier
                })
            });
            if is_peak {
                peaks.push((value, column, row));
            }
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
    peaks.truncate(MAX_PEAKS);
    peaks.into_iter().map(|(_, column, row)| (column, row)).collect()
}

/// The crossing around a saddle, from where two rings meet its edges; the second ring lies about the crossing of
/// the chords of the first.
fn crossing(image: &Grey, peak: Vector2<f64>, least_contrast: f32, ring: &Offsets) -> Option<Crossing> {
    const FARTHEST_PX: f64 = 2.5;
    let first = Ring::new(image, peak, least_contrast, ring)?;
    let place = first.chords_meet().filter(|place| (place - peak).norm() < FARTHEST_PX)?;
    let ring = Ring::new(image, place, least_contrast, ring)?;
    let saddle = ring.chords_meet().filter(|saddle| (saddle - place).norm() < 0.5 * FARTHEST_PX)?;
    let arms = ring.points.map(|p| (p - saddle).normalize());
    // Opposite arms are one edge, bent by 30° at most; neighbours are 20° or more apart.
    let straight = (0..2).all(|k| arms[k].dot(&arms[k + 2]) < -0.86);
    let apart = (0..4).all(|k| arms[k].perp(&arms[(k + 1) % 4]) > 0.34);
    (straight && apart).then_some(Crossing { peak, saddle, arms, contrast: ring.contrast })
}

/// Where a ring meets four edges.
struct Ring {
    /// Clockwise, dark between the first and the second.
    points: [Vector2<f64>; 4],
    contrast: f32,
}

impl Ring {
    /// `None` when brightness along the ring does not change sides four times, alike at opposite places.
    fn new(image: &Grey, centre: Vector2<f64>, least_contrast: f32, ring: &Offsets) -> Option<Self> {
        const HALF: usize = RING_SAMPLES / 2;
        let point = |turns: f64| {
            let (sin, cos) = (turns * TURN).sin_cos();
            centre + RING_PX * Vector2::new(cos, sin)
        };
        let range = |values: &[f32]| {
            values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |m, v| (m.0.min(*v), m.1.max(*v)))
        };
        // Most saddles are noise: eight samples tell.
        let few: [f32; 8] = std::array::from_fn(|i| image.between(centre + ring[i * RING_SAMPLES / 8]));
        let (low, high) = range(&few);
        if high - low < 0.5 * least_contrast {
            return None;
        }
        let raw: [f32; RING_SAMPLES] = std::array::from_fn(|i| image.between(centre + ring[i]));
        let values: [f32; RING_SAMPLES] = std::array::from_fn(|i| {
            let (before, after) = (raw[(i + RING_SAMPLES - 1) % RING_SAMPLES], raw[(i + 1) % RING_SAMPLES]);
            0.25 * (before + 2.0 * raw[i] + after)
        });
        let (low, high) = range(&values);
        let contrast = high - low;
        if contrast < least_contrast || contrast <= 0.0 {
            return None;
        }
        let middle = 0.5 * (low + high);
        let is_light = |i: usize| values[i % RING_SAMPLES] > middle;
        let alike = (0..HALF).filter(|&i| is_light(i) == is_light(i + HALF)).count();
        let mut changes = (0..RING_SAMPLES).filter(|&i| is_light(i) != is_light(i + 1));
        let edges = [changes.next()?, changes.next()?, changes.next()?, changes.next()?];
        if changes.next().is_some() || alike + 3 < HALF {
            return None;
        }
        let mut points = edges.map(|i| {
            let (before, after) = (values[i], values[(i + 1) % RING_SAMPLES]);
            point(i as f64 + f64::from((middle - before) / (after - before)))
        });
        if !is_light(edges[0]) {
            points.rotate_left(1);
        }
        Some(Self { points, contrast })
    }

    /// Where the chords between opposite points meet.
    fn chords_meet(&self) -> Option<Vector2<f64>> {
        let [a, b, c, d] = self.points;
        let (u, v) = (c - a, d - b);
        let sine = u.perp(&v);
        (sine > 0.0).then(|| a + u * ((b - a).perp(&v) / sine))
    }
}
