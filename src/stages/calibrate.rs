//! `calibrate`: a camera file, written parameters, photos of a target or known corners in, one camera out.

mod model;
pub(super) mod numbers;
mod overlay;
mod photos;
mod pictures;

use super::camera::camera_from_parameters;
use super::context::{RunContext, StageError};
use super::georeference::failed;
use crate::calibration::{
    BoardPoint, Calibration, CalibrationError, Detection, Observation, Options, OutlierPolicy, PhotoQuality,
    Target, ViewPoints, advice, calibrate_with,
};
use crate::camera::{Camera, ImagePoint, Invertibility, PixelRotation};
use crate::config::calibrate::{CameraFile, CameraSource, TargetCorners, TargetPhotos};
use crate::config::{Config, Located};
use crate::formats::InputError;
use crate::formats::camera::{
    CameraChoice, CameraFormat, Exported, camera_json, export, read_camera, read_chosen_camera,
};
use crate::formats::corners::read_pairs;
use crate::report::calibration::ChoiceNumbers;
use model::{Fitted, fit};
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The stage's main product, read back by later stages.
pub const CAMERA_FILE: &str = "camera.json";
/// The stage's numbers.
pub const NUMBERS_FILE: &str = "calibrate.json";
/// The picture of the three estimates.
pub const STEPS_PICTURE: &str = "steps.png";

/// The camera, and how it came about.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The camera.
    pub camera: Arc<Camera>,
    /// The adjustment, when the camera was calibrated in this run.
    pub calibration: Option<Calibration>,
    /// How the lens was chosen, when several were compared.
    pub choice: Option<ChoiceNumbers>,
    /// The target, and whether its rows and columns were counted; when photos were given.
    pub target: Option<(Target, bool)>,
    /// Photos of the target: those used, in the order of the calibration's views.
    pub photos: Vec<TargetPhoto>,
    /// Photos of the target that could not be used, ordered by name.
    pub rejected: Vec<RejectedPhoto>,
    /// A camera to compare with.
    pub reference: Option<Camera>,
    /// Height above ground for uncertainties in metres.
    pub report_height_m: f64,
    /// Files that were read.
    pub inputs: Vec<PathBuf>,
    /// What the user should know but need not act on.
    pub notes: Vec<String>,
    /// What would make the camera better known.
    pub advice: Vec<String>,
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
    /// How well it shows them.
    pub quality: PhotoQuality,
    /// How its stored pixels were turned; the corners are where the sensor saw them.
    pub rotation: PixelRotation,
}

impl TargetPhoto {
    fn view(&self) -> ViewPoints {
        ViewPoints { name: file_name(&self.file), observations: self.detection.observations() }
    }
}

/// A photo that is not used.
#[derive(Debug, Clone, Serialize)]
pub struct RejectedPhoto {
    /// The file.
    #[serde(skip)]
    pub path: PathBuf,
    /// File name.
    pub file: String,
    /// Why.
    pub reason: String,
    /// The target's corners, when it was found.
    #[serde(skip)]
    pub detection: Option<Detection>,
}

/// Makes the camera that the pipeline declares, in memory.
///
/// # Errors
/// A file cannot be used, fewer than three photos show the target, or they do not determine the camera.
pub fn make(config: &Config, context: &RunContext) -> Result<Calibrated, StageError> {
    match &config.calibrate.camera {
        CameraSource::File(file) => {
            let camera = chosen(config, file)?;
            let source = json!({ "method": "file", "file": file_name(&file.file) });
            Ok(Calibrated { inputs: vec![file.file.value.clone()], ..Calibrated::given(camera, source) })
        }
        CameraSource::Parameters(spec) => {
            let camera = camera_from_parameters(config, spec)?;
            Ok(Calibrated::given(camera, json!({ "method": "parameters" })))
        }
        CameraSource::Photos(photos) => from_photos(config, photos, context),
        CameraSource::Corners(corners) => from_corners(config, corners, context),
    }
}

