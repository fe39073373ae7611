//! What is accepted, what is refused, and whether the refusal points at the right place with the right words.

use super::accuracy::CheckPosition;
use super::calibrate::LensChoice;
use super::georeference::{Crs, GimbalAngle, GimbalReference, Ground, HeightAboveGround};
use super::height::{HeightDatum, VerticalDatum};
use super::log::columns::{PositionColumns, YawReference};
use super::log::{AngleSystem, FrameTimes, Join, LogFormat, LogSource, StatedClock};
use super::target::{HollowSquare, Pattern};
use super::*;
use crate::units::Radians;

/// A pipeline that uses nearly every table.
const FULL: &str = r#"version = 1

[run]
output = "../out/demo"
seed = 7
max_rejected_frames = "any"
[[run.requires]]
path = "data"
hint = "the survey"

[calibrate]
photos = ["calibration/*.png", "more/*.png"]
[calibrate.target]
kind = "squares"
rows = 7
columns = 7
square = "15.7 mm"
gap = "15.7 mm"
hollow = "upper_left"

[georeference]
images = "images"
crs = "EPSG:32617"
products = ["orthos"]
[georeference.log]
file = "log.csv"
join = "name"
takeoff_height = { value = "251 m", datum = "egm96" }
[georeference.log.columns]
frame = "file"
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg_e7" }
height = { column = "rel", unit = "ft", datum = "above_takeoff" }
yaw = { column = "hdg", unit = "deg", sense = "counterclockwise_from_east" }
pitch = { column = "pit", unit = "deg", sense = "nose_down" }
roll = { column = "rol", unit = "rad", sense = "right_wing_down" }
ground_speed = { column = "gs", unit = "kn" }
[georeference.mount]
antenna_in_body = { forward = "10 cm", down = "-5 cm" }
gimbal_tilt_down = "90 deg"
gimbal_pan = "-90 deg"
boresight = { yaw = "-2.5 deg", pitch = "-2.3 deg", roll = "3.6 deg" }
pixel_rotation = "180"
[georeference.ground]
kind = "dem"
file = "dem.tif"
datum = "egm96"
fallback_height = "254 m"

[mosaic]
gsd = "20 cm"
compression = "jpeg"
memory = "1 GiB"
bounds = { west = 0.0, south = 1.0, east = 2.0, north = 3.0 }

[accuracy.sigmas]
position = { cep = "3 m" }
height = "5 m"
roll = "0.2 deg"
pitch = "0.2 deg"
yaw = "0.6 deg"
time = "20 ms"
[accuracy.monte_carlo]
angle = "yaw"
[[accuracy.lengths]]
name = "runway"
from = { frame = "a.jpg", column = 1, row = 2.5 }
to = { frame = "b.jpg", column = 3, row = 4 }
truth = "225 m"
[accuracy.check_points]
points = "p.csv"
observations = "o.csv"
pixel_origin = "corner"
crs = "EPSG:32617"
[accuracy.check_points.columns]
point = "point"
easting = { column = "e", unit = "m" }
northing = { column = "n", unit = "m" }
height = { column = "h", unit = "m", datum = "egm96" }
[accuracy.check_points.observation_columns]
point = "point"
frame = "file"
column = "x"
row = "y"
"#;

/// The shortest pipeline that georeferences.
const SHORT: &str = r#"version = 1
[calibrate]
camera = "camera.json"
[georeference]
images = "images"
[georeference.log]
file = "log.csv"
join = "name"
[georeference.log.columns]
frame = "file"
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg" }
height = { column = "h", unit = "m", datum = "ellipsoid" }
yaw = { column = "yaw", unit = "deg", sense = "clockwise_from_true_north" }
pitch = { column = "pitch", unit = "deg", sense = "nose_up" }
roll = { column = "roll", unit = "deg", sense = "right_wing_down" }
[georeference.mount]
gimbal_elevation = "-90 deg"
[georeference.ground]
kind = "plane"
height = "254.4 m"
datum = "egm96"
"#;

fn read(text: &str) -> Result<Config, ConfigError> {
    Config::from_text(Path::new("pipelines/p.toml"), text, &[])
}

fn read_with(text: &str, overrides: &[&str]) -> Result<Config, ConfigError> {
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    Config::from_text(Path::new("p.toml"), text, &overrides)
}

