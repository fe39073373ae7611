//! Where poses and times come from: the log, and the photos themselves.

use super::join::Times;
use super::poses;
use crate::config::georeference::Georeference;
use crate::config::log::{FrameTimes, LogSource};
use crate::formats::InputError;
use crate::formats::flight::{FlightLog, LoggedPosition};
use crate::formats::log::{read_frame_times, read_table};
use crate::geodesy::{Geodetic, MapProjection, WGS84};
use crate::units::Metres;

/// Reads the log as declared.
pub(super) fn log(declared: &Georeference) -> Result<FlightLog, InputError> {
    match &declared.log.source {
        LogSource::Table(table) => read_table(table, &declared.log.join, &declared.mount),
    }
}

/// A place of the survey: where the first usable position lies, its height as stated.
pub(super) fn near(declared: &Georeference, log: &FlightLog) -> Result<Option<Geodetic>, InputError> {
    let first = log
        .positions
        .first()
        .map(|sample| sample.value)
        .or_else(|| log.exposures.iter().find_map(|exposure| exposure.position));
    Ok(match first {
        None => None,
        Some(LoggedPosition::Geodetic { latitude, longitude, height_m, .. }) => {
            Some(Geodetic { latitude, longitude, height: Metres::new(height_m) })
        }
        Some(LoggedPosition::Ecef(point)) => Some(WGS84.geodetic_from_ecef(&point)),
        Some(LoggedPosition::Projected { map, height_m, .. }) => {
            let crs = poses::position_crs(declared, log)?;
            let at = crs.and_then(|crs| crs.geodetic_from_map(&[map]).ok());
            at.map(|at| at[0].at_height(height_m))
        }
    })
}

/// When each image was taken.
pub(super) fn times(
    frames: &FrameTimes,
    images: &[String],
    notes: &mut Vec<String>,
) -> Result<Times, InputError> {
    match frames {
        FrameTimes::Table(table) => {
            let name = super::base_name(&table.file);
            let (rows, _) = read_frame_times(table)?;
            Ok(Times::of_table(images, rows, &name, notes))
        }
    }
}
