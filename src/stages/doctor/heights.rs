//! The heights of log, photos and ground against each other.

use super::findings::{Finding, frames_of, names};
use super::view::{Flight, median};
use crate::formats::metadata::Severity;

/// One sigma of a height above take-off or ground (barometer, rangefinder), metres.
const STATED_STD_M: f64 = 3.0;
/// Sigmas that a disagreement has to exceed.
const SIGMAS: f64 = 3.0;
/// Frames below the ground beyond this share of all are no take-off photos any more.
const MANY: f64 = 0.2;

pub(super) fn findings(flight: &Flight<'_>) -> Vec<Finding> {
    [below_ground(flight), disagreement(flight)].into_iter().flatten().collect()
}

/// Whether a frame was rejected because its camera is under the ground.
pub(super) fn is_below_ground(reason: &str) -> bool {
    reason.starts_with("the camera is ") && reason.ends_with(" m below the ground")
}

fn below_ground(flight: &Flight<'_>) -> Option<Finding> {
    let under: Vec<&(String, String)> =
        flight.rejected.iter().filter(|(_, reason)| is_below_ground(reason)).collect();
    let (first, reason) = under.first()?;
    let all = flight.rejected.len() + flight.views.len();
    let many = under.len() as f64 > MANY * all as f64;
    let frames: Vec<String> = under.iter().map(|(name, _)| name.clone()).collect();
    let undulation = flight.undulation_m.map_or(String::new(), |n| {
        format!("; the geoid lies {n:.1} m from the ellipsoid here, so that much changes with a datum")
    });
    Some(Finding {
        severity: if many { Severity::Error } else { Severity::Warning },
        code: "camera-below-ground",
        text: format!(
            "{} of {all} cameras lie below the ground ({first}: {reason}){undulation}",
            frames.len()
        ),
        help: Some(
            "check the datums of the log's heights and of [georeference.ground], and `takeoff_height`"
                .to_owned(),
        ),
        frames,
    })
}

/// Heights above take-off or ground as stated, against those that follow from the position and the ground model.
fn disagreement(flight: &Flight<'_>) -> Option<Finding> {
    if !flight.declared.ground_has_heights {
        return None;
    }
    let grounds: Vec<f64> = flight.views.iter().filter_map(|view| view.ground_m).collect();
    let (low, high) =
        grounds.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), g| (l.min(*g), h.max(*g)));
    let above_ground = flight.views.iter().filter(|view| view.above_ground_m.is_some()).count();
    let by_ground = 2 * above_ground > flight.views.len();
    // What take-off height the ground has is not known: anywhere between the lowest and the highest ground flown over.
    let (what, relief) = match by_ground {
        true => ("above ground", 0.0),
        false => ("above the take-off point", 0.5 * (high - low)),
    };
    let differences: Vec<f64> = flight
        .views
        .iter()
        .filter_map(|view| {
            let stated = if by_ground { view.above_ground_m } else { view.above_takeoff_m }?;
            Some(view.height_m - view.ground_m? - stated)
        })
        .collect();
    if 2 * differences.len() < flight.views.len() {
        return None;
    }
    let difference = median(differences)?;
    let ((height_std, height_said), (ground_std, ground_said)) =
        (flight.declared.height_std_m, flight.declared.ground_std_m);
    let relief = relief.max(0.0);
    let std = [height_std, ground_std, STATED_STD_M, relief].iter().map(|s| s * s).sum::<f64>().sqrt();
    if difference.abs() <= SIGMAS * std {
        return None;
    }
    let said = |said: bool| if said { "as declared" } else { "assumed" };
    let mut text = format!(
        "the log's positions lie {:.1} m {} where the heights {what} put them (median over the frames; one sigma is \
         {std:.1} m: height {height_std} m {}, ground {ground_std} m {}, height {what} {STATED_STD_M} m assumed, \
         relief {relief:.1} m)",
        difference.abs(),
        if difference > 0.0 { "above" } else { "below" },
        said(height_said),
        said(ground_said),
    );
    let mut help = "check the datum of the log's heights and that of [georeference.ground]".to_owned();
    if let Some(n) = flight.undulation_m.filter(|n| n.abs() > SIGMAS * std) {
        let explained = |by: f64| (difference - by).abs() <= SIGMAS * std;
        let looks = match (explained(n), explained(-n)) {
            (true, _) => Some(("ellipsoidal heights", "above sea level", "ellipsoid")),
            (_, true) => Some(("heights above sea level", "ellipsoidal", "egm96")),
            _ => None,
        };
        if let Some((are, taken, datum)) = looks {
            text.push_str(&format!(
                "; {n:.1} m is the geoid's undulation here: the log's heights look like {are} taken for {taken}, or \
                 the ground's the other way round"
            ));
            help = format!("if the log's heights are {are}, declare them so (datum \"{datum}\")");
        }
    }
    Some(Finding {
        severity: Severity::Warning,
        code: "heights-disagree",
        frames: frames_of(&flight.views),
        text,
        help: Some(help),
    })
}

