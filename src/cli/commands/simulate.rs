//! `simulate`: a scenario in, a synthetic survey with known truth out.

use std::sync::Arc;

use serde_json::json;

use crate::cli::args::SimulateArguments;
use crate::cli::console::Console;
use crate::cli::exit::ExitClass;
use crate::cli::output::{human_bytes, print, print_json};
use crate::config;
use crate::formats::survey::SurveyWriteError;
use crate::stages::simulate::{SimulateError, simulate_with};
use crate::stages::{ErrorClass, StageError};
use crate::synthetic::Scenario;

pub fn run(arguments: &SimulateArguments, console: &Arc<Console>) -> Result<ExitClass, StageError> {
    let scenario: Scenario = config::load_document(&arguments.scenario, &arguments.overrides)?;
    let mut bar = None;
    let mut pictures = 0;
    let written = simulate_with(&scenario, &arguments.output, arguments.force, &mut |done, all| {
        bar.get_or_insert_with(|| console.count("simulate", "rendering pictures", all))
            .advance((done - pictures) as u64);
        pictures = done;
    });
    drop(bar);
    let written = written.map_err(|error| failed(arguments, error))?;
    if arguments.json {
        print_json(&json!({
            "folder": arguments.output,
            "frames": written.frames,
            "targets": written.targets,
            "calibration_photos": written.calibration_photos,
            "blind_pixels": written.blind_pixels,
            "bytes": written.bytes,
        }))?;
    } else {
        print(&format!(
            "frames    {}\ntargets   {}\nphotos    {} of the calibration target\nfolder    {} ({})\n",
            written.frames,
            written.targets,
            written.calibration_photos,
            arguments.output.display(),
            human_bytes(written.bytes)
        ))?;
    }
    Ok(ExitClass::Done)
}

fn failed(arguments: &SimulateArguments, error: SimulateError) -> StageError {
    match error {
        SimulateError::Scenario(cause) => StageError::pipeline(format!(
            "{}: the scenario cannot be simulated",
            arguments.scenario.display()
        ))
        .because(cause),
        SimulateError::Write(
            cause @ (SurveyWriteError::Exists(_)
            | SurveyWriteError::NotASurvey(_)
            | SurveyWriteError::NoParent(_)),
        ) => StageError::new(ErrorClass::Usage, cause.to_string()),
        SimulateError::Write(cause) => StageError::new(
            ErrorClass::Io,
            format!("the survey cannot be written to {}", arguments.output.display()),
        )
        .because(cause),
    }
}
