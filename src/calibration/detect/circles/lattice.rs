//! Discs onto a square lattice. Neighbours on an asymmetric grid lie diagonally, on a square lattice too.

use super::super::plane::{homography, mapped};
use super::discs::Disc;
use nalgebra::Vector2;
use std::collections::{BTreeMap, BTreeSet};

/// A disc may lie this far from where the lattice, continued, expects it, in steps.
const TOLERANCE: f64 = 0.3;
/// Where no steps can be continued, cells up to this far away both ways tell where a disc is expected, ...
const REACH: i32 = 3;
/// ... at least this many.
const LEAST_CELLS: usize = 7;
/// Areas of neighbours differ by less than this factor.
const AREA_RATIO: f64 = 1.9;
/// Steps of a seed, seen from above, differ by less than this factor; a diagonal is 1.41 long.
const STEP_RATIO: f64 = 1.4;

/// Cell (right, down, turned anyhow) to disc. The turn from the first to the second axis is clockwise as seen.
pub(super) type Cells = BTreeMap<(i32, i32), usize>;

/// All lattices of at least four discs, the largest first; no disc is in two.
pub(super) fn lattices(discs: &[Disc]) -> Vec<Cells> {
    let mut used = vec![false; discs.len()];
    let mut found = Vec::new();
    for start in 0..discs.len() {
        if used[start] {
            continue;
        }
        let Some(cells) = seed(discs, &used, start).map(|cells| grown(cells, discs, &used)) else {
            continue;
        };
        let Some(cells) = squared(&cells, discs).map(|cells| grown(cells, discs, &used)) else {
            continue;
        };
        if cells.len() >= 4 {
            cells.values().for_each(|&disc| used[disc] = true);
            found.push(cells);
        }
    }
    found.sort_by_key(|cells| std::cmp::Reverse(cells.len()));
    found
}

fn alike(a: &Disc, b: &Disc) -> bool {
    let ratio = a.area() / b.area();
    ratio < AREA_RATIO && ratio * AREA_RATIO > 1.0
}

/// A disc with its nearest neighbour and the nearest across from that one, as three cells.
///
/// Distances are taken where this disc is round, so that the board's tilt does not matter.
fn seed(discs: &[Disc], used: &[bool], start: usize) -> Option<Cells> {
    let here = &discs[start];
    let others = || {
        (0..discs.len())
            .filter(|&other| other != start && !used[other] && alike(&discs[other], here))
            .map(|other| (other, here.rounding * (discs[other].centre - here.centre)))
    };
    let (first, along) = others().min_by(|a, b| a.1.norm_squared().total_cmp(&b.1.norm_squared()))?;
    let across = |to: &Vector2<f64>| along.perp(to).abs() > 0.85 * along.norm() * to.norm();
    let (second, to) = others()
        .filter(|(_, to)| across(to) && to.norm() < STEP_RATIO * along.norm())
        .min_by(|a, b| a.1.norm_squared().total_cmp(&b.1.norm_squared()))?;
    let (right, down) = if along.perp(&to) > 0.0 { (first, second) } else { (second, first) };
    Some(Cells::from([((0, 0), start), ((1, 0), right), ((0, 1), down)]))
}

/// Takes in discs that lie where the lattice expects one, until there are no more.
fn grown(mut cells: Cells, discs: &[Disc], used: &[bool]) -> Cells {
    let mut free: Vec<bool> = used.iter().map(|used| !used).collect();
    cells.values().for_each(|&disc| free[disc] = false);
    let mut border: BTreeSet<(i32, i32)> = cells.keys().flat_map(|&cell| around(cell)).collect();
    loop {
        let mut added = BTreeSet::new();
        for cell in std::mem::take(&mut border) {
            if cells.contains_key(&cell) {
                continue;
            }
            if let Some(disc) = expected(&cells, discs, cell)
                .and_then(|(place, near, step)| nearest(discs, &free, place, near, step))
            {
                free[disc] = false;
                cells.insert(cell, disc);
                added.extend(around(cell));
            }
        }
        if added.is_empty() {
            return cells;
        }
        border = added;
    }
}

/// The lattice with its shortest steps as axes; `None` when those, seen from above, do not make squares.
///
/// Every second disc hidden, or the lens, can make a diagonal the shorter step of a seed.
fn squared(cells: &Cells, discs: &[Disc]) -> Option<Cells> {
    let mut cells = cells.clone();
    for _ in 0..4 {
        let Gram { aa, ab, bb } = Gram::of(&cells, discs)?;
        let shear = |by: fn(i32, i32) -> (i32, i32)| {
            let moved = cells.iter().map(|(&(x, y), &disc)| (by(x, y), disc));
            moved.collect::<Cells>()
        };
        cells = if 2.0 * ab > aa.min(bb) {
            if aa < bb { shear(|x, y| (x + y, y)) } else { shear(|x, y| (x, y + x)) }
        } else if -2.0 * ab > aa.min(bb) {
            if aa < bb { shear(|x, y| (x - y, y)) } else { shear(|x, y| (x, y - x)) }
        } else {
            let square = aa < 2.0 * bb && bb < 2.0 * aa && ab * ab < 0.15 * aa * bb;
            return square.then_some(cells);
        };
    }
    None
}

