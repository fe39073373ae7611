//! `explain`: every matrix and vector from the Earth to the pixel for one frame.

use crate::cli::args::ExplainArguments;
use crate::cli::exit::ExitClass;
use crate::cli::output::{print, print_json};
use crate::config::Config;
use crate::stages::StageError;
use crate::stages::explain::explain;
use crate::stages::locate::Locator;
use crate::stages::session::Session;

pub fn run(arguments: &ExplainArguments) -> Result<ExitClass, StageError> {
    let config = Config::load(&arguments.pipeline.file, &arguments.pipeline.overrides)?;
    let session = Session::look(&config, arguments.output.as_deref().unwrap_or(&config.run.output))?;
    let survey = session.survey()?;
    let frame = Locator::new(&config, survey).frame(&arguments.frame)?;
    let explanation = explain(frame, survey);
    if arguments.json {
        print_json(&explanation)?;
    } else {
        print(&explanation.to_string())?;
    }
    Ok(ExitClass::Done)
}
