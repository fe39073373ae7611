//! One pose in every text format: all must give the same camera rotation.
//!
//! The numbers were computed by a separate program from the definitions alone: yaw, pitch from nadir and roll are turned into
//! a matrix, and that into each program's angles. Rounded to 0.001° the ω, φ, κ are those published for these places.

use super::{AngleSystem, AngleUnit, Declared, FlightLog, LoggedAttitude, LoggedPosition, North};
use super::{geo_txt, geoinfo, opensfm, orientation};
use crate::geodesy::{Geodetic, HeightKind, WGS84};
use crate::geometry::attitude::{OmegaPhiKappa, YawPitchRoll};
use crate::geometry::{Body, Camera, Ned};
use crate::units::Radians;
use nalgebra::Matrix3;

/// A pose and what other programs write for it. Angles in degrees where nothing else is said.
struct Pose {
    latitude: f64,
    longitude: f64,
    /// Convergence of UTM 33N there.
    gamma: f64,
    yaw_pitch_roll: [f64; 3],
    grid: [&'static str; 3],
    grid_radians: [&'static str; 3],
    local: [&'static str; 3],
    phi_omega_kappa_gon: [&'static str; 3],
    /// World to photo, row by row, as Metashape's users read it.
    matrix: [&'static str; 9],
    /// Latitude and longitude of the reference; its height is 100 m, the camera's 350 m.
    reference: [&'static str; 2],
    topocentric: [[&'static str; 3]; 2],
    /// Camera at 123.25, -45.5, 350 on the grid.
    on_grid: [[&'static str; 3]; 2],
}

const POSES: [Pose; 4] = [
    Pose {
        latitude: 36.0,
        longitude: 15.0,
        gamma: 0.0,
        yaw_pitch_roll: [30.0, 5.0, -3.0],
        grid: ["2.831737358905789", "-5.097015697920543", "-30.00494870068124"],
        grid_radians: ["0.04942314046463438", "-0.08895970595455016", "-0.5236851467188821"],
        local: ["2.831737358905789", "-5.097015697920543", "-30.00494870068124"],
        phi_omega_kappa_gon: ["-5.670238066970074", "3.133923034930798", "-33.61858945641067"],
        matrix: [
            "0.862557856",
            "-0.503265038",
            "0.052136802",
            "0.498097349",
            "0.862729916",
            "0.087155743",
            "-0.088842417",
            "-0.049207668",
            "0.994829448",
        ],
        reference: ["35.9990", "15.0010"],
        topocentric: [
            ["2.963354598144704", "-0.7976753543994465", "0.112329194502249"],
            ["120.5817394629593", "72.60625940690804", "251.259448789644"],
        ],
        on_grid: [
            ["2.963346169692066", "-0.79765857293927", "0.1123002863778244"],
            ["-147.456695768635", "52.64079706892582", "339.4794277374468"],
        ],
    },
    Pose {
        latitude: 36.0,
        longitude: 15.0,
        gamma: 0.0,
        yaw_pitch_roll: [30.0, 40.0, 0.0],
        grid: ["36.00521481878653", "-18.7472372510375", "-23.85865479845865"],
        grid_radians: ["0.6284095464756785", "-0.3272010156831351", "-0.4164120813298476"],
        local: ["36.00521481878653", "-18.7472372510375", "-23.85865479845865"],
        phi_omega_kappa_gon: ["-25.28941808290736", "37.58427218952191", "-41.11611331772269"],
        matrix: [
            "0.866025404",
            "-0.500000000",
            "0.000000000",
            "0.383022222",
            "0.663413948",
            "0.642787610",
            "-0.321393805",
            "-0.556670399",
            "0.766044443",
        ],
        reference: ["35.9990", "15.0010"],
        topocentric: [
            ["2.373609447426055", "-0.6360100820934393", "0.2315140017923034"],
            ["133.5663898972733", "199.7748548054535", "158.7229103825957"],
        ],
        on_grid: [
            ["2.373599098294141", "-0.6360039615431561", "0.2314865108770953"],
            ["-129.4876310164321", "241.997817555809", "253.8322718095114"],
        ],
    },
    Pose {
        latitude: 60.0,
        longitude: 17.9,
        gamma: 2.512,
        yaw_pitch_roll: [30.0, 5.0, -3.0],
        grid: ["3.052690288275843", "-4.968057027779461", "-27.48655065517908"],
        grid_radians: ["0.05327949657406831", "-0.086708952561595", "-0.4797308089490796"],
        local: ["2.831737358905789", "-5.097015697920543", "-30.00494870068124"],
        phi_omega_kappa_gon: ["-5.527868215511318", "3.379123261430279", "-30.83462580849515"],
        matrix: [
            "0.883786409",
            "-0.464976706",
            "0.052136802",
            "0.459806442",
            "0.883731810",
            "0.087155743",
            "-0.086600341",
            "-0.053054223",
            "0.994829448",
        ],
        reference: ["59.9990", "17.9010"],
        topocentric: [
            ["2.963354404669743", "-0.797683230492637", "0.1123215216825306"],
            ["91.16924198973838", "90.11378325013705", "248.1838020584097"],
        ],
        on_grid: [
            ["2.978663708588262", "-0.7321540285541766", "0.1098386775771734"],
            ["-148.3309957793258", "46.96585658541132", "339.9307819340758"],
        ],
    },
    Pose {
        latitude: 60.0,
        longitude: 17.9,
        gamma: 2.512,
        yaw_pitch_roll: [30.0, 40.0, 0.0],
        grid: ["36.66294976707836", "-17.25871689886484", "-21.73092084717338"],
        grid_radians: ["0.6398891869288055", "-0.3012214345547766", "-0.379276118273451"],
        local: ["36.00521481878653", "-18.7472372510375", "-23.85865479845865"],
        phi_omega_kappa_gon: ["-23.52360681503421", "38.62854296343745", "-37.98280677645534"],
        matrix: [
            "0.887107522",
            "-0.461562828",
            "0.000000000",
            "0.353577640",
            "0.679563788",
            "0.642787610",
            "-0.296686867",
            "-0.570221724",
            "0.766044443",
        ],
        reference: ["59.9990", "17.9010"],
        topocentric: [
            ["2.373609535343078", "-0.6360184453089881", "0.2315097970056793"],
            ["104.0332343168759", "213.2374020165992", "147.4259840041276"],
        ],
        on_grid: [
            ["2.384805885680822", "-0.5832936045809705", "0.2123015099053135"],
            ["-130.3371107758593", "237.6339551193249", "257.4939871704736"],
        ],
    },
];

/// The rotation that the pose means, from the angles' definition.
fn truth(pose: &Pose) -> Matrix3<f64> {
    let [yaw, pitch, roll] = pose.yaw_pitch_roll;
    let level = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    YawPitchRoll::from_degrees(yaw, pitch, roll).rotation::<Ned, Body>().matrix() * level
}

fn understood(log: &FlightLog, gamma: f64) -> Matrix3<f64> {
    assert_eq!((log.exposures.len(), log.bad.len()), (1, 0), "{:?}", log.bad);
    let level = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    match log.exposures[0].attitude.unwrap() {
        LoggedAttitude::CameraOnGrid(angles) => {
            angles.ned_from_camera::<Ned, Camera>(Radians::from_degrees(gamma)).matrix()
        }
        LoggedAttitude::CameraInNed(turn) => turn.matrix(),
        LoggedAttitude::Camera { angles, north: North::True } => {
            angles.rotation::<Ned, Body>().matrix() * level
        }
        other => panic!("{other:?}"),
    }
}

fn same(log: &FlightLog, pose: &Pose, format: &str) {
    let off = (understood(log, pose.gamma) - truth(pose)).abs().max();
    assert!(off < 1e-9, "{format} at {}°N, {:?}: off by {off:e}", pose.latitude, pose.yaw_pitch_roll);
}

const HEIGHTS: Option<HeightKind> = Some(HeightKind::Ellipsoid);

#[test]
fn omega_phi_kappa_on_the_grid_by_every_program() {
    for pose in &POSES {
        let (opk, map) = (pose.grid.join(" "), "500000.25 6651411.5 350");
        let crs = Declared { crs: Some("EPSG:32633"), heights: HEIGHTS, ..Declared::default() };
        let pix4d = format!("imageName X Y Z Omega Phi Kappa\na.jpg {map} {opk}\n");
        same(&orientation::read(pix4d.as_bytes(), &crs, None).unwrap(), pose, "Pix4D");
        let head = "PhotoID, X, Y, Z, Omega, Phi, Kappa, r11, r12, r13, r21, r22, r23, r31, r32, r33";
        let metashape = format!(
            "# Cameras (1)\n# {head}\na\t{}\t{}\t{}\n",
            map.replace(' ', "\t"),
            opk.replace(' ', "\t"),
            pose.matrix.join("\t")
        );
        same(&orientation::read(metashape.as_bytes(), &crs, None).unwrap(), pose, "Metashape");
        let orthority = format!("filename,x,y,z,omega,phi,kappa\na.jpg,{map} {opk}\n").replace(' ', ",");
        same(&orientation::read(orthority.as_bytes(), &crs, None).unwrap(), pose, "orthority");
        let json = format!(
            r#"{{"type": "FeatureCollection", "world_crs": "EPSG:32633", "features": [{{"type": "Feature", "properties":
            {{"filename": "a.jpg", "camera": null, "xyz": [{}], "opk": [{}]}}, "geometry": null}}]}}"#,
            map.replace(' ', ","),
            pose.grid_radians.join(",")
        );
        let heights = Declared { heights: HEIGHTS, ..Declared::default() };
        same(&orientation::read(json.as_bytes(), &heights, None).unwrap(), pose, "orthority's GeoJSON");
        let odm = format!("WGS84 UTM 33N\na.jpg {map} {opk}\n");
        let old =
            Declared { heights: HEIGHTS, angles: Some(AngleSystem::OmegaPhiKappa), ..Declared::default() };
        same(&geo_txt::read(odm.as_bytes(), &old).unwrap(), pose, "an old geo.txt");
        let gon = Declared { angles: Some(AngleSystem::PhiOmegaKappa), angle_unit: AngleUnit::Gon, ..crs };
        let inpho =
            format!("imagename x y z phi omega kappa\na.jpg {map} {}\n", pose.phi_omega_kappa_gon.join(" "));
        same(&geoinfo::read(inpho.as_bytes(), &gon).unwrap(), pose, "φωκ in gon");
    }
}

#[test]
fn angles_beside_latitude_and_longitude() {
    for pose in &POSES {
        let [yaw, pitch, roll] = pose.yaw_pitch_roll;
        let (lat, lon) = (pose.latitude, pose.longitude);
        let plain = Declared { heights: HEIGHTS, ..Declared::default() };
        let camera = Declared { angles: Some(AngleSystem::CameraYawPitchRoll(North::True)), ..plain };
        let opk = format!(
            "#imagename,latitude,longitude,altitude,omega,phi,kappa\na.jpg,{lat},{lon},350,{}\n",
            pose.local.join(",")
        );
        same(&geoinfo::read(opk.as_bytes(), &plain).unwrap(), pose, "Pix4D's geolocation, ωφκ");
        let ypr = format!(
            "#imagename,latitude,longitude,altitude,yaw,pitch,roll\na.jpg,{lat},{lon},350,{yaw},{pitch},{roll}\n"
        );
        same(&geoinfo::read(ypr.as_bytes(), &camera).unwrap(), pose, "Pix4D's geolocation");
        let odm = format!("EPSG:4326\na.jpg {lon} {lat} 350 {yaw} {pitch} {roll} 0.02 0.03\n");
        same(&geo_txt::read(odm.as_bytes(), &camera).unwrap(), pose, "geo.txt");
        let metashape = format!(
            "# CoordinateSystem: GEOGCS[\"WGS 84\",DATUM[\"World Geodetic System 1984\"]]\n\
             Label,Enable,Longitude,Latitude,Altitude,Yaw,Pitch,Roll\na,1,{lon},{lat},350,{yaw},{pitch},{roll}\n"
        );
        same(&orientation::read(metashape.as_bytes(), &plain, None).unwrap(), pose, "Metashape's reference");
        let orthority = format!(
            "filename latitude longitude altitude roll pitch yaw camera\na.jpg {lat} {lon} 350 {roll} {pitch} {yaw} \"a b\"\n"
        );
        let log = orientation::read(orthority.as_bytes(), &Declared::default(), None).unwrap();
        same(&log, pose, "orthority's roll, pitch, yaw");
        // Orthority's ω, φ, κ beside latitude and longitude count from the grid that its user names.
        let on_grid = format!(
            "filename,latitude,longitude,altitude,omega,phi,kappa\na.jpg,{lat},{lon},350,{}\n",
            pose.grid.join(",")
        );
        let crs = Declared { crs: Some("EPSG:32633"), ..Declared::default() };
        let log = orientation::read(on_grid.as_bytes(), &crs, None).unwrap();
        assert_eq!(log.crs.as_deref(), Some("EPSG:32633"));
        assert!(matches!(log.exposures[0].position, Some(LoggedPosition::Geodetic { .. })));
        same(&log, pose, "orthority's latitude, longitude and ωφκ");
        let asked = orientation::read(on_grid.as_bytes(), &Declared::default(), None).unwrap_err();
        assert!(asked.help.unwrap().contains("`position_crs`"));
    }
}

fn reconstruction(pose: &Pose, [rotation, translation]: &[[&str; 3]; 2]) -> String {
    let [lat, lon] = pose.reference;
    format!(
        r#"[{{"cameras": {{}}, "points": {{"1": {{"color": [1, 2, 3]}}}}, "reference_lla": {{"latitude": {lat},
        "longitude": {lon}, "altitude": 100.0}}, "shots": {{"a.jpg": {{"camera": "c", "rotation": [{}],
        "translation": [{}], "gps_position": [NaN, 0, 0]}}}}}}]"#,
        rotation.join(","),
        translation.join(",")
    )
}

