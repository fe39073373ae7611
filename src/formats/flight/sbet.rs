//! SBET trajectories (Applanix POSPac): 17 little-endian doubles a record, and the accuracies beside them (smrmsg).
//!
//! # Source
//! Applanix POSPac, "SBET format": time, latitude, longitude, altitude, velocities and heading in the wander frame (with
//! wander 0: x north, y west, z up), wander angle, body accelerations and rates.

use super::autopilot::{Quarantine, array_at, backward_steps};
use super::{
    Clock, FlightLog, LoggedAttitude, LoggedPosition, LoggedStd, North, Origin, ReadError, Sample, geodetic,
    plausible_angles, plausible_speed,
};
use crate::geodesy::{Geodetic, HeightKind, WGS84};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Ned};
use crate::units::{Metres, Radians, Seconds};

/// Bytes of a trajectory's record.
const RECORD: usize = 17 * 8;
/// Bytes of an accuracy file's record.
const ACCURACY: usize = 10 * 8;
const WEEK_S: f64 = 604_800.0;

/// How the level velocities of a file are to be understood.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Axes {
    /// As Applanix documents: wander frame, y west of x, z up.
    Wander,
    /// North, east, down, as some converters write.
    NorthEastDown,
    /// North, east, up.
    NorthEastUp,
}

impl Axes {
    /// North, east, down of the three numbers.
    fn ned(self, v: [f64; 3], wander: f64) -> [f64; 3] {
        let (sin, cos) = wander.sin_cos();
        match self {
            Self::Wander => [v[0] * cos - v[1] * sin, -v[0] * sin - v[1] * cos, -v[2]],
            Self::NorthEastDown => v,
            Self::NorthEastUp => [v[0], v[1], -v[2]],
        }
    }
}

/// One record as it stands in the file.
#[derive(Debug, Clone, Copy)]
struct Record([f64; 17]);

impl Record {
    fn at(bytes: &[u8], at: usize) -> Option<Self> {
        let mut values = [0.0; 17];
        for (i, value) in values.iter_mut().enumerate() {
            *value = f64::from_le_bytes(array_at(bytes, at + 8 * i)?);
        }
        Some(Self(values))
    }
    fn time(&self) -> Result<Seconds, String> {
        // A flight over the week's end counts on; more than two weeks is no time of a week.
        let time = self.0[0];
        if (0.0..2.0 * WEEK_S).contains(&time) {
            Ok(Seconds::new(time))
        } else {
            Err(format!("{time} s is no second of a GPS week"))
        }
    }
    fn position(&self) -> Result<LoggedPosition, String> {
        let [_, latitude, longitude, height, ..] = self.0;
        geodetic(Radians::new(latitude), Radians::new(longitude), height, HeightKind::Ellipsoid)
    }
    fn attitude(&self) -> Result<LoggedAttitude, String> {
        let [.., roll, pitch, platform, wander, _, _, _, _, _, _] = self.0;
        let angles =
            YawPitchRoll::new(Radians::new(platform - wander), Radians::new(pitch), Radians::new(roll));
        Ok(LoggedAttitude::Body { angles: plausible_angles(angles)?, north: North::True })
    }
    const fn velocity(&self) -> [f64; 3] {
        [self.0[4], self.0[5], self.0[6]]
    }
    const fn wander(&self) -> f64 {
        self.0[10]
    }
}

