//! Several lens models on the same photos: which one to take, and why.
//!
//! A model with more terms always fits closer; whether it also tells more is seen on photos that it was not
//! fitted to. Each photo is held out once. Its pose is not known, so the pose is found from every other point
//! of it and the model is judged on the points between: judged on the same points, the pose would hide the
//! lens's error. The simplest model that is not worse than the best by more than chance is taken.
//!
//! # Source
//! Cross-validation with a preference for the simpler model as in Hastie, Tibshirani and Friedman (2009), "The
//! Elements of Statistical Learning", section 7.10; here a model is worse when it is so by two standard errors
//! of the differences photo by photo, which all models share the noise of. They are differences of logarithms,
//! so that a few photos in which a model fails badly do not hide that it fails. Three photos cannot spare one: they are judged by Akaike's criterion, corrected for few observations
//! (Hurvich and Tsai 1989).

use super::adjust::Sight;
use super::error::CalibrationError;
use super::model::LensModel;
use super::product::{Calibration, ViewPoints};
use super::solve::{Options, OutlierPolicy, Solved, calibrate_with, placed_distances, solve};
use super::start::Start;
use super::zhang::{BoardPose, ClosedForm};
use nalgebra::Rotation3;
use rayon::prelude::*;

/// Photos from which on each can be held out.
const CROSS_VALIDATED: usize = 4;

/// Points that a photo needs to be judged: half of them place it.
const LEAST_POINTS: usize = 12;

/// The most parts that the photos are dealt into.
const MOST_FOLDS: usize = 10;

/// How the candidates were judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judgement {
    /// On photos held out, dealt into this many parts.
    CrossValidation {
        /// Parts.
        folds: usize,
    },
    /// By Akaike's corrected criterion: there are too few photos to hold one out.
    Information,
}

/// One model on the photos.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The model.
    pub model: LensModel,
    /// The calibration with all photos, or why there is none.
    pub calibration: Result<Box<Calibration>, CalibrationError>,
    /// Distance on points it was not fitted to, px: geometric mean of the photos' root mean squares; `None` when
    /// it was not judged so.
    pub held_out_px: Option<f64>,
    /// Score to be compared: mean over the photos of the logarithm of their mean square distance, or Akaike's
    /// criterion; less is better. `None` when it failed.
    pub score: Option<f64>,
    /// Score above that of the best, and how much of that may be chance: two standard errors, or two units of
    /// the criterion.
    pub excess: Option<(f64, f64)>,
    /// Why the model could not be judged although it has a calibration.
    pub failed: Option<CalibrationError>,
}

/// Candidates in the order given, and the choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The models.
    pub candidates: Vec<Candidate>,
    /// How they were judged.
    pub judgement: Judgement,
    /// Place of the chosen one.
    pub chosen: usize,
    /// The choice in a sentence or two, with its numbers.
    pub why: String,
}

impl Comparison {
    /// The chosen model's calibration.
    #[must_use]
    pub fn calibration(&self) -> Option<&Calibration> {
        self.candidates.get(self.chosen)?.calibration.as_deref().ok()
    }
}

/// Calibrates with every candidate and chooses one.
///
/// # Errors
/// The first candidate's error when none has a calibration.
pub fn compare(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    models: &[LensModel],
    outliers: OutlierPolicy,
) -> Result<Comparison, CalibrationError> {
    let fitted: Vec<(LensModel, Result<Box<Calibration>, CalibrationError>)> = models
        .par_iter()
        .map(|&model| {
            (model, calibrate_with(views, width, height, Options { model, outliers }).map(Box::new))
        })
        .collect();
    let kept = kept_points(&fitted, views);
    let folds = views.len().min(MOST_FOLDS);
    let judged_by = kept.iter().filter(|kept| kept.iter().filter(|k| **k).count() >= LEAST_POINTS).count();
    let judgement = if judged_by >= CROSS_VALIDATED {
        Judgement::CrossValidation { folds }
    } else {
        Judgement::Information
    };
    let set = Set { views, width, height, kept: &kept, folds };
    let judged: Vec<(Candidate, Vec<f64>)> = fitted
        .into_par_iter()
        .map(|(model, calibration)| match judgement {
            Judgement::CrossValidation { .. } => set.cross_validated(model, calibration),
            Judgement::Information => informed(model, calibration),
        })
        .collect();
    let Some(best) = (0..judged.len())
        .filter(|&k| judged[k].0.score.is_some())
        .min_by(|&a, &b| score(&judged[a].0).total_cmp(&score(&judged[b].0)))
    else {
        let error = judged.into_iter().find_map(|(c, _)| c.calibration.err().or(c.failed));
        return Err(error.unwrap_or(CalibrationError::NothingToCompare));
    };
    Ok(choose(judged, judgement, best))
}

