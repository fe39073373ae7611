//! Yaw, gimbal and image against the direction of flight.

use super::findings::{Finding, frames_of};
use super::view::{Flight, View, bearing, distance, median, quantile, turn};
use crate::formats::metadata::Severity;

/// Fewer frames on straight lines say nothing.
const FEWEST: usize = 6;
/// Frames nearer to each other than this give no course, metres.
const SHORTEST_STEP_M: f64 = 2.0;
/// A line is straight where its course changes by less than this from frame to frame, degrees.
const STRAIGHT_DEG: f64 = 15.0;
/// Beyond this, one direction points against the other, degrees.
const OPPOSITE_DEG: f64 = 135.0;
/// An autopilot's heading is off the course by more than this sooner or later, degrees.
const SAME_DEG: f64 = 1.0;
/// A crab angle that costs more than the usual heading sensor does, degrees.
const LARGE_CRAB_DEG: f64 = 5.0;

pub(super) fn findings(flight: &Flight<'_>) -> Vec<Finding> {
    let courses = courses(flight);
    let against = |direction: &dyn Fn(&View) -> Option<f64>| -> Vec<f64> {
        courses
            .iter()
            .filter_map(|(index, course)| Some(turn(*course, direction(&flight.views[*index])?)))
            .collect()
    };
    let nose = against(&|view| view.nose_deg);
    let top = against(&|view| view.top_deg);
    let nose_found = nose_findings(flight, &nose);
    let top_found = if nose_found.is_some() { None } else { top_finding(flight, &top) };
    [without_angles(flight), declared_course(flight), nose_found, top_found, gimbal(flight)]
        .into_iter()
        .flatten()
        .collect()
}

/// Course of each frame on a straight line, by the frames before and after it.
fn courses(flight: &Flight<'_>) -> Vec<(usize, f64)> {
    let place = |index: usize| flight.views[index].place;
    flight
        .order
        .windows(3)
        .filter_map(|three| {
            let (before, at, after) = (place(three[0]), place(three[1]), place(three[2]));
            let long = distance(before, at) >= SHORTEST_STEP_M && distance(at, after) >= SHORTEST_STEP_M;
            let straight = turn(bearing(before, at), bearing(at, after)).abs() < STRAIGHT_DEG;
            (long && straight).then(|| (three[1], bearing(before, after)))
        })
        .collect()
}

fn absolute(angles: &[f64]) -> Vec<f64> {
    angles.iter().map(|angle| angle.abs()).collect()
}

fn nose_findings(flight: &Flight<'_>, off: &[f64]) -> Option<Finding> {
    if off.len() < FEWEST {
        return None;
    }
    let middle = median(absolute(off))?;
    if middle > OPPOSITE_DEG {
        return Some(Finding {
            severity: Severity::Warning,
            code: "yaw-against-course",
            frames: frames_of(&flight.views),
            text: format!(
                "yaw points against the direction of flight: {middle:.0} deg off the course (median over {} frames on \
                 straight lines)",
                off.len()
            ),
            help: Some(
                "few aircraft fly backwards: check the sense of yaw and which way the attitude unit is mounted"
                    .to_owned(),
            ),
        });
    }
    let most = quantile(absolute(off), 0.9)?;
    (most < SAME_DEG && flight.declared.crab_std_deg.is_none()).then(|| Finding {
        severity: Severity::Warning,
        code: "yaw-equals-course",
        frames: frames_of(&flight.views),
        text: format!(
            "yaw equals the direction of flight within {most:.2} deg (90 % of {} frames on straight lines): it is \
             probably the receiver's course over ground, which does not know how far the wind turns the nose off it",
            off.len()
        ),
        help: Some(
            "if it is, declare it: `sense = \"course_over_ground\"` (`heading = \"course\"` for other logs) and \
             `crab_std`"
                .to_owned(),
        ),
    })
}

/// The image lies the other way round than the aircraft flies, though its nose does not.
fn top_finding(flight: &Flight<'_>, off: &[f64]) -> Option<Finding> {
    let middle = median(absolute(off)).filter(|_| off.len() >= FEWEST)?;
    (middle > OPPOSITE_DEG).then(|| Finding {
        severity: Severity::Warning,
        code: "image-against-course",
        frames: frames_of(&flight.views),
        text: format!(
            "the top of the images points against the direction of flight: {middle:.0} deg off the course (median over \
             {} frames on straight lines)",
            off.len()
        ),
        help: Some("right for a camera mounted the other way round; otherwise check `gimbal_pan`".to_owned()),
    })
}

fn gimbal(flight: &Flight<'_>) -> Option<Finding> {
    let off: Vec<f64> =
        flight.views.iter().filter_map(|view| Some(turn(view.nose_deg?, view.pan_deg?).abs())).collect();
    let count = off.len();
    let middle = median(off).filter(|_| count >= FEWEST)?;
    (middle > OPPOSITE_DEG).then(|| Finding {
        severity: Severity::Warning,
        code: "gimbal-against-nose",
        frames: frames_of(&flight.views),
        text: format!(
            "the gimbal's yaw is {middle:.0} deg off the aircraft's (median over {count} frames): one of the two counts \
             from the tail, or past nadir"
        ),
        help: Some("check against a photo which way its top points, and declare `gimbal_pan` if need be".to_owned()),
    })
}

