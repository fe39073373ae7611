//! The third and final corner estimate: sharp, by a gradient search along the four edges of a square.
//!
//! A corner of a separated square is an L. Searching for the point to which all gradients are orthogonal
//! is biased there: blur rounds the L off towards the inside by 0.1–0.5 px. An edge away from its ends
//! has no such bias, so each edge is located by least squares on the brightness step across it,
//!
//! ```text
//! I = light + (dark − light) Φ(d/σ) Φ(d'/σ) Φ(d''/σ),   d = n·(x − m) − (a + b s + c (s² − 1/3))
//! ```
//!
//! where d is the signed distance inside the edge, s runs from −1 to 1 along it, d' and d'' belong to the
//! neighbouring edges, and a, b, c (offset, turn, bend by lens distortion), dark, light and the blur σ are
//! estimated for every edge. A corner is where two neighbouring edges intersect.

use super::step::{Lanes, Products, normal, step};
use crate::calibration::grey::Grey;
use nalgebra::{Matrix6, Vector2, Vector6};

/// Standard deviation of an edge's curvature by lens distortion, 1/px: for an 80° lens it stays below
/// three times this. Keeps noise from bending short edges, and gives way to what long edges show.
const CURVATURE_STD: f64 = 3e-4;
/// A smaller blur than this (a box one pixel wide has 0.29 px) cannot be told from it.
const LEAST_BLUR_PX: f64 = 0.25;

/// Pixels are used so many σ away from the neighbouring edges, where those leave 95 % of the dark.
const CLEAR_OF_CORNERS: f64 = 1.64;
/// And from here on all of it.
const FAR_FROM_CORNERS: f64 = 3.5;

/// A pixel differs from the fitted step by less than this share of the step, root mean square.
const NOISE_SHARE: f64 = 0.4;

/// Widest half band around an edge, pixels: three standard deviations of the strongest blur (2 px) that
/// still leaves a usable photo.
const WIDEST_BAND_PX: f64 = 6.75;

/// One edge: position and shape, brightness on both sides.
#[derive(Debug, Clone, Copy)]
struct Edge {
    middle: Vector2<f64>,
    along: Vector2<f64>,
    inwards: Vector2<f64>,
    half_length: f64,
    /// a, b, c: pixels at s² = 1/3 on average, at the ends.
    shape: [f64; 3],
    dark: f64,
    light: f64,
    blur: f64,
}

impl Edge {
    fn new(from: Vector2<f64>, to: Vector2<f64>, blur: f64) -> Option<Self> {
        let along = (to - from).try_normalize(1e-9)?;
        Some(Self {
            middle: 0.5 * (from + to),
            along,
            inwards: Vector2::new(-along.y, along.x),
            half_length: 0.5 * (to - from).norm(),
            shape: [0.0; 3],
            dark: 0.0,
            light: 0.0,
            blur,
        })
    }
    fn station(&self, p: Vector2<f64>) -> f64 {
        self.along.dot(&(p - self.middle)) / self.half_length
    }
    fn offset(&self, s: f64) -> f64 {
        self.shape[0] + self.shape[1] * s + self.shape[2] * (s * s - 1.0 / 3.0)
    }
    fn distance(&self, p: Vector2<f64>) -> f64 {
        self.inwards.dot(&(p - self.middle)) - self.offset(self.station(p))
    }
    fn point(&self, s: f64) -> Vector2<f64> {
        self.middle + self.along * (s * self.half_length) + self.inwards * self.offset(s)
    }
    /// Direction of travel at a station.
    fn tangent(&self, s: f64) -> Vector2<f64> {
        self.along * self.half_length + self.inwards * (self.shape[1] + 2.0 * self.shape[2] * s)
    }
    /// Where this edge ends and the next begins.
    fn intersection(&self, next: &Self) -> Option<Vector2<f64>> {
        let (mut s, mut t) = (1.0, -1.0);
        for _ in 0..5 {
            let (u, v) = (self.tangent(s), next.tangent(t));
            let gap = next.point(t) - self.point(s);
            let sine = u.perp(&v);
            if sine <= 0.0 {
                return None;
            }
            s += gap.perp(&v) / sine;
            t += gap.perp(&u) / sine;
        }
        let gap = (next.point(t) - self.point(s)).norm();
        (gap < 1e-6).then(|| self.point(s))
    }
}

/// A pixel near an edge.
struct Sample {
    across: f64,
    station: f64,
    value: f64,
    /// Share of the dark that the neighbouring edges leave.
    kept: f64,
}

