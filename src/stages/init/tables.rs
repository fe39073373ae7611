//! Text tables: what their columns hold, by name and by value.

use crate::formats::flight::{Exposure, LoggedAttitude, LoggedGimbal, North, geodetic};
use crate::formats::table::{Row, Table};
use crate::geodesy::{Geodetic, GeoidModel, HeightKind};
use crate::geometry::attitude::YawPitchRoll;
use crate::navigation::{GimbalAngles, GimbalReference};
use crate::units::Radians;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// The photo's file name.
    Frame,
    /// When.
    Time,
    /// Degrees north.
    Latitude,
    /// Degrees east.
    Longitude,
    /// Height of the camera.
    Height,
    /// The same above the ground.
    AboveGround,
    /// The same above take-off.
    AboveTakeoff,
    /// Yaw of the UAV.
    Yaw,
    /// Pitch of the UAV.
    Pitch,
    /// Roll of the UAV.
    Roll,
    /// Pan or yaw of the gimbal.
    GimbalPan,
    /// Elevation or pitch of the gimbal.
    GimbalElevation,
    /// Roll of the gimbal.
    GimbalRoll,
    /// Speed over ground.
    GroundSpeed,
    /// Whether the stored pixels were turned by half a turn: 0 or 1.
    HalfTurns,
    /// The same in degrees clockwise.
    Turned,
}

/// A column that is understood.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Understood {
    /// What it holds.
    pub role: Role,
    /// Its name in the table.
    pub name: String,
    /// Unit in the pipeline file's words; a format for times.
    pub unit: &'static str,
    /// For heights, the datum in the pipeline file's words when the name says it; for yaws, what they count from.
    pub says: Option<&'static str>,
    /// How much the name is to be preferred over another of the same role.
    preferred: u8,
}

/// A table of which at least positions or turns are understood.
#[derive(Debug)]
pub struct Poses {
    /// The file.
    pub path: PathBuf,
    /// What parts its cells.
    pub delimiter: u8,
    /// One column for each role.
    pub columns: Vec<Understood>,
    /// Its rows that name a photo of the survey and can be used.
    pub exposures: Vec<Exposure>,
    /// Photos that it says were turned by half a turn.
    pub half_turned: BTreeSet<String>,
    /// Whether its name says that it is there to judge by.
    pub is_reference: bool,
}

impl Poses {
    /// The column of a role.
    #[must_use]
    pub fn column(&self, role: Role) -> Option<&Understood> {
        self.columns.iter().find(|column| column.role == role)
    }

    /// Whether there is a column of each role.
    #[must_use]
    pub fn has(&self, roles: &[Role]) -> bool {
        roles.iter().all(|role| self.column(*role).is_some())
    }

    /// Whether a row holds all that a frame's pose needs.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        use Role::*;
        self.has(&[Frame, Latitude, Longitude, Height])
            && (self.has(&[Yaw, Pitch, Roll]) || self.has(&[GimbalPan, GimbalElevation]))
    }
}

/// Reads a table's header and the rows of the photos; `None` when it names no photo or places nothing.
#[must_use]
pub fn read(path: &Path, delimiter: u8, photos: &BTreeSet<&str>) -> Option<Poses> {
    let table = Table::read_path(path, delimiter).ok()?;
    let columns = columns(path, delimiter, &table)?;
    let stem = path.file_stem()?.to_str()?.to_lowercase();
    let is_reference = ["truth", "true", "reference", "check", "gcp"].iter().any(|word| stem.contains(word));
    let mut poses = Poses {
        path: path.to_owned(),
        delimiter,
        columns,
        exposures: Vec::new(),
        half_turned: BTreeSet::new(),
        is_reference,
    };
    read_rows(&mut poses, &table, photos)?;
    (!poses.exposures.is_empty() || !poses.half_turned.is_empty()).then_some(poses)
}

