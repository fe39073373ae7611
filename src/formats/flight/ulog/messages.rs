//! Which fields of which topics are read, and what becomes of one message.

use super::super::autopilot::{angles_of_quaternion, yaw_is_from_north};
use super::super::{
    Exposure, LoggedAttitude, North, Origin, Sample, geodetic, plausible_angles, plausible_speed,
};
use super::container::{Field, Kind, Layout};
use super::{Collected, GimbalRow, PositionRow, Shot};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Ned};
use crate::navigation::GimbalAngles;
use crate::units::{Radians, Seconds};

/// The topics that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Topic {
    Attitude,
    Global,
    Gps,
    SensorGps,
    Local,
    Capture,
    Trigger,
    Gimbal,
    Mount,
}

impl Topic {
    pub(super) fn of(name: &str) -> Option<Self> {
        Some(match name {
            "vehicle_attitude" => Self::Attitude,
            "vehicle_global_position" => Self::Global,
            "vehicle_gps_position" => Self::Gps,
            "sensor_gps" => Self::SensorGps,
            "vehicle_local_position" => Self::Local,
            "camera_capture" => Self::Capture,
            "camera_trigger" => Self::Trigger,
            "gimbal_device_attitude_status" => Self::Gimbal,
            "mount_orientation" => Self::Mount,
            _ => return None,
        })
    }
}

/// Whether a topic is read.
pub(super) fn is_wanted(topic: &str) -> bool {
    Topic::of(topic).is_some()
}

/// A number with the factor that brings it to its SI unit or to degrees.
#[derive(Debug, Clone, Copy)]
struct Scaled(Field, f64);

impl Scaled {
    fn get(self, body: &[u8]) -> Option<f64> {
        Some(self.0.number(body)? * self.1)
    }
    /// The old integer field, or the new one in floating point: by name and type.
    fn of(layout: &Layout, old: &str, unit: f64, new: &str) -> Option<Self> {
        let integer = |f: &Field| !matches!(f.kind, Kind::F32 | Kind::F64);
        match layout.field(old) {
            Some(field) if integer(&field) => Some(Self(field, unit)),
            Some(field) => Some(Self(field, 1.0)),
            None => Some(Self(layout.field(new)?, 1.0)),
        }
    }
}

/// A flag that holds when the topic has no such field.
#[derive(Debug, Clone, Copy)]
struct Flag(Option<Field>);

impl Flag {
    fn holds(self, body: &[u8]) -> bool {
        self.0.is_none_or(|f| f.number(body).is_some_and(|v| v != 0.0))
    }
}

#[derive(Debug, Clone, Copy)]
struct Time {
    logged: Field,
    sampled: Option<Field>,
}

impl Time {
    /// The instant the values hold for, seconds: `timestamp_sample` where it is filled in.
    fn get(&self, body: &[u8]) -> Option<Seconds> {
        let logged = self.logged.number(body)?;
        let sampled = self.sampled.and_then(|f| f.number(body));
        let us = sampled.filter(|s| *s > 0.0 && (0.0..1e6).contains(&(logged - s))).unwrap_or(logged);
        Some(Seconds::new(us * 1e-6))
    }
}

#[derive(Debug, Clone, Copy)]
struct Gps {
    place: [Scaled; 3],
    ellipsoid: Option<Scaled>,
    fix: Field,
    utc: Option<Field>,
    utc_behind: Option<Field>,
    ned: Option<[Field; 3]>,
    ned_valid: Flag,
}

#[derive(Debug, Clone, Copy)]
struct Global {
    place: [Field; 3],
    ellipsoid: Option<Field>,
    valid: [Flag; 2],
    ellipsoid_valid: Option<Field>,
}

#[derive(Debug, Clone, Copy)]
struct Local {
    xyz: [Field; 3],
    reference: [Field; 3],
    valid: [Flag; 4],
    ned: [Field; 3],
    ned_valid: [Flag; 2],
    bottom: Option<(Field, Field)>,
}

#[derive(Debug, Clone, Copy)]
struct Capture {
    sequence: Option<Field>,
    place: [Field; 3],
    ground: Option<Field>,
    q: Option<[Field; 4]>,
    result: Option<Field>,
}

#[derive(Debug, Clone, Copy)]
enum What {
    Attitude([Field; 4]),
    Global(Global),
    Gps(Gps),
    Local(Local),
    Capture(Capture),
    Trigger { sequence: Option<Field>, feedback: Option<Field> },
    Gimbal { q: [Field; 4], flags: Option<Field> },
    Mount([Field; 3]),
}

/// What is done with the messages of one subscription.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    slot: usize,
    time: Time,
    what: What,
}

