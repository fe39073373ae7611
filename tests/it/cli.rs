//! Through the binary: exit codes, messages with their place, what goes to stdout and what to stderr, what is written.

#![expect(clippy::disallowed_methods, reason = "tests lay out inputs, not products")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder with a pipeline that runs: two grey frames over a level field, one log.
struct Project {
    folder: tempfile::TempDir,
}

const PIPELINE: &str = r#"version = 1

[run]
output = "out"

[calibrate.parameters]
image_width_px = 40
image_height_px = 30
pixel_origin = "centre"
fx_px = 40.0
fy_px = 40.0
cx_px = 19.5
cy_px = 14.5

[georeference]
images = "images"
crs = "EPSG:32617"

[georeference.log]
file = "log.csv"
join = "name"

[georeference.log.columns]
frame = "file"
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg" }
height = { column = "height", unit = "m", datum = "ellipsoid" }
yaw = { column = "yaw", unit = "deg", sense = "clockwise_from_true_north" }
pitch = { column = "pitch", unit = "deg", sense = "nose_up" }
roll = { column = "roll", unit = "deg", sense = "right_wing_down" }

[georeference.mount]
gimbal_elevation = "-90 deg"

[georeference.ground]
kind = "plane"
height = "200 m"
datum = "ellipsoid"

[mosaic]
gsd = "1 m"
preview_width_px = 64
"#;

const SIGMAS: &str = r#"
[accuracy.sigmas]
position = { std = "1 m" }
height = "1 m"
roll = "0.2 deg"
pitch = "0.2 deg"
yaw = "0.6 deg"
"#;

const LOG: &str = "file,lat,lon,height,yaw,pitch,roll\n\
                   a.png,41.0350,-83.3054,240,0,0,0\n\
                   b.png,41.0352,-83.3054,240,0,0,0\n";

impl Project {
    fn new() -> Self {
        let project = Self { folder: tempfile::tempdir().unwrap() };
        fs::create_dir(project.path("images")).unwrap();
        for (name, shade) in [("a.png", 90u8), ("b.png", 160)] {
            let frame = image::GrayImage::from_fn(40, 30, |x, y| image::Luma([shade + (x + y) as u8]));
            frame.save(project.path("images").join(name)).unwrap();
        }
        project.write("log.csv", LOG);
        project.write("p.toml", PIPELINE);
        project
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Writes the pipeline with one piece, which must stand in it once, replaced.
    fn change(&self, from: &str, to: &str) {
        assert_eq!(PIPELINE.matches(from).count(), 1, "{from:?}");
        self.write("p.toml", &PIPELINE.replace(from, to));
    }

    /// Runs the program in the project's folder.
    fn go(&self, words: &[&str]) -> Seen {
        Seen::of(program().current_dir(self.folder.path()).args(words))
    }

    /// Every file below a folder with its bytes; an absent folder has none.
    fn files(&self, folder: &str) -> BTreeMap<String, Vec<u8>> {
        let mut found = BTreeMap::new();
        let mut open = vec![self.path(folder)];
        while let Some(at) = open.pop() {
            for entry in fs::read_dir(at).into_iter().flatten() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    open.push(path);
                } else {
                    let name = path.strip_prefix(self.path(folder)).unwrap().to_string_lossy().into_owned();
                    found.insert(name, fs::read(&path).unwrap());
                }
            }
        }
        found
    }
}

fn program() -> Command {
    let mut program = Command::new(env!("CARGO_BIN_EXE_boresight"));
    program.env_remove("NO_COLOR");
    program
}

struct Seen {
    code: i32,
    stdout: String,
    stderr: String,
}

impl Seen {
    fn of(command: &mut Command) -> Self {
        let Output { status, stdout, stderr } = command.output().unwrap();
        Self {
            code: status.code().unwrap(),
            stdout: String::from_utf8(stdout).unwrap(),
            stderr: String::from_utf8(stderr).unwrap(),
        }
    }