#[test]
fn opensfm_through_the_earths_centre_and_on_odms_grid() {
    for pose in &POSES {
        let text = reconstruction(pose, &pose.topocentric);
        let log = opensfm::read(text.as_bytes(), opensfm::Axes::Topocentric, None, None).unwrap();
        same(&log, pose, "OpenSfM");
        let Some(LoggedPosition::Ecef(point)) = log.exposures[0].position else { panic!() };
        let expected =
            WGS84.ecef_from_geodetic(&Geodetic::from_degrees(pose.latitude, pose.longitude, 350.0));
        assert!(point.distance_to(&expected) < 1e-6, "{} m", point.distance_to(&expected));
        let text = reconstruction(pose, &pose.on_grid);
        let axes = opensfm::Axes::Grid { crs: "EPSG:32633", offset: [500_000.0, 6_651_000.0] };
        let log = opensfm::read(text.as_bytes(), axes, None, HEIGHTS).unwrap();
        same(&log, pose, "ODM's reconstruction");
        let Some(LoggedPosition::Projected { map, height_m, .. }) = log.exposures[0].position else {
            panic!()
        };
        assert!((map.easting - 500_123.25).abs() < 1e-6 && (map.northing - 6_650_954.5).abs() < 1e-6);
        assert!((height_m - 350.0).abs() < 1e-9);
    }
}