/// `text` with one piece replaced; the piece must be there.
fn changed(text: &str, from: &str, to: &str) -> String {
    assert_eq!(text.matches(from).count(), 1, "{from:?} must stand once in the base text");
    text.replace(from, to)
}

/// Where the refused text stands (line, column), the message and the help.
fn refused(text: &str) -> (usize, usize, String, String) {
    let error = read(text).expect_err("must be refused");
    let diagnostic = error.diagnostic();
    let place = diagnostic.place.as_ref().expect("has a place");
    let (line, column) = place.source.line_and_column(&place.span);
    (line, column, diagnostic.message.clone(), diagnostic.help.join(" | "))
}

/// The line (from 1) that contains `piece`.
fn line_of(text: &str, piece: &str) -> usize {
    1 + text.lines().position(|line| line.contains(piece)).expect("the piece is in the text")
}

#[track_caller]
fn assert_refused(text: &str, at: &str, message: &str, help: &str) {
    let (line, _, said, helped) = refused(text);
    assert!(said.contains(message), "message: {said}");
    assert!(helped.contains(help), "help: {helped}");
    assert_eq!(line, line_of(text, at), "pointed at line {line}: {said}");
}

#[test]
fn a_target_takes_the_keys_of_its_kind() {
    let with = |target: &str| {
        format!("version = 1\n[calibrate]\nphotos = \"*.png\"\n[calibrate.target]\n{target}\n")
    };
    let board = "kind = \"chessboard\"\nsquare = \"30 mm\"";
    let config = read(&with(board)).unwrap();
    let CameraSource::Photos(photos) = config.calibrate.camera else { panic!("photos") };
    assert_eq!(photos.target.pattern, Pattern::Chessboard { square_m: 0.03 });
    assert_eq!(photos.target.size, None, "counted when not given");
    assert_eq!(photos.model.lens, LensChoice::Auto);
    assert_refused(&with(&format!("{board}\nrows = 6")), "rows = 6", "give both `rows` and `columns`", "");
    assert_refused(
        &with(&format!("{board}\nrows = 1\ncolumns = 9")),
        "rows = 1",
        "2 or more rows of inner corners, not 1",
        "",
    );
    assert_refused(
        &with(&format!("{board}\ngap = \"1 cm\"")),
        "gap",
        "`gap` would not be used: chessboard takes square",
        "",
    );
    assert_refused(
        &with("kind = \"circles\"\nspacing = \"2 cm\""),
        "[calibrate.target]",
        "needs `diameter`",
        "",
    );
    assert_refused(&with("kind = \"chessboard\"\nsquare = \"0 mm\""), "square = ", "must be above 0", "");
    let model = format!("{}[calibrate.model]\naspect = -1.0\n", with(board));
    assert_refused(&model, "[calibrate.model]", "`aspect` is -1; it must be above 0", "");
}

#[test]
fn a_full_pipeline_is_resolved_to_si_units_and_paths_from_its_folder() {
    let config = read(FULL).unwrap();
    assert_eq!(config.run.output.value, Path::new("pipelines/../out/demo"));
    assert_eq!(config.run.requires[0].path.value, Path::new("pipelines/data"));
    let CameraSource::Photos(photos) = &config.calibrate.camera else { panic!("photos") };
    assert_eq!(photos.patterns.value, ["calibration/*.png", "more/*.png"]);
    let Pattern::Squares { square_m, hollow, .. } = photos.target.pattern else { panic!("squares") };
    assert_eq!((square_m, hollow, photos.target.size), (0.0157, HollowSquare::UpperLeft, Some((7, 7))));
    let georeference = config.georeference.as_ref().unwrap();
    assert_eq!(georeference.crs.value, Crs::Given("EPSG:32617".into()));
    assert!(georeference.orthos);
    let table = georeference.log.as_table().unwrap();
    let PositionColumns::Geodetic { longitude, height, .. } = &table.position else { panic!("geodetic") };
    assert!((longitude.factor - 1e-7 * std::f64::consts::PI / 180.0).abs() < 1e-24);
    assert_eq!(height.column.factor, 0.3048);
    assert_eq!(height.datum, HeightDatum::AboveTakeoff);
    let takeoff = georeference.log.takeoff.unwrap();
    assert_eq!((takeoff.metres, takeoff.datum), (251.0, VerticalDatum::Egm96));
    let attitude = table.attitude.as_ref().unwrap();
    assert!((attitude.yaw.clockwise(30.0) - std::f64::consts::FRAC_PI_3).abs() < 1e-12);
    assert_eq!(attitude.yaw.reference(), YawReference::TrueNorth);
    assert!(attitude.pitch.factor < 0.0);
    assert_eq!(attitude.roll.factor, 1.0);
    let mount = &georeference.mount;
    assert_eq!((mount.antenna_in_body.forward_m, mount.antenna_in_body.down_m), (0.1, -0.05));
    let GimbalAngle::Fixed(elevation) = mount.elevation else { panic!("fixed") };
    assert_eq!(elevation, -std::f64::consts::FRAC_PI_2);
    let Ground::Dem { fallback_m, .. } = &georeference.ground else { panic!("dem") };
    assert_eq!(*fallback_m, Some(254.0));
    let mosaic = config.mosaic.as_ref().unwrap();
    assert_eq!(mosaic.gsd_m.as_ref().unwrap().value, 0.2);
    assert_eq!(mosaic.memory_bytes.value, 1 << 30);
    assert_eq!(mosaic.quality, 90);
    let accuracy = config.accuracy.as_ref().unwrap();
    // CEP = 1.17741 sigma of a circular normal distribution.
    assert!((accuracy.sigmas.position_m - 2.548).abs() < 5e-4);
    assert_eq!(accuracy.confidence, 0.95);
    assert_eq!(accuracy.lengths[0].truth_m, Some(225.0));
    let CheckPosition::Projected { easting, .. } = &accuracy.check_points.as_ref().unwrap().position else {
        panic!("projected")
    };
    assert_eq!(easting.column.value, "e");
}

