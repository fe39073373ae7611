//! `join = "match"`: the log's exposures and the photos' times, two series of the same events.

use super::join::{Poses, antennas, with_own};
use super::poses::{Conventions, SeriesAttitude};
use super::sources::Clocked;
use crate::config::log::StatedClock;
use crate::formats::InputError;
use crate::formats::flight::{Clock, Exposure, FlightLog};
use crate::navigation::{
    ClockFit, ClockPrior, MatchError, MatchOptions, Matching, OrderMatch, PhotoTime, Track, match_by_number,
    match_exposures, match_in_order,
};
use crate::report::match_figure::match_residuals;
use crate::report::{Figure, FigureError};
use crate::units::Seconds;

/// How photos and exposures were paired: one row for each photo and each exposure without one.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchReport {
    /// Rows: the photos in order, then the exposures that no photo fits.
    pub rows: Vec<MatchRow>,
    /// The camera's clock against the log's, where times decided.
    pub clock: Option<ClockFit>,
    /// Whether only the number of photos and exposures decided: a photo lost at one end and an event lost at the other would
    /// go unnoticed.
    pub rests_on_count: bool,
    /// What the user should know, in sentences.
    pub notes: Vec<String>,
}

impl MatchReport {
    /// The residuals over the flight; `None` where order or numbers decided.
    ///
    /// # Errors
    /// The picture cannot be drawn.
    pub fn figure(&self) -> Result<Option<Figure>, FigureError> {
        let pairs: Vec<(f64, f64)> =
            self.rows.iter().filter_map(|row| Some((row.exposure_time_s?, row.residual_s?))).collect();
        let lonely: Vec<f64> = self
            .rows
            .iter()
            .filter(|row| row.frame.is_empty())
            .filter_map(|row| row.exposure_time_s)
            .collect();
        if pairs.is_empty() { Ok(None) } else { match_residuals(&pairs, &lonely).map(Some) }
    }
}

/// A photo, an exposure, or both.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MatchRow {
    /// The photo's file name; empty for an exposure without a photo.
    pub frame: String,
    /// The photo's time as it states it.
    pub photo_time_s: Option<f64>,
    /// Record of the exposure in the log.
    pub record: Option<u64>,
    /// The exposure's own number.
    pub sequence: Option<u64>,
    /// The exposure's time on the log's clock.
    pub exposure_time_s: Option<f64>,
    /// Exposure's time less the photo's, brought to the log's clock.
    pub residual_s: Option<f64>,
    /// Probability of the pair.
    pub probability: Option<f64>,
    /// Empty for a pair; otherwise why there is none.
    pub reason: String,
}

/// A pair: photo, exposure, and residual and probability where times decided.
struct Paired {
    photo: usize,
    exposure: usize,
    residual: Option<Seconds>,
    probability: Option<f64>,
}

/// What was found, by times, numbers or order.
struct Found {
    pairs: Vec<Paired>,
    photos: Vec<(usize, String)>,
    exposures: Vec<(usize, String)>,
    clock: Option<ClockFit>,
    rests_on_count: bool,
    notes: Vec<String>,
}

