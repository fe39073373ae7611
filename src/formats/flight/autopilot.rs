//! What the logs of autopilots share: a clock that starts with the unit, quaternions, gimbals whose yaw counts from the
//! nose, and records set aside.

use super::{BadRecord, Clock, FlightLog, LoggedAttitude, Sample};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Body, Ned, Rotation};
use crate::units::{Radians, Seconds};
use nalgebra::{Quaternion, UnitQuaternion};

/// Unusable records are listed one by one up to here and counted beyond, so that a hostile log cannot fill the memory.
const LISTED: usize = 1_000;

/// Exposures beyond this number are set aside: no survey has as many, and each takes more memory than it takes bytes.
pub(super) const EXPOSURES: usize = 200_000;

/// Records set aside while a log is read.
#[derive(Debug, Default)]
pub(super) struct Quarantine {
    bad: Vec<BadRecord>,
    more: u64,
}

impl Quarantine {
    /// Sets a record aside.
    pub(super) fn add(&mut self, place: u64, cause: impl Into<String>) {
        if self.bad.len() < LISTED {
            self.bad.push(BadRecord { place, frame: None, cause: cause.into() });
        } else {
            self.more += 1;
        }
    }

    /// The value, or `None` with the record set aside under the message's name.
    pub(super) fn keep<T>(&mut self, place: u64, what: &str, value: Result<T, String>) -> Option<T> {
        match value {
            Ok(value) => Some(value),
            Err(cause) => {
                self.add(place, format!("{what}: {cause}"));
                None
            }
        }
    }

    /// Whether one more exposure may be kept beside so many; if not, it is set aside.
    pub(super) fn has_room(&mut self, place: u64, exposures: usize) -> bool {
        if exposures >= EXPOSURES {
            self.add(place, format!("more than {EXPOSURES} exposures"));
        }
        exposures < EXPOSURES
    }

    /// Moves everything into the log, in the file's order.
    pub(super) fn finish(mut self, log: &mut FlightLog) {
        self.bad.sort_by_key(|b| b.place);
        log.bad.append(&mut self.bad);
        if self.more > 0 {
            log.notes.push(format!("{} more unusable records are not listed one by one", self.more));
        }
    }
}

/// Offsets between the unit's own clock and UTC, one per record that states both.
#[derive(Debug, Default)]
pub(super) struct ClockFit {
    offsets_s: Vec<f64>,
}

/// UTC minus the unit's own clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ClockOffset {
    /// Median, seconds.
    pub(super) offset_s: f64,
    /// Half the range that holds the middle 90 % of the offsets, seconds.
    pub(super) spread_s: f64,
    /// Records that state both clocks.
    pub(super) records: usize,
}

impl ClockFit {
    /// A record that states both: seconds of the own clock, Unix seconds. Times outside 2000 to 2100 are no UTC.
    pub(super) fn add(&mut self, own_s: f64, utc_s: f64) {
        if own_s.is_finite() && (946_684_800.0..4_102_444_800.0).contains(&utc_s) {
            self.offsets_s.push(utc_s - own_s);
        }
    }

    /// The offset at a fraction of the sorted offsets (0.5: the median, which a few wrong records cannot move).
    pub(super) fn quantile(&mut self, fraction: f64) -> Option<ClockOffset> {
        let n = self.offsets_s.len();
        if n == 0 {
            return None;
        }
        self.offsets_s.sort_by(f64::total_cmp);
        let at = |f: f64| self.offsets_s[((n - 1) as f64 * f).round() as usize];
        Some(ClockOffset { offset_s: at(fraction), spread_s: 0.5 * (at(0.95) - at(0.05)), records: n })
    }
}

impl ClockOffset {
    /// Moves every time of the log from the unit's own clock to UTC.
    pub(super) fn apply(&self, log: &mut FlightLog) {
        fn shift<T>(series: &mut [Sample<T>], by: Seconds) {
            for sample in series {
                sample.time = sample.time + by;
            }
        }
        let by = Seconds::new(self.offset_s);
        shift(&mut log.positions, by);
        shift(&mut log.attitudes, by);
        shift(&mut log.gimbals, by);
        shift(&mut log.velocities, by);
        shift(&mut log.heights_above_ground, by);
        for exposure in &mut log.exposures {
            exposure.time = exposure.time.map(|t| t + by);
        }
        log.clock = Clock::Utc;
    }
}

