//! Every format against its own reader, and against hostile input.

use super::*;
use crate::camera::{Brown, Fisheye, ImagePoint, Invertibility, Pix4dFisheye, Rational, ThinPrism};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

/// Terms and sizes of a camera, of which each kind of lens takes what it needs.
type Numbers = (f64, f64, f64, [f64; 2], [f64; 6], [f64; 4], (u32, u32));

fn numbers() -> impl Strategy<Value = Numbers> {
    let term = |size: f64| -size..size;
    (
        1000.0..2000.0f64,
        0.97..1.03f64,
        term(2.0),
        proptest::array::uniform2(term(40.0)),
        // Small enough that none of them folds within the frame.
        proptest::array::uniform6(term(0.05)),
        proptest::array::uniform4(term(0.005)),
        (400..1200u32, 400..1200u32),
    )
}

fn camera_of(kind: LensKind, skewed: bool, numbers: &Numbers) -> Camera {
    let (f, aspect, skew, offset, k, p, (width, height)) = *numbers;
    let skew = if skewed { skew } else { 0.0 };
    let (cx, cy) = (0.5 * f64::from(width) + offset[0], 0.5 * f64::from(height) + offset[1]);
    let [fx, fy] = [f * aspect, f];
    let lens: Lens = match kind {
        LensKind::Brown => Brown::new([fx, fy, skew, cx, cy, k[0], k[1], p[0], p[1], k[2]]).unwrap().into(),
        LensKind::Rational => {
            Rational::new([fx, fy, skew, cx, cy, k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5]])
                .unwrap()
                .into()
        }
        LensKind::ThinPrism => ThinPrism::new([
            fx, fy, skew, cx, cy, k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5], p[2], p[3], -p[2], p[0],
        ])
        .unwrap()
        .into(),
        LensKind::Fisheye => {
            Fisheye::new([fx, fy, skew, cx, cy, k[0], 0.1 * k[1], 0.1 * k[2], 0.1 * k[3]]).unwrap().into()
        }
        LensKind::Pix4dFisheye => {
            Pix4dFisheye::new([fx, fy, skew, cx, cy, 100.0 * p[2], k[0], k[1], k[2]]).unwrap().into()
        }
    };
    Camera::new(lens, width, height, None).unwrap()
}

/// Largest distance between the pixels of 1000 random rays of a camera's frame.
fn farthest(camera: &Camera, other: &Camera, seed: u64) -> f64 {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    (0..1000)
        .map(|_| {
            let pixel = ImagePoint::new(
                random.random_range(-0.5..f64::from(camera.width) - 0.5),
                random.random_range(-0.5..f64::from(camera.height) - 0.5),
            );
            let direction = camera.lens.direction_from_pixel(pixel).unwrap();
            let seen = other.lens.pixel_from_point(&direction).unwrap();
            f64::hypot(seen.column - pixel.column, seen.row - pixel.row)
        })
        .fold(0.0, f64::max)
}

fn read(text: &str) -> Result<Camera, InputError> {
    camera_from_text(Path::new("camera.file"), text, &CameraChoice::default())
}

