//! Pictures of a calibration, each over the frame of the image: residual vectors, and where the points were.

use super::figures::{
    ACCENT, FAINT, Figure, FigureError, INK, LINE, finished, image_axes, line, scene, text, tint,
};
use kuva::render::color::Color;
use kuva::render::render::{Primitive, TextAnchor};

const WIDTH: f64 = 620.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 20.0;
const BOTTOM: f64 = 86.0;

/// A residual: where it was observed, and observed − predicted; columns and rows, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResidualVector {
    /// Column and row of the point.
    pub at: [f64; 2],
    /// Column and row of observed − predicted.
    pub residual: [f64; 2],
    /// Set apart as an outlier.
    pub outlier: bool,
}

/// Residuals of all photos as lines over the frame, magnified by a round number that is written below.
///
/// # Errors
/// [`FigureError`].
pub fn residual_vectors(image_px: (u32, u32), vectors: &[ResidualVector]) -> Result<Figure, FigureError> {
    let scale = WIDTH / f64::from(image_px.0);
    let height = scale * f64::from(image_px.1);
    let mut scene = scene(LEFT + WIDTH + RIGHT, TOP + height + BOTTOM);
    // Nineteen of twenty lines are shorter than a thirtieth of the picture.
    let mut lengths: Vec<f64> =
        vectors.iter().filter(|v| !v.outlier).map(|v| v.residual[0].hypot(v.residual[1])).collect();
    lengths.sort_by(f64::total_cmp);
    let typical = lengths.get(lengths.len() * 19 / 20).copied().unwrap_or(1.0).max(1e-9);
    let magnification = round_down(WIDTH / 30.0 / (typical * scale));
    // Ordinary ones first, so that outliers lie on top.
    for outliers in [false, true] {
        for v in vectors.iter().filter(|v| v.outlier == outliers) {
            let from = (LEFT + (v.at[0] + 0.5) * scale, TOP + (v.at[1] + 0.5) * scale);
            let long = v.residual[0].hypot(v.residual[1]);
            // What leaves the picture is cut to a fifth of it.
            let cut = (0.2 * WIDTH / (long * magnification * scale)).min(1.0);
            let reach = magnification * scale * cut;
            let to = (from.0 + v.residual[0] * reach, from.1 + v.residual[1] * reach);
            let colour = if outliers { ACCENT } else { LINE };
            line(&mut scene, from, to, colour.clone(), 1.0);
            scene.add(Primitive::Circle {
                cx: from.0,
                cy: from.1,
                r: 1.3,
                fill: colour,
                fill_opacity: None,
                stroke: None,
                stroke_width: None,
            });
        }
    }
    image_axes(&mut scene, image_px, LEFT, TOP, WIDTH);
    let below = TOP + height + 70.0;
    let one = round_down(0.25 * WIDTH / (magnification * scale));
    let bar = one * magnification * scale;
    line(&mut scene, (LEFT, below), (LEFT + bar, below), INK, 2.0);
    let words = format!("{one} px (lines are {magnification} times as long as the residuals)");
    text(&mut scene, (LEFT + bar + 10.0, below + 5.0), &words, 14, TextAnchor::Start, INK);
    finished(&scene)
}

/// The largest of 1, 2 or 5 times a power of ten that is not above a value.
fn round_down(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    let digit = if value >= 5.0 * power {
        5.0
    } else if value >= 2.0 * power {
        2.0
    } else {
        1.0
    };
    digit * power
}

/// Where in the frame points of the target were seen: cells tinted by their number, points as dots, and pixels
/// whose lens no point supports or that have no inverse hatched.
///
/// - `cells`: across and down, for the tint.
/// - `unsupported`: for equal cells row by row, `columns` of them across: true where no point supports the lens.
///
/// # Errors
/// [`FigureError`].
pub fn coverage(
    image_px: (u32, u32),
    points: &[[f64; 2]],
    cells: (usize, usize),
    unsupported: &[bool],
    columns: usize,
) -> Result<Figure, FigureError> {
    let (w, h) = (f64::from(image_px.0), f64::from(image_px.1));
    let scale = WIDTH / w;
    let height = scale * h;
    let mut scene = scene(LEFT + WIDTH + RIGHT, TOP + height + BOTTOM);
    let mut counts = vec![0_u32; cells.0 * cells.1];
    for [column, row] in points {
        let cell = |at: f64, size: f64, cells: usize| {
            (((at + 0.5) / size * cells as f64).max(0.0) as usize).min(cells - 1)
        };
        counts[cell(*row, h, cells.1) * cells.0 + cell(*column, w, cells.0)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    let (cell_w, cell_h) = (WIDTH / cells.0 as f64, height / cells.1 as f64);
    for (i, count) in counts.iter().enumerate() {
        scene.add(Primitive::Rect {
            x: LEFT + (i % cells.0) as f64 * cell_w,
            y: TOP + (i / cells.0) as f64 * cell_h,
            width: cell_w,
            height: cell_h,
            fill: if *count == 0 {
                Color::Rgb(255, 244, 230)
            } else {
                tint(f64::from(*count) / f64::from(most))
            },
            stroke: None,
            stroke_width: None,
            opacity: None,
        });
    }
    if columns > 0 && !unsupported.is_empty() {
        let rows = unsupported.len() / columns;
        let (cell_w, cell_h) = (WIDTH / columns as f64, height / rows as f64);
        for (i, _) in unsupported.iter().enumerate().filter(|(_, without)| **without) {
            let (x, y) = (LEFT + (i % columns) as f64 * cell_w, TOP + (i / columns) as f64 * cell_h);
            line(&mut scene, (x, y + cell_h), (x + cell_w, y), ACCENT, 0.8);
        }
    }
    for [column, row] in points {
        scene.add(Primitive::Circle {
            cx: LEFT + (column + 0.5) * scale,
            cy: TOP + (row + 0.5) * scale,
            r: 1.2,
            fill: INK,
            fill_opacity: Some(0.6),
            stroke: None,
            stroke_width: None,
        });
    }
    image_axes(&mut scene, image_px, LEFT, TOP, WIDTH);
    let below = TOP + height + 75.0;
    let words = format!("{} points; hatched: no point supports the lens there", points.len());
    text(&mut scene, (LEFT, below), &words, 14, TextAnchor::Start, FAINT);
    finished(&scene)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residual_lines_are_magnified_by_a_round_number() {
        let vector = |c: f64, residual| ResidualVector { at: [c, 100.0], residual, outlier: false };
        let vectors: Vec<_> = (0..40).map(|i| vector(10.0 * f64::from(i), [0.2, 0.0])).collect();
        let svg = residual_vectors((620, 400), &vectors).unwrap().svg;
        // A thirtieth of 620 px is 20.7 px for 0.2 px: 103 times, rounded down to 100.
        assert!(svg.contains("lines are 100 times as long"), "{svg}");
        assert_eq!([round_down(103.0), round_down(0.07), round_down(2.0)], [100.0, 0.05, 2.0]);
    }

    #[test]
    fn coverage_counts_its_points_and_hatches_what_nothing_supports() {
        let hatched = |unsupported: &[bool]| {
            let svg =
                coverage((400, 300), &[[5.0, 5.0], [399.4, 299.4]], (8, 6), unsupported, 4).unwrap().svg;
            assert!(svg.contains("2 points"), "{svg}");
            svg.matches("#c05621").count() + svg.matches("rgb(192,86,33)").count()
        };
        let none = hatched(&[false; 12]);
        let mut three = [false; 12];
        three[..3].fill(true);
        assert_eq!(hatched(&three) - none, 3);
    }
}
