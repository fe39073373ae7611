//! From what a log says to navigation records: datums, north references, gimbal angles and the mount applied.

mod heights;
mod series;

pub(super) use heights::ellipsoidal;
pub(super) use series::SeriesAttitude;

use crate::camera::PixelRotation;
use crate::config::georeference::{
    Georeference, GimbalAngle, GimbalReference as DeclaredReference, LeverArm,
    PixelRotation as DeclaredRotation,
};
use crate::config::log::{LogFormat, LogSource};
use crate::formats::InputError;
use crate::formats::crs::Projection;
use crate::formats::flight::{
    Clock, Exposure, FlightLog, LoggedAttitude, LoggedGimbal, LoggedPosition, LoggedStd, North, Origin,
};
use crate::formats::geoid::Geoid;
use crate::formats::log::{height_kind, north};
use crate::geodesy::{Geodetic, HeightKind, LocalTangent, WGS84, grid_convergence};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Body, Camera, Displacement, Frame, Ned, Point, Rotation};
use crate::navigation::{GimbalAngles, GimbalReference, Mount, NavigationRecord, Track, declination};
use crate::units::{Radians, Seconds};
use std::sync::Arc;

/// A frame's pose before it meets the ground.
#[derive(Debug, Clone)]
pub(super) struct Posed {
    /// At the instant of exposure.
    pub record: NavigationRecord,
    /// How the camera sat then.
    pub mount: Mount,
    /// Where it came from.
    pub source: PoseSource,
}

/// Where a frame's pose came from.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseSource {
    /// How the frame found it: "line 7 of log.csv names it".
    pub found: String,
    /// What each number was read from.
    pub origins: Arc<[Origin]>,
    /// What was done to the numbers on the way, in sentences.
    pub applied: Vec<String>,
    /// What the record says its own values are worth.
    pub std: LoggedStd,
    /// Height above the take-off point, metres, where the record states it beside its own height.
    pub height_above_takeoff_m: Option<f64>,
}

/// The mount as declared, in the types of the chain; angles that the log is to give are those of [`GimbalAngles::NADIR`]
/// until it does.
pub(super) fn mount(declared: &Georeference) -> Mount {
    let m = &declared.mount;
    let fixed = |angle: GimbalAngle, otherwise: Radians| match angle {
        GimbalAngle::Fixed(radians) => Radians::new(radians),
        GimbalAngle::Logged => otherwise,
    };
    let nadir = GimbalAngles::NADIR;
    Mount {
        antenna_in_body: displacement(m.antenna_in_body),
        gimbal_in_body: displacement(m.gimbal_in_body),
        camera_in_gimbal: displacement(m.camera_in_gimbal),
        boresight: YawPitchRoll::new(
            Radians::new(m.boresight.yaw_rad),
            Radians::new(m.boresight.pitch_rad),
            Radians::new(m.boresight.roll_rad),
        ),
        gimbal: GimbalAngles {
            pan: fixed(m.pan, nadir.pan),
            elevation: fixed(m.elevation, nadir.elevation),
            roll: fixed(m.roll, nadir.roll),
        },
        gimbal_reference: match m.gimbal_reference {
            DeclaredReference::Body => GimbalReference::Body,
            DeclaredReference::Nav => GimbalReference::Nav,
        },
        pixel_rotation: pixel_rotation(m.pixel_rotation),
    }
}

/// A declared turn in the type of the chain.
pub(super) fn pixel_rotation(declared: DeclaredRotation) -> PixelRotation {
    PixelRotation::from_quarter_turns(match declared {
        DeclaredRotation::None => 0,
        DeclaredRotation::Quarter => 1,
        DeclaredRotation::Half => 2,
        DeclaredRotation::ThreeQuarters => 3,
    })
}

fn displacement<F: Frame>(arm: LeverArm) -> Displacement<F> {
    Displacement::new(arm.forward_m, arm.right_m, arm.down_m)
}

/// Answers for ground heights under positions, in order: metres above the ellipsoid, or why there is none.
pub(super) type HeightsUnder<'a> = &'a dyn Fn(&[Geodetic]) -> Vec<Result<f64, String>>;

/// Brings positions and attitudes of one log to the ellipsoid and to true north.
pub(super) struct Conventions<'a> {
    declared: &'a Georeference,
    geoid: &'a Geoid,
    /// CRS of projected positions and of the grid that angles count from.
    grid: Option<Projection>,
    /// For heights above ground.
    ground: HeightsUnder<'a>,
    clock: Clock,
    /// Where the numbers of the series came from.
    origins: &'a [Origin],
}

