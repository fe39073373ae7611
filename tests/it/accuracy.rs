//! The accuracy stage and the page on the demo's survey: simulated with known truth, noise as stated.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use boresight::camera::{Brown, Camera};
use boresight::config::Config;
use boresight::report::AccuracyNumbers;
use boresight::stages::georeference::{Georeferenced, georeference};
use boresight::stages::page::{PageInputs, page};
use boresight::stages::{NoProgress, RunContext, Stage, StageError, accuracy};
use gdal::Metadata;

/// The demo as `fixtures/scenes/demo.toml` states it: the paper's camera, gimbal and ADAHRS.
const DEMO: &str = r#"version = 1
[calibrate]
camera = "camera.json"
[georeference]
images = "images"
[georeference.log]
file = "log.csv"
join = "name"
[georeference.log.columns]
frame = "file"
latitude = { column = "latitude_deg", unit = "deg" }
longitude = { column = "longitude_deg", unit = "deg" }
height = { column = "height_ellipsoid_m", unit = "m", datum = "ellipsoid" }
yaw = { column = "yaw_deg", unit = "deg", sense = "clockwise_from_true_north" }
pitch = { column = "pitch_deg", unit = "deg", sense = "nose_up" }
roll = { column = "roll_deg", unit = "deg", sense = "right_wing_down" }
ground_speed = { column = "ground_speed_m_s", unit = "m/s" }
[georeference.mount]
MOUNT
[georeference.ground]
kind = "plane"
height = "640 m"
datum = "ellipsoid"
[accuracy.sigmas]
position = { cep = "3 m" }
height = "5 m"
roll = "0.2 deg"
pitch = "0.2 deg"
yaw = "0.6 deg"
picking = "0.5 px"
camera = "none"
[accuracy.monte_carlo]
draws = 2000
grid = [16, 9]
[accuracy.check_points]
points = "targets.csv"
observations = "target_observations.csv"
pixel_origin = "centre"
ground = "georeference"
[accuracy.check_points.columns]
point = "point"
latitude = { column = "latitude_deg", unit = "deg" }
longitude = { column = "longitude_deg", unit = "deg" }
height = { column = "height_ellipsoid_m", unit = "m", datum = "ellipsoid" }
[accuracy.check_points.observation_columns]
point = "point"
frame = "file"
column = "column"
row = "row"
"#;

fn demo_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/demo")
}

fn demo(extra: &str) -> Config {
    let text = DEMO.replace("MOUNT", MOUNT) + extra;
    Config::from_text(&demo_folder().join("demo.toml"), &text, &[]).unwrap_or_else(|e| panic!("{e}"))
}

const MOUNT: &str = r#"gimbal_pan = "-90 deg"
gimbal_elevation = "-90 deg"
antenna_in_body = { forward = "-0.3 m", right = "0 m", down = "-0.25 m" }
gimbal_in_body = { forward = "0.45 m", right = "0 m", down = "0.2 m" }
camera_in_gimbal = { forward = "0.05 m", right = "0 m", down = "0 m" }"#;

fn camera() -> Arc<Camera> {
    let brown = Brown::new([
        743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018,
    ])
    .unwrap();
    Arc::new(Camera::new(brown, 1152, 648, None).unwrap())
}

fn survey(config: &Config) -> Georeferenced {
    georeference(config.georeference.as_ref().unwrap(), &camera()).unwrap()
}

fn run(config: &Config, folder: &Path) -> Result<AccuracyNumbers, StageError> {
    let context = RunContext::new(Stage::Accuracy, folder, 5, Arc::new(NoProgress), Arc::default());
    accuracy::run(config, &survey(config), &context)
}

/// Centre of the runway's ends in one frame, from the simulator's own projection.
fn runway_in_one_frame() -> (String, [[f64; 2]; 2]) {
    let text = std::fs::read_to_string(demo_folder().join("runway_observations.csv")).unwrap();
    let rows: Vec<Vec<String>> =
        text.lines().skip(1).map(|l| l.split(',').map(str::to_owned).collect()).collect();
    let end = |name: &str, frame: &str| {
        let row = rows.iter().find(|r| r[0] == name && r[1] == frame)?;
        Some([row[2].parse::<f64>().unwrap(), row[3].parse::<f64>().unwrap()])
    };
    rows.iter()
        .find_map(|r| Some((r[1].clone(), [end("runway-end-1", &r[1])?, end("runway-end-2", &r[1])?])))
        .expect("a frame shows both ends")
}

