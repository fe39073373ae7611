//! Which camera is used: a file that fits the photos, what the photos say of their lens, or a nominal focal length.

use super::Survey;
use super::scan::{CameraNumbers, FileKind, Found, shown};
use super::write::{Line, float, key, quoted_path, rounded, text};
use crate::formats::metadata::{Optics, PhotoMetadata};

/// Diagonal of the 35 mm film frame, millimetres.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;
/// What a nominal focal length is worth, of itself.
const NOMINAL_STD: f64 = 0.03;
/// How far the principal point may be from the middle, of the width.
const CENTRE_STD: f64 = 0.02;

/// `[calibrate]`, and why.
pub fn camera(survey: &Survey<'_>, left_out: &mut Vec<String>) -> Vec<Line> {
    let size = survey.size();
    let fits = |found: &&Found| match &found.kind {
        FileKind::Camera(camera) => (camera.width, camera.height) == size,
        FileKind::CameraNumbers(numbers) => numbers.size == size,
        _ => false,
    };
    let is_camera = |found: &&Found| matches!(found.kind, FileKind::Camera(_) | FileKind::CameraNumbers(_));
    let cameras: Vec<&Found> = survey.scan.files.iter().filter(is_camera).collect();
    for other in cameras.iter().filter(|found| !fits(found)) {
        left_out.push(format!(
            "{}: a camera of another image size than the photos' {} × {}",
            shown(survey.root, &other.path),
            size.0,
            size.1
        ));
    }
    // One with a covariance says what it is worth; one of a known format says what it means.
    let worth = |found: &&&Found| match &found.kind {
        FileKind::Camera(camera) => 2 + u8::from(camera.covariance.is_some()),
        _ => 1,
    };
    let mut fitting: Vec<&Found> = cameras.into_iter().filter(|found| fits(found)).collect();
    fitting.sort_by_key(|found| std::cmp::Reverse(worth(&found)));
    for other in fitting.iter().skip(1) {
        left_out.push(format!("{}: another camera file is used", shown(survey.root, &other.path)));
    }
    let lines = match fitting.first() {
        Some(found) => of_file(survey, found),
        None => of_photos(survey),
    };
    for target in survey.scan.photos.iter().filter(|folder| folder.of_target) {
        left_out.push(format!(
            "{}: {} photos, of a calibration target by the folder's name; to calibrate from them, write photos = \
             \"{}/*\" and a table [calibrate.target] instead of the camera in [calibrate]",
            shown(survey.root, &target.folder),
            target.photos.len(),
            super::write::path_from(survey.base, &target.folder).display()
        ));
    }
    lines
}

fn of_file(survey: &Survey<'_>, found: &Found) -> Vec<Line> {
    let name = shown(survey.root, &found.path);
    match &found.kind {
        FileKind::Camera(camera) => {
            let worth = match camera.covariance {
                Some(_) => "it says itself how well its numbers are known",
                None => "it does not say how well its numbers are known: they count as exact",
            };
            vec![
                Line::Table("calibrate"),
                Line::Note(format!(
                    "{name} holds a camera for images of {} × {} pixels, as the photos are; {worth}.",
                    camera.width, camera.height
                )),
                Line::Key("camera".to_owned(), quoted_path(survey.base, &found.path)),
            ]
        }
        FileKind::CameraNumbers(numbers) => of_numbers(&name, numbers),
        _ => Vec::new(),
    }
}

fn of_numbers(name: &str, numbers: &CameraNumbers) -> Vec<Line> {
    let [_, _, cx, cy] = numbers.affine;
    let (w, h) = (f64::from(numbers.size.0), f64::from(numbers.size.1));
    let half_sizes = (cx - 0.5 * w).abs() < 1e-6 && (cy - 0.5 * h).abs() < 1e-6;
    let (origin, line) = if numbers.says_corner {
        ("corner", Line::Note(format!("{name} says that the corner of the top-left pixel is (0, 0).")))
    } else if half_sizes {
        let why = "its principal point is half the width and height: pixels count from the corner of the top-left one";
        ("corner", Line::Assumed(why.to_owned()))
    } else {
        let why = "pixels count from the centre of the top-left one, as OpenCV does; \"corner\" would move every frame by \
                   half a pixel";
        ("centre", Line::Assumed(why.to_owned()))
    };
    let mut lines = vec![
        Line::Table("calibrate.parameters"),
        Line::Note(format!(
            "The numbers of {name}, which is of no format that is read by itself. It does not say how well they are known: \
             they count as exact."
        )),
        Line::Assumed("k1, k2, p1, p2, k3 are Brown's lens in OpenCV's order and sense".to_owned()),
        line,
    ];
    lines.extend(parameters(numbers.size, origin, numbers.affine, numbers.lens));
    lines
}

