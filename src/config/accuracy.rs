//! `[accuracy]`: the spread of what was measured, and what is to be said about the products.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::calibrate::PixelOrigin;
use super::error::{ConfigError, Resolver};
use super::height::VerticalDatum;
use super::log::Log;
use super::log::columns::{CoordinateColumnSpec, HeightColumnSpec, LengthColumnSpec, NumberColumn};
use super::quantity::{Angle, Duration, Length, PixelLength};
use super::source::Located;

/// `[accuracy]` as written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AccuracySpec {
    /// Probability of the intervals stated for lengths. Default 0.95.
    #[serde(default = "default_confidence")]
    pub confidence: Located<f64>,
    /// Spread (1σ unless the key says otherwise) of everything measured.
    pub sigmas: Located<SigmasSpec>,
    /// The error map of one frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub monte_carlo: Option<Located<MonteCarloSpec>>,
    /// Lengths between picked pixels.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths: Vec<Located<LengthCheckSpec>>,
    /// Points of known position, used only to judge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub check_points: Option<Located<CheckPointsSpec>>,
    /// What the products have to reach.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requirement: Option<RequirementSpec>,
}

fn default_confidence() -> Located<f64> {
    Located::unplaced(0.95)
}

/// `[accuracy.sigmas]`: 1σ of each measurement.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SigmasSpec {
    /// Horizontal position of the antenna: exactly one of `cep`, `std`, `r95`.
    pub position: Located<HorizontalSpreadSpec>,
    /// Height of the antenna.
    pub height: Located<Length>,
    /// Roll of the body.
    pub roll: Located<Angle>,
    /// Pitch of the body.
    pub pitch: Located<Angle>,
    /// Yaw of the body.
    pub yaw: Located<Angle>,
    /// Boresight angles. Default zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boresight: Option<BoresightSigmasSpec>,
    /// Each of the gimbal's angles. Default "0 deg".
    #[serde(default = "no_angle")]
    pub gimbal: Located<Angle>,
    /// Time between exposure and pose. Needs the speed: a column ground_speed, velocity or time of the log. Default "0 s".
    #[serde(default = "no_duration")]
    pub time: Located<Duration>,
    /// Each component of the whole arm from the antenna to the camera. Default "0 m".
    #[serde(default = "no_length")]
    pub lever_arm: Located<Length>,
    /// Height of the ground. Default "0 m".
    #[serde(default = "no_length")]
    pub ground_height: Located<Length>,
    /// Each coordinate of a picked pixel. Default "0 px".
    #[serde(default = "no_pixels")]
    pub picking: Located<PixelLength>,
    /// The camera's parameters. Default "from_calibration".
    #[serde(default)]
    pub camera: CameraSpread,
}

fn no_angle() -> Located<Angle> {
    Located::unplaced(Angle::new(0.0))
}

fn no_duration() -> Located<Duration> {
    Located::unplaced(Duration::new(0.0))
}

fn no_length() -> Located<Length> {
    Located::unplaced(Length::new(0.0))
}

fn no_pixels() -> Located<PixelLength> {
    Located::unplaced(PixelLength::new(0.0))
}

/// A horizontal spread, equal in all directions: exactly one key.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HorizontalSpreadSpec {
    /// Circular error probable: half of the positions lie within this distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cep: Option<Length>,
    /// 1σ of each axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub std: Option<Length>,
    /// 95 % of the positions lie within this distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub r95: Option<Length>,
}

/// 1σ of the boresight angles.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoresightSigmasSpec {
    /// About x.
    pub roll: Located<Angle>,
    /// About y.
    pub pitch: Located<Angle>,
    /// About z.
    pub yaw: Located<Angle>,
}

/// Where the spread of the camera's parameters comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraSpread {
    /// The calibration's covariance.
    #[default]
    FromCalibration,
    /// The camera is taken as exact.
    None,
}

