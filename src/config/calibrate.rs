//! `[calibrate]`: where the camera comes from.

use std::fmt;
use std::path::PathBuf;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::error::{ConfigError, Resolver};
use super::quantity::Length;
use super::source::Located;

/// `[calibrate]` as written. Exactly one of `camera`, `photos`, `parameters`, `corners`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrateSpec {
    /// A camera file: this program's own JSON (with covariance) or OpenCV's YAML; recognised by its content.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Located<PathBuf>>,
    /// Photos of the calibration target: a pattern such as "calibration/*.png", or a list of patterns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photos: Option<Located<Patterns>>,
    /// The camera's parameters, written out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameters: Option<Located<ParametersSpec>>,
    /// Files of corners that were found elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corners: Option<Located<CornersSpec>>,
    /// The target in the photos. Required with `photos`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<Located<TargetSpec>>,
    /// Which parameters are estimated from `photos` or `corners`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<Located<ModelSpec>>,
}

/// One pattern or a list of patterns of file names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Patterns(pub Vec<String>);

impl<'de> Deserialize<'de> for Patterns {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct PatternsVisitor;
        impl<'de> Visitor<'de> for PatternsVisitor {
            type Value = Patterns;
            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a pattern such as \"calibration/*.png\" or a list of patterns")
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Patterns, E> {
                Ok(Patterns(vec![text.to_owned()]))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Patterns, A::Error> {
                let mut patterns = Vec::new();
                while let Some(pattern) = items.next_element()? {
                    patterns.push(pattern);
                }
                Ok(Patterns(patterns))
            }
        }
        deserializer.deserialize_any(PatternsVisitor)
    }
}

impl JsonSchema for Patterns {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Patterns".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "oneOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" }, "minItems": 1 }] })
    }
}

/// Where pixel (0, 0) lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PixelOrigin {
    /// (0, 0) is the centre of the top-left pixel, as everywhere inside this program.
    Centre,
    /// (0, 0) is the outer corner of the top-left pixel, whose centre is then (0.5, 0.5).
    Corner,
}

impl PixelOrigin {
    /// What to add to a written column or row so that (0, 0) is the centre of the top-left pixel. Pixels.
    pub fn offset_to_centre_px(self) -> f64 {
        match self {
            Self::Centre => 0.0,
            Self::Corner => -0.5,
        }
    }
}

/// `[calibrate.parameters]`: pixel units are plain numbers in keys ending `_px`.
///
/// The model is u = fx·x + skew·y + cx, v = fy·y + cy on distorted x, y (Brown: k1, k2, k3 radial, p1, p2 tangential,
/// in the order and signs of OpenCV).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParametersSpec {
    /// Width of the frames, pixels.
    pub image_width_px: Located<u32>,
    /// Height of the frames, pixels.
    pub image_height_px: Located<u32>,
    /// What pixel (0, 0) means in `cx_px` and `cy_px`.
    pub pixel_origin: PixelOrigin,
    /// Focal length along columns, pixels.
    pub fx_px: Located<f64>,
    /// Focal length along rows, pixels.
    pub fy_px: Located<f64>,
    /// Skew, pixels. Default 0.
    #[serde(default)]
    pub skew_px: f64,
    /// Principal point, column.
    pub cx_px: Located<f64>,
    /// Principal point, row.
    pub cy_px: Located<f64>,
    /// Radial distortion of r². Default 0.
    #[serde(default)]
    pub k1: f64,
    /// Radial distortion of r⁴. Default 0.
    #[serde(default)]
    pub k2: f64,
    /// Tangential distortion, first. Default 0.
    #[serde(default)]
    pub p1: f64,
    /// Tangential distortion, second. Default 0.
    #[serde(default)]
    pub p2: f64,
    /// Radial distortion of r⁶. Default 0.
    #[serde(default)]
    pub k3: f64,
    /// Standard deviations (1σ) of the parameters, taken as independent. What is left out is taken as exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub std: Option<Located<ParametersStdSpec>>,
}

