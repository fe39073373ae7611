//! One golden frame for each maker: the documented form of its tags in, our angles and heights out.
//!
//! Rotations were computed outside this program by the closed form of Rz·Ry·Rx.

use super::build::{Exif, attributes, elements, finds, jpeg, origin, packet, parse};
use crate::formats::flight::{Clock, LoggedAttitude, LoggedPosition, North};
use crate::formats::metadata::{PhotoMetadata, Severity, TurnEvidence, flight_log, normalised_gimbal};
use crate::geodesy::{GeoidModel, HeightKind};
use crate::geometry::{Camera, Displacement, Gimbal, Ned, Rotation};
use crate::navigation::{GimbalAngles, GimbalReference, Mount};
use crate::units::{Radians, Seconds};
use proptest::prelude::*;

const DJI: &str = "http://www.dji.com/drone-dji/1.0/";
const SEA: HeightKind = HeightKind::SeaLevel(GeoidModel::Egm96);

fn position(photo: &PhotoMetadata) -> (f64, f64, f64, HeightKind) {
    match photo.exposure.position {
        Some(LoggedPosition::Geodetic { latitude, longitude, height_m, kind }) => {
            (latitude.degrees(), longitude.degrees(), height_m, kind)
        }
        other => panic!("{other:?}: {:?}", photo.no_position),
    }
}

/// Image right, image bottom and optical axis in north-east-down.
fn camera_axes(photo: &PhotoMetadata) -> [[f64; 3]; 3] {
    let gimbal = photo.exposure.gimbal.expect("gimbal angles");
    assert_eq!(gimbal.reference, GimbalReference::Nav);
    let ned_from_gimbal: Rotation<Ned, Gimbal> = gimbal.angles.rotation();
    let ned_from_camera: Rotation<Ned, Camera> = ned_from_gimbal * Mount::gimbal_from_camera_axes();
    let m = ned_from_camera.matrix();
    [0, 1, 2].map(|c| [0, 1, 2].map(|r| m[(r, c)]))
}

fn assert_axes(photo: &PhotoMetadata, expected: [[f64; 3]; 3]) {
    let axes = camera_axes(photo);
    for (found, expected) in axes.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-9, "{axes:?}");
    }
}

fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
}

const DJI_RTK: [(&str, &str); 24] = [
    ("Version", "1.6"),
    ("GpsStatus", "RTK"),
    ("AltitudeType", "RtkAlt"),
    ("GpsLatitude", "+22.123456789"),
    ("GpsLongitude", "+113.987654321"),
    ("AbsoluteAltitude", "+121.668"),
    ("RelativeAltitude", "+109.983"),
    ("GimbalRollDegree", "+3.10"),
    ("GimbalYawDegree", "-120.50"),
    ("GimbalPitchDegree", "-75.20"),
    ("FlightRollDegree", "+7.10"),
    ("FlightYawDegree", "-123.00"),
    ("FlightPitchDegree", "-2.00"),
    ("FlightXSpeed", "+3.0"),
    ("FlightYSpeed", "-4.0"),
    ("FlightZSpeed", "+0.2"),
    ("CamReverse", "0"),
    ("RtkFlag", "50"),
    ("RtkStdLon", "0.01370"),
    ("RtkStdLat", "0.01439"),
    ("RtkStdHgt", "0.02969"),
    (
        "DewarpData",
        "2022-06-08;3713.29,3710.11,7.02,-8.72,-0.11257524,0.01487443,-0.00008572,0.00000010,-0.02706411",
    ),
    ("DewarpFlag", "0"),
    ("UTCAtExposure", "2022-08-15T10:13:56.123456"),
];

