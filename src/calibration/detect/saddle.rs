//! The exact place where two edges cross and dark and light change places: inner corners of chessboards.
//!
//! ```text
//! I = mean + slope·(p − c) + contrast S(d₁) S(d₂),   S(d) = 2 Φ(d/σ) − 1,   dᵢ = nᵢ·(p − x)
//! ```
//!
//! with the crossing x, the normals n₁ and n₂ of its edges, the blur σ and the light fitted to the pixels
//! around it by least squares. A photo of a crossing looks the same turned by half about it, whatever the blur
//! and the camera's gamma: there is nothing that could draw the estimate to one side.

use super::step::normal;
use crate::calibration::grey::Grey;
use nalgebra::{SMatrix, SVector, Vector2};

/// Crossing, two edge angles, blur, mean, slope across and down, contrast.
const PARAMETERS: usize = 9;
/// Wider windows gain little and see the lens bend the edges.
const WIDEST_REACH_PX: f64 = 9.0;

/// A located crossing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Saddle {
    pub pixel: Vector2<f64>,
    fit: Fit,
}

impl Saddle {
    /// Directions of its two edges, in the order of those given.
    pub fn edges(&self) -> [Vector2<f64>; 2] {
        self.fit.angles.map(|angle| Vector2::new(angle.cos(), angle.sin()))
    }
}

/// Locates a crossing.
///
/// - `start`: within `reach` / 3 of it, px.
/// - `edges`: directions of its two edges, to 20° or so; either way along the edge.
/// - `reach`: radius of the window in px; nothing but the crossing may be inside.
///
/// `None` when the pixels are not those of a crossing.
pub(super) fn refine(
    image: &Grey,
    start: Vector2<f64>,
    edges: [Vector2<f64>; 2],
    reach: f64,
) -> Option<Saddle> {
    let reach = reach.min(WIDEST_REACH_PX);
    let window = Window::new(image, start, reach)?;
    let mut saddle = settle(Fit::start(&window, start, edges)?, &window)?;
    // A window that is not symmetric about the crossing shows more of one field than of the opposite one.
    let recentred = Window::new(image, saddle.pixel, reach)?;
    if recentred.centre != window.centre {
        saddle = settle(saddle.fit.seen_from(recentred.centre - window.centre), &recentred)?;
    }
    ((saddle.pixel - start).norm() < 0.5 * reach + 0.5).then_some(saddle)
}

/// Levenberg–Marquardt from a start.
fn settle(start: Fit, window: &Window) -> Option<Saddle> {
    const STEPS: usize = 12;
    const TOLERANCE_PX: f64 = 3e-3;
    // Where the model does not fit exactly, steps shrink slowly: this many are enough for so little.
    const LEFT_PX: f64 = 3e-2;
    let mut fit = start;
    let (mut equations, mut damping) = (Equations::new(&fit, window), 1e-3);
    let mut moved = f64::INFINITY;
    for _ in 0..STEPS {
        let next = equations.step(damping).and_then(|step| fit.moved(&step, window.reach));
        let there = next.map(|next| (next, Equations::new(&next, window)));
        match there {
            Some((next, there)) if there.cost <= equations.cost => {
                moved = (next.crossing - fit.crossing).norm();
                (fit, equations, damping) = (next, there, 0.1 * damping);
                if moved < TOLERANCE_PX {
                    break;
                }
            }
            _ => damping = (10.0 * damping).max(1e-2),
        }
    }
    let spread = (equations.cost / window.pixels.len() as f64).sqrt();
    let sine = (fit.angles[1] - fit.angles[0]).sin().abs();
    let clean = spread < 0.5 * fit.contrast.abs() && sine > 0.25;
    (moved < LEFT_PX && clean).then_some(Saddle { pixel: window.centre + fit.crossing, fit })
}

/// The pixels that are looked at.
struct Window {
    /// A pixel's centre; everything else is relative to it.
    centre: Vector2<f64>,
    reach: f64,
    /// Right, down, brightness.
    pixels: Vec<[f64; 3]>,
}

