//! Fits the clocks of one hypothesis to the pairs it makes likely, and makes the pairs anew, until both stay.

use super::model::{Edge, Hypothesis, Series, Sums, density, log_density_slopes};

/// Scales of the delays that are tried, seconds.
const SCALES: [f64; 8] = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2];
/// One sigma of the drift of a camera's clock, before the data speak.
const DRIFT_STD: f64 = 100e-6;

/// What is known of the clocks beforehand.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior {
    /// `at_pivot - pivot` lies between these two, give or take `std`; `None`: anywhere.
    pub offset: Option<(f64, f64, f64)>,
    /// Largest drift, as a ratio.
    pub drift_limit: f64,
}

impl Prior {
    /// Logarithm of the density of a hypothesis' clocks, and its derivative by `at_pivot`, and the second's negative.
    fn log_offset(&self, h: &Hypothesis) -> (f64, f64, f64) {
        let Some((low, high, std)) = self.offset else { return (0.0, 0.0, 0.0) };
        let offset = h.at_pivot - h.pivot;
        let off = if offset < low {
            offset - low
        } else if offset > high {
            offset - high
        } else {
            return (0.0, 0.0, 0.0);
        };
        (-0.5 * (off / std).powi(2), -off / (std * std), 1.0 / (std * std))
    }
}

/// A hypothesis that its own pairs confirm.
#[derive(Debug)]
pub(super) struct Mode {
    pub hypothesis: Hypothesis,
    /// Logarithm of its weight against other modes and against no match at all.
    pub log_weight: f64,
    /// Logarithm of its weight as it stands, for neighbours that differ in the offset alone.
    pub log_sum: f64,
    /// What the clocks known beforehand contribute to it.
    pub log_prior: f64,
    pub edges: Vec<Edge>,
    /// Covariance of `at_pivot` and drift, conservative: from the scatter of the residuals.
    pub covariance: [[f64; 2]; 2],
}

impl Mode {
    /// Expected number of pairs.
    pub fn pairs(&self) -> f64 {
        self.edges.iter().map(|e| e.probability).sum()
    }

    /// For each photo the trigger that is more likely than not.
    pub fn choices(&self, photos: usize) -> Vec<Option<usize>> {
        let mut choice = vec![None; photos];
        for e in self.edges.iter().filter(|e| e.probability > 0.5) {
            choice[e.photo] = Some(e.trigger);
        }
        choice
    }

    /// Mean logarithm of the residuals' density over the likely pairs.
    pub fn mean_log_density(&self, series: &Series) -> f64 {
        let scale = self.hypothesis.scale;
        let sum: f64 = self
            .edges
            .iter()
            .map(|e| {
                e.probability * density(e.residual, series.halves[e.photo], scale).max(f64::MIN_POSITIVE).ln()
            })
            .sum();
        sum / self.pairs().max(1e-9)
    }
}

/// Prior plus data.
pub(super) fn log_posterior(sums: &Sums, h: &Hypothesis, prior: &Prior) -> f64 {
    sums.log_sum + prior.log_offset(h).0 - 0.5 * (h.drift / DRIFT_STD).powi(2)
}

/// Refines a hypothesis; `None` when the photos' times are too coarse for so many triggers.
pub(super) fn refine(series: &Series, start: Hypothesis, prior: &Prior, log_range: f64) -> Option<Mode> {
    let mut h = start;
    for _ in 0..12 {
        let sums = Sums::new(series, &h)?;
        let edges = sums.edges(series, &h);
        let old = h;
        counts(series, &edges, &mut h);
        clocks(series, &edges, prior, &mut h);
        h.scale = best_scale(series, &edges, &h, old.scale);
        let moved = (h.at_pivot - old.at_pivot).abs() + (h.drift - old.drift).abs() * series.span;
        if h.scale == old.scale && moved < 0.05 * h.scale && (h.misfire - old.misfire).abs() < 1e-4 {
            break;
        }
    }
    let sums = Sums::new(series, &h)?;
    let edges = sums.edges(series, &h);
    let covariance = covariance(series, &edges, &h);
    let log_sum = log_posterior(&sums, &h, prior);
    let log_prior = prior.log_offset(&h).0;
    let width = covariance[0][0].sqrt().clamp(1e-6, 60.0);
    let log_weight = log_sum + width.ln() - log_range;
    Some(Mode { hypothesis: h, log_weight, log_sum, log_prior, edges, covariance })
}