#[test]
fn dji_with_rtk() {
    for text in [attributes(DJI, &DJI_RTK), elements(DJI, &DJI_RTK)] {
        let exif = Exif::little().text(0x10F, "DJI").text(0x110, "M3E").short(0x112, 1).with_gps();
        let photo = parse(&jpeg(Some(&exif), Some(&text), (5280, 3956)));
        let (lat, lon, height, kind) = position(&photo);
        near(lat, 22.123_456_789);
        near(lon, 113.987_654_321);
        assert_eq!((height, kind), (121.668, HeightKind::Ellipsoid));
        assert!(origin(&photo, "height").1.contains("AltitudeType is RtkAlt"));
        assert_eq!(photo.exposure.height_above_takeoff_m, Some(109.983));
        assert_axes(
            &photo,
            [
                [0.886904784288, -0.461745678261, 0.013814203371],
                [0.443386021882, 0.859271279962, 0.255071956578],
                [-0.129648521808, -0.220099513949, 0.966823388604],
            ],
        );
        let Some(LoggedAttitude::Body { angles, north: North::True }) = photo.exposure.attitude else {
            panic!()
        };
        near(angles.yaw.degrees(), -123.0);
        near(angles.pitch.degrees(), -2.0);
        near(angles.roll.degrees(), 7.1);
        let std = photo.exposure.std;
        assert_eq!((std.north_m, std.east_m, std.up_m), (Some(0.01439), Some(0.0137), Some(0.02969)));
        near(photo.exposure.ground_speed_m_s.unwrap(), 5.0);
        // date -u -d '2022-08-15T10:13:56Z' +%s
        let time = photo.times.utc(None).unwrap();
        assert!(
            (time.time.get() - 1_660_558_436.123_456).abs() < 1e-6
                && (time.resolution_s - 1e-6).abs() < 1e-12
        );
        let dewarp = photo.optics.dewarp.as_ref().unwrap();
        assert_eq!((dewarp.fx, dewarp.cy_from_middle, dewarp.applied), (3713.29, -8.72, Some(false)));
        assert_eq!(dewarp.distortion, [-0.11257524, 0.01487443, -0.00008572, 0.0000001, -0.02706411]);
        assert_eq!(photo.optics.focal_length_px.as_ref().unwrap().x, 3713.29);
        assert!(!photo.findings.iter().any(|f| f.severity >= Severity::Warning), "{:?}", photo.findings);
    }
}

fn dji_with(changes: &[(&str, &str)]) -> PhotoMetadata {
    let kept = DJI_RTK.iter().filter(|(name, _)| !changes.iter().any(|(n, _)| n == name));
    let list: Vec<_> = kept.chain(changes.iter().filter(|(_, v)| !v.is_empty())).copied().collect();
    parse(&jpeg(None, Some(&attributes(DJI, &list)), (5280, 3956)))
}

#[test]
fn dewarp_data_is_opencv_s_lens_about_the_middle() {
    // Computed outside this program by OpenCV's formula, pixel (0, 0) being the middle of the first.
    let photo = dji_with(&[]);
    let dewarp = photo.optics.dewarp.unwrap();
    let ray = Displacement::new(0.2, -0.15, 1.0);
    for (stored, column, row) in [
        ((5280, 3956), 3384.0100884587428, 1416.1162548474279),
        ((2640, 1978), 1691.7550442293714, 707.8081274237139),
    ] {
        let camera = dewarp.camera(stored, Some((5280, 3956))).unwrap();
        let pixel = camera.pixel_from_ray(ray).unwrap();
        assert!((pixel.column - column).abs() < 1e-9 && (pixel.row - row).abs() < 1e-9, "{pixel:?}");
    }
    assert!(dewarp.camera((5280, 2970), Some((5280, 3956))).unwrap_err().contains("another shape"));
    assert!(dewarp.camera((5280, 3956), Some((0, 0))).is_err());
    let corrected = dji_with(&[("DewarpFlag", "1")]).optics.dewarp.unwrap();
    assert!(corrected.camera((5280, 3956), None).unwrap_err().contains("corrected already"));
}

