//! The run's page, read back from the run folder: it shows what stands there, also when a run made only a part of it.

use super::accuracy::{CE90_PICTURE, NUMBERS_FILE, RESIDUALS_FIGURE};
use super::calibrate;
use super::context::{ErrorClass, Stage, StageError};
use super::georeference::{Georeferenced, MatchReport};
use crate::formats::camera::read_camera;
use crate::geodesy::{Geodetic, MapPoint, MapProjection, WGS84};
use crate::report::CalibrationNumbers;
use crate::report::figures::MapFrame;
use crate::report::numbers::AccuracyNumbers;
use crate::report::page::{
    AccuracySection, CalibrationSection, CaptionedFigure, MosaicSection, Page, Provenance, Rejected, Survey,
};
use crate::report::render;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::path::Path;

/// What the page needs beside the run folder's products.
#[derive(Debug, Clone, Default)]
pub struct PageInputs {
    /// Name of the survey.
    pub title: String,
    /// Where the products come from.
    pub provenance: Provenance,
    /// Frames that were not used, with the reason.
    pub rejected: Vec<(String, String)>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Stages whose products stand in the folder.
    pub stages: Vec<Stage>,
}

/// Makes the page as HTML.
///
/// # Errors
/// [`StageError`] when a product of the folder cannot be read.
pub fn page(
    folder: &Path,
    survey: Option<&Georeferenced>,
    inputs: PageInputs,
) -> Result<Vec<u8>, StageError> {
    let has = |stage| inputs.stages.contains(&stage);
    let rejected: Vec<Rejected> =
        inputs.rejected.into_iter().map(|(name, reason)| Rejected { name, reason }).collect();
    let page = Page {
        title: inputs.title,
        provenance: inputs.provenance,
        survey: survey.map(|s| survey_section(s, rejected.len())).transpose()?,
        mosaic: has(Stage::Mosaic).then(|| mosaic_section(&folder.join(Stage::Mosaic.name()))).transpose()?,
        accuracy: has(Stage::Accuracy)
            .then(|| accuracy_section(&folder.join(Stage::Accuracy.name())))
            .transpose()?,
        calibration: has(Stage::Calibrate)
            .then(|| calibration_section(&folder.join(Stage::Calibrate.name())))
            .transpose()?
            .flatten(),
        rejected,
        warnings: inputs.warnings,
    };
    let html = render(&page).map_err(|e| StageError::new(ErrorClass::Bug, "no report page").because(e))?;
    Ok(html.into_bytes())
}

