//! Text tables with declared columns.

use super::super::InputError;
use super::super::flight::{
    BadRecord, Clock, Exposure, FlightLog, LoggedAttitude, LoggedGimbal, LoggedPosition, North, Origin,
    Sample, geodetic, plausible_angles, plausible_height, plausible_speed,
};
use super::super::table::{Column, Row, Table};
use super::{height_kind, north};
use crate::camera::PixelRotation;
use crate::config::georeference::{GimbalAngle, GimbalReference as DeclaredReference, Mount};
use crate::config::log::columns::{
    AttitudeColumns, HeightColumn, NumberColumn, PositionColumns, RotationColumnSpec, RotationMeaning,
    TableLog, TimeColumnSpec, TimeFormat, YawColumn,
};
use crate::config::log::{FrameTable, Join};
use crate::geodesy::{HeightKind, MapPoint};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Ned, Point};
use crate::navigation::{GimbalAngles, GimbalReference};
use crate::units::{Radians, Seconds};
use std::sync::Arc;

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
    Geodetic(Scaled, Scaled, Scaled, HeightKind),
    Projected(Scaled, Scaled, Scaled, HeightKind),
    Ecef(Scaled, Scaled, Scaled),
}

impl Position {
    fn of(table: &Table, declared: &PositionColumns) -> Result<Self, InputError> {
        let at = |c: &NumberColumn| Scaled::of(table, c);
        let height = |h: &HeightColumn| Ok::<_, InputError>((at(&h.column)?, height_kind(h.datum)));
        Ok(match declared {
            PositionColumns::Geodetic { latitude, longitude, height: h } => {
                let (h, kind) = height(h)?;
                Self::Geodetic(at(latitude)?, at(longitude)?, h, kind)
            }
            PositionColumns::Projected { easting, northing, height: h, .. } => {
                let (h, kind) = height(h)?;
                Self::Projected(at(easting)?, at(northing)?, h, kind)
            }
            PositionColumns::Ecef { x, y, z } => Self::Ecef(at(x)?, at(y)?, at(z)?),
        })
    }

    fn get(&self, row: &Row<'_>) -> Result<LoggedPosition, String> {
        match self {
            Self::Geodetic(latitude, longitude, height, kind) => geodetic(
                Radians::new(latitude.get(row)?),
                Radians::new(longitude.get(row)?),
                height.get(row)?,
                *kind,
            ),
            Self::Projected(easting, northing, height, kind) => {
                let map = MapPoint { easting: easting.get(row)?, northing: northing.get(row)? };
                let height_m = plausible_height(height.get(row)?)?;
                Ok(LoggedPosition::Projected { map, height_m, kind: *kind })
            }
            Self::Ecef(x, y, z) => {
                let point = Point::new(x.get(row)?, y.get(row)?, z.get(row)?);
                let radius = point.vector().norm();
                if !(6.3e6..6.5e6).contains(&radius) {
                    return Err(format!("x, y, z lie {:.0} km from the Earth's centre", radius / 1e3));
                }
                Ok(LoggedPosition::Ecef(point))
            }
        }
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
    fn get(&self, row: &Row<'_>) -> Result<LoggedAttitude, String> {
        let yaw = Radians::new(self.yaw_declared.clockwise(row.number(self.yaw)?));
        let angles =
            YawPitchRoll::new(yaw, Radians::new(self.pitch.get(row)?), Radians::new(self.roll.get(row)?));
        let north = north(self.yaw_declared.reference());
        Ok(LoggedAttitude::Body { angles: plausible_angles(angles)?, north })
    }
}

/// Gimbal angles: each a column, or fixed by the mount.
struct Gimbal {
    angles: [Result<f64, Scaled>; 3],
    reference: GimbalReference,
}

impl Gimbal {
    fn of(table: &Table, declared: &TableLog, mount: &Mount) -> Result<Option<Self>, InputError> {
        if !declared.has_gimbal() {
            return Ok(None);
        }
        let angle = |column: &Option<NumberColumn>, fixed: GimbalAngle| {
            Ok(match (column, fixed) {
                (Some(column), _) => Err(Scaled::of(table, column)?),
                (None, GimbalAngle::Fixed(radians)) => Ok(radians),
                (None, GimbalAngle::Logged) => Ok(0.0),
            })
        };
        Ok(Some(Self {
            angles: [
                angle(&declared.gimbal_pan, mount.pan)?,
                angle(&declared.gimbal_elevation, mount.elevation)?,
                angle(&declared.gimbal_roll, mount.roll)?,
            ],
            reference: match mount.gimbal_reference {
                DeclaredReference::Body => GimbalReference::Body,
                DeclaredReference::Nav => GimbalReference::Nav,
            },
        }))
    }

