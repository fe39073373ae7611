//! One simulated flight, told by every kind of log: each leads to the true targets. The logs are written here from the
//! simulator's own table of true poses, with formulas written out on the spot.

#![expect(
    clippy::disallowed_methods,
    reason = "shares no conversion with the library; writes logs to be read"
)]

use crate::simulated::{COLUMNS, MOUNT, pipeline_with, scenario, worst_target};
use crate::surveys::{pipeline, seneca_camera, shared};
use boresight::camera::{Camera, Lens, LensKind, MAX_INTERIOR};
use boresight::config::Config;
use boresight::formats::crs::Projection;
use boresight::geodesy::{Geodetic, LocalTangent, MapProjection, WGS84};
use boresight::stages::georeference::{Georeferenced, georeference};
use boresight::stages::simulate::simulate;
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

/// What truth.csv says of one frame.
struct True {
    frame: String,
    time_s: f64,
    /// Latitude and longitude in degrees, height above the ellipsoid.
    antenna: [f64; 3],
    /// Yaw, pitch, roll in degrees.
    attitude: [f64; 3],
    camera: Geodetic,
}

fn rows(file: &Path) -> Vec<csv::StringRecord> {
    csv::Reader::from_path(file).unwrap().records().map(Result::unwrap).collect()
}

fn truth(folder: &Path) -> Vec<True> {
    let number = |text: &str| text.parse::<f64>().unwrap();
    rows(&folder.join("survey/truth.csv"))
        .iter()
        .map(|row| True {
            frame: row[0].to_owned(),
            time_s: number(&row[1]),
            antenna: [2, 3, 4].map(|k| number(&row[k])),
            attitude: [5, 6, 7].map(|k| number(&row[k])),
            camera: Geodetic::from_degrees(number(&row[9]), number(&row[10]), number(&row[11])),
        })
        .collect()
}

fn rx(degrees: f64) -> Matrix3<f64> {
    Rotation3::from_axis_angle(&Vector3::x_axis(), degrees.to_radians()).into_inner()
}
fn ry(degrees: f64) -> Matrix3<f64> {
    Rotation3::from_axis_angle(&Vector3::y_axis(), degrees.to_radians()).into_inner()
}
fn rz(degrees: f64) -> Matrix3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), degrees.to_radians()).into_inner()
}

impl True {
    /// The camera (x right, y down, z forward) in north-east-down, through the simulated mount.
    fn ned_from_camera(&self) -> Matrix3<f64> {
        let [yaw, pitch, roll] = self.attitude;
        let boresight = rz(-2.1) * rx(1.3);
        let gimbal = rz(-90.0) * ry(-90.0);
        let axes = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        rz(yaw) * ry(pitch) * rx(roll) * boresight * gimbal * axes
    }

    /// Easting, northing, and the angle by which grid north lies east of true north there, radians.
    fn on_map(&self, utm: &Projection) -> (f64, f64, f64) {
        let c = self.camera;
        let north =
            Geodetic::from_degrees(c.latitude.degrees() + 1e-5, c.longitude.degrees(), c.height.get());
        let map = utm.map_from_geodetic(&[c, north]).unwrap();
        // True north leans west on the map where grid north lies east of it.
        let convergence = -(map[1].easting - map[0].easting).atan2(map[1].northing - map[0].northing);
        (map[0].easting, map[0].northing, convergence)
    }

    /// ω, φ, κ in degrees against the map's grid.
    fn omega_phi_kappa(&self, utm: &Projection) -> [f64; 3] {
        let (.., convergence) = self.on_map(utm);
        let enu_from_ned = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        let camera_from_photo = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let m = rz(convergence.to_degrees()) * enu_from_ned * self.ned_from_camera() * camera_from_photo;
        [(-m[(1, 2)]).atan2(m[(2, 2)]), m[(0, 2)].asin(), (-m[(0, 1)]).atan2(m[(0, 0)])].map(f64::to_degrees)
    }

    /// Yaw, pitch, roll in degrees of a body whose nose is the top of the image.
    fn camera_yaw_pitch_roll(&self) -> [f64; 3] {
        let camera_from_body = Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let m = self.ned_from_camera() * camera_from_body;
        [m[(1, 0)].atan2(m[(0, 0)]), (-m[(2, 0)]).asin(), m[(2, 1)].atan2(m[(2, 2)])].map(f64::to_degrees)
    }
}

