//! Photos of the target: found, counted, located, judged; each used or listed with its reason.

use super::{RejectedPhoto, TargetPhoto, file_name};
use crate::calibration::{Detection, Grey, PhotoQuality, Target, count, detect, photo_faults, photo_quality};
use crate::camera::{ImagePoint, PixelRotation};
use crate::config::Config;
use crate::config::calibrate::TargetPhotos;
use crate::formats::{files, photo};
use crate::stages::context::{RunContext, StageError};
use crate::stages::target::target;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Fewest photos that can be calibrated from.
const LEAST_PHOTOS: usize = 3;

/// What the photos of a target gave.
pub(super) struct Looked {
    /// The target, with its rows and columns.
    pub target: Target,
    /// Whether rows and columns were counted.
    pub counted: bool,
    /// Width and height of the photos used, pixels.
    pub size_px: (usize, usize),
    /// Photos to calibrate from.
    pub used: Vec<TargetPhoto>,
    /// Photos as high as those are wide: their pixels may have been turned by a quarter.
    pub turned: Vec<TargetPhoto>,
    /// The others.
    pub rejected: Vec<RejectedPhoto>,
    /// All files.
    pub files: Vec<PathBuf>,
}

/// What one photo gave: its size, points and measures, or why it is not used.
type Seen = Result<((usize, usize), Detection, PhotoQuality), String>;

/// Looks at all photos that the pipeline names.
///
/// # Errors
/// No file matches, or too few photos show the target.
pub(super) fn look_at_all(
    config: &Config,
    declared: &TargetPhotos,
    context: &RunContext,
) -> Result<Looked, StageError> {
    let place = config.at(&declared.patterns);
    let found = files::matching(&config.base, &declared.patterns)
        .map_err(|e| StageError::input(e.to_string()).at(place.clone()))?;
    let mut names = BTreeMap::new();
    for file in &found {
        if let Some(other) = names.insert(file_name(file), file) {
            let what = format!("{} and {} have the same name", other.display(), file.display());
            let help = "photos are told apart by their names in tables and pictures: rename one";
            return Err(StageError::input(what).at(place).help(help));
        }
    }
    let described = target(&declared.target)?;
    let counted = declared.target.size.is_none();
    let target = if counted {
        counted_target(&found, &described, context).map_err(|e| e.at(place.clone()))?
    } else {
        described
    };
    let seen = each(&found, "finding corners", context, |file| look_at(file, &target))?;

    let mut looked = Looked {
        target,
        counted,
        size_px: common_size(&seen),
        used: Vec::new(),
        turned: Vec::new(),
        rejected: Vec::new(),
        files: found.clone(),
    };
    for (file, seen) in found.into_iter().zip(seen) {
        let name = file_name(&file);
        let (reason, detection) = match seen {
            Ok((size, detection, quality)) if size == looked.size_px => {
                looked.used.push(TargetPhoto { file, detection, quality, rotation: PixelRotation::None });
                continue;
            }
            Ok(((height, width), detection, quality)) if (width, height) == looked.size_px => {
                looked.turned.push(TargetPhoto { file, detection, quality, rotation: PixelRotation::None });
                continue;
            }
            Ok((size, detection, _)) => (other_size(size, looked.size_px), Some(detection)),
            Err(reason) => (reason, None),
        };
        looked.rejected.push(RejectedPhoto { path: file, file: name, reason, detection });
    }
    leave_out_faulty(&mut looked);
    if looked.used.len() < LEAST_PHOTOS {
        return Err(too_few(looked).at(place));
    }
    Ok(looked)
}

/// Runs a look over every photo on all cores.
fn each<T: Send>(
    files: &[PathBuf],
    label: &str,
    context: &RunContext,
    look: impl Fn(&Path) -> T + Sync,
) -> Result<Vec<T>, StageError> {
    let task = context.task(label, files.len());
    files
        .par_iter()
        .map(|file| {
            context.check_interrupted()?;
            let seen = look(file);
            task.advance(1);
            Ok(seen)
        })
        .collect()
}

fn grey(file: &Path) -> Result<Grey, String> {
    photo::decode_grey(file).map_err(|e| e.cause)
}

fn look_at(file: &Path, target: &Target) -> Seen {
    let image = grey(file)?;
    let detection = detect(&image, target).map_err(|e| e.to_string())?;
    let quality = photo_quality(&image, photo::WHITE, &detection);
    Ok(((image.width(), image.height()), detection, quality))
}

