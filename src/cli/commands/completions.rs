//! `completions`: a script that completes commands and options in a shell.

use clap::CommandFactory;
use clap_complete::Shell;

use crate::cli::args::Arguments;
use crate::cli::exit::ExitClass;
use crate::cli::output;
use crate::stages::StageError;

pub fn run(shell: Shell) -> Result<ExitClass, StageError> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "boresight", &mut script);
    output::print(&String::from_utf8_lossy(&script))?;
    Ok(ExitClass::Done)
}
