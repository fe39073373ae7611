//! `[georeference.log]` and `[georeference.frames]`: where poses come from, and how frames find theirs.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::{ConfigError, Resolver};
use super::height::{Height, HeightDatum, HeightSpec};
use super::quantity::{Angle, Duration};
use super::source::Located;

pub mod columns;

use columns::{ColumnsSpec, TableLog, TimeColumnSpec, TimeFormat, YawReference};

/// `[georeference.log]` as written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LogSpec {
    /// What kind of log it is. Default "table": a text table whose columns are declared here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<Located<LogFormat>>,
    /// The log. Not with `format = "photos"`, where the photos themselves hold the poses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<Located<PathBuf>>,
    /// With "table": what separates columns: one character. Default ",".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delimiter: Option<Located<String>>,
    /// How a frame finds its pose: "name" (the log names the frame), "time" (interpolated at the frame's time) or "match"
    /// (the log's exposures are aligned with the frames' times). Required with "table"; otherwise what the format holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub join: Option<Located<JoinKind>>,
    /// With `join = "time"` and "match": frames in a longer gap of the log than this are rejected. Default "1 s".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_gap: Option<Located<Duration>>,
    /// Exposure in log time = the frame's time + this. With `join = "time"` default "0 s"; with "match" it is found from
    /// the two series unless stated here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock_offset: Option<Located<Duration>>,
    /// With `join = "match"` and `clock_offset`: one standard deviation of it. Default "1 s".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock_offset_std: Option<Located<Duration>>,
    /// With `join = "match"`: one photo and the record of the log that it belongs to, where the two series leave several
    /// alignments open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub anchor: Option<Located<AnchorSpec>>,
    /// Coordinate reference system of projected positions, for example "EPSG:32617"; for files that do not state it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_crs: Option<Located<String>>,
    /// Height of the take-off point, for heights above it, or of the zero of barometric heights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub takeoff_height: Option<Located<HeightSpec>>,
    /// What the log's heights are measured from, instead of what the format says. Not with "table", whose column says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_datum: Option<Located<HeightDatum>>,
    /// What the log's yaw is counted from, instead of what the format says. Not with "table", whose column says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading: Option<Located<YawReference>>,
    /// Where the yaw is the course over ground: one standard deviation of the angle between course and nose. Required then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crab_std: Option<Located<Angle>>,
    /// What the three angles of a file are that does not say so itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angles: Option<Located<AngleSystem>>,
    /// Their unit, where the file does not say so. Default "deg".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_unit: Option<Located<AngleUnit>>,
    /// With "geoinfo" and "orientation": the columns in their order, for a file without a header: "image", "latitude",
    /// "longitude", "x", "y", "altitude", "omega", "phi", "kappa", "yaw", "pitch", "roll"; "-" for one that is not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column_order: Option<Located<Vec<String>>>,
    /// With "orientation": Pix4D's offset file (..._offset.xyz), when positions were written less that offset. With
    /// "opensfm": OpenDroneMap's odm_georeferencing/coords.txt, when the reconstruction is on a map grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset_file: Option<Located<PathBuf>>,
    /// With "opensfm": reference_lla.json, for a reconstruction without a reference of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_file: Option<Located<PathBuf>>,
    /// With "table": its columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub columns: Option<Located<ColumnsSpec>>,
}

/// A photo and its record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnchorSpec {
    /// File name of the photo.
    pub frame: String,
    /// Number of the record in the log, as matching.csv and error messages count them (a table: its line).
    pub record: u64,
}

