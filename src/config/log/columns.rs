//! The columns of a text table: each one used is declared with its unit and its sense or datum.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::super::error::{ConfigError, Resolver};
use super::super::height::HeightDatum;
use super::super::source::Located;
use super::LogSpec;
use crate::units::Radians;

/// Columns of the log: each one used is declared with its unit and its sense or datum.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ColumnsSpec {
    /// Names the frame's file. Required with `join = "name"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<Located<String>>,
    /// Time of the row. Required with `join = "time"` and "match".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<Located<TimeColumnSpec>>,
    /// Geodetic latitude, WGS 84, positive north.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latitude: Option<Located<CoordinateColumnSpec>>,
    /// Longitude, WGS 84, positive east.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longitude: Option<Located<CoordinateColumnSpec>>,
    /// Easting in `position_crs`, instead of latitude and longitude.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub easting: Option<Located<LengthColumnSpec>>,
    /// Northing in `position_crs`, instead of latitude and longitude.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub northing: Option<Located<LengthColumnSpec>>,
    /// ECEF x (WGS 84), instead of latitude, longitude and height.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub x: Option<Located<LengthColumnSpec>>,
    /// ECEF y (WGS 84).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub y: Option<Located<LengthColumnSpec>>,
    /// ECEF z (WGS 84).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z: Option<Located<LengthColumnSpec>>,
    /// Height of the antenna. Required with latitude/longitude and easting/northing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<Located<HeightColumnSpec>>,
    /// Direction of the nose in the horizontal plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub yaw: Option<Located<AngleColumnSpec<YawSense>>>,
    /// Pitch of the airframe.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch: Option<Located<AngleColumnSpec<PitchSense>>>,
    /// Roll of the airframe.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll: Option<Located<AngleColumnSpec<RollSense>>>,
    /// Gimbal pan, instead of `mount.gimbal_pan`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_pan: Option<Located<AngleColumnSpec<TurnSense>>>,
    /// Gimbal elevation, instead of `mount.gimbal_elevation`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_elevation: Option<Located<AngleColumnSpec<ElevationSense>>>,
    /// Gimbal roll about the optical axis, instead of `mount.gimbal_roll`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_roll: Option<Located<AngleColumnSpec<TurnSense>>>,
    /// Height of the camera above the ground below it, for `ground.kind = "below_camera"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_above_ground: Option<Located<LengthColumnSpec>>,
    /// Speed over ground: what a timing error is multiplied by in the accuracy report.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground_speed: Option<Located<SpeedColumnSpec>>,
    /// Velocity towards north.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_north: Option<Located<SpeedColumnSpec>>,
    /// Velocity towards east.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_east: Option<Located<SpeedColumnSpec>>,
    /// Velocity downwards.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_down: Option<Located<SpeedColumnSpec>>,
    /// How far the stored pixels of a frame were turned after it was taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_rotation: Option<Located<RotationColumnSpec>>,
}

/// A column of times.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TimeColumnSpec {
    /// Name of the column.
    pub column: Located<String>,
    /// How its values are written.
    pub format: TimeFormat,
}

/// How times are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TimeFormat {
    /// Date and time with offset or Z, UTC: "2013-06-04T17:38:09.25Z".
    Iso8601,
    /// Seconds since 1970-01-01 UTC.
    UnixSeconds,
    /// Seconds since any instant, the same for log and frames.
    Seconds,
    /// Milliseconds since any instant, the same for log and frames.
    Milliseconds,
    /// Microseconds since any instant, the same for log and frames.
    Microseconds,
    /// Seconds of the GPS week.
    GpsSecondsOfWeek,
}

impl TimeFormat {
    /// Formats of one class can be compared with each other.
    pub(super) fn clock(self) -> &'static str {
        match self {
            Self::Iso8601 | Self::UnixSeconds => "UTC",
            Self::Seconds | Self::Milliseconds | Self::Microseconds => "a clock of its own",
            Self::GpsSecondsOfWeek => "seconds of a GPS week",
        }
    }
}

