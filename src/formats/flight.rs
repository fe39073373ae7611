//! What a flight's log or a photo's metadata says: values in SI units and our senses, each with its frame, datum and
//! clock, before datums, map grids and the mounting are applied.
//!
//! Every reader below takes bytes and gives a [`FlightLog`]; none touches a file. A record that cannot be used takes
//! only itself along: it is listed in [`FlightLog::bad`] with its place and the reason.

mod angles;
mod autopilot;
mod columns;
pub mod dataflash;
mod declared;
pub mod geo_txt;
pub mod geoinfo;
mod json;
pub mod mrk;
pub mod opensfm;
pub mod orientation;
mod poses;
pub mod rtklib;
pub mod sbet;
mod text;
pub mod tlog;
pub mod ulog;

pub use angles::{AngleSystem, AngleUnit};
pub use columns::Column;
pub use declared::Declared;

use crate::camera::PixelRotation;
use crate::geodesy::{HeightKind, MapPoint};
use crate::geometry::attitude::{OmegaPhiKappa, YawPitchRoll};
use crate::geometry::{Camera, Displacement, Ecef, Ned, Point, Rotation};
use crate::navigation::{GimbalAngles, GimbalReference};

pub use crate::navigation::Sample;
use crate::units::{Radians, Seconds};
use std::sync::Arc;

/// The clock that times of a log count on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// UTC: seconds since 1970-01-01T00:00:00Z, leap seconds not counted (Unix time).
    Utc,
    /// Seconds of a GPS week that the file does not name, on GPS time.
    GpsWeek,
    /// Seconds since the unit was switched on, or since an instant nobody stated.
    Own,
    /// Civil time of a zone that nobody stated: seconds since 1970-01-01 as the clock on the wall showed them.
    Local,
}

/// A position as the log states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LoggedPosition {
    /// WGS 84 latitude and longitude, and a height.
    Geodetic {
        /// Positive north.
        latitude: Radians,
        /// Positive east.
        longitude: Radians,
        /// Metres above what `kind` says.
        height_m: f64,
        /// What the height is measured from.
        kind: HeightKind,
    },
    /// Easting and northing in the log's CRS, and a height.
    Projected {
        /// In [`FlightLog::crs`], or the one declared for the log.
        map: MapPoint,
        /// Metres above what `kind` says.
        height_m: f64,
        /// What the height is measured from.
        kind: HeightKind,
    },
    /// WGS 84, Earth-centred.
    Ecef(Point<Ecef>),
}

/// The direction that a yaw or heading is counted from, clockwise seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum North {
    /// True north.
    True,
    /// Magnetic north: the declination is still to be added.
    Magnetic,
    /// Grid north of the log's CRS: the convergence is still to be added.
    Grid,
    /// True north, but the angle is the direction of travel, not that of the nose.
    Course,
}

/// An attitude as the log states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LoggedAttitude {
    /// Of the UAV: yaw clockwise from `north`, pitch nose up, roll right wing down.
    Body {
        /// `Rz(yaw)·Ry(pitch)·Rx(roll)`.
        angles: YawPitchRoll,
        /// What yaw is counted from.
        north: North,
    },
    /// Of the camera, as that of a body whose nose is the top of the image and which carries the camera looking straight
    /// down: all angles zero is a level photo with its top to the north; pitch +90° looks at the horizon.
    Camera {
        /// `Rz(yaw)·Ry(pitch)·Rx(roll)` of that body.
        angles: YawPitchRoll,
        /// What yaw is counted from.
        north: North,
    },
    /// Of the camera against the grid of the log's CRS (east, north, up), by photogrammetric angles.
    CameraOnGrid(OmegaPhiKappa),
    /// Of the camera (x right, y down, z forward) in north-east-down at the stated position.
    CameraInNed(Rotation<Ned, Camera>),
}

/// Gimbal angles as the log states them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoggedGimbal {
    /// Pan clockwise, elevation up (-90° looks straight down), roll clockwise along the optical axis.
    pub angles: GimbalAngles,
    /// What they are counted from.
    pub reference: GimbalReference,
}

