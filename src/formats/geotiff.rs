//! GeoTIFFs out: mosaics and orthos tile by tile, single bands of floating point at once, all Cloud Optimized.
//!
//! Tiles go into a temporary raster first, in memory while it is small, else a file in the output folder;
//! the Cloud Optimized file is a copy of it, because its driver can only copy. Overviews are made from the tiles
//! as they come, on all threads; GDAL would read the whole file once more for them. It appears
//! under its name when it is complete. GDAL reports a mistyped option or a full disk in words only: its
//! words are listened to, and an error among them is an error here.

use super::atomic::{self, WriteError, atomic_path};
use crate::config::mosaic::Compression;
use crate::mosaic::{TilePixels, Window};
use crate::raster::{GridTransform, Raster};
use gdal::errors::GdalError;
use gdal::raster::{Buffer, ColorInterpretation, RasterBand, RasterCreationOptions, ResampleAlg};
use gdal::{Dataset, Driver, DriverManager, Metadata};
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Once, OnceLock};
use tempfile::TempPath;

/// Side of a block, pixels.
const BLOCK: usize = crate::mosaic::TILE;
/// Temporary rasters up to this size stay in memory, bytes.
const SMALL: usize = 64 << 20;
/// What GDAL may keep of the files it reads and writes, bytes.
pub const GDAL_CACHE: usize = 64 << 20;

/// Why a raster could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum GeotiffError {
    /// GDAL could not write it.
    #[error("cannot write {}: {cause}", path.display())]
    Write {
        /// The file that was to appear.
        path: PathBuf,
        /// GDAL's words.
        cause: String,
    },
    /// GDAL could not read it.
    #[error("cannot read {}: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// GDAL's words.
        cause: String,
    },
    /// This GDAL cannot compress that way.
    #[error("this GDAL cannot write {wanted} compression; it offers {offered}")]
    Compression {
        /// As GDAL calls it.
        wanted: &'static str,
        /// What its COG driver lists.
        offered: String,
    },
    /// The file system refused.
    #[error(transparent)]
    File(#[from] WriteError),
}

/// Where a raster lies and what is to be said about it.
#[derive(Debug, Clone, PartialEq)]
pub struct RasterDescription {
    /// Where its pixels lie.
    pub grid: GridTransform,
    /// Its CRS.
    pub wkt: String,
    /// Metadata items, in the order written.
    pub metadata: Vec<(String, String)>,
}

/// How a colour raster is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encoding {
    /// Compression of the blocks.
    pub compression: Compression,
    /// Quality of lossy compressions, 1 to 100.
    pub quality: u32,
    /// Threads that compress; the bytes do not depend on it.
    pub threads: usize,
}

impl Encoding {
    /// JPEG has no room for a fourth band: transparency goes into a mask of one bit.
    fn has_mask(self) -> bool {
        self.compression == Compression::Jpeg
    }

    fn name(self) -> &'static str {
        match self.compression {
            Compression::Deflate => "DEFLATE",
            Compression::Zstd => "ZSTD",
            Compression::Lzw => "LZW",
            Compression::Jpeg => "JPEG",
            Compression::Webp => "WEBP",
        }
    }

    fn options(self) -> Result<Vec<String>, GeotiffError> {
        let mut options = cog_options(self.name(), self.threads)?;
        match self.compression {
            Compression::Deflate | Compression::Zstd | Compression::Lzw => {
                options.push("PREDICTOR=YES".into())
            }
            Compression::Jpeg | Compression::Webp => options.push(format!("QUALITY={}", self.quality)),
        }
        Ok(options)
    }
}

/// A mosaic or ortho under way: 8-bit colour or grey with transparency.
pub struct ColourWriter {
    // Before its file, so that it is closed first.
    dataset: Dataset,
    _file: Scratch,
    target: PathBuf,
    encoding: Encoding,
    channels: usize,
    levels: usize,
}

