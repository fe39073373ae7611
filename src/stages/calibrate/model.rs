//! The declared lens as the models to fit, and the fit.

use crate::calibration::{
    Calibration, CalibrationError, LensModel, Options, OutlierPolicy, ViewPoints, calibrate_with,
};
use crate::config::calibrate::{LensChoice, ModelSpec};
use crate::report::calibration::ChoiceNumbers;

/// A calibration and how its lens was chosen.
pub(super) struct Fitted {
    pub calibration: Calibration,
    pub choice: Option<ChoiceNumbers>,
    pub advice: Vec<String>,
}

/// The declared lens, with what else is declared.
fn declared(lens: LensModel, skew: bool, spec: ModelSpec, side: bool) -> LensModel {
    let mut model =
        lens.with_skew(skew).with_side(side).with_bend(spec.bend).with_principal_point(!spec.centred);
    if let Some(ratio) = spec.aspect {
        model = model.with_aspect(ratio);
    }
    model
}

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
    let one = |lens, skew| declared(lens, spec.skew.unwrap_or(skew), spec, found);
    let model = match spec.lens {
        LensChoice::Auto => one(LensModel::BROWN, true),
        LensChoice::Brown5 => one(LensModel::BROWN, true),
        LensChoice::Radial2 => one(LensModel::RADIAL2, false),
        LensChoice::Radial2Tangential2 => one(LensModel::RADIAL2_TANGENTIAL2, false),
        LensChoice::Rational => one(LensModel::RATIONAL, false),
        LensChoice::Fisheye => one(LensModel::FISHEYE, false),
    };
    let robust = spec.robust.unwrap_or(found);
    let outliers = if robust { OutlierPolicy::WeighDown } else { OutlierPolicy::Keep };
    let calibration = calibrate_with(views, width, height, Options { model, outliers })?;
    Ok(Fitted { calibration, choice: None, advice: Vec::new() })
}
