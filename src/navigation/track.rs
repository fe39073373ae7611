//! Log records, and series of a log interpolated to the instant of exposure.

use super::mount::GimbalAngles;
use crate::camera::PixelRotation;
use crate::geodesy::{Geodetic, LocalTangent, WGS84};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Body, Displacement, Ned, Point, Rotation};
use crate::units::Seconds;
use std::cmp::Ordering;

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

/// A value of a series in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T> {
    /// Place in the file: line of a text, number of the record otherwise; from 1.
    pub place: u64,
    /// On the log's clock.
    pub time: Seconds,
    /// The value.
    pub value: T,
}

/// Why a log is no track, or has no pose for an instant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// Times must strictly increase.
    #[error("line {place}: time {time_s} s does not come after {previous_s} s of line {previous_place}")]
    NotIncreasing {
        /// Place of the later record.
        place: u64,
        /// Its time.
        time_s: f64,
        /// Place of the earlier record.
        previous_place: u64,
        /// Its time.
        previous_s: f64,
    },
    /// The instant lies before the first or after the last record.
    #[error(
        "exposure at {time_s:.3} s lies {by_s:.3} s {side} of the log's {series} ({first_s:.3} to {last_s:.3} s)"
    )]
    OutsideLog {
        /// Instant asked for.
        time_s: f64,
        /// What is asked for.
        series: &'static str,
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
    #[error(
        "exposure at {time_s:.3} s falls into a gap of {gap_s:.3} s in the log's {series} (limit {limit_s:.3} s)"
    )]
    Gap {
        /// Instant asked for.
        time_s: f64,
        /// What is asked for.
        series: &'static str,
        /// Length of the gap.
        gap_s: f64,
        /// `max_gap`.
        limit_s: f64,
    },
    /// Nothing to interpolate.
    #[error("the log has no positions")]
    Empty,
}

/// Samples in strictly increasing time.
#[derive(Debug, Clone, PartialEq)]
struct Series<T> {
    name: &'static str,
    samples: Vec<Sample<T>>,
}

/// The two samples around an instant and how far the instant is from the first to the second, 0 to 1.
struct Around<'a, T> {
    before: &'a Sample<T>,
    after: &'a Sample<T>,
    fraction: f64,
}

impl<T> Series<T> {
    fn new(name: &'static str, samples: Vec<Sample<T>>) -> Result<Self, TrackError> {
        for pair in samples.windows(2) {
            // Not-a-number does not come after anything.
            if pair[1].time.partial_cmp(&pair[0].time) != Some(Ordering::Greater) {
                return Err(TrackError::NotIncreasing {
                    place: pair[1].place,
                    time_s: pair[1].time.get(),
                    previous_place: pair[0].place,
                    previous_s: pair[0].time.get(),
                });
            }
        }
        Ok(Self { name, samples })
    }

    fn around(&self, time: Seconds, max_gap: Seconds) -> Result<Around<'_, T>, TrackError> {
        let (Some(first), Some(last)) = (self.samples.first(), self.samples.last()) else {
            return Err(TrackError::Empty);
        };
        if !(first.time..=last.time).contains(&time) {
            let early = time < first.time;
            let by = if early { first.time - time } else { time - last.time };
            return Err(TrackError::OutsideLog {
                time_s: time.get(),
                series: self.name,
                by_s: by.get(),
                side: if early { "before the start" } else { "after the end" },
                first_s: first.time.get(),
                last_s: last.time.get(),
            });
        }
        let k = self.samples.partition_point(|sample| sample.time < time);
        let after = &self.samples[k];
        // A record exactly at the instant needs no neighbour.
        if after.time == time || k == 0 {
            return Ok(Around { before: after, after, fraction: 0.0 });
        }
        let before = &self.samples[k - 1];
        let gap = after.time - before.time;
        if gap > max_gap {
            return Err(TrackError::Gap {
                time_s: time.get(),
                series: self.name,
                gap_s: gap.get(),
                limit_s: max_gap.get(),
            });
        }
        Ok(Around { before, after, fraction: (time - before.time).get() / gap.get() })
    }
}

/// What a [`Track`] is made of; a series may be empty, but for the positions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrackSeries {
    /// Antenna positions.
    pub positions: Vec<Sample<Geodetic>>,
    /// Attitudes of the UAV: `Ned` from `Body`.
    pub attitudes: Vec<Sample<YawPitchRoll>>,
    /// Gimbal angles.
    pub gimbals: Vec<Sample<GimbalAngles>>,
    /// Velocities, m/s.
    pub velocities: Vec<Sample<Displacement<Ned>>>,
    /// Heights above the ground, metres.
    pub heights_above_ground: Vec<Sample<f64>>,
}

