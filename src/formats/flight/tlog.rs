//! MAVLink telemetry logs (`.tlog`) of ground stations.
//!
//! # Source
//! MAVLink `common.xml` and `ardupilotmega.xml`; what ArduPilot fills in: `AP_Camera_Backend`, `AP_Mount_Backend`.

mod container;
mod finish;
#[cfg(test)]
mod tests;

use super::autopilot::{ClockFit, Quarantine, angles_of_quaternion, yaw_is_from_north};
use super::{
    Clock, Exposure, FlightLog, LoggedAttitude, LoggedGimbal, LoggedPosition, North, ReadError, Sample,
    geodetic, plausible_angles, plausible_speed,
};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Ned};
use crate::navigation::{GimbalAngles, GimbalReference};
use crate::units::{Radians, Seconds};
use container::{Frame, walk};
use std::collections::BTreeMap;

const SEA_LEVEL: HeightKind = HeightKind::SeaLevel(GeoidModel::Egm96);
/// `MAV_AUTOPILOT`: none, and ArduPilot.
const NO_AUTOPILOT: u8 = 8;
const ARDUPILOT: u8 = 3;
/// `MAV_TYPE` of a ground station.
const GROUND_STATION: u8 = 6;

/// A time as a message states it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Stated {
    /// Seconds since the autopilot's start-up.
    Boot(f64),
    /// Unix seconds.
    Utc(f64),
    /// Unix seconds of the ground station's clock when it received the message.
    Received(f64),
}

impl Stated {
    /// Microseconds since 1970 or since start-up: MAVLink tells them apart by their size.
    fn of_usec(us: u64) -> Self {
        let seconds = us as f64 * 1e-6;
        if seconds > 1e9 { Self::Utc(seconds) } else { Self::Boot(seconds) }
    }
}

/// A gimbal attitude to the horizon, its pan from north or from the nose.
#[derive(Debug, Clone, Copy)]
struct GimbalRow {
    place: u64,
    time: Stated,
    angles: GimbalAngles,
    from_north: bool,
}

/// Gimbal messages, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum GimbalSource {
    Device,
    Orientation,
    Status,
}

/// Exposure messages, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ShotSource {
    Captured,
    Feedback,
    Trigger,
}

#[derive(Debug, Default)]
struct Collected {
    quarantine: Quarantine,
    system_time: ClockFit,
    received: ClockFit,
    filter: Vec<Sample<LoggedPosition>>,
    /// Fixes, and their ellipsoidal heights where stated.
    receiver: Vec<(Sample<LoggedPosition>, Option<f64>)>,
    velocities: Vec<Sample<Displacement<Ned>>>,
    euler: Vec<Sample<LoggedAttitude>>,
    quaternions: Vec<Sample<LoggedAttitude>>,
    gimbals: BTreeMap<GimbalSource, Vec<GimbalRow>>,
    shots: BTreeMap<ShotSource, Vec<(Stated, Exposure)>>,
    ranges: Vec<Sample<f64>>,
    last_boot_s: f64,
    without_fix: usize,
    repeated: usize,
}

/// The system that is read: its autopilot's component, and the kind of autopilot.
#[derive(Debug, Clone, Copy)]
struct Autopilot {
    component: u8,
    kind: u8,
}

/// Reads a telemetry log: of the system whose autopilot sent most heartbeats.
///
/// Times: those of the messages (since start-up), brought to UTC by SYSTEM_TIME, else by the ground station's clock.
///
/// # Errors
/// Bytes without a heartbeat of an autopilot.
pub fn read(bytes: &[u8]) -> Result<FlightLog, ReadError> {
    let mut heartbeats: BTreeMap<(u8, u8, u8), u64> = BTreeMap::new();
    let mut damage = Quarantine::default();
    let frames = walk(bytes, &mut damage, |frame| {
        if frame.id == 0 && frame.u8(5) != NO_AUTOPILOT && frame.u8(4) != GROUND_STATION {
            *heartbeats.entry((frame.system, frame.component, frame.u8(5))).or_default() += 1;
        }
    });
    let best = heartbeats.iter().rev().max_by_key(|(_, n)| **n).map(|(key, _)| *key);
    let Some((system, component, kind)) = best else {
        return Err(ReadError::new(format!(
            "no MAVLink telemetry log: {} bytes with {frames} frames and no heartbeat of an autopilot",
            bytes.len()
        )));
    };
    let autopilot = Autopilot { component, kind };
    let mut collected = Collected::default();
    walk(bytes, &mut Quarantine::default(), |frame| {
        if frame.system == system {
            collected.take(&frame, autopilot);
        }
    });
    let mut log = FlightLog::new(Clock::Own);
    log.notes.push(format!("MAVLink telemetry log of {frames} frames"));
    let mut systems: Vec<u8> = heartbeats.keys().map(|(system, ..)| *system).collect();
    systems.dedup();
    let name = if kind == ARDUPILOT { "ArduPilot".to_owned() } else { format!("autopilot kind {kind}") };
    log.notes.push(format!(
        "system {system}, component {component} ({name}) is read, of {} systems with an autopilot",
        systems.len()
    ));
    damage.finish(&mut log);
    collected.finish(&mut log);
    Ok(log)
}