/// Reads an SBET trajectory: positions, attitudes and velocities on GPS seconds of a week that the file does not name.
///
/// # Errors
/// A file without a single usable record.
pub fn read(bytes: &[u8]) -> Result<FlightLog, ReadError> {
    if bytes.len() < RECORD {
        return Err(ReadError::new(format!("{} bytes hold no SBET record of {RECORD} bytes", bytes.len())));
    }
    let mut log = FlightLog::new(Clock::GpsWeek);
    let mut quarantine = Quarantine::default();
    let mut kept = Vec::with_capacity(bytes.len() / RECORD);
    for (place, at) in (1u64..).zip((0..=bytes.len() - RECORD).step_by(RECORD)) {
        let Some(record) = Record::at(bytes, at) else { break };
        let usable = || Ok((record.time()?, record.position()?, record.attitude()?));
        let Some((time, position, attitude)) = quarantine.keep(place, "SBET record", usable()) else {
            continue;
        };
        log.positions.push(Sample { place, time, value: position });
        log.attitudes.push(Sample { place, time, value: attitude });
        kept.push((place, time, record));
    }
    let rest = bytes.len() % RECORD;
    let place = (bytes.len() / RECORD) as u64 + 1;
    if rest > 0 {
        quarantine.add(place, format!("the file ends {rest} bytes into a record of {RECORD} bytes"));
    }
    if kept.is_empty() {
        return Err(ReadError::new(format!(
            "none of {} records of {RECORD} bytes holds a position on Earth at a second of a week: no SBET file",
            bytes.len() / RECORD
        )));
    }
    velocities(&kept, &mut quarantine, &mut log);
    quarantine.finish(&mut log);
    describe(&mut log);
    Ok(log)
}

/// Velocities, by the axes that the positions themselves confirm.
fn velocities(kept: &[(u64, Seconds, Record)], quarantine: &mut Quarantine, log: &mut FlightLog) {
    let Some((axes, words)) = confirmed_axes(kept) else {
        log.notes.push(
            "the velocities are left out: they fit the change of position in none of the known axes"
                .to_owned(),
        );
        return;
    };
    log.notes.push(words);
    for (place, time, record) in kept {
        let [n, e, d] = axes.ned(record.velocity(), record.wander());
        let velocity =
            || Ok(Displacement::<Ned>::new(plausible_speed(n)?, plausible_speed(e)?, plausible_speed(d)?));
        if let Some(value) = quarantine.keep(*place, "SBET velocity", velocity()) {
            log.velocities.push(Sample { place: *place, time: *time, value });
        }
    }
    log.origins.push(Origin {
        quantity: "velocity",
        from: "doubles 5 to 7 and 11 (x, y, z velocity, m/s; wander angle, radians)".to_owned(),
        meaning: "north = x·cos(wander) − y·sin(wander), east = −x·sin(wander) − y·cos(wander), down = −z unless a \
                  note says otherwise"
            .to_owned(),
    });
}

/// The axes whose velocities fit the change of position best; the documented ones where the flight does not tell.
fn confirmed_axes(kept: &[(u64, Seconds, Record)]) -> Option<(Axes, String)> {
    let all = [Axes::Wander, Axes::NorthEastDown, Axes::NorthEastUp];
    // Some thousand intervals of at least a fifth of a second tell; the whole file need not be read again.
    let step = (kept.len() / 4_000).max(1);
    let (mut misfit, mut moved, mut count) = ([0.0; 3], 0.0, 0u32);
    let mut next = 0;
    for first in (0..kept.len()).step_by(step) {
        next = next.max(first);
        while next < kept.len() && (kept[next].1 - kept[first].1).get() < 0.2 {
            next += 1;
        }
        let Some(last) = kept.get(next) else { break };
        let seconds = (last.1 - kept[first].1).get();
        if seconds > 2.0 {
            continue;
        }
        let travelled = displacement(&kept[first].2, &last.2).map(|m| m / seconds);
        let mean = |i: usize| 0.5 * (kept[first].2.velocity()[i] + last.2.velocity()[i]);
        let v = [mean(0), mean(1), mean(2)];
        for (axes, misfit) in all.iter().zip(&mut misfit) {
            let ned = axes.ned(v, last.2.wander());
            let off: f64 = ned.iter().zip(travelled).map(|(a, b)| (a - b) * (a - b)).sum();
            // One broken record must not decide.
            *misfit += off.min(1e4);
        }
        moved += travelled.iter().map(|m| m * m).sum::<f64>().min(1e4);
        count += 1;
    }
    let rms = |sum: f64| (sum / f64::from(count.max(1))).sqrt();
    if count < 10 || rms(moved) < 1.0 {
        let words = "velocities are taken by Applanix's wander frame (x, y to its left, z up): the file is too short \
                     or too slow to confirm it";
        return Some((Axes::Wander, words.to_owned()));
    }
    let best = (0..3).min_by(|a, b| misfit[*a].total_cmp(&misfit[*b]))?;
    if rms(misfit[best]) > 0.2 * rms(moved) + 0.3 {
        return None;
    }
    let name = match all[best] {
        Axes::Wander => "in Applanix's wander frame (x, y to its left, z up)",
        Axes::NorthEastDown => "north, east, down",
        Axes::NorthEastUp => "north, east, up",
    };
    let words = format!(
        "velocities are {name}: they fit the change of position to {:.2} m/s rms over {count} intervals",
        rms(misfit[best])
    );
    Some((all[best], words))
}

