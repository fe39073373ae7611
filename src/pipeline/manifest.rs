//! `manifest.json`: what is in a run folder, what it was made from and by what. The same input gives the same bytes; what
//! differs from run to run (timings) is in `timings.json`.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::timed::TaskSeconds;
use crate::config::Config;
use crate::formats::{atomic, libraries};
use crate::stages::{ErrorClass, FrameStatus, Stage, StageError, StageRecord};

/// File name in the run folder.
pub const MANIFEST: &str = "manifest.json";
/// File name in the run folder.
pub const TIMINGS: &str = "timings.json";
/// File name in the run folder.
pub const RESOLVED: &str = "resolved.toml";
/// File name in the run folder.
pub const REPORT: &str = "index.html";

const FORMAT: &str = "boresight-manifest";
const VERSION: u32 = 1;

/// The whole manifest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// "boresight-manifest".
    pub format: String,
    /// Version of this format.
    pub version: u32,
    /// Version of the program that wrote it.
    pub program_version: String,
    /// Versions of the libraries that decide bytes.
    pub libraries: BTreeMap<String, String>,
    /// The pipeline file.
    pub pipeline: PipelineEntry,
    /// Seed of everything random.
    pub seed: u64,
    /// The stages whose products are in the folder.
    pub stages: BTreeMap<Stage, StageEntry>,
    /// What became of every frame.
    pub frames: BTreeMap<String, FrameEntry>,
}

/// The pipeline file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PipelineEntry {
    /// Its file name.
    pub file: String,
    /// BLAKE3 of its text and overrides, hex.
    pub blake3: String,
    /// The overrides.
    pub overrides: Vec<String>,
}

/// One stage.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageEntry {
    /// Whether the products belong to those of the other stages.
    pub status: StageStatus,
    /// BLAKE3 of the settings the stage was run with, hex.
    pub settings_blake3: String,
    /// Files it read; paths from the pipeline file's folder.
    pub inputs: Vec<FileEntry>,
    /// Files it made; paths from the run folder.
    pub products: Vec<FileEntry>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// What became of each frame in this stage.
    pub frames: BTreeMap<String, FrameStatus>,
}

/// State of a stage's products.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StageStatus {
    /// Made from the products that stand in the folder.
    Done,
    /// An earlier stage was run again since.
    Outdated,
}

/// What became of a frame in the whole run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameEntry {
    /// "used" or "rejected".
    #[serde(flatten)]
    pub status: FrameStatus,
    /// The first stage that rejected it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rejected_by: Option<Stage>,
}

/// A file and its contents' identity.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileEntry {
    /// Path with forward slashes.
    pub path: String,
    /// Size.
    pub bytes: u64,
    /// BLAKE3 of the contents, hex.
    pub blake3: String,
}

impl Manifest {
    /// A manifest without stages.
    pub fn new(config: &Config) -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            program_version: env!("CARGO_PKG_VERSION").to_owned(),
            libraries: [("gdal", libraries::gdal_version()), ("proj", libraries::proj_version())]
                .map(|(name, version)| (name.to_owned(), version))
                .into(),
            pipeline: PipelineEntry {
                file: config.source.name.file_name().unwrap_or_default().to_string_lossy().into_owned(),
                blake3: config.fingerprint(),
                overrides: config.source.overrides().map(|(_, written)| written.to_owned()).collect(),
            },
            seed: config.run.seed,
            stages: BTreeMap::new(),
            frames: BTreeMap::new(),
        }
    }

    /// Reads the manifest of a run folder; `None` when it has none.
    ///
    /// # Errors
    /// The file is there and is not a manifest of this program.
    pub fn read(folder: &Path) -> Result<Option<Self>, StageError> {
        let path = folder.join(MANIFEST);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            // That the folder cannot be one is found out, with better words, when it is made.
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Ok(None);
            }
            Err(error) => {
                return Err(
                    StageError::new(ErrorClass::Io, format!("cannot read {}", path.display())).because(error)
                );
            }
        };
        let foreign = |why: String| {
            StageError::new(ErrorClass::Usage, format!("{} {why}", path.display()))
                .help("choose another folder with --output DIR, or overwrite this one with --force")
        };
        let manifest: Self = serde_json::from_slice(&bytes)
            .map_err(|error| foreign("is not a manifest of boresight".to_owned()).because(error))?;
        if manifest.format != FORMAT || manifest.version != VERSION {
            return Err(foreign(format!("is a {} of version {}", manifest.format, manifest.version)));
        }
        Ok(Some(manifest))
    }

    /// Writes the manifest into the run folder.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), StageError> {
        Ok(atomic::write_atomic(&folder.join(MANIFEST), json(self).as_bytes())?)
    }

    /// Enters a finished stage, replacing what stood there, and works out the frames anew.
    ///
    /// # Errors
    /// A file the stage read or made cannot be read again.
    pub fn enter(
        &mut self,
        stage: Stage,
        config: &Config,
        folder: &Path,
        record: &StageRecord,
    ) -> Result<(), StageError> {
        let inputs: Vec<_> = record.inputs.iter().collect();
        let products: Vec<_> = record.products.iter().collect();
        let entry = StageEntry {
            status: StageStatus::Done,
            settings_blake3: settings_hash(config, stage),
            inputs: inputs
                .par_iter()
                .map(|path| file_entry(path, &config.relative(path)))
                .collect::<Result<_, _>>()?,
            products: products
                .par_iter()
                .map(|path| file_entry(path, path.strip_prefix(folder).unwrap_or(path)))
                .collect::<Result<_, _>>()?,
            warnings: record.warnings.clone(),
            frames: record.frames.clone(),
        };
        self.stages.insert(stage, entry);
        for later in super::plan::made_from(stage) {
            if let Some(entry) = self.stages.get_mut(&later) {
                entry.status = StageStatus::Outdated;
            }
        }
        self.frames = frames(&self.stages);
        Ok(())
    }

    /// One hash over all inputs: their paths and contents, in order of path, each once.
    pub fn inputs_blake3(&self) -> String {
        let inputs: BTreeMap<&str, &str> = self
            .stages
            .values()
            .flat_map(|entry| &entry.inputs)
            .map(|input| (input.path.as_str(), input.blake3.as_str()))
            .collect();
        let mut hasher = blake3::Hasher::new();
        for (path, hash) in inputs {
            hasher.update(path.as_bytes()).update(b"\0").update(hash.as_bytes()).update(b"\0");
        }
        hasher.finalize().to_hex().to_string()
    }

    /// Frames that are not part of the products: name and reason.
    pub fn rejected(&self) -> impl Iterator<Item = (&str, &str)> {
        self.frames.iter().filter_map(|(name, entry)| match &entry.status {
            FrameStatus::Rejected { reason } => Some((name.as_str(), reason.as_str())),
            FrameStatus::Used => None,
        })
    }
}

