//! `accuracy`: georeferenced frames and stated errors in; maps, budget, lengths, check points out.

mod checks;
mod pictures;
mod words;

use super::context::{ErrorClass, RunContext, StageError};
use super::georeference::Georeferenced;
use super::locate::error_model;
use crate::accuracy::budget::{self, Budget, budget, budget_at};
use crate::accuracy::ce90_map::Ce90Map;
use crate::accuracy::length::{PickedPixel, recover};
use crate::accuracy::{FramePropagation, PixelAccuracy, Source};
use crate::camera::ImagePoint;
use crate::config::accuracy::{Accuracy, LengthCheck, PickSpec};
use crate::config::{Config, Located};
use crate::formats::geotiff::{RasterDescription, write_float};
use crate::geodesy::WGS84;
use crate::geometry::{Displacement, Ned};
use crate::georeference::GeoreferencedFrame;
use crate::report::figures::ce90_picture;
use crate::report::numbers::{
    AccuracyNumbers, BudgetNumbers, BudgetPointNumbers, EllipseNumbers, FORMAT, FrameNumbers, LengthNumbers,
    MapNumbers, PlaceNumbers, RequirementNumbers, Share, VERSION, Without,
};
use rayon::prelude::*;
use serde_json::Value;

/// Files of this stage that the page shows.
pub const NUMBERS_FILE: &str = "accuracy.json";
/// CE90 over the map, as a picture.
pub const CE90_PICTURE: &str = "ce90.png";
/// Residuals at check points.
pub const RESIDUALS_FIGURE: &str = "residuals.svg";

/// Says what the survey is worth and writes `accuracy.json`, `frames.csv`, `ce90.tif`, the figures and, with
/// check points, `points.csv`.
///
/// # Errors
/// [`StageError`]: a picked pixel or check point that cannot be used, no frame with numbers, a product that
/// cannot be written.
pub fn run(
    config: &Config,
    survey: &Georeferenced,
    context: &RunContext,
) -> Result<AccuracyNumbers, StageError> {
    let declared = config
        .accuracy
        .as_ref()
        .ok_or_else(|| StageError::pipeline("the pipeline has no [accuracy] table"))?;
    let frames = with_velocities(&survey.frames);
    let mut assumptions = words::assumptions(declared, &frames);
    let mut frames_without = Vec::new();
    let mut propagations = Vec::with_capacity(frames.len());
    for frame in &frames {
        match FramePropagation::new(frame, &error_model(&declared.sigmas, frame)) {
            Ok(propagation) => propagations.push(propagation),
            Err(reason) => {
                frames_without.push(Without { name: frame.name.clone(), reason: reason.to_string() });
            }
        }
    }
    let all: Vec<Result<FrameNumbers, Without>> = propagations.par_iter().map(frame_numbers).collect();
    let mut numbers = Vec::with_capacity(all.len());
    for result in all {
        match result {
            Ok(frame) => numbers.push(frame),
            Err(without) => frames_without.push(without),
        }
    }
    frames_without.sort_by(|a, b| a.name.cmp(&b.name));
    if numbers.is_empty() {
        let first =
            frames_without.first().map_or("no frames".to_owned(), |w| format!("{}: {}", w.name, w.reason));
        return Err(
            StageError::input(format!("no frame has an accuracy; {first}")).at(config.at(&declared.table))
        );
    }
    for without in &frames_without {
        context.warn(format!("{} has no accuracy: {}", without.name, without.reason));
    }
    context.check_interrupted()?;

    let reference = reference_frame(config, declared, &propagations, &numbers)?;
    let eq11 = budget(reference.frame(), &error_model(&declared.sigmas, reference.frame()))
        .map_err(|reason| StageError::input(format!("frame {}: {reason}", reference.frame().name)))?;
    let map = ce90_map(survey, &propagations, context)?;
    context.check_interrupted()?;
    let (figures, monte_carlo) = pictures::draw(config, declared, reference, context)?;
    if let Some(line) = words::monte_carlo(monte_carlo.as_ref()) {
        assumptions.push(line);
    }
    let lengths = declared
        .lengths
        .iter()
        .map(|length| length_numbers(config, declared, length, &propagations, survey))
        .collect::<Result<Vec<_>, _>>()?;
    let check_points = checks::judge(config, declared, &propagations, survey, context)?;
    let requirement = match (declared.required_ce90_m, &map) {
        (Some(required), Some((map, numbers))) => {
            map.share_within(required).map(|share| RequirementNumbers {
                ce90_m: required,
                worst_ce90_m: numbers.ce90_worst_m,
                area_percent: 100.0 * share,
                met: share >= 1.0,
            })
        }
        _ => None,
    };
    let result = AccuracyNumbers {
        format: FORMAT.to_owned(),
        version: VERSION,
        sigmas: words::sigmas(declared),
        assumptions,
        map: map.map(|(_, numbers)| numbers),
        shares: shares(reference, &eq11),
        budget: budget_numbers(&eq11),
        frames: numbers,
        frames_without,
        monte_carlo,
        lengths,
        check_points,
        requirement,
        figures,
    };
    context.write_product("frames.csv", &frames_csv(&result.frames)?)?;
    let json = serde_json::to_value(&result).map(rounded).map_err(|e| bug(&e))?;
    let json = serde_json::to_string_pretty(&json).map_err(|e| bug(&e))?;
    context.write_product(NUMBERS_FILE, (json + "\n").as_bytes())?;
    Ok(result)
}

