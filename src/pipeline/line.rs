//! The real stages behind the engine.

use std::path::Path;

use super::execute::Stages;
use super::manifest::Manifest;
use crate::config::Config;
use crate::stages::session::Session;
use crate::stages::{RunContext, Stage, StageError};

impl Stages for Session {
    fn run(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError> {
        Self::run(self, stage, config, context)
    }

    fn reuse(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError> {
        Self::reuse(self, stage, config, context)
    }

    fn report(&mut self, _: &Config, _: &Manifest, _: &Path) -> Result<Option<Vec<u8>>, StageError> {
        Ok(None)
    }
}
