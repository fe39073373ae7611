//! The outline of a disc to a fraction of a pixel.
//!
//! A disc under blur, uneven light and noise is
//!
//! ```text
//! I = light + slope · (x − x₀) − contrast · S(d/σ),   d = (1 − |A (x − c)|) / |∇|A (x − c)||
//! ```
//!
//! with S a step of unit height (the logistic one, within 0.01 of the Gaussian's) and d the distance inside the
//! ellipse |A (x − c)| = 1, to first order. Centre c, symmetric A, light, slope, contrast and blur σ are
//! estimated by least squares on the pixels around the outline. Neither the threshold nor the blur moves the
//! centre, and pixels that fit nothing (dirt, glare, an object in front) are left out.

use crate::calibration::grey::Grey;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// A smaller blur than this cannot be told from it.
const LEAST_BLUR_PX: f64 = 0.25;
/// Widest half band around the outline, px: three standard deviations of the strongest blur.
const WIDEST_BAND_PX: f64 = 6.75;
/// Centre 2, shape 3, light, slope 2, contrast, blur.
const UNKNOWNS: usize = 10;

/// An ellipse in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ellipse {
    /// Pixels.
    pub centre: Vector2<f64>,
    /// Symmetric; takes offsets from the centre, px, to a plane where the ellipse is the unit circle.
    pub rounding: Matrix2<f64>,
}

impl Ellipse {
    /// Area, px².
    pub fn area(&self) -> f64 {
        std::f64::consts::PI / self.rounding.determinant()
    }
}

#[derive(Debug, Clone, Copy)]
struct Model {
    ellipse: Ellipse,
    light: f64,
    /// Per mean radius.
    slope: Vector2<f64>,
    contrast: f64,
    blur: f64,
}

/// A pixel near the outline: where, and how bright.
#[derive(Clone, Copy)]
struct Sample {
    at: Vector2<f64>,
    value: f64,
}

/// Locates the outline of a disc.
///
/// - `start`: roughly where it is, pixels of `image`.
/// - `start_scale`: pixels of `image` per pixel in which it was found.
/// - `free`: distance to the nearest other thing, in radii from the outline.
///
/// `None` when there is no clean step from light to dark all around.
pub(super) fn outline(image: &Grey, start: Ellipse, start_scale: f64, free: f64) -> Option<Ellipse> {
    const ROUNDS: usize = 3;
    const ENOUGH_SAMPLES: usize = 120;
    let radius = (start.area() / std::f64::consts::PI).sqrt();
    let mut model =
        Model { ellipse: start, light: 0.0, slope: Vector2::zeros(), contrast: 0.0, blur: start_scale };
    let mut samples = Vec::new();
    for round in 0..ROUNDS {
        let reach =
            if round == 0 { 3.5 * start_scale } else { (3.0 * model.blur + 0.75).min(WIDEST_BAND_PX) };
        collect(image, &model.ellipse, reach, 0.5 * free, &mut samples);
        if round + 1 < ROUNDS {
            // A share of the pixels will do for finding the way.
            let every = 1 + samples.len() / ENOUGH_SAMPLES;
            samples = samples.into_iter().step_by(every).collect();
        }
        if samples.len() < 2 * UNKNOWNS {
            return None;
        }
        if round == 0 {
            let (dark, light) = sides(&model.ellipse, &samples)?;
            (model.light, model.contrast) = (light, light - dark);
        } else if !keep_fitting(&model, &mut samples, start.centre, radius) {
            return None;
        }
        // Only the last round needs all digits.
        let tolerance_px = if round + 1 < ROUNDS { 5e-2 } else { 4e-3 };
        model = fit(model, &samples, start.centre, radius, tolerance_px)?;
        let moved = (model.ellipse.centre - start.centre).norm();
        let grown = model.ellipse.area() / start.area();
        if moved > start_scale + 0.3 * radius || !(0.4..2.5).contains(&grown) {
            return None;
        }
    }
    let mean_square = samples.iter().map(|s| model.residual(s, start.centre, radius).powi(2)).sum::<f64>()
        / samples.len() as f64;
    let clean = mean_square.sqrt() < 0.25 * model.contrast && model.blur < radius + 1.0;
    clean.then_some(model.ellipse)
}

/// Pixels within `reach` px of the outline and `free` radii outside it.
fn collect(image: &Grey, ellipse: &Ellipse, reach: f64, free: f64, samples: &mut Vec<Sample>) {
    samples.clear();
    // Half the box around the ellipse: square roots of the diagonal of A⁻².
    let Some(axes) = ellipse.rounding.try_inverse() else {
        return;
    };
    let half = Vector2::new(axes.row(0).norm(), axes.row(1).norm()).add_scalar(reach + 1.0);
    let (last_column, last_row) = (image.width() as f64 - 1.0, image.height() as f64 - 1.0);
    let square = ellipse.rounding * ellipse.rounding;
    let (low, high) = (ellipse.centre - half, ellipse.centre + half);
    let mut row = low.y.max(0.0).ceil();
    while row <= high.y.min(last_row) {
        let mut column = low.x.max(0.0).ceil();
        while column <= high.x.min(last_column) {
            let at = Vector2::new(column, row);
            column += 1.0;
            let offset = at - ellipse.centre;
            let q = (ellipse.rounding * offset).norm();
            let distance = (1.0 - q) * q / (square * offset).norm().max(1e-9);
            if distance.abs() <= reach && q <= 1.0 + free {
                samples.push(Sample { at, value: f64::from(image.at(at.x as isize, at.y as isize)) });
            }
        }
        row += 1.0;
    }
}

