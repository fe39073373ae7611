//! What is written is read back; what is wrong is said.

use super::*;
use crate::camera::{Brown, Fisheye, Pix4dFisheye, Rational, ThinPrism};

fn paper(covariance: Option<InteriorCovariance>) -> Camera {
    let interior =
        [743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018];
    Camera::new(Brown::new(interior).unwrap(), 1152, 648, covariance).unwrap()
}

/// Full of numbers that no short decimal holds.
fn awkward_covariance() -> InteriorCovariance {
    let factor = InteriorCovariance::from_fn(|i, j| {
        let scale = [1.0, 1.0, 0.3, 0.7, 0.8, 1e-2, 0.1, 4e-4, 4e-4, 0.35].get(i).copied().unwrap_or(0.0);
        scale * (((i * 7 + j * 13) % 11) as f64 / 3.0 - 1.7)
    });
    let product = factor * factor.transpose();
    0.5 * (product + product.transpose())
}

fn read(text: &str) -> Result<Camera, InputError> {
    camera_from_text(Path::new("camera.file"), text, &CameraChoice::default())
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
    let Exported { text, losses } = camera_opencv_yaml(&paper(Some(awkward_covariance()))).unwrap();
    assert!(losses[0].contains("skew") && losses[1].contains("covariance"));
    assert_eq!(read(&text).unwrap(), paper(None));
    assert!(text.starts_with("%YAML:1.0\n---\n") && text.contains("camera.json"));
}

#[test]
fn every_lens_comes_back_from_both_formats() {
    let rational = Rational::new([
        743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.2, 0.1, 1e-3, -2e-3, 0.05, 0.3, -0.05, 0.02,
    ]);
    let fisheye = Fisheye::new([301.5, 299.25, 0.125, 640.5, 480.25, 0.01, -0.02, 0.003, -1e-4]);
    let prism = ThinPrism::new([
        743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.2, 0.1, 1e-3, -2e-3, 0.05, 0.3, -0.05, 0.02,
        1e-3, -2e-3, 3e-3, 4e-4,
    ]);
    let lenses = [Lens::from(rational.unwrap()), fisheye.unwrap().into(), prism.unwrap().into()];
    for lens in lenses {
        let count = lens.names().len();
        let covariance =
            InteriorCovariance::from_fn(|i, j| if i == j && i < count { 0.1 + i as f64 } else { 0.0 });
        let camera = Camera::new(lens, 1280, 960, Some(covariance)).unwrap();
        let text = camera_json(&camera, serde_json::Value::Null);
        assert_eq!(read(&text).unwrap(), camera);
        let without = text.replacen("\"k1\": ", "\"k1\": null, \"p1\": ", 1);
        assert!(read(&without).is_err(), "{without}");
        let bare = Camera { covariance: None, ..camera };
        assert_eq!(read(&camera_opencv_yaml(&bare).unwrap().text).unwrap(), bare);
    }
}

#[test]
fn pix4ds_fisheye_comes_back_with_its_covariance() {
    let lens = Pix4dFisheye::new([1122.25, 1120.5, 0.75, 640.5, 480.25, -0.5, -0.13, -0.03, 0.01]).unwrap();
    let covariance = InteriorCovariance::from_fn(|i, j| if i == j && i < 9 { 0.1 + i as f64 } else { 0.0 });
    let camera = Camera::new(lens, 1280, 960, Some(covariance)).unwrap();
    let text = camera_json(&camera, serde_json::Value::Null);
    assert!(text.contains("\"model\": \"pix4d_fisheye\"") && text.contains("\"row_skew_px\": -0.5"));
    assert_eq!(read(&text).unwrap(), camera);
    let brown = text.replace("pix4d_fisheye", "fisheye");
    assert!(read(&brown).unwrap_err().cause.contains("covariance_order"));
    for format in CameraFormat::ALL {
        let refused = export(&camera, format, "x").unwrap_err().to_string();
        assert!(refused.ends_with(" has no pix4d_fisheye lens"), "{refused}");
    }
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
        camera.lens.interior()[..5],
        [535.915_733_961_632, 535.915_733_961_632, 0.0, 342.28315473308373, 235.57082909788173]
    );
    assert_eq!(camera.lens.interior()[9], 0.23839153080878486);
    let fisheye = format!("{text}fisheye_model: 1\n");
    assert!(read(&fisheye).unwrap_err().cause.contains("OpenCV writes 4 for this model"));
    let rational =
        text.replace("rows: 5", "rows: 8").replace("2.3839153080878486e-01 ]", "0.2, 0.5, 0., 0. ]");
    let camera = read(&rational).unwrap();
    assert_eq!((camera.lens.kind(), camera.lens.interior()[10]), (LensKind::Rational, 0.5));
    let harmless = rational.replace("0.5, 0., 0. ]", "0., 0., 0. ]");
    let camera = read(&harmless).unwrap();
    assert_eq!((camera.lens.kind(), camera.lens.interior()[9]), (LensKind::Brown, 0.2));
    let prism =
        rational.replace("rows: 8", "rows: 12").replace("0.5, 0., 0. ]", "0., 0., 0., 1e-3, 0., 0., 0. ]");
    let camera = read(&prism).unwrap();
    assert_eq!((camera.lens.kind(), camera.lens.interior()[13]), (LensKind::ThinPrism, 1e-3));
    let tilted =
        prism.replace("rows: 12", "rows: 14").replace("1e-3, 0., 0., 0. ]", "0., 0., 0., 0., 0.02, 0. ]");
    assert!(read(&tilted).unwrap_err().cause.contains("τx = 0.02"));
    let level = tilted.replace("0.02, 0. ]", "0., 0. ]");
    assert_eq!(read(&level).unwrap().lens.kind(), LensKind::Brown);
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
    assert!(
        say("\"model\": \"brown\"", "\"model\": \"cubic\"")
            .contains("brown, fisheye, pix4d_fisheye, rational, thin_prism")
    );
    assert!(say("\"model\": \"brown\"", "\"model\": \"fisheye\"").contains("covariance_order"));
    assert!(read("hello").unwrap_err().help.unwrap().contains("camera_matrix"));
    assert!(read("{").unwrap_err().line.is_some());
    let mut broken = awkward_covariance();
    broken[(2, 5)] *= 1.5;
    let text = camera_json(&paper(Some(broken)), serde_json::Value::Null);
    assert!(read(&text).unwrap_err().cause.contains("not symmetric for skew_px and k1"));
}