/// What kind of log it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// A text table whose first line names the columns; `columns` declares them.
    Table,
    /// EXIF and XMP of the photos themselves.
    Photos,
    /// ArduPilot DataFlash (.bin).
    Ardupilot,
    /// PX4 ULog (.ulg).
    Px4,
    /// MAVLink telemetry (.tlog).
    Mavlink,
    /// Applanix smoothed best estimate of trajectory (.sbet, .out).
    Sbet,
    /// RTKLIB solution (.pos).
    Rtklib,
    /// RTKLIB solution at events (_events.pos): one line per exposure.
    RtklibEvents,
    /// DJI exposures (.MRK).
    DjiMrk,
    /// Geolocation table of senseFly eMotion and Pix4D.
    Geoinfo,
    /// OpenDroneMap geo.txt.
    OdmGeo,
    /// Exterior orientation of Pix4D, Metashape or orthority.
    Orientation,
    /// OpenSfM and OpenDroneMap reconstruction.json.
    Opensfm,
}

impl LogFormat {
    /// The word of the pipeline file.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Table => "table",
            Self::Photos => "photos",
            Self::Ardupilot => "ardupilot",
            Self::Px4 => "px4",
            Self::Mavlink => "mavlink",
            Self::Sbet => "sbet",
            Self::Rtklib => "rtklib",
            Self::RtklibEvents => "rtklib_events",
            Self::DjiMrk => "dji_mrk",
            Self::Geoinfo => "geoinfo",
            Self::OdmGeo => "odm_geo",
            Self::Orientation => "orientation",
            Self::Opensfm => "opensfm",
        }
    }

    /// How frames find their pose when nothing else is said.
    const fn usual_join(self) -> Option<JoinKind> {
        match self {
            Self::Table => None,
            Self::Photos | Self::Geoinfo | Self::OdmGeo | Self::Orientation | Self::Opensfm => {
                Some(JoinKind::Name)
            }
            Self::Sbet | Self::Rtklib => Some(JoinKind::Time),
            Self::Ardupilot | Self::Px4 | Self::Mavlink | Self::RtklibEvents | Self::DjiMrk => {
                Some(JoinKind::Match)
            }
        }
    }
}

/// What three angles are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AngleSystem {
    /// Yaw, pitch, roll of the camera: all zero looks straight down with the image's top to the north, pitch +90° looks at
    /// the horizon (Pix4D, Metashape, OpenDroneMap, orthority).
    CameraYawPitchRoll,
    /// Yaw, pitch, roll of the UAV: all zero is level flight to the north.
    BodyYawPitchRoll,
    /// Omega, phi, kappa: Rx(ω)·Ry(φ)·Rz(κ), camera x right, y up, z back, to the map grid.
    OmegaPhiKappa,
    /// Phi, omega, kappa: Ry(φ)·Rx(ω)·Rz(κ), as Inpho writes them.
    PhiOmegaKappa,
}

/// The unit of a file's angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AngleUnit {
    /// 360 to a turn.
    Deg,
    /// 400 to a turn.
    Gon,
    /// 2π to a turn.
    Rad,
}

/// How a frame finds its pose in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JoinKind {
    /// The log names the frame.
    Name,
    /// The frame's time lies between two records of the log.
    Time,
    /// The log's exposures and the frames' times are two series of the same events.
    Match,
}

impl JoinKind {
    const fn word(self) -> &'static str {
        match self {
            Self::Name => "name",
            Self::Time => "time",
            Self::Match => "match",
        }
    }
}

/// `[georeference.frames]`: when each frame was taken, for `join = "time"` and "match".
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FramesSpec {
    /// A text table with one row per frame. Without it, the photos' own EXIF and XMP say when they were taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<Located<PathBuf>>,
    /// With `file`: what separates columns: one character. Default ",".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delimiter: Option<Located<String>>,
    /// With `file`: its columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub columns: Option<Located<FrameColumnsSpec>>,
    /// Without `file`: how far the camera's clock is ahead of UTC ("-4 h"), for photos that state neither UTC nor a zone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub utc_offset: Option<Located<Duration>>,
}

/// Columns of the frames' table.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameColumnsSpec {
    /// Names the frame's file.
    pub frame: Located<String>,
    /// When it was taken.
    pub time: Located<TimeColumnSpec>,
}

