//! `mosaic`: georeferenced frames in, one Cloud Optimized GeoTIFF out, with a picture and a description.

use super::context::{ErrorClass, FrameStatus, RunContext, StageError};
use super::georeference::{Georeferenced, RejectedFrame};
use crate::config::mosaic::{Blend as DeclaredBlend, Mosaic, MosaicSpec, Resampling};
use crate::config::{Config, Located};
use crate::formats::geotiff::{
    ColourWriter, Encoding, GDAL_CACHE, GeotiffError, RasterDescription, ReducedTile, png, read_preview,
    set_up,
};
use crate::formats::photo::{self, PhotoHeader, PhotoStore};
use crate::georeference::GeoreferencedFrame;
use crate::mosaic::{
    Blend, FrameFailure, FrameSource, MapBounds, MosaicPlan, PlanError, PlanSettings, RenderError,
    ScheduleError, TILE, TilePixels, automatic_gsd_m, render_all, render_tile, stored_channels,
};
use crate::raster::Kernel;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The finished mosaic.
#[derive(Debug, Clone)]
pub struct MosaicProduct {
    /// The Cloud Optimized GeoTIFF.
    pub raster: PathBuf,
    /// The picture.
    pub preview: PathBuf,
    /// Frames that turned out unusable here, ordered by name.
    pub rejected: Vec<RejectedFrame>,
    /// What `mosaic.json` says.
    pub summary: MosaicSummary,
}

/// `mosaic.json`.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MosaicSummary {
    /// Always "boresight mosaic".
    pub format: &'static str,
    /// Of this format.
    pub version: u32,
    /// CRS as declared or found.
    pub crs: String,
    /// Its own name.
    pub crs_name: String,
    /// Easting of the west side of the first column, map units.
    pub west: f64,
    /// Northing of the north side of the first row, map units.
    pub north: f64,
    /// Side of a pixel, map units.
    pub cell: f64,
    /// Side of a pixel, metres.
    pub gsd_m: f64,
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// 1 (grey) or 3 (colour), and transparency.
    pub channels: usize,
    /// Ground covered by the opaque pixels, square metres of the map.
    pub covered_m2: f64,
    /// Blending.
    pub blend: DeclaredBlend,
    /// Resampling.
    pub resampling: Resampling,
    /// Smallest, median and greatest ground sample distance of the frames, metres.
    pub frame_gsd_m: [f64; 3],
    /// The mosaic's ground sample distance over the frames' median: above 1 it is coarser than the frames.
    pub resampling_ratio: f64,
    /// Tiles, and how many of them show anything.
    pub tiles: usize,
    /// Tiles that show something.
    pub tiles_with_content: usize,
    /// BLAKE3 over the frames' names, pixels and poses and the grid.
    pub input_hash: String,
    /// Frames that show in the mosaic.
    pub frames_used: Vec<String>,
    /// Usable frames that show nowhere in it, because the bounds leave them out.
    pub frames_outside: Vec<String>,
    /// Frames that turned out unusable.
    pub frames_rejected: Vec<RejectedFrame>,
}