    /// The program ended with `code` and said each of `pieces` on stderr.
    #[track_caller]
    fn failed(&self, code: i32, pieces: &[&str]) {
        assert_eq!(self.code, code, "stderr:\n{}", self.stderr);
        for piece in pieces {
            assert!(self.stderr.contains(piece), "{piece:?} is not in:\n{}", self.stderr);
        }
    }

    #[track_caller]
    fn done(&self) -> &Self {
        assert_eq!(self.code, 0, "stderr:\n{}", self.stderr);
        self
    }
}

fn line_of(text: &str, piece: &str) -> usize {
    1 + text.lines().position(|line| line.contains(piece)).unwrap()
}

#[test]
fn help_documents_commands_and_exit_codes() {
    let help = Seen::of(program().arg("--help"));
    help.done();
    for word in ["run", "check", "locate", "explain", "simulate", "schema", "completions", "130  interrupted"]
    {
        assert!(help.stdout.contains(word), "{word}");
    }
    Seen::of(program().arg("rnu")).failed(2, &["unrecognized subcommand", "rnu"]);
    Seen::of(&mut program()).failed(2, &["Usage"]);
}

#[test]
fn a_wrong_pipeline_file_exits_3_and_shows_the_line() {
    let project = Project::new();
    let cases: [(&str, &str, &[&str]); 6] = [
        ("gsd = \"1 m\"", "gds = \"1 m\"", &["unknown key `gds`", "^^^", "did you mean `gsd`?"]),
        ("fx_px = 40.0", "fx_px = \"wide\"", &["invalid type: string \"wide\", expected a number"]),
        ("height = \"200 m\"", "height = 200", &["length 200 has no unit", "write \"200 m\""]),
        ("height = \"200 m\"", "height = \"200 q\"", &["unknown unit \"q\"", "m, mm, cm, km, ft, inch"]),
        (", datum = \"ellipsoid\" }", " }", &["missing key `datum`"]),
        ("gimbal_elevation = \"-90 deg\"", "", &["does not say where the camera looks", "gimbal_elevation"]),
    ];
    for (from, to, pieces) in cases {
        project.change(from, to);
        let seen = project.go(&["check", "p.toml"]);
        seen.failed(3, pieces);
        assert!(seen.stderr.contains("error[pipeline]"), "{}", seen.stderr);
        let text = fs::read_to_string(project.path("p.toml")).unwrap();
        let at = if to.is_empty() { "[georeference.mount]" } else { to.split(" }").next().unwrap() };
        let line = if to == " }" { line_of(&text, "column = \"height\"") } else { line_of(&text, at) };
        assert!(seen.stderr.contains(&format!("p.toml:{line}:")), "line {line}:\n{}", seen.stderr);
    }
    project.go(&["check", "nowhere.toml"]).failed(3, &["nowhere.toml: cannot be read"]);
    assert!(project.files("out").is_empty());
}

#[test]
fn overrides_reach_the_run_and_their_errors_name_them() {
    let project = Project::new();
    project.go(&["check", "p.toml", "--set", "mosaic.gsd=2 m"]).done();
    let small = project.go(&["check", "p.toml", "--set", "mosaic.gsd=2 m", "--json"]).done().stdout.clone();
    let found: serde_json::Value = serde_json::from_str(&small).unwrap();
    assert_eq!(found["mosaic"]["gsd_m"], 2.0);
    project
        .go(&["check", "p.toml", "--set", "mosaic.gsd=2 parsec"])
        .failed(3, &["unknown unit \"parsec\"", "--set:1:12", "mosaic.gsd=2 parsec"]);
    project.go(&["check", "p.toml", "--set", "mosaic.gdd=2"]).failed(3, &["unknown key `gdd`", "--set"]);
}