#[test]
fn metashapes_own_matrices_of_yaw_pitch_roll() {
    // What Metashape.Utils.ypr2mat returns for yaw 30, pitch 91, roll 0 and for 210, 89, 180 (Agisoft forum, topic 12200):
    // photo axes (x right, y up, z back) in east, north, up.
    let published = Matrix3::new(
        0.866_025_403_784_438_7,
        -0.008_726_203_218_641_737,
        -0.499_923_847_578_195_6,
        -0.499_999_999_999_999_94,
        -0.015_114_227_331_858_56,
        -0.865_893_503_920_753_9,
        0.0,
        0.999_847_695_156_391_3,
        -0.017_452_406_437_283_477,
    );
    let enu_from_ned = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let camera_from_photo = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, -1.0));
    for angles in ["30,91,0", "210,89,180"] {
        let text = format!("Label,Longitude,Latitude,Altitude,Yaw,Pitch,Roll\na,15,36,350,{angles}\n");
        let declared = Declared { heights: HEIGHTS, ..Declared::default() };
        let log = orientation::read(text.as_bytes(), &declared, None).unwrap();
        let enu_from_photo = enu_from_ned * understood(&log, 0.0) * camera_from_photo;
        assert!((enu_from_photo - published).abs().max() < 1e-12, "{angles}: {enu_from_photo}");
    }
}

