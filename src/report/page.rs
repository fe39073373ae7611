//! The page of a run: one HTML file that needs nothing beside it, light, fit to print.
//!
//! Every section may be missing. Numbers are rounded here and nowhere else: a spread to two digits, a value
//! to the digits its spread allows.

use super::calibration::{CalibrationNumbers, ParameterNumbers};
use super::figures::{self, CE90_COLOURS, FigureError, MapFrame};
use super::numbers::{AccuracyNumbers, CheckFigures, EllipseNumbers, LengthNumbers};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use minijinja::value::{Serde, Value};
use minijinja::{Environment, ErrorKind, context};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

const TEMPLATE: &str = include_str!("templates/page.html");

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// A picture could not be drawn.
    #[error(transparent)]
    Figure(#[from] FigureError),
    /// The template did not accept the numbers.
    #[error("the report page cannot be made")]
    Template(#[from] minijinja::Error),
}

/// Everything the page shows.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Name of the survey.
    pub title: String,
    /// Where the products come from.
    pub provenance: Provenance,
    /// Frames and their ground.
    pub survey: Option<Survey>,
    /// The mosaic.
    pub mosaic: Option<MosaicSection>,
    /// The accuracy stage's numbers and pictures.
    pub accuracy: Option<AccuracySection>,
    /// The camera.
    pub calibration: Option<CalibrationSection>,
    /// Frames that were not used.
    pub rejected: Vec<Rejected>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Where the products come from.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Provenance {
    /// Version of the program.
    pub program_version: String,
    /// Name of the pipeline file.
    pub pipeline_file: String,
    /// Its hash.
    pub pipeline_blake3: String,
    /// One hash over all inputs.
    pub inputs_blake3: Option<String>,
    /// Seed of the run.
    pub seed: u64,
    /// Libraries that decide about results, with versions.
    pub libraries: BTreeMap<String, String>,
}

/// Something that was not used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rejected {
    /// What.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// Frames and their ground.
#[derive(Debug, Clone, Serialize)]
pub struct Survey {
    /// Frames in the products.
    pub frames_used: usize,
    /// Frames left out.
    pub frames_rejected: usize,
    /// CRS as stated or chosen.
    pub crs: String,
    /// Median ground sample distance.
    pub gsd_median_m: f64,
    /// Least and greatest ground sample distance.
    pub gsd_range_m: [f64; 2],
    /// Least and greatest height above ground.
    pub height_above_ground_m: [f64; 2],
    /// Used frames in the order of their names.
    #[serde(skip)]
    pub frames: Vec<MapFrame>,
    /// Length of the CRS's unit in metres; `None` for a geographic CRS.
    #[serde(skip)]
    pub unit_m: Option<f64>,
    /// How photos and the log's exposures were matched, with a picture where times decided.
    #[serde(skip)]
    pub matching: Option<CaptionedFigure>,
}

/// The mosaic.
#[derive(Debug, Clone)]
pub struct MosaicSection {
    /// PNG.
    pub preview_png: Vec<u8>,
    /// File in the run folder.
    pub file: String,
    /// Columns.
    pub width_px: u64,
    /// Rows.
    pub height_px: u64,
    /// Ground sample distance.
    pub gsd_m: f64,
    /// CRS as stated or chosen.
    pub crs: String,
    /// Area with pixels, if known.
    pub area_m2: Option<f64>,
}

/// The accuracy stage's numbers and pictures.
#[derive(Debug, Clone)]
pub struct AccuracySection {
    /// The numbers of `accuracy.json`.
    pub numbers: AccuracyNumbers,
    /// Pictures over the image, with captions.
    pub figures: Vec<CaptionedFigure>,
    /// CE90 over the map as PNG, and the values of the first and the last colour.
    pub ce90: Option<(Vec<u8>, [f64; 2])>,
    /// Residuals at check points as SVG.
    pub residuals_svg: Option<String>,
}

/// A picture with words.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptionedFigure {
    /// For readers who cannot see it.
    pub title: String,
    /// What it shows.
    pub caption: String,
    /// The picture.
    pub svg: String,
}