/// `[calibrate.parameters.std]`: 1σ of each parameter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ParametersStdSpec {
    /// 1σ of `fx_px`, pixels.
    pub fx_px: f64,
    /// 1σ of `fy_px`, pixels.
    pub fy_px: f64,
    /// 1σ of `skew_px`, pixels.
    pub skew_px: f64,
    /// 1σ of `cx_px`, pixels.
    pub cx_px: f64,
    /// 1σ of `cy_px`, pixels.
    pub cy_px: f64,
    /// 1σ of `k1`.
    pub k1: f64,
    /// 1σ of `k2`.
    pub k2: f64,
    /// 1σ of `p1`.
    pub p1: f64,
    /// 1σ of `p2`.
    pub p2: f64,
    /// 1σ of `k3`.
    pub k3: f64,
}

impl ParametersStdSpec {
    /// The values with their keys.
    fn entries(&self) -> [(&'static str, f64); 10] {
        [
            ("fx_px", self.fx_px),
            ("fy_px", self.fy_px),
            ("skew_px", self.skew_px),
            ("cx_px", self.cx_px),
            ("cy_px", self.cy_px),
            ("k1", self.k1),
            ("k2", self.k2),
            ("p1", self.p1),
            ("p2", self.p2),
            ("k3", self.k3),
        ]
    }
}

/// The kind of calibration target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TargetKind {
    /// Separate black squares on white, in rows and columns.
    Squares,
}

/// Which square of the target is drawn as an outline, to tell the target's orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HollowSquare {
    /// The upper-left square is hollow, as on the paper's target.
    UpperLeft,
    /// All squares are filled: the target's orientation is then ambiguous by half a turn (or a quarter, when square).
    None,
}

/// `[calibrate.target]`: the target in the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetSpec {
    /// Kind of target.
    pub kind: TargetKind,
    /// Number of rows of squares.
    pub rows: Located<u32>,
    /// Number of columns of squares.
    pub columns: Located<u32>,
    /// Side of a square.
    pub square: Located<Length>,
    /// Space between neighbouring squares (their pitch is `square` + `gap`).
    pub gap: Located<Length>,
    /// Which square is hollow.
    pub hollow: HollowSquare,
}

/// `[calibrate.corners]`: corners found elsewhere, in Zhang's text format (whitespace-separated x y pairs, any number a line).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CornersSpec {
    /// File of the corners on the target (plane z = 0).
    pub model: Located<PathBuf>,
    /// The length that 1 means in `model`, for example "1 inch".
    pub model_unit: Located<Length>,
    /// One file of corners per view, in the order of `model`; pixels, column right, row down.
    pub views: Located<Vec<Located<PathBuf>>>,
    /// What pixel (0, 0) means in `views`.
    pub pixel_origin: PixelOrigin,
    /// Width of the photos, pixels.
    pub image_width_px: Located<u32>,
    /// Height of the photos, pixels.
    pub image_height_px: Located<u32>,
}

/// Which lens parameters are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum LensModel {
    /// k1, k2, p1, p2, k3: the paper's lens.
    #[serde(rename = "brown5")]
    Brown5,
    /// k1, k2.
    #[serde(rename = "radial2")]
    Radial2,
    /// k1, k2, p1, p2.
    #[serde(rename = "radial2_tangential2")]
    Radial2Tangential2,
}

/// `[calibrate.model]`: which parameters are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSpec {
    /// Lens parameters. Default "brown5".
    pub lens: LensModel,
    /// Whether skew is estimated. Default true.
    pub skew: bool,
}

impl Default for ModelSpec {
    fn default() -> Self {
        Self { lens: LensModel::Brown5, skew: true }
    }
}

/// `[calibrate]`, resolved.
#[derive(Debug, Clone)]
pub struct Calibrate {
    /// The table's place.
    pub table: Located<()>,
    /// Where the camera comes from.
    pub camera: CameraSource,
}

