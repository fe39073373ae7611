//! Points and views that do not fit: named always, weighed down only when asked for.

use super::adjust::Sight;
use super::product::View;

/// A point much farther off than the noise of the others explains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// Its view, counted from 0 in the order given.
    pub view: usize,
    /// Its place among the view's points, counted from 0.
    pub point: usize,
    /// Distance between observed and predicted, px.
    pub distance_px: f64,
    /// That distance over the noise of one coordinate.
    pub sigmas: f64,
}

/// A view that fits much worse than the others.
#[derive(Debug, Clone, PartialEq)]
pub struct SuspectView {
    /// Its place, counted from 0 in the order given.
    pub view: usize,
    /// Name of the photo.
    pub name: String,
    /// Root mean square distance between its observed and predicted points, px.
    pub rms_px: f64,
    /// Median of the same over the other views, px.
    pub others_px: f64,
}

/// Noise of one coordinate by the median distance: the median of a Rayleigh distribution is √(2 ln 2) σ.
pub(super) fn robust_sigma(distances: impl Iterator<Item = f64>) -> f64 {
    median(distances.collect()) / (2.0 * std::f64::consts::LN_2).sqrt()
}

/// Distance, in noises of one coordinate, that no point of a clean set of this size exceeds but for once in a
/// hundred sets.
///
/// A distance beyond t σ happens with the probability exp(−t²/2).
pub(super) fn cutoff(points: usize) -> f64 {
    const SETS: f64 = 100.0;
    (2.0 * (SETS * points.max(1) as f64).ln()).sqrt()
}

/// Weight of a point `times` the cutoff away: whole within it, none beyond twice it.
///
/// # Source
/// The redescending end of Hampel's three-part function (Hampel et al. 1986, "Robust Statistics", section
/// 2.6): a clean set keeps all its weights at exactly 1, so that its result is that of least squares.
pub(super) fn weight(times: f64) -> f64 {
    (2.0 - times).clamp(0.0, 1.0)
}

/// Sets the weights of all points by their distances; returns the largest change.
pub(super) fn reweigh(views: &mut [Vec<Sight>], distances: &[Vec<f64>]) -> f64 {
    let sigma = robust_sigma(distances.iter().flatten().copied());
    let limit = sigma * cutoff(distances.iter().map(Vec::len).sum());
    let mut change = 0.0_f64;
    for (sight, distance) in views.iter_mut().flatten().zip(distances.iter().flatten()) {
        let weight = if limit > 0.0 { weight(distance / limit) } else { 1.0 };
        change = change.max((weight - sight.weight).abs());
        sight.weight = weight;
    }
    change
}

/// The outliers among adjusted views, the farthest first.
pub(super) fn outliers(views: &[View], sigma_px: f64) -> Vec<Outlier> {
    let limit = sigma_px * cutoff(views.iter().map(|view| view.points.len()).sum());
    let mut found: Vec<Outlier> = views
        .iter()
        .enumerate()
        .flat_map(|(view, v)| {
            v.points.iter().enumerate().map(move |(point, p)| (view, point, p.distance_px()))
        })
        // Rounding alone is no noise to measure outliers by.
        .filter(|&(.., distance_px)| distance_px > limit && distance_px > 1e-6)
        .map(|(view, point, distance_px)| Outlier {
            view,
            point,
            distance_px,
            sigmas: distance_px / sigma_px,
        })
        .collect();
    found.sort_by(|a, b| b.distance_px.total_cmp(&a.distance_px));
    found
}

/// The views that fit three times worse than the median of the others, the worst first.
pub(super) fn suspects(views: &[View]) -> Vec<SuspectView> {
    /// Views of one camera differ twofold by sharpness and distance alone.
    const TIMES: f64 = 3.0;
    let mut found: Vec<SuspectView> = views
        .iter()
        .enumerate()
        .filter_map(|(index, view)| {
            let others = views.iter().enumerate().filter(|(other, _)| *other != index);
            let others_px = median(others.map(|(_, v)| v.rms_px).collect());
            (view.rms_px > TIMES * others_px && view.rms_px > 1e-6).then(|| SuspectView {
                view: index,
                name: view.name.clone(),
                rms_px: view.rms_px,
                others_px,
            })
        })
        .collect();
    found.sort_by(|a, b| b.rms_px.total_cmp(&a.rms_px));
    found
}

/// Median; NaN of nothing.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 {
        return f64::NAN;
    }
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_fall_from_the_cutoff_to_twice_it() {
        assert_eq!([0.5, 1.0, 1.5, 2.0, 9.0].map(weight), [1.0, 1.0, 0.5, 0.0, 0.0]);
        // 576 points: exp(−t²/2) · 576 = 1/100.
        let t = cutoff(576);
        assert!((576.0 * (-0.5 * t * t).exp() - 0.01).abs() < 1e-12, "{t}");
    }

    #[test]
    fn the_median_knows_the_noise_of_the_bulk() {
        // Distances of a Rayleigh distribution by its quantiles, and a tenth of nonsense.
        let rayleigh = (0..900).map(|k| 0.3 * (-2.0 * (1.0 - (f64::from(k) + 0.5) / 900.0).ln()).sqrt());
        let sigma = robust_sigma(rayleigh.clone().chain((0..100).map(|_| 50.0)));
        assert!((sigma / 0.3 - 1.0).abs() < 0.1, "{sigma}");
        assert!((robust_sigma(rayleigh) / 0.3 - 1.0).abs() < 1e-3);
    }
}