impl Collected {
    /// Navigation is the autopilot's own; cameras and gimbals are components of the same system.
    fn take(&mut self, frame: &Frame<'_>, autopilot: Autopilot) {
        let of_autopilot = frame.component == autopilot.component;
        match frame.id {
            2 if of_autopilot => {
                let boot_s = self.boot(frame, 8);
                self.system_time.add(boot_s, frame.u64(0) as f64 * 1e-6);
            }
            24 if of_autopilot => self.gps(frame),
            30 if of_autopilot => {
                let [roll, pitch, yaw] = [4, 8, 12].map(|at| Radians::new(frame.f32(at)));
                let angles = plausible_angles(YawPitchRoll::new(yaw, pitch, roll));
                self.attitude(frame, "ATTITUDE", angles, false);
            }
            31 if of_autopilot => {
                let angles = angles_of_quaternion(frame.quaternion(4));
                self.attitude(frame, "ATTITUDE_QUATERNION", angles, true);
            }
            33 if of_autopilot => self.global(frame),
            132 if of_autopilot => {
                // Orientation 25: straight down. Centimetres between the sensor's own limits.
                let [least, most, now] = [4, 6, 8].map(|at| frame.u16(at));
                let time = Seconds::new(self.boot(frame, 0));
                if frame.u8(12) == 25 && least < now && now < most {
                    self.ranges.push(Sample { place: frame.place, time, value: f64::from(now) * 0.01 });
                }
            }
            112 if of_autopilot => self.trigger(frame),
            158 if autopilot.kind == ARDUPILOT => self.mount_status(frame),
            180 if of_autopilot => self.feedback(frame, autopilot),
            263 => self.captured(frame, of_autopilot),
            265 => self.mount_orientation(frame, of_autopilot),
            285 => self.gimbal_device(frame, of_autopilot),
            _ => {}
        }
    }

    /// Seconds since start-up, and how they lie against the ground station's clock.
    fn boot(&mut self, frame: &Frame<'_>, at: usize) -> f64 {
        let boot_s = f64::from(frame.u32(at)) * 1e-3;
        self.received.add(boot_s, frame.received_us as f64 * 1e-6);
        self.last_boot_s = boot_s;
        boot_s
    }

    fn attitude(
        &mut self,
        frame: &Frame<'_>,
        name: &str,
        angles: Result<YawPitchRoll, String>,
        quaternion: bool,
    ) {
        let time = Seconds::new(self.boot(frame, 0));
        if let Some(angles) = self.quarantine.keep(frame.place, name, angles) {
            let value = LoggedAttitude::Body { angles, north: North::True };
            let series = if quaternion { &mut self.quaternions } else { &mut self.euler };
            series.push(Sample { place: frame.place, time, value });
        }
    }

    fn global(&mut self, frame: &Frame<'_>) {
        let (place, time) = (frame.place, Seconds::new(self.boot(frame, 0)));
        // Before the first fix the filter sends zeros.
        if frame.i32(4) == 0 && frame.i32(8) == 0 {
            self.without_fix += 1;
            return;
        }
        let position = position(frame, 4, 8, f64::from(frame.i32(12)) * 1e-3);
        let Some(value) = self.quarantine.keep(place, "GLOBAL_POSITION_INT", position) else { return };
        self.filter.push(Sample { place, time, value });
        let [n, e, d] = [20, 22, 24].map(|at| f64::from(frame.i16(at)) * 0.01);
        let velocity =
            || Ok(Displacement::new(plausible_speed(n)?, plausible_speed(e)?, plausible_speed(d)?));
        if let Some(value) = self.quarantine.keep(place, "GLOBAL_POSITION_INT", velocity()) {
            self.velocities.push(Sample { place, time, value });
        }
    }

