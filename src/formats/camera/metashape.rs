//! Metashape's calibration: the XML that its camera calibration window saves, and the sensors of an exported or saved
//! project.
//!
//! ```text
//! x' = x (1 + K1 r² + K2 r⁴ + K3 r⁶ + K4 r⁸) + P1 (r² + 2 x²) + 2 P2 x y
//! y' = y (1 + K1 r² + K2 r⁴ + K3 r⁶ + K4 r⁸) + P2 (r² + 2 y²) + 2 P1 x y
//! u = w / 2 + cx + x' f + x' B1 + y' B2,  v = h / 2 + cy + y' f
//! ```
//!
//! So P1 is our p2 and P2 our p1, fx = f + B1, fy = f and the skew is B2, exactly. The centre of the top-left pixel is
//! (0.5, 0.5) there: w / 2 + cx becomes (w − 1) / 2 + cx in our pixels. Of a fisheye, (x, y) = θ (X, Y) / R: the
//! Kannala–Brandt lens with K1 … K4 when P1 and P2 are zero. A frame camera's K4, P3 and P4 are of no lens of ours:
//! refused unless zero.
//!
//! # Source
//! Agisoft Metashape User Manual, Professional Edition, appendix "Camera models".

use super::{CameraChoice, ExportError, Exported, camera, common_losses, interior};
use crate::camera::{Camera, LensKind};
use crate::formats::InputError;
use quick_xml::Reader;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use std::path::Path;

const FORMAT: &str = "Metashape";
/// The numbers of a calibration; what is absent is zero, but for f.
const KEYS: [&str; 13] = ["f", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4"];

/// A `<calibration>`.
#[derive(Default)]
struct Calibration {
    projection: String,
    adjusted: bool,
    width: Option<u32>,
    height: Option<u32>,
    values: [Option<f64>; KEYS.len()],
    /// fx, fy or skew of a file of the old kind.
    old: bool,
}

impl Calibration {
    fn value(&self, key: &str) -> f64 {
        KEYS.iter().position(|k| *k == key).and_then(|k| self.values[k]).unwrap_or(0.0)
    }
}

/// The camera in a calibration or project file.
pub(super) fn from_text(file: &Path, text: &str, choice: &CameraChoice) -> Result<Camera, InputError> {
    let mut reader = Reader::from_str(text);
    let found = calibrations(&mut reader).map_err(|cause| {
        let read = usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX).min(text.len());
        let line = 1 + text.as_bytes()[..read].iter().filter(|byte| **byte == b'\n').count();
        InputError::new(file, cause).line(line as u64)
    })?;
    if found.is_empty() {
        return Err(InputError::new(
            file,
            "is XML without a <calibration>, so it is no Metashape camera file",
        ));
    }
    // A project's sensor has the calibration that it began with, too; a lone one has no name to be chosen by.
    let mut cameras: Vec<(String, Calibration)> = Vec::new();
    for (name, calibration) in found {
        match cameras.iter_mut().find(|(known, _)| *known == name) {
            Some((_, known)) if calibration.adjusted && !known.adjusted => *known = calibration,
            Some((_, known)) if known.adjusted && !calibration.adjusted => {}
            Some(_) => return Err(InputError::new(file, format!("has two cameras named \"{name}\""))),
            None => cameras.push((name, calibration)),
        }
    }
    let (_, calibration) = choice.of(file, cameras)?;
    converted(file, &calibration, choice)
}

fn converted(file: &Path, calibration: &Calibration, choice: &CameraChoice) -> Result<Camera, InputError> {
    let refused = |cause: String| InputError::new(file, cause);
    let value = |key: &str| calibration.value(key);
    if calibration.old {
        return Err(refused("gives fx, fy and skew, as PhotoScan did before its version 1.2".to_owned())
            .help("export the calibration with Metashape again"));
    }
    if calibration.values[0].is_none() {
        return Err(refused("its <calibration> has no <f>".to_owned()));
    }
    let said = calibration.width.zip(calibration.height);
    let (width, height) = choice.size(file, said)?;
    let kind = match calibration.projection.as_str() {
        "frame" | "" => LensKind::Brown,
        "fisheye" | "equidistant_fisheye" => LensKind::Fisheye,
        other => return Err(refused(format!("the camera is \"{other}\": this program has no such lens"))),
    };
    let alien: &[&str] =
        if kind == LensKind::Brown { &["k4", "p3", "p4"] } else { &["p1", "p2", "p3", "p4"] };
    if let Some(key) = alien.iter().find(|key| value(key) != 0.0) {
        let lens = if kind == LensKind::Brown { "frame" } else { "fisheye" };
        return Err(refused(format!("{key} = {}: this program's {lens} lens has no such term", value(key)))
            .help(format!("adjust the cameras again in Metashape with {} fixed at zero", alien.join(", "))));
    }
    let middle = |side: u32| 0.5 * (f64::from(side) - 1.0);
    let (f, cx, cy) = (value("f"), middle(width) + value("cx"), middle(height) + value("cy"));
    let affine = [f + value("b1"), f, value("b2"), cx, cy];
    let terms: &[&str] =
        if kind == LensKind::Brown { &["k1", "k2", "p2", "p1", "k3"] } else { &["k1", "k2", "k3", "k4"] };
    let terms: Vec<f64> = terms.iter().map(|term| value(term)).collect();
    camera(file, kind, interior(affine, &terms), width, height, None)
}

