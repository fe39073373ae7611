//! The description of a synthetic survey: what stands in a scenario file (TOML).
//!
//! Every key carries its unit; every key left out takes the default stated here, and the resolved
//! scenario is written beside the survey. Frames and angle senses are those of the crate: body axes
//! front-right-down, yaw clockwise from true north, gimbal elevation negative below the horizon.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SyntheticError;

/// A synthetic survey: site, scene, camera, flight, attitude-and-position unit and target photos.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Scenario {
    /// Seed of everything random: ground texture, relief, attitude wander, errors, sensor noise.
    pub seed: u64,
    pub site: Site,
    pub relief: Relief,
    pub scene: Scene,
    pub camera: Camera,
    pub photo: Photo,
    pub flight: Flight,
    pub mounting: Mounting,
    pub adahrs: Adahrs,
    pub calibration: CalibrationPhotos,
}

/// Where the survey lies. The scene's east and north axes (metres) are those of the local tangent
/// plane at this point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Site {
    /// WGS 84 latitude, degrees north.
    pub latitude_deg: f64,
    /// WGS 84 longitude, degrees east.
    pub longitude_deg: f64,
    /// Height of the ground (of the mean ground with hills) above the WGS 84 ellipsoid, metres.
    pub ground_height_ellipsoid_m: f64,
}

impl Default for Site {
    /// Near São José dos Campos, Brazil, where the paper's author worked.
    fn default() -> Self {
        Self { latitude_deg: -23.229, longitude_deg: -45.8616, ground_height_ellipsoid_m: 640.0 }
    }
}

/// The shape of the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Relief {
    pub shape: ReliefShape,
    /// Greatest departure of hills from the site's ground height, metres. Unused on flat ground.
    pub amplitude_m: f64,
    /// Shortest wavelength of hills, metres. Unused on flat ground.
    pub wavelength_m: f64,
}

impl Default for Relief {
    fn default() -> Self {
        Self { shape: ReliefShape::Flat, amplitude_m: 15.0, wavelength_m: 400.0 }
    }
}

/// The kinds of ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ReliefShape {
    /// A surface of constant ellipsoidal height (not a tangent plane).
    Flat,
    /// A smooth sum of sines in the site's east and north.
    Hills,
}

/// What lies on the ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Scene {
    /// Typical width of a field, metres.
    pub field_size_m: f64,
    /// Direction of the field boundaries, degrees clockwise from north.
    pub field_direction_deg: f64,
    /// Distance between crop rows, metres.
    pub row_period_m: f64,
    pub runway: Runway,
    pub targets: Targets,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            field_size_m: 170.0,
            field_direction_deg: 12.0,
            row_period_m: 1.6,
            runway: Runway::default(),
            targets: Targets::default(),
        }
    }
}

/// A paved runway with light markings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Runway {
    pub present: bool,
    /// Centre, metres east of the site.
    pub east_m: f64,
    /// Centre, metres north of the site.
    pub north_m: f64,
    /// Direction from end 1 to end 2, degrees clockwise from north.
    pub heading_deg: f64,
    pub length_m: f64,
    pub width_m: f64,
}

impl Default for Runway {
    /// The paper's runway.
    fn default() -> Self {
        Self { present: true, east_m: 0.0, north_m: 0.0, heading_deg: 181.4, length_m: 225.0, width_m: 10.0 }
    }
}

/// White discs and crosses on dark round plates, on a grid. Columns run along the heading, rows to its
/// right. A target that would lie on the runway or within 5 m of it is left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Targets {
    /// Targets along the heading; 0 for none.
    pub columns: u32,
    /// Targets across the heading; 0 for none.
    pub rows: u32,
    /// Distance between neighbours along the heading, metres.
    pub column_spacing_m: f64,
    /// Distance between neighbours across the heading, metres.
    pub row_spacing_m: f64,
    /// Centre of the grid, metres east of the site.
    pub east_m: f64,
    /// Centre of the grid, metres north of the site.
    pub north_m: f64,
    /// Direction of the columns, degrees clockwise from north.
    pub heading_deg: f64,
    /// Diameter of the white disc and span of the white cross, metres; the plate is 1.8 times as wide.
    pub diameter_m: f64,
}