#[test]
fn check_lists_what_would_be_used_and_writes_nothing() {
    let project = Project::new();
    project.write("log.csv", &LOG.replace("b.png", "c.png"));
    let seen = project.go(&["check", "p.toml"]);
    seen.failed(5, &["1 frames would be rejected", "max_rejected_frames = 1"]);
    assert!(seen.stdout.contains("1 of 2 would be used"), "{}", seen.stdout);
    assert!(seen.stdout.contains("rejected  b.png: no row of log.csv names it"), "{}", seen.stdout);
    assert!(seen.stdout.contains("georeference.images = images (2 files"), "{}", seen.stdout);
    project.go(&["check", "p.toml", "--set", "run.max_rejected_frames=any"]).done();
    assert!(!project.path("out").exists());
}

#[test]
fn check_says_what_is_wrong_with_a_flight() {
    let project = Project::new();
    let json = |words: &[&str], code: i32| -> serde_json::Value {
        let seen = project.go(words);
        assert_eq!(seen.code, code, "{}", seen.stderr);
        serde_json::from_str(&seen.stdout).unwrap()
    };
    let flight = json(&["check", "p.toml", "--json"], 0)["flight"].clone();
    assert_eq!(flight["format"], "boresight/check/1");
    // 40 x 30 px at 1 m: 22.2 m apart, 30 m long.
    let forward = flight["overlap"]["forward_median"].as_f64().unwrap();
    assert!((forward - 7.8 / 30.0).abs() < 0.03, "{flight}");
    assert_eq!(flight["findings"][0]["code"], "exposure-time-unknown");
    assert_eq!(flight["findings"].as_array().unwrap().len(), 1, "{flight}");
    let table = project.go(&["check", "p.toml", "--frames"]).done().stdout.clone();
    assert!(table.contains("\nframe  status  gsd_m   height_m"), "{table}");
    assert!(table.contains("\na.png  used    1.0000  40.0"), "{table}");
    assert!(!table.contains("sharpness"), "{table}");
    // One of two cameras below the ground is an error, whatever the run would put up with.
    project.write("log.csv", &LOG.replace("-83.3054,240,0,0,0\nb", "-83.3054,100,0,0,0\nb"));
    let any = ["check", "p.toml", "--set", "run.max_rejected_frames=any", "--json"];
    let found = json(&any, 5)["flight"]["findings"][0].clone();
    assert_eq!((&found["code"], &found["severity"]), (&"camera-below-ground".into(), &"error".into()));
    assert_eq!(found["frames"], serde_json::json!(["a.png"]));
    assert!(found["text"].as_str().unwrap().contains("the camera is 100.0 m below the ground"), "{found}");
}

#[test]
fn check_draws_the_coverage_only_where_it_is_told_to() {
    let project = Project::new();
    let before = project.files("");
    let draw = |file: &str| project.go(&["check", "p.toml", "--picture", file]);
    draw("map.svg").done();
    draw("map.png").done();
    let mut after = project.files("");
    let svg = after.remove("map.svg").unwrap();
    assert!(String::from_utf8(svg).unwrap().contains("p: how often the ground is seen"));
    assert!(after.remove("map.png").unwrap().starts_with(b"\x89PNG"));
    assert_eq!(after, before);
    draw("map.svg").failed(2, &["map.svg exists", "--force"]);
    project.go(&["check", "p.toml", "--picture", "map.svg", "--force"]).done();
    draw("map.jpg").failed(2, &["is written as .svg or .png"]);
}

#[test]
fn missing_inputs_exit_4_at_the_line_that_names_them() {
    let project = Project::new();
    project.change("images = \"images\"", "images = \"pictures\"");
    let line = line_of(PIPELINE, "images = ");
    for command in ["check", "run"] {
        project
            .go(&[command, "p.toml"])
            .failed(4, &["error[input]", "pictures", "does not exist", &format!("p.toml:{line}:10")]);
    }
    project.change("\"lat\"", "\"latt\"");
    let line = line_of(PIPELINE, "\"lat\"");
    project.go(&["check", "p.toml"]).failed(
        4,
        &[
            "log.csv has no column \"latt\"".replace(" has", ": has").as_str(),
            "did you mean \"lat\"?",
            &format!("p.toml:{line}:"),
        ],
    );
    project.write("p.toml", PIPELINE);
    project.write("log.csv", &LOG.replace("41.0350", "91.0350").replace("41.0352", "nan"));
    project.go(&["check", "p.toml"]).failed(4, &["log.csv"]);
}