/// From one record's position to another's, north, east, down at the first, metres.
fn displacement(from: &Record, to: &Record) -> [f64; 3] {
    let geodetic = |r: &Record| Geodetic {
        latitude: Radians::new(r.0[1]),
        longitude: Radians::new(r.0[2]),
        height: Metres::new(r.0[3]),
    };
    let (a, b) = (geodetic(from), geodetic(to));
    let ned_from_ecef = crate::geodesy::LocalTangent::at(a).ecef_from_ned().inverse();
    let p = ned_from_ecef * WGS84.ecef_from_geodetic(&b);
    [p.x(), p.y(), p.z()]
}

fn describe(log: &mut FlightLog) {
    log.notes.push(format!(
        "SBET trajectory of {} records; its datum is not in the file: WGS 84 or the ITRF of the base station is \
         assumed (a national datum differs by up to metres)",
        log.positions.len()
    ));
    log.notes.push("the GPS week is not in the file".to_owned());
    let back = backward_steps(&log.positions);
    if back > 0 {
        log.notes.push(format!(
            "time runs backwards {back} times: the end of a GPS week, or several files in one"
        ));
    }
    let origin = |quantity, from: &str, meaning: &str| Origin {
        quantity,
        from: from.to_owned(),
        meaning: meaning.to_owned(),
    };
    log.origins.extend([
        origin("time", "double 1, seconds", "GPS seconds of the week"),
        origin("latitude, longitude", "doubles 2 and 3, radians", "WGS 84 or ITRF, of the reference point"),
        origin("height", "double 4, metres", "above the ellipsoid"),
        origin("roll, pitch", "doubles 8 and 9, radians", "right wing down, nose up"),
        origin(
            "yaw",
            "doubles 10 and 11 (platform heading, wander angle), radians",
            "true heading = platform heading − wander angle",
        ),
    ]);
}

/// Standard deviations of a trajectory over time, from the accuracy file beside it (`smrmsg_*.out`).
///
/// Ten little-endian doubles a record: time, position (north, east, down, m), velocity (m/s), roll, pitch, heading
/// (minutes of arc). Places and times are those of the accuracy file; unusable records are the second part.
///
/// # Errors
/// A file without a single usable record.
pub fn read_accuracy(bytes: &[u8]) -> Result<(Vec<Sample<LoggedStd>>, Vec<super::BadRecord>), ReadError> {
    let mut log = FlightLog::new(Clock::GpsWeek);
    let mut quarantine = Quarantine::default();
    let mut samples = Vec::with_capacity(bytes.len() / ACCURACY);
    for (place, record) in (1u64..).zip(bytes.chunks(ACCURACY)) {
        let Some(sample) = quarantine.keep(place, "accuracy", accuracy(record)) else { continue };
        samples.push(Sample { place, time: sample.0, value: sample.1 });
    }
    quarantine.finish(&mut log);
    if samples.is_empty() {
        return Err(ReadError::new(format!(
            "{} bytes hold no accuracy record of {ACCURACY} bytes that makes sense",
            bytes.len()
        )));
    }
    Ok((samples, log.bad))
}