/// Series of a log, each in strictly increasing time and each with its own instants.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    positions: Series<Geodetic>,
    attitudes: Series<YawPitchRoll>,
    gimbals: Series<GimbalAngles>,
    velocities: Series<Displacement<Ned>>,
    heights_above_ground: Series<f64>,
}

impl Track {
    /// Checks that there are positions and that times strictly increase.
    ///
    /// # Errors
    /// [`TrackError::Empty`], [`TrackError::NotIncreasing`].
    pub fn new(series: TrackSeries) -> Result<Self, TrackError> {
        if series.positions.is_empty() {
            return Err(TrackError::Empty);
        }
        Ok(Self {
            positions: Series::new("positions", series.positions)?,
            attitudes: Series::new("attitudes", series.attitudes)?,
            gimbals: Series::new("gimbal angles", series.gimbals)?,
            velocities: Series::new("velocities", series.velocities)?,
            heights_above_ground: Series::new("heights above ground", series.heights_above_ground)?,
        })
    }

    /// The record at an instant: position linear in space between the two neighbours, attitude and gimbal
    /// by spherical linear interpolation; velocity from the two positions where the log has none.
    ///
    /// A log without attitudes gives zero angles, one without gimbal angles none.
    ///
    /// # Errors
    /// [`TrackError::OutsideLog`] and [`TrackError::Gap`]; never an extrapolation.
    pub fn at(&self, time: Seconds, max_gap: Seconds) -> Result<NavigationRecord, TrackError> {
        let fix = self.positions.around(time, max_gap)?;
        let (a, b, k) = (&fix.before.value, &fix.after.value, fix.fraction);
        let (pa, pb) = (WGS84.ecef_from_geodetic(a), WGS84.ecef_from_geodetic(b));
        let antenna = if k == 0.0 {
            *a
        } else {
            WGS84.geodetic_from_ecef(&Point::from_vector(pa.vector() * (1.0 - k) + pb.vector() * k))
        };
        let attitude = match self.attitudes.samples.is_empty() {
            true => YawPitchRoll::default(),
            false => turned(&self.attitudes.around(time, max_gap)?, |angles| *angles),
        };
        let gimbal = match self.gimbals.samples.is_empty() {
            true => None,
            false => {
                let around = self.gimbals.around(time, max_gap)?;
                let g = turned(&around, GimbalAngles::as_yaw_pitch_roll);
                Some(GimbalAngles { pan: g.yaw, elevation: g.pitch, roll: g.roll })
            }
        };
        // What only adds to a pose is left out where the log is silent.
        let velocity = self.velocities.around(time, max_gap).ok();
        let velocity = velocity.map(|v| v.before.value * (1.0 - v.fraction) + v.after.value * v.fraction);
        let above = self.heights_above_ground.around(time, max_gap).ok();
        let height_above_ground_m =
            above.map(|h| h.before.value * (1.0 - h.fraction) + h.after.value * h.fraction);
        let velocity = velocity.or_else(|| self.moved(time, max_gap));
        Ok(NavigationRecord {
            line: if k < 0.5 { fix.before.place } else { fix.after.place },
            time: Some(time),
            antenna,
            attitude,
            gimbal,
            height_above_ground_m,
            ground_speed_m_s: velocity.map(|v| v.x().hypot(v.y())),
            velocity,
            pixel_rotation: None,
        })
    }

    /// Velocity from the positions on both sides of an instant, m/s.
    fn moved(&self, time: Seconds, max_gap: Seconds) -> Option<Displacement<Ned>> {
        let samples = &self.positions.samples;
        let k = samples.partition_point(|sample| sample.time < time).clamp(1, samples.len().max(2) - 1);
        let (a, b) = (samples.get(k - 1)?, samples.get(k)?);
        let gap = b.time - a.time;
        let (pa, pb) = (WGS84.ecef_from_geodetic(&a.value), WGS84.ecef_from_geodetic(&b.value));
        let moved = LocalTangent::at(a.value).ecef_from_ned().rotation.inverse() * (pb - pa);
        (gap <= max_gap).then(|| moved * (1.0 / gap.get()))
    }

    /// Place in the log of the position nearest to an instant.
    #[must_use]
    pub fn place_at(&self, time: Seconds) -> u64 {
        let samples = &self.positions.samples;
        let k = samples.partition_point(|sample| sample.time < time).min(samples.len() - 1);
        let earlier = k.checked_sub(1).filter(|j| time - samples[*j].time < samples[k].time - time);
        samples[earlier.unwrap_or(k)].place
    }

    /// First and last instant that has a position and, where the log has attitudes, an attitude.
    #[must_use]
    pub fn span(&self) -> (Seconds, Seconds) {
        let positions = &self.positions.samples;
        let (first, last) = (positions[0].time, positions[positions.len() - 1].time);
        match self.attitudes.samples.as_slice() {
            [] => (first, last),
            [from, .., to] => (
                if from.time > first { from.time } else { first },
                if to.time < last { to.time } else { last },
            ),
            [only] => (only.time, only.time),
        }
    }
}

