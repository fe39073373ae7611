//! PX4 ULog logs (`.ulg`), by the names of topics and fields.
//!
//! # Source
//! PX4 "ULog File Format"; PX4's message definitions (`msg/*.msg`) and `modules/camera_feedback`, `modules/gimbal`.

mod container;
mod messages;
#[cfg(test)]
mod tests;

use super::autopilot::{ClockFit, ClockOffset, Quarantine, attitude_at, backward_steps};
use super::{
    Clock, Exposure, FlightLog, LoggedAttitude, LoggedGimbal, North, Origin, ReadError, Sample, geodetic,
};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Body, Displacement, Ned};
use crate::navigation::{GimbalAngles, GimbalReference};
use crate::units::{Radians, Seconds};
use container::{Event, walk};
use messages::{Plan, Topic};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A position with every height the topic states.
#[derive(Debug, Clone, Copy)]
struct PositionRow {
    latitude: Radians,
    longitude: Radians,
    sea_level_m: f64,
    ellipsoid_m: Option<f64>,
}

/// A logged gimbal attitude, its pan from north or from the nose.
#[derive(Debug, Clone, Copy)]
struct GimbalRow {
    angles: GimbalAngles,
    from_north: bool,
}

/// An exposure with the attitude whose owner is still to be told.
#[derive(Debug)]
struct Shot {
    exposure: Exposure,
    time: Seconds,
    angles: Option<YawPitchRoll>,
    feedback: bool,
}

/// What one instance of one topic gave.
#[derive(Debug, Default)]
struct Rows {
    attitudes: Vec<Sample<LoggedAttitude>>,
    positions: Vec<Sample<PositionRow>>,
    velocities: Vec<Sample<Displacement<Ned>>>,
    heights_m: Vec<Sample<f64>>,
    gimbals: Vec<Sample<GimbalRow>>,
    shots: Vec<Shot>,
    invalid: usize,
}

/// Everything the walk collects, on the log's own clock.
#[derive(Debug, Default)]
struct Collected {
    quarantine: Quarantine,
    fit: ClockFit,
    rows: Vec<(Topic, u8, Rows)>,
    parameters: BTreeMap<&'static str, f64>,
    without_feedback: usize,
    dropouts: (u64, u64),
}

/// Reads a ULog.
///
/// Positions: `vehicle_global_position`, else `vehicle_gps_position`, `sensor_gps`, `vehicle_local_position`; of several
/// instances of a topic the lowest with data. Times: UTC where the receiver gave it, else seconds since start-up.
///
/// # Errors
/// Bytes that are no ULog, or one with additions that readers of version 1 must refuse.
pub fn read(bytes: &[u8]) -> Result<FlightLog, ReadError> {
    let mut collected = Collected::default();
    let mut plans: Vec<Option<Box<Plan>>> = (0..1 << 16).map(|_| None).collect();
    let mut damage = Quarantine::default();
    let messages = walk(bytes, &mut damage, |event| match event {
        Event::Subscribed(id, topic, multi, layout) => {
            plans[usize::from(id)] = Topic::of(topic).and_then(|topic| {
                let slot = collected.slot(topic, multi);
                Plan::of(topic, layout, slot).map(Box::new)
            });
        }
        Event::Data(place, id, body) => {
            if let Some(plan) = &plans[usize::from(id)] {
                plan.run(place, body, &mut collected);
            }
        }
        Event::Parameter(name, value) => {
            if name == "MNT_DO_STAB" {
                collected.parameters.insert("MNT_DO_STAB", value);
            }
        }
        Event::Dropout(ms) => {
            collected.dropouts.0 += 1;
            collected.dropouts.1 += u64::from(ms);
        }
    })?;
    Ok(collected.into_log(damage, messages))
}

impl Collected {
    /// Where the rows of a topic's instance are kept; a log that subscribes twice goes on filling the same rows.
    fn slot(&mut self, topic: Topic, multi: u8) -> usize {
        let found = self.rows.iter().position(|(t, m, _)| (*t, *m) == (topic, multi));
        found.unwrap_or_else(|| {
            self.rows.push((topic, multi, Rows::default()));
            self.rows.len() - 1
        })
    }

    /// The rows of a topic: of the lowest instance for which `has` something.
    fn take(&mut self, topic: Topic, has: impl Fn(&Rows) -> bool) -> Option<Rows> {
        let (_, _, rows) = self
            .rows
            .iter_mut()
            .filter(|(t, _, r)| *t == topic && has(r))
            .min_by_key(|(_, multi, _)| *multi)?;
        Some(std::mem::take(rows))
    }