/// Every calibration with the label of its sensor, or without a name.
fn calibrations(reader: &mut Reader<&[u8]>) -> Result<Vec<(String, Calibration)>, String> {
    /// Deeper than any of Metashape's files.
    const DEEPEST: usize = 64;
    let mut found: Vec<(String, Calibration)> = Vec::new();
    let mut path: Vec<String> = Vec::new();
    let mut sensor = String::new();
    // Depth at which a calibration is open.
    let mut open: Option<usize> = None;
    loop {
        let event = reader.read_event().map_err(|error| format!("is no XML ({error})"))?;
        match event {
            Event::Start(ref element) | Event::Empty(ref element) => {
                let name = element.local_name().as_ref().to_owned();
                match (open, name.as_str()) {
                    (None, "sensor") => sensor = attribute(element, "label")?.unwrap_or_default(),
                    (None, "calibration") => found.push((sensor.clone(), begun(element)?)),
                    (Some(_), "resolution") => {
                        if let Some((_, calibration)) = found.last_mut() {
                            calibration.width = side(attribute(element, "width")?)?;
                            calibration.height = side(attribute(element, "height")?)?;
                        }
                    }
                    _ => {}
                }
                if matches!(event, Event::Empty(_)) {
                    continue;
                }
                if path.len() == DEEPEST {
                    return Err(format!("is nested deeper than {DEEPEST} elements"));
                }
                if open.is_none() && name == "calibration" {
                    open = Some(path.len());
                }
                path.push(name);
            }
            Event::End(_) => {
                let name = path.pop();
                if open == Some(path.len()) {
                    open = None;
                }
                if name.as_deref() == Some("sensor") {
                    sensor.clear();
                }
            }
            Event::Text(ref text) => {
                if let (Some(depth), Some((_, calibration)), Some(key)) =
                    (open, found.last_mut(), path.last())
                    && path.len() == depth + 2
                {
                    read_value(calibration, key, text.trim())?;
                }
            }
            Event::DocType(_) => return Err("has a document type, which no camera file needs".to_owned()),
            Event::Eof if path.is_empty() => return Ok(found),
            Event::Eof => return Err(format!("ends within <{}>", path.join("><"))),
            Event::CData(_) | Event::GeneralRef(_) if open.is_some() => {
                return Err("has a reference or CDATA where a number belongs".to_owned());
            }
            _ => {}
        }
    }
}

fn begun(element: &BytesStart) -> Result<Calibration, String> {
    Ok(Calibration {
        projection: attribute(element, "type")?.unwrap_or_default(),
        adjusted: attribute(element, "class")?.as_deref() == Some("adjusted"),
        ..Calibration::default()
    })
}

fn read_value(calibration: &mut Calibration, key: &str, text: &str) -> Result<(), String> {
    match key {
        "projection" => text.clone_into(&mut calibration.projection),
        "width" => calibration.width = side(Some(text.to_owned()))?,
        "height" => calibration.height = side(Some(text.to_owned()))?,
        "fx" | "fy" | "skew" => calibration.old = true,
        _ => {
            if let Some(place) = KEYS.iter().position(|known| *known == key) {
                let number = text.parse().map_err(|_| format!("<{key}> is \"{text}\", not a number"))?;
                calibration.values[place] = Some(number);
            }
        }
    }
    Ok(())
}

fn side(text: Option<String>) -> Result<Option<u32>, String> {
    text.map(|text| {
        text.parse().map_err(|_| format!("a side of the image is \"{text}\", not a number of pixels"))
    })
    .transpose()
}

fn attribute(element: &BytesStart, name: &str) -> Result<Option<String>, String> {
    for attribute in element.attributes() {
        let attribute = attribute.map_err(|error| format!("has a broken attribute ({error})"))?;
        if attribute.key.local_name().as_ref() == name {
            let value = attribute
                .normalized_value(XmlVersion::Implicit1_0)
                .map_err(|error| format!("has a broken value of {name} ({error})"))?;
            return Ok(Some(value.into_owned()));
        }
    }
    Ok(None)
}

/// The camera as the XML that Metashape's camera calibration window loads.
///
/// # Errors
/// [`ExportError`]: Metashape has no such lens.
pub fn camera_metashape_xml(camera: &Camera) -> Result<Exported, ExportError> {
    let values = camera.lens.interior();
    let [fx, fy, skew, cx, cy, a, b, c, d, e, ..] = values;
    let (projection, terms) = match camera.lens.kind() {
        LensKind::Brown => ("frame", [("k1", a), ("k2", b), ("k3", e), ("p1", d), ("p2", c)]),
        LensKind::Fisheye => ("fisheye", [("k1", a), ("k2", b), ("k3", c), ("k4", d), ("p1", 0.0)]),
        kind => return Err(ExportError::NoLens { lens: kind.word(), format: FORMAT }),
    };
    let middle = camera.image_centre();
    let affine =
        [("f", fy), ("cx", cx - middle.column), ("cy", cy - middle.row), ("b1", fx - fy), ("b2", skew)];
    let losses = common_losses(camera, FORMAT, false);
    let elements: String =
        affine.into_iter().chain(terms).map(|(key, value)| format!("  <{key}>{value:?}</{key}>\n")).collect();
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<calibration>\n  <projection>{projection}</projection>\n  \
         <width>{}</width>\n  <height>{}</height>\n{elements}</calibration>\n",
        camera.width, camera.height
    );
    Ok(Exported { text, losses })
}