fn score(candidate: &Candidate) -> f64 {
    candidate.score.unwrap_or(f64::INFINITY)
}

/// Which points have any weight under the model that fits closest: all, unless outliers are weighed down.
fn kept_points(
    fitted: &[(LensModel, Result<Box<Calibration>, CalibrationError>)],
    views: &[ViewPoints],
) -> Vec<Vec<bool>> {
    let closest = fitted
        .iter()
        .filter_map(|(_, calibration)| calibration.as_deref().ok())
        .min_by(|a, b| a.robust_sigma_px.total_cmp(&b.robust_sigma_px));
    match closest {
        Some(calibration) => {
            calibration.views.iter().map(|v| v.points.iter().map(|p| p.weight > 0.5).collect()).collect()
        }
        None => views.iter().map(|view| vec![true; view.observations.len()]).collect(),
    }
}

/// What the candidates are judged on.
struct Set<'a> {
    views: &'a [ViewPoints],
    width: u32,
    height: u32,
    kept: &'a [Vec<bool>],
    folds: usize,
}

impl Set<'_> {
    /// A candidate, and the logarithm of each photo's mean square distance when it was held out.
    fn cross_validated(
        &self,
        model: LensModel,
        calibration: Result<Box<Calibration>, CalibrationError>,
    ) -> (Candidate, Vec<f64>) {
        let judged = calibration.as_ref().map_err(Clone::clone).and_then(|whole| {
            let folds: Vec<Vec<(usize, f64)>> = (0..self.folds)
                .into_par_iter()
                .map(|fold| self.hold_out(whole, fold))
                .collect::<Result<_, _>>()?;
            let mut photos: Vec<(usize, f64)> = folds.into_iter().flatten().collect();
            photos.sort_by_key(|(view, _)| *view);
            Ok(photos.into_iter().map(|(_, score)| score).collect::<Vec<f64>>())
        });
        let failed = judged.as_ref().err().filter(|_| calibration.is_ok()).cloned();
        let by_photo = judged.unwrap_or_default();
        let mean = by_photo.iter().sum::<f64>() / by_photo.len() as f64;
        let score = mean.is_finite().then_some(mean);
        let held_out_px = score.map(|mean| (0.5 * mean).exp());
        (Candidate { model, calibration, held_out_px, score, excess: None, failed }, by_photo)
    }

    /// Fits to the photos outside a fold; the places of the photos in it, with their scores.
    fn hold_out(&self, whole: &Calibration, fold: usize) -> Result<Vec<(usize, f64)>, CalibrationError> {
        let is_held = |view: &usize| view % self.folds == fold;
        let (held, kept): (Vec<usize>, Vec<usize>) = (0..self.views.len()).partition(is_held);
        let training: Vec<ViewPoints> = kept.iter().map(|&view| self.trimmed(view)).collect();
        let start = Start {
            form: ClosedForm::Ladder,
            interior: whole.camera.lens.interior(),
            poses: kept.iter().map(|&view| pose_of(whole, view)).collect(),
        };
        let options = Options { model: whole.model, outliers: OutlierPolicy::Keep };
        let solved = solve(&training, self.width, self.height, options, vec![start])?;
        held.into_iter()
            .filter_map(|view| self.judge(&solved, whole, view).map(|score| Ok((view, score?))))
            .collect()
    }

    /// A photo without the points that are no part of the judgement.
    fn trimmed(&self, view: usize) -> ViewPoints {
        let observations = self.views[view]
            .observations
            .iter()
            .zip(&self.kept[view])
            .filter_map(|(o, kept)| kept.then_some(*o))
            .collect();
        ViewPoints { name: self.views[view].name.clone(), observations }
    }

    /// Logarithm of a photo's mean square distance: placed by every other point of it and measured at the
    /// points between, then the other way round. `None` for a photo with too few points for that.
    fn judge(
        &self,
        solved: &Solved,
        whole: &Calibration,
        view: usize,
    ) -> Option<Result<f64, CalibrationError>> {
        /// Of points without noise: rounding is nothing to choose by.
        const EXACT_PX2: f64 = 1e-16;
        let sights: Vec<Sight> = self.trimmed(view).observations.iter().map(Sight::of).collect();
        if sights.len() < LEAST_POINTS {
            return None;
        }
        let every_other = |parity: usize| -> Vec<Sight> {
            sights.iter().enumerate().filter(|(k, _)| k % 2 == parity).map(|(_, sight)| *sight).collect()
        };
        let parts = [every_other(0), every_other(1)];
        let mut sum = 0.0;
        for (fitted, judged) in [(&parts[0], &parts[1]), (&parts[1], &parts[0])] {
            match placed_distances(solved, &whole.model, pose_of(whole, view), fitted, judged) {
                Ok(distances) => sum += distances.iter().map(|d| d * d).sum::<f64>(),
                Err(error) => return Some(Err(error)),
            }
        }
        Some(Ok((sum / sights.len() as f64).max(EXACT_PX2).ln()))
    }
}

