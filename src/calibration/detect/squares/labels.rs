//! Quadrilaterals onto the target's lattice: neighbours, labels, which corner is the upper left.

use super::super::lattice::{Block, Cells, LatticeError, MarkerSeen, closed, components, extent, turned};
use super::super::quads::Quad;
use crate::calibration::target::{Marker, SquaresTarget};
use nalgebra::Vector2;
use std::collections::BTreeSet;

/// A neighbour may lie this far from where its fellow expects it, in pitches: perspective up to 60° and
/// lens distortion stay below, a diagonal neighbour is 1 pitch away.
const NEIGHBOUR_TOLERANCE: f64 = 0.3;
/// Areas of neighbours differ by less than this factor.
const AREA_RATIO: f64 = 2.5;
/// Share of the squares that must be found for the labels to be certain.
const REQUIRED_SHARE: f64 = 0.5;
/// Share of each border row and column.
const BORDER_SHARE: f64 = 0.25;

const SQUARES: &str = "squares";
const SINGLE: &str = "dark quadrilaterals";

/// A square of the target and the quadrilateral it was seen as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Labelled {
    pub row: usize,
    pub column: usize,
    /// Index into the quadrilaterals.
    pub quad: usize,
    /// The quadrilateral's corner that is the square's upper left one.
    pub first_corner: usize,
}

/// The squares of the target, row by row, without the marker.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Labels {
    pub squares: Vec<Labelled>,
    pub marker: MarkerSeen,
}

/// Puts quadrilaterals on the target's lattice.
pub(super) fn label(quads: &[Quad], target: &SquaresTarget) -> Result<Labels, LatticeError> {
    let cells = lattice(quads, target)?;
    let centres: Vec<_> = quads.iter().map(Quad::centre).collect();
    place(&cells, quads, &centres, target)
}

/// Rows and columns of the lattice that the quadrilaterals make up, as the target is read: its marker, if it
/// has one, at the upper left; otherwise no fewer columns than rows.
///
/// Border lines of which less than half is there are taken for clutter.
pub(super) fn count(quads: &[Quad], target: &SquaresTarget) -> Result<(usize, usize), LatticeError> {
    let cells = lattice(quads, target)?;
    let block = Block::around(&cells).trimmed(&cells);
    let block = block.ok_or(LatticeError::NoLattice { what: SINGLE, single: quads.len() })?;
    let (columns, rows) = (block.columns as usize, block.rows as usize);
    if target.marker() == Marker::None {
        return Ok((rows.min(columns), rows.max(columns)));
    }
    let corners = block.corners();
    let hollow = |cell: &(i32, i32)| cells.get(cell).is_some_and(|&(quad, _)| quads[quad].hollow);
    let absent = |cell: &(i32, i32)| !cells.contains_key(cell);
    let at = |kind: &dyn Fn(&(i32, i32)) -> bool| {
        let mut found = (0..4).filter(|&k| kind(&corners[k]));
        (found.next(), found.count())
    };
    match if corners.iter().any(hollow) { at(&hollow) } else { at(&absent) } {
        (None, _) => Err(LatticeError::NoMarker),
        (Some(turn), 0) => Ok(if turn % 2 == 0 { (rows, columns) } else { (columns, rows) }),
        (Some(_), more) => Err(LatticeError::MarkerAmbiguous { corners: more + 1 }),
    }
}

/// The largest lattice of quadrilaterals.
fn lattice(quads: &[Quad], target: &SquaresTarget) -> Result<Cells, LatticeError> {
    let centres: Vec<_> = quads.iter().map(Quad::centre).collect();
    let links = closed(&neighbours(quads, &centres, target.pitch_in_sides()));
    let largest = components(&links).into_iter().next();
    let mut cells = largest.ok_or(LatticeError::NoLattice { what: SINGLE, single: quads.len() })?;
    grow(&mut cells, quads, &centres);
    Ok(cells)
}

/// For each quadrilateral and side (0 upper, 1 right, 2 lower, 3 left) the one that is nearest to where a
/// neighbour is expected.
fn neighbours(quads: &[Quad], centres: &[Vector2<f64>], pitch_in_sides: f64) -> Vec<[Option<usize>; 4]> {
    let expected: Vec<[Vector2<f64>; 4]> = quads
        .iter()
        .zip(centres)
        .map(|(quad, centre)| {
            std::array::from_fn(|k| {
                let middle = 0.5 * (quad.corners[k] + quad.corners[(k + 1) % 4]);
                (middle - centre) * (2.0 * pitch_in_sides)
            })
        })
        .collect();
    let areas: Vec<f64> = quads.iter().map(Quad::area).collect();
    let nearest = |i: usize, k: usize| {
        let step = expected[i][k];
        let reach = (NEIGHBOUR_TOLERANCE * step.norm()).powi(2);
        let place = centres[i] + step;
        (0..quads.len())
            .filter(|&j| j != i && areas[j] < AREA_RATIO * areas[i] && areas[i] < AREA_RATIO * areas[j])
            .map(|j| (j, (centres[j] - place).norm_squared()))
            .filter(|&(_, miss)| miss < reach)
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(j, _)| j)
    };
    (0..quads.len()).map(|i| std::array::from_fn(|k| nearest(i, k))).collect()
}

