//! A synthetic survey as files: photos, logs, truth and terrain, in one folder that appears only when complete.
//!
//! | file | content |
//! |---|---|
//! | `images/IMG_0001.jpg` … | the frames |
//! | `log.csv` | one row per frame: exposure in the camera's clock and the pose the unit logged for it |
//! | `track.csv` | the unit's continuous log, in its own clock |
//! | `truth.csv` | true antenna pose and projection centre per frame |
//! | `targets.csv`, `target_observations.csv` | true target centres; the true pixels at which frames see them |
//! | `runway.csv`, `runway_observations.csv` | the same for the runway's ends and corners |
//! | `dem.tif` | ellipsoidal ground heights on a latitude-longitude grid, WGS 84 (hills only) |
//! | `calibration/target_01.png` …, `calibration/corners.csv` | photos of the squares target; its true corner pixels |
//! | `camera-true.json` | the camera's true parameters, a camera file for `[calibrate] camera` |
//! | `scenario.toml` | the scenario with every default written out |
//!
//! Positions are WGS 84 degrees and ellipsoidal metres, of the antenna unless the column says `camera`; yaw is clockwise
//! from true north, pitch nose up, roll right wing down; pixel (0, 0) is the centre of the top-left pixel.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use gdal::raster::{Buffer, RasterCreationOptions};
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};
use gdal::{DriverManager, Metadata};
use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

use crate::camera::{Brown, Camera, CameraError};
use crate::formats::atomic::{self, WriteError};
use crate::formats::camera::camera_json;
use crate::synthetic::{
    Camera as ScenarioCamera, GeodeticPosition, LogRow, Observation, ReliefShape, Survey,
};
use crate::units::Radians;

/// Distance between the terrain grid's heights, metres.
const DEM_POSTING_M: f64 = 2.0;
/// Terrain beyond what the frames see, in postings: 150 m.
const DEM_MARGIN: f64 = 75.0;
/// Ground further from the camera than this is left out of the terrain, metres: a view of the horizon has no end.
const DEM_REACH_M: f64 = 4000.0;

/// The file by which an older survey is known as such.
const SCENARIO_FILE: &str = "scenario.toml";