/// Numbers to twelve digits: no more is meant, and the rest would differ between machines.
fn rounded(value: Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => number
            .as_f64()
            .and_then(|v| format!("{v:.11e}").parse().ok())
            .and_then(serde_json::Number::from_f64)
            .map_or(Value::Null, Value::Number),
        Value::Array(values) => values.into_iter().map(rounded).collect(),
        Value::Object(entries) => {
            Value::Object(entries.into_iter().map(|(key, value)| (key, rounded(value))).collect())
        }
        other => other,
    }
}

/// An error that no input explains.
fn bug(error: &dyn std::fmt::Display) -> StageError {
    StageError::new(ErrorClass::Bug, error.to_string())
}

/// Frames whose log gave neither velocity nor speed take the velocity between the two exposures nearest in
/// time: for them a timing error would otherwise have nothing to be multiplied with.
pub(super) fn with_velocities(frames: &[GeoreferencedFrame]) -> Vec<GeoreferencedFrame> {
    let mut by_time: Vec<(f64, usize)> = frames
        .iter()
        .enumerate()
        .filter_map(|(i, frame)| frame.record.time.map(|time| (time.get(), i)))
        .collect();
    by_time.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut frames = frames.to_vec();
    let positions: Vec<_> = frames.iter().map(|f| WGS84.ecef_from_geodetic(&f.record.antenna)).collect();
    for (place, &(time, index)) in by_time.iter().enumerate() {
        let record = &mut frames[index].record;
        if record.velocity.is_some() || record.ground_speed_m_s.is_some() {
            continue;
        }
        let neighbours = [place.checked_sub(1), Some(place + 1)];
        let nearest = neighbours
            .into_iter()
            .flatten()
            .filter_map(|k| by_time.get(k))
            .filter(|(other, _)| *other != time)
            .min_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()));
        if let Some(&(other, neighbour)) = nearest {
            let moved = (positions[neighbour] - positions[index]) * (1.0 / (other - time));
            let ned_from_ecef = frames[index].chain.tangent.ecef_from_ned().rotation.inverse();
            let velocity: Displacement<Ned> = ned_from_ecef * moved;
            frames[index].record.velocity = Some(velocity);
        }
    }
    frames
}

fn ellipse(at: &PixelAccuracy) -> EllipseNumbers {
    EllipseNumbers {
        semi_major_m: at.ellipse.semi_major_m,
        semi_minor_m: at.ellipse.semi_minor_m,
        azimuth_deg: at.ellipse.azimuth.degrees(),
    }
}

/// A frame at its centre and its worst corner.
fn frame_numbers(propagation: &FramePropagation<'_>) -> Result<FrameNumbers, Without> {
    let frame = propagation.frame();
    let place = |name: &str, pixel: ImagePoint| -> Result<PlaceNumbers, String> {
        let point = budget_at(propagation, name, pixel).map_err(|e| e.to_string())?;
        Ok(PlaceNumbers {
            place: point.place,
            column: pixel.column,
            row: pixel.row,
            latitude_deg: point.position.latitude.degrees(),
            longitude_deg: point.position.longitude.degrees(),
            cep50_m: point.full_cep50_m,
            ce90_m: point.full_ce90_m,
            ellipse: ellipse(&point.full),
        })
    };
    let (name, pixel) = budget::centre(frame);
    let centre = place(name, pixel).map_err(|reason| Without { name: frame.name.clone(), reason })?;
    let corner_fraction = budget::corner_fraction(frame).unwrap_or(1.0);
    let worst_corner = budget::corners(frame, corner_fraction)
        .into_iter()
        .filter_map(|(name, pixel)| place(name, pixel).ok())
        .max_by(|a, b| a.ce90_m.total_cmp(&b.ce90_m));
    Ok(FrameNumbers { frame: frame.name.clone(), centre, worst_corner, corner_fraction })
}

