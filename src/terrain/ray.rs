//! Where a viewing ray meets the ground.

use super::{NoGround, Terrain};
use crate::geodesy::{Geodetic, WGS84};
use crate::geometry::{Displacement, Ecef, Point};

/// A half line in ECEF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Projection centre.
    pub origin: Point<Ecef>,
    /// Unit direction.
    pub direction: Displacement<Ecef>,
}

impl Ray {
    /// From an origin and a direction of any length.
    #[must_use]
    pub fn new(origin: Point<Ecef>, direction: Displacement<Ecef>) -> Self {
        Self { origin, direction: direction * (1.0 / direction.vector().norm()) }
    }
    /// The point `range` metres along the ray.
    #[must_use]
    pub fn at(&self, range: f64) -> Point<Ecef> {
        self.origin + self.direction * range
    }
}

/// Why a ray has no ground point.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum GroundMiss {
    /// The ray does not descend to the ground.
    #[error("the ray looks above the horizon")]
    AboveHorizon,
    /// The ground is farther than the caller accepts.
    #[error("the ground lies beyond {max_range_m:.0} m")]
    BeyondRange {
        /// The limit.
        max_range_m: f64,
    },
    /// The camera itself is below the ground.
    #[error("the camera is {below_m:.1} m below the ground")]
    BelowGround {
        /// How deep.
        below_m: f64,
    },
    /// The elevation model does not cover the place.
    #[error("{cause} near {latitude_deg:.6}°, {longitude_deg:.6}°")]
    NoGround {
        /// Outside or without data.
        cause: NoGround,
        /// Where.
        latitude_deg: f64,
        /// Where.
        longitude_deg: f64,
    },
}

/// First point where the ray meets the ground, at most `max_range` metres away.
///
/// A surface of constant height is solved exactly; over an elevation model the ray is sampled at half the
/// model's spacing from its highest to its lowest level and the first crossing is refined by bisection, so
/// a ridge in front of the target is met first.
///
/// # Errors
/// [`GroundMiss`], never a substitute point.
pub fn ground_from_ray(ray: &Ray, terrain: &dyn Terrain, max_range: f64) -> Result<Geodetic, GroundMiss> {
    let (lowest, highest) = terrain.height_range();
    let Some(spacing) = terrain.spacing() else {
        let range = range_to_height(ray, highest, max_range)?;
        return Ok(WGS84.geodetic_from_ecef(&ray.at(range)).at_height(highest));
    };
    let camera_height = WGS84.geodetic_from_ecef(&ray.origin).height.get();
    let start = if camera_height > highest { range_to_height(ray, highest, max_range)? } else { 0.0 };
    let end = match range_to_height(ray, lowest, max_range) {
        Ok(range) => range,
        // The ray may leave the model's height band beyond the limit and still meet a hill before it.
        Err(GroundMiss::BeyondRange { .. } | GroundMiss::AboveHorizon) => max_range,
        Err(other) => return Err(other),
    };
    let slant_to_level = {
        let up = WGS84.geodetic_from_ecef(&ray.at(start)).up().vector();
        let vertical = ray.direction.vector().dot(&up).abs();
        (1.0 - vertical * vertical).max(0.0).sqrt()
    };
    const MAX_SAMPLES: f64 = 100_000.0;
    let samples = (((end - start) * slant_to_level / (0.5 * spacing)).ceil() + 1.0).clamp(2.0, MAX_SAMPLES);
    let step = (end - start) / (samples - 1.0);
    const BATCH: usize = 64;
    let mut previous: Option<f64> = None;
    let mut gap: Option<(NoGround, Geodetic)> = None;
    let mut index = 0.0;
    while index < samples {
        let ranges: Vec<f64> = (0..BATCH)
            .map(|k| index + k as f64)
            .take_while(|i| *i < samples)
            .map(|i| start + i * step)
            .collect();
        let positions: Vec<Geodetic> = ranges.iter().map(|r| WGS84.geodetic_from_ecef(&ray.at(*r))).collect();
        for ((range, position), height) in ranges.iter().zip(&positions).zip(terrain.heights(&positions)) {
            match height {
                Err(cause) => {
                    gap = Some((cause, *position));
                    previous = None;
                }
                Ok(ground) if position.height.get() > ground => previous = Some(*range),
                Ok(ground) => {
                    if let Some(above) = previous {
                        return refine(ray, terrain, above, *range);
                    }
                    if let Some((cause, at)) = gap {
                        return Err(no_ground(cause, &at));
                    }
                    // Only the very first sample can be at or below ground without a sample above it.
                    let below_m = ground - position.height.get();
                    if *range > 0.0 && below_m < 1e-6 {
                        return Ok(position.at_height(ground));
                    }
                    return Err(GroundMiss::BelowGround { below_m });
                }
            }
        }
        index += BATCH as f64;
    }
    match gap {
        Some((cause, at)) => Err(no_ground(cause, &at)),
        None if end >= max_range => Err(GroundMiss::BeyondRange { max_range_m: max_range }),
        None => Err(GroundMiss::AboveHorizon),
    }
}

fn no_ground(cause: NoGround, at: &Geodetic) -> GroundMiss {
    GroundMiss::NoGround { cause, latitude_deg: at.latitude.degrees(), longitude_deg: at.longitude.degrees() }
}

