//! Which photo belongs to which trigger of the log, when names do not say: two series of times, aligned.
//!
//! The camera's clock has an unknown offset and drift, its times are often whole seconds, triggers misfire, photos are
//! taken by hand, events go missing. Every hypothesis on the clocks (offset, drift, spread of the delays, how often a
//! partner is missing) gives each order-keeping alignment a probability; hypotheses are found by votes over all
//! photo–trigger differences, refined, and summed. A pair is accepted when all of them together give it its level;
//! when a distinctly different alignment is not clearly less likely, nothing is accepted.

mod fit;
mod model;
mod order;
mod resolve;
#[cfg(test)]
mod tests;
mod votes;

pub use order::{OrderMatch, match_by_number, match_in_order};

use crate::units::Seconds;
use std::fmt;

/// When a photo was taken, by the camera's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotoTime {
    /// The recorded time, seconds on any epoch; `None` when the photo has none.
    pub time: Option<Seconds>,
    /// Step of the recorded time: 1 s for EXIF without subseconds.
    pub resolution: Seconds,
}

/// What is known of the camera's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClockPrior {
    /// Nothing.
    Unknown,
    /// `log time = camera time + offset`, give or take `std`.
    Known {
        /// Log less camera.
        offset: Seconds,
        /// One sigma.
        std: Seconds,
    },
    /// Photos and log are on the same clock (GPS time in the photos): the offset is a shutter's delay.
    Same,
    /// This photo belongs to this trigger.
    Anchor {
        /// Index of the photo; it must have a time.
        photo: usize,
        /// Index of the trigger.
        trigger: usize,
    },
}

/// How to match.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOptions {
    /// What is known of the camera's clock.
    pub clock: ClockPrior,
    /// Largest drift of the camera's clock, parts per million. Quartz clocks of cameras lose up to 1 s an hour (280).
    pub drift_limit_ppm: f64,
    /// Probability from which a pair is accepted.
    pub level: f64,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self { clock: ClockPrior::Unknown, drift_limit_ppm: 500.0, level: 0.99 }
    }
}

/// A photo and its trigger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Index of the photo as given.
    pub photo: usize,
    /// Index of the trigger as given.
    pub trigger: usize,
    /// The photo's time on the log's clock, by the fitted clocks; `None` when it has no time.
    pub predicted: Option<Seconds>,
    /// Trigger's time less the predicted one.
    pub residual: Option<Seconds>,
    /// Probability of the pair, all hypotheses together.
    pub probability: f64,
}

/// Why a photo has no trigger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PhotoReason {
    /// It has no time, and its neighbours in the file order leave more than one choice.
    NoTime,
    /// No trigger fits its time: it was taken by hand, or its event is missing.
    NoTrigger {
        /// Residual of the nearest trigger.
        nearest: Seconds,
    },
    /// Several triggers fit.
    Ambiguous {
        /// The likeliest trigger.
        trigger: usize,
        /// Its probability.
        probability: f64,
    },
}

impl fmt::Display for PhotoReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoTime => f.write_str(
                "the photo has no time, and its neighbours do not leave exactly one trigger to it",
            ),
            Self::NoTrigger { nearest } => {
                write!(f, "no trigger fits its time: the nearest is {:+.3} s away", nearest.get())
            }
            Self::Ambiguous { trigger, probability } => write!(
                f,
                "more than one trigger fits its time: trigger {} has a probability of {probability:.3} only",
                trigger + 1
            ),
        }
    }
}

/// Why a trigger has no photo.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TriggerReason {
    /// No photo fits: a misfire, or the photo is not among those given.
    NoPhoto,
    /// A photo fits that other triggers fit as well.
    Ambiguous {
        /// The photo.
        photo: usize,
    },
}

impl fmt::Display for TriggerReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPhoto => f.write_str("no photo fits its time: a misfire, or the photo is missing"),
            Self::Ambiguous { photo } => write!(f, "photo {} fits other triggers as well", photo + 1),
        }
    }
}

/// How the camera writes whole units of its clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recording {
    /// The last whole unit: the photo was taken up to one unit later.
    Truncated,
    /// The nearest whole unit.
    Rounded,
}

/// The camera's clock against the log's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockFit {
    /// `log time = recorded time + resolution/2 + offset + drift·(recorded time + resolution/2 − at)`: the camera's
    /// own offset when it truncates, half a resolution less when it rounds (the two cannot be told apart by times).
    pub offset: Seconds,
    /// One sigma of the offset, conservative for rounded times.
    pub offset_std: Seconds,
    /// Camera time for which the offset is stated.
    pub at: Seconds,
    /// Drift, parts per million: positive when the camera's clock is slow.
    pub drift_ppm: f64,
    /// One sigma of the drift.
    pub drift_std_ppm: f64,
    /// One sigma of the delays between shutter and log beside the rounding of the photo's time.
    pub delay_std: Seconds,
    /// Which way of recording a clock known beforehand implies; `None` when it does not tell.
    pub recording: Option<Recording>,
}

