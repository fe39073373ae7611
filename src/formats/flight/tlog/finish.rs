//! From the collected messages to the log: which source is used, on which clock, and what is said about it.

use super::super::autopilot::{ClockOffset, attitude_at, backward_steps};
use super::super::{FlightLog, LoggedGimbal, LoggedPosition, Origin, Sample};
use super::{Collected, GimbalRow, GimbalSource, ShotSource, Stated};
use crate::geodesy::HeightKind;
use crate::navigation::GimbalReference;
use crate::units::Seconds;
use std::sync::Arc;

impl Collected {
    /// Moves everything into the log.
    pub(super) fn finish(mut self, log: &mut FlightLog) {
        let received = self.received.quantile(0.05);
        let utc = self.system_time.quantile(0.5).or(received);
        let own = |time: Stated| match time {
            Stated::Boot(seconds) => Some(seconds),
            Stated::Utc(seconds) => utc.map(|o| seconds - o.offset_s),
            Stated::Received(seconds) => received.map(|o| seconds - o.offset_s),
        };
        self.finish_series(log);
        if let Some((source, rows)) = self.gimbals.pop_first() {
            finish_gimbals(source, &rows, own, log);
        }
        self.finish_ranges(log);
        self.finish_exposures(own, log);
        set_clock(self.system_time.quantile(0.5), received, log);
        self.quarantine.finish(log);
        log.bad.sort_by_key(|b| b.place);
        let back = backward_steps(&log.attitudes) + backward_steps(&log.positions);
        if back > 0 {
            log.notes.push(format!(
                "time runs backwards {back} times (a restart, or two links in one file): only the parts in order can \
                 be used"
            ));
        }
    }

    fn finish_series(&mut self, log: &mut FlightLog) {
        let (name, attitudes) = if self.euler.is_empty() {
            ("ATTITUDE_QUATERNION.q1 … q4", std::mem::take(&mut self.quaternions))
        } else {
            ("ATTITUDE.yaw, pitch, roll, radians", std::mem::take(&mut self.euler))
        };
        log.attitudes = attitudes;
        log.origins.push(Origin {
            quantity: "yaw, pitch, roll",
            from: name.to_owned(),
            meaning: "of the UAV; yaw from true north (the autopilot adds the declination)".to_owned(),
        });
        let sea_level = ("alt, millimetres", "above mean sea level, as the receiver's geoid (EGM96) has it");
        let (name, why, (field, height), positions) = if self.filter.is_empty() {
            let why = "the receiver's fixes; times are those of the message before, as theirs are of no known clock";
            let (ellipsoid, positions) = one_kind(std::mem::take(&mut self.receiver));
            let height =
                if ellipsoid { ("alt_ellipsoid, millimetres", "above the ellipsoid") } else { sea_level };
            ("GPS_RAW_INT", why, height, positions)
        } else {
            ("GLOBAL_POSITION_INT", "the autopilot's filter", sea_level, std::mem::take(&mut self.filter))
        };
        log.positions = positions;
        log.velocities = std::mem::take(&mut self.velocities);
        log.notes.push(format!(
            "positions: {} messages of {name} ({why}); {} without a fix are left out",
            log.positions.len(),
            self.without_fix
        ));
        log.origins.extend([
            Origin {
                quantity: "latitude, longitude",
                from: format!("{name}.lat, lon, 1e-7 degrees"),
                meaning: "WGS 84".to_owned(),
            },
            Origin { quantity: "height", from: format!("{name}.{field}"), meaning: height.to_owned() },
            Origin {
                quantity: "velocity",
                from: "GLOBAL_POSITION_INT.vx, vy, vz, cm/s".to_owned(),
                meaning: "north, east, down".to_owned(),
            },
        ]);
    }

    fn finish_ranges(&mut self, log: &mut FlightLog) {
        for range in &self.ranges {
            let Some(attitude) = attitude_at(&log.attitudes, range.time) else { continue };
            let cosine = attitude.pitch.get().cos() * attitude.roll.get().cos();
            if cosine > 0.5 {
                log.heights_above_ground.push(Sample { value: range.value * cosine, ..*range });
            }
        }
        if !log.heights_above_ground.is_empty() {
            log.origins.push(Origin {
                quantity: "height above ground",
                from: "DISTANCE_SENSOR.current_distance, cm, times cos(pitch)·cos(roll)".to_owned(),
                meaning: "downward sensor within its limits, UAV tilted less than 60°".to_owned(),
            });
        }
    }

    fn finish_exposures(&mut self, own: impl Fn(Stated) -> Option<f64>, log: &mut FlightLog) {
        let count = |source| self.shots.get(&source).map_or(0, Vec::len);
        let counts = format!(
            "{} CAMERA_IMAGE_CAPTURED, {} CAMERA_FEEDBACK, {} CAMERA_TRIGGER; {} repeated messages are left out",
            count(ShotSource::Captured),
            count(ShotSource::Feedback),
            count(ShotSource::Trigger),
            self.repeated
        );
        let Some((source, shots)) = self.shots.pop_first() else {
            log.notes.push("the log holds no exposures".to_owned());
            return;
        };
        let (name, origins) = exposure_origins(source);
        log.notes.push(format!("exposures: {name} is used; the log has {counts}"));
        let origins: Arc<[Origin]> = origins.into();
        for (time, mut exposure) in shots {
            exposure.time = own(time).map(Seconds::new);
            exposure.origins = Arc::clone(&origins);
            log.exposures.push(exposure);
        }
    }
}

