//! Headers, offsets, matrices and CRS of each program.

use super::super::{LoggedAttitude, LoggedPosition};
use super::*;
use proptest::prelude::*;

const UTM: Declared<'static> = Declared {
    crs: Some("EPSG:32633"),
    heights: Some(HeightKind::Ellipsoid),
    angles: None,
    angle_unit: AngleUnit::Degrees,
    columns: None,
};

const METASHAPE: &str = "# Cameras (1)\n\
    # PhotoID, X, Y, Z, Omega, Phi, Kappa, r11, r12, r13, r21, r22, r23, r31, r32, r33\n\
    a b\t500000.25\t6651411.5\t350\t3.05269028827584\t-4.96805702777946\t-27.4865506551791\t\
    0.883786409\t-0.464976706\t0.052136802\t0.459806442\t0.883731810\t0.087155743\t-0.086600341\t-0.053054223\t0.994829448\n";

fn map(log: &FlightLog) -> [f64; 3] {
    match log.exposures[0].position {
        Some(LoggedPosition::Projected { map, height_m, .. }) => [map.easting, map.northing, height_m],
        ref other => panic!("{other:?}"),
    }
}

#[test]
fn pix4ds_offset_is_added_once() {
    let offset: Option<&[u8]> = Some(b"332000.000 3488000.000 4000.000\r\n");
    let local =
        b"imageName X Y Z Omega Phi Kappa\nDSC 0157.JPG 81.126 911.819856 93.688402 -2.9 3.05 119.8\n";
    let log = read(local, &UTM, offset).unwrap();
    assert_eq!(log.exposures[0].frame.as_deref(), Some("DSC 0157.JPG"));
    let [x, y, z] = map(&log);
    assert!((x - 332_081.126).abs() < 1e-9 && (y - 3_488_911.819_856).abs() < 1e-8);
    assert!((z - 4_093.688_402).abs() < 1e-9);
    let full =
        b"imageName X Y Z Omega Phi Kappa\na.JPG 332081.126 3488911.819856 4093.688402 -2.9 3.05 119.8\n";
    assert!(read(full, &UTM, None).is_ok());
    assert!(read(full, &UTM, offset).unwrap_err().cause.contains("already"));
    for bad in [&b"1 2"[..], b"1 2 3 4", b"1 x 3", b"", b"\xFF"] {
        assert!(read(local, &UTM, Some(bad)).is_err(), "{bad:?}");
    }
    assert!(read(METASHAPE.as_bytes(), &UTM, offset).is_err());
}

#[test]
fn pix4ds_positions_have_no_header() {
    let text = b"IMG_1.JPG,332081.126,3488911.8,93.5\nIMG_2.JPG,332091.126,3488911.8,93.5\n";
    assert!(read(text, &UTM, None).unwrap_err().help.unwrap().contains("`column_order`"));
    let log = read(text, &Declared { columns: Some(&PIX4D_IMAGES_POSITION), ..UTM }, None).unwrap();
    assert_eq!((log.exposures.len(), log.exposures[1].place, log.exposures[0].attitude), (2, 2, None));
}

#[test]
fn metashapes_matrix_must_agree_with_its_angles() {
    let log = read(METASHAPE.as_bytes(), &UTM, None).unwrap();
    assert_eq!(log.exposures[0].frame.as_deref(), Some("a b"));
    assert!(matches!(log.exposures[0].attitude, Some(LoggedAttitude::CameraOnGrid(_))));
    // The transpose is the same rotation the other way about.
    let transposed = METASHAPE.replace(
        "0.883786409\t-0.464976706\t0.052136802\t0.459806442\t0.883731810\t0.087155743\t-0.086600341\t-0.053054223",
        "0.883786409\t0.459806442\t-0.086600341\t-0.464976706\t0.883731810\t-0.053054223\t0.052136802\t0.087155743",
    );
    assert!(read(transposed.as_bytes(), &UTM, None).is_ok());
    let off = METASHAPE.replace("-27.4865506551791", "-27.5265506551791");
    let refused = read(off.as_bytes(), &UTM, None).unwrap_err();
    assert!(
        refused.cause.contains("kappa -27.5266°") && refused.cause.contains("-27.4866°"),
        "{}",
        refused.cause
    );
    let torn = METASHAPE.replace("0.883731810", "x");
    assert!(read(torn.as_bytes(), &UTM, None).unwrap_err().cause.contains("r22"));
    let none = METASHAPE
        .replace("350\t3.05", "350\t")
        .replace("269028827584\t-4.96805702777946\t-27.4865506551791", "\t\t");
    assert_eq!(read(none.as_bytes(), &UTM, None).unwrap().exposures[0].attitude, None);
}

