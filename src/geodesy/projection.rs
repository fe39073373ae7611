//! Map projections as a contract; the implementation (PROJ through GDAL) lives in `formats`.

use super::Geodetic;
use crate::units::{Metres, Radians};

/// A position on a map grid, in metres unless the grid's CRS is geographic (then degrees).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPoint {
    /// First axis in "traditional GIS" order: easting, or longitude in degrees.
    pub easting: f64,
    /// Second axis: northing, or latitude in degrees.
    pub northing: f64,
}

/// What can go wrong between the ellipsoid and the map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProjectionError {
    /// The projection has no image for this position.
    #[error("latitude {latitude_deg:.6}°, longitude {longitude_deg:.6}° has no image in {crs}")]
    NoForward {
        /// Degrees.
        latitude_deg: f64,
        /// Degrees.
        longitude_deg: f64,
        /// The CRS as the user wrote it.
        crs: String,
    },
    /// The map position has no geodetic position.
    #[error("easting {easting:.3}, northing {northing:.3} lies outside {crs}")]
    NoInverse {
        /// First axis.
        easting: f64,
        /// Second axis.
        northing: f64,
        /// The CRS as the user wrote it.
        crs: String,
    },
}

/// Both ways between WGS 84 latitude/longitude and a map grid. Heights pass through untouched: they stay
/// ellipsoidal. Batches, because the implementations cost per call rather than per point.
pub trait MapProjection: Send + Sync {
    /// Map positions of geodetic positions, in the same order.
    ///
    /// # Errors
    /// [`ProjectionError::NoForward`] for the first position that has no image.
    fn map_from_geodetic(&self, positions: &[Geodetic]) -> Result<Vec<MapPoint>, ProjectionError>;

    /// Geodetic positions, at ellipsoidal height 0, of map positions, in the same order.
    ///
    /// # Errors
    /// [`ProjectionError::NoInverse`] for the first position outside the projection.
    fn geodetic_from_map(&self, positions: &[MapPoint]) -> Result<Vec<Geodetic>, ProjectionError>;
}

/// Angle from true north to grid north at a position, positive when grid north lies east of true north.
///
/// From the map image of a 1 m step north; accurate to 1e-6 rad for any conformal grid.
///
/// # Errors
/// As [`MapProjection::map_from_geodetic`].
pub fn grid_convergence(projection: &dyn MapProjection, at: &Geodetic) -> Result<Radians, ProjectionError> {
    let half_step = 0.5e-6;
    let south =
        Geodetic { latitude: Radians::new(at.latitude.get() - half_step), height: Metres::new(0.0), ..*at };
    let north = Geodetic { latitude: Radians::new(at.latitude.get() + half_step), ..south };
    let map = projection.map_from_geodetic(&[south, north])?;
    let (de, dn) = (map[1].easting - map[0].easting, map[1].northing - map[0].northing);
    Ok(Radians::new((-de).atan2(dn)))
}