#[test]
fn resolved_toml_reads_back_as_the_same_pipeline() {
    for text in [FULL, SHORT] {
        let first = read(text).unwrap();
        let again = read(&first.resolved_toml()).unwrap();
        assert_eq!(again.resolved_toml(), first.resolved_toml());
        assert_eq!(
            format!("{:?}", again.mosaic.as_ref().map(|m| m.quality)),
            format!("{:?}", first.mosaic.as_ref().map(|m| m.quality))
        );
    }
    let resolved = read(&format!("{SHORT}[mosaic]\n")).unwrap().resolved_toml();
    for line in ["memory = \"768 MiB\"", "crs = \"auto\"", "gimbal_reference = \"body\"", "delimiter = \",\""]
    {
        assert!(resolved.contains(line), "{line} is not in\n{resolved}");
    }
}

#[test]
fn an_unknown_key_is_refused_at_its_place_with_the_nearest_one() {
    let text = changed(FULL, "gsd = \"20 cm\"", "gds = \"20 cm\"");
    let (line, column, message, help) = refused(&text);
    assert_eq!((line, column), (line_of(&text, "gds ="), 1));
    assert_eq!(message, "unknown key `gds`");
    assert!(help.contains("did you mean `gsd`?"), "{help}");
    let text = changed(FULL, "datum = \"above_takeoff\"", "dautm = \"above_takeoff\"");
    let (line, column, _, help) = refused(&text);
    assert_eq!(line, line_of(&text, "dautm"));
    assert_eq!(column, 1 + text.lines().nth(line - 1).unwrap().find("dautm").unwrap());
    assert!(help.contains("did you mean `datum`?"), "{help}");
}

#[test]
fn an_unknown_table_is_refused_at_its_header() {
    assert_refused(
        &format!("{SHORT}[mosiac]\n"),
        "[mosiac]",
        "unknown key `mosiac`",
        "did you mean `mosaic`?",
    );
}

