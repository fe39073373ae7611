//! Which of the pose sources in a folder is used, and what is written about it.

use super::Survey;
use super::scan::{FileKind, shown};
use super::tables::{Poses, Role};
use super::write::{Line, quoted, quoted_path, text};
use crate::config::height::HeightDatum;
use crate::config::log::{AngleSystem, AngleUnit, LogFormat, StatedOfFile};
use crate::formats::flight::{Exposure, FlightLog, LoggedAttitude, LoggedPosition, North};
use crate::formats::log::read_file;
use crate::geodesy::{Geodetic, HeightKind};
use crate::units::{Metres, Radians};
use std::path::Path;

/// Logs larger than this are not read to see what is in them.
const MOST_LOG_BYTES: u64 = 1 << 30;
/// Positions nearer than this are the same, rounded.
const REPEATS_M: f64 = 0.5;
/// A source has to place this share of the photos.
const ENOUGH: f64 = 0.5;

/// What the attitude of a source is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attitude {
    /// The camera's, or a gimbal's: where it looks is known.
    OfCamera,
    /// The UAV's nose.
    OfBody,
    /// The UAV's, with the course for the nose.
    OfBodyByCourse,
    /// None.
    Missing,
}

/// A source of poses.
#[derive(Debug)]
pub struct Source {
    /// What it is, in a sentence: "the photos' own metadata".
    pub name: String,
    /// `[georeference.log]` and the table of its columns.
    pub lines: Vec<Line>,
    /// Its photos; positions of the track where it has no photos.
    pub exposures: Vec<Exposure>,
    /// What its attitude is.
    pub attitude: Attitude,
    /// Whether it is the photos themselves.
    pub is_photos: bool,
    /// Whether what its heights are measured from is stated, not assumed.
    pub heights_are_stated: bool,
    /// Whether frames find it by their names.
    pub by_name: bool,
    /// Gimbal angles in it count from: "nav", "body"; `None` when the format says it, or it has none.
    pub gimbal_reference: Option<&'static str>,
}

/// The sources there are, the one to be used first; and why others are not.
pub fn sources(survey: &Survey<'_>, left_out: &mut Vec<String>) -> Vec<Source> {
    let own = of_photos(survey);
    let enough =
        |source: &Source| source.exposures.len() as f64 >= ENOUGH * survey.photos.photos.len() as f64;
    let complete = own.as_ref().is_some_and(|own| own.attitude != Attitude::Missing && enough(own));
    let (mut better, mut usual, mut last) = (Vec::new(), Vec::new(), Vec::new());
    for found in &survey.scan.files {
        let FileKind::Log(format) = found.kind else { continue };
        let name = shown(survey.root, &found.path);
        match of_file(survey, &found.path, format) {
            Err(cause) => left_out.push(format!("{name}: {cause}")),
            // A table of adjusted or post-processed poses was made from the photos, to replace what they say.
            Ok(source) if replaces(format) && enough(&source) => better.push(source),
            Ok(source) if complete => left_out
                .push(format!("{name} ({}): the photos themselves state position and attitude", source.name)),
            Ok(source) => usual.push(source),
        }
    }
    for table in survey.tables.iter().filter(|table| table.is_complete()) {
        let name = shown(survey.root, &table.path);
        let source = of_table(survey, table);
        if table.is_reference {
            let differs = own.as_ref().map_or(String::new(), |own| {
                difference(&own.exposures, &source.exposures)
                    .map_or(String::new(), |d| format!(", {} off", d.words()))
            });
            left_out.push(format!(
                "{name}: poses of {} photos{differs}; by its name it is there to judge by",
                source.exposures.len()
            ));
            last.push(source);
            continue;
        }
        match own.as_ref().filter(|_| complete).map(|own| difference(&own.exposures, &source.exposures)) {
            Some(Some(difference)) if difference.is_none() => {
                left_out.push(format!("{name}: repeats what the photos say ({})", difference.words()));
            }
            Some(Some(_)) if enough(&source) => better.push(source),
            Some(_) => left_out.push(format!("{name}: the photos themselves state position and attitude")),
            None => usual.push(source),
        }
    }
    for table in survey.tables.iter().filter(|table| !table.is_complete() && !table.exposures.is_empty()) {
        let name = shown(survey.root, &table.path);
        let read = of_file(survey, &table.path, LogFormat::Geoinfo);
        let apart = own.as_ref().and_then(|own| difference(&own.exposures, &table.exposures));
        match (read, apart) {
            (Ok(_), Some(apart)) if apart.metres < REPEATS_M => {
                left_out.push(format!("{name}: repeats the positions of the photos ({})", apart.words()));
            }
            (Ok(source), _)
                if source.attitude != Attitude::Missing && !table.is_reference && enough(&source) =>
            {
                better.push(source);
            }
            (Ok(_), _) => left_out.push(format!("{name}: holds positions of photos, no attitudes")),
            (Err(cause), _) => left_out.push(format!("{name}: {cause}")),
        }
    }
    usual.sort_by_key(|source| (!source.by_name, std::cmp::Reverse(source.exposures.len())));
    let (own_first, own_late): (Vec<_>, Vec<_>) = own.into_iter().partition(|_| complete);
    better.into_iter().chain(own_first).chain(usual).chain(own_late).chain(last).collect()
}

