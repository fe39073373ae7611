//! Logs encoded by hand, and a real one.

use super::super::autopilot::yaw_is_from_north;
use super::super::{Clock, FlightLog, LoggedAttitude, LoggedPosition};
use super::container::{Event, MAGIC, walk};
use super::{Quarantine, read};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::navigation::GimbalReference;
use proptest::prelude::*;
use std::path::Path;

fn message(kind: u8, body: &[u8]) -> Vec<u8> {
    [&(body.len() as u16).to_le_bytes()[..], &[kind], body].concat()
}

fn start() -> Vec<u8> {
    [&MAGIC[..], &[1], &0u64.to_le_bytes(), &message(b'B', &[0; 40])].concat()
}

fn format(text: &str) -> Vec<u8> {
    message(b'F', text.as_bytes())
}

fn subscribe(multi: u8, id: u16, topic: &str) -> Vec<u8> {
    message(b'A', &[&[multi][..], &id.to_le_bytes(), topic.as_bytes()].concat())
}

/// A body under construction.
#[derive(Default)]
struct Data(Vec<u8>);

impl Data {
    fn of(id: u16, us: u64) -> Self {
        Self([&id.to_le_bytes()[..], &us.to_le_bytes()].concat())
    }
    fn u8(self, v: u8) -> Self {
        self.raw(&[v])
    }
    fn i32(self, v: i32) -> Self {
        self.raw(&v.to_le_bytes())
    }
    fn u64(self, v: u64) -> Self {
        self.raw(&v.to_le_bytes())
    }
    fn f(self, values: &[f32]) -> Self {
        values.iter().fold(self, |s, v| s.raw(&v.to_le_bytes()))
    }
    fn d(self, values: &[f64]) -> Self {
        values.iter().fold(self, |s, v| s.raw(&v.to_le_bytes()))
    }
    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }
    fn end(self) -> Vec<u8> {
        message(b'D', &self.0)
    }
}

/// Yaw about down, then pitch: the quaternion by half angles.
fn q(yaw_deg: f64, pitch_deg: f64) -> [f32; 4] {
    let half = |d: f64| (d * std::f64::consts::PI / 360.0).sin_cos();
    let ((sy, cy), (sp, cp)) = (half(yaw_deg), half(pitch_deg));
    [cy * cp, -sy * sp, cy * sp, sy * cp].map(|v| v as f32)
}

const GLOBAL: &str = "vehicle_global_position:uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;\
                      float alt;float alt_ellipsoid;bool lat_lon_valid;bool alt_valid;uint8_t[6] _padding0;";
const CAPTURE: &str = "camera_capture:uint64_t timestamp;uint64_t timestamp_utc;double lat;double lon;uint32_t seq;\
                       float alt;float ground_distance;float[4] q;int8_t result;uint8_t[3] _padding0;";

fn attitude(us: u64, yaw: f64, pitch: f64) -> Vec<u8> {
    Data::of(0, us).f(&q(yaw, pitch)).end()
}

fn global(us: u64, lat: f64, valid: u8) -> Vec<u8> {
    Data::of(1, us).u64(us - 20_000).d(&[lat, 10.25]).f(&[66.5, 106.5]).u8(valid).u8(1).end()
}

fn capture(us: u64, sequence: u32, q: [f32; 4], result: i8) -> Vec<u8> {
    let data = Data::of(2, us).u64(0).d(&[63.5, 10.25]).raw(&sequence.to_le_bytes()).f(&[66.0, 40.0]).f(&q);
    data.raw(&result.to_le_bytes()).end()
}

fn topics() -> Vec<u8> {
    [
        start(),
        format("vehicle_attitude:uint64_t timestamp;float[4] q;"),
        format(GLOBAL),
        format(CAPTURE),
        format("gimbal_device_attitude_status:uint64_t timestamp;float[4] q;uint16_t device_flags;"),
        format(
            "sensor_gps:uint64_t timestamp;double latitude_deg;double longitude_deg;double altitude_msl_m;\
                double altitude_ellipsoid_m;uint64_t time_utc_usec;uint8_t fix_type;",
        ),
        subscribe(0, 0, "vehicle_attitude"),
        subscribe(0, 1, "vehicle_global_position"),
        subscribe(0, 2, "camera_capture"),
        subscribe(0, 3, "gimbal_device_attitude_status"),
        subscribe(0, 4, "sensor_gps"),
    ]
    .concat()
}

