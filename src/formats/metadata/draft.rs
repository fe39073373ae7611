//! A photo's metadata while the makers' mappings fill it.

use super::exif::ExifTags;
use super::values::{number, quoted, wall_clock};
use super::xmp::{Namespace, Xmp};
use super::{Finding, Optics, PhotoMetadata, PhotoTimes, UtcTime};
use crate::formats::flight::{
    Exposure, LoggedPosition, Origin, geodetic, plausible_angles, plausible_height,
};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::geometry::attitude::YawPitchRoll;
use crate::units::{Radians, Seconds};

/// Sea level as most receivers and autopilots have it.
pub(super) const SEA_LEVEL: HeightKind = HeightKind::SeaLevel(GeoidModel::Egm96);

/// A height with what it was taken for.
pub(super) struct Height {
    pub metres: f64,
    pub kind: HeightKind,
    pub from: String,
    pub meaning: String,
}

/// Latitude and longitude, degrees, and their tags.
pub(super) struct Place {
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    pub from: [String; 2],
}

/// A text fit for messages: short, without control characters.
fn plain(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(256).collect()
}

/// The photo so far, and the tags to fill it from.
pub(super) struct Draft {
    pub exif: ExifTags,
    pub xmp: Xmp,
    pub out: PhotoMetadata,
    pub place: Option<Place>,
    pub height: Option<Height>,
    /// Why a maker's position that is there cannot be used.
    place_problem: Option<String>,
    origins: Vec<Origin>,
}

impl Draft {
    pub(super) fn new(exif: ExifTags, xmp: Xmp, size: Option<(u32, u32)>, findings: Vec<Finding>) -> Self {
        let xmp_text = |namespace, name| xmp.text(namespace, name).map(plain);
        let out = PhotoMetadata {
            exposure: Exposure::at(1),
            no_position: None,
            times: PhotoTimes { maker: None, gps: exif.gps_time, civil: exif.taken },
            make: exif.make.clone().or_else(|| xmp_text(Namespace::Tiff, "Make")),
            model: exif.model.clone().or_else(|| xmp_text(Namespace::Tiff, "Model")),
            camera_serial: exif.body_serial.clone().or_else(|| xmp_text(Namespace::Aux, "SerialNumber")),
            vehicle_serial: None,
            software: exif.software.clone(),
            creator_tool: xmp_text(Namespace::Xmp, "CreatorTool"),
            orientation: exif.orientation.filter(|o| (1..=8).contains(o)),
            exposure_time_s: exif.exposure_time_s,
            f_number: exif.f_number,
            iso: exif.iso,
            stored_size: size.filter(|(w, h)| *w > 0 && *h > 0),
            exif_size: exif.size,
            optics: Optics::default(),
            turned: None,
            findings,
        };
        Self { exif, xmp, out, place: None, height: None, place_problem: None, origins: Vec::new() }
    }

    pub(super) fn note(&mut self, text: impl Into<String>) {
        self.out.findings.push(Finding::note(text));
    }

    pub(super) fn warn(&mut self, text: impl Into<String>) {
        self.out.findings.push(Finding::warning(text));
    }

    pub(super) fn origin(
        &mut self,
        quantity: &'static str,
        from: impl Into<String>,
        meaning: impl Into<String>,
    ) {
        self.origins.push(Origin { quantity, from: from.into(), meaning: meaning.into() });
    }

    /// A tag's text, owned.
    pub(super) fn text(&self, namespace: Namespace, name: &str) -> Option<String> {
        self.xmp.text(namespace, name).map(plain)
    }

    /// A tag's number; one that is broken is reported and counts as absent.
    pub(super) fn number(&mut self, namespace: Namespace, name: &str) -> Option<f64> {
        let parsed = number(self.xmp.text(namespace, name)?);
        self.or_warn(&format!("{}:{name}", namespace.prefix()), parsed)
    }

    /// A tag's height or distance, metres; one that no aircraft has is reported and counts as absent.
    pub(super) fn metres(&mut self, namespace: Namespace, name: &str) -> Option<f64> {
        let judged = plausible_height(self.number(namespace, name)?);
        self.or_warn(&format!("{}:{name}", namespace.prefix()), judged)
    }