/// The camera.
#[derive(Debug, Clone)]
pub struct CalibrationSection {
    /// Where it comes from, a sentence.
    pub source: String,
    /// Interior parameters.
    pub parameters: Vec<ParameterNumbers>,
    /// How it was calibrated, when it was calibrated here.
    pub adjustment: Option<CalibrationNumbers>,
    /// Pictures over the frame.
    pub figures: Vec<CaptionedFigure>,
    /// The three estimates of one corner, PNG.
    pub steps_png: Option<Vec<u8>>,
    /// The photo that fits worst and its points: name and PNG.
    pub overlay: Option<(String, Vec<u8>)>,
}

/// Makes the page.
///
/// # Errors
/// [`PageError`].
pub fn render(page: &Page) -> Result<String, PageError> {
    let survey_map = match &page.survey {
        Some(survey) if !survey.frames.is_empty() => {
            Some(svg_uri(&figures::survey_map(&survey.frames, survey.unit_m)?.svg))
        }
        _ => None,
    };
    let mosaic = page.mosaic.as_ref().map(|m| {
        context! {
            preview => png_uri(&m.preview_png), file => m.file.as_str(), width_px => m.width_px,
            height_px => m.height_px, gsd_m => m.gsd_m, crs => m.crs.as_str(),
        }
    });
    let accuracy = page.accuracy.as_ref().map(|a| {
        let figures: Vec<Value> = a.figures.iter().map(captioned).collect();
        context! {
            numbers => Serde(&a.numbers),
            figures => figures,
            ce90_picture => a.ce90.as_ref().map(|(png, _)| png_uri(png)),
            ce90_range_m => a.ce90.as_ref().map(|(_, range)| *range),
            residuals => a.residuals_svg.as_deref().map(svg_uri),
        }
    });
    let judged = page.accuracy.as_ref().and_then(|a| {
        let check = a.numbers.check_points.as_ref()?;
        check.variants.get(check.judged_by)
    });
    let calibration = page.calibration.as_ref().map(|c| {
        context! {
            source => c.source.as_str(),
            parameters => Serde(&c.parameters),
            compared => c.parameters.iter().any(|p| p.reference.is_some()),
            adjustment => Serde(&c.adjustment),
            figures => c.figures.iter().map(captioned).collect::<Vec<_>>(),
            steps_picture => c.steps_png.as_deref().map(png_uri),
            overlay => c.overlay.as_ref().map(|(_, png)| png_uri(png)),
            overlay_of => c.overlay.as_ref().map(|(name, _)| name.as_str()),
        }
    });
    let colours: Vec<String> = CE90_COLOURS.iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    let area_m2 = page
        .mosaic
        .as_ref()
        .and_then(|m| m.area_m2)
        .or_else(|| page.accuracy.as_ref()?.numbers.map.as_ref().map(|m| m.area_m2));
    let corner_reason = match page.accuracy.as_ref().map(|a| a.numbers.budget.corner_fraction) {
        Some(fraction) if fraction < 1.0 => "the lens has no inverse, or no ground is seen",
        _ => "",
    };
    let html = environment()?.get_template("page.html")?.render(context! {
        title => page.title.as_str(),
        summary => summary(page),
        area => area_m2.map(area),
        provenance => Serde(&page.provenance),
        survey => Serde(&page.survey),
        survey_map,
        matching => page.survey.as_ref().and_then(|s| s.matching.as_ref()).map(captioned),
        mosaic,
        accuracy,
        judged => Serde(&judged),
        corner_reason,
        ce90_colours => Value::from_safe_string(colours.join(", ")),
        calibration,
        rejected => Serde(&page.rejected),
        warnings => Serde(&page.warnings),
    })?;
    Ok(html)
}

fn captioned(figure: &CaptionedFigure) -> Value {
    context! {
        title => figure.title.as_str(), caption => figure.caption.as_str(), picture => svg_uri(&figure.svg),
    }
}