    fn into_log(mut self, damage: Quarantine, messages: u64) -> FlightLog {
        let mut log = FlightLog::new(Clock::Own);
        log.notes.push(format!("PX4 ULog of {messages} messages"));
        if self.dropouts.0 > 0 {
            log.notes.push(format!(
                "the logger dropped out {} times, {} ms in all",
                self.dropouts.0, self.dropouts.1
            ));
        }
        damage.finish(&mut log);
        self.take_attitudes(&mut log);
        self.take_positions(&mut log);
        self.take_gimbals(&mut log);
        self.take_exposures(&mut log);
        match self.fit.quantile(0.5) {
            Some(offset) => set_clock(&offset, &mut log),
            None => {
                log.notes.push("times count from the autopilot's start-up: no receiver gave UTC".to_owned())
            }
        }
        std::mem::take(&mut self.quarantine).finish(&mut log);
        log.bad.sort_by_key(|b| b.place);
        let back = backward_steps(&log.attitudes) + backward_steps(&log.positions);
        if back > 0 {
            log.notes.push(format!("time runs backwards {back} times: only the parts in order can be used"));
        }
        log
    }

    fn take_attitudes(&mut self, log: &mut FlightLog) {
        let Some(rows) = self.take(Topic::Attitude, |r| !r.attitudes.is_empty()) else {
            log.notes.push("the log holds no vehicle_attitude".to_owned());
            return;
        };
        log.attitudes = rows.attitudes;
        log.notes.push(format!(
            "attitudes: {} messages of vehicle_attitude; yaw counts from true north (the filter adds the declination)",
            log.attitudes.len()
        ));
        log.origins.push(Origin {
            quantity: "yaw, pitch, roll",
            from: "vehicle_attitude.q (w, x, y, z)".to_owned(),
            meaning: "of the UAV: turns nose, right, down to north, east, down; true north".to_owned(),
        });
    }

    fn take_positions(&mut self, log: &mut FlightLog) {
        let order = [
            (Topic::Global, "vehicle_global_position", "lat, lon", "the filter's position"),
            (
                Topic::Gps,
                "vehicle_gps_position",
                "lat, lon (or latitude_deg, longitude_deg)",
                "the receiver's fixes",
            ),
            (
                Topic::SensorGps,
                "sensor_gps",
                "lat, lon (or latitude_deg, longitude_deg)",
                "the receiver's fixes",
            ),
            (
                Topic::Local,
                "vehicle_local_position",
                "x, y, z, ref_lat, ref_lon, ref_alt",
                "the filter's local position, by PX4's own azimuthal equidistant projection (sphere of 6371 km)",
            ),
        ];
        let mut found = None;
        for (topic, name, fields, meaning) in order {
            if let Some(rows) = self.take(topic, |r| !r.positions.is_empty()) {
                found = Some((rows, name, fields, meaning));
                break;
            }
        }
        let Some((mut rows, name, fields, meaning)) = found else {
            let invalid: usize = self.rows.iter().map(|(_, _, r)| r.invalid).sum();
            log.notes.push(format!(
                "the log holds no valid position ({invalid} messages say that theirs is not valid)"
            ));
            self.take_velocities(Rows::default(), log);
            return;
        };
        if rows.invalid > 0 {
            log.notes.push(format!("{} messages of {name} are left out: no fix, or not valid", rows.invalid));
        }
        let ellipsoid = rows.positions.iter().all(|p| p.value.ellipsoid_m.is_some());
        let height = if ellipsoid { "above the ellipsoid" } else { "above mean sea level (EGM96)" };
        for row in std::mem::take(&mut rows.positions) {
            let PositionRow { latitude, longitude, sea_level_m, ellipsoid_m } = row.value;
            let (height_m, kind) = match ellipsoid_m {
                Some(height_m) if ellipsoid => (height_m, HeightKind::Ellipsoid),
                _ => (sea_level_m, HeightKind::SeaLevel(GeoidModel::Egm96)),
            };
            let position = geodetic(latitude, longitude, height_m, kind);
            if let Some(value) = self.quarantine.keep(row.place, name, position) {
                log.positions.push(Sample { place: row.place, time: row.time, value });
            }
        }
        log.notes.push(format!(
            "positions: {} messages of {name}: {meaning}; heights {height}",
            log.positions.len()
        ));
        log.origins.push(Origin {
            quantity: "latitude, longitude",
            from: format!("{name}: {fields}"),
            meaning: format!("WGS 84: {meaning}"),
        });
        let field =
            if ellipsoid { "alt_ellipsoid (or altitude_ellipsoid_m)" } else { "alt (or altitude_msl_m)" };
        log.origins.push(Origin {
            quantity: "height",
            from: format!("{name}: {field}"),
            meaning: height.to_owned(),
        });
        self.take_velocities(rows, log);
    }

