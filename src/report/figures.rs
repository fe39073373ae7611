//! Pictures, each as SVG and PNG from one scene: contour maps over an image, the survey from above, residuals.

use super::contours::{contours, round_levels, spread_levels};
use kuva::backend::raster::RasterBackend;
use kuva::backend::svg::SvgBackend;
use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor};
use std::fmt::Write as _;

/// A picture in two formats.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Vector.
    pub svg: String,
    /// Pixels, twice the scene's size.
    pub png: Vec<u8>,
}

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FigureError {
    /// A panel's values do not fill its grid.
    #[error("{values} values do not fill a grid of {columns} × {rows}")]
    Grid {
        /// Given.
        values: usize,
        /// Across.
        columns: usize,
        /// Down.
        rows: usize,
    },
    /// The picture could not be drawn as pixels.
    #[error("a figure cannot be drawn: {cause}")]
    Raster {
        /// The drawing library's words.
        cause: String,
    },
}

pub(super) const INK: Color = Color::Rgb(31, 41, 55);
pub(super) const FAINT: Color = Color::Rgb(107, 114, 128);
pub(super) const RULE: Color = Color::Rgb(209, 213, 219);
pub(super) const LINE: Color = Color::Rgb(30, 64, 110);
pub(super) const ACCENT: Color = Color::Rgb(192, 86, 33);
pub(super) const WHITE: Color = Color::Rgb(255, 255, 255);
const FONT: &str = "system-ui, 'Segoe UI', 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif";

pub(super) fn scene(width: f64, height: f64) -> Scene {
    let mut scene = Scene::new(width, height).with_background(Some("white"));
    scene.font_family = Some(FONT.to_owned());
    scene
}

pub(super) fn finished(scene: &Scene) -> Result<Figure, FigureError> {
    let png = RasterBackend::new()
        .with_scale(2.0)
        .render_scene(scene)
        .map_err(|cause| FigureError::Raster { cause })?;
    Ok(Figure { svg: SvgBackend::default().render_scene(scene), png })
}

pub(super) fn text(
    scene: &mut Scene,
    at: (f64, f64),
    content: &str,
    size: u32,
    anchor: TextAnchor,
    color: Color,
) {
    scene.add(Primitive::Text {
        x: at.0,
        y: at.1,
        content: content.to_owned(),
        size,
        anchor,
        rotate: None,
        bold: false,
        color: Some(color),
    });
}

pub(super) fn line(scene: &mut Scene, from: (f64, f64), to: (f64, f64), stroke: Color, stroke_width: f64) {
    scene.add(Primitive::Line {
        x1: from.0,
        y1: from.1,
        x2: to.0,
        y2: to.1,
        stroke,
        stroke_width,
        stroke_dasharray: None,
    });
}

pub(super) fn frame_of(scene: &mut Scene, left: f64, top: f64, width: f64, height: f64) {
    scene.add(Primitive::Rect {
        x: left,
        y: top,
        width,
        height,
        fill: Color::None,
        stroke: Some(FAINT),
        stroke_width: Some(1.0),
        opacity: None,
    });
}

/// Path through points, closed or open.
pub(super) fn path(points: impl Iterator<Item = (f64, f64)>, closed: bool) -> String {
    let mut d = String::new();
    for (i, (x, y)) in points.enumerate() {
        // A String takes everything.
        let _ = write!(d, "{}{x:.2},{y:.2}", if i == 0 { "M" } else { "L" });
    }
    if closed {
        d.push('Z');
    }
    d
}

/// A number with as many decimals as its step needs: 2.5 needs one.
pub(super) fn by_step(value: f64, step: f64) -> String {
    let whole = |decimals: i32| {
        let scaled = step.abs() * 10_f64.powi(decimals);
        scaled >= 1.0 - 1e-6 && (scaled - scaled.round()).abs() < 1e-6 * scaled
    };
    let decimals = (0..6).find(|d| whole(*d)).unwrap_or(6);
    format!("{value:.*}", decimals as usize)
}

