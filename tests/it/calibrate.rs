//! Calibration through the stage: real photos, published corners, drawn photos, refusals.

use crate::surveys::shared;
use boresight::camera::Brown;
use boresight::config::Config;
use boresight::formats::atomic::write_atomic;
use boresight::formats::camera::read_camera;
use boresight::formats::table::Table;
use boresight::stages::calibrate::{Calibrated, look, make, run};
use boresight::stages::{NoProgress, RunContext, Stage, StageError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn pipeline(folder: &Path, text: &str) -> Config {
    let text = format!("version = 1\n{text}");
    Config::from_text(&folder.join("pipeline.toml"), &text, &[]).unwrap_or_else(|e| panic!("{e}"))
}

fn calibrated(folder: &Path, text: &str) -> Result<Calibrated, StageError> {
    make(&pipeline(folder, text), &RunContext::without_products(Stage::Calibrate, 0))
}

fn demo() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo/calibration")
}

const PAPER_TARGET: &str = "[calibrate.target]\nkind = \"squares\"\nrows = 7\ncolumns = 7\n\
    square = \"15.7 mm\"\ngap = \"15.7 mm\"\nhollow = \"upper_left\"\n";

/// Eqs. (6) and (7) of the paper.
const PAPER_CAMERA: [f64; 10] =
    [743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018];

#[test]
fn zhangs_corners_give_zhangs_numbers() {
    let Some(folder) = shared("zhang-squares") else { return };
    let text = "[calibrate.corners]\nmodel = \"Model.txt\"\nmodel_unit = \"25.4 mm\"\n\
        views = [\"data1.txt\", \"data2.txt\", \"data3.txt\", \"data4.txt\", \"data5.txt\"]\n\
        pixel_origin = \"centre\"\nimage_width_px = 640\nimage_height_px = 480\n\
        [calibrate.model]\nlens = \"radial2\"\nskew = true\n";
    let made = calibrated(&folder, text).unwrap();
    let calibration = made.calibration.unwrap();
    let [fx, fy, skew, cx, cy, k1, k2, ..] = made.camera.lens.interior();
    // fx, skew, fy, cx, cy, k1, k2, each to its last printed digit.
    let published = [
        (fx, 832.4998, 5e-5),
        (skew, 0.20450, 5e-6),
        (fy, 832.5296, 5e-5),
        (cx, 303.9589, 5e-5),
        (cy, 206.5852, 5e-5),
        (k1, -0.228601, 1e-6),
        (k2, 0.190354, 1e-6),
    ];
    for (found, expected, tolerance) in published {
        assert!((found - expected).abs() <= 1.01 * tolerance, "{found} for {expected}");
    }
    assert!((calibration.rms_px - 0.3364).abs() < 5e-5, "{}", calibration.rms_px);
    for (view, expected) in calibration.views.iter().zip([0.3474, 0.2314, 0.5400, 0.2358, 0.2110]) {
        assert!((view.rms_px - expected).abs() < 2e-4, "{}: {} for {expected}", view.name, view.rms_px);
    }
}

#[test]
fn zhangs_photos_give_zhangs_camera() {
    let Some(folder) = shared("zhang-squares") else { return };
    let text = "[calibrate]\nphotos = \"CalibIm*.png\"\nmodel = { lens = \"radial2\", skew = true }\n\
        [calibrate.target]\nkind = \"squares\"\nrows = 8\ncolumns = 8\nsquare = \"12.7 mm\"\n\
        gap = \"9.87778 mm\"\nhollow = \"none\"\n";
    let made = calibrated(&folder, text).unwrap();
    let calibration = made.calibration.unwrap();
    assert_eq!((made.photos.len(), made.rejected.len(), calibration.points()), (5, 0, 5 * 256));
    let [fx, fy, ..] = made.camera.lens.interior();
    assert!((fx / 832.5 - 1.0).abs() < 0.002 && (fy / 832.53 - 1.0).abs() < 0.002, "{fx} {fy}");
    // Below Zhang's own 0.336 px with his own corners.
    assert!(calibration.rms_px < 0.26, "{}", calibration.rms_px);
}