#[test]
fn absent_data_that_the_pipeline_declares_is_a_skip() {
    let project = Project::new();
    project.change(
        "output = \"out\"",
        "output = \"out\"\nrequires = [{ path = \"survey\", hint = \"the big survey\" }]",
    );
    for command in [&["run", "p.toml"][..], &["check", "p.toml"], &["run", "p.toml", "--dry-run"]] {
        let seen = project.go(command);
        assert!(seen.done().stdout.starts_with("skipped: the big survey ("), "{}", seen.stdout);
    }
    assert!(!project.path("out").exists());
}

#[test]
fn a_run_says_where_its_products_are() {
    let project = Project::new();
    let seen = project.go(&["run", "p.toml", "--until", "mosaic"]);
    seen.done();
    assert!(seen.stdout.contains("mosaic    out/mosaic/mosaic.tif"), "{}", seen.stdout);
    assert!(seen.stdout.contains("folder    out\n"), "{}", seen.stdout);
    assert!(seen.stderr.contains("georeference: done in"), "{}", seen.stderr);
    let files = project.files("out");
    for name in [
        "mosaic/mosaic.tif",
        "mosaic/preview.png",
        "georeference/frames.csv",
        "manifest.json",
        "timings.json",
        "resolved.toml",
    ] {
        assert!(files.contains_key(name), "{name}");
    }
    let manifest: serde_json::Value = serde_json::from_slice(&files["manifest.json"]).unwrap();
    assert_eq!(manifest["frames"]["a.png"]["status"], "used");
    assert_eq!(manifest["stages"]["mosaic"]["status"], "done");
    let bytes = fs::read(project.path("images/a.png")).unwrap();
    let inputs = manifest["stages"]["georeference"]["inputs"].as_array().unwrap();
    let entry = inputs.iter().find(|input| input["path"] == "images/a.png").unwrap();
    assert_eq!(entry["blake3"], blake3::hash(&bytes).to_hex().to_string());
    let quiet = project.go(&["run", "p.toml", "--until", "mosaic", "--quiet"]);
    assert_eq!(quiet.done().stderr, "");
}

#[test]
fn the_number_of_threads_does_not_change_a_byte() {
    let project = Project::new();
    project.write("p.toml", &format!("{PIPELINE}{SIGMAS}[accuracy.monte_carlo]\ndraws = 500\n"));
    for jobs in ["1", "2"] {
        project.go(&["run", "p.toml", "--jobs", jobs, "--output", jobs]).done();
    }
    let [mut one, mut two] = ["1", "2"].map(|folder| project.files(folder));
    for files in [&mut one, &mut two] {
        files.remove("timings.json").unwrap();
    }
    assert_eq!(one.keys().collect::<Vec<_>>(), two.keys().collect::<Vec<_>>());
    assert!(one.contains_key("index.html") && one.contains_key("accuracy/accuracy.json"));
    for (name, bytes) in &one {
        assert!(two[name] == *bytes, "{name} differs");
    }
}

#[test]
fn too_many_rejected_frames_exit_5_with_the_products_made() {
    let project = Project::new();
    project.write("images/b.png", "not a picture");
    let seen = project.go(&["run", "p.toml", "--until", "mosaic"]);
    seen.failed(5, &["error[limits]", "1 of 2 frames were rejected", "b.png"]);
    assert!(project.path("out/mosaic/mosaic.tif").exists());
    assert!(seen.stdout.contains("rejected  b.png"), "{}", seen.stdout);
    project.go(&["run", "p.toml", "--until", "mosaic", "--set", "run.max_rejected_frames=1"]).done();
}