#[test]
fn a_real_tables_angles_and_matrices_agree() {
    // The reference orientation of the Seneca survey states each attitude twice: as yaw, pitch, roll of a body whose nose is
    // the top of the image, and as the matrix from the camera to north-east-down.
    let file =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/seneca/reference_eo.csv");
    let Ok(bytes) = std::fs::read(&file) else {
        eprintln!("skipped: the data set seneca is not on this machine");
        return;
    };
    use super::Column::{Frame, Height, Latitude, Longitude, Pitch, Roll, Unused, Yaw};
    let mut columns = vec![Frame, Latitude, Longitude, Height, Unused, Unused, Yaw, Pitch, Roll];
    columns.extend([Unused; 9]);
    let declared = Declared {
        columns: Some(&columns),
        heights: Some(HeightKind::SeaLevel(crate::geodesy::GeoidModel::Egm96)),
        angles: Some(AngleSystem::CameraYawPitchRoll(North::True)),
        ..Declared::default()
    };
    let log = geoinfo::read(&bytes, &declared).unwrap();
    assert_eq!((log.exposures.len(), log.bad.len()), (68, 0));
    let text = String::from_utf8(bytes).unwrap();
    let mut worst = 0.0_f64;
    for (exposure, line) in log.exposures.iter().zip(text.lines().skip(1)) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(exposure.frame.as_deref(), Some(cells[0]));
        let matrix = Matrix3::from_row_iterator(cells[9..18].iter().map(|c| c.parse::<f64>().unwrap()));
        let one = FlightLog { exposures: vec![exposure.clone()], bad: Vec::new(), ..log.clone() };
        worst = worst.max((understood(&one, 0.0) - matrix).abs().max());
    }
    // Angles are printed to 0.0001°: 1.7e-6 rad.
    assert!(worst < 3e-6, "{worst:e}");
}

