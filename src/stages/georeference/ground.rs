//! The ground as declared, made into terrain under each frame.

use super::poses::ellipsoidal;
use crate::config::georeference::{Ground, HeightAboveGround};
use crate::config::height::{Height, VerticalDatum};
use crate::formats::InputError;
use crate::formats::crs::Projection;
use crate::formats::elevation::read_elevation;
use crate::formats::geoid::{Geoid, geoid_of};
use crate::geodesy::{Geodetic, GeoidModel, MapPoint, MapProjection};
use crate::georeference::GeoreferencedFrame;
use crate::navigation::NavigationRecord;
use crate::raster::Raster;
use crate::terrain::{ConstantHeight, Dem, Filled, Terrain};
use std::sync::Arc;

/// The ground of the whole survey.
pub(super) enum SurveyGround {
    /// One height above a datum; on the ellipsoid it follows the geoid from frame to frame.
    Plane(Height),
    /// At a stated height below each camera.
    BelowCamera(HeightAboveGround),
    /// An elevation model.
    Model(Arc<dyn Terrain>),
    /// An elevation model, and the same with a stated height where it has none.
    FilledModel {
        /// The model alone.
        model: Arc<dyn Terrain>,
        /// What frames are laid on.
        filled: Arc<dyn Terrain>,
    },
}

impl SurveyGround {
    /// Loads the model, if it is one. `near` is a place of the survey, for the geoid under a stated height.
    pub(super) fn load(
        declared: &Ground,
        near: Option<&Geodetic>,
        geoid: &Geoid,
    ) -> Result<Self, InputError> {
        Ok(match declared {
            Ground::Plane(height) => Self::Plane(*height),
            Ground::BelowCamera(height) => Self::BelowCamera(height.clone()),
            Ground::Dem { file, datum, fallback_m } => {
                let model = load_dem(file, *datum, geoid).map_err(|e| e.caused_by(file))?;
                match fallback_m {
                    None => Self::Model(Arc::new(model)),
                    Some(metres) => {
                        let stated = Height { metres: *metres, datum: *datum };
                        let fallback_m = match near {
                            // A log without a usable position is refused before any frame meets the ground.
                            None => *metres,
                            Some(near) => ellipsoidal(stated, near, geoid)
                                .map_err(|e| InputError::new(file, e).caused_by(file))?,
                        };
                        Self::FilledModel {
                            model: Arc::new(model.clone()),
                            filled: Arc::new(Filled { model, fallback_m }),
                        }
                    }
                }
            }
        })
    }

    /// What to say about frames that lie on the stated height instead of the model.
    pub(super) fn fallback_note(&self, frames: &[GeoreferencedFrame]) -> Option<String> {
        let Self::FilledModel { model, .. } = self else { return None };
        let anchors: Vec<Geodetic> =
            frames.iter().filter_map(|f| f.footprint.anchor.map(|a| a.position)).collect();
        let without = model.heights(&anchors).iter().filter(|h| h.is_err()).count();
        (without > 0).then(|| {
            format!(
                "the elevation model has no height under the middle of {without} of {} frames; the stated \
                 fallback_height stands in there",
                frames.len()
            )
        })
    }

    /// The terrain under one frame; `camera` is its projection centre.
    pub(super) fn under(
        &self,
        record: &NavigationRecord,
        camera: &Geodetic,
        geoid: &Geoid,
    ) -> Result<Arc<dyn Terrain>, String> {
        Ok(match self {
            Self::Model(terrain) | Self::FilledModel { filled: terrain, .. } => terrain.clone(),
            Self::Plane(height) => {
                Arc::new(ConstantHeight { height_m: ellipsoidal(*height, camera, geoid)? })
            }
            Self::BelowCamera(declared) => {
                let height_above_ground = match declared {
                    HeightAboveGround::Fixed(metres) => *metres,
                    HeightAboveGround::Logged => {
                        record.height_above_ground_m.ok_or("the log states no height above ground for it")?
                    }
                };
                if height_above_ground <= 0.0 {
                    return Err(format!("its height above ground is {height_above_ground} m"));
                }
                Arc::new(ConstantHeight { height_m: camera.height.get() - height_above_ground })
            }
        })
    }

    /// Ellipsoidal ground heights at positions, for logs whose heights are above ground.
    pub(super) fn heights(&self, at: &[Geodetic], geoid: &Geoid) -> Vec<Result<f64, String>> {
        match self {
            Self::Model(terrain) | Self::FilledModel { filled: terrain, .. } => {
                terrain.heights(at).into_iter().map(|h| h.map_err(|e| e.to_string())).collect()
            }
            Self::Plane(height) => at.iter().map(|at| ellipsoidal(*height, at, geoid)).collect(),
            // Refused when the pipeline file is read: neither height would be known.
            Self::BelowCamera(_) => vec![Err("the ground's own height is not stated".to_owned()); at.len()],
        }
    }
}

/// Reads an elevation model and brings its heights to the ellipsoid.
fn load_dem(file: &std::path::Path, datum: VerticalDatum, geoid: &Geoid) -> Result<Dem, InputError> {
    let raster = read_elevation(file)?;
    let failed = |e: String| InputError::new(file, e);
    let projection = Projection::new(&raster.wkt).map_err(|e| failed(e.to_string()))?;
    let heights = match geoid_of(datum) {
        None => raster.heights,
        Some(model) => {
            let (w, h) = (raster.heights.width(), raster.heights.height());
            let mut samples = Vec::with_capacity(w * h);
            for row in 0..h {
                // The geoid bends over kilometres: its two ends stand for a row of posts, unless the row is long.
                let ends =
                    geoid_along_row(&raster.grid, row, w, &projection, (geoid, model)).map_err(failed)?;
                for column in 0..w {
                    samples.push(raster.heights.at(column, row) + ends.at(column) as f32);
                }
            }
            Raster::new(w, h, samples).ok_or_else(|| failed("has no posts".to_owned()))?
        }
    };
    let spacing = raster.grid.per_column.0.hypot(raster.grid.per_column.1) * projection.metres_per_unit();
    Dem::new(heights, raster.grid, Arc::new(projection), spacing)
        .ok_or_else(|| InputError::new(file, "holds no data anywhere"))
}

/// Undulations along one row of posts, linear between knots.
struct RowUndulations {
    knots: Vec<f64>,
    step: usize,
}

impl RowUndulations {
    fn at(&self, column: usize) -> f64 {
        let k = (column / self.step).min(self.knots.len() - 2);
        let f = (column - k * self.step) as f64 / self.step as f64;
        self.knots[k] * (1.0 - f) + self.knots[k + 1] * f
    }
}

fn geoid_along_row(
    grid: &crate::raster::GridTransform,
    row: usize,
    width: usize,
    projection: &Projection,
    (geoid, model): (&Geoid, GeoidModel),
) -> Result<RowUndulations, String> {
    /// Undulations change by less than a millimetre within this distance of a straight line between knots.
    const KNOT_SPACING_M: f64 = 500.0;
    let cell = grid.per_column.0.hypot(grid.per_column.1) * projection.metres_per_unit();
    let step = ((KNOT_SPACING_M / cell).floor() as usize).clamp(1, width.max(1));
    let count = width.div_ceil(step) + 1;
    let at: Vec<MapPoint> = (0..count).map(|k| grid.map_from_pixel((k * step) as f64, row as f64)).collect();
    let places = projection.geodetic_from_map(&at).map_err(|e| e.to_string())?;
    let knots = geoid.undulations(model, &places).map_err(|e| e.to_string())?;
    Ok(RowUndulations { knots, step })
}