/// The columns that are understood, the best for each role.
fn columns(path: &Path, delimiter: u8, table: &Table) -> Option<Vec<Understood>> {
    let bytes = std::fs::read_to_string(path).ok()?;
    let header =
        bytes.trim_start_matches('\u{feff}').lines().find(|l| !l.trim().is_empty() && !l.starts_with('#'))?;
    let names = header.split(char::from(delimiter)).map(|name| name.trim().trim_matches('"'));
    let mut columns: Vec<Understood> = names.filter(|name| table.has(name)).filter_map(understand).collect();
    columns.sort_by_key(|column| (column.role, std::cmp::Reverse(column.preferred)));
    columns.dedup_by_key(|column| column.role);
    for column in &mut columns {
        by_values(column, table);
    }
    Some(columns)
}

/// Points on the ground: a table of places with heights, of no photo and no moment.
#[derive(Debug)]
pub struct Points {
    /// The file.
    pub path: PathBuf,
    /// What its heights are measured from, in the pipeline file's words.
    pub datum: &'static str,
    /// Places and heights as stated.
    pub places: Vec<Geodetic>,
}

/// Reads a table of points; `None` when it is none, or does not say what its heights are measured from.
#[must_use]
pub fn points(path: &Path, delimiter: u8) -> Option<Points> {
    let table = Table::read_path(path, delimiter).ok()?;
    let columns = columns(path, delimiter, &table)?;
    let of = |role| columns.iter().find(|column| column.role == role);
    if [Role::Time, Role::Yaw, Role::Pitch, Role::Roll].into_iter().any(|role| of(role).is_some()) {
        return None;
    }
    let [latitude, longitude, height] = [of(Role::Latitude)?, of(Role::Longitude)?, of(Role::Height)?];
    let datum = height.says?;
    let cell = |row: &Row<'_>, column: &Understood| cell(&table, row, column);
    let places: Vec<Geodetic> = table
        .rows()
        .filter_map(|row| {
            let (latitude, longitude) = (cell(&row, latitude)?, cell(&row, longitude)?);
            Some(Geodetic::from_degrees(latitude, longitude, cell(&row, height)?))
        })
        .collect();
    (!places.is_empty()).then(|| Points { path: path.to_owned(), datum, places })
}

fn read_rows(poses: &mut Poses, table: &Table, photos: &BTreeSet<&str>) -> Option<()> {
    let frame = table.column_named(&poses.column(Role::Frame)?.name).ok()?;
    let mut named = BTreeSet::new();
    for row in table.rows() {
        let cell = row.text(frame).rsplit(['/', '\\']).next().unwrap_or_default();
        let Some(photo) = photos.iter().find(|photo| photo.eq_ignore_ascii_case(cell)) else { continue };
        // A table with several rows for a photo (tie points) is no table of poses.
        if !named.insert(*photo) {
            return None;
        }
        let number = |role| number(poses, table, &row, role);
        let half = number(Role::HalfTurns) == Some(1.0) || number(Role::Turned) == Some(180.0);
        if let Some(exposure) = exposure(poses, &row, &number, photo) {
            poses.exposures.push(exposure);
        }
        if half {
            poses.half_turned.insert((*photo).to_owned());
        }
    }
    Some(())
}

/// The cell of a role in degrees or metres.
fn number(poses: &Poses, table: &Table, row: &Row<'_>, role: Role) -> Option<f64> {
    cell(table, row, poses.column(role)?)
}

/// A cell in degrees or metres.
fn cell(table: &Table, row: &Row<'_>, column: &Understood) -> Option<f64> {
    let value = row.number(table.column_named(&column.name).ok()?).ok()?;
    Some(match column.unit {
        "deg_e7" => value * 1e-7,
        "rad" => Radians::new(value).degrees(),
        "ft" => value * 0.3048,
        "km" => value * 1e3,
        "cm" | "cm/s" => value * 1e-2,
        "mm" => value * 1e-3,
        "km/h" => value / 3.6,
        "kn" => value * 1852.0 / 3600.0,
        _ => value,
    })
}

