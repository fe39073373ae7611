//! The declared lens as the models to fit, and the fit.

use crate::calibration::{
    Calibration, CalibrationError, Candidate, Comparison, LensModel, Options, OutlierPolicy, StartError,
    ViewPoints, advice, calibrate_with, compare,
};
use crate::config::calibrate::{LensChoice, ModelSpec};
use crate::report::calibration::{CandidateNumbers, ChoiceNumbers};

/// A calibration and how its lens was chosen.
pub(super) struct Fitted {
    pub calibration: Calibration,
    pub choice: Option<ChoiceNumbers>,
    pub advice: Vec<String>,
}

/// Lenses compared when none is declared, the simplest first.
const LENSES: [LensModel; 6] = [
    LensModel::RADIAL2,
    LensModel::RADIAL2_TANGENTIAL2,
    LensModel::BROWN,
    LensModel::PAPER,
    LensModel::FISHEYE,
    LensModel::RATIONAL,
];

/// Fits the declared lens, or the best of several.
///
/// - `found`: the points were found in photos by this program: their squares' side is estimated along, and points far
///   off weigh less unless the pipeline says otherwise.
pub(super) fn fit(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    spec: ModelSpec,
    found: bool,
) -> Result<Fitted, CalibrationError> {
    let robust = spec.robust.unwrap_or(found);
    let outliers = if robust { OutlierPolicy::WeighDown } else { OutlierPolicy::Keep };
    let model = |lens: LensModel| {
        let model = lens.with_side(found).with_bend(spec.bend).with_principal_point(!spec.centred);
        match spec.aspect {
            Some(ratio) => model.with_aspect(ratio),
            None => model,
        }
    };
    let one = |lens: LensModel, skew| model(lens.with_skew(spec.skew.unwrap_or(skew)));
    let declared = match spec.lens {
        LensChoice::Auto => {
            let skew = |lens: &LensModel| spec.skew.is_none_or(|skew| skew == lens.skew());
            let mut models: Vec<LensModel> = LENSES.into_iter().filter(skew).map(model).collect();
            if models.len() == 1 {
                // With skew declared every lens has it.
                models = LENSES.into_iter().map(|lens| model(lens.with_skew(true))).collect();
                models.dedup();
            }
            return chosen(views, compare(views, width, height, &models, outliers)?, width, height);
        }
        LensChoice::Brown5 => one(LensModel::BROWN, true),
        LensChoice::Radial2 => one(LensModel::RADIAL2, false),
        LensChoice::Radial2Tangential2 => one(LensModel::RADIAL2_TANGENTIAL2, false),
        LensChoice::Rational => one(LensModel::RATIONAL, false),
        LensChoice::Fisheye => one(LensModel::FISHEYE, false),
    };
    let calibration = calibrate_with(views, width, height, Options { model: declared, outliers })?;
    Ok(fitted(views, calibration, None, width, height))
}

fn fitted(
    views: &[ViewPoints],
    calibration: Calibration,
    choice: Option<ChoiceNumbers>,
    width: u32,
    height: u32,
) -> Fitted {
    let advice = advice(views, width, height, Some(&calibration)).iter().map(ToString::to_string).collect();
    Fitted { calibration, choice, advice }
}

fn chosen(
    views: &[ViewPoints],
    comparison: Comparison,
    width: u32,
    height: u32,
) -> Result<Fitted, CalibrationError> {
    let choice = ChoiceNumbers {
        explanation: comparison.why.clone(),
        candidates: comparison
            .candidates
            .iter()
            .enumerate()
            .map(|(k, candidate)| numbers(candidate, k == comparison.chosen))
            .collect(),
    };
    let calibration = comparison.calibration().cloned().ok_or(CalibrationError::NothingToCompare)?;
    Ok(fitted(views, calibration, Some(choice), width, height))
}

fn numbers(candidate: &Candidate, chosen: bool) -> CandidateNumbers {
    let failed = candidate.calibration.as_ref().err().or(candidate.failed.as_ref());
    CandidateNumbers {
        model: candidate.model.describe(),
        parameters: candidate.model.parameters(),
        rms_px: candidate.calibration.as_ref().ok().map(|calibration| calibration.rms_px),
        held_out_rms_px: candidate.held_out_px,
        chosen,
        // Other lenses explain the views: it is this one that does not.
        failed: failed.map(|error| match error {
            CalibrationError::Start(StartError::NoCamera) => "could not be fitted to these photos".to_owned(),
            other => other.to_string(),
        }),
    }
}