#[test]
fn all_fourteen_sony_photos_are_found() {
    let Some(folder) = shared("boofcv-sony-squares") else { return };
    let text = "[calibrate]\nphotos = \"frame*.jpg\"\nmodel = { lens = \"radial2\", skew = false }\n\
        [calibrate.target]\nkind = \"squares\"\nrows = 4\ncolumns = 3\nsquare = \"30 mm\"\ngap = \"30 mm\"\n\
        hollow = \"none\"\n";
    let made = calibrated(&folder, text).unwrap();
    let calibration = made.calibration.unwrap();
    assert_eq!((made.photos.len(), made.rejected.len(), calibration.points()), (14, 0, 14 * 48));
    let [fx, fy, ..] = made.camera.lens.interior();
    // BoofCV's published 703.08, 704.79 from its own corners.
    assert!((fx / 703.08 - 1.0).abs() < 0.005 && (fy / 704.79 - 1.0).abs() < 0.005, "{fx} {fy}");
    assert!(calibration.rms_px < 0.4, "{}", calibration.rms_px);
}

#[test]
fn the_demos_photos_give_the_camera_they_were_drawn_with() {
    let folder = tempfile::tempdir().unwrap();
    let config = pipeline(&demo(), &format!("[calibrate]\nphotos = \"target_*.png\"\n{PAPER_TARGET}"));
    let no_run_yet = look(&config, folder.path()).unwrap_err();
    assert!(no_run_yet.helps()[0].contains("--until calibrate"), "{no_run_yet}");
    let context = RunContext::new(Stage::Calibrate, folder.path(), 0, Arc::new(NoProgress), Arc::default());
    let made = run(&config, &context).unwrap();
    let calibration = made.calibration.as_ref().unwrap();
    assert_eq!((made.photos.len(), made.rejected.len()), (6, 0));
    assert_eq!(calibration.points(), 6 * 192);
    for (k, value) in made.camera.lens.interior().into_iter().enumerate().take(10) {
        let z = (value - PAPER_CAMERA[k]) / calibration.std[k];
        assert!(z.abs() < 4.0, "{}: {value} is {z:.1} standard deviations off", Brown::NAMES[k]);
    }
    // The renderer shares nothing with this program's camera: its corners are the truth.
    let table = Table::read_path(&demo().join("corners.csv"), b',').unwrap();
    let column = |name: &str| table.column_named(name).unwrap();
    let (file, r, c) = (column("file"), column("square_row"), column("square_column"));
    let (k, u, v) = (column("corner"), column("column"), column("row"));
    let truth: BTreeMap<(String, usize, usize, usize), (f64, f64)> = table
        .rows()
        .map(|row| {
            let index = |column| row.number(column).unwrap() as usize;
            let key = (row.text(file).to_owned(), index(r), index(c), index(k));
            (key, (row.number(u).unwrap(), row.number(v).unwrap()))
        })
        .collect();
    let mut squares = 0.0;
    for photo in &made.photos {
        let name = photo.file.file_name().unwrap().to_str().unwrap();
        for corner in &photo.detection.corners {
            let key = (name.to_owned(), corner.row, corner.column, corner.corner);
            let (column, row) = truth[&key];
            squares += (corner.sharp.column - column).powi(2) + (corner.sharp.row - row).powi(2);
        }
    }
    let rms = (squares / calibration.points() as f64).sqrt();
    assert!(rms < 0.05, "corners are off by {rms} px");
    // Products: the camera comes back to the last bit, and the next command finds it.
    let written = folder.path().join("calibrate");
    assert_eq!(read_camera(&written.join("camera.json")).unwrap(), *made.camera);
    assert_eq!(look(&config, folder.path()).unwrap(), *made.camera);
    let opencv = read_camera(&written.join("camera-opencv.yaml")).unwrap();
    assert_eq!(opencv.lens, made.camera.lens);
    let corners = Table::read_path(&written.join("corners.csv"), b',').unwrap();
    assert_eq!(corners.rows().count(), 6 * 192);
    let overlay = image::open(written.join("overlay.png")).unwrap();
    assert_eq!((overlay.width(), overlay.height()), (1152, 648));
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(written.join("calibrate.json")).unwrap()).unwrap();
    assert_eq!(summary["views"].as_array().unwrap().len(), 6);
    assert!(summary["views"][0]["steps"]["sharp_rms_px"].as_f64().unwrap() < 0.1);
    assert_eq!(context.record().inputs.len(), 6);
}