fn turned<T>(around: &Around<'_, T>, angles: impl Fn(&T) -> YawPitchRoll) -> YawPitchRoll {
    if around.fraction == 0.0 {
        return angles(&around.before.value);
    }
    between(angles(&around.before.value), angles(&around.after.value), around.fraction)
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

    /// One line per instant: time, yaw in degrees, latitude in degrees.
    fn track(lines: &[(f64, f64, f64)]) -> Result<Track, TrackError> {
        let mut series = TrackSeries::default();
        for (k, (time, yaw, latitude)) in lines.iter().enumerate() {
            let (place, time) = (k as u64 + 2, Seconds::new(*time));
            let value = Geodetic::from_degrees(*latitude, 10.0, 500.0);
            series.positions.push(Sample { place, time, value });
            series.attitudes.push(Sample { place, time, value: YawPitchRoll::from_degrees(*yaw, 0.0, 0.0) });
        }
        Track::new(series)
    }

    #[test]
    fn heading_turns_the_short_way_through_north() {
        let track = track(&[(0.0, 350.0, 41.0), (1.0, 20.0, 41.0001)]).unwrap();
        let mid = track.at(Seconds::new(0.5), Seconds::new(2.0)).unwrap();
        assert!((mid.attitude.yaw.degrees() - 5.0).abs() < 1e-9, "{}", mid.attitude.yaw.degrees());
        assert!((mid.antenna.latitude.degrees() - 41.00005).abs() < 1e-9);
        let v = mid.velocity.unwrap();
        assert!((v.x() - 11.1).abs() < 0.1 && v.y().abs() < 1e-6, "northwards at 11 m/s: {v:?}");
        assert!((mid.ground_speed_m_s.unwrap() - 11.1).abs() < 0.1);
    }

    #[test]
    fn knots_come_back_exactly() {
        let track = track(&[(0.0, 350.0, 41.0), (1.0, 20.0, 41.1)]).unwrap();
        for (t, yaw) in [(0.0, 350.0), (1.0, 20.0)] {
            let r = track.at(Seconds::new(t), Seconds::new(2.0)).unwrap();
            assert!((r.attitude.yaw.degrees() - yaw).abs() < 1e-9);
        }
    }

    #[test]
    fn series_have_instants_of_their_own() {
        let mut series = TrackSeries::default();
        for (place, (time, latitude)) in [(0.0, 41.0), (1.0, 41.001)].into_iter().enumerate() {
            let value = Geodetic::from_degrees(latitude, 10.0, 500.0);
            series.positions.push(Sample { place: place as u64, time: Seconds::new(time), value });
        }
        for (place, (time, yaw)) in [(0.4, 10.0), (0.6, 20.0)].into_iter().enumerate() {
            let value = YawPitchRoll::from_degrees(yaw, 0.0, 0.0);
            series.attitudes.push(Sample { place: place as u64, time: Seconds::new(time), value });
        }
        let track = Track::new(series).unwrap();
        let mid = track.at(Seconds::new(0.5), Seconds::new(1.0)).unwrap();
        assert!((mid.attitude.yaw.degrees() - 15.0).abs() < 1e-9);
        assert!((mid.antenna.latitude.degrees() - 41.0005).abs() < 1e-8);
        let error = track.at(Seconds::new(0.3), Seconds::new(1.0)).unwrap_err();
        assert!(error.to_string().contains("attitudes"), "{error}");
        assert_eq!(track.span(), (Seconds::new(0.4), Seconds::new(0.6)));
    }

    #[test]
    fn no_extrapolation_and_no_bridge_over_gaps() {
        let track = track(&[(0.0, 0.0, 41.0), (5.0, 0.0, 41.1)]).unwrap();
        let at = |t, gap| track.at(Seconds::new(t), Seconds::new(gap));
        assert!(matches!(at(-0.1, 9.0), Err(TrackError::OutsideLog { .. })));
        assert!(matches!(at(5.1, 9.0), Err(TrackError::OutsideLog { .. })));
        assert!(matches!(at(f64::NAN, 9.0), Err(TrackError::OutsideLog { .. })));
        assert!(matches!(at(2.0, 1.0), Err(TrackError::Gap { .. })));
        assert!(at(5.0, 1.0).is_ok(), "a record at the instant itself");
    }

    #[test]
    fn disorder_is_named_by_line() {
        let error = track(&[(1.0, 0.0, 41.0), (1.0, 0.0, 41.1)]).unwrap_err();
        assert!(error.to_string().starts_with("line 3"), "{error}");
        assert_eq!(Track::new(TrackSeries::default()).unwrap_err(), TrackError::Empty);
    }
}
