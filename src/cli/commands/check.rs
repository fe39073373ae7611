//! `check`: what a run would use, what it would reject and why; nothing is written.

use std::fmt::Write;
use std::sync::Arc;

use serde_json::json;

use super::run::{describe, skipped};
use crate::cli::args::CheckArguments;
use crate::cli::console::Console;
use crate::cli::exit::ExitClass;
use crate::cli::output::{print, print_json};
use crate::config::Config;
use crate::pipeline::{Plan, inputs};
use crate::stages::session::Session;
use crate::stages::{ErrorClass, StageError};

pub fn run(arguments: &CheckArguments, console: &Arc<Console>) -> Result<ExitClass, StageError> {
    let config = Config::load(&arguments.pipeline.file, &arguments.pipeline.overrides)?;
    let absent: Vec<_> = inputs::absent(&config)
        .into_iter()
        .map(|missing| (missing.path.value.clone(), missing.hint.clone()))
        .collect();
    if !absent.is_empty() {
        return skipped(&absent, arguments.json);
    }
    let plan = Plan::new(&config, None, None)?;
    let (found, missing) = inputs::declared(&config);
    for error in &missing {
        console.error(error);
    }
    if !missing.is_empty() {
        return Ok(ExitClass::Input);
    }
    let (session, camera) = Session::rehearse(&config)?;
    let survey = session.survey().ok();
    let size = session.mosaic_size(&config)?;
    let stages: Vec<_> = plan.steps.iter().map(|(stage, _)| stage.name()).collect();
    let (used, rejected, notes) = match survey {
        Some(survey) => (survey.frames.len(), &survey.rejected[..], &survey.notes[..]),
        None => (0, &[][..], &[][..]),
    };
    let all_notes: Vec<&String> = camera.notes.iter().chain(notes).collect();
    if arguments.json {
        print_json(&json!({
            "pipeline": config.source.name,
            "stages": stages,
            "inputs": found,
            "frames_used": used,
            "frames_rejected": rejected,
            "crs": survey.map(|survey| survey.projection.definition()),
            "mosaic": size,
            "photos_used": camera.photos.len(),
            "photos_rejected": camera.rejected,
            "notes": all_notes,
        }))?;
    } else {
        let mut text = format!("stages    {}\n", stages.join(", "));
        for input in &found {
            let _ = writeln!(text, "input     {}", describe(input));
        }
        if !(camera.photos.is_empty() && camera.rejected.is_empty()) {
            let (used, all) = (camera.photos.len(), camera.photos.len() + camera.rejected.len());
            let _ = writeln!(text, "photos    {used} of {all} show the target");
        }
        for photo in &camera.rejected {
            let _ = writeln!(text, "rejected  {}: {}", photo.file, photo.reason);
        }
        if let Some(survey) = survey {
            let _ = writeln!(text, "frames    {used} of {} would be used", used + rejected.len());
            for frame in rejected {
                let _ = writeln!(text, "rejected  {}: {}", frame.frame, frame.reason);
            }
            let _ =
                writeln!(text, "crs       {} ({})", survey.projection.definition(), survey.projection.name());
        }
        if let Some(size) = size {
            let _ = writeln!(text, "mosaic    {} × {} pixels of {} m", size.columns, size.rows, size.gsd_m);
        }
        for note in all_notes {
            let _ = writeln!(text, "note      {note}");
        }
        print(&text)?;
    }
    if config.run.max_rejected_frames.is_exceeded_by(rejected.len()) {
        return Err(StageError::new(
            ErrorClass::Limits,
            format!("{} frames would be rejected, more than run.max_rejected_frames allows", rejected.len()),
        )
        .help(format!(
            "to accept this, write max_rejected_frames = {} (or \"any\") in [run]",
            rejected.len()
        )));
    }
    Ok(ExitClass::Done)
}