/// Values over an image, at the centres of equal cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Heading, with the unit.
    pub title: String,
    /// Image width and height, pixels.
    pub image_px: (u32, u32),
    /// Cells across.
    pub columns: usize,
    /// Cells down.
    pub rows: usize,
    /// Values row by row; not finite where there is none.
    pub values: Vec<f64>,
    /// Levels for values that grow fast towards one side (an oblique view).
    pub spread: bool,
}

/// Contour maps side by side, each over the image's pixels with labelled lines: the form of the paper's Fig. 7.
///
/// # Errors
/// [`FigureError`].
pub fn contour_panels(panels: &[Panel]) -> Result<Figure, FigureError> {
    const WIDTH: f64 = 390.0;
    const LEFT: f64 = 66.0;
    const RIGHT: f64 = 18.0;
    const TOP: f64 = 44.0;
    const BOTTOM: f64 = 58.0;
    let plot_height =
        panels.iter().map(|p| WIDTH * f64::from(p.image_px.1) / f64::from(p.image_px.0)).fold(0.0, f64::max);
    let step = LEFT + WIDTH + RIGHT;
    let mut scene = scene(step * panels.len() as f64, TOP + plot_height + BOTTOM);
    for (i, panel) in panels.iter().enumerate() {
        if panel.values.len() != panel.columns * panel.rows {
            return Err(FigureError::Grid {
                values: panel.values.len(),
                columns: panel.columns,
                rows: panel.rows,
            });
        }
        draw_panel(&mut scene, panel, i as f64 * step + LEFT, TOP, WIDTH);
    }
    finished(&scene)
}

fn draw_panel(scene: &mut Scene, panel: &Panel, left: f64, top: f64, width: f64) {
    let height = width * f64::from(panel.image_px.1) / f64::from(panel.image_px.0);
    let (cell_w, cell_h) = (width / panel.columns as f64, height / panel.rows as f64);
    text(scene, (left, top - 16.0), &panel.title, 18, TextAnchor::Start, INK);

    let finite = || panel.values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, u), v| (l.min(v), u.max(v)));
    // Steps of colour rather than a ramp: neighbours of one step share a rectangle, and the file stays small.
    const STEPS: f64 = 14.0;
    let band = |value: f64| {
        let share = if high > low { (value - low) / (high - low) } else { 0.0 };
        value.is_finite().then(|| (share * STEPS).round() as u32)
    };
    let mut cells = (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (row, values) in panel.values.chunks(panel.columns).enumerate() {
        let mut column = 0;
        for run in values.chunk_by(|a, b| band(*a) == band(*b)) {
            let first = column;
            column += run.len();
            let Some(step) = band(run[0]) else { continue };
            let (x, y) = (left + first as f64 * cell_w, top + row as f64 * cell_h);
            cells.0.push(x.round());
            cells.1.push(y.round());
            // Each reaches under its right and lower neighbour, or seams show at some scales.
            cells
                .2
                .push((left + column as f64 * cell_w).round() - x.round() + overlap(column, panel.columns));
            cells
                .3
                .push((top + (row + 1) as f64 * cell_h).round() - y.round() + overlap(row + 1, panel.rows));
            cells.4.push(tint(f64::from(step) / STEPS));
        }
    }
    scene.add(Primitive::RectBatch { x: cells.0, y: cells.1, w: cells.2, h: cells.3, fills: cells.4 });

    let levels = if panel.spread { spread_levels(&panel.values, 9) } else { round_levels(&panel.values, 12) };
    let step = levels.windows(2).map(|p| (p[1] - p[0]).abs()).fold(f64::INFINITY, f64::min);
    let mut labels: Vec<((f64, f64), String)> = Vec::new();
    for level in levels {
        for contour in contours(&panel.values, panel.columns, level) {
            let points: Vec<(f64, f64)> = contour
                .points
                .iter()
                .map(|(c, r)| (left + (c + 0.5) * cell_w, top + (r + 0.5) * cell_h))
                .collect();
            if let Some(at) = label_place(&points, &labels) {
                labels.push((at, by_step(level, if panel.spread { level } else { step })));
            }
            scene.add(Primitive::PolyLine {
                points,
                stroke: LINE,
                stroke_width: 1.3,
                stroke_dasharray: None,
            });
        }
    }
    for ((x, y), label) in labels {
        let wide = 8.8 * label.chars().count() as f64 + 6.0;
        scene.add(Primitive::Rect {
            x: x - wide / 2.0,
            y: y - 9.0,
            width: wide,
            height: 17.0,
            fill: WHITE,
            stroke: None,
            stroke_width: None,
            opacity: Some(0.85),
        });
        text(scene, (x, y + 5.0), &label, 15, TextAnchor::Middle, LINE);
    }

    image_axes(scene, panel.image_px, left, top, width);
}

