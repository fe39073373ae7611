//! `georeference`: frames and log in, one pose and footprint per frame out.

mod ground;
mod join;
mod matched;
mod poses;
mod sources;

pub use matched::{MatchReport, MatchRow};
pub use poses::PoseSource;
pub use sources::{Photos, photos};

use super::context::{ErrorClass, FrameStatus, RunContext, StageError};
use crate::camera::{Camera, PixelRotation};
use crate::config::georeference::{Crs, Georeference, Ground};
use crate::config::log::{FrameTimes, Join, LogSource};
use crate::config::{Config, Located};
use crate::formats::InputError;
use crate::formats::crs::{self, Projection};
use crate::formats::files;
use crate::formats::flight::{BadRecord, Exposure, FlightLog};
use crate::formats::geoid::Geoid;
use crate::formats::metadata::PhotoMetadata;
use crate::formats::photo::{self, PhotoHeader};
use crate::geodesy::{Geodetic, MapProjection, WGS84, grid_convergence};
use crate::geometry::attitude::{OmegaPhiKappa, YawPitchRoll};
use crate::geometry::{Body, Camera as Camera3, Point, Rotation};
use crate::georeference::{Chain, GeoreferencedFrame};
use crate::navigation::{GimbalAngles, Mount};
use crate::units::Seconds;
use ground::SurveyGround;
use join::{Holder, Poses};
use poses::{Conventions, Posed};
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
    /// Where the pose of each usable frame came from.
    pub sources: BTreeMap<String, PoseSource>,
    /// How photos and the log's exposures were paired, with `join = "match"`.
    pub matching: Option<MatchReport>,
    /// What the photos say about themselves, by name, where poses or times came from them; otherwise empty.
    pub photos: BTreeMap<String, Result<PhotoMetadata, String>>,
}

/// Ground is looked for within this many heights above it, unless the pipeline file says otherwise.
const RANGE_IN_HEIGHTS: f64 = 20.0;