/// Formats that hold poses made for these photos.
const fn replaces(format: LogFormat) -> bool {
    use LogFormat::{Geoinfo, OdmGeo, Opensfm, Orientation, RtklibEvents};
    matches!(format, OdmGeo | Orientation | Opensfm | Geoinfo | RtklibEvents)
}

/// How far two sources are apart: medians.
struct Difference {
    metres: f64,
    yaw_deg: Option<f64>,
}

impl Difference {
    fn is_none(&self) -> bool {
        self.metres < REPEATS_M && self.yaw_deg.is_none_or(|yaw| yaw < 1.0)
    }
    fn words(&self) -> String {
        let yaw = self.yaw_deg.map_or(String::new(), |yaw| format!(" and {yaw:.1} deg of yaw"));
        format!("a median of {:.2} m{yaw}", self.metres)
    }
}

/// Medians of the differences of photos that both have.
fn difference(a: &[Exposure], b: &[Exposure]) -> Option<Difference> {
    let (mut metres, mut yaws) = (Vec::new(), Vec::new());
    for one in a {
        let Some(two) = b.iter().find(|two| two.frame == one.frame) else { continue };
        let (Some(p), Some(q)) = (place(one), place(two)) else { continue };
        let (dn, de) = ((p.latitude - q.latitude).get(), (p.longitude - q.longitude).get());
        metres.push(6_371_000.0 * dn.hypot(de * p.latitude.get().cos()));
        if let (Some(p), Some(q)) = (yaw(one), yaw(two)) {
            yaws.push((p - q).wrapped().degrees().abs());
        }
    }
    Some(Difference { metres: median(metres)?, yaw_deg: median(yaws) })
}

/// Where the image's top or the nose points.
pub fn yaw(exposure: &Exposure) -> Option<Radians> {
    if let Some(gimbal) = exposure.gimbal {
        return Some(gimbal.angles.pan);
    }
    match exposure.attitude? {
        LoggedAttitude::Body { angles, .. } | LoggedAttitude::Camera { angles, .. } => Some(angles.yaw),
        LoggedAttitude::CameraOnGrid(_) | LoggedAttitude::CameraInNed(_) => None,
    }
}

/// Latitude and longitude, and the height as stated.
pub fn place(exposure: &Exposure) -> Option<Geodetic> {
    match exposure.position? {
        LoggedPosition::Geodetic { latitude, longitude, height_m, .. } => {
            Some(Geodetic { latitude, longitude, height: Metres::new(height_m) })
        }
        _ => None,
    }
}

/// What the stated height counts from.
pub fn kind(exposure: &Exposure) -> Option<HeightKind> {
    match exposure.position? {
        LoggedPosition::Geodetic { kind, .. } | LoggedPosition::Projected { kind, .. } => Some(kind),
        LoggedPosition::Ecef(_) => Some(HeightKind::Ellipsoid),
    }
}

/// The middle one.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.retain(|value| value.is_finite());
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    match values.len() {
        0 => None,
        odd if odd % 2 == 1 => values.get(half).copied(),
        _ => Some(0.5 * (values[half - 1] + values[half])),
    }
}

