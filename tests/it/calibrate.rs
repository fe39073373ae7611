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

/// What a pipeline of the project gives; `None`, with the reason printed, when its data is absent.
fn published(name: &str, data: &str) -> Option<Calibrated> {
    shared(data)?;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines").join(name);
    let config = Config::load(&file, &[]).unwrap_or_else(|e| panic!("{e}"));
    Some(make(&config, &RunContext::without_products(Stage::Calibrate, 0)).unwrap_or_else(|e| panic!("{e}")))
}

#[test]
fn zhangs_corners_give_zhangs_numbers() {
    let Some(made) = published("zhang-corners.toml", "zhang-squares") else { return };
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
    let Some(made) = published("zhang.toml", "zhang-squares") else { return };
    let calibration = made.calibration.unwrap();
    assert_eq!((made.photos.len(), made.rejected.len(), calibration.points()), (5, 0, 5 * 256));
    let [fx, fy, ..] = made.camera.lens.interior();
    assert!((fx / 832.5 - 1.0).abs() < 0.015 && (fy / 832.53 - 1.0).abs() < 0.015, "{fx} {fy}");
    // Below Zhang's own 0.336 px with his own corners.
    assert!(calibration.rms_px < 0.336, "{}", calibration.rms_px);
}

#[test]
fn all_fourteen_sony_photos_are_found() {
    let Some(made) = published("sony-squares.toml", "boofcv-sony-squares") else { return };
    let calibration = made.calibration.unwrap();
    assert_eq!((made.photos.len(), made.rejected.len()), (14, 0));
    assert!(calibration.points() >= 14 * 48 - 8, "{}", calibration.points());
    let [fx, fy, ..] = made.camera.lens.interior();
    // BoofCV's published 703.08, 704.79 from its own corners.
    assert!((fx / 703.08 - 1.0).abs() < 0.01 && (fy / 704.79 - 1.0).abs() < 0.01, "{fx} {fy}");
}

#[test]
fn all_chessboards_are_found_and_no_photo_is_bad_when_corners_are_located_well() {
    // OpenCV publishes 0.3926 px and f = 535.9 for the left camera, with one photo, left02, at 1.2 px: its corner
    // refinement had too large a window. With small windows, or ours, that photo is as good as the others, and the
    // focal length is that of Bouguet's toolbox on his own corners, 533.004 and 533.153.
    let Some(left) = published("opencv-left.toml", "opencv-chessboard") else { return };
    let Some(right) = published("opencv-right.toml", "opencv-chessboard") else { return };
    for (made, limit) in [(&left, 0.41), (&right, 0.46)] {
        let calibration = made.calibration.as_ref().unwrap();
        assert_eq!((made.photos.len(), made.rejected.len()), (13, 0));
        assert!(calibration.points() >= 13 * 54 - 2, "{}", calibration.points());
        assert!(calibration.rms_px < limit, "{}", calibration.rms_px);
        assert!(calibration.suspects.is_empty(), "{:?}", calibration.suspects);
    }
    let [fx, fy, _, cx, cy, ..] = left.camera.lens.interior();
    assert!((fx / 533.004 - 1.0).abs() < 0.003 && (fy / 533.153 - 1.0).abs() < 0.003, "{fx} {fy}");
    assert!((cx - 341.586).abs() < 2.0 && (cy - 234.259).abs() < 2.0, "{cx} {cy}");
}

