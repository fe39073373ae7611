//! What every stage is given beside its settings and inputs: where its products go, a seeded generator, progress, the
//! record for the manifest, and the error through which it fails.

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, Place};
use crate::formats::atomic::{self, WriteError};

/// A stage of the run, in the order of the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Camera from photos, file or parameters.
    Calibrate,
    /// Frames and log to poses and footprints.
    Georeference,
    /// Frames to one map.
    Mosaic,
    /// What the products are worth.
    Accuracy,
}

impl Stage {
    /// All stages in the order of a run.
    pub const ALL: [Self; 4] = [Self::Calibrate, Self::Georeference, Self::Mosaic, Self::Accuracy];

    /// The stage's one name: table of the pipeline file, folder of the run, word on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Calibrate => "calibrate",
            Self::Georeference => "georeference",
            Self::Mosaic => "mosaic",
            Self::Accuracy => "accuracy",
        }
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// The kind of a failure; each has its exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorClass {
    /// The command line asks for what cannot be done.
    Usage,
    /// The pipeline file is wrong.
    Pipeline,
    /// An input is missing, unreadable or holds what cannot be.
    Input,
    /// A limit set by the pipeline file was exceeded.
    Limits,
    /// The system could not store a product.
    Io,
    /// The user stopped the run.
    Interrupted,
    /// This program is wrong.
    Bug,
}

impl ErrorClass {
    /// The word printed in `error[...]`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Usage => "usage",
            Self::Pipeline => "pipeline",
            Self::Input => "input",
            Self::Limits => "limits",
            Self::Io => "io",
            Self::Interrupted => "interrupted",
            Self::Bug => "bug",
        }
    }
}

/// Why a stage failed: what is wrong, its place in the pipeline file if it has one, what caused it, what to do.
#[derive(Debug)]
pub struct StageError(Box<Failure>);

#[derive(Debug)]
struct Failure {
    class: ErrorClass,
    message: String,
    place: Option<Place>,
    help: Vec<String>,
    cause: Option<Box<dyn Error + Send + Sync>>,
}

impl StageError {
    /// A failure with a lowercase fragment that holds the numbers: "log.csv line 7: latitude 91.2 deg is beyond a pole".
    pub fn new(class: ErrorClass, message: impl Into<String>) -> Self {
        Self(Box::new(Failure { class, message: message.into(), place: None, help: Vec::new(), cause: None }))
    }

    /// An input is missing, unreadable or holds what cannot be.
    pub fn input(message: impl Into<String>) -> Self {
        Self::new(ErrorClass::Input, message)
    }

    /// A setting of the pipeline file turned out to be wrong.
    pub fn pipeline(message: impl Into<String>) -> Self {
        Self::new(ErrorClass::Pipeline, message)
    }

    /// The place in the pipeline file that named what is wrong: `.at(config.at(&georeference.images))`.
    #[must_use]
    pub fn at(mut self, place: Option<Place>) -> Self {
        self.0.place = place;
        self
    }

    /// A next step for the user.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.0.help.push(help.into());
        self
    }

    /// The error underneath.
    #[must_use]
    pub fn because(mut self, cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        self.0.cause = Some(cause.into());
        self
    }

    /// The same failure of another kind.
    #[must_use]
    pub fn of_class(mut self, class: ErrorClass) -> Self {
        self.0.class = class;
        self
    }

    /// The kind of failure.
    pub fn class(&self) -> ErrorClass {
        self.0.class
    }

    /// The place in the pipeline file.
    pub fn place(&self) -> Option<&Place> {
        self.0.place.as_ref()
    }

    /// The next steps for the user.
    pub fn helps(&self) -> &[String] {
        &self.0.help
    }
}

impl fmt::Display for StageError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0.message)
    }
}

impl Error for StageError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.cause.as_deref().map(|cause| cause as &(dyn Error + 'static))
    }
}

impl From<WriteError> for StageError {
    fn from(error: WriteError) -> Self {
        let help = error.help();
        let WriteError { action, path, source } = error;
        let failure =
            Self::new(ErrorClass::Io, format!("cannot {action} {}", path.display())).because(source);
        match help {
            Some(help) => failure.help(help),
            None => failure,
        }
    }
}

impl From<ConfigError> for StageError {
    fn from(error: ConfigError) -> Self {
        let diagnostic = error.diagnostic();
        let failure = Self::pipeline(diagnostic.message.clone()).at(diagnostic.place.clone());
        diagnostic.help.iter().fold(failure, |failure, help| failure.help(help.clone()))
    }
}