#[test]
fn dji_s_height_is_the_ellipsoid_s_only_by_rtk() {
    assert_eq!(position(&dji_with(&[("AltitudeType", "")])).3, HeightKind::Ellipsoid);
    let fused = dji_with(&[("AltitudeType", "GPSFusionAlt")]);
    assert_eq!(position(&fused).3, SEA);
    assert!(origin(&fused, "height").1.starts_with("assumed"));
    assert_eq!(position(&dji_with(&[("AltitudeType", ""), ("RtkFlag", "0")])).3, SEA);
    assert_eq!(position(&dji_with(&[("AltitudeType", ""), ("RtkFlag", "")])).3, SEA);
    assert!(finds(&dji_with(&[("RtkFlag", "16")]), Severity::Warning, "RtkFlag is 16"));
    assert!(finds(&dji_with(&[("DewarpFlag", "1")]), Severity::Note, "corrected already"));
    assert!(finds(&dji_with(&[("CamReverse", "1")]), Severity::Warning, "upside down"));
    // The misspelling of older firmware.
    let misspelt = dji_with(&[("GpsLongitude", ""), ("GpsLongtitude", "11.5")]);
    near(position(&misspelt).1, 11.5);
}

#[test]
fn a_photo_without_an_absolute_height_keeps_the_relative_one() {
    let photo = dji_with(&[("AbsoluteAltitude", ""), ("RtkFlag", "")]);
    let (_, _, height, kind) = position(&photo);
    assert_eq!((height, kind), (109.983, HeightKind::AboveTakeoff));
    assert!(
        dji_with(&[("AbsoluteAltitude", ""), ("RelativeAltitude", "")])
            .no_position
            .unwrap()
            .contains("height")
    );
}

#[test]
fn a_gimbal_past_nadir_is_the_same_rotation() {
    let flipped = dji_with(&[
        ("GimbalRollDegree", "180.0"),
        ("GimbalPitchDegree", "-89.9"),
        ("GimbalYawDegree", "30.0"),
    ]);
    let angles = flipped.exposure.gimbal.unwrap().angles;
    near(angles.pan.degrees(), -150.0);
    near(angles.elevation.degrees(), -90.1);
    near(angles.roll.degrees(), 0.0);
    // Closed form of the angles as written.
    assert_axes(
        &flipped,
        [
            [0.49999999999999983, -0.8660254037844388, 0.0],
            [0.8660240847526538, 0.4999992384566437, -0.0017453283658982615],
            [0.0015114987028134765, 0.0008726641829491307, 0.9999984769132877],
        ],
    );
    assert!(finds(&flipped, Severity::Note, "elevation -90.1°, yaw -150.0°, roll 0.0°"));
}

proptest! {
    #[test]
    fn normalising_keeps_the_rotation(y in -400.0..400.0f64, p in -180.0..180.0f64, r in -400.0..400.0f64) {
        let deg = Radians::from_degrees;
        let said = GimbalAngles { pan: deg(y), elevation: deg(p), roll: deg(r) };
        let kept = normalised_gimbal(said);
        prop_assert!(kept.roll.degrees().abs() <= 90.0 + 1e-9);
        let (a, b): (Rotation<Ned, Gimbal>, Rotation<Ned, Gimbal>) = (said.rotation(), kept.rotation());
        prop_assert!((a.matrix() - b.matrix()).norm() < 1e-12);
    }
}

#[test]
fn dji_s_fine_height_is_exif_s() {
    let list = [("AbsoluteAltitude", "+300.3"), ("RelativeAltitude", "+40.10")];
    let exif = Exif::default().text(0x10F, "DJI").with_gps();
    let photo = parse(&jpeg(Some(&exif), Some(&attributes(DJI, &list)), (4000, 3000)));
    let (lat, lon, height, kind) = position(&photo);
    near(lat, 41.0 + 1.0 / 60.0 + 5.25 / 3600.0);
    near(lon, -(83.0 + 18.0 / 60.0 + 30.5 / 3600.0));
    assert_eq!((height, kind), (300.25, SEA));
    assert!(origin(&photo, "height").0.starts_with("EXIF GPSAltitude"));
    // Another number altogether: the maker's own tag counts.
    let list = [("AbsoluteAltitude", "+250.00")];
    let photo = parse(&jpeg(Some(&exif), Some(&attributes(DJI, &list)), (4000, 3000)));
    assert_eq!(position(&photo).2, 250.0);
    assert!(finds(&photo, Severity::Note, "differ"));
}

