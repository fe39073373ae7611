//! `locate`: pixels to places on the ground, each with its 1σ ellipse and CE90.

use std::collections::BTreeMap;

use serde::Serialize;

use super::context::{ErrorClass, StageError};
use super::georeference::Georeferenced;
use crate::accuracy::{AngleStd, ErrorModel, FramePropagation};
use crate::camera::ImagePoint;
use crate::config::Config;
use crate::config::accuracy::{CameraSpread, Sigmas};
use crate::config::height::VerticalDatum;
use crate::formats::geoid::Geoid;
use crate::geodesy::{Geodetic, MapProjection};
use crate::georeference::{GeoreferencedFrame, LocateError};

/// Where one pixel looks, or why that cannot be said. Cells without a value are empty in CSV.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Location {
    /// File name of the frame.
    pub frame: String,
    /// As asked for.
    pub column: Option<f64>,
    /// As asked for.
    pub row: Option<f64>,
    /// WGS 84, positive north.
    pub latitude_deg: Option<f64>,
    /// WGS 84, positive east.
    pub longitude_deg: Option<f64>,
    /// Height of the ground above the WGS 84 ellipsoid.
    pub height_ellipsoid_m: Option<f64>,
    /// In the CRS of the products, map units.
    pub easting: Option<f64>,
    /// In the CRS of the products, map units.
    pub northing: Option<f64>,
    /// CRS of easting and northing.
    pub crs: String,
    /// Larger half-axis of the 1σ ellipse.
    pub ellipse_semi_major_m: Option<f64>,
    /// Smaller half-axis of the 1σ ellipse.
    pub ellipse_semi_minor_m: Option<f64>,
    /// Direction of the larger half-axis, clockwise from true north.
    pub ellipse_azimuth_deg: Option<f64>,
    /// Radius that holds 90 % of the errors.
    pub ce90_m: Option<f64>,
    /// Why there is no place, or no spread; empty when all is well.
    pub error: String,
}

/// A pixel to be located.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked {
    /// File name of the frame.
    pub frame: String,
    /// Stored pixel; (0, 0) is the centre of the top-left one.
    pub pixel: ImagePoint,
    /// Height of the ground there, instead of the ground of the pipeline.
    pub ground: Option<(f64, VerticalDatum)>,
}

/// Locates pixels of one survey; frames are prepared once.
pub struct Locator<'s> {
    survey: &'s Georeferenced,
    frames: BTreeMap<&'s str, Prepared<'s>>,
    rejected: BTreeMap<&'s str, &'s str>,
    geoid: Geoid,
    crs: String,
}

struct Prepared<'s> {
    frame: &'s GeoreferencedFrame,
    /// Absent when the pipeline states no sigmas; words when they cannot be used with this frame.
    propagation: Option<Result<FramePropagation<'s>, String>>,
}