/// The frame the budget and the figures are about: the one the pipeline file names, else the one nearest to
/// the middle of the survey.
fn reference_frame<'p, 'f>(
    config: &Config,
    declared: &Accuracy,
    propagations: &'p [FramePropagation<'f>],
    numbers: &[FrameNumbers],
) -> Result<&'p FramePropagation<'f>, StageError> {
    let usable = || propagations.iter().filter(|p| numbers.iter().any(|n| n.frame == p.frame().name));
    if let Some(name) = declared.monte_carlo.as_ref().and_then(|m| m.frame.as_ref()) {
        return usable().find(|p| p.frame().name == name.value).ok_or_else(|| {
            StageError::pipeline(format!("frame {} is not among the used frames", name.value))
                .at(config.at(name))
                .help("name a frame of the images folder that is not rejected")
        });
    }
    let centres: Vec<_> = usable().map(|p| p.frame().ecef_from_camera().origin.vector()).collect();
    let middle = centres.iter().sum::<nalgebra::Vector3<f64>>() / centres.len() as f64;
    usable()
        .min_by(|a, b| {
            let far =
                |p: &FramePropagation<'_>| (p.frame().ecef_from_camera().origin.vector() - middle).norm();
            far(a).total_cmp(&far(b))
        })
        .ok_or_else(|| bug(&"no reference frame among usable ones"))
}

fn budget_numbers(budget: &Budget) -> BudgetNumbers {
    BudgetNumbers {
        frame: budget.frame.clone(),
        position_cep50_m: budget.position_cep50_m,
        corner_fraction: budget.corner_fraction,
        points: budget
            .points
            .iter()
            .map(|p| BudgetPointNumbers {
                place: p.place.clone(),
                column: p.pixel.column,
                row: p.pixel.row,
                epsilon_attitude_m: p.epsilon_attitude_m,
                epsilon_m: p.epsilon_m,
                linear_m: p.linear_m,
                quadrature_m: p.quadrature_m,
                cep50_m: p.cep50_m,
                full_cep50_m: p.full_cep50_m,
                full_ce90_m: p.full_ce90_m,
            })
            .collect(),
        missing: budget
            .missing
            .iter()
            .map(|(name, reason)| Without { name: name.clone(), reason: reason.to_string() })
            .collect(),
    }
}

/// Shares at the centre and at the worst corner, greatest first; sources without any are left out.
fn shares(reference: &FramePropagation<'_>, budget: &Budget) -> Vec<Share> {
    let percent = |at: &PixelAccuracy, k: usize| {
        let sum: f64 = at.variance_by_source.iter().sum();
        if sum > 0.0 { 100.0 * at.variance_by_source[k] / sum } else { 0.0 }
    };
    let centre = budget.points.first().map(|p| &p.full);
    let corner =
        budget.points.iter().skip(1).max_by(|a, b| a.full_ce90_m.total_cmp(&b.full_ce90_m)).map(|p| &p.full);
    let mut shares: Vec<Share> = Source::ALL
        .into_iter()
        .enumerate()
        .map(|(k, source)| Share {
            source: words::source(source, reference.frame()).to_owned(),
            centre_percent: centre.map_or(0.0, |at| percent(at, k)),
            corner_percent: corner.map(|at| percent(at, k)),
        })
        .filter(|s| s.centre_percent > 0.0 || s.corner_percent.unwrap_or(0.0) > 0.0)
        .collect();
    shares.sort_by(|a, b| b.centre_percent.total_cmp(&a.centre_percent));
    shares
}

