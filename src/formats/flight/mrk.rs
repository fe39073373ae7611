//! DJI's `.MRK` files: one line per photo with its GPS time, the RTK position and the lever arm at that instant.
//!
//! # Source
//! DJI, user manuals of the Zenmuse P1 (p. 24) and the Matrice 4 (p. 92), "Image Log File"; white paper of the Phantom 4
//! RTK, "Timestamp.MRK": N, E and V are millimetres from the antenna's phase centre to the sensor's, positive north, east
//! and down; latitude and longitude are given after this compensation, so they are the camera's.

use super::text::{bad, lines, not_empty, number, short, std};
use super::{
    Clock, Exposure, FlightLog, LoggedPosition, LoggedStd, Origin, ReadError, geodetic, utc_from_gps,
};
use crate::geodesy::{Geodetic, HeightKind, LocalTangent, WGS84};
use crate::geometry::{Displacement, Ned, Point};
use crate::units::Seconds;
use std::sync::Arc;

/// One line, read.
struct Mark {
    sequence: u64,
    second_of_week: f64,
    week: Option<u32>,
    camera_from_antenna: Displacement<Ned>,
    camera: Geodetic,
    std: LoggedStd,
    flag: u32,
}

/// Reads a `.MRK` file. Each exposure has its number, its time, the antenna's position (the file's position less its lever
/// arm), the lever arm and the standard deviations. Photos are not named: DJI's end in the number (`…_0001.JPG`).
///
/// Times are UTC when the lines hold the GPS week, seconds of the GPS week otherwise.
///
/// # Errors
/// [`ReadError`] when no line is usable.
pub fn read(bytes: &[u8]) -> Result<FlightLog, ReadError> {
    let mut log = FlightLog::new(Clock::Utc);
    let mut with_week = None;
    let mut flags = [0usize; 3];
    let origins: Arc<[Origin]> = origins().into();
    for (place, line) in lines(bytes)? {
        let mark = match line {
            Ok(line) if line.trim().is_empty() => continue,
            Ok(line) => mark(line),
            Err(cause) => Err(cause),
        };
        let exposure = mark.and_then(|mark| {
            if *with_week.get_or_insert(mark.week.is_some()) != mark.week.is_some() {
                return Err(
                    "states a GPS week where the lines before do not, or the other way about".to_owned()
                );
            }
            let exposure = exposure(place, &mark, &origins)?;
            flags[match mark.flag {
                50.. => 0,
                32..=49 => 1,
                _ => 2,
            }] += 1;
            Ok(exposure)
        });
        match exposure {
            Ok(exposure) => log.exposures.push(exposure),
            Err(cause) => bad(&mut log, place, None, cause)?,
        }
    }
    if with_week == Some(false) {
        log.clock = Clock::GpsWeek;
        log.notes.push("No GPS week is stated: times are seconds of an unnamed GPS week.".to_owned());
    }
    log.notes.push(
        "Positions in a .MRK file are the camera's; the antenna's are got by taking the stated lever arm off again."
            .to_owned(),
    );
    log.notes.push(
        "Photos are not named in a .MRK file: number n belongs to the photo whose name ends in n (…_0001.JPG)."
            .to_owned(),
    );
    let [_, float, single] = flags;
    if float + single > 0 {
        log.notes.push(format!(
            "Of {} positions {float} are RTK float and {single} single-point: see their standard deviations.",
            log.exposures.len()
        ));
    }
    log.origins = origins.to_vec();
    not_empty(log, "a DJI .MRK file")
}

fn mark(line: &str) -> Result<Mark, String> {
    let (before, week, after) = match line.split_once('[').and_then(|(a, rest)| {
        let (week, b) = rest.split_once(']')?;
        Some((a, week.trim(), b))
    }) {
        Some((before, week, after)) => {
            let week = week.parse().map_err(|_| format!("GPS week \"{}\" is not a number", short(week)))?;
            (before, Some(week), after)
        }
        None => (line, None, ""),
    };
    let mut cells = Cells(before.split(PARTED).chain(after.split(PARTED)).filter(|c| !c.is_empty()));
    let sequence = cells.integer("photo number")?;
    let second_of_week = cells.number("GPS second of week")?;
    let n = cells.labelled("offset north", "N")?;
    let e = cells.labelled("offset east", "E")?;
    let v = cells.labelled("offset down", "V")?;
    let latitude = cells.labelled("latitude", "Lat")?;
    let longitude = cells.labelled("longitude", "Lon")?;
    let height = cells.labelled("ellipsoidal height", "Ellh")?;
    let mut deviation = |name| std(name, cells.0.next().unwrap_or(""));
    let (north_m, east_m, up_m) =
        (deviation("sigma north")?, deviation("sigma east")?, deviation("sigma height")?);
    let flag = cells.integer("flag")?;
    cells.label("Q")?;
    if [n, e, v].iter().any(|mm| mm.abs() > 10_000.0) {
        return Err(format!("the lever arm {n}, {e}, {v} mm is longer than 10 m"));
    }
    Ok(Mark {
        sequence,
        second_of_week,
        week,
        camera_from_antenna: Displacement::new(n * 1e-3, e * 1e-3, v * 1e-3),
        camera: Geodetic::from_degrees(latitude, longitude, height),
        std: LoggedStd { north_m, east_m, up_m, ..LoggedStd::default() },
        flag: u32::try_from(flag).map_err(|_| format!("flag {flag} is none of DJI's"))?,
    })
}