    /// Fixes, for logs without the filter's position. Their own time is of no known clock: the last message's is taken.
    fn gps(&mut self, frame: &Frame<'_>) {
        if frame.u8(28) < 3 {
            self.without_fix += 1;
            return;
        }
        let sea_level_m = f64::from(frame.i32(16)) * 1e-3;
        let (place, time) = (frame.place, Seconds::new(self.last_boot_s));
        let position = position(frame, 8, 12, sea_level_m);
        if let Some(value) = self.quarantine.keep(place, "GPS_RAW_INT", position) {
            // An extension, millimetres; no geoid lies further than 150 m from the ellipsoid.
            let ellipsoid_m = f64::from(frame.i32(30)) * 1e-3;
            let stated = frame.i32(30) != 0 && (ellipsoid_m - sea_level_m).abs() < 150.0;
            self.receiver.push((Sample { place, time, value }, stated.then_some(ellipsoid_m)));
        }
    }

    fn gimbal(&mut self, source: GimbalSource, row: GimbalRow) {
        self.gimbals.entry(source).or_default().push(row);
    }

    /// Another component's start-up is another clock: then the time of receipt counts.
    fn component_time(frame: &Frame<'_>, at: usize, of_autopilot: bool) -> Stated {
        if of_autopilot {
            Stated::Boot(f64::from(frame.u32(at)) * 1e-3)
        } else {
            Stated::Received(frame.received_us as f64 * 1e-6)
        }
    }

    fn gimbal_device(&mut self, frame: &Frame<'_>, of_autopilot: bool) {
        let angles = angles_of_quaternion(frame.quaternion(4));
        if let Some(a) = self.quarantine.keep(frame.place, "GIMBAL_DEVICE_ATTITUDE_STATUS", angles) {
            let flags = u32::from(frame.u16(36));
            let row = GimbalRow {
                place: frame.place,
                time: Self::component_time(frame, 0, of_autopilot),
                angles: GimbalAngles { pan: a.yaw, elevation: a.pitch, roll: a.roll },
                from_north: yaw_is_from_north(flags),
            };
            self.gimbal(GimbalSource::Device, row);
        }
    }

    fn mount_orientation(&mut self, frame: &Frame<'_>, of_autopilot: bool) {
        let [roll, pitch, yaw] = [4, 8, 12].map(|at| frame.f32(at));
        // Roll and pitch in the global frame, yaw relative to the vehicle (NaN: unknown).
        if let Ok(a) = plausible_angles(YawPitchRoll::from_degrees(yaw, pitch, roll)) {
            let row = GimbalRow {
                place: frame.place,
                time: Self::component_time(frame, 0, of_autopilot),
                angles: GimbalAngles { pan: a.yaw, elevation: a.pitch, roll: a.roll },
                from_north: false,
            };
            self.gimbal(GimbalSource::Orientation, row);
        }
    }

    /// ArduPilot's: hundredths of a degree; pitch and roll to the horizon, yaw from the nose; no time of its own.
    fn mount_status(&mut self, frame: &Frame<'_>) {
        let [pitch, roll, yaw] = [0, 4, 8].map(|at| f64::from(frame.i32(at)) * 0.01);
        let angles = plausible_angles(YawPitchRoll::from_degrees(yaw, pitch, roll));
        if let Some(a) = self.quarantine.keep(frame.place, "MOUNT_STATUS", angles) {
            let row = GimbalRow {
                place: frame.place,
                time: Stated::Received(frame.received_us as f64 * 1e-6),
                angles: GimbalAngles { pan: a.yaw, elevation: a.pitch, roll: a.roll },
                from_north: false,
            };
            self.gimbal(GimbalSource::Status, row);
        }
    }

    /// Adds an exposure unless it repeats one: links and requests send the same message again.
    fn shoot(&mut self, source: ShotSource, time: Stated, exposure: Exposure) {
        let shots = self.shots.entry(source).or_default();
        let again = |(t, e): &(Stated, Exposure)| {
            e.sequence == exposure.sequence && (matches!(time, Stated::Received(_)) || *t == time)
        };
        if shots.iter().rev().take(20).any(again) {
            self.repeated += 1;
        } else if self.quarantine.has_room(exposure.place, shots.len()) {
            shots.push((time, exposure));
        }
    }

