//! Lines of equal value over a grid of values: marching squares, joined to polylines.

use std::collections::BTreeMap;

/// A line of one level; positions in grid units, (0, 0) the first value.
#[derive(Debug, Clone, PartialEq)]
pub struct Contour {
    /// The value along it.
    pub level: f64,
    /// Its corners; the first is repeated at the end when it closes.
    pub points: Vec<(f64, f64)>,
}

/// An edge of the grid: column, row, and whether it runs down.
type Edge = (usize, usize, bool);

/// Contours of values row by row, `columns` to a row; cells with a value that is not finite are left out.
#[must_use]
pub fn contours(values: &[f64], columns: usize, level: f64) -> Vec<Contour> {
    if columns < 2 || values.len() < 2 * columns {
        return Vec::new();
    }
    let rows = values.len() / columns;
    let at = |c: usize, r: usize| values[r * columns + c];
    let mut neighbours: BTreeMap<Edge, Vec<Edge>> = BTreeMap::new();
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let corners =
                [at(column, row), at(column + 1, row), at(column + 1, row + 1), at(column, row + 1)];
            if corners.iter().any(|v| !v.is_finite()) {
                continue;
            }
            let edges = [
                (column, row, false),
                (column + 1, row, true),
                (column, row + 1, false),
                (column, row, true),
            ];
            let above = corners.map(|v| v >= level);
            let crossed: Vec<Edge> =
                (0..4).filter(|&i| above[i] != above[(i + 1) % 4]).map(|i| edges[i]).collect();
            let pairs: &[(usize, usize)] = match crossed.len() {
                2 => &[(0, 1)],
                // A saddle: the centre decides which corners belong together.
                4 if (corners.iter().sum::<f64>() / 4.0 >= level) == above[0] => &[(0, 1), (2, 3)],
                4 => &[(0, 3), (1, 2)],
                _ => &[],
            };
            for &(a, b) in pairs {
                neighbours.entry(crossed[a]).or_default().push(crossed[b]);
                neighbours.entry(crossed[b]).or_default().push(crossed[a]);
            }
        }
    }
    let position = |(c, r, down): Edge| {
        let (from, to) = (at(c, r), if down { at(c, r + 1) } else { at(c + 1, r) });
        let share = if to == from { 0.5 } else { (level - from) / (to - from) };
        let (c, r) = (c as f64, r as f64);
        if down { (c, r + share) } else { (c + share, r) }
    };
    let mut lines = Vec::new();
    // Open lines start at an edge with one neighbour, so those go first; what is left are rings.
    while let Some(start) = neighbours
        .iter()
        .find(|(_, n)| n.len() == 1)
        .or_else(|| neighbours.iter().find(|(_, n)| !n.is_empty()))
        .map(|(e, _)| *e)
    {
        let mut points = vec![position(start)];
        let mut here = start;
        while let Some(next) = neighbours.get_mut(&here).and_then(Vec::pop) {
            if let Some(back) = neighbours.get_mut(&next)
                && let Some(i) = back.iter().position(|e| *e == here)
            {
                back.swap_remove(i);
            }
            points.push(position(next));
            here = next;
        }
        neighbours.retain(|_, n| !n.is_empty());
        lines.push(Contour { level, points });
    }
    lines
}

/// Round levels (1, 2 or 5 times a power of ten apart), about `count` of them, inside the values' range.
#[must_use]
pub fn round_levels(values: &[f64], count: usize) -> Vec<f64> {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let step = round_step((high - low) / count.max(1) as f64);
    if !(step > 0.0 && step.is_finite()) {
        return Vec::new();
    }
    let first = (low / step).ceil() as i64;
    (first..).map(|k| k as f64 * step).take_while(|level| *level <= high).collect()
}

/// Levels for values that grow fast: quantiles of the values, rounded, so that the lines
/// spread over the picture.
#[must_use]
pub fn spread_levels(values: &[f64], count: usize) -> Vec<f64> {
    let mut finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    finite.sort_by(f64::total_cmp);
    let Some(last) = finite.len().checked_sub(1) else { return Vec::new() };
    let mut levels: Vec<f64> = (1..=count)
        .map(|k| finite[(k * last) / (count + 1)])
        .map(|value| {
            let unit = round_step(value.abs() / 20.0);
            if unit > 0.0 && unit.is_finite() { (value / unit).round() * unit } else { value }
        })
        .collect();
    levels.dedup();
    levels
}

/// 1, 2 or 5 times a power of ten, not below a value.
fn round_step(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0]
        .into_iter()
        .map(|k| k * power)
        .find(|step| *step >= value * (1.0 - 1e-9))
        .unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_is_one_ring_of_its_radius() {
        let values: Vec<f64> =
            (0..41 * 31).map(|i| f64::hypot((i % 41) as f64 - 20.0, (i / 41) as f64 - 15.0)).collect();
        let rings = contours(&values, 41, 9.5);
        assert_eq!(rings.len(), 1);
        let ring = &rings[0].points;
        assert_eq!(ring.first(), ring.last());
        for (x, y) in ring {
            assert!((f64::hypot(x - 20.0, y - 15.0) - 9.5).abs() < 0.02);
        }
    }

    #[test]
    fn a_slope_is_one_open_line_and_holes_are_left_out() {
        let mut values: Vec<f64> = (0..10 * 8).map(|i| (i % 10) as f64).collect();
        let lines = contours(&values, 10, 4.25);
        assert_eq!(lines.len(), 1);
        assert_eq!(lines[0].points.len(), 8);
        assert!(lines[0].points.iter().all(|p| (p.0 - 4.25).abs() < 1e-12));
        values[3 * 10 + 4] = f64::NAN;
        assert_eq!(contours(&values, 10, 4.25).len(), 2);
        assert!(contours(&values, 10, 99.0).is_empty());
    }

    #[test]
    fn saddles_do_not_cross() {
        let lines = contours(&[1.0, 0.0, 0.0, 1.0], 2, 0.5);
        assert_eq!(lines.len(), 2);
        assert!(lines.iter().all(|l| l.points.len() == 2));
    }

    #[test]
    fn levels_are_round_and_inside() {
        assert_eq!(round_levels(&[0.03, 0.47, f64::NAN], 5), [0.1, 0.2, 0.30000000000000004, 0.4]);
        assert_eq!(round_levels(&[2.0, 2.0], 5), Vec::<f64>::new());
        let spread = spread_levels(&(1..=100).map(|i| f64::from(i * i)).collect::<Vec<_>>(), 4);
        assert_eq!(spread, [400.0, 1600.0, 3600.0, 6500.0]);
    }
}
