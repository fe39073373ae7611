//! What the user should know: one finding for each thing that is wrong or may be, with the numbers in it.

use super::frames::FrameRow;
use super::view::{Flight, View, median, quantile};
use super::{headings, heights, metadata, motion};
use crate::formats::metadata::Severity;

/// Something about the flight.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Finding {
    /// An error means that the products would be wrong; a warning, that they may be.
    pub severity: Severity,
    /// A short name that stays the same, for scripts: "heights-disagree".
    pub code: &'static str,
    /// What was found, with the numbers.
    pub text: String,
    /// The next step, where there is an obvious one.
    pub help: Option<String>,
    /// The frames it concerns; empty when it concerns none in particular.
    pub frames: Vec<String>,
}

/// All findings, the gravest first.
pub(super) fn of(flight: &Flight<'_>, rows: &[FrameRow]) -> Vec<Finding> {
    let mut found: Vec<Finding> =
        [rejected(flight), weak_match(flight), turned_by_data(flight), horizon(flight)]
            .into_iter()
            .flatten()
            .collect();
    found.extend(heights::findings(flight));
    found.extend(heights::places(flight));
    found.extend(headings::findings(flight));
    found.extend(motion::findings(flight, rows));
    found.extend(coverage(flight));
    found.extend(metadata::findings(flight));
    found.extend(soft(flight));
    found.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    found
}