fn of_photos(survey: &Survey<'_>) -> Option<Source> {
    let mut exposures: Vec<Exposure> = Vec::new();
    for photo in &survey.photos.photos {
        let Some(metadata) = photo.metadata.as_ref().filter(|m| m.exposure.position.is_some()) else {
            continue;
        };
        exposures.push(Exposure { frame: Some(photo.name.clone()), ..metadata.exposure.clone() });
    }
    let first = exposures.first()?;
    let attitude = attitude_of(&exposures);
    let origin = |quantity: &str| first.origins.iter().find(|o| o.quantity == quantity);
    let mut lines = vec![Line::Table("georeference.log")];
    let placed = exposures.len();
    lines.push(Line::Note(format!(
        "{placed} of {} photos state their own position{}.",
        survey.photos.photos.len(),
        if attitude == Attitude::Missing { ", none of them an attitude" } else { " and attitude" }
    )));
    lines.push(text("format", "photos"));
    if let Some(origin) = origin("latitude") {
        lines.push(Line::Note(format!("latitude: {}: {}", origin.from, origin.meaning)));
    }
    let mut heights_are_stated = true;
    if let Some(height) = origin("height") {
        let words = format!("height: {}: {}", height.from, height.meaning);
        // The reader says so itself.
        heights_are_stated =
            !["assumed", "if the ground disagrees"].iter().any(|w| height.meaning.contains(w));
        if heights_are_stated {
            lines.push(Line::Note(words));
        } else {
            lines.push(Line::Assumed(words));
            lines.push(Line::Dormant("height_datum = \"ellipsoid\"".to_owned()));
        }
    }
    for quantity in ["gimbal yaw, elevation, roll", "camera yaw, pitch, roll", "UAV yaw"] {
        if let Some(origin) = origin(quantity) {
            lines.push(Line::Note(format!("{quantity}: {}: {}", origin.from, origin.meaning)));
        }
    }
    if attitude == Attitude::OfBodyByCourse {
        lines.push(text("heading", "course"));
        lines.extend(crab(&exposures));
    }
    Some(Source {
        name: "the photos' own metadata".to_owned(),
        lines,
        exposures,
        attitude,
        is_photos: true,
        heights_are_stated,
        by_name: true,
        gimbal_reference: None,
    })
}

fn attitude_of(exposures: &[Exposure]) -> Attitude {
    let most =
        |test: &dyn Fn(&Exposure) -> bool| 2 * exposures.iter().filter(|e| test(e)).count() > exposures.len();
    let of_body = |e: &Exposure| matches!(e.attitude, Some(LoggedAttitude::Body { .. }));
    let by_course =
        |e: &Exposure| matches!(e.attitude, Some(LoggedAttitude::Body { north: North::Course, .. }));
    if most(&|e| e.gimbal.is_some() || e.attitude.is_some() && !of_body(e)) {
        Attitude::OfCamera
    } else if most(&by_course) {
        Attitude::OfBodyByCourse
    } else if most(&of_body) {
        Attitude::OfBody
    } else {
        Attitude::Missing
    }
}

/// How far the nose may be off the course, from the speeds with and against the wind.
fn crab(exposures: &[Exposure]) -> Vec<Line> {
    let mut speeds: Vec<f64> = exposures.iter().filter_map(|e| e.ground_speed_m_s).collect();
    speeds.sort_by(f64::total_cmp);
    let at = |share: f64| speeds.get((share * (speeds.len() as f64 - 1.0)).round() as usize).copied();
    let wind = match (at(0.05), at(0.95)) {
        (Some(slow), Some(fast)) if speeds.len() >= 10 && fast > 1.0 => Some((slow, fast)),
        _ => None,
    };
    let Some((slow, fast)) = wind else {
        return vec![
            Line::Assumed(
                "the nose is off the course by 10 deg (1 sigma): wind of a sixth of the air speed".to_owned(),
            ),
            text("crab_std", "10 deg"),
        ];
    };
    let (air, wind) = (0.5 * (fast + slow), 0.5 * (fast - slow));
    let most = Radians::new((wind / air).min(1.0).asin()).degrees();
    // Over all directions the crab angle varies like a sine.
    let std = (most / std::f64::consts::SQRT_2).clamp(1.0, 60.0).round();
    vec![
        Line::Assumed(format!(
            "the ground speed lies between {slow:.1} and {fast:.1} m/s: a wind of {wind:.1} m/s at an air speed of {air:.1} \
             m/s would push the nose up to {most:.0} deg off the course, {std:.0} deg in the mean square"
        )),
        text("crab_std", &format!("{std:.0} deg")),
    ]
}