/// `[accuracy.monte_carlo]`: the error on the ground over one frame, from random attitude errors.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MonteCarloSpec {
    /// Draws per grid point. Default 100000.
    #[serde(default = "default_draws")]
    pub draws: Located<u64>,
    /// Columns and rows of grid points over the frame. Default [32, 18].
    #[serde(default = "default_grid")]
    pub grid: Located<[u32; 2]>,
    /// The one angle that is drawn. Default: roll, pitch and yaw together.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<DrawnAngle>,
    /// 1σ of `angle`. Default: that of [accuracy.sigmas].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub std: Option<Located<Angle>>,
    /// File name of the frame. Default: the one nearest the middle of the survey.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<Located<String>>,
}

fn default_draws() -> Located<u64> {
    Located::unplaced(100_000)
}

fn default_grid() -> Located<[u32; 2]> {
    Located::unplaced([32, 18])
}

/// An angle of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DrawnAngle {
    /// Elevation of the gimbal.
    Tilt,
    /// Pan of the gimbal.
    Pan,
    /// Roll of the body.
    Roll,
    /// Pitch of the body.
    Pitch,
    /// Yaw of the body.
    Yaw,
}

/// One `[[accuracy.lengths]]`: a length between two picked pixels.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LengthCheckSpec {
    /// What is measured, for example "runway length".
    pub name: String,
    /// One end.
    pub from: Located<PickSpec>,
    /// The other end.
    pub to: Located<PickSpec>,
    /// The known length, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<Located<Length>>,
}

/// A picked pixel; (0, 0) is the centre of the frame's top-left pixel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PickSpec {
    /// File name of the frame.
    pub frame: Located<String>,
    /// Column, pixels, growing to the right.
    pub column: f64,
    /// Row, pixels, growing downwards.
    pub row: f64,
}

/// `[accuracy.check_points]`: points of known position and where frames show them.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CheckPointsSpec {
    /// Table of the points.
    pub points: Located<PathBuf>,
    /// Columns of `points`.
    pub columns: Located<PointColumnsSpec>,
    /// CRS of the columns easting and northing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crs: Option<Located<String>>,
    /// Table of the points' pixels.
    pub observations: Located<PathBuf>,
    /// Columns of `observations`.
    pub observation_columns: ObservationColumnsSpec,
    /// What pixel (0, 0) means in `observations`.
    pub pixel_origin: PixelOrigin,
    /// Which ground the pixels are laid on: each point's own height, or the ground of [georeference]. Default "point".
    #[serde(default)]
    pub ground: CheckGround,
}

/// Columns of a table of points.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointColumnsSpec {
    /// The point's name.
    pub point: Located<String>,
    /// Latitude, WGS 84.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub latitude: Option<CoordinateColumnSpec>,
    /// Longitude, WGS 84.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longitude: Option<CoordinateColumnSpec>,
    /// Easting in `crs`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub easting: Option<LengthColumnSpec>,
    /// Northing in `crs`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub northing: Option<LengthColumnSpec>,
    /// Height of the point; its datum is "ellipsoid" or "egm96".
    pub height: Located<HeightColumnSpec>,
}

/// Columns of a table of observations.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObservationColumnsSpec {
    /// The point's name.
    pub point: Located<String>,
    /// The frame's file name.
    pub frame: Located<String>,
    /// Column of the pixel, pixels.
    pub column: Located<String>,
    /// Row of the pixel, pixels.
    pub row: Located<String>,
}

/// Which ground the pixels of check points are laid on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CheckGround {
    /// Each point's own height: judges the poses alone.
    #[default]
    Point,
    /// The ground of [georeference]: judges the products.
    Georeference,
}

/// `[accuracy.requirement]`: what the products have to reach.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RequirementSpec {
    /// 90 % of the errors lie within this distance.
    pub ce90: Located<Length>,
}

/// `[accuracy]`, resolved.
#[derive(Debug, Clone)]
pub struct Accuracy {
    /// The table's place.
    pub table: Located<()>,
    /// Probability of stated intervals.
    pub confidence: f64,
    /// Spread of everything measured.
    pub sigmas: Sigmas,
    /// The error map.
    pub monte_carlo: Option<MonteCarlo>,
    /// Lengths between picked pixels.
    pub lengths: Vec<LengthCheck>,
    /// Points of known position.
    pub check_points: Option<CheckPoints>,
    /// CE90 to be reached, metres.
    pub required_ce90_m: Option<f64>,
}

