//! ArduPilot DataFlash logs (`.bin`), by the names their FMT records give.
//!
//! # Source
//! ArduPilot `LogStructure.h` of `AP_Logger`, `AP_AHRS`, `AP_GPS`, `AP_Camera`, `AP_Mount`, `AP_NavEKF2/3`.

mod container;
mod messages;
#[cfg(test)]
mod tests;

use super::autopilot::{ClockFit, Quarantine, attitude_at, backward_steps};
use super::{
    Clock, Exposure, FlightLog, LoggedAttitude, LoggedGimbal, LoggedPosition, North, Origin, ReadError,
    Sample, utc_from_gps,
};
use crate::geometry::{Displacement, Ned};
use crate::navigation::{GimbalAngles, GimbalReference};
use crate::units::{Radians, Seconds};
use container::{Event, walk};
use messages::{Cam, Plan};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The series of one receiver.
#[derive(Debug, Default)]
struct Receiver {
    positions: Vec<Sample<LoggedPosition>>,
    velocities: Vec<Sample<Displacement<Ned>>>,
    without_fix: usize,
    /// Records that give GPS time only, as before 2014: nothing joins them to the attitudes.
    without_time: usize,
    /// Ellipsoidal height minus height above sea level, where the receiver states both.
    undulations_m: Vec<f64>,
}

/// A logged gimbal attitude: to the horizon; yaw from north, or from the nose.
#[derive(Debug, Clone, Copy)]
struct MountRow {
    roll: f64,
    pitch: f64,
    yaw_from_north: Option<f64>,
    yaw_from_nose: Option<f64>,
}

/// An exposure whose time may be known on either clock.
#[derive(Debug)]
struct Shot {
    exposure: Exposure,
    utc: Option<Seconds>,
    camera: u8,
}