/// Range at which the ray, coming from above, first has this ellipsoidal height.
fn range_to_height(ray: &Ray, height: f64, max_range: f64) -> Result<f64, GroundMiss> {
    let start = WGS84.geodetic_from_ecef(&ray.origin);
    let mut above = start.height.get() - height;
    if above < 0.0 {
        return Err(GroundMiss::BelowGround { below_m: -above });
    }
    let mut range = 0.0;
    let mut here = start;
    // Height along a ray is convex, so Newton's steps from above never overshoot the first crossing.
    for _ in 0..60 {
        let descent = -ray.direction.vector().dot(&here.up().vector());
        if descent <= 1e-9 {
            return Err(GroundMiss::AboveHorizon);
        }
        range += above / descent;
        if range > max_range {
            return Err(GroundMiss::BeyondRange { max_range_m: max_range });
        }
        if above.abs() < 1e-10 {
            break;
        }
        here = WGS84.geodetic_from_ecef(&ray.at(range));
        above = here.height.get() - height;
        if above.abs() < 1e-9 {
            break;
        }
    }
    Ok(range)
}

fn refine(ray: &Ray, terrain: &dyn Terrain, mut above: f64, mut below: f64) -> Result<Geodetic, GroundMiss> {
    const RESOLUTION_M: f64 = 1e-5;
    while below - above > RESOLUTION_M {
        let mid = 0.5 * (above + below);
        let position = WGS84.geodetic_from_ecef(&ray.at(mid));
        match terrain.heights(&[position])[0] {
            Ok(ground) if position.height.get() > ground => above = mid,
            Ok(_) => below = mid,
            Err(cause) => return Err(no_ground(cause, &position)),
        }
    }
    Ok(WGS84.geodetic_from_ecef(&ray.at(0.5 * (above + below))))
}

#[cfg(test)]
mod tests {
    use super::super::ConstantHeight;
    use super::*;
    use crate::geodesy::LocalTangent;
    use crate::geometry::Ned;
    use crate::units::Radians;

    /// A ridge 40 m high running north-south 100 m east of the site, 20 m wide.
    struct Ridge(LocalTangent);
    impl Terrain for Ridge {
        fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
            positions
                .iter()
                .map(|p| {
                    let ned = self.0.ecef_from_ned().inverse() * WGS84.ecef_from_geodetic(p);
                    match ned.y() {
                        e if e < -500.0 => Err(NoGround::Outside),
                        e if (90.0..110.0).contains(&e) => Ok(140.0),
                        e if (150.0..160.0).contains(&e) => Err(NoGround::NoData),
                        _ => Ok(100.0),
                    }
                })
                .collect()
        }
        fn height_range(&self) -> (f64, f64) {
            (100.0, 140.0)
        }
        fn spacing(&self) -> Option<f64> {
            Some(2.0)
        }
    }

    fn site() -> LocalTangent {
        LocalTangent::at(Geodetic::from_degrees(45.0, 7.0, 100.0))
    }
    fn ray(down_by_east: (f64, f64)) -> Ray {
        let site = site();
        Ray::new(
            *site.ecef_from_ned() * Point::<Ned>::new(0.0, 0.0, -80.0),
            *site.ecef_from_ned() * Displacement::<Ned>::new(0.0, down_by_east.1, down_by_east.0),
        )
    }
    fn east_of(g: &Geodetic) -> f64 {
        (site().ecef_from_ned().inverse() * WGS84.ecef_from_geodetic(g)).y()
    }

    #[test]
    fn constant_height_is_met_exactly() {
        let flat = ConstantHeight { height_m: 100.0 };
        let hit = ground_from_ray(&ray((1.0, 2.0)), &flat, 1e4).unwrap();
        assert!((hit.height.get() - 100.0).abs() < 1e-12);
        // 80 m down, 160 m east, plus the 2 mm by which the Earth curves away.
        assert!((east_of(&hit) - 160.0).abs() < 0.01, "{}", east_of(&hit));
    }

    #[test]
    fn a_ridge_in_front_is_met_first() {
        let hit = ground_from_ray(&ray((1.0, 2.0)), &Ridge(site()), 1e4).unwrap();
        assert!((east_of(&hit) - 90.0).abs() < 0.02, "{}", east_of(&hit));
    }

    #[test]
    fn misses_say_why() {
        let flat = ConstantHeight { height_m: 100.0 };
        assert_eq!(ground_from_ray(&ray((0.0, 1.0)), &flat, 1e4), Err(GroundMiss::AboveHorizon));
        assert_eq!(ground_from_ray(&ray((-0.2, 1.0)), &flat, 1e4), Err(GroundMiss::AboveHorizon));
        assert!(matches!(
            ground_from_ray(&ray((0.05, 1.0)), &flat, 1e3),
            Err(GroundMiss::BeyondRange { .. })
        ));
        let deep = ConstantHeight { height_m: 300.0 };
        assert!(matches!(ground_from_ray(&ray((1.0, 0.0)), &deep, 1e4), Err(GroundMiss::BelowGround { .. })));
        let west = ground_from_ray(&ray((1.0, -10.0)), &Ridge(site()), 1e4);
        assert!(matches!(west, Err(GroundMiss::NoGround { cause: NoGround::Outside, .. })), "{west:?}");
        let hidden = ground_from_ray(&ray((0.78, 1.55)), &Ridge(site()), 1e4);
        assert!(hidden.is_ok(), "the ridge hides the hole: {hidden:?}");
        assert!(Radians::new(0.0).is_finite());
    }
}