/// Products of the two steps of a lattice where discs are round: medians.
struct Gram {
    aa: f64,
    ab: f64,
    bb: f64,
}

impl Gram {
    fn of(cells: &Cells, discs: &[Disc]) -> Option<Self> {
        let mut products = [const { Vec::new() }; 3];
        for (&(x, y), &disc) in cells {
            let step = |x: i32, y: i32| {
                cells.get(&(x, y)).map(|&to| discs[disc].rounding * (discs[to].centre - discs[disc].centre))
            };
            // Both ways along both axes.
            for (a, b) in [((1, 0), (0, 1)), ((-1, 0), (0, -1))] {
                if let (Some(a), Some(b)) = (step(x + a.0, y + a.1), step(x + b.0, y + b.1)) {
                    products[0].push(a.norm_squared());
                    products[1].push(a.dot(&b));
                    products[2].push(b.norm_squared());
                }
            }
        }
        let [aa, ab, bb] = products.map(|mut values| {
            let middle = values.len() / 2;
            (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
        });
        Some(Self { aa: aa?, ab: ab?, bb: bb? })
    }
}

/// Cells up to two steps away along the axes, and those across corners: gaps of one disc are stepped over.
fn around((x, y): (i32, i32)) -> impl Iterator<Item = (i32, i32)> {
    const STEPS: [(i32, i32); 12] = [
        (1, 0),
        (0, 1),
        (-1, 0),
        (0, -1),
        (1, 1),
        (-1, 1),
        (-1, -1),
        (1, -1),
        (2, 0),
        (0, 2),
        (-2, 0),
        (0, -2),
    ];
    STEPS.into_iter().map(move |(dx, dy)| (x + dx, y + dy))
}

/// Where a disc of an empty cell is expected, a disc near there, and the step between cells.
fn expected(cells: &Cells, discs: &[Disc], cell: (i32, i32)) -> Option<(Vector2<f64>, usize, Vector2<f64>)> {
    by_steps(cells, discs, cell).or_else(|| by_homography(cells, discs, cell))
}

/// From the cells around, neighbours or not.
fn by_homography(
    cells: &Cells,
    discs: &[Disc],
    (x, y): (i32, i32),
) -> Option<(Vector2<f64>, usize, Vector2<f64>)> {
    let near = || {
        cells
            .range((x - REACH, y - REACH)..=(x + REACH, y + REACH))
            .map(|(&(column, row), &disc)| ((column - x, row - y), disc))
            .filter(|((_, down), _)| down.abs() <= REACH)
    };
    let pairs: Vec<_> = near()
        .map(|((right, down), disc)| (Vector2::new(f64::from(right), f64::from(down)), discs[disc].centre))
        .collect();
    if pairs.len() < LEAST_CELLS {
        return None;
    }
    let h = homography(&pairs)?;
    let (_, closest) = near().min_by_key(|((right, down), _)| right * right + down * down)?;
    let place = mapped(&h, Vector2::zeros());
    Some((place, closest, mapped(&h, Vector2::new(1.0, 0.0)) - place))
}

/// From neighbouring cells and the steps between those next to them.
fn by_steps(
    cells: &Cells,
    discs: &[Disc],
    (x, y): (i32, i32),
) -> Option<(Vector2<f64>, usize, Vector2<f64>)> {
    let at = |x: i32, y: i32| cells.get(&(x, y)).map(|&disc| discs[disc].centre);
    let (mut sum, mut count, mut near) = (Vector2::zeros(), 0.0, None);
    for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
        let Some(&neighbour) = cells.get(&(x + dx, y + dy)) else {
            continue;
        };
        let beside = discs[neighbour].centre;
        let mut expect = |step: Vector2<f64>| {
            sum += beside + step;
            count += 1.0;
            near.get_or_insert((neighbour, step));
        };
        // The step continued, and the same step in the lines on both sides.
        if let Some(beyond) = at(x + 2 * dx, y + 2 * dy) {
            expect(beside - beyond);
        }
        for (ax, ay) in [(dy, dx), (-dy, -dx)] {
            if let (Some(to), Some(from)) = (at(x + ax, y + ay), at(x + dx + ax, y + dy + ay)) {
                expect(to - from);
            }
        }
    }
    near.map(|(neighbour, step)| (sum / count, neighbour, step))
}

fn nearest(
    discs: &[Disc],
    free: &[bool],
    place: Vector2<f64>,
    near: usize,
    step: Vector2<f64>,
) -> Option<usize> {
    let rounding = discs[near].rounding;
    let reach = TOLERANCE * (rounding * step).norm();
    (0..discs.len())
        .filter(|&disc| free[disc] && alike(&discs[disc], &discs[near]))
        .map(|disc| (disc, (rounding * (discs[disc].centre - place)).norm()))
        .filter(|&(_, miss)| miss < reach)
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(disc, _)| disc)
}