/// Renders the mosaic and writes `mosaic.tif`, `preview.png` and `mosaic.json`.
///
/// A frame whose photo cannot be decoded is rejected, and the mosaic is the one of the remaining frames to
/// the byte: on the first such frame the work so far is dropped, every other photo is tried once, and the
/// mosaic is planned anew. So the usual run decodes no photo just to test it.
///
/// # Errors
/// [`StageError`]: no usable frame, an absurd extent, a product that cannot be written, or the user's stop.
pub fn run(
    config: &Config,
    survey: &Georeferenced,
    context: &RunContext,
) -> Result<MosaicProduct, StageError> {
    let declared =
        config.mosaic.as_ref().ok_or_else(|| StageError::pipeline("the pipeline has no [mosaic] table"))?;
    let images = images_folder(config)?;
    set_up();
    let path = context.product_path("mosaic.tif")?;
    let mut rejected: BTreeMap<String, String> = BTreeMap::new();
    let mut frames = survey.frames.clone();
    let channels = look_at_headers(images, &mut frames, &mut rejected, context);
    let (plan, raster) = loop {
        if frames.is_empty() {
            return Err(none_left(&rejected));
        }
        let plan = MosaicPlan::new(
            frames.clone(),
            Arc::new(survey.projection.clone()),
            &settings(declared, survey, channels),
        )
        .map_err(|e| unplannable(config, declared, e))?;
        if plan.width.min(plan.height) < 2 {
            let key = declared.gsd_m.as_ref().map(|gsd| Located { value: (), span: gsd.span.clone() });
            return Err(StageError::pipeline(format!(
                "at {} m per pixel the whole survey falls into {} × {} pixels",
                plan.gsd_m, plan.width, plan.height
            ))
            .at(key.and_then(|key| config.at(&key)))
            .help("choose a smaller gsd, or \"auto\""));
        }
        match render(config, declared, survey, &plan, images, &path, context) {
            Ok(raster) => break (plan, raster),
            Err(Failure::Stage(error)) => return Err(error),
            Err(Failure::Frame(failure)) => {
                context.warn(format!("{failure}; planning again without it"));
                rejected.insert(failure.name, failure.cause);
                for (name, cause) in undecodable(images, &frames, &rejected) {
                    rejected.insert(name, cause);
                }
                frames.retain(|f| !rejected.contains_key(&f.name));
            }
        }
    };
    context.record_product(&path);
    let rejected: Vec<RejectedFrame> =
        rejected.into_iter().map(|(frame, reason)| RejectedFrame { frame, reason }).collect();
    for frame in &rejected {
        context.record_frame(&frame.frame, FrameStatus::Rejected { reason: frame.reason.clone() });
    }
    for frame in &plan.frames {
        context.record_frame(&frame.frame.name, FrameStatus::Used);
    }
    let picture = read_preview(&path, declared.preview_width_px as usize).map_err(unwritable)?;
    let bytes = png(&picture).map_err(|e| StageError::new(ErrorClass::Bug, e))?;
    let preview = context.write_product("preview.png", &bytes)?;
    let summary = summary(declared, survey, &plan, &raster, rejected.clone());
    let json = serde_json::to_string_pretty(&summary)
        .map_err(|e| StageError::new(ErrorClass::Bug, e.to_string()))?;
    context.write_product("mosaic.json", (json + "\n").as_bytes())?;
    Ok(MosaicProduct { raster: path, preview, rejected, summary })
}

/// One orthorectified GeoTIFF per frame, on the grid of the mosaic: `orthos/<name>.tif`.
///
/// Grid, resampling and compression are those of `[mosaic]`, or its defaults without such a table. Frames
/// whose photo cannot be decoded are rejected.
///
/// # Errors
/// As [`run`].
pub fn orthos(
    config: &Config,
    survey: &Georeferenced,
    context: &RunContext,
) -> Result<Vec<RejectedFrame>, StageError> {
    let images = images_folder(config)?;
    set_up();
    let fallback = without_table();
    let declared = config.mosaic.as_ref().unwrap_or(&fallback);
    let mut rejected: BTreeMap<String, String> = BTreeMap::new();
    let mut frames = survey.frames.clone();
    let channels = look_at_headers(images, &mut frames, &mut rejected, context);
    if frames.is_empty() {
        return Err(none_left(&rejected));
    }
    let settings = PlanSettings {
        gsd_m: Some(match &declared.gsd_m {
            Some(gsd_m) => gsd_m.value,
            None => automatic_gsd_m(&frames).map_err(|e| unplannable(config, declared, e))?,
        }),
        bounds: None,
        blend: Blend::None,
        ..settings(declared, survey, channels)
    };
    let task = context.task("rendering orthos", frames.len());
    let results: Vec<Result<Option<(String, String)>, StageError>> = frames
        .into_par_iter()
        .map(|frame| {
            context.check_interrupted()?;
            let name = frame.name.clone();
            let path = context.product_path(&format!("orthos/{name}.tif"))?;
            let done = ortho(config, declared, survey, frame, &settings, images, &path);
            task.advance(1);
            match done {
                Ok(()) => {
                    context.record_product(&path);
                    Ok(None)
                }
                Err(Failure::Frame(failure)) => Ok(Some((failure.name, failure.cause))),
                Err(Failure::Stage(error)) => Err(error),
            }
        })
        .collect();
    for result in results {
        rejected.extend(result?);
    }
    for (frame, reason) in &rejected {
        context.record_frame(frame, FrameStatus::Rejected { reason: reason.clone() });
    }
    Ok(rejected.into_iter().map(|(frame, reason)| RejectedFrame { frame, reason }).collect())
}

