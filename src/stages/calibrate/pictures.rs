//! The calibration as pictures, and its uncertainty over the frame.

use super::overlay::{self, Marks};
use super::{Calibrated, STEPS_PICTURE, file_name, numbers, worst_view};
use crate::calibration::{Calibration, DetectedCorner, UncertaintyMap, projection_uncertainty};
use crate::camera::PixelRotation;
use crate::formats::photo;
use crate::report::Figure;
use crate::report::calibration::UncertaintyNumbers;
use crate::report::figures::{Panel, contour_panels};
use crate::report::lens_figures::{ResidualVector, coverage, residual_vectors};
use crate::report::numbers::FigureFile;
use crate::stages::context::{ErrorClass, RunContext, StageError};
use image::RgbImage;
use rayon::prelude::*;
use std::path::Path;

/// How well the camera is known over its frame.
pub(super) struct Uncertainty {
    map: UncertaintyMap,
    height_m: f64,
}

impl Uncertainty {
    pub fn of(calibration: &Calibration, height_m: f64) -> Self {
        const COLUMNS: usize = 48;
        let camera = &calibration.camera;
        let rows =
            (COLUMNS as f64 * f64::from(camera.height) / f64::from(camera.width)).round().max(2.0) as usize;
        Self { map: projection_uncertainty(calibration, COLUMNS, rows), height_m }
    }

    fn px(&self) -> impl Iterator<Item = Option<f64>> {
        self.map.nodes.iter().map(|node| node.spread.as_ref().map(|spread| spread.px))
    }

    fn metres(&self) -> impl Iterator<Item = Option<f64>> {
        let height_m = self.height_m;
        self.map
            .nodes
            .iter()
            .map(move |node| node.spread.as_ref().and_then(|spread| spread.ground_m(height_m)))
    }

    pub fn numbers(&self) -> UncertaintyNumbers {
        let sorted = |values: &mut dyn Iterator<Item = Option<f64>>| {
            let mut values: Vec<f64> = values.flatten().collect();
            values.sort_by(f64::total_cmp);
            let median = values.get(values.len() / 2).copied().unwrap_or(0.0);
            (median, values.last().copied().unwrap_or(0.0))
        };
        let (median_px, worst_px) = sorted(&mut self.px());
        let (median_m, worst_m) = sorted(&mut self.metres());
        let (columns, rows) = (self.map.columns, self.map.rows);
        UncertaintyNumbers {
            columns,
            rows,
            std_px: self.px().collect(),
            centre_px: self.px().nth(rows / 2 * columns + columns / 2).flatten(),
            median_px,
            worst_px,
            height_m: self.height_m,
            median_m,
            worst_m,
        }
    }
}

/// Writes all pictures; returns those over the frame, for the page.
pub(super) fn write(
    made: &Calibrated,
    calibration: &Calibration,
    uncertainty: &Uncertainty,
    context: &RunContext,
) -> Result<Vec<FigureFile>, StageError> {
    write_overlays(made, calibration, context)?;
    if let Some((file, rotation, corners)) = example(made) {
        let picture = decode(file, rotation)?;
        context.write_product(STEPS_PICTURE, &overlay::three_steps(picture, &corners)?)?;
    }
    let camera = &calibration.camera;
    let size = (camera.width, camera.height);
    let outlier = |view, point| calibration.outliers.iter().any(|o| o.view == view && o.point == point);
    let vectors: Vec<ResidualVector> = calibration
        .views
        .iter()
        .enumerate()
        .flat_map(|(v, view)| view.points.iter().enumerate().map(move |(p, point)| (v, p, point)))
        .map(|(view, point, p)| ResidualVector {
            at: [p.observed.column, p.observed.row],
            residual: [p.observed.column - p.predicted.column, p.observed.row - p.predicted.row],
            outlier: outlier(view, point),
        })
        .collect();
    let points: Vec<[f64; 2]> = vectors.iter().map(|v| v.at).collect();
    let unsupported: Vec<bool> = uncertainty.map.nodes.iter().map(|node| !node.supported).collect();
    let panel = |title: String, values: &mut dyn Iterator<Item = Option<f64>>| Panel {
        title,
        image_px: size,
        columns: uncertainty.map.columns,
        rows: uncertainty.map.rows,
        values: values.map(|v| v.unwrap_or(f64::NAN)).collect(),
        spread: true,
    };
    let height_m = uncertainty.height_m;
    let panels = [
        panel("uncertainty (px, 1σ)".to_owned(), &mut uncertainty.px()),
        panel(format!("on the ground from {height_m} m (m)"), &mut uncertainty.metres()),
    ];
    let bug = |e| StageError::new(ErrorClass::Bug, "a figure cannot be drawn").because(e);
    let figures: [(&str, &str, &str, Figure); 3] = [
        (
            "uncertainty",
            "Uncertainty of the calibrated camera over its frame",
            "How far the calibrated camera is from the true one, for every pixel: standard deviation in the worse \
             direction after the best common rotation (which a boresight calibration takes up), in pixels and on the \
             ground for a camera that looks straight down.",
            contour_panels(&panels).map_err(bug)?,
        ),
        (
            "residuals",
            "Residuals of all points",
            "Observed minus predicted for every point of every photo. Lines that point the same way in one part of the \
             frame show what the lens model cannot follow.",
            residual_vectors(size, &vectors).map_err(bug)?,
        ),
        (
            "coverage",
            "Where in the frame points were seen",
            "Points of all photos. Cells without a point are orange; hatched is what lies outside the target in every \
             photo: the lens is extrapolated there.",
            coverage(size, &points, (8, 6), &unsupported, uncertainty.map.columns).map_err(bug)?,
        ),
    ];
    figures
        .into_iter()
        .map(|(name, title, caption, figure)| {
            let file = format!("{name}.svg");
            context.write_product(&file, figure.svg.as_bytes())?;
            context.write_product(&format!("{name}.png"), &figure.png)?;
            Ok(FigureFile { file, title: title.to_owned(), caption: caption.to_owned() })
        })
        .collect()
}