/// The simulated survey in a folder of its own.
fn survey() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    simulate(&scenario(), &folder.path().join("survey")).unwrap();
    folder
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    std::fs::write(folder.join(name), bytes).unwrap();
}

fn expect(folder: &Path, what: &str, log: &str, mount: &str, limit_m: f64) {
    let (worst, count) = worst_target(folder, &pipeline_with(log, mount));
    assert!(count > 30, "{what}: only {count} observations");
    assert!(worst < limit_m, "{what}: {worst} m");
}

#[test]
fn exterior_orientations_of_other_programs_lead_to_the_targets() {
    let folder = survey();
    let at = folder.path();
    let utm = Projection::new("EPSG:32633").unwrap();
    let frames = truth(at);
    let (mut pix4d, mut orthority, mut metashape, mut geo) = (
        "imageName X Y Z Omega Phi Kappa\n".to_owned(),
        "filename,longitude,latitude,altitude,roll,pitch,yaw,camera\n".to_owned(),
        format!(
            "# CoordinateSystem: {}\n# PhotoID, X, Y, Z, Omega, Phi, Kappa\n",
            utm.wkt().replace('\n', " ")
        ),
        "EPSG:32633\n".to_owned(),
    );
    for frame in &frames {
        let (easting, northing, _) = frame.on_map(&utm);
        let [omega, phi, kappa] = frame.omega_phi_kappa(&utm);
        let [yaw, pitch, roll] = frame.camera_yaw_pitch_roll();
        let (name, height) = (&frame.frame, frame.camera.height.get());
        let _ =
            writeln!(pix4d, "{name} {easting:.6} {northing:.6} {height:.6} {omega:.9} {phi:.9} {kappa:.9}");
        let _ = writeln!(
            metashape,
            "{name}\t{easting:.6}\t{northing:.6}\t{height:.6}\t{omega:.9}\t{phi:.9}\t{kappa:.9}"
        );
        let _ = writeln!(geo, "{name} {easting:.6} {northing:.6} {height:.6} {omega:.9} {phi:.9} {kappa:.9}");
        let (latitude, longitude) = (frame.camera.latitude.degrees(), frame.camera.longitude.degrees());
        let _ = writeln!(
            orthority,
            "{name},{longitude:.10},{latitude:.10},{height:.6},{roll:.9},{pitch:.9},{yaw:.9},cam"
        );
    }
    write(at, "pix4d.txt", pix4d);
    write(at, "metashape.txt", metashape);
    write(at, "geo.txt", geo);
    write(at, "orthority.csv", orthority);
    write(at, "reconstruction.json", reconstruction(&frames));
    let log = |format: &str, file: &str, more: &str| {
        format!("[georeference.log]\nformat = \"{format}\"\nfile = \"{file}\"\n{more}\n")
    };
    let heights = "height_datum = \"ellipsoid\"";
    let crs = format!("position_crs = \"EPSG:32633\"\n{heights}");
    expect(at, "Pix4D", &log("orientation", "pix4d.txt", &crs), "", 0.05);
    expect(at, "Metashape", &log("orientation", "metashape.txt", heights), "", 0.05);
    expect(at, "orthority", &log("orientation", "orthority.csv", ""), "", 0.05);
    let angles = format!("angles = \"omega_phi_kappa\"\n{heights}");
    expect(at, "geo.txt", &log("odm_geo", "geo.txt", &angles), "", 0.05);
    expect(at, "OpenSfM", &log("opensfm", "reconstruction.json", ""), "", 0.05);

    // A mounting that the camera's own pose has no use for is refused, not ignored.
    let text = pipeline_with(&log("opensfm", "reconstruction.json", ""), MOUNT);
    let config = Config::from_text(&at.join("p.toml"), &text, &[]).unwrap();
    let error = georeference(config.georeference.as_ref().unwrap(), &small_camera()).unwrap_err();
    assert!(error.cause.contains("would not be used") && error.span.is_some(), "{error}");
}

