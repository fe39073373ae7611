//! `[georeference]`: the frames, their log, how the camera is mounted, and the ground it looks at.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::{ConfigError, Resolver};
use super::height::{Height, VerticalDatum};
use super::log::columns::{ColumnsSpec, TableLog};
use super::log::{self, FramesSpec, Log, LogSpec};
use super::quantity::{Angle, Length};
use super::source::Located;

/// `[georeference]` as written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GeoreferenceSpec {
    /// Folder of the frames (JPEG, PNG or TIFF).
    pub images: Located<PathBuf>,
    /// CRS of the products: "auto" (the survey's UTM zone on WGS 84), "EPSG:32617", WKT or a PROJ string. Default "auto".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crs: Option<Located<String>>,
    /// Extra products beside the frames' table and footprints.
    #[serde(default)]
    pub products: Vec<GeoreferenceProduct>,
    /// Ground farther from the camera than this is cut off (frames that see the horizon). Default: 20 times the height above ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub footprint_max_range: Option<Located<Length>>,
    /// The log of the attitude-and-position unit.
    pub log: Located<LogSpec>,
    /// When each frame was taken; only with `log.join = "time"` and "match". Default: as the photos say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<Located<FramesSpec>>,
    /// How the camera is mounted. Required with a table of the log; other logs may hold the camera's own pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<Located<MountSpec>>,
    /// The ground the frames show.
    pub ground: Located<GroundSpec>,
    /// Where geoid undulations come from. Default: PROJ's installed grids.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geoid: Option<GeoidSpec>,
    /// Limits beyond which a frame is rejected.
    #[serde(default)]
    pub limits: LimitsSpec,
}

/// An extra product of the stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GeoreferenceProduct {
    /// One orthorectified GeoTIFF per frame.
    Orthos,
}

/// `[georeference.mount]`: from the antenna to the camera.
///
/// Body axes: x to the nose, y to the right wing, z down. Gimbal axes: x along the optical axis, y to the right of the
/// image, z to its bottom. Pan is positive clockwise seen from above, elevation positive up from the nose's plane, roll
/// positive clockwise seen along the optical axis; body_from_gimbal = Rz(pan)·Ry(elevation)·Rx(roll). With pan 0 and
/// elevation -90° the top of the image points to the nose.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MountSpec {
    /// Position of the antenna (the log's position) in the body. Default zero.
    #[serde(default)]
    pub antenna_in_body: LeverArmSpec,
    /// Position of the gimbal's centre in the body. Default zero.
    #[serde(default)]
    pub gimbal_in_body: LeverArmSpec,
    /// Position of the camera's projection centre in the gimbal's axes (forward = optical axis). Default zero.
    #[serde(default)]
    pub camera_in_gimbal: LeverArmSpec,
    /// What the gimbal angles are measured against. Required when a gimbal angle comes from the log. Default "body".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_reference: Option<Located<GimbalReference>>,
    /// Fixed pan, positive clockwise seen from above. Default "0 deg".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_pan: Option<Located<Angle>>,
    /// Fixed elevation, positive up: "-90 deg" looks straight down.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_elevation: Option<Located<Angle>>,
    /// The same angle, positive down: "90 deg" looks straight down.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_tilt_down: Option<Located<Angle>>,
    /// Fixed roll, positive clockwise seen along the optical axis. Default "0 deg".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gimbal_roll: Option<Located<Angle>>,
    /// Small constant rotation of the mount against the body: Rz(yaw)·Ry(pitch)·Rx(roll) before the gimbal's. Default zero.
    #[serde(default)]
    pub boresight: BoresightSpec,
    /// Clockwise turn of the stored pixels of every frame against the sensor. Default "none".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixel_rotation: Option<Located<PixelRotation>>,
    /// Frames whose stored pixels were turned, by a photo viewer for example.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub turned_frames: Vec<TurnedFrames>,
}

/// Frames whose stored pixels were turned after the camera wrote them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurnedFrames {
    /// File names of the frames.
    pub frames: Vec<Located<String>>,
    /// How far their pixels were turned clockwise.
    pub clockwise: PixelRotation,
}