fn gimbal(us: u64, q: [f32; 4], flags: u16) -> Vec<u8> {
    Data::of(3, us).f(&q).raw(&flags.to_le_bytes()).end()
}

fn gps(us: u64, utc_us: u64) -> Vec<u8> {
    Data::of(4, us).d(&[63.4, 10.2, 50.0, 90.0]).u64(utc_us).u8(3).end()
}

fn flight() -> Vec<u8> {
    let mut log = topics();
    for i in 0..20u64 {
        let us = 5_000_000 + 100_000 * i;
        log.extend(attitude(us, 30.0 + i as f64, 4.0));
        log.extend(global(us, 63.5 + 1e-5 * i as f64, 1));
        log.extend(gps(us, 1_618_986_658_000_000 + us));
    }
    log.extend(capture(6_050_000, 3, q(40.5, 4.0), 1));
    log.extend(capture(6_150_000, 4, q(41.5, 4.0), 0));
    log.extend(capture(6_250_000, 5, q(42.5, 4.0), -1));
    log
}

#[test]
fn a_flight_is_read_by_names_types_and_clocks() {
    let log = read(&flight()).unwrap();
    assert_eq!((log.clock, log.attitudes.len(), log.positions.len()), (Clock::Utc, 20, 20));
    let utc = 1_618_986_658.0;
    assert!((log.attitudes[3].time.get() - utc - 5.3).abs() < 1e-6);
    // The state holds for timestamp_sample, 20 ms before it was logged.
    assert!((log.positions[3].time.get() - utc - 5.28).abs() < 1e-6);
    let LoggedPosition::Geodetic { latitude, longitude, height_m, kind } = log.positions[3].value else {
        panic!()
    };
    assert!((latitude.degrees() - 63.500_03).abs() < 1e-12 && (longitude.degrees() - 10.25).abs() < 1e-12);
    assert_eq!((height_m, kind), (106.5, HeightKind::Ellipsoid));
    let LoggedAttitude::Body { angles, .. } = log.attitudes[3].value else { panic!() };
    assert!((angles.yaw.degrees() - 33.0).abs() < 1e-4 && (angles.pitch.degrees() - 4.0).abs() < 1e-4);
}

#[test]
fn captures_are_exposures_and_failures_are_not() {
    let log = read(&flight()).unwrap();
    let sequences: Vec<_> = log.exposures.iter().map(|e| e.sequence.unwrap()).collect();
    assert_eq!(sequences, [3, 5]);
    assert!(log.bad.len() == 1 && log.bad[0].cause.contains("photo 4 failed"), "{:?}", log.bad);
    assert!(log.notes.iter().any(|n| n.starts_with("1 exposures of cameras that report nothing back")));
    let shot = &log.exposures[0];
    assert!((shot.time.unwrap().get() - 1_618_986_664.05).abs() < 1e-6);
    assert_eq!(shot.height_above_ground_m, Some(40.0));
    let Some(LoggedPosition::Geodetic { height_m, kind, .. }) = shot.position else { panic!() };
    assert_eq!((height_m, kind), (66.0, HeightKind::SeaLevel(GeoidModel::Egm96)));
    let Some(LoggedAttitude::Body { angles, .. }) = shot.attitude else { panic!() };
    assert!((angles.yaw.degrees() - 40.5).abs() < 1e-4 && shot.gimbal.is_none());
}