/// The target with the rows and columns that most photos show.
fn counted_target(files: &[PathBuf], described: &Target, context: &RunContext) -> Result<Target, StageError> {
    let counts = each(files, "counting rows and columns", context, |file| {
        grey(file).and_then(|image| count(&image, described).map_err(|e| e.to_string()))
    })?;
    let mut votes: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    for size in counts.iter().flatten() {
        *votes.entry(*size).or_default() += 1;
    }
    // Of sizes that as many photos show the larger: hidden squares take away, nothing adds.
    let Some((&(rows, columns), &most)) = votes.iter().max_by_key(|((r, c), votes)| (**votes, r * c)) else {
        let reasons = files
            .iter()
            .zip(&counts)
            .filter_map(|(file, count)| count.as_ref().err().map(|e| format!("\n  {}: {e}", file_name(file))))
            .collect::<String>();
        return Err(StageError::input(format!("no photo shows the target{reasons}"))
            .help("check the kind and the lengths of [calibrate.target]"));
    };
    let all: usize = votes.values().sum();
    if 2 * most < all {
        let seen =
            votes.iter().map(|((r, c), votes)| format!("\n  {r} × {c} in {votes}")).collect::<String>();
        return Err(StageError::input(format!(
            "the photos do not agree on the target's rows and columns of {}:{seen}",
            described.unit()
        ))
        .help("state rows and columns in [calibrate.target], and check its kind and lengths"));
    }
    tracing::info!("counted {rows} × {columns} {} in {most} of {} photos", described.unit(), files.len());
    described.resized(rows, columns).map_err(|e| {
        StageError::input(format!("the photos show {rows} × {columns} {}: {e}", described.unit()))
    })
}

/// The size that most photos with the target have; of equally many the first.
fn common_size(seen: &[Seen]) -> (usize, usize) {
    let mut votes: Vec<((usize, usize), usize)> = Vec::new();
    for (size, ..) in seen.iter().flatten() {
        match votes.iter_mut().find(|(known, _)| known == size) {
            Some((_, count)) => *count += 1,
            None => votes.push((*size, 1)),
        }
    }
    let most = votes.iter().map(|(_, count)| *count).max().unwrap_or(0);
    votes.into_iter().find(|(_, count)| *count == most).map_or((0, 0), |(size, _)| size)
}

fn other_size((width, height): (usize, usize), (w, h): (usize, usize)) -> String {
    format!(
        "is {width} × {height} px where most photos are {w} × {h} px: another camera, another mode or a cut-out"
    )
}

/// A photo whose stored pixels were turned, with its points where the camera's sensor saw them.
pub(super) fn turned_back(
    photo: &TargetPhoto,
    rotation: PixelRotation,
    size_px: (usize, usize),
) -> TargetPhoto {
    let (width, height) = (size_px.0 as u32, size_px.1 as u32);
    let back = |p: ImagePoint| rotation.sensor_from_stored(p, width, height);
    let mut detection = photo.detection.clone();
    for corner in &mut detection.corners {
        corner.blunt = back(corner.blunt);
        corner.refined = back(corner.refined);
        corner.sharp = back(corner.sharp);
    }
    TargetPhoto { detection, rotation, ..photo.clone() }
}

/// Leaves out photos that are blurred, over-exposed or show what another shows.
pub(super) fn leave_out_faulty(looked: &mut Looked) {
    let names: Vec<String> = looked.used.iter().map(|photo| file_name(&photo.file)).collect();
    let measures: Vec<(&str, PhotoQuality, &Detection)> = names
        .iter()
        .zip(&looked.used)
        .map(|(name, photo)| (name.as_str(), photo.quality, &photo.detection))
        .collect();
    let faults = photo_faults(&measures, looked.size_px.0);
    let photos = std::mem::take(&mut looked.used);
    for ((photo, name), fault) in photos.into_iter().zip(names).zip(faults) {
        match fault {
            None => looked.used.push(photo),
            Some(fault) => looked.rejected.push(RejectedPhoto {
                path: photo.file,
                file: name,
                reason: fault.to_string(),
                detection: Some(photo.detection),
            }),
        }
    }
}

fn too_few(mut looked: Looked) -> StageError {
    let (width, height) = looked.size_px;
    for photo in std::mem::take(&mut looked.turned) {
        looked.rejected.push(RejectedPhoto {
            file: file_name(&photo.file),
            path: photo.file,
            reason: format!(
                "is {height} × {width} px, turned by a quarter: {LEAST_PHOTOS} photos of {width} × {height} px are \
                 needed to tell which way"
            ),
            detection: Some(photo.detection),
        });
    }
    looked.rejected.sort_by(|a, b| a.file.cmp(&b.file));
    let reasons = looked.rejected.iter().map(|r| format!("\n  {}: {}", r.file, r.reason)).collect::<String>();
    // What was found and yet left out needs other photos; what was not found, another description.
    let found = looked.rejected.iter().filter(|r| r.detection.is_some()).count();
    let help = if found > 0 {
        "take more photos, each with the target in another place and tilted by 20° to 45° to another side, sharp and \
         evenly lit"
    } else {
        "check [calibrate.target] against the target (leave rows and columns out to have them counted), and photograph \
         all of it, sharp and evenly lit"
    };
    StageError::input(format!(
        "{} of {} photos can be used, at least {LEAST_PHOTOS} are needed{reasons}",
        looked.used.len(),
        looked.files.len()
    ))
    .help(help)
}