/// A lever arm by its components.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LeverArmSpec {
    /// Along x. Default "0 m".
    pub forward: Length,
    /// Along y. Default "0 m".
    pub right: Length,
    /// Along z. Default "0 m".
    pub down: Length,
}

impl Default for LeverArmSpec {
    fn default() -> Self {
        Self { forward: Length::new(0.0), right: Length::new(0.0), down: Length::new(0.0) }
    }
}

/// Boresight angles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BoresightSpec {
    /// About z, positive clockwise seen from above. Default "0 deg".
    pub yaw: Angle,
    /// About y, positive nose up. Default "0 deg".
    pub pitch: Angle,
    /// About x, positive right wing down. Default "0 deg".
    pub roll: Angle,
}

impl Default for BoresightSpec {
    fn default() -> Self {
        Self { yaw: Angle::new(0.0), pitch: Angle::new(0.0), roll: Angle::new(0.0) }
    }
}

/// What gimbal angles are measured against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GimbalReference {
    /// The airframe.
    Body,
    /// True north and the horizon (a stabilised gimbal that reports absolute angles).
    Nav,
}

/// Clockwise turn of the stored pixels against the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum PixelRotation {
    /// Stored as taken.
    #[serde(rename = "none")]
    None,
    /// A quarter turn clockwise.
    #[serde(rename = "90")]
    Quarter,
    /// Half a turn.
    #[serde(rename = "180")]
    Half,
    /// A quarter turn counterclockwise.
    #[serde(rename = "270")]
    ThreeQuarters,
}

/// `[georeference.ground]` as written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GroundSpec {
    /// What the ground is: a level surface, a level surface under each camera, or a raster of heights.
    pub kind: Located<GroundKind>,
    /// With "plane": its height.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<Located<Length>>,
    /// With "plane" and "dem": what the heights are measured from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub datum: Option<Located<VerticalDatum>>,
    /// With "below_camera": height of every camera above the ground, unless the log has a column for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_above_ground: Option<Located<Length>>,
    /// With "dem": the raster, in any format GDAL reads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<Located<PathBuf>>,
    /// With "dem": height of a level surface where the raster has no data or ends. Without it such places have no ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fallback_height: Option<Located<Length>>,
}

/// Kind of ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroundKind {
    /// A surface of constant height above its datum.
    Plane,
    /// A level surface at a stated height below each camera.
    BelowCamera,
    /// A raster of heights.
    Dem,
}

/// `[georeference.geoid]`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GeoidSpec {
    /// Height of the geoid (mean sea level) above the ellipsoid in the survey's area, for example "-35.82 m".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub undulation: Option<Located<Length>>,
    /// Whether PROJ may fetch a missing geoid grid from the network. Default false: results do not depend on it.
    #[serde(default)]
    pub network: bool,
}

/// `[georeference.limits]`.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitsSpec {
    /// Frames whose optical axis is farther from straight down than this are rejected. Default: no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_off_nadir: Option<Located<Angle>>,
}

/// `[georeference]`, resolved.
#[derive(Debug, Clone)]
pub struct Georeference {
    /// The table's place.
    pub table: Located<()>,
    /// Folder of the frames.
    pub images: Located<PathBuf>,
    /// CRS of the products.
    pub crs: Located<Crs>,
    /// Whether every frame gets an orthorectified GeoTIFF.
    pub orthos: bool,
    /// Longest range of ground from the camera, metres; `None`: 20 times the height above ground.
    pub footprint_max_range_m: Option<f64>,
    /// The log.
    pub log: Log,
    /// How the camera is mounted.
    pub mount: Mount,
    /// The ground.
    pub ground: Ground,
    /// Constant height of the geoid above the ellipsoid, metres, instead of a grid.
    pub geoid_undulation_m: Option<f64>,
    /// Whether PROJ may fetch grids from the network.
    pub network: bool,
    /// Largest angle of the optical axis from straight down, radians.
    pub max_off_nadir_rad: Option<f64>,
}

