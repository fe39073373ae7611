//! Connected dark areas of a thresholded image, with their moments.

use nalgebra::{Matrix2, Vector2};

/// A connected dark area. What it encloses is counted as part of it where it is enclosed along the row.
#[derive(Debug, Clone)]
pub(super) struct Area {
    /// Dark pixels.
    pub dark: usize,
    /// Pixels between the first and the last dark one of every row.
    pub filled: usize,
    /// First row, and first and last dark column of every row from there on.
    pub top: usize,
    pub rows: Vec<(usize, usize)>,
    /// Centre of the filled area.
    pub centre: Vector2<f64>,
    /// Second moments of the filled area about its centre, px².
    pub covariance: Matrix2<f64>,
}

impl Area {
    /// First and last column.
    pub fn columns(&self) -> (usize, usize) {
        self.rows.iter().fold((usize::MAX, 0), |(low, high), row| (low.min(row.0), high.max(row.1)))
    }
    /// Middle of the bounding box.
    pub fn middle(&self) -> Vector2<f64> {
        let (left, right) = self.columns();
        Vector2::new(0.5 * (left + right) as f64, self.top as f64 + 0.5 * (self.rows.len() as f64 - 1.0))
    }
}

/// Dark pixels next to each other in a row.
struct Run {
    row: usize,
    first: usize,
    last: usize,
    parent: usize,
}

/// Areas of dark pixels that touch along their sides, in reading order of their first pixels. Those that touch
/// the image's border, and those of fewer than `least` or more than `most` pixels, are left out.
pub(super) fn dark_areas(dark: &[bool], width: usize, least: usize, most: usize) -> Vec<Area> {
    let height = dark.len() / width;
    let mut runs = runs(dark, width);
    join(&mut runs);
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); runs.len()];
    for at in 0..runs.len() {
        let root = root(&mut runs, at);
        members[root].push(at);
    }
    let inside = |run: &Run| run.first > 0 && run.last + 1 < width && run.row > 0 && run.row + 1 < height;
    members
        .into_iter()
        .filter(|members| {
            let pixels: usize = members.iter().map(|&at| runs[at].last + 1 - runs[at].first).sum();
            (least..=most).contains(&pixels) && members.iter().all(|&at| inside(&runs[at]))
        })
        .map(|members| area(members.iter().map(|&at| &runs[at])))
        .collect()
}

fn runs(dark: &[bool], width: usize) -> Vec<Run> {
    let mut runs = Vec::new();
    for (row, line) in dark.chunks_exact(width).enumerate() {
        let mut column = 0;
        while let Some(skip) = line[column..].iter().position(|&d| d) {
            let first = column + skip;
            let length = line[first..].iter().position(|&d| !d).unwrap_or(width - first);
            runs.push(Run { row, first, last: first + length - 1, parent: runs.len() });
            column = first + length;
        }
    }
    runs
}

/// Makes runs that touch members of one tree, whose root is its first run.
fn join(runs: &mut [Run]) {
    let mut above = 0;
    for here in 0..runs.len() {
        let (row, first, last) = (runs[here].row, runs[here].first, runs[here].last);
        while above < here
            && (runs[above].row + 1 < row || (runs[above].row < row && runs[above].last < first))
        {
            above += 1;
        }
        let mut other = above;
        while other < here && runs[other].row < row && runs[other].first <= last {
            let (a, b) = (root(runs, here), root(runs, other));
            runs[a.max(b)].parent = a.min(b);
            other += 1;
        }
    }
}

fn root(runs: &mut [Run], mut at: usize) -> usize {
    while runs[at].parent != at {
        runs[at].parent = runs[runs[at].parent].parent;
        at = runs[at].parent;
    }
    at
}

/// The runs come row by row.
fn area<'a>(runs: impl Iterator<Item = &'a Run> + Clone) -> Area {
    let mut rows: Vec<(usize, usize)> = Vec::new();
    let (mut top, mut dark) = (0, 0);
    for run in runs {
        dark += run.last + 1 - run.first;
        if rows.is_empty() {
            top = run.row;
        }
        match rows.get_mut(run.row - top) {
            Some(row) => *row = (row.0.min(run.first), row.1.max(run.last)),
            None => rows.push((run.first, run.last)),
        }
    }
    let (mut n, mut sum, mut products) = (0.0, Vector2::zeros(), Matrix2::zeros());
    let origin = Vector2::new(rows[0].0 as f64, top as f64);
    for (row, &(first, last)) in rows.iter().enumerate() {
        let length = (last + 1 - first) as f64;
        let middle = Vector2::new(0.5 * (first + last) as f64, (top + row) as f64) - origin;
        n += length;
        sum += middle * length;
        products += middle * middle.transpose() * length;
        // A row of unit pixels is a strip: its own moments along and across.
        products[(0, 0)] += length.powi(3) / 12.0;
        products[(1, 1)] += length / 12.0;
    }
    let mean = sum / n;
    let covariance = products / n - mean * mean.transpose();
    Area { dark, filled: n as usize, top, rows, centre: mean + origin, covariance }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(lines: &[&str]) -> (Vec<bool>, usize) {
        (lines.iter().flat_map(|line| line.bytes().map(|b| b == b'#')).collect(), lines[0].len())
    }

    #[test]
    fn areas_join_along_sides_only_and_keep_off_the_border() {
        let (dark, width) =
            picture(&["............", ".#.#..##..#.", ".###.#..#..#", "......##...#", "............"]);
        let areas = dark_areas(&dark, width, 1, 100);
        let sizes: Vec<usize> = areas.iter().map(|area| area.dark).collect();
        // The U is one area; the ring's parts meet at corners only; what touches the border is left out.
        assert_eq!(sizes, [5, 2, 1, 1, 1, 2]);
        assert_eq!(areas[0].filled, 6);
        assert_eq!((areas[0].columns(), areas[0].top, areas[0].rows.len()), ((1, 3), 1, 2));
    }

    #[test]
    fn moments_are_those_of_unit_pixels() {
        let (dark, width) = picture(&[".......", ".####..", ".####..", "......."]);
        let area = &dark_areas(&dark, width, 1, 100)[0];
        assert!((area.centre - Vector2::new(2.5, 1.5)).norm() < 1e-12);
        let expected = Matrix2::new(16.0 / 12.0, 0.0, 0.0, 4.0 / 12.0);
        assert!((area.covariance - expected).norm() < 1e-12);
    }
}