const PARTED: [char; 3] = [' ', '\t', ','];

/// The cells of a line, one after another.
struct Cells<I>(I);

impl<'a, I: Iterator<Item = &'a str>> Cells<I> {
    fn number(&mut self, name: &str) -> Result<f64, String> {
        number(name, self.0.next().unwrap_or(""))
    }
    fn integer(&mut self, name: &str) -> Result<u64, String> {
        let text = self.0.next().unwrap_or("");
        text.parse().map_err(|_| format!("{name} is \"{}\", not a whole number", short(text)))
    }
    fn label(&mut self, label: &str) -> Result<(), String> {
        match self.0.next().unwrap_or("") {
            text if text.eq_ignore_ascii_case(label) => Ok(()),
            text => Err(format!("\"{label}\" is expected where \"{}\" stands", short(text))),
        }
    }
    fn labelled(&mut self, name: &str, label: &str) -> Result<f64, String> {
        let value = self.number(name)?;
        self.label(label)?;
        Ok(value)
    }
}

fn exposure(place: u64, mark: &Mark, origins: &Arc<[Origin]>) -> Result<Exposure, String> {
    if mark.flag == 0 {
        return Err("flag 0: the receiver had no position".to_owned());
    }
    let Geodetic { latitude, longitude, height } = mark.camera;
    geodetic(latitude, longitude, height.get(), HeightKind::Ellipsoid)?;
    let time = match mark.week {
        Some(week) => utc_from_gps(week, mark.second_of_week)?,
        None if (0.0..604_800.0).contains(&mark.second_of_week) => Seconds::new(mark.second_of_week),
        None => return Err(format!("{} s is no second of a GPS week", mark.second_of_week)),
    };
    Ok(Exposure {
        sequence: Some(mark.sequence),
        time: Some(time),
        position: Some(antenna(&mark.camera, &mark.camera_from_antenna)),
        std: mark.std,
        camera_from_antenna: Some(mark.camera_from_antenna),
        origins: Arc::clone(origins),
        ..Exposure::at(place)
    })
}

/// The antenna's position, so that adding the lever arm gives the camera's again.
fn antenna(camera: &Geodetic, camera_from_antenna: &Displacement<Ned>) -> LoggedPosition {
    let arm = camera_from_antenna.vector();
    let antenna = if arm.norm() == 0.0 {
        *camera
    } else {
        let back = Point::<Ned>::from_vector(-arm);
        WGS84.geodetic_from_ecef(&(*LocalTangent::at(*camera).ecef_from_ned() * back))
    };
    LoggedPosition::Geodetic {
        latitude: antenna.latitude,
        longitude: antenna.longitude.wrapped(),
        height_m: antenna.height.get(),
        kind: HeightKind::Ellipsoid,
    }
}