impl Window {
    /// `None` when too little of it lies inside the photo.
    fn new(image: &Grey, start: Vector2<f64>, reach: f64) -> Option<Self> {
        let (w, h) = (image.width() as f64, image.height() as f64);
        let inside = start.x >= 0.0 && start.y >= 0.0 && start.x <= w - 1.0 && start.y <= h - 1.0;
        if !inside || reach.is_nan() || reach < 2.0 {
            return None;
        }
        let (column, row) = (start.x.round() as isize, start.y.round() as isize);
        let size = reach.floor() as isize;
        let mut pixels = Vec::with_capacity(((2 * size + 1) * (2 * size + 1)) as usize);
        for down in -size..=size {
            for right in -size..=size {
                let (c, r) = (column + right, row + down);
                let seen = c >= 0 && r >= 0 && c < image.width() as isize && r < image.height() as isize;
                if seen && ((right * right + down * down) as f64) <= reach * reach {
                    pixels.push([right as f64, down as f64, f64::from(image.at(c, r))]);
                }
            }
        }
        let enough = pixels.len() as f64 > 0.7 * std::f64::consts::PI * (reach - 0.5) * (reach - 0.5);
        enough.then_some(Self { centre: Vector2::new(column as f64, row as f64), reach, pixels })
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Fit {
    crossing: Vector2<f64>,
    /// Of the edges, clockwise from the right.
    angles: [f64; 2],
    blur: f64,
    mean: f64,
    slope: Vector2<f64>,
    contrast: f64,
}

impl Fit {
    fn start(window: &Window, start: Vector2<f64>, edges: [Vector2<f64>; 2]) -> Option<Self> {
        let angles = edges.map(|e| e.y.atan2(e.x));
        if (angles[1] - angles[0]).sin().abs() < 0.2 || !angles.iter().all(|a| a.is_finite()) {
            return None;
        }
        let mut fit = Self {
            crossing: start - window.centre,
            angles,
            blur: 1.0,
            mean: 0.0,
            slope: Vector2::zeros(),
            contrast: 0.0,
        };
        // Mean of each pair of opposite fields.
        let normals = fit.normals();
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        for &[x, y, value] in &window.pixels {
            let p = Vector2::new(x, y) - fit.crossing;
            let field = usize::from(normals[0].dot(&p) * normals[1].dot(&p) > 0.0);
            sums[field] += value;
            counts[field] += 1.0;
        }
        let [unlike, like] = [0, 1].map(|k| sums[k] / f64::max(counts[k], 1.0));
        fit.mean = 0.5 * (like + unlike);
        fit.contrast = 0.5 * (like - unlike);
        (fit.contrast.abs() > 0.0).then_some(fit)
    }
    /// The same fit relative to a place further on.
    fn seen_from(&self, centre: Vector2<f64>) -> Self {
        Self { crossing: self.crossing - centre, mean: self.mean + self.slope.dot(&centre), ..*self }
    }
    fn normals(&self) -> [Vector2<f64>; 2] {
        self.angles.map(|a| Vector2::new(-a.sin(), a.cos()))
    }
    /// `None` where there is no crossing any more.
    fn moved(&self, step: &SVector<f64, PARAMETERS>, reach: f64) -> Option<Self> {
        let next = Self {
            crossing: self.crossing + Vector2::new(step[0], step[1]),
            angles: [self.angles[0] + step[2], self.angles[1] + step[3]],
            // At most halved or doubled: the model is far from linear in it.
            blur: (self.blur + step[4]).clamp(0.5 * self.blur, 2.0 * self.blur).max(0.3),
            mean: self.mean + step[5],
            slope: self.slope + Vector2::new(step[6], step[7]),
            contrast: self.contrast + step[8],
        };
        let inside = next.crossing.norm() < reach && next.blur < reach;
        (inside && next.contrast * self.contrast > 0.0).then_some(next)
    }
}

/// Normal equations of the nine parameters.
struct Equations {
    /// Lower triangle of JᵀJ, Jᵀ residuals in the last row.
    matrix: [[f64; PARAMETERS]; PARAMETERS + 1],
    /// Sum of squared residuals.
    cost: f64,
}

impl Equations {
    fn new(fit: &Fit, window: &Window) -> Self {
        let [n, m] = fit.normals();
        // Unit vectors along the edges: how the normals turn.
        let (along_n, along_m) = (Vector2::new(-n.y, n.x), Vector2::new(-m.y, m.x));
        let per_blur = 1.0 / fit.blur;
        let mut matrix = [[0.0; PARAMETERS]; PARAMETERS + 1];
        let mut cost = 0.0;
        for &[x, y, value] in &window.pixels {
            let (dx, dy) = (x - fit.crossing.x, y - fit.crossing.y);
            let (d, e) = (n.x * dx + n.y * dy, m.x * dx + m.y * dy);
            let ((p, p_slope), (q, q_slope)) = (normal(d * per_blur), normal(e * per_blur));
            let (s, t) = (2.0 * p - 1.0, 2.0 * q - 1.0);
            // d(brightness) / d(distance from either edge).
            let by_d = 2.0 * fit.contrast * p_slope * per_blur * t;
            let by_e = 2.0 * fit.contrast * q_slope * per_blur * s;
            let residual = value - fit.mean - fit.slope.x * x - fit.slope.y * y - fit.contrast * s * t;
            let row = [
                -by_d * n.x - by_e * m.x,
                -by_d * n.y - by_e * m.y,
                by_d * (along_n.x * dx + along_n.y * dy),
                by_e * (along_m.x * dx + along_m.y * dy),
                -(by_d * d + by_e * e) * per_blur,
                1.0,
                x,
                y,
                s * t,
            ];
            for (i, line) in matrix.iter_mut().enumerate() {
                let factor = if i < PARAMETERS { row[i] } else { residual };
                for (sum, value) in line.iter_mut().zip(&row) {
                    *sum += factor * value;
                }
            }
            cost += residual * residual;
        }
        Self { matrix, cost }
    }

    fn step(&self, damping: f64) -> Option<SVector<f64, PARAMETERS>> {
        let mut matrix = SMatrix::<f64, PARAMETERS, PARAMETERS>::from_fn(|i, j| self.matrix[i][j]);
        for i in 0..PARAMETERS {
            matrix[(i, i)] *= 1.0 + damping;
        }
        let right = SVector::<f64, PARAMETERS>::from(self.matrix[PARAMETERS]);
        matrix.cholesky().map(|cholesky| cholesky.solve(&right))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A crossing seen through pixels and a blur that together are a box 2.4 px wide.
    fn drawn(crossing: Vector2<f64>, edges: [Vector2<f64>; 2], gamma: f64) -> Grey {
        const SIZE: usize = 24;
        const SAMPLES: usize = 1597;
        const STRIDE: usize = 987;
        let field = |p: Vector2<f64>| {
            let d = p - crossing;
            if edges[0].perp(&d) * edges[1].perp(&d) > 0.0 { 40.0 } else { 200.0 }
        };
        let share = |k: usize| 2.4 * ((k as f64 + 0.5) / SAMPLES as f64 - 0.5);
        let values = (0..SIZE * SIZE).map(|i| {
            let pixel = Vector2::new((i % SIZE) as f64, (i / SIZE) as f64);
            let sum: f64 = (0..SAMPLES)
                .map(|k| field(pixel + Vector2::new(share(k), share(k * STRIDE % SAMPLES))))
                .sum();
            (255.0 * (sum / SAMPLES as f64 / 255.0).powf(gamma)) as f32
        });
        Grey::new(SIZE, SIZE, values.collect()).unwrap()
    }

    #[test]
    fn crossings_are_found_at_any_angle_and_gamma() {
        for (turn, open, gamma) in [
            (0.0, 1.57, 1.0),
            (0.3, 1.57, 1.0),
            (0.3, 1.57, 2.2),
            (0.8, 0.7, 1.0),
            (0.8, 0.7, 0.45),
            (2.5, 2.4, 1.0),
        ] {
            let edges = [turn, turn + open].map(|a: f64| Vector2::new(a.cos(), a.sin()));
            let truth = Vector2::new(11.37, 12.18);
            let image = drawn(truth, edges, gamma);
            // From a third of the window away, with edges 9° off.
            let rough = [turn + 0.15, turn + open - 0.15].map(|a: f64| Vector2::new(a.cos(), a.sin()));
            let found = refine(&image, truth + Vector2::new(1.1, -0.9), rough, 6.0).unwrap();
            let miss = (found.pixel - truth).norm();
            assert!(miss < 0.02, "turned {turn}, open {open}, gamma {gamma}: {miss} px off");
        }
    }

    #[test]
    fn where_nothing_crosses_nothing_is_found() {
        let edges = [Vector2::x(), Vector2::y()];
        let start = Vector2::new(12.0, 12.0);
        let flat = Grey::new(24, 24, vec![90.0; 576]).unwrap();
        assert_eq!(refine(&flat, start, edges, 6.0), None);
        let step =
            Grey::new(24, 24, (0..576).map(|i| if i % 24 < 12 { 20.0 } else { 200.0 }).collect()).unwrap();
        assert_eq!(refine(&step, start, edges, 6.0), None);
        let crossing = drawn(start, edges, 1.0);
        assert_eq!(refine(&crossing, Vector2::new(-3.0, 500.0), edges, 6.0), None);
        assert_eq!(refine(&crossing, Vector2::new(f64::NAN, 5.0), edges, 6.0), None);
    }
}
