//! The flight: true poses over time, and what the attitude-and-position unit logs of them.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector2, Vector3};
use rand::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::earth::{GeodeticPosition, rotation_x, rotation_y, rotation_z, rotation_zyx_deg};
use super::ground::{Ground, ScenePoint};
use super::scenario::{Adahrs, Camera, Flight, Mounting, Scenario};
use super::stream;

/// The log starts this many seconds before the first exposure, and a strip this long before its own first.
const LEAD_S: f64 = 4.0;
const GRAVITY_M_S2: f64 = 9.806_65;
const STEEPEST_BANK_DEG: f64 = 40.0;

/// Attitude of the body in the local north-east-down axes: `Rz(yaw)·Ry(pitch)·Rx(roll)`, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude {
    /// Clockwise from true north, 0 to 360.
    pub yaw_deg: f64,
    /// Nose up.
    pub pitch_deg: f64,
    /// Right wing down.
    pub roll_deg: f64,
}

impl Attitude {
    /// `nav_from_body`.
    pub(super) fn nav_from_body(&self) -> Matrix3<f64> {
        rotation_zyx_deg(self.yaw_deg, self.pitch_deg, self.roll_deg)
    }
}

/// One record of the attitude-and-position unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogRow {
    pub time_s: f64,
    /// Position of the antenna.
    pub antenna: GeodeticPosition,
    pub attitude: Attitude,
    pub ground_speed_m_s: f64,
}

/// One frame of the survey: what is true, and what the log says.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueFrame {
    /// File name of the photo.
    pub name: String,
    /// Strip, counted from 0.
    pub strip: u32,
    /// The truth at the exposure, in the unit's time.
    pub truth: LogRow,
    /// True projection centre.
    pub camera: GeodeticPosition,
    /// The log's row for this frame; its time is that of the camera's clock.
    pub logged: LogRow,
    /// Projection centre in ECEF, metres.
    pub(super) camera_in_ecef: Vector3<f64>,
    pub(super) ecef_from_camera: Matrix3<f64>,
}

/// All frames and the continuous track.
pub(super) struct Flown {
    pub frames: Vec<TrueFrame>,
    pub track: Vec<LogRow>,
}

/// A piece of the path: straight along a strip, or a turn to the next one.
enum Leg {
    Straight {
        from: Vector2<f64>,
        velocity: Vector2<f64>,
    },
    /// Cubic Hermite curve between two strips.
    Turn {
        from: Vector2<f64>,
        to: Vector2<f64>,
        leave: Vector2<f64>,
        arrive: Vector2<f64>,
    },
}

struct TimedLeg {
    start_s: f64,
    duration_s: f64,
    leg: Leg,
}

/// Smooth wander: a few sines of random period and phase.
struct Wander {
    rms_deg: f64,
    waves: [(f64, f64); 4],
}

impl Wander {
    fn new(rms_deg: f64, random: &mut ChaCha8Rng) -> Self {
        let waves = [3.7, 6.1, 9.8, 15.3].map(|period: f64| {
            (TAU / (period * random.random_range(0.85..1.15)), random.random_range(0.0..TAU))
        });
        Self { rms_deg, waves }
    }

    fn at(&self, time_s: f64) -> f64 {
        self.rms_deg * self.waves.iter().map(|(rate, phase)| (rate * time_s + phase).sin()).sum::<f64>()
            / 2.0_f64.sqrt()
    }
}

/// The true pose of the antenna at any time.
struct Path<'a> {
    flight: &'a Flight,
    ground: &'a Ground,
    height_m: f64,
    legs: Vec<TimedLeg>,
    roll: Wander,
    pitch: Wander,
    yaw: Wander,
}