/// The log, resolved.
#[derive(Debug, Clone)]
pub struct Log {
    /// The table's place.
    pub table: Located<()>,
    /// Where it is and how it is read.
    pub source: LogSource,
    /// How frames find their pose.
    pub join: Join,
    /// CRS of projected positions that the file does not state.
    pub crs: Option<Located<String>>,
    /// Height of the take-off point, or of the zero of barometric heights.
    pub takeoff: Option<Height>,
    /// What heights are measured from, instead of what the format says.
    pub height_datum: Option<HeightDatum>,
    /// What yaw is counted from, instead of what the format says.
    pub heading: Option<YawReference>,
    /// One standard deviation of the angle between course and nose, radians.
    pub crab_std_rad: Option<f64>,
}

/// Where a log is and how it is read.
#[derive(Debug, Clone)]
pub enum LogSource {
    /// A text table with declared columns.
    Table(Box<TableLog>),
    /// The photos' own metadata.
    Photos,
    /// A file that says itself what its records are.
    File {
        /// The file.
        file: Located<PathBuf>,
        /// Its format.
        format: LogFormat,
        /// What is declared because the file does not say it.
        stated: Box<StatedOfFile>,
    },
}

/// What the pipeline file states about a log that does not state it itself.
#[derive(Debug, Clone)]
pub struct StatedOfFile {
    /// What three angles are.
    pub angles: Option<AngleSystem>,
    /// Their unit.
    pub angle_unit: AngleUnit,
    /// The columns in their order.
    pub column_order: Option<Located<Vec<String>>>,
    /// Pix4D's offset, or OpenDroneMap's coords.txt.
    pub offset_file: Option<Located<PathBuf>>,
    /// OpenSfM's reference_lla.json.
    pub reference_file: Option<Located<PathBuf>>,
}

impl Log {
    /// The log's file; `None` when the photos are the log.
    pub fn file(&self) -> Option<&Located<PathBuf>> {
        match &self.source {
            LogSource::Table(table) => Some(&table.file),
            LogSource::Photos => None,
            LogSource::File { file, .. } => Some(file),
        }
    }

    /// The declared table, if it is one.
    pub fn as_table(&self) -> Option<&TableLog> {
        match &self.source {
            LogSource::Table(table) => Some(table),
            LogSource::Photos | LogSource::File { .. } => None,
        }
    }

    /// Whether its heights are declared to be above the ground.
    pub fn is_above_ground(&self) -> bool {
        let column = self.as_table().and_then(|table| table.position.height()).map(|height| height.datum);
        column.or(self.height_datum) == Some(HeightDatum::AboveGround)
    }

    /// Whether it can say how fast the camera moved, as far as the pipeline file tells.
    pub fn may_know_speed(&self) -> bool {
        let Some(table) = self.as_table() else { return true };
        table.ground_speed.is_some() || table.velocity.is_some() || table.time.is_some()
    }
}

/// How frames find their pose.
#[derive(Debug, Clone)]
pub enum Join {
    /// By the frame's file name.
    Name,
    /// By time, interpolated.
    Time {
        /// Longest gap that is interpolated over, seconds.
        max_gap_s: f64,
        /// Exposure in log time = the frame's time + this, seconds.
        clock_offset_s: f64,
        /// Whether the pipeline file states the offset: whoever does says that the two clocks can be compared.
        offset_stated: bool,
        /// When each frame was taken.
        frames: FrameTimes,
    },
    /// By aligning the log's exposures with the frames' times.
    Match {
        /// Longest gap that is interpolated over, seconds.
        max_gap_s: f64,
        /// What is known of the two clocks.
        clock: StatedClock,
        /// When each frame was taken.
        frames: FrameTimes,
    },
}

/// What the pipeline file states about the clocks of photos and log.
#[derive(Debug, Clone, PartialEq)]
pub enum StatedClock {
    /// Nothing.
    Unknown,
    /// Exposure in log time = the frame's time + this.
    Offset {
        /// Seconds.
        offset_s: f64,
        /// One standard deviation, seconds.
        std_s: f64,
    },
    /// One photo and its record.
    Anchor(Located<AnchorSpec>),
}

