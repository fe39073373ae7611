//! EXIF tags to values: rationals divided, signs applied, what is broken reported and left out.

use super::values::{date_seconds, fraction_of_second, quoted, utc_offset, wall_clock};
use super::{CivilTime, Finding, UtcTime};
use crate::units::Seconds;
use exif::{Exif, In, Reader, Tag, Value};

/// The tags that matter, in SI units and degrees.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct ExifTags {
    pub make: Option<String>,
    pub model: Option<String>,
    pub software: Option<String>,
    pub body_serial: Option<String>,
    pub orientation: Option<u32>,
    /// When the file was last changed, by its wall clock.
    pub changed: Option<f64>,
    pub taken: Option<CivilTime>,
    pub exposure_time_s: Option<f64>,
    pub f_number: Option<f64>,
    pub iso: Option<u32>,
    pub focal_length_mm: Option<f64>,
    pub focal_length_35mm_mm: Option<f64>,
    /// Pixels per millimetre, in x and y, at the size that the EXIF states.
    pub focal_plane_px_mm: Option<[f64; 2]>,
    pub size: Option<(u32, u32)>,
    pub latitude_deg: Option<f64>,
    pub longitude_deg: Option<f64>,
    pub gps_height: Option<GpsHeight>,
    pub gps_time: Option<UtcTime>,
    pub horizontal_error_m: Option<f64>,
    /// Direction of travel, degrees, and its reference.
    pub track_deg: Option<(f64, bool)>,
    pub void_fix: bool,
    /// True when the block claims EXIF 3.0 or later.
    pub is_version_3: bool,
    /// Why a position that is there cannot be used.
    pub position_problem: Option<String>,
    pub findings: Vec<Finding>,
}

/// `GPSAltitude` with what `GPSAltitudeRef` says about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GpsHeight {
    /// Metres, sign applied.
    pub metres: f64,
    /// `GPSAltitudeRef`.
    pub reference: Option<u32>,
}

/// Reads the tags out of a TIFF structure. What cannot be read is a finding.
pub(super) fn read(block: Vec<u8>) -> ExifTags {
    let mut tags = ExifTags::default();
    let mut reader = Reader::new();
    let read = reader.continue_on_error(true).read_raw(block).or_else(|e| {
        e.distill_partial_result(|errors| {
            let first = errors.first().map_or_else(String::new, ToString::to_string);
            tags.findings.push(Finding::warning(format!(
                "the EXIF block is broken in {} place{} ({first}); what remains is used",
                errors.len(),
                if errors.len() == 1 { "" } else { "s" }
            )));
        })
    });
    match read {
        Ok(exif) => fill(&exif, &mut tags),
        Err(e) => tags.findings.push(Finding::warning(format!("the EXIF block cannot be read ({e})"))),
    }
    tags
}

fn fill(exif: &Exif, tags: &mut ExifTags) {
    tags.make = text(exif, Tag::Make);
    tags.model = text(exif, Tag::Model);
    tags.software = text(exif, Tag::Software);
    tags.body_serial = text(exif, Tag::BodySerialNumber);
    tags.orientation = whole(exif, Tag::Orientation);
    tags.iso = whole(exif, Tag::PhotographicSensitivity).filter(|v| *v > 0);
    tags.size = whole(exif, Tag::PixelXDimension)
        .zip(whole(exif, Tag::PixelYDimension))
        .filter(|(w, h)| *w > 0 && *h > 0);
    let mut positive = |tag, name| real(exif, tag, name, &mut tags.findings).filter(|v| *v > 0.0);
    tags.exposure_time_s = positive(Tag::ExposureTime, "ExposureTime");
    tags.f_number = positive(Tag::FNumber, "FNumber");
    tags.focal_length_mm = positive(Tag::FocalLength, "FocalLength");
    tags.focal_length_35mm_mm = positive(Tag::FocalLengthIn35mmFilm, "FocalLengthIn35mmFilm");
    let x = positive(Tag::FocalPlaneXResolution, "FocalPlaneXResolution");
    let y = positive(Tag::FocalPlaneYResolution, "FocalPlaneYResolution");
    let per_unit = match whole(exif, Tag::FocalPlaneResolutionUnit) {
        // The standard's default is the inch.
        Some(2) | None => Some(25.4),
        Some(3) => Some(10.0),
        Some(4) => Some(1.0),
        Some(5) => Some(0.001),
        Some(_) => None,
    };
    tags.focal_plane_px_mm = x.zip(per_unit).map(|(x, unit)| [x / unit, y.unwrap_or(x) / unit]);
    tags.is_version_3 = text(exif, Tag::ExifVersion).is_some_and(|v| v.as_str() >= "0300" && v.len() == 4);
    times(exif, tags);
    gps(exif, tags);
}