impl Default for Targets {
    fn default() -> Self {
        Self {
            columns: 4,
            rows: 3,
            column_spacing_m: 210.0,
            row_spacing_m: 150.0,
            east_m: 0.0,
            north_m: 0.0,
            heading_deg: 181.4,
            diameter_m: 4.0,
        }
    }
}

/// Interior orientation: `u = fx·xd + skew·yd + cx`, `v = fy·yd + cy` on distorted coordinates, Brown's
/// lens with radial `k1, k2, k3` (of r², r⁴, r⁶) and tangential `p1, p2`. Pixel (0, 0) is the centre of
/// the top-left pixel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Camera {
    pub width_px: u32,
    pub height_px: u32,
    pub fx_px: f64,
    pub fy_px: f64,
    pub skew_px: f64,
    pub cx_px: f64,
    pub cy_px: f64,
    pub k1: f64,
    pub k2: f64,
    pub p1: f64,
    pub p2: f64,
    pub k3: f64,
}

impl Default for Camera {
    /// The paper's camera, eq. (6) and (7). Its lens folds back in the corners of the frame.
    fn default() -> Self {
        Self {
            width_px: 1152,
            height_px: 648,
            fx_px: 743.7937,
            fy_px: 748.9947,
            skew_px: -0.7729,
            cx_px: 566.3670,
            cy_px: 345.5019,
            k1: -0.0199,
            k2: 0.1629,
            p1: 0.0076,
            p2: 0.0039,
            k3: -0.3018,
        }
    }
}

/// What happens between the ground and the picture file. Grey values count from 0 to 255.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Photo {
    /// Standard deviation of the sensor noise, grey values.
    pub noise_std: f64,
    /// Standard deviation of the Gaussian blur, pixels; 0 for none.
    pub blur_px: f64,
    /// Standard deviation of the exposure from frame to frame, as a fraction.
    pub gain_std: f64,
    /// Light lost in the corner of the frame, as a fraction.
    pub vignetting: f64,
    /// Quality of the JPEG files, 1 to 100.
    pub jpeg_quality: u8,
}

impl Default for Photo {
    fn default() -> Self {
        Self { noise_std: 1.5, blur_px: 0.6, gain_std: 0.0, vignetting: 0.0, jpeg_quality: 90 }
    }
}

/// Parallel strips flown at a constant ellipsoidal height, centred on the site.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Flight {
    pub strips: u32,
    pub frames_per_strip: u32,
    /// Overlap of successive frames as a fraction (0.6 unless a spacing is given).
    pub forward_overlap: Option<f64>,
    /// Distance between exposures, metres; instead of `forward_overlap`.
    pub photo_spacing_m: Option<f64>,
    /// Overlap of neighbouring strips as a fraction (0.4 unless a spacing is given).
    pub side_overlap: Option<f64>,
    /// Distance between strips, metres; instead of `side_overlap`.
    pub strip_spacing_m: Option<f64>,
    /// Antenna height above the site's ground height, metres.
    pub height_above_ground_m: f64,
    /// Speed over ground, metres per second.
    pub speed_m_s: f64,
    /// Course of the first strip, degrees clockwise from true north.
    pub heading_deg: f64,
    /// Whether every second strip is flown the other way.
    pub alternate: bool,
    /// Centre of the strips, metres east of the site.
    pub east_m: f64,
    /// Centre of the strips, metres north of the site.
    pub north_m: f64,
    /// Mean roll, degrees, right wing down.
    pub roll_deg: f64,
    /// Mean pitch, degrees, nose up.
    pub pitch_deg: f64,
    /// Mean yaw minus course, degrees.
    pub crab_deg: f64,
    /// Root mean square of the smooth wander of the true roll, degrees.
    pub roll_wander_deg: f64,
    /// The same of the true pitch, degrees.
    pub pitch_wander_deg: f64,
    /// The same of the true yaw, degrees.
    pub yaw_wander_deg: f64,
}

impl Default for Flight {
    fn default() -> Self {
        Self {
            strips: 3,
            frames_per_strip: 5,
            forward_overlap: None,
            photo_spacing_m: None,
            side_overlap: None,
            strip_spacing_m: None,
            height_above_ground_m: 357.46,
            speed_m_s: 22.0,
            heading_deg: 181.4,
            alternate: true,
            east_m: 0.0,
            north_m: 0.0,
            roll_deg: 0.0,
            pitch_deg: 0.0,
            crab_deg: 0.0,
            roll_wander_deg: 1.5,
            pitch_wander_deg: 1.2,
            yaw_wander_deg: 2.0,
        }
    }
}

