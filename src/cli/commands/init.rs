//! `init`: a folder in, a commented pipeline file out.

use std::fmt::Write;

use crate::cli::args::InitArguments;
use crate::cli::exit::ExitClass;
use crate::cli::output::{print, print_json};
use crate::stages::StageError;
use crate::stages::init::{Written, init};

pub fn run(arguments: &InitArguments) -> Result<ExitClass, StageError> {
    let written = init(&arguments.folder, arguments.output.as_deref(), arguments.force)?;
    if arguments.json {
        print_json(&written)?;
    } else {
        print(&report(&written))?;
    }
    // The file is there to be mended, but nothing can be run with it yet.
    Ok(if written.failure.is_some() { ExitClass::Input } else { ExitClass::Done })
}

fn report(written: &Written) -> String {
    let mut text = format!("file      {}\nposes     {}\n", written.file.display(), written.poses);
    match &written.failure {
        Some(failure) => {
            let _ = writeln!(text, "fails     {failure}");
        }
        None => {
            let (used, all) = (written.frames_used, written.frames_used + written.frames_rejected.len());
            let _ = writeln!(text, "frames    {used} of {all} would be used");
        }
    }
    for frame in &written.frames_rejected {
        let _ = writeln!(text, "rejected  {}: {}", frame.frame, frame.reason);
    }
    if let Some(size) = written.mosaic {
        let _ = writeln!(text, "mosaic    {} × {} pixels of {} m", size.columns, size.rows, size.gsd_m);
    }
    for (word, entries) in
        [("not used", &written.left_out), ("assumed", &written.assumptions), ("QUESTION", &written.questions)]
    {
        for entry in entries {
            let _ = writeln!(text, "{word:<9} {entry}");
        }
    }
    let _ = writeln!(text, "next      boresight check {}", written.file.display());
    text
}
