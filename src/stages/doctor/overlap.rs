//! How often the ground is seen: footprints counted on a coarse grid, and what each frame shares with the next.

use super::view::{View, median};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// How the footprints cover the ground.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Overlap {
    /// Side of a cell of the grid that the ground is counted on, metres.
    pub cell_m: f64,
    /// Ground that any frame sees, square metres.
    pub area_m2: f64,
    /// Shares of that ground by how many frames see it: one, two, three or more.
    pub seen_by: Share,
    /// Frames that see the ground, on average over that ground.
    pub mean_count: f64,
    /// Number of holes: ground without a frame that is enclosed by footprints or lies between the frames.
    pub holes: usize,
    /// Their area, square metres.
    pub holes_m2: f64,
    /// Number of pieces, not touching each other, that the footprints fall into.
    pub parts: usize,
    /// Share of a frame's ground that the next frame sees as well: the median over the frames.
    pub forward_median: Option<f64>,
    /// How frames follow each other: "time" or "name".
    pub order: &'static str,
    #[serde(skip)]
    forward: BTreeMap<String, f64>,
}

/// Shares that add up to 1.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Share {
    /// Seen by one frame only.
    pub one: f64,
    /// By two.
    pub two: f64,
    /// By three or more.
    pub more: f64,
}

impl Overlap {
    /// What a frame shares with the next one; `None` for the last.
    pub(super) fn forward_of(&self, frame: &str) -> Option<f64> {
        self.forward.get(frame).copied()
    }
}

/// How many frames see each cell, north up.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coverage {
    pub cell_m: f64,
    /// East and north of the upper left corner.
    pub corner: [f64; 2],
    pub columns: usize,
    pub rows: usize,
    pub counts: Vec<u16>,
    /// Cells that belong to a hole.
    pub hole: Vec<bool>,
}

/// Cells along the longer side of the grid.
const CELLS: f64 = 480.0;
/// Samples along each side of the box around a footprint, for what two frames share.
const SAMPLES: usize = 40;
/// Holes and pieces of fewer cells come from the cells themselves.
const FEWEST_CELLS: usize = 4;

/// Counts footprints; `None` without any.
pub(super) fn of(views: &[View], order: &[usize]) -> (Option<Overlap>, Option<Coverage>) {
    let Some(mut coverage) = Coverage::of(views) else { return (None, None) };
    let seen = coverage.counts.iter().filter(|count| **count > 0).count().max(1) as f64;
    let share = |wanted: &dyn Fn(u16) -> bool| {
        coverage.counts.iter().filter(|count| wanted(**count)).count() as f64 / seen
    };
    let seen_by = Share { one: share(&|n| n == 1), two: share(&|n| n == 2), more: share(&|n| n > 2) };
    let mean_count = coverage.counts.iter().map(|count| f64::from(*count)).sum::<f64>() / seen;
    let parts = coverage.pieces(|cell| coverage.counts[cell] > 0);
    let parts = parts.iter().filter(|piece| piece.len() >= FEWEST_CELLS).count();
    let holes = coverage.holes(views);
    for cell in holes.iter().flatten() {
        coverage.hole[*cell] = true;
    }
    let cell_m2 = coverage.cell_m * coverage.cell_m;
    let steps: Vec<&[usize]> = order.windows(2).collect();
    let forward: BTreeMap<String, f64> = steps
        .par_iter()
        .filter_map(|pair| {
            let (a, b) = (&views[pair[0]], &views[pair[1]]);
            Some((a.name.clone(), shared(&a.outline, &b.outline)?))
        })
        .collect();
    let overlap = Overlap {
        cell_m: coverage.cell_m,
        area_m2: seen * cell_m2,
        seen_by,
        mean_count,
        holes: holes.len(),
        holes_m2: holes.iter().map(Vec::len).sum::<usize>() as f64 * cell_m2,
        parts,
        forward_median: median(forward.values().copied().collect()),
        order: if views.iter().all(|view| view.time_s.is_some()) { "time" } else { "name" },
        forward,
    };
    (Some(overlap), Some(coverage))
}