fn ortho(
    config: &Config,
    declared: &Mosaic,
    survey: &Georeferenced,
    frame: GeoreferencedFrame,
    settings: &PlanSettings,
    images: &Path,
    path: &Path,
) -> Result<(), Failure> {
    let store = PhotoStore::new(vec![images.join(&frame.name)], settings.channels, usize::MAX);
    let name = frame.name.clone();
    // The photo first: a grid for a frame that cannot be decoded is of no use.
    store.frame(0)?;
    let plan = MosaicPlan::new(vec![frame], Arc::new(survey.projection.clone()), settings)
        .map_err(|e| unplannable(config, declared, e))?;
    let mut writer = writer(survey, &plan, path, encoding(declared, 1))?;
    for tile in plan.order() {
        let tile = render_tile(&plan, tile, &store).map_err(|e| render_failed(config, declared, e))?;
        writer.write(ReducedTile::new(tile, writer.levels())).map_err(unwritable)?;
    }
    let metadata = vec![
        ("BORESIGHT_FRAME".to_owned(), name),
        ("BORESIGHT_INPUT_HASH".to_owned(), input_hash(&plan, &store)),
    ];
    writer.finish(&metadata).map_err(unwritable)?;
    Ok(())
}

/// The defaults of `[mosaic]`, for a pipeline that has no such table.
fn without_table() -> Mosaic {
    let spec = MosaicSpec::default();
    Mosaic {
        table: Located::unplaced(()),
        gsd_m: None,
        blend: spec.blend,
        memory_bytes: spec.memory.as_ref().map(|memory| memory.bytes()),
        compression: spec.compression,
        quality: 90,
        resampling: spec.resampling,
        preview_width_px: spec.preview_width_px.value,
        bounds: None,
    }
}

/// The program itself with its libraries, and a photo's file while it is decoded, bytes.
const PROGRAM: usize = 96 << 20;

/// What ends the rendering of a plan.
enum Failure {
    /// One frame is unusable.
    Frame(FrameFailure),
    /// The stage is.
    Stage(StageError),
}

impl From<StageError> for Failure {
    fn from(error: StageError) -> Self {
        Self::Stage(error)
    }
}
impl From<FrameFailure> for Failure {
    fn from(failure: FrameFailure) -> Self {
        Self::Frame(failure)
    }
}

/// What was seen while rendering.
struct Rendered {
    opaque_px: u64,
    tiles_with_content: usize,
    frames: BTreeSet<usize>,
    input_hash: String,
}

fn render(
    config: &Config,
    declared: &Mosaic,
    survey: &Georeferenced,
    plan: &MosaicPlan,
    images: &Path,
    path: &Path,
    context: &RunContext,
) -> Result<Rendered, Failure> {
    let threads = rayon::current_num_threads();
    let overhead = threads * tile_bytes(plan.channels) + GDAL_CACHE + PROGRAM;
    let budget = declared.memory_bytes.value as usize;
    let largest = plan.frames.iter().map(|f| decoded_bytes(&f.frame, plan.channels)).max().unwrap_or(0);
    // Below one photo per thread the store would only decode the same photos over and over.
    let ceiling = budget.saturating_sub(overhead).max(threads * largest);
    // Logged, not recorded: products must not depend on the number of threads.
    if ceiling + overhead > budget {
        tracing::warn!(
            "memory: {} MiB are needed for {threads} threads, {} MiB are allowed",
            (ceiling + overhead) >> 20,
            budget >> 20
        );
    }
    let all: usize = plan.frames.iter().map(|f| decoded_bytes(&f.frame, plan.channels)).sum();
    tracing::debug!("memory: at most {} MiB planned", (ceiling.min(all) + overhead) >> 20);
    let paths = plan.frames.iter().map(|f| images.join(&f.frame.name)).collect();
    let store = PhotoStore::new(paths, plan.channels, ceiling);
    let mut rendered =
        Rendered { opaque_px: 0, tiles_with_content: 0, frames: BTreeSet::new(), input_hash: String::new() };
    let mut writer = writer(survey, plan, path, encoding(declared, threads))?;
    let levels = writer.levels();
    let task = context.task("rendering tiles", plan.tiles.len());
    let prepare = |tile: TilePixels| {
        let opaque = tile.alpha.iter().filter(|a| **a != 0).count();
        (opaque, tile.frames.clone(), ReducedTile::new(tile, levels))
    };
    let sink = |(opaque, frames, tile): (usize, Vec<usize>, ReducedTile)| -> Result<(), StageError> {
        context.check_interrupted()?;
        rendered.opaque_px += opaque as u64;
        rendered.tiles_with_content += usize::from(opaque > 0);
        rendered.frames.extend(frames);
        writer.write(tile).map_err(unwritable)?;
        task.advance(1);
        Ok(())
    };
    render_all(plan, &store, prepare, sink).map_err(|e| match e {
        ScheduleError::Sink(error) => Failure::Stage(error),
        ScheduleError::Render(error) => render_failed(config, declared, error),
    })?;
    tracing::debug!(decoded = store.decoded(), frames = plan.frames.len(), "photos decoded");
    drop(task);
    rendered.input_hash = input_hash(plan, &store);
    let task = context.task("writing the mosaic", 1);
    let metadata = vec![
        ("BORESIGHT_FRAMES".to_owned(), rendered.frames.len().to_string()),
        ("BORESIGHT_INPUT_HASH".to_owned(), rendered.input_hash.clone()),
    ];
    writer.finish(&metadata).map_err(unwritable)?;
    task.advance(1);
    Ok(rendered)
}

