//! `georeference`: frames and log in, one pose and footprint per frame out.

mod ground;
mod poses;

use super::context::{ErrorClass, FrameStatus, RunContext, StageError};
use crate::camera::Camera;
use crate::config::georeference::{Crs, Georeference, Ground};
use crate::config::log::Join;
use crate::config::{Config, Located};
use crate::formats::InputError;
use crate::formats::crs::Projection;
use crate::formats::files;
use crate::formats::geoid::Geoid;
use crate::formats::log::{BadRow, LogRow, read_frame_times, read_log};
use crate::formats::photo::{self, PhotoHeader};
use crate::geodesy::{Geodetic, MapProjection, WGS84, grid_convergence};
use crate::geometry::attitude::{OmegaPhiKappa, YawPitchRoll};
use crate::geometry::{Body, Camera as Camera3, Point, Rotation};
use crate::georeference::{Chain, GeoreferencedFrame};
use crate::navigation::{GimbalAngles, Mount, NavigationRecord, Track};
use crate::units::Seconds;
use ground::SurveyGround;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A frame that is not used, and why.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct RejectedFrame {
    /// The image's file name.
    pub frame: String,
    /// Why.
    pub reason: String,
}

/// Frames with poses, and what was left out.
#[derive(Debug, Clone)]
pub struct Georeferenced {
    /// Usable frames, ordered by name.
    pub frames: Vec<GeoreferencedFrame>,
    /// The others, ordered by name.
    pub rejected: Vec<RejectedFrame>,
    /// CRS of the products.
    pub projection: Projection,
    /// What the user should know but need not act on.
    pub notes: Vec<String>,
}

/// Ground is looked for within this many heights above it, unless the pipeline file says otherwise.
const RANGE_IN_HEIGHTS: f64 = 20.0;

/// Georeferences every image of the folder, in memory.
///
/// # Errors
/// [`InputError`] for what stops the whole survey: an unreadable log, folder or elevation model, an
/// unknown CRS, no usable frame. What concerns one frame rejects that frame.
pub fn georeference(declared: &Georeference, camera: &Arc<Camera>) -> Result<Georeferenced, InputError> {
    let images = image_names(declared)?;
    let geoid = declared.geoid_undulation_m.map_or(Geoid::Egm96, Geoid::Constant);
    let table = read_log(&declared.log)?;
    let near = poses::first_place(declared, &table)?;
    let ground = SurveyGround::load(&declared.ground, near.as_ref(), &geoid)?;
    let (records, bad) = poses::records(declared, table, |at| product_crs(declared, at), &geoid, &|at| {
        ground.heights(at, &geoid)
    })?;
    let mut notes = Vec::new();
    if records.is_empty() {
        return Err(no_rows(declared, &bad));
    }
    let centre = middle(&records);
    let projection = product_crs(declared, &centre)?;
    notes.extend(scale_note(&projection, &centre));
    let file = declared.log.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut poses = match &declared.log.join {
        Join::Name { .. } => by_name(&images, records, bad, &file, &mut notes),
        Join::Time { max_gap_s, clock_offset_s, frames, .. } => {
            if !bad.is_empty() {
                notes.push(format!(
                    "{} of {file}'s rows cannot be used; the first: line {}: {}",
                    bad.len(),
                    bad[0].line,
                    bad[0].cause
                ));
            }
            let track = Track::new(records.into_iter().map(|(_, record)| record).collect()).map_err(|e| {
                InputError::new(&declared.log.file, e.to_string()).caused_by(&declared.log.file)
            })?;
            let times = read_frame_times(frames)?;
            let name = frames.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let mut named: BTreeMap<String, Vec<_>> = BTreeMap::new();
            for time in times {
                named.entry(time.frame.clone()).or_default().push(time);
            }
            let poses = images
                .iter()
                .map(|image| match named.remove(image).as_deref() {
                    None => Err(format!("no row of {name} names it")),
                    Some([only]) => only
                        .time
                        .clone()
                        .map_err(|cause| format!("{name}, line {}: {cause}", only.line))
                        .and_then(|time| {
                            let exposure = Seconds::new(time.get() + clock_offset_s);
                            track.at(exposure, Seconds::new(*max_gap_s)).map_err(|e| e.to_string())
                        }),
                    Some(several) => Err(several_rows(&name, several.iter().map(|t| t.line))),
                })
                .collect();
            unmatched(named.keys(), &name, &mut notes);
            poses
        }
    };
    let mount = poses::mount(declared);
    let results: Vec<Result<GeoreferencedFrame, RejectedFrame>> = images
        .par_iter()
        .zip(poses.par_drain(..))
        .map(|(name, record): (&String, Result<NavigationRecord, String>)| {
            record
                .and_then(|record| frame(declared, name, record, &mount, camera, &ground, &geoid))
                .map_err(|reason| RejectedFrame { frame: name.clone(), reason })
        })
        .collect();
    let (mut frames, mut rejected) = (Vec::new(), Vec::new());
    for result in results {
        match result {
            Ok(frame) => frames.push(frame),
            Err(reason) => rejected.push(reason),
        }
    }
    if frames.is_empty() {
        let first = rejected.first().map_or(String::new(), |r| format!("; {}: {}", r.frame, r.reason));
        return Err(InputError::new(
            &declared.images,
            format!("none of its {} images can be used{first}", images.len()),
        )
        .caused_by(&declared.images));
    }
    notes.extend(ground.fallback_note(&frames));
    if declared.log.attitude.as_ref().is_some_and(|a| a.yaw.is_course()) {
        notes.push("yaw is the course over ground, as declared: the crab angle is not corrected".to_owned());
    }
    Ok(Georeferenced { frames, rejected, projection, notes })
}