impl ColourWriter {
    /// Begins a raster of `width × height` pixels with 1 or 3 channels that will appear at `target`.
    ///
    /// # Errors
    /// [`GeotiffError`] when the folder cannot be written to or this GDAL cannot compress as asked.
    pub fn create(
        target: &Path,
        (width, height): (usize, usize),
        channels: usize,
        description: &RasterDescription,
        encoding: Encoding,
    ) -> Result<Self, GeotiffError> {
        set_up();
        encoding.options()?;
        let bytes = width.saturating_mul(height).saturating_mul(channels + 1);
        let file = Scratch::beside(target, bytes)?;
        let levels = overview_levels(width, height);
        let dataset = heard(|| {
            let block = format!("BLOCKXSIZE={BLOCK} BLOCKYSIZE={BLOCK}");
            let options = "TILED=YES INTERLEAVE=BAND SPARSE_OK=TRUE BIGTIFF=IF_SAFER".split(' ');
            let bands = channels + usize::from(!encoding.has_mask());
            let mut dataset = DriverManager::get_driver_by_name("GTiff")?
                .create_with_band_type_with_options::<u8, _>(
                    &file.path,
                    width,
                    height,
                    bands,
                    &RasterCreationOptions::from_iter(options.chain(block.split(' '))),
                )?;
            describe(&mut dataset, description)?;
            let mut colours = match channels {
                1 => vec![ColorInterpretation::GrayIndex],
                _ => vec![
                    ColorInterpretation::RedBand,
                    ColorInterpretation::GreenBand,
                    ColorInterpretation::BlueBand,
                ],
            };
            if !encoding.has_mask() {
                colours.push(ColorInterpretation::AlphaBand);
            }
            for (i, colour) in colours.into_iter().enumerate() {
                dataset.rasterband(i + 1)?.set_color_interpretation(colour)?;
            }
            if encoding.has_mask() {
                dataset.rasterband(1)?.create_mask_band(true)?;
            }
            if levels > 0 {
                let factors: Vec<i32> = (1..=levels).map(|level| 1 << level).collect();
                // Empty: the tiles bring their own reductions.
                dataset.build_overviews("NONE", &factors, &[])?;
            }
            Ok(dataset)
        })
        .map_err(write_failed(target))?;
        Ok(Self { dataset, _file: file, target: target.to_owned(), encoding, channels, levels })
    }

    /// How often a tile must be reduced for [`Self::write`].
    #[must_use]
    pub const fn levels(&self) -> usize {
        self.levels
    }

    /// Puts a tile and its reductions in their places. A transparent one is not stored.
    ///
    /// # Errors
    /// [`GeotiffError::Write`].
    pub fn write(&mut self, tile: ReducedTile) -> Result<(), GeotiffError> {
        let (dataset, encoding, channels) = (&self.dataset, self.encoding, self.channels);
        let put = |band: &mut RasterBand, window: Window, plane: Vec<u8>| {
            let size = (window.width, window.height);
            band.write((window.column as isize, window.row as isize), size, &mut Buffer::new(size, plane))
        };
        heard(|| {
            for (level, tile) in tile.0.into_iter().enumerate() {
                let window = tile.window;
                let at_level = |band: RasterBand, plane: Vec<u8>| match level {
                    0 => put(&mut { band }, window, plane),
                    _ => put(&mut band.overview(level - 1)?, window, plane),
                };
                for (i, plane) in tile.planes.into_iter().enumerate() {
                    at_level(dataset.rasterband(i + 1)?, plane)?;
                }
                if encoding.has_mask() {
                    let first = dataset.rasterband(1)?;
                    let mask = tile.alpha.into_iter().map(|a| if a == 0 { 0 } else { 255 }).collect();
                    at_level(first.open_mask_band()?, mask)?;
                } else {
                    at_level(dataset.rasterband(channels + 1)?, tile.alpha)?;
                }
            }
            Ok(())
        })
        .map_err(write_failed(&self.target))
    }

