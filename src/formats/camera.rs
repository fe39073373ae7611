//! Camera files: our JSON with covariance, and OpenCV's YAML; read by content, written both ways.
//!
//! Our format names its units in the keys, says where pixel (0, 0) is, and gives every number in the
//! shortest form that reads back to the same bits:
//!
//! ```json
//! { "format": "boresight-camera", "version": 1, "model": "brown",
//!   "pixel_origin": "centre_of_top_left_pixel", "image_width_px": 1152, "image_height_px": 648,
//!   "fx_px": 743.7937, "…": 0, "covariance": null, "source": { "method": "photos" } }
//! ```

use super::InputError;
use crate::camera::{Brown, Camera, INTERIOR_NAMES, InteriorCovariance};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::Path;

const FORMAT: &str = "boresight-camera";
const VERSION: u32 = 1;
const MODEL: &str = "brown";
const PIXEL_ORIGIN: &str = "centre_of_top_left_pixel";

/// Our format, key by key.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    format: String,
    version: u32,
    model: String,
    pixel_origin: String,
    image_width_px: u32,
    image_height_px: u32,
    fx_px: f64,
    fy_px: f64,
    skew_px: f64,
    cx_px: f64,
    cy_px: f64,
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
    k3: f64,
    /// Rows and columns in the order of `covariance_order`; null when not known.
    covariance: Option<Vec<Vec<f64>>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    covariance_order: Option<Vec<String>>,
    /// Where the numbers come from; free form, for readers.
    #[serde(default)]
    source: serde_json::Value,
}

/// The camera in our format, ending in a line feed.
///
/// - `source`: where the numbers come from, for readers; any JSON.
#[must_use]
pub fn camera_json(camera: &Camera, source: serde_json::Value) -> String {
    let [fx_px, fy_px, skew_px, cx_px, cy_px, k1, k2, p1, p2, k3] = camera.brown.interior();
    let covariance: Option<Vec<Vec<f64>>> =
        camera.covariance.map(|matrix| matrix.row_iter().map(|row| row.iter().copied().collect()).collect());
    let covariance_order = covariance.is_some().then(|| INTERIOR_NAMES.map(str::to_owned).to_vec());
    let file = CameraFile {
        format: FORMAT.to_owned(),
        version: VERSION,
        model: MODEL.to_owned(),
        pixel_origin: PIXEL_ORIGIN.to_owned(),
        image_width_px: camera.width,
        image_height_px: camera.height,
        fx_px,
        fy_px,
        skew_px,
        cx_px,
        cy_px,
        k1,
        k2,
        p1,
        p2,
        k3,
        covariance,
        covariance_order,
        source,
    };
    let mut text = serde_json::to_string_pretty(&file).unwrap_or_default();
    text.push('\n');
    text
}

/// The camera as OpenCV's FileStorage writes it, for OpenCV's own programs.
///
/// What OpenCV has no place for is said in comments: the covariance is left out, and OpenCV's functions take
/// the skew as zero although it stands in the matrix.
#[must_use]
pub fn camera_opencv_yaml(camera: &Camera) -> String {
    let [fx, fy, skew, cx, cy, k1, k2, p1, p2, k3] = camera.brown.interior();
    let mut text = String::from("%YAML:1.0\n---\n");
    // Writing into a String cannot fail.
    if skew != 0.0 {
        let _ =
            writeln!(text, "# skew {skew} px in row 1, column 2 of the matrix: OpenCV's functions ignore it");
    }
    if camera.covariance.is_some() {
        text.push_str(
            "# the covariance of these parameters is in camera.json: this format has no place for it\n",
        );
    }
    let _ = write!(
        text,
        "image_width: {}\nimage_height: {}\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
         data: [ {}, {}, {},\n       0., {}, {},\n       0., 0., 1. ]\ndistortion_coefficients: \
         !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ {}, {}, {}, {}, {} ]\n",
        camera.width,
        camera.height,
        number(fx),
        number(skew),
        number(cx),
        number(fy),
        number(cy),
        number(k1),
        number(k2),
        number(p1),
        number(p2),
        number(k3),
    );
    text
}

/// Shortest text that reads back to the same bits, with the decimal point that OpenCV needs to see a real.
fn number(value: f64) -> String {
    let text = format!("{value:?}");
    match text.strip_suffix(".0") {
        Some(whole) => format!("{whole}."),
        None => text,
    }
}