/// Takes in quadrilaterals that lie where the lattice, continued, expects one.
fn grow(cells: &mut Cells, quads: &[Quad], centres: &[Vector2<f64>]) {
    loop {
        let taken: BTreeSet<usize> = cells.values().map(|&(quad, _)| quad).collect();
        let mut empty = BTreeSet::new();
        for &(x, y) in cells.keys() {
            for place in [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)] {
                if !cells.contains_key(&place) {
                    empty.insert(place);
                }
            }
        }
        let mut added = false;
        for (x, y) in empty {
            let at = |x: i32, y: i32| cells.get(&(x, y)).copied();
            let mut places = Vec::new();
            for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
                if let (Some(near), Some(far)) = (at(x + dx, y + dy), at(x + 2 * dx, y + 2 * dy)) {
                    let step = centres[near.0] - centres[far.0];
                    places.push((centres[near.0] + step, step.norm(), near));
                }
            }
            let Some(&(_, pitch, (near, turn))) = places.first() else {
                continue;
            };
            let place = places.iter().map(|p| p.0).sum::<Vector2<f64>>() / places.len() as f64;
            let found = (0..quads.len())
                .filter(|quad| !taken.contains(quad))
                .filter(|&quad| {
                    let ratio = quads[quad].area() / quads[near].area();
                    ratio < AREA_RATIO && ratio * AREA_RATIO > 1.0
                })
                .map(|quad| (quad, (centres[quad] - place).norm()))
                .filter(|&(_, miss)| miss < NEIGHBOUR_TOLERANCE * pitch)
                .min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((quad, _)) = found {
                if cells.values().any(|&(other, _)| other == quad) {
                    continue;
                }
                // Same way round as the neighbour: its upper left corner points the same way.
                let wanted = quads[near].corners[turn] - centres[near];
                let alike = |k: usize| (quads[quad].corners[k] - centres[quad]).dot(&wanted);
                let turn = (0..4).max_by(|&a, &b| alike(a).total_cmp(&alike(b))).unwrap_or(0);
                cells.insert((x, y), (quad, turn));
                added = true;
            }
        }
        if !added {
            return;
        }
    }
}

/// One way of laying the target over the lattice.
struct Placement {
    /// Quarter turns.
    turn: usize,
    /// The target's upper left cell in turned coordinates.
    left: i32,
    top: i32,
}

