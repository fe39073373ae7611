//! Geoid undulations: from PROJ's grids, or a stated constant.

use super::crs::{exact_transform, spatial_ref};
use crate::config::height::VerticalDatum;
use crate::geodesy::{Geodetic, GeoidModel};
use gdal::spatial_ref::CoordTransform;
use std::cell::OnceCell;
use std::thread::LocalKey;

/// How orthometric heights become ellipsoidal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Geoid {
    /// By PROJ's grid of the model that the height belongs to.
    Grids,
    /// One undulation everywhere, metres; stated by the user.
    Constant(f64),
}

/// Why a height could not be converted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeoidError {
    /// PROJ has no grid for the model.
    #[error(
        "the grid {grid} of the {model} geoid is not installed, so heights above sea level cannot be used; \
         {source_of_grid}, or state [georeference.geoid] undulation"
    )]
    NoGrid {
        /// The model.
        model: &'static str,
        /// PROJ's file.
        grid: &'static str,
        /// Where to get it.
        source_of_grid: &'static str,
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
    /// What is added to heights above a datum to make them ellipsoidal, at each position, metres.
    ///
    /// # Errors
    /// As [`Geoid::undulations`].
    pub fn above_ellipsoid(
        &self,
        datum: VerticalDatum,
        positions: &[Geodetic],
    ) -> Result<Vec<f64>, GeoidError> {
        match geoid_of(datum) {
            None => Ok(vec![0.0; positions.len()]),
            Some(model) => self.undulations(model, positions),
        }
    }

    /// Undulation N (ellipsoidal height = height above sea level + N) at each position, metres.
    ///
    /// # Errors
    /// [`GeoidError`]; a missing grid is never taken for N = 0.
    pub fn undulations(&self, model: GeoidModel, positions: &[Geodetic]) -> Result<Vec<f64>, GeoidError> {
        match self {
            Self::Constant(n) => Ok(vec![*n; positions.len()]),
            Self::Grids => by_grid(model, positions),
        }
    }
}

/// The geoid that a datum is; `None` for the ellipsoid.
#[must_use]
pub const fn geoid_of(datum: VerticalDatum) -> Option<GeoidModel> {
    match datum {
        VerticalDatum::Ellipsoid => None,
        VerticalDatum::Egm96 => Some(GeoidModel::Egm96),
        VerticalDatum::Egm2008 => Some(GeoidModel::Egm2008),
    }
}

type Operation = OnceCell<Result<CoordTransform, String>>;

thread_local! {
    /// Building a PROJ operation takes longer than a million evaluations of it.
    static EGM96: Operation = const { OnceCell::new() };
    static EGM2008: Operation = const { OnceCell::new() };
}

/// What PROJ knows of a model.
struct Grid {
    /// WGS 84 with heights above it.
    crs: &'static str,
    file: &'static str,
    source: &'static str,
    operation: &'static LocalKey<Operation>,
}

const fn grid_of(model: GeoidModel) -> Grid {
    match model {
        GeoidModel::Egm96 => Grid {
            crs: "EPSG:4326+5773",
            file: "us_nga_egm96_15.tif (egm96_15.gtx)",
            source: "install it (Debian: apt-get install proj-data; anywhere: projsync --file us_nga_egm96_15.tif)",
            operation: &EGM96,
        },
        GeoidModel::Egm2008 => Grid {
            crs: "EPSG:4326+3855",
            file: "us_nga_egm08_25.tif (egm08_25.gtx)",
            source: "install it (projsync --file us_nga_egm08_25.tif puts it into PROJ's user folder, 80 MB)",
            operation: &EGM2008,
        },
    }
}

fn by_grid(model: GeoidModel, positions: &[Geodetic]) -> Result<Vec<f64>, GeoidError> {
    let grid = grid_of(model);
    let mut x: Vec<f64> = positions.iter().map(|p| p.longitude.degrees()).collect();
    let mut y: Vec<f64> = positions.iter().map(|p| p.latitude.degrees()).collect();
    let mut z = vec![0.0; positions.len()];
    let done = grid.operation.with(|cell| match cell.get_or_init(|| ellipsoid_from_sea_level(grid.crs)) {
        Ok(transform) => {
            Ok(positions.is_empty() || transform.transform_coords(&mut x, &mut y, &mut z).is_ok())
        }
        Err(cause) => Err(GeoidError::NoGrid {
            model: model.name(),
            grid: grid.file,
            source_of_grid: grid.source,
            cause: cause.clone(),
        }),
    })?;
    // No place on Earth has an undulation of exactly zero; PROJ returns it when it did nothing.
    match z.iter().position(|n| !done || !n.is_finite() || *n == 0.0) {
        None => Ok(z),
        Some(k) => Err(GeoidError::Outside {
            model: model.name(),
            latitude_deg: positions[k].latitude.degrees(),
            longitude_deg: positions[k].longitude.degrees(),
        }),
    }
}

fn ellipsoid_from_sea_level(above_sea: &str) -> Result<CoordTransform, String> {
    let ellipsoidal = spatial_ref("EPSG:4979").map_err(|e| e.to_string())?;
    let above_sea = spatial_ref(above_sea).map_err(|e| e.to_string())?;
    exact_transform(&above_sea, &ellipsoidal).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// N by the 15-minute grid, bilinear, computed from the nodes of NGA's file; N(48, 11) is PROJ's own test point.
    #[test]
    fn egm96_at_known_places() {
        for (lat, lon, n) in [
            (48.0, 11.0, 45.96),
            (41.0365, -83.3065, -35.8217),
            (46.84266, -91.994, -28.6815),
            (41.4294, -81.6058, -34.6739),
            (41.0, -83.25, -35.7212),
            (47.0, -92.0, -28.9794),
        ] {
            let at = [Geodetic::from_degrees(lat, lon, 0.0)];
            let found = Geoid::Grids.undulations(GeoidModel::Egm96, &at).unwrap()[0];
            assert!((found - n).abs() < 0.01, "N({lat}, {lon}) = {found}, expected {n}");
        }
    }

    #[test]
    fn a_missing_grid_is_named_with_the_way_to_get_it() {
        let at = [Geodetic::from_degrees(48.0, 11.0, 0.0)];
        match Geoid::Grids.undulations(GeoidModel::Egm2008, &at) {
            // Published: N = 45.9 m near Munich by EGM2008 as well; the models differ by decimetres there.
            Ok(n) => assert!((n[0] - 45.9).abs() < 1.0, "{n:?}"),
            Err(error) => {
                let words = error.to_string();
                assert!(words.contains("us_nga_egm08_25.tif") && words.contains("projsync"), "{words}");
            }
        }
        assert_eq!(Geoid::Constant(-3.0).undulations(GeoidModel::Egm2008, &at), Ok(vec![-3.0]));
    }
}
