//! `schema`: the pipeline file's JSON Schema.

use crate::cli::exit::ExitClass;
use crate::cli::output;
use crate::config;
use crate::stages::StageError;

pub fn run() -> Result<ExitClass, StageError> {
    output::print(&config::schema_json())?;
    Ok(ExitClass::Done)
}