impl Path<'_> {
    /// Position, velocity and acceleration in the scene (metres, seconds) at a time.
    fn motion(&self, time_s: f64) -> [Vector2<f64>; 3] {
        let index = self.legs.partition_point(|leg| leg.start_s <= time_s).saturating_sub(1);
        let TimedLeg { start_s, duration_s, leg } = &self.legs[index];
        let elapsed = time_s - start_s;
        match leg {
            Leg::Straight { from, velocity } => [from + velocity * elapsed, *velocity, Vector2::zeros()],
            Leg::Turn { from, to, leave, arrive } => {
                let t = elapsed / duration_s;
                let position = from * (1.0 + t * t * (2.0 * t - 3.0))
                    + to * (t * t * (3.0 - 2.0 * t))
                    + leave * (t * (t - 1.0) * (t - 1.0))
                    + arrive * (t * t * (t - 1.0));
                let first = (to - from) * (6.0 * t * (1.0 - t))
                    + leave * (1.0 + t * (3.0 * t - 4.0))
                    + arrive * (t * (3.0 * t - 2.0));
                let second =
                    (to - from) * (6.0 - 12.0 * t) + leave * (6.0 * t - 4.0) + arrive * (6.0 * t - 2.0);
                [position, first / *duration_s, second / (duration_s * duration_s)]
            }
        }
    }

    fn at(&self, time_s: f64) -> LogRow {
        let [position, velocity, acceleration] = self.motion(time_s);
        let here = ScenePoint { east: position.x, north: position.y };
        let antenna = GeodeticPosition::from_ecef(&self.ground.ecef_at_height(here, self.height_m));
        // The course in the local axes: the site's north is not the aircraft's.
        let velocity_in_ned =
            antenna.ecef_from_ned().transpose() * self.ground.direction_in_ecef(velocity.x, velocity.y);
        let course_deg = velocity_in_ned.y.atan2(velocity_in_ned.x).to_degrees();
        let speed = velocity.norm();
        // A coordinated turn: positive to the right of the course.
        let sideways = (acceleration.x * velocity.y - acceleration.y * velocity.x) / speed;
        let bank_deg = sideways.atan2(GRAVITY_M_S2).to_degrees().clamp(-STEEPEST_BANK_DEG, STEEPEST_BANK_DEG);
        LogRow {
            time_s,
            antenna,
            attitude: Attitude {
                yaw_deg: (course_deg + self.flight.crab_deg + self.yaw.at(time_s)).rem_euclid(360.0),
                pitch_deg: self.flight.pitch_deg + self.pitch.at(time_s),
                roll_deg: self.flight.roll_deg + bank_deg + self.roll.at(time_s),
            },
            ground_speed_m_s: speed,
        }
    }
}

/// Distance between exposures and between strips, metres.
pub(super) fn spacings_m(flight: &Flight, camera: &Camera, mounting: &Mounting) -> (f64, f64) {
    let wide = flight.height_above_ground_m * f64::from(camera.width_px) / camera.fx_px;
    let high = flight.height_above_ground_m * f64::from(camera.height_px) / camera.fy_px;
    // Without pan the image's top looks to the nose, so its height lies along the strip.
    let (sin, cos) = mounting.gimbal_pan_deg.to_radians().sin_cos();
    let along = high * cos.abs() + wide * sin.abs();
    let across = wide * cos.abs() + high * sin.abs();
    (
        flight.photo_spacing_m.unwrap_or(along * (1.0 - flight.forward_overlap.unwrap_or(0.6))),
        flight.strip_spacing_m.unwrap_or(across * (1.0 - flight.side_overlap.unwrap_or(0.4))),
    )
}

