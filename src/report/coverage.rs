//! How often the ground is seen: a map of counts with the flight line, as SVG and PNG.

use super::figures::{
    ACCENT, FAINT, Figure, FigureError, INK, LINE, WHITE, by_step, finished, line, path, scene, text,
    tick_step,
};
use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor};

/// Counts of frames on a grid, north up; places are east and north in metres.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CoverageMap {
    /// Heading.
    pub title: String,
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// East and north of the upper left corner.
    pub corner: [f64; 2],
    /// Cells across.
    pub columns: usize,
    /// Frames that see each cell, row by row.
    pub counts: Vec<u16>,
    /// Cells of holes between the frames, row by row.
    pub holes: Vec<bool>,
    /// Footprints.
    pub outlines: Vec<Vec<[f64; 2]>>,
    /// The antenna's places in the order they were flown.
    pub flown: Vec<[f64; 2]>,
    /// Where rejected frames say they were taken.
    pub rejected: Vec<[f64; 2]>,
    /// Lines below the legend.
    pub words: Vec<String>,
}

/// Classes of the legend: least count and colour, pale to dark.
const CLASSES: [(u16, Color, &str); 6] = [
    (1, Color::Rgb(253, 224, 171), "1 frame"),
    (2, Color::Rgb(199, 228, 191), "2"),
    (3, Color::Rgb(134, 203, 192), "3"),
    (4, Color::Rgb(76, 166, 188), "4 – 5"),
    (6, Color::Rgb(43, 118, 168), "6 – 9"),
    (10, Color::Rgb(28, 70, 128), "10 or more"),
];
const HOLE: Color = Color::Rgb(214, 64, 69);
const WIDTH: f64 = 760.0;
const TALLEST: f64 = 760.0;
const SHORTEST: f64 = 380.0;
const MARGIN: f64 = 26.0;
const TOP: f64 = 58.0;
const LEGEND: f64 = 216.0;
/// Above this many frames their outlines and dots would only darken the map.
const MOST_OUTLINES: usize = 150;

/// Draws the map.
///
/// # Errors
/// [`FigureError`]: counts that do not fill the grid.
pub fn coverage_map(map: &CoverageMap) -> Result<Figure, FigureError> {
    let rows = map.counts.len() / map.columns.max(1);
    if map.columns == 0 || rows * map.columns != map.counts.len() || map.holes.len() != map.counts.len() {
        return Err(FigureError::Grid { values: map.counts.len(), columns: map.columns, rows });
    }
    let Frame { low, high } = Frame::of(map, rows);
    let span = [high[0] - low[0], high[1] - low[1]];
    let scale = (WIDTH / span[0]).min(TALLEST / span[1]);
    let drawn = (scale * span[1]).max(SHORTEST);
    let left = MARGIN + 0.5 * (WIDTH - scale * span[0]);
    let top = TOP + 0.5 * (drawn - scale * span[1]);
    let at = |p: [f64; 2]| (left + (p[0] - low[0]) * scale, top + (high[1] - p[1]) * scale);
    let mut scene = scene(WIDTH + 2.0 * MARGIN + LEGEND, TOP + drawn + 52.0);
    text(&mut scene, (MARGIN, 34.0), &map.title, 19, TextAnchor::Start, INK);
    cells(&mut scene, map, at);
    outlines(&mut scene, map, at);
    flight_line(&mut scene, map, at);
    let shown = |p: &[f64; 2]| (0..2).all(|k| p[k] >= low[k] && p[k] <= high[k]);
    for place in map.rejected.iter().filter(|place| shown(place)) {
        cross(&mut scene, at(*place));
    }
    scale_bar(&mut scene, (MARGIN, TOP + drawn + 30.0), span[0], scale);
    legend(&mut scene, map, (WIDTH + 2.0 * MARGIN, TOP));
    finished(&scene)
}

/// What the map shows, with a little room around.
struct Frame {
    low: [f64; 2],
    high: [f64; 2],
}

