//! The exact place where two edges cross and dark and light change places: inner corners of chessboards.
//!
//! ```text
//! I = mean + slope·(p − c) + contrast S(d₁) S(d₂),   S(d) = 2 Φ(d/σ) − 1,   dᵢ = nᵢ·(p − x)
//! ```
//!
//! with the crossing x, the normals n₁ and n₂ of its edges, the blur σ and the light fitted to the pixels
//! around it by least squares. A photo of a crossing looks the same turned by half about it, whatever the blur
//! and the camera's gamma: there is nothing that could draw the estimate to one side.

use super::step::{Lanes, Products, step};
use crate::calibration::grey::Grey;
use nalgebra::{SMatrix, SVector, Vector2};

/// Crossing, two edge angles, blur, mean, slope across and down, contrast.
const PARAMETERS: usize = 9;
/// Windows of sharp photos: wider ones gain little and see the lens bend the edges.
const USUAL_REACH_PX: f64 = 7.5;
/// Windows of blurred photos reach over so many standard deviations of the blur.
const REACH_BLURS: f64 = 5.5;
const WIDEST_REACH_PX: f64 = 12.0;
/// Half a pixel's diagonal is unavoidable.
const OFF_CENTRE_PX: f64 = 1.0;

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
    let window = Window::new(image, start, reach.min(USUAL_REACH_PX))?;
    let mut saddle = settle(Fit::start(&window, start, edges)?, &window)?;
    let wanted = reach.min((REACH_BLURS * saddle.fit.blur).clamp(USUAL_REACH_PX, WIDEST_REACH_PX));
    // A window that is not symmetric about the crossing shows more of one field than of the opposite one.
    if saddle.fit.crossing.norm() > OFF_CENTRE_PX || wanted > window.reach + 0.5 {
        let better = Window::new(image, saddle.pixel, wanted)?;
        saddle = settle(saddle.fit.seen_from(better.centre - window.centre), &better)?;
    }
    ((saddle.pixel - start).norm() < 0.5 * window.reach + 0.5).then_some(saddle)
}

/// Levenberg–Marquardt from a start.
fn settle(start: Fit, window: &Window) -> Option<Saddle> {
    const STEPS: usize = 12;
    const TOLERANCE_PX: f64 = 1e-2;
    // Steps shrink tenfold and more from one to the next, less where the model does not fit exactly.
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
    let spread = (equations.cost / window.count as f64).sqrt();
    let sine = (fit.angles[1] - fit.angles[0]).sin().abs();
    let clean = spread < 0.5 * fit.contrast.abs() && sine > 0.25;
    (moved < LEFT_PX && clean).then_some(Saddle { pixel: window.centre + fit.crossing, fit })
}

/// The pixels that are looked at.
struct Window {
    /// A pixel's centre; everything else is relative to it.
    centre: Vector2<f64>,
    reach: f64,
    /// Right, down, brightness, and 1 or 0 for those that only fill up the last four.
    pixels: Vec<[Lanes; 4]>,
    count: usize,
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
                    pixels.push([right as f32, down as f32, image.at(c, r), 1.0]);
                }
            }
        }
        let count = pixels.len();
        let enough = count as f64 > 0.7 * std::f64::consts::PI * (reach - 0.5) * (reach - 0.5);
        let lanes =
            |four: &[[f32; 4]], i: usize| Lanes(std::array::from_fn(|k| four.get(k).map_or(0.0, |p| p[i])));
        let pixels = pixels.chunks(4).map(|four| std::array::from_fn(|i| lanes(four, i))).collect();
        let centre = Vector2::new(column as f64, row as f64);
        enough.then_some(Self { centre, reach, pixels, count })
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
        for [x, y, value, weight] in &window.pixels {
            for k in 0..4 {
                let p = Vector2::new(f64::from(x.0[k]), f64::from(y.0[k])) - fit.crossing;
                let field = usize::from(normals[0].dot(&p) * normals[1].dot(&p) > 0.0);
                sums[field] += f64::from(value.0[k]);
                counts[field] += f64::from(weight.0[k]);
            }
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
    matrix: SMatrix<f64, PARAMETERS, PARAMETERS>,
    right: SVector<f64, PARAMETERS>,
    /// Sum of squared residuals.
    cost: f64,
}

impl Equations {
    fn new(fit: &Fit, window: &Window) -> Self {
        let [n, m] = fit.normals();
        let (nx, ny, mx, my) = (Lanes::all(n.x), Lanes::all(n.y), Lanes::all(m.x), Lanes::all(m.y));
        let (x0, y0) = (Lanes::all(fit.crossing.x), Lanes::all(fit.crossing.y));
        let (per_blur, contrast) = (Lanes::all(1.0 / fit.blur), Lanes::all(fit.contrast));
        let (mean, right, down) = (Lanes::all(fit.mean), Lanes::all(fit.slope.x), Lanes::all(fit.slope.y));
        let height = Lanes::all(fit.contrast / fit.blur);
        let mut products = Products::<{ PARAMETERS + 1 }>::new();
        for &[x, y, value, weight] in &window.pixels {
            let (dx, dy) = (x - x0, y - y0);
            let (d, e) = (nx * dx + ny * dy, mx * dx + my * dy);
            let ((s, s_slope), (t, t_slope)) = (step(d * per_blur), step(e * per_blur));
            // d(brightness) / d(distance from either edge).
            let (by_d, by_e) = (height * s_slope * t * weight, height * t_slope * s * weight);
            let both = s * t * weight;
            let residual = (value - mean - right * x - down * y) * weight - contrast * both;
            products.add(&[
                -(by_d * nx) - by_e * mx,
                -(by_d * ny) - by_e * my,
                // Turning a normal moves it along its edge.
                by_d * (nx * dy - ny * dx),
                by_e * (mx * dy - my * dx),
                -((by_d * d + by_e * e) * per_blur),
                weight,
                x * weight,
                y * weight,
                both,
                residual,
            ]);
        }
        Self {
            matrix: SMatrix::from_fn(|i, j| products.sum(i, j)),
            right: SVector::from_fn(|i, _| products.sum(PARAMETERS, i)),
            cost: products.sum(PARAMETERS, PARAMETERS),
        }
    }

    fn step(&self, damping: f64) -> Option<SVector<f64, PARAMETERS>> {
        let mut matrix = self.matrix;
        for i in 0..PARAMETERS {
            matrix[(i, i)] *= 1.0 + damping;
        }
        matrix.cholesky().map(|cholesky| cholesky.solve(&self.right))
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