fn exposure(
    poses: &Poses,
    row: &Row<'_>,
    number: &dyn Fn(Role) -> Option<f64>,
    photo: &str,
) -> Option<Exposure> {
    let [latitude, longitude] =
        [number(Role::Latitude)?, number(Role::Longitude)?].map(Radians::from_degrees);
    let kind = match poses.column(Role::Height).and_then(|column| column.says) {
        Some("ellipsoid") => HeightKind::Ellipsoid,
        Some("egm2008") => HeightKind::SeaLevel(GeoidModel::Egm2008),
        Some("above_takeoff") => HeightKind::AboveTakeoff,
        Some("above_ground") => HeightKind::AboveGround,
        _ => HeightKind::SeaLevel(GeoidModel::Egm96),
    };
    let mut exposure = Exposure::at(row.line());
    exposure.frame = Some(photo.to_owned());
    exposure.position = Some(geodetic(latitude, longitude, number(Role::Height)?, kind).ok()?);
    if let (Some(yaw), Some(pitch), Some(roll)) = (number(Role::Yaw), number(Role::Pitch), number(Role::Roll))
    {
        let angles = YawPitchRoll::from_degrees(yaw, pitch, roll);
        exposure.attitude = Some(LoggedAttitude::Body { angles, north: North::True });
    }
    if let (Some(pan), Some(elevation)) = (number(Role::GimbalPan), number(Role::GimbalElevation)) {
        exposure.gimbal = Some(LoggedGimbal {
            angles: GimbalAngles {
                pan: Radians::from_degrees(pan),
                elevation: Radians::from_degrees(elevation),
                roll: Radians::from_degrees(number(Role::GimbalRoll).unwrap_or(0.0)),
            },
            reference: GimbalReference::Nav,
        });
    }
    exposure.height_above_takeoff_m = number(Role::AboveTakeoff);
    exposure.height_above_ground_m = number(Role::AboveGround);
    exposure.ground_speed_m_s = number(Role::GroundSpeed);
    Some(exposure)
}

/// What a column's name says.
fn understand(name: &str) -> Option<Understood> {
    let mut words = words(name);
    let unit = take_unit(&mut words);
    let has = |word: &str| words.iter().any(|w| w == word);
    let any = |list: &[&str]| list.iter().any(|word| has(word));
    let gimbal = any(&["gimbal", "gimbl", "mount"]);
    // The camera's own place and attitude follow from the rest.
    if has("camera") && !any(&["time", "file"]) || any(&["std", "sigma", "accuracy", "error", "air"]) {
        return None;
    }
    let of =
        |role, unit, says, preferred| Some(Understood { role, name: name.to_owned(), unit, says, preferred });
    let angle = if unit == Some("rad") { "rad" } else { "deg" };
    let length = unit.filter(|u| matches!(*u, "ft" | "cm" | "mm" | "km")).unwrap_or("m");
    if any(&["rotated", "turned", "rotation"]) && any(&["pixels", "pixel", "image"]) {
        let half = any(&["180", "half"]);
        return if half { of(Role::HalfTurns, "", None, 0) } else { of(Role::Turned, "", None, 0) };
    }
    if any(&["lat", "latitude"]) {
        return of(Role::Latitude, if unit == Some("deg_e7") { "deg_e7" } else { angle }, None, 0);
    }
    if any(&["lon", "long", "lng", "longitude"]) {
        return of(Role::Longitude, if unit == Some("deg_e7") { "deg_e7" } else { angle }, None, 0);
    }
    if any(&["heading", "yaw", "azimuth"]) || gimbal && has("pan") {
        let magnetic = any(&["magnetic", "mag"]);
        let says = Some(if magnetic { "clockwise_from_magnetic_north" } else { "clockwise_from_true_north" });
        return if gimbal { of(Role::GimbalPan, angle, None, 0) } else { of(Role::Yaw, angle, says, 1) };
    }
    if any(&["course", "cog", "track"]) {
        return of(Role::Yaw, angle, Some("course_over_ground"), 0);
    }
    if has("pitch") || gimbal && any(&["elevation", "tilt"]) {
        return of(if gimbal { Role::GimbalElevation } else { Role::Pitch }, angle, None, 0);
    }
    if has("roll") {
        return of(if gimbal { Role::GimbalRoll } else { Role::Roll }, angle, None, 0);
    }
    if any(&["speed", "groundspeed", "velocity"]) {
        let is_ground = any(&["ground", "groundspeed", "gps"]);
        let unit = unit.filter(|u| matches!(*u, "km/h" | "kn" | "cm/s")).unwrap_or("m/s");
        return is_ground.then_some(()).and_then(|()| of(Role::GroundSpeed, unit, None, 0));
    }
    if any(&["height", "alt", "altitude", "elevation", "elev", "z", "hae", "msl", "amsl", "agl"]) {
        let sea = any(&["amsl", "msl", "orthometric", "egm96", "sea", "geoid"]);
        let (role, says, preferred) = if any(&["takeoff", "relative", "rel", "home", "launch"]) {
            (Role::AboveTakeoff, Some("above_takeoff"), 0)
        } else if has("agl") || has("above") && has("ground") {
            (Role::AboveGround, Some("above_ground"), 0)
        } else if has("egm2008") {
            (Role::Height, Some("egm2008"), 3)
        } else if sea {
            // An autopilot's height above the sea is filtered; the receiver's own beside it is not.
            (Role::Height, Some("egm96"), 3)
        } else if any(&["ellipsoid", "ellipsoidal", "wgs84", "hae", "ell"]) {
            (Role::Height, Some("ellipsoid"), 2)
        } else {
            (Role::Height, None, 1)
        };
        return of(role, length, says, preferred);
    }
    let names = [
        "file",
        "filename",
        "image",
        "imagename",
        "photo",
        "frame",
        "name",
        "label",
        "sourcefile",
        "picture",
    ];
    if any(&names) && !any(&["time", "width", "height", "type", "size"]) {
        let preferred = if any(&["file", "filename", "image", "imagename", "sourcefile"]) { 2 } else { 1 };
        return of(Role::Frame, "", None, preferred);
    }
    if any(&["time", "timestamp", "utc", "datetime"]) {
        let preferred = if has("utc") { 2 } else { 1 };
        return of(Role::Time, if unit == Some("ms") { "milliseconds" } else { "seconds" }, None, preferred);
    }
    None
}