/// The photo as the camera's sensor saw it.
fn decode(file: &Path, rotation: PixelRotation) -> Result<RgbImage, StageError> {
    let photo = photo::decode(file).map_err(|e| StageError::input(e.to_string()))?;
    let stored = overlay::rgb(photo)?;
    Ok(match rotation {
        PixelRotation::None => stored,
        PixelRotation::Clockwise90 => image::imageops::rotate270(&stored),
        PixelRotation::Half => image::imageops::rotate180(&stored),
        PixelRotation::Clockwise270 => image::imageops::rotate90(&stored),
    })
}

/// One overlay per photo in which the target was found, used or not.
fn write_overlays(
    made: &Calibrated,
    calibration: &Calibration,
    context: &RunContext,
) -> Result<(), StageError> {
    let task = context.task("drawing overlays", made.photos.len() + made.rejected.len());
    let used = made.photos.iter().zip(&calibration.views);
    let used = used.map(|(photo, view)| (&photo.file, photo.rotation, Marks::Predicted(&view.points)));
    let rejected = made.rejected.iter().filter_map(|photo| {
        let detection = photo.detection.as_ref()?;
        Some((&photo.path, PixelRotation::None, Marks::Found(&detection.corners)))
    });
    let all: Vec<_> = used.chain(rejected).collect();
    all.par_iter().try_for_each(|(file, rotation, marks)| {
        context.check_interrupted()?;
        let picture = overlay::draw(decode(file, *rotation)?, marks)?;
        context.write_product(&numbers::overlay_name(&file_name(file)), &picture)?;
        task.advance(1);
        Ok(())
    })
}

/// The photo that fits worst, for the page.
pub(super) fn shown_overlay(made: &Calibrated, calibration: &Calibration) -> Option<String> {
    made.photos.get(worst_view(calibration)).map(|photo| file_name(&photo.file))
}

/// Points whose three estimates are shown: those of one square or tag, or of the first cell of the lattice, of the
/// photo that shows them largest.
fn example(made: &Calibrated) -> Option<(&Path, PixelRotation, Vec<DetectedCorner>)> {
    let largest =
        made.photos.iter().max_by(|a, b| a.quality.extent_share.total_cmp(&b.quality.extent_share))?;
    let corners = &largest.detection.corners;
    let middle = corners.get(corners.len() / 2)?;
    let of_square: Vec<DetectedCorner> =
        corners.iter().filter(|c| (c.row, c.column) == (middle.row, middle.column)).copied().collect();
    if of_square.len() == 4 {
        return Some((&largest.file, largest.rotation, of_square));
    }
    // Clockwise around one cell.
    let at = |row, column| corners.iter().find(|c| (c.row, c.column) == (row, column)).copied();
    let cell = |c: &DetectedCorner| {
        let (r, k) = (c.row, c.column);
        [Some(*c), at(r, k + 1), at(r + 1, k + 1), at(r + 1, k)].into_iter().collect::<Option<Vec<_>>>()
    };
    corners.iter().find_map(cell).map(|corners| (largest.file.as_path(), largest.rotation, corners))
}
