//! `check` on real surveys: what it must find, and what it must not.

#![expect(clippy::disallowed_methods, reason = "tests lay out inputs, not products")]

use super::surveys::shared;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Runs `check --json` on a pipeline of the project after a change to its text: exit code and what it printed.
fn checked(pipeline: &str, change: impl Fn(&str) -> String, options: &[&str]) -> (i32, Value) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("pipelines").join(pipeline)).unwrap();
    let data = root.join("../shared").canonicalize().unwrap();
    let text = change(&text).replace("../../shared", data.to_str().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("p.toml");
    fs::write(&file, text).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_boresight"))
        .arg("check")
        .arg(&file)
        .arg("--json")
        .args(options)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let found = serde_json::from_str(&said)
        .unwrap_or_else(|e| panic!("{e}: {said}\n{}", String::from_utf8_lossy(&output.stderr)));
    (output.status.code().unwrap(), found)
}

fn codes(found: &Value) -> Vec<&str> {
    found["flight"]["findings"].as_array().unwrap().iter().map(|f| f["code"].as_str().unwrap()).collect()
}

fn finding<'a>(found: &'a Value, code: &str) -> &'a Value {
    let all = found["flight"]["findings"].as_array().unwrap();
    all.iter().find(|f| f["code"] == code).unwrap_or_else(|| panic!("no {code} in {:?}", codes(found)))
}

/// Without the column that says which pixels a photo viewer turned.
fn without_turns(text: &str) -> String {
    assert_eq!(text.matches("pixel_rotation = ").count(), 1);
    text.lines().filter(|line| !line.starts_with("pixel_rotation = ")).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_turned_strip_of_brighton_is_found_in_its_pixels() {
    let Some(_) = shared("brighton-beach") else { return };
    let (code, found) = checked("brighton.toml", without_turns, &["--overlaps"]);
    assert_eq!(code, 5);
    let strip: Vec<String> = (24..=29).map(|i| format!("DJI_00{i}.JPG")).collect();
    assert_eq!(finding(&found, "pixels-turned")["frames"], serde_json::json!(strip));
    assert_eq!(finding(&found, "pixels-turned")["severity"], "error");
    for frame in found["flight"]["pixel_turns"]["frames"].as_array().unwrap() {
        let turned = strip.iter().any(|name| frame["frame"] == name.as_str());
        assert_eq!(frame["turned_deg"], if turned { 180.into() } else { Value::Null }, "{frame}");
    }
    // Declared as they are, they fit.
    let (code, found) = checked("brighton.toml", str::to_owned, &["--overlaps"]);
    assert_eq!((code, codes(&found).contains(&"pixels-turned")), (0, false), "{:?}", codes(&found));
}

#[test]
fn metadata_alone_names_the_viewer_that_turned_brighton() {
    let Some(_) = shared("brighton-beach") else { return };
    let (code, found) = checked("brighton.toml", without_turns, &[]);
    assert_eq!(code, 0);
    let named = finding(&found, "pixels-perhaps-turned");
    assert_eq!(named["frames"].as_array().unwrap().len(), 6, "{named}");
    assert!(named["text"].as_str().unwrap().contains("Windows Photo Viewer"), "{named}");
    // Declared, there is nothing to say.
    assert_eq!(codes(&checked("brighton.toml", str::to_owned, &[]).1), Vec::<&str>::new());
}

#[test]
fn a_wrong_height_datum_of_brighton_is_explained_by_the_geoid() {
    let Some(_) = shared("brighton-beach") else { return };
    let wrong =
        |text: &str| text.replace("unit = \"m\", datum = \"ellipsoid\"", "unit = \"m\", datum = \"egm96\"");
    let (_, found) = checked("brighton.toml", wrong, &[]);
    let named = finding(&found, "heights-disagree");
    let text = named["text"].as_str().unwrap();
    assert!(text.contains("below where the heights above the take-off point put them"), "{text}");
    assert!(text.contains("-28.7 m is the geoid's undulation here"), "{text}");
    assert!(named["help"].as_str().unwrap().contains("\"ellipsoid\""), "{named}");
}

#[test]
fn seneca_is_as_its_source_describes_it() {
    let Some(_) = shared("seneca") else { return };
    let (code, found) = checked("seneca-log.toml", str::to_owned, &["--overlaps", "--sharpness"]);
    // The log's yaw is up to 50 degrees wrong: most pixels cannot tell, and none are called turned.
    assert_eq!((code, codes(&found)), (0, vec!["course-as-yaw", "motion-blur", "coverage-holes"]));
    let frames = found["flight"]["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 69);
    let mut sharpness: Vec<f64> = frames.iter().map(|row| row["sharpness"].as_f64().unwrap()).collect();
    sharpness.sort_by(f64::total_cmp);
    assert!(sharpness[0] > 0.0 && sharpness[34] == 1.0, "{sharpness:?}");
    for row in frames {
        assert_eq!((&row["status"], &row["speed_from"]), (&"used".into(), &"log".into()), "{row}");
        // f = 1278 px.
        let (gsd, height) = (row["gsd_m"].as_f64().unwrap(), row["height_above_ground_m"].as_f64().unwrap());
        assert!((gsd / (height / 1278.4) - 1.0).abs() < 0.1, "{row}");
        let smear = row["speed_m_s"].as_f64().unwrap() * row["exposure_time_s"].as_f64().unwrap() / gsd;
        assert!((smear - row["motion_blur_px"].as_f64().unwrap()).abs() < 1e-9, "{row}");
    }
}
