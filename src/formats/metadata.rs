//! What a photo says about itself: position, attitude, gimbal, time, optics, out of its EXIF and XMP.
//!
//! [`read`] takes a JPEG, TIFF or PNG and reads its header only; [`flight_log`] makes the log of a flight out of many
//! photos. Maker notes are never parsed, pixels never decoded, EXIF Orientation never applied, the computer's time zone
//! never used.
//!
//! # What is taken from where
//!
//! XMP is looked up by namespace URI, whatever its prefix. EXIF fills what a maker's own tags leave open.
//!
//! | tags | position | height, and what it is taken for | attitude |
//! |---|---|---|---|
//! | EXIF alone | `GPSLatitude`, `GPSLongitude` | `GPSAltitude`; `GPSAltitudeRef` 0 and 1: above and below sea level (EGM96) in EXIF 2, the ellipsoid in EXIF 3 (by `ExifVersion`); 2 and 3: above and below sea level | none |
//! | DJI, and Autel's newer firmware (`drone-dji`) | `GpsLatitude`, `GpsLongitude` (also `GpsLongtitude`), `Latitude`, `Longitude` | `AbsoluteAltitude`; `AltitudeType` RtkAlt, or without that tag an `RtkFlag` above 0: ellipsoid; else sea level (EGM96), an assumption. EXIF's height instead when it is the same with more digits | gimbal: `GimbalYaw/Pitch/RollDegree` from north and the horizon, Z-Y-X, pitch -90° at nadir; UAV: `FlightYaw/Pitch/RollDegree` |
//! | senseFly autopilot (`sensefly`) | `Latitude`, `Longitude` | `AltitudeAMSL`: sea level (EGM96) | UAV: `Heading`, `PitchAngle`, `RollAngle`; `Heading` is the course when the tags say so |
//! | Pix4D's `Camera` (Sequoia, S.O.D.A., MicaSense, Autel's older firmware) | EXIF | EXIF | camera: `Yaw`, `Pitch`, `Roll`, all zero at nadir with the image's top to the north, pitch +90° at the horizon |
//! | Parrot ANAFI (`drone-parrot`) | EXIF | EXIF: ellipsoid on ANAFI Ai, sea level (EGM96) on the others | gimbal: `CameraYaw/Pitch/RollDegree`, pitch -90° at nadir; UAV: `DroneYaw/Pitch/RollDegree` |
//! | Skydio (`drone-skydio`) | `Latitude`, `Longitude` | X10: EXIF's, ellipsoid; others: `AbsoluteAltitude`, sea level (EGM96), an assumption | gimbal: `CameraOrientationNED`, pitch -90° at nadir |
//! | MicaSense (`MicaSense`, `DLS`) | EXIF | EXIF | none: `DLS` is the irradiance sensor's attitude |
//!
//! MicaSense's clock keeps UTC (the maker's own `imageprocessing`), so its `DateTimeOriginal` needs no offset tag.
//!
//! Sources: DJI's manuals of the Mavic 3M, Zenmuse P1 and Matrice 4 (lists of XMP fields), Pix4D's "Specifications of
//! xmp.camera tags" and "Yaw, Pitch, Roll and Omega, Phi, Kappa angles", Parrot's "Embedded Photo Metadata", Skydio's
//! "camera and metadata overview" and "X10 RTK/PPK metadata overview", EXIF 2.32 and 3.0 (CIPA DC-008).
//!
//! Times: a maker's own UTC, then the receiver's UTC, then the camera's wall clock with its offset tag, then with a
//! declared offset: [`PhotoTimes::utc`].

mod container;
mod dji;
mod draft;
mod exif;
mod log;
mod makers;
mod optics;
mod pix4d;
mod sensefly;
mod tiff;
mod turned;
mod values;
mod xmp;

#[cfg(test)]
mod tests;

pub use dji::normalised_gimbal;
pub use log::flight_log;
pub use optics::{Dewarp, DjiCalibration, FocalLengthPx, Optics, Pix4dCamera, SkydioCalibration};
pub use turned::TurnEvidence;

use super::flight::{Exposure, ReadError};
use crate::units::Seconds;
use draft::Draft;
use std::io::{Read, Seek};

/// How much a finding matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Good to know.
    Note,
    /// A number was left out, or may mean something else than it was taken for.
    Warning,
    /// The photo cannot be placed by what it says itself.
    Error,
}

/// Something about a photo that its user should know.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Finding {
    /// How much it matters.
    pub severity: Severity,
    /// A lowercase fragment with the tags and numbers in it.
    pub text: String,
}

impl Finding {
    fn note(text: impl Into<String>) -> Self {
        Self { severity: Severity::Note, text: text.into() }
    }
    fn warning(text: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, text: text.into() }
    }
    fn error(text: impl Into<String>) -> Self {
        Self { severity: Severity::Error, text: text.into() }
    }
}