    /// The filter's velocities, else those of the receiver; heights above ground come with the filter's.
    fn take_velocities(&mut self, of_position: Rows, log: &mut FlightLog) {
        let has = |r: &Rows| !r.velocities.is_empty() || !r.heights_m.is_empty();
        let sources = [
            ("vehicle_local_position.vx, vy, vz", self.take(Topic::Local, has)),
            ("the position's topic: vel_n_m_s, vel_e_m_s, vel_d_m_s (or vx, vy, vz)", Some(of_position)),
            ("vehicle_gps_position.vel_n_m_s, vel_e_m_s, vel_d_m_s", self.take(Topic::Gps, has)),
            ("sensor_gps.vel_n_m_s, vel_e_m_s, vel_d_m_s", self.take(Topic::SensorGps, has)),
        ];
        for (from, rows) in sources.into_iter().filter_map(|(from, rows)| Some((from, rows?))) {
            if log.velocities.is_empty() && !rows.velocities.is_empty() {
                log.velocities = rows.velocities;
                log.origins.push(Origin {
                    quantity: "velocity",
                    from: format!("{from}, m/s"),
                    meaning: "north, east, down".to_owned(),
                });
            }
            if log.heights_above_ground.is_empty() && !rows.heights_m.is_empty() {
                log.heights_above_ground = rows.heights_m;
                log.origins.push(Origin {
                    quantity: "height above ground",
                    from: "vehicle_local_position.dist_bottom, metres".to_owned(),
                    meaning: "where dist_bottom_valid; made vertical by the filter".to_owned(),
                });
            }
        }
    }

    fn take_gimbals(&mut self, log: &mut FlightLog) {
        if let Some(rows) = self.take(Topic::Gimbal, |r| !r.gimbals.is_empty()) {
            self.gimbals_from_north(rows, log);
            log.origins.push(Origin {
                quantity: "gimbal pan, elevation, roll",
                from: "gimbal_device_attitude_status.q, device_flags".to_owned(),
                meaning: "x along the optical axis; to the horizon and to north, by the UAV's yaw where the flags say \
                          that the gimbal's counts from the nose"
                    .to_owned(),
            });
            return;
        }
        let Some(rows) = self.take(Topic::Mount, |r| !r.gimbals.is_empty()) else { return };
        // What the angles mean depends on who stabilises.
        match self.parameters.get("MNT_DO_STAB") {
            Some(1.0) => {
                for row in rows.gimbals {
                    let value = LoggedGimbal { angles: row.value.angles, reference: GimbalReference::Body };
                    log.gimbals.push(Sample { place: row.place, time: row.time, value });
                }
                log.notes.push(
                    "gimbal: mount_orientation, the angles commanded to the mount's axes (MNT_DO_STAB is 1)"
                        .to_owned(),
                );
            }
            Some(_) => {
                self.gimbals_from_north(rows, log);
                log.notes.push(
                    "gimbal: mount_orientation, the angles commanded to a mount that stabilises itself (MNT_DO_STAB \
                     is not 1): pitch and roll to the horizon, yaw from the nose"
                        .to_owned(),
                );
            }
            None => {
                log.notes.push(
                    "mount_orientation is left out: without MNT_DO_STAB nobody knows what its angles count from"
                        .to_owned(),
                );
                return;
            }
        }
        log.origins.push(Origin {
            quantity: "gimbal pan, elevation, roll",
            from: "mount_orientation.attitude_euler_angle, radians".to_owned(),
            meaning: "roll, pitch, yaw as commanded, not as measured".to_owned(),
        });
    }

    fn gimbals_from_north(&self, rows: Rows, log: &mut FlightLog) {
        let mut without_attitude = 0;
        for row in rows.gimbals {
            let GimbalRow { mut angles, from_north } = row.value;
            if !from_north {
                let Some(attitude) = attitude_at(&log.attitudes, row.time) else {
                    without_attitude += 1;
                    continue;
                };
                angles.pan = (angles.pan + attitude.yaw).wrapped();
            }
            let value = LoggedGimbal { angles, reference: GimbalReference::Nav };
            log.gimbals.push(Sample { place: row.place, time: row.time, value });
        }
        if without_attitude > 0 {
            log.notes.push(format!("{without_attitude} gimbal angles have no attitude of the UAV near them"));
        }
    }

