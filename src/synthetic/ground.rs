//! The shape of the synthetic ground and where a ray meets it, all in ECEF.
//!
//! The ground is a height above the ellipsoid, given as a function of the site's east and north (metres in the
//! tangent plane at the site). Flat ground is a surface of constant ellipsoidal height.

use std::f64::consts::TAU;

use nalgebra::{Vector2, Vector3};
use rand::prelude::*;
use rand_chacha::ChaCha8Rng;

use super::earth::{GeodeticPosition, Vertical};
use super::scenario::{ReliefShape, Scenario};

/// A bisected ray has met the ground when it is this close, metres.
const TOUCH_M: f64 = 1e-7;
/// From this close a Newton step ends within nanometres, metres.
const CLOSE_M: f64 = 1e-3;
/// Rays less than this (radians) below the site's horizon count as missing the ground.
const LEAST_SINK: f64 = 1e-3;
/// A mean radius, for starting values only, metres.
const EARTH_RADIUS_M: f64 = 6.37e6;

/// A point of the scene: metres east and north of the site, in its tangent plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ScenePoint {
    pub east: f64,
    pub north: f64,
}

struct Wave {
    /// Wave vector, radians per metre east and north.
    vector: Vector2<f64>,
    phase: f64,
    amplitude_m: f64,
}

pub(super) struct Ground {
    origin_in_ecef: Vector3<f64>,
    east: Vector3<f64>,
    north: Vector3<f64>,
    up: Vector3<f64>,
    mean_height_m: f64,
    waves: Vec<Wave>,
    /// No slope is steeper, metres per metre.
    steepest: f64,
}

impl Ground {
    pub fn new(scenario: &Scenario) -> Self {
        let site = &scenario.site;
        let origin = GeodeticPosition {
            latitude_deg: site.latitude_deg,
            longitude_deg: site.longitude_deg,
            height_m: site.ground_height_ellipsoid_m,
        };
        let axes = origin.ecef_from_ned();
        let mut random = ChaCha8Rng::seed_from_u64(scenario.seed);
        random.set_stream(super::stream::RELIEF);
        let count = if scenario.relief.shape == ReliefShape::Hills { 5 } else { 0 };
        let waves: Vec<_> = (0..count)
            .map(|index| {
                // Directions spread over the half circle; lengths from one to two and a half wavelengths.
                let direction = (f64::from(index) + random.random_range(0.2..0.8)) * TAU / 10.0;
                let length_m = scenario.relief.wavelength_m * (1.0 + 1.5 * f64::from(index) / 4.0);
                Wave {
                    vector: Vector2::new(direction.sin(), direction.cos()) * (TAU / length_m),
                    phase: random.random_range(0.0..TAU),
                    amplitude_m: scenario.relief.amplitude_m / 5.0,
                }
            })
            .collect();
        Self {
            origin_in_ecef: origin.ecef(),
            north: axes.column(0).into(),
            east: axes.column(1).into(),
            up: -Vector3::from(axes.column(2)),
            mean_height_m: site.ground_height_ellipsoid_m,
            steepest: waves.iter().map(|wave: &Wave| wave.amplitude_m * wave.vector.norm()).sum(),
            waves,
        }
    }

    /// Ellipsoidal height of the ground, metres.
    pub fn height_m(&self, at: ScenePoint) -> f64 {
        let point = Vector2::new(at.east, at.north);
        self.mean_height_m
            + self
                .waves
                .iter()
                .map(|wave| wave.amplitude_m * (wave.vector.dot(&point) + wave.phase).sin())
                .sum::<f64>()
    }

    /// Rise of the ground per metre east and north.
    pub fn slope(&self, at: ScenePoint) -> Vector2<f64> {
        let point = Vector2::new(at.east, at.north);
        self.waves
            .iter()
            .map(|wave| wave.vector * (wave.amplitude_m * (wave.vector.dot(&point) + wave.phase).cos()))
            .sum()
    }

