//! Real surveys: forward georeferencing against their published reference.

use boresight::camera::{Brown, Camera, ImagePoint};
use boresight::config::Config;
use boresight::formats::crs::Projection;
use boresight::formats::geoid::Geoid;
use boresight::formats::table::Table;
use boresight::geodesy::{Geodetic, GeoidModel, MapProjection};
use boresight::georeference::GeoreferencedFrame;
use boresight::stages::georeference::georeference;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A data folder beside the project; `None`, with the reason printed, where it is absent.
pub fn shared(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: the data set {name} is not on this machine");
    None
}

pub fn pipeline(name: &str) -> Config {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines").join(name);
    Config::load(&file, &[]).unwrap_or_else(|e| panic!("{e}"))
}

pub fn seneca_camera() -> Arc<Camera> {
    let brown = Brown::new([
        1278.47459049334,
        1278.2654390059174,
        0.0,
        899.5,
        674.5,
        -0.03428615333016995,
        0.01395262653034406,
        -0.0015817713252328123,
        0.000449624037447544,
        0.0,
    ])
    .unwrap();
    Arc::new(Camera::new(brown, 1800, 1350, None).unwrap())
}

#[derive(Clone, Copy)]
enum GroundOf {
    Point,
    Survey,
}

/// 2-D errors of all check observations whose frame has a pose, metres.
fn seneca_errors(folder: &Path, pipeline_file: &str, ground: GroundOf) -> Vec<f64> {
    let config = pipeline(pipeline_file);
    let survey = georeference(config.georeference.as_ref().unwrap(), &seneca_camera()).unwrap();
    let frames: BTreeMap<&str, &GeoreferencedFrame> =
        survey.frames.iter().map(|f| (f.name.as_str(), f)).collect();
    let utm = Projection::new("EPSG:32617").unwrap();
    let points = Table::read_path(&folder.join("check_points.csv"), b',').unwrap();
    let column = |t: &Table, name: &str| t.column_named(name).unwrap();
    let (name, east, north, height, lat, lon) = (
        column(&points, "point"),
        column(&points, "utm17_easting_m"),
        column(&points, "utm17_northing_m"),
        column(&points, "alt_amsl_m"),
        column(&points, "latitude_deg"),
        column(&points, "longitude_deg"),
    );
    let truth: BTreeMap<String, (f64, f64, f64)> = points
        .rows()
        .map(|r| {
            let at = Geodetic::from_degrees(r.number(lat).unwrap(), r.number(lon).unwrap(), 0.0);
            let h =
                r.number(height).unwrap() + Geoid::Grids.undulations(GeoidModel::Egm96, &[at]).unwrap()[0];
            (r.text(name).to_owned(), (r.number(east).unwrap(), r.number(north).unwrap(), h))
        })
        .collect();
    let observations = Table::read_path(&folder.join("check_observations.csv"), b',').unwrap();
    let (point, file, x, y) = (
        column(&observations, "point"),
        column(&observations, "file"),
        column(&observations, "x_px"),
        column(&observations, "y_px"),
    );
    observations
        .rows()
        .map(|row| {
            let frame = frames[row.text(file)];
            let (e, n, h) = truth[row.text(point)];
            // Measured from the corner of the top-left pixel.
            let pixel = ImagePoint::new(row.number(x).unwrap() - 0.5, row.number(y).unwrap() - 0.5);
            let found = match ground {
                GroundOf::Point => frame.ground_from_pixel_at_height(pixel, h),
                GroundOf::Survey => frame.ground_from_pixel(pixel),
            }
            .unwrap_or_else(|e| panic!("{}: {e}", row.text(file)));
            let map = utm.map_from_geodetic(&[found.position]).unwrap()[0];
            (map.easting - e).hypot(map.northing - n)
        })
        .collect()
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn seneca_reference_poses_meet_the_check_points() {
    let Some(folder) = shared("seneca") else { return };
    let errors = seneca_errors(&folder, "seneca-reference.toml", GroundOf::Point);
    assert_eq!(errors.len(), 843);
    assert!(rms(&errors) <= 0.03, "RMS {} m", rms(&errors));
}

#[test]
fn seneca_on_flat_ground_loses_what_the_relief_costs() {
    let Some(folder) = shared("seneca") else { return };
    let errors = seneca_errors(&folder, "seneca-flat.toml", GroundOf::Survey);
    assert!((rms(&errors) - 0.61).abs() <= 0.03, "RMS {} m", rms(&errors));
}

#[test]
fn seneca_raw_log_is_as_bad_as_published() {
    let Some(folder) = shared("seneca") else { return };
    let errors = seneca_errors(&folder, "seneca-log.toml", GroundOf::Point);
    assert!((rms(&errors) - 16.3).abs() <= 0.5, "RMS {} m", rms(&errors));
}