/// Standard deviations that the log itself states, one sigma.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LoggedStd {
    /// Position towards north, metres.
    pub north_m: Option<f64>,
    /// Position towards east, metres.
    pub east_m: Option<f64>,
    /// Height, metres.
    pub up_m: Option<f64>,
    /// Yaw.
    pub yaw: Option<Radians>,
    /// Pitch.
    pub pitch: Option<Radians>,
    /// Roll.
    pub roll: Option<Radians>,
}

/// What a number of the log was read from, and by which convention.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Origin {
    /// What it is: "latitude", "height", "yaw", "gimbal elevation", "time", …
    pub quantity: &'static str,
    /// The tag, column or field, with its unit: "drone-dji:GimbalPitchDegree, degrees", "GPS.Alt, metres".
    pub from: String,
    /// What was understood: "above mean sea level (EGM96): the autopilot's filtered height".
    pub meaning: String,
}

/// One exposure: a photo's own record, or a trigger event of the log.
#[derive(Debug, Clone, PartialEq)]
pub struct Exposure {
    /// Place in the file: line of a text, number of the record otherwise; from 1. A photo's own metadata: 1.
    pub place: u64,
    /// The photo's file name, when the record names it.
    pub frame: Option<String>,
    /// The camera's or autopilot's own number of the exposure.
    pub sequence: Option<u64>,
    /// On the log's [`Clock`].
    pub time: Option<Seconds>,
    /// Where the antenna (or, with a camera's attitude, the projection centre) was.
    pub position: Option<LoggedPosition>,
    /// Attitude.
    pub attitude: Option<LoggedAttitude>,
    /// Gimbal angles.
    pub gimbal: Option<LoggedGimbal>,
    /// Height above the ground below, metres.
    pub height_above_ground_m: Option<f64>,
    /// Height above the take-off point, metres, when stated beside the position's own height.
    pub height_above_takeoff_m: Option<f64>,
    /// Speed over ground, m/s.
    pub ground_speed_m_s: Option<f64>,
    /// Velocity, m/s.
    pub velocity: Option<Displacement<Ned>>,
    /// How the stored pixels were turned after the camera wrote them, when the record says so.
    pub pixel_rotation: Option<PixelRotation>,
    /// What the record says its own values are worth.
    pub std: LoggedStd,
    /// From the antenna to the camera in north-east-down, when the record states it (DJI .MRK); not yet applied.
    pub camera_from_antenna: Option<Displacement<Ned>>,
    /// Where each number came from.
    pub origins: Arc<[Origin]>,
}

impl Exposure {
    /// A record at a place of the file that says nothing yet.
    #[must_use]
    pub fn at(place: u64) -> Self {
        Self {
            place,
            frame: None,
            sequence: None,
            time: None,
            position: None,
            attitude: None,
            gimbal: None,
            height_above_ground_m: None,
            height_above_takeoff_m: None,
            ground_speed_m_s: None,
            velocity: None,
            pixel_rotation: None,
            std: LoggedStd::default(),
            camera_from_antenna: None,
            origins: Arc::new([]),
        }
    }
}

/// A record that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BadRecord {
    /// Place in the file, as [`Exposure::place`].
    pub place: u64,
    /// The photo it names, if it does.
    pub frame: Option<String>,
    /// Why.
    pub cause: String,
}

/// A log, read: series in time, exposures, or both.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightLog {
    /// The clock of every time below.
    pub clock: Clock,
    /// CRS of projected positions and of grid angles, when the file states it: "EPSG:n", WKT or a PROJ string.
    pub crs: Option<String>,
    /// The antenna's positions, in the file's order.
    pub positions: Vec<Sample<LoggedPosition>>,
    /// The UAV's attitudes.
    pub attitudes: Vec<Sample<LoggedAttitude>>,
    /// Gimbal angles.
    pub gimbals: Vec<Sample<LoggedGimbal>>,
    /// Velocities, m/s.
    pub velocities: Vec<Sample<Displacement<Ned>>>,
    /// Heights above the ground below, metres.
    pub heights_above_ground: Vec<Sample<f64>>,
    /// Photos and triggers, in the file's order.
    pub exposures: Vec<Exposure>,
    /// What cannot be used.
    pub bad: Vec<BadRecord>,
    /// What was understood and assumed, for the user: sentences.
    pub notes: Vec<String>,
    /// Where the numbers of the series came from.
    pub origins: Vec<Origin>,
}