#[test]
fn other_programs_get_what_they_read() {
    let camera = paper(Some(awkward_covariance()));
    let ros = camera_ros_yaml(&camera, "uav").unwrap();
    let expected = "# ROS has no skew; it is left out: -0.7729 px, which moves columns by up to 0.36 px\n\
        # ROS has no place for the covariance: it is in camera.json\n\
        image_width: 1152\nimage_height: 648\ncamera_name: \"uav\"\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
        data: [743.7937, 0., 566.367, 0., 748.9947, 345.5019, 0., 0., 1.]\ndistortion_model: plumb_bob\n\
        distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.0199, 0.1629, 0.0076, 0.0039, -0.3018]\n\
        rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\n\
        projection_matrix:\n  rows: 3\n  cols: 4\n  \
        data: [743.7937, 0., 566.367, 0., 0., 748.9947, 345.5019, 0., 0., 0., 1., 0.]\n";
    assert_eq!(ros.text, expected);
    assert_eq!(ros.losses.len(), 2);
    let opensfm = camera_opensfm_json(&camera, "v2 uav").unwrap();
    let entry: serde_json::Value = serde_json::from_str(&opensfm.text).unwrap();
    let entry = &entry["v2 uav"];
    assert_eq!((entry["projection_type"].as_str(), entry["k3"].as_f64()), (Some("brown"), Some(-0.3018)));
    let close = |key: &str, expected: f64| (entry[key].as_f64().unwrap() - expected).abs() < 1e-15;
    assert!(close("focal_x", 743.7937 / 1152.0) && close("focal_y", 748.9947 / 1152.0));
    // The middle of 1152 × 648 pixels is (575.5, 323.5).
    assert!(close("c_x", (566.367 - 575.5) / 1152.0) && close("c_y", (345.5019 - 323.5) / 1152.0));
    assert!(opensfm.losses[0].contains("no skew"));
}

#[test]
fn ros_files_are_read_back_but_for_the_skew() {
    let square = |kind: LensKind| {
        let mut interior = [0.0; MAX_INTERIOR];
        interior[..5].copy_from_slice(&[743.5, 748.25, 0.0, 566.25, 345.5]);
        (5..kind.names().len()).for_each(|k| interior[k] = 0.01 * k as f64);
        Camera::new(Lens::new(kind, &interior).unwrap(), 1152, 648, None).unwrap()
    };
    for camera in [LensKind::Brown, LensKind::Rational, LensKind::Fisheye].map(square) {
        let ros = camera_ros_yaml(&camera, "a \"quoted\" name").unwrap();
        assert!(ros.losses.is_empty());
        assert_eq!(read(&ros.text).unwrap(), camera, "{}", ros.text);
    }
    let unknown = camera_ros_yaml(&square(LensKind::Brown), "x").unwrap().text.replace("plumb_bob", "omni");
    assert!(read(&unknown).unwrap_err().cause.contains("omni"));
    let error = camera_opensfm_json(&square(LensKind::Rational), "x").unwrap_err();
    assert_eq!(error.to_string(), "cameras.json has no rational lens");
    let fisheye = camera_opensfm_json(&square(LensKind::Fisheye), "x").unwrap().text;
    assert!(fisheye.contains("fisheye_opencv") && fisheye.contains("\"k4\""));
}
