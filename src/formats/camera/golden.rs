//! Files of other programs against what those programs make of them.
//!
//! All points are seen by cameras of 4608 × 3456 px unless a test says otherwise. The numbers of orthority are what its
//! `FrameCamera._camera_to_pixel` (0.7.0) gives, those of DJI what `cv2.projectPoints` (4.14.0) gives with the matrix of
//! DJI's guide; the others are the formulas of each program's own documentation, written down once more in numpy, and
//! half a pixel less where the program counts from the image's corner:
//!
//! ```text
//! OpenSfM    u = fx·x_d + c_x;  column = u·max(w, h) − 0.5 + w/2
//! Metashape  u = w·0.5 + cx + x'·f + x'·B1 + y'·B2 − 0.5
//! Pix4D      u = f·x_hd + cx − 0.5, f and cx those of calibrated_camera_parameters.txt of the same project
//! COLMAP     u = f1·x_d + cx − 0.5
//! Kalibr     u = fu·x_d + pu
//! ```

use super::*;
use nalgebra::Vector3;

const POINTS: [[f64; 3]; 3] = [[0.31, -0.22, 1.0], [-0.42, 0.35, 1.2], [0.05, 0.4, 0.9]];

fn chosen(text: &str, choice: CameraChoice) -> Result<Camera, InputError> {
    camera_from_text(Path::new("camera.file"), text, &choice)
}

fn named(text: &str, name: &str) -> Result<Camera, InputError> {
    chosen(text, CameraChoice { name: Some(name), ..CameraChoice::default() })
}

fn sees(camera: Camera, pixels: [[f64; 2]; 3]) {
    for (point, [column, row]) in POINTS.into_iter().zip(pixels) {
        let pixel = camera.lens.pixel_from_point(&Vector3::from(point)).unwrap();
        let error = f64::hypot(pixel.column - column, pixel.row - row);
        assert!(error < 1e-8, "{pixel:?}, not ({column}, {row})");
    }
}

const ORTHORITY: &str = "the brown one:\n  type: brown\n  im_size: [4608, 3456]\n  focal_len: 8.8\n  sensor_size: [13.2, 9.88]\n  \
    cx: -0.0046\n  cy: 0.0113\n  k1: -0.27\n  k2: 0.11\n  p1: 3.7e-5\n  p2: -3.2e-4\n  k3: -0.03\nround:\n  type: fisheye\n  \
    im_size:\n  - 4608\n  - 3456\n  focal_len: 0.62\n  cx: -0.0046\n  cy: 0.0113\n  k1: -0.02\n  k2: 0.011\n  k3: -3.0e-3\n  k4: \
    2.0e-4\nmany:\n  type: opencv\n  im_size: [4608, 3456]\n  focal_len: [0.62, 0.63]\n  cx: -0.0046\n  cy: 0.0113\n  k1: -0.2\n  \
    k2: 0.1\n  p1: 1e-3\n  p2: -2e-3\n  k3: 0.05\n  k4: 0.3\n  k5: -0.05\n  k6: 0.02\n  s1: 1e-2\n  s2: -3e-3\n  s3: -8e-3\n  s4: \
    2e-3\n";

#[test]
fn orthoritys_cameras_see_what_orthority_sees() {
    let brown = [
        [3199.223056540787, 1127.4512853837134],
        [1262.0860519124735, 2631.325626653653],
        [2444.24198774294, 3079.3069538367963],
    ];
    sees(named(ORTHORITY, "the brown one").unwrap(), brown);
    let fisheye = [
        [3126.5794639391606, 1180.4065997851117],
        [1347.1389252945332, 2558.8739622545554],
        [2431.048198122593, 2969.530384980747],
    ];
    sees(named(ORTHORITY, "round").unwrap(), fisheye);
    let opencv = [
        [3110.9466773370523, 1181.4532126135523],
        [1376.2875496932404, 2546.497671983724],
        [2431.2675836062144, 2952.1941067981093],
    ];
    sees(named(ORTHORITY, "many").unwrap(), opencv);
    let several = chosen(ORTHORITY, CameraChoice::default()).unwrap_err();
    assert_eq!(several.cause, "holds 3 cameras: \"many\", \"round\", \"the brown one\"");
    assert!(named(ORTHORITY, "other").unwrap_err().cause.contains("no camera \"other\"; it has \"many\""));
    let tilted = ORTHORITY.replace("s4: 2e-3", "s4: 2e-3\n  tx: 0.1");
    assert!(named(&tilted, "many").unwrap_err().cause.contains("τx = 0.1"));
    let alien = ORTHORITY.replace("k3: -0.03", "k3: -0.03\n  k4: 0.1");
    assert!(named(&alien, "the brown one").unwrap_err().cause.contains("`k4` is no key of a brown camera"));
    let upright =
        ORTHORITY.replace("focal_len: 0.62", "focal_len: 0.62 # no sensor").replace("- 3456", "- 5000");
    assert!(named(&upright, "round").unwrap_err().cause.contains("higher than wide"));
}