/// Every frame with the first rejection any up-to-date stage gave it.
fn frames(stages: &BTreeMap<Stage, StageEntry>) -> BTreeMap<String, FrameEntry> {
    let mut frames: BTreeMap<String, FrameEntry> = BTreeMap::new();
    for (stage, entry) in stages.iter().filter(|(_, entry)| entry.status == StageStatus::Done) {
        for (name, status) in &entry.frames {
            let rejected_by = matches!(status, FrameStatus::Rejected { .. }).then_some(*stage);
            let new = FrameEntry { status: status.clone(), rejected_by };
            let known = frames.entry(name.clone()).or_insert_with(|| new.clone());
            if known.rejected_by.is_none() {
                *known = new;
            }
        }
    }
    frames
}

/// Identity of the settings a stage's products depend on.
pub(super) fn settings_hash(config: &Config, stage: Stage) -> String {
    let table = config.table_toml(stage.name()).unwrap_or_default();
    blake3::hash(format!("seed = {}\n{table}", config.run.seed).as_bytes()).to_hex().to_string()
}

fn file_entry(path: &Path, shown: &Path) -> Result<FileEntry, StageError> {
    let unreadable =
        |error| StageError::new(ErrorClass::Io, format!("cannot read {}", path.display())).because(error);
    let file = File::open(path).map_err(unreadable)?;
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(file).map_err(unreadable)?;
    Ok(FileEntry {
        path: slashes(shown),
        bytes: hasher.count(),
        blake3: hasher.finalize().to_hex().to_string(),
    })
}

fn slashes(path: &Path) -> String {
    path.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/").replace("//", "/")
}

/// `timings.json`: everything about a run that differs from one to the next.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Timings {
    /// When the run began, UTC.
    pub began: String,
    /// Threads it used.
    pub jobs: usize,
    /// Wall seconds of each stage that ran.
    pub stage_s: BTreeMap<Stage, f64>,
    /// Wall seconds of each piece of work of a stage.
    pub task_s: TaskSeconds,
}

impl Timings {
    /// Writes the timings into the run folder.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), StageError> {
        Ok(atomic::write_atomic(&folder.join(TIMINGS), json(self).as_bytes())?)
    }
}

fn json(value: &impl Serialize) -> String {
    let mut text =
        serde_json::to_string_pretty(value).expect("maps with string keys and plain values are JSON");
    text.push('\n');
    text
}

/// Removes products an earlier run of the stage made and this one did not: the folder holds what the manifest lists.
pub(super) fn remove_superseded(folder: &Path, earlier: Option<&StageEntry>, now: &StageRecord) {
    for product in earlier.map_or(&[][..], |entry| &entry.products) {
        let path: PathBuf = folder.join(&product.path);
        let inside =
            Path::new(&product.path).components().all(|part| matches!(part, std::path::Component::Normal(_)));
        if inside && !now.products.contains(&path) {
            // One that stays is not listed any more, and so not part of the run.
            let _ = std::fs::remove_file(path);
        }
    }
}