    /// East and north of an ECEF point, seen in the site's tangent plane.
    pub fn scene_from_ecef(&self, point: &Vector3<f64>) -> ScenePoint {
        let offset = point - self.origin_in_ecef;
        ScenePoint { east: offset.dot(&self.east), north: offset.dot(&self.north) }
    }

    /// The ECEF point with the given east and north and ellipsoidal height.
    pub fn ecef_at_height(&self, at: ScenePoint, height_m: f64) -> Vector3<f64> {
        let mut point = self.origin_in_ecef + self.east * at.east + self.north * at.north;
        for _ in 0..4 {
            let vertical = Vertical::at(&point);
            point += self.up * ((height_m - vertical.height_m) / vertical.up.dot(&self.up));
        }
        point
    }

    /// The point of the ground with the given east and north.
    pub fn ecef(&self, at: ScenePoint) -> Vector3<f64> {
        self.ecef_at_height(at, self.height_m(at))
    }

    pub fn geodetic(&self, at: ScenePoint) -> GeodeticPosition {
        GeodeticPosition::from_ecef(&self.ecef(at))
    }

    /// The point of the ground with the given latitude and longitude.
    pub fn scene_from_geodetic(&self, latitude_deg: f64, longitude_deg: f64) -> ScenePoint {
        let mut height_m = self.mean_height_m;
        let mut at = ScenePoint { east: 0.0, north: 0.0 };
        // East and north depend on the height only through the small angle between the verticals.
        for _ in 0..4 {
            at = self.scene_from_ecef(&GeodeticPosition { latitude_deg, longitude_deg, height_m }.ecef());
            height_m = self.height_m(at);
        }
        at
    }

    /// Unit vector of a scene direction in ECEF.
    pub fn direction_in_ecef(&self, east: f64, north: f64) -> Vector3<f64> {
        (self.east * east + self.north * north).normalize()
    }

    /// Distance along a ray (unit `direction`) to the first ground point, or `None` if it misses.
    pub fn distance_along(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let sink = -direction.dot(&self.up);
        if sink <= LEAST_SINK {
            return None;
        }
        let (east, north) = (direction.dot(&self.east), direction.dot(&self.north));
        let level = (east * east + north * north).sqrt();
        let start = (origin - self.origin_in_ecef).dot(&self.up);
        if sink <= 1.5 * self.steepest * level {
            return self.first_crossing(origin, direction, start, sink);
        }
        // Steeper than any slope: one root. The tangent plane, lowered by the Earth's curvature, is a close start.
        let mut distance = start / sink;
        let at = self.scene_from_ecef(&(origin + direction * distance));
        distance += (at.east * at.east + at.north * at.north) / (2.0 * EARTH_RADIUS_M) / sink;
        for _ in 0..40 {
            let point = origin + direction * distance;
            let vertical = Vertical::at(&point);
            let at = self.scene_from_ecef(&point);
            let above = vertical.height_m - self.height_m(at);
            let approach = self.slope(at).dot(&Vector2::new(east, north)) - direction.dot(&vertical.up);
            distance += above / approach;
            if above.abs() < CLOSE_M {
                return Some(distance);
            }
        }
        None
    }

