//! Which camera of a file, and what a file may leave to its reader.

use crate::formats::InputError;
use std::path::Path;

/// Which camera of a file is meant, and what the file does not say.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CameraChoice<'a> {
    /// Name of the camera in a file of several; `None` when the file has one.
    pub name: Option<&'a str>,
    /// Columns and rows of the image, where the file does not say them; where it does, it must agree.
    pub image_size: Option<(u32, u32)>,
}

impl CameraChoice<'_> {
    /// The one camera that is meant, with its name.
    ///
    /// # Errors
    /// [`InputError`]: there is none, there are several and none is named, or none has the name.
    pub(super) fn of<T>(&self, file: &Path, cameras: Vec<(String, T)>) -> Result<(String, T), InputError> {
        let names = listed(cameras.iter().map(|(name, _)| name.as_str()));
        match self.name {
            Some(wanted) => cameras
                .into_iter()
                .find(|(name, _)| name == wanted)
                .ok_or_else(|| InputError::new(file, format!("has no camera \"{wanted}\"; it has {names}"))),
            None => {
                let count = cameras.len();
                match <[(String, T); 1]>::try_from(cameras) {
                    Ok([camera]) => Ok(camera),
                    Err(_) if count == 0 => Err(InputError::new(file, "holds no camera")),
                    Err(_) => Err(InputError::new(file, format!("holds {count} cameras: {names}"))
                        .help("name the one that took the photos")),
                }
            }
        }
    }

    /// Refuses a name for a format whose files hold one camera.
    pub(super) fn expects_one(&self, file: &Path, format: &str) -> Result<(), InputError> {
        match self.name {
            None => Ok(()),
            Some(name) => Err(InputError::new(
                file,
                format!(
                    "is a {format} file, which holds one camera: it cannot be chosen by the name \"{name}\""
                ),
            )
            .help("leave the name out")),
        }
    }

    /// The image size that the file says, or the one that is given instead.
    ///
    /// # Errors
    /// [`InputError`]: neither, or both and they differ.
    pub(super) fn size(&self, file: &Path, said: Option<(u32, u32)>) -> Result<(u32, u32), InputError> {
        match (said, self.image_size) {
            (Some(said), Some(given)) if said != given => Err(InputError::new(
                file,
                format!("is for images of {} × {} px, not {} × {} px", said.0, said.1, given.0, given.1),
            )),
            (Some(size), _) | (None, Some(size)) => Ok(size),
            (None, None) => Err(InputError::new(file, "does not say how many pixels the image has")
                .help("give the image size beside the file")),
        }
    }
}

/// Names in quotes; the first twenty of many.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const MOST: usize = 20;
    let names: Vec<String> = names.map(|name| format!("\"{name}\"")).collect();
    let shown = names.iter().take(MOST).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > MOST { format!("{shown} and {} more", names.len() - MOST) } else { shown }
}
