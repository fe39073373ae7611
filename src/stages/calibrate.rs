//! `calibrate`: a camera file, written parameters, photos of a target or known corners in, one camera out.

mod overlay;

use super::camera::camera_from_parameters;
use super::context::{ErrorClass, RunContext, StageError};
use super::georeference::failed;
use crate::calibration::{BoardPoint, PointResidual};
use crate::calibration::{
    Calibration, CalibrationError, ClosedForm, DetectedCorner, Detection, Grey, LensModel, Marker,
    MarkerSeen, Observation, SquaresTarget, StartError, ViewPoints, calibrate, detect,
};
use crate::camera::{Camera, ImagePoint};
use crate::config::calibrate::{
    CameraSource, HollowSquare, LensModel as DeclaredLens, ModelSpec, Target, TargetCorners, TargetPhotos,
};
use crate::config::{Config, Located};
use crate::formats::camera::{camera_json, camera_opencv_yaml, read_camera};
use crate::formats::corners::read_pairs;
use crate::formats::{InputError, files, photo};
use crate::raster::Image8;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The stage's main product, read back by later stages.
pub const CAMERA_FILE: &str = "camera.json";

/// The camera, and how it came about.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The camera.
    pub camera: Arc<Camera>,
    /// The adjustment, when the camera was calibrated in this run.
    pub calibration: Option<Calibration>,
    /// Photos of the target: those used, in the order of the calibration's views.
    pub photos: Vec<TargetPhoto>,
    /// Photos of the target that could not be used, ordered by name.
    pub rejected: Vec<RejectedPhoto>,
    /// Files that were read.
    pub inputs: Vec<PathBuf>,
    /// What the user should know but need not act on.
    pub notes: Vec<String>,
    /// Where the camera's numbers come from, for its file.
    source: Value,
}

/// A photo in which the target was found.
#[derive(Debug, Clone)]
pub struct TargetPhoto {
    /// The file.
    pub file: PathBuf,
    /// Its corners.
    pub detection: Detection,
}

/// A photo without usable corners.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RejectedPhoto {
    /// File name.
    pub file: String,
    /// Why.
    pub reason: String,
}

/// Makes the camera that the pipeline declares, in memory.
///
/// # Errors
/// A file cannot be used, fewer than three photos show the target, or they do not determine the camera.
pub fn make(config: &Config, context: &RunContext) -> Result<Calibrated, StageError> {
    match &config.calibrate.camera {
        CameraSource::File(file) => {
            let camera = read_camera(file).map_err(|e| failed(config, e.caused_by(file)))?;
            let source = json!({ "method": "file", "file": file_name(file) });
            Ok(Calibrated { inputs: vec![file.value.clone()], ..Calibrated::given(camera, source) })
        }
        CameraSource::Parameters(spec) => {
            let camera = camera_from_parameters(config, spec)?;
            Ok(Calibrated::given(camera, json!({ "method": "parameters" })))
        }
        CameraSource::Photos(photos) => from_photos(config, photos, context),
        CameraSource::Corners(corners) => from_corners(config, corners),
    }
}

/// True when [`look`] has a camera without calibrating: none is to be estimated, or an earlier run left it.
#[must_use]
pub fn is_left_in(config: &Config, run_folder: &Path) -> bool {
    match &config.calibrate.camera {
        CameraSource::File(_) | CameraSource::Parameters(_) => true,
        CameraSource::Photos(_) | CameraSource::Corners(_) => {
            run_folder.join("calibrate").join(CAMERA_FILE).is_file()
        }
    }
}

/// The camera without the work of calibrating: of a camera file or parameters directly, otherwise the one
/// that an earlier run left in `run_folder`.
///
/// # Errors
/// As [`make`], or no earlier run has left a camera.
pub fn look(config: &Config, run_folder: &Path) -> Result<Camera, StageError> {
    match &config.calibrate.camera {
        CameraSource::File(file) => read_camera(file).map_err(|e| failed(config, e.caused_by(file))),
        CameraSource::Parameters(spec) => camera_from_parameters(config, spec),
        CameraSource::Photos(_) | CameraSource::Corners(_) => {
            let file = run_folder.join("calibrate").join(CAMERA_FILE);
            if !file.is_file() {
                let what = format!("the camera has not been calibrated: {} does not exist", file.display());
                return Err(StageError::input(what).help("run the pipeline first: --until calibrate"));
            }
            read_camera(&file).map_err(|e| failed(config, e))
        }
    }
}