/// OpenSfM's reconstruction about the first camera's place, a hundred metres lower.
fn reconstruction(frames: &[True]) -> String {
    let first = frames[0].camera;
    let reference = first.at_height(first.height.get() - 100.0);
    let enu_from_ned = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let rotation = |at: Geodetic| LocalTangent::at(at).ecef_from_ned().rotation.matrix();
    let ecef_from_enu = rotation(reference) * enu_from_ned;
    let origin = WGS84.ecef_from_geodetic(&reference).vector();
    let shots: serde_json::Map<String, serde_json::Value> = frames
        .iter()
        .map(|frame| {
            let camera_from_enu =
                (rotation(frame.camera) * frame.ned_from_camera()).transpose() * ecef_from_enu;
            let place = WGS84.ecef_from_geodetic(&frame.camera).vector() - origin;
            let translation = -(camera_from_enu * (ecef_from_enu.transpose() * place));
            let axis = Rotation3::from_matrix_unchecked(camera_from_enu).scaled_axis();
            let shot = serde_json::json!({
                "camera": "cam",
                "rotation": [axis.x, axis.y, axis.z],
                "translation": [translation.x, translation.y, translation.z],
            });
            (frame.frame.clone(), shot)
        })
        .collect();
    serde_json::json!([{
        "cameras": {},
        "shots": shots,
        "points": {},
        "reference_lla": {
            "latitude": reference.latitude.degrees(),
            "longitude": reference.longitude.degrees(),
            "altitude": reference.height.get(),
        },
    }])
    .to_string()
}

/// Seconds of the GPS week at which the simulated clock shows zero.
const WEEK_START: f64 = 200_000.0;

/// The frames' times as a table, each moved by `offset`.
fn frame_times(folder: &Path, frames: &[True], offset: f64, decimals: usize) {
    let mut table = "file,t\n".to_owned();
    for frame in frames {
        let _ = writeln!(table, "{},{:.decimals$}", frame.frame, frame.time_s + offset);
    }
    write(folder, "times.csv", table);
}

fn frames_table(format: &str) -> String {
    format!(
        "[georeference.frames]\nfile = \"times.csv\"\ncolumns = {{ frame = \"file\", time = {{ column = \"t\", format = \"{format}\" }} }}\n"
    )
}

#[test]
fn a_trajectory_of_doubles_is_interpolated_at_the_photos_times() {
    let folder = survey();
    let at = folder.path();
    let mut sbet: Vec<u8> = Vec::new();
    for row in rows(&at.join("survey/track.csv")) {
        let v: Vec<f64> = row.iter().map(|cell| cell.parse().unwrap()).collect();
        let [time, latitude, longitude, height, yaw, pitch, roll] = v[..7] else { panic!("{v:?}") };
        // A wander angle of 10 degrees: the platform's heading is that much more than the true one.
        let wander = 10.0_f64.to_radians();
        let record = [
            WEEK_START + time,
            latitude.to_radians(),
            longitude.to_radians(),
            height,
            0.0,
            0.0,
            0.0,
            roll.to_radians(),
            pitch.to_radians(),
            yaw.to_radians() + wander,
            wander,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ];
        sbet.extend(record.iter().flat_map(|value| value.to_le_bytes()));
    }
    write(at, "flight.sbet", sbet);
    frame_times(at, &truth(at), WEEK_START, 6);
    let log = format!(
        "[georeference.log]\nformat = \"sbet\"\nfile = \"flight.sbet\"\n{}",
        frames_table("gps_seconds_of_week")
    );
    expect(at, "SBET", &log, MOUNT, 0.05);
}

/// A DataFlash message: its format record, and its payloads.
struct Messages(Vec<u8>);

impl Messages {
    fn format(&mut self, id: u8, name: &str, types: &str, labels: &str, payload: usize) {
        let padded = |text: &str, size: usize| {
            let mut bytes = text.as_bytes().to_vec();
            bytes.resize(size, 0);
            bytes
        };
        self.0.extend([0xA3, 0x95, 128, id, (payload + 3) as u8]);
        self.0.extend(padded(name, 4));
        self.0.extend(padded(types, 16));
        self.0.extend(padded(labels, 64));
    }
    fn message(&mut self, id: u8, payload: &[Vec<u8>]) {
        self.0.extend([0xA3, 0x95, id]);
        self.0.extend(payload.concat());
    }
}