impl Join {
    /// When each frame was taken, where that matters.
    pub fn frames(&self) -> Option<&FrameTimes> {
        match self {
            Self::Name => None,
            Self::Time { frames, .. } | Self::Match { frames, .. } => Some(frames),
        }
    }
}

/// When each frame was taken.
#[derive(Debug, Clone)]
pub enum FrameTimes {
    /// As a text table says.
    Table(Box<FrameTable>),
    /// As the photos say.
    Photos {
        /// How far their clock is ahead of UTC, seconds, where they do not say it themselves.
        utc_offset_s: Option<f64>,
    },
}

/// A text table of the frames' times.
#[derive(Debug, Clone)]
pub struct FrameTable {
    /// The text table.
    pub file: Located<PathBuf>,
    /// The byte that separates columns.
    pub delimiter: u8,
    /// Column of the frame's file name.
    pub frame: Located<String>,
    /// Column of its time.
    pub time: TimeColumnSpec,
}

/// One ASCII character, "," when absent.
pub(super) fn delimiter(spec: &mut Option<Located<String>>, resolver: &Resolver) -> Result<u8, ConfigError> {
    let written = spec.get_or_insert_with(|| Located::unplaced(",".to_owned()));
    match written.as_bytes() {
        [byte] if byte.is_ascii() && !matches!(byte, b'"' | b'\n' | b'\r') => Ok(*byte),
        _ => Err(resolver
            .error(written, format!("delimiter {:?} is not one character", written.value))
            .help("write \",\", \";\" or \"\\t\"")),
    }
}

pub(super) fn resolve(
    spec: &mut Located<LogSpec>,
    frames: &mut Option<Located<FramesSpec>>,
    resolver: &Resolver,
) -> Result<Log, ConfigError> {
    let table = Located { value: (), span: spec.span.clone() };
    let format = spec.value.format.get_or_insert_with(|| Located::unplaced(LogFormat::Table)).clone();
    let kind = join_kind(spec, &format, resolver)?;
    let source = source(spec, &format, kind, resolver)?;
    let join = join(&mut spec.value, kind, &source, frames, resolver)?;
    let heading = match &source {
        LogSource::Table(table) => table.attitude.as_ref().map(|attitude| attitude.yaw.reference()),
        LogSource::Photos | LogSource::File { .. } => spec.heading.as_ref().map(|heading| heading.value),
    };
    let crab_std_rad = crab(spec, heading, resolver)?;
    Ok(Log {
        table,
        source,
        join,
        crs: spec.position_crs.clone(),
        takeoff: spec.takeoff_height.as_ref().map(|height| height.height()),
        height_datum: spec.height_datum.as_ref().map(|datum| datum.value),
        heading: spec.heading.as_ref().map(|heading| heading.value),
        crab_std_rad,
    })
}

/// Refuses what only a log that says itself what it holds needs stated.
fn nothing_of_a_file(spec: &LogSpec, because: &str, resolver: &Resolver) -> Result<(), ConfigError> {
    resolver.unused(&spec.angles, "angles", because)?;
    resolver.unused(&spec.angle_unit, "angle_unit", because)?;
    resolver.unused(&spec.column_order, "column_order", because)?;
    resolver.unused(&spec.offset_file, "offset_file", because)?;
    resolver.unused(&spec.reference_file, "reference_file", because)
}