impl Frame {
    fn of(map: &CoverageMap, rows: usize) -> Self {
        let far = [map.columns as f64 * map.cell_m, rows as f64 * map.cell_m];
        let mut low = [map.corner[0], map.corner[1] - far[1]];
        let mut high = [map.corner[0] + far[0], map.corner[1]];
        // Rejected frames may claim to be on another continent: they do not stretch the map by more than its size.
        let near = |p: &&[f64; 2]| (0..2).all(|k| p[k] > low[k] - far[k] && p[k] < high[k] + far[k]);
        let extra: Vec<[f64; 2]> =
            map.flown.iter().chain(map.rejected.iter().filter(near)).copied().collect();
        for p in extra {
            for k in 0..2 {
                (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
            }
        }
        let room = 0.02 * (high[0] - low[0]).max(high[1] - low[1]).max(1e-6);
        Self { low: low.map(|v| v - room), high: high.map(|v| v + room) }
    }
}

fn class_of(count: u16) -> Option<Color> {
    CLASSES.iter().rev().find(|(least, ..)| count >= *least).map(|(_, color, _)| color.clone())
}

/// Runs of equal cells as one rectangle each.
fn cells(scene: &mut Scene, map: &CoverageMap, at: impl Fn([f64; 2]) -> (f64, f64)) {
    let (mut x, mut y, mut w, mut h, mut fills) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let kinds: Vec<Option<Color>> = map
        .counts
        .iter()
        .zip(&map.holes)
        .map(|(count, hole)| if *hole { Some(HOLE) } else { class_of(*count) })
        .collect();
    for (row, kinds) in kinds.chunks(map.columns).enumerate() {
        let mut column = 0;
        for run in kinds.chunk_by(|a, b| a == b) {
            let first = column;
            column += run.len();
            let Some(fill) = &run[0] else { continue };
            let corner = |column: usize, row: usize| {
                let (x, y) =
                    at([map.corner[0] + column as f64 * map.cell_m, map.corner[1] - row as f64 * map.cell_m]);
                // Half units are whole pixels of the PNG: between them, seams would show.
                ((2.0 * x).round() / 2.0, (2.0 * y).round() / 2.0)
            };
            let (upper, lower) = (corner(first, row), corner(column, row + 1));
            x.push(upper.0);
            y.push(upper.1);
            w.push(lower.0 - upper.0);
            h.push(lower.1 - upper.1);
            fills.push(fill.clone());
        }
    }
    scene.add(Primitive::RectBatch { x, y, w, h, fills });
}

fn outlines(scene: &mut Scene, map: &CoverageMap, at: impl Fn([f64; 2]) -> (f64, f64)) {
    if map.outlines.len() > MOST_OUTLINES {
        return;
    }
    for outline in &map.outlines {
        scene.add(Primitive::Path(Box::new(PathData {
            d: path(outline.iter().map(|p| at(*p)), true),
            fill: None,
            stroke: LINE,
            stroke_width: 0.6,
            opacity: Some(0.35),
            stroke_dasharray: None,
        })));
    }
}

fn flight_line(scene: &mut Scene, map: &CoverageMap, at: impl Fn([f64; 2]) -> (f64, f64)) {
    let points: Vec<(f64, f64)> = map.flown.iter().map(|p| at(*p)).collect();
    let (r, stroke_width) = if points.len() > MOST_OUTLINES { (1.3, 0.7) } else { (3.0, 1.3) };
    scene.add(Primitive::PolyLine {
        points: points.clone(),
        stroke: ACCENT,
        stroke_width,
        stroke_dasharray: None,
    });
    for (i, (cx, cy)) in points.into_iter().enumerate() {
        // The first frame is larger: it tells which way the line was flown.
        let r = if i == 0 { r + 2.5 } else { r };
        scene.add(Primitive::Circle {
            cx,
            cy,
            r,
            fill: ACCENT,
            fill_opacity: None,
            stroke: Some(WHITE),
            stroke_width: Some(0.8),
        });
    }
}

fn cross(scene: &mut Scene, (x, y): (f64, f64)) {
    for sign in [-1.0, 1.0] {
        line(scene, (x - 5.0, y - 5.0 * sign), (x + 5.0, y + 5.0 * sign), HOLE, 2.4);
    }
}

fn scale_bar(scene: &mut Scene, (x, y): (f64, f64), span_m: f64, scale: f64) {
    let metres = tick_step(span_m);
    let long = metres * scale;
    line(scene, (x, y), (x + long, y), INK, 2.0);
    for end in [x, x + long] {
        line(scene, (end, y - 5.0), (end, y + 5.0), INK, 2.0);
    }
    let words = if metres >= 1000.0 {
        format!("{} km", by_step(metres / 1000.0, metres / 1000.0))
    } else {
        format!("{} m", by_step(metres, metres))
    };
    text(scene, (x + long + 10.0, y + 5.0), &words, 14, TextAnchor::Start, INK);
}

fn legend(scene: &mut Scene, map: &CoverageMap, (x, top): (f64, f64)) {
    let north = (x + 9.0, top + 4.0);
    line(scene, (north.0, north.1 + 26.0), north, INK, 2.0);
    for side in [-5.5, 5.5] {
        line(scene, north, (north.0 + side, north.1 + 9.0), INK, 2.0);
    }
    text(scene, (x + 24.0, top + 24.0), "N", 15, TextAnchor::Start, INK);
    text(scene, (x, top + 62.0), "Frames that see the ground", 14, TextAnchor::Start, INK);
    let mut y = top + 78.0;
    let most = map.counts.iter().copied().max().unwrap_or(0);
    let mut entry = |scene: &mut Scene, fill: Color, words: &str| {
        scene.add(Primitive::Rect {
            x,
            y,
            width: 20.0,
            height: 14.0,
            fill,
            stroke: Some(FAINT),
            stroke_width: Some(0.5),
            opacity: None,
        });
        text(scene, (x + 28.0, y + 12.0), words, 13, TextAnchor::Start, INK);
        y += 21.0;
    };
    for (_, color, words) in CLASSES.iter().filter(|(least, ..)| *least <= most) {
        entry(scene, color.clone(), words);
    }
    if map.holes.iter().any(|hole| *hole) {
        entry(scene, HOLE, "hole: seen by none");
    }
    y += 12.0;
    line(scene, (x, y), (x + 20.0, y), ACCENT, 1.4);
    scene.add(Primitive::Circle {
        cx: x + 10.0,
        cy: y,
        r: 3.0,
        fill: ACCENT,
        fill_opacity: None,
        stroke: Some(WHITE),
        stroke_width: Some(0.8),
    });
    text(scene, (x + 28.0, y + 4.5), "flight line, frames", 13, TextAnchor::Start, INK);
    if !map.rejected.is_empty() {
        y += 22.0;
        cross(scene, (x + 10.0, y));
        text(scene, (x + 28.0, y + 4.5), "rejected frame", 13, TextAnchor::Start, INK);
    }
    y += 34.0;
    for words in &map.words {
        text(scene, (x, y), words, 12, TextAnchor::Start, FAINT);
        y += 18.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map() -> CoverageMap {
        CoverageMap {
            title: "a <survey>".to_owned(),
            cell_m: 10.0,
            corner: [0.0, 20.0],
            columns: 3,
            counts: vec![1, 1, 2, 0, 12, 0],
            holes: vec![false, false, false, true, false, false],
            outlines: vec![vec![[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]]],
            flown: vec![[5.0, 5.0], [25.0, 15.0]],
            rejected: vec![[15.0, 10.0], [1e7, 0.0]],
            words: vec!["two frames".to_owned()],
        }
    }

    #[test]
    fn a_map_has_its_cells_line_and_legend() {
        let figure = coverage_map(&map()).unwrap();
        // Runs of equal cells: 1 1 | 2 and hole | 12; what is outside is not drawn. The legend shows each colour again.
        for (color, times) in [((253, 224, 171), 2), ((199, 228, 191), 2), ((28, 70, 128), 2)] {
            let (r, g, b) = color;
            let count = figure.svg.matches(&format!("#{r:02x}{g:02x}{b:02x}")).count()
                + figure.svg.matches(&format!("rgb({r},{g},{b})")).count();
            assert_eq!(count, times, "{color:?}\n{}", figure.svg);
        }
        for words in ["a &lt;survey&gt;", "hole: seen by none", "rejected frame", "two frames", "10 m"] {
            assert!(figure.svg.contains(words), "{words}\n{}", figure.svg);
        }
        assert!(figure.png.starts_with(&[0x89, b'P', b'N', b'G']));
        // One cross on the map and one in the legend, of two lines each: the frame that claims to be 10 000 km away is
        // not on the map. The hole and its entry have the same colour.
        assert_eq!(figure.svg.matches("stroke=\"#d64045\"").count(), 4);
        assert_eq!(figure.svg.matches("fill=\"#d64045\"").count(), 2);
        let elsewhere = CoverageMap { rejected: Vec::new(), holes: vec![false; 6], ..map() };
        let svg = coverage_map(&elsewhere).unwrap().svg;
        assert!(!svg.contains("rejected frame") && !svg.contains("hole:") && !svg.contains("#d64045"));
    }

    #[test]
    fn counts_that_do_not_fill_the_grid_are_refused() {
        let wrong = CoverageMap { counts: vec![1; 5], ..map() };
        assert!(matches!(coverage_map(&wrong), Err(FigureError::Grid { values: 5, .. })));
    }
}