/// A column of latitudes or longitudes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoordinateColumnSpec {
    /// Name of the column.
    pub column: Located<String>,
    /// Unit of its values.
    pub unit: CoordinateUnit,
}

/// Unit of a latitude or longitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CoordinateUnit {
    /// Degrees.
    #[serde(rename = "deg")]
    Degrees,
    /// Radians.
    #[serde(rename = "rad")]
    Radians,
    /// Degrees times 10⁷, whole numbers (as MAVLink and u-blox write them).
    #[serde(rename = "deg_e7")]
    DegreesE7,
}

/// Unit of an angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum AngleUnit {
    /// Degrees.
    #[serde(rename = "deg")]
    Degrees,
    /// Radians.
    #[serde(rename = "rad")]
    Radians,
}

/// Unit of a length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum LengthUnit {
    /// Metres.
    #[serde(rename = "m")]
    Metres,
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetres,
    /// Centimetres.
    #[serde(rename = "cm")]
    Centimetres,
    /// Kilometres.
    #[serde(rename = "km")]
    Kilometres,
    /// International feet.
    #[serde(rename = "ft")]
    Feet,
}

/// Unit of a speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum SpeedUnit {
    /// Metres per second.
    #[serde(rename = "m/s")]
    MetresPerSecond,
    /// Kilometres per hour.
    #[serde(rename = "km/h")]
    KilometresPerHour,
    /// Knots.
    #[serde(rename = "kn")]
    Knots,
    /// Centimetres per second.
    #[serde(rename = "cm/s")]
    CentimetresPerSecond,
}

impl CoordinateUnit {
    /// Radians in one of this unit.
    pub fn radians(self) -> f64 {
        match self {
            Self::Degrees => Radians::from_degrees(1.0).get(),
            Self::Radians => 1.0,
            Self::DegreesE7 => Radians::from_degrees(1.0).get() * 1e-7,
        }
    }
}

impl AngleUnit {
    /// Radians in one of this unit.
    pub fn radians(self) -> f64 {
        match self {
            Self::Degrees => Radians::from_degrees(1.0).get(),
            Self::Radians => 1.0,
        }
    }
}

impl LengthUnit {
    /// Metres in one of this unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metres => 1.0,
            Self::Millimetres => 1e-3,
            Self::Centimetres => 1e-2,
            Self::Kilometres => 1e3,
            Self::Feet => 0.3048,
        }
    }
}

impl SpeedUnit {
    /// Metres per second in one of this unit.
    pub fn metres_per_second(self) -> f64 {
        match self {
            Self::MetresPerSecond => 1.0,
            Self::KilometresPerHour => 1.0 / 3.6,
            Self::Knots => 1852.0 / 3600.0,
            Self::CentimetresPerSecond => 1e-2,
        }
    }
}

/// A column of lengths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LengthColumnSpec {
    /// Name of the column.
    pub column: Located<String>,
    /// Unit of its values.
    pub unit: LengthUnit,
}

/// A column of speeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpeedColumnSpec {
    /// Name of the column.
    pub column: Located<String>,
    /// Unit of its values.
    pub unit: SpeedUnit,
}

/// A column of heights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeightColumnSpec {
    /// Name of the column.
    pub column: Located<String>,
    /// Unit of its values.
    pub unit: LengthUnit,
    /// What the heights are measured from.
    pub datum: HeightDatum,
}

/// A column of angles, with the sense in which they grow.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "AngleColumn{S}")]
pub struct AngleColumnSpec<S> {
    /// Name of the column.
    pub column: Located<String>,
    /// Unit of its values.
    pub unit: AngleUnit,
    /// The sense in which the angle grows.
    pub sense: S,
}

