//! RTKLIB's `.pos` files: the antenna's track after RTK or PPK, and the events between its epochs.
//!
//! # Source
//! RTKLIB 2.4 manual, appendix B.1 "Positioning solution file", and the behaviour of `solution.c` (names of columns, signed
//! square roots of covariances, `WGS84/ellipsoidal` and `WGS84/geodetic`).

use super::declared::ecef;
use super::poses::words;
use super::text::{bad, lines, not_empty, number, short};
use super::{
    Clock, Exposure, FlightLog, LoggedPosition, LoggedStd, Origin, ReadError, Sample, geodetic,
    plausible_speed, utc_from_gps,
};
use crate::geodesy::{HeightKind, LocalTangent, WGS84};
use crate::geometry::{Displacement, Ecef, Ned};
use crate::units::{Radians, Seconds};
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// The clock of the first column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TimeSystem {
    Gps,
    Utc,
    Japan,
}

/// How the position is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Position {
    Degrees,
    DegreesMinutesSeconds,
    Ecef,
}

/// The line that names the columns.
#[derive(Debug)]
struct Header {
    time: TimeSystem,
    position: Position,
    /// Names behind the time, each with the place of its first cell behind the two of the time.
    columns: Vec<(String, usize)>,
    cells: usize,
    separator: char,
    heights: HeightKind,
}

/// Reads a `.pos` file. `as_events`: each row is an exposure (RTKLIB's `…_events.pos`), not an epoch of the track.
///
/// `heights`: what heights are measured from where the header does not say "ellipsoidal"; RTKLIB's "geodetic" heights count
/// from a geoid whose model the file does not name.
///
/// # Errors
/// [`ReadError`] without a header, for baselines (e/n/u), another datum than WGS 84, an unknown kind of heights, and when
/// no row is usable.
pub fn read(bytes: &[u8], as_events: bool, heights: Option<HeightKind>) -> Result<FlightLog, ReadError> {
    let mut log = FlightLog::new(Clock::Utc);
    let mut header: Option<Header> = None;
    let mut stated_heights = None;
    let mut quality = [0usize; 8];
    let mut origins: Arc<[Origin]> = Arc::new([]);
    for (place, line) in lines(bytes)? {
        let line = match line {
            Ok(line) => line,
            Err(cause) => {
                bad(&mut log, place, None, cause)?;
                continue;
            }
        };
        if line.trim().is_empty() {
            continue;
        }
        if let Some(comment) = line.trim_start().strip_prefix('%') {
            if let Some(kind) = heights_of(comment).map_err(|e| e.line(place))? {
                stated_heights = Some(kind);
            } else if header.is_none() && names_columns(comment) {
                let kind = settle_heights(comment, stated_heights, heights).map_err(|e| e.line(place))?;
                let found = Header::of(comment, kind).map_err(|e| e.line(place))?;
                origins = found.origins().into();
                header = Some(found);
            }
            continue;
        }
        let Some(header) = &header else {
            return Err(ReadError::new("has rows before the header that names the columns")
                .line(place)
                .help("let RTKLIB write the header (out-outhead = on)"));
        };
        match header.row(line).and_then(|row| row.checked()) {
            Ok(row) => {
                quality[row.quality.min(7)] += 1;
                row.push(place, as_events, &origins, &mut log);
            }
            Err(cause) => bad(&mut log, place, None, cause)?,
        }
    }
    if header.is_none() {
        return Err(ReadError::new("has no line that names RTKLIB's columns")
            .help("an RTKLIB .pos file has a line \"%  GPST  latitude(deg) …\""));
    }
    notes(&mut log, &quality);
    log.origins = origins.to_vec();
    not_empty(log, "an RTKLIB .pos file")
}

fn notes(log: &mut FlightLog, quality: &[usize; 8]) {
    const NAMES: [&str; 8] =
        ["no solution", "fixed", "float", "SBAS", "DGPS", "single", "PPP", "another quality"];
    let counts: Vec<_> =
        NAMES.iter().zip(quality).filter(|(_, n)| **n > 0).map(|(name, n)| format!("{n} {name}")).collect();
    log.notes.push(format!("Positions are the antenna's, by quality: {}.", counts.join(", ")));
}

fn names_columns(comment: &str) -> bool {
    ["latitude(", "x-ecef(", "e-baseline("].iter().any(|name| comment.contains(name))
}

