//! What lies in a folder: photos, logs, tables, cameras and elevation models, each known by its content.
//!
//! The search is bounded (depth, entries, bytes looked at), follows no symbolic link and goes in the order of names, so
//! that the same folder gives the same answer.

use crate::camera::Camera;
use crate::config::log::LogFormat;
use crate::formats::camera::{CameraChoice, camera_from_text};
use crate::formats::files::IMAGE_EXTENSIONS;
use crate::formats::metadata::{self, PhotoMetadata};
use crate::formats::photo;
use gdal::Metadata;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Folders are looked into this deep below the one that is named.
const MOST_DEPTH: usize = 4;
/// Entries that are looked at.
const MOST_ENTRIES: usize = 100_000;
/// Bytes of a file by which it is recognised.
const HEAD_BYTES: u64 = 64 << 10;
/// Camera files and tables larger than this are none.
const MOST_TEXT_BYTES: u64 = 64 << 20;

/// A photo and what its header says.
#[derive(Debug)]
pub struct Photo {
    /// File name.
    pub name: String,
    /// Columns and rows as stored.
    pub size: (u32, u32),
    /// Its metadata; `None` when they cannot be read.
    pub metadata: Option<PhotoMetadata>,
}

/// A folder that holds photos of one size.
#[derive(Debug)]
pub struct PhotoFolder {
    /// The folder.
    pub folder: PathBuf,
    /// The photos of the size that most have, by name.
    pub photos: Vec<Photo>,
    /// Names of images in it that have another size or cannot be read, with the reason.
    pub others: Vec<(String, String)>,
    /// Those of them whose width and height are swapped against the photos'.
    pub swapped: Vec<String>,
    /// Whether its name says that it holds photos of a calibration target.
    pub of_target: bool,
}

/// A file that may matter.
#[derive(Debug)]
pub struct Found {
    /// Where it is.
    pub path: PathBuf,
    /// What it is.
    pub kind: FileKind,
}

/// What a file is, by its content.
#[derive(Debug)]
pub enum FileKind {
    /// A camera file of a format that is read as it is.
    Camera(Box<Camera>),
    /// JSON that names a camera's numbers in no format of its own.
    CameraNumbers(Box<CameraNumbers>),
    /// A log that says itself what its records are.
    Log(LogFormat),
    /// A text table whose first line names columns.
    Table {
        /// What parts its cells.
        delimiter: u8,
    },
    /// A georeferenced raster.
    Raster(RasterKind),
    /// The scenario of a simulated survey.
    Scenario,
}

/// What a raster may be.
#[derive(Debug, Clone, PartialEq)]
pub enum RasterKind {
    /// One band of heights, perhaps; with what its band and CRS say of their datum.
    Heights {
        /// Description of the band and the CRS, in lower case.
        words: String,
    },
    /// Colours, or no CRS.
    Other,
}

/// A camera's numbers by the names that OpenCV and COLMAP have for them.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraNumbers {
    /// Columns and rows.
    pub size: (u32, u32),
    /// fx, fy, cx, cy, pixels.
    pub affine: [f64; 4],
    /// k1, k2, p1, p2, k3.
    pub lens: [f64; 5],
    /// Whether a text in the file says that pixels count from the corner of the top-left one.
    pub says_corner: bool,
}

/// What was found.
#[derive(Debug, Default)]
pub struct Scan {
    /// Folders with photos, the likeliest survey first.
    pub photos: Vec<PhotoFolder>,
    /// Other files that matter, by path.
    pub files: Vec<Found>,
    /// What was not looked at, and why.
    pub notes: Vec<String>,
}

/// Looks at a folder.
///
/// # Errors
/// The folder itself cannot be listed.
pub fn scan(root: &Path) -> std::io::Result<Scan> {
    let mut scan = Scan::default();
    let files = walk(root, &mut scan.notes)?;
    let is_image = |path: &PathBuf| extension(path).is_some_and(|e| IMAGE_EXTENSIONS.contains(&e.as_str()));
    let (images, others): (Vec<PathBuf>, Vec<PathBuf>) = files.into_iter().partition(is_image);
    let rasters: Vec<Option<RasterKind>> = images.par_iter().map(|path| raster(path)).collect();
    let mut folders: BTreeMap<PathBuf, Vec<PathBuf>> = BTreeMap::new();
    for (path, raster) in images.into_iter().zip(rasters) {
        match raster {
            Some(kind) => scan.files.push(Found { path, kind: FileKind::Raster(kind) }),
            None => {
                folders.entry(path.parent().unwrap_or(root).to_owned()).or_default().push(path);
            }
        }
    }
    scan.photos =
        folders.into_iter().filter_map(|(folder, images)| photo_folder(root, folder, &images)).collect();
    // The sort is stable: of equals the first by name stays first.
    scan.photos.sort_by_key(|folder| std::cmp::Reverse(rank(folder)));
    let known: Vec<Option<FileKind>> = others.par_iter().map(|path| recognise(path)).collect();
    scan.files
        .extend(others.into_iter().zip(known).filter_map(|(path, kind)| Some(Found { path, kind: kind? })));
    scan.files.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(scan)
}

