//! OpenSfM's and ODM's `reconstruction.json`: the poses of the shots.
//!
//! # Source
//! OpenSfM documentation, "Reconstruction file format" and "Coordinate systems"; `opensfm/geo.py`: topocentric coordinates are
//! east, north, up of the WGS 84 ellipsoid at `reference_lla`, turned exactly through Earth-centred ones; `export_geocoords`
//! and ODM's `run_opensfm.py`: after its georeferencing ODM keeps that file as `reconstruction.topocentric.json` and leaves in
//! `reconstruction.json` one on the UTM grid, less an offset.

use super::declared::{Coordinates, Crs};
use super::json::{Members, three, without_nan};
use super::poses::words;
use super::text::{bad, not_empty, number, short};
use super::{
    Clock, Exposure, FlightLog, LoggedAttitude, LoggedPosition, Origin, ReadError, plausible_height,
};
use crate::geodesy::{Geodetic, HeightKind, LocalTangent, WGS84};
use crate::geometry::attitude::OmegaPhiKappa;
use crate::geometry::{Camera, Ned, Point, Rotation};
use crate::units::Radians;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde_json::Value;
use std::sync::Arc;

/// The axes of a reconstruction: the file does not say which it has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Axes<'a> {
    /// East, north, up at `reference_lla`: OpenSfM's own, and ODM's `reconstruction.topocentric.json`.
    Topocentric,
    /// Easting and northing of a map grid less an offset, and height: ODM's `reconstruction.json` of a georeferenced project,
    /// OpenSfM's `reconstruction.geocoords.json`.
    Grid {
        /// The grid: the first line of ODM's `odm_georeferencing/coords.txt`.
        crs: &'a str,
        /// Added to easting and northing, metres: its second line.
        offset: [f64; 2],
    },
}

/// One reconstruction of the file.
#[derive(serde::Deserialize)]
struct Reconstruction {
    shots: Members,
    reference_lla: Option<Value>,
}

/// A file may hold one or a list.
#[derive(serde::Deserialize)]
#[serde(untagged)]
enum File {
    Many(Vec<Reconstruction>),
    One(Reconstruction),
}

/// Where a reconstruction stands.
enum Frame {
    Topocentric(Box<LocalTangent>),
    Grid(Crs, [f64; 2]),
}

/// Reads the shots of all reconstructions.
///
/// `reference`: the bytes of `reference_lla.json`, for a file without a `reference_lla` of its own. `heights`: what the
/// heights of the photos' GPS tags were measured from, which OpenSfM hands through: it calls them ellipsoidal without
/// looking. `None` believes that.
///
/// Positions are Earth-centred for ellipsoidal heights, and latitude, longitude and height of the stated kind otherwise.
///
/// # Errors
/// [`ReadError`] for text that is no reconstruction, without a reference, and when no shot is usable.
pub fn read(
    bytes: &[u8],
    axes: Axes<'_>,
    reference: Option<&[u8]>,
    heights: Option<HeightKind>,
) -> Result<FlightLog, ReadError> {
    let file = parse(bytes)?;
    let mut log = FlightLog::new(Clock::Own);
    let kind = heights.unwrap_or(HeightKind::Ellipsoid);
    let origins: Arc<[Origin]> = origins(axes, kind).into();
    let count = file.len();
    let mut place = 0;
    for reconstruction in file {
        let frame = frame(&reconstruction, axes, reference)?;
        if let Frame::Grid(crs, _) = &frame {
            log.crs = crs.kept();
        }
        for (name, shot) in &reconstruction.shots.0 {
            place += 1;
            match exposure(place, shot, &frame, kind) {
                Ok(exposure) => log.exposures.push(Exposure {
                    frame: Some(name.clone()),
                    origins: Arc::clone(&origins),
                    ..exposure
                }),
                Err(cause) => bad(&mut log, place, Some(name.clone()), cause)?,
            }
        }
    }
    if count != 1 {
        log.notes.push(format!(
            "The file holds {count} reconstructions that were not tied to each other by matches; all are used."
        ));
    }
    if heights.is_none() {
        log.notes.push(
            "Heights are taken as ellipsoidal, as OpenSfM calls them; if the photos' GPS heights count from mean sea level, \
             declare it."
                .to_owned(),
        );
    }
    log.origins = origins.to_vec();
    not_empty(log, "a reconstruction")
}