/// What the camera's own clock showed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CivilTime {
    /// Seconds since 1970-01-01T00:00:00 as the clock on the wall showed them, in whatever zone it was set to.
    pub time: Seconds,
    /// The worth of the last digit, seconds: 1 without `SubSecTimeOriginal`.
    pub resolution_s: f64,
    /// What the clock was ahead of UTC, when `OffsetTimeOriginal` says so.
    pub utc_offset: Option<Seconds>,
}

/// A time in UTC.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UtcTime {
    /// Seconds since 1970-01-01T00:00:00Z, leap seconds not counted.
    pub time: Seconds,
    /// The worth of the last digit, seconds.
    pub resolution_s: f64,
    /// The tags it was read from.
    pub from: &'static str,
}

/// The times that a photo states.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PhotoTimes {
    /// The maker's own UTC tag: `drone-dji:UTCAtExposure`, `sensefly:UTCTime`.
    pub maker: Option<UtcTime>,
    /// EXIF `GPSDateStamp` and `GPSTimeStamp`: of the receiver's last fix, often whole seconds.
    pub gps: Option<UtcTime>,
    /// EXIF `DateTimeOriginal`.
    pub civil: Option<CivilTime>,
}

impl PhotoTimes {
    /// The photo's UTC, by the best tag there is; `declared` is the zone of the camera's clock (ahead of UTC), used
    /// only when the photo itself states none.
    #[must_use]
    pub fn utc(&self, declared: Option<Seconds>) -> Option<UtcTime> {
        let by_clock = || {
            let civil = self.civil?;
            let (offset, from) = match civil.utc_offset {
                Some(offset) => (offset, "EXIF DateTimeOriginal and OffsetTimeOriginal"),
                None => (declared?, "EXIF DateTimeOriginal, in the declared time zone"),
            };
            Some(UtcTime { time: civil.time - offset, resolution_s: civil.resolution_s, from })
        };
        self.maker.or(self.gps).or_else(by_clock)
    }
}

/// What a photo says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoMetadata {
    /// Position, attitude, gimbal, heights and speeds as understood, with the tags they came from. `place` is 1;
    /// `frame` and `time` are left to [`flight_log`], which knows the file's name and the clock of the set.
    pub exposure: Exposure,
    /// Why the exposure has no position, when it has none: a fragment.
    pub no_position: Option<String>,
    /// The times it states.
    pub times: PhotoTimes,
    /// Maker of the camera.
    pub make: Option<String>,
    /// Model of the camera.
    pub model: Option<String>,
    /// Serial number of the camera.
    pub camera_serial: Option<String>,
    /// Serial number of the aircraft or its autopilot.
    pub vehicle_serial: Option<String>,
    /// EXIF `Software`: the camera's firmware, or the program that rewrote the file.
    pub software: Option<String>,
    /// XMP `xmp:CreatorTool`: the program that wrote the file.
    pub creator_tool: Option<String>,
    /// EXIF `Orientation`, 1 to 8: recorded, never applied.
    pub orientation: Option<u32>,
    /// Exposure time, seconds.
    pub exposure_time_s: Option<f64>,
    /// Aperture number.
    pub f_number: Option<f64>,
    /// Sensitivity.
    pub iso: Option<u32>,
    /// Columns and rows as stored in the file.
    pub stored_size: Option<(u32, u32)>,
    /// Columns and rows as the EXIF states them: those that the camera wrote.
    pub exif_size: Option<(u32, u32)>,
    /// Focal lengths and lens numbers.
    pub optics: Optics,
    /// Signs that a program turned the stored pixels.
    pub turned: Option<TurnEvidence>,
    /// What else the user should know.
    pub findings: Vec<Finding>,
}

/// Reads a photo's metadata. Only the header is read: a few KiB of a JPEG, at most 1 MiB of any one block.
///
/// What a broken tag leaves out is named in [`PhotoMetadata::findings`]; a photo without EXIF and XMP is no error.
///
/// # Errors
/// [`ReadError`]: no JPEG, PNG or TIFF, cut short inside its header, or not readable.
pub fn read(source: &mut (impl Read + Seek)) -> Result<PhotoMetadata, ReadError> {
    let blocks = container::blocks(source)?;
    let mut findings: Vec<Finding> = blocks.notes.into_iter().map(Finding::note).collect();
    let mut tags = blocks.exif.map(exif::read).unwrap_or_default();
    findings.append(&mut tags.findings);
    let xmp = blocks.xmp.map_or_else(xmp::Xmp::default, |packet| {
        xmp::parse(&packet).unwrap_or_else(|cause| {
            findings.push(Finding::warning(format!("the XMP packet is not used: {cause}")));
            xmp::Xmp::default()
        })
    });
    let mut draft = Draft::new(tags, xmp, blocks.size, findings);
    // The first to name an attitude or a place has it; EXIF comes last.
    dji::apply(&mut draft);
    sensefly::apply(&mut draft);
    makers::skydio(&mut draft);
    makers::parrot(&mut draft);
    pix4d::apply(&mut draft);
    makers::micasense(&mut draft);
    draft.apply_exif();
    optics::apply(&mut draft);
    turned::apply(&mut draft);
    Ok(draft.finish())
}