fn of_table(survey: &Survey<'_>, table: &Poses) -> Source {
    let name = shown(survey.root, &table.path);
    let mut lines = vec![Line::Table("georeference.log")];
    lines.push(Line::Note(format!(
        "{name} names {} of {} photos, with position and attitude.",
        table.exposures.len(),
        survey.photos.photos.len()
    )));
    lines.push(Line::Key("file".to_owned(), quoted_path(survey.base, &table.path)));
    if table.delimiter != b',' {
        lines.push(text("delimiter", &char::from(table.delimiter).to_string()));
    }
    lines.push(text("join", "name"));
    let by_course = table.column(Role::Yaw).is_some_and(|yaw| yaw.says == Some("course_over_ground"));
    if by_course {
        lines.extend(crab(&table.exposures));
    }
    lines.push(Line::Table("georeference.log.columns"));
    let heights_are_stated = columns(table, &mut lines);
    let attitude = match (table.has(&[Role::GimbalPan, Role::GimbalElevation]), by_course) {
        (true, _) => Attitude::OfCamera,
        (false, true) => Attitude::OfBodyByCourse,
        (false, false) => Attitude::OfBody,
    };
    Source {
        name: format!("the table {name}"),
        lines,
        exposures: table.exposures.clone(),
        attitude,
        is_photos: false,
        heights_are_stated,
        by_name: true,
        gimbal_reference: (attitude == Attitude::OfCamera).then(|| gimbal_reference(&table.exposures)),
    }
}

/// A gimbal's pan that goes along with the UAV's yaw counts from north; one that stays put while the UAV turns, from its nose.
fn gimbal_reference(exposures: &[Exposure]) -> &'static str {
    let both = exposures.iter().filter_map(|e| match (e.gimbal, e.attitude) {
        (Some(gimbal), Some(LoggedAttitude::Body { angles, .. })) => Some((gimbal.angles.pan, angles.yaw)),
        _ => None,
    });
    let (apart, from_zero): (Vec<f64>, Vec<f64>) =
        both.map(|(pan, yaw)| ((pan - yaw).wrapped().degrees().abs(), pan.wrapped().degrees().abs())).unzip();
    match (median(apart), median(from_zero)) {
        (Some(apart), Some(from_zero)) if from_zero < apart => "body",
        _ => "nav",
    }
}

/// The columns' lines; whether the heights' datum is said by the table.
fn columns(table: &Poses, lines: &mut Vec<Line>) -> bool {
    use Role::*;
    let mut stated = true;
    let with = |name: &str, unit: &str, more: &str| {
        format!("{{ column = {}, unit = \"{unit}\"{more} }}", quoted(name))
    };
    for (role, name) in [
        (Frame, "frame"),
        (Latitude, "latitude"),
        (Longitude, "longitude"),
        (Height, "height"),
        (Yaw, "yaw"),
        (Pitch, "pitch"),
        (Roll, "roll"),
        (GimbalPan, "gimbal_pan"),
        (GimbalElevation, "gimbal_elevation"),
        (GimbalRoll, "gimbal_roll"),
        (GroundSpeed, "ground_speed"),
        (HalfTurns, "pixel_rotation"),
        (Turned, "pixel_rotation"),
    ] {
        let Some(column) = table.column(role) else { continue };
        let (n, unit) = (column.name.as_str(), column.unit);
        let value = match role {
            Frame => quoted(n),
            Height => {
                let datum = column.says.unwrap_or("egm96");
                if column.says.is_none() {
                    stated = false;
                    lines.push(Line::Assumed(format!(
                        "\"{n}\" is above sea level (EGM96), as most receivers and autopilots have it; write \"ellipsoid\" \
                         if the program that made the table says so"
                    )));
                }
                with(n, unit, &format!(", datum = \"{datum}\""))
            }
            Yaw => with(
                n,
                unit,
                &format!(", sense = \"{}\"", column.says.unwrap_or("clockwise_from_true_north")),
            ),
            Pitch => with(n, unit, ", sense = \"nose_up\""),
            Roll => with(n, unit, ", sense = \"right_wing_down\""),
            GimbalPan | GimbalRoll => with(n, unit, ", sense = \"clockwise\""),
            GimbalElevation => with(n, unit, ", sense = \"up\""),
            HalfTurns => format!("{{ column = {}, meaning = \"half_turns\" }}", quoted(n)),
            Turned => format!("{{ column = {}, meaning = \"degrees_clockwise\" }}", quoted(n)),
            _ => with(n, unit, ""),
        };
        if role == Yaw {
            lines.push(Line::Assumed(
                "angles have the usual senses (yaw clockwise, pitch nose up, roll right wing down): the table's names \
                 give quantity and unit only"
                    .to_owned(),
            ));
        }
        lines.push(Line::Key(name.to_owned(), value));
    }
    stated
}