fn parse(bytes: &[u8]) -> Result<Vec<Reconstruction>, ReadError> {
    let text = without_nan(bytes);
    let failed = |e: serde_json::Error| {
        ReadError::new(format!("is no reconstruction of OpenSfM ({e})")).line(e.line() as u64)
    };
    // Told apart by the first character rather than by trial: the messages then name the place.
    let file = if text.trim_ascii_start().first() == Some(&b'[') {
        serde_json::from_slice(&text).map(File::Many)
    } else {
        serde_json::from_slice(&text).map(File::One)
    };
    Ok(match file.map_err(failed)? {
        File::Many(all) => all,
        File::One(one) => vec![one],
    })
}

fn frame(
    reconstruction: &Reconstruction,
    axes: Axes<'_>,
    reference: Option<&[u8]>,
) -> Result<Frame, ReadError> {
    match axes {
        Axes::Grid { crs, offset } => {
            let crs = Crs::of(crs)?;
            if crs.coordinates != Coordinates::Grid || !offset.iter().all(|o| o.is_finite()) {
                return Err(ReadError::new(
                    "the reconstruction's grid is no map projection with a finite offset",
                )
                .help("name odm_georeferencing/coords.txt as `offset_file`"));
            }
            Ok(Frame::Grid(crs, offset))
        }
        Axes::Topocentric => {
            let read: Value;
            let lla = match (&reconstruction.reference_lla, reference) {
                (Some(own), _) => own,
                (None, Some(bytes)) => {
                    read = serde_json::from_slice(bytes)
                        .map_err(|e| ReadError::new(format!("reference_lla.json is no JSON ({e})")))?;
                    &read
                }
                (None, None) => {
                    return Err(ReadError::new(
                        "states no reference_lla: its positions have no place on the Earth",
                    )
                    .help("give the reference_lla.json that stands beside it"));
                }
            };
            reference_lla(lla)
                .map(|at| Frame::Topocentric(Box::new(LocalTangent::at(at))))
                .map_err(ReadError::new)
        }
    }
}

fn reference_lla(lla: &Value) -> Result<Geodetic, String> {
    let get = |name: &str| {
        let value = lla.get(name).and_then(Value::as_f64);
        value.ok_or_else(|| format!("reference_lla has no number \"{name}\""))
    };
    let (latitude, longitude, altitude) = (get("latitude")?, get("longitude")?, get("altitude")?);
    super::geodetic(
        Radians::from_degrees(latitude),
        Radians::from_degrees(longitude),
        altitude,
        HeightKind::Ellipsoid,
    )?;
    Ok(Geodetic::from_degrees(latitude, longitude, altitude))
}

fn exposure(place: u64, shot: &Value, frame: &Frame, kind: HeightKind) -> Result<Exposure, String> {
    let turn = three("rotation", shot.get("rotation"))?;
    let translation = three("translation", shot.get("translation"))?;
    if turn.iter().any(|r| r.abs() > 100.0) {
        return Err(format!("rotation {turn:?} is no axis times an angle in radians"));
    }
    let camera_from_world = Rotation3::new(Vector3::from(turn));
    let world_from_camera = camera_from_world.inverse();
    let centre = -(world_from_camera * Vector3::from(translation));
    let (position, attitude) = match frame {
        Frame::Topocentric(_) if !(0.0..1e6).contains(&centre.norm()) => {
            return Err(format!("stands {:.0} km from the reference", centre.norm() / 1e3));
        }
        Frame::Topocentric(reference) => on_earth(reference, &world_from_camera, &centre, kind)?,
        Frame::Grid(crs, [east, north]) => {
            let position = crs.position([centre.x + east, centre.y + north, centre.z], kind)?;
            // Photo axes (x right, y up, z back) of a camera with x right, y down, z forward.
            let photo = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
            let angles = OmegaPhiKappa::of_grid_from_photo(&(world_from_camera.matrix() * photo));
            (position, LoggedAttitude::CameraOnGrid(angles))
        }
    };
    Ok(Exposure { position: Some(position), attitude: Some(attitude), ..Exposure::at(place) })
}

