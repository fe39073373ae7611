//! The run folder: whose it is, and that one run at a time writes into it.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use super::manifest::Manifest;
use crate::config::Config;
use crate::formats::atomic;
use crate::stages::{ErrorClass, Stage, StageError};

/// Held while a run writes; hidden, and left in place: a lock file that is removed can be locked twice.
const LOCK: &str = ".boresight-lock";

/// A run folder that is this run's alone until dropped.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    /// What an earlier run of the same pipeline left here.
    earlier: Option<Manifest>,
    _lock: File,
}

impl RunFolder {
    /// Makes the folder, or takes over one that an earlier run of the same pipeline file made.
    ///
    /// - `force`: take over a folder whatever is in it (files of other programs stay).
    ///
    /// # Errors
    /// The folder holds something else, another run is writing into it, or the system refuses.
    pub fn open(path: &Path, config: &Config, force: bool) -> Result<Self, StageError> {
        let earlier = check(path, config, force)?;
        let place = config.at(&config.run.output);
        atomic::create_folder(path).map_err(|error| StageError::from(error).at(place))?;
        let lock = lock(path)?;
        for folder in [path.to_owned()].into_iter().chain(Stage::ALL.map(|stage| path.join(stage.name()))) {
            atomic::remove_incomplete(&folder);
        }
        Ok(Self { path: path.to_owned(), earlier, _lock: lock })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What an earlier run of the same pipeline left here.
    pub fn earlier(&self) -> Option<&Manifest> {
        self.earlier.as_ref()
    }
}

/// Whether a run may write into `path`; the manifest of the earlier run that it continues.
///
/// # Errors
/// The folder holds something else and `force` is not given.
pub fn check(path: &Path, config: &Config, force: bool) -> Result<Option<Manifest>, StageError> {
    let another = |message: String| {
        StageError::new(ErrorClass::Usage, message)
            .at(config.at(&config.run.output))
            .help("choose another folder with --output DIR, or overwrite this one with --force")
    };
    match Manifest::read(path) {
        Ok(Some(manifest)) => {
            let (ours, theirs) = (Manifest::new(config).pipeline.file, &manifest.pipeline.file);
            if ours == *theirs {
                return Ok(Some(manifest));
            }
            if force {
                return Ok(None);
            }
            Err(another(format!(
                "the run folder {} was made from another pipeline, {theirs}",
                path.display()
            )))
        }
        Ok(None) => {
            let foreign = std::fs::read_dir(path).is_ok_and(|entries| {
                entries.flatten().any(|entry| {
                    let name = entry.file_name();
                    name != LOCK && !name.as_encoded_bytes().starts_with(atomic::TEMPORARY_PREFIX.as_bytes())
                })
            });
            if foreign && !force {
                return Err(another(format!(
                    "the folder {} holds files that are not of a run",
                    path.display()
                )));
            }
            Ok(None)
        }
        Err(error) if force && error.class() == ErrorClass::Usage => Ok(None),
        Err(error) => Err(error),
    }
}

fn lock(folder: &Path) -> Result<File, StageError> {
    let path = folder.join(LOCK);
    let failed =
        |error| StageError::from(atomic::WriteError { action: "create", path: path.clone(), source: error });
    let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(StageError::new(
            ErrorClass::Usage,
            format!("another run is writing into {}", folder.display()),
        )
        .help("wait for it, or choose another folder with --output DIR")),
        // A file system without locks (some network shares): the check is lost, the run is not.
        Err(TryLockError::Error(error)) if error.kind() == std::io::ErrorKind::Unsupported => Ok(file),
        Err(TryLockError::Error(error)) => Err(failed(error)),
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests put foreign files in place")]
mod tests {
    use super::*;
    use crate::pipeline::execute::tests::pipeline;

    #[test]
    fn a_folder_of_other_files_is_refused_unless_forced() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("thesis.txt"), "x").unwrap();
        let error = RunFolder::open(folder.path(), &pipeline(""), false).unwrap_err();
        assert_eq!(error.class(), ErrorClass::Usage);
        assert!(error.helps()[0].contains("--force"));
        RunFolder::open(folder.path(), &pipeline(""), true).unwrap();
        assert!(folder.path().join("thesis.txt").exists());
    }

    #[test]
    fn a_folder_of_another_pipeline_is_refused_unless_forced() {
        let folder = tempfile::tempdir().unwrap();
        let mut manifest = Manifest::new(&pipeline(""));
        manifest.write(folder.path()).unwrap();
        assert!(RunFolder::open(folder.path(), &pipeline(""), false).unwrap().earlier().is_some());
        manifest.pipeline.file = "other.toml".into();
        manifest.write(folder.path()).unwrap();
        let error = RunFolder::open(folder.path(), &pipeline(""), false).unwrap_err();
        assert!(error.to_string().contains("another pipeline, other.toml"), "{error}");
        assert!(RunFolder::open(folder.path(), &pipeline(""), true).unwrap().earlier().is_none());
        std::fs::write(folder.path().join(super::super::manifest::MANIFEST), "{}").unwrap();
        let error = RunFolder::open(folder.path(), &pipeline(""), false).unwrap_err();
        assert!(error.to_string().contains("is not a manifest"), "{error}");
        RunFolder::open(folder.path(), &pipeline(""), true).unwrap();
    }

    #[test]
    fn two_runs_cannot_share_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let first = RunFolder::open(folder.path(), &pipeline(""), false).unwrap();
        let error = RunFolder::open(folder.path(), &pipeline(""), false).unwrap_err();
        assert!(error.to_string().contains("another run is writing"), "{error}");
        drop(first);
        RunFolder::open(folder.path(), &pipeline(""), false).unwrap();
    }

    #[test]
    fn a_file_in_the_folder_s_place_is_an_io_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "x").unwrap();
        let error = RunFolder::open(&path.join("out"), &pipeline(""), false).unwrap_err();
        assert_eq!(error.class(), ErrorClass::Io);
    }
}
