//! Files made to break readers: every cut, flipped bits, absurd numbers, bombs.

use super::build::{Exif, attributes, finds, jpeg, packet, parse};
use crate::formats::metadata::{PhotoMetadata, Severity, flight_log, read};
use proptest::prelude::*;
use std::io::Cursor;
use std::time::Instant;

fn rich() -> Exif {
    Exif::little()
        .text(0x10F, "DJI")
        .text(0x110, "FC6310")
        .short(0x112, 1)
        .text(0x132, "2016:06:23 16:31:59")
        .text(0x9003, "2016:06:23 16:31:59")
        .rationals(0x829A, &[(1, 400)])
        .rationals(0x920A, &[(88, 10)])
        .short(0xA405, 24)
        .long(0xA002, 640)
        .long(0xA003, 480)
        .text(0x1D, "2016:06:23")
        .rationals(7, &[(21, 1), (31, 1), (59, 1)])
        .with_gps()
}

fn packet_of_many() -> String {
    packet(
        "<rdf:Description xmlns:d='http://www.dji.com/drone-dji/1.0/' d:GimbalYawDegree='3' d:GimbalPitchDegree='-90' \
         d:GimbalRollDegree='180' d:AbsoluteAltitude='+300.2' d:DewarpData='d;1,2,3,4,5,6,7,8,9'/>\
         <rdf:Description xmlns:c='http://pix4d.com/camera/1.0/'><c:BandName><rdf:Seq><rdf:li>R</rdf:li></rdf:Seq>\
         </c:BandName><c:GPSXYAccuracy>1/2</c:GPSXYAccuracy></rdf:Description>",
    )
}

/// Whatever is read must be fit for use.
fn check(photo: &PhotoMetadata) {
    assert_eq!(photo.exposure.position.is_none(), photo.no_position.is_some());
    if let Some(focal) = &photo.optics.focal_length_px {
        assert!(focal.x.is_finite() && focal.x > 0.0);
    }
    let sizes = photo.findings.iter().map(|f| f.text.len()).sum::<usize>();
    assert!(photo.findings.len() < 100 && sizes < 40_000);
}