/// File names of the folder's images, in order.
fn image_names(declared: &Georeference) -> Result<Vec<String>, InputError> {
    let failed = |cause: String| InputError::new(&declared.images, cause).caused_by(&declared.images);
    files::images(&declared.images)
        .map_err(|e| failed(e.to_string()))?
        .into_iter()
        .map(|path| {
            let name = path.file_name().unwrap_or_default();
            name.to_str().map(str::to_owned).ok_or_else(|| {
                failed(format!("holds a file whose name is not UTF-8: {}", name.to_string_lossy()))
            })
        })
        .collect()
}

fn no_rows(declared: &Georeference, bad: &[BadRow]) -> InputError {
    let cause = match bad.first() {
        None => "has no rows below its header".to_owned(),
        Some(row) => {
            format!("has no usable row; the first of {}: line {}: {}", bad.len(), row.line, row.cause)
        }
    };
    InputError::new(&declared.log.file, cause).caused_by(&declared.log.file)
}

fn product_crs(declared: &Georeference, at: &Geodetic) -> Result<Projection, InputError> {
    match &declared.crs.value {
        Crs::Auto => Projection::utm_at(at),
        Crs::Given(definition) => Projection::new(definition),
    }
    .map_err(|e| {
        InputError::of_setting(&declared.crs, e.to_string())
            .help("write \"auto\" for the survey's UTM zone, or a projected CRS such as \"EPSG:32617\"")
    })
}

/// What to say about a map grid that is not true to scale where the survey lies.
fn scale_note(projection: &Projection, at: &Geodetic) -> Option<String> {
    /// UTM stays within 0.04 % of true scale in its zone and 0.1 % in its neighbours.
    const TOLERATED: f64 = 0.005;
    if projection.is_geographic() {
        return None;
    }
    let tangent = crate::geodesy::LocalTangent::at(*at);
    let step = |n, e| WGS84.geodetic_from_ecef(&(*tangent.ecef_from_ned() * Point::new(n, e, 0.0)));
    let map = projection.map_from_geodetic(&[*at, step(1.0, 0.0), step(0.0, 1.0)]).ok()?;
    let (north, east) = (
        (map[1].easting - map[0].easting, map[1].northing - map[0].northing),
        (map[2].easting - map[0].easting, map[2].northing - map[0].northing),
    );
    let scale = (north.0 * east.1 - north.1 * east.0).abs().sqrt() * projection.metres_per_unit();
    ((scale - 1.0).abs() > TOLERATED).then(|| {
        format!(
            "{} is not true to scale at the survey: a metre on the ground is {scale:.4} m on this map, and sizes \
             and areas of the products count on the map",
            projection.name()
        )
    })
}

