//! Which fields of which messages are read, and what becomes of one message.

use super::super::{
    Exposure, LoggedAttitude, LoggedPosition, North, Origin, Sample, geodetic, plausible_angles,
    plausible_speed, utc_from_gps,
};
use super::container::{Field, Format};
use super::{Collected, MountRow, Shot, utc_of};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Ned};
use crate::units::{Radians, Seconds};

const SEA_LEVEL: HeightKind = HeightKind::SeaLevel(GeoidModel::Egm96);

/// Time since start-up: the field and the seconds of its unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Time(Field, f64);

impl Time {
    /// By name: microseconds in `TimeUS`, milliseconds in `T` (beside a GPS time called `TimeMS`) and `TimeMS`.
    fn of(format: &Format) -> Option<Self> {
        let (field, unit) = if let Some(f) = format.field("TimeUS") {
            (f, 1e-6)
        } else if let Some(f) = format.field("T").filter(|_| format.name == "GPS") {
            (f, 1e-3)
        } else if format.name == "GPS" && format.field("Week").is_some() {
            return None; // Its TimeMS is GPS time.
        } else {
            (format.field("TimeMS")?, 1e-3)
        };
        Some(Self(field, seconds_per(field, unit)))
    }
    fn get(self, body: &[u8]) -> Option<Seconds> {
        Some(Seconds::new(self.0.number(body)? * self.1))
    }
}

/// What the scaled number is still to be multiplied by: FMTU may already have brought it to seconds.
fn seconds_per(field: Field, unit: f64) -> f64 {
    if field.scale() == 1.0 { unit } else { 1.0 }
}

/// The fields of an attitude or position that several messages share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    lat: Field,
    lng: Field,
    alt: Field,
}