/// Reads a camera file of either format, recognised by its content.
///
/// # Errors
/// [`InputError`]: unreadable, of no known format, a key missing or unknown, a number that is no camera's, or
/// a lens this program has no model for.
pub fn read_camera(file: &Path) -> Result<Camera, InputError> {
    let text = std::fs::read_to_string(file).map_err(|error| match error.kind() {
        std::io::ErrorKind::InvalidData => {
            InputError::new(file, "is not UTF-8 text, so it is no camera file")
                .help("give a boresight camera.json or an OpenCV YAML file")
        }
        _ => InputError::new(file, format!("cannot be read ({error})")),
    })?;
    camera_from_text(file, &text)
}

/// The camera in the text of a file of either format; `file` is for messages.
///
/// # Errors
/// As [`read_camera`].
pub fn camera_from_text(file: &Path, text: &str) -> Result<Camera, InputError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    if text.trim_start().starts_with('{') {
        from_json(file, text)
    } else if text.trim_start().starts_with("%YAML") || text.contains("camera_matrix") {
        from_opencv(file, text)
    } else {
        Err(InputError::new(file, "is neither a boresight camera (JSON) nor an OpenCV camera (YAML)")
            .help("give a camera.json that `boresight run` wrote, or a YAML file with camera_matrix and distortion_coefficients"))
    }
}

fn from_json(file: &Path, text: &str) -> Result<Camera, InputError> {
    /// What says whether the rest can be understood at all.
    #[derive(Deserialize)]
    struct Kind {
        format: Option<String>,
        version: Option<u32>,
        model: Option<String>,
        pixel_origin: Option<String>,
    }
    let malformed = |error: serde_json::Error| {
        InputError::new(file, format!("is no camera file: {error}")).line(error.line() as u64)
    };
    let kind: Kind = serde_json::from_str(text).map_err(malformed)?;
    let expect = |key: &str, found: Option<String>, expected: &str| match found {
        Some(found) if found == expected => Ok(()),
        Some(found) => Err(InputError::new(file, format!("`{key}` is \"{found}\", not \"{expected}\""))),
        None => Err(InputError::new(file, format!("`{key}` is missing; it must be \"{expected}\""))),
    };
    expect("format", kind.format, FORMAT)?;
    match kind.version {
        Some(VERSION) => {}
        Some(other) => {
            return Err(InputError::new(file, format!("`version` is {other}; this program reads {VERSION}"))
                .help("use the version of boresight that wrote it, or calibrate again"));
        }
        None => return Err(InputError::new(file, format!("`version` is missing; it must be {VERSION}"))),
    }
    expect("model", kind.model, MODEL)?;
    expect("pixel_origin", kind.pixel_origin, PIXEL_ORIGIN)?;
    let f: CameraFile = serde_json::from_str(text).map_err(malformed)?;
    if f.covariance_order.as_ref().is_some_and(|order| *order != INTERIOR_NAMES) {
        let cause = format!("`covariance_order` must be {}", INTERIOR_NAMES.join(", "));
        return Err(InputError::new(file, cause));
    }
    let interior = [f.fx_px, f.fy_px, f.skew_px, f.cx_px, f.cy_px, f.k1, f.k2, f.p1, f.p2, f.k3];
    let covariance = f.covariance.map(|rows| covariance(file, &rows)).transpose()?;
    camera(file, interior, f.image_width_px, f.image_height_px, covariance)
}

fn covariance(file: &Path, rows: &[Vec<f64>]) -> Result<InteriorCovariance, InputError> {
    let failed = |cause: String| InputError::new(file, format!("`covariance` {cause}"));
    if rows.len() != 10 || rows.iter().any(|row| row.len() != 10) {
        return Err(failed(format!("must have 10 rows of 10 numbers, it has {} rows", rows.len())));
    }
    let matrix = InteriorCovariance::from_fn(|i, j| rows[i][j]);
    for i in 0..10 {
        let name = INTERIOR_NAMES[i];
        if !matrix.row(i).iter().all(|v| v.is_finite()) || matrix[(i, i)] < 0.0 {
            return Err(failed(format!("gives {name} the variance {}", matrix[(i, i)])));
        }
        for j in 0..i {
            let (a, b) = (matrix[(i, j)], matrix[(j, i)]);
            let bound = (matrix[(i, i)] * matrix[(j, j)]).sqrt();
            if (a - b).abs() > 1e-9 * bound {
                return Err(failed(format!("is not symmetric for {} and {name}", INTERIOR_NAMES[j])));
            }
            if a.abs() > bound * (1.0 + 1e-9) {
                return Err(failed(format!(
                    "gives {} and {name} a correlation of {}, beyond ±1",
                    INTERIOR_NAMES[j],
                    a / bound
                )));
            }
        }
    }
    Ok(matrix)
}