#[test]
fn photos_without_the_target_are_listed_with_their_reasons() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["target_01.png", "target_02.png"] {
        std::fs::copy(demo().join(name), folder.path().join(name)).unwrap();
    }
    write_atomic(folder.path().join("target_03.png").as_path(), b"no photo").unwrap();
    image::GrayImage::from_pixel(1152, 648, image::Luma([90]))
        .save(folder.path().join("target_04.png"))
        .unwrap();
    let text = format!("[calibrate]\nphotos = \"*.png\"\n{PAPER_TARGET}");
    let error = calibrated(folder.path(), &text).unwrap_err();
    let said = error.to_string();
    assert!(said.contains("2 of 4 photos show the target, at least 3"), "{said}");
    assert!(
        said.contains("target_03.png: ") && said.contains("target_04.png: the photo has no contrast"),
        "{said}"
    );
    assert!(error.place().is_some());
    let declared_wrongly = text.replace("rows = 7", "rows = 6");
    let said = calibrated(&demo(), &declared_wrongly).unwrap_err().to_string();
    assert!(said.contains("target_01.png: found 7 × 7 squares, more than the declared 6 × 7"), "{said}");
}

#[test]
fn photos_of_two_sizes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["target_01.png", "target_02.png", "target_03.png"] {
        std::fs::copy(demo().join(name), folder.path().join(name)).unwrap();
    }
    let cut = image::open(demo().join("target_04.png")).unwrap().crop_imm(0, 0, 1152, 647);
    cut.save(folder.path().join("target_04.png")).unwrap();
    let text = format!("[calibrate]\nphotos = \"*.png\"\n{PAPER_TARGET}");
    let said = calibrated(folder.path(), &text).unwrap_err().to_string();
    assert!(said.contains("target_04.png is 1152 × 647 px but target_01.png is 1152 × 648 px"), "{said}");
}

#[test]
fn camera_files_and_parameters_need_no_photos() {
    let folder = tempfile::tempdir().unwrap();
    let parameters = "[calibrate.parameters]\nimage_width_px = 1152\nimage_height_px = 648\n\
        pixel_origin = \"centre\"\nfx_px = 743.7937\nfy_px = 748.9947\ncx_px = 566.367\ncy_px = 345.5019\n";
    let config = pipeline(folder.path(), parameters);
    let context = RunContext::new(Stage::Calibrate, folder.path(), 0, Arc::new(NoProgress), Arc::default());
    let made = run(&config, &context).unwrap();
    assert!(made.calibration.is_none());
    // Both files it left are cameras again.
    for name in ["camera.json", "camera-opencv.yaml"] {
        let text = format!("[calibrate]\ncamera = \"calibrate/{name}\"\n");
        assert_eq!(calibrated(folder.path(), &text).unwrap().camera, made.camera, "{name}");
    }
    write_atomic(folder.path().join("broken.json").as_path(), b"{ \"format\": \"boresight-camera\" }")
        .unwrap();
    let error = calibrated(folder.path(), "[calibrate]\ncamera = \"broken.json\"\n").unwrap_err();
    assert!(error.to_string().contains("broken.json: `version` is missing"), "{error}");
    assert!(error.place().is_some());
}