#[test]
fn the_demo_is_as_good_as_it_claims() {
    let (frame, [a, b]) = runway_in_one_frame();
    let config = demo(&format!(
        "[accuracy.requirement]\nce90 = \"20 m\"\n[[accuracy.lengths]]\nname = \"runway length\"\ntruth = \"225 m\"\nfrom = {{ frame = \"{frame}\", column = {}, row = {} }}\nto = {{ frame = \"{frame}\", column = {}, row = {} }}\n",
        a[0], a[1], b[0], b[1]
    ));
    let folder = tempfile::tempdir().unwrap();
    let numbers = run(&config, folder.path()).unwrap();

    let length = &numbers.lengths[0];
    // Height 5 m at 357 m dominates: 3.1 m of 225 m.
    assert!((2.9..3.5).contains(&length.std_m), "{length:?}");
    assert!(length.z_score.unwrap().abs() < 3.5, "{length:?}");

    let budget = &numbers.budget;
    assert_eq!(budget.corner_fraction, 0.9, "the paper's lens has no inverse in the corners");
    assert!((budget.position_cep50_m - 3.0).abs() < 1e-9);
    assert!((3.2..3.6).contains(&budget.points[0].cep50_m), "{:?}", budget.points[0]);
    assert!(budget.points[0].linear_m > budget.points[0].quadrature_m);
    let worst = budget.points[1..].iter().map(|p| p.full_ce90_m).fold(0.0, f64::max);
    let map = numbers.map.as_ref().unwrap();
    assert!(map.ce90_median_m < map.ce90_p95_m && map.ce90_p95_m <= map.ce90_worst_m);
    assert!(map.ce90_worst_m < 1.5 * worst, "{map:?}, worst corner {worst}");
    let requirement = numbers.requirement.as_ref().unwrap();
    assert!(requirement.met && requirement.area_percent == 100.0);
    let first = &numbers.shares[0];
    assert_eq!(first.source, "antenna position");
    let sum: f64 = numbers.shares.iter().map(|s| s.centre_percent).sum();
    assert!((sum - 100.0).abs() < 1e-9);

    // The noise was drawn as stated, so the claim is honest: NEES of 2 within what correlated poses allow.
    let check = numbers.check_points.as_ref().unwrap();
    assert_eq!(check.judged_by, 1);
    let judged = &check.variants[1];
    assert!(judged.all.count >= 20, "{}", judged.all.count);
    let nees = judged.all.mean_normalised_squared.unwrap();
    assert!((0.8..4.0).contains(&nees), "mean normalised squared {nees}");
    assert!(judged.inside_claimed_ce90_percent.unwrap() > 70.0);

    let drawn = numbers.monte_carlo.as_ref().unwrap();
    assert_eq!((drawn.draws, drawn.seed, drawn.grid), (2000, 5, [16, 9]));
    assert!(drawn.first_order_difference_percent.unwrap() < 10.0);

    for file in [
        "accuracy.json",
        "frames.csv",
        "points.csv",
        "ce90.tif",
        "ce90.png",
        "frame-accuracy.svg",
        "one-degree.tif",
        "one-degree.png",
        "attitude-error-map.tif",
        "attitude-error-map.svg",
        "attitude-error-map.png",
        "residuals.svg",
    ] {
        assert!(folder.path().join("accuracy").join(file).exists(), "{file} is missing");
    }
    let read: AccuracyNumbers =
        serde_json::from_slice(&std::fs::read(folder.path().join("accuracy/accuracy.json")).unwrap())
            .unwrap();
    assert_eq!((read.format.as_str(), read.version), ("boresight-accuracy", 1));
    assert_eq!(read.frames.len(), numbers.frames.len());
    assert!((read.budget.points[4].full_ce90_m - budget.points[4].full_ce90_m).abs() < 1e-9);
}