fn environment() -> Result<Environment<'static>, minijinja::Error> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(minijinja::UndefinedBehavior::Strict);
    environment.add_filter("metres", |v: f64| format!("{}\u{a0}m", two_digits(v)));
    environment.add_filter("two", two_digits);
    environment.add_filter("three", |v: f64| significant(v, 3));
    environment.add_filter("whole", |v: f64| format!("{v:.0}"));
    environment.add_filter("exact", exact);
    environment.add_filter("stated", |v: f64| trimmed(significant(v, 3)));
    environment.add_filter("signed", |v: f64| signed(v, 1));
    environment.add_filter("gsd", gsd);
    environment.add_filter("share", |v: f64| {
        if v > 0.0 && v < 0.5 { "< 1\u{a0}%".to_owned() } else { format!("{v:.0}\u{a0}%") }
    });
    environment.add_filter("width", |v: f64| format!("{:.1}", v.clamp(0.0, 100.0)));
    // Never rounded up to a hundred that is not reached.
    environment.add_filter("percent_down", |v: f64| format!("{:.0}\u{a0}%", v.floor()));
    environment.add_filter("ellipse", |e: Serde<EllipseNumbers>| {
        format!("{} × {} m, {:.0}°", two_digits(e.semi_major_m), two_digits(e.semi_minor_m), e.azimuth_deg)
    });
    environment.add_filter("mean", |f: Serde<CheckFigures>| {
        let decimals = decimals_of(f.rmse_radial_m);
        format!("{}, {} m", signed(f.mean_north_m, decimals), signed(f.mean_east_m, decimals))
    });
    environment.add_filter("with_std", |l: Serde<LengthNumbers>| {
        let decimals = decimals_of(l.std_m);
        format!("{:.decimals$} ± {:.decimals$} m", l.length_m, l.std_m)
    });
    environment.add_filter("interval", |l: Serde<LengthNumbers>| {
        let decimals = decimals_of(l.std_m);
        let [low, high] = l.interval_m;
        format!("{low:.decimals$} to {high:.decimals$} m ({} %)", exact(l.confidence * 100.0))
    });
    environment.add_filter("deviation", |l: Serde<LengthNumbers>| -> Result<String, minijinja::Error> {
        let truth = l.truth_m.ok_or_else(|| {
            minijinja::Error::new(ErrorKind::InvalidOperation, "a length without truth has no deviation")
        })?;
        Ok(format!("{} m", signed(l.length_m - truth, decimals_of(l.std_m))))
    });
    environment.add_filter("parameter", |p: Serde<ParameterNumbers>| match p.std {
        Some(std) if std > 0.0 => minus(&format!("{:.*}", decimals_of(std), p.value)),
        _ => minus(&exact(p.value)),
    });
    environment.add_filter("off_reference", |p: Serde<ParameterNumbers>| match (p.reference, p.std) {
        (Some(reference), Some(std)) if std > 0.0 => signed((p.value - reference) / std, 1) + "\u{a0}σ",
        (Some(reference), _) => signed(p.value - reference, 4),
        (None, _) => String::new(),
    });
    environment.add_filter("reference", |p: Serde<ParameterNumbers>| match p.reference {
        Some(value) => minus(&format!("{:.*}", p.std.map_or(4, decimals_of), value)),
        None => String::new(),
    });
    environment.add_filter("two_signed", |v: f64| minus(&two_digits(v)));
    environment.add_filter("four", |v: f64| significant(v, 4));
    // Never rounded up to a hundred that is not reached.
    environment.add_filter("percent_share", |share: f64| format!("{:.0}\u{a0}%", (100.0 * share).floor()));
    environment.add_filter("percent", |share: f64| format!("{}\u{a0}%", significant(100.0 * share, 2)));
    environment.add_filter("millimetres", |m: f64| minus(&significant(1e3 * m, 2)));
    environment.add_template("page.html", TEMPLATE)?;
    Ok(environment)
}

