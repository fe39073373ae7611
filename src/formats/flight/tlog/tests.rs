//! Logs encoded by hand. Two frames of pymavlink check the checksums and the order of the fields.

use super::super::{Clock, LoggedAttitude, LoggedPosition};
use super::container::sealed;
use super::{FlightLog, read, unwrapped};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::navigation::GimbalReference;
use proptest::prelude::*;

const AUTOPILOT: (u8, u8) = (1, 1);
/// The ground station's clock is 0.8 s ahead and messages take at least 0.2 s.
const STATION_AHEAD_US: u64 = 1_000_000;
const START_UTC_US: u64 = 1_700_000_000_000_000;

/// A payload in wire order.
#[derive(Default, Clone)]
struct P(Vec<u8>);

impl P {
    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }
    fn u8(self, v: u8) -> Self {
        self.raw(&[v])
    }
    fn u16(self, v: u16) -> Self {
        self.raw(&v.to_le_bytes())
    }
    fn i16(self, v: i16) -> Self {
        self.raw(&v.to_le_bytes())
    }
    fn u32(self, v: u32) -> Self {
        self.raw(&v.to_le_bytes())
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
    /// Received when the boot clock shows these milliseconds.
    fn at(self, ms: u32, from: (u8, u8), id: u32) -> Vec<u8> {
        sealed(START_UTC_US + 1_000 * u64::from(ms) + STATION_AHEAD_US, from, id, &self.0)
    }
}

fn heartbeat(ms: u32, from: (u8, u8), kind: u8, autopilot: u8) -> Vec<u8> {
    P::default().u32(0).u8(kind).u8(autopilot).u8(81).u8(3).u8(3).at(ms, from, 0)
}

fn attitude(ms: u32, yaw: f32) -> Vec<u8> {
    P::default().u32(ms).f(&[0.1, -0.2, yaw, 0.0, 0.0, 0.0]).at(ms, AUTOPILOT, 30)
}

fn global(ms: u32, lat: i32) -> Vec<u8> {
    let place = P::default().u32(ms).i32(lat).i32(149_164_745).i32(581_250).i32(20_000);
    place.i16(500).i16(-250).i16(-30).u16(9_000).at(ms, AUTOPILOT, 33)
}

fn system_time(ms: u32) -> Vec<u8> {
    P::default().u64(START_UTC_US + 1_000 * u64::from(ms)).u32(ms).at(ms, AUTOPILOT, 2)
}

fn feedback(usec: u64, image: u16) -> Vec<u8> {
    let place =
        P::default().u64(usec).i32(-353_640_000).i32(1_491_647_457).f(&[600.5, 80.5, 1.0, -2.0, 270.0, 0.0]);
    place.u16(image).raw(&[0, 0, 0]).at(10_000, AUTOPILOT, 180)
}

fn flight() -> Vec<u8> {
    let mut log = heartbeat(900, AUTOPILOT, 2, 3);
    // A ground station and another vehicle talk on the same link.
    log.extend(heartbeat(900, (255, 190), 6, 8));
    for i in 0..10 {
        let ms = 1_000 + 100 * i;
        log.extend(heartbeat(ms, AUTOPILOT, 2, 3));
        log.extend(attitude(ms, 1.5));
        log.extend(global(ms, -353_640_000 + i as i32));
        log.extend(system_time(ms));
        log.extend(P::default().u32(ms).f(&[9.0; 6]).at(ms, (2, 1), 30));
    }
    log
}

fn height(log: &FlightLog, i: usize) -> (f64, HeightKind) {
    match log.positions[i].value {
        LoggedPosition::Geodetic { height_m, kind, .. } => (height_m, kind),
        _ => panic!(),
    }
}

#[test]
fn frames_of_pymavlink_are_read() {
    // MAVLink 1 HEARTBEAT and MAVLink 2 ATTITUDE (zeros at the end cut off), packed by pymavlink 2.4.50, system 7.
    let heartbeat = [254, 9, 0, 7, 1, 0, 5, 0, 0, 0, 2, 3, 81, 4, 3, 40, 92];
    let attitude =
        [253, 16, 0, 0, 1, 7, 1, 30, 0, 0, 232, 3, 0, 0, 0, 0, 128, 62, 0, 0, 0, 191, 0, 0, 192, 63, 222, 44];
    let stamp = 1_700_000_000_000_000u64.to_be_bytes();
    let log = [&stamp[..], &heartbeat, &stamp, &attitude].concat();
    let log = read(&log).unwrap();
    assert_eq!(log.attitudes.len(), 1);
    let LoggedAttitude::Body { angles, .. } = log.attitudes[0].value else { panic!() };
    assert_eq!((angles.roll.get(), angles.pitch.get(), angles.yaw.get()), (0.25, -0.5, 1.5));
    assert!(log.notes.iter().any(|n| n.starts_with("system 7")) && log.bad.is_empty());
}

