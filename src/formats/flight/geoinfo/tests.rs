//! Columns by header and by declaration; names and rows that nobody expects.

use super::super::{AngleSystem, HeightKind, LoggedAttitude, LoggedPosition, North};
use super::*;
use crate::geodesy::GeoidModel;
use proptest::prelude::*;

const SEA: Option<HeightKind> = Some(HeightKind::SeaLevel(GeoidModel::Egm96));

fn declared<'a>() -> Declared<'a> {
    Declared { heights: SEA, ..Declared::default() }
}

#[test]
fn a_header_names_the_columns_in_any_order_and_delimiter() {
    let rows = [
        "imagename,latitude,longitude,altitude,accuracy horz [m],accuracy vert [m]\nIMG 1.jpg,46.5,6.25,540.5,0.02,0.04",
        "# ImageName; Latitude [decimal degrees]; Longitude; Altitude (m); hacc; vacc\nIMG 1.jpg;46.5;6.25;540.5;0.02;0.04",
        "\u{feff}vacc\thacc\talt\tlon\tlat\tphoto\r\n0.04\t0.02\t540.5\t6.25\t46.5\tIMG 1.jpg\r\n",
        "image lat lon alt hacc vacc\nIMG 1.jpg 46.5 6.25 540.5 0.02 0.04\n",
        "image lat lon alt hacc vacc\n\"IMG 1.jpg\" 46.5 6.25 540.5 0.02 0.04\n",
    ];
    for text in rows {
        let log = read(text.as_bytes(), &declared()).unwrap();
        assert_eq!((log.exposures.len(), log.bad.len()), (1, 0), "{text}: {:?}", log.bad);
        let e = &log.exposures[0];
        assert_eq!((e.place, e.frame.as_deref()), (2, Some("IMG 1.jpg")), "{text}");
        let Some(LoggedPosition::Geodetic { latitude, longitude, height_m, kind }) = e.position else {
            panic!()
        };
        assert!((latitude.degrees() - 46.5).abs() < 1e-12 && (longitude.degrees() - 6.25).abs() < 1e-12);
        assert_eq!((height_m, Some(kind)), (540.5, SEA));
        assert_eq!((e.std.north_m, e.std.east_m, e.std.up_m), (Some(0.02), Some(0.02), Some(0.04)));
        assert_eq!((e.attitude, log.crs.as_ref()), (None, None));
        assert_eq!(e.origins.len(), log.origins.len());
    }
}

#[test]
fn without_a_header_the_columns_must_be_declared() {
    let text = b"a.jpg,46.5,6.25,540.5,10,-80,1\n";
    let asked = read(text, &declared()).unwrap_err();
    assert!(asked.help.unwrap().contains("`column_order`"));
    use Column::{Frame, Height, Latitude, Longitude, Pitch, Roll, Unused, Yaw};
    let columns = [Frame, Latitude, Longitude, Height, Yaw, Pitch, Roll];
    let with = Declared { columns: Some(&columns), ..declared() };
    assert!(read(text, &with).unwrap_err().help.unwrap().contains("angles"), "yaw of what?");
    let with = Declared { angles: Some(AngleSystem::BodyYawPitchRoll(North::Course)), ..with };
    let log = read(text, &with).unwrap();
    let Some(LoggedAttitude::Body { angles, north: North::Course }) = log.exposures[0].attitude else {
        panic!()
    };
    assert!((angles.pitch.degrees() + 80.0).abs() < 1e-12);
    let short = [Frame, Latitude, Longitude, Height, Unused];
    let log = read(text, &Declared { columns: Some(&short), ..declared() });
    assert!(log.unwrap_err().cause.contains("7 cells, the table has 5 columns"));
}

#[test]
fn nothing_is_guessed() {
    let geographic = b"image,lat,lon,alt\na.jpg,46.5,6.25,540.5\n";
    assert!(read(geographic, &Declared::default()).unwrap_err().help.unwrap().contains("`height_datum`"));
    let map = b"image,x,y,z\na.jpg,474191.175,5091809.612,540.5\n";
    assert!(read(map, &declared()).unwrap_err().help.unwrap().contains("`position_crs`"));
    let log = read(map, &Declared { crs: Some("EPSG:32632"), ..declared() }).unwrap();
    assert_eq!(log.crs.as_deref(), Some("EPSG:32632"));
    assert!(matches!(log.exposures[0].position, Some(LoggedPosition::Projected { .. })));
    let log = read(map, &Declared { crs: Some("EPSG:32632+5773"), ..Declared::default() }).unwrap();
    assert_eq!(log.crs.as_deref(), Some("EPSG:32632"));
    let Some(LoggedPosition::Projected { kind, .. }) = log.exposures[0].position else { panic!() };
    assert_eq!(Some(kind), SEA, "EGM96 by the compound CRS");
    let against = Declared { crs: Some("EPSG:32632+3855"), heights: SEA, ..Declared::default() };
    assert!(read(map, &against).unwrap_err().cause.contains("EGM2008"));
    let opk = Declared { angles: Some(AngleSystem::OmegaPhiKappa), ..declared() };
    let ypr = b"image,lat,lon,alt,yaw,pitch,roll\na.jpg,46.5,6.25,540.5,1,2,3\n";
    assert!(read(ypr, &opk).unwrap_err().cause.contains("omega"));
    let twice = b"image,lat,latitude,lon,alt\na.jpg,1,2,3,4\n";
    assert!(read(twice, &declared()).unwrap_err().cause.contains("latitude"));
}

