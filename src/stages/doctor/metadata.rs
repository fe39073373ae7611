//! What the photos' own metadata gives away.

use super::findings::{Finding, names};
use super::view::Flight;
use crate::formats::metadata::{PhotoMetadata, Severity, TurnEvidence};
use std::collections::{BTreeMap, BTreeSet};

/// Findings about single photos that are listed; more are counted only.
const MOST_TEXTS: usize = 10;

pub(super) fn findings(flight: &Flight<'_>) -> Vec<Finding> {
    let mut found: Vec<Finding> =
        [unreadable(flight), bodies(flight), turned(flight), orientation(flight), past_nadir(flight)]
            .into_iter()
            .flatten()
            .collect();
    found.extend(others(flight));
    found
}

fn readable<'a>(flight: &'a Flight<'_>) -> impl Iterator<Item = (&'a String, &'a PhotoMetadata)> {
    flight.photos.iter().filter_map(|(name, photo)| Some((name, photo.as_ref().ok()?)))
}

fn unreadable(flight: &Flight<'_>) -> Option<Finding> {
    let broken: Vec<(&String, &String)> =
        flight.photos.iter().filter_map(|(name, photo)| Some((name, photo.as_ref().err()?))).collect();
    let (first, cause) = broken.first()?;
    Some(Finding {
        severity: Severity::Warning,
        code: "photo-unreadable",
        text: format!("the header of {} photos cannot be read ({first}: {cause})", broken.len()),
        help: None,
        frames: broken.iter().map(|(name, _)| (*name).clone()).collect(),
    })
}

fn bodies(flight: &Flight<'_>) -> Option<Finding> {
    let distinct = |of: &dyn Fn(&PhotoMetadata) -> Option<String>| -> BTreeSet<String> {
        readable(flight).filter_map(|(_, photo)| of(photo)).collect()
    };
    let kinds = [
        ("aircraft", distinct(&|photo| photo.vehicle_serial.clone())),
        ("camera bodies", distinct(&|photo| photo.camera_serial.clone())),
        ("camera models", distinct(&|photo| photo.model.clone())),
    ];
    let several: Vec<String> = kinds
        .into_iter()
        .filter(|(_, found)| found.len() > 1)
        .map(|(what, found)| {
            format!("{} {what} ({})", found.len(), names(&found.into_iter().collect::<Vec<_>>()))
        })
        .collect();
    (!several.is_empty()).then(|| Finding {
        severity: Severity::Warning,
        code: "several-bodies",
        frames: Vec::new(),
        text: format!("the photos come from {}", several.join(", ")),
        help: Some(
            "one camera of the pipeline file holds for all frames: process each body on its own".to_owned(),
        ),
    })
}

/// Photos that a viewer rewrote, where nothing declares how their pixels were turned.
fn turned(flight: &Flight<'_>) -> Option<Finding> {
    // What the pixels themselves say is worth more.
    let judged = |name: &str| flight.turns.as_ref().is_some_and(|turns| turns.judged(name));
    let declared = |name: &str| flight.views.iter().any(|view| view.name == name && view.turned_deg != 0);
    let (mut quarter, mut half) = (Vec::new(), Vec::new());
    let mut program = "";
    for (name, photo) in readable(flight).filter(|(name, _)| !declared(name) && !judged(name)) {
        match &photo.turned {
            None => {}
            Some(TurnEvidence::QuarterTurn) => quarter.push(name.clone()),
            Some(TurnEvidence::PerhapsHalfTurn(by)) => {
                half.push(name.clone());
                program = by;
            }
        }
    }
    let mut said = Vec::new();
    if !quarter.is_empty() {
        said.push(format!(
            "{} photos are stored with width and height swapped against what the camera wrote ({}): turned by 90 or 270 \
             deg",
            quarter.len(),
            names(&quarter)
        ));
    }
    if !half.is_empty() {
        said.push(format!(
            "{} photos were rewritten by a program that turns pixels, {program} ({}): perhaps turned by 180 deg",
            half.len(),
            names(&half)
        ));
    }
    (!said.is_empty()).then(|| Finding {
        severity: Severity::Warning,
        code: "pixels-perhaps-turned",
        text: said.join("; "),
        help: Some(
            "`check --overlaps` compares them with their neighbours; declare turns with `turned_frames` in \
             [georeference.mount]"
                .to_owned(),
        ),
        frames: quarter.into_iter().chain(half).collect(),
    })
}

fn orientation(flight: &Flight<'_>) -> Option<Finding> {
    let frames: Vec<String> = readable(flight)
        .filter(|(_, photo)| photo.orientation.is_some_and(|orientation| orientation != 1))
        .map(|(name, _)| name.clone())
        .collect();
    (!frames.is_empty()).then(|| Finding {
        severity: Severity::Note,
        code: "exif-orientation",
        text: format!(
            "EXIF Orientation of {} photos is not 1 ({}); it never turns the geometry: pixels count as they are stored",
            frames.len(),
            names(&frames)
        ),
        help: None,
        frames,
    })
}

