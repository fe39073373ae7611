//! Single pixels to the ground, with their accuracy: what `locate` prints.

use super::georeference::Georeferenced;
use crate::accuracy::{ErrorModel, FramePropagation, PixelAccuracy};
use crate::camera::ImagePoint;
use crate::config::georeference::{Georeference, Ground};
use crate::config::log::VerticalDatum;
use crate::formats::geoid::Geoid;
use crate::geodesy::{Geodetic, MapProjection};
use crate::georeference::{GeoreferencedFrame, GroundPoint};
use std::collections::BTreeMap;

/// A pixel to be located.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelQuery {
    /// The image's file name.
    pub frame: String,
    /// Stored pixel; (0, 0) is the centre of the top-left pixel.
    pub pixel: ImagePoint,
    /// Height of the ground there instead of the pipeline's ground, metres above the locator's datum.
    pub height_m: Option<f64>,
}

/// A located pixel, as it is printed.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LocatedPixel {
    /// The image's file name.
    pub frame: String,
    /// As asked.
    pub column: f64,
    /// As asked.
    pub row: f64,
    /// WGS 84, positive north.
    pub latitude_deg: f64,
    /// WGS 84, positive east.
    pub longitude_deg: f64,
    /// In the CRS of the products.
    pub easting: f64,
    /// In the CRS of the products.
    pub northing: f64,
    /// Above `height_datum`.
    pub height_m: f64,
    /// "ellipsoid" or "egm96".
    pub height_datum: &'static str,
    /// Above the WGS 84 ellipsoid.
    pub height_ellipsoid_m: f64,
    /// Semi-major axis of the 1σ ellipse; `None` when the pipeline states no sigmas.
    pub std_major_m: Option<f64>,
    /// Semi-minor axis of the 1σ ellipse.
    pub std_minor_m: Option<f64>,
    /// Azimuth of the major axis, clockwise from true north.
    pub major_azimuth_deg: Option<f64>,
    /// Radius that holds half of the errors.
    pub cep50_m: Option<f64>,
    /// Radius that holds ninety percent of the errors.
    pub ce90_m: Option<f64>,
}

/// Locates pixels of one survey.
pub struct Locator<'a> {
    survey: &'a Georeferenced,
    by_name: BTreeMap<&'a str, &'a GeoreferencedFrame>,
    model: Option<&'a ErrorModel>,
    geoid: Geoid,
    datum: VerticalDatum,
}

impl<'a> Locator<'a> {
    /// Prepares a survey. `model` is absent when the pipeline has no [accuracy]; `datum` is that of the heights asked and
    /// answered, by default that of the pipeline's ground.
    #[must_use]
    pub fn new(
        survey: &'a Georeferenced,
        declared: &Georeference,
        model: Option<&'a ErrorModel>,
        datum: Option<VerticalDatum>,
    ) -> Self {
        let ground = match &declared.ground {
            Ground::Plane(height) => height.datum,
            Ground::Dem { datum, .. } => *datum,
            Ground::BelowCamera(_) => VerticalDatum::Ellipsoid,
        };
        Self {
            survey,
            by_name: survey.frames.iter().map(|f| (f.name.as_str(), f)).collect(),
            model,
            geoid: declared.geoid_undulation_m.map_or(Geoid::Egm96, Geoid::Constant),
            datum: datum.unwrap_or(ground),
        }
    }

