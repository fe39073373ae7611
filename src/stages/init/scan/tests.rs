//! Tests of the scan.

use super::*;
use crate::formats::atomic::{create_folder, write_atomic};
use proptest::prelude::*;

fn put(root: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = root.join(name);
    create_folder(path.parent().unwrap()).unwrap();
    write_atomic(&path, bytes).unwrap();
    path
}

/// A grey photo.
fn photo(root: &Path, name: &str, (width, height): (u32, u32)) {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::GrayImage::new(width, height).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    put(root, name, bytes.get_ref());
}

#[test]
fn the_largest_group_of_equal_photos_is_the_survey() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    for name in ["flight/b.png", "flight/a.png", "flight/c.png"] {
        photo(root, name, (40, 30));
    }
    photo(root, "flight/map.png", (99, 30));
    photo(root, "flight/upright.png", (30, 40));
    for k in 0..9 {
        photo(root, &format!("calibration/{k}.png"), (40, 30));
    }
    photo(root, "thumb.png", (4, 3));
    put(root, "flight/broken.png", b"no picture");
    let scan = scan(root).unwrap();
    let folders: Vec<_> =
        scan.photos.iter().map(|f| (shown(root, &f.folder), f.photos.len(), f.of_target)).collect();
    let expected = [("flight", 3, false), (".", 1, false), ("calibration", 9, true)];
    assert_eq!(folders, expected.map(|(name, count, target)| (name.to_owned(), count, target)));
    let first = &scan.photos[0];
    assert_eq!(first.photos.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["a.png", "b.png", "c.png"]);
    let others: Vec<_> = first.others.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(others, ["broken.png", "map.png", "upright.png"]);
    assert_eq!(first.swapped, ["upright.png"]);
}

#[test]
fn hidden_deep_linked_and_made_things_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    photo(root, "a.png", (4, 3));
    photo(root, ".hidden/a.png", (4, 3));
    photo(root, "1/2/3/4/a.png", (4, 3));
    photo(root, "1/2/3/4/5/a.png", (4, 3));
    photo(root, "out/mosaic/preview.png", (4, 3));
    put(root, "out/manifest.json", b"{}");
    #[cfg(unix)]
    std::os::unix::fs::symlink(root, root.join("again")).unwrap();
    let scan = scan(root).unwrap();
    let folders: Vec<_> = scan.photos.iter().map(|f| shown(root, &f.folder)).collect();
    assert_eq!(folders, [".", "1/2/3/4"]);
    let notes = scan.notes.join("\n");
    assert!(notes.contains("1/2/3/4/5 lies too deep") && notes.contains("out holds the products"), "{notes}");
    assert_eq!(cfg!(unix), notes.contains("again is a symbolic link"), "{notes}");
}

#[test]
fn files_are_known_by_their_content() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let kind = |name: &str, bytes: &[u8]| recognise(&put(root, name, bytes));
    let log = |name: &str, bytes: &[u8]| match kind(name, bytes) {
        Some(FileKind::Log(format)) => Some(format),
        _ => None,
    };
    assert_eq!(log("00000001.BIN", &[0xA3, 0x95, 0x80, 0x80, 0x59]), Some(LogFormat::Ardupilot));
    assert_eq!(log("a.dat", b"ULog\x01\x12\x35\x01........"), Some(LogFormat::Px4));
    assert_eq!(log("a.tlog", &[0, 5, 1, 2, 3, 4, 5, 6, 0xFD, 9]), Some(LogFormat::Mavlink));
    assert_eq!(log("a.sbet", &[0; 272]), Some(LogFormat::Sbet));
    assert_eq!(log("a.sbet", &[0; 273]), None);
    let mark =
        b"1\t111.1\t[2200]\t 1,N\t 2,E\t 3,V\t41.1,Lat\t-83.1,Lon\t300.0,Ellh\t0.01, 0.01, 0.02\t50,Q\n";
    assert_eq!(log("photos.txt", mark), Some(LogFormat::DjiMrk));
    let pos = b"% program : RTKLIB\n%  GPST   latitude(deg) longitude(deg)  height(m)   Q\n2020/01/01 0:0:0 1 2 3 1\n";
    assert_eq!(log("rover.pos", pos), Some(LogFormat::Rtklib));
    assert_eq!(log("rover_events.pos", pos), Some(LogFormat::RtklibEvents));
    assert_eq!(log("geo.txt", b"EPSG:4326\na.jpg -83.1 41.1 300\n"), Some(LogFormat::OdmGeo));
    assert_eq!(
        log("eo.txt", b"imageName X Y Z Omega Phi Kappa\na.jpg 1 2 3 4 5 6\n"),
        Some(LogFormat::Orientation)
    );
    assert_eq!(log("r.json", b"[{\"cameras\": {}, \"shots\": {}}]"), Some(LogFormat::Opensfm));
    assert!(matches!(kind("a.csv", b"file;lat;lon\na;1;2\n"), Some(FileKind::Table { delimiter: b';' })));
    for (name, bytes) in [
        ("a.csv", &b"1,2,3\n4,5,6\n"[..]),
        ("b.csv", b"file,lat,lon\n"),
        ("readme.md", b"file,lat,lon\na,1,2\n"),
        ("noise.csv", &[0xFF, 0x00, 0x80]),
        ("empty.txt", b""),
    ] {
        assert!(kind(name, bytes).is_none(), "{name}");
    }
}

#[test]
fn cameras_of_formats_and_of_plain_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let kind = |name: &str, text: &str| recognise(&put(folder.path(), name, text.as_bytes()));
    let colmap = "# Camera list\n1 PINHOLE 40 30 50 50 20 15\n";
    assert!(matches!(kind("cameras.txt", colmap), Some(FileKind::Camera(camera)) if camera.width == 40));
    let plain = r#"{"width": 1800, "height": 1350, "fx": 1278.5, "fy": 1278.25, "cx": 900, "cy": 675, "k1": -0.03,
        "note": "top-left CORNER of the image is (0,0)"}"#;
    let Some(FileKind::CameraNumbers(numbers)) = kind("camera.json", plain) else { panic!("numbers") };
    let lens = [-0.03, 0.0, 0.0, 0.0, 0.0];
    let expected = CameraNumbers {
        size: (1800, 1350),
        affine: [1278.5, 1278.25, 900.0, 675.0],
        lens,
        says_corner: true,
    };
    assert_eq!(*numbers, expected);
    for (from, to) in [
        ("\"k1\"", "\"k4\""),
        ("\"note\": \"", "\"model\": \"fisheye "),
        ("\"fx\": 1278.5,", ""),
        ("1278.25", "-1"),
    ] {
        assert!(kind("camera.json", &plain.replace(from, to)).is_none(), "{to}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_bytes_are_something_or_nothing(
        bytes in proptest::collection::vec(any::<u8>(), 0..600),
        text in "([a-z#%{\\[\"]{0,8}[,;\t\n: 0-9.]{0,3}){0,40}",
        name in "[a-z]{1,4}\\.(csv|txt|json|yaml|xml|cam|bin|tlog|sbet|pos|mrk|jpg|png|tif)",
    ) {
        let folder = tempfile::tempdir().unwrap();
        let photos = std::collections::BTreeSet::from(["a"]);
        for bytes in [&bytes[..], text.as_bytes()] {
            let path = put(folder.path(), &name, bytes);
            let _ = recognise(&path);
            let _ = super::super::tables::read(&path, b',', &photos);
            let _ = super::super::tables::points(&path, b',');
            prop_assert!(scan(folder.path()).is_ok());
        }
    }
}
