//! Every column of the Jacobian against central differences through the whole chain.

use super::super::model::{AngleStd, ErrorModel, Source};
use super::super::scenes;
use super::*;
use crate::camera::{Brown, Camera, PixelRotation};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Gimbal, Point, Rotation};
use crate::navigation::{GimbalAngles, Mount, NavigationRecord};
use crate::terrain::{ConstantHeight, NoGround};
use proptest::prelude::*;
use std::sync::Arc;

/// The pixel's own two parameters come last.
const COLUMN: usize = PARAMETERS - 2;
const ROW: usize = PARAMETERS - 1;

/// Everything a parameter can change.
#[derive(Clone)]
struct Setup {
    record: NavigationRecord,
    mount: Mount,
    interior: [f64; 10],
    ground_height_m: f64,
    pixel: ImagePoint,
}

impl Setup {
    fn frame(&self) -> GeoreferencedFrame {
        let camera = Camera::new(Brown::new(self.interior).unwrap(), 1152, 648, None).unwrap();
        let ground = Arc::new(ConstantHeight { height_m: self.ground_height_m });
        scenes::frame(self.record.clone(), &self.mount, camera, ground)
    }

    /// This setup with one parameter changed, the change done in the quantities the user states.
    fn changed(&self, column: usize, by: f64) -> Self {
        let mut s = self.clone();
        let add = |angle: &mut Radians, by: f64| *angle = Radians::new(angle.get() + by);
        let move_antenna = |s: &mut Self, ned: Vector3<f64>| {
            let tangent = LocalTangent::at(self.record.antenna);
            s.record.antenna =
                WGS84.geodetic_from_ecef(&(*tangent.ecef_from_ned() * Point::<Ned>::from_vector(ned)));
        };
        match column {
            0 => move_antenna(&mut s, Vector3::x() * by),
            1 => move_antenna(&mut s, Vector3::y() * by),
            2 => move_antenna(&mut s, Vector3::z() * -by),
            3 => add(&mut s.record.attitude.yaw, by),
            4 => add(&mut s.record.attitude.pitch, by),
            5 => add(&mut s.record.attitude.roll, by),
            6..=8 => {
                let angles = s.record.gimbal.as_mut().unwrap();
                match s.mount.gimbal_reference {
                    GimbalReference::Body => add(
                        [&mut angles.pan, &mut angles.elevation, &mut angles.roll]
                            .into_iter()
                            .nth(column - 6)
                            .unwrap(),
                        by,
                    ),
                    GimbalReference::Nav => {
                        let (sin, cos) = angles.pan.get().sin_cos();
                        let axis = [Vector3::z(), Vector3::new(-sin, cos, 0.0), Vector3::new(cos, sin, 0.0)]
                            [column - 6];
                        let turn: Rotation<Ned, Ned> =
                            Rotation::from_rotation(nalgebra::Rotation3::new(axis * by));
                        let turned = YawPitchRoll::of(&(turn * angles.rotation::<Ned>()));
                        *angles =
                            GimbalAngles { pan: turned.yaw, elevation: turned.pitch, roll: turned.roll };
                    }
                }
            }
            9 => add(&mut s.mount.boresight.yaw, by),
            10 => add(&mut s.mount.boresight.pitch, by),
            11 => add(&mut s.mount.boresight.roll, by),
            // Half through the antenna's arm and half through the gimbal's: only their difference counts.
            12..=14 => {
                let arm = Vector3::ith(column - 12, by);
                s.mount.antenna_in_body = s.mount.antenna_in_body + Displacement::from_vector(arm * -0.5);
                s.mount.gimbal_in_body = s.mount.gimbal_in_body + Displacement::from_vector(arm * 0.5);
            }
            15 => move_antenna(&mut s, self.record.velocity.unwrap().vector() * by),
            16 => {}
            17 => s.ground_height_m += by,
            18..=27 => s.interior[column - 18] += by,
            COLUMN => s.pixel.column += by,
            ROW => s.pixel.row += by,
            // Brown's lens has no such terms.
            28..COLUMN => {}
            _ => unreachable!("there are {PARAMETERS} parameters"),
        }
        s
    }

    /// A step that is small for the parameter and large for the rounding of positions.
    fn step(column: usize) -> f64 {
        match column {
            0..=2 | 12..=14 | 17 => 0.5,
            3..=11 => 1e-4,
            15 | 16 => 0.05,
            18..=22 => 0.05,
            23..=27 => 1e-4,
            _ => 0.05,
        }
    }

    fn ground(&self) -> Geodetic {
        self.frame().ground_from_pixel(self.pixel).unwrap().position
    }
}

