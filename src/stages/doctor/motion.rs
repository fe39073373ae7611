//! Places, times and speeds from frame to frame.

use super::findings::{Finding, names};
use super::frames::FrameRow;
use super::view::{Flight, View, distance, median, quantile};
use crate::formats::metadata::Severity;

/// Faster than any aircraft that carries a mapping camera at this scale, m/s.
const TOO_FAST_M_S: f64 = 60.0;
/// Nearer than two photos of a flight, metres.
const SAME_PLACE_M: f64 = 0.05;
/// Smear that begins to show, pixels.
const BLUR_PX: f64 = 0.5;

pub(super) fn findings(flight: &Flight<'_>, rows: &[FrameRow]) -> Vec<Finding> {
    let all = [duplicates(flight), jumps(flight), speeds(flight), blur(rows), exposures(rows)];
    all.into_iter().flatten().collect()
}

fn duplicates(flight: &Flight<'_>) -> Option<Finding> {
    let same = |a: &View, b: &View| {
        distance(a.place, b.place) < SAME_PLACE_M && (a.height_m - b.height_m).abs() < SAME_PLACE_M
    };
    let frames: Vec<String> =
        flight.steps().filter(|(a, b)| same(a, b)).map(|(_, b)| b.name.clone()).collect();
    (!frames.is_empty()).then(|| Finding {
        severity: Severity::Warning,
        code: "duplicate-positions",
        text: format!(
            "{} of {} frames have the position of the frame before them, to {SAME_PLACE_M} m ({})",
            frames.len(),
            flight.views.len(),
            names(&frames)
        ),
        help: Some(
            "photos taken standing still are harmless; otherwise the log repeats itself, or photos share a record"
                .to_owned(),
        ),
        frames,
    })
}

/// Distances that nobody flies in the time between two frames.
fn jumps(flight: &Flight<'_>) -> Option<Finding> {
    let resolution = flight.time_resolution_s();
    let usual = median(flight.steps().map(|(a, b)| distance(a.place, b.place)).collect())?;
    let fast: Vec<(&View, f64, Option<f64>)> = flight
        .steps()
        .filter_map(|(a, b)| {
            let far = distance(a.place, b.place);
            match a.time_s.zip(b.time_s) {
                Some((ta, tb)) => {
                    // Times in whole seconds may be nearly one second longer apart than they say.
                    let speed = far / (tb - ta + resolution).max(1e-3);
                    (speed > TOO_FAST_M_S && far > TOO_FAST_M_S * resolution + 5.0).then_some((
                        b,
                        far,
                        Some(speed),
                    ))
                }
                // Without times only what is out of all proportion.
                None => (far > 30.0 * usual && far > 1000.0).then_some((b, far, None)),
            }
        })
        .collect();
    let (to, far, speed) = *fast.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let frames: Vec<String> = fast.iter().map(|(view, ..)| view.name.clone()).collect();
    let how = speed.map_or_else(
        || format!("the usual distance is {usual:.0} m"),
        |speed| format!("{speed:.0} m/s; more than {TOO_FAST_M_S} m/s is not flown"),
    );
    Some(Finding {
        severity: Severity::Warning,
        code: "jumps",
        text: format!(
            "between {} pairs of frames that follow each other lies more than was flown; the farthest: {far:.0} m before \
             {} ({how})",
            fast.len(),
            to.name
        ),
        help: Some(
            "two aircraft or two flights in one folder, a wrong unit or CRS of the log, or photos matched with wrong \
             records"
                .to_owned(),
        ),
        frames,
    })
}

/// Stated speeds against those from places and times.
fn speeds(flight: &Flight<'_>) -> Option<Finding> {
    const FEWEST: usize = 5;
    const SLOW_M_S: f64 = 2.0;
    if flight.time_resolution_s() > 0.0 {
        return None;
    }
    let ratios: Vec<f64> = flight
        .steps()
        .filter_map(|(a, b)| {
            let step = b.time_s? - a.time_s?;
            let flown = distance(a.place, b.place) / step;
            let stated = 0.5 * (a.stated_speed?.0 + b.stated_speed?.0);
            (step > 0.0 && flown > SLOW_M_S).then_some(stated / flown)
        })
        .collect();
    let count = ratios.len();
    let ratio = median(ratios).filter(|_| count >= FEWEST)?;
    let of_unit = match ratio {
        r if (r - 3.6).abs() < 0.4 => " (km/h taken for m/s)",
        r if (r - 1.944).abs() < 0.2 => " (knots taken for m/s)",
        r if (r - 0.278).abs() < 0.03 => " (m/s taken for km/h)",
        r if (r - 0.514).abs() < 0.05 => " (m/s taken for knots)",
        _ => "",
    };
    // Turns make what was flown longer than the straight line between two frames, never shorter.
    (!(0.7..=1.6).contains(&ratio)).then(|| Finding {
        severity: Severity::Warning,
        code: "speed-disagrees",
        frames: Vec::new(),
        text: format!(
            "the stated speed is {ratio:.2} times that from positions and times (median over {count} steps){of_unit}"
        ),
        help: Some("check the unit of the speed, and the clock of the log".to_owned()),
    })
}