fn parameters(size: (u32, u32), origin: &str, affine: [f64; 4], lens: [f64; 5]) -> Vec<Line> {
    let mut lines =
        vec![key("image_width_px", size.0), key("image_height_px", size.1), text("pixel_origin", origin)];
    for (name, value) in ["fx_px", "fy_px", "cx_px", "cy_px"].into_iter().zip(affine) {
        lines.push(key(name, format!("{value:?}")));
    }
    for (name, value) in ["k1", "k2", "p1", "p2", "k3"].into_iter().zip(lens) {
        if value != 0.0 {
            lines.push(key(name, format!("{value:?}")));
        }
    }
    lines
}

/// Standard deviations of focal lengths and principal point.
fn spread(f: f64, f_share: f64, centre: f64) -> Vec<Line> {
    let mut lines = vec![Line::Table("calibrate.parameters.std")];
    for (name, value) in
        [("fx_px", f_share * f), ("fy_px", f_share * f), ("cx_px", centre), ("cy_px", centre)]
    {
        lines.push(key(name, float(value, 1)));
    }
    lines
}

fn of_photos(survey: &Survey<'_>) -> Vec<Line> {
    // A photo whose own metadata is broken speaks for no other.
    let all: Vec<&PhotoMetadata> =
        survey.photos.photos.iter().filter_map(|photo| photo.metadata.as_ref()).collect();
    let telling = all.iter().filter(|photo| photo.optics != Optics::default()).count();
    let keep = |photo: &&PhotoMetadata| telling == 0 || photo.optics != Optics::default();
    let mut photos = all.into_iter().filter(keep);
    let Some(first) = photos.next() else { return unknown(survey) };
    let others: Vec<&PhotoMetadata> = photos.collect();
    let (w, h) = survey.size();
    let middle = [0.5 * f64::from(w), 0.5 * f64::from(h)];
    if let Some(dewarp) = &first.optics.dewarp {
        let same = others
            .iter()
            .all(|p| p.optics.dewarp.as_ref().is_some_and(|d| d.distortion == dewarp.distortion));
        if let (true, Ok(camera)) = (same, dewarp.camera((w, h), first.exif_size)) {
            let interior = camera.lens.interior();
            let [fx, fy, _, cx, cy, k1, k2, p1, p2, k3, ..] = interior;
            let mut lines = vec![
                Line::Table("calibrate.parameters"),
                Line::Note(format!(
                    "DJI's own calibration of this camera, from the photos (drone-dji:DewarpData of {}).",
                    if dewarp.date.is_empty() { "no date" } else { &dewarp.date }
                )),
            ];
            lines.extend(parameters((w, h), "centre", [fx, fy, cx, cy], [k1, k2, p1, p2, k3]));
            lines.push(Line::Assumed(
                "it still holds to 0.5 % in the focal length and 0.3 % of the width".to_owned(),
            ));
            lines.extend(spread(fx, 0.005, 0.003 * f64::from(w)));
            return lines;
        }
    }
    if let Some(lines) = of_pix4d(survey, first, &others) {
        return lines;
    }
    let Some((f, from)) = nominal(&first.optics, (w, h)) else { return unknown(survey) };
    let corrected = match first.optics.dewarp.as_ref().and_then(|d| d.applied) {
        Some(true) => "the camera has corrected its lens already (DewarpFlag is 1)",
        _ => "the lens does not distort",
    };
    let mut lines = vec![
        Line::Table("calibrate.parameters"),
        Line::Assumed(format!(
            "a focal length of {f:.1} px ({from}), the principal point in the middle, and that {corrected}. A focal \
             length that is 3 % off moves the edge of each frame by 3 % of its distance from the middle: calibrate the \
             camera for more"
        )),
    ];
    let f = (f * 10.0).round() / 10.0;
    lines.extend(parameters((w, h), "corner", [f, f, middle[0], middle[1]], [0.0; 5]));
    lines.extend(spread(f, NOMINAL_STD, CENTRE_STD * f64::from(w)));
    lines
}

/// Pix4D's camera namespace: a perspective lens in millimetres or pixels of the size that the camera wrote.
fn of_pix4d(survey: &Survey<'_>, first: &PhotoMetadata, others: &[&PhotoMetadata]) -> Option<Vec<Line>> {
    let optics = &first.optics;
    let pix4d = optics.pix4d.as_ref()?;
    let perspective = pix4d.model.as_deref().is_none_or(|model| model.eq_ignore_ascii_case("perspective"));
    let [r1, r2, r3, t1, t2] = pix4d.perspective_distortion.filter(|_| perspective)?;
    let [px, py] = pix4d.principal_point_mm?;
    let [x, y] = optics.focal_plane_px_mm?;
    let f = optics.focal_length_px.as_ref().filter(|f| f.from.starts_with("Camera:"))?;
    if others.iter().any(|p| {
        p.optics.pix4d.as_ref().is_none_or(|p| p.perspective_distortion != pix4d.perspective_distortion)
    }) {
        return None;
    }
    let (w, h) = survey.size();
    let s = first.exif_size.map_or(1.0, |(ew, _)| f64::from(w) / f64::from(ew));
    let centre = [s * px * x, s * py * y];
    // A point outside the frame is in another unit than it should be.
    if !(0.0..f64::from(w)).contains(&centre[0]) || !(0.0..f64::from(h)).contains(&centre[1]) {
        return None;
    }
    let mut lines = vec![
        Line::Table("calibrate.parameters"),
        Line::Note(
            "The maker's calibration, from the photos (Camera:PerspectiveFocalLength, PrincipalPoint, PerspectiveDistortion)."
                .to_owned(),
        ),
        Line::Assumed("the principal point counts from the corner of the image".to_owned()),
    ];
    lines.extend(parameters((w, h), "corner", [f.x, f.y, centre[0], centre[1]], [r1, r2, t1, t2, r3]));
    lines
        .push(Line::Assumed("it still holds to 0.5 % in the focal length and 0.3 % of the width".to_owned()));
    lines.extend(spread(f.x, 0.005, 0.003 * f64::from(w)));
    Some(lines)
}

