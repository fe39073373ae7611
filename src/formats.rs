//! Files to types and back: the only user of the file system below the engine.
//!
//! Whatever a file says in its own units, senses, datums, CRS and pixel origin leaves here in ours
//! (`CONVENTIONS.md`).

pub mod atomic;
pub mod camera;
pub mod corners;
pub mod crs;
pub mod elevation;
pub mod files;
pub mod flight;
pub mod geoid;
pub mod geotiff;
pub mod libraries;
pub mod log;
pub mod metadata;
pub mod photo;
pub mod survey;
pub mod table;

use std::ops::Range;
use std::path::{Path, PathBuf};

/// Why an input file cannot be used: which file, where in it, what is wrong, what to do.
#[derive(Debug, Clone, PartialEq)]
pub struct InputError {
    /// The file; empty when it is the pipeline file itself.
    pub file: PathBuf,
    /// Line in it, 1-based, when one line is to blame.
    pub line: Option<u64>,
    /// What is wrong: a lowercase fragment with the numbers in it.
    pub cause: String,
    /// The next step, when there is an obvious one.
    pub help: Option<String>,
    /// The key of the pipeline file that led here, as bytes of its text.
    pub span: Option<Range<usize>>,
}

impl InputError {
    /// An error of a whole file.
    pub fn new(file: &Path, cause: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line: None, cause: cause.into(), help: None, span: None }
    }
    /// An error of a setting: only the pipeline file's own place is to blame.
    pub fn of_setting<T>(key: &crate::config::Located<T>, cause: impl Into<String>) -> Self {
        Self::new(Path::new(""), cause).caused_by(key)
    }
    /// True for [`InputError::of_setting`].
    #[must_use]
    pub fn is_of_pipeline_file(&self) -> bool {
        self.file.as_os_str().is_empty()
    }
    /// Names the line.
    #[must_use]
    pub fn line(self, line: u64) -> Self {
        Self { line: Some(line), ..self }
    }
    /// Adds the next step.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }
    /// Points at the key of the pipeline file that led here.
    #[must_use]
    pub fn caused_by<T>(self, key: &crate::config::Located<T>) -> Self {
        Self { span: Some(key.span.clone()), ..self }
    }
}

impl std::fmt::Display for InputError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.is_of_pipeline_file() {
            write!(f, "{}", self.file.display())?;
            if let Some(line) = self.line {
                write!(f, ", line {line}")?;
            }
            f.write_str(": ")?;
        }
        f.write_str(&self.cause)
    }
}

impl std::error::Error for InputError {}