/// Why a survey could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SurveyWriteError {
    /// The folder holds a survey and was not to be replaced.
    #[error("folder {} already holds a survey; replace it with --force or name another folder", .0.display())]
    Exists(PathBuf),
    /// The folder holds files that no survey put there.
    #[error("folder {} holds files that are no synthetic survey; name another folder", .0.display())]
    NotASurvey(PathBuf),
    /// The path cannot be a new folder.
    #[error("{} names no folder that could be made", .0.display())]
    NoParent(PathBuf),
    /// The system refused to read, make or rename a folder.
    #[error("cannot {action} folder {}", path.display())]
    Folder {
        /// What was tried.
        action: &'static str,
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file could not be stored.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A table could not be put into text.
    #[error("cannot make table {name}")]
    Table {
        /// Name of the file.
        name: String,
        /// The cause.
        source: csv::Error,
    },
    /// A picture could not be encoded.
    #[error("cannot encode picture {name}")]
    Picture {
        /// Name of the file.
        name: String,
        /// The cause.
        source: image::ImageError,
    },
    /// GDAL could not write the terrain.
    #[error("cannot write terrain dem.tif")]
    Terrain(#[from] gdal::errors::GdalError),
    /// The scenario has no TOML form.
    #[error("cannot write the scenario as TOML")]
    Toml(#[from] toml::ser::Error),
    /// The scenario's camera is none.
    #[error("the camera cannot be written to a camera file")]
    Camera(#[from] CameraError),
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrittenSurvey {
    pub frames: usize,
    pub targets: usize,
    pub calibration_photos: usize,
    /// Pixels per frame without an inverse of the lens, rendered grey.
    pub blind_pixels: usize,
    pub bytes: u64,
}

/// Writes a survey to a folder that does not exist yet or is empty or, with `replace`, holds an older survey.
/// `progress` is called after each picture with the number done and the number in all.
///
/// Everything is written to a hidden folder beside `output` that takes its name when complete.
///
/// # Errors
/// [`SurveyWriteError::Exists`] or [`SurveyWriteError::NotASurvey`] for a folder with files in it, which is then left as
/// it is; otherwise what failed and why, with nothing of the new survey left behind.
pub fn write_survey(
    survey: &Survey,
    output: &Path,
    replace: bool,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<WrittenSurvey, SurveyWriteError> {
    let occupied = output.exists() && fs::read_dir(output).map_err(folder("read", output))?.next().is_some();
    if occupied && !output.join(SCENARIO_FILE).is_file() {
        return Err(SurveyWriteError::NotASurvey(output.to_owned()));
    }
    if occupied && !replace {
        return Err(SurveyWriteError::Exists(output.to_owned()));
    }
    let parent = match output.parent() {
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => return Err(SurveyWriteError::NoParent(output.to_owned())),
    };
    atomic::create_folder(parent)?;
    let temporary = || {
        let mut builder = tempfile::Builder::new();
        builder.prefix(atomic::TEMPORARY_PREFIX);
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o755));
        builder.tempdir_in(parent).map_err(folder("make", output))
    };
    // The files sit one level below the temporary folder, so that renaming leaves it to be removed as usual.
    let partial = temporary()?;
    let mut contents = Contents { root: partial.path().join("survey"), bytes: 0 };
    write_files(survey, &mut contents, progress)?;
    if output.exists() {
        // Moved aside, not deleted: should the second rename fail, the first is taken back.
        let aside = partial.path().join("older");
        fs::rename(output, &aside).map_err(folder("move aside", output))?;
        if let Err(source) = fs::rename(&contents.root, output) {
            fs::rename(&aside, output).map_err(folder("put back", output))?;
            return Err(folder("name", output)(source));
        }
    } else {
        fs::rename(&contents.root, output).map_err(folder("name", output))?;
    }
    Ok(WrittenSurvey {
        frames: survey.frames().len(),
        targets: survey.targets().len(),
        calibration_photos: survey.scenario().calibration.views as usize,
        blind_pixels: survey.blind_pixels(),
        bytes: contents.bytes,
    })
}

fn folder(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> SurveyWriteError {
    move |source| SurveyWriteError::Folder { action, path: path.to_owned(), source }
}

fn write_files(
    survey: &Survey,
    contents: &mut Contents,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<(), SurveyWriteError> {
    let scenario = survey.scenario();
    let views = scenario.calibration.views;
    let pictures = survey.frames().len() + views as usize;
    contents.bytes(SCENARIO_FILE, toml::to_string(scenario)?.as_bytes())?;
    contents.bytes("camera-true.json", true_camera(&scenario.camera)?.as_bytes())?;
    write_tables(survey, contents)?;
    if scenario.relief.shape == ReliefShape::Hills {
        write_dem(survey, contents)?;
    }
    for (index, frame) in survey.frames().iter().enumerate() {
        let picture = survey.render_frame(index);
        contents.image(&format!("images/{}", frame.name), |writer| {
            JpegEncoder::new_with_quality(writer, scenario.photo.jpeg_quality).encode_image(&picture)
        })?;
        progress(index + 1, pictures);
    }
    for index in 0..views {
        let photo = survey.render_target_photo(index);
        contents.image(&format!("calibration/{}", target_photo_name(index)), |writer| {
            PngEncoder::new_with_quality(writer, CompressionType::Best, FilterType::Avg).write_image(
                photo.as_raw(),
                photo.width(),
                photo.height(),
                image::ExtendedColorType::L8,
            )
        })?;
        progress(survey.frames().len() + index as usize + 1, pictures);
    }
    Ok(())
}

/// The scenario's camera as a camera file.
fn true_camera(camera: &ScenarioCamera) -> Result<String, SurveyWriteError> {
    let ScenarioCamera { width_px, height_px, fx_px, fy_px, skew_px, cx_px, cy_px, k1, k2, p1, p2, k3 } =
        *camera;
    let lens = Brown::new([fx_px, fy_px, skew_px, cx_px, cy_px, k1, k2, p1, p2, k3])?;
    let camera = Camera::new(lens, width_px, height_px, None)?;
    Ok(camera_json(&camera, serde_json::json!({ "method": "simulated", "meaning": "the true camera" })))
}

fn target_photo_name(index: u32) -> String {
    format!("target_{:02}.png", index + 1)
}

fn write_tables(survey: &Survey, contents: &mut Contents) -> Result<(), SurveyWriteError> {
    const POSE: [&str; 8] = [
        "time_s",
        "latitude_deg",
        "longitude_deg",
        "height_ellipsoid_m",
        "yaw_deg",
        "pitch_deg",
        "roll_deg",
        "ground_speed_m_s",
    ];
    let frames = survey.frames();
    let logged = frames.iter().map(|frame| [vec![frame.name.clone()], pose(&frame.logged)].concat());
    contents.table("log.csv", &[&["file"][..], &POSE].concat(), logged)?;
    contents.table("track.csv", &POSE, survey.track().iter().map(pose))?;
    let truth = frames
        .iter()
        .map(|frame| [vec![frame.name.clone()], pose(&frame.truth), position(&frame.camera)].concat());
    let camera = ["camera_latitude_deg", "camera_longitude_deg", "camera_height_ellipsoid_m"];
    contents.table("truth.csv", &[&["file"][..], &POSE, &camera].concat(), truth)?;

    const PLACE: [&str; 4] = ["point", "latitude_deg", "longitude_deg", "height_ellipsoid_m"];
    let place = |name: String, at: &GeodeticPosition| [vec![name], position(at)].concat();
    let targets = survey.targets().iter().map(|target| place(target.name.clone(), &target.centre));
    contents.table("targets.csv", &PLACE, targets)?;
    write_observations(contents, "target_observations.csv", survey.observations())?;
    if let Some(runway) = survey.runway() {
        let rows = runway.points().into_iter().map(|(name, at)| place(name, &at));
        contents.table("runway.csv", &PLACE, rows)?;
        write_observations(contents, "runway_observations.csv", survey.runway_observations())?;
    }
    let views = survey.scenario().calibration.views;
    if views > 0 {
        let corners = (0..views).flat_map(|index| {
            survey.target_corners(index).into_iter().map(move |corner| {
                vec![
                    target_photo_name(index),
                    corner.square_row.to_string(),
                    corner.square_column.to_string(),
                    corner.corner.to_string(),
                    format!("{:.3}", corner.x_mm),
                    format!("{:.3}", corner.y_mm),
                    format!("{:.4}", corner.column),
                    format!("{:.4}", corner.row),
                ]
            })
        });
        let header = ["file", "square_row", "square_column", "corner", "x_mm", "y_mm", "column", "row"];
        contents.table("calibration/corners.csv", &header, corners)?;
    }
    Ok(())
}

fn write_observations(
    contents: &mut Contents,
    name: &str,
    seen: Vec<Observation>,
) -> Result<(), SurveyWriteError> {
    let rows = seen
        .into_iter()
        .map(|seen| vec![seen.point, seen.frame, format!("{:.4}", seen.column), format!("{:.4}", seen.row)]);
    contents.table(name, &["point", "file", "column", "row"], rows)
}

/// Ten decimals of a degree are a hundredth of a millimetre.
fn position(at: &GeodeticPosition) -> Vec<String> {
    vec![
        format!("{:.10}", at.latitude_deg),
        format!("{:.10}", at.longitude_deg),
        format!("{:.5}", at.height_m),
    ]
}

fn pose(row: &LogRow) -> Vec<String> {
    let mut cells = vec![format!("{:.6}", row.time_s)];
    cells.extend(position(&row.antenna));
    let attitude = &row.attitude;
    cells
        .extend([attitude.yaw_deg, attitude.pitch_deg, attitude.roll_deg].map(|angle| format!("{angle:.8}")));
    cells.push(format!("{:.3}", row.ground_speed_m_s));
    cells
}

/// Heights on a grid of whole rows and columns around everything the frames see.
fn write_dem(survey: &Survey, contents: &mut Contents) -> Result<(), SurveyWriteError> {
    let extent = Extent::of(survey);
    // About a degree's length on the ground: the posting need not be exact.
    let row_step = DEM_POSTING_M / 111_320.0;
    let column_step = row_step / Radians::from_degrees(survey.scenario().site.latitude_deg).get().cos();
    let west = extent.west_deg - DEM_MARGIN * column_step;
    let north = extent.north_deg + DEM_MARGIN * row_step;
    let columns = ((extent.east_deg - extent.west_deg) / column_step + 2.0 * DEM_MARGIN).ceil() as usize + 1;
    let rows = ((extent.north_deg - extent.south_deg) / row_step + 2.0 * DEM_MARGIN).ceil() as usize + 1;

    let options = RasterCreationOptions::from_iter(["TILED=YES", "COMPRESS=DEFLATE", "PREDICTOR=3"]);
    let driver = DriverManager::get_driver_by_name("GTiff")?;
    let path = contents.path("dem.tif")?;
    let mut dem = driver.create_with_band_type_with_options::<f32, _>(&path, columns, rows, 1, &options)?;
    let mut crs = SpatialRef::from_epsg(4326)?;
    crs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    dem.set_spatial_ref(&crs)?;
    // The first height stands in the middle of the first cell.
    dem.set_geo_transform(&[
        west - 0.5 * column_step,
        column_step,
        0.0,
        north + 0.5 * row_step,
        0.0,
        -row_step,
    ])?;
    let mut band = dem.rasterband(1)?;
    band.set_description("height above the WGS 84 ellipsoid, metres")?;
    for row in 0..rows {
        let latitude_deg = north - row as f64 * row_step;
        let heights = (0..columns)
            .map(|column| survey.ground_height(latitude_deg, west + column as f64 * column_step) as f32);
        let mut heights = Buffer::new((columns, 1), heights.collect());
        band.write((0, row as isize), (columns, 1), &mut heights)?;
    }
    dem.close()?;
    contents.count(&path)
}

/// Latitudes and longitudes of everything the frames see and of the points below the cameras.
struct Extent {
    west_deg: f64,
    east_deg: f64,
    south_deg: f64,
    north_deg: f64,
}

impl Extent {
    fn of(survey: &Survey) -> Self {
        let camera = &survey.scenario().camera;
        let (right, bottom) = (f64::from(camera.width_px) - 1.0, f64::from(camera.height_px) - 1.0);
        let mut extent = Self {
            west_deg: f64::INFINITY,
            east_deg: f64::NEG_INFINITY,
            south_deg: f64::INFINITY,
            north_deg: f64::NEG_INFINITY,
        };
        for frame in survey.frames() {
            extent.include(&frame.camera);
            for part in (0..=32).map(|step| f64::from(step) / 32.0) {
                let (column, row) = (part * right, part * bottom);
                for (column, row) in [(column, 0.0), (column, bottom), (0.0, row), (right, row)] {
                    let seen = survey.ground_from_pixel(frame, column, row);
                    if let Some(seen) = seen
                        && (seen.ecef() - frame.camera.ecef()).norm() < DEM_REACH_M
                    {
                        extent.include(&seen);
                    }
                }
            }
        }
        extent
    }

    fn include(&mut self, at: &GeodeticPosition) {
        self.west_deg = self.west_deg.min(at.longitude_deg);
        self.east_deg = self.east_deg.max(at.longitude_deg);
        self.south_deg = self.south_deg.min(at.latitude_deg);
        self.north_deg = self.north_deg.max(at.latitude_deg);
    }
}

/// The folder being filled, and what it weighs.
struct Contents {
    root: PathBuf,
    bytes: u64,
}

impl Contents {
    /// A file's path, its folder made.
    fn path(&self, name: &str) -> Result<PathBuf, SurveyWriteError> {
        let path = self.root.join(name);
        atomic::create_folder(path.parent().unwrap_or(&self.root))?;
        Ok(path)
    }

    fn count(&mut self, path: &Path) -> Result<(), SurveyWriteError> {
        self.bytes += fs::metadata(path).map_err(folder("read", path))?.len();
        Ok(())
    }

    fn bytes(&mut self, name: &str, bytes: &[u8]) -> Result<(), SurveyWriteError> {
        let path = self.path(name)?;
        atomic::write_atomic(&path, bytes)?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    fn table(
        &mut self,
        name: &str,
        header: &[&str],
        rows: impl Iterator<Item = Vec<String>>,
    ) -> Result<(), SurveyWriteError> {
        let wrap = |source| SurveyWriteError::Table { name: name.to_owned(), source };
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(header).map_err(wrap)?;
        for row in rows {
            writer.write_record(&row).map_err(wrap)?;
        }
        let bytes = writer.into_inner().map_err(|error| wrap(error.into_error().into()))?;
        self.bytes(name, &bytes)
    }

    fn image(
        &mut self,
        name: &str,
        encode: impl FnOnce(&mut Vec<u8>) -> image::ImageResult<()>,
    ) -> Result<(), SurveyWriteError> {
        let mut bytes = Vec::new();
        encode(&mut bytes).map_err(|source| SurveyWriteError::Picture { name: name.to_owned(), source })?;
        self.bytes(name, &bytes)
    }
}