/// Makes the camera and writes `camera.json` and `camera-opencv.yaml`; after a calibration also
/// `calibrate.json` (its numbers), `corners.csv` and, from photos, `overlay.png` (the calibrated camera's view
/// of the target over the photo that fits worst).
///
/// # Errors
/// As [`make`], and when a product cannot be written.
pub fn run(config: &Config, context: &RunContext) -> Result<Calibrated, StageError> {
    let made = make(config, context)?;
    for input in &made.inputs {
        context.record_input(input);
    }
    for RejectedPhoto { file, reason } in &made.rejected {
        context.warn(format!("{file} is not used: {reason}"));
    }
    for note in &made.notes {
        context.warn(note.clone());
    }
    context.write_product(CAMERA_FILE, camera_json(&made.camera, made.source.clone()).as_bytes())?;
    context.write_product("camera-opencv.yaml", camera_opencv_yaml(&made.camera).text.as_bytes())?;
    if let Some(calibration) = &made.calibration {
        let worst = worst_view(calibration);
        context.write_product("corners.csv", &corners_csv(&made, calibration)?)?;
        context.write_product("calibrate.json", summary(&made, calibration, worst).as_bytes())?;
        if let Some(photo) = made.photos.get(worst) {
            let image = photo::decode(&photo.file).map_err(|e| failed(config, e))?;
            context.write_product("overlay.png", &overlay::draw(image, &calibration.views[worst].points)?)?;
        }
    }
    Ok(made)
}

impl Calibrated {
    /// A camera that nothing had to be estimated for.
    fn given(camera: Camera, source: Value) -> Self {
        Self {
            camera: Arc::new(camera),
            calibration: None,
            photos: Vec::new(),
            rejected: Vec::new(),
            inputs: Vec::new(),
            notes: Vec::new(),
            source,
        }
    }