impl<'a> Conventions<'a> {
    /// - `own`: what each photo says of its own attitude, where the log says nothing of any; may be empty.
    /// - `product_crs`: the grid that a yaw from grid north counts from where the log has no CRS of its own.
    ///
    /// # Errors
    /// [`InputError`] for a CRS that PROJ does not know or that is missing, a course that nobody declared, and a mounting
    /// or a north that would not be used.
    pub(super) fn new(
        declared: &'a Georeference,
        log: &'a FlightLog,
        own: &[Option<Exposure>],
        product_crs: impl FnOnce() -> Result<Projection, InputError>,
        geoid: &'a Geoid,
        ground: HeightsUnder<'a>,
    ) -> Result<Self, InputError> {
        let attitudes: Vec<LoggedAttitude> = log
            .attitudes
            .iter()
            .map(|sample| sample.value)
            .chain(log.exposures.iter().chain(own.iter().flatten()).filter_map(|exposure| exposure.attitude))
            .collect();
        declared_course(declared, &attitudes)?;
        used_mount(declared, log, &attitudes)?;
        let grid = match position_crs(declared, log)? {
            Some(projection) => Some(projection),
            None if needs_grid(declared, &attitudes) => Some(product_crs()?),
            None => None,
        };
        Ok(Self { declared, geoid, grid, ground, clock: log.clock, origins: &log.origins })
    }

    /// The pose of one exposure: what it states itself, and the track at its instant for the rest.
    ///
    /// - `antenna`: its own position above the ellipsoid, if it states one.
    /// - `found`: how the frame found it, for the user.
    ///
    /// # Errors
    /// Words for what is missing.
    pub(super) fn pose(
        &self,
        exposure: &Exposure,
        antenna: Option<Geodetic>,
        track: Option<&(Track, SeriesAttitude)>,
        max_gap: Seconds,
        found: String,
    ) -> Result<Posed, String> {
        let mut applied = self.height_applied(exposure, antenna.as_ref());
        let around = self.around(exposure, antenna.is_some(), track, max_gap)?;
        let series = track.map_or(SeriesAttitude::NONE, |(_, attitude)| *attitude);
        let antenna = antenna
            .or(around.as_ref().map(|record| record.antenna))
            .ok_or("neither it nor the log around it states a position")?;
        let antenna = match exposure.camera_from_antenna {
            None => antenna,
            Some(offset) => {
                applied.push(format!(
                    "the record's own offset from the antenna to the camera is added: {:.3} m north, {:.3} m east, \
                     {:.3} m down",
                    offset.x(),
                    offset.y(),
                    offset.z()
                ));
                let at = Point::origin() + offset;
                WGS84.geodetic_from_ecef(&(*LocalTangent::at(antenna).ecef_from_ned() * at))
            }
        };
        let stated = exposure.attitude.or_else(|| series.of(around.as_ref()?.attitude));
        let gimbal = exposure
            .gimbal
            .or_else(|| Some(LoggedGimbal { angles: around.as_ref()?.gimbal?, reference: series.gimbal? }));
        let mut mount = mount(self.declared);
        let gimbal = match stated {
            // The pose is the camera's own: there is nothing between it and the record.
            Some(stated) if !matches!(stated, LoggedAttitude::Body { .. }) => {
                mount = Mount { pixel_rotation: mount.pixel_rotation, ..Mount::default() };
                None
            }
            _ => self.gimbal(gimbal, &mut mount, &mut applied)?,
        };
        let time = exposure.time.or(around.as_ref().and_then(|record| record.time));
        let attitude = match stated {
            Some(stated) => self.true_attitude(stated, &antenna, time, &mut applied)?,
            None if stands_without_attitude(&mount) => YawPitchRoll::default(),
            None => {
                return Err(
                    "its record has no attitude (yaw, pitch, roll), and the camera turns with the UAV"
                        .to_owned(),
                );
            }
        };
        let around = around.as_ref();
        let record = NavigationRecord {
            line: exposure.place,
            time,
            antenna,
            attitude,
            gimbal,
            height_above_ground_m: exposure
                .height_above_ground_m
                .or(around.and_then(|record| record.height_above_ground_m)),
            ground_speed_m_s: exposure.ground_speed_m_s.or(around.and_then(|record| record.ground_speed_m_s)),
            velocity: self.velocity(exposure, &attitude).or(around.and_then(|record| record.velocity)),
            pixel_rotation: exposure.pixel_rotation,
        };
        let series = if around.is_some() { self.origins } else { &[] };
        let origins = exposure.origins.iter().chain(series).cloned().collect();
        let (std, height_above_takeoff_m) = (exposure.std, exposure.height_above_takeoff_m);
        let source = PoseSource { found, origins, applied, std, height_above_takeoff_m };
        Ok(Posed { record, mount, source })
    }

