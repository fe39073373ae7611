//! Log records and their interpolation to the instant of exposure.

use super::mount::GimbalAngles;
use crate::camera::PixelRotation;
use crate::geodesy::{Geodetic, LocalTangent, WGS84};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Body, Displacement, Ned, Point, Rotation};
use crate::units::Seconds;

/// What the ADAHRS knew at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct NavigationRecord {
    /// Where it stands in the log: line of the file, 1-based.
    pub line: u64,
    /// Seconds on the log's clock, if the log has one.
    pub time: Option<Seconds>,
    /// Position of the antenna.
    pub antenna: Geodetic,
    /// Attitude of the UAV: `Ned` from `Body`.
    pub attitude: YawPitchRoll,
    /// Gimbal angles, when logged.
    pub gimbal: Option<GimbalAngles>,
    /// Height above ground as logged, metres.
    pub height_above_ground_m: Option<f64>,
    /// Speed over ground as logged, m/s.
    pub ground_speed_m_s: Option<f64>,
    /// Velocity as logged, m/s.
    pub velocity: Option<Displacement<Ned>>,
    /// How this frame's stored pixels are turned, when the log says so.
    pub pixel_rotation: Option<PixelRotation>,
}

/// Why a log is no track, or has no pose for an instant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// A record without a time in a log joined by time.
    #[error("line {line}: no time, and frames are joined to the log by time")]
    NoTime {
        /// Line in the log.
        line: u64,
    },
    /// Times must strictly increase.
    #[error("line {line}: time {time_s} s does not come after {previous_s} s of line {previous_line}")]
    NotIncreasing {
        /// Line of the later record.
        line: u64,
        /// Its time.
        time_s: f64,
        /// Line of the earlier record.
        previous_line: u64,
        /// Its time.
        previous_s: f64,
    },
    /// The instant lies before the first or after the last record.
    #[error("exposure at {time_s:.3} s lies {by_s:.3} s {side} of the log ({first_s:.3} to {last_s:.3} s)")]
    OutsideLog {
        /// Instant asked for.
        time_s: f64,
        /// How far outside.
        by_s: f64,
        /// "before the start" or "after the end".
        side: &'static str,
        /// First record.
        first_s: f64,
        /// Last record.
        last_s: f64,
    },
    /// The log is silent around the instant for longer than allowed.
    #[error("exposure at {time_s:.3} s falls into a gap of {gap_s:.3} s in the log (limit {limit_s:.3} s)")]
    Gap {
        /// Instant asked for.
        time_s: f64,
        /// Length of the gap.
        gap_s: f64,
        /// `max_gap`.
        limit_s: f64,
    },
    /// Nothing to interpolate.
    #[error("the log has no records")]
    Empty,
}

/// Records in strictly increasing time.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    records: Vec<NavigationRecord>,
    times: Vec<f64>,
}

impl Track {
    /// Checks that every record has a time and that times strictly increase.
    ///
    /// # Errors
    /// [`TrackError::Empty`], [`TrackError::NoTime`], [`TrackError::NotIncreasing`].
    pub fn new(records: Vec<NavigationRecord>) -> Result<Self, TrackError> {
        if records.is_empty() {
            return Err(TrackError::Empty);
        }
        let times = records
            .iter()
            .map(|r| r.time.map(Seconds::get).ok_or(TrackError::NoTime { line: r.line }))
            .collect::<Result<Vec<_>, _>>()?;
        for (i, pair) in times.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                return Err(TrackError::NotIncreasing {
                    line: records[i + 1].line,
                    time_s: pair[1],
                    previous_line: records[i].line,
                    previous_s: pair[0],
                });
            }
        }
        Ok(Self { records, times })
    }

    /// The record at an instant: position linear in space between the two neighbours, attitude and gimbal
    /// by spherical linear interpolation; velocity from the two positions where the log has none.
    ///
    /// # Errors
    /// [`TrackError::OutsideLog`] and [`TrackError::Gap`]; never an extrapolation.
    pub fn at(&self, time: Seconds, max_gap: Seconds) -> Result<NavigationRecord, TrackError> {
        let t = time.get();
        let (first, last) = (self.times[0], self.times[self.times.len() - 1]);
        if t < first || t > last {
            let (by_s, side) =
                if t < first { (first - t, "before the start") } else { (t - last, "after the end") };
            return Err(TrackError::OutsideLog { time_s: t, by_s, side, first_s: first, last_s: last });
        }
        let after = self.times.partition_point(|x| *x < t).max(1).min(self.times.len() - 1);
        if self.times.len() == 1 {
            return Ok(self.records[0].clone());
        }
        let (a, b) = (&self.records[after - 1], &self.records[after]);
        let gap = self.times[after] - self.times[after - 1];
        // A record exactly at the instant needs no neighbour.
        for (record, at) in [(a, self.times[after - 1]), (b, self.times[after])] {
            if at == t && gap > max_gap.get() {
                return Ok(record.clone());
            }
        }
        if gap > max_gap.get() {
            return Err(TrackError::Gap { time_s: t, gap_s: gap, limit_s: max_gap.get() });
        }
        let k = (t - self.times[after - 1]) / gap;
        let (pa, pb) = (WGS84.ecef_from_geodetic(&a.antenna), WGS84.ecef_from_geodetic(&b.antenna));
        let antenna =
            WGS84.geodetic_from_ecef(&Point::from_vector(pa.vector() * (1.0 - k) + pb.vector() * k));
        let moved = LocalTangent::at(antenna).ecef_from_ned().rotation.inverse() * (pb - pa);
        let blend = |x: Option<f64>, y: Option<f64>| Some(x? * (1.0 - k) + y? * k);
        let velocity = match (a.velocity, b.velocity) {
            (Some(va), Some(vb)) => va * (1.0 - k) + vb * k,
            _ => moved * (1.0 / gap),
        };
        Ok(NavigationRecord {
            line: if k < 0.5 { a.line } else { b.line },
            time: Some(time),
            antenna,
            attitude: between(a.attitude, b.attitude, k),
            gimbal: match (a.gimbal, b.gimbal) {
                (Some(x), Some(y)) => {
                    let g = between(x.as_yaw_pitch_roll(), y.as_yaw_pitch_roll(), k);
                    Some(GimbalAngles { pan: g.yaw, elevation: g.pitch, roll: g.roll })
                }
                _ => None,
            },
            height_above_ground_m: blend(a.height_above_ground_m, b.height_above_ground_m),
            ground_speed_m_s: blend(a.ground_speed_m_s, b.ground_speed_m_s),
            velocity: Some(velocity),
            pixel_rotation: if k < 0.5 { a.pixel_rotation } else { b.pixel_rotation },
        })
    }
}