/// How often a partner is missing, from the expected number of pairs; half a case and ten attempts beforehand, so that
/// a series without a gap is still allowed one.
fn counts(series: &Series, edges: &[Edge], h: &mut Hypothesis) {
    let pairs: f64 = edges.iter().map(|e| e.probability).sum();
    let (n, m) = (series.photos.len() as f64, series.triggers.len() as f64);
    h.misfire = (((m - pairs).max(0.0) + 0.5) / (m + 10.0)).min(0.98);
    h.extra_rate = ((n - pairs).max(0.0) + 0.5) / (series.span + 10.0 * series.interval);
}

/// Two steps of Newton's method on offset and drift; the likelihood is log-concave in them for given pairs.
fn clocks(series: &Series, edges: &[Edge], prior: &Prior, h: &mut Hypothesis) {
    for _ in 0..3 {
        let (_, slope, curvature) = prior.log_offset(h);
        let mut gradient = [slope, -h.drift / (DRIFT_STD * DRIFT_STD)];
        let mut hessian = [curvature, 0.0, 1.0 / (DRIFT_STD * DRIFT_STD)];
        let mut largest_half = 0.0_f64;
        for e in edges {
            let lever = series.photos[e.photo] - h.pivot;
            let half = series.halves[e.photo];
            let residual = series.triggers[e.trigger] - h.predict(series.photos[e.photo]);
            let (by_residual, weight) = log_density_slopes(residual, half, h.scale);
            // A flat top has no curvature: a thousandth of a Gaussian's of that width keeps the step finite.
            let weight = e.probability * (weight + 1e-3 / (half * half + h.scale * h.scale));
            let pull = -e.probability * by_residual;
            gradient[0] += pull;
            gradient[1] += pull * lever;
            hessian[0] += weight;
            hessian[1] += weight * lever;
            hessian[2] += weight * lever * lever;
            largest_half = largest_half.max(half);
        }
        let determinant = hessian[0] * hessian[2] - hessian[1] * hessian[1];
        if determinant.is_nan() || determinant <= 0.0 || edges.is_empty() {
            return;
        }
        let mut step = [
            (hessian[2] * gradient[0] - hessian[1] * gradient[1]) / determinant,
            (hessian[0] * gradient[1] - hessian[1] * gradient[0]) / determinant,
        ];
        // No end of the flight moves further than what the residuals can hold.
        let most = step[0].abs() + step[1].abs() * series.span;
        let allowed = largest_half + 2.0 * h.scale;
        if most > allowed {
            step = step.map(|s| s * allowed / most);
        }
        h.at_pivot += step[0];
        h.drift = (h.drift + step[1]).clamp(-prior.drift_limit, prior.drift_limit);
    }
}

/// The likeliest of the scales no more than one step below the last one.
fn best_scale(series: &Series, edges: &[Edge], h: &Hypothesis, last: f64) -> f64 {
    let floor = SCALES.iter().rev().find(|s| **s < 0.99 * last).copied().unwrap_or(SCALES[0]);
    let mut best = (f64::NEG_INFINITY, last);
    let ceiling = (series.interval / 6.0).max(floor);
    for scale in SCALES.into_iter().filter(|s| (floor..=ceiling).contains(s)) {
        // One case at 20 ms beforehand.
        let mut sum = -(scale / 0.02).ln().abs();
        for e in edges.iter().filter(|e| e.probability > 1e-3) {
            let residual = series.triggers[e.trigger] - h.predict(series.photos[e.photo]);
            let d = density(residual, series.halves[e.photo], scale).max(f64::MIN_POSITIVE);
            sum += e.probability * d.ln();
        }
        if sum > best.0 {
            best = (sum, scale);
        }
    }
    best.1
}

/// Covariance of offset and drift as least squares would give it: no smaller than the truth for rounded times.
fn covariance(series: &Series, edges: &[Edge], h: &Hypothesis) -> [[f64; 2]; 2] {
    let mut normal = [1e-9, 0.0, 1.0 / (DRIFT_STD * DRIFT_STD)];
    for e in edges {
        let half = series.halves[e.photo];
        let lever = series.photos[e.photo] - h.pivot;
        // Variance of a uniform and of a logistic distribution.
        let variance = half * half / 3.0 + h.scale * h.scale * std::f64::consts::PI.powi(2) / 3.0;
        let weight = e.probability / variance;
        normal[0] += weight;
        normal[1] += weight * lever;
        normal[2] += weight * lever * lever;
    }
    let determinant = normal[0] * normal[2] - normal[1] * normal[1];
    [[normal[2] / determinant, -normal[1] / determinant], [-normal[1] / determinant, normal[0] / determinant]]
}