#[test]
fn gimbals_count_from_north_and_own_the_captures_quaternion() {
    let mut log = topics();
    for i in 0..20u64 {
        let us = 5_000_000 + 100_000 * i;
        log.extend(attitude(us, 170.0, 4.0));
        // In the vehicle's frame (32), 20° to the right; later in the earth's (64); then by the yaw lock alone (16).
        let (yaw, flags) = [(20.0, 32), (190.0, 64), (190.0, 16), (20.0, 12)][i as usize % 4];
        log.extend(gimbal(us, q(yaw, -80.0), flags));
    }
    log.extend(capture(6_050_000, 3, q(190.0, -80.0), 1));
    let log = read(&log).unwrap();
    assert_eq!((log.clock, log.gimbals.len()), (Clock::Own, 20));
    for gimbal in &log.gimbals {
        let angles = gimbal.value.angles;
        assert_eq!(gimbal.value.reference, GimbalReference::Nav);
        assert!(
            (angles.pan.degrees() + 170.0).abs() < 1e-3 && (angles.elevation.degrees() + 80.0).abs() < 1e-3
        );
    }
    let shot = &log.exposures[0];
    let of_camera = shot.gimbal.unwrap();
    assert!(shot.attitude.is_none() && of_camera.reference == GimbalReference::Nav);
    assert!((of_camera.angles.elevation.degrees() + 80.0).abs() < 1e-3);
    assert!(
        yaw_is_from_north(64)
            && yaw_is_from_north(16)
            && !yaw_is_from_north(32 | 16)
            && !yaw_is_from_north(0)
    );
}

#[test]
fn old_integers_and_local_positions_are_read_by_type() {
    let mut log = start();
    let gps = "vehicle_gps_position:uint64_t timestamp;int32_t lat;int32_t lon;int32_t alt;int32_t alt_ellipsoid;\
               uint8_t fix_type;";
    let local = "vehicle_local_position:uint64_t timestamp;double ref_lat;double ref_lon;float x;float y;float z;\
                 float vx;float vy;float vz;float ref_alt;float dist_bottom;bool xy_valid;bool z_valid;bool v_xy_valid;\
                 bool v_z_valid;bool xy_global;bool z_global;bool dist_bottom_valid;";
    log.extend([format(gps), format(local), subscribe(0, 9, "vehicle_local_position")].concat());
    let row = |us: u64, valid: u8| {
        let data = Data::of(9, us).d(&[63.5, 10.25]).f(&[100.0, -50.0, -20.0, 1.0, 2.0, 3.0, 66.0, 19.5]);
        data.raw(&[valid, 1, 1, 1, valid, 1, valid]).end()
    };
    log.extend([row(1_000_000, 0), row(1_100_000, 1)].concat());
    let of_local = read(&log).unwrap();
    assert_eq!(
        (of_local.positions.len(), of_local.velocities.len(), of_local.heights_above_ground.len()),
        (1, 2, 1)
    );
    let LoggedPosition::Geodetic { latitude, longitude, height_m, .. } = of_local.positions[0].value else {
        panic!()
    };
    // 100 m north and 50 m west on a sphere of 6 371 000 m: by 100/R and 50/(R·cos 63.5°).
    assert!((latitude.degrees() - 63.5 - 8.993_216e-4).abs() < 1e-8, "{}", latitude.degrees());
    assert!((longitude.degrees() - 10.25 + 1.007_773e-3).abs() < 1e-7, "{}", longitude.degrees());
    assert!((height_m - 86.0).abs() < 1e-6);
    log.extend(subscribe(0, 7, "vehicle_gps_position"));
    log.extend(Data::of(7, 2).i32(634_170_622).i32(104_082_151).i32(66_814).i32(106_766).u8(2).end());
    log.extend(Data::of(7, 3).i32(634_170_622).i32(104_082_151).i32(66_814).i32(0).u8(3).end());
    let of_gps = read(&log).unwrap();
    assert_eq!(of_gps.positions.len(), 1);
    let LoggedPosition::Geodetic { latitude, height_m, kind, .. } = of_gps.positions[0].value else {
        panic!()
    };
    assert!((latitude.degrees() - 63.417_062_2).abs() < 1e-10 && (height_m - 66.814).abs() < 1e-9);
    // Its ellipsoidal height is not filled in.
    assert_eq!(kind, HeightKind::SeaLevel(GeoidModel::Egm96));
    assert_eq!(of_gps.velocities.len(), 2);
}