impl Calibrate {
    /// Whether the camera has to be worked out, instead of being given.
    pub fn is_estimated(&self) -> bool {
        matches!(self.camera, CameraSource::Photos(_) | CameraSource::Corners(_))
    }
}

/// Where the camera comes from.
#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "a pipeline holds one")]
pub enum CameraSource {
    /// A camera file, recognised by its content.
    File(Located<PathBuf>),
    /// Parameters written in the pipeline file.
    Parameters(Located<ParametersSpec>),
    /// Photos of a target.
    Photos(TargetPhotos),
    /// Corners found elsewhere.
    Corners(TargetCorners),
}

/// Photos of a target.
#[derive(Debug, Clone)]
pub struct TargetPhotos {
    /// Patterns of file names as written, to be looked up from [`super::Config::base`].
    pub patterns: Located<Vec<String>>,
    /// The target.
    pub target: Target,
    /// Which parameters are estimated.
    pub model: ModelSpec,
}

/// A target of squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Rows of squares, at least 2.
    pub rows: u32,
    /// Columns of squares, at least 2.
    pub columns: u32,
    /// Side of a square, metres.
    pub square_m: f64,
    /// Space between neighbouring squares, metres.
    pub gap_m: f64,
    /// Which square is hollow.
    pub hollow: HollowSquare,
}

/// Corners found elsewhere.
#[derive(Debug, Clone)]
pub struct TargetCorners {
    /// File of the corners on the target.
    pub model_file: Located<PathBuf>,
    /// The length that 1 means in `model_file`, metres.
    pub model_unit_m: f64,
    /// One file per view.
    pub views: Vec<Located<PathBuf>>,
    /// What pixel (0, 0) means in the views.
    pub pixel_origin: PixelOrigin,
    /// Width of the photos, pixels.
    pub image_width_px: u32,
    /// Height of the photos, pixels.
    pub image_height_px: u32,
    /// Which parameters are estimated.
    pub model: ModelSpec,
}

pub(super) fn resolve(
    spec: &mut Located<CalibrateSpec>,
    resolver: &Resolver,
) -> Result<Calibrate, ConfigError> {
    let table = Located { value: (), span: spec.span.clone() };
    let given: Vec<&str> = [
        ("camera", spec.camera.is_some()),
        ("photos", spec.photos.is_some()),
        ("parameters", spec.parameters.is_some()),
        ("corners", spec.corners.is_some()),
    ]
    .iter()
    .filter_map(|(name, present)| present.then_some(*name))
    .collect();
    if given.len() != 1 {
        let what =
            if given.is_empty() { "none is".to_owned() } else { format!("{} are", given.join(" and ")) };
        return Err(resolver
            .error(spec, format!("[calibrate] takes exactly one of camera, photos, parameters, corners; {what} given"))
            .help("`camera` names a camera file, `photos` calibrates from photos of a target, `parameters` writes the camera out, `corners` takes known corners"));
    }
    let spec = &mut spec.value;
    if spec.photos.is_none() {
        resolver.unused(&spec.target, "target", "only `photos` look for a target")?;
    }
    if spec.photos.is_none() && spec.corners.is_none() {
        resolver.unused(&spec.model, "model", "only `photos` and `corners` estimate parameters")?;
    }
    let camera = if let Some(file) = &spec.camera {
        CameraSource::File(resolver.path(file)?)
    } else if let Some(parameters) = &spec.parameters {
        check_parameters(parameters, resolver)?;
        CameraSource::Parameters(parameters.clone())
    } else if let Some(photos) = &spec.photos {
        let model = spec.model.get_or_insert_with(|| Located::unplaced(ModelSpec::default())).value;
        if photos.0.is_empty() || photos.0.iter().any(String::is_empty) {
            return Err(resolver.error(photos, "`photos` names no file"));
        }
        let target = spec.target.as_ref().ok_or_else(|| {
            resolver
                .error(photos, "`photos` need the target they show")
                .help("add a table [calibrate.target]")
        })?;
        CameraSource::Photos(TargetPhotos {
            patterns: photos.clone().map(|patterns| patterns.0),
            target: resolve_target(target, resolver)?,
            model,
        })
    } else if let Some(corners) = &spec.corners {
        let model = spec.model.get_or_insert_with(|| Located::unplaced(ModelSpec::default())).value;
        CameraSource::Corners(resolve_corners(corners, model, resolver)?)
    } else {
        unreachable!("one of the four was just counted")
    };
    Ok(Calibrate { table, camera })
}

