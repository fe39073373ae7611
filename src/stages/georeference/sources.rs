//! Where poses and times come from: the log, and the photos themselves.

use super::join::of_table;
use super::poses;
use crate::config::georeference::Georeference;
use crate::config::log::{FrameTimes, Join, LogSource};
use crate::formats::InputError;
use crate::formats::flight::{BadRecord, Clock, Exposure, FlightLog, LoggedPosition, gps_week_second};
use crate::formats::log::{read_file, read_frame_times, read_table};
use crate::formats::metadata::{self, PhotoMetadata};
use crate::geodesy::{Geodetic, MapProjection, WGS84};
use crate::units::{Metres, Seconds};
use rayon::prelude::*;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// What each photo says about itself, in the images' order; words for one that cannot be read.
pub type Photos = Vec<Result<PhotoMetadata, String>>;

/// Reads the metadata of the photos: their headers only.
#[must_use]
pub fn photos(folder: &Path, images: &[String]) -> Photos {
    images
        .par_iter()
        .map(|image| {
            let file = File::open(folder.join(image)).map_err(|e| format!("cannot be read ({e})"))?;
            metadata::read(&mut BufReader::new(file)).map_err(|e| e.cause)
        })
        .collect()
}

/// Whether the run needs what the photos say about themselves.
pub(super) fn needs_photos(declared: &Georeference) -> bool {
    let their_times = matches!(declared.log.join.frames(), Some(FrameTimes::Photos { .. }));
    declared.log.as_table().is_none() || their_times
}

/// Reads the log as declared.
pub(super) fn log(
    declared: &Georeference,
    images: &[String],
    photos: &Photos,
) -> Result<FlightLog, InputError> {
    match &declared.log.source {
        LogSource::Table(table) => read_table(table, &declared.log.join, &declared.mount),
        LogSource::File { file, format, stated } => {
            let crs = declared.log.crs.as_ref().map(|crs| crs.value.as_str());
            let log = read_file(file, *format, stated, crs, declared.log.height_datum);
            // What the declaration is to blame for points there already.
            log.map_err(|e| if e.span.is_some() { e } else { e.caused_by(file) })
        }
        LogSource::Photos => {
            let readable = images.iter().zip(photos);
            let (mut good, mut bad) = (Vec::new(), Vec::new());
            for (image, photo) in readable {
                match photo {
                    Ok(photo) => good.push((image.clone(), photo.clone())),
                    Err(cause) => {
                        bad.push(BadRecord { place: 1, frame: Some(image.clone()), cause: cause.clone() })
                    }
                }
            }
            let mut log = metadata::flight_log(good);
            log.bad.extend(bad);
            Ok(log)
        }
    }
}

