//! The frames of a mosaic, decoded when first needed and kept while memory allows.

use super::decode_bytes;
use crate::mosaic::{FrameFailure, FrameSource};
use crate::raster::ImagePyramid;
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Decoded photos behind a ceiling: the one used longest ago makes room.
///
/// Threads that want the same photo wait for one decoding. A photo in use stays in memory until its user
/// lets go, so the ceiling may be passed by one photo per thread.
pub struct PhotoStore {
    photos: Vec<Photo>,
    channels: usize,
    ceiling: usize,
    ledger: Mutex<Ledger>,
    decoded: AtomicUsize,
}

struct Photo {
    path: PathBuf,
    name: String,
    held: Mutex<Option<Arc<ImagePyramid>>>,
    hash: OnceLock<blake3::Hash>,
}

#[derive(Default)]
struct Ledger {
    clock: u64,
    bytes: usize,
    /// Photo → when last used, and its size.
    held: BTreeMap<usize, (u64, usize)>,
}

impl PhotoStore {
    /// - `paths`: the photos in the order of the plan's frames.
    /// - `channels`: 1 for a grey mosaic, 3 for a coloured one, whose photos are padded.
    /// - `ceiling`: bytes of decoded photos to keep.
    #[must_use]
    pub fn new(paths: Vec<PathBuf>, channels: usize, ceiling: usize) -> Self {
        let photo = |path: PathBuf| Photo {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            path,
            held: Mutex::new(None),
            hash: OnceLock::new(),
        };
        Self {
            photos: paths.into_iter().map(photo).collect(),
            channels,
            ceiling,
            ledger: Mutex::default(),
            decoded: AtomicUsize::new(0),
        }
    }

    /// How many photos were decoded so far, repeats counted. Depends on threads and ceiling.
    #[must_use]
    pub fn decoded(&self) -> usize {
        self.decoded.load(Ordering::Relaxed)
    }

    /// BLAKE3 of each photo's file, in order; `None` for those never needed.
    #[must_use]
    pub fn hashes(&self) -> Vec<Option<blake3::Hash>> {
        self.photos.iter().map(|p| p.hash.get().copied()).collect()
    }

    fn decode(&self, index: usize) -> Result<ImagePyramid, FrameFailure> {
        let photo = &self.photos[index];
        let failed = |cause: String| FrameFailure { frame: index, name: photo.name.clone(), cause };
        let bytes = fs::read(&photo.path).map_err(|e| failed(format!("cannot be read ({e})")))?;
        self.decoded.fetch_add(1, Ordering::Relaxed);
        let image = decode_bytes(&bytes).map_err(failed)?;
        photo.hash.get_or_init(|| blake3::hash(&bytes));
        Ok(ImagePyramid::new(match self.channels {
            1 => image,
            _ => image.into_padded(),
        }))
    }

    /// Notes the use of a photo and lets go of those used longest ago until the rest fits.
    fn used(&self, index: usize, bytes: usize) {
        let mut ledger = lock(&self.ledger);
        ledger.clock += 1;
        let now = ledger.clock;
        if ledger.held.insert(index, (now, bytes)).is_none() {
            ledger.bytes += bytes;
        }
        let mut by_age: Vec<(u64, usize)> =
            ledger.held.iter().filter(|(i, _)| **i != index).map(|(i, (used, _))| (*used, *i)).collect();
        by_age.sort_unstable();
        for (_, oldest) in by_age {
            if ledger.bytes <= self.ceiling {
                break;
            }
            // A photo that another thread is just fetching is not old.
            if let Ok(mut held) = self.photos[oldest].held.try_lock() {
                *held = None;
                if let Some((_, freed)) = ledger.held.remove(&oldest) {
                    ledger.bytes -= freed;
                }
            }
        }
    }
}

impl FrameSource for PhotoStore {
    fn frame(&self, index: usize) -> Result<Arc<ImagePyramid>, FrameFailure> {
        let mut held = lock(&self.photos[index].held);
        let photo = match &*held {
            Some(photo) => Arc::clone(photo),
            None => {
                let photo = Arc::new(self.decode(index)?);
                *held = Some(Arc::clone(&photo));
                photo
            }
        };
        self.used(index, photo.bytes());
        Ok(photo)
    }
}

/// Every change under these locks is whole, so a panic elsewhere leaves nothing half done.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::atomic::write_atomic;
    use image::{ExtendedColorType, ImageEncoder};

    fn store(folder: &std::path::Path, count: u8, ceiling: usize) -> PhotoStore {
        let paths = (0..count).map(|i| {
            let mut bytes = Vec::new();
            image::codecs::png::PngEncoder::new(&mut bytes)
                .write_image(&[i; 3000], 100, 30, ExtendedColorType::L8)
                .unwrap();
            let path = folder.join(format!("{i}.png"));
            write_atomic(&path, &bytes).unwrap();
            path
        });
        PhotoStore::new(paths.collect(), 1, ceiling)
    }

    #[test]
    fn photos_are_decoded_once_while_they_fit() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path(), 4, 1 << 20);
        for index in [0, 1, 2, 3, 0, 1, 2, 3] {
            assert_eq!(store.frame(index).unwrap().base().samples()[0], index as u8);
        }
        assert_eq!(store.decoded(), 4);
        assert!(store.hashes().iter().all(Option::is_some));
    }

    #[test]
    fn the_one_used_longest_ago_makes_room() {
        let folder = tempfile::tempdir().unwrap();
        // Each takes 4000 bytes with its reductions: two fit.
        let store = store(folder.path(), 3, 9000);
        for index in [0, 1, 0, 2, 0] {
            store.frame(index).unwrap();
        }
        assert_eq!(store.decoded(), 3);
        assert!(lock(&store.ledger).bytes <= 9000);
        store.frame(1).unwrap();
        assert_eq!(store.decoded(), 4);
    }

    #[test]
    fn threads_share_one_decoding() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path(), 2, 1 << 20);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| store.frame(1).unwrap());
            }
        });
        assert_eq!(store.decoded(), 1);
    }

    #[test]
    fn a_photo_that_cannot_be_read_is_named() {
        let store = PhotoStore::new(vec![PathBuf::from("no/such/IMG_7.jpg")], 1, 1);
        let failure = store.frame(0).unwrap_err();
        assert_eq!((failure.frame, failure.name.as_str()), (0, "IMG_7.jpg"));
    }
}