/// How antenna, gimbal and camera sit in the aircraft.
///
/// `body_from_gimbal = R(boresight)·Rz(pan)·Ry(elevation)·Rx(roll)` with
/// `R(boresight) = Rz(yaw)·Ry(pitch)·Rx(roll)`; the gimbal's x axis is the optical axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mounting {
    /// Gimbal pan, degrees, clockwise seen from above; 0 looks over the nose.
    pub gimbal_pan_deg: f64,
    /// Gimbal elevation, degrees above the horizon; -90 looks straight down.
    pub gimbal_elevation_deg: f64,
    /// Gimbal roll about the optical axis, degrees.
    pub gimbal_roll_deg: f64,
    pub boresight_roll_deg: f64,
    pub boresight_pitch_deg: f64,
    pub boresight_yaw_deg: f64,
    /// Antenna seen from the body origin, metres front, right, down.
    pub antenna_in_body_m: [f64; 3],
    /// Gimbal seen from the body origin, metres front, right, down.
    pub gimbal_in_body_m: [f64; 3],
    /// Camera's projection centre seen from the gimbal, metres in gimbal axes.
    pub camera_in_gimbal_m: [f64; 3],
}

impl Default for Mounting {
    /// The paper's flight: straight down, image right towards the nose, no lever arms.
    fn default() -> Self {
        Self {
            gimbal_pan_deg: -90.0,
            gimbal_elevation_deg: -90.0,
            gimbal_roll_deg: 0.0,
            boresight_roll_deg: 0.0,
            boresight_pitch_deg: 0.0,
            boresight_yaw_deg: 0.0,
            antenna_in_body_m: [0.0; 3],
            gimbal_in_body_m: [0.0; 3],
            camera_in_gimbal_m: [0.0; 3],
        }
    }
}

/// Errors of the attitude-and-position unit, all zero by default: the log then holds the true poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Adahrs {
    /// 1σ, degrees.
    pub roll_std_deg: f64,
    /// 1σ, degrees.
    pub pitch_std_deg: f64,
    /// 1σ, degrees.
    pub heading_std_deg: f64,
    /// Horizontal position as circular error probable, metres (1σ per axis = CEP / 1.1774).
    pub position_cep_m: Option<f64>,
    /// Horizontal position as 1σ per axis, metres; instead of `position_cep_m`.
    pub position_std_m: Option<f64>,
    /// 1σ of the height, metres.
    pub height_std_m: f64,
    /// Time over which the errors stay alike (first-order Gauss-Markov), seconds; 0 makes every record
    /// independent.
    pub correlation_time_s: f64,
    /// Camera clock minus the unit's clock, seconds. Exposure times in the log are those of the camera
    /// clock and their poses the unit's at that reading, hence late by this offset.
    pub clock_offset_s: f64,
    /// Records per second in the continuous track.
    pub track_rate_hz: f64,
}

impl Default for Adahrs {
    fn default() -> Self {
        Self {
            roll_std_deg: 0.0,
            pitch_std_deg: 0.0,
            heading_std_deg: 0.0,
            position_cep_m: None,
            position_std_m: None,
            height_std_m: 0.0,
            correlation_time_s: 0.0,
            clock_offset_s: 0.0,
            track_rate_hz: 10.0,
        }
    }
}

impl Adahrs {
    /// The unit of the paper: roll and pitch 0.2°, heading 0.6°, position 3 m CEP, and a height of 5 m (1σ).
    pub fn paper() -> Self {
        Self {
            roll_std_deg: 0.2,
            pitch_std_deg: 0.2,
            heading_std_deg: 0.6,
            position_cep_m: Some(3.0),
            height_std_m: 5.0,
            ..Self::default()
        }
    }

    /// Horizontal 1σ per axis, metres.
    pub(super) fn horizontal_std_m(&self) -> f64 {
        // The circular error probable of two equal independent axes is sqrt(2 ln 2) sigma.
        self.position_std_m.unwrap_or(0.0)
            + self.position_cep_m.unwrap_or(0.0) / (2.0 * std::f64::consts::LN_2).sqrt()
    }
}