fn accuracy(record: &[u8]) -> Result<(Seconds, LoggedStd), String> {
    let at = |i: usize| {
        array_at(record, 8 * i)
            .map(f64::from_le_bytes)
            .ok_or_else(|| format!("the file ends {} bytes into a record of {ACCURACY} bytes", record.len()))
    };
    // The last double first: a short record is told as one.
    let heading = at(9)?;
    let time = at(0)?;
    if !(0.0..2.0 * WEEK_S).contains(&time) {
        return Err(format!("{time} s is no second of a GPS week"));
    }
    let sigma = |value: f64, limit: f64| {
        if (0.0..limit).contains(&value) {
            Ok(value)
        } else {
            Err(format!("{value} is no standard deviation"))
        }
    };
    let angle = |minutes: f64| sigma(minutes, 10_800.0).map(|m| Some(Radians::from_degrees(m / 60.0)));
    let std = LoggedStd {
        north_m: Some(sigma(at(1)?, 1e5)?),
        east_m: Some(sigma(at(2)?, 1e5)?),
        up_m: Some(sigma(at(3)?, 1e5)?),
        roll: angle(at(7)?)?,
        pitch: angle(at(8)?)?,
        yaw: angle(heading)?,
    };
    Ok((Seconds::new(time), std))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bytes_of(records: &[[f64; 17]]) -> Vec<u8> {
        records.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()
    }

    /// Flies along a true heading at 20 m/s and climbs at 2 m/s, written with a wander angle: positions by the radii of
    /// curvature at 45° N (6 367 382 m, 6 388 838 m), independent of the code above.
    fn flight(true_heading_deg: f64, wander_deg: f64, n: usize) -> Vec<[f64; 17]> {
        let rad = |d: f64| d * std::f64::consts::PI / 180.0;
        let (course, wander) = (rad(true_heading_deg), rad(wander_deg));
        let (north, east) = (20.0 * course.cos(), 20.0 * course.sin());
        (0..n)
            .map(|i| {
                let t = 0.005 * i as f64;
                let mut r = [0.0; 17];
                r[0] = 345_600.0 + t;
                r[1] = rad(45.0) + north * t / (6_367_382.0 + 300.0);
                r[2] = rad(7.0) + east * t / ((6_388_838.0 + 300.0) * rad(45.0).cos());
                r[3] = 300.0 + 2.0 * t;
                // The wander frame's x points `wander` to the left of north, its y to the left of x.
                r[4] = north * wander.cos() - east * wander.sin();
                r[5] = -north * wander.sin() - east * wander.cos();
                r[6] = 2.0;
                r[7] = rad(3.0);
                r[8] = rad(-1.5);
                r[9] = course + wander;
                r[10] = wander;
                r
            })
            .collect()
    }

    #[test]
    fn a_trajectory_is_read_in_the_wander_frame() {
        let log = read(&bytes_of(&flight(60.0, 25.0, 400))).unwrap();
        assert_eq!((log.clock, log.positions.len(), log.bad.len()), (Clock::GpsWeek, 400, 0));
        assert_eq!(log.positions[0].time.get(), 345_600.0);
        let LoggedPosition::Geodetic { latitude, longitude, height_m, kind } = log.positions[0].value else {
            panic!()
        };
        assert!((latitude.degrees() - 45.0).abs() < 1e-12 && (longitude.degrees() - 7.0).abs() < 1e-12);
        assert_eq!((height_m, kind), (300.0, HeightKind::Ellipsoid));
        let LoggedAttitude::Body { angles, north } = log.attitudes[7].value else { panic!() };
        assert_eq!(north, North::True);
        assert!((angles.yaw.degrees() - 60.0).abs() < 1e-9);
        assert!((angles.pitch.degrees() + 1.5).abs() < 1e-9 && (angles.roll.degrees() - 3.0).abs() < 1e-9);
        let v = log.velocities[100].value;
        assert!(
            (v.x() - 10.0).abs() < 1e-9 && (v.y() - 17.320_508_075_688_775).abs() < 1e-9 && v.z() == -2.0
        );
        assert!(log.notes.iter().any(|n| n.contains("wander frame") && n.contains("fit")), "{:?}", log.notes);
    }

    #[test]
    fn the_positions_tell_which_axes_the_velocities_have() {
        let mut ned = flight(60.0, 0.0, 400);
        for r in &mut ned {
            r[5] = -r[5];
            r[6] = -r[6];
        }
        let log = read(&bytes_of(&ned)).unwrap();
        assert!((log.velocities[9].value.y() - 17.320_508_075_688_775).abs() < 1e-9);
        assert_eq!(log.velocities[9].value.z(), -2.0);
        assert!(log.notes.iter().any(|n| n.contains("north, east, down")), "{:?}", log.notes);
        for r in &mut ned {
            (r[4], r[5]) = (-r[4], r[4] + 7.0);
        }
        let log = read(&bytes_of(&ned)).unwrap();
        assert!(log.velocities.is_empty() && log.positions.len() == 400);
    }

    #[test]
    fn one_bad_record_takes_only_itself_along() {
        let mut records = flight(0.0, 0.0, 20);
        records[3][1] = f64::NAN;
        records[5][0] = -1.0;
        records[7][9] = 1e9;
        records[9][3] = 1e7;
        let mut bytes = bytes_of(&records);
        bytes.extend([0; 50]);
        let log = read(&bytes).unwrap();
        assert_eq!(log.positions.len(), 16);
        assert_eq!(log.bad.iter().map(|b| b.place).collect::<Vec<_>>(), [4, 6, 8, 10, 21]);
        assert!(log.bad[4].cause.contains("50 bytes"), "{}", log.bad[4].cause);
        assert!(
            read(&[]).is_err()
                && read(&[0; 1000]).is_err()
                && read(&[0xFF; 1000]).is_err()
                && read(&bytes[..135]).is_err()
        );
    }

    #[test]
    fn accuracies_are_read_in_minutes_of_arc() {
        let record = [345_600.0, 0.02, 0.03, 0.05, 0.01, 0.01, 0.01, 0.6, 0.6, 3.0];
        let mut bytes: Vec<u8> = record.iter().flat_map(|v: &f64| v.to_le_bytes()).collect();
        bytes.extend(bytes.clone());
        bytes.truncate(150);
        let (samples, bad) = read_accuracy(&bytes).unwrap();
        assert_eq!((samples.len(), bad.len(), samples[0].value.up_m), (1, 1, Some(0.05)));
        assert!((samples[0].value.yaw.unwrap().degrees() - 0.05).abs() < 1e-12);
        assert!((samples[0].value.roll.unwrap().degrees() - 0.01).abs() < 1e-12);
        assert!(read_accuracy(&[0xFF; 400]).is_err() && read_accuracy(&[]).is_err());
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..1000)) {
            let _ = read_accuracy(&bytes);
            if let Ok(log) = read(&bytes) {
                prop_assert!(log.positions.len() + log.bad.len() <= bytes.len() / 68 + 1);
            }
        }

        #[test]
        fn damage_is_survived(at in 0usize..136 * 30, flip in 1u8.., cut in 0usize..136 * 30) {
            let mut bytes = bytes_of(&flight(100.0, -40.0, 30));
            bytes[at] ^= flip;
            let whole = read(&bytes).unwrap();
            prop_assert!(whole.positions.len() >= 29);
            if let Ok(log) = read(&bytes[..cut]) {
                prop_assert!(log.positions.len() <= cut / 136);
            }
        }
    }
}