    /// What was done to the height that an exposure states.
    fn height_applied(&self, exposure: &Exposure, antenna: Option<&Geodetic>) -> Vec<String> {
        let Some(position) = &exposure.position else { return Vec::new() };
        let mut applied = Vec::new();
        let stated = match position {
            LoggedPosition::Geodetic { kind, .. } | LoggedPosition::Projected { kind, .. } => Some(*kind),
            LoggedPosition::Ecef(_) => None,
        };
        let instead = self.declared.log.height_datum;
        if let Some(instead) = instead.filter(|datum| Some(height_kind(*datum)) != stated) {
            applied.push(format!(
                "the height is taken to be {}, as [georeference.log] height_datum declares",
                instead.words()
            ));
        }
        // As stated, and what it counts from once the declaration has had its say.
        if let (Ok((at, kind)), Some(antenna)) =
            (self.place(position, exposure.height_above_takeoff_m), antenna)
            && kind != HeightKind::Ellipsoid
        {
            let from = match kind {
                HeightKind::Ellipsoid => "above the ellipsoid".to_owned(),
                HeightKind::SeaLevel(model) => format!("above sea level ({})", model.name()),
                HeightKind::Barometric => "by air pressure".to_owned(),
                HeightKind::AboveTakeoff => "above take-off".to_owned(),
                HeightKind::AboveGround => "above the ground".to_owned(),
            };
            let (stated, now) = (at.height.get(), antenna.height.get());
            applied.push(format!(
                "{stated:.3} m {from} are {now:.3} m above the ellipsoid there ({:+.3} m)",
                now - stated
            ));
        }
        applied
    }