fn pose_of(calibration: &Calibration, view: usize) -> BoardPose {
    let pose = &calibration.views[view].camera_from_board;
    BoardPose {
        rotation: Rotation3::from_matrix_unchecked(pose.rotation.matrix()),
        translation: pose.origin.vector(),
    }
}

/// A candidate by Akaike's corrected criterion: n ln(J/n) + 2k + 2k(k+1)/(n−k−1), n coordinates.
fn informed(
    model: LensModel,
    calibration: Result<Box<Calibration>, CalibrationError>,
) -> (Candidate, Vec<f64>) {
    let score = calibration.as_ref().ok().map(|c| {
        let n = 2.0 * c.points() as f64;
        let k = (model.parameters() + 6 * c.views.len() + 1) as f64;
        n * (c.j_total / n).ln() + 2.0 * k + 2.0 * k * (k + 1.0) / (n - k - 1.0).max(1.0)
    });
    (Candidate { model, calibration, held_out_px: None, score, excess: None, failed: None }, Vec::new())
}

/// The simplest candidate that is not worse than the best by more than chance.
fn choose(judged: Vec<(Candidate, Vec<f64>)>, judgement: Judgement, best: usize) -> Comparison {
    let best_score = score(&judged[best].0);
    let by_photo = judged[best].1.clone();
    let mut candidates = Vec::with_capacity(judged.len());
    for (mut candidate, own) in judged {
        candidate.excess = candidate.score.map(|score| match judgement {
            Judgement::CrossValidation { .. } => (score - best_score, 2.0 * standard_error(&own, &by_photo)),
            // Two units of the criterion are its own rule of thumb for no difference.
            Judgement::Information => (score - best_score, 2.0),
        });
        candidates.push(candidate);
    }
    let good_enough = |c: &Candidate| c.excess.is_some_and(|(excess, chance)| excess <= chance);
    let chosen = (0..candidates.len())
        .filter(|&k| k == best || good_enough(&candidates[k]))
        .min_by_key(|&k| (candidates[k].model.parameters(), candidates[k].model.kind, k != best, k))
        .unwrap_or(best);
    let why = explain(&candidates, judgement, best, chosen);
    Comparison { candidates, judgement, chosen, why }
}

/// Standard error of the mean difference, photo by photo.
fn standard_error(own: &[f64], best: &[f64]) -> f64 {
    let n = own.len() as f64;
    let differences: Vec<f64> = own.iter().zip(best).map(|(a, b)| a - b).collect();
    let mean = differences.iter().sum::<f64>() / n;
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (variance / n).sqrt()
}

fn explain(candidates: &[Candidate], judgement: Judgement, best: usize, chosen: usize) -> String {
    let name = |k: usize| candidates[k].model.describe();
    let measure = |k: usize| match (judgement, candidates[k].held_out_px) {
        (Judgement::CrossValidation { .. }, Some(px)) => format!("{px:.4} px on photos it was not fitted to"),
        _ => format!("a criterion of {:.1}", score(&candidates[k])),
    };
    let mut text = format!("{} is taken: {}", name(chosen), measure(chosen));
    if best == chosen {
        text.push_str(", the best of all");
    } else {
        text.push_str(&format!(
            "; {} has {}, which is no more than chance and costs {} more parameter(s)",
            name(best),
            measure(best),
            candidates[best].model.parameters().saturating_sub(candidates[chosen].model.parameters())
        ));
    }
    // The nearest simpler model says what the chosen one's extra terms are worth.
    let simpler = (0..candidates.len())
        .filter(|&k| candidates[k].model.parameters() < candidates[chosen].model.parameters())
        .filter(|&k| candidates[k].score.is_some())
        .min_by(|&a, &b| score(&candidates[a]).total_cmp(&score(&candidates[b])));
    match simpler {
        Some(k) => text.push_str(&format!(". The simpler {} has {}.", name(k), measure(k))),
        None => text.push('.'),
    }
    text
}

#[cfg(test)]
mod tests;