/// The mean position, which no meridian can split.
fn middle(records: &[(LogRow, NavigationRecord)]) -> Geodetic {
    let sum = records
        .iter()
        .map(|(_, r)| WGS84.ecef_from_geodetic(&r.antenna).vector())
        .fold(nalgebra::Vector3::zeros(), |a, b| a + b);
    WGS84.geodetic_from_ecef(&Point::from_vector(sum / records.len() as f64))
}

/// The record of each image, by the name its row gives.
fn by_name(
    images: &[String],
    records: Vec<(LogRow, NavigationRecord)>,
    bad: Vec<BadRow>,
    file: &str,
    notes: &mut Vec<String>,
) -> Vec<Result<NavigationRecord, String>> {
    // A log may leave the extension out; it must then name one image only.
    let stems = |name: &str| Path::new(name).file_stem().map(|s| s.to_string_lossy().into_owned());
    let mut by_stem: BTreeMap<String, Vec<&String>> = BTreeMap::new();
    for image in images {
        by_stem.entry(stems(image).unwrap_or_default()).or_default().push(image);
    }
    let image_of = |row: &str| {
        if images.iter().any(|i| i == row) {
            return row.to_owned();
        }
        match by_stem.get(row).map(Vec::as_slice) {
            Some([only]) => (*only).clone(),
            _ => row.to_owned(),
        }
    };
    /// A row's line and what it says.
    type Said = (u64, Result<NavigationRecord, String>);
    let mut rows: BTreeMap<String, Vec<Said>> = BTreeMap::new();
    for (row, record) in records {
        let image = image_of(row.frame.as_deref().unwrap_or_default());
        rows.entry(image).or_default().push((row.line, Ok(record)));
    }
    let mut nameless = 0;
    for row in bad {
        match row.frame.filter(|name| !name.is_empty()) {
            None => nameless += 1,
            Some(name) => {
                let cause = format!("{file}, line {}: {}", row.line, row.cause);
                rows.entry(image_of(&name)).or_default().push((row.line, Err(cause)));
            }
        }
    }
    if nameless > 0 {
        notes.push(format!("{nameless} rows of {file} name no frame"));
    }
    let poses = images
        .iter()
        .map(|image| match rows.remove(image) {
            None => Err(format!("no row of {file} names it")),
            Some(mut rows) if rows.len() == 1 => rows.swap_remove(0).1,
            Some(rows) => Err(several_rows(file, rows.iter().map(|(line, _)| *line))),
        })
        .collect();
    unmatched(rows.keys(), file, notes);
    poses
}

fn several_rows(file: &str, lines: impl Iterator<Item = u64>) -> String {
    let mut lines: Vec<u64> = lines.collect();
    lines.sort_unstable();
    let lines: Vec<String> = lines.iter().map(u64::to_string).collect();
    format!("{file} names it more than once (lines {})", lines.join(", "))
}

fn unmatched<'a>(names: impl ExactSizeIterator<Item = &'a String>, file: &str, notes: &mut Vec<String>) {
    let count = names.len();
    let mut names = names;
    if let Some(first) = names.next() {
        notes.push(format!("{count} rows of {file} name no image of the folder; the first: \"{first}\""));
    }
}

fn frame(
    declared: &Georeference,
    name: &str,
    record: NavigationRecord,
    mount: &Mount,
    camera: &Arc<Camera>,
    ground: &SurveyGround,
    geoid: &Geoid,
) -> Result<GeoreferencedFrame, String> {
    let rotation = record.pixel_rotation.unwrap_or(mount.pixel_rotation);
    let PhotoHeader { width, height, .. } =
        photo::read_header(&declared.images.join(name)).map_err(|e| e.cause)?;
    let expected = rotation.stored_size(camera.width, camera.height);
    if (width, height) != expected {
        return Err(format!(
            "the image is {width} × {height} px, the camera's are {} × {}",
            expected.0, expected.1
        ));
    }
    let centre = WGS84.geodetic_from_ecef(&Chain::new(&record, mount).ecef_from_camera().origin);
    let terrain = ground.under(&record, &centre, geoid)?;
    let max_range_m = match declared.footprint_max_range_m {
        Some(range) => range,
        None => {
            let below = terrain.heights(&[centre])[0].unwrap_or(terrain.height_range().0);
            let above = centre.height.get() - below;
            if above <= 0.0 {
                return Err(format!("the camera is {:.1} m below the ground", -above));
            }
            RANGE_IN_HEIGHTS * above
        }
    };
    let frame = GeoreferencedFrame::new(name.to_owned(), record, mount, camera.clone(), terrain, max_range_m)
        .map_err(|e| e.to_string())?;
    if let Some(limit) = declared.max_off_nadir_rad
        && frame.footprint.off_nadir > limit
    {
        let degrees = |r: f64| crate::units::Radians::new(r).degrees();
        return Err(format!(
            "the camera looks {:.1}° off nadir, the limit is {:.1}°",
            degrees(frame.footprint.off_nadir),
            degrees(limit)
        ));
    }
    Ok(frame)
}

