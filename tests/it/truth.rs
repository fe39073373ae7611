//! Synthetic surveys with known truth. The simulator shares no geometry with the library, so agreement means something.

use boresight::camera::{Brown, Camera, ImagePoint};
use boresight::geodesy::{Geodetic, WGS84};
use boresight::geometry::Displacement;
use boresight::geometry::attitude::YawPitchRoll;
use boresight::georeference::GeoreferencedFrame;
use boresight::navigation::{GimbalAngles, GimbalReference, Mount, NavigationRecord};
use boresight::synthetic::{GeodeticPosition, ReliefShape, Scenario, Survey};
use boresight::terrain::{ConstantHeight, NoGround, Terrain};
use boresight::units::Radians;
use std::sync::Arc;

/// The simulator's relief as terrain; sampled as finely as an elevation model of this spacing.
struct Relief(Survey, (f64, f64));

impl Terrain for Relief {
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
        positions
            .iter()
            .map(|p| Ok(self.0.ground_height(p.latitude.degrees(), p.longitude.degrees())))
            .collect()
    }
    fn height_range(&self) -> (f64, f64) {
        self.1
    }
    fn spacing(&self) -> Option<f64> {
        Some(1.0)
    }
}

fn displacement<F: boresight::geometry::Frame>(v: [f64; 3]) -> Displacement<F> {
    Displacement::new(v[0], v[1], v[2])
}

fn mount(s: &Scenario) -> Mount {
    let m = &s.mounting;
    Mount {
        antenna_in_body: displacement(m.antenna_in_body_m),
        gimbal_in_body: displacement(m.gimbal_in_body_m),
        camera_in_gimbal: displacement(m.camera_in_gimbal_m),
        boresight: YawPitchRoll::from_degrees(
            m.boresight_yaw_deg,
            m.boresight_pitch_deg,
            m.boresight_roll_deg,
        ),
        gimbal: GimbalAngles {
            pan: Radians::from_degrees(m.gimbal_pan_deg),
            elevation: Radians::from_degrees(m.gimbal_elevation_deg),
            roll: Radians::from_degrees(m.gimbal_roll_deg),
        },
        gimbal_reference: GimbalReference::Body,
        ..Mount::default()
    }
}

fn camera(s: &Scenario) -> Arc<Camera> {
    let c = &s.camera;
    let brown =
        Brown::new([c.fx_px, c.fy_px, c.skew_px, c.cx_px, c.cy_px, c.k1, c.k2, c.p1, c.p2, c.k3]).unwrap();
    Arc::new(Camera::new(brown, c.width_px, c.height_px, None).unwrap())
}

fn geodetic(p: &GeodeticPosition) -> Geodetic {
    Geodetic::from_degrees(p.latitude_deg, p.longitude_deg, p.height_m)
}

/// Largest distance between a target and where its pixel is georeferenced, metres, and the number of observations.
fn worst_target(scenario: &Scenario) -> (f64, usize) {
    let survey = Survey::new(scenario).unwrap();
    let ground: Arc<dyn Terrain> = match scenario.relief.shape {
        ReliefShape::Flat => Arc::new(ConstantHeight { height_m: scenario.site.ground_height_ellipsoid_m }),
        ReliefShape::Hills => {
            let (h, a) = (scenario.site.ground_height_ellipsoid_m, scenario.relief.amplitude_m);
            Arc::new(Relief(Survey::new(scenario).unwrap(), (h - 4.0 * a, h + 4.0 * a)))
        }
    };
    let (mount, camera) = (mount(scenario), camera(scenario));
    let frames: std::collections::BTreeMap<String, GeoreferencedFrame> = survey
        .frames()
        .iter()
        .map(|f| {
            let record = NavigationRecord {
                line: 1,
                time: None,
                antenna: geodetic(&f.truth.antenna),
                attitude: YawPitchRoll::from_degrees(
                    f.truth.attitude.yaw_deg,
                    f.truth.attitude.pitch_deg,
                    f.truth.attitude.roll_deg,
                ),
                gimbal: None,
                height_above_ground_m: None,
                ground_speed_m_s: None,
                velocity: None,
                pixel_rotation: None,
            };
            let frame =
                GeoreferencedFrame::new(f.name.clone(), record, &mount, camera.clone(), ground.clone(), 1e4)
                    .unwrap();
            (f.name.clone(), frame)
        })
        .collect();
    let targets: std::collections::BTreeMap<&str, Geodetic> =
        survey.targets().iter().map(|t| (t.name.as_str(), geodetic(&t.centre))).collect();
    let mut worst: f64 = 0.0;
    let observations = survey.observations();
    for o in &observations {
        let Some(truth) = targets.get(o.point.as_str()) else { continue };
        let frame = &frames[&o.frame];
        let found = frame.ground_from_pixel(ImagePoint::new(o.column, o.row)).unwrap();
        let truth = WGS84.ecef_from_geodetic(truth);
        worst = worst.max(WGS84.ecef_from_geodetic(&found.position).distance_to(&truth));
        let back = frame.pixel_from_ecef(&truth).unwrap();
        assert!((back.column - o.column).hypot(back.row - o.row) < 1e-3, "{back:?} for {o:?}");
    }
    (worst, observations.len())
}

#[test]
fn targets_on_flat_ground() {
    let (worst, n) = worst_target(&Scenario::demo());
    assert!(n > 30, "only {n} observations");
    assert!(worst < 0.03, "{worst} m");
}

#[test]
fn targets_over_relief() {
    let mut scenario = Scenario::demo();
    scenario.relief.shape = ReliefShape::Hills;
    scenario.relief.amplitude_m = 12.0;
    scenario.relief.wavelength_m = 400.0;
    let (worst, n) = worst_target(&scenario);
    assert!(n > 30, "only {n} observations");
    assert!(worst < 0.05, "{worst} m");
}

#[test]
fn targets_far_north_at_the_edge_of_a_zone_with_every_lever_arm_and_an_oblique_gimbal() {
    let mut scenario = Scenario::demo();
    scenario.site.latitude_deg = 60.0;
    scenario.site.longitude_deg = 17.99;
    scenario.flight.heading_deg = 33.0;
    scenario.mounting.gimbal_pan_deg = 20.0;
    scenario.mounting.gimbal_elevation_deg = -70.0;
    scenario.mounting.gimbal_roll_deg = 4.0;
    scenario.mounting.boresight_yaw_deg = -2.5;
    scenario.mounting.boresight_pitch_deg = -2.3;
    scenario.mounting.boresight_roll_deg = 3.6;
    scenario.mounting.antenna_in_body_m = [0.3, -0.1, -0.4];
    scenario.mounting.gimbal_in_body_m = [0.5, 0.2, 0.3];
    scenario.mounting.camera_in_gimbal_m = [0.06, 0.02, -0.01];
    let (worst, n) = worst_target(&scenario);
    assert!(n > 10, "only {n} observations");
    assert!(worst < 0.03, "{worst} m");
}
