//! The calibration as numbers for `calibrate.json` and the page, and as a table of its points.

use super::pictures::shown_overlay;
use super::{Calibrated, file_name, finite, invertible};
use crate::calibration::{Calibration, ClosedForm, DetectedCorner, MarkerSeen, Measured, PointResidual};
use crate::camera::{Camera, ImagePoint};
use crate::report::calibration::{
    BoardNumbers, CalibrationNumbers, FORMAT, MeasuredNumbers, OutlierNumbers, ParameterNumbers,
    QualityNumbers, RejectedNumbers, StepNumbers, SupportNumbers, TargetNumbers, UncertaintyNumbers, VERSION,
    ViewNumbers,
};
use crate::stages::context::{ErrorClass, StageError};

/// The interior parameters of a camera, beside those of a reference.
pub(in crate::stages) fn parameters(
    camera: &Camera,
    free: impl Fn(usize) -> bool,
    reference: Option<&Camera>,
) -> Vec<ParameterNumbers> {
    let interior = camera.lens.interior();
    let names = camera.lens.names();
    let std = |k: usize| camera.covariance.filter(|_| free(k)).map(|c| c[(k, k)].max(0.0).sqrt());
    // Focal lengths and principal point are never zero; only skew and lens terms can be.
    let could_be_zero = |k: usize| k == 2 || k >= 5;
    (0..names.len())
        .map(|k| ParameterNumbers {
            name: names[k].to_owned(),
            value: interior[k],
            std: std(k),
            estimated: free(k),
            insignificant: could_be_zero(k) && std(k).is_some_and(|s| s > 0.0 && interior[k].abs() < 2.0 * s),
            reference: reference.and_then(|reference| {
                let place = reference.lens.names().iter().position(|name| *name == names[k])?;
                // Terms of another kind of lens mean other things, although some have the same name.
                let comparable = k < 5 || reference.lens.kind() == camera.lens.kind();
                comparable.then(|| reference.lens.interior()[place])
            }),
        })
        .collect()
}

/// A point as found, and as the calibrated camera sees it.
type Pair = (DetectedCorner, PointResidual);

/// Root mean square distances of the three estimates from the calibrated camera's prediction.
fn steps(pairs: &[Pair]) -> StepNumbers {
    let rms = |estimate: fn(&DetectedCorner) -> ImagePoint| {
        let square = |(corner, point): &Pair| {
            let at = estimate(corner);
            (at.column - point.predicted.column).powi(2) + (at.row - point.predicted.row).powi(2)
        };
        (pairs.iter().map(square).sum::<f64>() / pairs.len().max(1) as f64).sqrt()
    };
    StepNumbers {
        blunt_rms_px: rms(|c| c.blunt),
        refined_rms_px: rms(|c| c.refined),
        sharp_rms_px: rms(|c| c.sharp),
    }
}

fn measured(m: &Measured) -> MeasuredNumbers {
    MeasuredNumbers { value: m.value, std: m.std, significant: m.is_significant() }
}

/// Where the overlay of a photo goes.
pub(in crate::stages) fn overlay_name(file: &str) -> String {
    format!("overlays/{file}.png")
}