/// Photos of the paper's 7×7 squares target for calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationPhotos {
    /// Number of photos; 0 for none.
    pub views: u32,
    /// Smallest and largest tilt of the target against the image plane, degrees.
    pub tilt_deg: [f64; 2],
    /// Smallest and largest part of the frame's height that the pattern fills.
    pub fill: [f64; 2],
    /// Standard deviation of the sensor noise, grey values.
    pub noise_std: f64,
    /// Standard deviation of the Gaussian blur, pixels.
    pub blur_px: f64,
}

impl Default for CalibrationPhotos {
    fn default() -> Self {
        Self { views: 6, tilt_deg: [15.0, 45.0], fill: [0.6, 0.85], noise_std: 3.0, blur_px: 0.8 }
    }
}

impl Scenario {
    /// The demo's survey: 3 strips of 5 frames over farmland with the paper's camera, flying height, gimbal,
    /// runway and unit.
    pub fn demo() -> Self {
        Self {
            seed: 14,
            flight: Flight { forward_overlap: Some(0.7), side_overlap: Some(0.6), ..Flight::default() },
            photo: Photo {
                noise_std: 1.0,
                gain_std: 0.02,
                vignetting: 0.08,
                jpeg_quality: 85,
                ..Photo::default()
            },
            mounting: Mounting {
                antenna_in_body_m: [-0.3, 0.0, -0.25],
                gimbal_in_body_m: [0.45, 0.0, 0.2],
                camera_in_gimbal_m: [0.05, 0.0, 0.0],
                ..Mounting::default()
            },
            adahrs: Adahrs { correlation_time_s: 20.0, ..Adahrs::paper() },
            calibration: CalibrationPhotos { noise_std: 1.25, ..CalibrationPhotos::default() },
            ..Self::default()
        }
    }

    /// The paper's flight test: one frame with the published attitude and height over the runway, errors zero.
    ///
    /// # Source
    /// Hemerly, section 4.3: roll, pitch, yaw = 0.0356, 0.057, 3.166 rad, 357.46 m, pan -π/2, tilt π/2.
    pub fn paper_flight() -> Self {
        Self {
            seed: 1,
            flight: Flight {
                strips: 1,
                frames_per_strip: 1,
                heading_deg: 3.166_f64.to_degrees(),
                roll_deg: 0.0356_f64.to_degrees(),
                pitch_deg: 0.057_f64.to_degrees(),
                roll_wander_deg: 0.0,
                pitch_wander_deg: 0.0,
                yaw_wander_deg: 0.0,
                ..Flight::default()
            },
            ..Self::default()
        }
    }