/// Georeferences every image of the folder, in memory.
///
/// # Errors
/// [`InputError`] for what stops the whole survey: an unreadable log, folder or elevation model, an
/// unknown CRS, no usable frame. What concerns one frame rejects that frame.
pub fn georeference(declared: &Georeference, camera: &Arc<Camera>) -> Result<Georeferenced, InputError> {
    if declared.network {
        crs::allow_network();
    }
    let images = image_names(declared)?;
    let geoid = declared.geoid_undulation_m.map_or(Geoid::Grids, Geoid::Constant);
    let mut notes = Vec::new();
    let photos = match sources::needs_photos(declared) {
        true => sources::photos(&declared.images, &images),
        false => Vec::new(),
    };
    let log = sources::log(declared, &images, &photos)?;
    notes.extend(log.notes.iter().cloned());
    let near = sources::near(declared, &log)?;
    let ground = SurveyGround::load(&declared.ground, near.as_ref(), &geoid)?;
    let under = |at: &[Geodetic]| ground.heights(at, &geoid);
    let product_grid = || match &near {
        Some(near) => product_crs(declared, near),
        None => Err(no_rows(declared, &log.bad)),
    };
    let own = sources::attitudes_of_photos(declared, &log, &photos);
    let conventions = Conventions::new(declared, &log, &own, product_grid, &geoid, &under)?;
    let (poses, matching) =
        poses_of_images(declared, (&images, &photos, &own), &log, &conventions, &mut notes)?;
    let centre = middle(&poses).ok_or_else(|| no_pose(declared, &images, &log.bad, &poses))?;
    let projection = product_crs(declared, &centre)?;
    notes.extend(scale_note(&projection, &centre));
    let poses = turned(declared, &images, poses)?;
    let results: Vec<Result<(GeoreferencedFrame, PoseSource), RejectedFrame>> = images
        .par_iter()
        .zip(poses)
        .map(|(name, posed)| {
            posed
                .and_then(|posed| frame(declared, name, posed, camera, &ground, &geoid))
                .map_err(|reason| RejectedFrame { frame: name.clone(), reason })
        })
        .collect();
    let (mut frames, mut rejected, mut sources) = (Vec::new(), Vec::new(), BTreeMap::new());
    for result in results {
        match result {
            Ok((frame, source)) => {
                sources.insert(frame.name.clone(), source);
                frames.push(frame);
            }
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
    notes.extend(crab_note(declared));
    let photos = images.into_iter().zip(photos).collect();
    Ok(Georeferenced { frames, rejected, projection, notes, sources, matching, photos })
}

/// A pose for each image, or why it has none.
fn poses_of_images(
    declared: &Georeference,
    (images, photos, own): (&[String], &Photos, &[Option<Exposure>]),
    log: &FlightLog,
    conventions: &Conventions<'_>,
    notes: &mut Vec<String>,
) -> Result<(Poses, Option<MatchReport>), InputError> {
    let file = declared.log.file().map_or_else(|| "the photos".to_owned(), |file| base_name(file));
    if own.iter().any(Option::is_some) {
        notes.push(format!("{file} states no attitudes: those that the photos state themselves are used"));
    }
    if !matches!(declared.log.join, Join::Name)
        && let Some(first) = log.bad.first()
    {
        notes.push(format!(
            "{} of {file}'s rows cannot be used; the first: line {}: {}",
            log.bad.len(),
            first.place,
            first.cause
        ));
    }
    match &declared.log.join {
        Join::Name => {
            let holder = declared.log.file().map_or(Holder::Photos, |_| Holder::File(&file));
            Ok((join::by_name(images, log, holder, own, conventions, notes)?, None))
        }
        Join::Time { max_gap_s, clock_offset_s, frames, .. } => {
            let track = conventions.track(log, notes)?.ok_or_else(|| no_rows(declared, &log.bad))?;
            let times = sources::times(frames, images, photos, notes)?;
            let times = sources::on_clock_of(log, times, declared)?;
            let (offset, max_gap) = (Seconds::new(*clock_offset_s), Seconds::new(*max_gap_s));
            Ok((join::by_time(&times, own, offset, &track, max_gap, conventions), None))
        }
        Join::Match { max_gap_s, clock, frames } => {
            let track = conventions.track(log, notes)?;
            let times = sources::in_gps_week_of(log, sources::times(frames, images, photos, notes)?);
            let track = (track.as_ref(), Seconds::new(*max_gap_s));
            let (poses, report) = matched::by_matching(images, &times, log, clock, track, own, conventions)?;
            notes.extend(report.notes.iter().cloned());
            Ok((poses, Some(report)))
        }
    }
}

fn base_name(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Turns of stored pixels: the record's own, or the list of turned frames, on top of the mount's.
fn turned(declared: &Georeference, images: &[String], mut poses: Poses) -> Result<Poses, InputError> {
    let mut listed: BTreeMap<&str, PixelRotation> = BTreeMap::new();
    for group in &declared.mount.turned_frames {
        for name in &group.frames {
            if !images.contains(name) {
                return Err(InputError::of_setting(
                    name,
                    format!(
                        "`turned_frames` names \"{}\", and no image of the folder has that name",
                        name.value
                    ),
                ));
            }
            let again = listed.insert(name, poses::pixel_rotation(group.clockwise));
            if again.is_some() {
                return Err(InputError::of_setting(
                    name,
                    format!("`turned_frames` names \"{}\" more than once", name.value),
                ));
            }
        }
    }
    for (image, posed) in images.iter().zip(&mut poses) {
        let Ok(posed) = posed else { continue };
        let own = listed.get(image.as_str()).copied().or(posed.record.pixel_rotation);
        let all = posed.mount.pixel_rotation;
        posed.record.pixel_rotation =
            own.map(|own| PixelRotation::from_quarter_turns(i64::from(own.degrees() + all.degrees()) / 90));
    }
    Ok(poses)
}

/// What to say about a course that stands for the nose.
fn crab_note(declared: &Georeference) -> Option<String> {
    let crab = crate::units::Radians::new(declared.log.crab_std_rad?).degrees();
    Some(format!(
        "yaw is the course over ground, as declared: the crab angle is not corrected, {crab:.1} deg (1 sigma) of it \
         count as error of the yaw"
    ))
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

fn no_rows(declared: &Georeference, bad: &[BadRecord]) -> InputError {
    let cause = match bad.first() {
        None => "has no positions".to_owned(),
        Some(row) => format!(
            "has no usable position; the first of {} records that cannot be used: line {}: {}",
            bad.len(),
            row.place,
            row.cause
        ),
    };
    of_log(declared, cause)
}

/// No image has a pose.
fn no_pose(declared: &Georeference, images: &[String], bad: &[BadRecord], poses: &Poses) -> InputError {
    let first = images.iter().zip(poses).find_map(|(image, posed)| Some((image, posed.as_ref().err()?)));
    match first {
        Some((image, cause)) if bad.len() < images.len() => of_log(
            declared,
            format!("gives none of the {} images a pose; the first: {image}: {cause}", images.len()),
        ),
        _ => no_rows(declared, bad),
    }
}

fn of_log(declared: &Georeference, cause: String) -> InputError {
    match declared.log.file() {
        Some(file) => InputError::new(file, cause).caused_by(file),
        None => InputError::new(&declared.images, cause).caused_by(&declared.images),
    }
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
fn middle(poses: &Poses) -> Option<Geodetic> {
    let antennas = || poses.iter().flatten().map(|posed| &posed.record.antenna);
    let sum = antennas()
        .map(|antenna| WGS84.ecef_from_geodetic(antenna).vector())
        .fold(nalgebra::Vector3::zeros(), |a, b| a + b);
    let count = antennas().count();
    (count > 0).then(|| WGS84.geodetic_from_ecef(&Point::from_vector(sum / count as f64)))
}

fn frame(
    declared: &Georeference,
    name: &str,
    posed: Posed,
    camera: &Arc<Camera>,
    ground: &SurveyGround,
    geoid: &Geoid,
) -> Result<(GeoreferencedFrame, PoseSource), String> {
    let Posed { record, mount, source } = posed;
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
    let centre = WGS84.geodetic_from_ecef(&Chain::new(&record, &mount).ecef_from_camera().origin);
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
    let frame =
        GeoreferencedFrame::new(name.to_owned(), record, &mount, camera.clone(), terrain, max_range_m)
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
    Ok((frame, source))
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
    if let Some(file) = declared.log.file() {
        context.record_input(file);
    }
    if let LogSource::File { stated, .. } = &declared.log.source {
        for file in [&stated.offset_file, &stated.reference_file].into_iter().flatten() {
            context.record_input(file);
        }
    }
    if let Some(FrameTimes::Table(frames)) = declared.log.join.frames() {
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
    if let Some(matching) = &survey.matching {
        context.write_product("matching.csv", &rows_csv(matching.rows.iter())?)?;
        let figure = matching.figure().map_err(|e| StageError::new(ErrorClass::Bug, e.to_string()))?;
        if let Some(figure) = figure {
            context.write_product("matching.svg", figure.svg.as_bytes())?;
            context.write_product("matching.png", &figure.png)?;
        }
    }
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
        let found = survey.sources.get(&frame.name).map(|source| source.found.clone());
        rows.push(
            FrameRow::of(frame, found, &survey.projection).map_err(|e| StageError::input(e.to_string()))?,
        );
    }
    rows.sort_by(|a, b| a.frame.cmp(&b.frame));
    rows_csv(rows.iter())
}

fn rows_csv<'r, R: serde::Serialize + 'r>(rows: impl Iterator<Item = &'r R>) -> Result<Vec<u8>, StageError> {
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
    pose_found: Option<String>,
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
        pose_found: Option<String>,
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
            pose_found,
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
