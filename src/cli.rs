//! The command line: arguments in, exit code out. Data goes to stdout; messages, progress and errors to stderr.

mod args;
mod commands;
mod console;
mod exit;
mod output;

use std::panic::{self, AssertUnwindSafe};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;
use clap::error::ErrorKind;

use args::{Arguments, Command};
use console::Console;
use exit::ExitClass;

use crate::formats::libraries;
use crate::stages::{ErrorClass, StageError};

/// Runs the program with the arguments of the process.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help and version are answers, not errors.
            let answered = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
            let _ = error.print();
            return if answered { ExitClass::Done } else { ExitClass::Usage }.into();
        }
    };
    let console = Console::new(&arguments.talk);
    console.receive_messages();
    libraries::route_messages();
    report_panics(&console);
    // The hook has told the user; what is left to do is the exit code.
    let outcome = panic::catch_unwind(AssertUnwindSafe(|| dispatch(arguments.command, &console)));
    match outcome {
        Err(_) => ExitClass::Bug.into(),
        Ok(Ok(class)) => class.into(),
        Ok(Err(error)) => {
            console.error(&error);
            ExitClass::from(error.class()).into()
        }
    }
}

fn dispatch(command: Command, console: &Arc<Console>) -> Result<ExitClass, StageError> {
    match command {
        Command::Run(arguments) => commands::run::run(&arguments, console, &interrupts()?),
        Command::Check(arguments) => commands::check::run(&arguments, console),
        Command::Init(arguments) => commands::init::run(&arguments),
        Command::Locate(arguments) => commands::locate::run(&arguments),
        Command::Explain(arguments) => commands::explain::run(&arguments),
        Command::Simulate(arguments) => commands::simulate::run(&arguments, console),
        Command::Camera(arguments) => commands::camera::run(&arguments),
        Command::Target(arguments) => commands::target::run(&arguments),
        Command::Schema => commands::schema::run(),
        Command::Completions { shell } => commands::completions::run(shell),
    }
}

/// A flag that Ctrl-C raises, so that a run stops between two pieces of work and leaves no half file. A second Ctrl-C stops at once.
fn interrupts() -> Result<Arc<AtomicBool>, StageError> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = flag.clone();
    ctrlc::set_handler(move || {
        if raised.swap(true, Ordering::Relaxed) {
            std::process::exit(ExitClass::Interrupted as i32);
        }
    })
    .map_err(|error| StageError::new(ErrorClass::Io, "cannot listen for Ctrl-C").because(error))?;
    Ok(flag)
}

fn report_panics(console: &Arc<Console>) {
    let console = console.clone();
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        if std::env::var_os("RUST_BACKTRACE").is_some() {
            usual(panic);
        }
        let payload = panic.payload();
        let said = payload.downcast_ref::<&str>().copied();
        let said =
            said.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message");
        let place = panic.location().map_or_else(String::new, |place| format!(" ({place})"));
        console.error(
            &StageError::new(ErrorClass::Bug, format!("{said}{place}"))
                .help("this is a bug in boresight: please report it with the command line and the pipeline file")
                .help("finished products in the run folder are complete"),
        );
    }));
}