fn times(exif: &Exif, tags: &mut ExifTags) {
    tags.changed = text(exif, Tag::DateTime).and_then(|t| wall_clock(&t).ok()).map(|c| c.seconds);
    let Some(stated) = text(exif, Tag::DateTimeOriginal).filter(|t| !t.trim_matches([' ', ':']).is_empty())
    else {
        return;
    };
    match wall_clock(&stated) {
        Ok(clock) => {
            let (fraction, resolution_s) = sub_second(exif, &stated).unwrap_or((0.0, clock.resolution_s));
            tags.taken = Some(CivilTime {
                time: Seconds::new(clock.seconds + fraction),
                resolution_s,
                utc_offset: text(exif, Tag::OffsetTimeOriginal).and_then(|t| utc_offset(&t)),
            });
        }
        Err(cause) => tags.findings.push(Finding::warning(format!("DateTimeOriginal is not used: {cause}"))),
    }
}

/// The fraction of the second that belongs to `DateTimeOriginal`, and its last digit's worth. `SubSecTime` belongs to
/// `DateTime`; where that is the same instant or absent it serves too. MicaSense writes negative ones.
fn sub_second(exif: &Exif, taken: &str) -> Option<(f64, f64)> {
    let same = text(exif, Tag::DateTime).is_none_or(|changed| changed == taken);
    let stated =
        text(exif, Tag::SubSecTimeOriginal).or_else(|| text(exif, Tag::SubSecTime).filter(|_| same))?;
    match stated.strip_prefix('-') {
        Some(digits) => fraction_of_second(digits).map(|(fraction, resolution)| (-fraction, resolution)),
        None => fraction_of_second(&stated),
    }
}

fn gps(exif: &Exif, tags: &mut ExifTags) {
    let before = tags.findings.len();
    let found = &mut tags.findings;
    tags.latitude_deg =
        coordinate(exif, (Tag::GPSLatitude, Tag::GPSLatitudeRef), "GPSLatitude", ["N", "S"], found);
    tags.longitude_deg =
        coordinate(exif, (Tag::GPSLongitude, Tag::GPSLongitudeRef), "GPSLongitude", ["E", "W"], found);
    let reference = match field(exif, Tag::GPSAltitudeRef) {
        Some(Value::Byte(v)) => v.first().map(|v| u32::from(*v)),
        Some(value) => value.get_uint(0),
        None => None,
    };
    tags.gps_height = real(exif, Tag::GPSAltitude, "GPSAltitude", found).map(|metres| {
        let below = matches!(reference, Some(1 | 3));
        GpsHeight { metres: if below { -metres } else { metres }, reference }
    });
    tags.position_problem = found.get(before).map(|f| f.text.clone());
    tags.horizontal_error_m =
        real(exif, Tag::GPSHPositioningError, "GPSHPositioningError", found).filter(|v| *v > 0.0 && *v < 1e4);
    tags.track_deg = real(exif, Tag::GPSTrack, "GPSTrack", found)
        .map(|track| (track, text(exif, Tag::GPSTrackRef).is_none_or(|r| r != "M")));
    tags.void_fix = text(exif, Tag::GPSStatus).is_some_and(|s| s == "V");
    match gps_time(exif) {
        Ok(time) => tags.gps_time = time,
        Err(cause) => found.push(Finding::warning(format!("the GPS time is not used: {cause}"))),
    }
}

fn gps_time(exif: &Exif) -> Result<Option<UtcTime>, String> {
    let (Some(date), Some(value)) = (text(exif, Tag::GPSDateStamp), field(exif, Tag::GPSTimeStamp)) else {
        return Ok(None);
    };
    let [hours, minutes, seconds] = triple(value, "GPSTimeStamp")?;
    let in_range =
        (0.0..24.0).contains(&hours) && (0.0..60.0).contains(&minutes) && (0.0..61.0).contains(&seconds);
    if !in_range {
        return Err(format!("GPSTimeStamp {hours}:{minutes}:{seconds} is no time of day"));
    }
    let time = date_seconds(&date)? + 3600.0 * hours + 60.0 * minutes + seconds;
    // A denominator above 1 promises more than whole seconds.
    let resolution_s = match value {
        Value::Rational(v) => v.get(2).map_or(1.0, |r| 1.0 / f64::from(r.denom.max(1))),
        _ => 1.0,
    };
    Ok(Some(UtcTime {
        time: Seconds::new(time),
        resolution_s,
        from: "EXIF GPSDateStamp and GPSTimeStamp, UTC",
    }))
}

