//! A simulated survey read back from its files: log, track, terrain and pictures lead to its true targets.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use boresight::camera::{Brown, Camera, ImagePoint};
use boresight::config::Config;
use boresight::geodesy::{Geodetic, WGS84};
use boresight::georeference::GeoreferencedFrame;
use boresight::stages::georeference::georeference;
use boresight::stages::simulate::simulate;
use boresight::synthetic::{self, Relief, ReliefShape, Scenario};

/// Hills far north at the edge of a UTM zone, true poses, lever arms, small frames, a camera clock that is fast.
pub fn scenario() -> Scenario {
    let mut scenario = Scenario::demo();
    scenario.camera = synthetic::Camera {
        width_px: 384,
        height_px: 216,
        fx_px: 248.0,
        fy_px: 249.5,
        skew_px: -0.26,
        cx_px: 188.5,
        cy_px: 114.8,
        ..scenario.camera
    };
    scenario.site.latitude_deg = 60.0;
    scenario.site.longitude_deg = 17.99;
    scenario.relief = Relief { shape: ReliefShape::Hills, amplitude_m: 12.0, wavelength_m: 400.0 };
    scenario.adahrs = synthetic::Adahrs { track_rate_hz: 50.0, ..synthetic::Adahrs::default() };
    scenario.mounting.boresight_roll_deg = 1.3;
    scenario.mounting.boresight_yaw_deg = -2.1;
    scenario.calibration.views = 0;
    scenario
}

pub const COLUMNS: &str = r#"
latitude = { column = "latitude_deg", unit = "deg" }
longitude = { column = "longitude_deg", unit = "deg" }
height = { column = "height_ellipsoid_m", unit = "m", datum = "ellipsoid" }
yaw = { column = "yaw_deg", unit = "deg", sense = "clockwise_from_true_north" }
pitch = { column = "pitch_deg", unit = "deg", sense = "nose_up" }
roll = { column = "roll_deg", unit = "deg", sense = "right_wing_down" }
ground_speed = { column = "ground_speed_m_s", unit = "m/s" }
"#;

/// How the simulated camera is mounted.
pub const MOUNT: &str = r#"
[georeference.mount]
gimbal_pan = "-90 deg"
gimbal_elevation = "-90 deg"
antenna_in_body = { forward = "-0.3 m", down = "-0.25 m" }
gimbal_in_body = { forward = "0.45 m", down = "0.2 m" }
camera_in_gimbal = { forward = "0.05 m" }
boresight = { roll = "1.3 deg", yaw = "-2.1 deg" }
"#;

/// The pipeline of the simulated survey with a log, and a mount where the log does not state the camera's own pose.
pub fn pipeline_with(log: &str, mount: &str) -> String {
    format!(
        r#"
version = 1

[run]
output = "out"

[calibrate]
camera = "camera.json"

[georeference]
images = "survey/images"

{log}
{mount}
[georeference.ground]
kind = "dem"
file = "survey/dem.tif"
datum = "ellipsoid"
"#
    )
}

fn pipeline(log: &str, columns: &str, frames: &str) -> String {
    pipeline_with(
        &format!("[georeference.log]\n{log}\n[georeference.log.columns]\n{columns}{COLUMNS}\n{frames}"),
        MOUNT,
    )
}

/// Greatest distance between a true target and where its true pixel is georeferenced, metres; number of observations.
pub fn worst_target(folder: &Path, pipeline: &str) -> (f64, usize) {
    let config =
        Config::from_text(&folder.join("pipeline.toml"), pipeline, &[]).unwrap_or_else(|e| panic!("{e}"));
    let c = scenario().camera;
    let brown =
        Brown::new([c.fx_px, c.fy_px, c.skew_px, c.cx_px, c.cy_px, c.k1, c.k2, c.p1, c.p2, c.k3]).unwrap();
    let camera = Arc::new(Camera::new(brown, c.width_px, c.height_px, None).unwrap());
    let survey = georeference(config.georeference.as_ref().unwrap(), &camera).unwrap();
    assert!(survey.rejected.is_empty(), "{} frames rejected", survey.rejected.len());
    let frames: BTreeMap<&str, &GeoreferencedFrame> =
        survey.frames.iter().map(|frame| (frame.name.as_str(), frame)).collect();
    assert_eq!(frames.len(), 15);

    let rows = |name: &str| -> Vec<csv::StringRecord> {
        csv::Reader::from_path(folder.join("survey").join(name))
            .unwrap()
            .records()
            .map(Result::unwrap)
            .collect()
    };
    let number = |text: &str| text.parse::<f64>().unwrap();
    let targets: BTreeMap<String, Geodetic> = rows("targets.csv")
        .iter()
        .map(|row| {
            (row[0].to_owned(), Geodetic::from_degrees(number(&row[1]), number(&row[2]), number(&row[3])))
        })
        .collect();
    let observations = rows("target_observations.csv");
    let mut worst: f64 = 0.0;
    for row in &observations {
        let found =
            frames[&row[1]].ground_from_pixel(ImagePoint::new(number(&row[2]), number(&row[3]))).unwrap();
        let truth = WGS84.ecef_from_geodetic(&targets[&row[0]]);
        worst = worst.max(WGS84.ecef_from_geodetic(&found.position).distance_to(&truth));
    }
    (worst, observations.len())
}

#[test]
fn targets_over_hills_are_found_from_the_files_by_name_and_by_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut scenario = scenario();
    simulate(&scenario, &folder.path().join("survey")).unwrap();
    let by_name = pipeline("file = \"survey/log.csv\"\njoin = \"name\"\n", "frame = \"file\"", "");
    let (worst, count) = worst_target(folder.path(), &by_name);
    assert!(count > 30, "only {count} observations");
    assert!(worst < 0.05, "{worst} m by name");

    // Joined by time, the camera's fast clock is put right; joined by name its log is half a second late.
    scenario.adahrs.clock_offset_s = 0.5;
    std::fs::remove_dir_all(folder.path().join("survey")).unwrap();
    simulate(&scenario, &folder.path().join("survey")).unwrap();
    let by_time = pipeline(
        "file = \"survey/track.csv\"\njoin = \"time\"\nclock_offset = \"-0.5 s\"\n",
        "time = { column = \"time_s\", format = \"seconds\" }",
        r#"
[georeference.frames]
file = "survey/log.csv"

[georeference.frames.columns]
frame = "file"
time = { column = "time_s", format = "seconds" }
"#,
    );
    let (worst, _) = worst_target(folder.path(), &by_time);
    assert!(worst < 0.05, "{worst} m by time");
    let (worst, _) = worst_target(folder.path(), &by_name);
    // 11 m flown, and up to 2 degrees of attitude seen from 357 m.
    assert!((11.0..30.0).contains(&worst), "{worst} m with the late log");
}