    /// Adds `metadata`, copies everything into a Cloud Optimized GeoTIFF, and gives that its name.
    ///
    /// # Errors
    /// [`GeotiffError`]; nothing then stands at the target but what stood there before.
    pub fn finish(mut self, metadata: &[(String, String)]) -> Result<(), GeotiffError> {
        heard(|| {
            for (key, value) in metadata {
                self.dataset.set_metadata_item(key, value, "")?;
            }
            self.dataset.flush_cache()
        })
        .map_err(write_failed(&self.target))?;
        copy_to_cog(&self.dataset, &self.target, self.encoding.options()?)
    }
}

/// A tile with its reductions by 2, 4, 8 …; none of them when it is transparent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReducedTile(Vec<TilePixels>);

impl ReducedTile {
    /// Reduces a tile `levels` times.
    #[must_use]
    pub fn new(tile: TilePixels, levels: usize) -> Self {
        if tile.is_transparent() {
            return Self(Vec::new());
        }
        let mut pyramid = vec![tile];
        for level in 0..levels {
            pyramid.push(pyramid[level].halved());
        }
        Self(pyramid)
    }
}

/// Overviews until the whole fits one block, but no more than a block can be halved.
fn overview_levels(width: usize, height: usize) -> usize {
    let most = BLOCK.ilog2() as usize;
    (0..most).take_while(|level| width.max(height).div_ceil(1 << level) > BLOCK).count()
}

/// Writes one band of floating point as a Cloud Optimized GeoTIFF; NaN is no data.
///
/// # Errors
/// [`GeotiffError`].
pub fn write_float(
    target: &Path,
    raster: &Raster<f32>,
    description: &RasterDescription,
    threads: usize,
) -> Result<(), GeotiffError> {
    set_up();
    let mut options = cog_options("DEFLATE", threads)?;
    options.push("PREDICTOR=YES".into());
    let size = (raster.width(), raster.height());
    let dataset = heard(|| {
        let mut dataset = DriverManager::get_driver_by_name("MEM")?
            .create_with_band_type::<f32, _>("", size.0, size.1, 1)?;
        describe(&mut dataset, description)?;
        {
            let mut band = dataset.rasterband(1)?;
            band.set_no_data_value(Some(f64::NAN))?;
            band.write((0, 0), size, &mut Buffer::new(size, raster.samples().to_vec()))?;
        }
        Ok(dataset)
    })
    .map_err(write_failed(target))?;
    copy_to_cog(&dataset, target, options)
}

/// Writes named bands of floating point over an image as a GeoTIFF without CRS; NaN is no data.
///
/// Its coordinates are the image's pixels: easting is the column and northing the row, growing downwards,
/// (0, 0) the centre of the top-left pixel. `step` is the size of a cell in pixels, across and down.
///
/// # Errors
/// [`GeotiffError`].
pub fn write_image_bands(
    target: &Path,
    bands: &[(&str, Raster<f32>)],
    step: (f64, f64),
    metadata: &[(String, String)],
) -> Result<(), GeotiffError> {
    set_up();
    let size = bands.first().map_or((0, 0), |(_, raster)| (raster.width(), raster.height()));
    let dataset = heard(|| {
        let mut dataset = DriverManager::get_driver_by_name("MEM")?.create_with_band_type::<f32, _>(
            "",
            size.0,
            size.1,
            bands.len(),
        )?;
        dataset.set_geo_transform(&[-0.5, step.0, 0.0, -0.5, 0.0, step.1])?;
        for (key, value) in metadata {
            dataset.set_metadata_item(key, value, "")?;
        }
        for (index, (name, raster)) in bands.iter().enumerate() {
            let mut band = dataset.rasterband(index + 1)?;
            band.set_no_data_value(Some(f64::NAN))?;
            band.set_description(name)?;
            band.write((0, 0), size, &mut Buffer::new(size, raster.samples().to_vec()))?;
        }
        Ok(dataset)
    })
    .map_err(write_failed(target))?;
    let options = RasterCreationOptions::from_iter(["COMPRESS=DEFLATE", "PREDICTOR=3", "INTERLEAVE=BAND"]);
    atomic_path(target, |path| {
        heard(|| {
            let driver = DriverManager::get_driver_by_name("GTiff")?;
            dataset.create_copy(&driver, path, &options)?.close()
        })
        .map_err(write_failed(target))
    })
}