/// Flies the strips and logs them.
pub(super) fn fly(scenario: &Scenario, ground: &Ground) -> Flown {
    let Scenario { flight, camera, mounting, adahrs, .. } = scenario;
    let (photo_spacing, strip_spacing) = spacings_m(flight, camera, mounting);
    let lead_s = LEAD_S + adahrs.clock_offset_s.abs();
    let lead = lead_s * flight.speed_m_s;
    let (sin, cos) = flight.heading_deg.to_radians().sin_cos();
    let (ahead, right) = (Vector2::new(sin, cos), Vector2::new(cos, -sin));
    let centre = Vector2::new(flight.east_m, flight.north_m);
    let length = f64::from(flight.frames_per_strip - 1) * photo_spacing;

    let mut legs: Vec<TimedLeg> = Vec::new();
    let mut exposures = Vec::new();
    let mut time_s = 0.0;
    let mut last: Option<(Vector2<f64>, Vector2<f64>)> = None;
    for strip in 0..flight.strips {
        let sense = if flight.alternate && strip % 2 == 1 { -1.0 } else { 1.0 };
        let side = (f64::from(strip) - 0.5 * f64::from(flight.strips - 1)) * strip_spacing;
        let direction = ahead * sense;
        let from = centre + right * side - direction * (0.5 * length + lead);
        if let Some((end, leaving)) = last {
            let reach = 1.6 * (from - end).norm().max(60.0);
            let leg = Leg::Turn { from: end, to: from, leave: leaving * reach, arrive: direction * reach };
            // Tangents of this length keep the strips' speed where the turn joins them.
            let duration_s = reach / flight.speed_m_s;
            legs.push(TimedLeg { start_s: time_s, duration_s, leg });
            time_s += duration_s;
        }
        let duration_s = (length + 2.0 * lead) / flight.speed_m_s;
        let velocity = direction * flight.speed_m_s;
        legs.push(TimedLeg { start_s: time_s, duration_s, leg: Leg::Straight { from, velocity } });
        for index in 0..flight.frames_per_strip {
            exposures.push((strip, time_s + lead_s + f64::from(index) * photo_spacing / flight.speed_m_s));
        }
        time_s += duration_s;
        last = Some((from + velocity * duration_s, direction));
    }

    let mut random = ChaCha8Rng::seed_from_u64(scenario.seed);
    random.set_stream(stream::WANDER);
    let path = Path {
        flight,
        ground,
        height_m: scenario.site.ground_height_ellipsoid_m + flight.height_above_ground_m,
        legs,
        roll: Wander::new(flight.roll_wander_deg, &mut random),
        pitch: Wander::new(flight.pitch_wander_deg, &mut random),
        yaw: Wander::new(flight.yaw_wander_deg, &mut random),
    };

    // Track records and looked-up frame poses share one error process, so they are drawn in order of time.
    let ticks = (time_s * adahrs.track_rate_hz).floor() as u64;
    let mut readings: Vec<(f64, Option<usize>)> =
        (0..=ticks).map(|tick| (tick as f64 / adahrs.track_rate_hz, None)).collect();
    readings.extend(
        exposures
            .iter()
            .enumerate()
            .map(|(index, (_, time_s))| (time_s + adahrs.clock_offset_s, Some(index))),
    );
    readings.sort_by(|a, b| a.0.total_cmp(&b.0));

    let mut errors = Errors::new(adahrs, scenario.seed);
    let mut track = Vec::with_capacity(ticks as usize + 1);
    let mut looked_up = vec![None; exposures.len()];
    for (time_s, frame) in readings {
        let row = errors.apply(path.at(time_s));
        match frame {
            Some(index) => looked_up[index] = Some(row),
            None => track.push(row),
        }
    }

    let frames = exposures
        .iter()
        .zip(looked_up.into_iter().flatten())
        .enumerate()
        .map(|(index, (&(strip, time_s), logged))| {
            let truth = path.at(time_s);
            let (camera_in_ecef, ecef_from_camera) = camera_pose(&truth, mounting);
            TrueFrame {
                name: format!("IMG_{:04}.jpg", index + 1),
                strip,
                truth,
                camera: GeodeticPosition::from_ecef(&camera_in_ecef),
                logged,
                camera_in_ecef,
                ecef_from_camera,
            }
        })
        .collect();
    Flown { frames, track }
}

