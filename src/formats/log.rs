//! ADAHRS logs as text tables with declared columns: every value in, SI units and our senses out.
//!
//! A row that cannot be used takes only itself along: it is listed with its line and the reason.

use super::InputError;
use super::table::{Column, Row, Table};
use crate::camera::PixelRotation;
use crate::config::log::{
    AttitudeColumns, FrameTimes, HeightReference, Join, Log, NumberColumn, PositionColumns,
    RotationColumnSpec, RotationMeaning, TimeColumnSpec, TimeFormat, YawColumn, YawReference,
};
use crate::geodesy::{Geodetic, MapPoint, WGS84};
use crate::geometry::{Displacement, Ned, Point};
use crate::units::{Metres, Radians, Seconds};

/// A position as the log states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LoggedPosition {
    /// Latitude and longitude, and a height of some datum.
    Geodetic {
        /// Positive north.
        latitude: Radians,
        /// Positive east.
        longitude: Radians,
        /// Metres above `datum`.
        height_m: f64,
        /// What the height is counted from.
        datum: HeightReference,
    },
    /// Easting and northing in the declared CRS, and a height of some datum.
    Projected {
        /// In the CRS of the log.
        map: MapPoint,
        /// Metres above `datum`.
        height_m: f64,
        /// What the height is counted from.
        datum: HeightReference,
    },
    /// Complete.
    Ecef(Geodetic),
}

/// One row of the log.
#[derive(Debug, Clone, PartialEq)]
pub struct LogRow {
    /// Line in the file, 1-based.
    pub line: u64,
    /// Frame named by the row, with `join = "name"`.
    pub frame: Option<String>,
    /// Seconds on the log's clock.
    pub time: Option<Seconds>,
    /// Position of the antenna.
    pub position: LoggedPosition,
    /// Yaw clockwise from `yaw_reference`, pitch, roll; `None` where the log has no attitude.
    pub attitude: Option<[Radians; 3]>,
    /// The north that yaw is counted from.
    pub yaw_reference: YawReference,
    /// Logged gimbal pan, elevation, roll.
    pub gimbal: [Option<Radians>; 3],
    /// Metres.
    pub height_above_ground_m: Option<f64>,
    /// m/s.
    pub ground_speed_m_s: Option<f64>,
    /// m/s.
    pub velocity: Option<Displacement<Ned>>,
    /// How the stored pixels are turned.
    pub pixel_rotation: Option<PixelRotation>,
}

/// A row that cannot be used.
#[derive(Debug, Clone, PartialEq)]
pub struct BadRow {
    /// Line in the file, 1-based.
    pub line: u64,
    /// Frame it names, if it does.
    pub frame: Option<String>,
    /// Why.
    pub cause: String,
}

/// A log, read.
#[derive(Debug, Clone, PartialEq)]
pub struct LogTable {
    /// Usable rows in the file's order.
    pub rows: Vec<LogRow>,
    /// The others.
    pub bad: Vec<BadRow>,
}

/// When one frame was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTime {
    /// Line in the file, 1-based.
    pub line: u64,
    /// The frame's file name.
    pub frame: String,
    /// Seconds on the log's clock before `clock_offset`, or why there is none.
    pub time: Result<Seconds, String>,
}

/// A column whose factor brings its cells to SI units and our sense.
struct Scaled {
    column: Column,
    factor: f64,
}

impl Scaled {
    fn of(table: &Table, declared: &NumberColumn) -> Result<Self, InputError> {
        Ok(Self { column: table.column(&declared.column)?, factor: declared.factor })
    }
    fn optional(table: &Table, declared: Option<&NumberColumn>) -> Result<Option<Self>, InputError> {
        declared.map(|d| Self::of(table, d)).transpose()
    }
    fn get(&self, row: &Row<'_>) -> Result<f64, String> {
        Ok(row.number(self.column)? * self.factor)
    }
}

enum Position {
    Geodetic(Scaled, Scaled, Scaled, HeightReference),
    Projected(Scaled, Scaled, Scaled, HeightReference),
    Ecef(Scaled, Scaled, Scaled),
}

impl Position {
    fn of(table: &Table, declared: &PositionColumns) -> Result<Self, InputError> {
        let at = |c: &NumberColumn| Scaled::of(table, c);
        Ok(match declared {
            PositionColumns::Geodetic { latitude, longitude, height } => {
                Self::Geodetic(at(latitude)?, at(longitude)?, at(&height.column)?, height.datum)
            }
            PositionColumns::Projected { easting, northing, height, .. } => {
                Self::Projected(at(easting)?, at(northing)?, at(&height.column)?, height.datum)
            }
            PositionColumns::Ecef { x, y, z } => Self::Ecef(at(x)?, at(y)?, at(z)?),
        })
    }