#[test]
fn an_autopilot_log_is_matched_with_photos_whose_clock_is_hours_off() {
    let folder = survey();
    let at = folder.path();
    let frames = truth(at);
    let mut log = Messages(Vec::new());
    log.format(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 86);
    // The labels stand in another order than ArduPilot's: only the names count.
    log.format(200, "CAM", "QddffHfff", "TimeUS,Lat,Lng,Alt,RelAlt,Img,Y,P,R", 8 + 16 + 8 + 2 + 12);
    // Two triggers without a photo, one of them between two photos.
    let fly_by = |time_s: f64, near: &True| True {
        frame: String::new(),
        time_s,
        antenna: near.antenna,
        attitude: near.attitude,
        camera: near.camera,
    };
    let mut events: Vec<(&True, f64)> = frames.iter().map(|frame| (frame, frame.time_s)).collect();
    let early = fly_by(frames[0].time_s - 3.3, &frames[0]);
    let between = fly_by(frames[6].time_s + 2.9, &frames[6]);
    events.extend([(&early, early.time_s), (&between, between.time_s)]);
    events.sort_by(|a, b| a.1.total_cmp(&b.1));
    // EGM96 at the place: heights of the log are above sea level.
    let undulation = 18.0;
    for (number, (event, time_s)) in events.iter().enumerate() {
        let [latitude, longitude, height] = event.antenna;
        let [yaw, pitch, roll] = event.attitude.map(|angle| (angle as f32).to_le_bytes().to_vec());
        log.message(
            200,
            &[
                (((time_s + 60.0) * 1e6).round() as u64).to_le_bytes().to_vec(),
                latitude.to_le_bytes().to_vec(),
                longitude.to_le_bytes().to_vec(),
                ((height - undulation) as f32).to_le_bytes().to_vec(),
                0_f32.to_le_bytes().to_vec(),
                (number as u16).to_le_bytes().to_vec(),
                yaw,
                pitch,
                roll,
            ],
        );
    }
    write(at, "flight.bin", log.0);
    frame_times(at, &frames, 14_403.7, 2);
    let text = format!(
        "[georeference.log]\nformat = \"ardupilot\"\nfile = \"flight.bin\"\n{}\n[georeference.geoid]\nundulation = \"{undulation} m\"\n",
        frames_table("seconds")
    );
    expect(at, "DataFlash", &text, MOUNT, 0.05);

    let config = Config::from_text(&at.join("p.toml"), &pipeline_with(&text, MOUNT), &[]).unwrap();
    let matched =
        georeference(config.georeference.as_ref().unwrap(), &small_camera()).unwrap().matching.unwrap();
    let clock = matched.clock.unwrap();
    // log = photo + offset: the log began a minute before the simulated clock, the photos' clock is four hours ahead.
    assert!((clock.offset.get() - (60.0 - 14_403.7)).abs() < 0.05, "{clock:?}");
    let lonely: Vec<_> = matched.rows.iter().filter(|row| row.frame.is_empty()).collect();
    assert_eq!(lonely.len(), 2, "{lonely:?}");
    assert!(matched.rows.iter().filter_map(|row| row.residual_s).all(|residual| residual.abs() < 0.02));
}

fn small_camera() -> Arc<Camera> {
    let c = scenario().camera;
    let mut interior = [0.0; MAX_INTERIOR];
    interior[..10]
        .copy_from_slice(&[c.fx_px, c.fy_px, c.skew_px, c.cx_px, c.cy_px, c.k1, c.k2, c.p1, c.p2, c.k3]);
    Arc::new(
        Camera::new(Lens::new(LensKind::Brown, &interior).unwrap(), c.width_px, c.height_px, None).unwrap(),
    )
}

#[test]
fn a_table_of_exposures_is_matched_too() {
    let folder = survey();
    let at = folder.path();
    frame_times(at, &truth(at), -77.25, 3);
    let log = format!(
        "[georeference.log]\nfile = \"survey/log.csv\"\njoin = \"match\"\n[georeference.log.columns]\ntime = {{ column = \"time_s\", format = \"seconds\" }}\n{COLUMNS}\n{}",
        frames_table("unix_seconds")
    );
    expect(at, "table", &log, MOUNT, 0.05);
}