const OPENSFM: &str = r#"{
  "v2 dji fc6310 4608 3456 brown 0.61": {"projection_type": "brown", "width": 4608, "height": 3456, "focal_x": 0.61,
    "focal_y": 0.615, "c_x": -0.0046, "c_y": 0.0113, "k1": -0.27, "k2": 0.11, "p1": 3.7e-05, "p2": -0.00032, "k3": -0.03},
  "plain": {"projection_type": "perspective", "width": 4608, "height": 3456, "focal": 0.61, "k1": -0.27, "k2": 0.11,
    "k1_prior": 0.5},
  "round": {"projection_type": "fisheye", "width": 4608, "height": 3456, "focal": 0.61, "k1": -0.02, "k2": 0.011},
  "rounder": {"projection_type": "fisheye_opencv", "width": 4608, "height": 3456, "focal_x": 0.61, "focal_y": 0.615,
    "c_x": -0.0046, "c_y": 0.0113, "k1": -0.02, "k2": 0.011, "k3": -0.003, "k4": 0.0002},
  "ball": {"projection_type": "spherical", "width": 4608, "height": 3456, "focal": 1.0}
}"#;

#[test]
fn opensfms_cameras_see_what_opensfm_sees() {
    let brown = [
        [3121.2848687348205, 1179.205829661897],
        [1348.8045094999138, 2563.727234574686],
        [2430.4771907847903, 2976.155134609567],
    ];
    let perspective = [
        [3142.877583217792, 1131.8126828776958],
        [1370.1656711181113, 2505.278607401574],
        [2451.892685261393, 2914.641482091145],
    ];
    let fisheye = [
        [3134.1645945946025, 1137.9960941586692],
        [1383.402321662385, 2494.2480652813456],
        [2449.8483124334875, 2898.286499467902],
    ];
    let opencv = [
        [3112.9621048433683, 1185.2385659158767],
        [1362.2222200478475, 2552.5892561073415],
        [2428.649085249648, 2959.9339334889664],
    ];
    // With and without what OpenSfM puts before its names.
    sees(named(OPENSFM, "v2 dji fc6310 4608 3456 brown 0.61").unwrap(), brown);
    sees(named(OPENSFM, "dji fc6310 4608 3456 brown 0.61").unwrap(), brown);
    sees(named(OPENSFM, "plain").unwrap(), perspective);
    sees(named(OPENSFM, "round").unwrap(), fisheye);
    sees(named(OPENSFM, "rounder").unwrap(), opencv);
    assert!(named(OPENSFM, "ball").unwrap_err().cause.contains("spherical"));
    let reconstruction = format!("[{{\"cameras\": {OPENSFM}, \"shots\": {{}}, \"points\": {{}}}}]");
    sees(named(&reconstruction, "rounder").unwrap(), opencv);
    let two = format!("[{0}, {0}]", &reconstruction[1..reconstruction.len() - 1]);
    assert!(named(&two, "rounder").unwrap_err().cause.contains("exactly one"));
    let other_size = CameraChoice { name: Some("plain"), image_size: Some((2304, 1728)) };
    assert_eq!(
        chosen(OPENSFM, other_size).unwrap_err().cause,
        "is for images of 4608 × 3456 px, not 2304 × 1728 px"
    );
}