/// The camera that is meant in a camera file.
fn chosen(config: &Config, declared: &CameraFile) -> Result<Camera, StageError> {
    let choice = CameraChoice { name: declared.name.as_deref(), image_size: declared.image_size };
    read_chosen_camera(&declared.file, &choice).map_err(|e| failed(config, e.caused_by(&declared.file)))
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
        CameraSource::File(file) => chosen(config, file),
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

/// Makes the camera and writes it in every format that can hold it; after a calibration also `calibrate.json` (its
/// numbers), `corners.csv` and pictures: residuals, coverage, uncertainty, and from photos the calibrated camera's view
/// of the target over each photo and the three estimates of one corner.
///
/// # Errors
/// As [`make`], and when a product cannot be written.
pub fn run(config: &Config, context: &RunContext) -> Result<Calibrated, StageError> {
    let made = make(config, context)?;
    for input in &made.inputs {
        context.record_input(input);
    }
    for RejectedPhoto { file, reason, .. } in &made.rejected {
        context.warn(format!("{file} is not used: {reason}"));
    }
    for note in &made.notes {
        context.warn(note.clone());
    }
    context.write_product(CAMERA_FILE, camera_json(&made.camera, made.source.clone()).as_bytes())?;
    write_exports(config, &made.camera, context)?;
    if let Some(calibration) = &made.calibration {
        tracing::info!("{}", said(&made.camera, calibration));
        context.write_product("corners.csv", &numbers::corners_csv(&made, calibration)?)?;
        let uncertainty = pictures::Uncertainty::of(calibration, made.report_height_m);
        let mut numbers = numbers::numbers(&made, calibration, uncertainty.numbers());
        numbers.figures = pictures::write(&made, calibration, &uncertainty, context)?;
        let mut text = serde_json::to_vec_pretty(&numbers)
            .map_err(|e| StageError::new(super::ErrorClass::Bug, "the numbers are not JSON").because(e))?;
        text.push(b'\n');
        context.write_product(NUMBERS_FILE, &text)?;
    }
    Ok(made)
}

/// The camera as other programs read it; what a format cannot hold is said.
fn write_exports(config: &Config, camera: &Camera, context: &RunContext) -> Result<(), StageError> {
    let name = config.source.name.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let write = |file: &str, exported: Exported| {
        for loss in &exported.losses {
            tracing::debug!("{file}: {loss}");
        }
        context.write_product(file, exported.text.as_bytes())
    };
    for format in [CameraFormat::OpenCv, CameraFormat::Ros, CameraFormat::OpenSfm] {
        match export(camera, format, &name) {
            Ok(exported) => {
                write(format.file_name(), exported)?;
            }
            Err(error) => tracing::info!("no {}: {error}", format.file_name()),
        }
    }
    Ok(())
}

impl Calibrated {
    /// A camera that nothing had to be estimated for.
    fn given(camera: Camera, source: Value) -> Self {
        Self {
            camera: Arc::new(camera),
            calibration: None,
            choice: None,
            target: None,
            photos: Vec::new(),
            rejected: Vec::new(),
            reference: None,
            report_height_m: 0.0,
            inputs: Vec::new(),
            notes: Vec::new(),
            advice: Vec::new(),
            source,
        }
    }

    fn estimated(fitted: Fitted, method: &str, reference: Option<Camera>, config: &Config) -> Self {
        let calibration = fitted.calibration;
        let source = json!({
            "method": method,
            "model": calibration.model.describe(),
            "views": calibration.views.len(),
            "points": calibration.points(),
            "rms_px": calibration.rms_px,
            "sigma0_px": calibration.sigma0_px,
            "supported_ideal_radius": finite(calibration.support.max_ideal_radius),
        });
        Self {
            calibration: Some(calibration.clone()),
            choice: fitted.choice,
            notes: notes(&calibration),
            advice: fitted.advice,
            inputs: config.calibrate.reference.iter().map(|file| file.value.clone()).collect(),
            reference,
            report_height_m: config.calibrate.report_height_m,
            ..Self::given(calibration.camera, source)
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn from_photos(
    config: &Config,
    declared: &TargetPhotos,
    context: &RunContext,
) -> Result<Calibrated, StageError> {
    let reference = reference(config)?;
    let mut looked = photos::look_at_all(config, declared, context)?;
    let (width, height) = (looked.size_px.0 as u32, looked.size_px.1 as u32);
    let adjusting = context.task("adjusting the camera", 1);
    let fit_all = |photos: &[TargetPhoto]| {
        let views: Vec<ViewPoints> = photos.iter().map(TargetPhoto::view).collect();
        fit(&views, width, height, declared.model, true)
            .map_err(|e| refused(&e, (&views, width, height), config, &declared.patterns))
    };
    let mut fitted = fit_all(&looked.used)?;
    if !looked.turned.is_empty() {
        turn_back(&mut looked, &fitted.calibration);
        photos::leave_out_faulty(&mut looked);
        fitted = fit_all(&looked.used)?;
    }
    drop(adjusting);
    looked.rejected.sort_by(|a, b| a.file.cmp(&b.file));
    let mut made = Calibrated::estimated(fitted, "photos", reference, config);
    made.notes.extend(size_note(&looked.target, made.calibration.as_ref()));
    for photo in looked.used.iter().filter(|photo| !photo.detection.missing.is_empty()) {
        let (missing, unit) = (photo.detection.missing.len(), looked.target.unit());
        made.notes.push(format!("{}: {missing} of the target's {unit} not seen", file_name(&photo.file)));
    }
    for photo in looked.used.iter().filter(|photo| photo.rotation != PixelRotation::None) {
        made.notes.push(format!(
            "{}: its pixels were turned by {}° clockwise after the photo was taken; its corners were turned back",
            file_name(&photo.file),
            photo.rotation.degrees()
        ));
    }
    made.inputs.extend(looked.files);
    Ok(Calibrated {
        target: Some((looked.target, looked.counted)),
        photos: looked.used,
        rejected: looked.rejected,
        ..made
    })
}

/// Squares that look much larger or smaller than declared are no matter of ink: a length is wrong.
fn size_note(target: &Target, calibration: Option<&Calibration>) -> Option<String> {
    const INK_SHARE: f64 = 0.04;
    let side_m = target.side_m()?;
    let excess = calibration?.board.side_excess_m?;
    let share = excess.value / side_m;
    (share.abs() > INK_SHARE && excess.is_significant()).then(|| {
        format!(
            "what is printed dark looks {:.2} mm ({:.0} %) {} than declared: [calibrate.target]'s side and gap contradict \
             the photos; measure both",
            1e3 * excess.value.abs(),
            100.0 * share.abs(),
            if share > 0.0 { "larger" } else { "smaller" }
        )
    })
}

/// Finds out which way each turned photo was turned: added to the others it must fit as they do one way and not the
/// other. Photos that do not tell are left out.
fn turn_back(looked: &mut photos::Looked, calibration: &Calibration) {
    /// A turn is taken when the other fits so much worse, and it fits not much worse than the others.
    const APART: f64 = 1.5;
    const LIKE_THE_OTHERS: f64 = 3.0;
    let (width, height) = (looked.size_px.0 as u32, looked.size_px.1 as u32);
    let options = Options { model: calibration.model, outliers: OutlierPolicy::Keep };
    let upright: Vec<ViewPoints> = looked.used.iter().map(TargetPhoto::view).collect();
    for photo in std::mem::take(&mut looked.turned) {
        let [mut best, other] = [PixelRotation::Clockwise90, PixelRotation::Clockwise270].map(|rotation| {
            let photo = photos::turned_back(&photo, rotation, looked.size_px);
            let mut views = upright.clone();
            views.push(photo.view());
            let fitted = calibrate_with(&views, width, height, options).ok();
            let rms_px = fitted.and_then(|c| c.views.last().map(|view| view.rms_px)).unwrap_or(f64::INFINITY);
            (rms_px, photo)
        });
        let mut worse_px = other.0;
        if other.0 < best.0 {
            worse_px = best.0;
            best = other;
        }
        if best.0 < LIKE_THE_OTHERS * calibration.rms_px && worse_px > APART * best.0 {
            looked.used.push(best.1);
        } else {
            let reason = "its pixels were turned by a quarter after the photo was taken, or it is another camera's, and \
                          its corners do not tell which way: give it as the camera stored it";
            looked.rejected.push(RejectedPhoto {
                file: file_name(&photo.file),
                path: photo.file,
                reason: reason.to_owned(),
                detection: Some(photo.detection),
            });
        }
    }
    looked.used.sort_by(|a, b| a.file.cmp(&b.file));
}

fn from_corners(
    config: &Config,
    declared: &TargetCorners,
    context: &RunContext,
) -> Result<Calibrated, StageError> {
    let at = |e: InputError, key: &Located<PathBuf>| failed(config, e.caused_by(key));
    let reference = reference(config)?;
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
    let adjusting = context.task("adjusting the camera", 1);
    let fitted = fit(&views, width, height, declared.model, false)
        .map_err(|e| refused(&e, (&views, width, height), config, &declared.model_file))?;
    drop(adjusting);
    let mut made = Calibrated::estimated(fitted, "corners", reference, config);
    made.inputs.push(declared.model_file.value.clone());
    made.inputs.extend(declared.views.iter().map(|file| file.value.clone()));
    Ok(made)
}

fn refused<T>(
    error: &CalibrationError,
    (views, width, height): (&[ViewPoints], u32, u32),
    config: &Config,
    key: &Located<T>,
) -> StageError {
    let failure = StageError::input(error.to_string()).at(config.at(key)).help(error.help());
    advice(views, width, height, None)
        .iter()
        .fold(failure, |failure, advice| failure.help(advice.to_string()))
}

/// The camera to compare with, read before any work is done.
fn reference(config: &Config) -> Result<Option<Camera>, StageError> {
    let file = config.calibrate.reference.as_ref();
    file.map(|file| read_camera(file).map_err(|e| failed(config, e.caused_by(file)))).transpose()
}

/// Corners are found to a tenth of a pixel and better; a sound calibration leaves no more than this.
const SOUND_RMS_PX: f64 = 1.0;

/// What a user should know before trusting the camera.
fn notes(calibration: &Calibration) -> Vec<String> {
    let mut notes = Vec::new();
    for suspect in &calibration.suspects {
        notes.push(format!(
            "{} fits much worse than the other photos ({:.2} px, they have {:.2} px): look at it, and leave it out if \
             the target moved, bent or was found wrongly",
            suspect.name, suspect.rms_px, suspect.others_px
        ));
    }
    if !calibration.insignificant.is_empty() {
        notes.push(format!(
            "not distinguishable from 0 by these photos: {}; a simpler lens may do",
            calibration.insignificant.join(", ")
        ));
    }
    if calibration.rms_px > SOUND_RMS_PX {
        notes.push(format!(
            "points lie {:.2} px from where the camera sees them: far more than corners are found to; the target may be \
             another than declared, bent, or of another size than its squares and gaps say",
            calibration.rms_px
        ));
    }
    let board = &calibration.board;
    if let Some(bend) = board.bend.as_ref().filter(|bend| bend.is_significant() && !calibration.model.bend) {
        notes.push(format!(
            "the board is not flat: it bends by {:.2} mm; [calibrate.model] bend = true estimates that along",
            1e3 * bend.depth_m()
        ));
    }
    if let Some(pitch) = board.pitch_excess.as_ref().filter(|pitch| pitch.is_significant()) {
        notes.push(format!(
            "the board's spacing downwards is {:+.3} % of that across, ± {:.3} %: measure the printed target",
            100.0 * pitch.value,
            100.0 * pitch.std
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

/// The camera in a line, for the log.
fn said(camera: &Camera, calibration: &Calibration) -> String {
    let [fx, fy, _, cx, cy, ..] = camera.lens.interior();
    let std = &calibration.std;
    format!(
        "{}: f {fx:.2} ± {:.2}, {fy:.2} ± {:.2} px, principal point {cx:.2} ± {:.2}, {cy:.2} ± {:.2} px; rms {:.3} px \
         of {} points in {} views",
        calibration.model.describe(),
        std[0],
        std[1],
        std[3],
        std[4],
        calibration.rms_px,
        calibration.points(),
        calibration.views.len()
    )
}

/// What is known about the inverse of the lens over the frame, in words.
fn invertible(camera: &Camera) -> String {
    match camera.invertibility() {
        Invertibility::Proved { to } => format!(
            "Every pixel has exactly one viewing ray: proved up to {:.1}° off the optical axis.",
            to.degrees()
        ),
        Invertibility::Unproved { mask } => format!(
            "{:.2} % of the frame have no viewing ray (the lens folds back there) and are left out everywhere.",
            100.0 * mask.share()
        ),
    }
}

/// The view that fits worst: what the overlay should show.
fn worst_view(calibration: &Calibration) -> usize {
    (0..calibration.views.len())
        .max_by(|&a, &b| calibration.views[a].rms_px.total_cmp(&calibration.views[b].rms_px))
        .unwrap_or(0)
}
