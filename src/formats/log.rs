//! Logs of any format, each read as the pipeline file declares it, and when frames were taken.
//!
//! A record that cannot be used takes only itself along: it is listed with its place and the reason.

mod declared;

use super::InputError;
use super::flight::{
    AngleSystem, AngleUnit, Clock, Column, Declared, FlightLog, North, ReadError, dataflash, geo_txt,
    geoinfo, mrk, opensfm, orientation, rtklib, sbet, tlog, ulog,
};
use crate::config::Located;
use crate::config::georeference::Mount;
use crate::config::height::HeightDatum;
use crate::config::log::columns::{TableLog, YawReference};
use crate::config::log::{
    AngleSystem as DeclaredAngles, AngleUnit as DeclaredUnit, FrameTable, Join, LogFormat, StatedOfFile,
};
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
/// - `crs`: CRS of projected positions, for formats that do not state it.
/// - `heights`: what heights are measured from, for formats that do not state it.
///
/// # Errors
/// [`InputError`]: unreadable, larger than 4 GiB, not of the format, or silent about what only `stated` could tell.
pub fn read_file(
    file: &Path,
    format: LogFormat,
    stated: &StatedOfFile,
    crs: Option<&str>,
    heights: Option<HeightDatum>,
) -> Result<FlightLog, InputError> {
    let bytes = read_bytes(file)?;
    let heights = heights.map(height_kind);
    let columns = stated.column_order.as_ref().map(columns).transpose()?;
    let declared = Declared {
        crs,
        heights,
        angles: stated.angles.map(angles),
        angle_unit: match stated.angle_unit {
            DeclaredUnit::Deg => AngleUnit::Degrees,
            DeclaredUnit::Gon => AngleUnit::Gon,
            DeclaredUnit::Rad => AngleUnit::Radians,
        },
        columns: columns.as_deref(),
    };
    let offset = stated.offset_file.as_ref().map(|file| read_bytes(file)).transpose()?;
    let log = match format {
        LogFormat::Ardupilot => dataflash::read(&bytes),
        LogFormat::Px4 => ulog::read(&bytes),
        LogFormat::Mavlink => tlog::read(&bytes),
        LogFormat::Sbet => sbet::read(&bytes),
        LogFormat::Rtklib => rtklib::read(&bytes, false, heights),
        LogFormat::RtklibEvents => rtklib::read(&bytes, true, heights),
        LogFormat::DjiMrk => mrk::read(&bytes),
        LogFormat::Geoinfo => geoinfo::read(&bytes, &declared),
        LogFormat::OdmGeo => geo_txt::read(&bytes, &declared),
        LogFormat::Orientation => orientation::read(&bytes, &declared, offset.as_deref()),
        LogFormat::Opensfm => return reconstruction(file, &bytes, stated, heights),
        LogFormat::Table | LogFormat::Photos => {
            Err(ReadError::new(format!("is read as \"{}\" elsewhere", format.word())))
        }
    };
    log.map_err(|error| of_file(file, error))
}

fn reconstruction(
    file: &Path,
    bytes: &[u8],
    stated: &StatedOfFile,
    heights: Option<HeightKind>,
) -> Result<FlightLog, InputError> {
    let reference = stated.reference_file.as_ref().map(|file| read_bytes(file)).transpose()?;
    let grid = match &stated.offset_file {
        None => None,
        Some(file) => Some(opensfm::coords_txt(&read_bytes(file)?).map_err(|e| of_file(file, e))?),
    };
    let axes = match &grid {
        None => opensfm::Axes::Topocentric,
        Some((crs, offset)) => opensfm::Axes::Grid { crs, offset: *offset },
    };
    opensfm::read(bytes, axes, reference.as_deref(), heights).map_err(|error| of_file(file, error))
}

/// Declared angles of a file; yaw counts from true north unless `heading` says otherwise.
const fn angles(declared: DeclaredAngles) -> AngleSystem {
    match declared {
        DeclaredAngles::CameraYawPitchRoll => AngleSystem::CameraYawPitchRoll(North::True),
        DeclaredAngles::BodyYawPitchRoll => AngleSystem::BodyYawPitchRoll(North::True),
        DeclaredAngles::OmegaPhiKappa => AngleSystem::OmegaPhiKappa,
        DeclaredAngles::PhiOmegaKappa => AngleSystem::PhiOmegaKappa,
    }
}

/// Declared columns in their order.
fn columns(declared: &Located<Vec<String>>) -> Result<Vec<Column>, InputError> {
    let column = |name: &String| match (name.as_str(), Column::named(name)) {
        ("-", _) => Ok(Column::Unused),
        (_, Column::Unused) => Err(InputError::of_setting(
            declared,
            format!("`column_order` names \"{name}\", which is no column of poses"),
        )
        .help("write \"-\" for a column that is not used")),
        (_, column) => Ok(column),
    };
    declared.iter().map(column).collect()
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
