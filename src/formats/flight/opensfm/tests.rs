//! References, several reconstructions, and what a shot can lack.

use super::*;
use proptest::prelude::*;

const SHOT: &str =
    r#"{"camera": "c", "rotation": [2.2, -2.2, 0.01], "translation": [1.5, 2.5, 30.0], "merge_cc": 0}"#;
const REFERENCE: &str = r#"{"latitude": 46.5, "longitude": -91.5, "altitude": 180.0}"#;

fn file(shots: &str) -> String {
    format!(r#"[{{"cameras": {{}}, "shots": {{{shots}}}, "points": {{}}, "reference_lla": {REFERENCE}}}]"#)
}

fn topocentric(text: &str) -> Result<FlightLog, ReadError> {
    read(text.as_bytes(), Axes::Topocentric, None, None)
}

#[test]
fn several_reconstructions_in_the_files_order() {
    let one = file(&format!(r#""z.jpg": {SHOT}, "../a b.jpg": {SHOT}"#));
    let two = format!(
        "[{}, {}]",
        one.trim_matches(['[', ']']),
        file(&format!(r#""é.jpg": {SHOT}"#)).trim_matches(['[', ']'])
    );
    let log = topocentric(&two).unwrap();
    let names: Vec<_> = log.exposures.iter().map(|e| (e.place, e.frame.as_deref().unwrap())).collect();
    assert_eq!(names, [(1, "z.jpg"), (2, "../a b.jpg"), (3, "é.jpg")]);
    assert!(log.notes.iter().any(|n| n.contains("2 reconstructions")));
    let single = one.trim_matches(['[', ']']);
    assert_eq!(topocentric(single).unwrap().exposures.len(), 2);
}

#[test]
fn a_reference_is_needed_and_heights_are_what_the_user_says() {
    let text = file(&format!(r#""a.jpg": {SHOT}"#));
    let without = text.replace("reference_lla", "other");
    let refused = topocentric(&without).unwrap_err();
    assert!(refused.help.unwrap().contains("reference_lla.json"));
    let given = read(without.as_bytes(), Axes::Topocentric, Some(REFERENCE.as_bytes()), None).unwrap();
    let own = topocentric(&text).unwrap();
    assert_eq!(given.exposures[0].position, own.exposures[0].position);
    let sea = HeightKind::SeaLevel(crate::geodesy::GeoidModel::Egm96);
    let log = read(text.as_bytes(), Axes::Topocentric, None, Some(sea)).unwrap();
    let (
        Some(LoggedPosition::Geodetic { latitude, longitude, height_m, kind }),
        Some(LoggedPosition::Ecef(point)),
    ) = (log.exposures[0].position, own.exposures[0].position)
    else {
        panic!()
    };
    assert_eq!(kind, sea);
    let same = Geodetic { latitude, longitude, height: crate::units::Metres::new(height_m) };
    assert!(WGS84.ecef_from_geodetic(&same).distance_to(&point) < 1e-6);
    for bad in [
        r#"{"latitude": 91, "longitude": 0, "altitude": 1}"#,
        r#"{"latitude": 0, "longitude": 0, "altitude": 1}"#,
        r#"{"latitude": "x"}"#,
        "[",
        "3",
    ] {
        assert!(read(without.as_bytes(), Axes::Topocentric, Some(bad.as_bytes()), None).is_err(), "{bad}");
    }
}

#[test]
fn bad_shots_are_kept_apart() {
    let bad = [
        r#"{"rotation": [1, 2], "translation": [1, 2, 3]}"#,
        r#"{"rotation": [1, 2, NaN], "translation": [1, 2, 3]}"#,
        r#"{"rotation": [1, 2, 3]}"#,
        r#"{"rotation": [1e6, 2, 3], "translation": [1, 2, 3]}"#,
        r#"{"rotation": [0, 0, 0], "translation": [1e8, 2, 3]}"#,
        r#"{"rotation": [0, 0, 0], "translation": [0, 0, 200000]}"#,
        r#"{"rotation": [0, 0, 0], "translation": [0, 0, -Infinity]}"#,
        "null",
    ];
    let shots: Vec<_> = bad.iter().enumerate().map(|(i, shot)| format!(r#""{i}.jpg": {shot}"#)).collect();
    let log = topocentric(&file(&format!(r#""a.jpg": {SHOT}, {}"#, shots.join(", ")))).unwrap();
    assert_eq!((log.exposures.len(), log.bad.len()), (1, bad.len()), "{:?}", log.bad);
    assert_eq!((log.bad[0].place, log.bad[0].frame.as_deref()), (2, Some("0.jpg")));
    assert!(topocentric("[]").is_err() && topocentric("{}").is_err() && topocentric("").is_err());
    assert!(topocentric(&"[".repeat(100_000)).is_err());
    let whole = Axes::Grid { crs: "EPSG:32615", offset: [0.0, 0.0] };
    let far = SHOT
        .replace("[1.5, 2.5, 30.0]", "[-576000, -5188000, -200]")
        .replace("[2.2, -2.2, 0.01]", "[0, 0, 0]");
    let log = read(file(&format!(r#""a.jpg": {far}"#)).as_bytes(), whole, None, None).unwrap();
    let Some(LoggedPosition::Projected { map, .. }) = log.exposures[0].position else { panic!() };
    assert_eq!((map.easting, map.northing), (576_000.0, 5_188_000.0), "without an offset");
    let grid = Axes::Grid { crs: "EPSG:4326", offset: [0.0, 0.0] };
    assert!(read(file(SHOT).as_bytes(), grid, None, None).is_err());
}

#[test]
fn odms_coords_txt() {
    let (crs, offset) = coords_txt(b"WGS84 UTM 15N\n576529 5188003\n-9.1 2.2 198.6\n").unwrap();
    assert_eq!((crs.as_str(), offset), ("EPSG:32615", [576_529.0, 5_188_003.0]));
    for bad in [&b""[..], b"WGS84 UTM 15N", b"WGS84 UTM 15N\n1\n", b"WGS84 UTM 15N\n1 x\n", b"x\n1 2\n"] {
        assert!(coords_txt(bad).is_err());
    }
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(cut in 0usize..600, at in 0usize..600, with in any::<u8>(), grid: bool) {
        let mut bytes = file(&format!(r#""a.jpg": {SHOT}, "b": {SHOT}"#)).into_bytes();
        let n = bytes.len();
        bytes[at % n] = with;
        bytes.truncate(cut % n + 1);
        let axes = if grid { Axes::Grid { crs: "EPSG:32615", offset: [5e5, 5e6] } } else { Axes::Topocentric };
        if let Ok(log) = read(&bytes, axes, None, None) {
            prop_assert!(log.exposures.len() + log.bad.len() <= bytes.len());
        }
        let _ = read(b"{\"shots\": {}}", axes, Some(&bytes), None);
        let _ = coords_txt(&bytes);
    }
}
