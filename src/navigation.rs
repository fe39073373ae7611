//! The navigation log: records, interpolation to the exposure, and how the camera is mounted.
//!
//! A record is what the ADAHRS knew at one instant, in one set of conventions: WGS 84 position of the
//! antenna, attitude of the UAV as yaw, pitch, roll, optional gimbal angles. Whatever a file said in other
//! senses, units or datums was converted where it was read.

mod heading;
mod matching;
mod mount;
mod track;

pub use heading::{Declination, HeadingError, declination};
pub use matching::{
    ClockFit, ClockPrior, MatchError, MatchOptions, Matching, OrderMatch, Pair, PhotoReason, PhotoTime,
    Recording, RunnerUp, TriggerReason, match_by_number, match_exposures, match_in_order,
};
pub use mount::{GimbalAngles, GimbalReference, Mount};
pub use track::{NavigationRecord, Sample, Track, TrackError, TrackSeries};