fn images_folder(config: &Config) -> Result<&Path, StageError> {
    let declared = config
        .georeference
        .as_ref()
        .ok_or_else(|| StageError::pipeline("the pipeline has no [georeference] table"))?;
    Ok(&declared.images)
}

fn settings(declared: &Mosaic, survey: &Georeferenced, channels: usize) -> PlanSettings {
    PlanSettings {
        gsd_m: declared.gsd_m.as_ref().map(|g| g.value),
        bounds: declared.bounds.as_ref().map(|b| MapBounds {
            west: b.west,
            south: b.south,
            east: b.east,
            north: b.north,
        }),
        metres_per_unit: survey.projection.metres_per_unit(),
        channels,
        kernel: match declared.resampling {
            Resampling::Nearest => Kernel::Nearest,
            Resampling::Bilinear => Kernel::Bilinear,
            Resampling::Cubic => Kernel::Cubic,
        },
        blend: match declared.blend {
            DeclaredBlend::Feather => Blend::Feather,
            DeclaredBlend::None => Blend::None,
        },
    }
}

fn encoding(declared: &Mosaic, threads: usize) -> Encoding {
    Encoding { compression: declared.compression.value, quality: declared.quality, threads }
}

/// Drops the frames whose header cannot be read; 3 channels unless all the others are grey.
fn look_at_headers(
    images: &Path,
    frames: &mut Vec<GeoreferencedFrame>,
    rejected: &mut BTreeMap<String, String>,
    context: &RunContext,
) -> usize {
    let headers: Vec<Result<PhotoHeader, String>> = frames
        .par_iter()
        .map(|frame| {
            let header = photo::read_header(&images.join(&frame.name)).map_err(|e| e.cause)?;
            let expected = frame.stored_size();
            if (header.width, header.height) != expected {
                return Err(format!(
                    "the image is {} × {} px, the camera's are {} × {}",
                    header.width, header.height, expected.0, expected.1
                ));
            }
            Ok(header)
        })
        .collect();
    let good = || headers.iter().flatten();
    let sixteen = good().filter(|h| h.sixteen_bits).count();
    if sixteen > 0 {
        context.warn(format!("{sixteen} photos have 16 bits per sample: scaled to 8 (65535 becomes 255)"));
    }
    let channels = if good().all(|h| h.channels == 1) { 1 } else { 3 };
    for (frame, header) in frames.iter().zip(&headers) {
        if let Err(cause) = header {
            rejected.insert(frame.name.clone(), cause.clone());
        }
    }
    frames.retain(|f| !rejected.contains_key(&f.name));
    channels
}

/// Every frame not yet rejected whose photo cannot be decoded.
fn undecodable(
    images: &Path,
    frames: &[GeoreferencedFrame],
    rejected: &BTreeMap<String, String>,
) -> Vec<(String, String)> {
    frames
        .par_iter()
        .filter(|f| !rejected.contains_key(&f.name))
        .filter_map(|f| photo::decode(&images.join(&f.name)).err().map(|error| (f.name.clone(), error.cause)))
        .collect()
}

fn writer(
    survey: &Georeferenced,
    plan: &MosaicPlan,
    path: &Path,
    encoding: Encoding,
) -> Result<ColourWriter, StageError> {
    let description = RasterDescription {
        grid: plan.grid,
        wkt: survey.projection.wkt().to_owned(),
        metadata: vec![
            ("TIFFTAG_SOFTWARE".to_owned(), format!("boresight {}", env!("CARGO_PKG_VERSION"))),
            ("BORESIGHT_GSD_M".to_owned(), plan.gsd_m.to_string()),
        ],
    };
    ColourWriter::create(path, (plan.width, plan.height), plan.channels, &description, encoding)
        .map_err(unwritable)
}

