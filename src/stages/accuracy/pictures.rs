//! Maps over one image: the model's CE90, one degree of one angle, and the error map by drawing.

use super::bug;
use crate::accuracy::budget::ATTITUDE;
use crate::accuracy::error_map::{Angle, ErrorMap, PixelGrid, error_map};
use crate::accuracy::monte_carlo::{Draws, MonteCarloMap, monte_carlo};
use crate::accuracy::{AngleStd, ErrorModel, FramePropagation};
use crate::config::Config;
use crate::config::accuracy::{Accuracy, DrawnAngle, MonteCarlo};
use crate::formats::geotiff::write_image_bands;
use crate::navigation::GimbalReference;
use crate::raster::Raster;
use crate::report::figures::{Panel, contour_panels};
use crate::report::numbers::{FigureFile, MonteCarloNumbers};
use crate::stages::context::{ErrorClass, RunContext, StageError};
use crate::stages::locate::error_model;
use crate::units::Radians;
use rayon::prelude::*;

/// Cells across for the maps that cost nothing.
const FINE_COLUMNS: usize = 96;

/// Draws every figure of the reference frame and writes its raster.
pub(super) fn draw(
    config: &Config,
    declared: &Accuracy,
    reference: &FramePropagation<'_>,
    context: &RunContext,
) -> Result<(Vec<FigureFile>, Option<MonteCarloNumbers>), StageError> {
    let frame = reference.frame();
    let (w, h) = frame.stored_size();
    let fine_rows = (FINE_COLUMNS * h as usize).div_ceil(w as usize).clamp(1, h as usize);
    let fine =
        PixelGrid::over(frame, FINE_COLUMNS.min(w as usize), fine_rows).ok_or_else(|| bug(&"no grid"))?;
    let mut figures = vec![model_figure(reference, fine, context)?];
    let angle = declared.monte_carlo.as_ref().and_then(|m| m.angle).map_or(Angle::Tilt, |(a, _)| of(a));
    figures.push(one_degree_figure(reference, angle, fine, context)?);
    let drawn = match &declared.monte_carlo {
        None => None,
        Some(wanted) => {
            let (figure, numbers) = drawn_figure(config, declared, wanted, reference, context)?;
            figures.push(figure);
            Some(numbers)
        }
    };
    Ok((figures, drawn))
}

const fn of(angle: DrawnAngle) -> Angle {
    match angle {
        DrawnAngle::Tilt => Angle::Tilt,
        DrawnAngle::Pan => Angle::Pan,
        DrawnAngle::Roll => Angle::Roll,
        DrawnAngle::Pitch => Angle::Pitch,
        DrawnAngle::Yaw => Angle::Yaw,
    }
}

/// Quantities over a grid of pixels, each with its title.
struct Maps<'a> {
    /// File name without extension.
    name: &'a str,
    grid: PixelGrid,
    /// Name of the band, title of its panel or none, values row by row.
    bands: Vec<(&'static str, Option<String>, Vec<f64>)>,
    /// Values that grow fast towards one side.
    spread: bool,
    title: String,
    caption: String,
    metadata: Vec<(String, String)>,
}