/// A reduced picture of a colour raster: red, green, blue, alpha, at most `width` pixels wide.
///
/// Colours are averaged over the pixels that are not transparent.
///
/// # Errors
/// [`GeotiffError::Read`].
pub fn read_preview(path: &Path, width: usize) -> Result<image::RgbaImage, GeotiffError> {
    set_up();
    let failed = |cause: String| GeotiffError::Read { path: path.to_owned(), cause };
    heard(|| {
        let dataset = Dataset::open(path)?;
        let whole = dataset.raster_size();
        let width = width.min(whole.0).max(1);
        let height = ((whole.1 * width) as f64 / whole.0 as f64).round().max(1.0) as usize;
        let size = (width, height);
        let plane = |band: &gdal::raster::RasterBand| {
            band.read_as::<u8>((0, 0), whole, size, Some(ResampleAlg::Average))
                .map(|b| b.into_shape_and_vec().1)
        };
        let first = dataset.rasterband(1)?;
        let alpha = plane(&first.open_mask_band()?)?;
        // Grey with alpha has two bands, grey with a mask one.
        let colours = if dataset.raster_count() >= 3 {
            [plane(&first)?, plane(&dataset.rasterband(2)?)?, plane(&dataset.rasterband(3)?)?]
        } else {
            let grey = plane(&first)?;
            [grey.clone(), grey.clone(), grey]
        };
        let pixel = |c: u32, r: u32| {
            let i = r as usize * width + c as usize;
            image::Rgba([colours[0][i], colours[1][i], colours[2][i], alpha[i]])
        };
        Ok(image::RgbaImage::from_fn(width as u32, height as u32, pixel))
    })
    .map_err(failed)
}

/// A picture as PNG bytes.
///
/// # Errors
/// The encoder's words.
pub fn png(picture: &image::RgbaImage) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    picture
        .write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png)
        .map_err(|e| e.to_string())?;
    Ok(bytes)
}

fn describe(dataset: &mut Dataset, description: &RasterDescription) -> gdal::errors::Result<()> {
    dataset.set_projection(&description.wkt)?;
    dataset.set_geo_transform(&description.grid.to_gdal())?;
    for (key, value) in &description.metadata {
        dataset.set_metadata_item(key, value, "")?;
    }
    Ok(())
}

fn copy_to_cog(dataset: &Dataset, target: &Path, options: Vec<String>) -> Result<(), GeotiffError> {
    let options = RasterCreationOptions::from_iter(options);
    atomic_path(target, |path| {
        heard(|| {
            let cog = DriverManager::get_driver_by_name("COG")?;
            // Errors while closing, a full disk among them, are heard here too.
            dataset.create_copy(&cog, path, &options)?.close()
        })
        .map_err(write_failed(target))
    })
}

fn cog_options(compression: &'static str, threads: usize) -> Result<Vec<String>, GeotiffError> {
    let offered = offered_compressions();
    if !offered.iter().any(|o| o == compression) {
        return Err(GeotiffError::Compression { wanted: compression, offered: offered.join(", ") });
    }
    Ok(vec![
        format!("COMPRESS={compression}"),
        format!("BLOCKSIZE={BLOCK}"),
        "OVERVIEW_RESAMPLING=AVERAGE".to_owned(),
        "BIGTIFF=IF_SAFER".to_owned(),
        format!("NUM_THREADS={}", threads.max(1)),
    ])
}

/// The values GDAL's COG driver lists for COMPRESS. Asked once: the driver makes its list when first asked, and
/// is not safe to ask from two threads then.
fn offered_compressions() -> &'static [String] {
    static OFFERED: OnceLock<Vec<String>> = OnceLock::new();
    OFFERED.get_or_init(list_compressions)
}

fn list_compressions() -> Vec<String> {
    let listed = DriverManager::get_driver_by_name("COG")
        .ok()
        .and_then(|driver: Driver| driver.metadata_item("DMD_CREATIONOPTIONLIST", ""))
        .unwrap_or_default();
    let option = listed
        .split("<Option ")
        .find(|o| o.contains("name='COMPRESS'") || o.contains("name=\"COMPRESS\""))
        .unwrap_or_default();
    option.split("<Value>").skip(1).filter_map(|v| v.split("</Value>").next().map(str::to_owned)).collect()
}