/// Everything but the pictures.
pub(super) fn numbers(
    made: &Calibrated,
    calibration: &Calibration,
    uncertainty: UncertaintyNumbers,
) -> CalibrationNumbers {
    let camera = &calibration.camera;
    let pairs: Vec<Vec<Pair>> = made
        .photos
        .iter()
        .zip(&calibration.views)
        .map(|(photo, view)| {
            photo.detection.corners.iter().copied().zip(view.points.iter().copied()).collect()
        })
        .collect();
    let views = calibration
        .views
        .iter()
        .enumerate()
        .map(|(i, view)| {
            let photo = made.photos.get(i);
            let rotation = view.camera_from_board.rotation.matrix();
            let origin = view.camera_from_board.origin.vector();
            ViewNumbers {
                file: view.name.clone(),
                points: view.points.len(),
                rms_px: view.rms_px,
                steps: pairs.get(i).map(|pairs| steps(pairs)),
                quality: photo.map(|photo| QualityNumbers {
                    blur_px: photo.quality.blur_px,
                    contrast: photo.quality.contrast,
                    clipped_share: photo.quality.clipped_share,
                    extent_share: photo.quality.extent_share,
                }),
                hidden: photo
                    .map_or_else(Vec::new, |p| p.detection.missing.iter().map(|&(r, c)| [r, c]).collect()),
                marker: photo.map(|photo| {
                    match photo.detection.marker {
                        MarkerSeen::None => "none",
                        MarkerSeen::Hollow => "hollow",
                        MarkerSeen::Absent => "absent",
                    }
                    .to_owned()
                }),
                suspect: calibration.suspects.iter().find(|suspect| suspect.view == i).map(|suspect| {
                    format!(
                        "fits much worse than the others: {:.2} px, they have {:.2} px; look at its overlay",
                        suspect.rms_px, suspect.others_px
                    )
                }),
                camera_from_board_rotation: rotation
                    .row_iter()
                    .map(|row| row.iter().copied().collect())
                    .collect(),
                board_origin_in_camera_m: [origin.x, origin.y, origin.z],
                overlay: photo.map(|photo| overlay_name(&file_name(&photo.file))),
            }
        })
        .collect();
    let outliers = calibration
        .outliers
        .iter()
        .map(|outlier| {
            let view = &calibration.views[outlier.view];
            let point = &view.points[outlier.point];
            OutlierNumbers {
                file: view.name.clone(),
                column: point.observed.column,
                row: point.observed.row,
                distance_px: outlier.distance_px,
                weight: point.weight,
            }
        })
        .collect();
    let bend = &calibration.board.bend;
    let support = &calibration.support;
    CalibrationNumbers {
        format: FORMAT.to_owned(),
        version: VERSION,
        image_width_px: camera.width,
        image_height_px: camera.height,
        target: made.target.as_ref().map(|(target, counted)| {
            let (rows, columns) = target.size();
            TargetNumbers { unit: target.unit().to_owned(), rows, columns, counted: *counted }
        }),
        model: calibration.model.describe(),
        choice: made.choice.clone(),
        parameters: parameters(camera, |k| calibration.model.free[k], made.reference.as_ref()),
        correlation: {
            let n = camera.lens.names().len();
            (0..n).map(|i| (0..n).map(|j| calibration.correlation[(i, j)]).collect()).collect()
        },
        points: calibration.points(),
        j_px2: calibration.j_total,
        j_per_point_px2: calibration.j_per_point,
        rms_px: calibration.rms_px,
        sigma0_px: calibration.sigma0_px,
        robust_sigma_px: calibration.robust_sigma_px,
        iterations: calibration.iterations,
        closed_form: match calibration.start {
            ClosedForm::WithSkew => "with_skew",
            ClosedForm::NoSkew => "no_skew",
            ClosedForm::Centred => "centred_principal_point",
            ClosedForm::Ladder => "ladder_of_focal_lengths",
        }
        .to_owned(),
        steps: (!pairs.is_empty()).then(|| steps(&pairs.concat())),
        board: BoardNumbers {
            side_excess_m: calibration.board.side_excess_m.as_ref().map(measured),
            pitch_excess: calibration.board.pitch_excess.as_ref().map(measured),
            bend_m: bend.as_ref().map(|bend| bend.depth_m()),
            flat_probability: bend.as_ref().map(|bend| bend.flat_probability),
            bend_estimated: calibration.model.bend,
        },
        support: SupportNumbers {
            max_ideal_radius: finite(support.max_ideal_radius),
            fold_radius: finite(support.fold_radius),
            supported_share_of_frame: support.supported_share,
            folded_share_of_frame: support.folded_share,
            share_of_48_cells_with_corners: support.covered_cells,
            invertible: invertible(camera),
        },
        uncertainty,
        views,
        outliers,
        rejected_photos: made
            .rejected
            .iter()
            .map(|rejected| RejectedNumbers {
                file: rejected.file.clone(),
                reason: rejected.reason.clone(),
                overlay: rejected.detection.as_ref().map(|_| overlay_name(&rejected.file)),
            })
            .collect(),
        advice: made.advice.clone(),
        overlay_of: shown_overlay(made, calibration),
        figures: Vec::new(),
        notes: made.notes.clone(),
    }
}

/// Every point of every view with its estimates and residual (observed − predicted).
pub(super) fn corners_csv(made: &Calibrated, calibration: &Calibration) -> Result<Vec<u8>, StageError> {
    let failed = |e: csv::Error| StageError::new(ErrorClass::Bug, "corners.csv cannot be made").because(e);
    let mut table = csv::Writer::from_writer(Vec::new());
    table
        .write_record([
            "file",
            "point",
            "row",
            "column",
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
            "weight",
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
                    found(&|c| c.row.to_string()),
                    found(&|c| c.column.to_string()),
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
                    format!("{:.3}", point.weight),
                ])
                .map_err(failed)?;
        }
    }
    table
        .into_inner()
        .map_err(|e| StageError::new(ErrorClass::Bug, "corners.csv cannot be made").because(e.into_error()))
}