/// Locates the corners of one square.
///
/// - `start`: corners of the outline, clockwise from any of them, pixels of `image`.
/// - `start_scale`: pixels of `image` per pixel in which the outline was found.
/// - `gap`: distance to the neighbouring square in sides; the search never reaches it.
///
/// Returns the corners in the same order, or `None` when an edge is not a clean step from light to dark.
pub(super) fn sharp(
    image: &Grey,
    start: [Vector2<f64>; 4],
    start_scale: f64,
    gap: f64,
) -> Option<[Vector2<f64>; 4]> {
    const ROUNDS: usize = 6;
    let shortest = (0..4).map(|k| (start[(k + 1) % 4] - start[k]).norm()).fold(f64::INFINITY, f64::min);
    // Half the free width on both sides of an edge, so that no other edge is in the band.
    let limit = 0.45 * shortest * gap.min(1.0);
    let mut corners = start;
    let mut edges = Vec::with_capacity(4);
    for k in 0..4 {
        edges.push(Edge::new(corners[k], corners[(k + 1) % 4], start_scale)?);
    }
    for round in 0..ROUNDS {
        let before = edges.clone();
        for k in 0..4 {
            let (previous, next) = (&before[(k + 3) % 4], &before[(k + 1) % 4]);
            // The first search reaches over the start's error, later ones just over the blur.
            // Shading and clutter farther out would pass for blur and draw the search on: hence the bound.
            let reach = (3.0 * before[k].blur + 0.75).min(WIDEST_BAND_PX);
            let reach = if round == 0 { 3.0 + start_scale } else { reach };
            let samples = collect(image, &before[k], previous, next, reach.min(limit));
            edges[k] = fit(&before[k], &samples, round == 0)?;
        }
        let mut moved = 0.0_f64;
        for k in 0..4 {
            let corner = edges[(k + 3) % 4].intersection(&edges[k])?;
            moved = moved.max((corner - corners[k]).norm());
            corners[k] = corner;
        }
        if corners.iter().zip(&start).any(|(c, s)| (c - s).norm() > 2.0 * start_scale + 0.25 * shortest) {
            return None;
        }
        for k in 0..4 {
            // The same curve over the new length.
            let mut edge = Edge::new(corners[k], corners[(k + 1) % 4], edges[k].blur)?;
            let bend = edges[k].shape[2] * (edge.half_length / edges[k].half_length).powi(2);
            edge.shape = [2.0 / 3.0 * -bend, 0.0, bend];
            (edge.dark, edge.light) = (edges[k].dark, edges[k].light);
            edges[k] = edge;
        }
        if round > 0 && moved < 0.1 {
            break;
        }
    }
    Some(corners)
}

/// The pixels within `reach` of an edge, between its neighbours.
fn collect(image: &Grey, edge: &Edge, previous: &Edge, next: &Edge, reach: f64) -> Vec<Sample> {
    let mut samples = Vec::with_capacity((edge.half_length * reach * 5.0) as usize + 16);
    let steep = edge.along.y.abs() > edge.along.x.abs();
    let (major, minor) = if steep { (1, 0) } else { (0, 1) };
    let ends = [edge.point(-1.0), edge.point(1.0)];
    let low = ends[0][major].min(ends[1][major]) - reach;
    let high = ends[0][major].max(ends[1][major]) + reach;
    let slope = edge.along[minor] / edge.along[major];
    let half_width = (reach + 0.5) / edge.along[major].abs();
    let size = [image.width() as f64 - 1.0, image.height() as f64 - 1.0];
    let mut m = low.max(0.0).ceil();
    while m <= high.min(size[major]) {
        let centre = edge.middle[minor] + (m - edge.middle[major]) * slope;
        let mut n = (centre - half_width).max(0.0).ceil();
        while n <= (centre + half_width).min(size[minor]) {
            let p = if steep { Vector2::new(n, m) } else { Vector2::new(m, n) };
            n += 1.0;
            let station = edge.station(p);
            if station.abs() > 1.05 || edge.distance(p).abs() > reach {
                continue;
            }
            let others = [previous, next].map(|other| other.distance(p) / other.blur);
            // The product of two steps is exact for a right angle only, and real corners are rounded.
            if others.iter().any(|z| *z < CLEAR_OF_CORNERS) {
                continue;
            }
            let near = others.into_iter().filter(|z| *z < FAR_FROM_CORNERS);
            let kept = near.map(normal).product();
            samples.push(Sample {
                across: edge.inwards.dot(&(p - edge.middle)),
                station,
                value: f64::from(image.at(p.x as isize, p.y as isize)),
                kept,
            });
        }
        m += 1.0;
    }
    samples
}

/// Four samples.
struct Block {
    across: Lanes,
    station: Lanes,
    value: Lanes,
    kept: Lanes,
    /// Zero for those that only fill up the last block.
    weight: Lanes,
}