    fn get(&self, row: &Row<'_>) -> Result<LoggedPosition, String> {
        match self {
            Self::Geodetic(latitude, longitude, height, datum) => {
                let (lat, lon) = (Radians::new(latitude.get(row)?), Radians::new(longitude.get(row)?));
                if lat.degrees().abs() > 90.0 {
                    return Err(format!("latitude {}° lies outside ±90°", lat.degrees()));
                }
                if lon.degrees().abs() > 360.0 {
                    return Err(format!("longitude {}° lies outside ±360°", lon.degrees()));
                }
                if lat.get() == 0.0 && lon.get() == 0.0 {
                    return Err(
                        "latitude and longitude are both 0, as receivers write without a fix".to_owned()
                    );
                }
                let height_m = plausible_height(height.get(row)?)?;
                Ok(LoggedPosition::Geodetic {
                    latitude: lat,
                    longitude: lon.wrapped(),
                    height_m,
                    datum: *datum,
                })
            }
            Self::Projected(easting, northing, height, datum) => {
                let map = MapPoint { easting: easting.get(row)?, northing: northing.get(row)? };
                let height_m = plausible_height(height.get(row)?)?;
                Ok(LoggedPosition::Projected { map, height_m, datum: *datum })
            }
            Self::Ecef(x, y, z) => {
                let point = Point::new(x.get(row)?, y.get(row)?, z.get(row)?);
                let radius = point.vector().norm();
                if !(6.3e6..6.5e6).contains(&radius) {
                    return Err(format!("x, y, z lie {:.0} km from the Earth's centre", radius / 1e3));
                }
                Ok(LoggedPosition::Ecef(WGS84.geodetic_from_ecef(&point)))
            }
        }
    }
}

/// Between the Dead Sea's bed and the stratosphere; beyond, the unit or the column is wrong.
fn plausible_height(height_m: f64) -> Result<f64, String> {
    if (-1_000.0..60_000.0).contains(&height_m) {
        Ok(height_m)
    } else {
        Err(format!("height {height_m} m is not one an aircraft flies at"))
    }
}

struct Attitude<'a> {
    yaw: Column,
    yaw_declared: &'a YawColumn,
    pitch: Scaled,
    roll: Scaled,
}

impl<'a> Attitude<'a> {
    fn of(table: &Table, declared: &'a AttitudeColumns) -> Result<Self, InputError> {
        Ok(Self {
            yaw: table.column(&declared.yaw.column.column)?,
            yaw_declared: &declared.yaw,
            pitch: Scaled::of(table, &declared.pitch)?,
            roll: Scaled::of(table, &declared.roll)?,
        })
    }
    fn get(&self, row: &Row<'_>) -> Result<[Radians; 3], String> {
        let yaw = Radians::new(self.yaw_declared.clockwise(row.number(self.yaw)?));
        let pitch = Radians::new(self.pitch.get(row)?);
        let roll = Radians::new(self.roll.get(row)?);
        for (name, angle, limit) in [("yaw", yaw, 720.0), ("pitch", pitch, 180.0), ("roll", roll, 360.0)] {
            if angle.degrees().abs() > limit {
                return Err(format!(
                    "{name} {:.1}° lies outside ±{limit:.0}°: is its unit right?",
                    angle.degrees()
                ));
            }
        }
        Ok([yaw.wrapped(), pitch, roll.wrapped()])
    }
}

/// A column of times.
struct Times {
    column: Column,
    format: TimeFormat,
}

impl Times {
    fn of(table: &Table, declared: &TimeColumnSpec) -> Result<Self, InputError> {
        Ok(Self { column: table.column(&declared.column)?, format: declared.format })
    }
    fn get(&self, row: &Row<'_>) -> Result<Seconds, String> {
        let seconds = match self.format {
            TimeFormat::Iso8601 => {
                let text = row.text(self.column);
                let instant: jiff::Timestamp = text.parse().map_err(|_| {
                    format!("time \"{text}\" is not a date and time with Z or an offset from UTC")
                })?;
                let seconds = instant.as_nanosecond() as f64 * 1e-9;
                // Cameras and receivers without a fix write dates long before there were UAVs.
                if seconds < 315_532_800.0 {
                    return Err(format!("time {text} lies before 1980"));
                }
                seconds
            }
            TimeFormat::UnixSeconds | TimeFormat::Seconds | TimeFormat::GpsSecondsOfWeek => {
                row.number(self.column)?
            }
            TimeFormat::Milliseconds => row.number(self.column)? * 1e-3,
            TimeFormat::Microseconds => row.number(self.column)? * 1e-6,
        };
        if self.format == TimeFormat::GpsSecondsOfWeek && !(0.0..604_800.0).contains(&seconds) {
            return Err(format!("time {seconds} s is no second of a GPS week"));
        }
        Ok(Seconds::new(seconds))
    }
}

