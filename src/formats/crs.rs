//! Map projections by PROJ, through GDAL.

use crate::geodesy::{Geodetic, MapPoint, MapProjection, ProjectionError};
use gdal::spatial_ref::{AxisMappingStrategy, CoordTransform, CoordTransformOptions, SpatialRef};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

/// What can be wrong with a CRS.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CrsError {
    /// GDAL cannot read the definition.
    #[error("\"{definition}\" is no coordinate reference system that PROJ knows")]
    Unknown {
        /// As written.
        definition: String,
    },
    /// Neither a map projection nor latitude/longitude.
    #[error("\"{definition}\" ({name}) is {kind}; a projected or geographic CRS is needed")]
    WrongKind {
        /// As written.
        definition: String,
        /// Its name.
        name: String,
        /// What it is instead.
        kind: &'static str,
    },
    /// No exact operation from WGS 84.
    #[error("no exact operation between WGS 84 and \"{definition}\" is available ({cause})")]
    NoOperation {
        /// As written.
        definition: String,
        /// PROJ's words.
        cause: String,
    },
}

/// A projected or geographic CRS. Cheap to share between threads: each thread builds its own PROJ objects
/// on first use.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection {
    definition: String,
    wkt: String,
    name: String,
    metres_per_unit: f64,
    geographic: bool,
}

thread_local! {
    static TRANSFORMS: RefCell<BTreeMap<String, (CoordTransform, CoordTransform)>> =
        const { RefCell::new(BTreeMap::new()) };
}

/// Length of one degree of the equator: the nominal size of a geographic CRS's unit.
const METRES_PER_DEGREE: f64 = std::f64::consts::PI / 180.0 * 6_378_137.0;

fn traditional(mut srs: SpatialRef) -> SpatialRef {
    // EPSG:4326 is latitude first by its own definition; everywhere here the easting or longitude leads.
    srs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    srs
}

/// Whether PROJ may fetch grids from the network; off unless the pipeline file asks for it.
static NETWORK: AtomicBool = AtomicBool::new(false);

/// Lets PROJ fetch missing grids from the network, from now on.
pub fn allow_network() {
    NETWORK.store(true, Ordering::Relaxed);
}

/// PROJ's default depends on its configuration; here it is what this program says.
fn settle_network() {
    // SAFETY: a plain setter of the C library, safe from any thread.
    unsafe { gdal_sys::OSRSetPROJEnableNetwork(i32::from(NETWORK.load(Ordering::Relaxed))) };
}

/// A spatial reference by any definition GDAL reads, with easting or longitude first.
pub(crate) fn spatial_ref(definition: &str) -> Result<SpatialRef, CrsError> {
    settle_network();
    SpatialRef::from_definition(definition)
        .map(traditional)
        .map_err(|_| CrsError::Unknown { definition: definition.to_owned() })
}

/// A transformation that is exact or does not exist: a missing grid is an error, never a shift left out.
pub(crate) fn exact_transform(from: &SpatialRef, to: &SpatialRef) -> gdal::errors::Result<CoordTransform> {
    let mut options = CoordTransformOptions::new()?;
    options.set_ballpark_allowed(false)?;
    CoordTransform::new_with_options(from, to, &options)
}

impl Projection {
    /// From `EPSG:n`, WKT or a PROJ string.
    ///
    /// # Errors
    /// [`CrsError`]: unknown, not a map, or without an exact way from WGS 84.
    pub fn new(definition: &str) -> Result<Self, CrsError> {
        let srs = spatial_ref(definition)?;
        let name = srs.name().unwrap_or_else(|| definition.to_owned());
        let kind = if srs.is_geocentric() {
            Some("geocentric")
        } else if srs.is_projected() || srs.is_geographic() {
            None
        } else if srs.is_vertical() {
            Some("a vertical CRS")
        } else {
            Some("a local CRS without a place on the Earth")
        };
        if let Some(kind) = kind {
            return Err(CrsError::WrongKind { definition: definition.to_owned(), name, kind });
        }
        let wkt = srs.to_wkt().map_err(|_| CrsError::Unknown { definition: definition.to_owned() })?;
        let geographic = srs.is_geographic();
        let metres_per_unit = if geographic { METRES_PER_DEGREE } else { srs.linear_units() };
        let projection = Self { definition: definition.to_owned(), wkt, name, metres_per_unit, geographic };
        projection.with_transforms(|_, _| ())?;
        Ok(projection)
    }