/// Writes a raster, an SVG and a PNG.
fn publish(maps: Maps<'_>, context: &RunContext) -> Result<FigureFile, StageError> {
    let (columns, rows) = (maps.grid.columns, maps.grid.rows);
    let panels: Vec<Panel> = maps
        .bands
        .iter()
        .filter_map(|(_, title, values)| {
            Some(Panel {
                title: title.clone()?,
                image_px: (maps.grid.image_width, maps.grid.image_height),
                columns,
                rows,
                values: values.clone(),
                spread: maps.spread,
            })
        })
        .collect();
    let figure = contour_panels(&panels).map_err(|e| bug(&e))?;
    let file = format!("{}.svg", maps.name);
    context.write_product(&file, figure.svg.as_bytes())?;
    context.write_product(&format!("{}.png", maps.name), &figure.png)?;
    let bands = maps
        .bands
        .iter()
        .map(|(name, _, values)| {
            let samples = values.iter().map(|v| *v as f32).collect();
            Raster::new(columns, rows, samples)
                .map(|raster| (*name, raster))
                .ok_or_else(|| bug(&"a band is short"))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let step = maps.grid.step();
    let mut metadata = vec![
        ("TIFFTAG_SOFTWARE".to_owned(), concat!("boresight ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("BORESIGHT_UNIT".to_owned(), "metre".to_owned()),
        ("BORESIGHT_COORDINATES".to_owned(), "column, row of the stored image in pixels".to_owned()),
        ("BORESIGHT_STEP_PX".to_owned(), format!("{} {}", step.0, step.1)),
    ];
    metadata.extend(maps.metadata);
    let path = context.product_path(&format!("{}.tif", maps.name))?;
    write_image_bands(&path, &bands, step, &metadata).map_err(|e| {
        StageError::new(ErrorClass::Io, format!("{}.tif cannot be written", maps.name)).because(e)
    })?;
    context.record_product(&path);
    Ok(FigureFile { file, title: maps.title, caption: maps.caption })
}

/// 1σ north and east and CE90 under the whole model, first order.
fn model_figure(
    reference: &FramePropagation<'_>,
    grid: PixelGrid,
    context: &RunContext,
) -> Result<FigureFile, StageError> {
    let cells: Vec<[f64; 3]> = grid
        .pixels()
        .into_par_iter()
        .map(|pixel| {
            let Ok(at) = reference.at(pixel) else { return [f64::NAN; 3] };
            let std = |k: usize| at.covariance[(k, k)].max(0.0).sqrt();
            [std(0), std(1), at.ce90_m().unwrap_or(f64::NAN)]
        })
        .collect();
    let band = |k: usize| cells.iter().map(|c| c[k]).collect::<Vec<f64>>();
    let name = &reference.frame().name;
    publish(
        Maps {
            name: "frame-accuracy",
            grid,
            spread: grows_fast(&band(2)),
            bands: vec![
                ("north_std", Some("north, 1σ (m)".to_owned()), band(0)),
                ("east_std", Some("east, 1σ (m)".to_owned()), band(1)),
                ("ce90", Some("CE90 (m)".to_owned()), band(2)),
            ],
            title: "Accuracy over the image".to_owned(),
            caption: format!(
                "All stated errors together over the image of {name}: 1σ along north and east, and CE90, in metres on the ground."
            ),
            metadata: vec![("BORESIGHT_FRAME".to_owned(), name.clone())],
        },
        context,
    )
}

/// Exact displacement for one degree of one angle: Fig. 7 of the paper.
fn one_degree_figure(
    reference: &FramePropagation<'_>,
    angle: Angle,
    grid: PixelGrid,
    context: &RunContext,
) -> Result<FigureFile, StageError> {
    let frame = reference.frame();
    let ErrorMap { cells, .. } = error_map(frame, angle, Radians::from_degrees(1.0), grid)
        .map_err(|e| StageError::input(format!("{} turned by one degree: {e}", frame.name)))?;
    let band = |f: &dyn Fn(&crate::accuracy::error_map::GroundShift) -> f64| {
        cells.iter().map(|c| c.as_ref().map_or(f64::NAN, f)).collect::<Vec<f64>>()
    };
    let radial = band(&|s| s.radial_m());
    publish(
        Maps {
            name: "one-degree",
            grid,
            spread: grows_fast(&radial),
            bands: vec![
                ("north", Some(format!("north (m per 1° of {})", angle.name())), band(&|s| s.north_m)),
                ("east", Some("east (m)".to_owned()), band(&|s| s.east_m)),
                ("radial", Some("radial (m)".to_owned()), radial),
            ],
            title: format!("Displacement for one degree of {}", angle.name()),
            caption: format!(
                "How far the ground points of {} move when its {} grows by one degree (the paper's Fig. 7), through the whole chain, not linearised.",
                frame.name,
                in_full(angle)
            ),
            metadata: vec![
                ("BORESIGHT_FRAME".to_owned(), frame.name.clone()),
                ("BORESIGHT_ANGLE".to_owned(), angle.name().to_owned()),
                ("BORESIGHT_CHANGE_DEG".to_owned(), "1".to_owned()),
            ],
        },
        context,
    )
}

const fn in_full(angle: Angle) -> &'static str {
    match angle {
        Angle::Tilt => "gimbal elevation (tilt, positive up)",
        Angle::Pan => "gimbal pan",
        Angle::Roll => "roll",
        Angle::Pitch => "pitch",
        Angle::Yaw => "yaw",
    }
}

/// The model with one angle's error only.
fn single(angle: DrawnAngle, std: f64) -> ErrorModel {
    let about = |yaw, pitch, roll| AngleStd { yaw, pitch, roll };
    // Explicitly zero for the gimbal: `None` would let a stabilised head follow the UAV's attitude.
    let none = Some(AngleStd::default());
    let (attitude_std, gimbal_std) = match angle {
        DrawnAngle::Tilt => (AngleStd::default(), Some(about(0.0, std, 0.0))),
        DrawnAngle::Pan => (AngleStd::default(), Some(about(std, 0.0, 0.0))),
        DrawnAngle::Roll => (about(0.0, 0.0, std), none),
        DrawnAngle::Pitch => (about(0.0, std, 0.0), none),
        DrawnAngle::Yaw => (about(std, 0.0, 0.0), none),
    };
    ErrorModel { attitude_std, gimbal_std, ..ErrorModel::default() }
}

/// The attitude-error map by drawing.
fn drawn_figure(
    config: &Config,
    declared: &Accuracy,
    wanted: &MonteCarlo,
    reference: &FramePropagation<'_>,
    context: &RunContext,
) -> Result<(FigureFile, MonteCarloNumbers), StageError> {
    let frame = reference.frame();
    let place = config.at(&declared.table);
    let (model, what) = match wanted.angle {
        Some((angle, std)) => (
            single(angle, std),
            format!("{} with 1σ of {}°", in_full(of(angle)), digits(Radians::new(std).degrees())),
        ),
        None => (
            error_model(&declared.sigmas, frame).only(&ATTITUDE),
            match frame.mount.gimbal_reference {
                GimbalReference::Body => "roll, pitch, yaw and gimbal angles with their stated spread",
                GimbalReference::Nav => "the stabilised camera's attitude with its stated spread",
            }
            .to_owned(),
        ),
    };
    let grid =
        PixelGrid::over(frame, wanted.grid_columns as usize, wanted.grid_rows as usize).ok_or_else(|| {
            StageError::pipeline(format!(
                "a grid of {} × {} does not fit an image of {} × {} pixels",
                wanted.grid_columns,
                wanted.grid_rows,
                frame.stored_size().0,
                frame.stored_size().1
            ))
            .at(place.clone())
        })?;
    let count = u32::try_from(wanted.draws).map_err(|_| {
        StageError::pipeline(format!("{} draws are more than {}", wanted.draws, u32::MAX)).at(place.clone())
    })?;
    let draws = Draws { seed: context.seed(), count };
    let refused = |e: &dyn std::fmt::Display| {
        StageError::pipeline(format!("the error map of {what} cannot be drawn: {e}")).at(place.clone())
    };
    let map = monte_carlo(frame, &model, grid, draws).map_err(|e| refused(&e))?;
    let first_order = FramePropagation::new(frame, &model).map_err(|e| refused(&e))?;
    let numbers = drawn_numbers(&map, &first_order, what.clone());
    let band = |f: &dyn Fn(&crate::accuracy::monte_carlo::CellStatistics) -> Option<f64>| {
        map.cells.iter().map(|c| c.as_ref().and_then(f).unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    let ce90 = band(&|c| c.ce90_m);
    let figure = publish(
        Maps {
            name: "attitude-error-map",
            grid,
            spread: grows_fast(&ce90),
            bands: vec![
                ("north_std", Some("north, 1σ (m)".to_owned()), band(&|c| Some(c.std_north_m))),
                ("east_std", Some("east, 1σ (m)".to_owned()), band(&|c| Some(c.std_east_m))),
                ("ce90", Some("CE90 (m)".to_owned()), ce90),
                ("cep50", None, band(&|c| c.cep50_m)),
                ("north_mean", None, band(&|c| Some(c.mean_north_m))),
                ("east_mean", None, band(&|c| Some(c.mean_east_m))),
            ],
            title: "Attitude error over the image, by drawing".to_owned(),
            caption: format!(
                "Errors on the ground over the image of {} from {what}, drawn {} times through the whole chain (seed {}).",
                frame.name, count, draws.seed
            ),
            metadata: vec![
                ("BORESIGHT_FRAME".to_owned(), frame.name.clone()),
                ("BORESIGHT_DRAWN".to_owned(), what),
                ("BORESIGHT_DRAWS".to_owned(), count.to_string()),
                ("BORESIGHT_SEED".to_owned(), draws.seed.to_string()),
            ],
        },
        context,
    )?;
    Ok((figure, numbers))
}

fn drawn_numbers(
    map: &MonteCarloMap,
    first_order: &FramePropagation<'_>,
    drawn: String,
) -> MonteCarloNumbers {
    let grid = map.grid;
    let middle = map.cells[(grid.rows / 2) * grid.columns + grid.columns / 2];
    let difference = grid
        .pixels()
        .into_iter()
        .zip(&map.cells)
        .filter_map(|(pixel, cell)| {
            let drawn = cell.as_ref()?.ce90_m?;
            let claimed = first_order.at(pixel).ok()?.ce90_m().ok()?;
            Some(100.0 * (drawn / claimed - 1.0).abs())
        })
        .reduce(f64::max);
    MonteCarloNumbers {
        frame: first_order.frame().name.clone(),
        drawn,
        draws: map.draws.count,
        seed: map.draws.seed,
        grid: [grid.columns, grid.rows],
        centre_ce90_m: middle.and_then(|c| c.ce90_m),
        worst_ce90_m: map.cells.iter().flatten().filter_map(|c| c.ce90_m).reduce(f64::max),
        first_order_difference_percent: difference,
        points_with_misses: map.cells.iter().flatten().filter(|c| c.misses > 0).count(),
    }
}

/// True when most of a map is far below its maximum (an oblique view): round steps would crowd its far side.
fn grows_fast(values: &[f64]) -> bool {
    let mut finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    finite.sort_by(f64::total_cmp);
    match (finite.get(finite.len() / 2), finite.last()) {
        (Some(median), Some(last)) => *last > 6.0 * median,
        _ => false,
    }
}

/// An angle without the dust of unit conversion.
fn digits(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