    /// The frame of a name.
    ///
    /// # Errors
    /// Words: rejected with its reason, or unknown with the nearest name.
    pub fn frame(&self, name: &str) -> Result<&'a GeoreferencedFrame, String> {
        find_frame(self.survey, name)
    }

    /// Where a pixel lies.
    ///
    /// # Errors
    /// Words for a frame that is not used, a pixel outside the image, above the horizon, without inverse lens or ground.
    pub fn locate(&self, query: &PixelQuery) -> Result<LocatedPixel, String> {
        if !(query.pixel.column.is_finite() && query.pixel.row.is_finite()) {
            return Err(format!("pixel ({}, {}) is not finite", query.pixel.column, query.pixel.row));
        }
        let frame = match self.by_name.get(query.frame.as_str()) {
            Some(frame) => *frame,
            None => self.frame(&query.frame)?,
        };
        let height = query.height_m.map(|h| self.ellipsoidal(h, frame)).transpose()?;
        let (ground, accuracy) = self.ground(frame, query.pixel, height)?;
        let at = ground.position;
        let map = self.survey.projection.map_from_geodetic(&[at]).map_err(|e| e.to_string())?[0];
        let undulation = self.undulation(&at)?;
        let ellipse = accuracy.as_ref().map(|a| a.ellipse);
        let radius = |level: f64| ellipse.map(|e| e.radius_of(level)).transpose().map_err(|e| e.to_string());
        Ok(LocatedPixel {
            frame: frame.name.clone(),
            column: query.pixel.column,
            row: query.pixel.row,
            latitude_deg: at.latitude.degrees(),
            longitude_deg: at.longitude.degrees(),
            easting: map.easting,
            northing: map.northing,
            height_m: at.height.get() - undulation,
            height_datum: match self.datum {
                VerticalDatum::Ellipsoid => "ellipsoid",
                VerticalDatum::Egm96 => "egm96",
            },
            height_ellipsoid_m: at.height.get(),
            std_major_m: ellipse.map(|e| e.semi_major_m),
            std_minor_m: ellipse.map(|e| e.semi_minor_m),
            major_azimuth_deg: ellipse.map(|e| e.azimuth.degrees()),
            cep50_m: radius(0.5)?,
            ce90_m: radius(0.9)?,
        })
    }

    fn ground(
        &self,
        frame: &GeoreferencedFrame,
        pixel: ImagePoint,
        height: Option<f64>,
    ) -> Result<(GroundPoint, Option<PixelAccuracy>), String> {
        let Some(model) = self.model else {
            let ground = match height {
                Some(h) => frame.ground_from_pixel_at_height(pixel, h),
                None => frame.ground_from_pixel(pixel),
            };
            return Ok((ground.map_err(|e| e.to_string())?, None));
        };
        let propagation = FramePropagation::new(frame, model).map_err(|e| e.to_string())?;
        let accuracy = match height {
            Some(h) => propagation.at_height(pixel, h),
            None => propagation.at(pixel),
        }
        .map_err(|e| e.to_string())?;
        Ok((accuracy.ground, Some(accuracy)))
    }

    fn undulation(&self, at: &Geodetic) -> Result<f64, String> {
        match self.datum {
            VerticalDatum::Ellipsoid => Ok(0.0),
            VerticalDatum::Egm96 => Ok(self.geoid.undulations(&[*at]).map_err(|e| e.to_string())?[0]),
        }
    }

    /// The geoid changes by millimetres over a frame: its value under the camera serves the whole frame.
    fn ellipsoidal(&self, height_m: f64, frame: &GeoreferencedFrame) -> Result<f64, String> {
        if !height_m.is_finite() {
            return Err(format!("height {height_m} is not finite"));
        }
        Ok(height_m + self.undulation(&frame.record.antenna)?)
    }
}

/// The frame of a name; its extension may be left out.
///
/// # Errors
/// Words: rejected with its reason, or unknown with the nearest name.
pub fn find_frame<'a>(survey: &'a Georeferenced, name: &str) -> Result<&'a GeoreferencedFrame, String> {
    let stem = |n: &str| n.rsplit_once('.').map_or(n, |(stem, _)| stem).to_owned();
    if let Some(frame) = survey.frames.iter().find(|f| f.name == name) {
        return Ok(frame);
    }
    if let Some(rejected) = survey.rejected.iter().find(|r| r.frame == name || stem(&r.frame) == name) {
        return Err(format!("frame {} was rejected: {}", rejected.frame, rejected.reason));
    }
    let mut same_stem = survey.frames.iter().filter(|f| stem(&f.name) == name);
    if let (Some(frame), None) = (same_stem.next(), same_stem.next()) {
        return Ok(frame);
    }
    let nearest = survey
        .frames
        .iter()
        .map(|f| (strsim::jaro_winkler(&f.name, name), &f.name))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    Err(match nearest {
        Some((likeness, nearest)) if likeness > 0.7 => {
            format!("no frame is called \"{name}\"; did you mean \"{nearest}\"?")
        }
        _ => format!("no frame is called \"{name}\""),
    })
}
