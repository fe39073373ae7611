//! Geoid undulations: from PROJ's grids, or a stated constant.

use super::crs::{exact_transform, spatial_ref};
use crate::geodesy::Geodetic;
use gdal::spatial_ref::CoordTransform;

/// How orthometric heights become ellipsoidal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Geoid {
    /// EGM96, from PROJ's 15-minute grid.
    Egm96,
    /// One undulation everywhere, metres; stated by the user.
    Constant(f64),
}

/// Why a height could not be converted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeoidError {
    /// PROJ has no grid for the model.
    #[error(
        "the geoid grid of {model} is not installed, so heights above sea level cannot be used ({cause}); \
         install it (Debian: apt-get install proj-data) or state [georeference.geoid] undulation"
    )]
    NoGrid {
        /// The model.
        model: &'static str,
        /// PROJ's words.
        cause: String,
    },
    /// PROJ has the grid, but not there.
    #[error("{model} has no undulation at {latitude_deg:.6}°, {longitude_deg:.6}°")]
    Outside {
        /// The model.
        model: &'static str,
        /// Degrees.
        latitude_deg: f64,
        /// Degrees.
        longitude_deg: f64,
    },
}

impl Geoid {
    /// Undulation N (ellipsoidal height = height above sea level + N) at each position, metres.
    ///
    /// # Errors
    /// [`GeoidError`]; a missing grid is never taken for N = 0.
    pub fn undulations(&self, positions: &[Geodetic]) -> Result<Vec<f64>, GeoidError> {
        match self {
            Self::Constant(n) => Ok(vec![*n; positions.len()]),
            Self::Egm96 => egm96(positions),
        }
    }
}

thread_local! {
    /// Building a PROJ operation takes longer than a million evaluations of it.
    static EGM96: std::cell::OnceCell<Result<CoordTransform, String>> = const { std::cell::OnceCell::new() };
}

fn egm96(positions: &[Geodetic]) -> Result<Vec<f64>, GeoidError> {
    const MODEL: &str = "EGM96";
    let mut x: Vec<f64> = positions.iter().map(|p| p.longitude.degrees()).collect();
    let mut y: Vec<f64> = positions.iter().map(|p| p.latitude.degrees()).collect();
    let mut z = vec![0.0; positions.len()];
    let done = EGM96.with(|cell| match cell.get_or_init(ellipsoid_from_sea_level) {
        Ok(transform) => {
            Ok(positions.is_empty() || transform.transform_coords(&mut x, &mut y, &mut z).is_ok())
        }
        Err(cause) => Err(GeoidError::NoGrid { model: MODEL, cause: cause.clone() }),
    })?;
    // No place on Earth has an undulation of exactly zero; PROJ returns it when it did nothing.
    match z.iter().position(|n| !done || !n.is_finite() || *n == 0.0) {
        None => Ok(z),
        Some(k) => Err(GeoidError::Outside {
            model: MODEL,
            latitude_deg: positions[k].latitude.degrees(),
            longitude_deg: positions[k].longitude.degrees(),
        }),
    }
}

fn ellipsoid_from_sea_level() -> Result<CoordTransform, String> {
    let ellipsoidal = spatial_ref("EPSG:4979").map_err(|e| e.to_string())?;
    let above_sea = spatial_ref("EPSG:4326+5773").map_err(|e| e.to_string())?;
    exact_transform(&above_sea, &ellipsoidal).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn egm96_at_known_places() {
        // Published with the survey data; PROJ's own test point is N(48, 11) = 45.96 m.
        for (lat, lon, n) in [(48.0, 11.0, 45.96), (41.0365, -83.3065, -35.82)] {
            let found = Geoid::Egm96.undulations(&[Geodetic::from_degrees(lat, lon, 0.0)]).unwrap()[0];
            assert!((found - n).abs() < 0.02, "N({lat}, {lon}) = {found}, expected {n}");
        }
    }
}