#[test]
fn omega_phi_kappa_beside_degrees_count_from_the_ground_or_from_a_declared_grid() {
    let text = b"image,lat,lon,alt,omega,phi,kappa\na.jpg,46.5,6.25,540.5,1,2,3\n";
    let log = read(text, &declared()).unwrap();
    assert!(matches!(log.exposures[0].attitude, Some(LoggedAttitude::CameraInNed(_))));
    assert!(log.crs.is_none() && log.notes.iter().any(|n| n.contains("true east")));
    let same = read(text, &Declared { crs: Some("EPSG:4326"), ..declared() }).unwrap();
    assert_eq!(same.exposures[0].attitude, log.exposures[0].attitude);
    let grid = Declared { crs: Some("EPSG:32632"), ..declared() };
    let log = read(text, &grid).unwrap();
    assert!(matches!(log.exposures[0].attitude, Some(LoggedAttitude::CameraOnGrid(_))));
    assert!(matches!(log.exposures[0].position, Some(LoggedPosition::Geodetic { .. })));
    assert_eq!(log.crs.as_deref(), Some("EPSG:32632"));
    let none = read(b"image,lat,lon,alt\na.jpg,46.5,6.25,540.5\n", &grid).unwrap();
    assert!(none.crs.is_none() && none.notes.iter().any(|n| n.contains("not used")));
    // Both kinds of coordinates: the degrees count.
    let both = b"image,x,y,lat,lon,alt\na.jpg,442000,5150000,46.5,6.25,540.5\n";
    let log = read(both, &grid).unwrap();
    assert!(matches!(log.exposures[0].position, Some(LoggedPosition::Geodetic { .. })), "{log:?}");
}

#[test]
fn names_stay_what_they_are() {
    let names =
        ["../../etc/passwd.jpg", "a \"b\".jpg", "façade été.jpg", "x, y.jpg", "C:\\DCIM\\1.jpg", "-.jpg"];
    let mut text = "image,lat,lon,alt\n".to_owned();
    for name in names {
        text += &format!("\"{}\",46.5,6.25,540.5\n", name.replace('"', "\"\""));
    }
    let log = read(text.as_bytes(), &declared()).unwrap();
    let read: Vec<_> = log.exposures.iter().map(|e| e.frame.as_deref().unwrap()).collect();
    assert_eq!(read, names);
}

#[test]
fn bad_rows_are_kept_apart() {
    let bad = [
        "b.jpg,91,6,500,1,2,3",
        "b.jpg,nan,6,500,1,2,3",
        "b.jpg,0,0,500,1,2,3",
        "b.jpg,46,6,inf,1,2,3",
        "b.jpg,46,6,1e7,1,2,3",
        ",46,6,500,1,2,3",
        "b.jpg,46,6,500,1,,3",
        "b.jpg,46,6,500,1e5,2,3",
        "b.jpg,46,6,500",
        "b.jpg,x,6,500,1,2,3",
    ];
    let text = format!("image,lat,lon,alt,omega,phi,kappa\na.jpg,46,6,500,,,\n# note\n{}\n", bad.join("\n"));
    let log = read(text.as_bytes(), &declared()).unwrap();
    assert_eq!((log.exposures.len(), log.bad.len()), (1, bad.len()), "{:?}", log.bad);
    assert_eq!(log.exposures[0].attitude, None, "empty angles are none");
    assert_eq!((log.bad[0].place, log.bad[0].frame.as_deref()), (4, Some("b.jpg")));
    assert!(log.bad[6].cause.contains("phi"));
    let spoilt = b"image,lat,lon,alt\na.jpg,46,6,500\nb\xFF.jpg,46,6,500\n";
    let log = read(spoilt, &declared()).unwrap();
    assert_eq!((log.exposures.len(), log.bad[0].place), (1, 3));
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(cut in 0usize..300, at in 0usize..300, with in any::<u8>()) {
        let text = "# CoordinateSystem: GEOGCS[\"WGS 84\"]\nimage,lat,lon,alt,omega,phi,kappa,r11\n\
                    \"a, b\",46,6,500,1,2,3,1\nc,46,6,500,1,2,3,1\n";
        let mut bytes = text.as_bytes().to_vec();
        let n = bytes.len();
        bytes[at % n] = with;
        bytes.truncate(cut % n + 1);
        if let Ok(log) = read(&bytes, &declared()) {
            prop_assert!(log.exposures.len() + log.bad.len() <= bytes.len());
        }
    }

    #[test]
    fn any_text_is_read_or_refused(text in "(?s).{0,200}") {
        let _ = read(text.as_bytes(), &declared());
        let columns = [Column::Frame, Column::X, Column::Y, Column::Height, Column::Yaw, Column::Pitch, Column::Roll];
        let with = Declared {
            columns: Some(&columns),
            crs: Some(&text),
            angles: Some(AngleSystem::CameraYawPitchRoll(North::True)),
            ..declared()
        };
        let _ = read(format!("{text} 1 2 3 4 5 6").as_bytes(), &with);
        let _ = read(b"a 1 2 3 4 5 6", &with);
    }
}