    /// A shallow ray may cross several slopes: walks from above every summit to the first crossing.
    fn first_crossing(
        &self,
        origin: &Vector3<f64>,
        direction: &Vector3<f64>,
        start: f64,
        sink: f64,
    ) -> Option<f64> {
        let is_above = |distance: f64| {
            let point = origin + direction * distance;
            Vertical::at(&point).height_m > self.height_m(self.scene_from_ecef(&point))
        };
        let amplitude: f64 = self.waves.iter().map(|wave| wave.amplitude_m).sum();
        let shortest = self.waves.iter().map(|wave| TAU / wave.vector.norm()).fold(f64::INFINITY, f64::min);
        let step = shortest / 64.0;
        let mut distance = ((start - amplitude) / sink).max(0.0);
        // The Earth's curvature lowers the ground by less than the last term.
        let end = distance + (4.0 * amplitude + distance * distance / EARTH_RADIUS_M) / sink + 4.0 * shortest;
        while is_above(distance) {
            distance += step;
            if distance > end {
                return None;
            }
        }
        let mut before = (distance - step).max(0.0);
        while distance - before > TOUCH_M {
            let middle = 0.5 * (distance + before);
            if is_above(middle) { before = middle } else { distance = middle }
        }
        Some(distance)
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenario::Relief;
    use super::*;

    fn ground(shape: ReliefShape) -> Ground {
        let relief = Relief { shape, amplitude_m: 20.0, wavelength_m: 300.0 };
        Ground::new(&Scenario { relief, ..Scenario::demo() })
    }

    #[test]
    fn a_vertical_ray_over_flat_ground_is_as_long_as_the_height() {
        let ground = ground(ReliefShape::Flat);
        let at = ScenePoint { east: 700.0, north: -400.0 };
        let above = ground.ecef_at_height(at, 740.0);
        let down = -Vertical::at(&above).up;
        let distance = ground.distance_along(&above, &down).unwrap();
        assert!((distance - 100.0).abs() < 1e-6, "{distance}");
    }

    /// The chord between two points of the flat ground is their distance in the tangent plane, lengthened only by
    /// the Earth's curvature: at 1 km from the site the ground has dropped 8 cm.
    #[test]
    fn scene_distances_are_true_distances() {
        let ground = ground(ReliefShape::Flat);
        let one = ground.ecef(ScenePoint { east: 900.0, north: 300.0 });
        let two = ground.ecef(ScenePoint { east: 1000.0, north: 500.0 });
        let plane = 100.0_f64.hypot(200.0);
        assert!(((one - two).norm() - plane).abs() < 1e-5);
        let drop = (one - ground.origin_in_ecef).dot(&ground.up);
        assert!((drop + (900.0_f64.powi(2) + 300.0_f64.powi(2)) / 2.0 / 6.36e6).abs() < 1e-3, "{drop}");
    }

    #[test]
    fn a_ray_ends_on_the_hills_at_any_steepness() {
        let ground = ground(ReliefShape::Hills);
        let start = ground.ecef_at_height(ScenePoint { east: -300.0, north: 200.0 }, 700.0);
        let (mut shallow, mut steep) = (0, 0);
        for direction in 0..24 {
            for depression in [3.0_f64, 8.0, 25.0, 60.0, 89.0] {
                let azimuth = f64::from(direction) * TAU / 24.0;
                let (sin, cos) = depression.to_radians().sin_cos();
                let ray = ground.direction_in_ecef(azimuth.sin(), azimuth.cos()) * cos - ground.up * sin;
                let distance = ground.distance_along(&start, &ray).unwrap();
                let hit = start + ray * distance;
                let at = ground.scene_from_ecef(&hit);
                assert!((Vertical::at(&hit).height_m - ground.height_m(at)).abs() < 1e-6);
                // Nothing of the ground stands in front of the hit.
                for part in 1..200 {
                    let point = start + ray * (distance * f64::from(part) / 200.5);
                    assert!(Vertical::at(&point).height_m > ground.height_m(ground.scene_from_ecef(&point)));
                }
                if depression < 20.0 { shallow += 1 } else { steep += 1 }
            }
        }
        assert_eq!((shallow, steep), (48, 72));
    }

    #[test]
    fn a_rising_ray_misses() {
        let ground = ground(ReliefShape::Hills);
        let start = ground.ecef_at_height(ScenePoint { east: 0.0, north: 0.0 }, 700.0);
        assert_eq!(ground.distance_along(&start, &ground.east), None);
    }

    #[test]
    fn latitude_and_longitude_lead_back_to_the_scene_point() {
        let ground = ground(ReliefShape::Hills);
        let at = ScenePoint { east: -812.3, north: 655.1 };
        let there = ground.geodetic(at);
        let back = ground.scene_from_geodetic(there.latitude_deg, there.longitude_deg);
        assert!((back.east - at.east).hypot(back.north - at.north) < 1e-6);
    }
}
