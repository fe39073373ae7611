//! How likely the times of a pair, a misfire and an extra photo are, and the sum over all alignments in order.

/// Photo and trigger times about their own middles, seconds, and what the probabilities are scaled by.
#[derive(Debug)]
pub(super) struct Series {
    /// Middle of the interval that each photo's recorded time stands for, increasing.
    pub photos: Vec<f64>,
    /// Half the resolution of each photo's time.
    pub halves: Vec<f64>,
    /// Trigger times, increasing.
    pub triggers: Vec<f64>,
    /// Median time between triggers.
    pub interval: f64,
    /// The longer of the two series' durations.
    pub span: f64,
}

/// One hypothesis: the clocks, the spread of the residuals, and how often each side lacks its partner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hypothesis {
    /// Photo time that the line turns about.
    pub pivot: f64,
    /// Trigger time of the pivot.
    pub at_pivot: f64,
    /// Drift: log seconds per camera second, less one.
    pub drift: f64,
    /// Scale of the logistic distribution of shutter and logging delays, seconds.
    pub scale: f64,
    /// Probability that a trigger gave no photo.
    pub misfire: f64,
    /// Extra photos (or photos whose event is missing) a second.
    pub extra_rate: f64,
}

impl Hypothesis {
    /// Log time of a photo.
    pub fn predict(&self, photo: f64) -> f64 {
        (photo - self.pivot) * (1.0 + self.drift) + self.at_pivot
    }

    /// What one pair weighs against a misfire plus an extra photo, per density of its residual.
    fn pair_factor(&self) -> f64 {
        (1.0 - self.misfire) / (self.misfire * self.extra_rate)
    }

    /// Beyond this residual a pair weighs nothing.
    fn reach(&self, half: f64) -> f64 {
        half + 25.0 * self.scale
    }

    /// Logarithm of what every alignment shares: all triggers misfired, all photos extra.
    fn log_common(&self, series: &Series) -> f64 {
        series.triggers.len() as f64 * self.misfire.ln() + series.photos.len() as f64 * self.extra_rate.ln()
            - self.extra_rate * series.span
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Density of a residual: the rounding of the photo's time (uniform) with a logistic delay on top. Its tails fall
/// exponentially, not as a Gaussian's: one late shutter does not overturn a match.
pub(super) fn density(residual: f64, half: f64, scale: f64) -> f64 {
    let half = half.max(1e-3 * scale);
    // Even function: the side on which the difference keeps its digits.
    let x = -residual.abs();
    (logistic((x + half) / scale) - logistic((x - half) / scale)) / (2.0 * half)
}

/// First derivative of the density's logarithm by the residual, and the second's negative.
pub(super) fn log_density_slopes(residual: f64, half: f64, scale: f64) -> (f64, f64) {
    let (p, q) = (logistic((residual + half) / scale), logistic((residual - half) / scale));
    ((1.0 - p - q) / scale, (p * (1.0 - p) + q * (1.0 - q)) / (scale * scale))
}

/// A possible pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    pub photo: usize,
    pub trigger: usize,
    pub residual: f64,
    /// Probability under the hypothesis.
    pub probability: f64,
}

/// The triggers within reach of each photo, as ranges that never step back.
struct Band {
    low: Vec<usize>,
    high: Vec<usize>,
    /// Where each photo's row of partial sums starts.
    start: Vec<usize>,
    size: usize,
}

impl Band {
    /// `None` when the ranges hold more than a bounded number of pairs.
    fn new(series: &Series, h: &Hypothesis) -> Option<Self> {
        let n = series.photos.len();
        let (mut low, mut high) = (vec![0; n], vec![0; n]);
        let mut so_far = 0;
        for i in 0..n {
            let (at, reach) = (h.predict(series.photos[i]), h.reach(series.halves[i]));
            low[i] = series.triggers.partition_point(|s| *s < at - reach);
            so_far = so_far.max(series.triggers.partition_point(|s| *s <= at + reach));
            high[i] = so_far.max(low[i]);
        }
        // Rows with different resolutions reach differently far back.
        for i in (1..n).rev() {
            low[i - 1] = low[i - 1].min(low[i]);
        }
        let mut start = vec![0; n];
        let mut size = 0;
        for i in 0..n {
            start[i] = size;
            size += high[i] - low[i] + 1;
        }
        (size <= 64 * (n + series.triggers.len())).then_some(Self { low, high, start, size })
    }
}

/// Weights of all pairs in the band, row by row, and the partial sums of the alignments up to each photo.
pub(super) struct Sums {
    band: Band,
    /// Pair weights; row `i` holds `high - low` of them.
    weights: Vec<f64>,
    /// `before[i][k]`: alignments of the photos before and with `i`, of triggers before `low + k`; scaled per row.
    forward: Vec<f64>,
    /// Logarithm of the sum over all alignments.
    pub log_sum: f64,
}

impl Sums {
    /// Sums over all alignments that keep the order; `None` when too many triggers are within reach of each photo.
    pub fn new(series: &Series, h: &Hypothesis) -> Option<Self> {
        let band = Band::new(series, h)?;
        let factor = h.pair_factor();
        let n = series.photos.len();
        let mut weights = vec![0.0; band.size];
        let mut forward = vec![0.0; band.size];
        let mut log_scale = 0.0;
        for i in 0..n {
            let (row, width) = (band.start[i], band.high[i] - band.low[i]);
            let at = h.predict(series.photos[i]);
            let mut matched = 0.0;
            let mut largest = 0.0_f64;
            for k in 0..=width {
                let j = band.low[i] + k;
                let before = previous(&band, &forward, i, j);
                let sum = before + matched;
                forward[row + k] = sum;
                largest = largest.max(sum);
                if k < width {
                    let w = factor * density(series.triggers[j] - at, series.halves[i], h.scale);
                    weights[row + k] = w;
                    matched += w * before;
                }
            }
            for value in &mut forward[row..=row + width] {
                *value /= largest;
            }
            log_scale += largest.ln();
        }
        let last = forward.last().copied().unwrap_or(1.0);
        let log_sum = log_scale + last.ln() + h.log_common(series);
        Some(Self { band, weights, forward, log_sum })
    }