impl FlightLog {
    /// A log without a record.
    #[must_use]
    pub const fn new(clock: Clock) -> Self {
        Self {
            clock,
            crs: None,
            positions: Vec::new(),
            attitudes: Vec::new(),
            gimbals: Vec::new(),
            velocities: Vec::new(),
            heights_above_ground: Vec::new(),
            exposures: Vec::new(),
            bad: Vec::new(),
            notes: Vec::new(),
            origins: Vec::new(),
        }
    }
}

/// Why bytes are no log of the kind expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadError {
    /// Line of a text, when one line is to blame.
    pub line: Option<u64>,
    /// What is wrong: a lowercase fragment with the numbers in it.
    pub cause: String,
    /// The next step, when there is an obvious one.
    pub help: Option<String>,
}

impl ReadError {
    /// An error of the whole file.
    pub fn new(cause: impl Into<String>) -> Self {
        Self { line: None, cause: cause.into(), help: None }
    }
    /// Names the line.
    #[must_use]
    pub fn line(self, line: u64) -> Self {
        Self { line: Some(line), ..self }
    }
    /// Adds the next step.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }
}

/// A WGS 84 position that an aircraft can have.
///
/// # Errors
/// Words for coordinates that are not finite, out of range or both zero (no fix), and for heights no UAV flies at.
pub fn geodetic(
    latitude: Radians,
    longitude: Radians,
    height_m: f64,
    kind: HeightKind,
) -> Result<LoggedPosition, String> {
    // Values that are not finite lie in no range.
    if !(-90.0..=90.0).contains(&latitude.degrees()) {
        return Err(format!("latitude {}° lies outside ±90°", latitude.degrees()));
    }
    if !(-360.0..=360.0).contains(&longitude.degrees()) {
        return Err(format!("longitude {}° lies outside ±360°", longitude.degrees()));
    }
    if latitude.get() == 0.0 && longitude.get() == 0.0 {
        return Err("latitude and longitude are both 0, as receivers write without a fix".to_owned());
    }
    let height_m = plausible_height(height_m)?;
    Ok(LoggedPosition::Geodetic { latitude, longitude: longitude.wrapped(), height_m, kind })
}

/// Between the Dead Sea's bed and the stratosphere; beyond, the unit or the column is wrong.
///
/// # Errors
/// Words for a height outside, or not finite.
pub fn plausible_height(height_m: f64) -> Result<f64, String> {
    if (-1_000.0..60_000.0).contains(&height_m) {
        Ok(height_m)
    } else {
        Err(format!("height {height_m} m is not one an aircraft flies at"))
    }
}

/// Attitude angles within the ranges that files use.
///
/// # Errors
/// Words for an angle that is not finite or so large that its unit must be wrong.
pub fn plausible_angles(angles: YawPitchRoll) -> Result<YawPitchRoll, String> {
    let YawPitchRoll { yaw, pitch, roll } = angles;
    for (name, angle, limit) in [("yaw", yaw, 720.0), ("pitch", pitch, 180.0), ("roll", roll, 360.0)] {
        if !(-limit..=limit).contains(&angle.degrees()) {
            return Err(format!(
                "{name} {:.1}° lies outside ±{limit:.0}°: is its unit right?",
                angle.degrees()
            ));
        }
    }
    Ok(YawPitchRoll::new(yaw.wrapped(), pitch, roll.wrapped()))
}

/// A speed that a UAV can have, m/s.
///
/// # Errors
/// Words for one that is not finite or beyond 200 m/s.
pub fn plausible_speed(speed_m_s: f64) -> Result<f64, String> {
    if speed_m_s.abs() <= 200.0 {
        Ok(speed_m_s)
    } else {
        Err(format!("a speed of {speed_m_s} m/s is not one of a UAV"))
    }
}

