//! `run`: a pipeline from beginning to end, then where to find what it made.

use std::fmt::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde_json::json;

use crate::cli::args::RunArguments;
use crate::cli::console::Console;
use crate::cli::exit::ExitClass;
use crate::cli::output::{human_bytes, print, print_json};
use crate::config::Config;
use crate::pipeline::manifest::{MANIFEST, Manifest, REPORT};
use crate::pipeline::{Action, Outcome, Plan, RunOptions, execute, folder, inputs};
use crate::stages::session::Session;
use crate::stages::{Progress, Stage, StageError};

/// What a user looks for first, with its place in the run folder.
const HIGHLIGHTS: [(&str, &str); 3] =
    [("mosaic", "mosaic/mosaic.tif"), ("preview", "mosaic/preview.png"), ("report", REPORT)];

pub fn run(
    arguments: &RunArguments,
    console: &Arc<Console>,
    interrupted: &Arc<AtomicBool>,
) -> Result<ExitClass, StageError> {
    let config = Config::load(&arguments.pipeline.file, &arguments.pipeline.overrides)?;
    let options = RunOptions {
        only: arguments.only.map(Stage::from),
        until: arguments.until.map(Stage::from),
        force: arguments.force,
        output: arguments.output.clone(),
        jobs: arguments.jobs.map(usize::from),
    };
    if arguments.dry_run {
        return dry_run(&config, &options, arguments.json, console);
    }
    let progress: Arc<dyn Progress> = console.clone();
    match execute(&config, &options, &mut Session::default(), &progress, interrupted)? {
        Outcome::Skipped(absent) => skipped(&absent, arguments.json),
        Outcome::Finished { folder, manifest, exceeded } => {
            finished(&folder, &manifest, arguments.json)?;
            match exceeded {
                None => Ok(ExitClass::Done),
                Some(error) => Err(error),
            }
        }
    }
}

/// Says which declared data is absent.
pub fn skipped(absent: &[(PathBuf, String)], as_json: bool) -> Result<ExitClass, StageError> {
    if as_json {
        let absent: Vec<_> =
            absent.iter().map(|(path, hint)| json!({ "path": path, "hint": hint })).collect();
        print_json(&json!({ "outcome": "skipped", "absent": absent }))?;
    } else {
        let lines: String = absent
            .iter()
            .map(|(path, hint)| format!("skipped: {hint} ({} does not exist)\n", path.display()))
            .collect();
        print(&lines)?;
    }
    Ok(ExitClass::Done)
}

/// A path without the detour `pipelines/../out`, for reading. Only for show: where `pipelines` is a symbolic link the
/// two differ.
fn shown(path: &Path) -> PathBuf {
    let mut short = PathBuf::new();
    for part in path.components() {
        match (part, short.components().next_back()) {
            (Component::ParentDir, Some(Component::Normal(_))) => {
                short.pop();
            }
            _ => short.push(part),
        }
    }
    short
}

fn finished(folder: &Path, manifest: &Manifest, as_json: bool) -> Result<(), StageError> {
    let highlights: Vec<(&str, PathBuf)> = HIGHLIGHTS
        .into_iter()
        .map(|(name, place)| (name, folder.join(place)))
        .filter(|(_, path)| path.exists())
        .collect();
    let rejected: Vec<_> = manifest.rejected().collect();
    if as_json {
        let rejected: Vec<_> =
            rejected.iter().map(|(frame, reason)| json!({ "frame": frame, "reason": reason })).collect();
        return print_json(&json!({
            "outcome": "finished",
            "folder": folder,
            "products": highlights.into_iter().map(|(name, path)| (name.to_owned(), json!(path))).collect::<serde_json::Map<_, _>>(),
            "manifest": folder.join(MANIFEST),
            "frames": manifest.frames.len(),
            "rejected": rejected,
        }));
    }
    let mut text = String::new();
    for (name, path) in &highlights {
        let _ = writeln!(text, "{name:<9} {}", shown(path).display());
    }
    let _ = writeln!(text, "{:<9} {}", "folder", shown(folder).display());
    for (frame, reason) in rejected {
        let _ = writeln!(text, "{:<9} {frame}: {reason}", "rejected");
    }
    print(&text)
}

fn dry_run(
    config: &Config,
    options: &RunOptions,
    as_json: bool,
    console: &Arc<Console>,
) -> Result<ExitClass, StageError> {
    let absent: Vec<_> = inputs::absent(config)
        .into_iter()
        .map(|missing| (missing.path.value.clone(), missing.hint.clone()))
        .collect();
    if !absent.is_empty() {
        return skipped(&absent, as_json);
    }
    let plan = Plan::new(config, options.only, options.until)?;
    folder::check(options.folder(config), config, options.force)?;
    let (found, missing) = inputs::declared(config);
    for error in &missing {
        console.error(error);
    }
    if !missing.is_empty() {
        return Ok(ExitClass::Input);
    }
    let size = match Session::look(config, options.folder(config)) {
        Ok(session) if plan.runs(Stage::Mosaic) => session.mosaic_size(config)?,
        Ok(_) => None,
        // Without the camera that this very run is to calibrate, the mosaic's size is not known yet.
        Err(_) if plan.runs(Stage::Calibrate) && config.calibrate.is_estimated() => None,
        Err(error) => return Err(error),
    };
    // What a GeoTIFF of this size takes before compression: three colours and a mask.
    let raw_bytes = size.map(|size| 4 * size.columns as u64 * size.rows as u64);
    if as_json {
        let stages: Vec<_> =
            plan.steps.iter().map(|(stage, action)| json!({ "stage": stage, "action": action })).collect();
        print_json(&json!({
            "outcome": "planned",
            "folder": options.folder(config),
            "stages": stages,
            "inputs": found,
            "mosaic": size,
            "mosaic_uncompressed_bytes": raw_bytes,
        }))?;
        return Ok(ExitClass::Done);
    }
    let mut text = String::new();
    for (stage, action) in &plan.steps {
        let action = match action {
            Action::Run => "run",
            Action::Reuse => "reuse",
        };
        let _ = writeln!(text, "{action:<9} {stage}");
    }
    for input in &found {
        let _ = writeln!(text, "{:<9} {}", "input", describe(input));
    }
    let _ = writeln!(text, "{:<9} {}", "folder", options.folder(config).display());
    if let (Some(size), Some(bytes)) = (size, raw_bytes) {
        let _ = writeln!(
            text,
            "{:<9} {} × {} pixels of {} m, {} before compression",
            "mosaic",
            size.columns,
            size.rows,
            size.gsd_m,
            human_bytes(bytes)
        );
    }
    print(&text)?;
    Ok(ExitClass::Done)
}

/// One line about an input.
pub fn describe(input: &inputs::Input) -> String {
    let files = if input.files == 1 { "1 file".to_owned() } else { format!("{} files", input.files) };
    format!("{} = {} ({files}, {})", input.key, input.path, human_bytes(input.bytes))
}