/// Georeferences the survey and writes `frames.csv`, `footprints.geojson` and, on request, one orthorectified
/// GeoTIFF per frame.
///
/// # Errors
/// As [`georeference`], and when a product cannot be written.
pub fn run(config: &Config, camera: &Arc<Camera>, context: &RunContext) -> Result<Georeferenced, StageError> {
    let declared = config
        .georeference
        .as_ref()
        .ok_or_else(|| StageError::pipeline("the pipeline has no [georeference] table"))?;
    let survey = georeference(declared, camera).map_err(|e| failed(config, e))?;
    context.record_input(&declared.log.file);
    if let Join::Time { frames, .. } = &declared.log.join {
        context.record_input(&frames.file);
    }
    if let Ground::Dem { file, .. } = &declared.ground {
        context.record_input(file);
    }
    for frame in &survey.frames {
        context.record_input(&declared.images.join(&frame.name));
        context.record_frame(&frame.name, FrameStatus::Used);
    }
    for RejectedFrame { frame, reason } in &survey.rejected {
        context.record_frame(frame, FrameStatus::Rejected { reason: reason.clone() });
    }
    for note in &survey.notes {
        context.warn(note.clone());
    }
    context.write_product("frames.csv", &frames_csv(&survey)?)?;
    context.write_product("footprints.geojson", footprints_geojson(&survey).as_bytes())?;
    if declared.orthos {
        super::mosaic::orthos(config, &survey, context)?;
    }
    Ok(survey)
}

/// An input error as the stage's, with its place in the pipeline file.
pub(super) fn failed(config: &Config, error: InputError) -> StageError {
    let place = error.span.clone().and_then(|span| config.at(&Located { value: (), span }));
    let message = error.to_string();
    let failure =
        if error.is_of_pipeline_file() { StageError::pipeline(message) } else { StageError::input(message) };
    let failure = failure.at(place);
    match error.help {
        Some(help) => failure.help(help),
        None => failure,
    }
}

/// One row per image, used or not.
fn frames_csv(survey: &Georeferenced) -> Result<Vec<u8>, StageError> {
    let mut rows: Vec<FrameRow> = survey
        .rejected
        .iter()
        .map(|r| FrameRow {
            frame: r.frame.clone(),
            status: "rejected",
            reason: r.reason.clone(),
            ..FrameRow::default()
        })
        .collect();
    for frame in &survey.frames {
        rows.push(FrameRow::of(frame, &survey.projection).map_err(|e| StageError::input(e.to_string()))?);
    }
    rows.sort_by(|a, b| a.frame.cmp(&b.frame));
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).map_err(|e| StageError::new(ErrorClass::Bug, e.to_string()))?;
    }
    writer.into_inner().map_err(|e| StageError::new(ErrorClass::Bug, e.to_string()))
}

/// A row of `frames.csv`: the camera, not the antenna or the UAV. `camera_yaw_deg` and its fellows are those of
/// a body whose nose is the sensor's top. Empty cells for a rejected frame.
#[derive(Debug, Default, serde::Serialize)]
struct FrameRow {
    frame: String,
    status: &'static str,
    reason: String,
    log_line: Option<u64>,
    time_s: Option<f64>,
    latitude_deg: Option<String>,
    longitude_deg: Option<String>,
    height_ellipsoid_m: Option<String>,
    easting: Option<String>,
    northing: Option<String>,
    camera_yaw_deg: Option<String>,
    camera_pitch_deg: Option<String>,
    camera_roll_deg: Option<String>,
    omega_deg: Option<String>,
    phi_deg: Option<String>,
    kappa_deg: Option<String>,
    pixel_rotation_deg: Option<u32>,
    height_above_ground_m: Option<String>,
    gsd_m: Option<String>,
    off_nadir_deg: Option<String>,
    clipped: Option<bool>,
}

