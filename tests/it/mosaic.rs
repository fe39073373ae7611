//! The mosaic stage from files to files, and the Seneca mosaic against its reference orthophoto.

use super::surveys::{pipeline, seneca_camera, shared};
use boresight::camera::{Brown, Camera, ImagePoint};
use boresight::config::Config;
use boresight::formats::atomic::write_atomic;
use boresight::geodesy::{MapPoint, MapProjection};
use boresight::georeference::GeoreferencedFrame;
use boresight::raster::GridTransform;
use boresight::stages::georeference::{Georeferenced, georeference};
use boresight::stages::mosaic::{self, MosaicProduct};
use boresight::stages::{ErrorClass, NoProgress, RunContext, Stage, StageError};
use gdal::{Dataset, Metadata};
use image::{ExtendedColorType, ImageEncoder};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

/// Four photos of painted ground in a folder, with log and pipeline file.
struct Survey {
    folder: tempfile::TempDir,
}

const FRAMES: [(&str, f64, f64, [f64; 3]); 4] = [
    ("a.jpg", 45.000_00, 7.000_00, [0.0, 0.0, 0.0]),
    ("b.jpg", 45.000_20, 7.000_10, [40.0, 3.0, -2.0]),
    ("c.jpg", 45.000_35, 7.000_30, [170.0, -4.0, 5.0]),
    ("d.jpg", 45.000_10, 7.000_45, [265.0, 1.0, 1.0]),
];

/// Waves of 12 m and 9 m, in red, green and blue.
fn paint(at: MapPoint) -> [f64; 3] {
    let turn = std::f64::consts::TAU;
    let (e, n) = ((turn * at.easting / 12.0).sin(), (turn * at.northing / 9.0).cos());
    [128.0 + 60.0 * e + 50.0 * n, 128.0 + 90.0 * e, 128.0 + 90.0 * n]
}

fn camera() -> Arc<Camera> {
    let brown = Brown::new([200.0, 201.0, 0.1, 120.8, 78.7, -0.08, 0.02, 1e-3, -8e-4, 0.0]).unwrap();
    Arc::new(Camera::new(brown, 240, 160, None).unwrap())
}

fn png(samples: &[u8], width: u32, height: u32) -> Vec<u8> {
    let kind = if samples.len() == (width * height) as usize {
        ExtendedColorType::L8
    } else {
        ExtendedColorType::Rgb8
    };
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes).write_image(samples, width, height, kind).unwrap();
    bytes
}

impl Survey {
    /// Photos are PNGs inside, whatever their extension: nothing is lost to compression.
    fn new() -> Self {
        let survey = Self { folder: tempfile::tempdir().unwrap() };
        std::fs::create_dir(survey.images()).unwrap();
        let mut log = "frame,lat,lon,height,yaw,pitch,roll\n".to_owned();
        for (name, lat, lon, [yaw, pitch, roll]) in FRAMES {
            log += &format!("{name},{lat},{lon},160,{yaw},{pitch},{roll}\n");
            write_atomic(&survey.images().join(name), &png(&[0; 240 * 160], 240, 160)).unwrap();
        }
        write_atomic(&survey.folder.path().join("log.csv"), log.as_bytes()).unwrap();
        for frame in survey.georeferenced(&[]).frames {
            write_atomic(&survey.images().join(&frame.name), &png(&photo(&frame), 240, 160)).unwrap();
        }
        survey
    }
    fn images(&self) -> PathBuf {
        self.folder.path().join("images")
    }
    fn output(&self) -> PathBuf {
        self.folder.path().join("out")
    }
    fn config(&self, overrides: &[&str]) -> Config {
        let text = r#"
version = 1
[calibrate.parameters]
image_width_px = 240
image_height_px = 160
pixel_origin = "centre"
fx_px = 200.0
fy_px = 201.0
cx_px = 120.8
cy_px = 78.7
[georeference]
images = "images"
crs = "EPSG:32632"
[georeference.log]
file = "log.csv"
join = "name"
[georeference.log.columns]
frame = "frame"
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg" }
height = { column = "height", unit = "m", datum = "ellipsoid" }
yaw = { column = "yaw", unit = "deg", sense = "clockwise_from_true_north" }
pitch = { column = "pitch", unit = "deg", sense = "nose_up" }
roll = { column = "roll", unit = "deg", sense = "right_wing_down" }
[georeference.mount]
gimbal_elevation = "-90 deg"
[georeference.ground]
kind = "plane"
height = "100 m"
datum = "ellipsoid"
[mosaic]
gsd = "20 cm"
preview_width_px = 100
"#;
        let file = self.folder.path().join("pipeline.toml");
        write_atomic(&file, text.as_bytes()).unwrap();
        let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
        Config::load(&file, &overrides).unwrap_or_else(|e| panic!("{e}"))
    }
    fn georeferenced(&self, overrides: &[&str]) -> Georeferenced {
        georeference(self.config(overrides).georeference.as_ref().unwrap(), &camera()).unwrap()
    }
    fn context(&self) -> RunContext {
        RunContext::new(Stage::Mosaic, &self.output(), 0, Arc::new(NoProgress), Arc::default())
    }
    fn run(&self, overrides: &[&str]) -> Result<MosaicProduct, StageError> {
        mosaic::run(&self.config(overrides), &self.georeferenced(overrides), &self.context())
    }
}

