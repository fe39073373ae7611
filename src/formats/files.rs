//! Which files a pipeline means: patterns of names, and the frames of a folder. Always sorted, so that runs repeat.

use std::path::{Path, PathBuf};

use thiserror::Error;

/// Extensions of frames, lower case.
pub const IMAGE_EXTENSIONS: [&str; 5] = ["jpg", "jpeg", "png", "tif", "tiff"];

/// Why files could not be listed.
#[derive(Debug, Error)]
pub enum FilesError {
    /// The pattern itself is wrong.
    #[error("\"{pattern}\" is not a pattern of file names: {reason}")]
    Pattern {
        /// The pattern as written.
        pattern: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// No file has such a name.
    #[error("no file matches \"{pattern}\" in {}", base.display())]
    NoMatch {
        /// The pattern as written.
        pattern: String,
        /// The folder it was looked up from.
        base: PathBuf,
    },
    /// There is no such folder.
    #[error("folder {} does not exist", folder.display())]
    NoFolder {
        /// The folder.
        folder: PathBuf,
    },
    /// The path is a file.
    #[error("{} is not a folder", folder.display())]
    NotAFolder {
        /// The path.
        folder: PathBuf,
    },
    /// The folder holds no frame.
    #[error("folder {} holds no image (jpg, jpeg, png, tif, tiff)", folder.display())]
    NoImages {
        /// The folder.
        folder: PathBuf,
    },
    /// The system refused.
    #[error("cannot list {}", folder.display())]
    Unreadable {
        /// The folder.
        folder: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
}

/// The files that match any of the patterns (`*`, `?`, `[a-z]`, `**`), sorted, each once.
///
/// - `base`: the folder relative patterns count from; taken literally, whatever signs its name holds.
///
/// # Errors
/// A pattern is wrong, matches nothing, or a folder cannot be read.
pub fn matching(base: &Path, patterns: &[String]) -> Result<Vec<PathBuf>, FilesError> {
    let mut found = Vec::new();
    for pattern in patterns {
        let anchored = match base.to_str() {
            _ if Path::new(pattern).is_absolute() => pattern.clone(),
            Some("") => pattern.clone(),
            base => format!("{}/{pattern}", glob::Pattern::escape(base.unwrap_or("."))),
        };
        let before = found.len();
        let paths = glob::glob(&anchored)
            .map_err(|error| FilesError::Pattern { pattern: pattern.clone(), reason: error.msg })?;
        for path in paths {
            let path = path.map_err(|error| FilesError::Unreadable {
                folder: error.path().to_owned(),
                source: error.into(),
            })?;
            if path.is_file() {
                found.push(path);
            }
        }
        if found.len() == before {
            return Err(FilesError::NoMatch { pattern: pattern.clone(), base: base.to_owned() });
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// The images in a folder (not in folders inside it), sorted by name. Hidden files are not images.
///
/// # Errors
/// The folder does not exist, cannot be read, or holds no image.
pub fn images(folder: &Path) -> Result<Vec<PathBuf>, FilesError> {
    if !folder.exists() {
        return Err(FilesError::NoFolder { folder: folder.to_owned() });
    }
    if !folder.is_dir() {
        return Err(FilesError::NotAFolder { folder: folder.to_owned() });
    }
    let unreadable = |source| FilesError::Unreadable { folder: folder.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let is_image = path.extension().is_some_and(|extension| {
            IMAGE_EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
        });
        let hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if is_image && !hidden && path.is_file() {
            found.push(path);
        }
    }
    if found.is_empty() {
        return Err(FilesError::NoImages { folder: folder.to_owned() });
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make incomplete files on purpose")]
mod tests {
    use std::fs;

    use super::*;

    fn folder_with(names: &[&str]) -> tempfile::TempDir {
        // A name with a pattern's signs must be taken literally.
        let folder = tempfile::Builder::new().prefix("a[b]*").tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"").unwrap();
        }
        folder
    }

    fn names(paths: &[PathBuf]) -> Vec<&str> {
        paths.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect()
    }

    #[test]
    fn patterns_give_each_file_once_and_sorted() {
        let folder = folder_with(&["c/2.png", "c/1.png", "c/1.txt", "d/0.png"]);
        let pattern = |text: &str| text.to_owned();
        let found = matching(folder.path(), &[pattern("c/*.png"), pattern("*/1.png")]).unwrap();
        assert_eq!(names(&found), ["1.png", "2.png"]);
        let found = matching(
            Path::new("elsewhere"),
            &[folder.path().join("d").to_str().unwrap().replace('[', "[[]").replace("*", "[*]") + "/*.png"],
        );
        assert_eq!(names(&found.unwrap()), ["0.png"]);
    }

    #[test]
    fn patterns_without_a_file_are_named() {
        let folder = folder_with(&["a.png"]);
        let error = matching(folder.path(), &["a.png".into(), "*.tif".into()]).unwrap_err();
        assert!(error.to_string().contains("no file matches \"*.tif\""), "{error}");
        assert!(matches!(matching(folder.path(), &["[a".into()]), Err(FilesError::Pattern { .. })));
    }

    #[test]
    fn frames_are_the_images_of_the_folder_itself() {
        let folder = folder_with(&["b.JPG", "a.jpeg", "x.txt", ".hidden.jpg", "deep/c.jpg"]);
        assert_eq!(names(&images(folder.path()).unwrap()), ["a.jpeg", "b.JPG"]);
        let empty = folder_with(&["x.txt"]);
        assert!(matches!(images(empty.path()), Err(FilesError::NoImages { .. })));
        assert!(matches!(images(&empty.path().join("nowhere")), Err(FilesError::NoFolder { .. })));
        assert!(matches!(images(&empty.path().join("x.txt")), Err(FilesError::NotAFolder { .. })));
    }
}