    fn estimated(calibration: Calibration, method: &str) -> Self {
        let source = json!({
            "method": method,
            "views": calibration.views.len(),
            "points": calibration.points(),
            "rms_px": calibration.rms_px,
            "sigma0_px": calibration.sigma0_px,
            "supported_ideal_radius": calibration.support.max_ideal_radius,
        });
        let notes = notes(&calibration);
        Self { calibration: Some(calibration.clone()), notes, ..Self::given(calibration.camera, source) }
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn lens_model(declared: ModelSpec, side: bool) -> LensModel {
    let lens = match declared.lens {
        DeclaredLens::Brown5 => LensModel::BROWN,
        DeclaredLens::Radial2 => LensModel::RADIAL2,
        DeclaredLens::Radial2Tangential2 => LensModel::RADIAL2_TANGENTIAL2,
    };
    lens.with_skew(declared.skew).with_side(side)
}

fn squares_target(declared: &Target) -> Result<SquaresTarget, StageError> {
    let marker = match declared.hollow {
        HollowSquare::UpperLeft => Marker::UpperLeft,
        HollowSquare::None => Marker::None,
    };
    let (rows, columns) = (declared.rows as usize, declared.columns as usize);
    SquaresTarget::new(rows, columns, declared.square_m, declared.gap_m, marker)
        .map_err(|e| StageError::pipeline(format!("[calibrate.target]: {e}")))
}

/// Brightness as the eye weighs colours (ITU-R BT.601, as JPEG and OpenCV do).
fn grey(image: &Image8) -> Vec<f32> {
    if image.channels() == 1 {
        return image.samples().iter().map(|v| f32::from(*v)).collect();
    }
    image
        .samples()
        .chunks_exact(3)
        .map(|rgb| 0.299 * f32::from(rgb[0]) + 0.587 * f32::from(rgb[1]) + 0.114 * f32::from(rgb[2]))
        .collect()
}

/// What one photo gave: its size and corners, or why it is not used.
fn look_at(file: &Path, target: &SquaresTarget) -> Result<(usize, usize, Detection), String> {
    let image = photo::decode(file).map_err(|e| e.cause)?;
    let (width, height) = (image.width(), image.height());
    let detection = Grey::new(width, height, grey(&image))
        .map_err(|e| e.to_string())
        .and_then(|grey| detect(&grey, target).map_err(|e| e.to_string()))?;
    Ok((width, height, detection))
}

fn from_photos(
    config: &Config,
    declared: &TargetPhotos,
    context: &RunContext,
) -> Result<Calibrated, StageError> {
    let place = config.at(&declared.patterns);
    let target = squares_target(&declared.target)?;
    let found = files::matching(&config.base, &declared.patterns)
        .map_err(|e| StageError::input(e.to_string()).at(place.clone()))?;
    let task = context.task("finding corners", found.len());
    let looked: Vec<_> = found
        .par_iter()
        .map(|file| {
            context.check_interrupted()?;
            let seen = look_at(file, &target);
            task.advance(1);
            Ok(seen)
        })
        .collect::<Result<_, StageError>>()?;
    drop(task);
    let mut size: Option<(usize, usize, String)> = None;
    let (mut photos, mut rejected) = (Vec::new(), Vec::new());
    for (file, seen) in found.iter().zip(looked) {
        let name = file_name(file);
        match seen {
            Err(reason) => rejected.push(RejectedPhoto { file: name, reason }),
            Ok((width, height, detection)) => {
                let (w, h, first) = size.get_or_insert_with(|| (width, height, name.clone()));
                if (width, height) != (*w, *h) {
                    let what = format!("{name} is {width} × {height} px but {first} is {w} × {h} px");
                    return Err(StageError::input(what)
                        .at(place)
                        .help("calibrate from photos of one camera at one size, all turned the same way"));
                }
                photos.push(TargetPhoto { file: file.clone(), detection });
            }
        }
    }
    let (Some((width, height, _)), true) = (size, photos.len() >= 3) else {
        let reasons = rejected.iter().map(|r| format!("\n  {}: {}", r.file, r.reason)).collect::<String>();
        let what = format!(
            "{} of {} photos show the target, at least 3 are needed{reasons}",
            photos.len(),
            found.len()
        );
        return Err(StageError::input(what).at(place).help(
            "check [calibrate.target] against the target, and photograph all of it, sharp and evenly lit",
        ));
    };
    let views: Vec<ViewPoints> = photos
        .iter()
        .map(|photo| ViewPoints {
            name: file_name(&photo.file),
            observations: photo.detection.observations(),
        })
        .collect();
    let calibration = calibrate(&views, width as u32, height as u32, lens_model(declared.model, true))
        .map_err(|e| refused(e, config, &declared.patterns))?;
    let mut made = Calibrated::estimated(calibration, "photos");
    for photo in photos.iter().filter(|photo| !photo.detection.missing.is_empty()) {
        let missing = photo.detection.missing.len();
        made.notes.push(format!("{}: {missing} square(s) of the target are hidden", file_name(&photo.file)));
    }
    Ok(Calibrated { photos, rejected, inputs: found, ..made })
}

fn from_corners(config: &Config, declared: &TargetCorners) -> Result<Calibrated, StageError> {
    let at = |e: InputError, key: &Located<PathBuf>| failed(config, e.caused_by(key));
    let board = read_pairs(&declared.model_file).map_err(|e| at(e, &declared.model_file))?;
    let shift = declared.pixel_origin.offset_to_centre_px();
    let mut views = Vec::with_capacity(declared.views.len());
    for file in &declared.views {
        let pixels = read_pairs(file).map_err(|e| at(e, file))?;
        if pixels.len() != board.len() {
            let (found, needed) = (pixels.len(), board.len());
            let model = file_name(&declared.model_file);
            let cause = format!("holds {found} corners but {model} holds {needed}");
            return Err(at(InputError::new(file, cause), file));
        }
        let observations = board
            .iter()
            .zip(pixels)
            .map(|(&(x, y), (column, row))| Observation {
                board: BoardPoint { x_m: x * declared.model_unit_m, y_m: y * declared.model_unit_m },
                growth: BoardPoint { x_m: 0.0, y_m: 0.0 },
                pixel: ImagePoint::new(column + shift, row + shift),
            })
            .collect();
        views.push(ViewPoints { name: file_name(file), observations });
    }
    let (width, height) = (declared.image_width_px, declared.image_height_px);
    let calibration = calibrate(&views, width, height, lens_model(declared.model, false))
        .map_err(|e| refused(e, config, &declared.model_file))?;
    let mut inputs = vec![declared.model_file.value.clone()];
    inputs.extend(declared.views.iter().map(|file| file.value.clone()));
    Ok(Calibrated { inputs, ..Calibrated::estimated(calibration, "corners") })
}

fn refused<T>(error: CalibrationError, config: &Config, key: &Located<T>) -> StageError {
    let failure = StageError::input(error.to_string()).at(config.at(key));
    match error {
        CalibrationError::Start(StartError::Parallel { .. } | StartError::TooFewViews { .. }) => {
            failure.help("photograph the target filling the frame, tilted by 20° to 45° to all four sides")
        }
        CalibrationError::Undetermined { .. } => {
            failure.help("fewer parameters: [calibrate.model] lens = \"radial2\", skew = false")
        }
        _ => failure,
    }
}

/// What a user should know before trusting the camera.
fn notes(calibration: &Calibration) -> Vec<String> {
    let mut notes = Vec::new();
    if !calibration.insignificant.is_empty() {
        notes.push(format!(
            "{} differ(s) from 0 by less than two standard deviations",
            calibration.insignificant.join(", ")
        ));
    }
    let support = &calibration.support;
    if support.supported_share < 0.9 {
        notes.push(format!(
            "{:.0} % of the frame lie farther from the optical axis than any corner (tangent {:.3}): the lens \
             is extrapolated there; photograph the target in the frame's corners",
            100.0 * (1.0 - support.supported_share),
            support.max_ideal_radius
        ));
    }
    if support.folded_share > 0.0 {
        notes.push(format!(
            "the lens folds back at tangent {:.3}: {:.2} % of the frame have no inverse and stay unused",
            support.fold_radius,
            100.0 * support.folded_share
        ));
    }
    notes
}

/// The view that fits worst: what the overlay should show.
fn worst_view(calibration: &Calibration) -> usize {
    (0..calibration.views.len())
        .max_by(|&a, &b| calibration.views[a].rms_px.total_cmp(&calibration.views[b].rms_px))
        .unwrap_or(0)
}

/// Every point of every view with its estimates and residual (observed − predicted).
fn corners_csv(made: &Calibrated, calibration: &Calibration) -> Result<Vec<u8>, StageError> {
    let failed = |e: csv::Error| StageError::new(ErrorClass::Bug, "corners.csv cannot be made").because(e);
    let mut table = csv::Writer::from_writer(Vec::new());
    table
        .write_record([
            "file",
            "point",
            "square_row",
            "square_column",
            "corner",
            "x_mm",
            "y_mm",
            "blunt_column_px",
            "blunt_row_px",
            "refined_column_px",
            "refined_row_px",
            "sharp_column_px",
            "sharp_row_px",
            "residual_column_px",
            "residual_row_px",
        ])
        .map_err(failed)?;
    let px = |value: f64| format!("{value:.4}");
    for (index, view) in calibration.views.iter().enumerate() {
        let corners = made.photos.get(index).map(|photo| &photo.detection.corners);
        for (i, point) in view.points.iter().enumerate() {
            let corner = corners.and_then(|corners| corners.get(i));
            let found = |value: &dyn Fn(&DetectedCorner) -> String| corner.map_or_else(String::new, value);
            table
                .write_record([
                    view.name.clone(),
                    (i + 1).to_string(),
                    found(&|c| c.square_row.to_string()),
                    found(&|c| c.square_column.to_string()),
                    found(&|c| c.corner.to_string()),
                    format!("{:.4}", 1e3 * point.board.x_m),
                    format!("{:.4}", 1e3 * point.board.y_m),
                    found(&|c| px(c.blunt.column)),
                    found(&|c| px(c.blunt.row)),
                    found(&|c| px(c.refined.column)),
                    found(&|c| px(c.refined.row)),
                    px(point.observed.column),
                    px(point.observed.row),
                    px(point.observed.column - point.predicted.column),
                    px(point.observed.row - point.predicted.row),
                ])
                .map_err(failed)?;
        }
    }
    table
        .into_inner()
        .map_err(|e| StageError::new(ErrorClass::Bug, "corners.csv cannot be made").because(e.into_error()))
}

/// Root mean square distance of one of the three estimates from the calibrated camera's prediction, px.
fn step_rms(
    photo: &TargetPhoto,
    points: &[PointResidual],
    estimate: impl Fn(&DetectedCorner) -> ImagePoint,
) -> f64 {
    let sum: f64 = photo
        .detection
        .corners
        .iter()
        .zip(points)
        .map(|(corner, point)| {
            let at = estimate(corner);
            (at.column - point.predicted.column).powi(2) + (at.row - point.predicted.row).powi(2)
        })
        .sum();
    (sum / points.len().max(1) as f64).sqrt()
}

/// `calibrate.json`: the numbers of the calibration, for the report and for other programs.
fn summary(made: &Calibrated, calibration: &Calibration, worst: usize) -> String {
    let interior = calibration.camera.lens.interior();
    let names = calibration.camera.lens.names();
    let free = calibration.model.free;
    let parameters: Vec<Value> = (0..names.len())
        .map(|k| {
            json!({
                "name": names[k],
                "value": interior[k],
                "std": free[k].then_some(calibration.std[k]),
                "estimated": free[k],
                "insignificant": calibration.insignificant.contains(&names[k]),
            })
        })
        .collect();
    let views: Vec<Value> = calibration
        .views
        .iter()
        .enumerate()
        .map(|(i, view)| {
            let photo = made.photos.get(i);
            let steps = photo.map(|photo| {
                json!({
                    "blunt_rms_px": step_rms(photo, &view.points, |c| c.blunt),
                    "refined_rms_px": step_rms(photo, &view.points, |c| c.refined),
                    "sharp_rms_px": step_rms(photo, &view.points, |c| c.sharp),
                })
            });
            let hidden = photo
                .map(|photo| photo.detection.missing.iter().map(|&(r, c)| json!([r, c])).collect::<Vec<_>>());
            let marker = photo.map(|photo| match photo.detection.marker {
                MarkerSeen::None => "none",
                MarkerSeen::Hollow => "hollow",
                MarkerSeen::Absent => "absent",
            });
            let rotation = view.camera_from_board.rotation.matrix();
            let origin = view.camera_from_board.origin.vector();
            json!({
                "file": view.name,
                "points": view.points.len(),
                "rms_px": view.rms_px,
                "steps": steps,
                "hidden_squares": hidden,
                "marker": marker,
                "camera_from_board_rotation": rotation.row_iter()
                    .map(|row| row.iter().copied().collect::<Vec<f64>>())
                    .collect::<Vec<_>>(),
                "board_origin_in_camera_m": [origin.x, origin.y, origin.z],
            })
        })
        .collect();
    let support = &calibration.support;
    let finite = |value: f64| value.is_finite().then_some(value);
    let text = serde_json::to_string_pretty(&json!({
        "format": "boresight-calibrate",
        "version": 1,
        "image_width_px": calibration.camera.width,
        "image_height_px": calibration.camera.height,
        "parameters": parameters,
        "correlation": (0..names.len())
            .map(|i| (0..names.len()).map(|j| calibration.correlation[(i, j)]).collect::<Vec<f64>>())
            .collect::<Vec<_>>(),
        "square_side_excess_m": calibration.side_excess_m
            .map(|(value, std)| json!({ "value": value, "std": std })),
        "points": calibration.points(),
        "j_px2": calibration.j_total,
        "j_per_point_px2": calibration.j_per_point,
        "rms_px": calibration.rms_px,
        "sigma0_px": calibration.sigma0_px,
        "iterations": calibration.iterations,
        "closed_form": match calibration.start {
            ClosedForm::WithSkew => "with_skew",
            ClosedForm::NoSkew => "no_skew",
            ClosedForm::Centred => "centred_principal_point",
            ClosedForm::Ladder => "ladder_of_focal_lengths",
        },
        "support": {
            "max_ideal_radius": support.max_ideal_radius,
            "fold_radius": finite(support.fold_radius),
            "supported_share_of_frame": support.supported_share,
            "folded_share_of_frame": support.folded_share,
            "share_of_48_cells_with_corners": support.covered_cells,
        },
        "views": views,
        "rejected_photos": made.rejected,
        "overlay_of": made.photos.get(worst).map(|photo| file_name(&photo.file)),
        "notes": made.notes,
    }));
    text.unwrap_or_default() + "\n"
}