#[test]
fn a_flight_is_read_on_the_autopilots_clock() {
    let log = read(&flight()).unwrap();
    assert_eq!((log.clock, log.positions.len(), log.attitudes.len(), log.bad.len()), (Clock::Utc, 10, 10, 0));
    assert!((log.positions[0].time.get() - 1_700_000_001.0).abs() < 1e-6);
    assert_eq!(height(&log, 0), (581.25, HeightKind::SeaLevel(GeoidModel::Egm96)));
    let LoggedAttitude::Body { angles, .. } = log.attitudes[0].value else { panic!() };
    for (angle, radians) in [(angles.yaw, 1.5), (angles.pitch, -0.2), (angles.roll, 0.1)] {
        assert!((angle.get() - radians).abs() < 1e-7);
    }
    let v = log.velocities[0].value;
    assert!((v.x() - 5.0).abs() < 1e-12 && (v.y() + 2.5).abs() < 1e-12 && (v.z() + 0.3).abs() < 1e-12);
    assert!(log.notes.iter().any(|n| n.starts_with("system 1, component 1 (ArduPilot)")), "{:?}", log.notes);
}

#[test]
fn without_system_time_the_ground_stations_clock_is_taken_and_said() {
    let mut log = heartbeat(900, AUTOPILOT, 2, 12);
    for i in 0..10 {
        log.extend(attitude(1_000 + 100 * i, 0.5));
    }
    let log = read(&log).unwrap();
    assert!((log.attitudes[0].time.get() - 1_700_000_002.0).abs() < 1e-6);
    assert!(log.notes.iter().any(|n| n.contains("ground station's clock")), "{:?}", log.notes);
}

#[test]
fn feedback_is_preferred_and_repeats_are_dropped() {
    let mut log = flight();
    log.extend(P::default().u64(START_UTC_US + 1_500_000).u32(4).at(1_500, AUTOPILOT, 112));
    // Once on UTC, once since start-up as feedback pins have it, once more over another link.
    for usec in [START_UTC_US + 1_450_000, 1_650_000, 1_650_000] {
        log.extend(feedback(usec, if usec > 1e12 as u64 { 4 } else { 5 }));
    }
    let log = read(&log).unwrap();
    let times: Vec<f64> = log.exposures.iter().map(|e| e.time.unwrap().get() - 1_700_000_000.0).collect();
    assert_eq!(times.len(), 2, "{times:?}");
    assert!((times[0] - 1.45).abs() < 1e-6 && (times[1] - 1.65).abs() < 1e-6, "{times:?}");
    assert_eq!(log.exposures[1].sequence, Some(5));
    assert_eq!(log.exposures[0].height_above_takeoff_m, Some(80.5));
    let Some(LoggedAttitude::Body { angles, .. }) = log.exposures[0].attitude else { panic!() };
    assert!((angles.yaw.degrees() + 90.0).abs() < 1e-6 && (angles.pitch.degrees() + 2.0).abs() < 1e-6);
    assert!(log.notes.iter().any(|n| n.contains("2 CAMERA_FEEDBACK, 1 CAMERA_TRIGGER; 1 repeated")));
    // 2³² µs are 4294.967296 s.
    assert!((unwrapped(100.0, 8_700.0) - 8_689.934_592).abs() < 1e-9);
    assert!((unwrapped(4_200.0, 10.0) - 4_200.0).abs() < 1e-9);
}

fn captured(result: u8, index: i32, url: &str) -> Vec<u8> {
    // Pitch −90° by half angles.
    let h = std::f32::consts::FRAC_1_SQRT_2;
    let place = P::default().u64(START_UTC_US + 1_500_000).u32(77).i32(-353_640_000).i32(1_491_647_457);
    let body = place.i32(600_500).i32(80_500).f(&[h, 0.0, -h, 0.0]).i32(index).u8(1).u8(result);
    let mut text = url.as_bytes().to_vec();
    text.resize(205, 0);
    body.raw(&text).at(1_700, (1, 100), 263)
}

#[test]
fn captured_images_carry_the_cameras_attitude_and_a_tame_name() {
    let mut log = flight();
    log.extend(captured(1, 12, "http://192.168.1.1/../DCIM/Foto 12 ü.JPG"));
    log.extend(captured(0, 13, ""));
    let log = read(&log).unwrap();
    assert_eq!(log.exposures.len(), 1);
    let shot = &log.exposures[0];
    assert_eq!((shot.frame.as_deref(), shot.sequence), (Some("Foto 12 ü.JPG"), Some(12)));
    assert!((shot.time.unwrap().get() - 1_700_000_001.5).abs() < 1e-6);
    let gimbal = shot.gimbal.unwrap();
    assert_eq!(gimbal.reference, GimbalReference::Nav);
    assert!((gimbal.angles.elevation.degrees() + 90.0).abs() < 0.05);
    assert!(log.bad.len() == 1 && log.bad[0].cause.contains("photo 13 failed"), "{:?}", log.bad);
}

