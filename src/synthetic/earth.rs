//! The Earth as the synthetic survey sees it: the WGS 84 ellipsoid, ECEF, and local axes.
//!
//! Written anew with plain vectors, sharing nothing with the crate's geodesy, so that an error there
//! cannot cancel itself in a test.

use nalgebra::{Matrix3, Vector3};

const SEMI_MAJOR_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const SEMI_MINOR_M: f64 = SEMI_MAJOR_M * (1.0 - FLATTENING);
const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);

/// A point given by WGS 84 latitude and longitude (degrees) and ellipsoidal height (metres).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeodeticPosition {
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    pub height_m: f64,
}

impl GeodeticPosition {
    /// Earth-centred, Earth-fixed coordinates, metres.
    pub fn ecef(&self) -> Vector3<f64> {
        let (sin_lat, cos_lat) = self.latitude_deg.to_radians().sin_cos();
        let (sin_lon, cos_lon) = self.longitude_deg.to_radians().sin_cos();
        let normal = SEMI_MAJOR_M / (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
        Vector3::new(
            (normal + self.height_m) * cos_lat * cos_lon,
            (normal + self.height_m) * cos_lat * sin_lon,
            (normal * (1.0 - ECCENTRICITY_SQUARED) + self.height_m) * sin_lat,
        )
    }

    /// The geodetic position of an ECEF point (metres) near the Earth's surface.
    pub fn from_ecef(point: &Vector3<f64>) -> Self {
        let vertical = Vertical::at(point);
        Self {
            latitude_deg: vertical.sin_lat.atan2(vertical.cos_lat).to_degrees(),
            longitude_deg: point.y.atan2(point.x).to_degrees(),
            height_m: vertical.height_m,
        }
    }

    /// `ecef_from_ned`: columns are the local north, east and down axes.
    pub fn ecef_from_ned(&self) -> Matrix3<f64> {
        let (sin_lat, cos_lat) = self.latitude_deg.to_radians().sin_cos();
        let (sin_lon, cos_lon) = self.longitude_deg.to_radians().sin_cos();
        Matrix3::new(
            -sin_lat * cos_lon,
            -sin_lon,
            -cos_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lon,
            -cos_lat * sin_lon,
            cos_lat,
            0.0,
            -sin_lat,
        )
    }
}

/// Ellipsoidal height and normal at an ECEF point, without the cost of angles.
pub(super) struct Vertical {
    pub height_m: f64,
    pub up: Vector3<f64>,
    sin_lat: f64,
    cos_lat: f64,
}

impl Vertical {
    /// Bowring's iteration on the parametric latitude; two rounds leave less than a nanometre from
    /// the sea floor to 10 km.
    pub fn at(point: &Vector3<f64>) -> Self {
        let distance = (point.x * point.x + point.y * point.y).sqrt();
        let second_eccentricity_squared = ECCENTRICITY_SQUARED / (1.0 - ECCENTRICITY_SQUARED);
        let (mut sin_beta, mut cos_beta) = unit(point.z * SEMI_MAJOR_M, distance * SEMI_MINOR_M);
        let (mut sin_lat, mut cos_lat) = (0.0, 1.0);
        for _ in 0..2 {
            (sin_lat, cos_lat) = unit(
                point.z + second_eccentricity_squared * SEMI_MINOR_M * sin_beta.powi(3),
                distance - ECCENTRICITY_SQUARED * SEMI_MAJOR_M * cos_beta.powi(3),
            );
            (sin_beta, cos_beta) = unit((1.0 - FLATTENING) * sin_lat, cos_lat);
        }
        let height_m = distance * cos_lat + point.z * sin_lat
            - SEMI_MAJOR_M * (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
        let up = Vector3::new(cos_lat * point.x / distance, cos_lat * point.y / distance, sin_lat);
        Self { height_m, up, sin_lat, cos_lat }
    }
}

fn unit(sin: f64, cos: f64) -> (f64, f64) {
    let length = (sin * sin + cos * cos).sqrt();
    (sin / length, cos / length)
}

/// Active rotation about x (columns are the turned axes), radians.
pub(super) fn rotation_x(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c)
}

/// Active rotation about y, radians.
pub(super) fn rotation_y(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c)
}

/// Active rotation about z, radians.
pub(super) fn rotation_z(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

/// `Rz(yaw)·Ry(pitch)·Rx(roll)`, all in degrees.
pub(super) fn rotation_zyx_deg(yaw: f64, pitch: f64, roll: f64) -> Matrix3<f64> {
    rotation_z(yaw.to_radians()) * rotation_y(pitch.to_radians()) * rotation_x(roll.to_radians())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ecef_matches_the_definition_at_the_axes() {
        let equator = GeodeticPosition { latitude_deg: 0.0, longitude_deg: 90.0, height_m: 10.0 }.ecef();
        assert!((equator - Vector3::new(0.0, 6_378_147.0, 0.0)).norm() < 1e-6);
        let pole = GeodeticPosition { latitude_deg: 90.0, longitude_deg: 0.0, height_m: 0.0 }.ecef();
        assert!((pole.z - 6_356_752.314_245).abs() < 1e-5 && pole.x.abs() < 1e-5);
    }

    #[test]
    fn geodetic_and_ecef_are_inverse() {
        for latitude_deg in [-89.0, -60.0, -23.2, 0.0, 45.0, 60.0, 88.0] {
            for longitude_deg in [-179.0, -45.9, 0.0, 17.9] {
                for height_m in [-400.0, 0.0, 640.0, 9000.0] {
                    let point = GeodeticPosition { latitude_deg, longitude_deg, height_m }.ecef();
                    let back = GeodeticPosition::from_ecef(&point);
                    assert!((back.height_m - height_m).abs() < 1e-7, "{back:?} from height {height_m}");
                    assert!((back.ecef() - point).norm() < 1e-7);
                }
            }
        }
    }

    #[test]
    fn local_axes_are_orthonormal_and_point_down() {
        let here = GeodeticPosition { latitude_deg: 60.0, longitude_deg: 17.9, height_m: 100.0 };
        let ecef_from_ned = here.ecef_from_ned();
        assert!((ecef_from_ned.transpose() * ecef_from_ned - Matrix3::identity()).norm() < 1e-14);
        assert!((ecef_from_ned.determinant() - 1.0).abs() < 1e-14);
        let lower = GeodeticPosition::from_ecef(&(here.ecef() + ecef_from_ned.column(2) * 10.0));
        assert!((lower.height_m - 90.0).abs() < 1e-7);
        let further_east = GeodeticPosition::from_ecef(&(here.ecef() + ecef_from_ned.column(1) * 10.0));
        assert!(
            further_east.longitude_deg > here.longitude_deg
                && (further_east.latitude_deg - 60.0).abs() < 1e-8
        );
    }
}