#[test]
fn a_folder_that_is_not_the_run_s_own_is_left_alone() {
    let project = Project::new();
    fs::create_dir(project.path("out")).unwrap();
    project.write("out/thesis.txt", "x");
    let run = ["run", "p.toml", "--until", "georeference"];
    project.go(&run).failed(2, &["holds files that are not of a run", "--force", "p.toml:4:10"]);
    assert_eq!(project.files("out").len(), 1);
    project.go(&[&run[..], &["--force"]].concat()).done();
    assert!(project.path("out/thesis.txt").exists());
    project.write("q.toml", PIPELINE);
    project.go(&["run", "q.toml"]).failed(2, &["made from another pipeline, p.toml"]);
}

#[test]
fn a_folder_that_cannot_be_made_exits_6() {
    let project = Project::new();
    project
        .go(&["run", "p.toml", "--output", "log.csv/out"])
        .failed(6, &["error[io]", "log.csv/out", "--output DIR"]);
}

#[test]
fn one_stage_alone_needs_its_predecessors() {
    let project = Project::new();
    let only = ["run", "p.toml", "--only", "mosaic"];
    project.go(&only).failed(
        2,
        &["products of calibrate are not in the run folder", "boresight run p.toml --until calibrate"],
    );
    project.go(&["run", "p.toml", "--until", "georeference"]).done();
    let seen = project.go(&only);
    assert!(seen.done().stderr.contains("using the products of an earlier run"), "{}", seen.stderr);
    let changed = [&only[..], &["--set", "georeference.mount.gimbal_elevation=-80 deg"]].concat();
    project.go(&changed).failed(2, &["products of georeference were made with other settings"]);
    project.go(&["run", "p.toml", "--only", "accuracy"]).failed(2, &["p.toml has no table [accuracy]"]);
}

#[test]
fn a_failed_run_leaves_the_older_products() {
    let project = Project::new();
    project.go(&["run", "p.toml", "--until", "mosaic"]).done();
    let before = project.files("out");
    project.write("log.csv", "file,lat\n");
    project.go(&["run", "p.toml", "--until", "mosaic"]).failed(4, &["log.csv"]);
    let after = project.files("out");
    assert_eq!(before["mosaic/mosaic.tif"], after["mosaic/mosaic.tif"]);
    assert_eq!(before["georeference/frames.csv"], after["georeference/frames.csv"]);
}

#[test]
fn a_dry_run_prints_the_plan_and_writes_nothing() {
    let project = Project::new();
    let seen = project.go(&["run", "p.toml", "--dry-run"]);
    for line in [
        "run       calibrate",
        "run       mosaic",
        "input     georeference.log.file = log.csv",
        "before compression",
    ] {
        assert!(seen.done().stdout.contains(line), "{line}:\n{}", seen.stdout);
    }
    let json = project.go(&["run", "p.toml", "--dry-run", "--json"]);
    let plan: serde_json::Value = serde_json::from_str(&json.done().stdout).unwrap();
    assert_eq!(plan["stages"][0]["stage"], "calibrate");
    assert!(!project.path("out").exists());
}

#[test]
fn locate_answers_one_pixel() {
    let project = Project::new();
    project.write("p.toml", &format!("{PIPELINE}{SIGMAS}"));
    let seen = project.go(&["locate", "p.toml", "a.png", "19.5", "14.5", "--json"]);
    let found: serde_json::Value = serde_json::from_str(&seen.done().stdout).unwrap();
    // The image centre of a camera that looks straight down lies under the antenna.
    assert!((found["latitude_deg"].as_f64().unwrap() - 41.0350).abs() < 1e-9);
    assert!((found["longitude_deg"].as_f64().unwrap() + 83.3054).abs() < 1e-9);
    assert!((found["height_ellipsoid_m"].as_f64().unwrap() - 200.0).abs() < 1e-6);
    // 1 m of position and 40 m times 0.2 degrees of roll and pitch: 1.0097 m on each axis.
    assert!((found["ellipse_semi_major_m"].as_f64().unwrap() - 1.0097).abs() < 1e-3);
    assert!((found["ce90_m"].as_f64().unwrap() - 2.1460 * 1.0097).abs() < 2e-3);
    project
        .go(&["locate", "p.toml", "A.png", "1", "1"])
        .failed(2, &["no frame A.png", "did you mean a.png?"]);
    let outside = project.go(&["locate", "p.toml", "a.png", "-1", "1"]);
    outside.failed(4, &["1 of 1 pixels have no answer"]);
    assert!(outside.stdout.contains("lies outside the 40 × 30 image"), "{}", outside.stdout);
}