/// The first names of a list, and how many more there are.
pub(super) fn names(all: &[String]) -> String {
    const MOST: usize = 4;
    let shown = all.iter().take(MOST).map(String::as_str).collect::<Vec<_>>().join(", ");
    match all.len().saturating_sub(MOST) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// Names of all frames.
pub(super) fn frames_of(views: &[View]) -> Vec<String> {
    views.iter().map(|view| view.name.clone()).collect()
}

fn rejected(flight: &Flight<'_>) -> Option<Finding> {
    let other: Vec<&(String, String)> =
        flight.rejected.iter().filter(|(_, reason)| !heights::is_below_ground(reason)).collect();
    let (first, reason) = other.first()?;
    Some(Finding {
        severity: if flight.declared.too_many_rejected { Severity::Error } else { Severity::Warning },
        code: "frames-rejected",
        text: format!(
            "{} of {} frames would be rejected; the first: {first}: {reason}",
            other.len(),
            flight.views.len() + flight.rejected.len()
        ),
        help: None,
        frames: other.iter().map(|(name, _)| name.clone()).collect(),
    })
}

fn weak_match(flight: &Flight<'_>) -> Option<Finding> {
    const SURE: f64 = 0.95;
    /// Share of the time between frames that the clocks' offset may be uncertain by.
    const OFFSET_SHARE: f64 = 0.25;
    let unsure: Vec<String> = flight
        .matches
        .iter()
        .filter(|(_, found)| found.probability.is_some_and(|p| p < SURE))
        .map(|(name, _)| name.clone())
        .collect();
    let step = median(
        flight.steps().filter_map(|(a, b)| Some(b.time_s? - a.time_s?)).filter(|step| *step > 0.0).collect(),
    );
    let mut said = Vec::new();
    if !unsure.is_empty() {
        said.push(format!(
            "{} of {} photos belong to their record of the log with a probability below {SURE} ({})",
            unsure.len(),
            flight.matches.len(),
            names(&unsure)
        ));
    }
    if let (Some(std), Some(step)) = (flight.clock_std_s, step)
        && std > OFFSET_SHARE * step
    {
        said.push(format!(
            "the clocks of photos and log are known against each other to {std:.2} s (1 sigma) only, with {step:.2} s \
             between frames"
        ));
    }
    if flight.rests_on_count {
        said.push(
            "the exposures are so evenly spaced that only the number of photos and exposures decided which belong together: \
             a photo lost at one end and an event lost at the other would shift all of them by one"
                .to_owned(),
        );
    }
    (!said.is_empty()).then(|| Finding {
        severity: Severity::Warning,
        code: "match-weak",
        text: said.join("; "),
        help: Some("state `clock_offset` in [georeference.log] if it is known".to_owned()),
        frames: unsure,
    })
}

fn turned_by_data(flight: &Flight<'_>) -> Option<Finding> {
    let turned: Vec<_> = flight.turns.as_ref()?.turned().collect();
    let first = turned.first()?;
    let frames: Vec<String> = turned.iter().map(|verdict| verdict.frame.clone()).collect();
    let by: Vec<String> = [90, 180, 270]
        .into_iter()
        .filter_map(|deg| {
            let of: Vec<String> = turned
                .iter()
                .filter(|verdict| verdict.turned_deg == Some(deg))
                .map(|verdict| verdict.frame.clone())
                .collect();
            (!of.is_empty()).then(|| format!("{} by {deg} deg ({})", of.len(), names(&of)))
        })
        .collect();
    Some(Finding {
        severity: Severity::Error,
        code: "pixels-turned",
        text: format!(
            "the pixels of {} frames are turned against what is declared: {}; turned back they fit their neighbours on \
             the ground ({}: correlation {:.2} instead of {:.2}, {} neighbours)",
            turned.len(),
            by.join(", "),
            first.frame,
            first.score_turned.unwrap_or(0.0),
            first.score_as_declared.unwrap_or(0.0),
            first.neighbours
        ),
        help: Some(
            "add to [georeference.mount]: turned_frames = [{ frames = [...], clockwise = \"180\" }] (or a column \
             pixel_rotation of the log); what is declared already is to be replaced by the sum"
                .to_owned(),
        ),
        frames,
    })
}

fn horizon(flight: &Flight<'_>) -> Option<Finding> {
    let frames: Vec<String> =
        flight.views.iter().filter(|view| view.clipped).map(|view| view.name.clone()).collect();
    (!frames.is_empty()).then(|| Finding {
        severity: Severity::Warning,
        code: "horizon",
        text: format!(
            "{} of {} frames see the horizon, or ground that is missing or out of range, or have pixels that the lens cannot \
             resolve, in part of the image ({}); that part is not used",
            frames.len(),
            flight.views.len(),
            names(&frames)
        ),
        help: Some(
            "expected of oblique photos; otherwise check pitch, roll and the gimbal's angles, and how far the elevation \
             model reaches"
                .to_owned(),
        ),
        frames,
    })
}

fn coverage(flight: &Flight<'_>) -> Vec<Finding> {
    /// Neighbours that share less leave gaps as soon as the aircraft rolls.
    const LOW: f64 = 0.3;
    const FEWEST: usize = 4;
    let Some(overlap) = &flight.overlap else { return Vec::new() };
    let mut found = Vec::new();
    let mut add = |severity, code, text, help: &str| {
        found.push(Finding { severity, code, text, help: Some(help.to_owned()), frames: Vec::new() });
    };
    if overlap.parts > 1 {
        add(
            Severity::Warning,
            "separate-areas",
            format!("the footprints fall into {} pieces that do not touch", overlap.parts),
            "two flights in one folder, or gaps; a mosaic of each needs `bounds` in [mosaic]",
        );
    }
    if overlap.holes > 0 {
        add(
            Severity::Warning,
            "coverage-holes",
            format!(
                "{} hole{} of {:.0} m2 in all between the frames ({:.1} % of the ground that is seen)",
                overlap.holes,
                if overlap.holes == 1 { "" } else { "s" },
                overlap.holes_m2,
                100.0 * overlap.holes_m2 / overlap.area_m2
            ),
            "the mosaic will be empty there; `--picture` shows where",
        );
    }
    if let Some(forward) = overlap.forward_median
        && forward < LOW
        && flight.views.len() >= FEWEST
    {
        add(
            Severity::Warning,
            "low-overlap",
            format!("a frame shares {:.0} % of its ground with the next (median)", 100.0 * forward),
            "check that heights and focal length are right; a closed mosaic wants more",
        );
    }
    let gsds = || flight.views.iter().map(|view| view.gsd_m).collect::<Vec<f64>>();
    if let (Some(low), Some(high)) = (quantile(gsds(), 0.0), quantile(gsds(), 1.0))
        && high > 2.0 * low
    {
        add(
            Severity::Note,
            "gsd-varies",
            format!("the ground sample distance runs from {low:.4} m to {high:.4} m"),
            "frames from very different heights, or oblique ones",
        );
    }
    found
}

fn soft(flight: &Flight<'_>) -> Option<Finding> {
    /// A fraction of the usual variance that texture alone does not explain.
    const SOFT: f64 = 0.25;
    let frames: Vec<String> = flight
        .sharpness
        .iter()
        .filter(|(_, sharpness)| **sharpness < SOFT)
        .map(|(name, _)| name.clone())
        .collect();
    (!frames.is_empty()).then(|| Finding {
        severity: Severity::Warning,
        code: "soft-photos",
        text: format!(
            "{} of {} photos have less than {SOFT} of the usual sharpness ({})",
            frames.len(),
            flight.sharpness.len(),
            names(&frames)
        ),
        help: Some(
            "look at them: blurred photos spoil a mosaic, smooth ground (water, snow) does not".to_owned(),
        ),
        frames,
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::PhotosByName;
    use super::super::overlap;
    use super::super::view::Match;
    use super::*;
    use crate::formats::flight::Exposure;
    use crate::formats::metadata::{Optics, PhotoMetadata, PhotoTimes};

    /// No photo says anything.
    pub(crate) fn photos() -> PhotosByName {
        PhotosByName::new()
    }

    /// A photo without metadata.
    pub(crate) fn photo() -> PhotoMetadata {
        PhotoMetadata {
            exposure: Exposure::at(1),
            no_position: None,
            times: PhotoTimes::default(),
            make: None,
            model: None,
            camera_serial: None,
            vehicle_serial: None,
            software: None,
            creator_tool: None,
            orientation: None,
            exposure_time_s: None,
            f_number: None,
            iso: None,
            stored_size: None,
            exif_size: None,
            optics: Optics::default(),
            turned: None,
            findings: Vec::new(),
        }
    }

    /// A strip flown to the east at 10 m/s, a frame of 100 m × 80 m every 2 s, the nose up to 6° off the course.
    pub(crate) fn strip(count: usize) -> Vec<View> {
        (0..count)
            .map(|i| {
                let east = 20.0 * i as f64;
                let nose = 90.0 + 6.0 * (i as f64).sin();
                View {
                    name: format!("{i:02}.jpg"),
                    time_s: Some(2.0 * i as f64 + 0.25),
                    place: [east, 0.0],
                    height_m: 300.0,
                    ground_m: Some(200.0),
                    nose_deg: Some(nose),
                    top_deg: Some(nose),
                    outline: vec![
                        [east - 50.0, 40.0],
                        [east + 50.0, 40.0],
                        [east + 50.0, -40.0],
                        [east - 50.0, -40.0],
                    ],
                    centre: [east, 0.0],
                    gsd_m: 0.05,
                    height_above_ground_m: 100.0,
                    exposure_time_s: Some(1e-3),
                    ..View::default()
                }
            })
            .collect()
    }

    pub(crate) fn codes(findings: &[Finding]) -> Vec<&'static str> {
        findings.iter().map(|finding| finding.code).collect()
    }

    fn examined(flight: &mut Flight<'_>) -> Vec<Finding> {
        flight.overlap = overlap::of(&flight.views, &flight.order).0;
        of(flight, &[])
    }

    #[test]
    fn a_good_flight_has_no_findings() {
        let none = photos();
        assert_eq!(examined(&mut Flight::made(strip(20), &none)), []);
    }

    #[test]
    fn gaps_pieces_and_thin_overlap_are_found() {
        let none = photos();
        let mut flight = Flight::made(strip(20), &none);
        for (i, view) in flight.views.iter_mut().enumerate() {
            // Frames of 10 m × 80 m, 20 m apart.
            let east = 20.0 * i as f64;
            view.outline =
                vec![[east - 5.0, 40.0], [east + 5.0, 40.0], [east + 5.0, -40.0], [east - 5.0, -40.0]];
        }
        assert_eq!(codes(&examined(&mut flight)), ["separate-areas", "low-overlap"]);
        let mut flight = Flight::made(strip(20), &none);
        for view in &mut flight.views[10..] {
            let shift = |p: &mut [f64; 2]| p[1] += 200.0;
            view.outline.iter_mut().for_each(shift);
            shift(&mut view.centre);
        }
        let found = examined(&mut flight);
        assert_eq!(codes(&found), ["separate-areas", "coverage-holes"]);
        assert!(found[0].text.contains("2 pieces"), "{}", found[0].text);
        flight.views[3].gsd_m = 0.2;
        assert!(codes(&examined(&mut flight)).contains(&"gsd-varies"));
    }

    #[test]
    fn rejected_frames_are_an_error_only_beyond_the_limit() {
        let none = photos();
        let mut flight = Flight::made(strip(4), &none);
        flight.rejected.push(("z.jpg".to_owned(), "no row of log.csv names it".to_owned()));
        let found = examined(&mut flight);
        assert_eq!((codes(&found)[0], found[0].severity), ("frames-rejected", Severity::Warning));
        flight.declared.too_many_rejected = true;
        assert_eq!(examined(&mut flight)[0].severity, Severity::Error);
    }

    #[test]
    fn horizon_soft_photos_and_weak_matches_are_found() {
        let none = photos();
        let mut flight = Flight::made(strip(4), &none);
        flight.views[1].clipped = true;
        flight.sharpness = [("00.jpg", 1.0), ("01.jpg", 0.1), ("02.jpg", 0.3)]
            .map(|(name, sharpness)| (name.to_owned(), sharpness))
            .into();
        let pair = |p| Match { residual_s: Some(0.0), probability: Some(p) };
        flight.matches = [("00.jpg".to_owned(), pair(1.0)), ("02.jpg".to_owned(), pair(0.6))].into();
        flight.clock_std_s = Some(0.4);
        let found = examined(&mut flight);
        assert_eq!(codes(&found), ["match-weak", "horizon", "soft-photos"]);
        assert_eq!(
            found.iter().map(|f| f.frames[0].as_str()).collect::<Vec<_>>(),
            ["02.jpg", "01.jpg", "01.jpg"]
        );
        // 0.6 s against 2 s between frames.
        flight.clock_std_s = Some(0.6);
        assert!(examined(&mut flight)[0].text.contains("known against each other to 0.60 s"));
        flight.matches.clear();
        flight.clock_std_s = Some(0.4);
        assert_eq!(codes(&examined(&mut flight)), ["horizon", "soft-photos"]);
        flight.rests_on_count = true;
        assert!(examined(&mut flight)[0].text.contains("only the number of photos"));
    }

    #[test]
    fn long_lists_of_names_are_cut() {
        let all: Vec<String> = (0..6).map(|i| format!("{i}")).collect();
        assert_eq!(names(&all), "0, 1, 2, 3 and 2 more");
        assert_eq!(names(&all[..2]), "0, 1");
    }
}