const METASHAPE: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="2">
  <sensor id="0" label="M3M &amp; lens (12.29mm)" type="frame">
    <resolution width="4608" height="3456"/>
    <property name="focal_length" value="12.28999999"/>
    <calibration type="frame" class="initial">
      <resolution width="4608" height="3456"/><f>3700</f>
    </calibration>
    <calibration type="frame" class="adjusted">
      <resolution width="4608" height="3456"/>
      <f>3705.4728792737214</f><cx>11.6738523909</cx><cy>-27.7497969199</cy>
      <b1>0.5262024073</b1><b2>-0.3058334293</b2>
      <k1>-0.0919367147</k1><k2>-0.0762807468</k2><k3>0.1162639394</k3><k4>0</k4>
      <p1>-0.0003134847</p1><p2>0.0001164035</p2>
    </calibration>
    <covariance><params>f cx</params><coeffs>1 0 0 1</coeffs></covariance>
  </sensor>
  <sensor id="1" label="round" type="fisheye">
    <calibration type="fisheye" class="adjusted">
      <resolution width="4608" height="3456"/>
      <f>2105.5</f><cx>11.67</cx><cy>-27.75</cy><b1>0.5</b1><b2>-0.3</b2>
      <k1>-0.02</k1><k2>0.011</k2><k3>-0.003</k3><k4>0.0002</k4>
    </calibration>
  </sensor>
</sensors></chunk></document>"#;

#[test]
fn metashapes_cameras_see_what_its_manual_says() {
    let frame = [
        [3446.96055660935, 896.6510195674512],
        [1045.0401828301412, 2757.8604786932347],
        [2516.474351539859, 3312.9413978737202],
    ];
    let camera = named(METASHAPE, "M3M & lens (12.29mm)").unwrap();
    // B1 and B2 are fx, fy and the skew, and P1, P2 change places.
    let [fx, fy, skew, _, _, _, _, p1, p2, ..] = camera.lens.interior();
    assert_eq!([fx, fy, skew], [3705.4728792737214 + 0.5262024073, 3705.4728792737214, -0.3058334293]);
    assert_eq!([p1, p2], [0.0001164035, -0.0003134847]);
    sees(camera, frame);
    let fisheye = [
        [2937.588781150572, 1258.1829562358425],
        [1625.7344623661554, 2274.075034416641],
        [2424.692001725851, 2576.717387844759],
    ];
    sees(named(METASHAPE, "round").unwrap(), fisheye);
    assert!(chosen(METASHAPE, CameraChoice::default()).unwrap_err().cause.contains("holds 2 cameras"));
    let lone = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<calibration>\n  <projection>frame</projection>\n  \
        <width>4608</width>\n  <height>3456</height>\n  <f>3705.4728792737214</f>\n  <cx>11.6738523909</cx>\n  \
        <cy>-27.7497969199</cy>\n  <b1>0.5262024073</b1>\n  <b2>-0.3058334293</b2>\n  <k1>-0.0919367147</k1>\n  \
        <k2>-0.0762807468</k2>\n  <k3>0.1162639394</k3>\n  <p1>-0.0003134847</p1>\n  <p2>0.0001164035</p2>\n  \
        <date>2022-05-26T08:27:27Z</date>\n</calibration>\n";
    sees(chosen(lone, CameraChoice::default()).unwrap(), frame);
    let refused = |from: &str, to: &str| {
        assert!(lone.contains(from), "{from}");
        chosen(&lone.replace(from, to), CameraChoice::default()).unwrap_err()
    };
    // geograypher's sample of a Mavic 3M has this K4: a term of no lens of ours.
    let k4 = refused("<p1>", "<k4>-0.0761413904</k4><p1>");
    assert!(k4.cause.starts_with("k4 = -0.0761413904") && k4.help.unwrap().contains("fixed at zero"));
    assert!(refused("<b1>", "<p3>1e-5</p3><b1>").cause.starts_with("p3 = 0.00001"));
    assert!(refused("<f>", "<fx>1</fx><f>").cause.contains("PhotoScan"));
    assert!(refused("<projection>frame", "<projection>spherical").cause.contains("spherical"));
    assert!(refused("<width>4608</width>", "").cause.contains("how many pixels"));
    assert!(refused("<cx>11", "<cx>x11").cause.contains("<cx> is \"x11.6738523909\""));
    assert_eq!(refused("<cx>11", "<cx>x11").line, Some(7));
    assert!(refused("<cx>11", "<cx>&#49;1").cause.contains("reference"));
    assert!(refused("<f>3705.4728792737214</f>", "").cause.contains("no <f>"));
}