/// Projection centre in ECEF and `ecef_from_camera` of a true pose.
///
/// # Source
/// Hemerly, eq. (8), with the antenna's lever arm and the boresight angles added.
fn camera_pose(truth: &LogRow, mounting: &Mounting) -> (Vector3<f64>, Matrix3<f64>) {
    let nav_from_body = truth.attitude.nav_from_body();
    let body_from_gimbal = rotation_zyx_deg(
        mounting.boresight_yaw_deg,
        mounting.boresight_pitch_deg,
        mounting.boresight_roll_deg,
    ) * rotation_z(mounting.gimbal_pan_deg.to_radians())
        * rotation_y(mounting.gimbal_elevation_deg.to_radians())
        * rotation_x(mounting.gimbal_roll_deg.to_radians());
    let gimbal_from_camera = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let antenna_to_camera_in_body = Vector3::from(mounting.gimbal_in_body_m)
        - Vector3::from(mounting.antenna_in_body_m)
        + body_from_gimbal * Vector3::from(mounting.camera_in_gimbal_m);
    let ecef_from_body = truth.antenna.ecef_from_ned() * nav_from_body;
    (
        truth.antenna.ecef() + ecef_from_body * antenna_to_camera_in_body,
        ecef_from_body * body_from_gimbal * gimbal_from_camera,
    )
}

/// The unit's errors: six first-order Gauss-Markov processes, white where the correlation time is zero.
struct Errors {
    random: ChaCha8Rng,
    /// 1σ of north, east, down (metres), yaw, pitch, roll (degrees).
    std: [f64; 6],
    state: [f64; 6],
    correlation_time_s: f64,
    last_s: f64,
}

