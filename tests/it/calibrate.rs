//! Calibration on real photos and published corners.

use boresight::calibration::{
    Detection, Grey, Lens, LensModel, Marker, SquaresTarget, ViewPoints, calibrate, detect,
};
use std::path::Path;

use crate::surveys::shared;

/// Zhang's model: two radial terms and the skew.
const ZHANG: LensModel = LensModel { lens: Lens::Radial2, skew: true, side: true };

fn grey(file: &Path) -> Grey {
    let image = image::open(file).unwrap().into_luma8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    Grey::new(width, height, image.into_raw().into_iter().map(f32::from).collect()).unwrap()
}

/// Detects the target in all photos; every one must show it in full.
fn detections(folder: &Path, names: &[String], target: &SquaresTarget) -> Vec<Detection> {
    names
        .iter()
        .map(|name| {
            let image = grey(&folder.join(name));
            let begin = std::time::Instant::now();
            let found = detect(&image, target).unwrap_or_else(|e| panic!("{name}: {e}"));
            println!(
                "{name}: {} corners in {:?}, missing {:?}",
                found.corners.len(),
                begin.elapsed(),
                found.missing
            );
            found
        })
        .collect()
}

fn views(names: &[String], detections: &[Detection]) -> Vec<ViewPoints> {
    names
        .iter()
        .zip(detections)
        .map(|(name, d)| ViewPoints { name: name.clone(), observations: d.observations() })
        .collect()
}

#[test]
fn zhangs_photos_give_zhangs_camera() {
    let Some(folder) = shared("zhang-squares") else { return };
    let names: Vec<String> = (1..=5).map(|i| format!("CalibIm{i}.png")).collect();
    let inch = 0.0254;
    let target = SquaresTarget::new(8, 8, 0.5 * inch, 0.388_889 * inch, Marker::None).unwrap();
    let found = detections(&folder, &names, &target);
    let calibration = calibrate(&views(&names, &found), 640, 480, ZHANG).unwrap();
    println!(
        "{:?} rms {} {:?}",
        calibration.camera.brown.interior(),
        calibration.rms_px,
        calibration.views.iter().map(|v| v.rms_px).collect::<Vec<_>>()
    );
    assert!(found.iter().all(|d| d.missing.is_empty()));
    let [fx, fy, ..] = calibration.camera.brown.interior();
    assert!((fx / 832.5 - 1.0).abs() < 0.015 && (fy / 832.53 - 1.0).abs() < 0.015, "{fx} {fy}");
    assert!(calibration.rms_px < 0.336, "{}", calibration.rms_px);
}

#[test]
fn all_fourteen_sony_photos_are_found() {
    let Some(folder) = shared("boofcv-sony-squares") else { return };
    let names: Vec<String> = (1..=14).map(|i| format!("frame{i:02}.jpg")).collect();
    let target = SquaresTarget::new(4, 3, 0.03, 0.03, Marker::None).unwrap();
    let found = detections(&folder, &names, &target);
    let model = LensModel { lens: Lens::Radial2, skew: false, side: true };
    let calibration = calibrate(&views(&names, &found), 640, 480, model).unwrap();
    println!(
        "{:?} rms {} {:?}",
        calibration.camera.brown.interior(),
        calibration.rms_px,
        calibration.views.iter().map(|v| v.rms_px).collect::<Vec<_>>()
    );
    assert!(found.iter().all(|d| d.missing.is_empty()));
    let [fx, fy, ..] = calibration.camera.brown.interior();
    // BoofCV's published 703.08, 704.79 from its own corners.
    assert!((fx / 703.08 - 1.0).abs() < 0.01 && (fy / 704.79 - 1.0).abs() < 0.01, "{fx} {fy}");
}