#[test]
fn values_are_refused_in_plain_words() {
    let full = |from: &str, to: &str| changed(FULL, from, to);
    assert_refused(&full("seed = 7", "seed = \"x\""), "seed", "expected a whole number", "");
    assert_refused(&full("seed = 7", "seed = -1"), "seed", "-1", "");
    assert_refused(
        &full("square = \"15.7 mm\"", "square = 15.7"),
        "square =",
        "length 15.7 has no unit",
        "write \"15.7 m\"",
    );
    assert_refused(&full("gsd = \"20 cm\"", "gsd = 0.2"), "gsd", "length 0.2 has no unit", "write \"0.2 m\"");
    assert_refused(
        &full("gsd = \"20 cm\"", "gsd = \"20 parsec\""),
        "gsd",
        "unknown unit \"parsec\"",
        "m, mm, cm",
    );
    assert_refused(&full("gsd = \"20 cm\"", "gsd = \"0 m\""), "gsd", "must be above 0", "");
    assert_refused(&full("memory = \"1 GiB\"", "memory = \"nan GiB\""), "memory", "not a finite number", "");
    assert_refused(
        &full("\"nose_down\"", "\"nose_dwon\""),
        "nose_dwon",
        "unknown value \"nose_dwon\"",
        "did you mean `nose_down`?",
    );
    assert_refused(
        &full("max_rejected_frames = \"any\"", "max_rejected_frames = -2"),
        "max_rejected",
        "-2",
        "",
    );
    assert_refused(&full("images = \"images\"", "images = 3"), "images =", "expected a path", "");
    assert_refused(
        &full("[mosaic]", "[[mosaic]]"),
        "[[mosaic]]",
        "`mosaic` is a list; expected a table",
        "single brackets",
    );
    assert_refused(
        &full("{ cep = \"3 m\" }", "[\"3 m\"]"),
        "position =",
        "`position` is a list; expected a table",
        "braces",
    );
    assert_refused(&full("rows = 7", "rows = 1"), "rows", "2 or more rows", "");
    assert_refused(&full("west = 0.0", "west = 9.0"), "west", "hold no area", "west < east");
    assert_refused(&full("images = \"images\"", "images = \"\""), "images", "the path is empty", "");
}

#[test]
fn broken_toml_is_refused_at_its_place() {
    let text = changed(FULL, "seed = 7", "seed = = 7");
    let (line, column, ..) = refused(&text);
    assert_eq!((line, column), (line_of(&text, "seed"), 8));
    let text = changed(FULL, "seed = 7", "seed = 7\nseed = 8");
    assert_eq!(refused(&text).0, line_of(&text, "seed = 8"));
}

#[test]
fn the_version_is_checked_before_anything_else() {
    assert_refused("version = 2\nfoo = 1\n", "version", "is not known", "version = 1");
    let (line, _, message, help) = refused("[calibrate]\n");
    assert_eq!((line, message.as_str()), (1, "missing key `version`"));
    assert!(help.contains("version = 1"));
}

#[test]
fn missing_keys_point_at_the_table_that_lacks_them() {
    let text = changed(SHORT, "join = \"name\"\n", "");
    assert_refused(&text, "[georeference.log]", "a table needs `join`", "add `join");
    let text = changed(SHORT, ", datum = \"ellipsoid\"", "");
    assert_refused(&text, "height = { column", "missing key `datum`", "");
    let text = changed(SHORT, ", sense = \"nose_up\"", "");
    assert_refused(&text, "pitch =", "missing key `sense`", "");
    let text = changed(SHORT, "gimbal_elevation = \"-90 deg\"\n", "");
    assert_refused(&text, "[georeference.mount]", "where the camera looks", "gimbal_elevation");
    let text = changed(
        SHORT,
        "kind = \"plane\"\nheight = \"254.4 m\"\ndatum = \"egm96\"",
        "kind = \"plane\"\nheight = \"254.4 m\"",
    );
    assert_refused(&text, "kind =", "needs `datum`", "");
}

#[test]
fn the_camera_has_exactly_one_source() {
    let text = changed(SHORT, "camera = \"camera.json\"\n", "");
    assert_refused(&text, "[calibrate]", "none is given", "`camera` names");
    let text = changed(SHORT, "camera = \"camera.json\"", "camera = \"camera.json\"\nphotos = \"*.png\"");
    assert_refused(&text, "[calibrate]", "camera and photos are given", "");
    let text = changed(SHORT, "camera = \"camera.json\"", "photos = \"*.png\"");
    assert_refused(&text, "photos", "need the target", "[calibrate.target]");
    let text =
        changed(SHORT, "camera = \"camera.json\"", "camera = \"camera.json\"\nmodel = { skew = false }");
    assert_refused(&text, "model", "`model` would not be used", "remove `model`");
}