#[test]
fn autel_s_newer_firmware_writes_dji_s_namespace() {
    let text = packet(&format!(
        "<rdf:Description xmlns:tiff='http://ns.adobe.com/tiff/1.0/' xmlns:drone='{DJI}' tiff:Make='Autel Robotics' \
         tiff:Model='XT705' drone:AbsoluteAltitude='+513.00' drone:GpsLatitude='47.64368732' \
         drone:GpsLongtitude='16.47592717' drone:CalibratedFocalLength='4404.166667' drone:RtkFlag='50' \
         drone:GimbalYawDegree='10' drone:GimbalPitchDegree='-90' drone:GimbalRollDegree='0'/>"
    ));
    let photo = parse(&jpeg(None, Some(&text), (5472, 3648)));
    assert_eq!((photo.make.as_deref(), photo.model.as_deref()), (Some("Autel Robotics"), Some("XT705")));
    let (lat, lon, height, kind) = position(&photo);
    near(lat, 47.643_687_32);
    near(lon, 16.475_927_17);
    assert_eq!((height, kind), (513.0, HeightKind::Ellipsoid));
    assert_eq!(photo.optics.focal_length_px.unwrap().x, 4404.166667);
}

#[test]
fn sensefly_s_autopilot_and_its_course() {
    let uri = "http://ns.sensefly.com/sensefly/1.0/";
    let list = [
        ("Latitude", "41.0347606"),
        ("Longitude", "-83.3054654"),
        ("AltitudeAMSL", "315.753"),
        ("AltitudeWGS84", "283.824"),
        ("Height", "67.875"),
        ("Heading", "30.5"),
        ("PitchAngle", "-1.5"),
        ("RollAngle", "-2.75"),
        ("GroundSpeed", "3.05"),
        ("UTCTime", "2013-06-04T17:38:09"),
        ("AutopilotSN", "7763-046"),
    ];
    let photo_of = |course: &str, exif: Exif| {
        let list: Vec<_> = list.iter().copied().chain([("Course", course)]).collect();
        parse(&jpeg(Some(&exif), Some(&elements(uri, &list)), (1800, 1350)))
    };
    let plain = Exif::little().text(0x10F, "senseFly");
    let photo = photo_of("37.25", plain.clone());
    let (lat, lon, height, kind) = position(&photo);
    near(lat, 41.034_760_6);
    near(lon, -83.305_465_4);
    assert_eq!((height, kind), (315.753, SEA));
    assert!(origin(&photo, "height by GPS").1.contains("283.824 m above the ellipsoid"));
    let Some(LoggedAttitude::Body { angles, north: North::True }) = photo.exposure.attitude else { panic!() };
    near(angles.yaw.degrees(), 30.5);
    near(angles.pitch.degrees(), -1.5);
    near(angles.roll.degrees(), -2.75);
    assert_eq!(photo.exposure.height_above_takeoff_m, Some(67.875));
    assert_eq!(photo.times.utc(None).unwrap().time.get(), 1_370_367_489.0);
    assert_eq!(photo.vehicle_serial.as_deref(), Some("7763-046"));
    // A unit without a compass.
    let north = |photo: &PhotoMetadata| match photo.exposure.attitude {
        Some(LoggedAttitude::Body { north, .. }) => north,
        other => panic!("{other:?}"),
    };
    let photo = photo_of("0.000", plain.clone());
    assert_eq!(north(&photo), North::Course);
    assert!(origin(&photo, "UAV yaw").1.contains("Course is 0"));
    let photo = photo_of("12.0", plain.rationals(0xF, &[(61, 2)]));
    assert_eq!(north(&photo), North::Course);
    assert!(origin(&photo, "UAV yaw").1.contains("GPSTrack"));
}