/// From east, north, up at the reference to the position on the Earth and the attitude in the frame there.
fn on_earth(
    reference: &LocalTangent,
    world_from_camera: &Rotation3<f64>,
    centre: &Vector3<f64>,
    kind: HeightKind,
) -> Result<(LoggedPosition, LoggedAttitude), String> {
    let ned_from_enu = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let ecef_from_reference = reference.ecef_from_ned();
    let point = *ecef_from_reference * Point::<Ned>::from_vector(ned_from_enu * centre);
    let at = WGS84.geodetic_from_ecef(&point);
    plausible_height(at.height.get())?;
    let reference_from_camera =
        Rotation::<Ned, Camera>::from_matrix_unchecked(ned_from_enu * world_from_camera.matrix());
    let there = LocalTangent::at(at);
    let ned_from_camera =
        there.ecef_from_ned().rotation.inverse() * (ecef_from_reference.rotation * reference_from_camera);
    let position = if kind == HeightKind::Ellipsoid {
        LoggedPosition::Ecef(point)
    } else {
        LoggedPosition::Geodetic {
            latitude: at.latitude,
            longitude: at.longitude,
            height_m: at.height.get(),
            kind,
        }
    };
    Ok((position, LoggedAttitude::CameraInNed(ned_from_camera)))
}

/// The CRS and offset of ODM's `odm_georeferencing/coords.txt`: its first two lines.
///
/// # Errors
/// [`ReadError`] for text that is no such file.
pub fn coords_txt(bytes: &[u8]) -> Result<(String, [f64; 2]), ReadError> {
    let mut rows = super::text::lines(bytes)?;
    let mut next = || match rows.next() {
        Some((_, Ok(line))) => Ok(line.trim()),
        _ => Err(ReadError::new("is no coords.txt of ODM: it has not two lines of text")),
    };
    let crs = Crs::of(next()?).map_err(|e| e.line(1))?;
    let cells: Vec<&str> = next()?.split_whitespace().collect();
    let [east, north] = cells[..] else {
        return Err(ReadError::new("holds no two offsets, east and north").line(2));
    };
    let offset = |name, cell| number(name, cell).map_err(|e| ReadError::new(e).line(2));
    Ok((crs.definition, [offset("offset east", east)?, offset("offset north", north)?]))
}

fn origins(axes: Axes<'_>, kind: HeightKind) -> Vec<Origin> {
    let (position, attitude) = match axes {
        Axes::Topocentric => (
            format!(
                "-Rᵀt, metres east, north, up of reference_lla on WGS 84, turned exactly through Earth-centred coordinates; \
                 heights above {}",
                words(kind)
            ),
            "Rᵀ brought from the reference's to the camera's own north, east, down",
        ),
        Axes::Grid { crs, offset: [east, north] } => (
            format!("-Rᵀt + ({east}, {north}), on the grid {}; heights above {}", short(crs), words(kind)),
            "Rᵀ against the grid",
        ),
    };
    vec![
        Origin { quantity: "position", from: "shots.*.rotation, translation".to_owned(), meaning: position },
        Origin {
            quantity: "attitude",
            from: "shots.*.rotation, axis times angle in radians, world to camera".to_owned(),
            meaning: attitude.to_owned(),
        },
    ]
}

#[cfg(test)]
mod tests;