#[test]
fn locate_answers_many_pixels_row_by_row() {
    let project = Project::new();
    project.write("q.csv", "frame,column,row,height_m\na.png,39,14.5,200\na.png,39,14.5,220\nz.png,1,1,\nb.png,nan,1,\nb.png,1,1,\n");
    let words = ["locate", "p.toml", "--pixels", "q.csv"];
    // Heights count from what the pipeline's ground counts from.
    let seen = project.go(&words);
    assert_eq!(seen.stdout, project.go(&[&words[..], &["--height-datum", "ellipsoid"]].concat()).stdout);
    seen.failed(4, &["2 of 5 pixels have no answer", "no [accuracy.sigmas]"]);
    let rows: Vec<_> = csv::Reader::from_reader(seen.stdout.as_bytes())
        .deserialize::<BTreeMap<String, String>>()
        .map(Result::unwrap)
        .collect();
    assert_eq!(rows.len(), 5);
    let east = |row: usize| rows[row]["easting"].parse::<f64>().unwrap();
    // 19.5 pixels of f = 40 from 40 m and from 20 m: 19.5 m and 9.75 m to the east of the antenna.
    assert!((east(0) - east(1) - 9.75).abs() < 0.02, "{} {}", east(0), east(1));
    assert_eq!(rows[0]["ce90_m"], "");
    assert!(rows[2]["error"].contains("no frame z.png"));
    assert!(rows[3]["error"].contains("line 5: column is NaN"), "{}", rows[3]["error"]);
    assert_eq!(rows[4]["error"], "");
    let seen = project.go(&[&words[..], &["--height-datum", "egm96", "--json"]].concat());
    assert_eq!(seen.stdout.lines().count(), 5);
    for line in seen.stdout.lines() {
        serde_json::from_str::<serde_json::Value>(line).unwrap();
    }
}

#[test]
fn explain_writes_the_chain_down() {
    let project = Project::new();
    let text = project.go(&["explain", "p.toml", "a.png"]);
    for word in ["nav_from_body", "camera_in_ecef", "deg", "metres"] {
        assert!(text.done().stdout.contains(word), "{word}");
    }
    let json = project.go(&["explain", "p.toml", "a.png", "--json"]);
    let chain: serde_json::Value = serde_json::from_str(&json.done().stdout).unwrap();
    assert_eq!(chain["frame"], "a.png");
    project.go(&["explain", "p.toml", "c.png"]).failed(2, &["no frame c.png"]);
}

#[test]
fn json_logs_are_one_object_per_line() {
    let project = Project::new();
    let seen = project.go(&["--log", "json", "run", "p.toml", "--until", "mosaic", "--json"]);
    let objects: Vec<serde_json::Value> =
        seen.done().stderr.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(objects.iter().any(|object| object["stage"] == "mosaic"), "{}", seen.stderr);
    let outcome: serde_json::Value = serde_json::from_str(&seen.stdout).unwrap();
    assert_eq!(outcome["outcome"], "finished");
    assert_eq!(outcome["frames"], 2);
    let seen = project.go(&["--log", "json", "check", "p.toml", "--set", "mosaic.gsd=1"]);
    let error: serde_json::Value = serde_json::from_str(&seen.stderr).unwrap();
    assert_eq!((seen.code, error["class"].as_str()), (3, Some("pipeline")));
    assert_eq!((error["exit_code"].as_i64(), error["column"].as_i64()), (Some(3), Some(12)));
}