impl Plan {
    /// By the names of the fields; `None` for a topic that lacks what is needed.
    pub(super) fn of(topic: Topic, layout: &Layout, slot: usize) -> Option<Self> {
        let field = |name| layout.field(name);
        let three = |a, b, c| Some([field(a)?, field(b)?, field(c)?]);
        let flag = |name| Flag(field(name));
        let time = Time { logged: field("timestamp")?, sampled: field("timestamp_sample") };
        let what = match topic {
            Topic::Attitude => What::Attitude(layout.array("q")?),
            Topic::Global => What::Global(Global {
                place: three("lat", "lon", "alt")?,
                ellipsoid: field("alt_ellipsoid"),
                valid: [flag("lat_lon_valid"), flag("alt_valid")],
                ellipsoid_valid: field("alt_ellipsoid_valid"),
            }),
            Topic::Gps | Topic::SensorGps => What::Gps(Gps {
                place: [
                    Scaled::of(layout, "lat", 1e-7, "latitude_deg")?,
                    Scaled::of(layout, "lon", 1e-7, "longitude_deg")?,
                    Scaled::of(layout, "alt", 1e-3, "altitude_msl_m")?,
                ],
                ellipsoid: Scaled::of(layout, "alt_ellipsoid", 1e-3, "altitude_ellipsoid_m"),
                fix: field("fix_type")?,
                utc: field("time_utc_usec"),
                utc_behind: field("timestamp_time_relative"),
                ned: three("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"),
                ned_valid: flag("vel_ned_valid"),
            }),
            Topic::Local => What::Local(Local {
                xyz: three("x", "y", "z")?,
                reference: three("ref_lat", "ref_lon", "ref_alt")?,
                valid: [flag("xy_valid"), flag("z_valid"), flag("xy_global"), flag("z_global")],
                ned: three("vx", "vy", "vz")?,
                ned_valid: [flag("v_xy_valid"), flag("v_z_valid")],
                bottom: field("dist_bottom").zip(field("dist_bottom_valid")),
            }),
            Topic::Capture => What::Capture(Capture {
                sequence: field("seq"),
                place: three("lat", "lon", "alt")?,
                ground: field("ground_distance"),
                q: layout.array("q"),
                result: field("result"),
            }),
            Topic::Trigger => What::Trigger { sequence: field("seq"), feedback: field("feedback") },
            Topic::Gimbal => What::Gimbal { q: layout.array("q")?, flags: field("device_flags") },
            Topic::Mount => What::Mount(layout.array("attitude_euler_angle")?),
        };
        Some(Self { slot, time, what })
    }

    /// Reads one message into the collection; a bad one is set aside.
    pub(super) fn run(&self, place: u64, body: &[u8], to: &mut Collected) {
        if self.try_run(place, body, to).is_none() {
            to.quarantine.add(place, format!("a message of {} bytes lacks fields of its topic", body.len()));
        }
    }

    fn try_run(&self, place: u64, body: &[u8], to: &mut Collected) -> Option<()> {
        let time = self.time.get(body)?;
        match &self.what {
            What::Attitude(q) => {
                let angles = angles_of_quaternion(numbers(*q, body)?);
                if let Some(angles) = to.quarantine.keep(place, "vehicle_attitude", angles) {
                    let value = LoggedAttitude::Body { angles, north: North::True };
                    to.rows[self.slot].2.attitudes.push(Sample { place, time, value });
                }
            }
            What::Global(global) => self.global(global, (place, time), body, to)?,
            What::Gps(gps) => self.gps(gps, (place, time), body, to)?,
            What::Local(local) => self.local(local, (place, time), body, to)?,
            What::Capture(capture) => self.capture(capture, place, body, to)?,
            What::Trigger { sequence, feedback } => {
                let time = Seconds::new(self.time.logged.number(body)? * 1e-6);
                let mut exposure = Exposure::at(place);
                exposure.time = Some(time);
                exposure.sequence = sequence.and_then(|f| f.number(body)).map(|n| n as u64);
                let feedback = feedback.and_then(|f| f.number(body)).is_some_and(|v| v != 0.0);
                self.shoot(Shot { exposure, time, angles: None, feedback }, to);
            }
            What::Gimbal { q, flags } => {
                let flags = flags.and_then(|f| f.number(body)).map_or(0, |f| f as u32);
                let angles = angles_of_quaternion(numbers(*q, body)?);
                if let Some(a) = to.quarantine.keep(place, "gimbal_device_attitude_status", angles) {
                    self.gimbal(a, yaw_is_from_north(flags), (place, time), to);
                }
            }
            What::Mount(euler) => {
                let [roll, pitch, yaw] = numbers(*euler, body)?.map(Radians::new);
                let angles = plausible_angles(YawPitchRoll::new(yaw, pitch, roll));
                if let Some(a) = to.quarantine.keep(place, "mount_orientation", angles) {
                    self.gimbal(a, false, (place, time), to);
                }
            }
        }
        Some(())
    }

