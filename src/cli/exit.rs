//! Exit codes: the one place that knows them.

use std::process::ExitCode;

use crate::stages::ErrorClass;

/// How the program ended, as its caller sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExitClass {
    /// What was asked for is done (a run skipped for absent data included).
    Done = 0,
    /// This program is wrong.
    Bug = 1,
    /// The command line asks for what cannot be done.
    Usage = 2,
    /// The pipeline file is wrong.
    Pipeline = 3,
    /// An input is missing, unreadable or holds what cannot be.
    Input = 4,
    /// A limit of the pipeline file was exceeded; the products are complete.
    Limits = 5,
    /// The system could not store or show something.
    Io = 6,
    /// Stopped by the user (Ctrl-C).
    Interrupted = 130,
}

impl From<ErrorClass> for ExitClass {
    fn from(class: ErrorClass) -> Self {
        match class {
            ErrorClass::Usage => Self::Usage,
            ErrorClass::Pipeline => Self::Pipeline,
            ErrorClass::Input => Self::Input,
            ErrorClass::Limits => Self::Limits,
            ErrorClass::Io => Self::Io,
            ErrorClass::Interrupted => Self::Interrupted,
            ErrorClass::Bug => Self::Bug,
        }
    }
}

impl From<ExitClass> for ExitCode {
    fn from(class: ExitClass) -> Self {
        Self::from(class as u8)
    }
}

/// The exit codes, for `--help`.
pub const EXIT_CODES: &str = "\
Exit codes:
    0  done (also when the data a pipeline declares in [[run.requires]] is absent: \"skipped\")
    1  a bug in boresight
    2  wrong usage of the command line
    3  the pipeline file is wrong
    4  input data is missing, unreadable or wrong
    5  a limit of the pipeline file was exceeded; the products are complete
    6  a file could not be written
  130  interrupted (Ctrl-C)";