fn coordinate(
    exif: &Exif,
    (tag, reference): (Tag, Tag),
    name: &str,
    [plus, minus]: [&str; 2],
    findings: &mut Vec<Finding>,
) -> Option<f64> {
    let value = field(exif, tag)?;
    let magnitude = triple(value, name).map(|[d, m, s]| d + m / 60.0 + s / 3600.0);
    let sign = match text(exif, reference) {
        Some(r) if r.eq_ignore_ascii_case(plus) => Ok(1.0),
        Some(r) if r.eq_ignore_ascii_case(minus) => Ok(-1.0),
        Some(r) => Err(format!("{name}Ref is {}, neither {plus} nor {minus}", quoted(&r))),
        None => Err(format!("{name}Ref is absent")),
    };
    match magnitude.and_then(|v| sign.map(|s| s * v)) {
        Ok(v) => Some(v),
        Err(cause) => {
            findings.push(Finding::warning(format!("{name} is not used: {cause}")));
            None
        }
    }
}

fn field(exif: &Exif, tag: Tag) -> Option<&Value> {
    exif.get_field(tag, In::PRIMARY).map(|f| &f.value)
}

/// Three rationals: degrees or hours, minutes, seconds. Absent minutes and seconds are none.
fn triple(value: &Value, name: &str) -> Result<[f64; 3], String> {
    let mut out = [0.0; 3];
    for (k, slot) in out.iter_mut().enumerate() {
        *slot = match nth(value, k) {
            Some(Ok(v)) => v,
            Some(Err(cause)) => return Err(format!("{name} {cause}")),
            None if k > 0 => 0.0,
            None => return Err(format!("{name} holds no rational numbers")),
        };
    }
    Ok(out)
}

/// The k-th number of a value.
fn nth(value: &Value, k: usize) -> Option<Result<f64, String>> {
    let divided = |n: f64, d: f64| {
        if d == 0.0 { Err(format!("holds {n}/0, which has no value")) } else { Ok(n / d) }
    };
    match value {
        Value::Rational(v) => v.get(k).map(|r| divided(f64::from(r.num), f64::from(r.denom))),
        Value::SRational(v) => v.get(k).map(|r| divided(f64::from(r.num), f64::from(r.denom))),
        Value::Float(v) => v.get(k).map(|v| finite(f64::from(*v))),
        Value::Double(v) => v.get(k).map(|v| finite(*v)),
        _ => value.get_uint(k).map(|v| Ok(f64::from(v))),
    }
}

fn finite(value: f64) -> Result<f64, String> {
    if value.is_finite() { Ok(value) } else { Err(format!("holds {value}")) }
}

/// A tag's first number; one without a value is reported.
fn real(exif: &Exif, tag: Tag, name: &str, findings: &mut Vec<Finding>) -> Option<f64> {
    match nth(field(exif, tag)?, 0)? {
        Ok(value) => Some(value),
        Err(cause) => {
            let text = format!("{name} is not used: it {cause}");
            findings.push(if name.starts_with("GPS") { Finding::warning(text) } else { Finding::note(text) });
            None
        }
    }
}

fn whole(exif: &Exif, tag: Tag) -> Option<u32> {
    field(exif, tag)?.get_uint(0)
}

/// A text tag: the part before the first NUL, trimmed; `None` when empty.
fn text(exif: &Exif, tag: Tag) -> Option<String> {
    let bytes = match field(exif, tag)? {
        Value::Ascii(parts) => parts.first()?.as_slice(),
        Value::Byte(bytes) | Value::Undefined(bytes, _) => bytes,
        _ => return None,
    };
    let text: String = String::from_utf8_lossy(bytes.get(..256).unwrap_or(bytes))
        .chars()
        .filter(|c| !c.is_control())
        .collect();
    Some(text.trim().to_owned()).filter(|t| !t.is_empty())
}
