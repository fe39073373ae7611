//! `init`: the file it writes for a survey leads to the same places on the ground as the one written by hand.

#![expect(clippy::disallowed_methods, reason = "tests lay out inputs, not products")]

use super::surveys::{pipeline, shared};
use boresight::camera::ImagePoint;
use boresight::config::Config;
use boresight::geodesy::{Geodetic, WGS84};
use boresight::georeference::GeoreferencedFrame;
use boresight::stages::georeference::Georeferenced;
use boresight::stages::init::{Written, init};
use boresight::stages::session::Session;
use boresight::stages::simulate::simulate;
use boresight::synthetic::{Camera, Relief, ReliefShape, Scenario};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Copies files and folders of a data set, so that nothing is written into it.
fn copy(from: &Path, to: &Path, names: &[&str]) {
    for name in names {
        let (from, to) = (from.join(name), to.join(name));
        if from.is_dir() {
            fs::create_dir_all(&to).unwrap();
            for entry in fs::read_dir(&from).unwrap() {
                let path = entry.unwrap().path();
                fs::write(to.join(path.file_name().unwrap()), fs::read(&path).unwrap()).unwrap();
            }
        } else {
            fs::write(to, fs::read(from).unwrap()).unwrap();
        }
    }
}

/// The survey that a pipeline file leads to, as it stands.
fn survey_of(config: &Config) -> Georeferenced {
    Session::rehearse(config).unwrap_or_else(|e| panic!("{e}")).0.survey().unwrap().clone()
}

fn written_survey(written: &Written) -> Georeferenced {
    assert_eq!(written.failure, None);
    let survey = survey_of(&Config::load(&written.file, &[]).unwrap_or_else(|e| panic!("{e}")));
    assert_eq!((survey.frames.len(), &survey.rejected), (written.frames_used, &written.frames_rejected));
    survey
}

fn by_name(survey: &Georeferenced) -> BTreeMap<&str, &GeoreferencedFrame> {
    survey.frames.iter().map(|frame| (frame.name.as_str(), frame)).collect()
}

/// Greatest horizontal distance between the places of a pixel of each frame, metres.
fn apart(one: &Georeferenced, two: &Georeferenced, column: f64, row: f64) -> f64 {
    let two = by_name(two);
    let mut worst: f64 = 0.0;
    for frame in &one.frames {
        let pixel = ImagePoint::new(column, row);
        let places = [frame, two[frame.name.as_str()]].map(|f| f.ground_from_pixel(pixel).unwrap().position);
        let [a, b] = places.map(|at| {
            WGS84.ecef_from_geodetic(&Geodetic::from_degrees(
                at.latitude.degrees(),
                at.longitude.degrees(),
                0.0,
            ))
        });
        worst = worst.max(a.distance_to(&b));
    }
    worst
}

#[test]
fn seneca_s_folder_gives_the_poses_of_its_own_log() {
    let Some(data) = shared("seneca") else { return };
    let folder = tempfile::tempdir().unwrap();
    let all = [
        "images",
        "frames.csv",
        "reference_eo.csv",
        "reference_camera.json",
        "reference_dem_5m.tif",
        "check_points.csv",
    ];
    copy(&data, folder.path(), &all);
    let written = init(folder.path(), None, false).unwrap();
    assert_eq!(written.questions, Vec::<String>::new());
    assert_eq!((written.poses.as_str(), written.frames_used), ("the photos' own metadata", 69));
    let (own, hand) = (written_survey(&written), survey_of(&pipeline("seneca-log.toml")));
    let hand_frames = by_name(&hand);
    assert_eq!(own.frames.len(), hand.frames.len());
    for frame in &own.frames {
        let (a, b) = (&frame.record, &hand_frames[frame.name.as_str()].record);
        // frames.csv holds the photos' numbers with 7, 3 and 4 decimals.
        assert!((a.antenna.latitude - b.antenna.latitude).degrees().abs() < 1e-6, "{}", frame.name);
        assert!((a.antenna.longitude - b.antenna.longitude).degrees().abs() < 1e-6, "{}", frame.name);
        assert!((a.antenna.height.get() - b.antenna.height.get()).abs() < 1e-3, "{}", frame.name);
        let angles =
            |r: &boresight::navigation::NavigationRecord| [r.attitude.yaw, r.attitude.pitch, r.attitude.roll];
        for (one, two) in angles(a).into_iter().zip(angles(b)) {
            assert!((one - two).wrapped().degrees().abs() < 1e-4, "{}", frame.name);
        }
    }
    // Camera and ground are the same too, so every place is: to the rounding of the table.
    assert!(apart(&own, &hand, 899.5, 674.5) < 0.02);
    assert!(apart(&own, &hand, 100.0, 1300.0) < 0.02);
}

