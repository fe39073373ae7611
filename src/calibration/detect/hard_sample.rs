//! How often targets are found in photos under hard conditions, for tests.

use crate::calibration::rendered::{HardView, hard_view};
use crate::calibration::target::{BoardPoint, Target};
use rayon::prelude::*;

/// A point found farther from its truth than this, px, has the wrong label.
const WRONG_PX: f64 = 2.0;

/// What came of many views.
#[derive(Debug, Default, Clone)]
pub(super) struct Sample {
    pub views: usize,
    pub found: usize,
    /// Seeds of views with a wrongly labelled point.
    pub wrong: Vec<u64>,
    /// Seeds of views without the target, and what was said.
    pub refused: Vec<(u64, String)>,
    points: usize,
    square_px: f64,
}

impl Sample {
    /// Root mean square distance from the truth, px, over what was found.
    pub fn rms_px(&self) -> f64 {
        (self.square_px / self.points.max(1) as f64).sqrt()
    }
    fn joined(mut self, other: Self) -> Self {
        self.views += other.views;
        self.found += other.found;
        self.wrong.extend(other.wrong);
        self.refused.extend(other.refused);
        self.points += other.points;
        self.square_px += other.square_px;
        self
    }
}

/// Looks for a target in the hard views of many seeds.
///
/// - `usable`: views for which it does not hold are left out.
/// - `alike`: the places of a point when the board is turned so that it looks the same; itself first.
pub(super) fn hard_sample(
    target: &Target,
    seeds: std::ops::Range<u64>,
    usable: impl Fn(&HardView) -> bool + Sync,
    alike: impl Fn(BoardPoint) -> Vec<BoardPoint> + Sync,
) -> Sample {
    let look = |seed: u64| {
        let view = hard_view(target, seed);
        if !usable(&view) {
            return Sample::default();
        }
        let detection = match crate::calibration::detect(&view.photo(target), target) {
            Ok(detection) => detection,
            Err(error) => {
                return Sample { views: 1, refused: vec![(seed, error.to_string())], ..Sample::default() };
            }
        };
        let misses = |turn: usize| -> Vec<f64> {
            detection.corners.iter().map(|c| view.miss(alike(c.board)[turn], c.sharp)).collect()
        };
        let worst = |misses: &[f64]| misses.iter().copied().fold(0.0, f64::max);
        let turns = alike(detection.corners[0].board).len();
        let best = (0..turns).map(misses).min_by(|a, b| worst(a).total_cmp(&worst(b))).unwrap();
        Sample {
            views: 1,
            found: 1,
            wrong: if worst(&best) > WRONG_PX { vec![seed] } else { Vec::new() },
            refused: Vec::new(),
            points: best.len(),
            square_px: best.iter().map(|miss| miss * miss).sum(),
        }
    };
    // Joined in the order of the seeds, so that sums come out alike on any machine.
    let samples: Vec<Sample> = seeds.into_par_iter().map(look).collect();
    samples.into_iter().fold(Sample::default(), Sample::joined)
}