#[test]
fn inline_cameras_are_checked() {
    let inline = |parameters: &str| {
        changed(SHORT, "camera = \"camera.json\"", &format!("[calibrate.parameters]\n{parameters}"))
    };
    let whole = "image_width_px = 1800\nimage_height_px = 1350\npixel_origin = \"centre\"\nfx_px = 1278.5\nfy_px = 1278.3\ncx_px = 901\ncy_px = 675.5\n";
    let config = read(&inline(whole)).unwrap();
    let CameraSource::Parameters(camera) = &config.calibrate.camera else { panic!("parameters") };
    assert_eq!((camera.cx_px.value, camera.k1), (901.0, 0.0));
    assert_refused(
        &inline(&whole.replace("pixel_origin = \"centre\"\n", "")),
        "[calibrate.parameters]",
        "missing key `pixel_origin`",
        "",
    );
    assert_refused(&inline(&whole.replace("fx_px = 1278.5", "fx_px = -1")), "fx_px", "must be above 0", "");
    assert_refused(&inline(&whole.replace("cx_px = 901", "cx_px = nan")), "cx_px", "must be finite", "");
    assert_refused(
        &inline(&whole.replace("image_width_px = 1800", "image_width_px = 0")),
        "image_width_px",
        "is 0",
        "",
    );
    assert_refused(&inline(&format!("{whole}k2 = inf\n")), "[calibrate.parameters]", "`k2` is inf", "");
    assert_refused(&inline(&format!("{whole}std = {{ fx_px = -1.0 }}\n")), "std =", "`fx_px` is -1", "");
}

#[test]
fn positions_are_declared_once_and_wholly() {
    let with = |from: &str, to: &str| changed(SHORT, from, to);
    let text = with("longitude = { column = \"lon\", unit = \"deg\" }\n", "");
    assert_refused(&text, "[georeference.log.columns]", "lacks the column `longitude`", "");
    let text = with("longitude = ", "easting = { column = \"e\", unit = \"m\" }\nlongitude = ");
    assert_refused(&text, "[georeference.log.columns]", "more than once", "");
    let geodetic =
        "latitude = { column = \"lat\", unit = \"deg\" }\nlongitude = { column = \"lon\", unit = \"deg\" }\n";
    let text = with(
        geodetic,
        "easting = { column = \"e\", unit = \"m\" }\nnorthing = { column = \"n\", unit = \"m\" }\n",
    );
    assert_refused(&text, "[georeference.log.columns]", "need their CRS", "position_crs");
    let text = with("height = { column = \"h\", unit = \"m\", datum = \"ellipsoid\" }\n", "");
    assert_refused(&text, "[georeference.log.columns]", "lacks the column `height`", "above_takeoff");
    let text = with("join = \"name\"", "join = \"name\"\nposition_crs = \"EPSG:32617\"");
    assert_refused(&text, "position_crs", "would not be used", "");
    let text = with("datum = \"ellipsoid\"", "datum = \"above_takeoff\"");
    assert_refused(&text, "height = { column", "needs the height of its zero", "takeoff_height");
}

#[test]
fn joining_by_time_needs_comparable_clocks() {
    let timed = |log: &str, frames: &str| {
        changed(SHORT, "join = \"name\"", "join = \"time\"\nmax_gap = \"2 s\"")
            .replace("frame = \"file\"\n", &format!("time = {{ column = \"t\", format = \"{log}\" }}\n"))
            + &format!(
                "[georeference.frames]\nfile = \"f.csv\"\ncolumns = {{ frame = \"f\", time = {{ column = \"t\", format = \"{frames}\" }} }}\n"
            )
    };
    let config = read(&timed("iso8601", "unix_seconds")).unwrap();
    let Join::Time { max_gap_s, clock_offset_s, frames, .. } = &config.georeference.unwrap().log.join else {
        panic!("time")
    };
    let FrameTimes::Table(frames) = frames else { panic!("table") };
    assert_eq!((*max_gap_s, *clock_offset_s, frames.delimiter), (2.0, 0.0, b','));
    assert_refused(
        &timed("iso8601", "seconds"),
        "columns = { frame",
        "the frames' times count on a clock of its own, the log's on UTC",
        "same clock",
    );
    let text = changed(SHORT, "join = \"name\"", "join = \"name\"\nmax_gap = \"1 s\"");
    assert_refused(&text, "max_gap", "would not be used", "");
    let text = changed(SHORT, "join = \"name\"", "join = \"time\"")
        .replace("frame = \"file\"", "time = { column = \"t\", format = \"seconds\" }");
    assert_refused(&text, "join", "when each frame was taken", "[georeference.frames]");
}

/// [`SHORT`] with another log and no columns.
fn with_log(lines: &str) -> String {
    let from = SHORT.find("[georeference.log]").unwrap();
    let to = SHORT.find("[georeference.mount]").unwrap();
    format!("{}[georeference.log]\n{lines}\n\n{}", &SHORT[..from], &SHORT[to..])
}

