//! Elevation rasters in any format GDAL reads.

use super::InputError;
use crate::raster::{GridTransform, Raster};
use gdal::Dataset;
use std::path::Path;

/// Heights as a file gives them.
#[derive(Debug, Clone)]
pub struct Elevation {
    /// Metres above the file's own datum; NaN where it has no data.
    pub heights: Raster<f32>,
    /// Where the posts lie.
    pub grid: GridTransform,
    /// CRS of the grid.
    pub wkt: String,
}

/// Metres in one unit of height; a file that names none means metres.
fn metres_per(unit: &str) -> Option<f64> {
    match unit.trim().to_lowercase().as_str() {
        "" | "m" | "metre" | "metres" | "meter" | "meters" => Some(1.0),
        "ft" | "foot" | "feet" | "international foot" => Some(0.3048),
        "us-ft" | "ftus" | "us survey foot" | "us_survey_foot" => Some(1200.0 / 3937.0),
        _ => None,
    }
}

/// The largest model held in memory: 400 million posts.
const MAX_POSTS: usize = 400_000_000;

/// Reads the first band of an elevation raster, its scale, offset and unit applied.
///
/// # Errors
/// [`InputError`] when the file is missing, unreadable, too large, or lacks a georeference or CRS.
pub fn read_elevation(file: &Path) -> Result<Elevation, InputError> {
    let failed = |cause: String| InputError::new(file, cause);
    // GDAL's own words for a missing file are empty.
    std::fs::metadata(file).map_err(|e| failed(format!("cannot be read ({e})")))?;
    let unreadable = |e: gdal::errors::GdalError| failed(format!("cannot be read as a raster ({e})"));
    let dataset = Dataset::open(file).map_err(unreadable)?;
    let (width, height) = dataset.raster_size();
    if width.checked_mul(height).is_none_or(|posts| posts > MAX_POSTS) {
        return Err(failed(format!("has {width} × {height} posts, the limit is {MAX_POSTS}"))
            .help("crop or coarsen it to the survey's area, for example with gdalwarp -te -tr"));
    }
    if dataset.raster_count() == 0 {
        return Err(failed("has no raster band".to_owned()));
    }
    let grid = dataset
        .geo_transform()
        .ok()
        .and_then(GridTransform::from_gdal)
        .ok_or_else(|| failed("has no georeference".to_owned()))?;
    let wkt = dataset.projection();
    if wkt.is_empty() {
        return Err(failed("states no CRS".to_owned())
            .help("assign one, for example with gdal_edit.py -a_srs EPSG:…"));
    }
    let band = dataset.rasterband(1).map_err(unreadable)?;
    let no_data = band.no_data_value();
    let unit = band.unit();
    let metres = metres_per(&unit)
        .ok_or_else(|| failed(format!("gives heights in \"{unit}\"; metres or feet are understood")))?;
    let (scale, offset) = (band.scale().unwrap_or(1.0) * metres, band.offset().unwrap_or(0.0) * metres);
    let buffer = band.read_as::<f64>((0, 0), (width, height), (width, height), None).map_err(unreadable)?;
    let samples = buffer
        .data()
        .iter()
        .map(|&raw| {
            // A value stored as f32 may differ from the declared one in its last digits.
            let missing = no_data.is_some_and(|n| raw == n || raw as f32 == n as f32);
            if missing { f32::NAN } else { (raw * scale + offset) as f32 }
        })
        .collect();
    let heights = Raster::new(width, height, samples).ok_or_else(|| failed("is cut short".to_owned()))?;
    Ok(Elevation { heights, grid, wkt })
}