fn positive(value: &Located<f64>, name: &str, resolver: &Resolver) -> Result<(), ConfigError> {
    if value.is_finite() && value.value > 0.0 {
        return Ok(());
    }
    Err(resolver.error(value, format!("`{name}` is {}; it must be above 0", value.value)))
}

fn not_zero(value: &Located<u32>, name: &str, resolver: &Resolver) -> Result<u32, ConfigError> {
    if value.value > 0 { Ok(value.value) } else { Err(resolver.error(value, format!("`{name}` is 0"))) }
}

fn positive_length(value: &Located<Length>, name: &str, resolver: &Resolver) -> Result<f64, ConfigError> {
    positive(&value.as_ref().map(|length| length.metres()), name, resolver)?;
    Ok(value.metres())
}

fn check_parameters(spec: &Located<ParametersSpec>, resolver: &Resolver) -> Result<(), ConfigError> {
    not_zero(&spec.image_width_px, "image_width_px", resolver)?;
    not_zero(&spec.image_height_px, "image_height_px", resolver)?;
    positive(&spec.fx_px, "fx_px", resolver)?;
    positive(&spec.fy_px, "fy_px", resolver)?;
    for (name, value) in [("cx_px", &spec.cx_px), ("cy_px", &spec.cy_px)] {
        if !value.is_finite() {
            return Err(resolver.error(value, format!("`{name}` is {}; it must be finite", value.value)));
        }
    }
    let lens = [
        ("skew_px", spec.skew_px),
        ("k1", spec.k1),
        ("k2", spec.k2),
        ("p1", spec.p1),
        ("p2", spec.p2),
        ("k3", spec.k3),
    ];
    if let Some((name, value)) = lens.iter().find(|(_, value)| !value.is_finite()) {
        return Err(resolver.error(spec, format!("`{name}` is {value}; it must be finite")));
    }
    if let Some(std) = &spec.std
        && let Some((name, value)) =
            std.entries().iter().find(|(_, value)| !(value.is_finite() && *value >= 0.0))
    {
        return Err(resolver
            .error(std, format!("the standard deviation of `{name}` is {value}; it must be 0 or more")));
    }
    Ok(())
}

fn resolve_target(spec: &Located<TargetSpec>, resolver: &Resolver) -> Result<Target, ConfigError> {
    for (name, count) in [("rows", &spec.rows), ("columns", &spec.columns)] {
        if count.value < 2 {
            return Err(resolver
                .error(count, format!("a target needs 2 or more {name} of squares, not {}", count.value)));
        }
    }
    Ok(Target {
        rows: spec.rows.value,
        columns: spec.columns.value,
        square_m: positive_length(&spec.square, "square", resolver)?,
        gap_m: positive_length(&spec.gap, "gap", resolver)?,
        hollow: spec.hollow,
    })
}

fn resolve_corners(
    spec: &Located<CornersSpec>,
    model: ModelSpec,
    resolver: &Resolver,
) -> Result<TargetCorners, ConfigError> {
    if spec.views.is_empty() {
        return Err(resolver.error(&spec.views, "`views` names no file"));
    }
    Ok(TargetCorners {
        model_file: resolver.path(&spec.model)?,
        model_unit_m: positive_length(&spec.model_unit, "model_unit", resolver)?,
        views: spec.views.iter().map(|view| resolver.path(view)).collect::<Result<_, _>>()?,
        pixel_origin: spec.pixel_origin,
        image_width_px: not_zero(&spec.image_width_px, "image_width_px", resolver)?,
        image_height_px: not_zero(&spec.image_height_px, "image_height_px", resolver)?,
        model,
    })
}