/// CRS of the products.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Crs {
    /// The UTM zone of the survey, WGS 84.
    Auto,
    /// What the user wrote: EPSG code, WKT or PROJ string.
    Given(String),
}

/// From the antenna to the camera.
#[derive(Debug, Clone)]
pub struct Mount {
    /// The table's place.
    pub table: Located<()>,
    /// Antenna in body axes.
    pub antenna_in_body: LeverArm,
    /// Gimbal's centre in body axes.
    pub gimbal_in_body: LeverArm,
    /// Camera's projection centre in gimbal axes.
    pub camera_in_gimbal: LeverArm,
    /// What the gimbal angles are measured against.
    pub gimbal_reference: GimbalReference,
    /// Pan, positive clockwise seen from above.
    pub pan: GimbalAngle,
    /// Elevation, positive up.
    pub elevation: GimbalAngle,
    /// Roll, positive clockwise seen along the optical axis.
    pub roll: GimbalAngle,
    /// Boresight angles.
    pub boresight: Boresight,
    /// Clockwise turn of the stored pixels of every frame (per-frame turns add to it).
    pub pixel_rotation: PixelRotation,
    /// Frames with a turn of their own.
    pub turned_frames: Vec<TurnedFrames>,
}

/// A lever arm, metres along the axes of the frame its name ends with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeverArm {
    /// Along x.
    pub forward_m: f64,
    /// Along y.
    pub right_m: f64,
    /// Along z.
    pub down_m: f64,
}

impl LeverArm {
    fn is_zero(self) -> bool {
        [self.forward_m, self.right_m, self.down_m] == [0.0; 3]
    }
}

impl From<LeverArmSpec> for LeverArm {
    fn from(spec: LeverArmSpec) -> Self {
        Self { forward_m: spec.forward.metres(), right_m: spec.right.metres(), down_m: spec.down.metres() }
    }
}

/// One angle of the gimbal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GimbalAngle {
    /// The same for every frame, radians.
    Fixed(f64),
    /// From the log.
    Logged,
}

/// Boresight angles, radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boresight {
    /// About z.
    pub yaw_rad: f64,
    /// About y.
    pub pitch_rad: f64,
    /// About x.
    pub roll_rad: f64,
}

/// The ground the frames show.
#[derive(Debug, Clone)]
pub enum Ground {
    /// A surface of constant height above its datum.
    Plane(Height),
    /// A level surface below each camera.
    BelowCamera(HeightAboveGround),
    /// A raster of heights.
    Dem {
        /// The raster.
        file: Located<PathBuf>,
        /// What its heights (and the fallback) are measured from.
        datum: VerticalDatum,
        /// Height where the raster has none, metres; `None`: no ground there.
        fallback_m: Option<f64>,
    },
}

impl Ground {
    /// What the stated heights of the ground are measured from; `None` where none is stated.
    pub fn datum(&self) -> Option<VerticalDatum> {
        match self {
            Self::Plane(height) => Some(height.datum),
            Self::Dem { datum, .. } => Some(*datum),
            Self::BelowCamera(_) => None,
        }
    }
}

/// Height of the camera above the ground below it.
#[derive(Debug, Clone)]
pub enum HeightAboveGround {
    /// The same for every frame, metres.
    Fixed(f64),
    /// From the log.
    Logged,
}