/// The sense of a yaw column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum YawSense {
    /// From true north towards east (compass heading, corrected for declination).
    ClockwiseFromTrueNorth,
    /// From magnetic north towards east: the declination at the place and the date of the log is added.
    ClockwiseFromMagneticNorth,
    /// From the grid north of the log's CRS (or of the products', where the log has none) towards east.
    ClockwiseFromGridNorth,
    /// The direction of travel, from true north towards east, used as if the nose pointed along it; `log.crab_std` states
    /// how far off the nose may be.
    CourseOverGround,
    /// From true north towards west.
    CounterclockwiseFromTrueNorth,
    /// From east towards north (mathematical angle).
    CounterclockwiseFromEast,
}

/// What a yaw is measured from, once its sense is undone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum YawReference {
    /// True north.
    #[serde(rename = "true_north")]
    TrueNorth,
    /// Magnetic north at the place and the date of the log.
    #[serde(rename = "magnetic_north")]
    MagneticNorth,
    /// Grid north of the log's CRS.
    #[serde(rename = "grid_north")]
    GridNorth,
    /// True north, but it is the direction of travel, used as if the nose pointed along it.
    #[serde(rename = "course")]
    Course,
}

/// The sense of a pitch column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PitchSense {
    /// Positive when the nose is up.
    NoseUp,
    /// Positive when the nose is down.
    NoseDown,
}

/// The sense of a roll column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RollSense {
    /// Positive when the right wing is down.
    RightWingDown,
    /// Positive when the left wing is down.
    LeftWingDown,
}

/// The sense of a gimbal's pan (seen from above) or roll (seen along the optical axis).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TurnSense {
    /// Clockwise.
    Clockwise,
    /// Counterclockwise.
    Counterclockwise,
}

/// The sense of a gimbal's elevation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ElevationSense {
    /// Positive upwards: -90° looks straight down.
    Up,
    /// Positive downwards: +90° looks straight down.
    Down,
}

/// A sense that is either ours (+1) or its mirror image (-1).
pub trait Sense: Copy {
    /// +1 or -1.
    fn sign(self) -> f64;
}

impl Sense for PitchSense {
    fn sign(self) -> f64 {
        if self == Self::NoseUp { 1.0 } else { -1.0 }
    }
}

impl Sense for RollSense {
    fn sign(self) -> f64 {
        if self == Self::RightWingDown { 1.0 } else { -1.0 }
    }
}

impl Sense for TurnSense {
    fn sign(self) -> f64 {
        if self == Self::Clockwise { 1.0 } else { -1.0 }
    }
}

impl Sense for ElevationSense {
    fn sign(self) -> f64 {
        if self == Self::Up { 1.0 } else { -1.0 }
    }
}

/// A column that tells how the stored pixels were turned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RotationColumnSpec {
    /// Name of the column.
    pub column: Located<String>,
    /// What its values mean.
    pub meaning: RotationMeaning,
}

/// What the values of a pixel rotation column mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RotationMeaning {
    /// 0: as taken; 1: the stored pixels were turned by half a turn.
    HalfTurns,
    /// 0, 90, 180 or 270: the stored pixels were turned clockwise by so many degrees.
    DegreesClockwise,
}

/// A numeric column and what its values are multiplied by: SI unit and our sense come out.
#[derive(Debug, Clone, PartialEq)]
pub struct NumberColumn {
    /// Name of the column.
    pub column: Located<String>,
    /// SI value in our sense = written value × this.
    pub factor: f64,
}

/// Columns of the antenna's position.
#[derive(Debug, Clone)]
pub enum PositionColumns {
    /// Geodetic, WGS 84.
    Geodetic {
        /// Radians, positive north.
        latitude: NumberColumn,
        /// Radians, positive east.
        longitude: NumberColumn,
        /// Metres.
        height: HeightColumn,
    },
    /// Map coordinates.
    Projected {
        /// Metres.
        easting: NumberColumn,
        /// Metres.
        northing: NumberColumn,
        /// Their CRS.
        crs: Located<String>,
        /// Metres.
        height: HeightColumn,
    },
    /// Earth-centred, Earth-fixed, WGS 84.
    Ecef {
        /// Metres.
        x: NumberColumn,
        /// Metres.
        y: NumberColumn,
        /// Metres.
        z: NumberColumn,
    },
}