#[test]
fn pix4d_s_camera_of_a_sequoia() {
    let text = packet(
        "<rdf:Description xmlns:Camera='http://pix4d.com/camera/1.0' Camera:Yaw='95.5' Camera:Pitch='4.25' \
         Camera:Roll='-3.5' Camera:GPSXYAccuracy='175/100' Camera:GPSZAccuracy='3/1' Camera:ModelType='fisheye' \
         Camera:PrincipalPoint='2.42299,1.850154' Camera:FisheyeAffineMatrix='1583.319083002,0,0,1583.319083002' \
         Camera:FisheyePolynomial='0,1,-0.025178575,0.167834214' Camera:RigRelatives='0.3836, -1.27665, -0.1156' \
         Camera:RigName='Sequoia' Camera:RigCameraIndex='2' Camera:AboveGroundAltitude='61.5'>\
         <Camera:BandName><rdf:Seq><rdf:li>Rededge</rdf:li></rdf:Seq></Camera:BandName>\
         <Camera:CentralWavelength><rdf:Seq><rdf:li>735</rdf:li></rdf:Seq></Camera:CentralWavelength>\
         </rdf:Description>",
    );
    let exif = Exif::default().text(0x10F, "Parrot").text(0x110, "Sequoia").with_gps();
    let photo = parse(&jpeg(Some(&exif), Some(&text), (1280, 960)));
    let Some(LoggedAttitude::Camera { angles, north: North::True }) = photo.exposure.attitude else {
        panic!()
    };
    near(angles.yaw.degrees(), 95.5);
    near(angles.pitch.degrees(), 4.25);
    near(angles.roll.degrees(), -3.5);
    let std = photo.exposure.std;
    assert_eq!((std.north_m, std.east_m, std.up_m), (Some(1.75), Some(1.75), Some(3.0)));
    assert_eq!(photo.exposure.height_above_ground_m, Some(61.5));
    let camera = photo.optics.pix4d.unwrap();
    assert_eq!(camera.principal_point_mm, Some([2.42299, 1.850154]));
    assert_eq!(camera.fisheye_affine, Some([1583.319083002, 0.0, 0.0, 1583.319083002]));
    assert_eq!(camera.fisheye_polynomial, [0.0, 1.0, -0.025178575, 0.167834214]);
    assert_eq!(camera.rig_relatives_deg, Some([0.3836, -1.27665, -0.1156]));
    assert_eq!((camera.bands, camera.wavelengths_nm), (vec!["Rededge".to_owned()], vec![735.0]));
    assert_eq!(camera.model.as_deref(), Some("fisheye"));
}

#[test]
fn a_pitch_counted_from_the_horizon_is_suspected() {
    let text = attributes("http://pix4d.com/camera/1.0/", &[("Yaw", "1"), ("Pitch", "-89.5"), ("Roll", "0")]);
    let photo = parse(&jpeg(Some(&Exif::default().with_gps()), Some(&text), (1280, 960)));
    assert!(finds(&photo, Severity::Warning, "Camera:Pitch is -89.5°"));
}

#[test]
fn sensefly_s_camera_namespace_says_that_its_roll_is_disputed() {
    let text =
        attributes("http://ns.sensefly.com/Camera/1.0/", &[("Yaw", "1"), ("Pitch", "2"), ("Roll", "3")]);
    let exif = Exif::default().text(0x10F, "senseFly").text(0x110, "S.O.D.A.").with_gps();
    let photo = parse(&jpeg(Some(&exif), Some(&text), (5472, 3648)));
    assert!(matches!(photo.exposure.attitude, Some(LoggedAttitude::Camera { .. })));
    assert!(finds(&photo, Severity::Warning, "disputed"));
    assert!(finds(&photo, Severity::Note, "Swinglet"));
}

