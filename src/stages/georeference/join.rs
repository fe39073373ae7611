//! How frames find their pose in the log: by name, by time, or by aligning two series of the same events.

use super::poses::{Conventions, Posed, SeriesAttitude};
use super::sources::Clocked;
use crate::formats::InputError;
use crate::formats::flight::{Exposure, FlightLog, Origin};
use crate::formats::log::FrameTime;
use crate::geodesy::Geodetic;
use crate::navigation::Track;
use crate::units::Seconds;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// A pose for each image in order, or why it has none.
pub(super) type Poses = Vec<Result<Posed, String>>;

/// A row's place and what it says.
type Said = (u64, Result<Posed, String>);

/// Who names the images.
#[derive(Debug, Clone, Copy)]
pub(super) enum Holder<'a> {
    /// A file of this name.
    File(&'a str),
    /// Each photo itself.
    Photos,
}

impl Holder<'_> {
    const fn name(&self) -> &str {
        match self {
            Self::File(name) => name,
            Self::Photos => "the photos",
        }
    }
    fn found(self, place: u64) -> String {
        match self {
            Self::File(name) => format!("record {place} of {name} names it"),
            Self::Photos => "the photo states it itself".to_owned(),
        }
    }
    fn failed(self, place: u64, cause: &str) -> String {
        match self {
            Self::File(name) => format!("{name}, line {place}: {cause}"),
            Self::Photos => cause.to_owned(),
        }
    }
}

/// The pose of each image, by the name that the log gives it.
///
/// - `own`: what each photo says of its own attitude, where the log says nothing of any; may be empty.
///
/// # Errors
/// [`InputError`] for what concerns the whole log.
pub(super) fn by_name(
    images: &[String],
    log: &FlightLog,
    holder: Holder<'_>,
    own: &[Option<Exposure>],
    conventions: &Conventions<'_>,
    notes: &mut Vec<String>,
) -> Result<Poses, InputError> {
    let names = Names::of(images);
    let antennas = antennas(&log.exposures, conventions)?;
    // What each image's rows say; their places.
    let mut rows: BTreeMap<String, Vec<Said>> = BTreeMap::new();
    let mut nameless = log.exposures.iter().filter(|exposure| exposure.frame.is_none()).count();
    for (exposure, antenna) in log.exposures.iter().zip(antennas) {
        let Some(name) = &exposure.frame else { continue };
        let (image, place) = (names.image_of(name), exposure.place);
        let photo = images.binary_search(&image).ok().and_then(|k| own.get(k)?.as_ref());
        let posed = antenna.and_then(|antenna| {
            let found = holder.found(place);
            conventions.pose(&with_own(exposure, photo), antenna, None, Seconds::new(0.0), found)
        });
        let posed = posed.map_err(|cause| holder.failed(place, &cause));
        rows.entry(image).or_default().push((place, posed));
    }
    for record in &log.bad {
        match record.frame.as_deref().filter(|name| !name.is_empty()) {
            None => nameless += 1,
            Some(name) => {
                let cause = holder.failed(record.place, &record.cause);
                rows.entry(names.image_of(name)).or_default().push((record.place, Err(cause)));
            }
        }
    }
    let file = holder.name();
    if nameless > 0 {
        notes.push(format!("{nameless} rows of {file} name no frame"));
    }
    let poses = images
        .iter()
        .map(|image| match rows.remove(image) {
            None => Err(format!("no row of {file} names it")),
            Some(mut rows) if rows.len() == 1 => rows.swap_remove(0).1,
            Some(rows) => Err(several_rows(file, rows.iter().map(|(place, _)| *place))),
        })
        .collect();
    unmatched(rows.keys(), file, notes);
    Ok(poses)
}

/// An exposure of the log with the attitude that its photo states itself.
pub(super) fn with_own<'e>(exposure: &'e Exposure, photo: Option<&Exposure>) -> Cow<'e, Exposure> {
    let Some(photo) = photo else { return Cow::Borrowed(exposure) };
    let attitude = |origin: &&Origin| {
        ["yaw", "pitch", "roll", "gimbal"].iter().any(|word| origin.quantity.contains(word))
    };
    let of_photo = photo.origins.iter().filter(attitude).cloned();
    Cow::Owned(Exposure {
        attitude: photo.attitude,
        gimbal: photo.gimbal,
        origins: exposure.origins.iter().cloned().chain(of_photo).collect(),
        ..exposure.clone()
    })
}

/// Antenna positions above the ellipsoid of exposures that state one.
pub(super) fn antennas(
    exposures: &[Exposure],
    conventions: &Conventions<'_>,
) -> Result<Vec<Result<Option<Geodetic>, String>>, InputError> {
    let stated: Vec<_> =
        exposures.iter().filter_map(|e| Some((e.position?, e.height_above_takeoff_m))).collect();
    let mut placed = conventions.positions(&stated)?.into_iter();
    let next = |exposure: &Exposure| match exposure.position {
        None => Ok(None),
        Some(_) => placed.next().transpose(),
    };
    Ok(exposures.iter().map(next).collect())
}