impl PositionColumns {
    /// The height column, which ECEF positions do not have.
    pub fn height(&self) -> Option<&HeightColumn> {
        match self {
            Self::Geodetic { height, .. } | Self::Projected { height, .. } => Some(height),
            Self::Ecef { .. } => None,
        }
    }
}

/// A column of heights, metres.
#[derive(Debug, Clone)]
pub struct HeightColumn {
    /// The column.
    pub column: NumberColumn,
    /// What the heights are measured from.
    pub datum: HeightDatum,
}

/// Columns of the body's attitude.
#[derive(Debug, Clone)]
pub struct AttitudeColumns {
    /// Direction of the nose.
    pub yaw: YawColumn,
    /// Radians, nose up.
    pub pitch: NumberColumn,
    /// Radians, right wing down.
    pub roll: NumberColumn,
}

/// A column of yaws.
#[derive(Debug, Clone)]
pub struct YawColumn {
    /// Radians in the sense below.
    pub column: NumberColumn,
    /// The sense as declared.
    pub sense: YawSense,
}

impl YawColumn {
    /// The yaw clockwise from [`YawColumn::reference`] of a written value, radians.
    pub fn clockwise(&self, written: f64) -> f64 {
        let angle = written * self.column.factor;
        match self.sense {
            YawSense::ClockwiseFromTrueNorth
            | YawSense::ClockwiseFromMagneticNorth
            | YawSense::ClockwiseFromGridNorth
            | YawSense::CourseOverGround => angle,
            YawSense::CounterclockwiseFromTrueNorth => -angle,
            YawSense::CounterclockwiseFromEast => std::f64::consts::FRAC_PI_2 - angle,
        }
    }

    /// The north it is measured from.
    pub fn reference(&self) -> YawReference {
        match self.sense {
            YawSense::ClockwiseFromMagneticNorth => YawReference::MagneticNorth,
            YawSense::ClockwiseFromGridNorth => YawReference::GridNorth,
            YawSense::CourseOverGround => YawReference::Course,
            _ => YawReference::TrueNorth,
        }
    }
}

/// Columns of the velocity, m/s.
#[derive(Debug, Clone)]
pub struct VelocityColumns {
    /// Towards north.
    pub north: NumberColumn,
    /// Towards east.
    pub east: NumberColumn,
    /// Downwards.
    pub down: NumberColumn,
}

impl CoordinateColumnSpec {
    fn number(&self) -> NumberColumn {
        NumberColumn { column: self.column.clone(), factor: self.unit.radians() }
    }
}

impl LengthColumnSpec {
    pub(in crate::config) fn number(&self) -> NumberColumn {
        NumberColumn { column: self.column.clone(), factor: self.unit.metres() }
    }
}

impl SpeedColumnSpec {
    fn number(&self) -> NumberColumn {
        NumberColumn { column: self.column.clone(), factor: self.unit.metres_per_second() }
    }
}

impl<S: Sense> AngleColumnSpec<S> {
    fn number(&self) -> NumberColumn {
        NumberColumn { column: self.column.clone(), factor: self.unit.radians() * self.sense.sign() }
    }
}