/// Third-order remainders of the differences removed by Richardson's extrapolation.
fn numeric_column(setup: &Setup, site: &LocalTangent, column: usize) -> [f64; 2] {
    let difference = |h: f64| {
        let up = scenes::ned_of(site, &setup.changed(column, h).ground());
        let down = scenes::ned_of(site, &setup.changed(column, -h).ground());
        [(up.x() - down.x()) / (2.0 * h), (up.y() - down.y()) / (2.0 * h)]
    };
    let h = Setup::step(column);
    let (wide, narrow) = (difference(2.0 * h), difference(h));
    [0, 1].map(|i| (4.0 * narrow[i] - wide[i]) / 3.0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
    #[test]
    fn jacobian_is_the_derivative_of_the_chain(
        latitude in -65.0..65.0f64, longitude in -180.0..180.0f64, height in 60.0..400.0f64,
        yaw in -180.0..180.0f64, pitch in -12.0..12.0f64, roll in -12.0..12.0f64,
        pan in -180.0..180.0f64, elevation in -88.0..-50.0f64, gimbal_roll in -10.0..10.0f64,
        boresight in [-5.0..5.0f64, -5.0..5.0f64, -5.0..5.0f64],
        arm in [-0.5..0.5f64, -0.5..0.5f64, -0.5..0.5f64],
        column in 60.0..1090.0f64, row in 60.0..580.0f64,
        turned in 0..4i64, nav in any::<bool>(),
    ) {
        let mut record = scenes::record(
            Geodetic::from_degrees(latitude, longitude, 100.0 + height), yaw, pitch, roll,
        );
        record.gimbal = Some(scenes::gimbal(pan, elevation, gimbal_roll));
        record.velocity = Some(Displacement::new(11.0, -7.0, 1.5));
        let rotation = PixelRotation::from_quarter_turns(turned);
        let mount = Mount {
            antenna_in_body: Displacement::new(arm[1], arm[2], arm[0]),
            gimbal_in_body: Displacement::new(arm[0], arm[1], arm[2]),
            camera_in_gimbal: Displacement::<Gimbal>::new(0.05, arm[2] * 0.1, -0.03),
            boresight: YawPitchRoll::from_degrees(boresight[0], boresight[1], boresight[2]),
            gimbal_reference: if nav { GimbalReference::Nav } else { GimbalReference::Body },
            pixel_rotation: rotation,
            ..Mount::default()
        };
        let pixel = rotation.stored_from_sensor(ImagePoint::new(column, row), 1152, 648);
        let setup = Setup {
            record, mount, interior: scenes::PAPER_INTERIOR, ground_height_m: 100.0, pixel,
        };
        let model = ErrorModel { position_std_m: 1.0, ..ErrorModel::default() };
        let frame = setup.frame();
        let jacobian = FramePropagation::new(&frame, &model).unwrap().at(pixel).unwrap().jacobian;
        let site = LocalTangent::at(setup.ground());
        for column in 0..PARAMETERS {
            let analytic = jacobian.column(column);
            let numeric = numeric_column(&setup, &site, column);
            let off = (analytic[0] - numeric[0]).hypot(analytic[1] - numeric[1]);
            // Positions are rounded to about 2 nm; the step turns that into the floor of the second term.
            let floor = 4e-9 / Setup::step(column);
            prop_assert!(
                off <= 1e-6 * analytic.norm() + floor,
                "column {column}: analytic {analytic:?}, numeric {numeric:?}"
            );
        }
    }
}

/// A plane rising to the north-east, as an elevation model.
struct Slope(LocalTangent);
const RISE_NORTH: f64 = 0.2;
const RISE_EAST: f64 = -0.1;

impl Terrain for Slope {
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
        positions
            .iter()
            .map(|p| {
                let at = scenes::ned_of(&self.0, p);
                Ok(100.0 + RISE_NORTH * at.x() + RISE_EAST * at.y())
            })
            .collect()
    }
    fn height_range(&self) -> (f64, f64) {
        (-100.0, 300.0)
    }
    fn spacing(&self) -> Option<f64> {
        Some(2.0)
    }
}

#[test]
fn a_slope_tilts_the_ground_under_the_ray() {
    let site = LocalTangent::at(Geodetic::from_degrees(47.0, 8.0, 100.0));
    let mount = Mount { gimbal: scenes::gimbal(20.0, -60.0, 0.0), ..Mount::default() };
    let antenna = Geodetic::from_degrees(47.0, 8.0, 420.0);
    let build = |yaw: f64| {
        scenes::frame(
            scenes::record(antenna, yaw, 1.0, -2.0),
            &mount,
            scenes::paper_camera(),
            Arc::new(Slope(site)),
        )
    };
    let model = ErrorModel { attitude_std: AngleStd::equal(1e-3), ..ErrorModel::default() };
    let frame = build(30.0);
    let pixel = ImagePoint::new(400.0, 200.0);
    let at = FramePropagation::new(&frame, &model).unwrap().at(pixel).unwrap();
    let here = LocalTangent::at(at.ground.position);
    let step = 0.05_f64;
    let moved = |by: f64| {
        let there = build(30.0 + by).ground_from_pixel(pixel).unwrap().position;
        scenes::ned_of(&here, &there)
    };
    let (up, down) = (moved(step), moved(-step));
    let by_yaw = at.jacobian.column(Source::Yaw.parameters().start);
    let span = 2.0 * Radians::from_degrees(step).get();
    // The elevation model is met to 10 µm, over a step of 0.3 m.
    let tolerance = 2e-4 * by_yaw.norm();
    assert!(((up.x() - down.x()) / span - by_yaw[0]).abs() < tolerance);
    assert!(((up.y() - down.y()) / span - by_yaw[1]).abs() < tolerance);
    // On level ground the same turn would not change the distance; here it does by the slope.
    let level = FramePropagation::new(&frame, &model)
        .unwrap()
        .at_height(pixel, at.ground.position.height.get())
        .unwrap();
    let difference = level.jacobian.column(Source::Yaw.parameters().start) - by_yaw;
    assert!(difference.norm() > 0.01 * by_yaw.norm());
}

