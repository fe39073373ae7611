//! Rows of every length, and the question what the angles are.

use super::super::{HeightKind, LoggedAttitude, LoggedPosition, North};
use super::*;
use crate::geodesy::GeoidModel;
use proptest::prelude::*;

fn declared<'a>() -> Declared<'a> {
    Declared { heights: Some(HeightKind::SeaLevel(GeoidModel::Egm96)), ..Declared::default() }
}

#[test]
fn odms_own_example() {
    let text = b"\xEF\xBB\xBFEPSG:4326\r\nDJI_0028.JPG -91.9942096111111 46.84252125 198.609\r\n\
                 # a comment\r\nDJI_0032.JPG    -91.9938293055556\t46.8424584444444 198.609\r\n";
    let log = read(text, &declared()).unwrap();
    assert_eq!((log.exposures.len(), log.bad.len(), log.crs.clone()), (2, 0, None));
    let e = &log.exposures[1];
    assert_eq!((e.place, e.frame.as_deref(), e.attitude), (4, Some("DJI_0032.JPG"), None));
    let Some(LoggedPosition::Geodetic { latitude, longitude, .. }) = e.position else { panic!() };
    assert!((latitude.degrees() - 46.842_458_444_444_4).abs() < 1e-12);
    assert!((longitude.degrees() + 91.993_829_305_555_6).abs() < 1e-12);
}

#[test]
fn rows_of_every_length_on_a_grid() {
    let text = "+proj=utm +zone=15 +datum=WGS84 +units=m +no_defs\n\
                a.jpg 576000 5188000\n\
                b.jpg 576000 5188000 200\n\
                c.jpg 576000 5188000 200 label\n\
                d.jpg 576000 5188000 200 0 0 0\n\
                e.jpg 576000 5188000 200 nan nan nan 0.02 0.03\n\
                f.jpg 576000 5188000 200 10 20 -3\n\
                g.jpg 576000 5188000 200 0 0 0 0.02 0.03 some label\n\
                h.jpg\n";
    let asked = read(text.as_bytes(), &declared()).unwrap_err();
    assert_eq!(asked.line, Some(7));
    assert!(asked.cause.contains("10 20 -3") && asked.help.unwrap().contains("angles"));
    let camera = AngleSystem::CameraYawPitchRoll(North::True);
    let log = read(text.as_bytes(), &Declared { angles: Some(camera), ..declared() }).unwrap();
    let names: Vec<_> = log.exposures.iter().map(|e| e.frame.as_deref().unwrap()).collect();
    assert_eq!(names, ["b.jpg", "c.jpg", "d.jpg", "e.jpg", "f.jpg", "g.jpg"]);
    assert_eq!(log.bad.iter().map(|b| b.place).collect::<Vec<_>>(), [2, 9]);
    assert!(log.bad[0].cause.contains("geo_z"), "{}", log.bad[0].cause);
    let with: Vec<_> = log.exposures.iter().map(|e| e.attitude.is_some()).collect();
    assert_eq!(with, [false, false, false, false, true, false]);
    assert!(matches!(log.exposures[4].attitude, Some(LoggedAttitude::Camera { .. })));
    assert_eq!(log.exposures[3].std.up_m, Some(0.03));
    assert_eq!(log.exposures[5].std.north_m, Some(0.02));
    assert!(log.crs.unwrap().starts_with("+proj=utm"));
    // Without the row of angles nobody is asked.
    let silent = text.replace("10 20 -3", "0 0 0.0");
    assert!(read(silent.as_bytes(), &declared()).is_ok());
}

#[test]
fn the_first_line_is_the_crs() {
    let utm = |zone: &str| read(format!("WGS84 UTM {zone}\na 576000 5188000 200\n").as_bytes(), &declared());
    assert_eq!(utm("17N").unwrap().crs.as_deref(), Some("EPSG:32617"));
    assert_eq!(utm("23S").unwrap().crs.as_deref(), Some("EPSG:32723"));
    assert!(utm("61N").is_err() && utm("N").is_err() && utm("17").is_err());
    for bad in ["a.jpg 1 2 3", "EPSG:", "EPSG:abc", "", "LOCAL_CS[\"x\"]"] {
        assert!(read(format!("{bad}\na 1 2 3\n").as_bytes(), &declared()).is_err(), "{bad}");
    }
    let ecef = read(b"EPSG:32617\na 1115000 -4843000 3983000\n", &declared()).unwrap_err();
    assert!(ecef.cause.contains("Earth-centred"), "{}", ecef.cause);
    assert!(read(b"EPSG:4978\na 1115000 -4843000 3983000\n", &Declared::default()).is_ok());
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(cut in 0usize..200, at in 0usize..200, with in any::<u8>()) {
        let mut bytes = b"EPSG:32615\na.jpg 576000 5188000 200 10 20 -3 0.02 0.03 x\nb 1 2 3\n".to_vec();
        let n = bytes.len();
        bytes[at % n] = with;
        bytes.truncate(cut % n + 1);
        let angles = Some(AngleSystem::CameraYawPitchRoll(North::True));
        if let Ok(log) = read(&bytes, &Declared { angles, ..declared() }) {
            prop_assert!(log.exposures.len() + log.bad.len() <= bytes.len());
        }
    }
}