impl<'s> Locator<'s> {
    /// Prepares the survey's frames with the sigmas of `[accuracy]`, if there are any.
    #[must_use]
    pub fn new(config: &Config, survey: &'s Georeferenced) -> Self {
        let sigmas = config.accuracy.as_ref().map(|accuracy| &accuracy.sigmas);
        let prepare = |frame: &'s GeoreferencedFrame| Prepared {
            frame,
            propagation: sigmas.map(|sigmas| {
                FramePropagation::new(frame, &error_model(sigmas, frame)).map_err(|error| error.to_string())
            }),
        };
        let geoid = config.georeference.as_ref().and_then(|georeference| georeference.geoid_undulation_m);
        Self {
            survey,
            frames: survey.frames.iter().map(|frame| (frame.name.as_str(), prepare(frame))).collect(),
            rejected: survey
                .rejected
                .iter()
                .map(|rejected| (rejected.frame.as_str(), rejected.reason.as_str()))
                .collect(),
            geoid: geoid.map_or(Geoid::Grids, Geoid::Constant),
            crs: survey.projection.definition().to_owned(),
        }
    }

    /// Whether locations come with their spread.
    pub fn knows_spread(&self) -> bool {
        self.frames.values().any(|prepared| prepared.propagation.is_some())
    }

    /// A row that only says what is wrong.
    pub fn failed(&self, frame: &str, pixel: [Option<f64>; 2], error: String) -> Location {
        Location {
            frame: frame.to_owned(),
            column: pixel[0],
            row: pixel[1],
            latitude_deg: None,
            longitude_deg: None,
            height_ellipsoid_m: None,
            easting: None,
            northing: None,
            crs: self.crs.clone(),
            ellipse_semi_major_m: None,
            ellipse_semi_minor_m: None,
            ellipse_azimuth_deg: None,
            ce90_m: None,
            error,
        }
    }

    /// Locates one pixel. What goes wrong is said in the row.
    pub fn locate(&self, asked: &Asked) -> Location {
        let pixel = [Some(asked.pixel.column), Some(asked.pixel.row)];
        let mut row = self.failed(&asked.frame, pixel, String::new());
        let prepared = match self.prepared(&asked.frame) {
            Ok(prepared) => prepared,
            Err(error) => return Location { error: error.to_string(), ..row },
        };
        if let Err(error) = self.fill(&mut row, prepared, asked) {
            row.error = error;
        }
        row
    }

    /// Fills the row as far as it gets: a pixel that has ground but no spread (grazing, off the model's edge) keeps its
    /// place.
    fn fill(&self, row: &mut Location, prepared: &Prepared<'_>, asked: &Asked) -> Result<(), String> {
        let words = |error: LocateError| error.to_string();
        let height = self.height(prepared, asked)?;
        let ground = match height {
            None => prepared.frame.ground_from_pixel(asked.pixel),
            Some(height) => prepared.frame.ground_from_pixel_at_height(asked.pixel, height),
        }
        .map_err(words)?;
        row.latitude_deg = Some(ground.position.latitude.degrees());
        row.longitude_deg = Some(ground.position.longitude.degrees());
        row.height_ellipsoid_m = Some(ground.position.height.get());
        let map = self
            .survey
            .projection
            .map_from_geodetic(&[ground.position])
            .map_err(|error| error.to_string())?[0];
        (row.easting, row.northing) = (Some(map.easting), Some(map.northing));
        let Some(propagation) = &prepared.propagation else { return Ok(()) };
        let propagation = propagation.as_ref().map_err(Clone::clone)?;
        let accuracy = match height {
            None => propagation.at(asked.pixel),
            Some(height) => propagation.at_height(asked.pixel, height),
        }
        .map_err(|error| error.to_string())?;
        row.ellipse_semi_major_m = Some(accuracy.ellipse.semi_major_m);
        row.ellipse_semi_minor_m = Some(accuracy.ellipse.semi_minor_m);
        row.ellipse_azimuth_deg = Some(accuracy.ellipse.azimuth.degrees());
        row.ce90_m = Some(accuracy.ce90_m().map_err(|error| error.to_string())?);
        Ok(())
    }

    /// A frame by its file name.
    ///
    /// # Errors
    /// It was rejected (with the reason), or there is no such frame (with the nearest name).
    pub fn frame(&self, name: &str) -> Result<&'s GeoreferencedFrame, StageError> {
        self.prepared(name).map(|prepared| prepared.frame)
    }

    fn prepared(&self, name: &str) -> Result<&Prepared<'s>, StageError> {
        if let Some(prepared) = self.frames.get(name) {
            return Ok(prepared);
        }
        if let Some(reason) = self.rejected.get(name) {
            return Err(StageError::input(format!("frame {name} is rejected: {reason}")));
        }
        let nearest = self
            .frames
            .keys()
            .chain(self.rejected.keys())
            .map(|known| (strsim::damerau_levenshtein(&known.to_lowercase(), &name.to_lowercase()), known))
            .min();
        let error = StageError::new(ErrorClass::Usage, format!("the survey has no frame {name}"));
        Err(match nearest {
            Some((distance, known)) if distance <= 4 => error.help(format!("did you mean {known}?")),
            _ => error.help("name the frame by its file name, with its extension"),
        })
    }

    /// The height of the ground that the row asks for, above the ellipsoid.
    fn height(&self, prepared: &Prepared<'_>, asked: &Asked) -> Result<Option<f64>, String> {
        match asked.ground {
            None => Ok(None),
            Some((metres, datum)) => self.above_ellipsoid(prepared, asked, metres, datum).map(Some),
        }
    }

    /// A height at the very place it belongs to: the undulation is taken where the pixel lands with it.
    fn above_ellipsoid(
        &self,
        prepared: &Prepared<'_>,
        asked: &Asked,
        metres: f64,
        datum: VerticalDatum,
    ) -> Result<f64, String> {
        let undulation = |at: Geodetic| -> Result<f64, String> {
            Ok(self.geoid.above_ellipsoid(datum, &[at]).map_err(|error| error.to_string())?[0])
        };
        if datum == VerticalDatum::Ellipsoid {
            return Ok(metres);
        }
        // The undulation changes by centimetres per kilometre: one step from the camera's own place suffices.
        let camera = prepared.frame.record.antenna;
        let first = metres + undulation(camera)?;
        let landed = prepared
            .frame
            .ground_from_pixel_at_height(asked.pixel, first)
            .map_err(|error| error.to_string())?;
        Ok(metres + undulation(landed.position)?)
    }
}

/// The error model that the pipeline's sigmas state, for one frame.
///
/// A camera without covariance is taken as exact: the pipeline's default asks for a covariance only where there is one.
pub fn error_model(sigmas: &Sigmas, frame: &GeoreferencedFrame) -> ErrorModel {
    ErrorModel {
        position_std_m: sigmas.position_m,
        height_std_m: sigmas.height_m,
        attitude_std: AngleStd { yaw: sigmas.yaw_rad, pitch: sigmas.pitch_rad, roll: sigmas.roll_rad },
        gimbal_std: (sigmas.gimbal_rad > 0.0).then(|| AngleStd::equal(sigmas.gimbal_rad)),
        boresight_std: AngleStd {
            yaw: sigmas.boresight_yaw_rad,
            pitch: sigmas.boresight_pitch_rad,
            roll: sigmas.boresight_roll_rad,
        },
        lever_arm_std_m: sigmas.lever_arm_m,
        time_std_s: sigmas.time_s,
        ground_height_std_m: sigmas.ground_height_m,
        picking_std_px: sigmas.picking_px,
        interior: sigmas.camera == CameraSpread::FromCalibration && frame.camera.covariance.is_some(),
    }
}