/// A table of the log, resolved.
#[derive(Debug, Clone)]
pub struct TableLog {
    /// The text table.
    pub file: Located<PathBuf>,
    /// The byte that separates columns.
    pub delimiter: u8,
    /// Column of the frame's file name, with `join = "name"`.
    pub frame: Option<Located<String>>,
    /// Column of the row's time; present with `join = "time"` and "match".
    pub time: Option<TimeColumnSpec>,
    /// Columns of the antenna's position.
    pub position: PositionColumns,
    /// Columns of the body's attitude; absent only with a stabilised gimbal and no lever arm in the body.
    pub attitude: Option<AttitudeColumns>,
    /// Gimbal pan, positive clockwise seen from above; absent when the mount fixes it.
    pub gimbal_pan: Option<NumberColumn>,
    /// Gimbal elevation, positive up; absent when the mount fixes it.
    pub gimbal_elevation: Option<NumberColumn>,
    /// Gimbal roll, positive clockwise seen along the optical axis; absent when the mount fixes it.
    pub gimbal_roll: Option<NumberColumn>,
    /// Height above the ground below the camera, metres.
    pub height_above_ground: Option<NumberColumn>,
    /// Speed over ground, m/s.
    pub ground_speed: Option<NumberColumn>,
    /// Velocity north, east, down, m/s; all three or none.
    pub velocity: Option<VelocityColumns>,
    /// Per-frame turn of the stored pixels.
    pub pixel_rotation: Option<RotationColumnSpec>,
}

impl TableLog {
    /// Whether any gimbal angle is a column.
    pub fn has_gimbal(&self) -> bool {
        self.gimbal_pan.is_some() || self.gimbal_elevation.is_some() || self.gimbal_roll.is_some()
    }
}

pub(super) fn resolve(
    file: Located<PathBuf>,
    delimiter: u8,
    columns: &Located<ColumnsSpec>,
    spec: &LogSpec,
    resolver: &Resolver,
) -> Result<TableLog, ConfigError> {
    let velocity = match (&columns.velocity_north, &columns.velocity_east, &columns.velocity_down) {
        (Some(north), Some(east), Some(down)) => {
            Some(VelocityColumns { north: north.number(), east: east.number(), down: down.number() })
        }
        (None, None, None) => None,
        _ => {
            return Err(resolver
                .error(columns, "a velocity needs all of velocity_north, velocity_east, velocity_down")
                .help("add the missing columns, or declare `ground_speed` instead"));
        }
    };
    Ok(TableLog {
        file,
        delimiter,
        frame: columns.frame.clone(),
        time: columns.time.as_ref().map(|time| time.value.clone()),
        position: position(columns, spec, resolver)?,
        attitude: attitude(columns, resolver)?,
        gimbal_pan: columns.gimbal_pan.as_ref().map(|column| column.number()),
        gimbal_elevation: columns.gimbal_elevation.as_ref().map(|column| column.number()),
        gimbal_roll: columns.gimbal_roll.as_ref().map(|column| column.number()),
        height_above_ground: columns.height_above_ground.as_ref().map(|column| column.number()),
        ground_speed: columns.ground_speed.as_ref().map(|column| column.number()),
        velocity,
        pixel_rotation: columns.pixel_rotation.as_ref().map(|column| column.value.clone()),
    })
}