fn without_angles(flight: &Flight<'_>) -> Option<Finding> {
    /// A hand-made log of two level photos is no sign of anything.
    const FEWEST: usize = 3;
    let all = flight.views.len() >= FEWEST && flight.views.iter().all(|view| view.without_angles);
    all.then(|| Finding {
        severity: Severity::Warning,
        code: "attitudes-all-zero",
        frames: frames_of(&flight.views),
        text: format!("yaw, pitch and roll of all {} frames are exactly zero", flight.views.len()),
        help: Some(
            "they were probably never measured; choose the columns or the log that hold them".to_owned(),
        ),
    })
}

fn declared_course(flight: &Flight<'_>) -> Option<Finding> {
    let crab = flight.declared.crab_std_deg?;
    let reach = median(
        flight
            .views
            .iter()
            .map(|view| view.outline.iter().map(|p| distance(*p, view.centre)).fold(0.0, f64::max))
            .collect(),
    )?;
    let moved = reach * crate::units::Radians::from_degrees(crab.min(80.0)).get().tan();
    Some(Finding {
        severity: if crab > LARGE_CRAB_DEG { Severity::Warning } else { Severity::Note },
        code: "course-as-yaw",
        frames: frames_of(&flight.views),
        text: format!(
            "yaw is the course over ground, as declared, and the nose may be {crab:.1} deg off it (1 sigma): that moves \
             the corners of a frame by {moved:.1} m"
        ),
        help: (crab > LARGE_CRAB_DEG).then(|| {
            "a log with the autopilot's attitude, or photos with it, would be worth more".to_owned()
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::super::findings::tests::{codes, photos, strip};
    use super::*;

    #[test]
    fn a_flight_whose_nose_wanders_about_the_course_is_in_order() {
        let none = photos();
        assert_eq!(findings(&Flight::made(strip(20), &none)), []);
    }

    #[test]
    fn yaw_that_is_the_course_is_told_from_one_that_is_not() {
        let none = photos();
        let mut flight = Flight::made(strip(20), &none);
        flight.views.iter_mut().for_each(|view| view.nose_deg = Some(90.2));
        assert_eq!(codes(&findings(&flight)), ["yaw-equals-course"]);
        // Declared as what it is, only its price is stated.
        flight.declared.crab_std_deg = Some(14.0);
        let found = findings(&flight);
        assert_eq!(codes(&found), ["course-as-yaw"]);
        assert_eq!(found[0].severity, Severity::Warning);
        // Corners are √(50² + 40²) m away: times tan 14°.
        assert!(found[0].text.contains("by 16.0 m"), "{}", found[0].text);
        flight.declared.crab_std_deg = Some(2.0);
        assert_eq!(findings(&flight)[0].severity, Severity::Note);
        // Too few frames say nothing.
        let mut short = Flight::made(strip(5), &none);
        short.views.iter_mut().for_each(|view| view.nose_deg = Some(90.0));
        assert_eq!(findings(&short), []);
    }

    #[test]
    fn directions_that_point_backwards_are_found() {
        let none = photos();
        let mut flight = Flight::made(strip(20), &none);
        flight.views.iter_mut().for_each(|view| view.top_deg = view.nose_deg.map(|nose| nose + 180.0));
        assert_eq!(codes(&findings(&flight)), ["image-against-course"]);
        flight.views.iter_mut().for_each(|view| view.nose_deg = view.nose_deg.map(|nose| nose - 170.0));
        let found = findings(&flight);
        assert_eq!(codes(&found), ["yaw-against-course"]);
        assert!(found[0].text.contains("170 deg off"), "{}", found[0].text);
        // A multirotor that flies sideways: neither.
        flight.views.iter_mut().for_each(|view| (view.nose_deg, view.top_deg) = (Some(0.0), Some(0.0)));
        assert_eq!(findings(&flight), []);
    }

    #[test]
    fn a_gimbal_against_the_nose_is_found() {
        let none = photos();
        let mut flight = Flight::made(strip(20), &none);
        flight.views.iter_mut().for_each(|view| view.pan_deg = view.nose_deg.map(|nose| nose + 4.0));
        assert_eq!(findings(&flight), []);
        flight.views.iter_mut().for_each(|view| view.pan_deg = view.nose_deg.map(|nose| nose - 178.0));
        assert_eq!(codes(&findings(&flight)), ["gimbal-against-nose"]);
    }

    #[test]
    fn attitudes_that_nobody_measured_are_found() {
        let none = photos();
        let mut flight = Flight::made(strip(4), &none);
        flight.views.iter_mut().for_each(|view| view.without_angles = true);
        assert_eq!(codes(&findings(&flight)), ["attitudes-all-zero"]);
        flight.views[3].without_angles = false;
        assert_eq!(findings(&flight), []);
    }
}