#[test]
fn micasense_s_sun_sensor_is_no_camera() {
    let text = packet(
        "<rdf:Description xmlns:DLS='http://micasense.com/DLS/1.0/'><DLS:Yaw>0.73</DLS:Yaw><DLS:Pitch>0.04</DLS:Pitch>\
         <DLS:Roll>0.15</DLS:Roll></rdf:Description><rdf:Description xmlns:Camera='http://pix4d.com/camera/1.0/'>\
         <Camera:PerspectiveFocalLength>5.5</Camera:PerspectiveFocalLength>\
         <Camera:PerspectiveFocalLengthUnits>mm</Camera:PerspectiveFocalLengthUnits>\
         <Camera:PerspectiveDistortion><rdf:Seq><rdf:li>-0.1</rdf:li><rdf:li>0.15</rdf:li><rdf:li>-0.02</rdf:li>\
         <rdf:li>0.0001</rdf:li><rdf:li>0.0002</rdf:li></rdf:Seq></Camera:PerspectiveDistortion></rdf:Description>",
    );
    // 266.666667 pixels a millimetre.
    let exif = Exif::little()
        .text(0x10F, "MicaSense")
        .text(0x110, "RedEdge-M")
        .with_gps()
        .rationals(0xA20E, &[(800, 3)])
        .rationals(0xA20F, &[(800, 3)])
        .short(0xA210, 4);
    let photo = parse(&jpeg(Some(&exif), Some(&text), (1280, 960)));
    assert!(photo.exposure.attitude.is_none() && photo.exposure.gimbal.is_none());
    assert!(finds(&photo, Severity::Note, "irradiance sensor"));
    let focal = photo.optics.focal_length_px.unwrap();
    near(focal.x, 5.5 * 800.0 / 3.0);
    let camera = photo.optics.pix4d.unwrap();
    assert_eq!(camera.perspective_distortion, Some([-0.1, 0.15, -0.02, 0.0001, 0.0002]));
}

#[test]
fn parrot_s_datum_goes_by_the_model() {
    let uri = "http://www.parrot.com/drone-parrot/1.0/";
    let list = [
        ("CameraYawDegree", "-120.5"),
        ("CameraPitchDegree", "-75.2"),
        ("CameraRollDegree", "3.1"),
        ("DroneYawDegree", "-119"),
        ("DronePitchDegree", "-8"),
        ("DroneRollDegree", "1"),
    ];
    for (model, kind) in [("AnafiAi", HeightKind::Ellipsoid), ("Anafi", SEA), ("ANAFI USA", SEA)] {
        let exif = Exif::default().text(0x10F, "Parrot").text(0x110, model).with_gps();
        let photo = parse(&jpeg(Some(&exif), Some(&elements(uri, &list)), (4608, 3456)));
        assert_eq!(position(&photo).3, kind, "{model}");
        assert_axes(
            &photo,
            [
                [0.886904784288, -0.461745678261, 0.013814203371],
                [0.443386021882, 0.859271279962, 0.255071956578],
                [-0.129648521808, -0.220099513949, 0.966823388604],
            ],
        );
        assert!(matches!(photo.exposure.attitude, Some(LoggedAttitude::Body { north: North::True, .. })));
    }
}

#[test]
fn skydio_s_structures() {
    let text = packet(
        "<rdf:Description xmlns:s='https://www.skydio.com/drone-skydio/1.0/'><s:Latitude>37.5</s:Latitude>\
         <s:Longitude>-122.25</s:Longitude><s:AbsoluteAltitude>55.5</s:AbsoluteAltitude>\
         <s:RelativeAltitude>20.5</s:RelativeAltitude><s:GpsHorizontalAccuracy>0.8</s:GpsHorizontalAccuracy>\
         <s:GpsVerticalAccuracy>1.2</s:GpsVerticalAccuracy><s:CameraOrientationNED rdf:parseType='Resource'>\
         <s:Roll>3.1</s:Roll><s:Pitch>-75.2</s:Pitch><s:Yaw>-120.5</s:Yaw></s:CameraOrientationNED>\
         <s:CalibratedFocalLength s:X='2376.5625' s:Y='2376.5625'/>\
         <s:CalibratedOpticalCenter s:X='2027.5' s:Y='1519.5'/><s:DewarpData>0.13,-0.24,0.104</s:DewarpData>\
         </rdf:Description>",
    );
    let file = |model: &str| {
        let exif = Exif::default().text(0x10F, "Skydio").text(0x110, model).with_gps();
        parse(&jpeg(Some(&exif), Some(&text), (4056, 3040)))
    };
    let photo = file("2+");
    let (lat, lon, height, kind) = position(&photo);
    near(lat, 37.5);
    near(lon, -122.25);
    assert_eq!((height, kind), (55.5, SEA));
    assert_axes(
        &photo,
        [
            [0.886904784288, -0.461745678261, 0.013814203371],
            [0.443386021882, 0.859271279962, 0.255071956578],
            [-0.129648521808, -0.220099513949, 0.966823388604],
        ],
    );
    let calibration = photo.optics.skydio.as_ref().unwrap();
    assert_eq!(calibration.focal_length_px, [2376.5625; 2]);
    assert_eq!(calibration.optical_centre, Some([2027.5, 1519.5]));
    assert_eq!(calibration.radial, [0.13, -0.24, 0.104]);
    assert_eq!(photo.exposure.std.up_m, Some(1.2));
    let (_, _, height, kind) = position(&file("VT300-L_93"));
    assert_eq!((height, kind), (300.25, HeightKind::Ellipsoid));
}