#[test]
fn the_conventions_page_prints_what_the_code_computes() {
    let page = include_str!("../../../CONVENTIONS.md").replace('−', "-");
    let cells = |line: &str| -> Vec<Vec<f64>> {
        let numbers = |cell: &str| cell.split(',').map(|n| n.trim().parse().unwrap_or(f64::NAN)).collect();
        line.trim_matches('|').split('|').skip(1).map(numbers).collect()
    };
    let row = |start: &str| {
        let found = page.lines().find(|l| l.starts_with(start));
        cells(found.unwrap_or_else(|| panic!("CONVENTIONS.md has no row {start}")))
    };
    let poses = row("| place | 0, 0, 0 |");
    assert_eq!(poses.len(), 5);
    for (start, gamma) in [("| 36°N 15°E", 0.0), ("| 60°N 17.9°E", 2.512)] {
        for (pose, expected) in poses.iter().zip(row(start)) {
            let level = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
            let body = YawPitchRoll::from_degrees(pose[0], pose[1], pose[2]).rotation::<Ned, Body>().matrix();
            let turn = crate::geometry::Rotation::<Ned, Camera>::from_matrix_unchecked(body * level);
            let opk = OmegaPhiKappa::of_ned_from_camera(&turn, Radians::from_degrees(gamma));
            for (angle, printed) in [opk.omega, opk.phi, opk.kappa].into_iter().zip(expected) {
                assert!((angle.degrees() - printed).abs() < 1e-3, "{start} {pose:?}: {}", angle.degrees());
            }
        }
    }
}