#[test]
fn of_several_instances_the_lowest_with_data_is_read() {
    let mut log = topics();
    log.extend(subscribe(1, 20, "vehicle_attitude"));
    log.extend(Data::of(20, 1_000_000).f(&q(99.0, 0.0)).end());
    let yaw = |log: &FlightLog, i: usize| match log.attitudes[i].value {
        LoggedAttitude::Body { angles, .. } => angles.yaw.degrees(),
        _ => panic!(),
    };
    assert!((yaw(&read(&log).unwrap(), 0) - 99.0).abs() < 1e-4);
    log.extend(attitude(2_000_000, 11.0, 0.0));
    let both = read(&log).unwrap();
    assert!(both.attitudes.len() == 1 && (yaw(&both, 0) - 11.0).abs() < 1e-4);
}

#[test]
fn a_bad_message_takes_only_itself_along() {
    let mut log = topics();
    log.extend(attitude(1_000_000, 10.0, 0.0));
    log.extend(Data::of(0, 1_100_000).f(&[f32::NAN, 0.0, 0.0, 1.0]).end());
    log.extend(global(1_100_000, 91.0, 1));
    log.extend(global(1_200_000, 63.5, 0));
    log.extend([0xFF; 31]);
    let whole = attitude(1_200_000, 10.0, 0.0);
    // Four messages in a row are needed to trust a place after damage.
    for _ in 0..4 {
        log.extend(&whole);
    }
    log.extend(&whole[..17]);
    for i in 0..6 {
        log.extend(attitude(1_300_000 + i, 10.0, 0.0));
    }
    log.extend(&whole[..9]);
    let log = read(&log).unwrap();
    assert_eq!((log.attitudes.len(), log.positions.len()), (11, 0));
    let causes: Vec<&str> = log.bad.iter().map(|b| b.cause.as_str()).collect();
    assert_eq!(causes.len(), 5, "{causes:?}");
    for words in ["NaN", "latitude 91°", "31 bytes", "lost 12 bytes", "9 bytes"] {
        assert!(causes.iter().any(|c| c.contains(words)), "{words}: {causes:?}");
    }
}

#[test]
fn appended_data_follow_a_cut_message() {
    let mut log = topics();
    log.extend(attitude(1_000_000, 10.0, 0.0));
    log.extend(&attitude(1_100_000, 10.0, 0.0)[..14]);
    let offset = log.len() as u64;
    log.extend(attitude(1_200_000, 10.0, 0.0));
    // The flag bits' body starts 19 bytes into the file: its 8 compatible, 8 incompatible flags, then the offsets.
    log[19 + 8] = 1;
    log[19 + 16..19 + 24].copy_from_slice(&offset.to_le_bytes());
    let read_log = read(&log).unwrap();
    assert_eq!((read_log.attitudes.len(), read_log.bad.len()), (2, 1));
    log[19 + 8] = 2;
    assert!(read(&log).unwrap_err().cause.contains("incompatible flags"));
}

#[test]
fn what_is_no_ulog_is_refused() {
    for bytes in [&b""[..], b"ULog", &[0; 500]] {
        assert!(read(bytes).unwrap_err().cause.contains("no PX4 ULog"));
    }
}

/// Every message of one topic as rows of the named numbers (`q[1]`: an element).
fn rows(bytes: &[u8], topic: &str, columns: &[&str]) -> Vec<Vec<f64>> {
    let mut wanted = None;
    let mut rows = Vec::new();
    walk(bytes, &mut Quarantine::default(), |event| match event {
        Event::Subscribed(id, name, 0, layout) if name == topic => {
            let fields: Vec<_> = columns
                .iter()
                .map(|c| {
                    let (name, i) =
                        c.split_once('[').map_or((*c, "0"), |(n, i)| (n, i.trim_end_matches(']')));
                    layout.field(name).unwrap().element(i.parse().unwrap())
                })
                .collect();
            wanted = Some((id, fields));
        }
        Event::Data(_, id, body) => {
            if let Some((_, fields)) = wanted.as_ref().filter(|(wanted, _)| *wanted == id) {
                rows.push(fields.iter().map(|f| f.number(body).unwrap()).collect());
            }
        }
        _ => {}
    })
    .unwrap();
    rows
}