#[test]
fn exif_alone_with_its_altitude_references() {
    let with_reference = |reference: u8, version: &[u8; 4]| {
        let exif = Exif::default()
            .text(1, "S")
            .rationals(2, &[(41, 1), (65, 10), (0, 1)])
            .text(3, "E")
            .rationals(4, &[(3, 1), (0, 1), (0, 1)])
            .byte(5, reference)
            .raw(0x9000, 7, version.to_vec())
            .rationals(6, &[(25, 2)]);
        parse(&jpeg(Some(&exif), None, (100, 80)))
    };
    for (reference, height) in [(0, 12.5), (1, -12.5), (2, 12.5), (3, -12.5)] {
        // EXIF 3 defines 0 and 1 anew.
        let newer = with_reference(reference, b"0300");
        let kind = if reference < 2 { HeightKind::Ellipsoid } else { SEA };
        assert_eq!((position(&newer).2, position(&newer).3), (height, kind));
        let photo = with_reference(reference, b"0232");
        let (lat, lon, metres, kind) = position(&photo);
        near(lat, -(41.0 + 6.5 / 60.0));
        near(lon, 3.0);
        assert_eq!((metres, kind), (height, SEA));
        assert_eq!(origin(&photo, "height").1.contains("EXIF 3"), reference < 2);
    }
}

#[test]
fn times_know_their_zone_and_resolution() {
    let exif = Exif::default()
        .with_gps()
        .text(0x9003, "2013:06:04 13:37:35")
        .text(0x9291, "25")
        .text(0x9011, "-04:00");
    let photo = parse(&jpeg(Some(&exif), None, (100, 80)));
    let civil = photo.times.civil.unwrap();
    assert_eq!((civil.time.get(), civil.resolution_s), (1_370_353_055.25, 0.01));
    assert_eq!(photo.times.utc(Some(Seconds::new(0.0))).unwrap().time.get(), 1_370_367_455.25);
    // The receiver's time is better still.
    let gps = exif.text(0x1D, "2013:06:04").rationals(7, &[(17, 1), (38, 1), (905, 100)]);
    let photo = parse(&jpeg(Some(&gps), None, (100, 80)));
    assert_eq!(photo.times.utc(None).unwrap().time.get(), 1_370_367_489.05);
    // MicaSense: UTC, with a signed fraction in the tag of the other time.
    let rededge = Exif::default()
        .text(0x10F, "MicaSense")
        .text(0x132, "2013:06:04 13:37:35")
        .text(0x9003, "2013:06:04 13:37:35")
        .text(0x9290, "-250000");
    let photo = parse(&jpeg(Some(&rededge), None, (100, 80)));
    assert_eq!(photo.times.utc(None).unwrap().time.get(), 1_370_353_054.75);
    // Without a zone, only a declared one gives UTC.
    let photo = parse(&jpeg(Some(&Exif::default().text(0x9003, "2013:06:04 13:37:35")), None, (9, 8)));
    assert!(photo.times.utc(None).is_none());
    assert_eq!(photo.times.utc(Some(Seconds::new(-14_400.0))).unwrap().time.get(), 1_370_367_455.0);
}