#[test]
fn the_rasters_lie_where_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let config = demo("");
    let numbers = run(&config, folder.path()).unwrap();
    let open = |name: &str| gdal::Dataset::open(folder.path().join("accuracy").join(name)).unwrap();
    let map = open("ce90.tif");
    let t = map.geo_transform().unwrap();
    let cell = numbers.map.as_ref().unwrap().cell;
    assert_eq!((t[1], t[5]), (cell, -cell));
    assert!((t[0] / cell).fract() == 0.0 && (t[3] / cell).fract() == 0.0, "aligned to its cells: {t:?}");
    assert!(map.projection().contains("UTM zone 23S"), "{}", map.projection());
    let one_degree = open("one-degree.tif");
    assert_eq!(one_degree.raster_count(), 3);
    assert_eq!(one_degree.rasterband(1).unwrap().description().unwrap(), "north");
    // One degree of tilt at 357 m above ground moves the centre by 357 m × tan 1°.
    let (w, h) = one_degree.raster_size();
    let radial = one_degree
        .rasterband(3)
        .unwrap()
        .read_as::<f32>(((w / 2) as isize, (h / 2) as isize), (1, 1), (1, 1), None)
        .unwrap();
    assert!((radial.data()[0] - 6.24).abs() < 0.2, "{}", radial.data()[0]);
}

#[test]
fn the_same_bytes_with_one_and_two_threads() {
    let bytes = |threads: usize| {
        let folder = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&demo(""), folder.path())).unwrap();
        let read = |name: &str| std::fs::read(folder.path().join("accuracy").join(name)).unwrap();
        ["accuracy.json", "ce90.tif", "attitude-error-map.tif", "attitude-error-map.svg", "points.csv"]
            .map(read)
    };
    assert!(bytes(1) == bytes(2));
}

#[test]
fn the_page_shows_what_stands_in_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let config = demo("");
    run(&config, folder.path()).unwrap();
    let survey = survey(&config);
    let inputs = |stages: Vec<Stage>| PageInputs { title: "Demo".into(), stages, ..PageInputs::default() };
    let html =
        page(folder.path(), Some(&survey), inputs(vec![Stage::Georeference, Stage::Accuracy])).unwrap();
    let html = String::from_utf8(html).unwrap();
    for expected in
        ["Error budget, equation (11)", "Check points", "data:image/svg+xml;base64,", "Frame by frame"]
    {
        assert!(html.contains(expected), "{expected} is missing");
    }
    let bare = page(folder.path(), None, inputs(Vec::new())).unwrap();
    assert!(!String::from_utf8(bare).unwrap().contains("<h2>Accuracy"));
    // A stage whose products should be there and are not is an error, not an empty section.
    let missing = page(folder.path(), None, inputs(vec![Stage::Mosaic])).unwrap_err();
    assert!(missing.to_string().contains("mosaic.json"), "{missing}");
    if let Some(path) = std::env::var_os("BORESIGHT_DEMO_PAGE") {
        boresight::formats::atomic::write_atomic(path.as_ref(), html.as_bytes()).unwrap();
    }
}

#[test]
fn wrong_picks_and_points_are_named_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |extra: &str| run(&demo(extra), folder.path()).unwrap_err();
    let length = |frame: &str, column: f64| {
        format!(
            "[[accuracy.lengths]]\nname = \"side\"\nfrom = {{ frame = \"{frame}\", column = {column}, row = 300 }}\nto = {{ frame = \"{frame}\", column = 500, row = 300 }}\n"
        )
    };
    let error = refused(&length("IMG_9999.jpg", 400.0));
    assert!(error.to_string().contains("no frame IMG_9999.jpg") && error.place().is_some(), "{error}");
    let error = refused(&length("IMG_0001.jpg", 4000.0));
    assert!(error.to_string().contains("outside the 1152 × 648 image"), "{error}");
    let error = run(
        &Config::from_text(
            &demo_folder().join("demo.toml"),
            &DEMO.replace("MOUNT", MOUNT).replace("column = \"column\"", "column = \"x\""),
            &[],
        )
        .unwrap(),
        folder.path(),
    )
    .unwrap_err();
    assert!(error.to_string().contains("no column \"x\""), "{error}");
}