fn blur(rows: &[FrameRow]) -> Option<Finding> {
    let known: Vec<(&str, f64)> =
        rows.iter().filter_map(|row| Some((row.frame.as_str(), row.motion_blur_px?))).collect();
    let frames: Vec<String> =
        known.iter().filter(|(_, blur)| *blur > BLUR_PX).map(|(name, _)| (*name).to_owned()).collect();
    if frames.is_empty() {
        return None;
    }
    let values = || known.iter().map(|(_, blur)| *blur).collect::<Vec<f64>>();
    let share = frames.len() as f64 / known.len() as f64;
    Some(Finding {
        severity: if share >= 0.1 { Severity::Warning } else { Severity::Note },
        code: "motion-blur",
        text: format!(
            "{} of {} frames moved by more than {BLUR_PX} px while the shutter was open (median {:.2} px, most {:.2} px)",
            frames.len(),
            known.len(),
            median(values())?,
            quantile(values(), 1.0)?
        ),
        help: Some("shorter exposures or slower flight; detail below the smear is lost".to_owned()),
        frames,
    })
}

fn exposures(rows: &[FrameRow]) -> Option<Finding> {
    let without: Vec<String> = rows
        .iter()
        .filter(|row| row.status == "used" && row.exposure_time_s.is_none())
        .map(|row| row.frame.clone())
        .collect();
    (!without.is_empty()).then(|| Finding {
        severity: Severity::Note,
        code: "exposure-time-unknown",
        text: format!(
            "{} photos do not state their exposure time ({}): their motion blur is not known",
            without.len(),
            names(&without)
        ),
        help: None,
        frames: without,
    })
}

#[cfg(test)]
mod tests {
    use super::super::findings::tests::{codes, photos, strip};
    use super::*;

    fn row(name: &str, blur: Option<f64>) -> FrameRow {
        FrameRow {
            frame: name.to_owned(),
            status: "used",
            exposure_time_s: blur.map(|_| 1e-3),
            motion_blur_px: blur,
            ..FrameRow::default()
        }
    }

    #[test]
    fn a_plain_strip_is_in_order() {
        let none = photos();
        assert_eq!(findings(&Flight::made(strip(12), &none), &[row("a", Some(0.4))]), []);
    }

    #[test]
    fn positions_that_repeat_are_found() {
        let none = photos();
        let mut flight = Flight::made(strip(12), &none);
        flight.views[4].place = flight.views[3].place;
        let found = findings(&flight, &[]);
        assert_eq!(codes(&found), ["duplicate-positions"]);
        assert_eq!(found[0].frames, [flight.views[4].name.clone()]);
        // Straight up and down over one place: another position.
        flight.views[4].height_m += 10.0;
        assert_eq!(findings(&flight, &[]), []);
    }

    #[test]
    fn a_second_aircraft_shows_as_jumps() {
        let none = photos();
        let mut flight = Flight::made(strip(12), &none);
        for view in &mut flight.views[6..] {
            view.place[1] += 2500.0;
        }
        let found = findings(&flight, &[]);
        assert_eq!(codes(&found), ["jumps"]);
        assert_eq!(found[0].frames.len(), 1);
        // Times in whole seconds: 100 m within "1 s" may be 1.99 s.
        let mut flight = Flight::made(strip(6), &none);
        for (i, view) in flight.views.iter_mut().enumerate() {
            (view.place, view.time_s) = ([100.0 * i as f64, 0.0], Some(i as f64));
        }
        assert_eq!(findings(&flight, &[]), []);
        flight.views.iter_mut().for_each(|view| view.time_s = view.time_s.map(|t| t + 0.25));
        assert_eq!(codes(&findings(&flight, &[])), ["jumps"]);
        // Without times, only what is out of proportion.
        flight.views.iter_mut().for_each(|view| view.time_s = None);
        assert_eq!(findings(&flight, &[]), []);
        flight.views[5].place[0] += 9000.0;
        assert_eq!(codes(&findings(&flight, &[])), ["jumps"]);
    }

    #[test]
    fn a_speed_in_another_unit_is_found() {
        let none = photos();
        let mut flight = Flight::made(strip(12), &none);
        for (i, view) in flight.views.iter_mut().enumerate() {
            (view.stated_speed, view.time_s) = (Some((10.3, "log")), Some(2.0 * i as f64 + 0.5));
        }
        assert_eq!(findings(&flight, &[]), []);
        flight.views.iter_mut().for_each(|view| view.stated_speed = Some((36.0, "log")));
        let found = findings(&flight, &[]);
        assert_eq!(codes(&found), ["speed-disagrees"]);
        assert!(found[0].text.contains("3.60 times") && found[0].text.contains("km/h"), "{}", found[0].text);
    }

    #[test]
    fn smear_and_unknown_exposures_are_counted() {
        let none = photos();
        let flight = Flight::made(strip(2), &none);
        let rows: Vec<FrameRow> =
            (0..20).map(|i| row(&i.to_string(), Some(if i == 7 { 0.9 } else { 0.2 }))).collect();
        let found = findings(&flight, &rows);
        assert_eq!((codes(&found)[0], found[0].severity), ("motion-blur", Severity::Note));
        assert!(
            found[0].text.contains("1 of 20") && found[0].text.contains("most 0.90"),
            "{}",
            found[0].text
        );
        let many: Vec<FrameRow> = (0..20).map(|i| row(&i.to_string(), Some(0.6))).collect();
        assert_eq!(findings(&flight, &many)[0].severity, Severity::Warning);
        assert_eq!(codes(&findings(&flight, &[row("a", None)])), ["exposure-time-unknown"]);
    }
}