/// How frames find their pose: as written, or as the format has it.
fn join_kind(
    spec: &mut Located<LogSpec>,
    format: &Located<LogFormat>,
    resolver: &Resolver,
) -> Result<JoinKind, ConfigError> {
    match (&spec.join, format.usual_join()) {
        (Some(join), usual) => {
            let names_only = usual == Some(JoinKind::Name);
            if names_only && join.value != JoinKind::Name {
                return Err(resolver
                    .error(join, format!("a log of format \"{}\" names its frames", format.word()))
                    .help("remove `join`"));
            }
            if !names_only && format.value != LogFormat::Table && join.value == JoinKind::Name {
                return Err(resolver
                    .error(join, format!("a log of format \"{}\" names no frames", format.word()))
                    .help("write `join = \"match\"` or `join = \"time\"`"));
            }
            Ok(join.value)
        }
        (None, Some(usual)) => {
            spec.value.join = Some(Located::unplaced(usual));
            Ok(usual)
        }
        (None, None) => Err(resolver
            .error(spec, "a table needs `join`: how a frame finds its row")
            .help("add `join = \"name\"` (a column names the frame), \"time\" (interpolated) or \"match\" (rows are exposures)")),
    }
}

fn source(
    spec: &mut Located<LogSpec>,
    format: &Located<LogFormat>,
    join: JoinKind,
    resolver: &Resolver,
) -> Result<LogSource, ConfigError> {
    let is = format!("the log's format is \"{}\"", format.word());
    let needs = |what: &str, example: &str, spec: &Located<LogSpec>| {
        resolver
            .error(spec, format!("a log of format \"{}\" needs `{what}`", format.word()))
            .help(format!("add {example} to [georeference.log]"))
    };
    if format.value == LogFormat::Table {
        resolver.unused(&spec.height_datum, "height_datum", "the table's height column states its datum")?;
        resolver.unused(&spec.heading, "heading", "the table's yaw column states its sense")?;
        nothing_of_a_file(spec, "the table's columns are declared", resolver)?;
        let file = spec.file.as_ref().ok_or_else(|| needs("file", "`file = \"log.csv\"`", spec))?;
        let file = resolver.path(file)?;
        let delimiter = delimiter(&mut spec.value.delimiter, resolver)?;
        let columns = spec.columns.as_ref().ok_or_else(|| needs("columns", "a table `columns`", spec))?;
        if join == JoinKind::Name && columns.frame.is_none() {
            return Err(resolver
                .error(columns, "`join = \"name\"` needs the column that names the frame")
                .help("add `frame = \"<column>\"` to [georeference.log.columns]"));
        }
        if join != JoinKind::Name {
            let because = format!("frames are joined by time (`join = \"{}\"`)", join.word());
            resolver.unused(&columns.frame, "frame", &because)?;
            if columns.time.is_none() {
                return Err(resolver
                    .error(columns, format!("`join = \"{}\"` needs the log's time column", join.word()))
                    .help("add `time = { column = \"<column>\", format = \"iso8601\" }` to [georeference.log.columns]"));
            }
        }
        return Ok(LogSource::Table(Box::new(columns::resolve(file, delimiter, columns, spec, resolver)?)));
    }
    resolver.unused(&spec.columns, "columns", &is)?;
    resolver.unused(&spec.delimiter, "delimiter", &is)?;
    match &spec.height_datum {
        Some(datum) if datum.needs_zero() && spec.takeoff_height.is_none() => {
            return Err(resolver
                .error(datum, format!("heights {} need the height of their zero", datum.words()))
                .help(
                    "add `takeoff_height = { value = \"... m\", datum = \"egm96\" }` to [georeference.log]",
                ));
        }
        _ => {}
    }
    if format.value == LogFormat::Photos {
        resolver.unused(
            &spec.file,
            "file",
            "the photos themselves hold the poses (`format = \"photos\"`)",
        )?;
        nothing_of_a_file(spec, &is, resolver)?;
        resolver.unused(&spec.position_crs, "position_crs", "photos state latitude and longitude")?;
        return Ok(LogSource::Photos);
    }
    let tabular = matches!(format.value, LogFormat::Geoinfo | LogFormat::OdmGeo | LogFormat::Orientation);
    if !tabular {
        resolver.unused(&spec.angles, "angles", &is)?;
        resolver.unused(&spec.angle_unit, "angle_unit", &is)?;
    }
    if !matches!(format.value, LogFormat::Geoinfo | LogFormat::Orientation) {
        resolver.unused(&spec.column_order, "column_order", &is)?;
    }
    if !matches!(format.value, LogFormat::Orientation | LogFormat::Opensfm) {
        resolver.unused(&spec.offset_file, "offset_file", &is)?;
    }
    if format.value != LogFormat::Opensfm {
        resolver.unused(&spec.reference_file, "reference_file", &is)?;
    }
    let file = spec.file.as_ref().ok_or_else(|| needs("file", "`file = \"...\"`", spec))?;
    let path = |file: &Option<Located<PathBuf>>| file.as_ref().map(|file| resolver.path(file)).transpose();
    Ok(LogSource::File {
        file: resolver.path(file)?,
        format: format.value,
        stated: Box::new(StatedOfFile {
            angles: spec.angles.as_ref().map(|angles| angles.value),
            angle_unit: spec.angle_unit.as_ref().map_or(AngleUnit::Deg, |unit| unit.value),
            column_order: spec.column_order.clone(),
            offset_file: path(&spec.offset_file)?,
            reference_file: path(&spec.reference_file)?,
        }),
    })
}