/// The angles of a quaternion (w, x, y, z) that turns a body's axes (forward, right, down) to north-east-down.
///
/// # Errors
/// Words for one that is not finite or far from unit length.
pub(super) fn angles_of_quaternion(q: [f64; 4]) -> Result<YawPitchRoll, String> {
    let quaternion = Quaternion::new(q[0], q[1], q[2], q[3]);
    let norm = quaternion.norm();
    // Single precision leaves 1e-7.
    if !norm.is_finite() || (norm - 1.0).abs() > 0.01 {
        return Err(format!("quaternion {q:?} has length {norm}, not 1"));
    }
    let rotation = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
    Ok(YawPitchRoll::of(&Rotation::<Ned, Body>::from_rotation(rotation)))
}

/// The UAV's attitude between two neighbouring samples no more than a second apart, along the shorter way round.
pub(super) fn attitude_at(attitudes: &[Sample<LoggedAttitude>], time: Seconds) -> Option<YawPitchRoll> {
    let angles = |s: &Sample<LoggedAttitude>| match s.value {
        LoggedAttitude::Body { angles, .. } => Some(angles),
        _ => None,
    };
    let after = attitudes.partition_point(|s| s.time < time);
    let next = attitudes.get(after)?;
    if next.time == time {
        return angles(next);
    }
    let last = attitudes.get(after.checked_sub(1)?)?;
    let step = (next.time - last.time).get();
    let part = (time - last.time).get() / step;
    if !(step <= 1.0 && (0.0..=1.0).contains(&part)) {
        return None;
    }
    let (a, b) = (angles(last)?, angles(next)?);
    let between = |a: Radians, b: Radians| Radians::new(a.get() + part * (b - a).wrapped().get()).wrapped();
    Some(YawPitchRoll::new(between(a.yaw, b.yaw), between(a.pitch, b.pitch), between(a.roll, b.roll)))
}

/// What a gimbal's quaternion counts its yaw from, by `GIMBAL_DEVICE_FLAGS`: earth frame (64), vehicle frame (32), or,
/// where neither is set, by the yaw lock (16).
pub(super) const fn yaw_is_from_north(flags: u32) -> bool {
    flags & 64 != 0 || flags & 32 == 0 && flags & 16 != 0
}

/// How often the times of a series run backwards, as when a log holds several flights.
pub(super) fn backward_steps<T>(series: &[Sample<T>]) -> usize {
    series.windows(2).filter(|w| w[1].time < w[0].time).count()
}

/// `N` bytes from `at`; `None` beyond the end.
pub(super) fn array_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at.checked_add(N)?)?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::super::North;
    use super::*;

    fn body(time: f64, yaw: f64) -> Sample<LoggedAttitude> {
        let angles = YawPitchRoll::from_degrees(yaw, 1.0, -2.0);
        Sample {
            place: 1,
            time: Seconds::new(time),
            value: LoggedAttitude::Body { angles, north: North::True },
        }
    }

    #[test]
    fn attitudes_turn_the_short_way_and_gaps_are_not_bridged() {
        let series = [body(0.0, 350.0), body(0.5, 10.0), body(3.0, 20.0)];
        let at = |t| attitude_at(&series, Seconds::new(t));
        assert!((at(0.25).unwrap().yaw.degrees()).abs() < 1e-9);
        assert!((at(0.5).unwrap().yaw.degrees() - 10.0).abs() < 1e-9);
        assert!(at(1.0).is_none() && at(-0.1).is_none() && at(3.1).is_none() && at(f64::NAN).is_none());
    }

    #[test]
    fn quaternions_become_angles() {
        // Half-angle formula: 90° about z is (cos 45°, 0, 0, sin 45°).
        let h = std::f64::consts::FRAC_1_SQRT_2;
        let turned = angles_of_quaternion([h, 0.0, 0.0, h]).unwrap();
        assert!((turned.yaw.degrees() - 90.0).abs() < 1e-9);
        let nose_up = angles_of_quaternion([(0.1f64).cos(), 0.0, (0.1f64).sin(), 0.0]).unwrap();
        assert!((nose_up.pitch.get() - 0.2).abs() < 1e-12);
        for q in [[0.0; 4], [f64::NAN, 0.0, 0.0, 1.0], [2.0, 0.0, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0, 0.0]] {
            assert!(angles_of_quaternion(q).is_err());
        }
    }

    #[test]
    fn a_few_wrong_clocks_do_not_move_the_offset() {
        let mut fit = ClockFit::default();
        for i in 0..100 {
            fit.add(f64::from(i), 1.6e9 + f64::from(i));
        }
        fit.add(5.0, 1.7e9);
        fit.add(5.0, 12.0);
        fit.add(f64::NAN, 1.6e9);
        let offset = fit.quantile(0.5).unwrap();
        assert_eq!((offset.offset_s, offset.records), (1.6e9, 101));
        assert!(ClockFit::default().quantile(0.5).is_none());
    }
}
