//! Tests of the whole way from a small folder to its file.

use super::*;
use crate::formats::atomic::create_folder;

/// A folder of grey photos with logs beside them.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(photos: &[&str]) -> Self {
        let folder = Self(tempfile::Builder::new().prefix("a \"b\" ü ").tempdir().unwrap());
        for name in photos {
            let mut bytes = std::io::Cursor::new(Vec::new());
            image::GrayImage::new(40, 30).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
            folder.put(name, bytes.get_ref());
        }
        folder
    }
    fn put(&self, name: &str, bytes: &[u8]) {
        let path = self.0.path().join(name);
        create_folder(path.parent().unwrap()).unwrap();
        atomic::write_atomic(&path, bytes).unwrap();
    }
    fn init(&self) -> (Written, String) {
        let written = init(self.0.path(), None, true).unwrap_or_else(|e| panic!("{e}"));
        let text = std::fs::read_to_string(&written.file).unwrap();
        assert_eq!(written.failure, None, "{text}");
        Config::load(&written.file, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        (written, text)
    }
}

const HEADER: &str = "file,lat,lon,alt_ellipsoid_m,height_above_takeoff_m,yaw,pitch,roll\n";
const CAMERA: &str = "1 PINHOLE 40 30 50 50 20 15\n";

fn about(questions: &[String]) -> Vec<&str> {
    questions.iter().map(|q| q.split('?').next().unwrap()).collect()
}

#[test]
fn a_table_and_photos_without_metadata() {
    let folder = Folder::new(&["photos/a.png", "photos/ö 'x'.png"]);
    folder.put(
        "log.csv",
        format!("{HEADER}a.png,41,-83,240,40,0,0,0\nö 'x'.png,41.0002,-83,240,40,0,0,0\n").as_bytes(),
    );
    let (written, text) = folder.init();
    assert_eq!((written.frames_used, written.frames_rejected.len()), (2, 0));
    let open = ["what is the camera's focal length in pixels", "how does the camera sit in the UAV"];
    assert_eq!(about(&written.questions), open);
    assert!(text.contains("datum = \"ellipsoid\" }\n"), "{text}");
    // The ground lies at the take-off point, on the datum that the table's column names.
    assert!(text.contains("kind = \"plane\"\nheight = \"200 m\"\ndatum = \"ellipsoid\"\n"), "{text}");
    // A camera file settles the one, and only if it fits.
    folder.put("cameras.txt", CAMERA.replace("40 30", "50 30").as_bytes());
    assert_eq!(folder.init().0.questions.len(), 2);
    folder.put("cameras.txt", CAMERA.as_bytes());
    let (written, text) = folder.init();
    assert_eq!(about(&written.questions), open[1..]);
    assert!(text.contains("camera = \"cameras.txt\"\n"), "{text}");
}

#[test]
fn photos_that_nothing_places_are_said_to_be_rejected() {
    let folder = Folder::new(&["a.png", "b.png", "c.png"]);
    folder.put(
        "log.csv",
        format!("{HEADER}a.png,41,-83,240,40,0,0,0\nb.png,41.0002,-83,240,40,0,0,0\n").as_bytes(),
    );
    folder.put("cameras.txt", CAMERA.as_bytes());
    let (written, text) = folder.init();
    assert_eq!((written.frames_used, written.frames_rejected.len()), (2, 1));
    assert!(text.contains("images = \".\"\n") && text.contains("max_rejected_frames = 1\n"), "{text}");
    assert!(text.contains("# c.png: ") && text.contains("2 of 3 images are used"), "{text}");
}

#[test]
fn a_complete_table_is_taken_before_one_that_is_there_to_judge_by() {
    let folder = Folder::new(&["a.png", "b.png"]);
    let rows = |height: u32| {
        format!("{HEADER}a.png,41,-83,{height},40,0,0,0\nb.png,41.0002,-83,{height},40,0,0,0\n")
    };
    folder.put("a_reference.csv", rows(230).as_bytes());
    folder.put("z.csv", rows(240).as_bytes());
    folder.put("cameras.txt", CAMERA.as_bytes());
    let (written, _) = folder.init();
    assert_eq!(written.poses, "the table z.csv");
    assert!(
        written.left_out.iter().any(|note| note.starts_with("a_reference.csv") && note.contains("judge"))
    );
    // Alone it is better than nothing.
    std::fs::remove_file(folder.0.path().join("z.csv")).unwrap();
    assert_eq!(folder.init().0.poses, "the table a_reference.csv");
}

#[test]
fn gimbal_angles_count_from_what_they_follow() {
    let folder = Folder::new(&["a.png", "b.png"]);
    folder.put("cameras.txt", CAMERA.as_bytes());
    let header =
        "image;latitude;longitude;alt_msl;agl;heading;pitch;roll;gimbal_yaw;gimbal_pitch;gimbal_roll\n";
    let rows = |a: i32, b: i32| {
        format!("{header}a.png;41;-83;240;40;90;0;0;{a};-90;0\nb.png;41.0002;-83;240;40;-95;0;0;{b};-90;0\n")
    };
    folder.put("log.csv", rows(88, -97).as_bytes());
    let (written, text) = folder.init();
    assert_eq!(written.questions, Vec::<String>::new());
    assert!(text.contains("gimbal_reference = \"nav\"\n") && text.contains("delimiter = \";\"\n"), "{text}");
    folder.put("log.csv", rows(1, -2).as_bytes());
    assert!(folder.init().1.contains("gimbal_reference = \"body\"\n"));
}

#[test]
fn a_geo_txt_places_photos_that_say_nothing() {
    let folder = Folder::new(&["a.png", "b.png"]);
    folder.put("cameras.txt", CAMERA.as_bytes());
    folder.put("geo.txt", b"EPSG:4326\na.png -83 41 240 10 0.5 0\nb.png -83 41.0002 240 12 0.5 0\n");
    let (written, text) = folder.init();
    assert_eq!(written.frames_used, 2);
    assert!(
        text.contains("format = \"odm_geo\"\n") && text.contains("angles = \"camera_yaw_pitch_roll\"\n"),
        "{text}"
    );
    assert!(text.contains("height_datum = \"egm96\"\n"), "{text}");
    assert_eq!(written.questions.len(), 2, "{:?}", written.questions);
}

#[test]
fn a_file_that_is_there_is_left_alone_and_so_is_a_folder_without_photos() {
    let folder = Folder::new(&[]);
    folder.put("boresight.toml", b"mine");
    let refused = |force| init(folder.0.path(), None, force).unwrap_err();
    assert_eq!(refused(false).class(), ErrorClass::Usage);
    assert_eq!(refused(true).class(), ErrorClass::Input);
    assert_eq!(std::fs::read(folder.0.path().join("boresight.toml")).unwrap(), b"mine");
    assert_eq!(
        init(&folder.0.path().join("nowhere"), Some(&folder.0.path().join("p.toml")), false)
            .unwrap_err()
            .class(),
        ErrorClass::Input
    );
}
