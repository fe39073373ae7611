//! The one error of this module: a diagnostic with its place in the pipeline file.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::source::{Diagnostic, Located, Place, Source};

/// Why a pipeline file was refused, and where.
#[derive(Debug, Clone)]
pub struct ConfigError(Box<Diagnostic>);

impl ConfigError {
    pub(super) fn at(source: &Arc<Source>, span: Range<usize>, message: impl Into<String>) -> Self {
        Self(Box::new(Diagnostic {
            message: message.into(),
            place: Some(Place { source: source.clone(), span }),
            help: Vec::new(),
        }))
    }

    /// An error of the file as a whole (it cannot be read, or is not text).
    pub fn whole_file(name: &Path, message: impl std::fmt::Display) -> Self {
        Self(Box::new(Diagnostic {
            message: format!("{}: {message}", name.display()),
            place: None,
            help: Vec::new(),
        }))
    }

    /// Adds a next step for the user.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.0.help.push(help.into());
        self
    }

    /// What is wrong, where, and what to do.
    pub fn diagnostic(&self) -> &Diagnostic {
        &self.0
    }
}

impl std::fmt::Display for ConfigError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.0.place {
            Some(place) => write!(formatter, "{place}: {}", self.0.message),
            None => formatter.write_str(&self.0.message),
        }
    }
}

impl std::error::Error for ConfigError {}

/// What resolving a table needs beside the table: the text to point into and the folder paths start from.
pub(super) struct Resolver {
    pub source: Arc<Source>,
    pub base: PathBuf,
}

impl Resolver {
    pub fn error<T>(&self, at: &Located<T>, message: impl Into<String>) -> ConfigError {
        ConfigError::at(&self.source, at.span.clone(), message)
    }

    /// A path of the file, from the file's own folder.
    pub fn path(&self, written: &Located<PathBuf>) -> Result<Located<PathBuf>, ConfigError> {
        if written.as_os_str().is_empty() {
            return Err(self.error(written, "the path is empty"));
        }
        Ok(Located { value: self.base.join(&written.value), span: written.span.clone() })
    }

    /// Refuses a key that this combination of choices would ignore.
    pub fn unused<T>(&self, key: &Option<Located<T>>, name: &str, because: &str) -> Result<(), ConfigError> {
        match key {
            Some(value) => Err(self
                .error(value, format!("`{name}` would not be used: {because}"))
                .help(format!("remove `{name}`"))),
            None => Ok(()),
        }
    }
}