/// Shows how far work has come.
pub trait Progress: Send + Sync {
    /// A piece of work begins: `label` says what ("rendering tiles"), `total` counts its steps.
    fn begin(&self, stage: Stage, label: &str, total: u64) -> Box<dyn TaskProgress>;
}

/// One piece of work under way; it ends when dropped.
pub trait TaskProgress: Send + Sync {
    /// So many steps more are done.
    fn advance(&self, steps: u64);
}

/// Shows nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn begin(&self, _: Stage, _: &str, _: u64) -> Box<dyn TaskProgress> {
        Box::new(Self)
    }
}

impl TaskProgress for NoProgress {
    fn advance(&self, _: u64) {}
}

/// What became of a frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum FrameStatus {
    /// It is part of the products.
    Used,
    /// It is not.
    Rejected {
        /// Why: a lowercase fragment with the numbers.
        reason: String,
    },
}

/// What one stage read, made and noticed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StageRecord {
    /// Files it read.
    pub inputs: BTreeSet<PathBuf>,
    /// Files it made.
    pub products: BTreeSet<PathBuf>,
    /// What became of each frame it was given, by file name.
    pub frames: BTreeMap<String, FrameStatus>,
    /// What the user should know, in the order noticed.
    pub warnings: Vec<String>,
}

impl StageRecord {
    /// Frames that are not part of the products, with the reason.
    pub fn rejected(&self) -> impl Iterator<Item = (&str, &str)> {
        self.frames.iter().filter_map(|(name, status)| match status {
            FrameStatus::Rejected { reason } => Some((name.as_str(), reason.as_str())),
            FrameStatus::Used => None,
        })
    }
}

/// What a stage is given beside settings and inputs.
///
/// Safe to use from several threads; what is recorded does not depend on their order (warnings excepted: give them
/// from one thread).
pub struct RunContext {
    stage: Stage,
    run_folder: Option<PathBuf>,
    seed: u64,
    progress: Arc<dyn Progress>,
    interrupted: Arc<AtomicBool>,
    record: Mutex<StageRecord>,
}

impl RunContext {
    /// A context whose products go to `run_folder/<stage>/`.
    pub fn new(
        stage: Stage,
        run_folder: &Path,
        seed: u64,
        progress: Arc<dyn Progress>,
        interrupted: Arc<AtomicBool>,
    ) -> Self {
        Self {
            run_folder: Some(run_folder.to_owned()),
            interrupted,
            progress,
            ..Self::without_products(stage, seed)
        }
    }

    /// A context for looking only (`check`, `locate`, `explain`): asking it for a product's path is an error.
    pub fn without_products(stage: Stage, seed: u64) -> Self {
        Self {
            stage,
            run_folder: None,
            seed,
            progress: Arc::new(NoProgress),
            interrupted: Arc::default(),
            record: Mutex::default(),
        }
    }

    /// The stage this context is for.
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// The run folder, which holds the stages' folders; `None` when nothing is to be written.
    pub fn run_folder(&self) -> Option<&Path> {
        self.run_folder.as_deref()
    }

    /// The run's seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// A generator for one independent piece of random work.
    ///
    /// `stream` numbers the piece (a frame, a chunk of draws), so that the numbers do not depend on which thread does
    /// it. Streams of different stages are unrelated.
    pub fn random(&self, stream: u64) -> ChaCha8Rng {
        let mut seed = [0; 32];
        seed[..8].copy_from_slice(&self.seed.to_le_bytes());
        seed[8] = self.stage as u8;
        let mut generator = ChaCha8Rng::from_seed(seed);
        generator.set_stream(stream);
        generator
    }

    /// Where the product `name` ("mosaic.tif", "orthos/IMG_1.tif") of this stage goes; makes the folder.
    ///
    /// # Errors
    /// The folder cannot be made, or this context is for looking only.
    pub fn product_path(&self, name: &str) -> Result<PathBuf, StageError> {
        let folder = self.run_folder.as_ref().ok_or_else(|| {
            StageError::new(
                ErrorClass::Bug,
                format!("the product {name} was to be written by a command that only looks"),
            )
        })?;
        let path = folder.join(self.stage.name()).join(name);
        atomic::create_folder(path.parent().unwrap_or(folder))?;
        Ok(path)
    }