#[test]
fn an_open_alignment_is_refused_until_one_photo_is_named() {
    let folder = survey();
    let at = folder.path();
    let frames = truth(at);
    // Evenly spaced photos, two triggers without one, a clock that drifts: a shift by one photo fits nearly as well.
    let text = std::fs::read_to_string(at.join("survey/log.csv")).unwrap();
    let mut events = String::new();
    for (k, line) in text.lines().enumerate() {
        let (_, cells) = line.split_once(',').unwrap();
        let _ = writeln!(events, "{cells}");
        if [4, 10].contains(&k) {
            let (time, rest) = cells.split_once(',').unwrap();
            let _ = writeln!(events, "{:.6},{rest}", time.parse::<f64>().unwrap() + 2.5);
        }
    }
    write(at, "events.csv", events);
    frame_times(at, &frames, 14_403.7, 2);
    let log = |more: &str| {
        format!(
            "[georeference.log]\nfile = \"events.csv\"\njoin = \"match\"\n{more}\n[georeference.log.columns]\ntime = {{ column = \"time_s\", format = \"seconds\" }}\n{COLUMNS}\n{}",
            frames_table("unix_seconds")
        )
    };
    let config = Config::from_text(&at.join("p.toml"), &pipeline_with(&log(""), MOUNT), &[]).unwrap();
    let error = georeference(config.georeference.as_ref().unwrap(), &small_camera()).unwrap_err();
    assert!(error.cause.contains("more than one way"), "{error}");
    assert!(error.help.as_ref().unwrap().contains("clock_offset = \"-14403.7 s\""), "{error:?}");
    // The table's second line is the first exposure.
    let anchored = log(&format!("anchor = {{ frame = \"{}\", record = 2 }}", frames[0].frame));
    expect(at, "anchored", &anchored, MOUNT, 0.05);
    let wrong = log("anchor = { frame = \"nowhere.jpg\", record = 2 }");
    let config = Config::from_text(&at.join("p.toml"), &pipeline_with(&wrong, MOUNT), &[]).unwrap();
    let error = georeference(config.georeference.as_ref().unwrap(), &small_camera()).unwrap_err();
    assert!(error.cause.contains("nowhere.jpg") && error.span.is_some(), "{error}");
}

/// Positions and attitudes of all frames, by name.
fn poses(survey: &Georeferenced) -> Vec<(String, nalgebra::Vector3<f64>, Matrix3<f64>)> {
    survey
        .frames
        .iter()
        .map(|f| {
            (f.name.clone(), f.ecef_from_camera().origin.vector(), f.ecef_from_camera().rotation.matrix())
        })
        .collect()
}

/// Largest difference of camera positions, metres, and of rotations, radians.
fn difference(a: &Georeferenced, b: &Georeferenced) -> (f64, f64) {
    assert_eq!(a.frames.len(), b.frames.len());
    poses(a).iter().zip(poses(b)).fold((0.0, 0.0), |(metres, radians): (f64, f64), (x, y)| {
        assert_eq!(x.0, y.0);
        (metres.max((x.1 - y.1).norm()), radians.max((x.2 - y.2).norm()))
    })
}

