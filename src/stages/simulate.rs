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
    simulate_with_progress(scenario, output, &mut |_, _| {})
}

/// [`simulate`], calling `progress` with the pictures done and the pictures in all.
///
/// # Errors
/// Those of [`simulate`].
pub fn simulate_with_progress(
    scenario: &Scenario,
    output: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<WrittenSurvey, SimulateError> {
    let survey = Survey::new(scenario)?;
    Ok(write_survey(&survey, output, progress)?)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fs;

    use super::*;
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
        fs::write(folder.path().join("notes.txt"), "mine").unwrap();
        let error = simulate(&small(), folder.path()).unwrap_err();
        assert!(matches!(error, SimulateError::Write(SurveyWriteError::NotEmpty(_))));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_output_path_through_a_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
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