fn of_file(survey: &Survey<'_>, path: &Path, format: LogFormat) -> Result<Source, String> {
    let size = std::fs::metadata(path).map_err(|e| e.to_string())?.len();
    if size > MOST_LOG_BYTES {
        return Err(format!("is {size} bytes long; it was not read to see what is in it"));
    }
    let (log, lines_of_reader, heights_are_stated) = read(path, format)?;
    let by_name = log.exposures.iter().any(|e| e.frame.is_some());
    let named: Vec<Exposure> = log
        .exposures
        .iter()
        .filter(|e| e.frame.as_ref().is_some_and(|f| survey.photos.photos.iter().any(|p| p.name == *f)))
        .cloned()
        .collect();
    if by_name && named.is_empty() {
        return Err(format!("names {} photos, none of these", log.exposures.len()));
    }
    let series = || {
        let step = (log.positions.len() / 1000).max(1);
        log.positions.iter().step_by(step).map(|sample| {
            let mut exposure = Exposure::at(sample.place);
            exposure.position = Some(sample.value);
            exposure
        })
    };
    let mut exposures = if by_name { named } else { log.exposures.clone() };
    if exposures.iter().all(|e| e.position.is_none()) {
        exposures = series().collect();
    }
    let mut attitude = attitude_of(&exposures);
    if attitude == Attitude::Missing && !log.gimbals.is_empty() {
        attitude = Attitude::OfCamera;
    } else if attitude == Attitude::Missing && !log.attitudes.is_empty() {
        attitude = Attitude::OfBody;
    }
    let own = survey.photos.photos.iter().filter_map(|p| p.metadata.as_ref().map(|m| m.exposure.clone()));
    // A log of positions alone leaves the attitude to the photos.
    if attitude == Attitude::Missing {
        attitude = attitude_of(&own.collect::<Vec<_>>());
    }
    let name = shown(survey.root, path);
    let records = match (by_name, log.exposures.len()) {
        (true, _) => format!("names {} of {} photos", exposures.len(), survey.photos.photos.len()),
        (false, 0) => format!("holds {} positions, no exposures", log.positions.len()),
        (false, count) => format!("holds {count} exposures for {} photos", survey.photos.photos.len()),
    };
    let mut lines = vec![
        Line::Table("georeference.log"),
        Line::Note(format!("{name} {records}.")),
        text("format", format.word()),
        Line::Key("file".to_owned(), quoted_path(survey.base, path)),
    ];
    lines.extend(lines_of_reader);
    Ok(Source {
        name: format!("{name} ({})", format.word()),
        lines,
        exposures,
        attitude,
        is_photos: false,
        heights_are_stated,
        by_name,
        gimbal_reference: None,
    })
}

/// Reads a log, declaring what it leaves open until it can be read.
fn read(path: &Path, format: LogFormat) -> Result<(FlightLog, Vec<Line>, bool), String> {
    let mut stated = StatedOfFile {
        angles: None,
        angle_unit: AngleUnit::Deg,
        column_order: None,
        offset_file: None,
        reference_file: None,
    };
    let mut lines = Vec::new();
    let mut heights = None;
    loop {
        let error = match read_file(path, format, &stated, None, heights) {
            Ok(log) => return Ok((log, lines, heights.is_none())),
            Err(error) => error,
        };
        let help = error.help.clone().unwrap_or_default();
        let open = |word: &str| help.contains(word) || error.cause.contains(word);
        if stated.angles.is_none() && (open("angles`") || open("omega")) {
            stated.angles = Some(AngleSystem::CameraYawPitchRoll);
            lines.push(Line::Question(format!(
                "{} (the file does not say it). Meanwhile they are taken for yaw, pitch, roll of a camera that looks straight \
                 down at zero; the program that wrote the file knows: see `angles` in [georeference.log]",
                error.cause
            )));
            lines.push(text("angles", "camera_yaw_pitch_roll"));
        } else if heights.is_none() && open("height") {
            heights = Some(HeightDatum::Egm96);
            lines.push(Line::Assumed(format!("heights are above sea level (EGM96): {}", error.cause)));
            lines.push(text("height_datum", "egm96"));
        } else {
            return Err(format!("cannot be used: {}", error.cause));
        }
    }
}
