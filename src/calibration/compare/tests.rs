//! The model that the photos were made with is found again.

use super::super::LensModel;
use super::super::simulated::{Scene, around};
use super::*;
use crate::camera::{Brown, Fisheye, Lens};

const MODELS: [LensModel; 5] =
    [LensModel::RADIAL2, LensModel::BROWN, LensModel::PAPER, LensModel::RATIONAL, LensModel::FISHEYE];

fn compared(lens: impl Into<Lens>, noise_px: f64, seed: u64) -> Comparison {
    let views = around(&Scene::new(lens, noise_px), 12, seed);
    compare(&views, 1152, 648, &MODELS, OutlierPolicy::Keep).unwrap()
}

fn chosen(comparison: &Comparison) -> LensModel {
    comparison.candidates[comparison.chosen].model
}

#[test]
fn two_radial_terms_are_enough_for_a_lens_that_has_no_more() {
    let lens = Brown::new([744.0, 749.0, 0.0, 566.4, 335.5, -0.2, 0.06, 0.0, 0.0, 0.0]).unwrap();
    let comparison = compared(lens, 0.1, 1);
    assert_eq!(chosen(&comparison), LensModel::RADIAL2, "{}", comparison.why);
    assert!(comparison.why.contains("radial") || comparison.why.contains("brown (k1 k2)"));
    assert_eq!(comparison.judgement, Judgement::CrossValidation { folds: 10 });
}

#[test]
fn decentring_is_worth_its_terms() {
    let lens = Brown::new([744.0, 749.0, 0.0, 566.4, 335.5, -0.2, 0.06, 4e-3, -3e-3, -0.01]).unwrap();
    let comparison = compared(lens, 0.1, 2);
    assert_eq!(chosen(&comparison), LensModel::BROWN, "{}", comparison.why);
    assert!(comparison.why.contains("The simpler "), "{}", comparison.why);
}

#[test]
fn a_skew_is_seen() {
    let lens = Brown::new([744.0, 749.0, -3.0, 566.4, 335.5, -0.2, 0.06, 4e-3, -3e-3, -0.01]).unwrap();
    let comparison = compared(lens, 0.1, 3);
    assert_eq!(chosen(&comparison), LensModel::PAPER, "{}", comparison.why);
}

#[test]
fn a_fisheye_is_taken_for_one() {
    let lens = Fisheye::new([420.0, 421.0, 0.0, 566.4, 335.5, 0.05, -0.01, 0.004, -0.001]).unwrap();
    let comparison = compared(lens, 0.1, 4);
    assert_eq!(chosen(&comparison), LensModel::FISHEYE, "{}", comparison.why);
    let calibration = comparison.calibration().unwrap();
    assert!((calibration.camera.lens.interior()[0] - 420.0).abs() < 4.0 * calibration.std[0]);
}

#[test]
fn three_photos_are_judged_by_information() {
    let lens = Brown::new([744.0, 749.0, 0.0, 566.4, 335.5, -0.2, 0.06, 4e-3, -3e-3, -0.01]).unwrap();
    let views = around(&Scene::new(lens, 0.1), 3, 5);
    let comparison = compare(&views, 1152, 648, &MODELS[..3], OutlierPolicy::Keep).unwrap();
    assert_eq!(comparison.judgement, Judgement::Information);
    assert_ne!(chosen(&comparison), LensModel::RADIAL2, "{}", comparison.why);
    assert!(comparison.why.contains("criterion"), "{}", comparison.why);
}

#[test]
fn a_set_that_no_model_explains_says_why() {
    let lens = Brown::new([744.0, 749.0, 0.0, 566.4, 335.5, -0.2, 0.06, 0.0, 0.0, 0.0]).unwrap();
    let views = around(&Scene::new(lens, 0.1), 2, 6);
    let error = compare(&views, 1152, 648, &MODELS, OutlierPolicy::Keep).unwrap_err();
    assert!(error.to_string().contains("at least 3"), "{error}");
    let none = compare(&views, 1152, 648, &[], OutlierPolicy::Keep).unwrap_err();
    assert_eq!(none, CalibrationError::NothingToCompare);
}