    fn trigger(&mut self, frame: &Frame<'_>) {
        let mut exposure = Exposure::at(frame.place);
        exposure.sequence = Some(u64::from(frame.u32(8)));
        self.shoot(ShotSource::Trigger, Stated::of_usec(frame.u64(0)), exposure);
    }

    fn feedback(&mut self, frame: &Frame<'_>, autopilot: Autopilot) {
        let mut exposure = Exposure::at(frame.place);
        exposure.sequence = Some(u64::from(frame.u16(40)));
        if frame.i32(8) != 0 || frame.i32(12) != 0 {
            let position = position(frame, 8, 12, frame.f32(16));
            exposure.position = self.quarantine.keep(frame.place, "CAMERA_FEEDBACK", position);
        }
        exposure.height_above_takeoff_m = Some(frame.f32(20)).filter(|h| h.abs() < 60_000.0);
        // The message means the camera's angles; ArduPilot fills in the vehicle's.
        if autopilot.kind == ARDUPILOT {
            let [roll, pitch, yaw] = [24, 28, 32].map(|at| frame.f32(at));
            let angles = plausible_angles(YawPitchRoll::from_degrees(yaw, pitch, roll));
            exposure.attitude = self
                .quarantine
                .keep(frame.place, "CAMERA_FEEDBACK", angles)
                .map(|angles| LoggedAttitude::Body { angles, north: North::True });
        }
        let time = match Stated::of_usec(frame.u64(0)) {
            Stated::Boot(seconds) => Stated::Boot(unwrapped(seconds, self.last_boot_s)),
            other => other,
        };
        self.shoot(ShotSource::Feedback, time, exposure);
    }

    fn captured(&mut self, frame: &Frame<'_>, of_autopilot: bool) {
        let index = frame.i32(44);
        if frame.i8(49) == 0 {
            // A zero at the end is cut off in MAVLink 2, so a failure is a short payload as well.
            self.quarantine
                .add(frame.place, format!("CAMERA_IMAGE_CAPTURED: photo {index} failed (result 0)"));
            return;
        }
        let mut exposure = Exposure::at(frame.place);
        exposure.sequence = u64::try_from(index).ok();
        let url = frame.text(50, 205);
        let name = url.rsplit(['/', '\\']).next().unwrap_or_default();
        exposure.frame = (!name.is_empty() && !name.contains(char::is_control)).then(|| name.to_owned());
        if frame.i32(12) != 0 || frame.i32(16) != 0 {
            let position = position(frame, 12, 16, f64::from(frame.i32(20)) * 1e-3);
            exposure.position = self.quarantine.keep(frame.place, "CAMERA_IMAGE_CAPTURED", position);
        }
        exposure.height_above_takeoff_m = Some(f64::from(frame.i32(24)) * 1e-3);
        // All zero: unknown.
        if frame.quaternion(28) != [0.0; 4] {
            let angles = angles_of_quaternion(frame.quaternion(28));
            exposure.gimbal = self.quarantine.keep(frame.place, "CAMERA_IMAGE_CAPTURED", angles).map(|a| {
                let angles = GimbalAngles { pan: a.yaw, elevation: a.pitch, roll: a.roll };
                LoggedGimbal { angles, reference: GimbalReference::Nav }
            });
        }
        let time = match frame.u64(0) {
            0 => Self::component_time(frame, 8, of_autopilot),
            utc_us => Stated::Utc(utc_us as f64 * 1e-6),
        };
        self.shoot(ShotSource::Captured, time, exposure);
    }
}

/// A position from 1e-7 degrees at two places of the payload.
fn position(frame: &Frame<'_>, lat: usize, lon: usize, height_m: f64) -> Result<LoggedPosition, String> {
    let degrees = |at| Radians::from_degrees(f64::from(frame.i32(at)) * 1e-7);
    geodetic(degrees(lat), degrees(lon), height_m, SEA_LEVEL)
}

/// ArduPilot stamps feedback pins with a 32-bit counter of microseconds, which starts again every 71.6 minutes.
fn unwrapped(seconds: f64, near: f64) -> f64 {
    const TURN: f64 = 4_294.967_296;
    if seconds < TURN { seconds + ((near - seconds) / TURN).round().max(0.0) * TURN } else { seconds }
}