pub(super) fn resolve(
    spec: &mut Located<GeoreferenceSpec>,
    resolver: &Resolver,
) -> Result<Georeference, ConfigError> {
    let table = Located { value: (), span: spec.span.clone() };
    let spec = &mut spec.value;
    let crs = spec.crs.get_or_insert_with(|| Located::unplaced("auto".to_owned()));
    if crs.trim().is_empty() {
        return Err(resolver
            .error(crs, "`crs` is empty")
            .help("write \"auto\", \"EPSG:32617\", WKT or a PROJ string"));
    }
    let crs = crs.clone().map(|text| if text == "auto" { Crs::Auto } else { Crs::Given(text) });
    let log = log::resolve(&mut spec.log, &mut spec.frames, resolver)?;
    let mount = mount(&mut spec.mount, &spec.log, &log, resolver)?;
    let ground = ground(&spec.ground, &spec.log, &log, resolver)?;
    let footprint_max_range_m = match &spec.footprint_max_range {
        Some(range) if range.metres() <= 0.0 => {
            return Err(resolver
                .error(range, format!("`footprint_max_range` is {}; it must be above 0", range.value)));
        }
        range => range.as_ref().map(|range| range.metres()),
    };
    let max_off_nadir_rad = match &spec.limits.max_off_nadir {
        Some(angle) if !(0.0..=std::f64::consts::PI).contains(&angle.radians()) => {
            return Err(resolver
                .error(angle, format!("`max_off_nadir` is {}; it lies between 0 and 180 deg", angle.value)));
        }
        angle => angle.as_ref().map(|angle| angle.radians()),
    };
    Ok(Georeference {
        table,
        images: resolver.path(&spec.images)?,
        crs,
        orthos: spec.products.contains(&GeoreferenceProduct::Orthos),
        footprint_max_range_m,
        log,
        mount,
        ground,
        geoid_undulation_m: spec
            .geoid
            .as_ref()
            .and_then(|geoid| geoid.undulation.as_ref())
            .map(|undulation| undulation.metres()),
        network: spec.geoid.as_ref().is_some_and(|geoid| geoid.network),
        max_off_nadir_rad,
    })
}

/// The mount with a declared table: every gimbal angle is fixed or a column.
/// With any other log: what is stated is used; what is not is the log's.
fn mount(
    written: &mut Option<Located<MountSpec>>,
    log_spec: &Located<LogSpec>,
    log: &Log,
    resolver: &Resolver,
) -> Result<Mount, ConfigError> {
    if written.is_none() && log.as_table().is_some() {
        return Err(resolver
            .error(log_spec, "the pipeline does not say how the camera is mounted")
            .help("add a table [georeference.mount] with `gimbal_elevation = \"-90 deg\"` (straight down)"));
    }
    let spec = written.get_or_insert_with(|| Located::unplaced(MountSpec::default()));
    let table = Located { value: (), span: spec.span.clone() };
    let [pan, elevation, roll] = match log.as_table() {
        Some(columns) => table_angles(spec, columns, resolver)?,
        None => log_angles(spec, resolver)?,
    };
    let resolved = Mount {
        table,
        antenna_in_body: spec.antenna_in_body.into(),
        gimbal_in_body: spec.gimbal_in_body.into(),
        camera_in_gimbal: spec.camera_in_gimbal.into(),
        gimbal_reference: spec
            .gimbal_reference
            .as_ref()
            .map_or(GimbalReference::Body, |reference| reference.value),
        pan,
        elevation,
        roll,
        boresight: Boresight {
            yaw_rad: spec.boresight.yaw.radians(),
            pitch_rad: spec.boresight.pitch.radians(),
            roll_rad: spec.boresight.roll.radians(),
        },
        pixel_rotation: spec.pixel_rotation.as_ref().map_or(PixelRotation::None, |rotation| rotation.value),
        turned_frames: spec.turned_frames.clone(),
    };
    if let (Some(columns), Some(place)) = (log.as_table(), &log_spec.columns)
        && columns.attitude.is_none()
    {
        needs_no_attitude(&resolved, place, resolver)?;
    }
    let filled = &mut spec.value;
    filled.gimbal_reference.get_or_insert_with(|| Located::unplaced(GimbalReference::Body));
    filled.pixel_rotation.get_or_insert_with(|| Located::unplaced(PixelRotation::None));
    Ok(resolved)
}

/// Elevation as stated, under either of its names: the key, radians up, the name.
type StatedElevation<'s> = (&'s Located<Angle>, f64, &'static str);