/// Frames and their ground as the page shows them.
///
/// # Errors
/// [`StageError`] when a frame has no image on the map.
pub fn survey_section(survey: &Georeferenced, rejected: usize) -> Result<Survey, StageError> {
    let off_map = |e: crate::geodesy::ProjectionError| StageError::input(e.to_string());
    let frames = survey
        .frames
        .iter()
        .map(|frame| {
            let mut places: Vec<Geodetic> = frame.footprint.outline.iter().map(|v| v.position).collect();
            places.push(WGS84.geodetic_from_ecef(&frame.ecef_from_camera().origin));
            let mut map: Vec<[f64; 2]> = survey
                .projection
                .map_from_geodetic(&places)
                .map_err(off_map)?
                .into_iter()
                .map(|MapPoint { easting, northing }| [easting, northing])
                .collect();
            let camera = map.pop().unwrap_or_default();
            Ok(MapFrame { name: frame.name.clone(), outline: map, camera })
        })
        .collect::<Result<Vec<_>, StageError>>()?;
    let sorted = |value: &dyn Fn(&crate::georeference::GeoreferencedFrame) -> f64| {
        let mut values: Vec<f64> = survey.frames.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let gsd = sorted(&|f| f.footprint.gsd_m);
    let height = sorted(&|f| f.footprint.height_above_ground_m);
    let ends = |v: &[f64]| [v.first().copied().unwrap_or(0.0), v.last().copied().unwrap_or(0.0)];
    let projection = &survey.projection;
    Ok(Survey {
        frames_used: frames.len(),
        frames_rejected: rejected,
        crs: if projection.name() == projection.definition() {
            projection.name().to_owned()
        } else {
            format!("{} ({})", projection.name(), projection.definition())
        },
        gsd_median_m: gsd.get(gsd.len() / 2).copied().unwrap_or(0.0),
        gsd_range_m: ends(&gsd),
        height_above_ground_m: ends(&height),
        frames,
        unit_m: (!projection.is_geographic()).then(|| projection.metres_per_unit()),
        matching: survey.matching.as_ref().map(matching_figure).transpose()?.flatten(),
    })
}

/// The residuals between photos and exposures, where times decided.
fn matching_figure(matching: &MatchReport) -> Result<Option<CaptionedFigure>, StageError> {
    let figure = matching.figure().map_err(|e| StageError::new(ErrorClass::Bug, e.to_string()))?;
    Ok(figure.map(|figure| CaptionedFigure {
        title: "Photos matched with the log's exposures".to_owned(),
        caption: matching.notes.join(". ") + ". Every pair stands in georeference/matching.csv.",
        svg: figure.svg,
    }))
}

fn bytes(path: &Path) -> Result<Vec<u8>, StageError> {
    std::fs::read(path).map_err(|e| {
        StageError::new(ErrorClass::Io, format!("cannot read {} for the report", path.display())).because(e)
    })
}

/// A picture no wider and higher than the page can show, so that the page can be sent by mail.
fn reduced(path: &Path) -> Result<Vec<u8>, StageError> {
    const MOST_PX: u32 = 1000;
    let broken = |e: image::ImageError| {
        StageError::new(ErrorClass::Io, format!("{} cannot be reduced for the report", path.display()))
            .because(e)
    };
    let stored = bytes(path)?;
    let picture = image::load_from_memory(&stored).map_err(broken)?;
    if picture.width().max(picture.height()) <= MOST_PX {
        return Ok(stored);
    }
    // Colours weighted by opacity, or the black of transparent pixels would seep into the mosaic's rim.
    let mut light = picture.to_rgba32f();
    for pixel in light.pixels_mut() {
        let alpha = pixel.0[3];
        pixel.0[..3].iter_mut().for_each(|c| *c *= alpha);
    }
    let mut light = image::DynamicImage::from(light)
        .resize(MOST_PX, MOST_PX, image::imageops::FilterType::Triangle)
        .to_rgba32f();
    for pixel in light.pixels_mut() {
        let alpha = pixel.0[3].max(f32::MIN_POSITIVE);
        pixel.0[..3].iter_mut().for_each(|c| *c /= alpha);
    }
    let mut png = std::io::Cursor::new(Vec::new());
    image::DynamicImage::from(image::DynamicImage::from(light).to_rgba8())
        .write_to(&mut png, image::ImageFormat::Png)
        .map_err(broken)?;
    Ok(png.into_inner())
}

fn text(path: &Path) -> Result<String, StageError> {
    String::from_utf8(bytes(path)?)
        .map_err(|_| StageError::new(ErrorClass::Io, format!("{} is not UTF-8 text", path.display())))
}

fn json<T: DeserializeOwned>(path: &Path) -> Result<T, StageError> {
    serde_json::from_slice(&bytes(path)?).map_err(|e| {
        StageError::new(ErrorClass::Io, format!("{} is not what its stage writes", path.display()))
            .because(e)
            .help("run the stage again with --force")
    })
}

/// What the page takes from `mosaic.json`.
#[derive(Deserialize)]
struct Mosaic {
    crs: String,
    crs_name: String,
    gsd_m: f64,
    width_px: u64,
    height_px: u64,
    covered_m2: f64,
}

fn mosaic_section(folder: &Path) -> Result<MosaicSection, StageError> {
    let mosaic: Mosaic = json(&folder.join("mosaic.json"))?;
    Ok(MosaicSection {
        preview_png: reduced(&folder.join("preview.png"))?,
        file: "mosaic/mosaic.tif".to_owned(),
        width_px: mosaic.width_px,
        height_px: mosaic.height_px,
        gsd_m: mosaic.gsd_m,
        crs: if mosaic.crs == mosaic.crs_name {
            mosaic.crs
        } else {
            format!("{} ({})", mosaic.crs_name, mosaic.crs)
        },
        area_m2: Some(mosaic.covered_m2),
    })
}

fn accuracy_section(folder: &Path) -> Result<AccuracySection, StageError> {
    let numbers: AccuracyNumbers = json(&folder.join(NUMBERS_FILE))?;
    let figures = numbers
        .figures
        .iter()
        .map(|f| {
            let svg = text(&folder.join(&f.file))?;
            Ok(CaptionedFigure { title: f.title.clone(), caption: f.caption.clone(), svg })
        })
        .collect::<Result<Vec<_>, StageError>>()?;
    let ce90 = match &numbers.map {
        Some(map) => Some((bytes(&folder.join(CE90_PICTURE))?, map.colour_range_m)),
        None => None,
    };
    let residuals_svg = match numbers.check_points {
        Some(_) => Some(text(&folder.join(RESIDUALS_FIGURE))?),
        None => None,
    };
    Ok(AccuracySection { figures, ce90, residuals_svg, numbers })
}

fn calibration_section(folder: &Path) -> Result<Option<CalibrationSection>, StageError> {
    let (calibrated, camera) = (folder.join(calibrate::NUMBERS_FILE), folder.join(calibrate::CAMERA_FILE));
    if calibrated.exists() {
        let made: CalibrationNumbers = json(&calibrated)?;
        let figures = made
            .figures
            .iter()
            .map(|f| {
                let svg = text(&folder.join(&f.file))?;
                Ok(CaptionedFigure { title: f.title.clone(), caption: f.caption.clone(), svg })
            })
            .collect::<Result<Vec<_>, StageError>>()?;
        let steps = folder.join(calibrate::STEPS_PICTURE);
        let overlay = made.overlay_of.as_ref().map(|file| {
            let picture = folder.join(calibrate::numbers::overlay_name(file));
            bytes(&picture).map(|png| (file.clone(), png))
        });
        return Ok(Some(CalibrationSection {
            source: if made.target.is_some() {
                "The camera was calibrated from photos of a planar target; its points were found automatically."
            } else {
                "The camera was calibrated from given corners of a planar target."
            }
            .to_owned(),
            parameters: made.parameters.clone(),
            figures,
            steps_png: (made.steps.is_some() && steps.exists()).then(|| bytes(&steps)).transpose()?,
            overlay: overlay.transpose()?,
            adjustment: Some(made),
        }));
    }
    if !camera.exists() {
        return Ok(None);
    }
    let camera = read_camera(&camera).map_err(|e| StageError::new(ErrorClass::Io, e.to_string()))?;
    Ok(Some(CalibrationSection {
        source: "The camera was given with the pipeline.".to_owned(),
        parameters: calibrate::numbers::parameters(&camera, |_| true, None),
        adjustment: None,
        figures: Vec::new(),
        steps_png: None,
        overlay: None,
    }))
}