/// What the photos say of their own attitude, where the log says nothing of any: DJI's .MRK and tables of positions.
pub(super) fn attitudes_of_photos(
    declared: &Georeference,
    log: &FlightLog,
    photos: &Photos,
) -> Vec<Option<Exposure>> {
    let silent = |exposure: &Exposure| exposure.attitude.is_none() && exposure.gimbal.is_none();
    let is_file = matches!(declared.log.source, LogSource::File { .. });
    if !is_file || !log.attitudes.is_empty() || !log.gimbals.is_empty() || !log.exposures.iter().all(silent) {
        return Vec::new();
    }
    photos
        .iter()
        .map(|photo| photo.as_ref().ok().map(|p| p.exposure.clone()).filter(|exposure| !silent(exposure)))
        .collect()
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
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Clocked {
    /// In the images' order, or why there is none.
    pub of_images: Vec<Result<Seconds, String>>,
    /// What the times count on.
    pub clock: Clock,
    /// The worth of their last digit, seconds.
    pub resolution_s: f64,
    /// One sigma of their distance from the exposure, seconds: 0 for the exposure's own, more for the receiver's last fix;
    /// `None` for a camera's own clock, which may be wrong by anything.
    pub std_s: Option<f64>,
}

/// When each image was taken, by its table or by itself.
pub(super) fn times(
    frames: &FrameTimes,
    images: &[String],
    photos: &Photos,
    notes: &mut Vec<String>,
) -> Result<Clocked, InputError> {
    match frames {
        FrameTimes::Table(table) => {
            let name = super::base_name(&table.file);
            let (rows, clock) = read_frame_times(table)?;
            let of_images = of_table(images, rows, &name, notes);
            let whole = |t: &Seconds| t.get().fract() == 0.0;
            let resolution_s = if of_images.iter().flatten().all(whole) { 1.0 } else { 1e-3 };
            Ok(Clocked { of_images, clock, resolution_s, std_s: None })
        }
        FrameTimes::Photos { utc_offset_s } => {
            let (times, words) = of_photos(photos, utc_offset_s.map(Seconds::new));
            let digits = match times.resolution_s >= 0.5 {
                true => format!(
                    ", whose last digit is worth {} s: at 10 m/s that is {:.0} m along the track",
                    times.resolution_s,
                    10.0 * times.resolution_s
                ),
                false => String::new(),
            };
            notes.push(format!("when the frames were taken is read from {words} of the photos{digits}"));
            Ok(times)
        }
    }
}

/// One of the times that photos state.
type TimeOf<'a> = &'a dyn Fn(&PhotoMetadata) -> Option<(Seconds, f64)>;

/// The finest time that nearly every photo states, and the same one for all: two kinds of time are not one series.
fn of_photos(photos: &Photos, utc_offset: Option<Seconds>) -> (Clocked, &'static str) {
    /// Below this share of the photos, a kind of time is not the set's.
    const NEARLY_ALL: f64 = 0.9;
    let maker = |photo: &PhotoMetadata| photo.times.maker.map(|t| (t.time, t.resolution_s));
    let gps = |photo: &PhotoMetadata| photo.times.gps.map(|t| (t.time, t.resolution_s));
    let civil_utc = |photo: &PhotoMetadata| {
        let civil = photo.times.civil?;
        Some((civil.time - civil.utc_offset.or(utc_offset)?, civil.resolution_s))
    };
    let civil = |photo: &PhotoMetadata| photo.times.civil.map(|t| (t.time, t.resolution_s));
    let fine =
        |time: TimeOf<'_>| photos.iter().flatten().filter_map(time).all(|(_, resolution)| resolution < 0.5);
    let share = |time: TimeOf<'_>| {
        photos.iter().flatten().filter_map(time).count() as f64 / photos.len().max(1) as f64
    };
    let kinds: [(TimeOf<'_>, Clock, Option<f64>, &'static str); 4] = [
        (&maker, Clock::Utc, Some(0.0), "the maker's UTC"),
        // Of the receiver's last fix before the photo, in whole seconds as a rule.
        (&gps, Clock::Utc, Some(1.5), "EXIF GPS time"),
        (&civil_utc, Clock::Utc, None, "EXIF DateTimeOriginal with an offset from UTC"),
        (&civil, Clock::Local, None, "EXIF DateTimeOriginal"),
    ];
    let common = || kinds.iter().filter(|(time, ..)| share(*time) >= NEARLY_ALL);
    let chosen = common().find(|(time, ..)| fine(*time)).or_else(|| common().next()).unwrap_or(&kinds[3]);
    let (time, clock, std_s, words) = *chosen;
    let of_images = photos
        .iter()
        .map(|photo| match photo {
            Err(cause) => Err(cause.clone()),
            Ok(photo) => {
                time(photo).map(|(t, _)| t).ok_or_else(|| format!("the photo does not state {words}"))
            }
        })
        .collect();
    let resolution_s =
        photos.iter().flatten().filter_map(time).map(|(_, r)| r).fold(1e-3, |a: f64, b| a.max(b));
    (Clocked { of_images, clock, resolution_s, std_s }, words)
}

/// Times in UTC brought to the seconds of the GPS week that the log counts in; other times as they are.
pub(super) fn in_gps_week_of(log: &FlightLog, mut times: Clocked) -> Clocked {
    if (log.clock, times.clock) == (Clock::GpsWeek, Clock::Utc) {
        for time in times.of_images.iter_mut().flatten() {
            *time = gps_week_second(*time);
        }
        times.clock = Clock::GpsWeek;
    }
    times
}

/// The images' times on the clock of the log.
///
/// # Errors
/// [`InputError`] when the two clocks cannot be compared.
pub(super) fn on_clock_of(
    log: &FlightLog,
    times: Clocked,
    declared: &Georeference,
) -> Result<Clocked, InputError> {
    let times = in_gps_week_of(log, times);
    let words = |clock: Clock| match clock {
        Clock::Utc => "UTC",
        Clock::GpsWeek => "seconds of a GPS week",
        Clock::Own => "a clock of its own",
        Clock::Local => "the camera's clock, in a zone not stated",
    };
    match (log.clock, times.clock) {
        (a, b) if a == b => Ok(times),
        (log_clock, frame_clock) => {
            let offset_declared = matches!(declared.log.join, Join::Time { offset_stated: true, .. });
            // Whoever states the offset between two clocks says that they can be compared.
            if offset_declared {
                return Ok(times);
            }
            let error = InputError::of_setting(
                &declared.log.table,
                format!(
                    "the frames' times count on {}, the log's on {}",
                    words(frame_clock),
                    words(log_clock)
                ),
            );
            Err(match frame_clock {
                Clock::Local => error.help(
                    "state the zone of the camera's clock: [georeference.frames] utc_offset = \"... h\"",
                ),
                _ => error.help(
                    "align the two with `join = \"match\"`, or state `clock_offset` in [georeference.log]",
                ),
            })
        }
    }
}