fn photo(frame: &GeoreferencedFrame) -> Vec<u8> {
    let utm = boresight::formats::crs::Projection::new("EPSG:32632").unwrap();
    let ground: Vec<_> = (0..160)
        .flat_map(|r| (0..240).map(move |c| ImagePoint::new(f64::from(c), f64::from(r))))
        .map(|pixel| frame.ground_from_pixel(pixel).unwrap().position)
        .collect();
    let map = utm.map_from_geodetic(&ground).unwrap();
    map.into_iter().flat_map(|at| paint(at).map(|v| v.round() as u8)).collect()
}

/// A raster as it lies in its file: bands, and where they lie.
struct Opened {
    width: usize,
    height: usize,
    bands: Vec<Vec<u8>>,
    grid: GridTransform,
    dataset: Dataset,
}

fn open(path: &Path) -> Opened {
    let dataset = Dataset::open(path).unwrap();
    let (width, height) = dataset.raster_size();
    let bands = (1..=dataset.raster_count())
        .map(|b| {
            let band = dataset.rasterband(b).unwrap();
            let whole = (width, height);
            band.read_as::<u8>((0, 0), whole, whole, None).unwrap().into_shape_and_vec().1
        })
        .collect();
    let grid = GridTransform::from_gdal(dataset.geo_transform().unwrap()).unwrap();
    Opened { width, height, bands, grid, dataset }
}

/// Root mean square of (mosaic − paint) over the opaque pixels, and their number.
fn difference(mosaic: &Opened) -> (f64, usize) {
    let (mut squares, mut count) = (0.0, 0);
    for i in 0..mosaic.width * mosaic.height {
        if mosaic.bands[3][i] == 255 {
            let at = mosaic.grid.map_from_pixel((i % mosaic.width) as f64, (i / mosaic.width) as f64);
            for (band, value) in mosaic.bands.iter().zip(paint(at)) {
                squares += (f64::from(band[i]) - value).powi(2);
            }
            count += 1;
        }
    }
    ((squares / (3 * count) as f64).sqrt(), count)
}

/// GDAL's own judgement, where its Python scripts are installed; its structure in any case.
fn assert_cloud_optimized(path: &Path) {
    let dataset = Dataset::open(path).unwrap();
    assert_eq!(dataset.metadata_item("LAYOUT", "IMAGE_STRUCTURE").as_deref(), Some("COG"), "{path:?}");
    assert_eq!(dataset.rasterband(1).unwrap().block_size(), (512, 512));
    let judge = Command::new("/usr/bin/python3")
        .args(["-m", "osgeo_utils.samples.validate_cloud_optimized_geotiff"])
        .arg(path)
        .output();
    match judge {
        Ok(judged) => {
            let words = String::from_utf8_lossy(&judged.stdout).into_owned();
            if String::from_utf8_lossy(&judged.stderr).contains("No module named") {
                eprintln!("GDAL's validate_cloud_optimized_geotiff is not installed: not asked");
                return;
            }
            assert!(judged.status.success(), "{words}");
            assert!(words.contains("is a valid cloud optimized GeoTIFF"), "{words}");
        }
        Err(_) => eprintln!("python3 is not installed: GDAL's validator was not asked"),
    }
}