    /// Writes a product at once and records it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_product(&self, name: &str, bytes: &[u8]) -> Result<PathBuf, StageError> {
        let path = self.product_path(name)?;
        atomic::write_atomic(&path, bytes)?;
        self.record_product(&path);
        Ok(path)
    }

    /// Notes a file that was read, for the manifest.
    pub fn record_input(&self, path: &Path) {
        self.lock().inputs.insert(path.to_owned());
    }

    /// Notes a file that was made, for the manifest.
    pub fn record_product(&self, path: &Path) {
        self.lock().products.insert(path.to_owned());
    }

    /// Notes what became of a frame. A rejection is never taken back by a later `Used`.
    pub fn record_frame(&self, name: &str, status: FrameStatus) {
        let mut record = self.lock();
        let entry = record.frames.entry(name.to_owned()).or_insert_with(|| status.clone());
        if *entry == FrameStatus::Used {
            *entry = status;
        }
    }

    /// Tells the user something that does not stop the run; it is logged now and kept in the manifest.
    pub fn warn(&self, warning: impl Into<String>) {
        let warning = warning.into();
        tracing::warn!(stage = self.stage.name(), "{warning}");
        self.lock().warnings.push(warning);
    }

    /// Begins a piece of work of `total` steps; it ends when the result is dropped.
    pub fn task(&self, label: &str, total: usize) -> Box<dyn TaskProgress> {
        self.progress.begin(self.stage, label, total as u64)
    }

    /// To be asked between pieces of work (a frame, a tile).
    ///
    /// # Errors
    /// [`ErrorClass::Interrupted`] once the user has asked to stop.
    pub fn check_interrupted(&self) -> Result<(), StageError> {
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(StageError::new(
                ErrorClass::Interrupted,
                "stopped on request; finished products are in place",
            ));
        }
        Ok(())
    }

    /// What was recorded so far.
    pub fn record(&self) -> StageRecord {
        self.lock().clone()
    }

    /// A panic elsewhere does not make the record wrong: every change to it is one insertion.
    fn lock(&self) -> MutexGuard<'_, StageRecord> {
        self.record.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use rand::prelude::*;

    use super::*;

    #[test]
    fn random_streams_are_repeatable_and_differ_by_stream_stage_and_seed() {
        let draw =
            |stage, seed, stream| RunContext::without_products(stage, seed).random(stream).random::<u64>();
        let first = draw(Stage::Accuracy, 1, 0);
        assert_eq!(first, draw(Stage::Accuracy, 1, 0));
        for other in [draw(Stage::Accuracy, 1, 1), draw(Stage::Accuracy, 2, 0), draw(Stage::Mosaic, 1, 0)] {
            assert_ne!(first, other);
        }
    }

    #[test]
    fn a_rejection_is_not_taken_back() {
        let context = RunContext::without_products(Stage::Georeference, 0);
        let rejected = FrameStatus::Rejected { reason: "no log row".into() };
        context.record_frame("a.jpg", rejected.clone());
        context.record_frame("a.jpg", FrameStatus::Used);
        context.record_frame("b.jpg", FrameStatus::Used);
        context.record_frame("b.jpg", rejected);
        context.record_frame("c.jpg", FrameStatus::Used);
        let record = context.record();
        assert_eq!(record.rejected().map(|(name, _)| name).collect::<Vec<_>>(), ["a.jpg", "b.jpg"]);
    }

    #[test]
    fn products_go_to_the_stage_s_folder_and_are_recorded() {
        let folder = tempfile::tempdir().unwrap();
        let context = RunContext::new(Stage::Mosaic, folder.path(), 0, Arc::new(NoProgress), Arc::default());
        let path = context.write_product("parts/a.txt", b"x").unwrap();
        assert_eq!(path, folder.path().join("mosaic/parts/a.txt"));
        assert!(context.record().products.contains(&path));
        let looking = RunContext::without_products(Stage::Mosaic, 0);
        assert_eq!(looking.product_path("a").unwrap_err().class(), ErrorClass::Bug);
    }

    #[test]
    fn a_request_to_stop_is_seen() {
        let stop = Arc::new(AtomicBool::new(false));
        let context = RunContext::new(Stage::Mosaic, Path::new("."), 0, Arc::new(NoProgress), stop.clone());
        assert!(context.check_interrupted().is_ok());
        stop.store(true, Ordering::Relaxed);
        assert_eq!(context.check_interrupted().unwrap_err().class(), ErrorClass::Interrupted);
    }
}