/// GPS seconds at which each leap second since 1999 took effect, and UTC's lag from then on.
const LEAPS: [(f64, f64); 6] = [
    (0.0, 13.0),
    (820_108_814.0, 14.0),
    (914_803_215.0, 15.0),
    (1_025_136_016.0, 16.0),
    (1_119_744_017.0, 17.0),
    (1_167_264_018.0, 18.0),
];
/// 1980-01-06T00:00:00Z, where GPS time begins.
const GPS_EPOCH_UNIX: f64 = 315_964_800.0;
const WEEK_S: f64 = 604_800.0;

/// UTC (Unix seconds) of a GPS week and second, leap seconds taken off.
///
/// # Errors
/// Words for a second outside the week or a week before GPS time came into use with UAVs.
pub fn utc_from_gps(week: u32, second_of_week: f64) -> Result<Seconds, String> {
    if !(0.0..WEEK_S).contains(&second_of_week) {
        return Err(format!("{second_of_week} s is no second of a GPS week"));
    }
    // Week 1200 is January 2003; week 4000 is 2056.
    if !(1200..4000).contains(&week) {
        return Err(format!("GPS week {week} lies outside 1200 to 4000"));
    }
    let gps = f64::from(week) * WEEK_S + second_of_week;
    let lag = LEAPS.iter().rev().find(|(from, _)| gps >= *from).map_or(13.0, |(_, lag)| *lag);
    Ok(Seconds::new(GPS_EPOCH_UNIX + gps - lag))
}

/// Second of the GPS week of an instant of UTC (Unix seconds).
#[must_use]
pub fn gps_week_second(utc: Seconds) -> Seconds {
    // Leap seconds are few: the one that holds a second earlier holds here, but for that very second.
    let lag = LEAPS.iter().rev().find(|(from, lag)| utc.get() - GPS_EPOCH_UNIX + lag >= *from);
    let gps = utc.get() - GPS_EPOCH_UNIX + lag.map_or(13.0, |(_, lag)| *lag);
    Seconds::new(gps.rem_euclid(WEEK_S))
}

#[cfg(test)]
mod golden;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gps_time_becomes_utc() {
        // 2017-01-01T00:00:00Z = GPS 1167264018 s; 2013-06-04T17:38:09Z = week 1743, second 236305 (UTC + 16 s).
        let unix = |week, second| utc_from_gps(week, second).unwrap().get();
        assert_eq!(unix(1930, 18.0), 1_483_228_800.0);
        assert_eq!(unix(1930, 16.0), 1_483_228_799.0);
        assert_eq!(unix(1743, 236_305.0), 1_370_367_489.0);
        assert!(utc_from_gps(10, 0.0).is_err() && utc_from_gps(2300, 604_800.0).is_err());
        assert!(utc_from_gps(2300, f64::NAN).is_err());
        for (week, second) in [(1930, 18.0), (1930, 16.0), (1743, 236_305.0), (2300, 0.0)] {
            assert_eq!(gps_week_second(utc_from_gps(week, second).unwrap()).get(), second);
        }
    }

    #[test]
    fn what_no_aircraft_can_be_is_refused() {
        let deg = Radians::from_degrees;
        let at = |lat, lon, h| geodetic(deg(lat), deg(lon), h, HeightKind::Ellipsoid);
        assert!(at(41.0, -83.0, 300.0).is_ok());
        for (lat, lon, h) in [
            (91.0, 0.0, 0.0),
            (f64::NAN, 3.0, 0.0),
            (3.0, f64::INFINITY, 0.0),
            (0.0, 0.0, 10.0),
            (3.0, 3.0, f64::NAN),
            (3.0, 3.0, 1e6),
        ] {
            assert!(at(lat, lon, h).is_err(), "{lat} {lon} {h}");
        }
        assert!(plausible_angles(YawPitchRoll::from_degrees(0.0, f64::NAN, 0.0)).is_err());
        assert!(plausible_speed(300.0).is_err() && plausible_speed(f64::NAN).is_err());
    }
}