    /// The value, or a finding that names the tag.
    pub(super) fn or_warn<T>(&mut self, tag: &str, value: Result<T, String>) -> Option<T> {
        match value {
            Ok(value) => Some(value),
            Err(cause) => {
                self.warn(format!("{tag} is not used: {cause}"));
                None
            }
        }
    }

    /// Yaw, pitch and roll in degrees of three tags, all or nothing; pitch is the angle of that name.
    pub(super) fn angles(
        &mut self,
        namespace: Namespace,
        [yaw, pitch, roll]: [&str; 3],
    ) -> Option<YawPitchRoll> {
        let given = [yaw, pitch, roll].map(|name| self.xmp.text(namespace, name).is_some());
        let values = [yaw, pitch, roll].map(|name| self.number(namespace, name));
        if let [Some(y), Some(p), Some(r)] = values {
            let checked = plausible_angles(YawPitchRoll::from_degrees(y, p, r));
            return self.or_warn(&format!("{}:{yaw}, {pitch}, {roll}", namespace.prefix()), checked);
        }
        if given.contains(&true) && given.contains(&false) {
            let missing =
                [yaw, pitch, roll].into_iter().zip(given).find(|(_, g)| !g).map_or("", |(name, _)| name);
            self.warn(format!(
                "{}:{missing} is absent, so its fellow angles are not used",
                namespace.prefix()
            ));
        }
        None
    }

    /// A standard deviation: positive and below a kilometre, or not taken.
    pub(super) fn sigma(&mut self, namespace: Namespace, name: &str) -> Option<f64> {
        self.number(namespace, name).filter(|v| *v > 0.0 && *v < 1000.0)
    }

    /// A maker's UTC tag.
    pub(super) fn utc(&mut self, namespace: Namespace, name: &str, from: &'static str) {
        let Some(text) = self.xmp.text(namespace, name) else { return };
        let clock = wall_clock(text);
        if let Some(clock) = self.or_warn(from, clock) {
            self.out.times.maker =
                Some(UtcTime { time: Seconds::new(clock.seconds), resolution_s: clock.resolution_s, from });
        }
    }

    /// Takes latitude and longitude from a maker's tags, unless they were taken already or say that there was no fix.
    pub(super) fn take_place(&mut self, namespace: Namespace, latitude: &str, longitude: &str) {
        if self.place.is_some() {
            return;
        }
        let (Some(lat), Some(lon)) = (self.number(namespace, latitude), self.number(namespace, longitude))
        else {
            return;
        };
        let tag = |name: &str| format!("{}:{name}, degrees", namespace.prefix());
        let deg = Radians::from_degrees;
        // The height is judged elsewhere.
        match geodetic(deg(lat), deg(lon), 0.0, HeightKind::Ellipsoid) {
            Ok(_) => {
                let from = [tag(latitude), tag(longitude)];
                self.place = Some(Place { latitude_deg: lat, longitude_deg: lon, from });
            }
            Err(cause) => {
                let text = format!("{} is not used: {cause}", tag(latitude));
                self.place_problem = Some(text.clone());
                self.warn(text);
            }
        }
    }

    /// Fills place and height from EXIF where no maker's tag did.
    pub(super) fn apply_exif(&mut self) {
        if self.place.is_none()
            && let Some((latitude_deg, longitude_deg)) = self.exif.latitude_deg.zip(self.exif.longitude_deg)
        {
            let from = ["EXIF GPSLatitude, degrees", "EXIF GPSLongitude, degrees"].map(str::to_owned);
            self.place = Some(Place { latitude_deg, longitude_deg, from });
        }
        if self.height.is_none() {
            self.height = self.exif_height();
        }
        let std = &mut self.out.exposure.std;
        if let (Some(error), None, None) = (self.exif.horizontal_error_m, std.north_m, std.east_m) {
            (std.north_m, std.east_m) = (Some(error), Some(error));
            self.origin(
                "horizontal sigma",
                "EXIF GPSHPositioningError, metres",
                "taken as one sigma north and east: the tag states no level",
            );
        }
        if self.exif.void_fix {
            self.warn("EXIF GPSStatus is V: the receiver had lost its fix when the position was written");
        }
    }

