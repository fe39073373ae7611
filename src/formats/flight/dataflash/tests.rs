//! Logs encoded by hand, and a real one.

use super::super::autopilot::Quarantine;
use super::super::{Clock, FlightLog, LoggedAttitude, LoggedPosition, North};
use super::container::{Event, Format, walk};
use super::read;
use crate::geodesy::{GeoidModel, HeightKind};
use crate::navigation::GimbalReference;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// A value to encode.
#[derive(Clone, Copy)]
enum V {
    U8(u8),
    U16(u16),
    I16(i16),
    U32(u32),
    I32(i32),
    U64(u64),
    F(f32),
    D(f64),
    T(&'static str, usize),
}
use V::{D, F, I16, I32, T, U8, U16, U32, U64};

fn message(kind: u8, values: &[V]) -> Vec<u8> {
    let mut bytes = vec![0xA3, 0x95, kind];
    for value in values {
        match *value {
            U8(v) => bytes.push(v),
            U16(v) => bytes.extend(v.to_le_bytes()),
            I16(v) => bytes.extend(v.to_le_bytes()),
            U32(v) => bytes.extend(v.to_le_bytes()),
            I32(v) => bytes.extend(v.to_le_bytes()),
            U64(v) => bytes.extend(v.to_le_bytes()),
            F(v) => bytes.extend(v.to_le_bytes()),
            D(v) => bytes.extend(v.to_le_bytes()),
            T(text, size) => {
                let mut padded = text.as_bytes().to_vec();
                padded.resize(size, 0);
                bytes.extend(padded);
            }
        }
    }
    bytes
}

fn fmt(kind: u8, length: u8, name: &'static str, letters: &'static str, labels: &'static str) -> Vec<u8> {
    message(0x80, &[U8(kind), U8(length), T(name, 4), T(letters, 16), T(labels, 64)])
}

const GPS: &str = "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U";
const CAM: &str = "TimeUS,I,Img,GPSTime,GPSWeek,Lat,Lng,Alt,RelAlt,GPSAlt,R,P,Y";

/// Formats as Copter 4.x writes them.
fn formats() -> Vec<u8> {
    [
        fmt(1, 28, "ATT", "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
        fmt(2, 51, "GPS", "QBBIHBcLLeffffB", GPS),
        fmt(3, 31, "POS", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
        fmt(4, 46, "CAM", "QBHIHLLeeeccC", CAM),
        fmt(5, 46, "TRIG", "QBHIHLLeeeccC", CAM),
        fmt(6, 48, "MNT", "QBfffffffff", "TimeUS,I,DRoll,Roll,DPitch,Pitch,DYawB,YawB,DYawE,YawE,Dist"),
        fmt(7, 16, "RFND", "QBCBB", "TimeUS,Instance,Dist,Stat,Orient"),
        fmt(8, 56, "XKF1", "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
        fmt(9, 31, "PARM", "QNf", "TimeUS,Name,Value"),
        fmt(10, 44, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        fmt(11, 20, "MULT", "Qbd", "TimeUS,Id,Mult"),
    ]
    .concat()
}

fn att(us: u64, roll: i16, pitch: i16, yaw: u16) -> Vec<u8> {
    let [zero, none] = [I16(0), U16(0)];
    message(1, &[U64(us), zero, I16(roll), zero, I16(pitch), none, U16(yaw), none, none, U8(3)])
}

fn gps(us: u64, instance: u8, status: u8, ms: u32, lat: i32, alt_cm: i32) -> Vec<u8> {
    let place = [I32(lat), I32(1_491_647_457), I32(alt_cm)];
    let start = [U64(us), U8(instance), U8(status), U32(ms), U16(2300), U8(12), I16(80)];
    message(2, &[&start[..], &place, &[F(5.0), F(90.0), F(-0.5), F(0.0), U8(1)]].concat())
}

fn pos(us: u64, lat: i32, alt: f32) -> Vec<u8> {
    message(3, &[U64(us), I32(lat), I32(1_491_647_457), F(alt), F(20.0), F(20.0)])
}

fn cam(kind: u8, us: u64, image: u16, lat: i32) -> Vec<u8> {
    let start = [U64(us), U8(0), U16(image), U32(100_000), U16(2300), I32(lat), I32(1_491_647_457)];
    let end = [I32(60_012), I32(8_050), I32(60_100), I16(-17_950), I16(250), U16(35_999)];
    message(kind, &[&start[..], &end].concat())
}

/// A whole small flight: 1 s of everything at 10 Hz from 10 s after start-up.
fn flight() -> Vec<u8> {
    let mut log = formats();
    for i in 0..11u64 {
        let us = 10_000_000 + 100_000 * i;
        log.extend(att(us, 100, -200, if i < 5 { 35_900 } else { 100 }));
        log.extend(gps(us, 0, 3, 100_000 + 100 * i as u32, -353_640_332, 58_000));
        log.extend(pos(us, -353_640_000 + i as i32, 581.25));
    }
    log.extend(cam(4, 10_550_000, 7, -353_640_005));
    log.extend(cam(5, 10_500_000, 7, -353_640_005));
    log
}

#[test]
fn a_flight_is_read_by_names_units_and_clocks() {
    let log = read(&flight()).unwrap();
    assert_eq!((log.clock, log.positions.len(), log.attitudes.len(), log.bad.len()), (Clock::Utc, 11, 11, 0));
    // Week 2300 starts on 2024-02-04 (Unix 1 707 004 800); 100 s later on GPS time, 18 leap seconds taken off.
    let start = 1_707_004_800.0 + 100.0 - 18.0;
    assert!((log.positions[0].time.get() - start).abs() < 1e-6);
    assert!((log.attitudes[10].time.get() - start - 1.0).abs() < 1e-6);
    let LoggedPosition::Geodetic { latitude, longitude, height_m, kind } = log.positions[3].value else {
        panic!()
    };
    assert!((latitude.degrees() + 35.363_999_7).abs() < 1e-10);
    assert!((longitude.degrees() - 149.164_745_7).abs() < 1e-10);
    assert_eq!((height_m, kind), (581.25, HeightKind::SeaLevel(GeoidModel::Egm96)));
    let LoggedAttitude::Body { angles, north } = log.attitudes[0].value else { panic!() };
    assert_eq!(north, North::True);
    for (angle, degrees) in [(angles.yaw, -1.0), (angles.pitch, -2.0), (angles.roll, 1.0)] {
        assert!((angle.degrees() - degrees).abs() < 1e-9);
    }
    // 5 m/s on a course of 90°, climbing at 0.5 m/s.
    let v = log.velocities[0].value;
    assert!(v.x().abs() < 1e-9 && (v.y() - 5.0).abs() < 1e-9 && v.z() == -0.5);
    assert!(log.notes.iter().any(|n| n.contains("records of POS")), "{:?}", log.notes);
}

#[test]
fn feedback_is_preferred_to_commands_and_carries_the_vehicle() {
    let log = read(&flight()).unwrap();
    assert_eq!(log.exposures.len(), 1);
    let shot = &log.exposures[0];
    assert_eq!((shot.sequence, shot.height_above_takeoff_m), (Some(7), Some(80.5)));
    assert!((shot.time.unwrap().get() - (1_707_004_882.0 + 0.55)).abs() < 1e-6);
    let Some(LoggedAttitude::Body { angles, .. }) = shot.attitude else { panic!() };
    assert!((angles.roll.degrees() + 179.5).abs() < 1e-9 && (angles.yaw.degrees() + 0.01).abs() < 1e-9);
    let Some(LoggedPosition::Geodetic { height_m, .. }) = shot.position else { panic!() };
    assert!((height_m - 600.12).abs() < 1e-9);
    assert!(log.notes.iter().any(|n| n.contains("1 CAM") && n.contains("1 TRIG")), "{:?}", log.notes);
    let commands: Vec<u8> = [formats(), cam(5, 1_000_000, 3, -353_640_005)].concat();
    let log = read(&commands).unwrap();
    assert_eq!((log.exposures.len(), log.exposures[0].sequence, log.clock), (1, Some(3), Clock::Own));
    assert!((log.exposures[0].time.unwrap().get() - 1.0).abs() < 1e-12);
}

#[test]
fn rows_without_a_fix_and_other_receivers_are_left_out() {
    let mut log = formats();
    log.extend(gps(1_000_000, 0, 1, 0, 1, 0));
    for i in 0..4u32 {
        let us = 2_000_000 + 100_000 * u64::from(i);
        log.extend(gps(us, 0, 3, 200_000 + 100 * i, -353_640_332, 58_000));
        log.extend(gps(us, 1, 4, 200_000 + 100 * i, -353_640_400, 59_000));
    }
    let log = read(&log).unwrap();
    assert_eq!(log.positions.len(), 4);
    for p in &log.positions {
        let LoggedPosition::Geodetic { height_m, .. } = p.value else { panic!() };
        assert_eq!(height_m, 580.0);
    }
    for expected in ["1 GPS records without a 3-D fix", "of 2 receivers GPS instance 0", "records of GPS"] {
        assert!(log.notes.iter().any(|n| n.contains(expected)), "{expected}: {:?}", log.notes);
    }
}

#[test]
fn the_mounts_actual_angles_are_counted_from_north() {
    let mut log = formats();
    log.extend(att(1_000_000, 0, 0, 9_000));
    log.extend(att(1_400_000, 0, 0, 10_000));
    let mount = |us, yaw_b, yaw_e| {
        let desired_actual = [F(9.0), F(1.0), F(-45.0), F(-80.0), F(9.0), F(yaw_b), F(9.0), F(yaw_e), F(0.0)];
        message(6, &[&[U64(us), U8(0)][..], &desired_actual].concat())
    };
    log.extend(mount(1_200_000, 5.0, 100.5));
    log.extend(mount(1_200_000, 5.0, f32::NAN));
    log.extend(mount(1_200_000, f32::NAN, f32::NAN));
    let log = read(&log).unwrap();
    assert_eq!(log.gimbals.len(), 2);
    for (gimbal, pan) in log.gimbals.iter().zip([100.5, 100.0]) {
        let angles = gimbal.value.angles;
        assert_eq!(gimbal.value.reference, GimbalReference::Nav);
        assert!((angles.pan.degrees() - pan).abs() < 1e-6, "{}", angles.pan.degrees());
        assert!(
            (angles.elevation.degrees() + 80.0).abs() < 1e-9 && (angles.roll.degrees() - 1.0).abs() < 1e-9
        );
    }
    assert!(log.notes.iter().any(|n| n.starts_with("1 MNT records are left out")), "{:?}", log.notes);
}

#[test]
fn velocities_are_those_of_the_filters_primary_core() {
    let mut log = formats();
    log.extend(fmt(12, 13, "XKF4", "QBb", "TimeUS,C,PI"));
    for (core, north) in [(0, 1.0), (1, 2.0)] {
        let start = [U64(1_000_000), U8(core), I16(0), I16(0), U16(0)];
        let numbers = [F(north), F(-3.0), F(0.5), F(0.0), F(0.0), F(0.0), F(0.0)];
        let end = [I16(0), I16(0), I16(0), I32(0)];
        log.extend(message(8, &[&start[..], &numbers, &end].concat()));
    }
    let first = read(&log).unwrap();
    assert_eq!((first.velocities.len(), first.velocities[0].value.x()), (1, 1.0));
    for primary in [0, 1, 1] {
        log.extend(message(12, &[U64(1), U8(0), U8(primary)]));
    }
    let primary = read(&log).unwrap();
    assert_eq!((primary.velocities.len(), primary.velocities[0].value.x()), (1, 2.0));
    assert!(primary.origins.iter().any(|o| o.from.starts_with("XKF1.VN") && o.meaning.contains("core 1")));
}

#[test]
fn ranges_are_made_vertical_and_only_good_ones_taken() {
    let mut log = formats();
    log.extend(att(1_000_000, 6_000 - 1, 0, 0));
    log.extend(att(1_200_000, 6_000 - 1, 0, 0));
    let range = |status, orient| message(7, &[U64(1_100_000), U8(0), U16(5_000), U8(status), U8(orient)]);
    for (status, orient) in [(4, 25), (3, 25), (4, 0)] {
        log.extend(range(status, orient));
    }
    let log = read(&log).unwrap();
    assert_eq!(log.heights_above_ground.len(), 1);
    // cos 59.99° = 0.500151.
    assert!((log.heights_above_ground[0].value - 25.007_557).abs() < 1e-4);
}

#[test]
fn units_and_parameters_of_the_log_are_heeded() {
    let mut log = formats();
    // FMTU says that POS counts in 1e-6 degrees and in decimetres, the ATT in thousandths.
    log.extend(message(11, &[U64(1), U8(b'x'), D(1e-3)]));
    log.extend(message(10, &[U64(1), U8(3), T("sDUmmm", 16), T("FFGA00", 16)]));
    log.extend(message(10, &[U64(1), U8(1), T("sddddhhdh-", 16), T("Fxxxxxxxx-", 16)]));
    log.extend(pos(3_000_000, -35_364_000, 5_812.5));
    log.extend(att(3_000_000, 1_000, -2_000, 3_000));
    for (name, value) in [("COMPASS_AUTODEC", 0.0), ("COMPASS_DEC", 0.0), ("COMPASS_USE", 1.0)] {
        log.extend(message(9, &[U64(1), T(name, 16), F(value)]));
    }
    let log = read(&log).unwrap();
    assert!((log.positions[0].time.get() - 3.0).abs() < 1e-12);
    let LoggedPosition::Geodetic { latitude, height_m, .. } = log.positions[0].value else { panic!() };
    assert!((latitude.degrees() + 35.364).abs() < 1e-9 && (height_m - 581.25).abs() < 1e-9);
    let LoggedAttitude::Body { angles, north } = log.attitudes[0].value else { panic!() };
    assert_eq!(north, North::Magnetic);
    assert!((angles.roll.degrees() - 1.0).abs() < 1e-9 && (angles.yaw.degrees() - 3.0).abs() < 1e-9);
}

#[test]
fn old_logs_count_in_milliseconds_and_older_exposures_in_gps_time() {
    let gps = "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T";
    let mut log = fmt(1, 17, "ATT", "IccccC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,Yaw");
    log.extend(fmt(2, 45, "GPS", "BIHBcLLeeEefI", gps));
    log.extend(fmt(4, 27, "CAM", "IHLLeccC", "GPSTime,GPSWeek,Lat,Lng,Alt,Roll,Pitch,Yaw"));
    log.extend(message(1, &[U32(5_000), I16(0), I16(150), I16(0), I16(-50), U16(27_000)]));
    let place = [I32(-353_640_332), I32(1_491_647_457), I32(2_000), I32(58_000)];
    let start = [U8(3), U32(300_000), U16(1800), U8(9), I16(99)];
    log.extend(message(2, &[&start[..], &place, &[U32(250), I32(0), F(0.0), U32(5_000)]].concat()));
    let angles = [I16(0), I16(0), U16(9_000)];
    log.extend(message(
        4,
        &[&[U32(301_500), U16(1800)][..], &[place[0], place[1], place[3]], &angles].concat(),
    ));
    let log = read(&log).unwrap();
    // Week 1800 starts on 2014-07-06 (Unix 1 404 604 800); 16 leap seconds then.
    let t0 = 1_404_604_800.0 + 300.0 - 16.0;
    assert!((log.attitudes[0].time.get() - t0).abs() < 1e-6);
    assert!((log.exposures[0].time.unwrap().get() - t0 - 1.5).abs() < 1e-6);
    assert!((log.velocities[0].value.x() - 2.5).abs() < 1e-9);
}

#[test]
fn fixes_that_nothing_joins_to_the_attitudes_are_told() {
    let mut log = fmt(2, 23, "GPS", "BIHLLeB", "Status,TimeMS,Week,Lat,Lng,Alt,NSats");
    let place = [I32(-353_640_332), I32(1_491_647_457), I32(58_000)];
    log.extend(message(2, &[&[U8(3), U32(300_000), U16(1800)][..], &place, &[U8(9)]].concat()));
    let log = read(&log).unwrap();
    assert!(log.positions.is_empty());
    assert!(log.notes.iter().any(|n| n.starts_with("1 GPS records without a time")), "{:?}", log.notes);
}

#[test]
fn a_bad_record_takes_only_itself_along() {
    let mut log = formats();
    log.extend(pos(1_000_000, -353_640_000, 500.0));
    log.extend(pos(1_100_000, 910_000_000, 500.0));
    log.extend(pos(1_200_000, -353_640_000, f32::NAN));
    log.extend([0xA3, 0x95, 0x77, 1, 2, 3]);
    log.extend(pos(1_400_000, -353_640_000, 500.0));
    // A record that lost its last bytes, and the next one unharmed.
    let cut = pos(1_500_000, -353_640_000, 500.0);
    log.extend(&cut[..20]);
    log.extend(pos(1_600_000, -353_640_000, 500.0));
    log.extend(pos(1_700_000, -353_640_000, 500.0));
    log.extend(&cut[..15]);
    let log = read(&log).unwrap();
    let times: Vec<f64> = log.positions.iter().map(|p| p.time.get()).collect();
    for (time, expected) in times.iter().zip([1.0, 1.4, 1.6, 1.7]) {
        assert!((time - expected).abs() < 1e-9, "{times:?}");
    }
    assert_eq!(times.len(), 4);
    let causes: Vec<&str> = log.bad.iter().map(|b| b.cause.as_str()).collect();
    assert_eq!(causes.len(), 5, "{causes:?}");
    for (cause, words) in causes.iter().zip(["latitude 91°", "NaN", "6 bytes", "lost 11 bytes", "15 bytes"])
    {
        assert!(cause.contains(words), "{cause}");
    }
}

#[test]
fn exposures_without_end_are_cut_off() {
    let mut log = fmt(4, 3, "CAM", "", "");
    for _ in 0..200_500 {
        log.extend([0xA3, 0x95, 4]);
    }
    let log = read(&log).unwrap();
    assert_eq!((log.exposures.len(), log.bad.len()), (200_000, 500));
}

#[test]
fn what_is_no_dataflash_log_is_refused_with_the_next_step() {
    for bytes in [&b""[..], b"FMT, 128, 89, FMT, BBnNZ", &[0xA3, 0x95, 0x80], &[0; 5000]] {
        let error = read(bytes).unwrap_err();
        assert!(error.cause.contains("no ArduPilot DataFlash log") && error.help.is_some());
    }
}

/// Every message of one name, as rows of the named numbers.
fn rows(bytes: &[u8], name: &str, columns: &[String]) -> Vec<Vec<f64>> {
    let mut formats: BTreeMap<u8, Format> = BTreeMap::new();
    let mut rows = Vec::new();
    walk(bytes, &mut Quarantine::default(), |event| match event {
        Event::Format(kind, format) => {
            if format.name == name {
                formats.insert(kind, format.clone());
            }
        }
        Event::Message(_, kind, body) => {
            if let Some(format) = formats.get(&kind) {
                rows.push(columns.iter().map(|c| format.field(c).unwrap().number(body).unwrap()).collect());
            }
        }
    });
    rows
}

fn real() -> Option<(std::path::PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/autopilot-logs");
    let Ok(bytes) = std::fs::read(folder.join("log171.bin")) else {
        eprintln!("skipped: the data set autopilot-logs is not on this machine");
        return None;
    };
    Some((folder, bytes))
}

#[test]
fn a_real_log_equals_what_pymavlink_extracts() {
    let Some((folder, bytes)) = real() else { return };
    for (name, count) in [("ATT", 2383), ("GPS", 1199), ("AHR2", 2359), ("BARO", 2383)] {
        let text = std::fs::read_to_string(folder.join(format!("log171_{name}.csv"))).unwrap();
        let mut lines = text.lines();
        let columns: Vec<String> = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = rows(&bytes, name, &columns);
        assert_eq!(rows.len(), count, "{name}");
        for (row, line) in rows.iter().zip(lines) {
            for ((value, printed), column) in row.iter().zip(line.split(',')).zip(&columns) {
                let decimals = printed.split('.').nth(1).map_or(0, str::len) as i32;
                let expected: f64 = printed.parse().unwrap();
                let half_digit = 0.500_001 * 10f64.powi(-decimals);
                assert!(
                    (value - expected).abs() <= half_digit,
                    "{name}.{column}: {value}, printed {printed}"
                );
            }
        }
    }
}

#[test]
fn a_real_flight_keeps_its_flip_and_loses_its_rows_without_fix() {
    let Some((_, bytes)) = real() else { return };
    let log = read(&bytes).unwrap();
    assert_eq!(log.clock, Clock::Utc);
    let fixes = rows(&bytes, "GPS", &["Status".to_owned()]).iter().filter(|r| r[0] >= 3.0).count();
    assert_eq!(log.positions.len(), fixes);
    let left_out = format!("{} GPS records without a 3-D fix", 1199 - fixes);
    assert!(log.notes.iter().any(|n| n.contains(&left_out)), "{:?}", log.notes);
    let rolls: Vec<f64> = log
        .attitudes
        .iter()
        .map(|s| match s.value {
            LoggedAttitude::Body { angles, .. } => angles.roll.degrees(),
            _ => panic!(),
        })
        .collect();
    assert!(rolls.iter().any(|r| *r > 170.0) && rolls.iter().any(|r| *r < -170.0));
    assert!(rolls.iter().all(|r| r.abs() <= 180.0));
    // Velocities are the filter's: EKF1 holds 2 383.
    assert_eq!(log.velocities.len(), 2383);
    assert!(log.exposures.is_empty() && log.bad.is_empty(), "{:?}", log.bad);
}

fn size(log: &FlightLog) -> usize {
    log.positions.len() + log.attitudes.len() + log.gimbals.len() + log.velocities.len() + log.exposures.len()
}

proptest! {
    #[test]
    fn damage_is_survived(flips in proptest::collection::vec((0usize..3_000, 1u8..), 0..20), cut in 0usize..4_000) {
        let mut bytes = flight();
        for (at, flip) in flips {
            let at = at % bytes.len();
            bytes[at] ^= flip;
        }
        bytes.truncate(cut);
        if let Ok(log) = read(&bytes) {
            prop_assert!(size(&log) <= bytes.len());
            prop_assert!(log.bad.len() <= 1_000);
        }
    }

    #[test]
    fn any_bytes_after_the_formats_are_survived(tail in proptest::collection::vec(any::<u8>(), 0..2_000)) {
        let bytes = [formats(), tail].concat();
        prop_assert!(read(&bytes).is_ok());
    }

    #[test]
    fn garbage_between_records_costs_no_record(
        garbage in proptest::collection::vec(0u8..0xA3, 1..300), at in 0usize..11,
    ) {
        let mut bytes = formats();
        for i in 0..11u64 {
            bytes.extend(pos(1_000_000 * i, -353_640_000, 500.0));
            if i as usize == at {
                bytes.extend(&garbage);
            }
        }
        let log = read(&bytes).unwrap();
        prop_assert_eq!(log.positions.len(), 11);
        prop_assert_eq!(log.bad.len(), 1);
    }
}
