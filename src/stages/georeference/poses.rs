//! From log rows to navigation records: datums, north references and gimbal angles applied.

use crate::camera::PixelRotation;
use crate::config::georeference::{
    Georeference, GimbalAngle, GimbalReference as DeclaredReference, LeverArm,
    PixelRotation as DeclaredRotation,
};
use crate::config::log::{Height, HeightReference, VerticalDatum, YawReference};
use crate::formats::InputError;
use crate::formats::crs::Projection;
use crate::formats::geoid::Geoid;
use crate::formats::log::{BadRow, LogRow, LogTable, LoggedPosition};
use crate::geodesy::{Geodetic, MapProjection, grid_convergence};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Frame};
use crate::navigation::{GimbalAngles, GimbalReference, Mount, NavigationRecord};
use crate::terrain::Terrain;
use crate::units::{Metres, Radians};

/// The mount as declared, in the types of the chain.
pub(super) fn mount(declared: &Georeference) -> Mount {
    let m = &declared.mount;
    let fixed = |angle: &GimbalAngle| match angle {
        GimbalAngle::Fixed(radians) => Radians::new(*radians),
        // Every record brings its own; this one is never looked at.
        GimbalAngle::Column(_) => Radians::new(0.0),
    };
    Mount {
        antenna_in_body: displacement(m.antenna_in_body),
        gimbal_in_body: displacement(m.gimbal_in_body),
        camera_in_gimbal: displacement(m.camera_in_gimbal),
        boresight: YawPitchRoll::new(
            Radians::new(m.boresight.yaw_rad),
            Radians::new(m.boresight.pitch_rad),
            Radians::new(m.boresight.roll_rad),
        ),
        gimbal: GimbalAngles { pan: fixed(&m.pan), elevation: fixed(&m.elevation), roll: fixed(&m.roll) },
        gimbal_reference: match m.gimbal_reference {
            DeclaredReference::Body => GimbalReference::Body,
            DeclaredReference::Nav => GimbalReference::Nav,
        },
        pixel_rotation: PixelRotation::from_quarter_turns(match m.pixel_rotation {
            DeclaredRotation::None => 0,
            DeclaredRotation::Quarter => 1,
            DeclaredRotation::Half => 2,
            DeclaredRotation::ThreeQuarters => 3,
        }),
    }
}

fn displacement<F: Frame>(arm: LeverArm) -> Displacement<F> {
    Displacement::new(arm.forward_m, arm.right_m, arm.down_m)
}

/// Ellipsoidal height of a stated height at a place.
pub(super) fn ellipsoidal(height: Height, undulation_m: f64) -> f64 {
    match height.datum {
        VerticalDatum::Ellipsoid => height.metres,
        VerticalDatum::Egm96 => height.metres + undulation_m,
    }
}

/// True when any height of the pipeline is above sea level, so that a geoid is needed.
pub(super) fn needs_geoid(declared: &Georeference) -> bool {
    use crate::config::georeference::Ground;
    let log = match declared.log.position.height().map(|h| h.datum) {
        Some(HeightReference::Egm96) => true,
        Some(HeightReference::AboveTakeoff(h)) => h.datum == VerticalDatum::Egm96,
        _ => false,
    };
    let ground = match &declared.ground {
        Ground::Plane(h) => h.datum == VerticalDatum::Egm96,
        Ground::Dem { datum, .. } => *datum == VerticalDatum::Egm96,
        Ground::BelowCamera(_) => false,
    };
    log || ground
}

/// Answers for ground heights under positions, in order: metres above the ellipsoid, or why there is none.
pub(super) type HeightsUnder<'a> = &'a dyn Fn(&[Geodetic]) -> Vec<Result<f64, String>>;

/// Rows with their records, in the log's order.
pub(super) type Records = Vec<(LogRow, NavigationRecord)>;

/// Turns every usable row into a record; a row that turns out unusable joins the bad ones.
///
/// `ground` is asked only for heights above ground.
///
/// # Errors
/// [`InputError`] for what concerns the whole log: an unknown position CRS, a missing geoid.
pub(super) fn records(
    declared: &Georeference,
    table: LogTable,
    product_crs: impl FnOnce(&Geodetic) -> Result<Projection, InputError>,
    geoid: &Geoid,
    ground: HeightsUnder<'_>,
) -> Result<(Records, Vec<BadRow>), InputError> {
    let LogTable { rows, mut bad } = table;
    let file = &declared.log.file;
    let mut placed = places(declared, rows, &mut bad)?;
    let undulations = if needs_geoid(declared) {
        let at: Vec<Geodetic> = placed.iter().map(|(_, g)| *g).collect();
        geoid.undulations(&at).map_err(|e| InputError::new(file, e.to_string()).caused_by(file))?
    } else {
        vec![0.0; placed.len()]
    };
    let under: Vec<Result<f64, String>> =
        if matches!(declared.log.position.height().map(|h| h.datum), Some(HeightReference::AboveGround)) {
            ground(&placed.iter().map(|(_, g)| *g).collect::<Vec<_>>())
        } else {
            vec![Ok(0.0); placed.len()]
        };
    let grid_north = placed.iter().any(|(row, _)| row.yaw_reference == YawReference::GridNorth);
    let grid = match placed.first() {
        Some((_, first)) if grid_north => Some(match position_crs(declared)? {
            Some(projection) => projection,
            None => product_crs(first)?,
        }),
        _ => None,
    };
    let mut records = Vec::with_capacity(placed.len());
    for (((row, at), n), under) in placed.drain(..).zip(undulations).zip(under) {
        match record(declared, &row, at, n, under, grid.as_ref()) {
            Ok(record) => records.push((row, record)),
            Err(cause) => bad.push(BadRow { line: row.line, frame: row.frame, cause }),
        }
    }
    bad.sort_by_key(|row| row.line);
    Ok((records, bad))
}