    fn get(&self, row: &Row<'_>) -> Result<LoggedGimbal, String> {
        let angle = |angle: &Result<f64, Scaled>| {
            Ok::<_, String>(match angle {
                Ok(fixed) => Radians::new(*fixed),
                Err(column) => Radians::new(column.get(row)?).wrapped(),
            })
        };
        let [pan, elevation, roll] = &self.angles;
        Ok(LoggedGimbal {
            angles: GimbalAngles { pan: angle(pan)?, elevation: angle(elevation)?, roll: angle(roll)? },
            reference: self.reference,
        })
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

/// Reads a table. With `join = "time"` its rows are series, otherwise exposures.
///
/// # Errors
/// [`InputError`] when the table cannot be read or a declared column is missing. A bad row is no error: it
/// is listed in [`FlightLog::bad`].
pub(super) fn read(declared: &TableLog, join: &Join, mount: &Mount) -> Result<FlightLog, InputError> {
    let table = Table::read(&declared.file, declared.delimiter)?;
    let columns = Columns::of(&table, declared, mount)?;
    let clock = declared.time.as_ref().map_or(Clock::Own, |time| clock_of(time.format));
    let mut log = FlightLog::new(clock);
    log.origins = origins(declared);
    let origins: Arc<[Origin]> = log.origins.as_slice().into();
    for row in table.rows() {
        let frame = columns.frame.map(|c| row.text(c).to_owned());
        match columns.exposure(&row, frame.clone(), origins.clone()) {
            Ok(exposure) if matches!(join, Join::Time { .. }) => sample(&mut log, &exposure),
            Ok(exposure) => log.exposures.push(exposure),
            Err(cause) => log.bad.push(BadRecord { place: row.line(), frame, cause }),
        }
    }
    Ok(log)
}

/// The clock that a format of times counts on.
pub(super) const fn clock_of(format: TimeFormat) -> Clock {
    match format {
        TimeFormat::Iso8601 | TimeFormat::UnixSeconds => Clock::Utc,
        TimeFormat::Seconds | TimeFormat::Milliseconds | TimeFormat::Microseconds => Clock::Own,
        TimeFormat::GpsSecondsOfWeek => Clock::GpsWeek,
    }
}

/// A row of a series: each of its values joins the series it belongs to.
fn sample(log: &mut FlightLog, row: &Exposure) {
    let Some(time) = row.time else { return };
    fn push<T>(series: &mut Vec<Sample<T>>, place: u64, time: Seconds, value: Option<T>) {
        series.extend(value.map(|value| Sample { place, time, value }));
    }
    push(&mut log.positions, row.place, time, row.position);
    push(&mut log.attitudes, row.place, time, row.attitude);
    push(&mut log.gimbals, row.place, time, row.gimbal);
    push(&mut log.velocities, row.place, time, row.velocity);
    push(&mut log.heights_above_ground, row.place, time, row.height_above_ground_m);
}

/// The declared columns, found in the table.
struct Columns<'a> {
    frame: Option<Column>,
    time: Option<Times>,
    position: Position,
    attitude: Option<Attitude<'a>>,
    gimbal: Option<Gimbal>,
    height_above_ground: Option<Scaled>,
    ground_speed: Option<Scaled>,
    velocity: Option<[Scaled; 3]>,
    turned: Option<(Column, RotationMeaning)>,
}

impl<'a> Columns<'a> {
    fn of(table: &Table, declared: &'a TableLog, mount: &Mount) -> Result<Self, InputError> {
        Ok(Self {
            frame: declared.frame.as_ref().map(|frame| table.column(frame)).transpose()?,
            time: declared.time.as_ref().map(|time| Times::of(table, time)).transpose()?,
            position: Position::of(table, &declared.position)?,
            attitude: declared.attitude.as_ref().map(|a| Attitude::of(table, a)).transpose()?,
            gimbal: Gimbal::of(table, declared, mount)?,
            height_above_ground: Scaled::optional(table, declared.height_above_ground.as_ref())?,
            ground_speed: Scaled::optional(table, declared.ground_speed.as_ref())?,
            velocity: match &declared.velocity {
                None => None,
                Some(v) => Some([
                    Scaled::of(table, &v.north)?,
                    Scaled::of(table, &v.east)?,
                    Scaled::of(table, &v.down)?,
                ]),
            },
            turned: match &declared.pixel_rotation {
                None => None,
                Some(RotationColumnSpec { column, meaning }) => Some((table.column(column)?, *meaning)),
            },
        })
    }