/// Every `stride`th sample, in fours.
fn blocks(samples: &[Sample], stride: usize) -> Vec<Block> {
    let used: Vec<&Sample> = samples.iter().step_by(stride).collect();
    let block = |four: &[&Sample]| {
        let lanes =
            |f: fn(&Sample) -> f64| Lanes(std::array::from_fn(|k| four.get(k).map_or(0.0, |s| f(s) as f32)));
        Block {
            across: lanes(|s| s.across),
            station: lanes(|s| s.station),
            value: lanes(|s| s.value),
            kept: lanes(|s| s.kept),
            weight: lanes(|_| 1.0),
        }
    };
    used.chunks(4).map(block).collect()
}

/// Normal equations of one edge.
struct Equations {
    matrix: Matrix6<f64>,
    right: Vector6<f64>,
    /// Mean square difference of a pixel from the step.
    mean_square: f64,
    /// What is minimised: the pixels' share and that of the prior knowledge of the bend.
    cost: f64,
}

impl Equations {
    /// `None` when the dark side is not the darker one.
    fn new(edge: &Edge, blocks: &[Block], curvature_std: f64) -> Option<Self> {
        let contrast = edge.light - edge.dark;
        if contrast.is_nan() || contrast <= 0.0 {
            return None;
        }
        let [a, b, c] = edge.shape.map(Lanes::all);
        let (one, half, third) = (Lanes::all(1.0), Lanes::all(0.5), Lanes::all(1.0 / 3.0));
        let (per_blur, light, height) =
            (Lanes::all(1.0 / edge.blur), Lanes::all(edge.light), Lanes::all(contrast));
        // d(value)/d(offset) = contrast · kept · density / blur.
        let slope = Lanes::all(0.5 * contrast / edge.blur);
        let mut products = Products::<7>::new();
        for block in blocks {
            let s = block.station;
            let bend = s * s - third;
            let z = (block.across - a - b * s - c * bend) * per_blur;
            let (inside, density) = step(z);
            let covered = (inside * half + half) * block.kept;
            let residual = (block.value - light + height * covered) * block.weight;
            let by_offset = slope * block.kept * density * block.weight;
            products.add(&[
                by_offset,
                by_offset * s,
                by_offset * bend,
                covered * block.weight,
                (one - covered) * block.weight,
                by_offset * z,
                residual,
            ]);
        }
        let mut matrix = Matrix6::from_fn(|i, j| products.sum(i, j));
        let mut right = Vector6::from_fn(|i, _| products.sum(6, i));
        let (sum, count) = (products.sum(6, 6), blocks.iter().map(|b| b.weight.sum()).sum::<f64>());
        // What is known of the bend before looking, weighed against pixels that fit the step to 2 % of its
        // height, as photos do.
        let prior = (0.02 * contrast / curvature_std).powi(2);
        matrix[(2, 2)] += prior;
        right[2] -= prior * edge.shape[2];
        let cost = sum + prior * edge.shape[2].powi(2);
        Some(Self { matrix, right, mean_square: sum / count, cost })
    }

    fn solve(&self, damping: f64) -> Option<Vector6<f64>> {
        let mut matrix = self.matrix;
        for i in 0..6 {
            matrix[(i, i)] *= 1.0 + damping;
        }
        matrix.cholesky().map(|cholesky| cholesky.solve(&self.right))
    }
}