    /// The UTM zone that holds a longitude, on WGS 84. The widened zones of Norway and Svalbard are not
    /// used: the zone is always the one of 6° that the longitude falls into.
    ///
    /// # Errors
    /// As [`Projection::new`].
    pub fn utm_at(position: &Geodetic) -> Result<Self, CrsError> {
        let zone = ((position.longitude.degrees() + 180.0) / 6.0).floor().rem_euclid(60.0) as u32 + 1;
        let base = if position.latitude.get() >= 0.0 { 32_600 } else { 32_700 };
        Self::new(&format!("EPSG:{}", base + zone))
    }

    /// As the user wrote it.
    #[must_use]
    pub fn definition(&self) -> &str {
        &self.definition
    }
    /// The CRS's own name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }
    /// WKT, for rasters.
    #[must_use]
    pub fn wkt(&self) -> &str {
        &self.wkt
    }
    /// Metres in one map unit: 1 for most grids, 0.3048… for feet; for a geographic CRS the length of a
    /// degree of the equator.
    #[must_use]
    pub const fn metres_per_unit(&self) -> f64 {
        self.metres_per_unit
    }
    /// True for latitude/longitude in degrees.
    #[must_use]
    pub const fn is_geographic(&self) -> bool {
        self.geographic
    }

    fn with_transforms<T>(
        &self,
        use_them: impl FnOnce(&CoordTransform, &CoordTransform) -> T,
    ) -> Result<T, CrsError> {
        TRANSFORMS.with_borrow_mut(|cache| {
            if !cache.contains_key(&self.wkt) {
                let no_operation = |e: gdal::errors::GdalError| CrsError::NoOperation {
                    definition: self.definition.clone(),
                    cause: e.to_string(),
                };
                let wgs84 = spatial_ref("EPSG:4326")?;
                let map = spatial_ref(&self.wkt)?;
                let forward = exact_transform(&wgs84, &map).map_err(no_operation)?;
                let inverse = exact_transform(&map, &wgs84).map_err(no_operation)?;
                cache.insert(self.wkt.clone(), (forward, inverse));
            }
            let (forward, inverse) = &cache[&self.wkt];
            Ok(use_them(forward, inverse))
        })
    }

    /// Transforms in one batch; on failure finds the first position to blame.
    fn transform(&self, forward: bool, x: &mut [f64], y: &mut [f64]) -> Result<(), usize> {
        let run = |x: &mut [f64], y: &mut [f64]| {
            self.with_transforms(|f, i| {
                let done = if forward { f } else { i }.transform_coords(x, y, &mut []).is_ok();
                done && x.iter().chain(y.iter()).all(|v| v.is_finite())
            })
            .unwrap_or(false)
        };
        let (x0, y0) = (x.to_vec(), y.to_vec());
        if x.is_empty() || run(x, y) {
            return Ok(());
        }
        Err((0..x0.len()).find(|&k| !run(&mut [x0[k]], &mut [y0[k]])).unwrap_or(0))
    }
}

impl MapProjection for Projection {
    fn map_from_geodetic(&self, positions: &[Geodetic]) -> Result<Vec<MapPoint>, ProjectionError> {
        let mut x: Vec<f64> = positions.iter().map(|p| p.longitude.degrees()).collect();
        let mut y: Vec<f64> = positions.iter().map(|p| p.latitude.degrees()).collect();
        self.transform(true, &mut x, &mut y).map_err(|k| ProjectionError::NoForward {
            latitude_deg: positions[k].latitude.degrees(),
            longitude_deg: positions[k].longitude.degrees(),
            crs: self.name.clone(),
        })?;
        Ok(x.into_iter().zip(y).map(|(easting, northing)| MapPoint { easting, northing }).collect())
    }

