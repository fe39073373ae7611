//! `simulate`: a scenario in, a synthetic survey's folder out.

use std::path::Path;

use crate::formats::survey::{SurveyWriteError, WrittenSurvey, write_survey};
use crate::synthetic::{Scenario, Survey, SyntheticError};

/// Why a survey could not be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    #[error("the scenario is not usable")]
    Scenario(#[from] SyntheticError),
    #[error("the survey could not be written")]
    Write(#[from] SurveyWriteError),
}

/// Renders a scenario into a folder that does not exist yet or is empty. The folder's files are listed in
/// [`crate::formats::survey`].
///
/// # Errors
/// [`SimulateError::Scenario`] for a senseless value, before anything is written; [`SimulateError::Write`] if the folder
/// holds files already or a file cannot be written; then `output` is left as it was.
pub fn simulate(scenario: &Scenario, output: &Path) -> Result<WrittenSurvey, SimulateError> {
    simulate_with(scenario, output, false, &mut |_, _| {})
}

/// [`simulate`] that with `replace` also takes the place of an older survey, and calls `progress` with the pictures done
/// and the pictures in all.
///
/// # Errors
/// Those of [`simulate`]. With `replace` a folder whose files are no survey is still refused.
pub fn simulate_with(
    scenario: &Scenario,
    output: &Path,
    replace: bool,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<WrittenSurvey, SimulateError> {
    let survey = Survey::new(scenario)?;
    Ok(write_survey(&survey, output, replace, progress)?)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fs;

    use super::*;
    use crate::formats::atomic;
    use crate::synthetic::{Camera, Relief, ReliefShape};

    /// Two small frames over hills and one target photo.
    fn small() -> Scenario {
        let mut scenario = Scenario::demo();
        scenario.camera = Camera {
            width_px: 288,
            height_px: 162,
            fx_px: 186.0,
            fy_px: 187.0,
            skew_px: 0.0,
            cx_px: 141.0,
            cy_px: 86.0,
            k3: 0.0,
            ..Camera::default()
        };
        scenario.relief = Relief { shape: ReliefShape::Hills, amplitude_m: 10.0, wavelength_m: 300.0 };
        scenario.flight.strips = 1;
        scenario.flight.frames_per_strip = 2;
        scenario.calibration.views = 1;
        scenario
    }

    fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
        let mut found = BTreeMap::new();
        for sub in ["", "images", "calibration"] {
            for entry in fs::read_dir(folder.join(sub)).unwrap() {
                let path = entry.unwrap().path();
                if path.is_file() {
                    let name = path.strip_prefix(folder).unwrap().display().to_string();
                    found.insert(name, fs::read(&path).unwrap());
                }
            }
        }
        found
    }

    #[test]
    fn writes_every_file_twice_alike() {
        let folder = tempfile::tempdir().unwrap();
        let (one, two) = (folder.path().join("one"), folder.path().join("deeper/two"));
        let written = simulate(&small(), &one).unwrap();
        simulate(&small(), &two).unwrap();
        let names = [
            "calibration/corners.csv",
            "calibration/target_01.png",
            "camera-true.json",
            "dem.tif",
            "images/IMG_0001.jpg",
            "images/IMG_0002.jpg",
            "log.csv",
            "runway.csv",
            "runway_observations.csv",
            "scenario.toml",
            "target_observations.csv",
            "targets.csv",
            "track.csv",
            "truth.csv",
        ];
        let files_one = files(&one);
        assert_eq!(files_one.keys().collect::<Vec<_>>(), names);
        assert!(files_one == files(&two));
        assert_eq!(written.bytes, files_one.values().map(|bytes| bytes.len() as u64).sum::<u64>());
        let scenario: Scenario =
            toml::from_str(&String::from_utf8(files_one["scenario.toml"].clone()).unwrap()).unwrap();
        assert_eq!(scenario, small());
        // Nothing unfinished is left beside the results.
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn the_terrain_file_holds_the_ground_heights_below_every_target() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("survey");
        simulate(&small(), &output).unwrap();
        let survey = Survey::new(&small()).unwrap();
        let dem = gdal::Dataset::open(output.join("dem.tif")).unwrap();
        let [west, column_step, _, north, _, row_step] = dem.geo_transform().unwrap();
        let heights = dem.rasterband(1).unwrap().read_band_as::<f32>().unwrap();
        let (columns, rows) = dem.raster_size();
        let height = |column: usize, row: usize| f64::from(heights.data()[row * columns + column]);
        for (column, row) in [(0, 0), (columns - 1, rows - 1), (columns / 2, rows / 3)] {
            let (longitude, latitude) =
                (west + (column as f64 + 0.5) * column_step, north + (row as f64 + 0.5) * row_step);
            assert!((height(column, row) - survey.ground_height(latitude, longitude)).abs() < 1e-4);
        }
        let mut checked = 0;
        for seen in survey.observations() {
            let target = survey.targets().iter().find(|target| target.name == seen.point).unwrap();
            let column = (target.centre.longitude_deg - west) / column_step - 0.5;
            let row = (target.centre.latitude_deg - north) / row_step - 0.5;
            let nearest = height(column.round() as usize, row.round() as usize);
            // Half a posting away on ground no steeper than 0.2.
            assert!((nearest - target.centre.height_m).abs() < 0.3, "{}", target.name);
            checked += 1;
        }
        assert!(checked > 0);
    }

    #[test]
    fn existing_files_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let note = folder.path().join("notes.txt");
        atomic::write_atomic(&note, b"mine").unwrap();
        for replace in [false, true] {
            let error = simulate_with(&small(), folder.path(), replace, &mut |_, _| {}).unwrap_err();
            assert!(matches!(error, SimulateError::Write(SurveyWriteError::NotASurvey(_))));
            assert_eq!(fs::read(&note).unwrap(), b"mine");
        }
    }

    #[test]
    fn an_older_survey_is_replaced_only_on_request() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("survey");
        let mut scenario = small();
        simulate(&scenario, &output).unwrap();
        scenario.flight.frames_per_strip = 1;
        let error = simulate(&scenario, &output).unwrap_err();
        assert!(matches!(error, SimulateError::Write(SurveyWriteError::Exists(_))));
        assert!(output.join("images/IMG_0002.jpg").exists());
        let (mut calls, mut all) = (0, 0);
        simulate_with(&scenario, &output, true, &mut |_, count| (calls, all) = (calls + 1, count)).unwrap();
        assert_eq!((calls, all), (2, 2));
        assert!(!output.join("images/IMG_0002.jpg").exists() && output.join("images/IMG_0001.jpg").exists());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// The demo's files in the repository are those its scenario makes. Grey values may differ by rounding where the
    /// mathematical library does.
    #[test]
    fn the_demos_files_are_up_to_date() {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
        let scenario: Scenario =
            toml::from_str(&fs::read_to_string(fixtures.join("scenes/demo.toml")).unwrap()).unwrap();
        assert_eq!(scenario, Scenario::demo());
        let demo = fixtures.join("demo");
        assert_eq!(
            fs::read_to_string(demo.join("scenario.toml")).unwrap(),
            toml::to_string(&scenario).unwrap()
        );
        let survey = Survey::new(&scenario).unwrap();
        let mut log = csv::Reader::from_path(demo.join("log.csv")).unwrap();
        let rows: Vec<csv::StringRecord> = log.records().map(Result::unwrap).collect();
        assert_eq!(rows.len(), survey.frames().len());
        for (row, frame) in rows.iter().zip(survey.frames()) {
            assert_eq!(&row[0], frame.name);
            for (cell, expected, tolerance) in [
                (&row[2], frame.logged.antenna.latitude_deg, 1e-9),
                (&row[4], frame.logged.antenna.height_m, 1e-4),
                (&row[5], frame.logged.attitude.yaw_deg, 1e-7),
            ] {
                assert!(
                    (cell.parse::<f64>().unwrap() - expected).abs() < tolerance,
                    "{cell} is not {expected}"
                );
            }
        }
        let fresh = survey.render_frame(2);
        let stored = image::open(demo.join("images/IMG_0003.jpg")).unwrap().to_rgb8();
        let difference: u64 = fresh.iter().zip(stored.iter()).map(|(&a, &b)| u64::from(a.abs_diff(b))).sum();
        let mean = difference as f64 / fresh.len() as f64;
        assert!(mean < 2.5, "JPEG and noise explain 2 grey values, not {mean}");
    }

    #[test]
    fn an_output_path_through_a_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        atomic::write_atomic(&file, b"").unwrap();
        let Err(SimulateError::Write(error)) = simulate(&small(), &file.join("out")) else {
            panic!("written into a file")
        };
        assert!(error.to_string().contains("file"), "{error}");
    }

    #[test]
    fn a_bad_scenario_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut scenario = small();
        scenario.flight.speed_m_s = 0.0;
        assert!(matches!(simulate(&scenario, &folder.path().join("out")), Err(SimulateError::Scenario(_))));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