/// Levenberg–Marquardt on a, b, c, dark, light and blur.
fn fit(start: &Edge, samples: &[Sample], from_scratch: bool) -> Option<Edge> {
    const STEPS: usize = 12;
    // Steps shrink a hundredfold and more from one to the next: the last one leaves far less than this.
    let tolerance_px = if from_scratch { 1e-1 } else { 2e-2 };
    let mut edge = *start;
    if samples.len() < 20 {
        return None;
    }
    if from_scratch {
        // Dark and light: means of what lies clearly inside and outside.
        let mean = |side: &dyn Fn(&Sample) -> bool| {
            let (mut sum, mut count) = (0.0, 0.0);
            for s in samples.iter().filter(|s| side(s)) {
                sum += s.value;
                count += 1.0;
            }
            (count > 0.0).then(|| sum / count)
        };
        edge.dark = mean(&|s| s.across > 1.5).or_else(|| mean(&|s| s.across > 0.0))?;
        edge.light = mean(&|s| s.across < -1.5).or_else(|| mean(&|s| s.across < 0.0))?;
    }
    // The first fit only has to bring the next one close.
    let blocks = blocks(samples, if from_scratch && samples.len() > 120 { 3 } else { 1 });
    let curvature_std = CURVATURE_STD * edge.half_length * edge.half_length * 0.5;
    let (mut equations, mut damping) = (Equations::new(&edge, &blocks, curvature_std)?, 1e-3);
    for _ in 0..STEPS {
        let step = equations.solve(damping)?;
        let mut next = edge;
        for k in 0..3 {
            next.shape[k] += step[k];
        }
        next.dark += step[3];
        next.light += step[4];
        next.blur = (edge.blur + step[5]).max(LEAST_BLUR_PX);
        // On an edge along a pixel row that is sharper than a pixel, position and blur show in one row of
        // pixels only: undamped steps would run away.
        match Equations::new(&next, &blocks, curvature_std) {
            Some(there) if there.cost <= equations.cost => {
                (edge, equations, damping) = (next, there, 0.1 * damping);
                if step.iter().take(3).all(|v| v.abs() < tolerance_px) {
                    break;
                }
            }
            _ => damping = (10.0 * damping).max(1e-3),
        }
    }
    // The band must reach past the blur, and the step must explain what is seen in it.
    let contrast = edge.light - edge.dark;
    let clean =
        equations.mean_square.sqrt() < NOISE_SHARE * contrast && edge.blur < 0.35 * edge.half_length.max(4.0);
    clean.then_some(edge)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dark square (any corners) blurred by a Gaussian, sampled at pixel centres with 6 × 6 samples.
    fn blurred(corners: [Vector2<f64>; 4], blur: f64, size: usize) -> Grey {
        const SUB: usize = 16;
        let fine = size * SUB;
        let mut values = vec![0.0_f64; fine * fine];
        for (i, value) in values.iter_mut().enumerate() {
            let to_px = |k: usize| (k as f64 + 0.5) / SUB as f64 - 0.5;
            let p = Vector2::new(to_px(i % fine), to_px(i / fine));
            let inside = (0..4).all(|k| (corners[(k + 1) % 4] - corners[k]).perp(&(p - corners[k])) > 0.0);
            *value = if inside { 30.0 } else { 200.0 };
        }
        let reach = (4.0 * blur * SUB as f64) as isize;
        let kernel: Vec<f64> =
            (-reach..=reach).map(|k| (-0.5 * (k as f64 / (blur * SUB as f64)).powi(2)).exp()).collect();
        let total: f64 = kernel.iter().sum();
        let pass = |source: &[f64], stride: usize, other: usize| -> Vec<f64> {
            (0..fine * fine)
                .map(|i| {
                    let along = (i / stride % fine) as isize;
                    let base = i - along as usize * stride;
                    debug_assert!(other > 0);
                    kernel
                        .iter()
                        .zip(-reach..)
                        .map(|(w, k)| {
                            let at = (along + k).clamp(0, fine as isize - 1) as usize;
                            w * source[base + at * stride]
                        })
                        .sum::<f64>()
                        / total
                })
                .collect()
        };
        let values = pass(&pass(&values, 1, fine), fine, 1);
        let mut image = vec![0.0_f32; size * size];
        for (i, value) in image.iter_mut().enumerate() {
            let mut sum = 0.0;
            for r in 0..SUB {
                for c in 0..SUB {
                    sum += values[(i / size * SUB + r) * fine + i % size * SUB + c];
                }
            }
            *value = (sum / (SUB * SUB) as f64) as f32;
        }
        Grey::new(size, size, image).unwrap()
    }

    #[test]
    fn corners_of_blurred_squares_are_found_without_inward_bias() {
        for (blur, angle) in [(0.4, 0.03), (0.8, 0.35), (1.5, 0.6), (1.5, 0.0)] {
            let (sin, cos) = f64::sin_cos(angle);
            let truth = [(-9.0, -9.3), (9.6, -8.7), (9.1, 9.4), (-9.7, 8.8)]
                .map(|(x, y)| Vector2::new(22.3 + cos * x - sin * y, 21.6 + sin * x + cos * y));
            let image = blurred(truth, blur, 44);
            let centre = truth.iter().sum::<Vector2<f64>>() / 4.0;
            // Starting a pixel inside, as the Harris estimate does.
            let start = truth.map(|p| p + (centre - p).normalize());
            let found = sharp(&image, start, 1.0, 1.0).unwrap();
            for (f, t) in found.iter().zip(&truth) {
                let outwards = (f - t).dot(&(t - centre).normalize());
                assert!((f - t).norm() < 0.02, "blur {blur}: {f:?} for {t:?}, {outwards:.4} px outwards");
            }
        }
    }

    #[test]
    fn no_square_no_corner() {
        let flat = Grey::new(40, 40, vec![100.0; 1600]).unwrap();
        let start = [(10.0, 10.0), (28.0, 10.0), (28.0, 28.0), (10.0, 28.0)].map(|(x, y)| Vector2::new(x, y));
        assert!(sharp(&flat, start, 1.0, 1.0).is_none());
    }
}