#[test]
fn rows_and_columns_are_counted_when_not_declared() {
    for (folder, photos, target, expected) in [
        (
            "zhang-squares",
            "CalibIm*.png",
            "kind = \"squares\"\nsquare = \"12.7 mm\"\ngap = \"9.87778 mm\"\nhollow = \"none\"",
            (8, 8),
        ),
        (
            "boofcv-sony-squares",
            "frame0*.jpg",
            "kind = \"squares\"\nsquare = \"30 mm\"\ngap = \"30 mm\"\nhollow = \"none\"",
            (3, 4),
        ),
        ("opencv-chessboard", "right*.jpg", "kind = \"chessboard\"\nsquare = \"30 mm\"", (6, 9)),
    ] {
        let Some(folder) = shared(folder) else { return };
        let made = calibrated(
            &folder,
            &format!("[calibrate]\nphotos = \"{photos}\"\n[calibrate.target]\n{target}\n"),
        );
        let (target, counted) = made.unwrap().target.unwrap();
        assert_eq!((target.size(), counted), (expected, true));
    }
    // White squares between black ones pass for separate squares here and there, but not alike in most photos.
    let Some(folder) = shared("opencv-chessboard") else { return };
    let text = "[calibrate]\nphotos = \"left*.jpg\"\n[calibrate.target]\nkind = \"squares\"\nsquare = \"30 mm\"\n\
        gap = \"30 mm\"\nhollow = \"upper_left\"\n";
    let error = calibrated(&folder, text).unwrap_err();
    assert!(error.to_string().contains("do not agree on the target's rows and columns"), "{error}");
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
    let overlay = image::open(written.join("overlays/target_03.png.png")).unwrap();
    assert_eq!((overlay.width(), overlay.height()), (1152, 648));
    for picture in
        ["steps.png", "residuals.png", "coverage.svg", "uncertainty.svg", "camera-ros.yaml", "cameras.json"]
    {
        assert!(written.join(picture).exists(), "{picture}");
    }
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(written.join("calibrate.json")).unwrap()).unwrap();
    assert_eq!(summary["views"].as_array().unwrap().len(), 6);
    assert!(summary["views"][0]["steps"]["sharp_rms_px"].as_f64().unwrap() < 0.1);
    // Compared with lenses that know no skew, the one that the photos were drawn with wins.
    assert_eq!(summary["model"], "brown (k1 k2 p1 p2 k3, skew)");
    assert!(summary["choice"]["candidates"].as_array().unwrap().len() > 4);
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
    assert!(said.contains("2 of 4 photos can be used, at least 3"), "{said}");
    assert!(
        said.contains("target_03.png: ") && said.contains("target_04.png: the photo has no contrast"),
        "{said}"
    );
    assert!(error.place().is_some());
    let declared_wrongly = text.replace("rows = 7", "rows = 6");
    let said = calibrated(&demo(), &declared_wrongly).unwrap_err().to_string();
    assert!(said.contains("target_01.png: found 7 × 7 squares, more than the target's 6 × 7"), "{said}");
}

#[test]
fn photos_of_another_size_and_repeated_ones_are_left_out_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["target_01.png", "target_02.png", "target_03.png"] {
        std::fs::copy(demo().join(name), folder.path().join(name)).unwrap();
    }
    let fourth = image::open(demo().join("target_04.png")).unwrap();
    fourth.crop_imm(0, 0, 1152, 647).save(folder.path().join("target_04.png")).unwrap();
    fourth.rotate90().save(folder.path().join("target_05.png")).unwrap();
    std::fs::copy(demo().join("target_02.png"), folder.path().join("target_06.png")).unwrap();
    let text = format!("[calibrate]\nphotos = \"*.png\"\n{PAPER_TARGET}");
    let made = calibrated(folder.path(), &text).unwrap();
    let reasons: Vec<String> = made.rejected.iter().map(|r| format!("{}: {}", r.file, r.reason)).collect();
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    assert!(
        reasons[0].contains("target_04.png: is 1152 × 647 px where most photos are 1152 × 648 px"),
        "{reasons:?}"
    );
    assert!(reasons[1].contains("target_06.png: shows the same view as target_02.png"), "{reasons:?}");

    // The turned one is turned back: the sensor's corner is where the photo as stored had it.
    assert_eq!(made.photos.len(), 4);
    assert_eq!(made.photos[3].rotation.degrees(), 90);
    assert!(
        made.notes.iter().any(|note| note.contains("target_05.png: its pixels were turned by 90° clockwise"))
    );
    let stored = calibrated(&demo(), &text).unwrap();
    let first = |made: &Calibrated| made.photos[3].detection.corners[0].sharp;
    let (turned, upright) = (first(&made), first(&stored));
    assert!((turned.column - upright.column).abs() < 0.05 && (turned.row - upright.row).abs() < 0.05);

    // Nothing but copies of one photo: no camera, and what to do.
    let copies = tempfile::tempdir().unwrap();
    for name in ["a.png", "b.png", "c.png", "d.png"] {
        std::fs::copy(demo().join("target_01.png"), copies.path().join(name)).unwrap();
    }
    let error = calibrated(copies.path(), &text).unwrap_err();
    assert!(error.to_string().contains("1 of 4 photos can be used"), "{error}");
    assert!(error.to_string().contains("b.png: shows the same view as a.png"), "{error}");
    assert!(error.helps()[0].contains("tilted by 20° to 45°"), "{error}");
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