    /// Checks every value that would otherwise give a meaningless survey.
    ///
    /// # Errors
    /// [`SyntheticError::Value`] naming the key, its value and what is allowed;
    /// [`SyntheticError::Both`] where two keys exclude each other.
    pub fn validate(&self) -> Result<(), SyntheticError> {
        let Self { site, relief, scene, camera, photo, flight, mounting, adahrs, calibration, .. } = self;
        within("site.latitude_deg", site.latitude_deg, -89.0, 89.0)?;
        within("site.longitude_deg", site.longitude_deg, -180.0, 180.0)?;
        within("site.ground_height_ellipsoid_m", site.ground_height_ellipsoid_m, -500.0, 9000.0)?;
        if relief.shape == ReliefShape::Hills {
            within("relief.wavelength_m", relief.wavelength_m, 20.0, 1e5)?;
            within("relief.amplitude_m", relief.amplitude_m, 0.0, relief.wavelength_m / 8.0)?;
        }
        within("scene.field_size_m", scene.field_size_m, 40.0, 1e4)?;
        within("scene.field_direction_deg", scene.field_direction_deg, -360.0, 360.0)?;
        within("scene.row_period_m", scene.row_period_m, 0.1, 50.0)?;
        let runway = &scene.runway;
        within("scene.runway.length_m", runway.length_m, 30.0, 5000.0)?;
        within("scene.runway.width_m", runway.width_m, 4.0, 100.0)?;
        within("scene.runway.heading_deg", runway.heading_deg, -360.0, 360.0)?;
        let targets = &scene.targets;
        within("scene.targets.columns", f64::from(targets.columns), 0.0, 200.0)?;
        within("scene.targets.rows", f64::from(targets.rows), 0.0, 200.0)?;
        within("scene.targets.diameter_m", targets.diameter_m, 0.1, 100.0)?;
        within("scene.targets.column_spacing_m", targets.column_spacing_m, 2.5 * targets.diameter_m, 1e4)?;
        within("scene.targets.row_spacing_m", targets.row_spacing_m, 2.5 * targets.diameter_m, 1e4)?;
        within("scene.targets.heading_deg", targets.heading_deg, -360.0, 360.0)?;
        for (key, value) in [
            ("scene.runway.east_m", runway.east_m),
            ("scene.runway.north_m", runway.north_m),
            ("scene.targets.east_m", targets.east_m),
            ("scene.targets.north_m", targets.north_m),
            ("flight.east_m", flight.east_m),
            ("flight.north_m", flight.north_m),
        ] {
            // Beyond this the tangent plane of the site is no sensible map any more.
            within(key, value, -2e4, 2e4)?;
        }
        within("camera.width_px", f64::from(camera.width_px), 16.0, 20_000.0)?;
        within("camera.height_px", f64::from(camera.height_px), 16.0, 20_000.0)?;
        within("camera.fx_px", camera.fx_px, 1.0, 1e6)?;
        within("camera.fy_px", camera.fy_px, 1.0, 1e6)?;
        for (key, value) in [
            ("camera.skew_px", camera.skew_px),
            ("camera.cx_px", camera.cx_px),
            ("camera.cy_px", camera.cy_px),
            ("camera.k1", camera.k1),
            ("camera.k2", camera.k2),
            ("camera.p1", camera.p1),
            ("camera.p2", camera.p2),
            ("camera.k3", camera.k3),
        ] {
            within(key, value, -1e6, 1e6)?;
        }
        within("photo.noise_std", photo.noise_std, 0.0, 100.0)?;
        within("photo.blur_px", photo.blur_px, 0.0, 20.0)?;
        within("photo.gain_std", photo.gain_std, 0.0, 0.3)?;
        within("photo.vignetting", photo.vignetting, 0.0, 0.95)?;
        within("photo.jpeg_quality", f64::from(photo.jpeg_quality), 1.0, 100.0)?;
        within("flight.strips", f64::from(flight.strips), 1.0, 500.0)?;
        within("flight.frames_per_strip", f64::from(flight.frames_per_strip), 1.0, 5000.0)?;
        within("flight.height_above_ground_m", flight.height_above_ground_m, 1.0, 1e4)?;
        if relief.shape == ReliefShape::Hills {
            within(
                "flight.height_above_ground_m",
                flight.height_above_ground_m,
                1.5 * relief.amplitude_m,
                1e4,
            )?;
        }
        within("flight.speed_m_s", flight.speed_m_s, 0.1, 300.0)?;
        for (key, value) in
            [("flight.forward_overlap", flight.forward_overlap), ("flight.side_overlap", flight.side_overlap)]
        {
            value.map_or(Ok(()), |value| within(key, value, 0.0, 0.98))?;
        }
        for (key, value) in [
            ("flight.photo_spacing_m", flight.photo_spacing_m),
            ("flight.strip_spacing_m", flight.strip_spacing_m),
        ] {
            value.map_or(Ok(()), |value| within(key, value, 0.1, 1e4))?;
        }
        exclusive(
            "flight.forward_overlap",
            flight.forward_overlap,
            "flight.photo_spacing_m",
            flight.photo_spacing_m,
        )?;
        exclusive(
            "flight.side_overlap",
            flight.side_overlap,
            "flight.strip_spacing_m",
            flight.strip_spacing_m,
        )?;
        exclusive(
            "adahrs.position_cep_m",
            adahrs.position_cep_m,
            "adahrs.position_std_m",
            adahrs.position_std_m,
        )?;
        for (key, value) in [
            ("flight.heading_deg", flight.heading_deg),
            ("mounting.gimbal_pan_deg", mounting.gimbal_pan_deg),
            ("mounting.gimbal_roll_deg", mounting.gimbal_roll_deg),
            ("mounting.boresight_yaw_deg", mounting.boresight_yaw_deg),
        ] {
            within(key, value, -360.0, 360.0)?;
        }
        for (key, value) in [
            ("flight.roll_deg", flight.roll_deg),
            ("flight.pitch_deg", flight.pitch_deg),
            ("flight.crab_deg", flight.crab_deg),
            ("mounting.gimbal_elevation_deg", mounting.gimbal_elevation_deg),
            ("mounting.boresight_roll_deg", mounting.boresight_roll_deg),
            ("mounting.boresight_pitch_deg", mounting.boresight_pitch_deg),
        ] {
            within(key, value, -90.0, 90.0)?;
        }
        for (key, value) in [
            ("flight.roll_wander_deg", flight.roll_wander_deg),
            ("flight.pitch_wander_deg", flight.pitch_wander_deg),
            ("flight.yaw_wander_deg", flight.yaw_wander_deg),
            ("adahrs.roll_std_deg", adahrs.roll_std_deg),
            ("adahrs.pitch_std_deg", adahrs.pitch_std_deg),
            ("adahrs.heading_std_deg", adahrs.heading_std_deg),
        ] {
            within(key, value, 0.0, 20.0)?;
        }
        for (key, value) in [
            ("adahrs.position_cep_m", adahrs.position_cep_m.unwrap_or(0.0)),
            ("adahrs.position_std_m", adahrs.position_std_m.unwrap_or(0.0)),
            ("adahrs.height_std_m", adahrs.height_std_m),
            ("adahrs.correlation_time_s", adahrs.correlation_time_s),
        ] {
            within(key, value, 0.0, 1000.0)?;
        }
        within("adahrs.clock_offset_s", adahrs.clock_offset_s, -10.0, 10.0)?;
        within("adahrs.track_rate_hz", adahrs.track_rate_hz, 0.1, 1000.0)?;
        for (key, arm) in [
            ("mounting.antenna_in_body_m", mounting.antenna_in_body_m),
            ("mounting.gimbal_in_body_m", mounting.gimbal_in_body_m),
            ("mounting.camera_in_gimbal_m", mounting.camera_in_gimbal_m),
        ] {
            arm.iter().try_for_each(|&value| within(key, value, -100.0, 100.0))?;
        }
        within("calibration.views", f64::from(calibration.views), 0.0, 200.0)?;
        within("calibration.tilt_deg", calibration.tilt_deg[0], 0.0, 60.0)?;
        within("calibration.tilt_deg", calibration.tilt_deg[1], calibration.tilt_deg[0], 60.0)?;
        within("calibration.fill", calibration.fill[0], 0.1, 0.95)?;
        within("calibration.fill", calibration.fill[1], calibration.fill[0], 0.95)?;
        within("calibration.noise_std", calibration.noise_std, 0.0, 100.0)?;
        within("calibration.blur_px", calibration.blur_px, 0.0, 20.0)
    }
}