impl Place {
    fn of(format: &Format) -> Option<Self> {
        Some(Self { lat: format.field("Lat")?, lng: format.field("Lng")?, alt: format.field("Alt")? })
    }
    fn get(&self, body: &[u8]) -> Result<LoggedPosition, String> {
        let read = |f: Field| f.number(body).ok_or_else(|| "a coordinate is not a number".to_owned());
        geodetic(
            Radians::from_degrees(read(self.lat)?),
            Radians::from_degrees(read(self.lng)?),
            read(self.alt)?,
            SEA_LEVEL,
        )
    }
    /// Receivers and filters write zeros before they know better.
    fn is_empty(&self, body: &[u8]) -> bool {
        self.lat.number(body) == Some(0.0) && self.lng.number(body) == Some(0.0)
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Angles {
    roll: Field,
    pitch: Field,
    yaw: Field,
}

impl Angles {
    fn of(format: &Format) -> Option<Self> {
        Some(Self {
            roll: format.any(&["Roll", "R"])?,
            pitch: format.any(&["Pitch", "P"])?,
            yaw: format.any(&["Yaw", "Y"])?,
        })
    }
    fn get(&self, body: &[u8]) -> Result<LoggedAttitude, String> {
        let read = |f: Field| f.degrees(body).ok_or_else(|| "an angle is not a number".to_owned());
        let angles = YawPitchRoll::from_degrees(read(self.yaw)?, read(self.pitch)?, read(self.roll)?);
        Ok(LoggedAttitude::Body { angles: plausible_angles(angles)?, north: North::True })
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Gps {
    time: Option<Time>,
    instance: Option<Field>,
    status: Field,
    place: Place,
    week: Option<Field>,
    gps_ms: Option<Field>,
    gps_scale: f64,
    speed: Option<Field>,
    course: Option<Field>,
    down: Option<Field>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Cam {
    time: Option<Time>,
    camera: Option<Field>,
    image: Option<Field>,
    place: Option<Place>,
    angles: Option<Angles>,
    above_takeoff: Option<Field>,
    pub(super) week: Option<Field>,
    pub(super) gps_ms: Option<Field>,
    pub(super) gps_scale: f64,
}

/// What is done with one kind of message.
#[derive(Debug, Clone, Copy)]
pub(super) enum Plan {
    Skip,
    Attitude(Time, Angles),
    Filter(Time, Place),
    Backup(Time, Place, Angles),
    Gps(Gps),
    Undulation {
        instance: Option<Field>,
        ellipsoid: Field,
    },
    Velocity {
        filter: &'static str,
        time: Time,
        core: Option<Field>,
        ned: [Field; 3],
    },
    Primary(&'static str, Field),
    Mount {
        time: Time,
        instance: Option<Field>,
        roll: Field,
        pitch: Field,
        nose: Option<Field>,
        north: Option<Field>,
    },
    Range {
        time: Time,
        instance: Option<Field>,
        distance: Field,
        status: Field,
        orientation: Field,
    },
    Cam(bool, Cam),
    Parameter {
        name: usize,
        value: Field,
    },
}

impl Plan {
    /// By the message's name and the names of its fields; a message that lacks what is needed is skipped.
    pub(super) fn of(format: &Format) -> Self {
        Self::try_of(format).unwrap_or(Self::Skip)
    }

    fn try_of(format: &Format) -> Option<Self> {
        let time = || Time::of(format);
        Some(match format.name.as_str() {
            "ATT" => Self::Attitude(time()?, Angles::of(format)?),
            "POS" => Self::Filter(time()?, Place::of(format)?),
            "AHR2" => Self::Backup(time()?, Place::of(format)?, Angles::of(format)?),
            "GPS" => Self::Gps(Gps::of(format)?),
            "GPA" => Self::Undulation { instance: format.field("I"), ellipsoid: format.field("AEl")? },
            name @ ("XKF1" | "NKF1" | "EKF1") => Self::Velocity {
                filter: ["XKF1", "NKF1", "EKF1"].into_iter().find(|n| *n == name)?,
                time: time()?,
                core: format.field("C"),
                ned: [format.field("VN")?, format.field("VE")?, format.field("VD")?],
            },
            "XKF4" => Self::Primary("XKF1", format.field("PI")?),
            "NKF4" => Self::Primary("NKF1", format.field("PI")?),
            "MNT" => Self::Mount {
                time: time()?,
                instance: format.field("I"),
                roll: format.field("Roll")?,
                pitch: format.field("Pitch")?,
                nose: format.field("YawB"),
                north: format.field("YawE"),
            },
            "RFND" => Self::Range {
                time: time()?,
                instance: format.any(&["Instance", "I"]),
                distance: format.field("Dist")?,
                status: format.any(&["Stat", "Status"])?,
                orientation: format.any(&["Orient", "Orientation"])?,
            },
            "CAM" => Self::Cam(false, Cam::of(format)),
            "TRIG" => Self::Cam(true, Cam::of(format)),
            "PARM" => Self::Parameter { name: format.text_offset("Name")?, value: format.field("Value")? },
            _ => return None,
        })
    }

    /// Reads one message into the collection; a bad one is set aside.
    pub(super) fn run(&self, place: u64, body: &[u8], to: &mut Collected) {
        // Numbers that the body is too short for cannot occur: formats are checked against their length.
        let _ = self.try_run(place, body, to);
    }

    fn try_run(&self, place: u64, body: &[u8], to: &mut Collected) -> Option<()> {
        match self {
            Self::Skip => {}
            Self::Attitude(time, angles) => {
                let time = time.get(body)?;
                let value = to.quarantine.keep(place, "ATT", angles.get(body))?;
                to.attitudes.push(Sample { place, time, value });
            }
            Self::Filter(time, at) => {
                let time = time.get(body)?;
                if !at.is_empty(body) {
                    let value = to.quarantine.keep(place, "POS", at.get(body))?;
                    to.filter.push(Sample { place, time, value });
                }
            }
            Self::Backup(time, at, angles) => {
                let time = time.get(body)?;
                if let Ok(value) = angles.get(body) {
                    to.backup_attitudes.push(Sample { place, time, value });
                }
                if !at.is_empty(body) {
                    let value = to.quarantine.keep(place, "AHR2", at.get(body))?;
                    to.backup.push(Sample { place, time, value });
                }
            }
            Self::Gps(gps) => gps.run(place, body, to)?,
            Self::Undulation { instance, ellipsoid } => {
                let receiver = to.receivers.entry(number(*instance, body)).or_default();
                if let Some(LoggedPosition::Geodetic { height_m, .. }) =
                    receiver.positions.last().map(|p| p.value)
                {
                    let undulation_m = ellipsoid.number(body)? - height_m;
                    // The geoid keeps within 110 m; unknown heights are written as −2³¹.
                    if undulation_m.abs() < 150.0 {
                        receiver.undulations_m.push(undulation_m);
                    }
                }
            }
            Self::Velocity { filter, time, core, ned: [n, e, d] } => {
                let time = time.get(body)?;
                let velocity = velocity(n.number(body)?, e.number(body)?, d.number(body)?);
                let value = to.quarantine.keep(place, "velocity of the filter", velocity)?;
                let core = number(*core, body);
                to.filter_velocities.entry((filter, core)).or_default().push(Sample { place, time, value });
            }
            Self::Primary(filter, core) => {
                let core = core.number(body)? as u8;
                *to.primary_core.entry((filter, core)).or_default() += 1;
            }
            Self::Mount { time, instance, roll, pitch, nose, north } => {
                let time = time.get(body)?;
                let angle = |f: Field| f.degrees(body).filter(|a| a.abs() <= 720.0);
                let yaws = (north.and_then(angle), nose.and_then(angle));
                let (Some(roll), Some(pitch), (Some(_), _) | (_, Some(_))) =
                    (angle(*roll), angle(*pitch), yaws)
                else {
                    to.mount_without_yaw += 1;
                    return None;
                };
                let value = MountRow { roll, pitch, yaw_from_north: yaws.0, yaw_from_nose: yaws.1 };
                to.mounts.entry(number(*instance, body)).or_default().push(Sample { place, time, value });
            }
            Self::Range { time, instance, distance, status, orientation } => {
                // Status 4: in good order. Orientation 25: straight down.
                let good = status.number(body)? == 4.0 && orientation.number(body)? == 25.0;
                let (time, value) = (time.get(body)?, distance.number(body)?);
                if good && (0.0..10_000.0).contains(&value) {
                    to.ranges.entry(number(*instance, body)).or_default().push(Sample { place, time, value });
                }
            }
            Self::Cam(trigger, cam) => cam.run(*trigger, place, body, to),
            Self::Parameter { name, value } => {
                for known in ["COMPASS_AUTODEC", "COMPASS_DEC", "COMPASS_USE", "AHRS_EKF_TYPE"] {
                    let stored = body.get(*name..name + 16)?;
                    if stored.starts_with(known.as_bytes()) && stored.get(known.len()).is_none_or(|b| *b == 0)
                    {
                        to.parameters.insert(known, value.number(body)?);
                    }
                }
            }
        }
        Some(())
    }
}

/// An instance or core number; 0 where the message has none.
fn number(field: Option<Field>, body: &[u8]) -> u8 {
    field.and_then(|f| f.number(body)).map_or(0, |n| n as u8)
}

fn velocity(north: f64, east: f64, down: f64) -> Result<Displacement<Ned>, String> {
    Ok(Displacement::new(plausible_speed(north)?, plausible_speed(east)?, plausible_speed(down)?))
}

impl Gps {
    fn of(format: &Format) -> Option<Self> {
        let gps_ms = format.any(&["GMS", "TimeMS"]);
        Some(Self {
            time: Time::of(format),
            instance: format.field("I"),
            status: format.field("Status")?,
            place: Place::of(format)?,
            week: format.any(&["GWk", "Week"]),
            gps_ms,
            gps_scale: gps_ms.map_or(1e-3, |f| seconds_per(f, 1e-3)),
            speed: format.field("Spd"),
            course: format.field("GCrs"),
            down: format.field("VZ"),
        })
    }

    fn run(&self, place: u64, body: &[u8], to: &mut Collected) -> Option<()> {
        let receiver = to.receivers.entry(number(self.instance, body)).or_default();
        if self.status.number(body)? < 3.0 {
            receiver.without_fix += 1;
            return None;
        }
        let utc = || {
            let second = self.gps_ms?.number(body)? * self.gps_scale;
            utc_from_gps(self.week?.number(body)? as u32, second).ok()
        };
        let Some(time) = self.time else {
            receiver.without_time += 1;
            return None;
        };
        let time = time.get(body)?;
        if let Some(utc) = utc() {
            to.fit.add(time.get(), utc.get());
        }
        let value = to.quarantine.keep(place, "GPS", self.place.get(body))?;
        receiver.positions.push(Sample { place, time, value });
        let (speed, course) = (self.speed?.number(body)?, Radians::from_degrees(self.course?.degrees(body)?));
        let (north, east) = (speed * course.get().cos(), speed * course.get().sin());
        let down = self.down.and_then(|f| f.number(body)).unwrap_or(0.0);
        let value = to.quarantine.keep(place, "velocity of GPS", velocity(north, east, down))?;
        receiver.velocities.push(Sample { place, time, value });
        Some(())
    }
}

impl Cam {
    fn of(format: &Format) -> Self {
        let gps_ms = format.field("GPSTime");
        Self {
            time: Time::of(format),
            camera: format.field("I"),
            image: format.field("Img"),
            place: Place::of(format),
            angles: Angles::of(format),
            above_takeoff: format.field("RelAlt"),
            week: format.field("GPSWeek"),
            gps_ms,
            gps_scale: gps_ms.map_or(1e-3, |f| seconds_per(f, 1e-3)),
        }
    }

    /// An exposure stays an exposure without a usable position or attitude: its time still counts.
    fn run(&self, trigger: bool, place: u64, body: &[u8], to: &mut Collected) {
        let name = if trigger { "TRIG" } else { "CAM" };
        let mut exposure = Exposure::at(place);
        exposure.sequence = self.image.and_then(|f| f.number(body)).map(|n| n as u64);
        exposure.time = self.time.and_then(|t| t.get(body));
        if let Some(at) = self.place.filter(|at| !at.is_empty(body)) {
            exposure.position = to.quarantine.keep(place, name, at.get(body));
        }
        if let Some(angles) = self.angles {
            exposure.attitude = to.quarantine.keep(place, name, angles.get(body));
        }
        exposure.height_above_takeoff_m =
            self.above_takeoff.and_then(|f| f.number(body)).filter(|h| h.abs() < 60_000.0);
        let shot = Shot { exposure, utc: utc_of(self, body), camera: number(self.camera, body) };
        to.shoot(trigger, shot);
    }
}

/// Where an exposure's numbers come from.
pub(super) fn exposure_origins(from: &str) -> Vec<Origin> {
    let origin = |quantity, fields: &str, meaning: &str| Origin {
        quantity,
        from: fields.replace('#', from),
        meaning: meaning.to_owned(),
    };
    let event =
        if from == "CAM" { "shutter feedback (or command, without a feedback pin)" } else { "command" };
    vec![
        origin("time", "#.TimeUS", event),
        origin("sequence", "#.Img", "the autopilot's image number"),
        origin("latitude, longitude", "#.Lat, #.Lng, degrees", "WGS 84: the filter's position of the UAV"),
        origin("height", "#.Alt, metres", "above mean sea level (EGM96): the filter's height"),
        origin("height above take-off", "#.RelAlt, metres", "above home"),
        origin("yaw, pitch, roll", "#.Y, #.P, #.R, degrees", "of the UAV, not of the camera"),
    ]
}
