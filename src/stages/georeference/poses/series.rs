//! The series of a log as a track.

use super::Conventions;
use crate::formats::InputError;
use crate::formats::flight::{FlightLog, LoggedAttitude, North, Sample};
use crate::geometry::attitude::YawPitchRoll;
use crate::navigation::{GimbalReference, Track, TrackError, TrackSeries};
use crate::units::Seconds;

impl Conventions<'_> {
    /// The series of the log as a track, and the north that its attitudes count from.
    ///
    /// Records that do not come after their predecessor are an error in a table, where somebody declared what the times
    /// are; autopilots repeat records, and a repeated one is left out and counted.
    ///
    /// # Errors
    /// [`InputError`] for what concerns the whole log. `Ok(None)`: the log has no series of positions.
    pub(in super::super) fn track(
        &self,
        log: &FlightLog,
        notes: &mut Vec<String>,
    ) -> Result<Option<(Track, SeriesAttitude)>, InputError> {
        if log.positions.is_empty() {
            return Ok(None);
        }
        let stated: Vec<_> = log.positions.iter().map(|sample| (sample.value, None)).collect();
        let mut series = TrackSeries::default();
        let mut unusable: Option<(u64, String, usize)> = None;
        for (sample, place) in log.positions.iter().zip(self.positions(&stated)?) {
            match place {
                Ok(value) => {
                    series.positions.push(Sample { place: sample.place, time: sample.time, value });
                }
                Err(cause) => {
                    unusable.get_or_insert((sample.place, cause, 0)).2 += 1;
                }
            }
        }
        if let Some((place, cause, count)) = unusable {
            notes.push(format!(
                "{count} positions of the log cannot be used; the first: record {place}: {cause}"
            ));
        }
        let attitude = series_attitude(log);
        for Sample { place, time, value } in &log.attitudes {
            if let LoggedAttitude::Body { angles, .. } | LoggedAttitude::Camera { angles, .. } = value {
                series.attitudes.push(Sample { place: *place, time: *time, value: *angles });
            }
        }
        for Sample { place, time, value } in &log.gimbals {
            series.gimbals.push(Sample { place: *place, time: *time, value: value.angles });
        }
        series.velocities.clone_from(&log.velocities);
        series.heights_above_ground.clone_from(&log.heights_above_ground);
        if self.declared.log.as_table().is_none() {
            let repeated = advance(&mut series.positions)
                + advance(&mut series.attitudes)
                + advance(&mut series.gimbals)
                + advance(&mut series.velocities)
                + advance(&mut series.heights_above_ground);
            if repeated > 0 {
                notes.push(format!(
                    "{repeated} records of the log do not come after their predecessor in time and are left out"
                ));
            }
        }
        match Track::new(series) {
            Ok(track) => Ok(Some((track, attitude))),
            Err(TrackError::Empty) => Ok(None),
            Err(error) => Err(self.of_log(error.to_string())),
        }
    }
}

/// What the attitudes of a log's series are; all of them are of one kind.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct SeriesAttitude {
    /// Of the UAV (true) or of the camera (false); `None`: the log has no attitudes.
    pub(super) of_body: Option<bool>,
    pub(super) north: North,
    pub(super) gimbal: Option<GimbalReference>,
}

impl SeriesAttitude {
    pub(super) const NONE: Self = Self { of_body: None, north: North::True, gimbal: None };

    /// Interpolated angles as the log would have stated them.
    pub(super) fn of(self, angles: YawPitchRoll) -> Option<LoggedAttitude> {
        let north = self.north;
        Some(match self.of_body? {
            true => LoggedAttitude::Body { angles, north },
            false => LoggedAttitude::Camera { angles, north },
        })
    }
}

fn series_attitude(log: &FlightLog) -> SeriesAttitude {
    let gimbal = log.gimbals.first().map(|sample| sample.value.reference);
    match log.attitudes.first().map(|sample| sample.value) {
        Some(LoggedAttitude::Body { north, .. }) => SeriesAttitude { of_body: Some(true), north, gimbal },
        Some(LoggedAttitude::Camera { north, .. }) => SeriesAttitude { of_body: Some(false), north, gimbal },
        _ => SeriesAttitude { gimbal, ..SeriesAttitude::NONE },
    }
}

/// Leaves out samples that do not come after their predecessor; how many.
fn advance<T>(samples: &mut Vec<Sample<T>>) -> usize {
    let before = samples.len();
    let mut latest = Seconds::new(f64::NEG_INFINITY);
    samples.retain(|sample| {
        let later = sample.time > latest;
        if later {
            latest = sample.time;
        }
        later
    });
    before - samples.len()
}