/// The heights of a line `(lat/lon/height=WGS84/ellipsoidal,…)`: `Some(None)` for a geoid without a name.
fn heights_of(comment: &str) -> Result<Option<Option<HeightKind>>, ReadError> {
    let Some((_, after)) = comment.split_once("lat/lon/height=") else { return Ok(None) };
    let (datum, rest) = after.split_once('/').unwrap_or((after, ""));
    if datum != "WGS84" {
        return Err(ReadError::new(format!("positions are on the datum \"{}\", not WGS 84", short(datum)))
            .help("let RTKLIB write WGS 84 (out-outdatum = wgs84)"));
    }
    Ok(Some(rest.starts_with("ellipsoidal").then_some(HeightKind::Ellipsoid)))
}

fn settle_heights(
    columns: &str,
    stated: Option<Option<HeightKind>>,
    declared: Option<HeightKind>,
) -> Result<HeightKind, ReadError> {
    // A baseline has no height either; it is refused with the header.
    if columns.contains("x-ecef(") || columns.contains("e-baseline(") {
        return Ok(HeightKind::Ellipsoid);
    }
    match (stated.flatten(), declared) {
        (Some(kind), Some(other)) if kind != other => Err(ReadError::new(format!(
            "the header measures heights from {}, the declaration from {}",
            words(kind),
            words(other)
        ))),
        (Some(kind), _) | (None, Some(kind)) => Ok(kind),
        (None, None) if stated.is_some() => {
            Err(ReadError::new("heights are \"geodetic\": above a geoid whose model the file does not name")
                .help(
                    "declare its `height_datum` (RTKLIB's own geoid is EGM96), or write ellipsoidal heights",
                ))
        }
        (None, None) => Err(ReadError::new("the header does not state what heights are measured from")
            .help("declare its `height_datum`, or let RTKLIB write the full header (out-outhead = on)")),
    }
}

impl Header {
    fn of(comment: &str, heights: HeightKind) -> Result<Self, ReadError> {
        let (position, anchor) = if comment.contains("x-ecef(") {
            (Position::Ecef, "x-ecef(m)")
        } else if comment.contains("e-baseline(") {
            return Err(ReadError::new("holds baselines from the base station (e/n/u), not positions")
                .help("let RTKLIB write latitude, longitude, height or x/y/z-ecef (out-solformat = llh)"));
        } else if comment.contains("latitude(deg)") {
            (Position::Degrees, "latitude(deg)")
        } else {
            (Position::DegreesMinutesSeconds, "latitude(d'\")")
        };
        // As RTKLIB does: the character behind the first column's name parts the cells.
        let separator = comment.split_once(anchor).and_then(|(_, rest)| rest.chars().next()).unwrap_or(' ');
        let mut names =
            comment.split(|c: char| c.is_whitespace() || c == separator).filter(|name| !name.is_empty());
        let time = match names.next() {
            Some("GPST") => TimeSystem::Gps,
            Some("UTC") => TimeSystem::Utc,
            Some("JST") => TimeSystem::Japan,
            other => {
                return Err(ReadError::new(format!(
                    "the time column is \"{}\", none of GPST, UTC, JST",
                    short(other.unwrap_or(""))
                )));
            }
        };
        let mut columns = Vec::new();
        let mut cells = 0;
        for name in names.take(64) {
            columns.push((name.to_owned(), cells));
            cells += if name.ends_with("(d'\")") { 3 } else { 1 };
        }
        let header = Self { time, position, columns, cells, separator, heights };
        match header.place("Q") {
            Some(_) => Ok(header),
            None => Err(ReadError::new("the header has no column Q (quality)")),
        }
    }

    fn place(&self, name: &str) -> Option<usize> {
        self.columns.iter().find(|(n, _)| n == name || n.split('(').next() == Some(name)).map(|(_, at)| *at)
    }