fn join(
    spec: &mut LogSpec,
    kind: JoinKind,
    source: &LogSource,
    frames: &mut Option<Located<FramesSpec>>,
    resolver: &Resolver,
) -> Result<Join, ConfigError> {
    if kind == JoinKind::Name {
        let because = "frames are joined by name (`join = \"name\"`)";
        resolver.unused(&spec.max_gap, "max_gap", because)?;
        resolver.unused(&spec.clock_offset, "clock_offset", because)?;
        resolver.unused(&spec.clock_offset_std, "clock_offset_std", because)?;
        resolver.unused(&spec.anchor, "anchor", because)?;
        resolver.unused(frames, "[georeference.frames]", because)?;
        return Ok(Join::Name);
    }
    let max_gap = spec.max_gap.get_or_insert_with(|| Located::unplaced(Duration::new(1.0)));
    if max_gap.seconds() <= 0.0 {
        return Err(resolver.error(max_gap, format!("`max_gap` is {}; it must be above 0", max_gap.value)));
    }
    let max_gap_s = max_gap.seconds();
    if frames.is_none()
        && kind == JoinKind::Time
        && let LogSource::Table(log) = source
        && log.time.as_ref().is_some_and(|time| !time.format.is_utc())
    {
        return Err(resolver
            .error(
                spec.join.as_ref().unwrap_or(&Located::unplaced(kind)),
                "`join = \"time\"` needs to know when each frame was taken on the log's clock, which is not UTC",
            )
            .help("add a table [georeference.frames] with `file` and `columns = { frame = \"...\", time = { column = \"...\", format = \"...\" } }`, or align the photos' own times with `join = \"match\"`"));
    }
    let frames = frame_times(source, kind, frames, resolver)?;
    if kind == JoinKind::Time {
        resolver.unused(&spec.clock_offset_std, "clock_offset_std", "frames are joined by time")?;
        resolver.unused(&spec.anchor, "anchor", "frames are joined by time")?;
        let offset_stated = spec.clock_offset.is_some();
        let clock_offset = spec.clock_offset.get_or_insert_with(|| Located::unplaced(Duration::new(0.0)));
        return Ok(Join::Time { max_gap_s, clock_offset_s: clock_offset.seconds(), offset_stated, frames });
    }
    if spec.clock_offset.is_some() {
        resolver.unused(&spec.anchor, "anchor", "`clock_offset` says how the clocks stand to each other")?;
    }
    let clock = match (&spec.clock_offset, &spec.clock_offset_std) {
        (None, None) => spec.anchor.clone().map_or(StatedClock::Unknown, StatedClock::Anchor),
        (None, Some(std)) => {
            return Err(resolver
                .error(std, "`clock_offset_std` says how well a `clock_offset` is known, and there is none")
                .help("add `clock_offset`, or remove `clock_offset_std`"));
        }
        (Some(_), Some(std)) if std.seconds() <= 0.0 => {
            return Err(resolver.error(std, "`clock_offset_std` must be above 0"));
        }
        (Some(offset), std) => StatedClock::Offset {
            offset_s: offset.seconds(),
            std_s: std.as_ref().map_or(1.0, |std| std.seconds()),
        },
    };
    Ok(Join::Match { max_gap_s, clock, frames })
}