fn real() -> Option<(std::path::PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/autopilot-logs");
    let Ok(bytes) = std::fs::read(folder.join("px4_sample_log_small.ulg")) else {
        eprintln!("skipped: the data set autopilot-logs is not on this machine");
        return None;
    };
    Some((folder, bytes))
}

#[test]
fn a_real_log_equals_what_pyulog_extracts() {
    let Some((folder, bytes)) = real() else { return };
    for (topic, count) in
        [("vehicle_attitude", 1298), ("vehicle_gps_position", 32), ("vehicle_local_position", 636)]
    {
        let text = std::fs::read_to_string(folder.join(format!("px4_{topic}.csv"))).unwrap();
        let mut lines = text.lines();
        let columns: Vec<&str> = lines.next().unwrap().split(',').collect();
        let rows = rows(&bytes, topic, &columns);
        assert_eq!(rows.len(), count, "{topic}");
        for (row, line) in rows.iter().zip(lines) {
            for ((value, printed), column) in row.iter().zip(line.split(',')).zip(&columns) {
                let expected: f64 = printed.parse().unwrap();
                let same = *value == expected || value.is_nan() && expected.is_nan();
                assert!(same, "{topic}.{column}: {value}, printed {printed}");
            }
        }
    }
}

#[test]
fn a_real_log_on_the_bench_stands_still() {
    let Some((_, bytes)) = real() else { return };
    let log = read(&bytes).unwrap();
    assert_eq!((log.attitudes.len(), log.positions.len(), log.clock), (1298, 32, Clock::Utc));
    let LoggedPosition::Geodetic { latitude, height_m, kind, .. } = log.positions[0].value else { panic!() };
    assert!((latitude.degrees() - 63.417_062_2).abs() < 1e-9);
    assert_eq!((height_m, kind), (106.766, HeightKind::Ellipsoid));
    // 2021-04-21T06:30:58.6Z, the receiver's own time of its first message, to the 9 ms that its messages vary by.
    assert!((log.positions[0].time.get() - 1_618_986_658.600_345).abs() < 0.02);
    for sample in &log.attitudes[100..] {
        let LoggedAttitude::Body { angles, .. } = sample.value else { panic!() };
        assert!((angles.roll.degrees() - 1.0).abs() < 0.5 && angles.pitch.degrees().abs() < 0.5);
    }
    // The filter's velocities are marked not valid, the receiver's are valid; 0.242 m/s down in its first message.
    assert_eq!(log.velocities.len(), 32);
    assert!((log.velocities[0].value.z() - 0.242).abs() < 1e-6);
    assert!(!log.heights_above_ground.is_empty());
    assert!(log.bad.is_empty(), "{:?}", log.bad);
}

#[test]
fn a_real_log_loses_nothing_to_bytes_put_in() {
    let Some((_, mut bytes)) = real() else { return };
    let middle = bytes.len() / 2;
    bytes.splice(middle..middle, [0x5A; 20]);
    let log = read(&bytes).unwrap();
    assert!(log.attitudes.len() >= 1297 && !log.bad.is_empty(), "{}", log.attitudes.len());
}

proptest! {
    #[test]
    fn damage_is_survived(flips in proptest::collection::vec((0usize..6_000, 1u8..), 0..20), cut in 0usize..6_000) {
        let mut bytes = flight();
        for (at, flip) in flips {
            let at = at % bytes.len();
            bytes[at] ^= flip;
        }
        bytes.truncate(cut);
        if let Ok(log) = read(&bytes) {
            prop_assert!(log.attitudes.len() + log.positions.len() + log.exposures.len() <= bytes.len());
            prop_assert!(log.bad.len() <= 1_000);
        }
    }

    #[test]
    fn any_bytes_after_the_definitions_are_survived(tail in proptest::collection::vec(any::<u8>(), 0..2_000)) {
        prop_assert!(read(&[topics(), tail].concat()).is_ok());
    }

    #[test]
    fn any_formats_are_survived(text in "[a-c:;\\[\\]0-9 _]{0,60}") {
        let bytes = [start(), format(&format!("vehicle_attitude:{text}")), subscribe(0, 0, "vehicle_attitude")].concat();
        prop_assert!(read(&bytes).is_ok());
    }
}