/// Mean brightness inside and outside.
fn sides(ellipse: &Ellipse, samples: &[Sample]) -> Option<(f64, f64)> {
    let mut sums = [(0.0, 0.0); 2];
    for sample in samples {
        let outside = (ellipse.rounding * (sample.at - ellipse.centre)).norm() > 1.0;
        let side = &mut sums[usize::from(outside)];
        *side = (side.0 + sample.value, side.1 + 1.0);
    }
    let [dark, light] = sums.map(|(sum, count)| sum / count);
    (light > dark).then_some((dark, light))
}

/// Leaves out the pixels that the model does not explain; false when too few stay.
fn keep_fitting(model: &Model, samples: &mut Vec<Sample>, origin: Vector2<f64>, radius: f64) -> bool {
    let before = samples.len();
    let mut misses: Vec<f64> = samples.iter().map(|s| model.residual(s, origin, radius).abs()).collect();
    let middle = misses.len() / 2;
    let median = *misses.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Four standard deviations of Gaussian noise, and 3 % of the step for what the model leaves out.
    let most = 4.0 * 1.4826 * median + 0.03 * model.contrast;
    samples.retain(|s| model.residual(s, origin, radius).abs() <= most);
    4 * samples.len() >= 3 * before
}

impl Model {
    fn residual(&self, sample: &Sample, origin: Vector2<f64>, radius: f64) -> f64 {
        self.linearised(sample, origin, radius).0
    }
    /// Observed minus expected brightness, and the derivatives of what is expected.
    fn linearised(&self, sample: &Sample, origin: Vector2<f64>, radius: f64) -> (f64, [f64; UNKNOWNS]) {
        let z = sample.at - self.ellipse.centre;
        let y = self.ellipse.rounding * z;
        let q = y.norm().max(1e-9);
        let gradient = self.ellipse.rounding * y / q;
        let steepness = gradient.norm().max(1e-9);
        let distance = (1.0 - q) / steepness;
        let (inside, density) = step(distance / self.blur);
        let away = (sample.at - origin) / radius;
        let expected = self.light + self.slope.dot(&away) - self.contrast * inside;
        let by_distance = -self.contrast * density / self.blur;
        let by_shape = -by_distance / (q * steepness);
        let derivatives = [
            by_distance * gradient.x / steepness,
            by_distance * gradient.y / steepness,
            by_shape * y.x * z.x,
            by_shape * (y.x * z.y + y.y * z.x),
            by_shape * y.y * z.y,
            1.0,
            away.x,
            away.y,
            -inside,
            -by_distance * distance / self.blur,
        ];
        (sample.value - expected, derivatives)
    }
    fn moved(&self, by: &SVector<f64, UNKNOWNS>) -> Self {
        let shape = Matrix2::new(by[2], by[3], by[3], by[4]);
        Self {
            ellipse: Ellipse {
                centre: self.ellipse.centre + Vector2::new(by[0], by[1]),
                rounding: self.ellipse.rounding + shape,
            },
            light: self.light + by[5],
            slope: self.slope + Vector2::new(by[6], by[7]),
            contrast: self.contrast + by[8],
            blur: (self.blur + by[9]).max(LEAST_BLUR_PX),
        }
    }
    /// A dark ellipse.
    fn is_sound(&self) -> bool {
        let a = &self.ellipse.rounding;
        self.contrast > 0.0 && a.determinant() > 0.0 && a.trace() > 0.0
    }
}

/// Levenberg–Marquardt on all unknowns.
fn fit(
    start: Model,
    samples: &[Sample],
    origin: Vector2<f64>,
    radius: f64,
    tolerance_px: f64,
) -> Option<Model> {
    const STEPS: usize = 8;
    let equations = |model: &Model| {
        let mut lower = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut right = [0.0; UNKNOWNS];
        let mut cost = 0.0;
        for sample in samples {
            let (residual, row) = model.linearised(sample, origin, radius);
            for i in 0..UNKNOWNS {
                for j in 0..=i {
                    lower[i][j] += row[i] * row[j];
                }
                right[i] += row[i] * residual;
            }
            cost += residual * residual;
        }
        let matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::from_fn(|i, j| lower[i.max(j)][i.min(j)]);
        (matrix, SVector::<f64, UNKNOWNS>::from(right), cost)
    };
    let mut model = start;
    let (mut matrix, mut right, mut cost) = equations(&model);
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let mut damped = matrix;
        for k in 0..UNKNOWNS {
            damped[(k, k)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&right);
        let next = model.moved(&step);
        let there = if next.is_sound() { Some(equations(&next)) } else { None };
        match there {
            Some(better) if better.2 <= cost => {
                (matrix, right, cost) = better;
                model = next;
                damping *= 0.1;
                if step[0].hypot(step[1]) < tolerance_px && step[9].abs() < 10.0 * tolerance_px {
                    break;
                }
            }
            _ => damping = (10.0 * damping).max(1e-3),
        }
    }
    model.is_sound().then_some(model)
}

/// Logistic step and its slope, scaled to be closest to the normal distribution.
fn step(z: f64) -> (f64, f64) {
    const SCALE: f64 = 1.702;
    let value = 1.0 / (1.0 + (-SCALE * z).exp());
    (value, SCALE * value * (1.0 - value))
}