#[test]
fn the_mosaic_shows_the_ground_where_it_is() {
    let survey = Survey::new();
    let product = survey.run(&[]).unwrap();
    assert_cloud_optimized(&product.raster);
    let mosaic = open(&product.raster);
    assert_eq!(mosaic.bands.len(), 4);
    let (rms, count) = difference(&mosaic);
    assert!(rms < 1.0, "{rms} grey values");
    assert!((product.summary.covered_m2 - 0.04 * count as f64).abs() < 1e-6);
    assert!(count > 4 * 240 * 160 / 2, "{count}");
    // Transparent is black, and the grid lies on whole multiples of 0.2 m.
    assert!((0..count).all(|i| mosaic.bands[3][i] != 0 || mosaic.bands[0][i] == 0));
    let corner = mosaic.grid.map_from_pixel(-0.5, -0.5);
    assert!((corner.easting / 0.2 - (corner.easting / 0.2).round()).abs() < 1e-6);
    let crs = mosaic.dataset.spatial_ref().unwrap();
    assert_eq!(crs.auth_code().unwrap(), 32632);
    let item = |key| mosaic.dataset.metadata_item(key, "").unwrap_or_default();
    assert!(item("TIFFTAG_SOFTWARE").starts_with("boresight "), "{}", item("TIFFTAG_SOFTWARE"));
    assert_eq!(item("BORESIGHT_INPUT_HASH"), product.summary.input_hash);
    assert_eq!(product.summary.frames_used, ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]);
    // The picture: reduced, transparent outside, no dark rim.
    let picture = image::open(&product.preview).unwrap().into_rgba8();
    assert_eq!(picture.width(), 100);
    assert!(picture.pixels().any(|p| p.0[3] == 0) && picture.pixels().any(|p| p.0[3] == 255));
    let dark = picture.pixels().filter(|p| p.0[3] > 0 && p.0[0] < 10).count();
    assert_eq!(dark, 0, "pixels darker than any paint");
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(survey.output().join("mosaic/mosaic.json")).unwrap()).unwrap();
    assert_eq!(json["width_px"], mosaic.width);
    let left: Vec<_> = std::fs::read_dir(survey.output().join("mosaic"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(left.len(), 3, "{left:?}");
}

#[test]
fn overviews_have_no_dark_borders() {
    let survey = Survey::new();
    for (name, ..) in FRAMES {
        write_atomic(&survey.images().join(name), &png(&[200; 240 * 160 * 3], 240, 160)).unwrap();
    }
    let product = survey.run(&["mosaic.gsd=5 cm"]).unwrap();
    let dataset = Dataset::open(&product.raster).unwrap();
    let (colour, alpha) = (dataset.rasterband(1).unwrap(), dataset.rasterband(4).unwrap());
    let count = colour.overview_count().unwrap();
    assert!(count >= 1);
    for level in 0..count {
        let read = |band: &gdal::raster::RasterBand| {
            let overview = band.overview(level as usize).unwrap();
            overview.read_band_as::<u8>().unwrap().into_shape_and_vec().1
        };
        for (value, alpha) in read(&colour).into_iter().zip(read(&alpha)) {
            assert!(alpha == 0 || value == 200, "value {value} under alpha {alpha} in overview {level}");
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let survey = Survey::new();
    let bytes = |threads: usize, compression: &str| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let product = pool
            .install(|| survey.run(&["mosaic.gsd=5 cm", &format!("mosaic.compression={compression}")]))
            .unwrap();
        (std::fs::read(&product.raster).unwrap(), std::fs::read(&product.preview).unwrap())
    };
    for compression in ["deflate", "zstd", "jpeg"] {
        let one = bytes(1, compression);
        assert!(one == bytes(2, compression), "{compression}: 2 threads");
        assert!(one == bytes(7, compression), "{compression}: 7 threads");
    }
}

#[test]
fn every_compression_makes_a_valid_file() {
    let survey = Survey::new();
    for (compression, limit) in [("deflate", 1.0), ("zstd", 1.0), ("lzw", 1.0), ("jpeg", 3.0), ("webp", 3.0)]
    {
        let product = match survey.run(&[&format!("mosaic.compression={compression}")]) {
            Ok(product) => product,
            // A GDAL without it must say so and offer others.
            Err(error) => {
                assert!(error.to_string().contains("it offers"), "{error}");
                continue;
            }
        };
        assert_cloud_optimized(&product.raster);
        let mosaic = open(&product.raster);
        if mosaic.bands.len() == 4 {
            let (rms, _) = difference(&mosaic);
            assert!(rms < limit, "{compression}: {rms} grey values");
        } else {
            // JPEG has a mask instead of the alpha band.
            assert_eq!(compression, "jpeg");
            let first = mosaic.dataset.rasterband(1).unwrap();
            assert!(first.mask_flags().unwrap().is_per_dataset());
            let mask = first.open_mask_band().unwrap().read_band_as::<u8>().unwrap();
            let opaque = mask.data().iter().filter(|m| **m == 255).count();
            assert!((opaque as f64 * 0.04 - product.summary.covered_m2).abs() < 1e-6);
            let picture = image::open(&product.preview).unwrap().into_rgba8();
            assert!(picture.pixels().any(|p| p.0[3] == 0) && picture.pixels().any(|p| p.0[3] == 255));
        }
    }
}

#[test]
fn grey_photos_make_a_grey_mosaic() {
    let survey = Survey::new();
    for (name, ..) in FRAMES {
        write_atomic(&survey.images().join(name), &png(&[131; 240 * 160], 240, 160)).unwrap();
    }
    let product = survey.run(&[]).unwrap();
    let mosaic = open(&product.raster);
    assert_eq!(mosaic.bands.len(), 2);
    assert!(mosaic.bands[0].iter().zip(&mosaic.bands[1]).all(|(v, a)| *v == if *a == 255 { 131 } else { 0 }));
    let picture = image::open(&product.preview).unwrap().into_rgba8();
    assert!(picture.pixels().any(|p| p.0 == [131, 131, 131, 255]));
    // One colour photo among them makes it a colour mosaic.
    write_atomic(&survey.images().join("b.jpg"), &png(&[131; 240 * 160 * 3], 240, 160)).unwrap();
    assert_eq!(open(&survey.run(&[]).unwrap().raster).bands.len(), 4);
}

#[test]
fn a_broken_photo_is_rejected_and_the_rest_is_as_without_it() {
    let survey = Survey::new();
    std::fs::rename(survey.images().join("c.jpg"), survey.folder.path().join("c.jpg")).unwrap();
    let without = survey.run(&[]).unwrap();
    let expected = std::fs::read(&without.raster).unwrap();
    // The header is whole, so georeferencing accepts it; the pixels end half way.
    let bytes = std::fs::read(survey.folder.path().join("c.jpg")).unwrap();
    write_atomic(&survey.images().join("c.jpg"), &bytes[..bytes.len() / 2]).unwrap();
    let context = survey.context();
    let product = mosaic::run(&survey.config(&[]), &survey.georeferenced(&[]), &context).unwrap();
    assert_eq!(product.rejected.len(), 1);
    assert_eq!(product.rejected[0].frame, "c.jpg");
    assert!(product.rejected[0].reason.contains("cannot be decoded"), "{}", product.rejected[0].reason);
    assert_eq!(context.record().rejected().map(|(name, _)| name).collect::<Vec<_>>(), ["c.jpg"]);
    assert!(std::fs::read(&product.raster).unwrap() == expected, "not the mosaic of the other frames");
}

#[test]
fn without_a_usable_photo_the_old_mosaic_stays() {
    let survey = Survey::new();
    let before = std::fs::read(survey.run(&[]).unwrap().raster).unwrap();
    let georeferenced = survey.georeferenced(&[]);
    for (name, ..) in FRAMES {
        write_atomic(&survey.images().join(name), b"").unwrap();
    }
    let error = mosaic::run(&survey.config(&[]), &georeferenced, &survey.context()).unwrap_err();
    assert_eq!(error.class(), ErrorClass::Input);
    assert!(error.to_string().contains("a.jpg: the file is empty"), "{error}");
    assert!(std::fs::read(survey.output().join("mosaic/mosaic.tif")).unwrap() == before);
}

#[test]
fn bounds_outside_the_survey_point_at_their_key() {
    let survey = Survey::new();
    let error = survey.run(&["mosaic.bounds={ west = 0, south = 0, east = 10, north = 10 }"]).unwrap_err();
    assert!(error.to_string().contains("no frame sees anything inside the bounds"), "{error}");
    let error = survey.run(&["mosaic.gsd=0.001 mm"]).unwrap_err();
    assert!(error.to_string().contains("choose a larger gsd"), "{error}");
}

#[test]
fn a_folder_that_cannot_be_written_to_is_named() {
    let survey = Survey::new();
    // A file where the stage's folder should be: root may write anywhere else.
    std::fs::create_dir(survey.output()).unwrap();
    write_atomic(&survey.output().join("mosaic"), b"in the way").unwrap();
    let error = survey.run(&[]).unwrap_err();
    assert_eq!(error.class(), ErrorClass::Io);
    assert!(error.to_string().contains("out/mosaic"), "{error}");
}

#[test]
#[cfg(unix)]
fn a_full_disk_is_an_error_and_leaves_the_old_mosaic() {
    let survey = Survey::new();
    let before = std::fs::read(survey.run(&[]).unwrap().raster).unwrap();
    survey.config(&[]);
    // No file may grow beyond 32 KiB, and the signal that says so is ignored: writing fails as on a full disk.
    let run = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 64; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_boresight")])
        .args(["run", "--until", "mosaic", "--force", "--output"])
        .arg(survey.output())
        .arg(survey.folder.path().join("pipeline.toml"))
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(6), "{words}");
    assert!(words.contains("mosaic.tif"), "{words}");
    assert!(std::fs::read(survey.output().join("mosaic/mosaic.tif")).unwrap() == before);
    let left = std::fs::read_dir(survey.output().join("mosaic")).unwrap().count();
    assert_eq!(left, 3, "temporary files stayed");
}

#[test]
fn orthos_lie_on_the_mosaic_s_grid_and_show_one_frame_each() {
    let survey = Survey::new();
    let product = survey.run(&[]).unwrap();
    let context = survey.context();
    let rejected = mosaic::orthos(&survey.config(&[]), &survey.georeferenced(&[]), &context).unwrap();
    assert!(rejected.is_empty());
    let mosaic = open(&product.raster);
    for (name, ..) in FRAMES {
        let path = survey.output().join(format!("mosaic/orthos/{name}.tif"));
        assert_cloud_optimized(&path);
        let ortho = open(&path);
        let (rms, count) = difference(&ortho);
        assert!(rms < 1.0, "{name}: {rms} grey values");
        assert!(count > 60_000 && count < 110_000, "{count}");
        let at = mosaic.grid.pixel_from_map(ortho.grid.map_from_pixel(0.0, 0.0));
        assert!((at.0 - at.0.round()).abs() < 1e-6 && (at.1 - at.1.round()).abs() < 1e-6, "{at:?}");
    }
}

#[test]
fn the_seneca_mosaic_lies_on_the_reference_orthophoto() {
    let Some(folder) = shared("seneca") else { return };
    let config = pipeline("seneca-reference.toml");
    let survey = georeference(config.georeference.as_ref().unwrap(), &seneca_camera()).unwrap();
    let output = tempfile::tempdir().unwrap();
    let context = RunContext::new(Stage::Mosaic, output.path(), 0, Arc::new(NoProgress), Arc::default());
    let product = mosaic::run(&config, &survey, &context).unwrap();
    assert_cloud_optimized(&product.raster);
    assert_eq!(product.summary.frames_used.len(), 68);
    let mosaic = open(&product.raster);
    let reference = image::open(folder.join("reference_ortho_020m.jpg")).unwrap().into_luma8();
    // reference_ortho_020m.jgw: centre of the first pixel, 0.2 m.
    let first = mosaic.grid.pixel_from_map(MapPoint { easting: 305_995.1, northing: 4_545_624.9 });
    let (dc, dr) = (first.0.round() as i64, first.1.round() as i64);
    assert!((first.0 - dc as f64).abs() < 1e-6 && (first.1 - dr as f64).abs() < 1e-6);
    let grey = |i: usize| -> Option<f32> {
        (mosaic.bands[3][i] == 255).then(|| {
            let [r, g, b] = [0, 1, 2].map(|k| f32::from(mosaic.bands[k][i]));
            0.299 * r + 0.587 * g + 0.114 * b
        })
    };
    let ours = |c: i64, r: i64| -> Option<f32> {
        let (c, r) = (c + dc, r + dr);
        (c >= 0 && r >= 0 && c < mosaic.width as i64 && r < mosaic.height as i64)
            .then(|| grey(r as usize * mosaic.width + c as usize))
            .flatten()
    };
    let theirs = |c: i64, r: i64| -> Option<f32> {
        let inside = c >= 0 && r >= 0 && c < reference.width().into() && r < reference.height().into();
        inside.then(|| f32::from(reference.get_pixel(c as u32, r as u32).0[0])).filter(|v| *v > 0.0)
    };
    let mut offsets = Vec::new();
    for row in (0..2500).step_by(100) {
        for column in (0..2200).step_by(100) {
            offsets.extend(patch_offset(column, row, &ours, &theirs));
        }
    }
    let rms = |pick: fn(&(f64, f64)) -> f64| {
        (offsets.iter().map(|o| pick(o).powi(2)).sum::<f64>() / offsets.len() as f64).sqrt() * 0.2
    };
    let (east, south) = (rms(|o| o.0), rms(|o| o.1));
    let mean =
        |pick: fn(&(f64, f64)) -> f64| offsets.iter().map(pick).sum::<f64>() / offsets.len() as f64 * 0.2;
    println!(
        "{} patches: RMS {:.3} m ({east:.3} east, {south:.3} north), mean {:.3} m east, {:.3} m south",
        offsets.len(),
        east.hypot(south),
        mean(|o| o.0),
        mean(|o| o.1)
    );
    assert!(offsets.len() >= 100, "only {} patches", offsets.len());
    assert!(east.hypot(south) <= 0.25, "{} m", east.hypot(south));
}

/// Where a patch of one picture is found in the other, pixels: the peak of the normalised correlation within
/// 8 pixels, refined by parabolas. `None` where the patch is incomplete, too smooth, or not found.
fn patch_offset(
    column: i64,
    row: i64,
    ours: &impl Fn(i64, i64) -> Option<f32>,
    theirs: &impl Fn(i64, i64) -> Option<f32>,
) -> Option<(f64, f64)> {
    const SIDE: i64 = 96;
    const REACH: i64 = 8;
    let mut patch = Vec::new();
    for r in 0..SIDE {
        for c in 0..SIDE {
            patch.push(theirs(column + c, row + r)?);
        }
    }
    let width = SIDE + 2 * REACH;
    let mut area = Vec::new();
    for r in -REACH..SIDE + REACH {
        for c in -REACH..SIDE + REACH {
            area.push(ours(column + c, row + r)?);
        }
    }
    let n = patch.len() as f32;
    let mean = patch.iter().sum::<f32>() / n;
    let spread = (patch.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n).sqrt();
    if spread < 6.0 {
        return None;
    }
    let correlation = |dc: i64, dr: i64| -> f64 {
        let (mut sum, mut squares, mut product) = (0.0_f32, 0.0_f32, 0.0_f32);
        for r in 0..SIDE {
            let line = &area[((r + dr + REACH) * width + dc + REACH) as usize..][..SIDE as usize];
            let own = &patch[(r * SIDE) as usize..][..SIDE as usize];
            for (a, p) in line.iter().zip(own) {
                sum += a;
                squares += a * a;
                product += a * (p - mean);
            }
        }
        let variance = f64::from(squares / n) - f64::from(sum / n).powi(2);
        f64::from(product / n) / (variance.max(1e-6).sqrt() * f64::from(spread))
    };
    let mut best = (f64::NEG_INFINITY, 0, 0);
    for dr in -REACH..=REACH {
        for dc in -REACH..=REACH {
            let value = correlation(dc, dr);
            if value > best.0 {
                best = (value, dc, dr);
            }
        }
    }
    let (peak, dc, dr) = best;
    if peak < 0.7 || dc.abs() == REACH || dr.abs() == REACH {
        return None;
    }
    let refine = |before: f64, after: f64| 0.5 * (before - after) / (before - 2.0 * peak + after);
    Some((
        dc as f64 + refine(correlation(dc - 1, dr), correlation(dc + 1, dr)),
        dr as f64 + refine(correlation(dc, dr - 1), correlation(dc, dr + 1)),
    ))
}
