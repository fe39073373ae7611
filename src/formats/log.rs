//! Logs of any format, each read as the pipeline file declares it, and when frames were taken.
//!
//! A record that cannot be used takes only itself along: it is listed with its place and the reason.

mod declared;

use super::InputError;
use super::flight::{Clock, FlightLog, North, ReadError, dataflash, sbet};
use crate::config::georeference::Mount;
use crate::config::height::HeightDatum;
use crate::config::log::columns::{TableLog, YawReference};
use crate::config::log::{AngleSystem, FrameTable, Join, LogFormat};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::units::Seconds;
use std::path::Path;

/// When one frame was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTime {
    /// Line in the file, 1-based.
    pub place: u64,
    /// The frame's file name.
    pub frame: String,
    /// Seconds on the frames' clock, or why there is none.
    pub time: Result<Seconds, String>,
}

/// Reads a table with declared columns. With `join = "time"` its rows are series, otherwise exposures.
///
/// # Errors
/// [`InputError`] when the table cannot be read or a declared column is missing.
pub fn read_table(table: &TableLog, join: &Join, mount: &Mount) -> Result<FlightLog, InputError> {
    declared::read(table, join, mount)
}

/// Reads when each frame was taken from a table; the times count on the second value.
///
/// # Errors
/// As [`read_table`].
pub fn read_frame_times(table: &FrameTable) -> Result<(Vec<FrameTime>, Clock), InputError> {
    Ok((declared::read_times(table)?, declared::clock_of(table.time.format)))
}

/// What a declared height counts from.
#[must_use]
pub const fn height_kind(datum: HeightDatum) -> HeightKind {
    match datum {
        HeightDatum::Ellipsoid => HeightKind::Ellipsoid,
        HeightDatum::Egm96 => HeightKind::SeaLevel(GeoidModel::Egm96),
        HeightDatum::Egm2008 => HeightKind::SeaLevel(GeoidModel::Egm2008),
        HeightDatum::Barometric => HeightKind::Barometric,
        HeightDatum::AboveTakeoff => HeightKind::AboveTakeoff,
        HeightDatum::AboveGround => HeightKind::AboveGround,
    }
}

/// The north that a declared yaw counts from.
#[must_use]
pub const fn north(reference: YawReference) -> North {
    match reference {
        YawReference::TrueNorth => North::True,
        YawReference::MagneticNorth => North::Magnetic,
        YawReference::GridNorth => North::Grid,
        YawReference::Course => North::Course,
    }
}

/// Reads a log whose format says itself what its records are.
///
/// - `angles`: what three angles are, for formats that do not say so themselves.
/// - `crs`: CRS of projected positions, for formats that do not state it.
///
/// # Errors
/// [`InputError`]: unreadable, larger than 4 GiB, or not of the format.
pub fn read_file(
    file: &Path,
    format: LogFormat,
    angles: Option<AngleSystem>,
    crs: Option<&str>,
) -> Result<FlightLog, InputError> {
    let bytes = read_bytes(file)?;
    let log = match format {
        LogFormat::Ardupilot => dataflash::read(&bytes),
        LogFormat::Sbet => sbet::read(&bytes),
        _ => Err(ReadError::new(format!("is no log of format \"{}\"", format.word()))),
    };
    log.map_err(|error| of_file(file, error))
}

/// Logs larger than this are refused before they are read.
const MOST_BYTES: u64 = 4 << 30;

fn read_bytes(file: &Path) -> Result<Vec<u8>, InputError> {
    let unreadable = |e: std::io::Error| InputError::new(file, format!("cannot be read ({e})"));
    let size = std::fs::metadata(file).map_err(unreadable)?.len();
    if size > MOST_BYTES {
        return Err(InputError::new(file, format!("is {size} bytes long, the limit is {MOST_BYTES}")));
    }
    std::fs::read(file).map_err(unreadable)
}

fn of_file(file: &Path, error: ReadError) -> InputError {
    let ReadError { line, cause, help } = error;
    InputError { line, help, ..InputError::new(file, cause) }
}