/// Lower-case words of a column's name: "GimbalYaw(deg)" is gimbal, yaw, deg.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before_lower = false;
    for c in name.chars() {
        let starts = c.is_uppercase() && before_lower;
        if starts || !c.is_alphanumeric() {
            words.push(String::new());
        }
        if c.is_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.extend(c.to_lowercase());
        }
        before_lower = c.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

/// The unit at the end of a name, taken off its words.
fn take_unit(words: &mut Vec<String>) -> Option<&'static str> {
    const UNITS: [(&[&str], &str); 15] = [
        (&["cm", "s"], "cm/s"),
        (&["m", "s"], "m/s"),
        (&["km", "h"], "km/h"),
        (&["deg", "e7"], "deg_e7"),
        (&["e7"], "deg_e7"),
        (&["kn"], "kn"),
        (&["kt"], "kn"),
        (&["deg"], "deg"),
        (&["degrees"], "deg"),
        (&["rad"], "rad"),
        (&["ft"], "ft"),
        (&["cm"], "cm"),
        (&["ms"], "ms"),
        (&["m"], "m"),
        (&["s"], "s"),
    ];
    for (ending, unit) in UNITS {
        if words.len() > ending.len()
            && words.ends_with(&ending.iter().map(|w| (*w).to_owned()).collect::<Vec<_>>())
        {
            words.truncate(words.len() - ending.len());
            return Some(unit);
        }
    }
    None
}