/// BLAKE3 over everything the pixels depend on.
fn input_hash(plan: &MosaicPlan, store: &PhotoStore) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut number = |v: f64| {
        hasher.update(&v.to_le_bytes());
    };
    number(plan.cell);
    plan.grid.to_gdal().into_iter().for_each(&mut number);
    for frame in &plan.frames {
        let pose = frame.frame.ecef_from_camera();
        pose.rotation.matrix().iter().copied().for_each(&mut number);
        pose.origin.vector().iter().copied().for_each(&mut number);
        let lens = &frame.frame.camera.lens;
        lens.interior().into_iter().take(lens.names().len()).for_each(&mut number);
    }
    for (frame, hash) in plan.frames.iter().zip(store.hashes()) {
        hasher.update(frame.frame.name.as_bytes());
        // A photo that was never opened has no part in the pixels.
        hasher.update(hash.as_ref().map_or(&[0; 32], |h| h.as_bytes()));
    }
    hasher.finalize().to_hex().to_string()
}

/// A decoded frame with its reductions.
fn decoded_bytes(frame: &GeoreferencedFrame, channels: usize) -> usize {
    let (width, height) = frame.stored_size();
    width as usize * height as usize * stored_channels(channels) / 3 * 4
}

/// What rendering one tile holds: sums and weights, the finished planes with their reductions, terrain heights.
const fn tile_bytes(channels: usize) -> usize {
    TILE * TILE * (4 * (stored_channels(channels) + 1) + 2 * (channels + 1) + 8)
}

fn none_left(rejected: &BTreeMap<String, String>) -> StageError {
    let first = rejected.iter().next().map_or(String::new(), |(name, cause)| format!("; {name}: {cause}"));
    StageError::input(format!("none of the {} georeferenced photos can be used{first}", rejected.len()))
}

fn unplannable(config: &Config, declared: &Mosaic, error: PlanError) -> StageError {
    let place = match (&error, &declared.bounds, &declared.gsd_m) {
        (PlanError::EmptyBounds { .. } | PlanError::NothingInside, Some(bounds), _) => config.at(bounds),
        (PlanError::Gsd { .. }, _, Some(gsd)) => config.at(gsd),
        _ => config.at(&declared.table),
    };
    StageError::input(error.to_string()).at(place)
}

fn render_failed(config: &Config, declared: &Mosaic, error: RenderError) -> Failure {
    match error {
        RenderError::Frame(failure) => Failure::Frame(failure),
        other => Failure::Stage(StageError::input(other.to_string()).at(config.at(&declared.table))),
    }
}

fn unwritable(error: GeotiffError) -> StageError {
    match error {
        GeotiffError::File(error) => error.into(),
        GeotiffError::Compression { .. } => StageError::input(error.to_string())
            .help("choose another `compression`, for example \"deflate\", which every GDAL has"),
        GeotiffError::Write { .. } => StageError::new(ErrorClass::Io, error.to_string())
            .help("is the disk full? choose a folder on another disk: --output DIR"),
        GeotiffError::Read { .. } => StageError::new(ErrorClass::Io, error.to_string()),
    }
}

fn summary(
    declared: &Mosaic,
    survey: &Georeferenced,
    plan: &MosaicPlan,
    rendered: &Rendered,
    frames_rejected: Vec<RejectedFrame>,
) -> MosaicSummary {
    let corner = plan.grid.map_from_pixel(-0.5, -0.5);
    let mut gsds: Vec<f64> = plan.frames.iter().map(|f| f.frame.footprint.gsd_m).collect();
    gsds.sort_by(f64::total_cmp);
    // A plan has at least one frame.
    let of = |share: f64| gsds[((gsds.len() - 1) as f64 * share).round() as usize];
    let names = |used: bool| {
        plan.frames
            .iter()
            .enumerate()
            .filter(|(i, _)| rendered.frames.contains(i) == used)
            .map(|(_, f)| f.frame.name.clone())
            .collect()
    };
    MosaicSummary {
        format: "boresight mosaic",
        version: 1,
        crs: survey.projection.definition().to_owned(),
        crs_name: survey.projection.name().to_owned(),
        west: corner.easting,
        north: corner.northing,
        cell: plan.cell,
        gsd_m: plan.gsd_m,
        width_px: plan.width,
        height_px: plan.height,
        channels: plan.channels,
        covered_m2: rendered.opaque_px as f64 * plan.gsd_m * plan.gsd_m,
        blend: declared.blend,
        resampling: declared.resampling,
        frame_gsd_m: [of(0.0), of(0.5), of(1.0)],
        resampling_ratio: plan.gsd_m / of(0.5),
        tiles: plan.tiles.len(),
        tiles_with_content: rendered.tiles_with_content,
        input_hash: rendered.input_hash.clone(),
        frames_used: names(true),
        frames_outside: names(false),
        frames_rejected,
    }
}
