//! `[calibrate]`: where the camera comes from.

use std::fmt;
use std::path::PathBuf;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::error::{ConfigError, Resolver};
use super::quantity::Length;
use super::source::Located;
use super::target::{self, Target, TargetSpec};

/// `[calibrate]` as written. Exactly one of `camera`, `photos`, `parameters`, `corners`.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrateSpec {
    /// A camera file: this program's own JSON (with covariance), or one of OpenCV, ROS, Kalibr, OpenDroneMap, orthority,
    /// Metashape, Pix4D or COLMAP; recognised by its content.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Located<PathBuf>>,
    /// Name of the camera in a file of several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_name: Option<Located<String>>,
    /// Columns and rows of the photos, for a camera file that does not state them: [4000, 3000].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_size: Option<Located<[u32; 2]>>,
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
    /// A camera file to compare with in the report; it has no influence on the result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<Located<PathBuf>>,
    /// Height above ground for which the report gives the uncertainty of a pixel in metres. Default 100 m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub report_height: Option<Located<Length>>,
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

/// The lens that is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum LensChoice {
    /// Several lenses, compared by how well they predict photos that took no part; the simplest one that is not worse
    /// than the best is used.
    #[serde(rename = "auto")]
    Auto,
    /// Brown's with k1, k2, p1, p2, k3: the paper's lens.
    #[serde(rename = "brown5")]
    Brown5,
    /// Brown's with k1, k2.
    #[serde(rename = "radial2")]
    Radial2,
    /// Brown's with k1, k2, p1, p2.
    #[serde(rename = "radial2_tangential2")]
    Radial2Tangential2,
    /// OpenCV's rational lens: k1, k2, p1, p2, k3, k4, k5, k6.
    #[serde(rename = "rational")]
    Rational,
    /// Kannala and Brandt's fisheye lens: k1, k2, k3, k4.
    #[serde(rename = "fisheye")]
    Fisheye,
}

/// `[calibrate.model]`: which parameters are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSpec {
    /// The lens. Default "auto".
    pub lens: LensChoice,
    /// Whether skew is estimated. Default: true for "brown5", false for the other lenses; "auto" compares
    /// Brown's five terms with and without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skew: Option<bool>,
    /// Ratio fx / fy where it is known, for example 1.0; both are estimated when left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aspect: Option<f64>,
    /// Whether the principal point is taken to be the middle of the image. Default false.
    pub centred: bool,
    /// Whether the board's bend is estimated along with the camera. Default false: it is reported, not used.
    pub bend: bool,
    /// Whether points far beyond the noise of the others lose weight; they are named either way. Default: true with
    /// `photos`, false with `corners`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robust: Option<bool>,
}

impl Default for ModelSpec {
    fn default() -> Self {
        Self { lens: LensChoice::Auto, skew: None, aspect: None, centred: false, bend: false, robust: None }
    }
}

/// `[calibrate]`, resolved.
#[derive(Debug, Clone)]
pub struct Calibrate {
    /// The table's place.
    pub table: Located<()>,
    /// Where the camera comes from.
    pub camera: CameraSource,
    /// A camera file to compare with.
    pub reference: Option<Located<PathBuf>>,
    /// Height above ground for which uncertainties are given in metres.
    pub report_height_m: f64,
}

impl Calibrate {
    /// Whether the camera has to be worked out, instead of being given.
    pub fn is_estimated(&self) -> bool {
        matches!(self.camera, CameraSource::Photos(_) | CameraSource::Corners(_))
    }
}

/// A camera file, recognised by its content, and what it does not say itself.
#[derive(Debug, Clone)]
pub struct CameraFile {
    /// The file.
    pub file: Located<PathBuf>,
    /// Which of its cameras.
    pub name: Option<String>,
    /// Columns and rows of the photos.
    pub image_size: Option<(u32, u32)>,
}

/// Where the camera comes from.
#[derive(Debug, Clone)]
pub enum CameraSource {
    /// A camera file.
    File(CameraFile),
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
        resolver.unused(&spec.reference, "reference", "only `photos` and `corners` are compared")?;
        resolver.unused(&spec.report_height, "report_height", "only `photos` and `corners` have a report")?;
    }
    if spec.camera.is_none() {
        resolver.unused(&spec.camera_name, "camera_name", "it chooses among the cameras of a camera file")?;
        resolver.unused(&spec.camera_size, "camera_size", "only a camera file may lack its image size")?;
    }
    let camera = if let Some(file) = &spec.camera {
        CameraSource::File(CameraFile {
            file: resolver.path(file)?,
            name: spec.camera_name.as_ref().map(|name| name.value.clone()),
            image_size: spec.camera_size.as_ref().map(|size| (size[0], size[1])),
        })
    } else if let Some(parameters) = &spec.parameters {
        check_parameters(parameters, resolver)?;
        CameraSource::Parameters(parameters.clone())
    } else if let Some(photos) = &spec.photos {
        let model = resolve_model(&mut spec.model, resolver)?;
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
            target: target::resolve(target, resolver)?,
            model,
        })
    } else if let Some(corners) = &spec.corners {
        let model = resolve_model(&mut spec.model, resolver)?;
        CameraSource::Corners(resolve_corners(corners, model, resolver)?)
    } else {
        unreachable!("one of the four was just counted")
    };
    let reference = spec.reference.as_ref().map(|file| resolver.path(file)).transpose()?;
    let report_height_m = match &spec.report_height {
        Some(height) => positive_length(height, "report_height", resolver)?,
        None => 100.0,
    };
    Ok(Calibrate { table, camera, reference, report_height_m })
}

/// The model as written or the default, checked.
fn resolve_model(
    spec: &mut Option<Located<ModelSpec>>,
    resolver: &Resolver,
) -> Result<ModelSpec, ConfigError> {
    let model = spec.get_or_insert_with(|| Located::unplaced(ModelSpec::default()));
    match model.aspect {
        Some(ratio) if !(ratio.is_finite() && ratio > 0.0) => {
            Err(resolver.error(model, format!("`aspect` is {ratio}; it must be above 0")))
        }
        _ => Ok(model.value),
    }
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