fn is_past_nadir(text: &str) -> bool {
    text.starts_with("gimbal roll ") && text.contains("the same rotation is")
}

fn past_nadir(flight: &Flight<'_>) -> Option<Finding> {
    let frames: Vec<String> = readable(flight)
        .filter(|(_, photo)| photo.findings.iter().any(|finding| is_past_nadir(&finding.text)))
        .map(|(name, _)| name.clone())
        .collect();
    (!frames.is_empty()).then(|| Finding {
        severity: Severity::Note,
        code: "gimbal-past-nadir",
        text: format!(
            "{} photos state a gimbal roll near 180 deg ({}): a gimbal just past nadir; taken as the same rotation with \
             roll near 0",
            frames.len(),
            names(&frames)
        ),
        help: None,
        frames,
    })
}

/// Other warnings of single photos; notes only, where the poses come from elsewhere.
fn others(flight: &Flight<'_>) -> Vec<Finding> {
    let mut by_text: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for (name, photo) in readable(flight) {
        for finding in photo.findings.iter().filter(|finding| finding.severity == Severity::Warning) {
            if !finding.text.starts_with("the stored pixels ") {
                by_text.entry(&finding.text).or_default().push(name.clone());
            }
        }
    }
    let severity = if flight.declared.log_is_photos { Severity::Warning } else { Severity::Note };
    let more = by_text.len().saturating_sub(MOST_TEXTS);
    let mut found: Vec<Finding> = by_text
        .into_iter()
        .take(MOST_TEXTS)
        .map(|(text, frames)| Finding {
            severity,
            code: "photo-metadata",
            text: format!("{} photos ({}): {text}", frames.len(), names(&frames)),
            help: None,
            frames,
        })
        .collect();
    if more > 0 {
        found.push(Finding {
            severity,
            code: "photo-metadata",
            frames: Vec::new(),
            text: format!("{more} more kinds of findings about single photos"),
            help: None,
        });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::findings::tests::{codes, photo, photos, strip};
    use super::*;
    use crate::formats::metadata;

    #[test]
    fn photos_that_say_nothing_wrong_give_nothing() {
        let mut all = photos();
        for i in 0..4 {
            let of = PhotoMetadata {
                model: Some("S.O.D.A.".to_owned()),
                camera_serial: Some("7".to_owned()),
                orientation: Some(1),
                ..photo()
            };
            all.insert(format!("{i:02}.jpg"), Ok(of));
        }
        assert_eq!(findings(&Flight::made(strip(4), &all)), []);
    }

    #[test]
    fn every_sign_is_named() {
        let mut all = photos();
        all.insert("a.jpg".to_owned(), Err("is no JPEG".to_owned()));
        all.insert("b.jpg".to_owned(), Ok(PhotoMetadata { camera_serial: Some("1".to_owned()), ..photo() }));
        all.insert(
            "c.jpg".to_owned(),
            Ok(PhotoMetadata {
                camera_serial: Some("2".to_owned()),
                turned: Some(TurnEvidence::QuarterTurn),
                ..photo()
            }),
        );
        let half = Some(TurnEvidence::PerhapsHalfTurn("Picasa".to_owned()));
        let note = |text: &str, severity| metadata::Finding { severity, text: text.to_owned() };
        all.insert("d.jpg".to_owned(), Ok(PhotoMetadata { turned: half, orientation: Some(6), ..photo() }));
        all.insert(
            "e.jpg".to_owned(),
            Ok(PhotoMetadata {
                findings: vec![
                    note("gimbal roll 180.0° at elevation -89.0°: the same rotation is …", Severity::Note),
                    note("height is 0/0", Severity::Warning),
                ],
                ..photo()
            }),
        );
        let flight = Flight::made(strip(1), &all);
        let found = findings(&flight);
        assert_eq!(
            codes(&found),
            [
                "photo-unreadable",
                "several-bodies",
                "pixels-perhaps-turned",
                "exif-orientation",
                "gimbal-past-nadir",
                "photo-metadata"
            ]
        );
        assert_eq!(found[2].frames, ["c.jpg", "d.jpg"]);
        assert!(found[2].text.contains("Picasa"), "{}", found[2].text);
        assert_eq!((found[5].severity, found[5].frames.len()), (Severity::Note, 1));
    }

    #[test]
    fn a_turn_that_is_declared_is_no_finding() {
        let mut all = photos();
        let mut flight_views = strip(1);
        let name = flight_views[0].name.clone();
        let half = Some(TurnEvidence::PerhapsHalfTurn("Picasa".to_owned()));
        all.insert(name, Ok(PhotoMetadata { turned: half, ..photo() }));
        assert_eq!(codes(&findings(&Flight::made(flight_views.clone(), &all))), ["pixels-perhaps-turned"]);
        flight_views[0].turned_deg = 180;
        assert_eq!(findings(&Flight::made(flight_views, &all)), []);
    }
}