/// When frames were taken: by their table, or by themselves.
fn frame_times(
    source: &LogSource,
    join: JoinKind,
    frames: &mut Option<Located<FramesSpec>>,
    resolver: &Resolver,
) -> Result<FrameTimes, ConfigError> {
    let Some(frames) = frames else { return Ok(FrameTimes::Photos { utc_offset_s: None }) };
    let Some(file) = &frames.file else {
        let because = "without `file` the photos themselves say when they were taken";
        resolver.unused(&frames.delimiter, "delimiter", because)?;
        resolver.unused(&frames.columns, "columns", because)?;
        let utc_offset_s = frames.utc_offset.as_ref().map(|offset| offset.seconds());
        if let Some(offset) = &frames.utc_offset
            && offset.seconds().abs() > 14.0 * 3600.0
        {
            return Err(resolver.error(offset, "`utc_offset` lies beyond ±14 h, where no zone is"));
        }
        return Ok(FrameTimes::Photos { utc_offset_s });
    };
    let file = resolver.path(file)?;
    resolver.unused(&frames.utc_offset, "utc_offset", "the frames' table states the times")?;
    let delimiter = delimiter(&mut frames.value.delimiter, resolver)?;
    let columns = frames.columns.as_ref().ok_or_else(|| {
        resolver
            .error(frames, "the frames' table needs `columns`")
            .help("add `columns = { frame = \"...\", time = { column = \"...\", format = \"...\" } }`")
    })?;
    // Aligning two series finds the offset between their clocks; interpolating needs them to be one.
    if let (JoinKind::Time, LogSource::Table(log)) = (join, source)
        && let Some(time) = &log.time
    {
        let (log_clock, frame_clock) = (time.format.clock(), columns.time.format.clock());
        if log_clock != frame_clock {
            return Err(resolver
                .error(
                    &columns.time,
                    format!("the frames' times count on {frame_clock}, the log's on {log_clock}"),
                )
                .help("give both tables times on the same clock, or align them with `join = \"match\"`"));
        }
    }
    Ok(FrameTimes::Table(Box::new(FrameTable {
        file,
        delimiter,
        frame: columns.frame.clone(),
        time: columns.time.value.clone(),
    })))
}

/// A course stands for the nose only with a statement of how far off it may be.
fn crab(
    spec: &Located<LogSpec>,
    heading: Option<YawReference>,
    resolver: &Resolver,
) -> Result<Option<f64>, ConfigError> {
    let is_course = heading == Some(YawReference::Course);
    match &spec.crab_std {
        Some(crab) if crab.radians() < 0.0 => Err(resolver.error(crab, "`crab_std` is negative")),
        Some(crab) if is_course => Ok(Some(crab.radians())),
        Some(_) => resolver
            .unused(&spec.crab_std, "crab_std", "yaw is not declared to be the course over ground")
            .map(|()| None),
        None if is_course => Err(resolver
            .error(spec, "yaw is the course over ground: how far the nose may be off it must be stated")
            .help("add `crab_std = \"10 deg\"` to [georeference.log] (one standard deviation; wind of a third of the air speed makes 20 deg)")),
        None => Ok(None),
    }
}

impl TimeFormat {
    /// Whether its values are instants of UTC.
    pub fn is_utc(self) -> bool {
        matches!(self, Self::Iso8601 | Self::UnixSeconds)
    }
}