/// The fixes by ellipsoidal height when every one states it (`true`), else all by height above sea level.
fn one_kind(fixes: Vec<(Sample<LoggedPosition>, Option<f64>)>) -> (bool, Vec<Sample<LoggedPosition>>) {
    let all = fixes.iter().all(|(_, ellipsoid)| ellipsoid.is_some());
    let by = |(sample, ellipsoid): (Sample<LoggedPosition>, Option<f64>)| match (sample.value, ellipsoid) {
        (LoggedPosition::Geodetic { latitude, longitude, .. }, Some(height_m)) if all => {
            let kind = HeightKind::Ellipsoid;
            Sample { value: LoggedPosition::Geodetic { latitude, longitude, height_m, kind }, ..sample }
        }
        _ => sample,
    };
    (all, fixes.into_iter().map(by).collect())
}

fn finish_gimbals(
    source: GimbalSource,
    rows: &[GimbalRow],
    own: impl Fn(Stated) -> Option<f64>,
    log: &mut FlightLog,
) {
    let mut left_out = 0;
    for row in rows {
        let Some(time) = own(row.time).map(Seconds::new) else { continue };
        let mut angles = row.angles;
        if !row.from_north {
            let Some(attitude) = attitude_at(&log.attitudes, time) else {
                left_out += 1;
                continue;
            };
            angles.pan = (angles.pan + attitude.yaw).wrapped();
        }
        let value = LoggedGimbal { angles, reference: GimbalReference::Nav };
        log.gimbals.push(Sample { place: row.place, time, value });
    }
    let (from, note) = match source {
        GimbalSource::Device => ("GIMBAL_DEVICE_ATTITUDE_STATUS.q, flags", "as the gimbal reports it"),
        GimbalSource::Orientation => (
            "MOUNT_ORIENTATION.roll, pitch, yaw, degrees",
            "possibly the commanded angles; yaw from the nose",
        ),
        GimbalSource::Status => (
            "MOUNT_STATUS.pointing_a, b, c, 0.01 degrees",
            "ArduPilot's; yaw from the nose; timed by receipt",
        ),
    };
    log.notes.push(format!(
        "gimbal: {from}: {note}; {left_out} without an attitude of the UAV near them are left out"
    ));
    log.origins.push(Origin {
        quantity: "gimbal pan, elevation, roll",
        from: from.to_owned(),
        meaning: format!("to the horizon and, by the UAV's yaw where needed, to north; {note}"),
    });
}

fn exposure_origins(source: ShotSource) -> (&'static str, Vec<Origin>) {
    let origin = |quantity, from: &str, meaning: &str| Origin {
        quantity,
        from: from.to_owned(),
        meaning: meaning.to_owned(),
    };
    match source {
        ShotSource::Captured => (
            "CAMERA_IMAGE_CAPTURED",
            vec![
                origin(
                    "time",
                    "CAMERA_IMAGE_CAPTURED.time_utc (else time_boot_ms, else receipt)",
                    "of the photo",
                ),
                origin("frame", "CAMERA_IMAGE_CAPTURED.file_url", "its last part"),
                origin("latitude, longitude", "CAMERA_IMAGE_CAPTURED.lat, lon, 1e-7 degrees", "WGS 84"),
                origin("height", "CAMERA_IMAGE_CAPTURED.alt, millimetres", "above mean sea level (EGM96)"),
                origin(
                    "height above take-off",
                    "CAMERA_IMAGE_CAPTURED.relative_alt, millimetres",
                    "above home",
                ),
                origin(
                    "gimbal pan, elevation, roll",
                    "CAMERA_IMAGE_CAPTURED.q",
                    "of the camera, x along its axis",
                ),
            ],
        ),
        ShotSource::Feedback => (
            "CAMERA_FEEDBACK",
            vec![
                origin("time", "CAMERA_FEEDBACK.time_usec", "since 1970, or since start-up where small"),
                origin("latitude, longitude", "CAMERA_FEEDBACK.lat, lng, 1e-7 degrees", "WGS 84"),
                origin("height", "CAMERA_FEEDBACK.alt_msl, metres", "above mean sea level (EGM96)"),
                origin("height above take-off", "CAMERA_FEEDBACK.alt_rel, metres", "above home"),
                origin(
                    "yaw, pitch, roll",
                    "CAMERA_FEEDBACK.yaw, pitch, roll, degrees",
                    "of the UAV (ArduPilot)",
                ),
            ],
        ),
        ShotSource::Trigger => (
            "CAMERA_TRIGGER",
            vec![origin(
                "time",
                "CAMERA_TRIGGER.time_usec",
                "command; since 1970, or since start-up where small",
            )],
        ),
    }
}

fn set_clock(system_time: Option<ClockOffset>, received: Option<ClockOffset>, log: &mut FlightLog) {
    let (offset, how) = match (system_time, received) {
        (Some(offset), _) => (offset, "SYSTEM_TIME, which the autopilot sends (median)"),
        (None, Some(offset)) => (
            offset,
            "the ground station's clock at receipt (least latency; that clock's own error and some latency are in it)",
        ),
        (None, None) => {
            log.notes.push("times count from the autopilot's start-up".to_owned());
            return;
        }
    };
    offset.apply(log);
    log.notes.push(format!(
        "times are UTC: start-up lies at {:.3} s Unix time by {} messages of {how} (±{:.3} s for 90 % of them)",
        offset.offset_s, offset.records, offset.spread_s
    ));
    log.origins.push(Origin {
        quantity: "time",
        from: "time_boot_ms of each message".to_owned(),
        meaning: format!("UTC by {how}"),
    });
}