/// 1σ of everything measured, SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sigmas {
    /// Each horizontal axis of the antenna's position, metres.
    pub position_m: f64,
    /// Height of the antenna, metres.
    pub height_m: f64,
    /// Roll of the body, radians.
    pub roll_rad: f64,
    /// Pitch of the body, radians.
    pub pitch_rad: f64,
    /// Yaw of the body, radians.
    pub yaw_rad: f64,
    /// Boresight roll, radians.
    pub boresight_roll_rad: f64,
    /// Boresight pitch, radians.
    pub boresight_pitch_rad: f64,
    /// Boresight yaw, radians.
    pub boresight_yaw_rad: f64,
    /// Each gimbal angle, radians.
    pub gimbal_rad: f64,
    /// Exposure against pose, seconds.
    pub time_s: f64,
    /// Each component of the whole arm from the antenna to the camera, metres.
    pub lever_arm_m: f64,
    /// Height of the ground, metres.
    pub ground_height_m: f64,
    /// Each coordinate of a picked pixel, pixels.
    pub picking_px: f64,
    /// Where the spread of the camera's parameters comes from.
    pub camera: CameraSpread,
}

/// The error map, resolved.
#[derive(Debug, Clone)]
pub struct MonteCarlo {
    /// Draws per grid point.
    pub draws: u64,
    /// Grid points along a row of the frame.
    pub grid_columns: u32,
    /// Grid points along a column of the frame.
    pub grid_rows: u32,
    /// The one angle drawn and its 1σ in radians; `None`: roll, pitch and yaw with their sigmas.
    pub angle: Option<(DrawnAngle, f64)>,
    /// File name of the frame.
    pub frame: Option<Located<String>>,
}

/// A length between picked pixels, resolved.
#[derive(Debug, Clone)]
pub struct LengthCheck {
    /// What is measured.
    pub name: String,
    /// One end.
    pub from: Located<PickSpec>,
    /// The other end.
    pub to: Located<PickSpec>,
    /// The known length, metres.
    pub truth_m: Option<f64>,
}

/// Check points, resolved.
#[derive(Debug, Clone)]
pub struct CheckPoints {
    /// Table of the points.
    pub points: Located<PathBuf>,
    /// Column of the point's name.
    pub point: Located<String>,
    /// Columns of the position.
    pub position: CheckPosition,
    /// Column of the height, metres.
    pub height: NumberColumn,
    /// What the heights are measured from.
    pub height_datum: VerticalDatum,
    /// Table of the pixels.
    pub observations: Located<PathBuf>,
    /// Columns of the pixels.
    pub observation_columns: ObservationColumnsSpec,
    /// What pixel (0, 0) means.
    pub pixel_origin: PixelOrigin,
    /// Which ground the pixels are laid on.
    pub ground: CheckGround,
}

/// Columns of a check point's horizontal position.
#[derive(Debug, Clone)]
pub enum CheckPosition {
    /// WGS 84, radians.
    Geodetic {
        /// Positive north.
        latitude: NumberColumn,
        /// Positive east.
        longitude: NumberColumn,
    },
    /// Map coordinates, metres.
    Projected {
        /// Easting.
        easting: NumberColumn,
        /// Northing.
        northing: NumberColumn,
        /// Their CRS.
        crs: Located<String>,
    },
}

/// Most grid points of an error map: more would not be seen.
const LARGEST_GRID: u32 = 1024;

pub(super) fn resolve(
    spec: &mut Located<AccuracySpec>,
    log: &Log,
    resolver: &Resolver,
) -> Result<Accuracy, ConfigError> {
    let table = Located { value: (), span: spec.span.clone() };
    let confidence = &spec.confidence;
    if !(confidence.value > 0.0 && confidence.value < 1.0) {
        return Err(resolver
            .error(confidence, format!("`confidence` is {}; it lies between 0 and 1", confidence.value)));
    }
    let sigmas = sigmas(&spec.sigmas, log, resolver)?;
    let lengths =
        spec.lengths.iter().map(|length| length_check(length, resolver)).collect::<Result<_, _>>()?;
    let check_points = spec.check_points.as_ref().map(|points| check_points(points, resolver)).transpose()?;
    let required_ce90_m = match &spec.requirement {
        Some(requirement) if requirement.ce90.metres() <= 0.0 => {
            return Err(resolver.error(&requirement.ce90, "`ce90` must be above 0"));
        }
        requirement => requirement.as_ref().map(|requirement| requirement.ce90.metres()),
    };
    Ok(Accuracy {
        table,
        confidence: confidence.value,
        monte_carlo: spec
            .monte_carlo
            .as_ref()
            .map(|spec| monte_carlo(spec, &sigmas, resolver))
            .transpose()?,
        sigmas,
        lengths,
        check_points,
        required_ce90_m,
    })
}