impl Coverage {
    fn of(views: &[View]) -> Option<Self> {
        let (low, high) = bounds(views.iter().flat_map(|view| &view.outline))?;
        let longer = (high[0] - low[0]).max(high[1] - low[1]);
        if !(longer > 0.0 && longer.is_finite()) {
            return None;
        }
        let cell_m = longer / CELLS;
        let cells = |k: usize| (((high[k] - low[k]) / cell_m).ceil() as usize).max(1);
        let (columns, rows) = (cells(0), cells(1));
        let mut coverage = Self {
            cell_m,
            corner: [low[0], high[1]],
            columns,
            rows,
            counts: vec![0; columns * rows],
            hole: vec![false; columns * rows],
        };
        for view in views {
            coverage.add(&view.outline);
        }
        Some(coverage)
    }

    /// East and north of a cell's middle.
    fn middle(&self, column: usize, row: usize) -> [f64; 2] {
        [
            self.corner[0] + (column as f64 + 0.5) * self.cell_m,
            self.corner[1] - (row as f64 + 0.5) * self.cell_m,
        ]
    }

    /// Counts the cells whose middle lies in an outline, row by row.
    fn add(&mut self, outline: &[[f64; 2]]) {
        let Some((low, high)) = bounds(outline.iter()) else { return };
        let row_of = |north: f64| ((self.corner[1] - north) / self.cell_m).max(0.0) as usize;
        for row in row_of(high[1])..=row_of(low[1]).min(self.rows - 1) {
            let north = self.middle(0, row)[1];
            let mut crossings = crossings(outline, north);
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let column =
                    |east: f64| ((east - self.corner[0]) / self.cell_m - 0.5).ceil().max(0.0) as usize;
                for column in column(pair[0])..column(pair[1]).min(self.columns) {
                    let count = &mut self.counts[row * self.columns + column];
                    *count = count.saturating_add(1);
                }
            }
        }
    }

    /// Cells that satisfy a condition, gathered into pieces that touch by their sides.
    fn pieces(&self, inside: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let mut seen = vec![false; self.counts.len()];
        let mut pieces = Vec::new();
        for start in 0..self.counts.len() {
            if seen[start] || !inside(start) {
                continue;
            }
            seen[start] = true;
            let mut piece = vec![start];
            let mut next = 0;
            while let Some(&cell) = piece.get(next) {
                next += 1;
                let (column, row) = (cell % self.columns, cell / self.columns);
                let sides = [
                    (column > 0).then(|| cell - 1),
                    (column + 1 < self.columns).then_some(cell + 1),
                    (row > 0).then(|| cell - self.columns),
                    (row + 1 < self.rows).then_some(cell + self.columns),
                ];
                for side in sides.into_iter().flatten() {
                    if !seen[side] && inside(side) {
                        seen[side] = true;
                        piece.push(side);
                    }
                }
            }
            pieces.push(piece);
        }
        pieces
    }

    /// Ground without a frame that footprints enclose, or that lies within the hull of the frames' centres.
    fn holes(&self, views: &[View]) -> Vec<Vec<usize>> {
        let hull = hull(views.iter().map(|view| view.centre).collect());
        let within = |cell: usize| {
            hull.len() > 2 && contains(&hull, self.middle(cell % self.columns, cell / self.columns))
        };
        let mut empty = vec![false; self.counts.len()];
        for piece in self.pieces(|cell| self.counts[cell] == 0) {
            let open = piece.iter().any(|cell| {
                let (column, row) = (cell % self.columns, cell / self.columns);
                column == 0 || row == 0 || column + 1 == self.columns || row + 1 == self.rows
            });
            for cell in piece {
                empty[cell] = !open || within(cell);
            }
        }
        let mut holes = self.pieces(|cell| empty[cell]);
        holes.retain(|hole| hole.len() >= FEWEST_CELLS);
        holes
    }
}

/// Least and greatest coordinates.
pub(super) fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Option<([f64; 2], [f64; 2])> {
    points.fold(None, |bounds, p| {
        let (low, high) = bounds.unwrap_or((*p, *p));
        Some(([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]))
    })
}

