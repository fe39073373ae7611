//! Which crossings are neighbours on a board: an edge leads from one to the other.

use super::super::crossings::{self, Crossing};
use super::super::lattice::Cells;
use crate::calibration::grey::Grey;
use nalgebra::Vector2;
use std::collections::BTreeSet;

/// Neighbours are among this many nearest crossings, unless tilt makes one direction eight times shorter.
const NEAREST: usize = 32;
/// Cosine of the largest angle between an arm and the direction of the neighbour: 25°.
const ALONG_ARM: f64 = 0.906;
/// Light minus dark across an edge, as a share of the contrast of the stronger crossing at its ends.
const EDGE_SHARE: f32 = 0.25;
/// Contrasts of neighbours differ by less than this share: light falls off slowly, clutter does not.
const CONTRAST_RATIO: f32 = 0.4;

/// For each crossing the neighbour along each arm.
pub(super) fn neighbours(smooth: &Grey, crossings: &[Crossing]) -> Vec<[Option<usize>; 4]> {
    let buckets = Buckets::new(smooth, crossings);
    let mut near = Vec::new();
    (0..crossings.len())
        .map(|i| {
            buckets.nearest(crossings, i, &mut near);
            let mut found = [None; 4];
            for &(_, j) in &near {
                if let Some((arm, _)) = link(smooth, &crossings[i], &crossings[j])
                    && found[arm].is_none()
                {
                    found[arm] = Some(j);
                }
            }
            found
        })
        .collect()
}

/// The arms of two crossings that are one edge, if they are.
fn link(smooth: &Grey, from: &Crossing, to: &Crossing) -> Option<(usize, usize)> {
    let (weaker, stronger) = (from.contrast.min(to.contrast), from.contrast.max(to.contrast));
    if weaker < CONTRAST_RATIO * stronger {
        return None;
    }
    let step = to.saddle - from.saddle;
    let direction = step.try_normalize(1.0)?;
    let arm = (0..4).find(|&k| from.arms[k].dot(&direction) > ALONG_ARM)?;
    let back = (0..4).find(|&k| to.arms[k].dot(&direction) < -ALONG_ARM)?;
    // Leaving one crossing dark is on the right, arriving at the next it is on the left, or the reverse.
    if arm % 2 == back % 2 {
        return None;
    }
    let right = Vector2::new(-direction.y, direction.x) * (0.15 * step.norm()).clamp(1.5, 12.0);
    let right = if arm % 2 == 0 { right } else { -right };
    let least = EDGE_SHARE * stronger;
    // An edge over a crossing in between, or two of them, would change sides.
    let is_edge = [1.0 / 6.0, 0.5, 5.0 / 6.0].into_iter().all(|share| {
        let p = from.saddle + step * share;
        smooth.between(p - right) - smooth.between(p + right) > least
    });
    is_edge.then_some((arm, back))
}

/// Crossings by their place, for finding near ones.
struct Buckets {
    size: f64,
    columns: usize,
    rows: usize,
    members: Vec<Vec<usize>>,
}

impl Buckets {
    fn new(image: &Grey, crossings: &[Crossing]) -> Self {
        let (w, h) = (image.width() as f64, image.height() as f64);
        let size = (w * h / crossings.len().max(1) as f64).sqrt().max(1.0);
        let (columns, rows) = ((w / size) as usize + 1, (h / size) as usize + 1);
        let mut members = vec![vec![]; columns * rows];
        for (i, crossing) in crossings.iter().enumerate() {
            let (c, r) = ((crossing.saddle.x / size) as usize, (crossing.saddle.y / size) as usize);
            members[r.min(rows - 1) * columns + c.min(columns - 1)].push(i);
        }
        Self { size, columns, rows, members }
    }