#[test]
fn shares_add_up_to_the_covariance() {
    let frame = scenes::flight();
    let model = ErrorModel {
        position_std_m: 2.5,
        height_std_m: 5.0,
        attitude_std: AngleStd::equal(4e-3),
        boresight_std: AngleStd::equal(1e-3),
        lever_arm_std_m: 0.05,
        ground_height_std_m: 1.0,
        picking_std_px: 0.5,
        ..ErrorModel::default()
    };
    let at = FramePropagation::new(&frame, &model).unwrap().at(ImagePoint::new(900.0, 120.0)).unwrap();
    let sum: f64 = at.variance_by_source.iter().sum();
    assert!((sum - at.covariance.trace()).abs() < 1e-12 * sum);
    let e = at.ellipse;
    let trace = e.semi_major_m.powi(2) + e.semi_minor_m.powi(2);
    assert!((trace - sum).abs() < 1e-9 * sum);
}

#[test]
fn what_cannot_be_propagated_is_said() {
    let frame = scenes::flight();
    let late = ErrorModel { time_std_s: 0.02, ..ErrorModel::default() };
    let refused = FramePropagation::new(&frame, &late).err().unwrap();
    assert!(matches!(refused, PropagationError::NoSpeed { .. }), "{refused}");
    let interior = ErrorModel { interior: true, ..ErrorModel::default() };
    let refused = FramePropagation::new(&frame, &interior).err().unwrap();
    assert_eq!(refused, PropagationError::NoInteriorCovariance);
    let model = ErrorModel { height_std_m: 1.0, ..ErrorModel::default() };
    let propagation = FramePropagation::new(&frame, &model).unwrap();
    assert!(matches!(
        propagation.at(ImagePoint::new(0.0, 0.0)),
        Err(PropagationError::Locate(LocateError::NoRay { .. }))
    ));
}

#[test]
fn next_to_the_fold_of_the_lens_nothing_is_claimed() {
    let frame = scenes::flight();
    let model = ErrorModel { picking_std_px: 1.0, ..ErrorModel::default() };
    let propagation = FramePropagation::new(&frame, &model).unwrap();
    // Along the first row towards the upper left corner, which the paper's lens cannot see.
    let mut last = propagation.at(ImagePoint::new(300.0, 0.0)).unwrap().ce90_m().unwrap();
    let mut refused = 0;
    for step in 0..30_000 {
        let pixel = ImagePoint::new(300.0 - f64::from(step) * 0.01, 0.0);
        match propagation.at(pixel) {
            Ok(at) => {
                assert_eq!(refused, 0, "claimed beyond the fold");
                last = at.ce90_m().unwrap();
            }
            Err(PropagationError::NearFold { times }) => {
                assert!(times > 10.0);
                refused += 1;
            }
            Err(PropagationError::Locate(LocateError::NoRay { .. })) => break,
            Err(other) => panic!("{other}"),
        }
    }
    // A pixel is 0.5 m; ten of them at most.
    assert!(refused > 0 && last < 20.0, "{refused} refused, the last claim is {last} m");
}

#[test]
fn a_speed_without_direction_keeps_its_square() {
    let mut frame = scenes::flight();
    let model = ErrorModel { time_std_s: 0.1, ..ErrorModel::default() };
    frame.record.ground_speed_m_s = Some(20.0);
    let speed = FramePropagation::new(&frame, &model).unwrap().at(ImagePoint::new(600.0, 300.0)).unwrap();
    frame.record.velocity = Some(Displacement::new(12.0, 16.0, 0.0));
    let velocity = FramePropagation::new(&frame, &model).unwrap().at(ImagePoint::new(600.0, 300.0)).unwrap();
    let (a, b) = (speed.covariance.trace(), velocity.covariance.trace());
    assert!((a - 4.0).abs() < 1e-3 && (b - 4.0).abs() < 1e-3, "{a} {b}");
}