    fn geodetic_from_map(&self, positions: &[MapPoint]) -> Result<Vec<Geodetic>, ProjectionError> {
        let mut x: Vec<f64> = positions.iter().map(|p| p.easting).collect();
        let mut y: Vec<f64> = positions.iter().map(|p| p.northing).collect();
        self.transform(false, &mut x, &mut y).map_err(|k| ProjectionError::NoInverse {
            easting: positions[k].easting,
            northing: positions[k].northing,
            crs: self.name.clone(),
        })?;
        Ok(x.into_iter().zip(y).map(|(lon, lat)| Geodetic::from_degrees(lat, lon, 0.0)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::grid_convergence;
    use crate::geometry::attitude::{OmegaPhiKappa, YawPitchRoll};
    use crate::geometry::{Body, Camera, Ned};
    use crate::navigation::{GimbalAngles, Mount};

    #[test]
    fn utm_both_ways() {
        let p = Projection::new("EPSG:32617").unwrap();
        // First check point of the Seneca survey, published in both systems.
        let g = Geodetic::from_degrees(41.037_669_560, -83.305_959_435, 0.0);
        let m = p.map_from_geodetic(&[g]).unwrap()[0];
        assert!((m.easting - 306_168.420).abs() < 2e-3 && (m.northing - 4_545_500.411).abs() < 2e-3, "{m:?}");
        let back = p.geodetic_from_map(&[m]).unwrap()[0];
        assert!((back.latitude.degrees() - 41.037_669_560).abs() < 1e-10);
        assert!((p.metres_per_unit() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn utm_zone_by_longitude_and_hemisphere() {
        let zone = |lat, lon| Projection::utm_at(&Geodetic::from_degrees(lat, lon, 0.0)).unwrap();
        assert_eq!(zone(41.0, -83.3).definition(), "EPSG:32617");
        assert_eq!(zone(-23.2, -45.9).definition(), "EPSG:32723");
        assert_eq!(zone(10.0, 180.0).definition(), "EPSG:32601");
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(matches!(Projection::new("EPSG:99999"), Err(CrsError::Unknown { .. })));
        assert!(matches!(Projection::new("hello"), Err(CrsError::Unknown { .. })));
        assert!(matches!(Projection::new("EPSG:4978"), Err(CrsError::WrongKind { .. })));
        assert!(matches!(Projection::new("EPSG:5773"), Err(CrsError::WrongKind { .. })));
    }

    #[test]
    fn golden_omega_phi_kappa() {
        // Yaw, pitch counted from nadir, roll; expected ω, φ, κ in degrees at two places of UTM 33N.
        let cases = [
            ((0.0, 0.0, 0.0), [[0.0, 0.0, 0.0], [0.0, 0.0, 2.512]]),
            ((90.0, 0.0, 0.0), [[0.0, 0.0, -90.0], [0.0, 0.0, -87.488]]),
            ((30.0, 5.0, -3.0), [[2.832, -5.097, -30.005], [3.053, -4.968, -27.487]]),
            ((-120.0, 10.0, 0.0), [[-5.038, 8.649, 120.381], [-5.414, 8.420, 122.911]]),
            ((30.0, 40.0, 0.0), [[36.005, -18.747, -23.859], [36.663, -17.259, -21.731]]),
        ];
        let utm = Projection::new("EPSG:32633").unwrap();
        for (place, (lat, lon)) in [(36.0, 15.0), (60.0, 17.9)].into_iter().enumerate() {
            let convergence = grid_convergence(&utm, &Geodetic::from_degrees(lat, lon, 0.0)).unwrap();
            for ((yaw, pitch, roll), expected) in cases {
                let ned_from_camera = YawPitchRoll::from_degrees(yaw, pitch, roll).rotation::<Ned, Body>()
                    * GimbalAngles::NADIR.rotation::<Body>()
                    * Mount::gimbal_from_camera_axes();
                let opk = OmegaPhiKappa::of_ned_from_camera::<Ned, Camera>(&ned_from_camera, convergence);
                for (angle, expected) in [opk.omega, opk.phi, opk.kappa].into_iter().zip(expected[place]) {
                    assert!(
                        (angle.degrees() - expected).abs() < 1.1e-3,
                        "{lat}N yaw {yaw} pitch {pitch} roll {roll}: {} expected {expected}",
                        angle.degrees()
                    );
                }
            }
        }
    }
}