fn within(key: &'static str, value: f64, low: f64, high: f64) -> Result<(), SyntheticError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(SyntheticError::Value { key, value, low, high }) }
}

fn exclusive(
    first: &'static str,
    a: Option<f64>,
    second: &'static str,
    b: Option<f64>,
) -> Result<(), SyntheticError> {
    if a.is_some() && b.is_some() { Err(SyntheticError::Both { first, second }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scenario_survives_its_own_toml() {
        for scenario in [Scenario::demo(), Scenario::paper_flight(), Scenario::default()] {
            let text = toml::to_string(&scenario).unwrap();
            assert_eq!(toml::from_str::<Scenario>(&text).unwrap(), scenario);
            scenario.validate().unwrap();
        }
    }

    #[test]
    fn an_unknown_key_is_refused() {
        let error = toml::from_str::<Scenario>("[flight]\nheight_m = 100.0\n").unwrap_err();
        assert!(error.to_string().contains("height_m"), "{error}");
    }

    #[test]
    fn a_senseless_value_is_named_with_its_limits() {
        let mut scenario = Scenario::demo();
        scenario.site.latitude_deg = 91.0;
        assert_eq!(
            scenario.validate().unwrap_err().to_string(),
            "site.latitude_deg is 91, allowed is -89 to 89"
        );
        let mut scenario = Scenario::demo();
        scenario.adahrs.height_std_m = f64::NAN;
        assert!(scenario.validate().unwrap_err().to_string().starts_with("adahrs.height_std_m is NaN"));
        let mut scenario = Scenario::demo();
        scenario.flight.photo_spacing_m = Some(100.0);
        assert!(matches!(scenario.validate(), Err(SyntheticError::Both { .. })));
    }
}