/// A pipeline file of the project with its log told by the photos instead.
fn by_photos(name: &str, log: &str, mount: &str) -> Config {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines").join(name);
    let text = std::fs::read_to_string(&file).unwrap();
    let (before, rest) = text.split_once("[georeference.log]\n").unwrap();
    let (_, after) = rest.split_once("[georeference.ground]\n").unwrap();
    let text = format!("{before}[georeference.log]\n{log}\n{mount}\n[georeference.ground]\n{after}");
    Config::from_text(&file, &text, &[]).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn senefly_photos_state_the_poses_of_their_log() {
    if shared("seneca").is_none() {
        return;
    }
    let table =
        georeference(pipeline("seneca-log.toml").georeference.as_ref().unwrap(), &seneca_camera()).unwrap();
    let log = "format = \"photos\"\nheading = \"course\"\ncrab_std = \"14 deg\"";
    let config = by_photos("seneca-log.toml", log, "[georeference.mount]\ngimbal_elevation = \"-90 deg\"");
    let photos = georeference(config.georeference.as_ref().unwrap(), &seneca_camera()).unwrap();
    assert_eq!(photos.frames.len(), 69);
    let (metres, radians) = difference(&table, &photos);
    // The table's own rounding: 1e-7 degrees, millimetres, 1e-4 degrees.
    assert!(metres < 0.02 && radians < 5e-6, "{metres} m, {radians} rad");

    // Undeclared, a course is refused, also where the log only places photos that state it.
    let positions = tempfile::tempdir().unwrap();
    let mut geo = "EPSG:4326\n".to_owned();
    for row in rows(&shared("seneca").unwrap().join("frames.csv")) {
        let _ = writeln!(geo, "{} {} {} {}", &row[0], &row[4], &row[3], &row[6]);
    }
    write(positions.path(), "geo.txt", geo);
    let log = format!(
        "format = \"odm_geo\"\nfile = \"{}\"\nheight_datum = \"egm96\"",
        positions.path().join("geo.txt").display()
    );
    let mount = "[georeference.mount]\ngimbal_elevation = \"-90 deg\"";
    let config = by_photos("seneca-log.toml", &log, mount);
    let error = georeference(config.georeference.as_ref().unwrap(), &seneca_camera()).unwrap_err();
    assert!(error.cause.contains("course over ground"), "{error}");
    let config =
        by_photos("seneca-log.toml", &format!("{log}\nheading = \"course\"\ncrab_std = \"14 deg\""), mount);
    let placed = georeference(config.georeference.as_ref().unwrap(), &seneca_camera()).unwrap();
    let (metres, radians) = difference(&table, &placed);
    assert!(metres < 0.02 && radians < 5e-6, "{metres} m, {radians} rad");

    let config = by_photos(
        "seneca-log.toml",
        "format = \"photos\"",
        "[georeference.mount]\ngimbal_elevation = \"-90 deg\"",
    );
    let error = georeference(config.georeference.as_ref().unwrap(), &seneca_camera()).unwrap_err();
    assert!(error.cause.contains("course over ground") && error.help.unwrap().contains("crab_std"));
}

#[test]
fn dji_photos_state_the_poses_of_their_log() {
    if shared("brighton-beach").is_none() {
        return;
    }
    let mut interior = [0.0; MAX_INTERIOR];
    interior[..5].copy_from_slice(&[1155.0, 1155.0, 0.0, 999.5, 562.0]);
    let lens = Lens::new(LensKind::Brown, &interior).unwrap();
    let camera = Arc::new(Camera::new(lens, 2000, 1125, None).unwrap());
    let table = georeference(pipeline("brighton.toml").georeference.as_ref().unwrap(), &camera).unwrap();
    let turned: Vec<String> = (24..30).map(|k| format!("\"DJI_00{k}.JPG\"")).collect();
    let mount = format!(
        "[georeference.mount]\nturned_frames = [{{ frames = [{}], clockwise = \"180\" }}]",
        turned.join(", ")
    );
    let config = by_photos("brighton.toml", "format = \"photos\"\nheight_datum = \"ellipsoid\"", &mount);
    let photos = georeference(config.georeference.as_ref().unwrap(), &camera).unwrap();
    assert_eq!(photos.frames.len(), 18);
    let (metres, radians) = difference(&table, &photos);
    assert!(metres < 1e-3 && radians < 1e-9, "{metres} m, {radians} rad");
    let notes = photos.notes.join("\n");
    assert!(
        notes.contains("DJI_0024.JPG to DJI_0029.JPG") && notes.contains("Windows Photo Viewer"),
        "{notes}"
    );
}

/// The seeds of the fuzzers are files as they should be; each reader takes its own.
#[test]
fn seeds_of_the_fuzzers_are_read() {
    use boresight::formats::camera::{CameraChoice, camera_from_text};
    use boresight::formats::flight::{dataflash, sbet, tlog, ulog};
    use boresight::formats::metadata;
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds");
    let bytes = |name: &str| std::fs::read(seeds.join(name)).unwrap();
    for (name, read) in [
        ("dataflash", dataflash::read as fn(&[u8]) -> _),
        ("ulog", ulog::read),
        ("tlog", tlog::read),
        ("sbet", sbet::read),
    ] {
        let log: boresight::formats::flight::FlightLog = read(&bytes(&format!("binary_logs/{name}"))[1..])
            .unwrap_or_else(|e: boresight::formats::flight::ReadError| panic!("{name}: {e:?}"));
        assert!(log.positions.len() >= 3 && log.attitudes.len() >= 3, "{name}: {log:?}");
    }
    for name in ["dji.jpg", "sensefly.tif"] {
        let photo = metadata::read(&mut std::io::Cursor::new(bytes(&format!("metadata/{name}")))).unwrap();
        assert!(photo.exposure.position.is_some(), "{name}: {photo:?}");
    }
    for file in std::fs::read_dir(seeds.join("camera_file")).unwrap() {
        let file = file.unwrap().path();
        let text = std::fs::read_to_string(&file).unwrap();
        let camera =
            camera_from_text(&file, &text, &CameraChoice::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((camera.width, camera.height), (640, 480), "{}", file.display());
    }
}