    /// EXIF's height by the standard's own words.
    pub(super) fn exif_height(&self) -> Option<Height> {
        let height = self.exif.gps_height?;
        let (kind, meaning) = match height.reference {
            Some(2 | 3) => {
                (SEA_LEVEL, "above sea level, as GPSAltitudeRef 2 or 3 says; the geoid is taken for EGM96")
            }
            Some(0 | 1) if self.exif.is_version_3 => (
                HeightKind::Ellipsoid,
                "above the ellipsoid, as EXIF 3 defines GPSAltitudeRef 0 and 1: declare the height's kind if the \
                 ground disagrees",
            ),
            _ => (
                SEA_LEVEL,
                "above sea level (EGM96), as EXIF 2 has it; EXIF 3 and some makers mean the ellipsoid: declare the \
                 height's kind if the ground disagrees",
            ),
        };
        Some(Height {
            metres: height.metres,
            kind,
            from: "EXIF GPSAltitude, metres".to_owned(),
            meaning: meaning.to_owned(),
        })
    }

    /// Closes the draft: judges the position and lists the origins.
    pub(super) fn finish(mut self) -> PhotoMetadata {
        match self.position() {
            Ok(position) => self.out.exposure.position = Some(position),
            Err(cause) => {
                self.out.findings.push(Finding::error(format!("no usable position: {cause}")));
                self.out.no_position = Some(cause);
            }
        }
        if let (Some(gps), Some(civil)) = (self.out.times.gps, self.out.times.civil) {
            let apart = (gps.time - civil.time).get().abs();
            // Zones reach from -12 to +14 hours.
            if apart > 15.0 * 3600.0 {
                self.warn(format!(
                    "the GPS time and the camera's clock are {:.1} hours apart, more than time zones explain",
                    apart / 3600.0
                ));
            }
        }
        if let Some(orientation) = self.out.orientation.filter(|o| *o != 1) {
            self.note(format!(
                "EXIF Orientation is {orientation}: viewers show the photo turned, here its pixels count as stored"
            ));
        }
        self.out.exposure.origins = self.origins.into();
        self.out
    }

    fn position(&mut self) -> Result<LoggedPosition, String> {
        let place = self.place.take();
        let height = self.height.take();
        let problem = self.exif.position_problem.take();
        let Some(place) = place else {
            let problem = self.place_problem.take().or(problem);
            let absent = || "neither EXIF nor XMP holds a latitude and longitude".to_owned();
            return Err(problem.unwrap_or_else(absent));
        };
        let (latitude, longitude) =
            (Radians::from_degrees(place.latitude_deg), Radians::from_degrees(place.longitude_deg));
        geodetic(latitude, longitude, 0.0, HeightKind::Ellipsoid)?;
        let Some(height) = height.or_else(|| self.relative_height()) else {
            return Err(problem.unwrap_or_else(|| "neither EXIF nor XMP holds a height".to_owned()));
        };
        let metres = plausible_height(height.metres)?;
        let [from_latitude, from_longitude] = place.from;
        self.origin("latitude", from_latitude, "WGS 84, positive north");
        self.origin("longitude", from_longitude, "WGS 84, positive east");
        self.origin("height", height.from, height.meaning);
        geodetic(latitude, longitude, metres, height.kind)
    }

    /// A height above take-off or ground, where there is no other.
    fn relative_height(&self) -> Option<Height> {
        let exposure = &self.out.exposure;
        let above_takeoff = exposure.height_above_takeoff_m.map(|h| (h, HeightKind::AboveTakeoff));
        let above_ground = || exposure.height_above_ground_m.map(|h| (h, HeightKind::AboveGround));
        let (metres, kind) = above_takeoff.or_else(above_ground)?;
        Some(Height {
            metres,
            kind,
            from: "the height above take-off or ground, metres".to_owned(),
            meaning: "relative: the photo states no other height".to_owned(),
        })
    }

    /// True when the camera's maker is named so.
    pub(super) fn is_made_by(&self, maker: &str) -> bool {
        self.out.make.as_deref().is_some_and(|m| m.to_ascii_lowercase().contains(maker))
    }

    /// For a message: the text of a tag that is not understood.
    pub(super) fn shown(text: &str) -> String {
        quoted(text)
    }
}
