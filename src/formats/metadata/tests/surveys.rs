//! Real surveys, where they are on the machine: every number equals the table that was extracted from them elsewhere.

use super::build::parse;
use crate::formats::flight::{Clock, LoggedAttitude, LoggedPosition, North};
use crate::formats::metadata::{PhotoMetadata, Severity, TurnEvidence, flight_log, read};
use crate::geodesy::{GeoidModel, HeightKind};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A data folder beside the project; `None`, with the reason printed, where it is absent.
fn shared(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: the data set {name} is not on this machine");
    None
}

/// Rows of a plain table: column name to text.
fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        names.iter().zip(line.split(',')).map(|(n, v)| ((*n).to_owned(), v.to_owned())).collect()
    };
    lines.filter(|l| !l.is_empty()).map(row).collect()
}

/// The value with as many digits as the table's text has, whether that was rounded or cut off.
#[track_caller]
fn same(row: &BTreeMap<String, String>, column: &str, value: f64) {
    let text = &row[column];
    let digits = text.split_once('.').map_or(0, |(_, f)| f.len());
    let stated: f64 = text.parse().unwrap();
    let apart = (stated - value).abs();
    assert!(
        apart <= 1.000_001 * 10f64.powi(-(digits as i32)),
        "{} {column}: {text} but {value}",
        row["file"]
    );
}

fn photos(folder: &Path, rows: &[BTreeMap<String, String>]) -> Vec<(String, PhotoMetadata)> {
    let read = |row: &BTreeMap<String, String>| {
        let name = row["file"].clone();
        let mut file = std::fs::File::open(folder.join("images").join(&name)).unwrap();
        (name, read(&mut file).unwrap_or_else(|e| panic!("{}", e.cause)))
    };
    rows.iter().map(read).collect()
}

#[test]
fn seneca_s_photos_hold_the_log() {
    let Some(folder) = shared("seneca") else { return };
    let rows = table(&folder.join("frames.csv"));
    assert_eq!(rows.len(), 69);
    let photos = photos(&folder, &rows);
    let log = flight_log(photos.clone());
    assert_eq!((log.clock, log.exposures.len(), log.bad.len()), (Clock::Utc, 69, 0));
    for ((row, exposure), (_, photo)) in rows.iter().zip(&log.exposures).zip(&photos) {
        assert_eq!(exposure.frame.as_ref(), Some(&row["file"]));
        let Some(LoggedPosition::Geodetic { latitude, longitude, height_m, kind }) = exposure.position else {
            panic!("{:?}", exposure.position)
        };
        assert_eq!(kind, HeightKind::SeaLevel(GeoidModel::Egm96));
        same(row, "latitude_deg", latitude.degrees());
        same(row, "longitude_deg", longitude.degrees());
        same(row, "alt_amsl_m", height_m);
        same(row, "height_above_takeoff_m", exposure.height_above_takeoff_m.unwrap());
        same(row, "groundspeed_m_s", exposure.ground_speed_m_s.unwrap());
        let Some(LoggedAttitude::Body { angles, north }) = exposure.attitude else { panic!() };
        assert_eq!(north, North::Course);
        same(row, "heading_deg", angles.yaw.degrees().rem_euclid(360.0));
        same(row, "pitch_deg", angles.pitch.degrees());
        same(row, "roll_deg", angles.roll.degrees());
        let time = jiff::Timestamp::from_second(exposure.time.unwrap().get() as i64).unwrap();
        assert_eq!(time.to_string(), row["utc_time"]);
        let civil = jiff::Timestamp::from_second(photo.times.civil.unwrap().time.get() as i64).unwrap();
        assert_eq!(civil.to_string().trim_end_matches('Z'), row["camera_time"]);
        assert_eq!(photo.stored_size, Some((1800, 1350)));
        // 4.3 mm at 645.4 pixels a millimetre and 1800 of 4000 columns; self-calibrated: 1278.
        assert!((photo.optics.focal_length_px.as_ref().unwrap().x - 1248.9).abs() < 0.1);
        assert_eq!(photo.turned, None);
        assert!(!photo.findings.iter().any(|f| f.severity >= Severity::Warning), "{:?}", photo.findings);
    }
    println!("{:#?}", log.notes);
    assert!(log.notes[0].starts_with("69 photos of Canon PowerShot"), "{:?}", log.notes);
    assert!(log.notes.iter().any(|n| n.starts_with("69 photos, UAV yaw: the course")), "{:?}", log.notes);
}