/// Maps CE90 and writes it as raster and picture.
fn ce90_map(
    survey: &Georeferenced,
    propagations: &[FramePropagation<'_>],
    context: &RunContext,
) -> Result<Option<(Ce90Map, MapNumbers)>, StageError> {
    let map = Ce90Map::new(propagations, &survey.projection)
        .map_err(|e| StageError::input("CE90 cannot be mapped").because(e))?;
    let Some((map, summary)) = map.and_then(|map| map.summary().map(|summary| (map, summary))) else {
        return Ok(None);
    };
    let description = RasterDescription {
        grid: map.grid,
        wkt: survey.projection.wkt().to_owned(),
        metadata: vec![
            ("TIFFTAG_SOFTWARE".to_owned(), concat!("boresight ", env!("CARGO_PKG_VERSION")).to_owned()),
            ("BORESIGHT_QUANTITY".to_owned(), "CE90, metres".to_owned()),
        ],
    };
    let path = context.product_path("ce90.tif")?;
    write_float(&path, &map.ce90_m, &description, rayon::current_num_threads())
        .map_err(|e| StageError::new(ErrorClass::Io, "ce90.tif cannot be written").because(e))?;
    context.record_product(&path);
    let picture = ce90_picture(map.ce90_m.samples(), map.ce90_m.width()).map_err(|e| bug(&e))?;
    let Some((png, colour_range_m)) = picture else { return Ok(None) };
    context.write_product(CE90_PICTURE, &png)?;
    let numbers = MapNumbers {
        ce90_median_m: summary.median_m,
        ce90_p95_m: summary.p95_m,
        ce90_worst_m: summary.worst_m,
        colour_range_m,
        area_m2: map.area_m2,
        cell: map.cell,
        crs: survey.projection.definition().to_owned(),
    };
    Ok(Some((map, numbers)))
}

/// The propagation of the frame a pick names.
fn picked<'p, 'f>(
    config: &Config,
    pick: &Located<PickSpec>,
    propagations: &'p [FramePropagation<'f>],
    survey: &Georeferenced,
) -> Result<&'p FramePropagation<'f>, StageError> {
    let name = &pick.frame.value;
    propagations.iter().find(|p| p.frame().name == *name).ok_or_else(|| {
        let why = match survey.rejected.iter().find(|r| r.frame == *name) {
            Some(rejected) => format!("frame {name} is rejected: {}", rejected.reason),
            None if survey.frames.iter().any(|f| f.name == *name) => format!("frame {name} has no accuracy"),
            None => format!("there is no frame {name}"),
        };
        StageError::pipeline(why)
            .at(config.at(&pick.frame))
            .help("name one of the used frames (georeference/frames.csv)")
    })
}

fn length_numbers(
    config: &Config,
    declared: &Accuracy,
    length: &LengthCheck,
    propagations: &[FramePropagation<'_>],
    survey: &Georeferenced,
) -> Result<LengthNumbers, StageError> {
    let end = |pick: &Located<PickSpec>| -> Result<_, StageError> {
        let propagation = picked(config, pick, propagations, survey)?;
        let pixel = ImagePoint::new(pick.column, pick.row);
        // Asked on its own first, so that the error names the end that is to blame.
        propagation.at(pixel).map_err(|reason| {
            StageError::pipeline(format!("{}: {reason}", length.name)).at(config.at(pick))
        })?;
        Ok((propagation, PickedPixel { pixel, height_m: None }))
    };
    let recovered = recover(end(&length.from)?, end(&length.to)?).map_err(|reason| {
        StageError::pipeline(format!("{}: {reason}", length.name)).at(config.at(&length.from))
    })?;
    Ok(LengthNumbers {
        name: length.name.clone(),
        frames: [length.from.frame.value.clone(), length.to.frame.value.clone()],
        length_m: recovered.length_m,
        std_m: recovered.std_m,
        interval_m: recovered.interval_m(declared.confidence).map_err(|e| bug(&e))?,
        confidence: declared.confidence,
        truth_m: length.truth_m,
        z_score: length.truth_m.and_then(|truth| recovered.z_score(truth).ok()),
    })
}

/// One row per frame.
fn frames_csv(frames: &[FrameNumbers]) -> Result<Vec<u8>, StageError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer
        .write_record([
            "frame",
            "place",
            "column",
            "row",
            "latitude_deg",
            "longitude_deg",
            "cep50_m",
            "ce90_m",
            "ellipse_semi_major_m",
            "ellipse_semi_minor_m",
            "ellipse_azimuth_deg",
        ])
        .map_err(|e| bug(&e))?;
    for frame in frames {
        for place in std::iter::once(&frame.centre).chain(&frame.worst_corner) {
            let e = place.ellipse;
            writer
                .write_record([
                    frame.frame.clone(),
                    place.place.clone(),
                    format!("{:.2}", place.column),
                    format!("{:.2}", place.row),
                    format!("{:.9}", place.latitude_deg),
                    format!("{:.9}", place.longitude_deg),
                    format!("{:.4}", place.cep50_m),
                    format!("{:.4}", place.ce90_m),
                    format!("{:.4}", e.semi_major_m),
                    format!("{:.4}", e.semi_minor_m),
                    format!("{:.2}", e.azimuth_deg),
                ])
                .map_err(|e| bug(&e))?;
        }
    }
    writer.into_inner().map_err(|e| bug(&e))
}