/// The pose of each image, interpolated at the time it was taken.
///
/// - `own`: as in [`by_name`].
pub(super) fn by_time(
    times: &Clocked,
    own: &[Option<Exposure>],
    offset: Seconds,
    track: &(Track, SeriesAttitude),
    max_gap: Seconds,
    conventions: &Conventions<'_>,
) -> Poses {
    let pose = |(k, time): (usize, &Result<Seconds, String>)| {
        let time = time.clone()? + offset;
        let exposure = Exposure { time: Some(time), ..Exposure::at(track.0.place_at(time)) };
        let found = format!("interpolated at {:.3} s of the log's clock", time.get());
        let photo = own.get(k).and_then(Option::as_ref);
        conventions.pose(&with_own(&exposure, photo), None, Some(track), max_gap, found)
    };
    times.of_images.iter().enumerate().map(pose).collect()
}

/// When each image was taken, from a table whose rows name images; in the images' order.
pub(super) fn of_table(
    images: &[String],
    rows: Vec<FrameTime>,
    name: &str,
    notes: &mut Vec<String>,
) -> Vec<Result<Seconds, String>> {
    let names = Names::of(images);
    let mut named: BTreeMap<String, Vec<FrameTime>> = BTreeMap::new();
    for row in rows {
        named.entry(names.image_of(&row.frame)).or_default().push(row);
    }
    let of_images = images
        .iter()
        .map(|image| match named.remove(image).as_deref() {
            None => Err(format!("no row of {name} names it")),
            Some([only]) => {
                only.time.clone().map_err(|cause| format!("{name}, line {}: {cause}", only.place))
            }
            Some(several) => Err(several_rows(name, several.iter().map(|row| row.place))),
        })
        .collect();
    unmatched(named.keys(), name, notes);
    of_images
}

/// Finds the image that a log means by a name: the file's own name, or, where only one image fits, the name without a
/// folder before it, with another case, or without its extension.
struct Names<'a> {
    images: &'a [String],
    by_key: BTreeMap<String, Vec<&'a String>>,
}

impl<'a> Names<'a> {
    fn of(images: &'a [String]) -> Self {
        let mut by_key: BTreeMap<String, Vec<&String>> = BTreeMap::new();
        for image in images {
            let key = image.to_lowercase();
            let stem = Path::new(&key).file_stem().map(|stem| stem.to_string_lossy().into_owned());
            for key in stem.into_iter().chain([key.clone()]) {
                by_key.entry(key).or_default().push(image);
            }
        }
        Self { images, by_key }
    }

    fn image_of(&self, said: &str) -> String {
        // The folder's listing is sorted.
        if self.images.binary_search_by(|image| image.as_str().cmp(said)).is_ok() {
            return said.to_owned();
        }
        let bare = said.rsplit(['/', '\\']).next().unwrap_or(said).to_lowercase();
        match self.by_key.get(&bare).map(Vec::as_slice) {
            Some([only]) => (*only).clone(),
            _ => said.to_owned(),
        }
    }
}

fn several_rows(file: &str, places: impl Iterator<Item = u64>) -> String {
    let mut places: Vec<u64> = places.collect();
    places.sort_unstable();
    let places: Vec<String> = places.iter().map(u64::to_string).collect();
    format!("{file} names it more than once (lines {})", places.join(", "))
}

fn unmatched<'a>(names: impl ExactSizeIterator<Item = &'a String>, file: &str, notes: &mut Vec<String>) {
    let count = names.len();
    let mut names = names;
    if let Some(first) = names.next() {
        notes.push(format!("{count} rows of {file} name no image of the folder; the first: \"{first}\""));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_in_logs_find_the_one_image_they_can_mean() {
        let images: Vec<String> =
            ["IMG 1.jpg", "a\"b'.JPG", "x.jpg", "x.tif", "Ärger.jpg"].map(str::to_owned).to_vec();
        let mut sorted = images.clone();
        sorted.sort();
        let names = Names::of(&sorted);
        for (said, image) in [
            ("IMG 1.jpg", "IMG 1.jpg"),
            ("img 1", "IMG 1.jpg"),
            ("a\"b'.jpg", "a\"b'.JPG"),
            // A path is only text: what counts is the name at its end.
            ("../../etc/x.jpg", "x.jpg"),
            ("C:\\flight\\x.tif", "x.tif"),
            ("ärger.JPG", "Ärger.jpg"),
        ] {
            assert_eq!(names.image_of(said), image, "{said}");
        }
        // Two images have this stem: none is guessed.
        assert_eq!(names.image_of("x"), "x");
        assert_eq!(names.image_of(".."), "..");
    }
}