fn stated_elevation<'s>(
    spec: &'s MountSpec,
    resolver: &Resolver,
) -> Result<Option<StatedElevation<'s>>, ConfigError> {
    match (&spec.gimbal_elevation, &spec.gimbal_tilt_down) {
        (Some(_), Some(tilt)) => Err(resolver
            .error(tilt, "`gimbal_tilt_down` and `gimbal_elevation` state the same angle")
            .help("keep one of the two: elevation is positive up, tilt_down positive down")),
        (Some(elevation), None) => Ok(Some((elevation, elevation.radians(), "gimbal_elevation"))),
        (None, Some(tilt)) => Ok(Some((tilt, -tilt.radians(), "gimbal_tilt_down"))),
        (None, None) => Ok(None),
    }
}

fn table_angles(
    spec: &Located<MountSpec>,
    columns: &TableLog,
    resolver: &Resolver,
) -> Result<[GimbalAngle; 3], ConfigError> {
    if columns.has_gimbal() && spec.gimbal_reference.is_none() {
        return Err(resolver
            .error(spec, "gimbal angles of the log need to say what they are measured against")
            .help("add `gimbal_reference = \"body\"` (angles against the airframe) or \"nav\" (against north and the horizon)"));
    }
    let fixed_or_column =
        |fixed: Option<(&Located<Angle>, f64)>, is_column: bool, key: &str| match (fixed, is_column) {
            (Some((key_there, _)), true) => Err(resolver
                .error(key_there, format!("`{key}` is given here and as a column of the log"))
                .help("keep one of the two")),
            (_, true) => Ok(GimbalAngle::Logged),
            (fixed, false) => Ok(GimbalAngle::Fixed(fixed.map_or(0.0, |(_, radians)| radians))),
        };
    let (elevation, name) = match stated_elevation(spec, resolver)? {
        Some((key, radians, name)) => (Some((key, radians)), name),
        None => (None, "gimbal_elevation"),
    };
    if elevation.is_none() && columns.gimbal_elevation.is_none() {
        return Err(resolver
            .error(spec, "the mount does not say where the camera looks")
            .help("add `gimbal_elevation = \"-90 deg\"` (straight down), `gimbal_tilt_down`, or a column gimbal_elevation of the log"));
    }
    fn stated(angle: &Option<Located<Angle>>) -> Option<(&Located<Angle>, f64)> {
        angle.as_ref().map(|angle| (angle, angle.radians()))
    }
    Ok([
        fixed_or_column(stated(&spec.gimbal_pan), columns.gimbal_pan.is_some(), "gimbal_pan")?,
        fixed_or_column(elevation, columns.gimbal_elevation.is_some(), name)?,
        fixed_or_column(stated(&spec.gimbal_roll), columns.gimbal_roll.is_some(), "gimbal_roll")?,
    ])
}

/// Of a log whose contents the pipeline file does not list: an elevation stated here stands for whatever it logs.
fn log_angles(spec: &Located<MountSpec>, resolver: &Resolver) -> Result<[GimbalAngle; 3], ConfigError> {
    let Some((_, elevation, _)) = stated_elevation(spec, resolver)? else {
        let because = "without `gimbal_elevation` the gimbal angles are the log's";
        resolver.unused(&spec.gimbal_pan, "gimbal_pan", because)?;
        resolver.unused(&spec.gimbal_roll, "gimbal_roll", because)?;
        resolver.unused(&spec.gimbal_reference, "gimbal_reference", because)?;
        return Ok([GimbalAngle::Logged; 3]);
    };
    let fixed = |angle: &Option<Located<Angle>>| {
        GimbalAngle::Fixed(angle.as_ref().map_or(0.0, |angle| angle.radians()))
    };
    Ok([fixed(&spec.gimbal_pan), GimbalAngle::Fixed(elevation), fixed(&spec.gimbal_roll)])
}

/// Only a stabilised camera without lever arms in the body does without the body's attitude.
fn needs_no_attitude(
    mount: &Mount,
    columns: &Located<ColumnsSpec>,
    resolver: &Resolver,
) -> Result<(), ConfigError> {
    let stabilised = mount.gimbal_reference == GimbalReference::Nav;
    let lever_arm = !mount.antenna_in_body.is_zero() || !mount.gimbal_in_body.is_zero();
    if stabilised && !lever_arm {
        return Ok(());
    }
    let why = if stabilised { "a lever arm in the body needs it" } else { "the camera turns with the body" };
    Err(resolver
        .error(columns, format!("the log's columns hold no attitude (yaw, pitch, roll): {why}"))
        .help("declare the columns yaw, pitch and roll with unit and sense"))
}