fn sigmas(spec: &Located<SigmasSpec>, log: &Log, resolver: &Resolver) -> Result<Sigmas, ConfigError> {
    fn spread<T>(
        value: &Located<T>,
        name: &str,
        si: impl Fn(&T) -> f64,
        resolver: &Resolver,
    ) -> Result<f64, ConfigError> {
        let number = si(&value.value);
        if number >= 0.0 {
            Ok(number)
        } else {
            Err(resolver.error(value, format!("the sigma `{name}` is negative")))
        }
    }
    let angle = |value: &Located<Angle>, name| spread(value, name, |angle| angle.radians(), resolver);
    let length = |value: &Located<Length>, name| spread(value, name, |length| length.metres(), resolver);
    let time_s = spread(&spec.time, "time", |time| time.seconds(), resolver)?;
    if time_s > 0.0 && !log.may_know_speed() {
        return Err(resolver
            .error(&spec.time, "a spread in time says nothing without the speed")
            .help("declare a column ground_speed, the three velocity columns, or time in [georeference.log.columns]"));
    }
    let boresight = match &spec.boresight {
        Some(boresight) => [
            angle(&boresight.roll, "boresight.roll")?,
            angle(&boresight.pitch, "boresight.pitch")?,
            angle(&boresight.yaw, "boresight.yaw")?,
        ],
        None => [0.0; 3],
    };
    Ok(Sigmas {
        position_m: horizontal_std_m(&spec.position, resolver)?,
        height_m: length(&spec.height, "height")?,
        roll_rad: angle(&spec.roll, "roll")?,
        pitch_rad: angle(&spec.pitch, "pitch")?,
        // A course that stands for the nose is off it by the crab angle as well.
        yaw_rad: angle(&spec.yaw, "yaw")?.hypot(log.crab_std_rad.unwrap_or(0.0)),
        boresight_roll_rad: boresight[0],
        boresight_pitch_rad: boresight[1],
        boresight_yaw_rad: boresight[2],
        gimbal_rad: angle(&spec.gimbal, "gimbal")?,
        time_s,
        lever_arm_m: length(&spec.lever_arm, "lever_arm")?,
        ground_height_m: length(&spec.ground_height, "ground_height")?,
        picking_px: spread(&spec.picking, "picking", |pixels| pixels.pixels(), resolver)?,
        camera: spec.camera,
    })
}

/// 1σ per axis of a circular normal distribution: P(distance ≤ r) = 1 - exp(-r²/2σ²).
fn horizontal_std_m(spec: &Located<HorizontalSpreadSpec>, resolver: &Resolver) -> Result<f64, ConfigError> {
    let radius = |probability: f64| (-2.0 * (1.0 - probability).ln()).sqrt();
    let std = match (spec.cep, spec.std, spec.r95) {
        (Some(cep), None, None) => cep.metres() / radius(0.5),
        (None, Some(std), None) => std.metres(),
        (None, None, Some(r95)) => r95.metres() / radius(0.95),
        _ => {
            return Err(resolver
                .error(spec, "the sigma `position` takes exactly one of cep, std, r95")
                .help("for example `position = { cep = \"3 m\" }`"));
        }
    };
    if std >= 0.0 { Ok(std) } else { Err(resolver.error(spec, "the sigma `position` is negative")) }
}