    fn shoot(&self, shot: Shot, to: &mut Collected) {
        let shots = &mut to.rows[self.slot].2.shots;
        if to.quarantine.has_room(shot.exposure.place, shots.len()) {
            shots.push(shot);
        }
    }

    fn gimbal(&self, a: YawPitchRoll, from_north: bool, (place, time): (u64, Seconds), to: &mut Collected) {
        let angles = GimbalAngles { pan: a.yaw, elevation: a.pitch, roll: a.roll };
        let value = GimbalRow { angles, from_north };
        to.rows[self.slot].2.gimbals.push(Sample { place, time, value });
    }

    fn global(
        &self,
        g: &Global,
        (place, time): (u64, Seconds),
        body: &[u8],
        to: &mut Collected,
    ) -> Option<()> {
        let rows = &mut to.rows[self.slot].2;
        let [lat, lon, alt] = numbers(g.place, body)?;
        if !g.valid.iter().all(|f| f.holds(body)) {
            rows.invalid += 1;
            return Some(());
        }
        let stated = g.ellipsoid_valid.is_none_or(|f| f.number(body) == Some(1.0));
        let ellipsoid_m = g.ellipsoid.filter(|_| stated).and_then(|f| f.number(body));
        rows.positions.push(Sample { place, time, value: row(lat, lon, alt, ellipsoid_m) });
        Some(())
    }

    fn gps(&self, g: &Gps, (place, time): (u64, Seconds), body: &[u8], to: &mut Collected) -> Option<()> {
        let rows = &mut to.rows[self.slot].2;
        if g.fix.number(body)? < 3.0 {
            rows.invalid += 1;
            return Some(());
        }
        if let Some(utc_us) = g.utc.and_then(|f| f.number(body)) {
            let behind_us = g.utc_behind.and_then(|f| f.number(body)).unwrap_or(0.0);
            to.fit.add((self.time.logged.number(body)? + behind_us) * 1e-6, utc_us * 1e-6);
        }
        let [lat, lon, alt] = g.place;
        let ellipsoid_m = g.ellipsoid.and_then(|f| f.get(body));
        let value = row(lat.get(body)?, lon.get(body)?, alt.get(body)?, ellipsoid_m);
        rows.positions.push(Sample { place, time, value });
        if let Some(ned) = g.ned.filter(|_| g.ned_valid.holds(body)) {
            let velocity = velocity(numbers(ned, body)?);
            if let Some(value) = to.quarantine.keep(place, "velocity of the receiver", velocity) {
                rows.velocities.push(Sample { place, time, value });
            }
        }
        Some(())
    }

    fn local(&self, l: &Local, (place, time): (u64, Seconds), body: &[u8], to: &mut Collected) -> Option<()> {
        let rows = &mut to.rows[self.slot].2;
        let [x, y, z] = numbers(l.xyz, body)?;
        let [ref_lat, ref_lon, ref_alt] = numbers(l.reference, body)?;
        if l.valid.iter().all(|f| f.holds(body)) {
            let (lat, lon) = unprojected(ref_lat, ref_lon, x, y);
            rows.positions.push(Sample { place, time, value: row(lat, lon, ref_alt - z, None) });
        } else {
            rows.invalid += 1;
        }
        if l.ned_valid.iter().all(|f| f.holds(body)) {
            let velocity = velocity(numbers(l.ned, body)?);
            if let Some(value) = to.quarantine.keep(place, "vehicle_local_position", velocity) {
                rows.velocities.push(Sample { place, time, value });
            }
        }
        if let Some((distance, valid)) = l.bottom {
            let value = distance.number(body)?;
            if valid.number(body)? != 0.0 && (0.0..10_000.0).contains(&value) {
                rows.heights_m.push(Sample { place, time, value });
            }
        }
        Some(())
    }

