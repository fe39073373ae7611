//! `camera`: a camera file of any program in, one of another program out; what is lost is said.

use serde_json::json;

use crate::cli::args::CameraArguments;
use crate::cli::exit::ExitClass;
use crate::cli::output::print;
use crate::formats::atomic::write_atomic;
use crate::formats::camera::{CameraChoice, CameraFormat, Exported, camera_json, export, read_chosen_camera};
use crate::stages::{ErrorClass, StageError};

pub fn run(arguments: &CameraArguments) -> Result<ExitClass, StageError> {
    let choice = CameraChoice { name: arguments.name.as_deref(), image_size: arguments.size };
    let camera = read_chosen_camera(&arguments.file, &choice).map_err(|error| {
        let failure = StageError::input(error.to_string());
        error.help.iter().fold(failure, |failure, help| failure.help(help.clone()))
    })?;
    let made = match arguments.to.as_str() {
        "boresight" => {
            let name = arguments.file.file_name().unwrap_or_default().to_string_lossy();
            let source = json!({ "method": "file", "file": name });
            Exported { text: camera_json(&camera, source), losses: Vec::new() }
        }
        other => {
            let known = || CameraFormat::ALL.map(CameraFormat::name).join(", ");
            let format = CameraFormat::from_name(other).ok_or_else(|| {
                StageError::new(ErrorClass::Usage, format!("there is no camera format \"{other}\""))
                    .help(format!("one of boresight, {}", known()))
            })?;
            export(&camera, format, arguments.name.as_deref().unwrap_or("camera"))
                .map_err(|error| StageError::input(error.to_string()))?
        }
    };
    for loss in &made.losses {
        tracing::warn!("lost: {loss}");
    }
    match &arguments.output {
        None => print(&made.text)?,
        Some(file) if !arguments.force && file.exists() => {
            return Err(StageError::new(ErrorClass::Usage, format!("{} exists", file.display()))
                .help("choose another name, or replace it with --force"));
        }
        Some(file) => write_atomic(file, made.text.as_bytes())?,
    }
    Ok(ExitClass::Done)
}