    /// The nearest others, by squared distance.
    fn nearest(&self, crossings: &[Crossing], of: usize, found: &mut Vec<(f64, usize)>) {
        let here = crossings[of].saddle;
        let (c, r) = ((here.x / self.size) as usize, (here.y / self.size) as usize);
        let mut reach = 2;
        loop {
            found.clear();
            for row in r.saturating_sub(reach)..=(r + reach).min(self.rows - 1) {
                for column in c.saturating_sub(reach)..=(c + reach).min(self.columns - 1) {
                    let others = self.members[row * self.columns + column].iter().filter(|&&j| j != of);
                    found.extend(others.map(|&j| ((crossings[j].saddle - here).norm_squared(), j)));
                }
            }
            // All that are as near as the border of the buckets looked at.
            let complete = (reach as f64 * self.size).powi(2);
            if reach >= self.columns.max(self.rows)
                || found.iter().filter(|(distance, _)| *distance < complete).count() >= NEAREST
            {
                break;
            }
            reach *= 2;
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.truncate(NEAREST);
    }
}

const STEPS: [(i32, i32); 4] = [(0, -1), (1, 0), (0, 1), (-1, 0)];

/// Looks for crossings where the lattice, continued, expects them: weak ones, and ones that were not linked.
pub(super) fn grow(cells: &mut Cells, smooth: &Grey, crossings: &mut Vec<Crossing>) {
    const ROUNDS: usize = 50;
    for _ in 0..ROUNDS {
        let beside = |&(x, y): &(i32, i32)| STEPS.map(|(dx, dy)| (x + dx, y + dy));
        let empty: BTreeSet<_> =
            cells.keys().flat_map(beside).filter(|place| !cells.contains_key(place)).collect();
        let mut added = false;
        for place in empty {
            if let Some((crossing, turn)) = continued(place, cells, smooth, crossings) {
                cells.insert(place, (crossings.len(), turn));
                crossings.push(crossing);
                added = true;
            }
        }
        if !added {
            return;
        }
    }
}

/// The crossing at an empty place, and its arm that is the upper one in the lattice's orientation.
fn continued(
    (x, y): (i32, i32),
    cells: &Cells,
    smooth: &Grey,
    crossings: &[Crossing],
) -> Option<(Crossing, usize)> {
    let at = |x: i32, y: i32| cells.get(&(x, y)).map(|&(index, turn)| (&crossings[index], turn));
    let (mut sum, mut count, mut pitch) = (Vector2::zeros(), 0.0, f64::INFINITY);
    for (dx, dy) in STEPS {
        let Some((near, _)) = at(x + dx, y + dy) else { continue };
        // Straight on; or around the corner, along the next row.
        let behind = at(x + 2 * dx, y + 2 * dy).map(|(far, _)| near.saddle - far.saddle);
        let beside = [(dy, dx), (-dy, -dx)].into_iter().find_map(|(u, v)| {
            let (diagonal, _) = at(x + dx + u, y + dy + v)?;
            let (side, _) = at(x + u, y + v)?;
            Some(side.saddle - diagonal.saddle)
        });
        for step in [behind, beside].into_iter().flatten() {
            sum += near.saddle + step;
            count += 1.0;
            pitch = pitch.min(step.norm());
        }
    }
    if count == 0.0 {
        return None;
    }
    let reach = (0.25 * pitch).clamp(1.5, 8.0);
    let weakest = STEPS.iter().filter_map(|(dx, dy)| at(x + dx, y + dy)).map(|(c, _)| c.contrast);
    let crossing =
        crossings::near(smooth, sum / count, reach, CONTRAST_RATIO * weakest.fold(f32::INFINITY, f32::min))?;
    let mut turn = None;
    for (side, (dx, dy)) in STEPS.into_iter().enumerate() {
        let Some((neighbour, neighbour_turn)) = at(x + dx, y + dy) else { continue };
        // Every neighbour must agree.
        let (arm, back) = link(smooth, &crossing, neighbour)?;
        let this = (arm + 4 - side) % 4;
        let facing = (side + 2 + neighbour_turn) % 4;
        if back != facing || turn.is_some_and(|turn| turn != this) {
            return None;
        }
        turn = Some(this);
    }
    Some((crossing, turn?))
}