/// Everything the walk collects, on the log's own clock.
#[derive(Debug, Default)]
struct Collected {
    quarantine: Quarantine,
    fit: ClockFit,
    filter: Vec<Sample<LoggedPosition>>,
    backup: Vec<Sample<LoggedPosition>>,
    receivers: BTreeMap<u8, Receiver>,
    attitudes: Vec<Sample<LoggedAttitude>>,
    backup_attitudes: Vec<Sample<LoggedAttitude>>,
    /// By the filter's message and its core.
    filter_velocities: BTreeMap<(&'static str, u8), Vec<Sample<Displacement<Ned>>>>,
    /// How often a filter called a core its primary one.
    primary_core: BTreeMap<(&'static str, u8), u64>,
    mounts: BTreeMap<u8, Vec<Sample<MountRow>>>,
    mount_without_yaw: usize,
    ranges: BTreeMap<u8, Vec<Sample<f64>>>,
    shots: Vec<Shot>,
    triggers: Vec<Shot>,
    parameters: BTreeMap<&'static str, f64>,
}

/// Reads a DataFlash log.
///
/// Positions: the autopilot's filter (POS) where logged, else the receiver's fixes (GPS), else the backup AHRS (AHR2);
/// of several receivers the one with most fixes. Times: UTC where the log has GPS time, else seconds since start-up.
///
/// # Errors
/// Bytes without a single DataFlash record that describes itself.
pub fn read(bytes: &[u8]) -> Result<FlightLog, ReadError> {
    let mut collected = Collected::default();
    let mut plans: Vec<Plan> = (0..256).map(|_| Plan::Skip).collect();
    let mut described = 0u32;
    let mut quarantine = Quarantine::default();
    let records = walk(bytes, &mut quarantine, |event| match event {
        Event::Format(kind, format) => {
            described += 1;
            plans[usize::from(kind)] = Plan::of(format);
        }
        Event::Message(place, kind, body) => plans[usize::from(kind)].run(place, body, &mut collected),
    });
    if described == 0 {
        return Err(ReadError::new(format!(
            "no ArduPilot DataFlash log: {} bytes without a format (FMT) record",
            bytes.len()
        ))
        .help("a text log (.log) is converted by Mission Planner or mavlogdump.py; a telemetry log ends in .tlog"));
    }
    Ok(collected.into_log(quarantine, records))
}

impl Collected {
    fn into_log(mut self, damage: Quarantine, records: u64) -> FlightLog {
        let mut log = FlightLog::new(Clock::Own);
        log.notes.push(format!("ArduPilot DataFlash log of {records} records"));
        damage.finish(&mut log);
        self.take_attitudes(&mut log);
        let receiver = self.take_receiver(&mut log);
        self.take_positions(receiver, &mut log);
        self.take_gimbals(&mut log);
        self.take_ranges(&mut log);
        let utc = self.take_exposures(&mut log);
        self.set_clock(&utc, &mut log);
        std::mem::take(&mut self.quarantine).finish(&mut log);
        log.bad.sort_by_key(|b| b.place);
        let back = backward_steps(&log.attitudes) + backward_steps(&log.positions);
        if back > 0 {
            log.notes.push(format!(
                "time runs backwards {back} times: several flights in one file? only the parts in order can be used"
            ));
        }
        log
    }

    /// North of the yaw: true unless the compass's declination is switched off.
    fn north(&self) -> (North, &'static str) {
        let value = |name| self.parameters.get(name).copied();
        match (value("COMPASS_AUTODEC"), value("COMPASS_DEC"), value("COMPASS_USE")) {
            (Some(0.0), Some(0.0), Some(used)) if used != 0.0 => {
                (North::Magnetic, "COMPASS_AUTODEC and COMPASS_DEC are 0: yaw counts from magnetic north")
            }
            (Some(0.0), _, _) => {
                (North::True, "yaw counts from true north by the declination in COMPASS_DEC")
            }
            (Some(_), _, _) => (North::True, "yaw counts from true north (COMPASS_AUTODEC is on)"),
            (None, _, _) => (
                North::True,
                "yaw is taken to count from true north: COMPASS_AUTODEC is on unless switched off",
            ),
        }
    }

    fn take_attitudes(&mut self, log: &mut FlightLog) {
        let (north, why) = self.north();
        let (from, attitudes) = if self.attitudes.is_empty() {
            ("AHR2", std::mem::take(&mut self.backup_attitudes))
        } else {
            ("ATT", std::mem::take(&mut self.attitudes))
        };
        log.attitudes = attitudes;
        if log.attitudes.is_empty() {
            log.notes.push("the log holds no attitude (ATT)".to_owned());
            return;
        }
        for sample in &mut log.attitudes {
            if let LoggedAttitude::Body { north: of, .. } = &mut sample.value {
                *of = north;
            }
        }
        log.notes.push(format!("attitudes: {} records of {from}; {why}", log.attitudes.len()));
        log.origins.push(Origin {
            quantity: "yaw, pitch, roll",
            from: format!("{from}.Yaw, {from}.Pitch, {from}.Roll, degrees"),
            meaning: format!("of the UAV (nose, right, down); {why}"),
        });
    }

    /// The receiver with most fixes; the first of equals.
    fn take_receiver(&mut self, log: &mut FlightLog) -> Receiver {
        let of = self.receivers.len();
        let best = self.receivers.iter().rev().max_by_key(|(_, r)| r.positions.len()).map(|(i, _)| *i);
        let Some((instance, mut receiver)) = best.and_then(|i| self.receivers.remove_entry(&i)) else {
            return Receiver::default();
        };
        if of > 1 {
            log.notes.push(format!("of {of} receivers GPS instance {instance} is used: most fixes"));
        }
        if receiver.without_fix > 0 {
            log.notes.push(format!(
                "{} GPS records without a 3-D fix (Status below 3) are left out",
                receiver.without_fix
            ));
        }
        if receiver.without_time > 0 {
            log.notes.push(format!(
                "{} GPS records without a time since start-up (TimeUS, T) are left out: nothing joins them to ATT",
                receiver.without_time
            ));
        }
        let undulations = &mut receiver.undulations_m;
        if !undulations.is_empty() {
            undulations.sort_by(f64::total_cmp);
            log.notes.push(format!(
                "the receiver's own sea level lies {:.2} m above the ellipsoid (median of GPA.AEl − GPS.Alt)",
                undulations[undulations.len() / 2]
            ));
        }
        receiver
    }

    fn take_positions(&mut self, receiver: Receiver, log: &mut FlightLog) {
        let filter = std::mem::take(&mut self.filter);
        let backup = std::mem::take(&mut self.backup);
        let (from, meaning, positions) = if !filter.is_empty() {
            let meaning = "above mean sea level: the filter's height, the receiver's sea level (EGM96) at the \
                           origin carried on mostly by the barometer";
            ("POS", meaning, filter)
        } else if !receiver.positions.is_empty() {
            ("GPS", "above mean sea level as the receiver's geoid (EGM96) has it", receiver.positions)
        } else {
            ("AHR2", "above mean sea level (EGM96): the backup filter's height", backup)
        };
        if positions.is_empty() {
            log.notes.push("the log holds no position (POS, GPS with a fix, AHR2)".to_owned());
        } else {
            let why = match from {
                "POS" => "the autopilot's filter: no receiver latency, denser than GPS",
                "GPS" => {
                    "the log has no POS; times are those of logging, a receiver's latency (about 0.1 to 0.2 s) late"
                }
                _ => "the log has neither POS nor a GPS fix",
            };
            log.notes.push(format!("positions: {} records of {from}: {why}", positions.len()));
            log.origins.push(Origin {
                quantity: "latitude, longitude",
                from: format!("{from}.Lat, {from}.Lng, degrees"),
                meaning: "WGS 84".to_owned(),
            });
            log.origins.push(Origin {
                quantity: "height",
                from: format!("{from}.Alt, metres"),
                meaning: meaning.to_owned(),
            });
        }
        log.positions = positions;
        self.take_velocities(receiver.velocities, log);
    }

    /// The message of the filter in use, and its primary core.
    fn filter_in_use(&self) -> Option<(&'static str, u8)> {
        let logged = |name: &&str| self.filter_velocities.keys().any(|(n, _)| n == name);
        // AHRS_EKF_TYPE: 2 or 3, where both filters run.
        let order = match self.parameters.get("AHRS_EKF_TYPE") {
            Some(2.0) => ["NKF1", "XKF1", "EKF1"],
            _ => ["XKF1", "NKF1", "EKF1"],
        };
        let name = order.into_iter().find(logged)?;
        let cores = self.primary_core.iter().rev().filter(|((n, _), _)| *n == name);
        let primary = cores.max_by_key(|(_, count)| **count).map(|((_, core), _)| (name, *core));
        let lowest = self.filter_velocities.keys().find(|(n, _)| *n == name).copied();
        primary.filter(|key| self.filter_velocities.contains_key(key)).or(lowest)
    }

    fn take_velocities(&mut self, of_receiver: Vec<Sample<Displacement<Ned>>>, log: &mut FlightLog) {
        let in_use = self.filter_in_use();
        let (from, meaning, velocities) = match in_use
            .and_then(|key| Some((key, self.filter_velocities.remove(&key)?)))
        {
            Some(((name, core), velocities)) => {
                (format!("{name}.VN, {name}.VE, {name}.VD, m/s"), format!("filter core {core}"), velocities)
            }
            None => {
                let from = "GPS.Spd, m/s; GPS.GCrs, degrees; GPS.VZ, m/s down".to_owned();
                (from, "speed and course over ground".to_owned(), of_receiver)
            }
        };
        if !velocities.is_empty() {
            log.origins.push(Origin {
                quantity: "velocity",
                from,
                meaning: format!("north, east, down; {meaning}"),
            });
        }
        log.velocities = velocities;
    }

    fn take_gimbals(&mut self, log: &mut FlightLog) {
        if self.mount_without_yaw > 0 {
            log.notes.push(format!(
                "{} MNT records are left out: they do not say whether their yaw counts from north or from the nose \
                 (no YawB, YawE), or the mount did not know its angles",
                self.mount_without_yaw
            ));
        }
        let Some((instance, rows)) = self.mounts.pop_first() else { return };
        if !self.mounts.is_empty() {
            log.notes.push(format!("of {} mounts MNT instance {instance} is used", self.mounts.len() + 1));
        }
        let mut without_attitude = 0;
        for row in rows {
            let MountRow { roll, pitch, yaw_from_north, yaw_from_nose } = row.value;
            let heading = || attitude_at(&log.attitudes, row.time).map(|a| a.yaw.degrees());
            let yaw = yaw_from_north.or_else(|| Some(heading()? + yaw_from_nose?));
            let Some(yaw) = yaw else {
                without_attitude += 1;
                continue;
            };
            let angles = GimbalAngles {
                pan: Radians::from_degrees(yaw).wrapped(),
                elevation: Radians::from_degrees(pitch),
                roll: Radians::from_degrees(roll).wrapped(),
            };
            let value = LoggedGimbal { angles, reference: GimbalReference::Nav };
            log.gimbals.push(Sample { place: row.place, time: row.time, value });
        }
        if without_attitude > 0 {
            log.notes.push(format!("{without_attitude} MNT records have no attitude of the UAV near them"));
        }
        log.origins.push(Origin {
            quantity: "gimbal pan, elevation, roll",
            from: "MNT.YawE (else MNT.YawB and the UAV's yaw), MNT.Pitch, MNT.Roll, degrees".to_owned(),
            meaning: "actual, not desired, angles; pitch and roll to the horizon, pan from true north"
                .to_owned(),
        });
    }

    fn take_ranges(&mut self, log: &mut FlightLog) {
        let Some((_, ranges)) = self.ranges.pop_first() else { return };
        for range in ranges {
            // The finder looks along the UAV's down axis.
            let Some(attitude) = attitude_at(&log.attitudes, range.time) else { continue };
            let cosine = attitude.pitch.get().cos() * attitude.roll.get().cos();
            if cosine > 0.5 {
                log.heights_above_ground.push(Sample { value: range.value * cosine, ..range });
            }
        }
        log.origins.push(Origin {
            quantity: "height above ground",
            from: "RFND.Dist, metres, times cos(pitch)·cos(roll)".to_owned(),
            meaning: "downward rangefinder in good order, UAV tilted less than 60°".to_owned(),
        });
    }

    /// The exposures, preferring feedback to commands; UTC of those without a time on the own clock.
    fn take_exposures(&mut self, log: &mut FlightLog) -> Vec<Option<Seconds>> {
        let (north, _) = self.north();
        let (feedback, command) = (self.shots.len(), self.triggers.len());
        if feedback + command == 0 {
            log.notes.push("the log holds no exposures (neither CAM nor TRIG)".to_owned());
            return Vec::new();
        }
        let (from, mut shots) = if feedback > 0 {
            ("CAM", std::mem::take(&mut self.shots))
        } else {
            ("TRIG", std::mem::take(&mut self.triggers))
        };
        log.notes.push(format!(
            "exposures: {from} is used; the log has {feedback} CAM records (shutter feedback, or the command where \
             no feedback pin is set up) and {command} TRIG records (command)"
        ));
        let camera = shots.iter().map(|s| s.camera).min().unwrap_or(0);
        let all = shots.len();
        shots.retain(|s| s.camera == camera);
        if shots.len() < all {
            log.notes.push(format!(
                "only camera {camera} is read: {} exposures of other cameras are left out",
                all - shots.len()
            ));
        }
        let origins: Arc<[Origin]> = messages::exposure_origins(from).into();
        let mut utc = Vec::with_capacity(shots.len());
        for mut shot in shots {
            if let Some(LoggedAttitude::Body { north: of, .. }) = &mut shot.exposure.attitude {
                *of = north;
            }
            shot.exposure.origins = Arc::clone(&origins);
            utc.push(shot.utc);
            log.exposures.push(shot.exposure);
        }
        utc
    }

    fn set_clock(&mut self, utc: &[Option<Seconds>], log: &mut FlightLog) {
        let Some(offset) = self.fit.quantile(0.5) else {
            log.notes.push("times count from the autopilot's start-up: the log has no GPS time".to_owned());
            return;
        };
        offset.apply(log);
        // Logs before 2014 give an exposure's GPS time only.
        for (exposure, utc) in log.exposures.iter_mut().zip(utc) {
            exposure.time = exposure.time.or(*utc);
        }
        log.notes.push(format!(
            "times are UTC: start-up lies at {:.3} s Unix time, the median of {} GPS records (±{:.3} s for 90 % of \
             them; a receiver's latency, about 0.1 to 0.2 s, is in it); GPS time minus leap seconds",
            offset.offset_s, offset.records, offset.spread_s
        ));
        log.origins.push(Origin {
            quantity: "time",
            from: "TimeUS (or TimeMS, T), plus the median of GPS.GWk and GPS.GMS minus it".to_owned(),
            meaning: "UTC".to_owned(),
        });
    }

    fn shoot(&mut self, trigger: bool, shot: Shot) {
        let shots = if trigger { &mut self.triggers } else { &mut self.shots };
        if self.quarantine.has_room(shot.exposure.place, shots.len()) {
            shots.push(shot);
        }
    }
}

/// UTC of an exposure's own GPS time, if it is one.
fn utc_of(cam: &Cam, body: &[u8]) -> Option<Seconds> {
    let week = cam.week?.number(body)?;
    let second = cam.gps_ms?.number(body)? * cam.gps_scale;
    utc_from_gps(week as u32, second).ok()
}