/// Pearson's correlation and the mean of b - a.
fn correlation(pairs: &[(f64, f64)]) -> (f64, f64) {
    let n = pairs.len() as f64;
    let mean = pairs.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let sum = |f: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|p| f(p.0 - mean.0, p.1 - mean.1)).sum::<f64>();
    (sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt(), mean.1 - mean.0)
}

#[test]
fn sensefly_s_roll_is_right_wing_down() {
    let Some(folder) = shared("seneca") else { return };
    let rows = table(&folder.join("frames.csv"));
    let reference: BTreeMap<String, BTreeMap<String, String>> =
        table(&folder.join("reference_eo.csv")).into_iter().map(|r| (r["file"].clone(), r)).collect();
    let (mut rolls, mut pitches) = (Vec::new(), Vec::new());
    for (name, photo) in photos(&folder, &rows) {
        let (Some(row), Some(LoggedAttitude::Body { angles, .. })) =
            (reference.get(&name), photo.exposure.attitude)
        else {
            continue;
        };
        rolls.push((angles.roll.degrees(), row["roll_deg"].parse().unwrap()));
        pitches.push((angles.pitch.degrees(), row["pitch_deg"].parse().unwrap()));
    }
    let ((roll, roll_offset), (pitch, pitch_offset)) = (correlation(&rolls), correlation(&pitches));
    println!(
        "{} frames: correlation with the reference: roll {roll:+.3} (mean difference {roll_offset:+.2}°), pitch \
         {pitch:+.3} ({pitch_offset:+.2}°)",
        rolls.len()
    );
    assert_eq!(rolls.len(), 68);
    // The unit's noise (4° of roll) and its lag of 0.4 s keep it from 1; the other sense would give the negative.
    assert!(roll > 0.6 && pitch > 0.7);
}

#[test]
fn brighton_beach_and_its_turned_strip() {
    let Some(folder) = shared("brighton-beach") else { return };
    let rows = table(&folder.join("frames.csv"));
    assert_eq!(rows.len(), 18);
    let photos = photos(&folder, &rows);
    let log = flight_log(photos.clone());
    // No zone, no GPS time: the camera's clock.
    assert_eq!((log.clock, log.exposures.len()), (Clock::Local, 18));
    for ((row, exposure), (_, photo)) in rows.iter().zip(&log.exposures).zip(&photos) {
        let Some(LoggedPosition::Geodetic { latitude, longitude, height_m, .. }) = exposure.position else {
            panic!()
        };
        same(row, "latitude_deg", latitude.degrees());
        same(row, "longitude_deg", longitude.degrees());
        same(row, "alt_gps_m", height_m);
        same(row, "height_above_takeoff_m", exposure.height_above_takeoff_m.unwrap());
        let gimbal = exposure.gimbal.unwrap().angles;
        same(row, "gimbal_yaw_deg", gimbal.pan.degrees());
        same(row, "gimbal_pitch_deg", gimbal.elevation.degrees());
        same(row, "gimbal_roll_deg", gimbal.roll.degrees());
        let Some(LoggedAttitude::Body { angles, north: North::True }) = exposure.attitude else { panic!() };
        same(row, "flight_yaw_deg", angles.yaw.degrees());
        same(row, "flight_pitch_deg", angles.pitch.degrees());
        same(row, "flight_roll_deg", angles.roll.degrees());
        let time = jiff::Timestamp::from_second(exposure.time.unwrap().get() as i64).unwrap();
        assert_eq!(time.to_string().trim_end_matches('Z'), row["camera_time"]);
        let turned = matches!(photo.turned, Some(TurnEvidence::PerhapsHalfTurn(_)));
        assert_eq!(turned, row["pixels_rotated_180"] == "1", "{}", row["file"]);
        assert_eq!(
            photo.findings.iter().any(|f| f.severity >= Severity::Warning),
            turned,
            "{:?}",
            photo.findings
        );
    }
    println!("{:#?}", log.notes);
    assert!(log.notes.iter().any(|n| n.contains("may have been turned by 180°")));
}

#[test]
fn a_thousand_photos_take_a_fraction_of_a_second() {
    let Some(folder) = shared("seneca") else { return };
    let rows = table(&folder.join("frames.csv"));
    let files: Vec<Vec<u8>> =
        rows.iter().map(|r| std::fs::read(folder.join("images").join(&r["file"])).unwrap()).collect();
    let start = Instant::now();
    let mut placed = 0;
    for k in 0..1000 {
        placed += usize::from(parse(&files[k % files.len()]).exposure.position.is_some());
    }
    let taken = start.elapsed();
    println!("1000 photos in {taken:?}");
    assert_eq!(placed, 1000);
    assert!(cfg!(debug_assertions) || taken.as_secs_f64() < 1.0, "{taken:?}");
}