fn origins() -> Vec<Origin> {
    let origin = |quantity, from: &str, meaning: &str| Origin {
        quantity,
        from: from.to_owned(),
        meaning: meaning.to_owned(),
    };
    vec![
        origin(
            "time",
            "column 2, GPS second of week; column 3, [GPS week]",
            "instant of exposure, brought to UTC",
        ),
        origin(
            "latitude",
            "…,Lat, degrees",
            "WGS 84, of the camera; the lever arm is taken off to get the antenna's",
        ),
        origin(
            "longitude",
            "…,Lon, degrees",
            "WGS 84, of the camera; the lever arm is taken off to get the antenna's",
        ),
        origin(
            "height",
            "…,Ellh, metres",
            "above the WGS 84 ellipsoid, of the camera; the antenna's as above",
        ),
        origin("lever arm", "…,N …,E …,V, millimetres", "from the antenna to the camera: north, east, down"),
        origin(
            "position sigma",
            "the three numbers after Ellh, metres",
            "north, east, height; one standard deviation",
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Metres;
    use proptest::prelude::*;

    const LINE: &str = "1\t400373.488877\t[2264]\t   -40,N\t     0,E\t    86,V\t44.42824637,Lat\t1.26196331,Lon\t\
                        359.494,Ellh\t0.028, 0.031, 0.055\t16,Q";

    #[test]
    fn a_line_of_a_mavic_3() {
        let log = read(LINE.as_bytes()).unwrap();
        assert_eq!((log.clock, log.bad.len(), log.exposures.len()), (Clock::Utc, 0, 1));
        let e = &log.exposures[0];
        assert_eq!((e.sequence, e.frame.as_deref()), (Some(1), None));
        // GPS week 2264 began on 2023-05-28; 400373.488877 s later less 18 leap seconds: 2023-06-01T15:12:35.488877Z.
        assert!((e.time.unwrap().get() - 1_685_632_355.488_877).abs() < 1e-6, "{:?}", e.time);
        assert_eq!(e.std.north_m.zip(e.std.east_m).zip(e.std.up_m), Some(((0.028, 0.031), 0.055)));
        let arm = e.camera_from_antenna.unwrap().vector();
        assert!((arm.x + 0.040).abs() < 1e-12 && arm.y == 0.0 && (arm.z - 0.086).abs() < 1e-12);
        assert!(log.notes.iter().any(|n| n.contains("1 single-point")));
    }

    #[test]
    fn the_lever_arm_leads_from_the_antenna_to_the_stated_position() {
        let log = read(LINE.as_bytes()).unwrap();
        let Some(LoggedPosition::Geodetic { latitude, longitude, height_m, kind }) =
            log.exposures[0].position
        else {
            panic!("{:?}", log.exposures[0].position)
        };
        assert_eq!(kind, HeightKind::Ellipsoid);
        // The camera is 40 mm south of the antenna and 86 mm below: the antenna is north of it and higher. One degree of
        // latitude at 44.4° is 111 113 m.
        assert!(((latitude.degrees() - 44.428_246_37) * 111_113.0 - 0.040).abs() < 1e-5);
        assert!((longitude.degrees() - 1.261_963_31).abs() < 1e-11);
        assert!((height_m - 359.580).abs() < 1e-6, "{height_m}");
        let antenna = Geodetic { latitude, longitude, height: Metres::new(height_m) };
        let camera = *LocalTangent::at(antenna).ecef_from_ned()
            * Point::from_vector(log.exposures[0].camera_from_antenna.unwrap().vector());
        let stated = WGS84.ecef_from_geodetic(&Geodetic::from_degrees(44.428_246_37, 1.261_963_31, 359.494));
        assert!(camera.distance_to(&stated) < 1e-8);
    }

    #[test]
    fn bad_lines_are_kept_apart() {
        let bad = [
            LINE.replace("16,Q", "0,Q"),
            LINE.replace("44.42824637", "0.0").replace("1.26196331", "0"),
            LINE.replace("44.42824637", "91"),
            LINE.replace("44.42824637", "nan"),
            LINE.replace("[2264]", "[1]"),
            LINE.replace("[2264]", "[x]"),
            LINE.replace("400373.488877", "700000"),
            LINE.replace("-40,N", "-40000000,N"),
            LINE.replace(",Lat", ",Lon"),
            LINE.replace("[2264]", ""),
            "1\t2".to_owned(),
            "\u{e9}".to_owned(),
        ];
        let text = format!("\u{feff}{LINE}\r\n\r\n{}\r\n", bad.join("\r\n"));
        let log = read(text.as_bytes()).unwrap();
        assert_eq!((log.exposures.len(), log.bad.len()), (1, bad.len()));
        assert_eq!(log.bad[0].place, 3);
        assert!(log.bad[2].cause.contains("91"), "{}", log.bad[2].cause);
        assert!(read(b"").unwrap_err().cause.contains("no record"));
        assert_eq!(read(b"hello").unwrap_err().line, Some(1));
    }

    #[test]
    fn without_a_week_times_are_of_an_unnamed_one() {
        let log = read(LINE.replace("[2264]\t", "").as_bytes()).unwrap();
        assert_eq!(log.clock, Clock::GpsWeek);
        assert!((log.exposures[0].time.unwrap().get() - 400_373.488_877).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(cut in 0usize..160, at in 0usize..160, with in any::<u8>()) {
            let mut bytes = [LINE, LINE].join("\n").into_bytes();
            let n = bytes.len();
            bytes[at % n] = with;
            bytes.truncate(cut % n + 1);
            if let Ok(log) = read(&bytes) {
                prop_assert!(log.exposures.len() + log.bad.len() <= bytes.len() + 1);
            }
        }
    }
}