/// Files below a folder whose names are UTF-8 and not hidden.
fn walk(root: &Path, notes: &mut Vec<String>) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut seen = 0;
    let mut folders = vec![(root.to_owned(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        let listed = match fs::read_dir(&folder) {
            Ok(listed) => listed,
            Err(error) if depth == 0 => return Err(error),
            Err(error) => {
                notes.push(format!("folder {} cannot be listed ({error})", shown(root, &folder)));
                continue;
            }
        };
        let mut entries: Vec<_> = listed.flatten().take(MOST_ENTRIES).collect();
        entries.sort_by_key(fs::DirEntry::file_name);
        if depth > 0 && entries.iter().any(|entry| entry.file_name() == "manifest.json") {
            notes.push(format!("folder {} holds the products of a run", shown(root, &folder)));
            continue;
        }
        let mut inner = Vec::new();
        for entry in entries {
            seen += 1;
            if seen > MOST_ENTRIES {
                notes.push(format!("only the first {MOST_ENTRIES} entries were looked at"));
                return Ok(files);
            }
            let (name, path) = (entry.file_name(), entry.path());
            let Some(name) = name.to_str().filter(|_| path.to_str().is_some()) else {
                notes.push(format!("the name of {} is not UTF-8", path.display()));
                continue;
            };
            // The entry's own type: a symbolic link is neither file nor folder.
            match entry.file_type() {
                _ if name.starts_with('.') => {}
                Ok(kind) if kind.is_file() => files.push(path),
                Ok(kind) if kind.is_dir() && depth < MOST_DEPTH => inner.push((path, depth + 1)),
                Ok(kind) if kind.is_dir() => {
                    notes.push(format!("folder {} lies too deep", shown(root, &path)));
                }
                Ok(kind) if kind.is_symlink() => {
                    notes.push(format!("{} is a symbolic link", shown(root, &path)));
                }
                _ => {}
            }
        }
        folders.extend(inner.into_iter().rev());
    }
    files.sort();
    Ok(files)
}

/// A path from the folder that is looked at.
pub fn shown(root: &Path, path: &Path) -> String {
    let short = path.strip_prefix(root).unwrap_or(path);
    if short.as_os_str().is_empty() { ".".to_owned() } else { short.display().to_string() }
}

fn extension(path: &Path) -> Option<String> {
    path.extension().and_then(|e| e.to_str()).map(str::to_lowercase)
}

/// What an image is when it is no photo: one with a world file beside it, or a TIFF with a georeference.
fn raster(path: &Path) -> Option<RasterKind> {
    const WORLD_FILES: [&str; 9] = ["jgw", "jpgw", "jgwx", "pgw", "pngw", "tfw", "tifw", "wld", "prj"];
    if WORLD_FILES.iter().any(|e| path.with_extension(e).is_file()) {
        return Some(RasterKind::Other);
    }
    if !matches!(extension(path)?.as_str(), "tif" | "tiff") {
        return None;
    }
    let dataset = gdal::Dataset::open(path).ok()?;
    let moved = dataset.geo_transform().is_ok_and(|t| t != [0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let wkt = dataset.projection();
    if !moved {
        return None;
    }
    let band = dataset.rasterband(1).ok()?;
    let heights = dataset.raster_count() == 1
        && band.band_type() != gdal::raster::GdalDataType::UInt8
        && band.color_table().is_none()
        && !wkt.is_empty();
    if !heights {
        return Some(RasterKind::Other);
    }
    let description = band.description().unwrap_or_default();
    Some(RasterKind::Heights { words: format!("{description} {}", vertical_part(&wkt)).to_lowercase() })
}

/// What a compound CRS says of its heights; nothing for a horizontal one.
fn vertical_part(wkt: &str) -> &str {
    let at = ["VERT_CS[", "VERTCRS["].into_iter().find_map(|word| wkt.find(word));
    at.map_or("", |at| &wkt[at..])
}

fn photo_folder(root: &Path, folder: PathBuf, images: &[PathBuf]) -> Option<PhotoFolder> {
    let read: Vec<(String, Result<Photo, String>)> = images
        .par_iter()
        .map(|path| {
            let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_owned();
            (name.clone(), read_photo(path, name))
        })
        .collect();
    let mut counts: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for photo in read.iter().filter_map(|(_, photo)| photo.as_ref().ok()) {
        *counts.entry(photo.size).or_default() += 1;
    }
    let size = counts.into_iter().max_by_key(|((w, h), count)| (*count, u64::from(*w) * u64::from(*h)))?.0;
    let (mut photos, mut others, mut swapped) = (Vec::new(), Vec::new(), Vec::new());
    for (name, photo) in read {
        match photo {
            Ok(photo) if photo.size == size => photos.push(photo),
            Ok(photo) => {
                if photo.size == (size.1, size.0) {
                    swapped.push(name.clone());
                }
                others.push((name, format!("has {} × {} pixels", photo.size.0, photo.size.1)));
            }
            Err(cause) => others.push((name, cause)),
        }
    }
    let below = folder.strip_prefix(root).ok()?;
    let of_target = below.components().any(|part| {
        let part = part.as_os_str().to_string_lossy().to_lowercase();
        ["calib", "target", "chess", "checker", "board"].iter().any(|word| part.contains(word))
    });
    Some(PhotoFolder { folder, photos, others, swapped, of_target })
}

fn read_photo(path: &Path, name: String) -> Result<Photo, String> {
    let file = File::open(path).map_err(|e| format!("cannot be read ({e})"))?;
    let metadata = metadata::read(&mut BufReader::new(file)).ok();
    let size = match metadata.as_ref().and_then(|m| m.stored_size) {
        Some(size) => size,
        None => {
            let header = photo::read_header(path).map_err(|e| e.cause)?;
            (header.width, header.height)
        }
    };
    Ok(Photo { name, size, metadata })
}

/// Photos that know where they were taken are a survey sooner than others; then the many before the few.
fn rank(folder: &PhotoFolder) -> (bool, bool, usize, u64) {
    let placed = |photo: &&Photo| photo.metadata.as_ref().is_some_and(|m| m.exposure.position.is_some());
    let placed = folder.photos.iter().filter(placed).count();
    let pixels = folder.photos.first().map_or(0, |p| u64::from(p.size.0) * u64::from(p.size.1));
    (!folder.of_target, 2 * placed > folder.photos.len(), folder.photos.len(), pixels)
}

/// What a file that is no image is.
fn recognise(path: &Path) -> Option<FileKind> {
    let size = fs::metadata(path).ok()?.len();
    let mut head = Vec::new();
    File::open(path).ok()?.take(HEAD_BYTES).read_to_end(&mut head).ok()?;
    let extension = extension(path).unwrap_or_default();
    if let Some(format) = binary_log(&head, &extension, size) {
        return Some(FileKind::Log(format));
    }
    let text = match std::str::from_utf8(&head) {
        Ok(text) => text,
        // The last character may be cut.
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&head[..error.valid_up_to()]).ok()?
        }
        Err(_) => return None,
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    if text.contains('\0') || size > MOST_TEXT_BYTES {
        return None;
    }
    let name = path.file_name()?.to_str()?.to_lowercase();
    if name == "scenario.toml" {
        return Some(FileKind::Scenario);
    }
    if let Some(format) = text_log(text, &name, &extension) {
        return Some(FileKind::Log(format));
    }
    if matches!(extension.as_str(), "json" | "yaml" | "yml" | "xml" | "cam" | "txt") {
        let whole = fs::read_to_string(path).ok()?;
        if let Ok(camera) = camera_from_text(path, &whole, &CameraChoice::default()) {
            return Some(FileKind::Camera(Box::new(camera)));
        }
        if let Some(numbers) = camera_numbers(&whole) {
            return Some(FileKind::CameraNumbers(Box::new(numbers)));
        }
    }
    matches!(extension.as_str(), "csv" | "txt" | "tsv")
        .then(|| table_delimiter(text))
        .flatten()
        .map(|delimiter| FileKind::Table { delimiter })
}

fn binary_log(head: &[u8], extension: &str, size: u64) -> Option<LogFormat> {
    if head.starts_with(&[0xA3, 0x95, 0x80]) {
        return Some(LogFormat::Ardupilot);
    }
    if head.starts_with(b"ULog\x01\x12\x35") {
        return Some(LogFormat::Px4);
    }
    let stamped = matches!(head.get(8), Some(0xFE | 0xFD));
    if extension == "tlog" && stamped {
        return Some(LogFormat::Mavlink);
    }
    // Seventeen doubles a record, and a name that says so: nothing in the bytes does.
    let named = matches!(extension, "sbet" | "out");
    (named && size > 0 && size.is_multiple_of(136) && head.contains(&0)).then_some(LogFormat::Sbet)
}

fn text_log(text: &str, name: &str, extension: &str) -> Option<LogFormat> {
    let first = text.lines().map(str::trim).find(|line| !line.is_empty())?;
    if extension == "mrk" || (first.contains(",Lat") && first.contains(",Lon") && first.contains(",N")) {
        return Some(LogFormat::DjiMrk);
    }
    let lower = text.to_lowercase();
    if text.lines().any(|l| l.starts_with('%')) && (lower.contains("latitude(") || lower.contains("x-ecef("))
    {
        return Some(if name.contains("event") { LogFormat::RtklibEvents } else { LogFormat::Rtklib });
    }
    let upper = first.to_uppercase();
    let crs = ["EPSG:", "WGS84 UTM", "+PROJ"].iter().any(|word| upper.starts_with(word));
    if crs && extension == "txt" {
        return Some(LogFormat::OdmGeo);
    }
    if extension == "json" && text.contains("\"shots\"") && text.contains("\"cameras\"") {
        return Some(LogFormat::Opensfm);
    }
    let header = first.to_lowercase();
    (header.contains("omega") && header.contains("phi") && header.contains("kappa")
        || lower.starts_with("# cameras (") && lower.contains("omega"))
    .then_some(LogFormat::Orientation)
}

/// JSON that is an object with width, height, fx, fy, cx and cy, and no lens term that is not Brown's.
fn camera_numbers(text: &str) -> Option<CameraNumbers> {
    let value: serde_json::Value = serde_json::from_str(text).ok()?;
    let object = value.as_object()?;
    let number = |names: &[&str]| names.iter().find_map(|name| object.get(*name)?.as_f64());
    let pixels = |names: &[&str]| number(names).filter(|n| (1.0..1e6).contains(n)).map(|n| n as u32);
    let size = (pixels(&["width", "image_width"])?, pixels(&["height", "image_height"])?);
    let affine = [number(&["fx"])?, number(&["fy"])?, number(&["cx"])?, number(&["cy"])?];
    let lens = ["k1", "k2", "p1", "p2", "k3"].map(|name| number(&[name]).unwrap_or(0.0));
    let alien = ["k4", "k5", "k6", "s1", "xi", "rho2"].iter().any(|name| object.contains_key(*name));
    let words: String =
        object.values().filter_map(|v| v.as_str()).collect::<Vec<_>>().join(" ").to_lowercase();
    let says_corner = words.contains("corner") && words.contains("(0,0)") || words.contains("(0.5,0.5)");
    let usable = affine.iter().chain(&lens).all(|n| n.is_finite()) && affine[0] > 0.0 && affine[1] > 0.0;
    (usable && !alien && !words.contains("fisheye")).then_some(CameraNumbers {
        size,
        affine,
        lens,
        says_corner,
    })
}

/// What parts the cells of a table whose first line names at least three columns.
fn table_delimiter(text: &str) -> Option<u8> {
    let mut lines = text.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let header = lines.next()?;
    lines.next()?;
    let delimiter =
        [b',', b';', b'\t'].into_iter().max_by_key(|d| header.bytes().filter(|b| b == d).count())?;
    let cells: Vec<&str> = header.split(char::from(delimiter)).map(str::trim).collect();
    let named = |cell: &&str| cell.parse::<f64>().is_err() && cell.chars().any(char::is_alphabetic);
    (cells.len() >= 3 && cells.iter().filter(|c| !c.is_empty()).all(|c| named(&c))).then_some(delimiter)
}

#[cfg(test)]
mod tests;