/// Frame, ticks and names of an image's columns and rows.
pub(super) fn image_axes(scene: &mut Scene, image_px: (u32, u32), left: f64, top: f64, width: f64) {
    let (w, h) = (f64::from(image_px.0), f64::from(image_px.1));
    let scale = width / w;
    let height = h * scale;
    frame_of(scene, left, top, width, height);
    let step = tick_step(w);
    for k in 0..=(w / step) as u32 {
        let value = f64::from(k) * step;
        let x = left + (value + 0.5) * scale;
        line(scene, (x, top + height), (x, top + height + 5.0), FAINT, 1.0);
        text(scene, (x, top + height + 20.0), &format!("{value:.0}"), 14, TextAnchor::Middle, FAINT);
    }
    for k in 0..=(h / step) as u32 {
        let value = f64::from(k) * step;
        let y = top + (value + 0.5) * scale;
        line(scene, (left - 5.0, y), (left, y), FAINT, 1.0);
        text(scene, (left - 9.0, y + 4.5), &format!("{value:.0}"), 14, TextAnchor::End, FAINT);
    }
    let below = (left + width / 2.0, top + height + 42.0);
    text(scene, below, "column (px)", 14, TextAnchor::Middle, FAINT);
    scene.add(Primitive::Text {
        x: left - 50.0,
        y: top + height / 2.0,
        content: "row (px)".to_owned(),
        size: 13,
        anchor: TextAnchor::Middle,
        rotate: Some(-90.0),
        bold: false,
        color: Some(FAINT),
    });
}

/// How far a cell reaches under the next one; the last one ends with the picture.
const fn overlap(next: usize, count: usize) -> f64 {
    if next < count { 1.0 } else { 0.0 }
}

/// Half way along a line, if that is not on top of another label; lines too short for a label have none.
fn label_place(points: &[(f64, f64)], taken: &[((f64, f64), String)]) -> Option<(f64, f64)> {
    let length: f64 = points.windows(2).map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1)).sum();
    if length < 70.0 {
        return None;
    }
    [0.5, 0.35, 0.65, 0.2, 0.8].into_iter().find_map(|share| {
        let mut left = share * length;
        let at = points.windows(2).find_map(|p| {
            let step = (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1);
            if step >= left {
                let k = left / step;
                return Some((p[0].0 + k * (p[1].0 - p[0].0), p[0].1 + k * (p[1].1 - p[0].1)));
            }
            left -= step;
            None
        })?;
        let free = taken.iter().all(|((x, y), _)| (x - at.0).abs() > 46.0 || (y - at.1).abs() > 19.0);
        free.then_some(at)
    })
}

/// White to blue.
pub(super) fn tint(share: f64) -> Color {
    let mix = |from: f64, to: f64| (from + (to - from) * share).round().clamp(0.0, 255.0) as u8;
    Color::Rgb(mix(247.0, 133.0), mix(250.0, 178.0), mix(253.0, 221.0))
}