/// A temporary raster that vanishes with this value.
struct Scratch {
    path: PathBuf,
    file: Option<TempPath>,
}

impl Scratch {
    /// In memory while it is small, else in the target's folder.
    fn beside(target: &Path, bytes: usize) -> Result<Self, GeotiffError> {
        if bytes <= SMALL {
            static COUNT: AtomicUsize = AtomicUsize::new(0);
            let number = COUNT.fetch_add(1, Ordering::Relaxed);
            return Ok(Self { path: format!("/vsimem/boresight-{number}.tif").into(), file: None });
        }
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = tempfile::Builder::new()
            .prefix(atomic::TEMPORARY_PREFIX)
            .suffix(".tif")
            .tempfile_in(folder)
            .map_err(|source| WriteError { action: "create", path: target.to_owned(), source })?
            .into_temp_path();
        Ok(Self { path: file.to_path_buf(), file: Some(file) })
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        if self.file.is_none() {
            // What cannot be removed goes with the process.
            let _ = gdal::vsi::unlink_mem_file(&self.path);
        }
    }
}

fn write_failed(path: &Path) -> impl Fn(String) -> GeotiffError {
    let path = path.to_owned();
    move |cause| GeotiffError::Write { path: path.clone(), cause }
}

/// GDAL, once for the process: a bounded cache.
pub fn set_up() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // SAFETY: plain setters of the C library, called once before any raster is opened here.
        // A mask belongs into its file, and overviews have the blocks of the raster they reduce.
        for (key, value) in [("GDAL_TIFF_INTERNAL_MASK", "YES"), ("GDAL_TIFF_OVR_BLOCKSIZE", "512")] {
            // Fails only for keys or values with a NUL in them.
            let _ = gdal::config::set_config_option(key, value);
        }
        unsafe {
            gdal_sys::GDALSetCacheMax64(GDAL_CACHE as i64);
        }
        offered_compressions();
    });
}

/// Runs GDAL calls and listens to what GDAL says on this thread: an error, or a warning that an option
/// was not understood, makes them fail even where the call itself claims success.
fn heard<T>(call: impl FnOnce() -> Result<T, GdalError>) -> Result<T, String> {
    let mut words: Vec<String> = Vec::new();
    // SAFETY: the handler is popped below, on the same thread, while `words` is alive; nothing in `call`
    // unwinds through C frames.
    unsafe { gdal_sys::CPLPushErrorHandlerEx(Some(listen), (&raw mut words).cast::<c_void>()) };
    let pop = Pop;
    let result = call();
    drop(pop);
    match result {
        Ok(value) if words.is_empty() => Ok(value),
        Ok(_) => Err(words.join("; ")),
        Err(error) if words.is_empty() => Err(error.to_string()),
        Err(_) => Err(words.join("; ")),
    }
}

/// Pops the handler also when the call panics.
struct Pop;
impl Drop for Pop {
    fn drop(&mut self) {
        // SAFETY: pairs with the push in `heard`.
        unsafe { gdal_sys::CPLPopErrorHandler() };
    }
}

unsafe extern "C" fn listen(class: gdal_sys::CPLErr::Type, _number: c_int, message: *const c_char) {
    // SAFETY: GDAL hands over a C string, and the pointer that `heard` gave it.
    let (message, words) = unsafe {
        let words = gdal_sys::CPLGetErrorHandlerUserData().cast::<Vec<String>>().as_mut();
        (CStr::from_ptr(message).to_string_lossy().into_owned(), words)
    };
    let is_error = class >= gdal_sys::CPLErr::CE_Failure
        || (class == gdal_sys::CPLErr::CE_Warning && message.contains("does not support creation option"));
    match words {
        Some(words) if is_error => words.push(message),
        _ => tracing::debug!("GDAL: {message}"),
    }
}