fn monte_carlo(
    spec: &MonteCarloSpec,
    sigmas: &Sigmas,
    resolver: &Resolver,
) -> Result<MonteCarlo, ConfigError> {
    if spec.draws.value < 100 {
        return Err(
            resolver.error(&spec.draws, format!("`draws` is {}; it must be 100 or more", spec.draws.value))
        );
    }
    let [columns, rows] = spec.grid.value;
    if ![columns, rows].iter().all(|count| (2..=LARGEST_GRID).contains(count)) {
        return Err(resolver.error(
            &spec.grid,
            format!("`grid` is [{columns}, {rows}]; each lies between 2 and {LARGEST_GRID}"),
        ));
    }
    let angle = match (spec.angle, &spec.std) {
        (None, std) => {
            resolver.unused(std, "std", "no single `angle` is drawn")?;
            None
        }
        (Some(_), Some(std)) if std.radians() <= 0.0 => {
            return Err(resolver.error(std, format!("`std` is {}; it must be above 0", std.value)));
        }
        (Some(angle), Some(std)) => Some((angle, std.radians())),
        (Some(angle), None) => Some((
            angle,
            match angle {
                DrawnAngle::Tilt | DrawnAngle::Pan => sigmas.gimbal_rad,
                DrawnAngle::Roll => sigmas.roll_rad,
                DrawnAngle::Pitch => sigmas.pitch_rad,
                DrawnAngle::Yaw => sigmas.yaw_rad,
            },
        )),
    };
    Ok(MonteCarlo {
        draws: spec.draws.value,
        grid_columns: columns,
        grid_rows: rows,
        angle,
        frame: spec.frame.clone(),
    })
}

fn length_check(spec: &Located<LengthCheckSpec>, resolver: &Resolver) -> Result<LengthCheck, ConfigError> {
    for pick in [&spec.from, &spec.to] {
        if !(pick.column.is_finite() && pick.row.is_finite()) {
            return Err(resolver.error(pick, "a picked pixel needs finite column and row"));
        }
    }
    let truth_m = match &spec.truth {
        Some(truth) if truth.metres() <= 0.0 => {
            return Err(resolver.error(truth, format!("`truth` is {}; it must be above 0", truth.value)));
        }
        truth => truth.as_ref().map(|truth| truth.metres()),
    };
    Ok(LengthCheck { name: spec.name.clone(), from: spec.from.clone(), to: spec.to.clone(), truth_m })
}

fn check_points(spec: &Located<CheckPointsSpec>, resolver: &Resolver) -> Result<CheckPoints, ConfigError> {
    let columns = &spec.columns;
    let number = |column: &CoordinateColumnSpec| NumberColumn {
        column: column.column.clone(),
        factor: column.unit.radians(),
    };
    let position = match (&columns.latitude, &columns.longitude, &columns.easting, &columns.northing) {
        (Some(latitude), Some(longitude), None, None) => {
            resolver.unused(&spec.crs, "crs", "latitude and longitude are WGS 84")?;
            CheckPosition::Geodetic { latitude: number(latitude), longitude: number(longitude) }
        }
        (None, None, Some(easting), Some(northing)) => {
            let crs = spec.crs.clone().ok_or_else(|| {
                resolver
                    .error(columns, "easting and northing need their CRS")
                    .help("add `crs = \"EPSG:...\"` to [accuracy.check_points]")
            })?;
            CheckPosition::Projected { easting: easting.number(), northing: northing.number(), crs }
        }
        _ => {
            return Err(resolver
                .error(columns, "check points take either latitude and longitude, or easting and northing")
                .help("declare both columns of one pair, each with its unit"));
        }
    };
    let height_datum = columns.height.datum.absolute().ok_or_else(|| {
        resolver
            .error(&columns.height, "the height of a check point is absolute")
            .help("its datum is \"ellipsoid\", \"egm96\" or \"egm2008\"")
    })?;
    Ok(CheckPoints {
        points: resolver.path(&spec.points)?,
        point: columns.point.clone(),
        position,
        height: NumberColumn { column: columns.height.column.clone(), factor: columns.height.unit.metres() },
        height_datum,
        observations: resolver.path(&spec.observations)?,
        observation_columns: spec.observation_columns.clone(),
        pixel_origin: spec.pixel_origin,
        ground: spec.ground,
    })
}