impl Errors {
    fn new(adahrs: &Adahrs, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream::ADAHRS);
        let horizontal = adahrs.horizontal_std_m();
        let std = [
            horizontal,
            horizontal,
            adahrs.height_std_m,
            adahrs.heading_std_deg,
            adahrs.pitch_std_deg,
            adahrs.roll_std_deg,
        ];
        // A first step from the infinite past draws the stationary state.
        Self {
            random,
            std,
            state: [0.0; 6],
            correlation_time_s: adahrs.correlation_time_s,
            last_s: f64::NEG_INFINITY,
        }
    }

    fn apply(&mut self, truth: LogRow) -> LogRow {
        let kept = if self.correlation_time_s > 0.0 {
            (-(truth.time_s - self.last_s) / self.correlation_time_s).exp()
        } else {
            0.0
        };
        self.last_s = truth.time_s;
        for (state, std) in self.state.iter_mut().zip(self.std) {
            let fresh: f64 = self.random.sample(StandardNormal);
            *state = *state * kept + std * fresh * (1.0 - kept * kept).sqrt();
        }
        let [north, east, down, yaw, pitch, roll] = self.state;
        if self.std == [0.0; 6] {
            // A faultless unit returns the truth to the last bit.
            return truth;
        }
        let offset = truth.antenna.ecef_from_ned() * Vector3::new(north, east, down);
        LogRow {
            antenna: GeodeticPosition::from_ecef(&(truth.antenna.ecef() + offset)),
            attitude: Attitude {
                yaw_deg: (truth.attitude.yaw_deg + yaw).rem_euclid(360.0),
                pitch_deg: truth.attitude.pitch_deg + pitch,
                roll_deg: truth.attitude.roll_deg + roll,
            },
            ..truth
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(scenario: &Scenario) -> Flown {
        fly(scenario, &Ground::new(scenario))
    }

    /// Hemerly's flight: the published attitude gives this `nav_from_camera` (computed independently).
    #[test]
    fn the_papers_flight_has_its_camera_attitude() {
        let frame = &flown(&Scenario::paper_flight()).frames[0];
        let nav_from_camera = frame.truth.antenna.ecef_from_ned().transpose() * frame.ecef_from_camera;
        let expected = Matrix3::new(
            -0.998079, 0.022362, -0.057785, -0.024365, -0.999118, 0.034192, -0.056969, 0.035535, 0.997743,
        );
        assert!((nav_from_camera - expected).abs().max() < 1.5e-6, "{nav_from_camera}");
    }

    #[test]
    fn lever_arms_add_up_in_body_axes() {
        let mut scenario = Scenario::paper_flight();
        scenario.flight.roll_deg = 0.0;
        scenario.flight.pitch_deg = 0.0;
        scenario.flight.heading_deg = 90.0;
        scenario.mounting.antenna_in_body_m = [-0.5, 0.2, -0.3];
        scenario.mounting.gimbal_in_body_m = [1.0, 0.0, 0.4];
        // With the gimbal looking down, its x axis is down.
        scenario.mounting.camera_in_gimbal_m = [0.1, 0.0, 0.0];
        let frame = &flown(&scenario).frames[0];
        let antenna = &frame.truth.antenna;
        let offset_in_ned = antenna.ecef_from_ned().transpose() * (frame.camera_in_ecef - antenna.ecef());
        assert!((offset_in_ned - Vector3::new(0.2, 1.5, 0.8)).norm() < 1e-6, "{offset_in_ned}");
    }

    #[test]
    fn the_track_is_continuous_and_its_turns_are_flown_to_the_right_side() {
        let scenario = Scenario { adahrs: Adahrs::default(), ..Scenario::demo() };
        let flown = flown(&scenario);
        for pair in flown.track.windows(2) {
            let moved = (pair[1].antenna.ecef() - pair[0].antenna.ecef()).norm();
            let speed = 0.5 * (pair[0].ground_speed_m_s + pair[1].ground_speed_m_s);
            let elapsed = pair[1].time_s - pair[0].time_s;
            assert!((moved - speed * elapsed).abs() < 0.05 * moved, "{} s: {moved} m", pair[0].time_s);
        }
        // Strips follow one another to the right of the first, so the first turn is a right turn, banked right.
        let (first, second) = (flown.frames[4].truth.time_s, flown.frames[5].truth.time_s);
        let middle = path_row(&flown.track, 0.5 * (first + second));
        assert!(middle.attitude.roll_deg > 5.0, "{middle:?}");
    }

    fn path_row(track: &[LogRow], time_s: f64) -> &LogRow {
        &track[track.partition_point(|row| row.time_s < time_s)]
    }

    #[test]
    fn a_faultless_unit_logs_the_truth() {
        let scenario = Scenario { adahrs: Adahrs::default(), ..Scenario::demo() };
        for frame in flown(&scenario).frames {
            assert_eq!(frame.logged, frame.truth);
        }
    }

    #[test]
    fn a_clock_offset_makes_the_log_late() {
        let adahrs = Adahrs { clock_offset_s: 0.5, ..Adahrs::default() };
        let scenario = Scenario { adahrs, ..Scenario::demo() };
        for frame in flown(&scenario).frames {
            assert!((frame.logged.time_s - frame.truth.time_s - 0.5).abs() < 1e-9);
            let moved = (frame.logged.antenna.ecef() - frame.truth.antenna.ecef()).norm();
            assert!((moved - 11.0).abs() < 0.01, "{moved}");
        }
    }

    /// The spread of many logged errors is the stated one: with 600 frames the ratio's own 1σ is 3 %.
    #[test]
    fn logged_errors_have_the_stated_spread() {
        let mut scenario = Scenario { adahrs: Adahrs::paper(), ..Scenario::demo() };
        scenario.flight.strips = 20;
        scenario.flight.frames_per_strip = 30;
        let frames = flown(&scenario).frames;
        let mut squares = [0.0; 6];
        for frame in &frames {
            let antenna = &frame.truth.antenna;
            let offset = antenna.ecef_from_ned().transpose() * (frame.logged.antenna.ecef() - antenna.ecef());
            let yaw = (frame.logged.attitude.yaw_deg - frame.truth.attitude.yaw_deg + 180.0)
                .rem_euclid(360.0)
                - 180.0;
            let pitch = frame.logged.attitude.pitch_deg - frame.truth.attitude.pitch_deg;
            let roll = frame.logged.attitude.roll_deg - frame.truth.attitude.roll_deg;
            for (square, error) in squares.iter_mut().zip([offset.x, offset.y, offset.z, yaw, pitch, roll]) {
                *square += error * error / frames.len() as f64;
            }
        }
        for (square, std) in squares.iter().zip([2.548, 2.548, 5.0, 0.6, 0.2, 0.2]) {
            assert!((square.sqrt() / std - 1.0).abs() < 0.12, "{squares:?}");
        }
    }
}