/// The focal length by what the photos say, pixels, and how it was derived.
pub fn nominal(optics: &Optics, size: (u32, u32)) -> Option<(f64, String)> {
    let stated = optics.focal_length_px.as_ref();
    if let Some(stated) = stated.filter(|f| !f.from.contains("35mm")) {
        return Some((0.5 * (stated.x + stated.y), stated.from.clone()));
    }
    let film = optics.focal_length_35mm_mm?;
    let stated = stated?;
    let (w, h) = (f64::from(size.0), f64::from(size.1));
    let (long, short) = (w.max(h), w.min(h));
    // The equivalent focal length counts on the whole sensor, whose shape follows from its size.
    let diagonal_mm = optics.focal_length_mm.map(|f| f * FILM_DIAGONAL_MM / film);
    let (shape, words) = match diagonal_mm {
        Some(d) if (14.5..17.5).contains(&d) || d > 25.0 => (1.5, "3:2"),
        _ => (4.0 / 3.0, "4:3"),
    };
    if long / short < shape + 0.05 {
        return Some((stated.x, format!("EXIF FocalLengthIn35mmFilm of {film} mm by the diagonal")));
    }
    let f = film * long.hypot(long / shape) / FILM_DIAGONAL_MM;
    let sensor = diagonal_mm.map_or(String::new(), |d| format!(" with a diagonal of {} mm", rounded(d, 1)));
    Some((
        f,
        format!(
            "EXIF FocalLengthIn35mmFilm of {film} mm, on the whole {words} sensor{sensor}, of which these photos of {long:.0} \
             × {short:.0} pixels are a part"
        ),
    ))
}

fn unknown(survey: &Survey<'_>) -> Vec<Line> {
    let (w, h) = survey.size();
    let f = (0.8 * f64::from(w.max(h))).round();
    let mut lines = vec![
        Line::Table("calibrate.parameters"),
        Line::Question(format!(
            "what is the camera's focal length in pixels? Neither a camera file nor the photos say it. Meanwhile it is 0.8 of \
             the longer side, {f} px, a usual wide lens, which makes every frame as many per cent too large or too small as it \
             is off. Give a camera file, photos of a calibration target (boresight target prints one), or fx_px = focal \
             length / sensor width × {}",
            w.max(h)
        )),
    ];
    lines.extend(parameters((w, h), "corner", [f, f, 0.5 * f64::from(w), 0.5 * f64::from(h)], [0.0; 5]));
    lines.extend(spread(f, 0.2, CENTRE_STD * f64::from(w)));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::metadata::FocalLengthPx;

    /// Equivalent focal lengths on the whole sensor; golden values by hand from the makers' data sheets.
    #[test]
    fn the_equivalent_focal_length_counts_on_the_whole_sensor() {
        let optics = |mm, film, f| Optics {
            focal_length_mm: Some(mm),
            focal_length_35mm_mm: Some(film),
            focal_length_px: Some(FocalLengthPx {
                x: f,
                y: f,
                from: "EXIF FocalLengthIn35mmFilm by".to_owned(),
            }),
            ..Optics::default()
        };
        let px = |optics: &Optics, size| nominal(optics, size).unwrap().0;
        // Phantom 3: 3.61 mm on 6.17 mm of 4000 pixels: 2340.
        assert!((px(&optics(3.61, 20.0, 2121.4), (4000, 2250)) / 2340.0 - 1.0).abs() < 0.02);
        // Phantom 4 Pro: 8.8 mm on 13.2 mm of 5472 pixels: 3648.
        assert!((px(&optics(8.8, 24.0, 3482.0), (5472, 3078)) / 3648.0 - 1.0).abs() < 0.01);
        // The whole sensor, and what is no equivalent at all, stay as they are.
        assert_eq!(px(&optics(3.61, 20.0, 2311.0), (4000, 3000)), 2311.0);
        let mut own = optics(3.61, 20.0, 2000.0);
        own.focal_length_px.as_mut().unwrap().from = "drone-dji:CalibratedFocalLength".to_owned();
        assert_eq!(px(&own, (4000, 2250)), 2000.0);
    }
}