    fn exposure(
        &self,
        row: &Row<'_>,
        frame: Option<String>,
        origins: Arc<[Origin]>,
    ) -> Result<Exposure, String> {
        if frame.as_deref() == Some("") {
            return Err("names no frame".to_owned());
        }
        let get = |column: &Option<Scaled>| column.as_ref().map(|c| c.get(row)).transpose();
        let velocity = match &self.velocity {
            None => None,
            Some([n, e, d]) => Some(Displacement::<Ned>::new(n.get(row)?, e.get(row)?, d.get(row)?)),
        };
        Ok(Exposure {
            frame,
            time: self.time.as_ref().map(|t| t.get(row)).transpose()?,
            position: Some(self.position.get(row)?),
            attitude: self.attitude.as_ref().map(|a| a.get(row)).transpose()?,
            gimbal: self.gimbal.as_ref().map(|g| g.get(row)).transpose()?,
            height_above_ground_m: get(&self.height_above_ground)?,
            ground_speed_m_s: get(&self.ground_speed)?.map(plausible_speed).transpose()?,
            velocity,
            pixel_rotation: self.turned.map(|(c, meaning)| rotation(row, c, meaning)).transpose()?,
            origins,
            ..Exposure::at(row.line())
        })
    }
}

/// Which column each number comes from.
fn origins(declared: &TableLog) -> Vec<Origin> {
    let mut origins = Vec::new();
    let mut add = |quantity: &'static str, column: &str, meaning: String| {
        origins.push(Origin { quantity, from: format!("column {column}"), meaning });
    };
    let height = |h: &HeightColumn| h.datum.words().to_owned();
    match &declared.position {
        PositionColumns::Geodetic { latitude, longitude, height: h } => {
            add("latitude", &latitude.column, "WGS 84, positive north".to_owned());
            add("longitude", &longitude.column, "WGS 84, positive east".to_owned());
            add("height", &h.column.column, height(h));
        }
        PositionColumns::Projected { easting, northing, crs, height: h } => {
            add("easting", &easting.column, crs.value.clone());
            add("northing", &northing.column, crs.value.clone());
            add("height", &h.column.column, height(h));
        }
        PositionColumns::Ecef { x, y, z } => {
            for (name, column) in [("x", x), ("y", y), ("z", z)] {
                add(name, &column.column, "Earth-centred, WGS 84".to_owned());
            }
        }
    }
    if let Some(AttitudeColumns { yaw, pitch, roll }) = &declared.attitude {
        let sense = match north(yaw.reference()) {
            North::True => "of the nose, from true north",
            North::Magnetic => "of the nose, from magnetic north: the declination is added",
            North::Grid => "of the nose, from grid north: the convergence is added",
            North::Course => "the course over ground, used as if the nose pointed along it",
        };
        add("yaw", &yaw.column.column, sense.to_owned());
        add("pitch", &pitch.column, "of the UAV, nose up".to_owned());
        add("roll", &roll.column, "of the UAV, right wing down".to_owned());
    }
    for (name, column) in [
        ("gimbal pan", &declared.gimbal_pan),
        ("gimbal elevation", &declared.gimbal_elevation),
        ("gimbal roll", &declared.gimbal_roll),
    ] {
        if let Some(column) = column {
            add(name, &column.column, "as the mount's gimbal_reference counts it".to_owned());
        }
    }
    if let Some(speed) = &declared.ground_speed {
        add("ground speed", &speed.column, "over ground".to_owned());
    }
    if let Some(velocity) = &declared.velocity {
        for (name, column) in [
            ("velocity north", &velocity.north),
            ("velocity east", &velocity.east),
            ("velocity down", &velocity.down),
        ] {
            add(name, &column.column, "of the antenna over ground".to_owned());
        }
    }
    origins
}

/// Reads when each frame was taken.
///
/// # Errors
/// As [`read`].
pub(super) fn read_times(frames: &FrameTable) -> Result<Vec<super::FrameTime>, InputError> {
    let table = Table::read(&frames.file, frames.delimiter)?;
    let name = table.column(&frames.frame)?;
    let times = Times::of(&table, &frames.time)?;
    Ok(table
        .rows()
        .map(|row| super::FrameTime {
            place: row.line(),
            frame: row.text(name).to_owned(),
            time: times.get(&row),
        })
        .collect())
}
