//! First guesses of the clocks' offset: every photo–trigger difference votes, for each of a row of drifts.

use super::fit::Prior;
use super::model::Series;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Bins of a histogram at most.
const MOST_BINS: f64 = 4_194_304.0;
/// Votes cast at most.
const MOST_VOTES: f64 = 4e7;
/// Photos that vote at least, when there are that many.
const LEAST_VOTERS: usize = 64;
/// Guesses kept of each drift's histogram, and in all.
const KEPT: usize = 48;

/// A guess: the photo time of the triggers' middle, and the drift.
#[derive(Debug, Clone, Copy)]
pub(super) struct Guess {
    pub pivot: f64,
    pub drift: f64,
}

/// The guesses with the most votes, best first, and the width within which each may be off, seconds.
pub(super) fn guesses(series: &Series, prior: &Prior) -> (Vec<Guess>, f64) {
    let (photos, triggers) = (&series.photos, &series.triggers);
    let (m, duration) = (triggers.len() as f64, triggers[triggers.len() - 1] - triggers[0]);
    let (low, high) = offsets(series, prior);
    let widest = series.halves.iter().copied().fold(0.0, f64::max);
    let mut width = (2.0 * widest).max(0.1);
    let drifts = |width: f64| (2.0 * prior.drift_limit * duration / width).ceil() + 1.0;
    while (high - low) / (width / 2.0) > MOST_BINS
        || m * drifts(width) * LEAST_VOTERS.min(photos.len()) as f64 > MOST_VOTES
    {
        width *= 2.0;
    }
    let bin = width / 2.0;
    let steps = drifts(width) as usize;
    let voters =
        ((MOST_VOTES / (m * steps as f64)) as usize).clamp(LEAST_VOTERS.min(photos.len()), photos.len());
    let mut histogram = vec![0_u32; ((high - low) / bin) as usize + 3];
    let last_bin = histogram.len() - 1;
    // All drifts together.
    let mut all: Vec<(u32, Guess)> = Vec::new();
    for step in 0..steps {
        let drift =
            if steps == 1 { 0.0 } else { prior.drift_limit * (2.0 * step as f64 / (steps - 1) as f64 - 1.0) };
        histogram.fill(0);
        for k in 0..voters {
            let photo = photos[k * photos.len() / voters] * (1.0 + drift);
            let from = triggers.partition_point(|s| *s < photo + low);
            for s in triggers[from..].iter().take_while(|s| **s - photo < high) {
                let place = ((s - photo - low) / bin) as usize + 1;
                histogram[place.min(last_bin)] += 1;
            }
        }
        for (votes, place) in most_voted(&histogram) {
            let offset = low + (place as f64 - 0.5) * bin;
            // trigger = photo (1 + drift) + offset, and the triggers' middle is 0.
            all.push((votes, Guess { pivot: -offset / (1.0 + drift), drift }));
        }
    }
    all.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.drift.abs().total_cmp(&b.1.drift.abs())));
    let mut kept: Vec<Guess> = Vec::new();
    for (_, guess) in all {
        if kept.len() < KEPT && kept.iter().all(|k| (k.pivot - guess.pivot).abs() > 0.75 * width) {
            kept.push(guess);
        }
    }
    (kept, width)
}

/// Range of offsets to search.
fn offsets(series: &Series, prior: &Prior) -> (f64, f64) {
    let (photos, triggers) = (&series.photos, &series.triggers);
    let margin = 1.0 + prior.drift_limit * series.span;
    let all =
        (triggers[0] - photos[photos.len() - 1] - margin, triggers[triggers.len() - 1] - photos[0] + margin);
    match prior.offset {
        None => all,
        Some((low, high, std)) => {
            let slack = 8.0 * std + series.halves.iter().copied().fold(0.0, f64::max) + margin;
            let low = all.0.max(low - slack);
            (low, all.1.min(high + slack).max(low))
        }
    }
}

/// The places with the most votes in three neighbouring bins.
fn most_voted(histogram: &[u32]) -> Vec<(u32, usize)> {
    let mut heap = BinaryHeap::with_capacity(KEPT + 1);
    for (k, three) in histogram.windows(3).enumerate() {
        let votes = three[0] + three[1] + three[2];
        let least = heap.peek().map_or(0, |Reverse((v, _))| *v);
        if votes == 0 || (heap.len() == KEPT && votes <= least) {
            continue;
        }
        heap.push(Reverse((votes, k + 1)));
        if heap.len() > KEPT {
            heap.pop();
        }
    }
    heap.into_iter().map(|Reverse(x)| x).collect()
}