    /// The pairs with their probabilities, those below a millionth left out; by photo, then by trigger.
    pub fn edges(&self, series: &Series, h: &Hypothesis) -> Vec<Edge> {
        let band = &self.band;
        let n = series.photos.len();
        let mut edges = Vec::new();
        // after[k]: alignments of the photos after `i` with triggers from `low_of_next + k` on.
        let mut after: Vec<f64> = vec![1.0];
        let mut after_low = series.triggers.len();
        for i in (0..n).rev() {
            let (row, low, width) = (band.start[i], band.low[i], band.high[i] - band.low[i]);
            let look = |j: usize| after[j.saturating_sub(after_low).min(after.len() - 1)];
            // Sum of everything that passes row i: the normaliser without any stored scale.
            let mut total = 0.0;
            let first = edges.len();
            let mut here = vec![0.0; width + 1];
            let mut matched = 0.0;
            for k in (0..=width).rev() {
                let j = low + k;
                if k < width {
                    let w = self.weights[row + k];
                    let onward = w * look(j + 1);
                    let through = previous(band, &self.forward, i, j) * onward;
                    total += through;
                    matched += onward;
                    edges.push(Edge {
                        photo: i,
                        trigger: j,
                        residual: series.triggers[j] - h.predict(series.photos[i]),
                        probability: through,
                    });
                }
                here[k] = look(j) + matched;
            }
            total += self.unmatched(i, &look);
            for edge in &mut edges[first..] {
                edge.probability /= total;
            }
            let kept: Vec<Edge> = edges.drain(first..).filter(|e| e.probability > 1e-6).collect();
            edges.extend(kept);
            let largest = here.iter().copied().fold(0.0, f64::max);
            after = here.into_iter().map(|v| v / largest).collect();
            after_low = low;
        }
        edges.reverse();
        edges
    }

    /// Weight of all alignments in which photo `i` has no trigger: the photos before it use triggers up to some last
    /// one, the photos after it only later ones.
    fn unmatched(&self, i: usize, look: &impl Fn(usize) -> f64) -> f64 {
        let band = &self.band;
        if i == 0 {
            return look(0);
        }
        // Alignments of the photos before whose last used trigger is exactly j - 1: differences of the prefix sums.
        let (row, low, width) = (band.start[i - 1], band.low[i - 1], band.high[i - 1] - band.low[i - 1]);
        let mut sum = 0.0;
        let mut previous = 0.0;
        for k in 0..=width {
            let value = self.forward[row + k];
            sum += (value - previous) * look(low + k);
            previous = value;
        }
        sum
    }
}

/// Alignments of the photos before `i` with triggers before `j`.
fn previous(band: &Band, forward: &[f64], i: usize, j: usize) -> f64 {
    if i == 0 {
        return 1.0;
    }
    let width = band.high[i - 1] - band.low[i - 1];
    forward[band.start[i - 1] + j.saturating_sub(band.low[i - 1]).min(width)]
}