fn position(
    columns: &Located<ColumnsSpec>,
    spec: &LogSpec,
    resolver: &Resolver,
) -> Result<PositionColumns, ConfigError> {
    let geodetic = columns.latitude.is_some() || columns.longitude.is_some();
    let projected = columns.easting.is_some() || columns.northing.is_some();
    let ecef = columns.x.is_some() || columns.y.is_some() || columns.z.is_some();
    let missing = |name: &str| {
        resolver.error(columns, format!("the position lacks the column `{name}`")).help(format!(
            "add `{name} = {{ column = \"<column>\", unit = \"...\" }}` to [georeference.log.columns]"
        ))
    };
    let need = |column: &Option<Located<LengthColumnSpec>>, name: &str| {
        column.as_ref().map(|column| column.number()).ok_or_else(|| missing(name))
    };
    match (geodetic, projected, ecef) {
        (true, false, false) => {
            resolver.unused(&spec.position_crs, "position_crs", "latitude and longitude are WGS 84")?;
            let need = |column: &Option<Located<CoordinateColumnSpec>>, name: &str| {
                column.as_ref().map(|column| column.number()).ok_or_else(|| missing(name))
            };
            Ok(PositionColumns::Geodetic {
                latitude: need(&columns.latitude, "latitude")?,
                longitude: need(&columns.longitude, "longitude")?,
                height: height(columns, spec, resolver)?,
            })
        }
        (false, true, false) => {
            let crs = spec.position_crs.clone().ok_or_else(|| {
                resolver
                    .error(columns, "easting and northing need their CRS")
                    .help("add `position_crs = \"EPSG:...\"` to [georeference.log]")
            })?;
            Ok(PositionColumns::Projected {
                easting: need(&columns.easting, "easting")?,
                northing: need(&columns.northing, "northing")?,
                crs,
                height: height(columns, spec, resolver)?,
            })
        }
        (false, false, true) => {
            resolver.unused(&spec.position_crs, "position_crs", "x, y, z are ECEF (WGS 84)")?;
            resolver.unused(&columns.height, "height", "x, y, z hold the height")?;
            resolver.unused(&spec.takeoff_height, "takeoff_height", "x, y, z hold the height")?;
            Ok(PositionColumns::Ecef {
                x: need(&columns.x, "x")?,
                y: need(&columns.y, "y")?,
                z: need(&columns.z, "z")?,
            })
        }
        (false, false, false) => Err(resolver.error(columns, "the log's columns hold no position").help(
            "declare latitude and longitude, or easting and northing with `position_crs`, or x, y, z (ECEF)",
        )),
        _ => Err(resolver
            .error(columns, "the position is declared more than once")
            .help("keep one of: latitude and longitude; easting and northing; x, y, z")),
    }
}

fn height(
    columns: &Located<ColumnsSpec>,
    spec: &LogSpec,
    resolver: &Resolver,
) -> Result<HeightColumn, ConfigError> {
    let column = columns.height.as_ref().ok_or_else(|| {
        resolver
            .error(columns, "the position lacks the column `height`")
            .help("add `height = { column = \"<column>\", unit = \"m\", datum = \"ellipsoid\" }` (or egm96, egm2008, barometric, above_ground, above_takeoff) to [georeference.log.columns]")
    })?;
    match (column.datum.needs_zero(), &spec.takeoff_height) {
        (true, None) => {
            return Err(resolver
                .error(column, format!("a height {} needs the height of its zero", column.datum.words()))
                .help(
                    "add `takeoff_height = { value = \"... m\", datum = \"egm96\" }` to [georeference.log]",
                ));
        }
        (false, takeoff) => {
            resolver.unused(
                takeoff,
                "takeoff_height",
                "the height column is neither `above_takeoff` nor `barometric`",
            )?;
        }
        (true, Some(_)) => {}
    }
    let datum = column.datum;
    let column = NumberColumn { column: column.column.clone(), factor: column.unit.metres() };
    Ok(HeightColumn { column, datum })
}

fn attitude(
    columns: &Located<ColumnsSpec>,
    resolver: &Resolver,
) -> Result<Option<AttitudeColumns>, ConfigError> {
    match (&columns.yaw, &columns.pitch, &columns.roll) {
        (None, None, None) => Ok(None),
        (Some(yaw), Some(pitch), Some(roll)) => Ok(Some(AttitudeColumns {
            yaw: YawColumn {
                column: NumberColumn { column: yaw.column.clone(), factor: yaw.unit.radians() },
                sense: yaw.sense,
            },
            pitch: pitch.number(),
            roll: roll.number(),
        })),
        (yaw, pitch, _) => {
            let missing = if yaw.is_none() {
                ("yaw", "clockwise_from_true_north")
            } else if pitch.is_none() {
                ("pitch", "nose_up")
            } else {
                ("roll", "right_wing_down")
            };
            let (name, sense) = missing;
            Err(resolver.error(columns, format!("the attitude lacks the column `{name}`")).help(format!(
                "add `{name} = {{ column = \"<column>\", unit = \"deg\", sense = \"{sense}\" }}` to [georeference.log.columns]"
            )))
        }
    }
}