impl FrameRow {
    fn of(
        frame: &GeoreferencedFrame,
        projection: &Projection,
    ) -> Result<Self, crate::geodesy::ProjectionError> {
        let centre = WGS84.geodetic_from_ecef(&frame.ecef_from_camera().origin);
        let map = projection.map_from_geodetic(&[centre])?[0];
        let convergence = grid_convergence(projection, &centre)?;
        // The attitude of a body whose nose is the image's top: the camera's own yaw, pitch and roll.
        let ned_from_camera = crate::geodesy::LocalTangent::at(centre).ecef_from_ned().rotation.inverse()
            * frame.ecef_from_camera().rotation;
        let nadir: Rotation<Body, Camera3> =
            GimbalAngles::NADIR.rotation::<Body>() * Mount::gimbal_from_camera_axes();
        let attitude = YawPitchRoll::of(&(ned_from_camera * nadir.inverse()));
        let opk = OmegaPhiKappa::of_ned_from_camera(&ned_from_camera, convergence);
        let decimals = |v: f64, n: usize| Some(format!("{v:.n$}"));
        let map_decimals = if projection.is_geographic() { 9 } else { 4 };
        Ok(Self {
            frame: frame.name.clone(),
            status: "used",
            reason: String::new(),
            log_line: Some(frame.record.line),
            time_s: frame.record.time.map(Seconds::get),
            latitude_deg: decimals(centre.latitude.degrees(), 9),
            longitude_deg: decimals(centre.longitude.degrees(), 9),
            height_ellipsoid_m: decimals(centre.height.get(), 4),
            easting: decimals(map.easting, map_decimals),
            northing: decimals(map.northing, map_decimals),
            camera_yaw_deg: decimals(attitude.yaw.degrees(), 6),
            camera_pitch_deg: decimals(attitude.pitch.degrees(), 6),
            camera_roll_deg: decimals(attitude.roll.degrees(), 6),
            omega_deg: decimals(opk.omega.degrees(), 6),
            phi_deg: decimals(opk.phi.degrees(), 6),
            kappa_deg: decimals(opk.kappa.degrees(), 6),
            pixel_rotation_deg: Some(frame.pixel_rotation.degrees()),
            height_above_ground_m: decimals(frame.footprint.height_above_ground_m, 3),
            gsd_m: decimals(frame.footprint.gsd_m, 5),
            off_nadir_deg: decimals(crate::units::Radians::new(frame.footprint.off_nadir).degrees(), 4),
            clipped: Some(frame.footprint.clipped),
        })
    }
}

/// Outlines as polygons in longitude and latitude (RFC 7946: counter-clockwise, closed).
fn footprints_geojson(survey: &Georeferenced) -> String {
    let features = survey.frames.iter().map(|frame| {
        let mut ring: Vec<geojson::Position> = frame
            .footprint
            .outline
            .iter()
            // The outline runs clockwise in the image, which looks down: reversed it runs counter-clockwise.
            .rev()
            .map(|v| {
                [v.position.longitude.degrees(), v.position.latitude.degrees()].map(round_degrees).into()
            })
            .collect();
        ring.extend(ring.first().cloned());
        let mut properties = geojson::JsonObject::new();
        properties.insert("frame".into(), frame.name.clone().into());
        properties.insert("gsd_m".into(), serde_json::json!(round(frame.footprint.gsd_m, 1e5)));
        properties.insert("clipped".into(), frame.footprint.clipped.into());
        geojson::Feature {
            geometry: Some(geojson::Geometry::new(geojson::GeometryValue::Polygon {
                coordinates: vec![ring],
            })),
            properties: Some(properties),
            ..geojson::Feature::default()
        }
    });
    geojson::FeatureCollection::from_iter(features).to_string()
}

fn round(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}

/// A hundredth of a millimetre on the ground.
fn round_degrees(value: f64) -> f64 {
    round(value, 1e10)
}