    fn row(&self, line: &str) -> Result<Row, String> {
        let cells: Vec<&str> = line
            .split(|c: char| c.is_whitespace() || c == self.separator)
            .filter(|cell| !cell.is_empty())
            .collect();
        // Newer versions add columns behind the named ones.
        if cells.len() < self.cells + 2 {
            return Err(format!("has {} cells, the header names {}", cells.len(), self.cells + 2));
        }
        let time = self.time(cells[0], cells[1])?;
        let cells = &cells[2..];
        let get = |name: &str| match self.place(name) {
            Some(at) => number(name, cells.get(at).unwrap_or(&"")).map(Some),
            None => Ok(None),
        };
        let need = |name: &str| get(name)?.ok_or_else(|| format!("the header has no column {name}"));
        let position = match self.position {
            Position::Degrees => geodetic(
                Radians::from_degrees(need("latitude")?),
                Radians::from_degrees(need("longitude")?),
                need("height")?,
                self.heights,
            )?,
            Position::DegreesMinutesSeconds => geodetic(
                self.sexagesimal("latitude", cells)?,
                self.sexagesimal("longitude", cells)?,
                need("height")?,
                self.heights,
            )?,
            Position::Ecef => ecef(need("x-ecef")?, need("y-ecef")?, need("z-ecef")?)?,
        };
        let quality = need("Q")?;
        let three = |names: [&str; 3]| -> Result<Option<Vector3<f64>>, String> {
            match (get(names[0])?, get(names[1])?, get(names[2])?) {
                (Some(a), Some(b), Some(c)) => Ok(Some(Vector3::new(a, b, c))),
                _ => Ok(None),
            }
        };
        let (std, velocity) = match position {
            LoggedPosition::Ecef(point) => {
                let here = LocalTangent::at(WGS84.geodetic_from_ecef(&point));
                let ned_from_ecef = here.ecef_from_ned().rotation.inverse();
                let std = three(["sdx", "sdy", "sdz"])?;
                let cross = three(["sdxy", "sdyz", "sdzx"])?.unwrap_or_default();
                let velocity = three(["vx", "vy", "vz"])?;
                (
                    std.map(|s| std_in_ned(&ned_from_ecef.matrix(), &s, &cross)),
                    velocity.map(|v| ned_from_ecef * Displacement::<Ecef>::from_vector(v)),
                )
            }
            LoggedPosition::Geodetic { .. } | LoggedPosition::Projected { .. } => (
                three(["sdn", "sde", "sdu"])?,
                three(["vn", "ve", "vu"])?.map(|v| Displacement::new(v.x, v.y, -v.z)),
            ),
        };
        Ok(Row { time, position, quality: quality.clamp(0.0, 255.0) as usize, std, velocity })
    }

    /// Degrees, minutes and seconds; the degrees carry the sign, "-0" too.
    fn sexagesimal(&self, name: &str, cells: &[&str]) -> Result<Radians, String> {
        let at = self.place(name).unwrap_or(0);
        let cell = |i: usize| cells.get(at + i).copied().unwrap_or("");
        let (degrees, minutes, seconds) =
            (number(name, cell(0))?, number("minutes", cell(1))?, number("seconds", cell(2))?);
        // Rounding may print 60 seconds.
        if !(0.0..=60.0).contains(&minutes) || !(0.0..=60.0).contains(&seconds) {
            return Err(format!("{name} has {minutes} minutes and {seconds} seconds"));
        }
        let size = degrees.abs() + minutes / 60.0 + seconds / 3600.0;
        Ok(Radians::from_degrees(if cell(0).starts_with('-') { -size } else { size }))
    }

    /// `week second` or `yyyy/mm/dd hh:mm:ss.s`.
    fn time(&self, first: &str, second: &str) -> Result<Seconds, String> {
        let gps_or_civil = if first.contains('/') {
            civil(first, second)?
        } else {
            let week = first.parse().map_err(|_| format!("GPS week \"{}\" is not a number", short(first)))?;
            let second = number("second of week", second)?;
            if self.time == TimeSystem::Gps {
                return utc_from_gps(week, second);
            }
            // Week and second of UTC or JST, as RTKLIB prints them: no leap seconds.
            utc_from_gps(week, second)?;
            GPS_EPOCH + f64::from(week) * 604_800.0 + second
        };
        match self.time {
            TimeSystem::Gps => {
                let since = gps_or_civil - GPS_EPOCH;
                let week = (since / 604_800.0).floor();
                utc_from_gps(week as u32, since - week * 604_800.0)
            }
            TimeSystem::Utc => Ok(Seconds::new(gps_or_civil)),
            TimeSystem::Japan => Ok(Seconds::new(gps_or_civil - 9.0 * 3600.0)),
        }
    }

