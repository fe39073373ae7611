//! The files and folders a pipeline names, each with whether it is there: for `--dry-run` and `check`, and to fail before any work is done.

use std::path::PathBuf;

use serde::Serialize;

use crate::config::georeference::Ground;
use crate::config::log::FrameTimes;
use crate::config::run::Requirement;
use crate::config::{CameraSource, Config, Located};
use crate::formats::files;
use crate::stages::{Stage, StageError};

/// One thing the pipeline file names.
#[derive(Debug, Clone, Serialize)]
pub struct Input {
    /// The stage that reads it.
    pub stage: Stage,
    /// Its key in the pipeline file.
    pub key: &'static str,
    /// Path from the pipeline file's folder, or pattern as written.
    pub path: String,
    /// Files it stands for.
    pub files: usize,
    /// Their size in all.
    pub bytes: u64,
    /// Every file.
    #[serde(skip)]
    pub paths: Vec<PathBuf>,
}

/// Data that the pipeline declares as possibly absent and that is absent.
pub fn absent(config: &Config) -> Vec<&Requirement> {
    config.run.requires.iter().filter(|requirement| !requirement.path.exists()).collect()
}

/// Everything the pipeline names: what is there, and an error for each thing that is not.
pub fn declared(config: &Config) -> (Vec<Input>, Vec<StageError>) {
    let mut found = Found { config, inputs: Vec::new(), missing: Vec::new() };
    match &config.calibrate.camera {
        CameraSource::File(camera) => found.file(Stage::Calibrate, "calibrate.camera", &camera.file),
        CameraSource::Parameters(_) => {}
        CameraSource::Photos(photos) => {
            found.patterns(Stage::Calibrate, "calibrate.photos", &photos.patterns)
        }
        CameraSource::Corners(corners) => {
            found.file(Stage::Calibrate, "calibrate.corners.model", &corners.model_file);
            for view in &corners.views {
                found.file(Stage::Calibrate, "calibrate.corners.views", view);
            }
        }
    }
    if let Some(georeference) = &config.georeference {
        found.images(Stage::Georeference, "georeference.images", &georeference.images);
        if let Some(file) = georeference.log.file() {
            found.file(Stage::Georeference, "georeference.log.file", file);
        }
        if let Some(FrameTimes::Table(frames)) = georeference.log.join.frames() {
            found.file(Stage::Georeference, "georeference.frames.file", &frames.file);
        }
        if let Ground::Dem { file, .. } = &georeference.ground {
            found.file(Stage::Georeference, "georeference.ground.file", file);
        }
    }
    if let Some(points) = config.accuracy.as_ref().and_then(|accuracy| accuracy.check_points.as_ref()) {
        found.file(Stage::Accuracy, "accuracy.check_points.points", &points.points);
        found.file(Stage::Accuracy, "accuracy.check_points.observations", &points.observations);
    }
    (found.inputs, found.missing)
}

struct Found<'c> {
    config: &'c Config,
    inputs: Vec<Input>,
    missing: Vec<StageError>,
}

impl Found<'_> {
    fn file(&mut self, stage: Stage, key: &'static str, file: &Located<PathBuf>) {
        let shown = self.config.relative(file).display().to_string();
        // Opening tells more than looking: a file without permission to read is there and of no use.
        let opened = std::fs::File::open(&file.value).and_then(|opened| opened.metadata());
        let failure = match opened {
            Ok(metadata) if metadata.is_file() => {
                self.add(stage, key, shown, vec![file.value.clone()]);
                return;
            }
            Ok(_) => StageError::input(format!("{} is not a file", file.display())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                StageError::input(format!("{} does not exist", file.display()))
                    .help("paths count from the pipeline file's folder")
            }
            Err(error) => StageError::input(format!("{} cannot be read", file.display())).because(error),
        };
        self.missing.push(failure.at(self.config.at(file)));
    }

    fn images(&mut self, stage: Stage, key: &'static str, folder: &Located<PathBuf>) {
        let shown = self.config.relative(folder).display().to_string();
        match files::images(folder) {
            Ok(paths) => self.add(stage, key, shown, paths),
            Err(error) => self.missing.push(
                StageError::input(error.to_string())
                    .at(self.config.at(folder))
                    .help("paths count from the pipeline file's folder"),
            ),
        }
    }

    fn patterns(&mut self, stage: Stage, key: &'static str, patterns: &Located<Vec<String>>) {
        match files::matching(&self.config.base, patterns) {
            Ok(paths) => self.add(stage, key, patterns.join(", "), paths),
            Err(error) => self.missing.push(
                StageError::input(error.to_string())
                    .at(self.config.at(patterns))
                    .help("patterns count from the pipeline file's folder"),
            ),
        }
    }

    fn add(&mut self, stage: Stage, key: &'static str, path: String, paths: Vec<PathBuf>) {
        let bytes = paths.iter().filter_map(|path| path.metadata().ok()).map(|metadata| metadata.len()).sum();
        self.inputs.push(Input { stage, key, path, files: paths.len(), bytes, paths });
    }
}
