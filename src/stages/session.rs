//! What the stages of one run hand to each other, and the same without writing anything for commands that only look.

use std::path::Path;
use std::sync::Arc;

use super::accuracy;
use super::calibrate::{self, Calibrated};
use super::context::{ErrorClass, RunContext, Stage, StageError};
use super::georeference::{self, Georeferenced};
use super::mosaic;
use crate::camera::Camera;
use crate::config::Config;
use crate::mosaic::{Blend, MapBounds, MosaicPlan, PlanSettings};
use crate::raster::Kernel;

/// Products in memory.
#[derive(Debug, Default)]
pub struct Session {
    camera: Option<Arc<Camera>>,
    survey: Option<Georeferenced>,
}

impl Session {
    /// Loads the camera and georeferences the survey, without writing anything.
    ///
    /// A camera that has to be calibrated is taken from the run folder, or calibrated in memory where no run has
    /// left one: the result is the same.
    ///
    /// # Errors
    /// As the stages' own.
    pub fn look(config: &Config, run_folder: &Path) -> Result<Self, StageError> {
        if calibrate::is_left_in(config, run_folder) {
            return Self::with_camera(config, Arc::new(calibrate::look(config, run_folder)?));
        }
        Ok(Self::rehearse(config)?.0)
    }

    /// Calibrates the camera and georeferences the survey in memory: what a run would find out before it renders.
    ///
    /// # Errors
    /// As the stages' own.
    pub fn rehearse(config: &Config) -> Result<(Self, Calibrated), StageError> {
        let context = RunContext::without_products(Stage::Calibrate, config.run.seed);
        let calibrated = calibrate::make(config, &context)?;
        Ok((Self::with_camera(config, calibrated.camera.clone())?, calibrated))
    }

    fn with_camera(config: &Config, camera: Arc<Camera>) -> Result<Self, StageError> {
        let survey = config.georeference.as_ref().map(|declared| {
            let survey = georeference::georeference(declared, &camera);
            survey.map_err(|error| georeference::failed(config, error))
        });
        let mut survey = survey.transpose()?;
        if let Some(survey) = &mut survey {
            // As the accuracy stage does, so that a pixel's spread is the same everywhere.
            survey.frames = accuracy::with_velocities(&survey.frames);
        }
        Ok(Self { camera: Some(camera), survey })
    }

    /// The georeferenced survey.
    ///
    /// # Errors
    /// The pipeline has no `[georeference]` table.
    pub fn survey(&self) -> Result<&Georeferenced, StageError> {
        self.survey.as_ref().ok_or_else(|| {
            StageError::pipeline("the pipeline has no table [georeference]")
                .help("add one: without poses there is no place on the ground")
        })
    }

    /// Makes one stage's products and keeps what later stages need.
    ///
    /// # Errors
    /// As the stage's own.
    pub fn run(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError> {
        match stage {
            Stage::Calibrate => {
                self.camera = Some(calibrate::run(config, context)?.camera);
            }
            Stage::Georeference => {
                self.survey = Some(georeference::run(config, self.camera()?, context)?);
            }
            Stage::Mosaic => {
                let rejected = mosaic::run(config, self.survey()?, context)?.rejected;
                // A photo that could not be decoded is no part of what the accuracy is stated for.
                if let Some(survey) = &mut self.survey {
                    survey.frames.retain(|f| rejected.iter().all(|r| r.frame != f.name));
                    survey.rejected.extend(rejected);
                    survey.rejected.sort();
                }
            }
            Stage::Accuracy => {
                accuracy::run(config, self.survey()?, context)?;
            }
        }
        Ok(())
    }

    /// Takes what later stages need from an earlier run of the stage.
    ///
    /// Poses are worked out anew: that takes milliseconds per frame, and a copy on disk could disagree with them.
    ///
    /// # Errors
    /// As [`Session::look`].
    pub fn reuse(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError> {
        match stage {
            Stage::Calibrate => {
                let folder = context.run_folder().unwrap_or(Path::new(""));
                self.camera = Some(Arc::new(calibrate::look(config, folder)?));
            }
            Stage::Georeference => {
                if let Some(declared) = &config.georeference {
                    let survey = georeference::georeference(declared, self.camera()?)
                        .map_err(|error| georeference::failed(config, error))?;
                    self.survey = Some(survey);
                }
            }
            Stage::Mosaic | Stage::Accuracy => {}
        }
        Ok(())
    }

    fn camera(&self) -> Result<&Arc<Camera>, StageError> {
        self.camera.as_ref().ok_or_else(|| {
            StageError::new(ErrorClass::Bug, "a stage that needs the camera ran before calibrate")
        })
    }

    /// The mosaic's size without rendering it: columns, rows, ground sample distance in metres.
    ///
    /// # Errors
    /// The mosaic cannot be laid out (nothing inside the bounds, absurd extent).
    pub fn mosaic_size(&self, config: &Config) -> Result<Option<MosaicSize>, StageError> {
        let (Some(declared), Some(survey)) = (&config.mosaic, &self.survey) else { return Ok(None) };
        let bounds = declared.bounds.as_ref();
        let settings = PlanSettings {
            gsd_m: declared.gsd_m.as_ref().map(|gsd| gsd.value),
            bounds: bounds.map(|b| MapBounds { west: b.west, south: b.south, east: b.east, north: b.north }),
            metres_per_unit: survey.projection.metres_per_unit(),
            channels: 3,
            kernel: Kernel::Bilinear,
            blend: Blend::Feather,
        };
        let plan = MosaicPlan::new(survey.frames.clone(), Arc::new(survey.projection.clone()), &settings)
            .map_err(|error| {
                StageError::input("the mosaic cannot be laid out")
                    .because(error)
                    .at(config.at(&declared.table))
            })?;
        Ok(Some(MosaicSize { columns: plan.width, rows: plan.height, gsd_m: plan.gsd_m }))
    }
}

/// Size of a mosaic that is still to be made.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct MosaicSize {
    /// Columns.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Side of a pixel, metres.
    pub gsd_m: f64,
}
