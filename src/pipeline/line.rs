//! The real stages behind the engine.

use std::path::Path;

use super::execute::Stages;
use super::manifest::{Manifest, StageStatus};
use crate::config::Config;
use crate::report::page::Provenance;
use crate::stages::page::{PageInputs, page};
use crate::stages::session::Session;
use crate::stages::{RunContext, Stage, StageError};

impl Stages for Session {
    fn run(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError> {
        Self::run(self, stage, config, context)
    }

    fn reuse(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError> {
        Self::reuse(self, stage, config, context)
    }

    fn report(
        &mut self,
        config: &Config,
        manifest: &Manifest,
        folder: &Path,
    ) -> Result<Option<Vec<u8>>, StageError> {
        // Products of a stage that has to be run again would contradict those they are no longer made from.
        let current: Vec<_> =
            manifest.stages.iter().filter(|(_, entry)| entry.status == StageStatus::Done).collect();
        let inputs = PageInputs {
            title: config.source.name.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            provenance: Provenance {
                program_version: manifest.program_version.clone(),
                pipeline_file: manifest.pipeline.file.clone(),
                pipeline_blake3: manifest.pipeline.blake3.clone(),
                inputs_blake3: Some(manifest.inputs_blake3()),
                seed: manifest.seed,
                libraries: manifest.libraries.clone(),
            },
            rejected: manifest.rejected().map(|(frame, why)| (frame.to_owned(), why.to_owned())).collect(),
            warnings: current.iter().flat_map(|(_, entry)| entry.warnings.clone()).collect(),
            stages: current.iter().map(|(stage, _)| **stage).collect(),
        };
        page(folder, self.survey().ok(), inputs).map(Some)
    }
}