/// The pose of each image, at the exposure that its time belongs to.
///
/// - `own`: what each photo says of its own attitude, where the log says nothing of any; may be empty.
/// - `clock`: what the pipeline file states about the two clocks.
///
/// # Errors
/// [`InputError`] when nothing can be matched: too few, ambiguous, or no times.
pub(super) fn by_matching(
    images: &[String],
    times: &Clocked,
    log: &FlightLog,
    clock: &StatedClock,
    (track, max_gap): (Option<&(Track, SeriesAttitude)>, Seconds),
    own: &[Option<Exposure>],
    conventions: &Conventions<'_>,
) -> Result<(Poses, MatchReport), InputError> {
    let found = find(images, times, (log, conventions.numbers_name_photos()), clock)
        .map_err(|refusal| refusal.of_log(conventions))?;
    let antennas = antennas(&log.exposures, conventions)?;
    let mut poses: Poses = vec![Err("no exposure of the log was matched with it".to_owned()); images.len()];
    for (photo, reason) in &found.photos {
        poses[*photo] = Err(reason.clone());
    }
    for pair in &found.pairs {
        let exposure = &log.exposures[pair.exposure];
        let how = match pair.residual {
            Some(residual) => format!(
                "matched by time with record {} of the log, residual {:+.3} s",
                exposure.place,
                residual.get()
            ),
            None => format!("matched with record {} of the log", exposure.place),
        };
        poses[pair.photo] = antennas[pair.exposure]
            .clone()
            .and_then(|antenna| {
                let photo = own.get(pair.photo).and_then(Option::as_ref);
                conventions.pose(&with_own(exposure, photo), antenna, track, max_gap, how)
            })
            .map_err(|cause| format!("record {} of the log: {cause}", exposure.place));
    }
    Ok((poses, report(images, times, log, found)))
}

fn find(
    images: &[String],
    times: &Clocked,
    (log, numbers_name_photos): (&FlightLog, bool),
    stated: &StatedClock,
) -> Result<Found, Refusal> {
    let photos: Vec<PhotoTime> = times
        .of_images
        .iter()
        .map(|time| PhotoTime {
            time: time.as_ref().ok().copied(),
            resolution: Seconds::new(times.resolution_s),
        })
        .collect();
    if log.exposures.is_empty() {
        return Err(Refusal::NoExposures);
    }
    if numbers_name_photos
        && *stated == StatedClock::Unknown
        && let Some(found) = by_number(images, &photos, log)?
    {
        return Ok(found);
    }
    let timed: Vec<usize> = (0..log.exposures.len()).filter(|k| log.exposures[*k].time.is_some()).collect();
    let any_photo_time = photos.iter().any(|photo| photo.time.is_some());
    if timed.is_empty() || !any_photo_time {
        return without_times(images, log);
    }
    let triggers: Vec<Seconds> = timed.iter().filter_map(|k| log.exposures[*k].time).collect();
    let clock = clock_prior(images, times, log, &timed, stated)?;
    let matching = match_exposures(&photos, &triggers, &MatchOptions { clock, ..MatchOptions::default() })?;
    Ok(of_times(matching, &timed))
}

/// What is known of the two clocks: as stated, or by what the photos' times are.
fn clock_prior(
    images: &[String],
    times: &Clocked,
    log: &FlightLog,
    timed: &[usize],
    stated: &StatedClock,
) -> Result<ClockPrior, Refusal> {
    match stated {
        StatedClock::Offset { offset_s, std_s } => {
            Ok(ClockPrior::Known { offset: Seconds::new(*offset_s), std: Seconds::new(*std_s) })
        }
        StatedClock::Anchor(anchor) => {
            let refused = |cause: String| Refusal::Setting(InputError::of_setting(anchor, cause));
            let photo = images.iter().position(|image| *image == anchor.frame).ok_or_else(|| {
                refused(format!(
                    "`anchor` names \"{}\", and no image of the folder has that name",
                    anchor.frame
                ))
            })?;
            let trigger =
                timed.iter().position(|k| log.exposures[*k].place == anchor.record).ok_or_else(|| {
                    refused(format!(
                        "`anchor` names record {}, which is no exposure with a time in the log",
                        anchor.record
                    ))
                })?;
            Ok(ClockPrior::Anchor { photo, trigger })
        }
        StatedClock::Unknown => Ok(match times.std_s {
            Some(std_s) if log.clock == times.clock && matches!(log.clock, Clock::Utc | Clock::GpsWeek) => {
                if std_s == 0.0 {
                    ClockPrior::Same
                } else {
                    ClockPrior::Known { offset: Seconds::new(0.0), std: Seconds::new(std_s) }
                }
            }
            _ => ClockPrior::Unknown,
        }),
    }
}