#[test]
fn colours_are_used_only_when_asked_for_off_a_terminal() {
    let project = Project::new();
    let wrong = ["check", "p.toml", "--set", "mosaic.gsd=1"];
    assert!(!project.go(&wrong).stderr.contains('\u{1b}'));
    assert!(project.go(&[&wrong[..], &["--color", "always"]].concat()).stderr.contains('\u{1b}'));
}

#[test]
fn simulate_makes_a_survey_and_its_refusals_are_clear() {
    let project = Project::new();
    project.write("tiny.toml", "[flight]\nstrips = 1\nframes_per_strip = 1\n[calibration]\nviews = 0\n");
    let small = [
        "--set",
        "camera.width_px=96",
        "--set",
        "camera.height_px=54",
        "--set",
        "camera.fx_px=62",
        "--set",
        "camera.fy_px=62",
        "--set",
        "camera.cx_px=48",
        "--set",
        "camera.cy_px=27",
    ];
    let words = [&["simulate", "tiny.toml", "--output", "survey", "--json"][..], &small].concat();
    let seen = project.go(&words);
    let written: serde_json::Value = serde_json::from_str(&seen.done().stdout).unwrap();
    assert_eq!(written["frames"], 1);
    assert!(project.path("survey/images/IMG_0001.jpg").exists());
    project.go(&words).failed(2, &["already holds a survey", "--force"]);
    project.go(&[&words[..], &["--force"]].concat()).done();
    project
        .go(&["simulate", "tiny.toml", "--output", "s2", "--set", "flight.stripes=2"])
        .failed(3, &["unknown key `stripes`", "did you mean `strips`?"]);
    assert!(!project.path("s2").exists());
}

#[test]
fn target_writes_a_sheet_and_the_table_that_declares_it() {
    let project = Project::new();
    let squares =
        ["target", "squares", "--rows", "7", "--columns", "7", "--square", "15.7 mm", "--gap", "15.7 mm"];
    let seen = project.go(&[&squares[..], &["-o", "sheet.pdf"]].concat());
    let table = seen.done().stdout.clone();
    assert!(fs::read(project.path("sheet.pdf")).unwrap().starts_with(b"%PDF-1."));
    // The table is what a pipeline takes.
    let pipeline = format!("version = 1\n[calibrate]\nphotos = \"*.png\"\n{table}");
    boresight::config::Config::from_text(Path::new("p.toml"), &pipeline, &[]).unwrap();
    project.go(&[&squares[..], &["-o", "sheet.pdf"]].concat()).failed(2, &["sheet.pdf exists", "--force"]);
    project.go(&[&squares[..], &["-o", "sheet.png"]].concat()).failed(2, &[".pdf or .svg"]);
    project
        .go(&[&squares[..], &["-o", "small.svg", "--paper", "a5"]].concat())
        .failed(2, &["more than A5", "--paper"]);
    project
        .go(&[&squares[..], &["-o", "other.svg", "--tag", "1 cm"]].concat())
        .failed(2, &["`tag` would not be used", "square, gap, hollow"]);
    assert!(!project.path("small.svg").exists() && !project.path("other.svg").exists());
}

#[test]
fn completions_and_schema_are_printed() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let seen = Seen::of(program().args(["completions", shell]));
        assert!(seen.done().stdout.contains("boresight"), "{shell}");
    }
    let schema = Seen::of(program().arg("schema"));
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/boresight.schema.json");
    let committed = fs::read_to_string(committed).unwrap_or_default();
    assert!(
        schema.done().stdout == committed,
        "pipelines/boresight.schema.json is not fresh: run `make schema`"
    );
}

#[test]
fn every_pipeline_of_the_project_is_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let mut seen = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            if let Err(error) = boresight::config::Config::load(&path, &[]) {
                panic!("{}", error.diagnostic().render("pipeline", &[], false));
            }
            seen += 1;
        }
    }
    assert!(seen > 0, "there are no pipelines");
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    use std::process::Stdio;
    let mut child = program().arg("schema").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}