/// What values say that a name leaves open: degrees times 10⁷, the form of times.
fn by_values(column: &mut Understood, table: &Table) {
    let Ok(at) = table.column_named(&column.name) else { return };
    let mut numbers = table.rows().take(1000).filter_map(|row| row.number(at).ok());
    match column.role {
        Role::Latitude | Role::Longitude if column.unit == "deg" => {
            // Beyond every angle, and whole: degrees times ten million.
            if numbers.all(|n| n.fract() == 0.0 && n.abs() > 1e5) && table.rows().next().is_some() {
                column.unit = "deg_e7";
            }
        }
        Role::Time => {
            let first = table.rows().next().map(|row| row.text(at).to_owned()).unwrap_or_default();
            if first.contains('T') || first.contains(':') {
                column.unit = "iso8601";
            } else if numbers.all(|n| (1e9..1e10).contains(&n)) {
                column.unit = "unix_seconds";
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(name: &str) -> Option<(Role, &'static str, Option<&'static str>)> {
        understand(name).map(|column| (column.role, column.unit, column.says))
    }

    #[test]
    fn names_of_columns() {
        use Role::*;
        let north = Some("clockwise_from_true_north");
        let cases = [
            ("file", Frame, "", None),
            ("ImageName", Frame, "", None),
            ("latitude_deg", Latitude, "deg", None),
            ("lat_e7", Latitude, "deg_e7", None),
            ("Longitude [deg]", Longitude, "deg", None),
            ("height_ellipsoid_m", Height, "m", Some("ellipsoid")),
            ("alt_amsl_m", Height, "m", Some("egm96")),
            ("alt_wgs84_m", Height, "m", Some("ellipsoid")),
            ("alt_gps_m", Height, "m", None),
            ("AltitudeAMSL(ft)", Height, "ft", Some("egm96")),
            ("height_above_takeoff_m", AboveTakeoff, "m", Some("above_takeoff")),
            ("agl", AboveGround, "m", Some("above_ground")),
            ("yaw_deg", Yaw, "deg", north),
            ("heading", Yaw, "deg", north),
            ("mag_heading_rad", Yaw, "rad", Some("clockwise_from_magnetic_north")),
            ("course", Yaw, "deg", Some("course_over_ground")),
            ("FlightPitchDegree", Pitch, "deg", None),
            ("gimbal_yaw_deg", GimbalPan, "deg", None),
            ("gimbal_pitch_deg", GimbalElevation, "deg", None),
            ("GimbalRoll(deg)", GimbalRoll, "deg", None),
            ("groundspeed_m_s", GroundSpeed, "m/s", None),
            ("ground_speed_kn", GroundSpeed, "kn", None),
            ("time_s", Time, "seconds", None),
            ("pixels_rotated_180", HalfTurns, "", None),
        ];
        for (name, role, unit, says) in cases {
            assert_eq!(one(name), Some((role, unit, says)), "{name}");
        }
        for name in ["camera_latitude_deg", "airspeed", "r11", "strip", "x_px", "yaw_std", "point", ""] {
            assert_eq!(one(name), None, "{name}");
        }
    }

    fn table(text: &str, photos: &[&str]) -> Option<Poses> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        crate::formats::atomic::write_atomic(&path, text.as_bytes()).unwrap();
        read(&path, b',', &photos.iter().copied().collect())
    }

    #[test]
    fn rows_of_the_survey_s_photos() {
        let text = "file,lat,lon,alt_msl,yaw,pitch,roll\n\
                    dir/A.jpg,410000000,-830000000,300,10,1,2\nb.jpg,410000000,-830000000,x,10,1,2\n\
                    other.jpg,410000000,-830000000,300,10,1,2\n";
        let poses = table(text, &["a.jpg", "b.jpg"]).unwrap();
        assert!(poses.is_complete() && !poses.is_reference);
        assert_eq!(poses.column(Role::Latitude).unwrap().unit, "deg_e7");
        let frames: Vec<_> = poses.exposures.iter().map(|e| e.frame.clone().unwrap()).collect();
        assert_eq!(frames, ["a.jpg"]);
        // Tie points name photos too, each many times.
        assert!(table("file,lat,lon,alt\na.jpg,1,1,1\na.jpg,1,1,1\n", &["a.jpg"]).is_none());
        assert!(table("point,lat,lon,alt\na.jpg,1,1,1\n", &["a.jpg"]).is_none());
    }

    #[test]
    fn turned_photos_are_known_without_positions() {
        let poses =
            table("file,pixels_rotated_180,strip\na.jpg,0,1\nb.jpg,1,2\n", &["a.jpg", "b.jpg"]).unwrap();
        assert_eq!(poses.half_turned, BTreeSet::from(["b.jpg".to_owned()]));
        assert!(poses.exposures.is_empty() && !poses.is_complete());
    }
}