/// Frames whose photo says it was taken elsewhere than the log's pose.
pub(super) fn places(flight: &Flight<'_>) -> Option<Finding> {
    /// Farther than a receiver without corrections errs, and than a second's flight.
    const FAR_M: f64 = 50.0;
    let far: Vec<(&str, f64)> = flight
        .views
        .iter()
        .filter_map(|view| {
            let apart = super::view::distance(view.place, view.photo_place?);
            (apart > FAR_M).then_some((view.name.as_str(), apart))
        })
        .collect();
    let worst = far.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let frames: Vec<String> = far.iter().map(|(name, _)| (*name).to_owned()).collect();
    Some(Finding {
        severity: Severity::Warning,
        code: "photo-position-disagrees",
        text: format!(
            "{} of {} photos say that they were taken more than {FAR_M} m from the place the log gives them ({}; the \
             farthest is {}, {:.0} m)",
            far.len(),
            flight.views.len(),
            names(&frames),
            worst.0,
            worst.1
        ),
        help: Some(
            "check which photo belongs to which record (`join`, clock offset), and the log's CRS".to_owned(),
        ),
        frames,
    })
}

#[cfg(test)]
mod tests {
    use super::super::findings::tests::{photos, strip};
    use super::*;

    #[test]
    fn a_wrong_datum_is_found_and_the_undulation_named() {
        let none = photos();
        let mut flight = Flight::made(strip(8), &none);
        for view in &mut flight.views {
            (view.height_m, view.ground_m, view.above_takeoff_m) = (300.0, Some(200.0), Some(98.0));
        }
        flight.undulation_m = Some(-35.8);
        assert_eq!(disagreement(&flight), None);
        // Ellipsoidal heights taken for heights above sea level have N added: 35.8 m too low.
        flight.views.iter_mut().for_each(|view| view.height_m -= 35.8);
        let found = disagreement(&flight).unwrap();
        assert_eq!((found.code, found.frames.len()), ("heights-disagree", 8));
        assert!(found.text.contains("33.8 m below"), "{}", found.text);
        assert!(found.text.contains("-35.8 m is the geoid's undulation here"), "{}", found.text);
        assert!(
            found.text.contains("look like ellipsoidal heights taken for above sea level"),
            "{}",
            found.text
        );
        // The other way round.
        flight.views.iter_mut().for_each(|view| view.height_m += 71.6);
        let found = disagreement(&flight).unwrap();
        assert!(found.text.contains("heights above sea level taken for ellipsoidal"), "{}", found.text);
        // Something else: 80 m.
        flight.views.iter_mut().for_each(|view| view.height_m += 50.0);
        let found = disagreement(&flight).unwrap();
        assert!(!found.text.contains("undulation"), "{}", found.text);
    }

    #[test]
    fn sigmas_and_relief_decide_what_is_a_disagreement() {
        let none = photos();
        let mut flight = Flight::made(strip(8), &none);
        for view in &mut flight.views {
            (view.height_m, view.ground_m, view.above_takeoff_m) = (320.0, Some(200.0), Some(98.0));
        }
        // 22 m against 3 · √(5² + 5² + 3²) = 23.04 m.
        assert_eq!(disagreement(&flight), None);
        flight.declared.height_std_m = (1.0, true);
        // 3 · √(1 + 25 + 9) = 17.7 m.
        assert!(disagreement(&flight).unwrap().text.contains("height 1 m as declared"));
        // Ground from 180 m to 220 m: the take-off point may lie at either.
        for (i, view) in flight.views.iter_mut().enumerate() {
            view.ground_m = Some(if i % 2 == 0 { 180.0 } else { 220.0 });
        }
        assert_eq!(disagreement(&flight), None);
        // Stated above ground, relief is no excuse.
        flight.views.iter_mut().for_each(|view| view.above_ground_m = Some(98.0));
        assert!(disagreement(&flight).unwrap().text.contains("heights above ground"));
        // Ground at a stated height below each camera has no height to compare with.
        flight.declared.ground_has_heights = false;
        assert_eq!(disagreement(&flight), None);
    }

    #[test]
    fn cameras_below_the_ground_are_an_error_when_they_are_many() {
        let none = photos();
        let mut flight = Flight::made(strip(8), &none);
        assert_eq!(below_ground(&flight), None);
        flight.rejected.push(("z.jpg".to_owned(), "the camera is 3.2 m below the ground".to_owned()));
        assert_eq!(below_ground(&flight).unwrap().severity, Severity::Warning);
        for i in 0..8 {
            flight.rejected.push((format!("y{i}.jpg"), "the camera is 33.0 m below the ground".to_owned()));
        }
        let found = below_ground(&flight).unwrap();
        assert_eq!((found.severity, found.frames.len()), (Severity::Error, 9));
        assert!(found.text.starts_with("9 of 17 cameras"), "{}", found.text);
    }

    #[test]
    fn photos_taken_elsewhere_are_named() {
        let none = photos();
        let mut flight = Flight::made(strip(6), &none);
        for view in &mut flight.views {
            view.photo_place = Some([view.place[0] + 12.0, view.place[1] - 9.0]);
        }
        assert_eq!(places(&flight), None);
        flight.views[2].photo_place = Some([view_east(&flight, 2) + 400.0, 0.0]);
        let found = places(&flight).unwrap();
        assert_eq!(found.frames, [flight.views[2].name.clone()]);
        assert!(found.text.contains("400 m"), "{}", found.text);
    }

    fn view_east(flight: &Flight<'_>, i: usize) -> f64 {
        flight.views[i].place[0]
    }
}