/// Why nothing was matched.
enum Refusal {
    /// The log holds none.
    NoExposures,
    /// The numbers of photos and exposures do not belong together.
    Numbers(MatchError),
    /// The numbers of photos and exposures and their times contradict each other.
    NumbersAndTimes {
        /// How far the times of equal numbers spread, seconds.
        spread_s: f64,
    },
    /// The series themselves.
    Match(MatchError),
    /// A setting.
    Setting(InputError),
}

impl From<MatchError> for Refusal {
    fn from(error: MatchError) -> Self {
        Self::Match(error)
    }
}

impl Refusal {
    fn of_log(self, conventions: &Conventions<'_>) -> InputError {
        match self {
            Self::Setting(error) => error,
            Self::NoExposures => conventions
                .of_log("holds no exposures (camera triggers) to match the photos with".to_owned())
                .help("interpolate at the photos' times: `join = \"time\"` in [georeference.log]"),
            Self::Numbers(error) => conventions
                .of_log(format!(
                    "its exposures are numbered like the photos' names, but not with the same numbers: {error}"
                ))
                .help("name one photo and its record: `anchor = { frame = \"...\", record = ... }` in [georeference.log]; the times then decide"),
            Self::NumbersAndTimes { spread_s } => conventions
                .of_log(format!(
                    "its exposures carry the numbers of the photos' names, and their times contradict that: from photo to \
                     photo the two clocks differ by up to {spread_s:.1} s"
                ))
                .help("are these the photos of this log? otherwise state how the clocks stand to each other: `clock_offset` in [georeference.log]"),
            Self::Match(error) => {
                let help = match &error {
                    MatchError::Ambiguous { offset_s, .. } => format!(
                        "if the likelier one is right, add `clock_offset = \"{offset_s:.1} s\"` to [georeference.log]; or name one photo and its record: `anchor = {{ frame = \"...\", record = ... }}`"
                    ),
                    _ => "state how the clocks stand to each other: `clock_offset`, or `anchor = { frame = \"...\", record = ... }` in [georeference.log]".to_owned(),
                };
                conventions.of_log(error.to_string()).help(help)
            }
        }
    }
}

fn of_times(matching: Matching, timed: &[usize]) -> Found {
    let mut notes = vec![format!(
        "{} photos were matched with the log's {} exposures by time: the camera's clock is {:+.3} ± {:.3} s off the \
         log's and drifts by {:+.0} ± {:.0} ppm; {} photos and {} exposures have no partner",
        matching.pairs.len(),
        timed.len(),
        -matching.clock.offset.get(),
        matching.clock.offset_std.get(),
        -matching.clock.drift_ppm,
        matching.clock.drift_std_ppm,
        matching.unmatched_photos.len(),
        matching.unmatched_triggers.len()
    )];
    if matching.rests_on_count {
        notes.push(
            "the exposures are so evenly spaced that only their number decides which photo belongs to which: a photo \
             lost at one end and an event lost at the other would go unnoticed; state `clock_offset` to be sure"
                .to_owned(),
        );
    }
    if matching.out_of_order > 0 {
        notes.push(format!(
            "{} photos are earlier than the photo before them by name; their times were believed",
            matching.out_of_order
        ));
    }
    Found {
        pairs: matching
            .pairs
            .iter()
            .map(|pair| Paired {
                photo: pair.photo,
                exposure: timed[pair.trigger],
                residual: pair.residual,
                probability: Some(pair.probability),
            })
            .collect(),
        photos: matching.unmatched_photos.iter().map(|(k, reason)| (*k, reason.to_string())).collect(),
        exposures: matching
            .unmatched_triggers
            .iter()
            .map(|(k, reason)| (timed[*k], reason.to_string()))
            .collect(),
        clock: Some(matching.clock),
        rests_on_count: matching.rests_on_count,
        notes,
    }
}