pub(super) fn tick_step(size_px: f64) -> f64 {
    let raw = size_px / 5.0;
    let power = 10_f64.powf(raw.log10().floor());
    [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().map(|k| k * power).find(|s| *s >= raw).unwrap_or(raw)
}

/// A frame on the map, in metres (or the CRS's unit).
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MapFrame {
    /// The image's file name.
    pub name: String,
    /// Outline on the ground: easting, northing.
    pub outline: Vec<[f64; 2]>,
    /// Projection centre: easting, northing.
    pub camera: [f64; 2],
}

/// The survey from above: footprints and flight path, north up, with a scale bar.
///
/// `unit_m` is the length of the CRS's unit in metres; without it (a geographic CRS) there is no scale bar.
///
/// # Errors
/// [`FigureError`].
pub fn survey_map(frames: &[MapFrame], unit_m: Option<f64>) -> Result<Figure, FigureError> {
    const WIDTH: f64 = 900.0;
    const MARGIN: f64 = 26.0;
    let points = || frames.iter().flat_map(|f| f.outline.iter().chain(std::iter::once(&f.camera)));
    let range = |k: usize| {
        points().map(|p| p[k]).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
    };
    let ((west, east), (south, north)) = (range(0), range(1));
    // A geographic CRS would look squeezed: a degree of longitude is shorter than one of latitude.
    let aspect =
        if unit_m.is_some() { 1.0 } else { (0.5 * (south + north) * std::f64::consts::PI / 180.0).cos() };
    let (span_e, span_n) = ((east - west).max(1e-9) * aspect, (north - south).max(1e-9));
    let scale = ((WIDTH - 2.0 * MARGIN) / span_e).min(620.0 / span_n);
    let left = (WIDTH - scale * span_e) / 2.0;
    let height = scale * span_n + 2.0 * MARGIN + 34.0;
    let mut scene = scene(WIDTH, height);
    let at = |p: &[f64; 2]| (left + (p[0] - west) * aspect * scale, MARGIN + (north - p[1]) * scale);
    for frame in frames {
        scene.add(Primitive::Path(Box::new(PathData {
            d: path(frame.outline.iter().map(at), true),
            fill: Some(Color::Rgb(59, 130, 196)),
            stroke: Color::None,
            stroke_width: 0.0,
            opacity: Some(0.10),
            stroke_dasharray: None,
        })));
    }
    for frame in frames {
        scene.add(Primitive::Path(Box::new(PathData {
            d: path(frame.outline.iter().map(at), true),
            fill: None,
            stroke: LINE,
            stroke_width: 0.7,
            opacity: Some(0.75),
            stroke_dasharray: None,
        })));
    }
    scene.add(Primitive::PolyLine {
        points: frames.iter().map(|f| at(&f.camera)).collect(),
        stroke: ACCENT,
        stroke_width: 1.2,
        stroke_dasharray: None,
    });
    for frame in frames {
        let (cx, cy) = at(&frame.camera);
        scene.add(Primitive::Circle {
            cx,
            cy,
            r: 3.0,
            fill: ACCENT,
            fill_opacity: None,
            stroke: Some(WHITE),
            stroke_width: Some(0.8),
        });
    }
    let base = height - 22.0;
    if let Some(unit_m) = unit_m {
        let metres = tick_step(1.2 * span_e * unit_m);
        let long = metres / unit_m * scale;
        line(&mut scene, (MARGIN, base), (MARGIN + long, base), INK, 2.0);
        for x in [MARGIN, MARGIN + long] {
            line(&mut scene, (x, base - 5.0), (x, base + 5.0), INK, 2.0);
        }
        text(
            &mut scene,
            (MARGIN + long + 10.0, base + 5.0),
            &format!("{} m", by_step(metres, metres)),
            14,
            TextAnchor::Start,
            INK,
        );
    }
    let x = WIDTH - MARGIN - 8.0;
    line(&mut scene, (x, base + 8.0), (x, base - 16.0), INK, 2.0);
    line(&mut scene, (x, base - 16.0), (x - 5.0, base - 7.0), INK, 2.0);
    line(&mut scene, (x, base - 16.0), (x + 5.0, base - 7.0), INK, 2.0);
    text(&mut scene, (x - 16.0, base + 5.0), "N", 14, TextAnchor::End, INK);
    finished(&scene)
}

/// Residuals as a target: east to the right, north up, with circles of the observed and the claimed CE90.
///
/// # Errors
/// [`FigureError`].
pub fn residual_plot(
    north_east_m: &[(f64, f64)],
    observed_ce90_m: f64,
    claimed_ce90_m: Option<f64>,
) -> Result<Figure, FigureError> {
    const SIZE: f64 = 460.0;
    const MARGIN: f64 = 56.0;
    let farthest = north_east_m
        .iter()
        .map(|(n, e)| n.hypot(*e))
        .chain([observed_ce90_m, claimed_ce90_m.unwrap_or(0.0)])
        .fold(0.0, f64::max)
        .max(1e-6);
    let reach = 1.08 * farthest;
    let scale = (SIZE / 2.0) / reach;
    let centre = (MARGIN + SIZE / 2.0, 16.0 + SIZE / 2.0);
    let mut scene = scene(SIZE + MARGIN + 20.0, SIZE + 16.0 + 76.0);
    let at = |n: f64, e: f64| (centre.0 + e * scale, centre.1 - n * scale);
    frame_of(&mut scene, MARGIN, 16.0, SIZE, SIZE);
    line(&mut scene, at(0.0, -reach), at(0.0, reach), RULE, 1.0);
    line(&mut scene, at(-reach, 0.0), at(reach, 0.0), RULE, 1.0);
    for &(n, e) in north_east_m {
        let (cx, cy) = at(n, e);
        scene.add(Primitive::Circle {
            cx,
            cy,
            r: 2.2,
            fill: LINE,
            fill_opacity: Some(0.45),
            stroke: None,
            stroke_width: None,
        });
    }
    let mut circle = |radius_m: f64, stroke: Color| {
        scene.add(Primitive::Circle {
            cx: centre.0,
            cy: centre.1,
            r: radius_m * scale,
            fill: Color::None,
            fill_opacity: None,
            stroke: Some(stroke),
            stroke_width: Some(2.0),
        });
    };
    circle(observed_ce90_m, LINE);
    if let Some(claimed) = claimed_ce90_m {
        circle(claimed, ACCENT);
    }
    let step = tick_step(reach * 2.4);
    let count = (reach / step).floor() as i64;
    for k in -count..=count {
        let value = k as f64 * step;
        let label = by_step(value, step);
        let (x, _) = at(0.0, value);
        text(&mut scene, (x, 16.0 + SIZE + 18.0), &label, 13, TextAnchor::Middle, FAINT);
        let (_, y) = at(value, 0.0);
        text(&mut scene, (MARGIN - 8.0, y + 4.5), &label, 13, TextAnchor::End, FAINT);
    }
    text(&mut scene, (centre.0, 16.0 + SIZE + 38.0), "east residual (m)", 13, TextAnchor::Middle, FAINT);
    scene.add(Primitive::Text {
        x: 14.0,
        y: centre.1,
        content: "north residual (m)".to_owned(),
        size: 13,
        anchor: TextAnchor::Middle,
        rotate: Some(-90.0),
        bold: false,
        color: Some(FAINT),
    });
    let below = 16.0 + SIZE + 64.0;
    text(&mut scene, (MARGIN, below), "● observed CE90", 13, TextAnchor::Start, LINE);
    if claimed_ce90_m.is_some() {
        text(&mut scene, (MARGIN + 150.0, below), "● claimed CE90 (median)", 13, TextAnchor::Start, ACCENT);
    }
    finished(&scene)
}

/// Colours of a CE90 map from best to worst, as CSS; the page draws its legend from them.
pub const CE90_COLOURS: [[u8; 3]; 5] =
    [[38, 84, 124], [66, 143, 150], [156, 197, 121], [245, 206, 96], [203, 76, 46]];

/// A picture as PNG, and the values that its first and its last colour stand for.
pub type ColouredMap = (Vec<u8>, [f64; 2]);

/// A CE90 map as a picture, one pixel to a cell, transparent where nothing is known; with the values that
/// the first and the last colour stand for.
///
/// # Errors
/// [`FigureError::Grid`] and [`FigureError::Raster`].
pub fn ce90_picture(values: &[f32], columns: usize) -> Result<Option<ColouredMap>, FigureError> {
    let rows = values.len() / columns.max(1);
    let mut seen: Vec<f32> = values.iter().copied().filter(|v| v.is_finite()).collect();
    seen.sort_by(f32::total_cmp);
    let Some(last) = seen.len().checked_sub(1) else { return Ok(None) };
    // The worst 2 % share the last colour, or a few grazing cells would flatten all others.
    let (low, high) = (f64::from(seen[0]), f64::from(seen[(0.98 * last as f64) as usize]));
    let colour = |value: f32| {
        if !value.is_finite() {
            return [0, 0, 0, 0];
        }
        let share = if high > low { ((f64::from(value) - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 };
        let at = share * (CE90_COLOURS.len() - 1) as f64;
        let (i, k) = (
            (at as usize).min(CE90_COLOURS.len() - 2),
            at - (at as usize).min(CE90_COLOURS.len() - 2) as f64,
        );
        let mix = |b: usize| {
            let (from, to) = (f64::from(CE90_COLOURS[i][b]), f64::from(CE90_COLOURS[i + 1][b]));
            (from + k * (to - from)).round() as u8
        };
        [mix(0), mix(1), mix(2), 255]
    };
    let pixels: Vec<u8> = values.iter().flat_map(|v| colour(*v)).collect();
    let picture = image::RgbaImage::from_raw(columns as u32, rows as u32, pixels)
        .ok_or(FigureError::Grid { values: values.len(), columns, rows })?;
    let mut png = Vec::new();
    picture
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .map_err(|e| FigureError::Raster { cause: e.to_string() })?;
    Ok(Some((png, [low, high])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(columns: usize, rows: usize) -> Panel {
        let values = (0..columns * rows)
            .map(|i| {
                1.0 + f64::hypot(
                    (i % columns) as f64 / columns as f64 - 0.5,
                    (i / columns) as f64 / rows as f64 - 0.5,
                )
            })
            .collect();
        Panel { title: "CE90 (m)".to_owned(), image_px: (1152, 648), columns, rows, values, spread: false }
    }

    #[test]
    fn a_contour_figure_has_axes_lines_and_labels_and_both_formats() {
        let figure = contour_panels(&[panel(32, 18), panel(32, 18)]).unwrap();
        assert!(figure.svg.starts_with("<svg") && figure.svg.contains("column (px)"));
        assert!(figure.svg.contains(">1.2<") && figure.svg.contains(">1.5<"));
        assert!(!figure.svg.contains("NaN"));
        let png = image::load_from_memory(&figure.png).unwrap();
        assert_eq!(png.width(), 2 * 2 * (66 + 390 + 18));
        assert_eq!(contour_panels(&[panel(32, 18)]).unwrap(), contour_panels(&[panel(32, 18)]).unwrap());
        let short = Panel { rows: 17, ..panel(32, 18) };
        assert!(matches!(contour_panels(&[short]), Err(FigureError::Grid { .. })));
    }

    #[test]
    fn labels_have_the_decimals_of_their_step() {
        assert_eq!(by_step(0.30000000000000004, 0.1), "0.3");
        assert_eq!(by_step(7.5, 2.5), "7.5");
        assert_eq!(by_step(0.75, 0.25), "0.75");
        assert_eq!(by_step(500.0, 250.0), "500");
    }

    #[test]
    fn a_ce90_picture_is_transparent_where_nothing_is_known() {
        let (png, range) = ce90_picture(&[1.0, 2.0, f32::NAN, 3.0], 2).unwrap().unwrap();
        let picture = image::load_from_memory(&png).unwrap().to_rgba8();
        assert_eq!(picture.get_pixel(0, 0).0, [38, 84, 124, 255]);
        assert_eq!(picture.get_pixel(0, 1).0[3], 0);
        assert!(range[0] == 1.0 && range[1] <= 3.0);
        assert_eq!(ce90_picture(&[f32::NAN], 1).unwrap(), None);
    }
}