/// EasyIDP's sample of a maize field: the same project's camera matrix has f 3952.81…, (2233.46…, 1667.92…).
const PIX4D: &str = "Pix4D camera calibration file 0\n\
    #Focal Length mm assuming a sensor width of 17.49998592000000030566x13.12498944000000200560mm\n\
    F 15.01175404934517487732\n#Principal Point mm\nPx 8.48210511970419922534\nPy 6.33434629978042273990\n\
    #Symmetrical Lens Distortion Coeffs\nK1 0.03833474118270804865\nK2 -0.01750917966495743258\n\
    K3 0.02049798716391852335\n#Tangential Lens Distortion Coeffs\nT1 0.00240851666319534747\nT2 0.00292562392135245920\n";

#[test]
fn pix4ds_camera_sees_what_its_matrix_says() {
    let pixels = [
        [3467.3438605912334, 793.9733611829465],
        [842.548354729877, 2830.0791256774223],
        [2456.99395458634, 3443.036609637632],
    ];
    let sized = CameraChoice { image_size: Some((4608, 3456)), ..CameraChoice::default() };
    sees(chosen(PIX4D, sized).unwrap(), pixels);
    let unsized_image = chosen(PIX4D, CameraChoice::default()).unwrap_err();
    assert!(unsized_image.cause.contains("how many pixels") && unsized_image.help.is_some());
    let two = format!("{PIX4D}\n{}", PIX4D.replace("file 0", "file 1").replace("F 15", "F 16"));
    assert_eq!(chosen(&two, sized).unwrap_err().cause, "holds 2 cameras: \"0\", \"1\"");
    sees(chosen(&two, CameraChoice { name: Some("0"), ..sized }).unwrap(), pixels);
    let incomplete = chosen(&PIX4D.replace("T2", "#"), sized).unwrap_err();
    assert_eq!((incomplete.cause.as_str(), incomplete.line), ("T2 is missing", Some(1)));
    assert_eq!(chosen(&PIX4D.replace("K2 ", "K2 -"), sized).unwrap_err().line, Some(9));
    let other =
        "camera_calibration_file 0\n#Focal Length mm assuming a sensor width of 17.5x13.1mm\nFOCAL 15.0\n";
    assert!(chosen(other, sized).unwrap_err().help.unwrap().contains("_pix4d_calibrated_internal"));
}

#[test]
fn djis_numbers_are_those_of_its_guide() {
    // A Phantom 4 RTK's line.
    let line = "2018-03-13;3659.780000000000,3653.170000000000,-7.710000000000,45.900000000000,-0.269478000000,\
        0.115681000000,-0.000087561900,-0.000306177000,-0.035762800000";
    let sized = CameraChoice { image_size: Some((5472, 3648)), ..CameraChoice::default() };
    let pixels = [
        [3820.928025800019, 1095.7190431835952],
        [1512.5996434606704, 2880.8856901733243],
        [2921.2595558509543, 3412.599215187356],
    ];
    sees(chosen(line, sized).unwrap(), pixels);
    sees(camera_from_dewarp_data(Path::new("photo.jpg"), &format!(" {line} "), &sized).unwrap(), pixels);
    let longer = chosen(&format!("{line},0.1,0.2,0.3"), sized).unwrap();
    assert_eq!((longer.lens.kind(), longer.lens.interior()[12]), (LensKind::Rational, 0.3));
    assert!(chosen(line, CameraChoice::default()).unwrap_err().cause.contains("how many pixels"));
    let refused =
        |text: &str| camera_from_dewarp_data(Path::new("photo.jpg"), text, &sized).unwrap_err().cause;
    assert!(refused("2018-03-13;0,0,0,0,0,0,0,0,0").contains("not calibrated"));
    assert!(refused("2018-03-13;1,2,3,4,5,6,7,8,9,10").contains("10 numbers"));
    assert!(refused("2018-03-13;1,2,3,4,five,6,7,8,9").contains("\"five\""));
    assert!(refused("1,2,3").contains("is no DewarpData"));
}

const COLMAP: &str = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\
    # Number of cameras: 4\n7 FULL_OPENCV 4608 3456 3700.5 3701.25 2300.25 1730.75 -0.2 0.1 0.001 -0.002 0.05 0.3 -0.05 0.02\n\
    8 SIMPLE_RADIAL 4608 3456 3700.5 2300.25 1730.75 -0.15\n\
    9 OPENCV_FISHEYE 4608 3456 2100.5 2101.25 2300.25 1730.75 -0.02 0.011 -0.003 0.0002\n\
    10 FOV 4608 3456 2100.5 2101.25 2300.25 1730.75 0.9\n";