fn position_crs(declared: &Georeference) -> Result<Option<Projection>, InputError> {
    use crate::config::log::PositionColumns;
    match &declared.log.position {
        PositionColumns::Projected { crs, .. } => {
            Projection::new(crs).map(Some).map_err(|e| InputError::of_setting(crs, e.to_string()))
        }
        _ => Ok(None),
    }
}

/// Where the first usable row stands.
pub(super) fn first_place(declared: &Georeference, table: &LogTable) -> Result<Option<Geodetic>, InputError> {
    let first: Vec<LogRow> = table.rows.first().cloned().into_iter().collect();
    Ok(places(declared, first, &mut Vec::new())?.first().map(|(_, at)| *at))
}

/// Latitude and longitude of every row, at the height it states.
fn places(
    declared: &Georeference,
    rows: Vec<LogRow>,
    bad: &mut Vec<BadRow>,
) -> Result<Vec<(LogRow, Geodetic)>, InputError> {
    let projection = position_crs(declared)?;
    let mut placed = Vec::with_capacity(rows.len());
    for row in rows {
        let at = match (row.position, &projection) {
            (LoggedPosition::Geodetic { latitude, longitude, height_m, .. }, _) => {
                Ok(Geodetic { latitude, longitude, height: Metres::new(height_m) })
            }
            (LoggedPosition::Ecef(at), _) => Ok(at),
            (LoggedPosition::Projected { map, height_m, .. }, Some(projection)) => projection
                .geodetic_from_map(&[map])
                .map(|at| at[0].at_height(height_m))
                .map_err(|e| e.to_string()),
            (LoggedPosition::Projected { .. }, None) => Err("the position has no CRS".to_owned()),
        };
        match at {
            Ok(at) => placed.push((row, at)),
            Err(cause) => bad.push(BadRow { line: row.line, frame: row.frame, cause }),
        }
    }
    Ok(placed)
}

fn record(
    declared: &Georeference,
    row: &LogRow,
    at: Geodetic,
    undulation_m: f64,
    under: Result<f64, String>,
    grid: Option<&Projection>,
) -> Result<NavigationRecord, String> {
    let stated = at.height.get();
    let height = match crate::formats::log::logged_height(&row.position).map(|(_, datum)| datum) {
        None | Some(HeightReference::Ellipsoid) => stated,
        Some(HeightReference::Egm96) => stated + undulation_m,
        Some(HeightReference::AboveGround) => {
            stated
                + under.map_err(|e| {
                    format!("its height is above ground, and there is no ground under it: {e}")
                })?
        }
        Some(HeightReference::AboveTakeoff(takeoff)) => stated + ellipsoidal(takeoff, undulation_m),
    };
    let antenna = at.at_height(height);
    let attitude = match row.attitude {
        None => YawPitchRoll::default(),
        Some([yaw, pitch, roll]) => {
            let yaw = match (row.yaw_reference, grid) {
                (YawReference::GridNorth, Some(grid)) => {
                    yaw + grid_convergence(grid, &antenna).map_err(|e| e.to_string())?
                }
                _ => yaw,
            };
            YawPitchRoll::new(yaw.wrapped(), pitch, roll)
        }
    };
    let m = &declared.mount;
    let angle = |logged: Option<Radians>, declared: &GimbalAngle| match declared {
        GimbalAngle::Fixed(radians) => Radians::new(*radians),
        GimbalAngle::Column(_) => logged.unwrap_or_default(),
    };
    let any_logged = row.gimbal.iter().any(Option::is_some);
    let gimbal = any_logged.then(|| GimbalAngles {
        pan: angle(row.gimbal[0], &m.pan),
        elevation: angle(row.gimbal[1], &m.elevation),
        roll: angle(row.gimbal[2], &m.roll),
    });
    let course = declared.log.attitude.as_ref().is_some_and(|a| a.yaw.is_course());
    let velocity = row.velocity.or_else(|| match (course, row.ground_speed_m_s) {
        (true, Some(speed)) => {
            let (sin, cos) = attitude.yaw.get().sin_cos();
            Some(Displacement::new(speed * cos, speed * sin, 0.0))
        }
        _ => None,
    });
    let turned = row.pixel_rotation.map(|own| {
        let fixed = mount(declared).pixel_rotation;
        PixelRotation::from_quarter_turns(i64::from(own.degrees() + fixed.degrees()) / 90)
    });
    Ok(NavigationRecord {
        line: row.line,
        time: row.time,
        antenna,
        attitude,
        gimbal,
        height_above_ground_m: row.height_above_ground_m,
        ground_speed_m_s: row.ground_speed_m_s,
        velocity,
        pixel_rotation: turned,
    })
}

/// Ground heights under positions, for logs whose heights are above ground.
pub(super) fn heights_under(terrain: &dyn Terrain, at: &[Geodetic]) -> Vec<Result<f64, String>> {
    terrain.heights(at).into_iter().map(|h| h.map_err(|e| e.to_string())).collect()
}