    fn origins(&self) -> Vec<Origin> {
        let origin =
            |quantity, from: String, meaning: &str| Origin { quantity, from, meaning: meaning.to_owned() };
        let names = |wanted: [&str; 3]| {
            let all: Vec<_> = wanted
                .iter()
                .filter_map(|w| {
                    self.columns.iter().find(|(n, _)| n.split('(').next() == Some(w)).map(|(n, _)| n.as_str())
                })
                .collect();
            all.join(", ")
        };
        let system = match self.time {
            TimeSystem::Gps => "GPS time, brought to UTC by the leap seconds of its date",
            TimeSystem::Utc => "UTC",
            TimeSystem::Japan => "Japan standard time (UTC + 9 h), brought to UTC",
        };
        let position = match self.position {
            Position::Ecef => {
                (["x-ecef", "y-ecef", "z-ecef"], "WGS 84, Earth-centred, of the antenna".to_owned())
            }
            Position::Degrees | Position::DegreesMinutesSeconds => (
                ["latitude", "longitude", "height"],
                format!("WGS 84, of the antenna; height above {}", words(self.heights)),
            ),
        };
        let mut all = vec![
            origin("time", "the first two cells".to_owned(), system),
            origin("position", names(position.0), &position.1),
        ];
        if self.place("vn").or_else(|| self.place("vx")).is_some() {
            let wanted =
                if self.position == Position::Ecef { ["vx", "vy", "vz"] } else { ["vn", "ve", "vu"] };
            all.push(origin("velocity", names(wanted), "of the antenna, brought to north, east, down"));
        }
        all
    }
}

/// Unix time at which GPS time began.
const GPS_EPOCH: f64 = 315_964_800.0;

/// Seconds since 1970 of a date and a time of day, both on one unnamed clock.
fn civil(date: &str, time: &str) -> Result<f64, String> {
    let bad = || format!("\"{} {}\" is no date and time", short(date), short(time));
    let mut parts = date.split('/').map(|p| p.parse::<i16>().ok());
    let (Some(Some(year)), Some(Some(month)), Some(Some(day)), None) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(bad());
    };
    let mut parts = time.split(':').map(|p| p.parse::<f64>().ok());
    let (Some(Some(hour)), Some(Some(minute)), Some(Some(second)), None) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(bad());
    };
    if !(0.0..24.0).contains(&hour) || !(0.0..60.0).contains(&minute) || !(0.0..61.0).contains(&second) {
        return Err(bad());
    }
    let [month, day] = [month, day].map(|v| i8::try_from(v).unwrap_or(0));
    let date = jiff::civil::Date::new(year, month, day).map_err(|_| bad())?;
    if !(1980..2100).contains(&year) {
        return Err(format!("year {year} lies outside 1980 to 2099"));
    }
    let days = date.since(jiff::civil::date(1970, 1, 1)).map_err(|_| bad())?.get_days();
    Ok(f64::from(days) * 86_400.0 + hour * 3_600.0 + minute * 60.0 + second)
}

/// Standard deviations towards north, east and up from RTKLIB's Earth-centred ones; `cross` holds the signed square roots
/// of the covariances xy, yz, zx.
fn std_in_ned(ned_from_ecef: &Matrix3<f64>, std: &Vector3<f64>, cross: &Vector3<f64>) -> Vector3<f64> {
    let [xx, yy, zz] = [std.x, std.y, std.z].map(|s| s * s);
    let [xy, yz, zx] = [cross.x, cross.y, cross.z].map(|s| s * s.abs());
    let covariance = Matrix3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz);
    let turned = ned_from_ecef * covariance * ned_from_ecef.transpose();
    turned.diagonal().map(|v| v.max(0.0).sqrt())
}

struct Row {
    time: Seconds,
    position: LoggedPosition,
    quality: usize,
    /// North, east, up.
    std: Option<Vector3<f64>>,
    velocity: Option<Displacement<Ned>>,
}

impl Row {
    fn checked(self) -> Result<Self, String> {
        if self.quality == 0 {
            return Err("Q 0: there is no solution".to_owned());
        }
        if let Some(velocity) = self.velocity {
            plausible_speed(velocity.vector().norm())?;
        }
        Ok(self)
    }

    fn push(self, place: u64, as_events: bool, origins: &Arc<[Origin]>, log: &mut FlightLog) {
        let Self { time, position, std, velocity, .. } = self;
        if !as_events {
            log.positions.push(Sample { place, time, value: position });
            log.velocities.extend(velocity.map(|value| Sample { place, time, value }));
            return;
        }
        let std = std.map_or_else(LoggedStd::default, |s| {
            let known = |v: f64| (v > 0.0).then_some(v);
            LoggedStd { north_m: known(s.x), east_m: known(s.y), up_m: known(s.z), ..LoggedStd::default() }
        });
        log.exposures.push(Exposure {
            time: Some(time),
            position: Some(position),
            velocity,
            std,
            origins: Arc::clone(origins),
            ..Exposure::at(place)
        });
    }
}

#[cfg(test)]
mod tests;