/// By numbers that name the photos (DJI's .MRK), where photos and exposures all have one and their times do not speak
/// against it.
fn by_number(images: &[String], photos: &[PhotoTime], log: &FlightLog) -> Result<Option<Found>, Refusal> {
    /// Shutter delays, and what a camera's clock loses within a flight.
    const TOLERATED_S: f64 = 2.0;
    let numbers: Vec<Option<u64>> = images.iter().map(|name| number_in(name)).collect();
    let sequence: Vec<Option<u64>> = log.exposures.iter().map(|exposure| exposure.sequence).collect();
    if !numbers.iter().chain(&sequence).all(Option::is_some) {
        return Ok(None);
    }
    let matched = match match_by_number(&numbers, &sequence) {
        Ok(matched) => matched,
        // Other numbers altogether name other things; some of them the same leave two readings open.
        Err(_) if numbers.iter().all(|number| !sequence.contains(number)) => return Ok(None),
        Err(error) => return Err(Refusal::Numbers(error)),
    };
    let apart =
        |(photo, exposure): &(usize, usize)| Some(log.exposures[*exposure].time? - photos[*photo].time?);
    let mut offsets: Vec<f64> = matched.pairs.iter().filter_map(apart).map(Seconds::get).collect();
    offsets.sort_by(f64::total_cmp);
    let middle = offsets.get(offsets.len() / 2).copied().unwrap_or(0.0);
    let resolution = photos.iter().map(|photo| photo.resolution.get()).fold(0.0, f64::max);
    let spread_s = offsets.iter().map(|offset| (offset - middle).abs()).fold(0.0, f64::max);
    if spread_s > TOLERATED_S + resolution {
        return Err(Refusal::NumbersAndTimes { spread_s });
    }
    let mut found = numbered(matched);
    for pair in &mut found.pairs {
        pair.residual = apart(&(pair.photo, pair.exposure)).map(|offset| offset - Seconds::new(middle));
    }
    if !offsets.is_empty() {
        found.notes.push(format!(
            "the times of photos and exposures agree with that: beside a constant offset of {middle:+.1} s they differ by \
             {spread_s:.1} s at most"
        ));
    }
    Ok(Some(found))
}

/// By the numbers that photos and exposures carry, or by their order.
fn without_times(images: &[String], log: &FlightLog) -> Result<Found, Refusal> {
    let numbers: Vec<Option<u64>> = images.iter().map(|name| number_in(name)).collect();
    let sequence: Vec<Option<u64>> = log.exposures.iter().map(|exposure| exposure.sequence).collect();
    let all_numbered = numbers.iter().all(Option::is_some) && sequence.iter().all(Option::is_some);
    let matched = match all_numbered {
        true => match_by_number(&numbers, &sequence)?,
        false => match_in_order(images.len(), log.exposures.len())?,
    };
    Ok(numbered(matched))
}

fn numbered(matched: OrderMatch) -> Found {
    Found {
        pairs: matched
            .pairs
            .iter()
            .map(|(photo, exposure)| Paired {
                photo: *photo,
                exposure: *exposure,
                residual: None,
                probability: None,
            })
            .collect(),
        photos: matched
            .unmatched_photos
            .iter()
            .map(|k| (*k, "no exposure of the log has its number".to_owned()))
            .collect(),
        exposures: matched
            .unmatched_triggers
            .iter()
            .map(|k| (*k, "no photo has its number".to_owned()))
            .collect(),
        clock: None,
        rests_on_count: false,
        notes: vec![matched.assumed],
    }
}

/// The last group of digits in a file's name: 17 in `DJI_20240501_0017_V.JPG`.
fn number_in(name: &str) -> Option<u64> {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |k| {
        // The sign before the digits may take several bytes.
        k + stem[k..].chars().next().map_or(1, char::len_utf8)
    });
    stem[start..end].parse().ok()
}