    /// The track at an exposure that does not state everything itself.
    fn around(
        &self,
        exposure: &Exposure,
        has_position: bool,
        track: Option<&(Track, SeriesAttitude)>,
        max_gap: Seconds,
    ) -> Result<Option<NavigationRecord>, String> {
        let (Some((track, _)), Some(time)) = (track, exposure.time) else { return Ok(None) };
        let complete = has_position && exposure.attitude.is_some();
        match track.at(time, max_gap) {
            Ok(record) => Ok(Some(record)),
            // What it does state is a pose: the track would only add to it.
            Err(_) if complete => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Gimbal angles of a frame whose attitude is the UAV's; an elevation stated by the mount stands for what is logged.
    fn gimbal(
        &self,
        logged: Option<LoggedGimbal>,
        mount: &mut Mount,
        applied: &mut Vec<String>,
    ) -> Result<Option<GimbalAngles>, String> {
        let stated = self.declared.log.as_table().is_none()
            && matches!(self.declared.mount.elevation, GimbalAngle::Fixed(_));
        match logged {
            Some(_) if stated => {
                applied.push("the mount's gimbal angles stand for the logged ones".to_owned());
                Ok(None)
            }
            Some(logged) => {
                mount.gimbal_reference = logged.reference;
                Ok(Some(logged.angles))
            }
            None if self.declared.mount.elevation == GimbalAngle::Logged => {
                Err("neither its record nor the log around it says where the camera looks; state \
                     `gimbal_elevation` in [georeference.mount]"
                    .to_owned())
            }
            None => Ok(None),
        }
    }

    /// The attitude from true north, of the body that carries the camera.
    fn true_attitude(
        &self,
        stated: LoggedAttitude,
        at: &Geodetic,
        time: Option<Seconds>,
        applied: &mut Vec<String>,
    ) -> Result<YawPitchRoll, String> {
        let instead = self.declared.log.heading.map(north);
        let (angles, north) = match stated {
            LoggedAttitude::Body { angles, north } | LoggedAttitude::Camera { angles, north } => {
                if let Some(instead) = instead.filter(|instead| *instead != north) {
                    applied.push(format!(
                        "yaw is taken to count from {} as [georeference.log] heading declares, not from {}",
                        words(instead),
                        words(north)
                    ));
                }
                (angles, instead.unwrap_or(north))
            }
            LoggedAttitude::CameraInNed(rotation) => return Ok(carrier(&rotation)),
            LoggedAttitude::CameraOnGrid(angles) => {
                let convergence = self.convergence(at)?;
                applied.push(format!(
                    "the angles count from the grid, whose north lies {:.4} deg east of true north there",
                    convergence.degrees()
                ));
                return Ok(carrier(&angles.ned_from_camera(convergence)));
            }
        };
        let turn = match north {
            North::True | North::Course => Radians::new(0.0),
            North::Grid => {
                let convergence = self.convergence(at)?;
                applied.push(format!(
                    "yaw counts from grid north: {:.4} deg of convergence are added",
                    convergence.degrees()
                ));
                convergence
            }
            North::Magnetic => self.declination(at, time, applied)?,
        };
        if north == North::Course {
            applied.push("yaw is the course over ground: the crab angle is not corrected".to_owned());
        }
        Ok(YawPitchRoll::new((angles.yaw + turn).wrapped(), angles.pitch, angles.roll))
    }

    /// Whether the numbers of the log's exposures are those at the end of the photos' names.
    pub(super) fn numbers_name_photos(&self) -> bool {
        matches!(self.declared.log.source, LogSource::File { format: LogFormat::DjiMrk, .. })
    }

    /// An error of the whole log.
    pub(super) fn of_log(&self, cause: String) -> InputError {
        match self.declared.log.file() {
            Some(file) => InputError::new(file, cause).caused_by(file),
            None => InputError::of_setting(&self.declared.log.table, cause),
        }
    }

    fn declination(
        &self,
        at: &Geodetic,
        time: Option<Seconds>,
        applied: &mut Vec<String>,
    ) -> Result<Radians, String> {
        let utc = time.filter(|_| self.clock == Clock::Utc).ok_or(
            "its yaw counts from magnetic north, and the log does not state the date (UTC) that the declination needs",
        )?;
        let declination = declination(at, utc).map_err(|e| e.to_string())?;
        applied.push(format!(
            "yaw counts from magnetic north: the declination of {:+.3} ± {:.3} deg ({}) is added",
            declination.angle.degrees(),
            declination.std.degrees(),
            declination.model
        ));
        Ok(declination.angle)
    }

    fn convergence(&self, at: &Geodetic) -> Result<Radians, String> {
        let grid = self.grid.as_ref().ok_or("its angles count from a grid, and no CRS is stated")?;
        grid_convergence(grid, at).map_err(|e| e.to_string())
    }

    fn velocity(&self, exposure: &Exposure, attitude: &YawPitchRoll) -> Option<Displacement<Ned>> {
        let course = matches!(
            exposure.attitude,
            Some(
                LoggedAttitude::Body { north: North::Course, .. }
                    | LoggedAttitude::Camera { north: North::Course, .. }
            )
        ) || self.declared.log.heading.map(north) == Some(North::Course);
        exposure.velocity.or_else(|| match (course, exposure.ground_speed_m_s) {
            (true, Some(speed)) => {
                let (sin, cos) = attitude.yaw.get().sin_cos();
                Some(Displacement::new(speed * cos, speed * sin, 0.0))
            }
            _ => None,
        })
    }
}

/// What a yaw counts from, in a sentence.
const fn words(north: North) -> &'static str {
    match north {
        North::True => "true north",
        North::Magnetic => "magnetic north",
        North::Grid => "grid north",
        North::Course => "true north along the course over ground",
    }
}

/// The body that carries the camera looking straight down, its nose at the top of the image.
fn carrier(ned_from_camera: &Rotation<Ned, Camera>) -> YawPitchRoll {
    let body_from_camera: Rotation<Body, Camera> =
        GimbalAngles::NADIR.rotation::<Body>() * Mount::gimbal_from_camera_axes();
    YawPitchRoll::of(&(*ned_from_camera * body_from_camera.inverse()))
}

/// Only a camera stabilised against the horizon, without lever arms in the body, does without the UAV's attitude.
fn stands_without_attitude(mount: &Mount) -> bool {
    let arms = [mount.antenna_in_body, mount.gimbal_in_body];
    mount.gimbal_reference == GimbalReference::Nav && arms.iter().all(|arm| arm.vector().norm() == 0.0)
}

/// The CRS of the log's own positions: declared, or stated by the file; both must agree where both are there.
pub(super) fn position_crs(
    declared: &Georeference,
    log: &FlightLog,
) -> Result<Option<Projection>, InputError> {
    match (&declared.log.crs, &log.crs) {
        (Some(crs), _) => {
            Projection::new(crs).map(Some).map_err(|e| InputError::of_setting(crs, e.to_string()))
        }
        (None, Some(definition)) => Projection::new(definition).map(Some).map_err(|e| {
            let file = declared.log.file().map_or_else(Default::default, |file| file.value.clone());
            InputError::new(&file, e.to_string())
                .help("state the CRS of its positions as `position_crs` in [georeference.log]")
        }),
        (None, None) => {
            let projected = |p: &LoggedPosition| matches!(p, LoggedPosition::Projected { .. });
            let any = log.positions.iter().any(|sample| projected(&sample.value))
                || log.exposures.iter().filter_map(|e| e.position.as_ref()).any(projected);
            if any {
                return Err(InputError::of_setting(
                    &declared.log.table,
                    "the log's positions are map coordinates, and nothing states their CRS",
                )
                .help("add `position_crs = \"EPSG:...\"` to [georeference.log]"));
            }
            Ok(None)
        }
    }
}

/// A course may stand for the nose only where somebody said how far off it may be.
fn declared_course(declared: &Georeference, attitudes: &[LoggedAttitude]) -> Result<(), InputError> {
    let is_course = |attitude: &LoggedAttitude| {
        matches!(
            attitude,
            LoggedAttitude::Body { north: North::Course, .. }
                | LoggedAttitude::Camera { north: North::Course, .. }
        )
    };
    let undeclared = declared.log.heading.is_none() && declared.log.crab_std_rad.is_none();
    if undeclared && attitudes.iter().any(is_course) {
        return Err(InputError::of_setting(
            &declared.log.table,
            "the yaw is the course over ground, not the direction of the nose",
        )
        .help("to use it as if the nose pointed along it, add `heading = \"course\"` and `crab_std = \"10 deg\"` (one standard deviation of the crab angle) to [georeference.log]"));
    }
    Ok(())
}

/// A mounting or a north that no pose would take up is refused, not left out in silence.
fn used_mount(
    declared: &Georeference,
    log: &FlightLog,
    attitudes: &[LoggedAttitude],
) -> Result<(), InputError> {
    let of_body = |attitude: &LoggedAttitude| matches!(attitude, LoggedAttitude::Body { .. });
    let m = mount(declared);
    let arms = m.antenna_in_body.vector().norm()
        + m.gimbal_in_body.vector().norm()
        + m.camera_in_gimbal.vector().norm()
        > 0.0;
    let turned = m.boresight != YawPitchRoll::default()
        || declared.log.as_table().is_none() && declared.mount.elevation != GimbalAngle::Logged;
    let unused = |what: &str, because: &str| {
        Err(InputError::of_setting(&declared.mount.table, format!("{what} would not be used: {because}"))
            .help("remove them from [georeference.mount]"))
    };
    if !attitudes.is_empty() && !attitudes.iter().any(of_body) && (arms || turned) {
        return unused("lever arms, boresight and gimbal angles", "the log states the camera's own pose");
    }
    if arms && log.exposures.iter().any(|exposure| exposure.camera_from_antenna.is_some()) {
        return unused(
            "lever arms",
            "the log states the way from the antenna to the camera for each exposure",
        );
    }
    let has_yaw = |attitude: &LoggedAttitude| {
        matches!(attitude, LoggedAttitude::Body { .. } | LoggedAttitude::Camera { .. })
    };
    if declared.log.heading.is_some() && !attitudes.is_empty() && !attitudes.iter().any(has_yaw) {
        return Err(InputError::of_setting(
            &declared.log.table,
            "`heading` would not be used: the log states rotations of the camera, not a yaw",
        )
        .help("remove `heading`"));
    }
    Ok(())
}

/// Whether any angle counts from a grid.
fn needs_grid(declared: &Georeference, attitudes: &[LoggedAttitude]) -> bool {
    let on_grid = |attitude: &LoggedAttitude| match attitude {
        LoggedAttitude::Body { north, .. } | LoggedAttitude::Camera { north, .. } => *north == North::Grid,
        LoggedAttitude::CameraOnGrid(_) => true,
        LoggedAttitude::CameraInNed(_) => false,
    };
    declared.log.heading.map(north) == Some(North::Grid) || attitudes.iter().any(on_grid)
}
