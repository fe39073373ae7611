//! Check points: their files, their residuals, `points.csv`.

use super::{RESIDUALS_FIGURE, bug};
use crate::accuracy::FramePropagation;
use crate::accuracy::check::{
    CheckPoint, CheckStatistics, GroundUsed, Residual, residual, statistics_by_frame,
};
use crate::camera::ImagePoint;
use crate::config::Config;
use crate::config::accuracy::{Accuracy, CheckGround, CheckPoints, CheckPosition};
use crate::formats::InputError;
use crate::formats::crs::Projection;
use crate::formats::geoid::Geoid;
use crate::formats::table::Table;
use crate::geodesy::{Geodetic, MapPoint, MapProjection};
use crate::report::figures::residual_plot;
use crate::report::numbers::{CheckFigures, CheckFrame, CheckNumbers, CheckVariant, Without};
use crate::stages::context::{RunContext, StageError};
use crate::stages::georeference::{Georeferenced, failed};
use crate::units::{Metres, Radians};
use std::collections::BTreeMap;

/// Judges by check points, if there are any.
pub(super) fn judge(
    config: &Config,
    declared: &Accuracy,
    propagations: &[FramePropagation<'_>],
    survey: &Georeferenced,
    context: &RunContext,
) -> Result<Option<CheckNumbers>, StageError> {
    let Some(checks) = &declared.check_points else { return Ok(None) };
    let refused = |e: InputError| failed(config, e);
    let undulation = config.georeference.as_ref().and_then(|g| g.geoid_undulation_m);
    let points = read_points(checks, &undulation.map_or(Geoid::Grids, Geoid::Constant)).map_err(refused)?;
    let observations = read_observations(checks).map_err(refused)?;
    context.record_input(&checks.points);
    context.record_input(&checks.observations);
    let frames: BTreeMap<&str, &FramePropagation<'_>> =
        propagations.iter().map(|p| (p.frame().name.as_str(), p)).collect();
    let mut without = Vec::new();
    let mut own = Vec::new();
    let mut over_ground = Vec::new();
    for (line, point, frame, pixel) in observations {
        let name = format!("{point} in {frame} (line {line})");
        let mut leave_out = |reason: String| without.push(Without { name: name.clone(), reason });
        let Some(known) = points.get(&point) else {
            leave_out("no such point in the table of points".to_owned());
            continue;
        };
        let Some(propagation) = frames.get(frame.as_str()) else {
            leave_out(match survey.rejected.iter().find(|r| r.frame == frame) {
                Some(rejected) => format!("the frame is rejected: {}", rejected.reason),
                None => "no such frame".to_owned(),
            });
            continue;
        };
        // Both or none, so that the two columns of the report speak of the same observations.
        match (
            residual(propagation, known, pixel, GroundUsed::OwnHeight),
            residual(propagation, known, pixel, GroundUsed::FrameGround),
        ) {
            (Ok(a), Ok(b)) => {
                own.push(a);
                over_ground.push(b);
            }
            (Err(reason), _) | (_, Err(reason)) => leave_out(reason.to_string()),
        }
    }
    if !without.is_empty() {
        context.warn(format!(
            "{} check observations cannot be used; the first: {}: {}",
            without.len(),
            without[0].name,
            without[0].reason
        ));
    }
    let (Some(own_figures), Some(ground_figures)) =
        (variant("each point's own height", &own), variant("the frame's ground", &over_ground))
    else {
        return Err(StageError::input("no check observation can be used")
            .at(config.at(&checks.observations))
            .help("its frames must be used frames and its points must stand in the table of points"));
    };
    let (judged_by, judged) = match checks.ground {
        CheckGround::Point => (0, &own),
        CheckGround::Georeference => (1, &over_ground),
    };
    context.write_product("points.csv", &points_csv(&own, &over_ground)?)?;
    let variants = vec![own_figures, ground_figures];
    let pairs: Vec<(f64, f64)> = judged.iter().map(|r| (r.north_m, r.east_m)).collect();
    let figure = residual_plot(
        &pairs,
        variants[judged_by].all.ce90_sample_m,
        variants[judged_by].claimed_ce90_median_m,
    )
    .map_err(|e| bug(&e))?;
    context.write_product(RESIDUALS_FIGURE, figure.svg.as_bytes())?;
    let mut names: Vec<&str> = judged.iter().map(|r| r.point.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    Ok(Some(CheckNumbers { points: names.len(), judged_by, variants, without }))
}

fn read_points(checks: &CheckPoints, geoid: &Geoid) -> Result<BTreeMap<String, CheckPoint>, InputError> {
    let table = Table::read(&checks.points, b',')?;
    let refuse = |line: u64, cause: String| {
        InputError::new(&checks.points, cause).line(line).caused_by(&checks.points)
    };
    let name = table.column(&checks.point)?;
    let height = table.column(&checks.height.column)?;
    let (first, second) = match &checks.position {
        CheckPosition::Geodetic { latitude, longitude } => (latitude, longitude),
        CheckPosition::Projected { easting, northing, .. } => (easting, northing),
    };
    let columns = (table.column(&first.column)?, table.column(&second.column)?);
    let projection = match &checks.position {
        CheckPosition::Geodetic { .. } => None,
        CheckPosition::Projected { crs, .. } => Some(
            Projection::new(crs)
                .map_err(|e| InputError::new(&checks.points, format!("crs: {e}")).caused_by(crs))?,
        ),
    };
    let mut points = BTreeMap::new();
    for row in table.rows() {
        let line = row.line();
        let number =
            |column, factor: f64| row.number(column).map(|v| v * factor).map_err(|cause| refuse(line, cause));
        let (a, b) = (number(columns.0, first.factor)?, number(columns.1, second.factor)?);
        let mut position = match &projection {
            None if a.abs() > std::f64::consts::FRAC_PI_2 => {
                let degrees = Radians::new(a).degrees();
                return Err(refuse(line, format!("latitude {degrees} deg is beyond a pole")));
            }
            None => {
                Geodetic { latitude: Radians::new(a), longitude: Radians::new(b), height: Metres::new(0.0) }
            }
            Some(projection) => projection
                .geodetic_from_map(&[MapPoint { easting: a, northing: b }])
                .map_err(|e| refuse(line, e.to_string()))?[0],
        };
        let stated = number(height, checks.height.factor)?;
        let above = geoid
            .above_ellipsoid(checks.height_datum, &[position])
            .map_err(|e| refuse(line, e.to_string()))?[0];
        position = position.at_height(stated + above);
        let key = row.text(name).to_owned();
        if points.contains_key(&key) {
            return Err(refuse(line, format!("point \"{key}\" stands here a second time")));
        }
        points.insert(key.clone(), CheckPoint { name: key, position });
    }
    Ok(points)
}

type Observation = (u64, String, String, ImagePoint);

fn read_observations(checks: &CheckPoints) -> Result<Vec<Observation>, InputError> {
    let table = Table::read(&checks.observations, b',')?;
    let declared = &checks.observation_columns;
    let point = table.column(&declared.point)?;
    let frame = table.column(&declared.frame)?;
    let (column, line) = (table.column(&declared.column)?, table.column(&declared.row)?);
    let shift = checks.pixel_origin.offset_to_centre_px();
    table
        .rows()
        .map(|row| {
            let number = |cell| {
                row.number(cell).map(|v| v + shift).map_err(|cause| {
                    InputError::new(&checks.observations, cause)
                        .line(row.line())
                        .caused_by(&checks.observations)
                })
            };
            let pixel = ImagePoint::new(number(column)?, number(line)?);
            Ok((row.line(), row.text(point).to_owned(), row.text(frame).to_owned(), pixel))
        })
        .collect()
}

fn figures(s: CheckStatistics) -> CheckFigures {
    let few = s.is_few();
    CheckFigures {
        count: s.count,
        mean_north_m: s.mean_m[0],
        mean_east_m: s.mean_m[1],
        rmse_north_m: s.rmse_m[0],
        rmse_east_m: s.rmse_m[1],
        rmse_radial_m: s.rmse_radial_m,
        cep50_sample_m: s.cep50_sample_m,
        ce90_sample_m: s.ce90_sample_m,
        worst_m: s.worst.0,
        worst_point: s.worst.1,
        worst_frame: s.worst.2,
        mean_normalised_squared: s.mean_normalised_squared,
        few,
    }
}

fn variant(ground: &str, residuals: &[Residual]) -> Option<CheckVariant> {
    let all = figures(CheckStatistics::of(residuals)?);
    let mut claimed: Vec<f64> = residuals.iter().filter_map(|r| r.claimed.ce90_m().ok()).collect();
    claimed.sort_by(f64::total_cmp);
    let inside =
        residuals.iter().filter(|r| r.claimed.ce90_m().is_ok_and(|limit| r.radial_m() <= limit)).count();
    let comparable = claimed.len() == residuals.len();
    Some(CheckVariant {
        ground: ground.to_owned(),
        all,
        claimed_ce90_median_m: claimed.get(claimed.len() / 2).copied(),
        inside_claimed_ce90_percent: comparable.then(|| 100.0 * inside as f64 / residuals.len() as f64),
        frames: statistics_by_frame(residuals)
            .into_iter()
            .map(|(frame, s)| CheckFrame { frame, figures: figures(s) })
            .collect(),
    })
}

/// One row per observation: residuals over both grounds and the claim.
fn points_csv(own: &[Residual], over_ground: &[Residual]) -> Result<Vec<u8>, StageError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer
        .write_record([
            "point",
            "frame",
            "column",
            "row",
            "residual_north_own_height_m",
            "residual_east_own_height_m",
            "residual_north_frame_ground_m",
            "residual_east_frame_ground_m",
            "claimed_ce90_m",
            "normalised_squared_own_height",
        ])
        .map_err(|e| bug(&e))?;
    let metres = |v: f64| format!("{v:.4}");
    for (a, b) in own.iter().zip(over_ground) {
        writer
            .write_record([
                a.point.clone(),
                a.frame.clone(),
                format!("{:.3}", a.pixel.column),
                format!("{:.3}", a.pixel.row),
                metres(a.north_m),
                metres(a.east_m),
                metres(b.north_m),
                metres(b.east_m),
                a.claimed.ce90_m().map_or_else(|_| String::new(), metres),
                a.normalised_squared.map_or_else(String::new, metres),
            ])
            .map_err(|e| bug(&e))?;
    }
    writer.into_inner().map_err(|e| bug(&e))
}