fn camera(
    file: &Path,
    interior: [f64; 10],
    width: u32,
    height: u32,
    covariance: Option<InteriorCovariance>,
) -> Result<Camera, InputError> {
    Brown::new(interior)
        .and_then(|brown| Camera::new(brown, width, height, covariance))
        .map_err(|error| InputError::new(file, error.to_string()))
}

fn from_opencv(file: &Path, text: &str) -> Result<Camera, InputError> {
    #[derive(Deserialize)]
    struct Matrix {
        rows: usize,
        cols: usize,
        data: Vec<f64>,
    }
    #[derive(Deserialize)]
    struct OpenCv {
        image_width: Option<u32>,
        image_height: Option<u32>,
        camera_matrix: Option<Matrix>,
        distortion_coefficients: Option<Matrix>,
        fisheye_model: Option<i64>,
    }
    // OpenCV's first line and its tag are not legal YAML; lines are kept so that places stay right.
    let yaml: String = text
        .lines()
        .map(|line| if line.starts_with("%YAML") { "" } else { line })
        .flat_map(|line| [line, "\n"])
        .collect::<String>()
        .replace("!!opencv-matrix", "");
    let parsed: OpenCv = serde_saphyr::from_str(&yaml).map_err(|error| {
        let cause = format!("is no OpenCV camera file: {}", error.without_snippet());
        let refused = InputError::new(file, cause);
        match error.location() {
            Some(location) => refused.line(location.line()),
            None => refused,
        }
    })?;
    let missing = |key: &str| {
        InputError::new(file, format!("`{key}` is missing"))
            .help("OpenCV's calibration writes image_width, image_height, camera_matrix and distortion_coefficients")
    };
    if parsed.fisheye_model.is_some_and(|flag| flag != 0) {
        return Err(InputError::new(file, "`fisheye_model` is set: this program has no fisheye lens")
            .help("calibrate again without the fisheye model, or give photos of a target"));
    }
    let width = parsed.image_width.ok_or_else(|| missing("image_width"))?;
    let height = parsed.image_height.ok_or_else(|| missing("image_height"))?;
    let k = parsed.camera_matrix.ok_or_else(|| missing("camera_matrix"))?;
    if (k.rows, k.cols, k.data.len()) != (3, 3, 9) {
        let cause =
            format!("`camera_matrix` is {} × {} with {} numbers, not 3 × 3", k.rows, k.cols, k.data.len());
        return Err(InputError::new(file, cause));
    }
    let [fx, skew, cx, zero_a, fy, cy, zero_b, zero_c, one] = std::array::from_fn(|i| k.data[i]);
    if [zero_a, zero_b, zero_c, one] != [0.0, 0.0, 0.0, 1.0] {
        return Err(InputError::new(
            file,
            "`camera_matrix` is not upper triangular with 1 in its last place",
        ));
    }
    let lens = parsed.distortion_coefficients.ok_or_else(|| missing("distortion_coefficients"))?;
    let coefficients = lens.data;
    if lens.rows * lens.cols != coefficients.len() || ![0, 4, 5, 8, 12, 14].contains(&coefficients.len()) {
        let cause = format!(
            "`distortion_coefficients` is {} × {} with {} numbers; OpenCV writes 4, 5, 8, 12 or 14",
            lens.rows,
            lens.cols,
            coefficients.len()
        );
        return Err(InputError::new(file, cause));
    }
    let beyond = ["k4", "k5", "k6", "s1", "s2", "s3", "s4", "τx", "τy"];
    if let Some((name, value)) =
        beyond.iter().zip(coefficients.iter().skip(5)).find(|(_, value)| **value != 0.0)
    {
        let cause =
            format!("`distortion_coefficients` has {name} = {value}: this program's lens ends with k3");
        return Err(InputError::new(file, cause).help("calibrate again with 5 coefficients (k1 k2 p1 p2 k3)"));
    }
    let term = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
    let interior = [fx, fy, skew, cx, cy, term(0), term(1), term(2), term(3), term(4)];
    camera(file, interior, width, height, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper(covariance: Option<InteriorCovariance>) -> Camera {
        let interior =
            [743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018];
        Camera::new(Brown::new(interior).unwrap(), 1152, 648, covariance).unwrap()
    }

    /// Full of numbers that no short decimal holds.
    fn awkward_covariance() -> InteriorCovariance {
        let factor = InteriorCovariance::from_fn(|i, j| {
            let scale = [1.0, 1.0, 0.3, 0.7, 0.8, 1e-2, 0.1, 4e-4, 4e-4, 0.35][i];
            scale * (((i * 7 + j * 13) % 11) as f64 / 3.0 - 1.7)
        });
        let product = factor * factor.transpose();
        0.5 * (product + product.transpose())
    }

    fn read(text: &str) -> Result<Camera, InputError> {
        camera_from_text(Path::new("camera.file"), text)
    }

    #[test]
    fn our_format_comes_back_to_the_last_bit() {
        for covariance in [None, Some(awkward_covariance())] {
            let camera = paper(covariance);
            let text = camera_json(&camera, serde_json::json!({ "method": "test" }));
            assert_eq!(read(&text).unwrap(), camera);
            assert!(text.contains("\"fx_px\": 743.7937"), "shortest numbers: {text}");
        }
    }

    #[test]
    fn opencvs_format_comes_back_to_the_last_bit_without_its_covariance() {
        let text = camera_opencv_yaml(&paper(Some(awkward_covariance())));
        assert_eq!(read(&text).unwrap(), paper(None));
        assert!(text.starts_with("%YAML:1.0\n---\n") && text.contains("camera.json"));
    }

    #[test]
    fn opencvs_own_file_is_read() {
        let text = "%YAML:1.0\n---\nnframes: 13\nimage_width: 640\nimage_height: 480\nflags: 2\n\
            camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
            data: [ 5.3591573396163199e+02, 0., 3.4228315473308373e+02, 0.,\n       \
            5.3591573396163199e+02, 2.3557082909788173e+02, 0., 0., 1. ]\n\
            distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   \
            data: [ -2.6637260909660682e-01, -3.8588898922304653e-02,\n       1.7831947042852964e-03, \
            -2.8122100441115472e-04,\n       2.3839153080878486e-01 ]\n";
        let camera = read(text).unwrap();
        assert_eq!((camera.width, camera.height), (640, 480));
        assert_eq!(
            camera.brown.interior()[..5],
            [535.915_733_961_632, 535.915_733_961_632, 0.0, 342.28315473308373, 235.57082909788173]
        );
        assert_eq!(camera.brown.interior()[9], 0.23839153080878486);
        let fisheye = format!("{text}fisheye_model: 1\n");
        assert!(read(&fisheye).unwrap_err().cause.contains("fisheye"));
        let rational =
            text.replace("rows: 5", "rows: 8").replace("2.3839153080878486e-01 ]", "0.2, 0.5, 0., 0. ]");
        assert!(read(&rational).unwrap_err().cause.contains("k4 = 0.5"));
        let harmless = rational.replace("0.5, 0., 0. ]", "0., 0., 0. ]");
        assert_eq!(read(&harmless).unwrap().brown.interior()[9], 0.2);
        let unsized_image = text.replace("image_width: 640\n", "");
        assert!(read(&unsized_image).unwrap_err().cause.contains("image_width"));
        let broken = text.replace("rows: 3", "rows: three");
        let error = read(&broken).unwrap_err();
        assert_eq!(error.line, Some(8), "{error}");
    }

    #[test]
    fn what_is_wrong_with_a_file_is_said() {
        let good = camera_json(&paper(Some(awkward_covariance())), serde_json::Value::Null);
        let say = |from: &str, to: &str| {
            assert!(good.contains(from), "{from}");
            read(&good.replacen(from, to, 1)).unwrap_err().to_string()
        };
        assert!(say("boresight-camera", "other").contains("`format` is \"other\""));
        assert!(say("\"version\": 1", "\"version\": 2").contains("this program reads 1"));
        assert!(say("centre_of_top_left_pixel", "corner").contains("pixel_origin"));
        assert!(say("\"k3\"", "\"k9\"").contains("k9"));
        assert!(say("743.7937", "-743.7937").contains("fx_px"));
        assert!(say("743.7937", "null").contains("line 8"), "{}", say("743.7937", "null"));
        assert!(say("\"image_width_px\": 1152", "\"image_width_px\": 0").contains("no pixels"));
        assert!(read("hello").unwrap_err().help.unwrap().contains("camera_matrix"));
        assert!(read("{").unwrap_err().line.is_some());
        let mut broken = awkward_covariance();
        broken[(2, 5)] *= 1.5;
        let text = camera_json(&paper(Some(broken)), serde_json::Value::Null);
        assert!(read(&text).unwrap_err().cause.contains("not symmetric for skew_px and k1"));
    }
}