#[test]
fn colmaps_cameras_see_what_its_models_say() {
    let full = [
        [3367.941587003866, 971.8006249790232],
        [1119.0232762430244, 2713.876178993029],
        [2485.720256912634, 3230.9366782207817],
    ];
    let radial = [
        [3422.040415375, 933.78583425],
        [1044.90081328125, 2775.9576555989584],
        [2499.1467978395062, 3325.42438271605],
    ];
    let fisheye = [
        [2920.4805290953345, 1289.5742694327068],
        [1612.1966009258679, 2303.41574617334],
        [2409.110603073374, 2605.4472090756585],
    ];
    sees(named(COLMAP, "7").unwrap(), full);
    sees(named(COLMAP, "8").unwrap(), radial);
    sees(named(COLMAP, "9").unwrap(), fisheye);
    let fov = named(COLMAP, "10").unwrap_err();
    assert!(fov.cause.contains("\"FOV\"; this program knows SIMPLE_PINHOLE, PINHOLE") && fov.line == Some(7));
    assert!(
        chosen(COLMAP, CameraChoice::default()).unwrap_err().cause.contains("\"7\", \"8\", \"9\", \"10\"")
    );
    let short = named(&COLMAP.replace(" 0.0002", ""), "9").unwrap_err();
    assert_eq!(short.cause, "OPENCV_FISHEYE has 8 parameters, here are 7");
    // Without its denominator the full model is Brown's.
    let plain = named(&COLMAP.replace("0.3 -0.05 0.02", "0 0 0"), "7").unwrap();
    assert_eq!((plain.lens.kind(), plain.lens.interior()[9]), (LensKind::Brown, 0.05));
}

const KALIBR: &str = "cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_coeffs: [-0.27, 0.11, 3.7e-05, -0.00032]\n  \
    distortion_model: radtan\n  intrinsics: [3700.5, 3701.25, 2300.25, 1730.75]\n  resolution: [4608, 3456]\n  rostopic: \
    /cam0/image_raw\ncam1:\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.1]\n  - [0.0, 1.0, 0.0, 0.0]\n  camera_model: pinhole\n  \
    distortion_coeffs: [-0.02, 0.011, -0.003, 0.0002]\n  distortion_model: equidistant\n  intrinsics: [2100.5, 2101.25, 2300.25, \
    1730.75]\n  resolution: [4608, 3456]\ncam2:\n  camera_model: omni\n  intrinsics: [0.8, 833.0, 830.0, 373.0, 253.0]\n  \
    distortion_model: radtan\n  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n  resolution: [752, 480]\n";

#[test]
fn kalibrs_cameras_see_what_its_models_say() {
    let radtan = [
        [3404.866182470362, 946.5682872025625],
        [1070.9592968621564, 2755.190096496431],
        [2495.369617287672, 3293.9516684128275],
    ];
    let equidistant = [
        [2920.9805290953345, 1290.0742694327068],
        [1612.6966009258679, 2303.91574617334],
        [2409.610603073374, 2605.9472090756585],
    ];
    sees(named(KALIBR, "cam0").unwrap(), radtan);
    sees(named(KALIBR, "cam1").unwrap(), equidistant);
    let omni = named(KALIBR, "cam2").unwrap_err();
    assert!(omni.cause.contains("`camera_model` is \"omni\"") && omni.help.is_some());
    for other in ["eucm", "ds"] {
        let refused = named(&KALIBR.replace("omni", other), "cam2").unwrap_err();
        assert!(refused.cause.contains(other), "{refused}");
    }
    let fov = named(&KALIBR.replace("equidistant", "fov"), "cam1").unwrap_err();
    assert!(fov.cause.contains("`distortion_model` is \"fov\""));
    assert!(chosen(KALIBR, CameraChoice::default()).unwrap_err().cause.contains("holds 3 cameras"));
    let short = named(&KALIBR.replace(", 1730.75]\n  resolution", "]\n  resolution"), "cam0").unwrap_err();
    assert!(short.cause.contains("`intrinsics` has 3 numbers"), "{short}");
}

#[test]
fn a_name_where_there_is_no_choice_is_refused() {
    let json = r#"{"format": "boresight-camera", "version": 1, "model": "brown"}"#;
    assert!(named(json, "x").unwrap_err().cause.contains("holds one camera"));
    let yaml = "%YAML:1.0\n---\ncamera_matrix: 1\n";
    assert!(named(yaml, "x").unwrap_err().cause.contains("holds one camera"));
}