#[test]
fn focal_lengths_in_pixels_of_the_stored_size() {
    let camera = |unit, per_unit: (u32, u32)| {
        Exif::default()
            .rationals(0x920A, &[(43, 10)])
            .short(0xA002, 4000)
            .short(0xA003, 3000)
            .rationals(0xA20E, &[per_unit])
            .rationals(0xA20F, &[per_unit])
            .short(0xA210, unit)
    };
    // 645.4 pixels a millimetre, four ways; the stored photo has half the size.
    for (unit, per_unit) in [(2, (16_393_160, 1000)), (3, (6454, 1)), (4, (6454, 10)), (5, (6454, 10_000))] {
        let photo = parse(&jpeg(Some(&camera(unit, per_unit)), None, (2000, 1500)));
        near(photo.optics.focal_length_px.unwrap().x, 4.3 * 645.4 / 2.0);
        assert!(photo.findings.iter().any(|f| f.text.contains("scaled by 0.5000")));
    }
    let cropped = parse(&jpeg(Some(&camera(2, (16_393_160, 1000))), None, (2000, 1000)));
    assert!(cropped.optics.focal_length_px.is_none() && finds(&cropped, Severity::Warning, "cropped"));
    let film = Exif::default().short(0xA405, 20);
    let photo = parse(&jpeg(Some(&film), None, (4000, 3000)));
    // 20 mm of a diagonal of 43.2666 mm, 5000 pixels.
    assert!((photo.optics.focal_length_px.unwrap().x - 2311.25).abs() < 0.01);
}

#[test]
fn turned_pixels_are_noticed() {
    let camera = Exif::default().with_gps().short(0x112, 1).long(0xA002, 4000).long(0xA003, 3000);
    let untouched = parse(&jpeg(Some(&camera.clone().text(0x131, "v01.23.4920")), None, (4000, 3000)));
    assert_eq!(untouched.turned, None);
    let quarter = parse(&jpeg(Some(&camera), None, (1500, 2000)));
    assert_eq!(quarter.turned, Some(TurnEvidence::QuarterTurn));
    assert!(finds(&quarter, Severity::Warning, "90° or 270°"));
    let viewed = camera
        .text(0x131, "Microsoft Windows Photo Viewer 10.0")
        .text(0x132, "2016:06:23 19:24:40")
        .text(0x9003, "2016:06:23 16:32:40");
    let viewed = parse(&jpeg(Some(&viewed), None, (4000, 3000)));
    assert!(matches!(viewed.turned, Some(TurnEvidence::PerhapsHalfTurn(_))));
    assert!(finds(
        &viewed,
        Severity::Warning,
        "Orientation is 1 and the file was rewritten by Microsoft Windows"
    ));
    assert!(finds(&viewed, Severity::Warning, "172 minutes after"));
}

#[test]
fn a_log_quarantines_only_the_bad_photo() {
    let dated = |name: &str, serial: &str| {
        let mut list = DJI_RTK.to_vec();
        list.push(("DroneSerialNumber", serial));
        (name.to_owned(), parse(&jpeg(None, Some(&attributes(DJI, &list)), (5280, 3956))))
    };
    let mut nowhere = dated("../e ü\".jpg", "A");
    nowhere.1 =
        parse(&jpeg(None, Some(&attributes(DJI, &[("GpsLatitude", "91"), ("GpsLongitude", "5")])), (9, 8)));
    let log = flight_log(vec![dated("a.jpg", "A"), nowhere, dated("c.jpg", "B")]);
    assert_eq!(log.clock, Clock::Utc);
    let names: Vec<_> = log.exposures.iter().filter_map(|e| e.frame.as_deref()).collect();
    assert_eq!(names, ["a.jpg", "c.jpg"]);
    assert!((log.exposures[1].time.unwrap().get() - 1_660_558_436.123_456).abs() < 1e-6);
    assert!(log.exposures[0].origins.iter().any(|o| o.quantity == "time"));
    assert_eq!(log.bad.len(), 1);
    assert_eq!(log.bad[0].frame.as_deref(), Some("../e ü\".jpg"));
    assert!(log.bad[0].cause.contains("latitude 91° lies outside ±90°"), "{}", log.bad[0].cause);
    assert!(log.notes.iter().any(|n| n.contains("2 aircraft: A, B")), "{:?}", log.notes);
    assert!(log.notes.iter().any(|n| n.contains("latitude 91")), "{:?}", log.notes);
    assert!(flight_log(Vec::new()).exposures.is_empty());
}