/// Finds where and which way round the target lies on the lattice.
fn place(
    cells: &Cells,
    quads: &[Quad],
    centres: &[Vector2<f64>],
    target: &SquaresTarget,
) -> Result<Labels, LatticeError> {
    let (rows, columns) = (target.rows() as i32, target.columns() as i32);
    let mut placements = Vec::new();
    for turn in 0..4 {
        let at = cells.keys().map(|&cell| turned(cell, turn));
        let (left, width) = extent(at.clone().map(|c| c.0));
        let (top, height) = extent(at.map(|c| c.1));
        for dy in 0..=height - rows {
            for dx in 0..=width - columns {
                placements.push(Placement { turn, left: left + dx, top: top + dy });
            }
        }
    }
    let (_, found_columns) = extent(cells.keys().map(|c| c.0));
    let (_, found_rows) = extent(cells.keys().map(|c| c.1));
    let (found_rows, found_columns) = (found_rows as usize, found_columns as usize);
    if placements.is_empty() {
        // Say it the way round that the target is declared.
        let upright = (found_rows > found_columns) == (rows > columns) || found_rows == found_columns;
        let (found_rows, found_columns) =
            if upright { (found_rows, found_columns) } else { (found_columns, found_rows) };
        return Err(LatticeError::TooFew {
            what: SQUARES,
            found_rows,
            found_columns,
            rows: target.rows(),
            columns: target.columns(),
        });
    }
    let in_target = |p: &Placement, cell: (i32, i32)| {
        let (x, y) = turned(cell, p.turn);
        let (column, row) = (x - p.left, y - p.top);
        (column >= 0 && row >= 0 && column < columns && row < rows).then_some((row as usize, column as usize))
    };
    let covered = |p: &Placement| -> BTreeSet<(i32, i32)> {
        cells.keys().copied().filter(|&cell| in_target(p, cell).is_some()).collect()
    };
    let most = placements.iter().map(|p| covered(p).len()).max().unwrap_or(0);
    placements.retain(|p| covered(p).len() == most);
    // Nearly one more line of squares is no stray clutter: it is another target.
    if cells.len() - most + 1 >= target.rows().min(target.columns()) {
        return Err(LatticeError::TooMany {
            what: SQUARES,
            found_rows,
            found_columns,
            rows: target.rows(),
            columns: target.columns(),
        });
    }
    let window = covered(&placements[0]);
    if placements.iter().any(|p| covered(p) != window) {
        return Err(LatticeError::Ambiguous { what: SQUARES });
    }
    let cell_at = |p: &Placement, row: usize, column: usize| {
        cells
            .iter()
            .find(|&(&cell, _)| in_target(p, cell) == Some((row, column)))
            .map(|(_, &(quad, turn))| (quad, turn))
    };
    let state = |p: &Placement, row: usize, column: usize| match cell_at(p, row, column) {
        None => MarkerSeen::Absent,
        Some((quad, _)) if quads[quad].hollow => MarkerSeen::Hollow,
        Some(_) => MarkerSeen::None,
    };
    let corners = |p: &Placement| {
        let (bottom, right) = (target.rows() - 1, target.columns() - 1);
        [(0, 0), (0, right), (bottom, right), (bottom, 0)].map(|(r, c)| state(p, r, c))
    };
    let seen = corners(&placements[0]);
    let count = |kind: MarkerSeen| seen.iter().filter(|&&corner| corner == kind).count();
    let marker = match target.marker() {
        Marker::None if count(MarkerSeen::Hollow) > 0 => return Err(LatticeError::UnexpectedMarker),
        Marker::None => MarkerSeen::None,
        Marker::UpperLeft => {
            let kind = if count(MarkerSeen::Hollow) > 0 { MarkerSeen::Hollow } else { MarkerSeen::Absent };
            match count(kind) {
                0 => return Err(LatticeError::NoMarker),
                1 => kind,
                corners => return Err(LatticeError::MarkerAmbiguous { corners }),
            }
        }
    };
    let upper_left_corner = |p: &Placement| {
        cells
            .iter()
            .filter_map(|(&cell, &(quad, _))| {
                in_target(p, cell).map(|(row, column)| (row + column, centres[quad].norm()))
            })
            .min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))
            .map_or(f64::INFINITY, |(_, distance)| distance)
    };
    let chosen = match target.marker() {
        Marker::UpperLeft => {
            placements.iter().find(|p| corners(p)[0] == marker).ok_or(LatticeError::Mirrored)?
        }
        Marker::None => placements
            .iter()
            .min_by(|a, b| upper_left_corner(a).total_cmp(&upper_left_corner(b)))
            .ok_or(LatticeError::Ambiguous { what: SQUARES })?,
    };
    let mut squares = Vec::with_capacity(most);
    for (&cell, &(quad, turn)) in cells {
        if let Some((row, column)) = in_target(chosen, cell)
            && target.is_used(row, column)
            && !quads[quad].hollow
        {
            let first_corner = (turn + chosen.turn) % 4;
            squares.push(Labelled { row, column, quad, first_corner });
        }
    }
    squares.sort_by_key(|s| (s.row, s.column));
    let expected = target.used_squares();
    let enough = |count: usize, of: usize| count as f64 >= BORDER_SHARE * of as f64;
    let in_row = |row| enough(squares.iter().filter(|s| s.row == row).count(), target.columns());
    let in_column = |column| enough(squares.iter().filter(|s| s.column == column).count(), target.rows());
    let bounded = in_row(0) && in_row(target.rows() - 1) && in_column(0) && in_column(target.columns() - 1);
    if !bounded || (squares.len() as f64) < REQUIRED_SHARE * expected as f64 {
        return Err(LatticeError::Incomplete { what: SQUARES, found: squares.len(), expected });
    }
    Ok(Labels { squares, marker })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Squares of side 10 and pitch 20 at (column, row) cells, seen through a mild perspective; each
    /// starts at a corner of its own.
    fn quads(cells: &[(i32, i32)], hollow: Option<(i32, i32)>, mirrored: bool) -> Vec<Quad> {
        let see = |x: f64, y: f64| {
            let x = if mirrored { -x } else { x };
            let w = 1.0 + 0.001 * x + 0.0006 * y;
            Vector2::new((0.9 * x - 0.2 * y) / w + 300.0, (0.25 * x + 0.95 * y) / w + 200.0)
        };
        cells
            .iter()
            .enumerate()
            .map(|(i, &(c, r))| {
                let (x, y) = (20.0 * f64::from(c), 20.0 * f64::from(r));
                let mut corners = [see(x, y), see(x + 10.0, y), see(x + 10.0, y + 10.0), see(x, y + 10.0)];
                if mirrored {
                    corners.reverse();
                }
                corners.rotate_left(i * 7 % 4);
                Quad { corners, outline: vec![], hollow: hollow == Some((c, r)) }
            })
            .collect()
    }

    fn all(columns: i32, rows: i32) -> Vec<(i32, i32)> {
        (0..rows).flat_map(|r| (0..columns).map(move |c| (c, r))).collect()
    }

    fn target(rows: usize, columns: usize, marker: Marker) -> SquaresTarget {
        SquaresTarget::new(rows, columns, 0.01, 0.01, marker).unwrap()
    }

    /// Every labelled square is the one it was drawn as, corner by corner.
    fn assert_labels(labels: &Labels, quads: &[Quad], cells: &[(i32, i32)], turn: usize) {
        for s in &labels.squares {
            let (c, r) = turned(cells[s.quad], turn);
            let (c0, r0) = cells
                .iter()
                .map(|&cell| turned(cell, turn))
                .fold((i32::MAX, i32::MAX), |m, p| (m.0.min(p.0), m.1.min(p.1)));
            assert_eq!((s.row as i32, s.column as i32), (r - r0, c - c0));
            assert_eq!((s.first_corner + s.quad * 7 - turn % 4 + 4) % 4, 0);
        }
        assert!(!quads.is_empty());
    }

    #[test]
    fn the_hollow_square_turns_the_target_upright_from_any_corner() {
        for (turn, corner) in [(0, (0, 0)), (1, (6, 0)), (2, (6, 6)), (3, (0, 6))] {
            let cells = all(7, 7);
            let quads = quads(&cells, Some(corner), false);
            let labels = label(&quads, &SquaresTarget::paper()).unwrap();
            assert_eq!(labels.marker, MarkerSeen::Hollow);
            assert_eq!(labels.squares.len(), 48);
            assert_labels(&labels, &quads, &cells, turn);
        }
    }

    #[test]
    fn an_absent_corner_square_is_a_marker_too() {
        let cells: Vec<_> = all(7, 7).into_iter().filter(|&c| c != (6, 6)).collect();
        let labels = label(&quads(&cells, None, false), &SquaresTarget::paper()).unwrap();
        assert_eq!((labels.marker, labels.squares.len()), (MarkerSeen::Absent, 48));
    }

    #[test]
    fn without_a_marker_the_upper_left_is_the_corner_nearest_the_images() {
        let cells = all(3, 4);
        let quads = quads(&cells, None, false);
        let labels = label(&quads, &target(4, 3, Marker::None)).unwrap();
        assert_eq!(labels.squares.len(), 12);
        assert_labels(&labels, &quads, &cells, 0);
    }

    #[test]
    fn contradictions_are_said() {
        let see = |cells: &[(i32, i32)], hollow, mirrored, target: &SquaresTarget| {
            label(&quads(cells, hollow, mirrored), target).unwrap_err().to_string()
        };
        let plain = target(7, 7, Marker::None);
        let paper = SquaresTarget::paper();
        assert_eq!(see(&all(6, 6), None, false, &plain), "found 6 × 6 squares of the target's 7 × 7");
        assert!(see(&all(8, 7), None, false, &plain).contains("more than the target's 7 × 7"));
        assert!(see(&all(8, 7)[..55], None, false, &plain).contains("more than the target's 7 × 7"));
        assert!(see(&all(7, 7), None, false, &paper).contains("no hollow square"));
        assert!(see(&all(7, 7), Some((0, 0)), false, &plain).contains("none was declared"));
        let wide = target(4, 6, Marker::UpperLeft);
        assert!(see(&all(6, 4), Some((0, 0)), true, &wide).contains("mirrored"));
        assert!(label(&quads(&all(6, 4), Some((0, 0)), false), &wide).is_ok());
        assert!(see(&all(2, 1), None, false, &plain).contains("no lattice"));
        let gone: Vec<_> =
            all(7, 7).into_iter().filter(|&(c, r)| (c, r) != (0, 0) && (c, r) != (6, 6)).collect();
        assert!(see(&gone, None, false, &paper).contains("2 corners"));
        let sparse: Vec<_> = all(7, 7).into_iter().filter(|&(c, r)| c < 2 || r < 2).collect();
        assert!(
            see(&sparse, None, false, &plain).contains("visible"),
            "{}",
            see(&sparse, None, false, &plain)
        );
    }

    #[test]
    fn stray_squares_beside_the_target_are_left_out() {
        let mut cells = all(7, 7);
        cells.extend([(7, 3), (3, 8)]);
        let labels = label(&quads(&cells, Some((0, 0)), false), &SquaresTarget::paper()).unwrap();
        assert_eq!(labels.squares.len(), 48);
        assert!(labels.squares.iter().all(|s| s.quad < 49));
    }
}