#[test]
fn cut_at_every_byte() {
    let whole = jpeg(Some(&rich()), Some(&packet_of_many()), (640, 480));
    let tiff = rich().raw(700, 1, packet_of_many().into_bytes()).bytes();
    for file in [&whole, &tiff] {
        for length in 0..file.len() {
            if let Ok(photo) = read(&mut Cursor::new(&file[..length])) {
                check(&photo);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn flipped_bits_never_panic(flips in proptest::collection::vec((any::<prop::sample::Index>(), 0..8u8), 1..12), as_tiff: bool) {
        let mut file = if as_tiff {
            rich().long(256, 640).long(257, 480).raw(700, 1, packet_of_many().into_bytes()).bytes()
        } else {
            jpeg(Some(&rich()), Some(&packet_of_many()), (640, 480))
        };
        for (at, bit) in flips {
            let at = at.index(file.len());
            file[at] ^= 1 << bit;
        }
        if let Ok(photo) = read(&mut Cursor::new(&file)) {
            check(&photo);
            let log = flight_log(vec![("f".to_owned(), photo)]);
            prop_assert_eq!(log.exposures.len() + log.bad.len(), 1);
        }
    }

    #[test]
    fn random_bytes_never_panic(magic in 0..4usize, bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let magic: &[u8] = [&b"\xFF\xD8\xFF\xE1"[..], b"II\x2a\0\x08\0\0\0", b"MM\0\x2a\0\0\0\x08", b"\x89PNG\r\n\x1a\n"][magic];
        let file = [magic, &bytes].concat();
        if let Ok(photo) = read(&mut Cursor::new(&file)) {
            check(&photo);
        }
    }

    #[test]
    fn random_xmp_values_never_panic(name in 0..12usize, value in "\\PC{0,40}") {
        let name = ["GpsLatitude", "GpsLongitude", "AbsoluteAltitude", "GimbalYawDegree", "GimbalPitchDegree",
            "GimbalRollDegree", "DewarpData", "UTCAtExposure", "RtkFlag", "FlightXSpeed", "AltitudeType", "CamReverse"][name];
        let escaped = value.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
        let text = attributes("http://www.dji.com/drone-dji/1.0/", &[("GpsLongitude", "3"), (name, &escaped), ("FlightYSpeed", "1")]);
        check(&parse(&jpeg(None, Some(&text), (640, 480))));
    }
}

fn refused(exif: Exif) -> PhotoMetadata {
    let photo = parse(&jpeg(Some(&exif), None, (640, 480)));
    assert!(photo.exposure.position.is_none());
    assert!(finds(&photo, Severity::Error, "no usable position"), "{:?}", photo.findings);
    photo
}

#[test]
fn absurd_positions_and_times_are_refused_with_their_numbers() {
    let at = |lat: &[(u32, u32)], height: (u32, u32)| {
        Exif::default()
            .text(1, "N")
            .rationals(2, lat)
            .text(3, "E")
            .rationals(4, &[(3, 1), (0, 1), (0, 1)])
            .rationals(6, &[height])
    };
    let photo = refused(at(&[(41, 1), (5, 0), (0, 1)], (10, 1)));
    assert!(finds(&photo, Severity::Warning, "GPSLatitude holds 5/0"), "{:?}", photo.findings);
    let photo = refused(at(&[(0, 0), (0, 0), (0, 0)], (10, 1)));
    assert!(finds(&photo, Severity::Warning, "0/0"), "{:?}", photo.findings);
    let photo = refused(at(&[(91, 1), (0, 1), (0, 1)], (10, 1)));
    assert!(photo.no_position.unwrap().contains("latitude 91"));
    let photo = refused(at(&[(41, 1), (0, 1), (0, 1)], (10, 0)));
    assert!(
        finds(&photo, Severity::Warning, "GPSAltitude is not used: it holds 10/0"),
        "{:?}",
        photo.findings
    );
    let photo = refused(at(&[(41, 1), (0, 1), (0, 1)], (u32::MAX, 1)));
    assert!(photo.no_position.unwrap().contains("4294967295"));
    let nowhere = Exif::default().text(1, "N").rationals(2, &[(0, 1)]).text(3, "E").rationals(4, &[(0, 1)]);
    assert!(refused(nowhere).no_position.unwrap().contains("both 0"));
    refused(Exif::default().rationals(2, &[(41, 1)]).rationals(4, &[(3, 1)]));
    refused(Exif::default());
    for time in ["0001:01:01 00:00:00", "2016:13:41 25:61:61", "9999:99:99 99:99:99"] {
        let exif = Exif::default().with_gps().text(0x9003, time);
        let photo = parse(&jpeg(Some(&exif), None, (640, 480)));
        assert!(photo.times.civil.is_none() && photo.exposure.position.is_some());
        assert!(finds(&photo, Severity::Warning, "DateTimeOriginal is not used"), "{:?}", photo.findings);
    }
    let exif = Exif::default().with_gps().text(0x1D, "2016:06:23").rationals(7, &[(25, 1), (0, 1), (0, 1)]);
    assert!(parse(&jpeg(Some(&exif), None, (640, 480))).times.gps.is_none());
}

#[test]
fn absurd_xmp_takes_only_itself_along() {
    let uri = "http://www.dji.com/drone-dji/1.0/";
    let text = attributes(
        uri,
        &[
            ("GpsLatitude", "nan"),
            ("GpsLongitude", "1/0"),
            ("FlightXSpeed", "300"),
            ("FlightYSpeed", "0"),
            ("GimbalYawDegree", "1e300"),
            ("GimbalPitchDegree", "-90"),
            ("GimbalRollDegree", "0"),
            ("FlightYawDegree", "5"),
            ("DewarpData", "x;1,2"),
        ],
    );
    let photo = parse(&jpeg(Some(&Exif::default().with_gps()), Some(&text), (640, 480)));
    // EXIF's position remains.
    assert!(photo.exposure.position.is_some());
    assert!(photo.exposure.gimbal.is_none() && photo.exposure.attitude.is_none());
    assert!(photo.exposure.ground_speed_m_s.is_none() && photo.optics.dewarp.is_none());
    for text in ["\"nan\"", "zero denominator", "300 m/s", "FlightPitchDegree is absent", "DewarpData"] {
        assert!(finds(&photo, Severity::Warning, text), "{text}: {:?}", photo.findings);
    }
}

#[test]
fn bombs_cost_nothing() {
    let start = Instant::now();
    let depth = packet(&"<rdf:Seq>".repeat(100_000));
    let bomb =
        format!("<!DOCTYPE l [<!ENTITY a \"{}\">]>{}", "b".repeat(1000), packet("<rdf:li>&a;</rdf:li>"));
    for text in [&depth, &bomb] {
        let tiff = Exif::default().with_gps().raw(700, 1, text.as_bytes().to_vec()).bytes();
        let photo = parse(&tiff);
        assert!(finds(&photo, Severity::Warning, "the XMP packet is not used"));
        assert!(photo.exposure.position.is_some());
    }
    // Tags that share their bytes: two thousand XMP packets of a megabyte, two thousand texts.
    for (tag, kind, size) in [(700u16, 1, 1_000_000), (0x10E, 2, 4096)] {
        let mut shared = [&b"MM\0\x2a\0\0\0\x08"[..], &2000u16.to_be_bytes()].concat();
        for _ in 0..2000 {
            shared.extend(
                [&tag.to_be_bytes()[..], &[0, kind], &u32::to_be_bytes(size), &[0, 0, 0, 8]].concat(),
            );
        }
        shared.resize(1_100_000, b' ');
        let read = read(&mut Cursor::new(&shared));
        assert_eq!(read.is_err(), tag == 0x10E);
    }
    // Directories that point at themselves, and tags that claim four thousand million values.
    let mut looped = Exif::default().with_gps().bytes();
    looped[8..10].copy_from_slice(&0xFFFFu16.to_be_bytes());
    let _ = read(&mut Cursor::new(&looped));
    let huge = Exif::default().with_gps().raw(0x10E, 5, vec![0xFF; 8]);
    let _ = parse(&jpeg(Some(&huge), None, (640, 480)));
    assert!(start.elapsed().as_secs_f64() < 1.0, "{:?}", start.elapsed());
}