#[test]
fn gimbals_are_brought_to_north_by_their_flags() {
    let mut log = flight();
    let q = |yaw: f32| [(0.5 * yaw).cos(), 0.0, 0.0, (0.5 * yaw).sin()];
    for (flags, yaw) in [(32u16, 0.25), (64, 1.75)] {
        let body = P::default().u32(1_300).f(&q(yaw)).f(&[0.0; 3]).u32(0).u16(flags).u8(0).u8(0);
        log.extend(body.at(1_300, AUTOPILOT, 285));
    }
    // Poorer sources of the same angles are not mixed in.
    log.extend(P::default().i32(-4_500).i32(0).i32(1_000).at(1_300, AUTOPILOT, 158));
    let both = read(&log).unwrap();
    assert_eq!(both.gimbals.len(), 2);
    for gimbal in &both.gimbals {
        assert!((gimbal.value.angles.pan.get() - 1.75).abs() < 1e-6);
        assert!((gimbal.time.get() - 1_700_000_001.3).abs() < 1e-6);
    }
    let mut log = flight();
    log.extend(P::default().i32(-4_500).i32(0).i32(1_000).at(1_300, AUTOPILOT, 158));
    let status = read(&log).unwrap().gimbals[0];
    assert!((status.value.angles.elevation.degrees() + 45.0).abs() < 1e-9);
    assert!((status.value.angles.pan.get() - 1.5 - 10f64 * std::f64::consts::PI / 180.0).abs() < 1e-6);
}

#[test]
fn fixes_by_ellipsoidal_height_when_all_state_it() {
    let gps = |ellipsoid: i32| {
        let place = P::default().u64(7).i32(-353_640_000).i32(1_491_647_457).i32(581_250);
        place.raw(&[0; 8]).u8(3).u8(12).i32(ellipsoid).at(1_000, AUTOPILOT, 24)
    };
    let start = [heartbeat(900, AUTOPILOT, 2, 3), attitude(1_000, 0.0)].concat();
    let all = [start.clone(), gps(600_500), gps(600_400)].concat();
    assert_eq!(height(&read(&all).unwrap(), 0), (600.5, HeightKind::Ellipsoid));
    let some = [start, gps(600_500), gps(0)].concat();
    assert_eq!(height(&read(&some).unwrap(), 0), (581.25, HeightKind::SeaLevel(GeoidModel::Egm96)));
}

#[test]
fn a_bad_frame_takes_only_itself_along() {
    let mut log = flight();
    let mut wrong = attitude(2_000, 0.0);
    wrong[20] ^= 1;
    log.extend(wrong);
    log.extend(global(2_000, 910_000_000));
    log.extend([0x55; 40]);
    for i in 0..3 {
        log.extend(attitude(2_100 + i, 0.0));
    }
    log.extend(P::default().u32(2_200).f(&[f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]).at(2_200, AUTOPILOT, 30));
    log.extend(&attitude(2_300, 0.0)[..25]);
    let log = read(&log).unwrap();
    assert_eq!((log.attitudes.len(), log.positions.len()), (13, 10));
    let causes: Vec<&str> = log.bad.iter().map(|b| b.cause.as_str()).collect();
    assert_eq!(causes.len(), 5, "{causes:?}");
    for words in ["wrong checksum", "latitude 91°", "40 bytes", "NaN", "25 bytes"] {
        assert!(causes.iter().any(|c| c.contains(words)), "{words}: {causes:?}");
    }
}

#[test]
fn what_has_no_autopilot_is_refused() {
    for bytes in [Vec::new(), vec![0; 300], heartbeat(1, (255, 190), 6, 8)] {
        assert!(read(&bytes).unwrap_err().cause.contains("no heartbeat of an autopilot"));
    }
}

proptest! {
    #[test]
    fn damage_is_survived(flips in proptest::collection::vec((0usize..6_000, 1u8..), 0..20), cut in 0usize..4_000) {
        let mut bytes = [flight(), captured(1, 1, "a.jpg"), feedback(5, 5)].concat();
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
    fn any_payload_is_survived(id in prop::sample::select(vec![2u32, 24, 30, 31, 33, 112, 132, 158, 180, 263, 265, 285]),
                               payload in proptest::collection::vec(any::<u8>(), 1..255)) {
        let bytes = [flight(), sealed(START_UTC_US, AUTOPILOT, id, &payload)].concat();
        let log = read(&bytes).unwrap();
        prop_assert!(log.positions.len() >= 10 && log.attitudes.len() >= 10);
    }
}
