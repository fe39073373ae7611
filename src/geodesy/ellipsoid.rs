//! The WGS 84 ellipsoid: geodetic ↔ Earth-centred coordinates and the local north-east-down frame.

use crate::geometry::{Displacement, Ecef, Ned, Point, Pose, Rotation};
use crate::units::{Metres, Radians};
use nalgebra::Matrix3;

/// An ellipsoid of revolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Semi-major axis, metres.
    pub semi_major_m: f64,
    /// Flattening.
    pub flattening: f64,
}

/// WGS 84 (NIMA TR8350.2).
pub const WGS84: Ellipsoid = Ellipsoid { semi_major_m: 6_378_137.0, flattening: 1.0 / 298.257_223_563 };

/// A position by latitude, longitude and height above the WGS 84 ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Geodetic latitude, positive north.
    pub latitude: Radians,
    /// Longitude, positive east.
    pub longitude: Radians,
    /// Height above the ellipsoid.
    pub height: Metres,
}

impl Geodetic {
    /// From degrees and metres above the ellipsoid.
    #[must_use]
    pub const fn from_degrees(latitude: f64, longitude: f64, height_m: f64) -> Self {
        Self {
            latitude: Radians::from_degrees(latitude),
            longitude: Radians::from_degrees(longitude),
            height: Metres::new(height_m),
        }
    }
    /// The same latitude and longitude at another height.
    #[must_use]
    pub const fn at_height(self, height_m: f64) -> Self {
        Self { height: Metres::new(height_m), ..self }
    }
    /// Unit vector straight up (the ellipsoid's normal), in ECEF.
    #[must_use]
    pub fn up(&self) -> Displacement<Ecef> {
        let (sin_lat, cos_lat) = self.latitude.get().sin_cos();
        let (sin_lon, cos_lon) = self.longitude.get().sin_cos();
        Displacement::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    }
}

impl Ellipsoid {
    /// First eccentricity squared.
    #[must_use]
    pub const fn eccentricity_squared(&self) -> f64 {
        self.flattening * (2.0 - self.flattening)
    }

    /// ECEF position of a geodetic position.
    #[must_use]
    pub fn ecef_from_geodetic(&self, g: &Geodetic) -> Point<Ecef> {
        let e2 = self.eccentricity_squared();
        let (sin_lat, cos_lat) = g.latitude.get().sin_cos();
        let (sin_lon, cos_lon) = g.longitude.get().sin_cos();
        let n = self.semi_major_m / (1.0 - e2 * sin_lat * sin_lat).sqrt();
        let h = g.height.get();
        Point::new((n + h) * cos_lat * cos_lon, (n + h) * cos_lat * sin_lon, (n * (1.0 - e2) + h) * sin_lat)
    }

    /// Geodetic position of an ECEF position; within 1 nm anywhere from the deep crust to orbit.
    ///
    /// # Source
    /// Bowring (1976), "Transformation from spatial to geographical coordinates", iterated on the
    /// reduced latitude until it stops moving; two rounds suffice near the surface.
    #[must_use]
    pub fn geodetic_from_ecef(&self, p: &Point<Ecef>) -> Geodetic {
        let a = self.semi_major_m;
        let e2 = self.eccentricity_squared();
        let b = a * (1.0 - self.flattening);
        let second_e2 = e2 / (1.0 - e2);
        let rho = p.x().hypot(p.y());
        let mut reduced = (p.z() * a).atan2(rho * b);
        let mut latitude = 0.0;
        for _ in 0..5 {
            let (s, c) = reduced.sin_cos();
            latitude = (p.z() + second_e2 * b * s.powi(3)).atan2(rho - e2 * a * c.powi(3));
            let next = ((1.0 - self.flattening) * latitude.sin()).atan2(latitude.cos());
            let moved = (next - reduced).abs();
            reduced = next;
            if moved < 1e-16 {
                break;
            }
        }
        let (s, c) = latitude.sin_cos();
        let n = a / (1.0 - e2 * s * s).sqrt();
        // The distance along the normal; unlike rho/cos it does not blow up at the poles.
        let height = rho * c + p.z() * s - n * (1.0 - e2 * s * s);
        Geodetic {
            latitude: Radians::new(latitude),
            longitude: Radians::new(p.y().atan2(p.x())),
            height: Metres::new(height),
        }
    }
}

/// The north-east-down frame at one position: exact, not a flat-Earth approximation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalTangent {
    origin: Geodetic,
    ecef_from_ned: Pose<Ecef, Ned>,
}

impl LocalTangent {
    /// The frame whose origin is `origin`, axes along true north, east and the ellipsoid's inward normal.
    #[must_use]
    pub fn at(origin: Geodetic) -> Self {
        let (sin_lat, cos_lat) = origin.latitude.get().sin_cos();
        let (sin_lon, cos_lon) = origin.longitude.get().sin_cos();
        let axes = Matrix3::new(
            -sin_lat * cos_lon,
            -sin_lon,
            -cos_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lon,
            -cos_lat * sin_lon,
            cos_lat,
            0.0,
            -sin_lat,
        );
        Self {
            origin,
            ecef_from_ned: Pose::new(
                Rotation::from_matrix_unchecked(axes),
                WGS84.ecef_from_geodetic(&origin),
            ),
        }
    }
    /// Where the frame stands.
    #[must_use]
    pub const fn origin(&self) -> &Geodetic {
        &self.origin
    }
    /// The frame's pose in ECEF.
    #[must_use]
    pub const fn ecef_from_ned(&self) -> &Pose<Ecef, Ned> {
        &self.ecef_from_ned
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn known_positions_on_the_ellipsoid() {
        let equator = WGS84.ecef_from_geodetic(&Geodetic::from_degrees(0.0, 90.0, 10.0));
        assert!(equator.distance_to(&Point::new(0.0, 6_378_147.0, 0.0)) < 1e-8);
        let pole = WGS84.ecef_from_geodetic(&Geodetic::from_degrees(90.0, 0.0, 0.0));
        assert!((pole.z() - 6_356_752.314_245).abs() < 1e-6);
    }

    #[test]
    fn tangent_axes_point_north_east_down() {
        let here = Geodetic::from_degrees(41.0, -83.0, 250.0);
        let tangent = LocalTangent::at(here);
        let step = |n, e, d| WGS84.geodetic_from_ecef(&(*tangent.ecef_from_ned() * Point::new(n, e, d)));
        assert!(step(1.0, 0.0, 0.0).latitude > here.latitude);
        assert!(step(0.0, 1.0, 0.0).longitude > here.longitude);
        assert!((step(0.0, 0.0, 1.0).height.get() - 249.0).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn geodetic_survives_the_round_trip(
            lat in -90.0..90.0f64, lon in -180.0..180.0f64, h in -10_000.0..100_000.0f64,
        ) {
            let p = WGS84.ecef_from_geodetic(&Geodetic::from_degrees(lat, lon, h));
            let q = WGS84.ecef_from_geodetic(&WGS84.geodetic_from_ecef(&p));
            prop_assert!(p.distance_to(&q) < 1e-8, "{} m", p.distance_to(&q));
        }
    }
}