fn ground(
    spec: &Located<GroundSpec>,
    log_spec: &LogSpec,
    log: &Log,
    resolver: &Resolver,
) -> Result<Ground, ConfigError> {
    let missing = |key: &str, example: &str| {
        let kind = format!("{:?}", toml_name(spec.kind.value));
        resolver
            .error(&spec.kind, format!("ground of kind {kind} needs `{key}`"))
            .help(format!("add `{key} = \"{example}\"` to [georeference.ground]"))
    };
    let kind_is = format!("the ground's kind is \"{}\"", toml_name(spec.kind.value));
    let wanted = |key: &str| match spec.kind.value {
        GroundKind::Plane => matches!(key, "height" | "datum"),
        GroundKind::BelowCamera => key == "height_above_ground",
        GroundKind::Dem => matches!(key, "file" | "datum" | "fallback_height"),
    };
    if !wanted("height") {
        resolver.unused(&spec.height, "height", &kind_is)?;
    }
    if !wanted("datum") {
        resolver.unused(&spec.datum, "datum", &kind_is)?;
    }
    if !wanted("height_above_ground") {
        resolver.unused(&spec.height_above_ground, "height_above_ground", &kind_is)?;
        if let Some(columns) = &log_spec.columns {
            resolver.unused(&columns.height_above_ground, "height_above_ground", &kind_is)?;
        }
    }
    if !wanted("file") {
        resolver.unused(&spec.file, "file", &kind_is)?;
        resolver.unused(&spec.fallback_height, "fallback_height", &kind_is)?;
    }
    match spec.kind.value {
        GroundKind::Plane => {
            let height = spec.height.as_ref().ok_or_else(|| missing("height", "254.4 m"))?;
            let datum = spec.datum.as_ref().ok_or_else(|| missing("datum", "egm96"))?;
            Ok(Ground::Plane(Height { metres: height.metres(), datum: datum.value }))
        }
        GroundKind::Dem => {
            let file = spec.file.as_ref().ok_or_else(|| missing("file", "dem.tif"))?;
            let datum = spec.datum.as_ref().ok_or_else(|| missing("datum", "egm96"))?;
            let fallback_m = spec.fallback_height.as_ref().map(|height| height.metres());
            Ok(Ground::Dem { file: resolver.path(file)?, datum: datum.value, fallback_m })
        }
        GroundKind::BelowCamera if log.is_above_ground() => Err(resolver
            .error(&spec.kind, "the log's height is above the ground and the ground is below the camera: neither has a height of its own")
            .help("state the ground's height (kind = \"plane\" or \"dem\"), or declare a height column of another datum")),
        GroundKind::BelowCamera => {
            // A log whose contents are not listed here may state it for every frame.
            let logged = log.as_table().is_none_or(|columns| columns.height_above_ground.is_some());
            match (&spec.height_above_ground, logged) {
                (Some(height), _) if height.metres() <= 0.0 => Err(resolver
                    .error(height, format!("`height_above_ground` is {}; it must be above 0", height.value))),
                (Some(height), true) if log.as_table().is_some() => Err(resolver
                    .error(height, "`height_above_ground` is given here and as a column of the log")
                    .help("keep one of the two")),
                (Some(height), _) => Ok(Ground::BelowCamera(HeightAboveGround::Fixed(height.metres()))),
                (None, true) => Ok(Ground::BelowCamera(HeightAboveGround::Logged)),
                (None, false) => Err(missing("height_above_ground", "120 m")),
            }
        }
    }
}

fn toml_name(kind: GroundKind) -> &'static str {
    match kind {
        GroundKind::Plane => "plane",
        GroundKind::BelowCamera => "below_camera",
        GroundKind::Dem => "dem",
    }
}
