//! Many photos' metadata to the log of a flight.

use super::{PhotoMetadata, Severity};
use crate::formats::flight::{BadRecord, Clock, Exposure, FlightLog, Origin};
use std::collections::{BTreeMap, BTreeSet};

/// Sentences about single photos' findings; more are counted only.
const MOST_NOTES: usize = 40;

/// Quantities of the origins that name an attitude, the camera's own first.
const ATTITUDES: [&str; 5] = [
    "gimbal yaw, elevation, roll",
    "camera yaw, pitch, roll",
    "UAV yaw, pitch, roll",
    "UAV yaw",
    "UAV pitch, roll",
];

/// The log of a flight out of its photos: one exposure for each that has a position, the others in `bad` with the
/// reason. The names become the exposures' frames.
///
/// The clock is UTC when every photo with a position states its UTC (by GPS, by a maker's tag, or by an offset tag);
/// otherwise it is the camera's wall clock, whose zone remains to be declared.
#[must_use]
pub fn flight_log(photos: Vec<(String, PhotoMetadata)>) -> FlightLog {
    let placed = || photos.iter().map(|(_, photo)| photo).filter(|p| p.exposure.position.is_some());
    let all_utc = placed().next().is_some() && placed().all(|p| p.times.utc(None).is_some());
    let mut log = FlightLog::new(if all_utc { Clock::Utc } else { Clock::Local });
    log.notes = notes(&photos, all_utc);
    for (name, photo) in photos {
        if let Some(cause) = photo.no_position {
            log.bad.push(BadRecord { place: 1, frame: Some(name), cause });
            continue;
        }
        log.exposures.push(exposure(name, photo, all_utc));
    }
    log
}

fn exposure(name: String, photo: PhotoMetadata, utc: bool) -> Exposure {
    let (time, from, meaning) = if utc {
        let utc = photo.times.utc(None);
        (utc.map(|t| t.time), utc.map_or("", |t| t.from), "UTC")
    } else {
        (
            photo.times.civil.map(|c| c.time),
            "EXIF DateTimeOriginal",
            "the camera's clock, in a zone not stated",
        )
    };
    let mut origins = photo.exposure.origins.to_vec();
    if time.is_some() {
        origins.push(Origin { quantity: "time", from: from.to_owned(), meaning: meaning.to_owned() });
    }
    Exposure { frame: Some(name), time, origins: origins.into(), ..photo.exposure }
}

fn notes(photos: &[(String, PhotoMetadata)], all_utc: bool) -> Vec<String> {
    let mut notes = sources(photos);
    notes.extend(meanings(photos));
    notes.extend(serials(photos));
    let untimed =
        photos.iter().filter(|(_, p)| p.exposure.position.is_some() && p.times.utc(None).is_none()).count();
    if !all_utc && untimed > 0 {
        notes.push(format!(
            "{untimed} photo{} no UTC: times are those of the camera's clock, and its time zone must be declared \
             before they are compared with a log",
            states(untimed)
        ));
    }
    notes.extend(findings(photos));
    notes
}

const fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

const fn states(count: usize) -> &'static str {
    if count == 1 { " states" } else { "s state" }
}

/// One sentence for each camera and set of sources.
fn sources(photos: &[(String, PhotoMetadata)]) -> Vec<String> {
    let mut groups: BTreeMap<String, usize> = BTreeMap::new();
    for (_, photo) in photos {
        let camera = camera(photo);
        let tag = |quantity: &str| {
            let origin = photo.exposure.origins.iter().find(|o| o.quantity == quantity);
            origin.map(|o| o.from.clone())
        };
        let attitude = ATTITUDES.into_iter().find_map(tag);
        let time = photo.times.utc(None).map(|t| t.from);
        let time = time.or(photo.times.civil.map(|_| "EXIF DateTimeOriginal, zone not stated"));
        let or_none = |text: Option<String>| text.unwrap_or_else(|| "nowhere".to_owned());
        let text = format!(
            "of {camera}: latitude from {}; height from {}; attitude from {}; time from {}",
            or_none(tag("latitude")),
            or_none(tag("height")),
            or_none(attitude),
            time.unwrap_or("nowhere")
        );
        *groups.entry(text).or_default() += 1;
    }
    groups.into_iter().map(|(text, count)| format!("{count} photo{} {text}", plural(count))).collect()
}

/// Maker and model; many models name their maker themselves.
fn camera(photo: &PhotoMetadata) -> String {
    match (&photo.make, &photo.model) {
        (Some(make), Some(model)) if !model.starts_with(make.as_str()) => format!("{make} {model}"),
        (_, Some(name)) | (Some(name), None) => name.clone(),
        (None, None) => "an unnamed camera".to_owned(),
    }
}

/// What heights and attitudes were taken for.
fn meanings(photos: &[(String, PhotoMetadata)]) -> Vec<String> {
    let mut groups: BTreeMap<String, usize> = BTreeMap::new();
    for origin in photos.iter().flat_map(|(_, photo)| photo.exposure.origins.iter()) {
        if origin.quantity == "height" || ATTITUDES.contains(&origin.quantity) {
            *groups.entry(format!("{}: {}", origin.quantity, origin.meaning)).or_default() += 1;
        }
    }
    groups.into_iter().map(|(text, count)| format!("{count} photo{}, {text}", plural(count))).collect()
}

/// Two aircraft in one folder.
fn serials(photos: &[(String, PhotoMetadata)]) -> Vec<String> {
    let vehicles: BTreeSet<&str> = photos.iter().filter_map(|(_, p)| p.vehicle_serial.as_deref()).collect();
    let mut cameras: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for (_, photo) in photos {
        if let (Some(model), Some(serial)) = (photo.model.as_deref(), photo.camera_serial.as_deref()) {
            cameras.entry(model).or_default().insert(serial);
        }
    }
    let list = |names: &BTreeSet<&str>| names.iter().take(5).copied().collect::<Vec<_>>().join(", ");
    let mut notes = Vec::new();
    if vehicles.len() > 1 {
        notes.push(format!("the photos come from {} aircraft: {}", vehicles.len(), list(&vehicles)));
    }
    for (model, serials) in cameras.iter().filter(|(_, serials)| serials.len() > 1) {
        let count = serials.len();
        notes.push(format!("the photos come from {count} cameras of the model {model}: {}", list(serials)));
    }
    notes
}

/// Warnings and errors, the same ones of several photos in one sentence.
fn findings(photos: &[(String, PhotoMetadata)]) -> Vec<String> {
    let mut groups: Vec<(&str, Vec<&str>)> = Vec::new();
    let mut place: BTreeMap<&str, usize> = BTreeMap::new();
    for (name, photo) in photos {
        for finding in photo.findings.iter().filter(|f| f.severity == Severity::Warning) {
            let at = *place.entry(&finding.text).or_insert_with(|| {
                groups.push((&finding.text, Vec::new()));
                groups.len() - 1
            });
            groups[at].1.push(name);
        }
    }
    let more = groups.len().saturating_sub(MOST_NOTES);
    let mut notes: Vec<String> = groups
        .into_iter()
        .take(MOST_NOTES)
        .map(|(text, names)| match names[..] {
            [one] => format!("{one}: {text}"),
            [first, .., last] => format!("{} photos ({first} to {last}): {text}", names.len()),
            [] => text.to_owned(),
        })
        .collect();
    if more > 0 {
        notes.push(format!("{more} more findings about single photos"));
    }
    notes
}