#[test]
fn brighton_s_turned_strip_is_declared_or_asked_for() {
    let Some(data) = shared("brighton-beach") else { return };
    let folder = tempfile::tempdir().unwrap();
    copy(&data, folder.path(), &["images", "frames.csv", "dsm_025m.tif", "ortho_from_cloud_010m.tif"]);
    let written = init(folder.path(), None, false).unwrap();
    assert_eq!(written.questions, Vec::<String>::new());
    let (own, hand) = (written_survey(&written), survey_of(&pipeline("brighton.toml")));
    // The focal length is 0.05 % off the one written by hand, and where the surface model is empty the heights that stand
    // in differ by 1.7 m: nothing below the camera, a metre and a half at the corner.
    assert!(apart(&own, &hand, 999.5, 562.0) < 0.05, "{}", apart(&own, &hand, 999.5, 562.0));
    assert!(apart(&own, &hand, 50.0, 50.0) < 2.0, "{}", apart(&own, &hand, 50.0, 50.0));

    // Without the table only the viewer's name is left, and the question is marked where it stands.
    fs::remove_file(folder.path().join("frames.csv")).unwrap();
    let written = init(folder.path(), None, true).unwrap();
    assert!(
        matches!(&written.questions[..], [one] if one.contains("DJI_0024.JPG to DJI_0029.JPG")),
        "{:?}",
        written.questions
    );
    assert!(apart(&own, &written_survey(&written), 50.0, 50.0) < 1e-6);
    let text = fs::read_to_string(&written.file).unwrap();
    assert!(
        text.contains("# QUESTION 1: ") && text.contains("\nturned_frames = [{ frames = [\"DJI_0024.JPG\"")
    );

    // Without a model the ground lies at the take-off point.
    fs::remove_file(folder.path().join("dsm_025m.tif")).unwrap();
    let written = init(folder.path(), None, true).unwrap();
    assert!(
        fs::read_to_string(&written.file)
            .unwrap()
            .contains("kind = \"plane\"\nheight = \"158.5 m\"\ndatum = \"egm96\"")
    );
    assert!(apart(&own, &written_survey(&written), 999.5, 562.0) < 0.05);
}

/// A small survey without errors: level ground or hills, as the paper's flight was mounted.
fn small(shape: ReliefShape) -> Scenario {
    let mut scenario = Scenario::demo();
    scenario.camera = Camera {
        width_px: 384,
        height_px: 216,
        fx_px: 248.0,
        fy_px: 249.5,
        skew_px: -0.26,
        cx_px: 188.5,
        cy_px: 114.8,
        ..scenario.camera
    };
    scenario.relief = Relief { shape, amplitude_m: 12.0, wavelength_m: 400.0 };
    scenario.adahrs = boresight::synthetic::Adahrs::default();
    scenario.calibration.views = 0;
    scenario
}

/// Greatest distance between a true target and where its true pixel is georeferenced, metres.
fn worst_target(folder: &Path, survey: &Georeferenced) -> f64 {
    let rows = |name: &str| -> Vec<csv::StringRecord> {
        csv::Reader::from_path(folder.join(name)).unwrap().records().map(Result::unwrap).collect()
    };
    let number = |text: &str| text.parse::<f64>().unwrap();
    let targets: BTreeMap<String, Geodetic> = rows("targets.csv")
        .iter()
        .map(|r| (r[0].to_owned(), Geodetic::from_degrees(number(&r[1]), number(&r[2]), number(&r[3]))))
        .collect();
    let frames = by_name(survey);
    let observations = rows("target_observations.csv");
    assert!(observations.len() > 20);
    observations.iter().fold(0.0, |worst: f64, row| {
        let found =
            frames[&row[1]].ground_from_pixel(ImagePoint::new(number(&row[2]), number(&row[3]))).unwrap();
        let truth = WGS84.ecef_from_geodetic(&targets[&row[0]]);
        worst.max(WGS84.ecef_from_geodetic(&found.position).distance_to(&truth))
    })
}