/// What was made, in one or two sentences.
fn summary(page: &Page) -> String {
    let mut words = Vec::new();
    match (&page.mosaic, &page.survey) {
        (Some(mosaic), Some(survey)) => words.push(format!(
            "A mosaic of {} photos, georeferenced from the UAV's own attitude and position without ground control points, in {}.",
            survey.frames_used, mosaic.crs
        )),
        (None, Some(survey)) => words.push(format!(
            "{} photos, georeferenced from the UAV's own attitude and position without ground control points, in {}.",
            survey.frames_used, survey.crs
        )),
        _ => match page.calibration.as_ref().and_then(|c| c.adjustment.as_ref()) {
            Some(made) => words.push(format!(
                "A camera of {} × {} pixels, calibrated from {} photos of a planar target.",
                made.image_width_px,
                made.image_height_px,
                made.views.len()
            )),
            None if page.calibration.is_some() => words.push("A camera and its lens.".to_owned()),
            None => {}
        },
    }
    if let Some(map) = page.accuracy.as_ref().and_then(|a| a.numbers.map.as_ref()) {
        words.push(format!(
            "From the stated errors of the measurements, a place on the map is expected within {} m of its true position in 90 of 100 cases (CE90, median over the area).",
            two_digits(map.ce90_median_m)
        ));
    }
    if let Some(survey) = &page.survey
        && survey.frames_rejected > 0
    {
        words.push(match survey.frames_rejected {
            1 => "One frame could not be used; the reason is listed below.".to_owned(),
            n => format!("{n} frames could not be used; the reasons are listed below."),
        });
    }
    words.join(" ")
}

/// Base64 holds nothing that HTML would have to escape; escaping its slashes would only lengthen it.
fn png_uri(png: &[u8]) -> Value {
    Value::from_safe_string(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}

fn svg_uri(svg: &str) -> Value {
    Value::from_safe_string(format!("data:image/svg+xml;base64,{}", STANDARD.encode(svg)))
}

/// Decimals that leave a spread two significant digits.
fn decimals_of(spread: f64) -> usize {
    if !(spread.is_finite() && spread > 0.0) {
        return 3;
    }
    // Rounding may carry into the next power of ten: 0.0997 is 0.10.
    let power = format!("{spread:.1e}").split('e').nth(1).and_then(|p| p.parse::<i32>().ok()).unwrap_or(0);
    (1 - power).clamp(0, 12) as usize
}

/// A value to a number of significant digits, without an exponent.
fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let rounded = format!("{value:.*e}", (digits - 1) as usize);
    let power: i32 = rounded.split('e').nth(1).and_then(|p| p.parse().ok()).unwrap_or(0);
    let decimals = (digits - 1 - power).clamp(0, 12) as usize;
    format!("{:.decimals$}", rounded.parse().unwrap_or(value))
}

fn two_digits(value: f64) -> String {
    significant(value, 2)
}

/// A number as somebody stated it: without the dust of unit conversion.
fn exact(value: f64) -> String {
    trimmed(significant(value, 6))
}

fn trimmed(text: String) -> String {
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// With a minus sign as wide as a digit.
fn minus(text: &str) -> String {
    text.replacen('-', "−", 1)
}

fn signed(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    // Zero has no sign.
    let is_zero = text.chars().all(|c| c == '0' || c == '.');
    match (is_zero, value < 0.0) {
        (true, _) => text,
        (_, true) => format!("−{text}"),
        (_, false) => format!("+{text}"),
    }
}

fn gsd(metres: f64) -> String {
    if metres < 1.0 {
        format!("{}\u{a0}cm", significant(metres * 100.0, 3))
    } else {
        format!("{}\u{a0}m", significant(metres, 3))
    }
}

fn area(m2: f64) -> String {
    if m2 >= 1e6 {
        format!("{}\u{a0}km²", significant(m2 / 1e6, 3))
    } else if m2 >= 1e4 {
        format!("{}\u{a0}ha", significant(m2 / 1e4, 3))
    } else {
        format!("{}\u{a0}m²", significant(m2, 3))
    }
}

#[cfg(test)]
mod tests;