    fn take_exposures(&mut self, log: &mut FlightLog) {
        let captures = self.take(Topic::Capture, |r| !r.shots.is_empty()).map_or_else(Vec::new, |r| r.shots);
        let triggers = self.take(Topic::Trigger, |r| !r.shots.is_empty()).map_or_else(Vec::new, |r| r.shots);
        let answered = triggers.iter().filter(|s| s.feedback).count();
        if captures.len() + triggers.len() == 0 {
            log.notes
                .push("the log holds no exposures (neither camera_capture nor camera_trigger)".to_owned());
            return;
        }
        let counts = format!(
            "the log has {} usable camera_capture, {} camera_trigger commands and {answered} with feedback",
            captures.len(),
            triggers.len() - answered
        );
        let (name, shots): (_, Vec<Shot>) = if captures.is_empty() {
            ("camera_trigger", triggers.into_iter().filter(|s| s.feedback == (answered > 0)).collect())
        } else {
            ("camera_capture", captures)
        };
        log.notes.push(format!("exposures: {name} is used; {counts}"));
        if self.without_feedback > 0 && name == "camera_capture" {
            log.notes.push(format!(
                "{} exposures of cameras that report nothing back (result −1): commands, not confirmed photos",
                self.without_feedback
            ));
        }
        let of_camera = is_of_camera(&shots, log);
        let origins: Arc<[Origin]> = messages::exposure_origins(name, of_camera).into();
        for Shot { mut exposure, angles, .. } in shots {
            if of_camera {
                exposure.gimbal = angles.map(|a| LoggedGimbal {
                    angles: GimbalAngles { pan: a.yaw, elevation: a.pitch, roll: a.roll },
                    reference: GimbalReference::Nav,
                });
            } else {
                exposure.attitude = angles.map(|angles| LoggedAttitude::Body { angles, north: North::True });
            }
            exposure.origins = Arc::clone(&origins);
            log.exposures.push(exposure);
        }
    }
}

/// Whose attitude `camera_capture.q` is: PX4 before 1.13 wrote the UAV's even with a gimbal, later the gimbal's where
/// one reports. The logged attitudes of both at the same time tell.
fn is_of_camera(shots: &[Shot], log: &mut FlightLog) -> bool {
    let apart = |other: &dyn Fn(Seconds) -> Option<YawPitchRoll>| {
        let mut degrees: Vec<f64> = shots
            .iter()
            .filter_map(|s| {
                let q = s.angles?.rotation::<Ned, Body>();
                Some(Radians::new(q.angle_to(&other(s.time)?.rotation())).degrees())
            })
            .collect();
        degrees.sort_by(f64::total_cmp);
        degrees.get(degrees.len() / 2).copied()
    };
    if shots.iter().all(|s| s.angles.is_none()) {
        return false;
    }
    let from_uav = apart(&|time| attitude_at(&log.attitudes, time));
    let from_gimbal = apart(&|time| gimbal_at(&log.gimbals, time));
    let (of_camera, why) = match (from_uav, from_gimbal) {
        (Some(uav), Some(gimbal)) => (
            gimbal < uav,
            format!(
                "it differs from the UAV's attitude by {uav:.1}°, from the gimbal's by {gimbal:.1}° (medians)"
            ),
        ),
        (Some(uav), None) => (uav > 10.0, format!("it differs from vehicle_attitude by {uav:.1}° (median)")),
        (None, _) => (!log.gimbals.is_empty(), "by the presence of gimbal topics".to_owned()),
    };
    let whose = if of_camera { "the camera (a gimbal's), x along the optical axis" } else { "the UAV" };
    log.notes.push(format!("camera_capture.q is taken as that of {whose}: {why}"));
    of_camera
}

/// The gimbal's attitude to the horizon and north, of the sample next in time and no more than half a second away.
fn gimbal_at(gimbals: &[Sample<LoggedGimbal>], time: Seconds) -> Option<YawPitchRoll> {
    let after = gimbals.partition_point(|s| s.time < time);
    let near = |i: usize| gimbals.get(i).filter(|s| (s.time - time).get().abs() <= 0.5);
    let (next, last) = (near(after), after.checked_sub(1).and_then(near));
    let away = |s: &Sample<LoggedGimbal>| (s.time - time).get().abs();
    let nearest = match (last, next) {
        (Some(a), Some(b)) => {
            if away(a) < away(b) {
                a
            } else {
                b
            }
        }
        (a, b) => a.or(b)?,
    };
    (nearest.value.reference == GimbalReference::Nav).then(|| nearest.value.angles.as_yaw_pitch_roll())
}

fn set_clock(offset: &ClockOffset, log: &mut FlightLog) {
    offset.apply(log);
    log.notes.push(format!(
        "times are UTC: start-up lies at {:.3} s Unix time, the median of {} receiver messages (±{:.3} s for 90 % of \
         them)",
        offset.offset_s, offset.records, offset.spread_s
    ));
    log.origins.push(Origin {
        quantity: "time",
        from:
            "timestamp_sample (else timestamp), µs since start-up, plus the median of time_utc_usec minus it"
                .to_owned(),
        meaning: "UTC".to_owned(),
    });
}