#[test]
fn a_simulated_survey_is_found_with_its_camera_and_its_hills() {
    let folder = tempfile::tempdir().unwrap();
    let survey = folder.path().join("survey");
    simulate(&small(ReliefShape::Hills), &survey).unwrap();
    let file = folder.path().join("my flight.toml");
    let written = init(&survey, Some(&file), false).unwrap();
    assert_eq!(written.questions, Vec::<String>::new());
    let text = fs::read_to_string(&file).unwrap();
    for line in [
        "camera = \"survey/camera-true.json\"",
        "file = \"survey/dem.tif\"",
        "datum = \"ellipsoid\"",
        "images = \"survey/images\"",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    }
    let worst = worst_target(&survey, &written_survey(&written));
    assert!(worst < 0.05, "{worst} m");
}

#[test]
fn a_survey_that_does_not_say_how_the_camera_sits_leaves_that_question() {
    let folder = tempfile::tempdir().unwrap();
    let survey = folder.path().join("survey");
    let mut scenario = small(ReliefShape::Flat);
    for arm in [
        &mut scenario.mounting.antenna_in_body_m,
        &mut scenario.mounting.gimbal_in_body_m,
        &mut scenario.mounting.camera_in_gimbal_m,
    ] {
        *arm = [0.0; 3];
    }
    simulate(&scenario, &survey).unwrap();
    fs::remove_file(survey.join("scenario.toml")).unwrap();
    let written = init(&survey, None, false).unwrap();
    assert!(
        matches!(&written.questions[..], [one] if one.starts_with("how does the camera sit")),
        "{:?}",
        written.questions
    );
    let astray = worst_target(&survey, &written_survey(&written));
    assert!(astray > 50.0, "answered by luck: {astray} m");
    // The answer, where the question stands.
    let text = fs::read_to_string(&written.file).unwrap();
    let answered = text.replace(
        "gimbal_elevation = \"-90 deg\"",
        "gimbal_elevation = \"-90 deg\"\ngimbal_pan = \"-90 deg\"",
    );
    fs::write(&written.file, answered).unwrap();
    let worst = worst_target(&survey, &survey_of(&Config::load(&written.file, &[]).unwrap()));
    assert!(worst < 0.05, "{worst} m");
}

#[test]
fn through_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let go = |words: &[&str]| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_boresight"));
        let seen = program.current_dir(folder.path()).args(words).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (seen.status.code(), text(seen.stdout), text(seen.stderr))
    };
    fs::create_dir_all(folder.path().join("a b/images")).unwrap();
    let (code, _, said) = go(&["init", "a b"]);
    assert!(code == Some(4) && said.contains("holds no photos"), "{said}");
    for name in ["a.png", "b.png"] {
        image::GrayImage::new(40, 30).save(folder.path().join("a b/images").join(name)).unwrap();
    }
    let (code, _, said) = go(&["init", "a b"]);
    assert!(
        code == Some(4)
            && said.contains("nothing that says where they were taken")
            && said.contains("looked for"),
        "{said}"
    );
    assert!(!folder.path().join("a b/boresight.toml").exists());
    fs::write(
        folder.path().join("a b/log.csv"),
        "file,lat,lon,alt_ellipsoid_m,height_above_takeoff_m,yaw,pitch,roll\n\
         a.png,41.0350,-83.3054,240,40,0,0,0\nb.png,41.0352,-83.3054,240,40,0,0,0\n",
    )
    .unwrap();
    let (code, said, _) = go(&["init", "a b", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(code, Some(0));
    assert_eq!(report["frames_used"], 2);
    assert_eq!(report["questions"].as_array().unwrap().len(), 2);
    // What it wrote is what `check` accepts, as it stands.
    let (code, said, wrong) = go(&["check", "a b/boresight.toml"]);
    assert!(code == Some(0) && said.contains("2 of 2 would be used"), "{said}{wrong}");
    let (code, _, said) = go(&["init", "a b"]);
    assert!(code == Some(2) && said.contains("is there already") && said.contains("--force"), "{said}");
    let (code, said, _) = go(&["init", "a b", "--force"]);
    assert!(code == Some(0) && said.contains("QUESTION"), "{said}");
    let (code, _, said) = go(&["init", "a b", "-o", "nowhere/p.toml"]);
    assert!(code == Some(2) && said.contains("does not exist"), "{said}");
}
