//! Rows in every layout that RTKLIB writes.

use super::*;
use crate::geodesy::{Geodetic, GeoidModel};
use proptest::prelude::*;

const LLH: &str = "% program   : RTKPOST ver.2.4.3\r\n\
% obs start : 2023/06/01 15:00:00.0 GPST (week2264 399600.0s)\r\n\
% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\r\n\
%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)\r\n\
2023/06/01 15:12:53.488   44.428246370    1.261963310   359.4940   1  17   0.0080   0.0070   0.0150   0.0010  -0.0020   0.0030   0.10   12.3    1.50000   -2.50000    0.25000\r\n\
2023/06/01 15:12:53.688   44.428246400    1.261963320   359.5040   2  17   0.1080   0.1070   0.2150   0.0010  -0.0020   0.0030   0.10    1.3    1.50000   -2.50000    0.25000\r\n";

fn geodetic_of(position: &LoggedPosition) -> (f64, f64, f64, HeightKind) {
    match position {
        LoggedPosition::Geodetic { latitude, longitude, height_m, kind } => {
            (latitude.degrees(), longitude.degrees(), *height_m, *kind)
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_track_with_velocities() {
    let log = read(LLH.as_bytes(), false, None).unwrap();
    assert_eq!((log.positions.len(), log.velocities.len(), log.exposures.len(), log.bad.len()), (2, 2, 0, 0));
    let first = &log.positions[0];
    assert_eq!(first.place, 5);
    // GPS was 18 s ahead of UTC: 15:12:35.488 UTC.
    assert!((first.time.get() - 1_685_632_355.488).abs() < 1e-6, "{:?}", first.time);
    let (lat, lon, height, kind) = geodetic_of(&first.value);
    assert!((lat - 44.428_246_37).abs() < 1e-12 && (lon - 1.261_963_31).abs() < 1e-12);
    assert!((height - 359.494).abs() < 1e-12);
    assert_eq!(kind, HeightKind::Ellipsoid);
    assert_eq!(log.velocities[0].value, Displacement::new(1.5, -2.5, -0.25));
    assert!(log.notes.iter().any(|n| n.contains("1 fixed, 1 float")), "{:?}", log.notes);
    assert!(log.origins.iter().any(|o| o.quantity == "position" && o.from.contains("latitude(deg)")));
}

#[test]
fn events_are_exposures_with_their_sigmas() {
    let log = read(LLH.as_bytes(), true, None).unwrap();
    assert_eq!((log.positions.len(), log.exposures.len()), (0, 2));
    let e = &log.exposures[1];
    assert_eq!((e.std.north_m, e.std.east_m, e.std.up_m), (Some(0.108), Some(0.107), Some(0.215)));
    assert_eq!((e.place, e.frame.as_deref(), e.sequence), (6, None, None));
    assert!(e.velocity.is_some());
}

#[test]
fn every_clock_and_layout_gives_the_same_instant_and_place() {
    let week = LLH.replace("2023/06/01 15:12:53.488", "2264 400373.488");
    let utc = LLH.replace("  GPST ", "  UTC ").replace("15:12:53.488", "15:12:35.488");
    let utc_week = LLH.replace("  GPST ", "  UTC ").replace("2023/06/01 15:12:53.488", "2264 400355.488");
    let jst = LLH.replace("  GPST ", "  JST ").replace("2023/06/01 15:12:53.488", "2023/06/02 00:12:35.488");
    let comma: String = LLH
        .lines()
        .map(|line| {
            let cells: Vec<_> = line.split_whitespace().collect();
            match cells[..] {
                ["%", "GPST", ..] => format!("%  {}\n", cells[1..].join(",")),
                [date, time, ..] if !date.starts_with('%') => {
                    format!("{date} {time},{}\n", cells[2..].join(","))
                }
                _ => format!("{line}\n"),
            }
        })
        .collect();
    let dms = LLH
        .replace("latitude(deg) longitude(deg)", "latitude(d'\") longitude(d'\")")
        .replace("44.428246370    1.261963310", "44 25 41.686932    1 15 43.067916")
        .replace("44.428246400    1.261963320", "44 25 41.687040    1 15 43.067952");
    for (name, text) in
        [("week", week), ("UTC", utc), ("UTC week", utc_week), ("JST", jst), ("comma", comma), ("dms", dms)]
    {
        let log = read(text.as_bytes(), false, None).unwrap();
        assert_eq!((log.positions.len(), log.bad.len()), (2, 0), "{name}: {:?}", log.bad);
        let first = &log.positions[0];
        assert!((first.time.get() - 1_685_632_355.488).abs() < 1e-6, "{name}: {:?}", first.time);
        let (lat, lon, height, _) = geodetic_of(&first.value);
        assert!((lat - 44.428_246_37).abs() < 1e-11 && (lon - 1.261_963_31).abs() < 1e-11, "{name}");
        assert!((height - 359.494).abs() < 1e-12, "{name}");
    }
}

#[test]
fn degrees_of_minus_zero_are_south() {
    let text = LLH
        .replace("latitude(deg) longitude(deg)", "latitude(d'\") longitude(d'\")")
        .replace("44.428246370    1.261963310", "-0 30 00.00000    -0 15 60.00000");
    let log = read(text.as_bytes(), false, None).unwrap();
    let (lat, lon, ..) = geodetic_of(&log.positions[0].value);
    assert!((lat + 0.5).abs() < 1e-12 && (lon + 16.0 / 60.0).abs() < 1e-12, "{lat} {lon}");
}

#[test]
fn earth_centred_rows_and_their_sigmas() {
    // At 0°N 90°E north is z, east is -x, up is y; at 44.4°N the sigmas mix, but their squares' sum stays.
    let head = "% (x/y/z-ecef=WGS84,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n\
                %  GPST  x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio vx(m/s) vy(m/s) vz(m/s)\n";
    let text =
        format!("{head}2264 400373.488 0.0 6378237.0 0.0 1 9 0.03 0.05 0.02 0.01 -0.01 0 0 9 -4.0 2.0 3.0\n");
    let log = read(text.as_bytes(), true, None).unwrap();
    let e = &log.exposures[0];
    let close = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 1e-12;
    assert!(
        close(e.std.north_m, 0.02) && close(e.std.east_m, 0.03) && close(e.std.up_m, 0.05),
        "{:?}",
        e.std
    );
    let v = e.velocity.unwrap().vector();
    assert!((v - Vector3::new(3.0, 4.0, -2.0)).norm() < 1e-12, "{v}");
    let at = WGS84.ecef_from_geodetic(&Geodetic::from_degrees(44.0, 1.0, 300.0));
    let text = format!(
        "{head}2264 400373.488 {} {} {} 1 9 0.03 0.05 0.02 0.01 -0.01 0.02 0 9 0 0 0\n",
        at.x(),
        at.y(),
        at.z()
    );
    let log = read(text.as_bytes(), true, None).unwrap();
    let s = log.exposures[0].std;
    let trace: f64 = [s.north_m, s.east_m, s.up_m].iter().map(|s| s.unwrap().powi(2)).sum();
    assert!((trace - (0.03f64.powi(2) + 0.05f64.powi(2) + 0.02f64.powi(2))).abs() < 1e-12);
    assert!(matches!(log.exposures[0].position, Some(LoggedPosition::Ecef(_))));
}

#[test]
fn heights_are_asked_for_when_the_file_does_not_say() {
    let geodetic = LLH.replace("WGS84/ellipsoidal", "WGS84/geodetic");
    assert!(read(geodetic.as_bytes(), false, None).unwrap_err().help.unwrap().contains("`height_datum`"));
    let sea = HeightKind::SeaLevel(GeoidModel::Egm96);
    let log = read(geodetic.as_bytes(), false, Some(sea)).unwrap();
    assert_eq!(geodetic_of(&log.positions[0].value).3, sea);
    let silent = LLH.replace("(lat/lon/height=WGS84/ellipsoidal,", "(");
    assert!(read(silent.as_bytes(), false, None).is_err());
    assert!(read(silent.as_bytes(), false, Some(HeightKind::Ellipsoid)).is_ok());
    assert!(read(LLH.as_bytes(), false, Some(sea)).unwrap_err().cause.contains("EGM96"), "contradiction");
}

#[test]
fn what_is_no_track_is_refused_in_words() {
    let baseline = "%  GPST e-baseline(m) n-baseline(m) u-baseline(m) Q ns\n2264 1.0 1 2 3 1 9\n";
    assert!(read(baseline.as_bytes(), false, None).unwrap_err().cause.contains("baselines"));
    let tokyo = LLH.replace("WGS84/ellipsoidal", "Tokyo/ellipsoidal");
    let refused = read(tokyo.as_bytes(), false, None).unwrap_err();
    assert!(refused.cause.contains("Tokyo") && refused.line == Some(3), "{refused:?}");
    assert!(read(b"", false, None).is_err());
    assert!(read(b"2264 1.0 44 1 300 1 9\n", false, None).unwrap_err().cause.contains("header"));
    let zone = LLH.replace("  GPST ", "  CEST ");
    assert!(read(zone.as_bytes(), false, None).unwrap_err().cause.contains("CEST"));
}

#[test]
fn bad_rows_are_kept_apart() {
    let row = "2023/06/01 15:12:53.488   44.428246370    1.261963310   359.4940   1  17   0.0080   0.0070   0.0150   0.0010  -0.0020   0.0030   0.10   12.3    1.50000   -2.50000    0.25000";
    let bad = [
        row.replace("44.428246370", "91.0"),
        row.replace("44.428246370", "nan"),
        row.replace("44.428246370    1.261963310", "0.0 0.0"),
        row.replace("359.4940", "1e9"),
        row.replace("359.4940   1 ", "359.4940   0 "),
        row.replace("2023/06/01", "0001/06/01"),
        row.replace("2023/06/01", "2023/13/01"),
        row.replace("15:12:53.488", "25:12:53.488"),
        row.replace("1.50000", "300.0"),
        row.replace("2023/06/01 15:12:53.488", "2264 700000"),
        row.replace("2023/06/01 15:12:53.488", "99999 7000"),
        "2023/06/01 15:12:53.488 44.4".to_owned(),
    ];
    let log = read(format!("{LLH}{}\n", bad.join("\n")).as_bytes(), false, None).unwrap();
    assert_eq!((log.positions.len(), log.bad.len()), (2, bad.len()), "{:?}", log.bad);
    assert!(log.bad[0].cause.contains("91") && log.bad[0].place == 7);
    assert!(log.bad[8].cause.contains("speed"));
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(cut in 0usize..1200, at in 0usize..1200, with in any::<u8>(), events: bool) {
        let mut bytes = LLH.as_bytes().to_vec();
        let n = bytes.len();
        bytes[at % n] = with;
        bytes.truncate(cut % n + 1);
        if let Ok(log) = read(&bytes, events, Some(HeightKind::Ellipsoid)) {
            prop_assert!(log.positions.len() + log.exposures.len() + log.bad.len() <= bytes.len());
        }
    }
}