fn between(a: YawPitchRoll, b: YawPitchRoll, k: f64) -> YawPitchRoll {
    let (qa, qb) = (a.rotation::<Ned, Body>().quaternion(), b.rotation::<Ned, Body>().quaternion());
    // Half a turn apart there is no shortest way; the nearer record is the honest answer.
    let q = qa.try_slerp(&qb, k, 1e-12).unwrap_or(if k < 0.5 { qa } else { qb });
    YawPitchRoll::of(&Rotation::<Ned, Body>::from_rotation(q.to_rotation_matrix()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(line: u64, time: f64, yaw: f64, lat: f64) -> NavigationRecord {
        NavigationRecord {
            line,
            time: Some(Seconds::new(time)),
            antenna: Geodetic::from_degrees(lat, 10.0, 500.0),
            attitude: YawPitchRoll::from_degrees(yaw, 0.0, 0.0),
            gimbal: None,
            height_above_ground_m: None,
            ground_speed_m_s: None,
            velocity: None,
            pixel_rotation: None,
        }
    }

    #[test]
    fn heading_turns_the_short_way_through_north() {
        let track = Track::new(vec![record(2, 0.0, 350.0, 41.0), record(3, 1.0, 20.0, 41.0001)]).unwrap();
        let mid = track.at(Seconds::new(0.5), Seconds::new(2.0)).unwrap();
        assert!((mid.attitude.yaw.degrees() - 5.0).abs() < 1e-9, "{}", mid.attitude.yaw.degrees());
        assert!((mid.antenna.latitude.degrees() - 41.00005).abs() < 1e-9);
        let v = mid.velocity.unwrap();
        assert!((v.x() - 11.1).abs() < 0.1 && v.y().abs() < 1e-6, "northwards at 11 m/s: {v:?}");
    }

    #[test]
    fn knots_come_back_exactly() {
        let track = Track::new(vec![record(2, 0.0, 350.0, 41.0), record(3, 1.0, 20.0, 41.1)]).unwrap();
        for (t, yaw) in [(0.0, -10.0), (1.0, 20.0)] {
            let r = track.at(Seconds::new(t), Seconds::new(2.0)).unwrap();
            assert!((r.attitude.yaw.degrees() - yaw).abs() < 1e-9);
        }
    }

    #[test]
    fn no_extrapolation_and_no_bridge_over_gaps() {
        let track = Track::new(vec![record(2, 0.0, 0.0, 41.0), record(3, 5.0, 0.0, 41.1)]).unwrap();
        assert!(matches!(
            track.at(Seconds::new(-0.1), Seconds::new(9.0)),
            Err(TrackError::OutsideLog { .. })
        ));
        assert!(matches!(track.at(Seconds::new(5.1), Seconds::new(9.0)), Err(TrackError::OutsideLog { .. })));
        assert!(matches!(track.at(Seconds::new(2.0), Seconds::new(1.0)), Err(TrackError::Gap { .. })));
        assert!(track.at(Seconds::new(5.0), Seconds::new(1.0)).is_ok(), "a record at the instant itself");
    }

    #[test]
    fn disorder_is_named_by_line() {
        let error = Track::new(vec![record(2, 1.0, 0.0, 41.0), record(3, 1.0, 0.0, 41.1)]).unwrap_err();
        assert!(error.to_string().starts_with("line 3"), "{error}");
        assert_eq!(Track::new(vec![]).unwrap_err(), TrackError::Empty);
    }
}