    /// An exposure stays an exposure without a usable position or attitude: its time still counts.
    fn capture(&self, c: &Capture, place: u64, body: &[u8], to: &mut Collected) -> Option<()> {
        let time = Seconds::new(self.time.logged.number(body)? * 1e-6);
        let mut exposure = Exposure::at(place);
        exposure.time = Some(time);
        exposure.sequence = c.sequence.and_then(|f| f.number(body)).map(|n| n as u64);
        match c.result.and_then(|f| f.number(body)) {
            Some(0.0) => {
                let sequence = exposure.sequence.unwrap_or(0);
                to.quarantine.add(place, format!("camera_capture: photo {sequence} failed (result 0)"));
                return Some(());
            }
            Some(result) if result < 0.0 => to.without_feedback += 1,
            _ => {}
        }
        let [lat, lon, alt] = numbers(c.place, body)?;
        let (lat, lon) = (Radians::from_degrees(lat), Radians::from_degrees(lon));
        let position = geodetic(lat, lon, alt, HeightKind::SeaLevel(GeoidModel::Egm96));
        exposure.position = to.quarantine.keep(place, "camera_capture", position);
        // −1 stands for unknown.
        exposure.height_above_ground_m =
            c.ground.and_then(|f| f.number(body)).filter(|h| (0.0..10_000.0).contains(h));
        let angles = c.q.and_then(|q| numbers(q, body)).map(angles_of_quaternion);
        let angles = angles.and_then(|a| to.quarantine.keep(place, "camera_capture", a));
        self.shoot(Shot { exposure, time, angles, feedback: true }, to);
        Some(())
    }
}

fn numbers<const N: usize>(fields: [Field; N], body: &[u8]) -> Option<[f64; N]> {
    let mut values = [0.0; N];
    for (value, field) in values.iter_mut().zip(fields) {
        *value = field.number(body)?;
    }
    Some(values)
}

/// A row in degrees and metres; an ellipsoidal height further from sea level than any geoid is not one.
fn row(latitude_deg: f64, longitude_deg: f64, sea_level_m: f64, ellipsoid_m: Option<f64>) -> PositionRow {
    PositionRow {
        latitude: Radians::from_degrees(latitude_deg),
        longitude: Radians::from_degrees(longitude_deg),
        sea_level_m,
        ellipsoid_m: ellipsoid_m.filter(|h| *h != 0.0 && (h - sea_level_m).abs() < 150.0),
    }
}

fn velocity([north, east, down]: [f64; 3]) -> Result<Displacement<Ned>, String> {
    Ok(Displacement::new(plausible_speed(north)?, plausible_speed(east)?, plausible_speed(down)?))
}

/// Latitude and longitude, degrees, of metres north and east of a reference.
///
/// # Source
/// PX4 `lib/geo`: azimuthal equidistant on a sphere of 6 371 000 m, which is how the filter made x and y.
fn unprojected(ref_lat_deg: f64, ref_lon_deg: f64, north_m: f64, east_m: f64) -> (f64, f64) {
    const RADIUS_M: f64 = 6_371_000.0;
    let (n, e) = (north_m / RADIUS_M, east_m / RADIUS_M);
    let c = n.hypot(e);
    if c == 0.0 {
        return (ref_lat_deg, ref_lon_deg);
    }
    let (sin_ref, cos_ref) = Radians::from_degrees(ref_lat_deg).get().sin_cos();
    let (sin_c, cos_c) = c.sin_cos();
    let latitude = (cos_c * sin_ref + n * sin_c * cos_ref / c).clamp(-1.0, 1.0).asin();
    let turn = (e * sin_c).atan2(c * cos_ref * cos_c - n * sin_ref * sin_c);
    (Radians::new(latitude).degrees(), ref_lon_deg + Radians::new(turn).degrees())
}

/// Where an exposure's numbers come from.
pub(super) fn exposure_origins(topic: &str, of_camera: bool) -> Vec<Origin> {
    let origin = |quantity, fields: &str, meaning: &str| Origin {
        quantity,
        from: fields.replace('#', topic),
        meaning: meaning.to_owned(),
    };
    let mut origins = vec![
        origin("time", "#.timestamp, µs since start-up", "of the trigger, or of the camera's feedback"),
        origin("sequence", "#.seq", "the autopilot's image number"),
    ];
    if topic == "camera_capture" {
        let q = if of_camera { "gimbal pan, elevation, roll" } else { "yaw, pitch, roll" };
        let whose = if of_camera {
            "of the camera: x along the optical axis, to north-east-down"
        } else {
            "of the UAV"
        };
        origins.extend([
            origin(
                "latitude, longitude",
                "#.lat, #.lon, degrees",
                "WGS 84: the filter's position of the UAV",
            ),
            origin("height", "#.alt, metres", "above mean sea level (EGM96)"),
            origin("height above ground", "#.ground_distance, metres", "by the filter's terrain estimate"),
            origin(q, "#.q (w, x, y, z)", whose),
        ]);
    }
    origins
}