fn rotation(row: &Row<'_>, column: Column, meaning: RotationMeaning) -> Result<PixelRotation, String> {
    let text = row.text(column);
    let turns = match (meaning, text) {
        (_, "0") => 0,
        (RotationMeaning::HalfTurns, "1") => 2,
        (RotationMeaning::DegreesClockwise, "90") => 1,
        (RotationMeaning::DegreesClockwise, "180") => 2,
        (RotationMeaning::DegreesClockwise, "270") => 3,
        (RotationMeaning::HalfTurns, _) => {
            return Err(format!("pixel rotation \"{text}\" is neither 0 nor 1"));
        }
        (RotationMeaning::DegreesClockwise, _) => {
            return Err(format!("pixel rotation \"{text}\" is none of 0, 90, 180, 270"));
        }
    };
    Ok(PixelRotation::from_quarter_turns(turns))
}

/// Reads the log.
///
/// # Errors
/// [`InputError`] when the table cannot be read or a declared column is missing. A bad row is no error: it
/// is listed in [`LogTable::bad`].
pub fn read_log(log: &Log) -> Result<LogTable, InputError> {
    let table = Table::read(&log.file, log.delimiter)?;
    let (frame, times) = match &log.join {
        Join::Name { frame, time } => {
            (Some(table.column(frame)?), time.as_ref().map(|t| Times::of(&table, t)).transpose()?)
        }
        Join::Time { time, .. } => (None, Some(Times::of(&table, time)?)),
    };
    let position = Position::of(&table, &log.position)?;
    let attitude = log.attitude.as_ref().map(|a| Attitude::of(&table, a)).transpose()?;
    let gimbal = [
        Scaled::optional(&table, log.gimbal_pan.as_ref())?,
        Scaled::optional(&table, log.gimbal_elevation.as_ref())?,
        Scaled::optional(&table, log.gimbal_roll.as_ref())?,
    ];
    let height_above_ground = Scaled::optional(&table, log.height_above_ground.as_ref())?;
    let ground_speed = Scaled::optional(&table, log.ground_speed.as_ref())?;
    let velocity = match &log.velocity {
        None => None,
        Some(v) => {
            Some([Scaled::of(&table, &v.north)?, Scaled::of(&table, &v.east)?, Scaled::of(&table, &v.down)?])
        }
    };
    let turned = match &log.pixel_rotation {
        None => None,
        Some(RotationColumnSpec { column, meaning }) => Some((table.column(column)?, *meaning)),
    };
    let get = |column: &Option<Scaled>, row: &Row<'_>| column.as_ref().map(|c| c.get(row)).transpose();
    let mut read = LogTable { rows: Vec::new(), bad: Vec::new() };
    for row in table.rows() {
        let name = frame.map(|c| row.text(c).to_owned());
        let values = || -> Result<LogRow, String> {
            if name.as_deref() == Some("") {
                return Err("names no frame".to_owned());
            }
            let mut angles = [None; 3];
            for (angle, column) in angles.iter_mut().zip(&gimbal) {
                *angle = get(column, &row)?.map(|a| Radians::new(a).wrapped());
            }
            Ok(LogRow {
                line: row.line(),
                frame: name.clone(),
                time: times.as_ref().map(|t| t.get(&row)).transpose()?,
                position: position.get(&row)?,
                attitude: attitude.as_ref().map(|a| a.get(&row)).transpose()?,
                yaw_reference: log.attitude.as_ref().map_or(YawReference::TrueNorth, |a| a.yaw.reference()),
                gimbal: angles,
                height_above_ground_m: get(&height_above_ground, &row)?,
                ground_speed_m_s: get(&ground_speed, &row)?,
                velocity: match &velocity {
                    None => None,
                    Some([n, e, d]) => Some(Displacement::new(n.get(&row)?, e.get(&row)?, d.get(&row)?)),
                },
                pixel_rotation: turned.map(|(c, meaning)| rotation(&row, c, meaning)).transpose()?,
            })
        };
        match values() {
            Ok(values) => read.rows.push(values),
            Err(cause) => read.bad.push(BadRow { line: row.line(), frame: name, cause }),
        }
    }
    Ok(read)
}

/// Reads when each frame was taken.
///
/// # Errors
/// As [`read_log`].
pub fn read_frame_times(frames: &FrameTimes) -> Result<Vec<FrameTime>, InputError> {
    let table = Table::read(&frames.file, frames.delimiter)?;
    let name = table.column(&frames.frame)?;
    let times = Times::of(&table, &frames.time)?;
    Ok(table
        .rows()
        .map(|row| FrameTime { line: row.line(), frame: row.text(name).to_owned(), time: times.get(&row) })
        .collect())
}

/// Metres above a stated datum, before the datum is applied.
#[must_use]
pub fn logged_height(position: &LoggedPosition) -> Option<(Metres, HeightReference)> {
    match position {
        LoggedPosition::Geodetic { height_m, datum, .. }
        | LoggedPosition::Projected { height_m, datum, .. } => Some((Metres::new(*height_m), *datum)),
        LoggedPosition::Ecef(_) => None,
    }
}