#[test]
fn other_logs_say_themselves_what_they_hold() {
    let log = |lines: &str| read(&with_log(lines)).unwrap().georeference.unwrap().log;
    let ardupilot = log("format = \"ardupilot\"\nfile = \"a.bin\"");
    assert!(matches!(ardupilot.join, Join::Match { clock: StatedClock::Unknown, .. }));
    assert!(matches!(&ardupilot.source, LogSource::File { format: LogFormat::Ardupilot, .. }));
    assert!(ardupilot.may_know_speed());
    let known = log("format = \"px4\"\nfile = \"a.ulg\"\nclock_offset = \"4 h\"\nclock_offset_std = \"2 s\"");
    assert!(matches!(
        known.join,
        Join::Match { clock: StatedClock::Offset { offset_s: 14_400.0, std_s: 2.0 }, .. }
    ));
    let photos = log("format = \"photos\"\nheight_datum = \"egm2008\"");
    assert!(matches!(photos.join, Join::Name) && photos.file().is_none());
    assert_eq!(photos.height_datum, Some(HeightDatum::Egm2008));
    let geo = log("format = \"odm_geo\"\nfile = \"geo.txt\"\nangles = \"omega_phi_kappa\"");
    let LogSource::File { stated, .. } = geo.source else { panic!("file") };
    assert_eq!(stated.angles, Some(AngleSystem::OmegaPhiKappa));

    let refused = |lines: &str, place: &str, cause: &str, help: &str| {
        assert_refused(&with_log(lines), place, cause, help);
    };
    refused("format = \"photos\"\nfile = \"a\"", "file", "would not be used", "");
    refused("format = \"ardupilot\"", "[georeference.log]", "needs `file`", "");
    refused("format = \"sbet\"\nfile = \"a\"\njoin = \"name\"", "join", "names no frames", "match");
    refused("format = \"odm_geo\"\nfile = \"a\"\njoin = \"time\"", "join", "names its frames", "remove");
    refused("format = \"px4\"\nfile = \"a\"\ndelimiter = \";\"", "delimiter", "would not be used", "");
    refused(
        "format = \"px4\"\nfile = \"a\"\nangles = \"camera_yaw_pitch_roll\"",
        "angles",
        "would not be used",
        "",
    );
    refused("format = \"sbet\"\nfile = \"a\"\noffset_file = \"b\"", "offset_file", "would not be used", "");
    refused(
        "format = \"photos\"\nheight_datum = \"above_takeoff\"",
        "height_datum",
        "height of their zero",
        "",
    );
    refused(
        "format = \"px4\"\nfile = \"a\"\nclock_offset_std = \"2 s\"",
        "clock_offset_std",
        "there is none",
        "",
    );
}

#[test]
fn a_course_stands_for_the_nose_only_with_its_spread() {
    let course = changed(SHORT, "clockwise_from_true_north", "course_over_ground");
    assert_refused(&course, "[georeference.log]", "how far the nose may be off", "crab_std");
    let stated = changed(&course, "join = \"name\"", "join = \"name\"\ncrab_std = \"10 deg\"");
    let crab = read(&stated).unwrap().georeference.unwrap().log.crab_std_rad.unwrap();
    assert!((Radians::new(crab).degrees() - 10.0).abs() < 1e-12);
    let needless = changed(SHORT, "join = \"name\"", "join = \"name\"\ncrab_std = \"10 deg\"");
    assert_refused(&needless, "crab_std", "would not be used", "");
    let photos = with_log("format = \"photos\"\nheading = \"course\"");
    assert_refused(&photos, "[georeference.log]", "how far the nose may be off", "crab_std");
}

