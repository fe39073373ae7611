//! Files that appear only when complete: written under a temporary name in the target's folder, flushed to disk, then renamed.
//!
//! A reader sees the old file or the new one, never a part; when writing fails the old file stays and the temporary
//! one is removed.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};
use thiserror::Error;

/// What temporary names begin with; hidden, and recognisable should the machine fail before they are removed.
pub const TEMPORARY_PREFIX: &str = ".incomplete-";

/// Why a file could not be written.
#[derive(Debug, Error)]
#[error("cannot {action} {}", path.display())]
pub struct WriteError {
    /// What was tried ("create", "write", "rename").
    pub action: &'static str,
    /// The file that was to appear.
    pub path: PathBuf,
    /// What the system said.
    #[source]
    pub source: io::Error,
}

impl WriteError {
    /// The next step for the user, where the system's answer tells.
    pub fn help(&self) -> Option<&'static str> {
        match self.source.kind() {
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
                Some("choose a folder you may write to: --output DIR")
            }
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                Some("free some space, or choose a folder on another disk: --output DIR")
            }
            io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists => {
                Some("a file stands where a folder is needed: choose another folder with --output DIR")
            }
            _ => None,
        }
    }
}

fn failed(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> WriteError {
    move |source| WriteError { action, path: path.to_owned(), source }
}

/// A file being written; it appears under its name at [`AtomicFile::commit`] and not at all without.
#[derive(Debug)]
pub struct AtomicFile {
    temporary: NamedTempFile,
    target: PathBuf,
}

impl AtomicFile {
    /// Begins a file that will stand at `target`, whose folder must exist.
    ///
    /// # Errors
    /// [`WriteError`] when the folder cannot be written to.
    pub fn create(target: &Path) -> Result<Self, WriteError> {
        let temporary = temporary_beside(target).map_err(failed("create", target))?;
        Ok(Self { temporary, target: target.to_owned() })
    }

    /// Flushes the file to disk and gives it its name, replacing any older file.
    ///
    /// # Errors
    /// [`WriteError`] when the system could not store it; the older file then still stands.
    pub fn commit(mut self) -> Result<(), WriteError> {
        self.temporary
            .flush()
            .and_then(|()| self.temporary.as_file().sync_all())
            .map_err(failed("write", &self.target))?;
        self.temporary.persist(&self.target).map_err(|error| failed("rename", &self.target)(error.error))?;
        sync_folder_of(&self.target)
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temporary.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.temporary.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.temporary.seek(position)
    }
}

/// Writes a whole file at once.
///
/// # Errors
/// [`WriteError`]; an older file then still stands.
pub fn write_atomic(target: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    let mut file = AtomicFile::create(target)?;
    file.write_all(bytes).map_err(failed("write", target))?;
    file.commit()
}

/// Lets a writer that insists on a path of its own (GDAL) make a file, which appears at `target` when `write` succeeds.
///
/// `write` gets a temporary path in the same folder with the same extension; no file stands there yet. Whatever it
/// leaves beside it (`.aux.xml`, `.ovr.tmp`, ...) is removed, so everything that matters must be inside the one file.
///
/// # Errors
/// Those of `write`, or [`WriteError`]; an older file then still stands.
pub fn atomic_path<T, E: From<WriteError>>(
    target: &Path,
    write: impl FnOnce(&Path) -> Result<T, E>,
) -> Result<T, E> {
    // The empty placeholder reserves the name; GDAL would rather create the file itself.
    let placeholder = temporary_beside(target).map_err(failed("create", target))?;
    let path = placeholder.path().to_owned();
    drop(placeholder);
    let leftovers = Leftovers { of: path.clone() };
    let value = write(&path)?;
    let file = File::open(&path).map_err(failed("write", target))?;
    file.sync_all().map_err(failed("write", target))?;
    fs::rename(&path, target).map_err(failed("rename", target))?;
    drop(leftovers);
    sync_folder_of(target)?;
    Ok(value)
}

/// Creates a folder and those above it.
///
/// # Errors
/// [`WriteError`] when the system refuses.
pub fn create_folder(folder: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(folder).map_err(failed("create folder", folder))
}

/// Removes temporary files that a run left behind which was killed before it could do so itself.
///
/// Only to be called while no other run writes into `folder`.
pub fn remove_incomplete(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        if entry.file_name().as_encoded_bytes().starts_with(TEMPORARY_PREFIX.as_bytes()) {
            // A leftover that stays is untidy, not wrong.
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn temporary_beside(target: &Path) -> io::Result<NamedTempFile> {
    let extension = target.extension().map_or_else(OsString::new, |extension| {
        let mut dotted = OsString::from(".");
        dotted.push(extension);
        dotted
    });
    let mut builder = Builder::new();
    builder.prefix(TEMPORARY_PREFIX).suffix(&extension);
    // Temporary files are private by default and a rename keeps that: products are for everybody the umask allows.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o644));
    }
    builder.tempfile_in(folder_of(target))
}

fn folder_of(target: &Path) -> &Path {
    match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// A rename is only lasting once the folder itself is on disk.
fn sync_folder_of(target: &Path) -> Result<(), WriteError> {
    #[cfg(unix)]
    File::open(folder_of(target)).and_then(|folder| folder.sync_all()).map_err(failed("write", target))?;
    Ok(())
}

/// Removes a temporary file and everything a writer put beside it under a name that begins like it.
struct Leftovers {
    of: PathBuf,
}

impl Drop for Leftovers {
    fn drop(&mut self) {
        let Some(name) = self.of.file_name() else { return };
        let Ok(entries) = fs::read_dir(folder_of(&self.of)) else { return };
        for entry in entries.flatten() {
            if entry.file_name().as_encoded_bytes().starts_with(name.as_encoded_bytes()) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make incomplete files on purpose")]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_appears_whole_at_commit_and_replaces_the_older_one() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.txt");
        write_atomic(&target, b"old").unwrap();
        let mut file = AtomicFile::create(&target).unwrap();
        file.write_all(b"new").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"old");
        file.commit().unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[cfg(unix)]
    #[test]
    fn products_can_be_read_by_others() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.txt");
        write_atomic(&target, b"x").unwrap();
        assert_eq!(fs::metadata(&target).unwrap().permissions().mode() & 0o777, 0o644);
    }

    #[test]
    fn without_commit_nothing_appears_and_nothing_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.txt");
        write_atomic(&target, b"old").unwrap();
        let mut file = AtomicFile::create(&target).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert_eq!(fs::read(&target).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_path_writer_that_fails_leaves_the_older_file_and_no_sidecars() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.tif");
        write_atomic(&target, b"old").unwrap();
        let outcome: Result<(), WriteError> = atomic_path(&target, |path| {
            assert_eq!(path.extension().unwrap(), "tif");
            assert!(!path.exists());
            fs::write(path, b"half").unwrap();
            fs::write(format!("{}.ovr.tmp", path.display()), b"half").unwrap();
            Err(WriteError {
                action: "write",
                path: path.to_owned(),
                source: io::ErrorKind::StorageFull.into(),
            })
        });
        assert!(outcome.unwrap_err().help().unwrap().contains("free some space"));
        assert_eq!(fs::read(&target).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a.tif"]);
    }

    #[test]
    fn a_path_writer_that_succeeds_leaves_only_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.tif");
        let value: u32 = atomic_path(&target, |path| {
            fs::write(path, b"new").unwrap();
            fs::write(format!("{}.aux.xml", path.display()), b"<x/>").unwrap();
            Ok::<_, WriteError>(5)
        })
        .unwrap();
        assert_eq!(value, 5);
        assert_eq!(fs::read(&target).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["a.tif"]);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("missing").join("a.txt");
        let error = write_atomic(&target, b"x").unwrap_err();
        assert!(error.to_string().contains("cannot create"), "{error}");
        assert!(error.to_string().contains("a.txt"), "{error}");
    }

    #[test]
    fn leftovers_of_a_killed_run_are_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(format!("{TEMPORARY_PREFIX}x.tif")), b"").unwrap();
        fs::write(folder.path().join("kept.tif"), b"").unwrap();
        remove_incomplete(folder.path());
        assert_eq!(names(folder.path()), ["kept.tif"]);
    }
}