/// Which lenses a format holds, and whether with their skew.
fn holds(format: CameraFormat) -> (&'static [LensKind], bool) {
    use LensKind::{Brown, Fisheye, Rational, ThinPrism};
    match format {
        CameraFormat::OpenCv => (&[Brown, Fisheye, Rational, ThinPrism], true),
        CameraFormat::Ros => (&[Brown, Fisheye, Rational], false),
        CameraFormat::OpenSfm | CameraFormat::Kalibr => (&[Brown, Fisheye], false),
        CameraFormat::Orthority => (&[Brown, Fisheye, Rational, ThinPrism], false),
        CameraFormat::Metashape => (&[Brown, Fisheye], true),
        CameraFormat::Pix4d => (&[Brown], false),
        CameraFormat::Colmap => (&[Brown, Fisheye, Rational], false),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_format_sees_the_same_when_it_is_read_back(numbers in numbers(), seed: u64) {
        for kind in LensKind::ALL {
            let skewed = camera_of(kind, true, &numbers);
            let proved = matches!(skewed.invertibility(), Invertibility::Proved { .. });
            prop_assert!(proved, "{skewed:?}");
            prop_assert_eq!(read(&camera_json(&skewed, serde_json::Value::Null)).unwrap(), skewed);
            for format in CameraFormat::ALL {
                let (lenses, with_skew) = holds(format);
                let mut numbers = numbers;
                if format == CameraFormat::Kalibr {
                    let k3 = export(&camera_of(LensKind::Brown, false, &numbers), format, "x");
                    let refused = matches!(k3, Err(ExportError::NoTerm { term: "k3", .. }));
                    prop_assert!(refused || numbers.4[2] == 0.0, "{k3:?}");
                    if kind == LensKind::Brown {
                        numbers.4[2] = 0.0;
                    }
                }
                let camera = camera_of(kind, with_skew, &numbers);
                let exported = export(&camera, format, "a name: with \"quotes\" #1");
                if !lenses.contains(&kind) {
                    let refused = matches!(exported, Err(ExportError::NoLens { .. }));
                    prop_assert!(refused, "{format:?} takes a {} lens", kind.word());
                    continue;
                }
                let Exported { text, losses } = exported.unwrap();
                prop_assert_eq!(losses.iter().any(|loss| loss.contains("has no skew")), false);
                let back = read(&text);
                prop_assert!(back.is_ok(), "{format:?}: {back:?}\n{text}");
                let back = back.unwrap();
                prop_assert_eq!((back.width, back.height), (camera.width, camera.height));
                let error = farthest(&camera, &back, seed);
                prop_assert!(error < 1e-6, "{format:?}: {error} px\n{text}");
            }
        }
    }

    #[test]
    fn broken_files_are_refused_and_never_a_panic(
        which in 0..12usize, cut: prop::sample::Index,
        flips in proptest::collection::vec((any::<prop::sample::Index>(), 0..8u32), 0..6),
    ) {
        let mut bytes = samples()[which].clone().into_bytes();
        bytes.truncate(cut.index(bytes.len()) + 1);
        for (place, bit) in flips {
            let place = place.index(bytes.len());
            bytes[place] ^= 1 << bit;
        }
        let text = String::from_utf8_lossy(&bytes);
        for choice in [
            CameraChoice::default(),
            CameraChoice { name: Some("cam0"), image_size: Some((640, 480)) },
        ] {
            if let Ok(camera) = camera_from_text(Path::new("x"), &text, &choice) {
                prop_assert!(camera.width > 0 && camera.lens.interior().iter().all(|v| v.is_finite()));
            }
        }
    }
}

/// A file of every format, and some of several cameras.
fn samples() -> Vec<String> {
    let numbers =
        (900.0, 1.01, 0.0, [3.0, -4.0], [-0.1, 0.05, 0.0, 0.02, 0.01, 0.003], [1e-3; 4], (640, 480));
    let mut samples: Vec<String> = CameraFormat::ALL
        .into_iter()
        .map(|format| export(&camera_of(LensKind::Brown, true, &numbers), format, "uav").unwrap().text)
        .collect();
    samples.push(camera_json(&camera_of(LensKind::ThinPrism, true, &numbers), serde_json::Value::Null));
    samples.push(camera_json(&camera_of(LensKind::Pix4dFisheye, true, &numbers), serde_json::Value::Null));
    samples.push(
        "<document><chunk><sensors><sensor label=\"a\"><calibration type=\"frame\" class=\"adjusted\"><resolution \
         width=\"640\" height=\"480\"/><f>500</f></calibration></sensor></sensors></chunk></document>"
            .to_owned(),
    );
    samples
        .push("2018-03-13;3659.78,3653.17,-7.71,45.9,-0.269478,0.115681,-0.00008,-0.0003,-0.03".to_owned());
    samples
}

#[test]
fn what_is_lost_is_said() {
    let numbers = (900.0, 1.01, 1.5, [3.0, -4.0], [-0.1, 0.05, 0.0, 0.0, 0.0, 0.0], [1e-3; 4], (640, 480));
    let covariance = Some(InteriorCovariance::identity());
    let camera = Camera { covariance, ..camera_of(LensKind::Brown, true, &numbers) };
    for format in CameraFormat::ALL {
        let Exported { text, losses } = export(&camera, format, "uav").unwrap();
        let says = |what: &str| losses.iter().any(|loss| loss.contains(what));
        assert!(says("no place for the covariance"), "{format:?}: {losses:?}");
        let skew_is_kept = format == CameraFormat::Metashape;
        assert_eq!(says("1.5000 px"), !skew_is_kept, "{format:?}: {losses:?}");
        let back = read(&text).unwrap();
        assert!(back.covariance.is_none());
        assert_eq!(back.lens.interior()[2] == 1.5, holds(format).1, "{format:?}");
        assert_eq!(CameraFormat::from_name(format.name()), Some(format));
    }
    let Exported { losses, .. } = camera_pix4d_cam(&camera).unwrap();
    assert!(
        losses.iter().any(|l| l.contains("fx / fy = 1.01")) && losses.iter().any(|l| l.contains("0.001 mm"))
    );
}

#[test]
fn tiny_and_huge_numbers_are_numbers_for_pythons_yaml_too() {
    // PyYAML takes 1e-7 and 1.0e7 for texts: it asks for a point before the exponent and a sign in it.
    let numbers = (900.0, 1.0, 0.0, [0.0; 2], [1e-7, -2.5e-9, 0.0, 0.0, 0.0, 0.0], [0.0; 4], (640, 480));
    let camera = camera_of(LensKind::Brown, false, &numbers);
    for format in [CameraFormat::Kalibr, CameraFormat::Orthority, CameraFormat::Ros] {
        let text = export(&camera, format, "uav").unwrap().text;
        assert!(text.contains("1.e-7") && text.contains("-2.5e-9"), "{text}");
    }
    assert_eq!(opencv::row(&[1e20, 0.0, -3.0, 0.25]), "1.e+20, 0., -3., 0.25");
}

#[test]
fn hostile_files_are_refused_at_once() {
    let refused = |text: String| read(&text).unwrap_err().cause;
    let deep = format!("{}<calibration>{}", "<a>".repeat(100_000), "</a>".repeat(100_000));
    assert!(refused(deep).contains("nested deeper"));
    let within = format!("<calibration>{}", "<f>".repeat(100_000));
    assert!(refused(within).contains("nested deeper"));
    let bomb = "<!DOCTYPE x [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;\">]><calibration>&b;</calibration>";
    assert!(refused(bomb.to_owned()).contains("document type"));
    assert!(refused("<calibration><f>&b;</f></calibration>".to_owned()).contains("reference"));
    assert!(refused("<calibration><f>1</f>".to_owned()).contains("ends within <calibration>"));
    assert!(refused("<html></html>".to_owned()).contains("without a <calibration>"));
    // Nesting and aliases of YAML and JSON stop at their parsers' budgets.
    refused(format!("cam0:\n  camera_model: {}", "[".repeat(100_000)));
    refused(format!("{{\"projection_type\": {}", "[".repeat(100_000)));
    refused(format!("[{}", "{\"cameras\":".repeat(100_000)) + "\"projection_type\"");
    let mut aliases = "a: &a [x, x, x, x, x, x, x, x, x, x]\n".to_owned();
    for (name, of) in ('b'..='k').zip('a'..) {
        aliases.push_str(&format!(
            "{name}: &{name} [*{of}, *{of}, *{of}, *{of}, *{of}, *{of}, *{of}, *{of}, *{of}]\n"
        ));
    }
    refused(aliases + "camera_model: pinhole\n");
    // Numbers that are none, or no camera's.
    let good = camera_metashape_xml(&camera_of(
        LensKind::Brown,
        false,
        &(900.0, 1.0, 0.0, [0.0; 2], [0.0; 6], [0.0; 4], (640, 480)),
    ));
    let good = good.unwrap().text;
    for (from, to, what) in [
        ("<f>900.0</f>", "<f>NaN</f>", "fx_px is NaN"),
        ("<f>900.0</f>", "<f>-inf</f>", "-inf"),
        ("<f>900.0</f>", "<f>0</f>", "must be positive"),
        ("<width>640</width>", "<width>0</width>", "no pixels"),
        ("<width>640</width>", "<width>99999999999</width>", "not a number of pixels"),
        ("<width>640</width>", "<width>-640</width>", "not a number of pixels"),
    ] {
        assert!(good.contains(from), "{good}");
        let cause = refused(good.replace(from, to));
        assert!(cause.contains(what), "{cause}");
    }
}