#[test]
fn gimbal_angles_come_from_one_place_and_say_what_they_are_against() {
    let column = "gimbal_elevation = { column = \"ge\", unit = \"deg\", sense = \"down\" }\nyaw = ";
    let with_column = changed(SHORT, "yaw = ", column);
    assert_refused(
        &with_column,
        "[georeference.mount]",
        "what they are measured against",
        "gimbal_reference",
    );
    let both = changed(
        &with_column,
        "gimbal_elevation = \"-90 deg\"",
        "gimbal_elevation = \"-90 deg\"\ngimbal_reference = \"body\"",
    );
    assert_refused(&both, "gimbal_elevation = \"", "given here and as a column", "keep one");
    let stabilised = changed(&with_column, "gimbal_elevation = \"-90 deg\"", "gimbal_reference = \"nav\"");
    let config = read(&stabilised).unwrap();
    let georeference = config.georeference.unwrap();
    assert_eq!(georeference.mount.gimbal_reference, GimbalReference::Nav);
    assert_eq!(georeference.mount.elevation, GimbalAngle::Logged);
    assert!(georeference.log.as_table().unwrap().gimbal_elevation.as_ref().unwrap().factor < 0.0);
    let text = changed(
        SHORT,
        "gimbal_elevation = \"-90 deg\"",
        "gimbal_elevation = \"-90 deg\"\ngimbal_tilt_down = \"90 deg\"",
    );
    assert_refused(&text, "gimbal_tilt_down", "the same angle", "positive down");
}

#[test]
fn attitude_may_be_missing_only_where_it_has_no_effect() {
    let attitude_from = SHORT.find("yaw = ").unwrap();
    let attitude_to = SHORT.find("[georeference.mount]").unwrap();
    let bare = format!("{}{}", &SHORT[..attitude_from], &SHORT[attitude_to..]);
    assert_refused(
        &bare,
        "[georeference.log.columns]",
        "the camera turns with the body",
        "yaw, pitch and roll",
    );
    let stabilised = changed(&bare, "gimbal_elevation", "gimbal_reference = \"nav\"\ngimbal_elevation");
    let log = read(&stabilised).unwrap().georeference.unwrap().log;
    assert!(log.as_table().unwrap().attitude.is_none());
    let lever =
        changed(&stabilised, "gimbal_elevation", "antenna_in_body = { down = \"1 m\" }\ngimbal_elevation");
    assert_refused(&lever, "[georeference.log.columns]", "a lever arm in the body needs it", "");
    let text =
        changed(SHORT, "roll = { column = \"roll\", unit = \"deg\", sense = \"right_wing_down\" }\n", "");
    assert_refused(&text, "[georeference.log.columns]", "lacks the column `roll`", "right_wing_down");
}

#[test]
fn ground_keys_fit_its_kind() {
    let ground =
        |lines: &str| changed(SHORT, "kind = \"plane\"\nheight = \"254.4 m\"\ndatum = \"egm96\"", lines);
    let config = read(&ground("kind = \"below_camera\"\nheight_above_ground = \"357.46 m\"")).unwrap();
    let Ground::BelowCamera(HeightAboveGround::Fixed(height)) = config.georeference.unwrap().ground else {
        panic!("fixed")
    };
    assert_eq!(height, 357.46);
    assert_refused(&ground("kind = \"below_camera\""), "kind", "needs `height_above_ground`", "");
    assert_refused(
        &ground("kind = \"below_camera\"\nheight_above_ground = \"9 m\"\ndatum = \"egm96\""),
        "datum = \"egm96\"",
        "`datum` would not be used",
        "",
    );
    assert_refused(&ground("kind = \"dem\"\ndatum = \"egm96\""), "kind", "needs `file`", "dem.tif");
    assert_refused(
        &ground("kind = \"plane\"\nheight = \"1 m\"\ndatum = \"egm96\"\nfile = \"dem.tif\""),
        "file = \"dem.tif\"",
        "the ground's kind is \"plane\"",
        "",
    );
    let circular = changed(
        &ground("kind = \"below_camera\"\nheight_above_ground = \"9 m\""),
        "datum = \"ellipsoid\"",
        "datum = \"above_ground\"",
    );
    assert_refused(&circular, "kind =", "neither has a height of its own", "");
}

#[test]
fn sigmas_are_checked() {
    let full = |from: &str, to: &str| changed(FULL, from, to);
    assert_refused(
        &full("position = { cep = \"3 m\" }", "position = { cep = \"3 m\", std = \"2 m\" }"),
        "position =",
        "exactly one of cep, std, r95",
        "",
    );
    assert_refused(
        &full("height = \"5 m\"", "height = \"-5 m\""),
        "height = \"-5",
        "`height` is negative",
        "",
    );
    assert_refused(
        &full("ground_speed = { column = \"gs\", unit = \"kn\" }\n", ""),
        "time =",
        "nothing without the speed",
        "ground_speed",
    );
    assert_refused(&full("angle = \"yaw\"", "std = \"1 deg\""), "std", "`std` would not be used", "");
    assert_refused(&full("truth = \"225 m\"", "truth = \"0 m\""), "truth", "must be above 0", "");
    let r95 = read(&full("cep = \"3 m\"", "r95 = \"3 m\"")).unwrap().accuracy.unwrap().sigmas.position_m;
    // 95 % of a circular normal distribution lie within 2.4477 sigma.
    assert!((r95 * 2.4477 - 3.0).abs() < 1e-3);
}