/// Where a line towards east crosses an outline.
fn crossings(outline: &[[f64; 2]], north: f64) -> Vec<f64> {
    let next = outline.iter().cycle().skip(1);
    outline
        .iter()
        .zip(next)
        .filter(|(a, b)| (a[1] > north) != (b[1] > north))
        .map(|(a, b)| a[0] + (north - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
        .collect()
}

/// Whether an outline holds a point (by the even–odd rule).
pub(super) fn contains(outline: &[[f64; 2]], at: [f64; 2]) -> bool {
    crossings(outline, at[1]).into_iter().filter(|east| *east > at[0]).count() % 2 == 1
}

/// Share of an outline that another one covers as well; `None` for an outline without an area.
fn shared(outline: &[[f64; 2]], other: &[[f64; 2]]) -> Option<f64> {
    let (low, high) = bounds(outline.iter())?;
    let (mut own, mut both) = (0_usize, 0_usize);
    for row in 0..SAMPLES {
        for column in 0..SAMPLES {
            let along = |k: usize, i: usize| low[k] + (i as f64 + 0.5) / SAMPLES as f64 * (high[k] - low[k]);
            let at = [along(0, column), along(1, row)];
            if contains(outline, at) {
                own += 1;
                both += usize::from(contains(other, at));
            }
        }
    }
    (own > 0).then(|| both as f64 / own as f64)
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let left = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| {
        (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]) > 0.0
    };
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while chain.len() > 1 && !left(chain[chain.len() - 2], chain[chain.len() - 1], p) {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(name: &str, centre: [f64; 2], half: [f64; 2]) -> View {
        let [e, n] = centre;
        let outline = vec![
            [e - half[0], n + half[1]],
            [e + half[0], n + half[1]],
            [e + half[0], n - half[1]],
            [e - half[0], n - half[1]],
        ];
        View { name: name.to_owned(), place: centre, centre, outline, ..View::default() }
    }

    fn overlap(views: &[View]) -> Overlap {
        let order: Vec<usize> = (0..views.len()).collect();
        of(views, &order).0.unwrap()
    }

    #[test]
    fn two_frames_that_share_half_their_ground() {
        let views = [view("a", [0.0, 0.0], [50.0, 30.0]), view("b", [50.0, 0.0], [50.0, 30.0])];
        let found = overlap(&views);
        // 150 m × 60 m in all, of which the middle 50 m are seen twice.
        assert!((found.area_m2 - 9000.0).abs() < 100.0, "{found:?}");
        assert!((found.seen_by.two - 1.0 / 3.0).abs() < 0.01, "{found:?}");
        assert!((found.seen_by.one - 2.0 / 3.0).abs() < 0.01, "{found:?}");
        assert_eq!((found.holes, found.parts, found.seen_by.more), (0, 1, 0.0));
        assert!((found.forward_median.unwrap() - 0.5).abs() < 0.03);
        assert_eq!((found.forward_of("b"), found.order), (None, "name"));
    }

    #[test]
    fn a_ring_of_frames_leaves_a_hole_of_its_area() {
        let mut views = Vec::new();
        for (i, (e, n)) in
            [(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)].into_iter().enumerate()
        {
            views.push(view(&i.to_string(), [100.0 * f64::from(e), 100.0 * f64::from(n)], [55.0, 55.0]));
        }
        let found = overlap(&views);
        // Between them 200 m − 2 · 55 m are left, squared.
        assert_eq!(found.holes, 1);
        assert!((found.holes_m2 - 90.0 * 90.0).abs() < 200.0, "{found:?}");
        views.push(view("middle", [0.0, 0.0], [55.0, 55.0]));
        assert_eq!(overlap(&views).holes, 0);
    }

    #[test]
    fn two_strips_apart_have_a_gap_and_are_two_pieces() {
        let mut views = Vec::new();
        for strip in 0..2 {
            for i in 0..4 {
                let name = format!("{strip}{i}");
                views.push(view(&name, [60.0 * f64::from(i), 200.0 * f64::from(strip)], [50.0, 50.0]));
            }
        }
        let found = overlap(&views);
        assert_eq!((found.parts, found.holes), (2, 1));
        // Of the hull of the centres, 180 m × 100 m hold nothing.
        assert!((found.holes_m2 - 18_000.0).abs() < 600.0, "{found:?}");
    }

    #[test]
    fn outlines_without_an_area_give_nothing() {
        assert_eq!(of(&[], &[]), (None, None));
        let flat = View { outline: vec![[1.0, 1.0]; 4], ..View::default() };
        assert_eq!(of(&[flat], &[0]), (None, None));
    }
}