#[test]
fn metashapes_reference_states_its_crs() {
    let wkt = "COMPD_CS[\"WGS 84 + EGM96, height\",GEOGCS[\"WGS 84\",DATUM[\"World Geodetic System 1984\"]],VERT_CS[\"EGM96\"]]";
    let text = format!(
        "# CoordinateSystem: {wkt}\n#Label,X/Longitude,Y/Latitude,Z/Altitude,Yaw,Pitch,Roll,\
         Accuracy_X/Y/Z_(m),Error_(m),X_error,X_est\na,15.5,36.25,350,30,5,-3,0.05,1,2,3\n"
    );
    let log = read(text.as_bytes(), &Declared::default(), None).unwrap();
    let e = &log.exposures[0];
    let Some(LoggedPosition::Geodetic { latitude, longitude, kind, .. }) = e.position else { panic!() };
    assert!((latitude.degrees() - 36.25).abs() < 1e-12 && (longitude.degrees() - 15.5).abs() < 1e-12);
    assert_eq!(kind, HeightKind::SeaLevel(crate::geodesy::GeoidModel::Egm96));
    assert_eq!((e.std.north_m, e.std.up_m), (Some(0.05), Some(0.05)));
    assert!(log.notes.iter().any(|n| n.contains("\"X_est\"")), "{:?}", log.notes);
    // Beside map coordinates the north of the yaw is open.
    let map = text.replace(wkt, "PROJCS[\"WGS 84 / UTM zone 33N\"]").replace("15.5,36.25", "545000,4012000");
    let heights = Declared { heights: Some(HeightKind::Ellipsoid), ..Declared::default() };
    assert!(read(map.as_bytes(), &heights, None).unwrap_err().cause.contains("north"));
    let grid = Declared { angles: Some(AngleSystem::CameraYawPitchRoll(North::Grid)), ..heights };
    let log = read(map.as_bytes(), &grid, None).unwrap();
    assert!(matches!(log.exposures[0].attitude, Some(LoggedAttitude::Camera { north: North::Grid, .. })));
    let local = text.replace(wkt, "LOCAL_CS[\"Local Coordinates (m)\"]");
    let refused = read(local.as_bytes(), &heights, None).unwrap_err();
    assert!(refused.cause.contains("local") && refused.line == Some(1));
    // Degrees of another datum go through PROJ.
    let nad83 = text.replace(wkt, "GEOGCS[\"NAD83\",DATUM[\"North_American_Datum_1983\"]]");
    let log = read(nad83.as_bytes(), &heights, None).unwrap();
    assert!(matches!(log.exposures[0].position, Some(LoggedPosition::Projected { .. })));
    assert!(log.crs.unwrap().starts_with("GEOGCS[\"NAD83\""));
}

#[test]
fn orthoritys_files_and_their_gaps() {
    let csv = b"filename,x,y,z,omega,phi,kappa,camera\na.jpg,1000,2000,300,0.5,1,2,\"cam, 1\"\n";
    let no_crs = Declared { crs: None, ..UTM };
    assert!(read(csv, &no_crs, None).unwrap_err().help.unwrap().contains("`position_crs`"));
    assert_eq!(map(&read(csv, &UTM, None).unwrap()), [1000.0, 2000.0, 300.0]);
    let feature = |name: &str, xyz: &str, opk: &str| {
        format!(r#"{{"properties": {{"filename": {name}, "xyz": {xyz}, "opk": {opk}}}}}"#)
    };
    let features = [
        feature("\"a.jpg\"", "[20000.0, 30000.0, 1000.0]", "[-0.05, 0.03, 0.17]"),
        feature("\"../b.jpg\"", "[20000.0, 30000.0, NaN]", "[-0.05, 0.03, 0.17]"),
        feature("\"c.jpg\"", "[20000.0, 30000.0]", "[-0.05, 0.03, 0.17]"),
        feature("\"d.jpg\"", "[20000.0, 30000.0, 1000]", "[-5000, 0.03, 0.17]"),
        feature("null", "[20000.0, 30000.0, 1000]", "[-0.05, 0.03, 0.17]"),
        "17".to_owned(),
    ];
    let json = format!(r#"{{"type": "x", "world_crs": "EPSG:32634", "features": [{}]}}"#, features.join(","));
    let log = read(json.as_bytes(), &no_crs, None).unwrap();
    assert_eq!((log.exposures.len(), log.bad.len(), log.crs.as_deref()), (1, 5, Some("EPSG:32634")));
    assert_eq!((log.bad[0].place, log.bad[0].frame.as_deref()), (2, Some("../b.jpg")));
    let Some(LoggedAttitude::CameraOnGrid(angles)) = log.exposures[0].attitude else { panic!() };
    assert!((angles.kappa.get() - 0.17).abs() < 1e-15);
    assert!(
        read(json.as_bytes(), &Declared::default(), None)
            .unwrap_err()
            .help
            .unwrap()
            .contains("`height_datum`")
    );
    for bad in ["{", "{}", r#"{"features": 1}"#, r#"{"world_crs": "EPSG:4326", "features": []}"#] {
        assert!(read(bad.as_bytes(), &no_crs, None).is_err(), "{bad}");
    }
    let deep = format!("{{\"features\": {}", "[".repeat(100_000));
    assert!(read(deep.as_bytes(), &UTM, None).is_err());
}

#[test]
fn other_tables_are_refused() {
    assert!(read(b"time,x,y,z\n1,2,3,4\n", &UTM, None).unwrap_err().cause.contains("no header"));
    assert!(read(b"", &UTM, None).is_err());
    assert!(read(b"filename,x,y\na,1,2\n", &UTM, None).unwrap_err().help.unwrap().contains("`column_order`"));
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(cut in 0usize..400, at in 0usize..400, with in any::<u8>(), json: bool) {
        let geojson = r#"{"world_crs": "EPSG:32634", "features": [{"properties": {"filename": "a", "xyz": [1, 2, 3],
            "opk": [0.1, NaN, 1e3]}}, {"properties": {"filename": "a", "xyz": [1, 2, 3], "opk": [0.1, 0, 1e3]}}]}"#;
        let mut bytes = if json { geojson } else { METASHAPE }.as_bytes().to_vec();
        let n = bytes.len();
        bytes[at % n] = with;
        bytes.truncate(cut % n + 1);
        if let Ok(log) = read(&bytes, &UTM, None) {
            prop_assert!(log.exposures.len() + log.bad.len() <= bytes.len());
        }
        let _ = read(METASHAPE.as_bytes(), &UTM, Some(&bytes));
    }
}