impl ClockFit {
    /// The photo's time on the log's clock: the middle of what its recorded time stands for.
    #[must_use]
    pub fn log_time(&self, photo: &PhotoTime) -> Option<Seconds> {
        let middle = photo.time?.get() + photo.resolution.get() / 2.0;
        let lever = middle - self.at.get();
        Some(Seconds::new(middle + self.offset.get() + self.drift_ppm * 1e-6 * lever))
    }
}

/// The likeliest alignment that is distinctly different from the accepted one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunnerUp {
    /// Its clock offset less the accepted one.
    pub shift: Seconds,
    /// Number of pairs it would make.
    pub pairs: usize,
    /// Natural logarithm of how many times likelier the accepted alignment is.
    pub log_ratio: f64,
}

/// The alignment.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// Accepted pairs, in the photos' order as given.
    pub pairs: Vec<Pair>,
    /// Photos without an accepted trigger, in order.
    pub unmatched_photos: Vec<(usize, PhotoReason)>,
    /// Triggers without an accepted photo, in order.
    pub unmatched_triggers: Vec<(usize, TriggerReason)>,
    /// The clocks.
    pub clock: ClockFit,
    /// Probability of this alignment (with its near variants) against all others found, and against none.
    pub probability: f64,
    /// The best other alignment.
    pub runner_up: Option<RunnerUp>,
    /// True when the spacing of the triggers alone would fit another alignment as well, and only the number of photos
    /// and triggers decided: a photo lost at one end and an event lost at the other would go unnoticed.
    pub rests_on_count: bool,
    /// Photos whose time is earlier than that of a photo before them: their times were believed, not their order.
    pub out_of_order: usize,
}

impl Matching {
    /// Indices of the photos that were refused because several triggers fit.
    pub fn ambiguous(&self) -> impl Iterator<Item = usize> + '_ {
        self.unmatched_photos
            .iter()
            .filter(|(_, reason)| matches!(reason, PhotoReason::Ambiguous { .. }))
            .map(|(photo, _)| *photo)
    }
}

/// Why nothing was matched.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MatchError {
    /// A photo's time or resolution is unusable.
    #[error("photo {}: {cause}", index + 1)]
    Photo {
        /// Index as given.
        index: usize,
        /// What is wrong.
        cause: String,
    },
    /// A trigger's time is unusable.
    #[error("trigger {}: {cause}", index + 1)]
    Trigger {
        /// Index as given.
        index: usize,
        /// What is wrong.
        cause: String,
    },
    /// An option is out of range.
    #[error("{0}")]
    Option(String),
    /// Too few to compare.
    #[error(
        "{photos} photos with a time and {triggers} triggers are too few to find the camera clock's offset: at least {least} of each are needed; declare the offset"
    )]
    TooFew {
        /// Photos with a time.
        photos: usize,
        /// Triggers.
        triggers: usize,
        /// Number needed.
        least: usize,
    },
    /// More than the search is made for.
    #[error("{count} {what} are more than the {most} that can be matched at once")]
    TooMany {
        /// How many there are.
        count: usize,
        /// Of what.
        what: &'static str,
        /// Limit.
        most: usize,
    },
    /// The triggers follow each other much faster than the photos' times can tell apart.
    #[error(
        "photo times in steps of {resolution_s} s cannot tell triggers every {interval_s:.3} s apart: declare the camera clock's offset, or use photos with finer times"
    )]
    TooCoarse {
        /// Step of the photo times.
        resolution_s: f64,
        /// Median time between triggers.
        interval_s: f64,
    },
    /// No alignment pairs more than chance would.
    #[error(
        "the photos' times and the triggers do not belong together: the best alignment pairs {pairs} of the {photos} photos taken during the log ({triggers} triggers)"
    )]
    Unrelated {
        /// Pairs of the best alignment.
        pairs: usize,
        /// Photos with a time within the log's span, by that alignment.
        photos: usize,
        /// Triggers.
        triggers: usize,
    },
    /// Two alignments fit alike.
    #[error(
        "photos and triggers can be paired in more than one way: a camera clock offset of {offset_s:.3} s makes {pairs} pairs with a probability of {probability:.3}, one {shift_s:+.3} s from it makes {other_pairs}; to settle it, declare the camera clock's offset, name one photo with its trigger, or use photos with GPS time"
    )]
    Ambiguous {
        /// Offset of the best alignment.
        offset_s: f64,
        /// Its pairs.
        pairs: usize,
        /// Its probability.
        probability: f64,
        /// Offset of the next one, less the best one's.
        shift_s: f64,
        /// Its pairs.
        other_pairs: usize,
    },
    /// Order alone does not tell.
    #[error("{0}")]
    Order(String),
}

/// Aligns photos (in file order) with the triggers of a log (in time order).
///
/// # Errors
/// [`MatchError`]: values that are no times, with their index; series that do not belong together; and two distinct
/// alignments of which neither is clearly likelier, with what would settle it.
pub fn match_exposures(
    photos: &[PhotoTime],
    triggers: &[Seconds],
    options: &MatchOptions,
) -> Result<Matching, MatchError> {
    resolve::resolve(photos, triggers, options)
}