#[test]
fn a_stage_without_its_predecessor_is_refused() {
    let text = "version = 1\n[calibrate]\ncamera = \"c.json\"\n[mosaic]\n";
    assert_refused(text, "[mosaic]", "needs the stage before it, [georeference]", "");
    assert!(read("version = 1\n[calibrate]\ncamera = \"c.json\"\n").is_ok());
}

#[test]
fn overrides_replace_add_and_are_read_as_text_when_not_toml() {
    let config = read_with(
        FULL,
        &["mosaic.gsd=35 cm", "run.seed = 99", "georeference.limits.max_off_nadir=\"60 deg\""],
    )
    .unwrap();
    assert_eq!(config.mosaic.as_ref().unwrap().gsd_m.as_ref().unwrap().value, 0.35);
    assert_eq!(config.run.seed, 99);
    assert!(
        (config.georeference.unwrap().max_off_nadir_rad.unwrap() - std::f64::consts::FRAC_PI_3).abs() < 1e-12
    );
    let config = read_with(SHORT, &["mosaic={}", "mosaic.blend=none"]).unwrap();
    assert_eq!(config.mosaic.unwrap().blend, mosaic::Blend::None);
    let config = read_with(FULL, &["calibrate.photos=[\"a\", \"b\"]"]).unwrap();
    let CameraSource::Photos(photos) = config.calibrate.camera else { panic!("photos") };
    assert_eq!(photos.patterns.value, ["a", "b"]);
}

#[test]
fn refused_overrides_point_at_the_override() {
    let refused = |text: &str| read_with(FULL, &["run.seed=3", text]).unwrap_err();
    let place = |error: &ConfigError| error.diagnostic().place.as_ref().unwrap().to_string();
    for (text, message) in [
        ("mosaic.gds=1", "unknown key `gds`"),
        ("mosaic.gsd=20", "length 20 has no unit"),
        ("mosaic.gsd=20 yards", "unknown unit \"yards\""),
        ("mosaic.gsd", "has no `=`"),
        ("mosaic..gsd=1", "is not a key path"),
        ("run.seed.x=1", "`seed` is not a table"),
        ("version=3", "is not known"),
        ("mosaic.gsd=1\nversion=2", "unknown unit"),
    ] {
        let error = refused(text);
        assert_eq!(place(&error), format!("--set {text}"));
        assert!(error.to_string().contains(message), "{text}: {error}");
    }
    let shown = refused("mosaic.gsd=20").diagnostic().render("pipeline", &[], false);
    assert!(shown.contains("mosaic.gsd=20"), "{shown}");
    assert!(shown.contains("--set:1:12"), "{shown}");
}

#[test]
fn the_schema_describes_every_key_and_accepts_the_keys_the_reader_accepts() {
    let schema: serde_json::Value = serde_json::from_str(&schema_json()).unwrap();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    let mut described = 0;
    let mut tables = vec![("pipeline".to_owned(), &schema)];
    tables.extend(schema["$defs"].as_object().unwrap().iter().map(|(name, table)| (name.clone(), table)));
    for (name, table) in tables {
        let Some(properties) = table["properties"].as_object() else { continue };
        assert_eq!(table["additionalProperties"], false, "{name} must refuse unknown keys");
        for (key, property) in properties {
            assert!(property["description"].is_string(), "{name}.{key} has no description");
            described += 1;
        }
    }
    assert!(described > 120, "only {described} keys are described");
}

proptest::proptest! {
    #[test]
    fn no_text_panics(cut in 0usize..3000, junk in "\\PC{0,8}") {
        let end = FULL.char_indices().map(|(at, _)| at).nth(cut.min(FULL.len() - 1)).unwrap_or(FULL.len());
        if let Err(error) = read(&format!("{}{junk}", &FULL[..end])) {
            let _ = error.diagnostic().render("pipeline", &[], false);
        }
        if let Err(error) = read_with(FULL, &[&junk, &format!("mosaic.gsd={junk}")]) {
            let _ = error.diagnostic().render("pipeline", &[], false);
        }
    }
}
