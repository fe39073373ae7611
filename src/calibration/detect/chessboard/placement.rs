//! Where and which way round a board lies on a lattice of crossings.

use super::super::crossings::Crossing;
use super::super::lattice::{Block, Cells, LatticeError, turned};
use super::{CORNERS, REQUIRED_SHARE};
use crate::calibration::target::ChessboardTarget;
use std::collections::BTreeMap;

/// Crossings by row and column of the board.
pub(super) type Labels = BTreeMap<(usize, usize), usize>;

/// Share of a border line that must be there when all border lines together make up the declared size.
const BORDER_SHARE: f64 = 0.25;

/// Labels the crossings of a lattice, if it has the declared rows and columns.
pub(super) fn place(
    cells: &Cells,
    crossings: &[Crossing],
    target: &ChessboardTarget,
) -> Result<Labels, LatticeError> {
    let (rows, columns) = (target.rows() as i32, target.columns() as i32);
    let fits = |block: &Block| {
        (block.rows, block.columns) == (rows, columns) || (block.rows, block.columns) == (columns, rows)
    };
    let all = Block::around(cells);
    let trimmed = all.trimmed(cells).unwrap_or(all);
    let bounded = all.borders(cells).into_iter().all(|share| share >= BORDER_SHARE);
    let block = if fits(&all) && bounded { all } else { trimmed };
    if !fits(&block) {
        return Err(other_size(block, target));
    }
    let mut best: Option<((bool, f64), Labels)> = None;
    for turn in 0..4 {
        let upright = if turn % 2 == 0 { block.rows == rows } else { block.columns == rows };
        if !upright {
            continue;
        }
        let labels = labelled(cells, block, turn);
        let first = labels.iter().min_by_key(|&(&(row, column), _)| (row + column, row));
        let from_upper_left = first.map_or(f64::INFINITY, |(_, &index)| crossings[index].saddle.norm());
        let rank = (!is_black_first(cells, block, turn), from_upper_left);
        let is_better = |(so_far, _): &((bool, f64), Labels)| {
            rank.0.cmp(&so_far.0).then(rank.1.total_cmp(&so_far.1)).is_lt()
        };
        if best.as_ref().is_none_or(is_better) {
            best = Some((rank, labels));
        }
    }
    let expected = target.rows() * target.columns();
    match best {
        Some((_, labels)) if labels.len() as f64 >= REQUIRED_SHARE * expected as f64 => Ok(labels),
        labels => {
            let found = labels.map_or(0, |(_, labels)| labels.len());
            Err(LatticeError::Incomplete { what: CORNERS, found, expected })
        }
    }
}

/// Row and column of a cell when the board's upper side is the block's side `turn`.
fn label(cell: (i32, i32), block: Block, turn: usize) -> (usize, usize) {
    let (x, y) = turned(cell, turn);
    let corners = block.corners().map(|corner| turned(corner, turn));
    let left = corners.iter().map(|c| c.0).min().unwrap_or(0);
    let top = corners.iter().map(|c| c.1).min().unwrap_or(0);
    ((y - top) as usize, (x - left) as usize)
}

fn labelled(cells: &Cells, block: Block, turn: usize) -> Labels {
    let inside = cells.iter().filter(|&(&cell, _)| block.contains(cell));
    inside.map(|(&cell, &(index, _))| (label(cell, block, turn), index)).collect()
}

/// Whether the square up and left of the first corner is then black.
fn is_black_first(cells: &Cells, block: Block, turn: usize) -> bool {
    // Arms are clockwise with dark after the even ones, and the upper left square lies after the left arm. Links
    // keep the colours of the whole lattice consistent: any crossing will do.
    cells.iter().find(|&(&cell, _)| block.contains(cell)).is_some_and(|(&cell, &(_, upper_arm))| {
        let (row, column) = label(cell, block, turn);
        (3 + turn + upper_arm) % 2 == (row + column) % 2
    })
}

fn other_size(block: Block, target: &ChessboardTarget) -> LatticeError {
    let (rows, columns) = (target.rows(), target.columns());
    let (low, high) = (block.rows.min(block.columns) as usize, block.rows.max(block.columns) as usize);
    // Said the way round that the target is declared.
    let (found_rows, found_columns) = if rows > columns { (high, low) } else { (low, high) };
    let what = CORNERS;
    if found_rows > rows && found_columns >= columns || found_rows >= rows && found_columns > columns {
        LatticeError::TooMany { what, found_rows, found_columns, rows, columns }
    } else {
        LatticeError::TooFew { what, found_rows, found_columns, rows, columns }
    }
}