fn report(images: &[String], times: &Clocked, log: &FlightLog, found: Found) -> MatchReport {
    let photo_row = |photo: usize| MatchRow {
        frame: images[photo].clone(),
        photo_time_s: times.of_images[photo].as_ref().ok().map(|time| time.get()),
        record: None,
        sequence: None,
        exposure_time_s: None,
        residual_s: None,
        probability: None,
        reason: String::new(),
    };
    let mut of_photo: Vec<MatchRow> = (0..images.len()).map(photo_row).collect();
    for (photo, reason) in found.photos {
        of_photo[photo].reason = reason;
    }
    for pair in &found.pairs {
        let exposure = &log.exposures[pair.exposure];
        let row = &mut of_photo[pair.photo];
        row.record = Some(exposure.place);
        row.sequence = exposure.sequence;
        row.exposure_time_s = exposure.time.map(Seconds::get);
        row.residual_s = pair.residual.map(|residual| (residual.get() * 1e4).round() / 1e4);
        row.probability = pair.probability.map(|probability| (probability * 1e6).round() / 1e6);
    }
    of_photo.extend(found.exposures.into_iter().map(|(k, reason)| {
        let exposure = &log.exposures[k];
        MatchRow {
            frame: String::new(),
            photo_time_s: None,
            record: Some(exposure.place),
            sequence: exposure.sequence,
            exposure_time_s: exposure.time.map(Seconds::get),
            residual_s: None,
            probability: None,
            reason,
        }
    }));
    MatchReport {
        rows: of_photo,
        clock: found.clock,
        rests_on_count: found.rests_on_count,
        notes: found.notes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly spaced exposures: times alone would leave every shift open, or take the wrong one.
    #[test]
    fn numbers_that_name_the_photos_decide_and_times_may_only_object() {
        let mut log = FlightLog::new(Clock::Utc);
        log.exposures = (17..=34)
            .map(|number| Exposure {
                sequence: Some(number),
                time: Some(Seconds::new(1e9 + 2.0 * number as f64)),
                ..Exposure::at(number)
            })
            .collect();
        let images: Vec<String> = (18..=35).map(|number| format!("DJI_{number:04}.JPG")).collect();
        let photo = |number: u64, late: f64| PhotoTime {
            time: Some(Seconds::new(1e9 - 3600.0 + 2.0 * number as f64 + late)),
            resolution: Seconds::new(1.0),
        };
        let photos: Vec<PhotoTime> = (18..=35).map(|number| photo(number, 0.3)).collect();
        // As many of one as of the other with other numbers: a counter that starts elsewhere, or one lost at each end?
        assert!(matches!(by_number(&images, &photos, &log), Err(Refusal::Numbers(_))));
        let elsewhere: Vec<String> = (500..518).map(|number| format!("IMG_{number}.JPG")).collect();
        assert!(matches!(by_number(&elsewhere, &photos, &log), Ok(None)));
        let found = by_number(&images[..17], &photos[..17], &log).ok().flatten().unwrap();
        assert_eq!(found.pairs.len(), 17);
        assert!(found.pairs.iter().all(|pair| pair.exposure == pair.photo + 1));
        assert!(found.pairs.iter().all(|pair| pair.residual.unwrap().get().abs() < 1e-6));
        assert_eq!(found.exposures, [(0, "no photo has its number".to_owned())]);
        let strange: Vec<PhotoTime> =
            (18..35).map(|number| photo(number, 9.0 * (number % 3) as f64)).collect();
        assert!(matches!(
            by_number(&images[..17], &strange, &log),
            Err(Refusal::NumbersAndTimes { spread_s }) if spread_s > 8.0
        ));
    }

    #[test]
    fn numbers_of_photos_are_the_last_digits_of_the_name() {
        for (name, number) in [
            ("DJI_20240501120000_0017_V.JPG", Some(17)),
            ("100_0042_0007.jpg", Some(7)),
            ("é9.png", Some(9)),
            ("IMG.tif", None),
            ("99999999999999999999999.jpg", None),
        ] {
            assert_eq!(number_in(name), number, "{name}");
        }
    }
}
