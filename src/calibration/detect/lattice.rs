//! Lattices of things that have four neighbours each: who is next to whom, rows and columns, errors.

use std::collections::{BTreeMap, VecDeque};

/// Why what was found does not make up the target. `what` names what is counted, for example `squares`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LatticeError {
    /// No four neighbours.
    #[error("no lattice of {what} found ({single} single ones)")]
    NoLattice {
        /// What is counted.
        what: &'static str,
        /// Candidates in the photo.
        single: usize,
    },
    /// A lattice smaller than the target.
    #[error("found {found_rows} × {found_columns} {what} of the target's {rows} × {columns}")]
    TooFew {
        /// What is counted.
        what: &'static str,
        /// Rows found.
        found_rows: usize,
        /// Columns found.
        found_columns: usize,
        /// Rows declared.
        rows: usize,
        /// Columns declared.
        columns: usize,
    },
    /// A lattice larger than the target.
    #[error("found {found_rows} × {found_columns} {what}, more than the target's {rows} × {columns}")]
    TooMany {
        /// What is counted.
        what: &'static str,
        /// Rows found.
        found_rows: usize,
        /// Columns found.
        found_columns: usize,
        /// Rows declared.
        rows: usize,
        /// Columns declared.
        columns: usize,
    },
    /// Too much of the target is hidden.
    #[error("only {found} of the target's {expected} {what} are visible")]
    Incomplete {
        /// What is counted.
        what: &'static str,
        /// Found.
        found: usize,
        /// The target has.
        expected: usize,
    },
    /// More than one target.
    #[error("{targets} targets are in the photo, the points of one are wanted")]
    Several {
        /// How many.
        targets: usize,
    },
    /// The target fits at more than one place.
    #[error("the target fits the {what} found at more than one place")]
    Ambiguous {
        /// What is counted.
        what: &'static str,
    },
    /// All four corners are solid squares.
    #[error("no hollow square at a corner of the target")]
    NoMarker,
    /// More than one corner could be the marker.
    #[error("{corners} corners of the target are hollow or hidden, so its upper left is uncertain")]
    MarkerAmbiguous {
        /// How many.
        corners: usize,
    },
    /// A hollow square although none was declared.
    #[error("the target has a hollow square at a corner although none was declared")]
    UnexpectedMarker,
    /// The hollow square is at a corner where turning the target cannot bring it.
    #[error(
        "the hollow square is not at the target's upper left corner: the photo is mirrored or rows and columns are swapped"
    )]
    Mirrored,
}

/// What stood at the marker's place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkerSeen {
    /// The target has no marker.
    None,
    /// A light square in a dark outline.
    Hollow,
    /// Nothing.
    Absent,
}

/// Lattice coordinates, x to the right and y down, of what stands there: its index, and which of its four
/// sides or corners is the upper or upper left one in the lattice's orientation.
pub(super) type Cells = BTreeMap<(i32, i32), (usize, usize)>;

/// For each side, clockwise, the neighbour there and the neighbour's side that faces back. Links are mutual.
pub(super) type Links = [Option<(usize, usize)>; 4];

/// Keeps the links that both ends agree on and that are a side of a closed square of four links: a link over
/// something hidden or into clutter is not. `one_way` gives the neighbour on each side.
pub(super) fn closed(one_way: &[[Option<usize>; 4]]) -> Vec<Links> {
    let mutual = |i: usize, side: usize| {
        let j = one_way[i][side]?;
        let back = (0..4).find(|&back| one_way[j][back] == Some(i))?;
        Some((j, back))
    };
    let links: Vec<Links> = (0..one_way.len()).map(|i| std::array::from_fn(|k| mutual(i, k))).collect();
    // The square on the right of a link (`turn` 1) or on its left (3): out from both its ends, and back.
    let is_side = |i: usize, side: usize, turn: usize| {
        let (j, back) = links[i][side]?;
        let (k, back_from_k) = links[i][(side + turn) % 4]?;
        let (opposite, _) = links[j][(back + 4 - turn) % 4]?;
        let (end, _) = links[k][(back_from_k + turn) % 4]?;
        (end == opposite).then_some((j, back))
    };
    let kept = |i: usize, side: usize| is_side(i, side, 1).or_else(|| is_side(i, side, 3));
    (0..links.len()).map(|i| std::array::from_fn(|k| kept(i, k))).collect()
}

/// Walks from neighbour to neighbour: the connected lattices of four or more, the largest first.
pub(super) fn components(links: &[Links]) -> Vec<Cells> {
    const STEPS: [(i32, i32); 4] = [(0, -1), (1, 0), (0, 1), (-1, 0)];
    let mut seen = vec![false; links.len()];
    let mut found = Vec::new();
    for start in 0..links.len() {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let mut cells = Cells::from([((0, 0), (start, 0))]);
        let mut queue = VecDeque::from([((0, 0), start, 0)]);
        while let Some(((x, y), quad, turn)) = queue.pop_front() {
            for (side, (dx, dy)) in STEPS.into_iter().enumerate() {
                let Some((next, back)) = links[quad][(side + turn) % 4] else {
                    continue;
                };
                let cell = (x + dx, y + dy);
                // A place already taken, or a member already placed, contradicts this link: keep the
                // shorter chain of links, which is the one that came first.
                if seen[next] || cells.contains_key(&cell) {
                    continue;
                }
                seen[next] = true;
                let next_turn = (back + 4 - (side + 2) % 4) % 4;
                cells.insert(cell, (next, next_turn));
                queue.push_back((cell, next, next_turn));
            }
        }
        if cells.len() >= 4 {
            found.push(cells);
        }
    }
    // The sort is stable: of equal ones the first in reading order stays first.
    found.sort_by_key(|cells| std::cmp::Reverse(cells.len()));
    found
}

/// Lattice cell as the target's (column, row) when the target's upper side is the lattice's side `turn`.
pub(super) const fn turned((x, y): (i32, i32), turn: usize) -> (i32, i32) {
    match turn {
        0 => (x, y),
        1 => (y, -x),
        2 => (-x, -y),
        _ => (-y, x),
    }
}

pub(super) fn extent(values: impl Iterator<Item = i32> + Clone) -> (i32, i32) {
    let low = values.clone().min().unwrap_or(0);
    (low, values.max().unwrap_or(-1) - low + 1)
}

/// A block of rows and columns of a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Block {
    pub left: i32,
    pub top: i32,
    pub columns: i32,
    pub rows: i32,
}

impl Block {
    /// Around all cells.
    pub fn around(cells: &Cells) -> Self {
        let (left, columns) = extent(cells.keys().map(|c| c.0));
        let (top, rows) = extent(cells.keys().map(|c| c.1));
        Self { left, top, columns, rows }
    }
    pub const fn contains(&self, (x, y): (i32, i32)) -> bool {
        x >= self.left && y >= self.top && x < self.left + self.columns && y < self.top + self.rows
    }
    /// Corners clockwise from the upper left: the index is the number of quarter turns that bring one there.
    pub const fn corners(&self) -> [(i32, i32); 4] {
        let (right, bottom) = (self.left + self.columns - 1, self.top + self.rows - 1);
        [(self.left, self.top), (right, self.top), (right, bottom), (self.left, bottom)]
    }
    /// Shares of the left, right, upper and lower border lines that are there.
    pub fn borders(&self, cells: &Cells) -> [f64; 4] {
        let [(left, top), (right, _), (_, bottom), _] = self.corners();
        let count = |on_line: &dyn Fn((i32, i32)) -> bool| {
            cells.keys().filter(|&&cell| self.contains(cell) && on_line(cell)).count() as f64
        };
        let (rows, columns) = (f64::from(self.rows), f64::from(self.columns));
        [
            count(&|c| c.0 == left) / rows,
            count(&|c| c.0 == right) / rows,
            count(&|c| c.1 == top) / columns,
            count(&|c| c.1 == bottom) / columns,
        ]
    }
    /// Without border lines of which less than half is there: those are clutter. `None` when nothing is left.
    pub fn trimmed(mut self, cells: &Cells) -> Option<Self> {
        while self.columns >= 2 && self.rows >= 2 {
            let borders = self.borders(cells);
            match (0..4).find(|&k| borders[k] < 0.5) {
                None => return Some(self),
                Some(0) => (self.left, self.columns) = (self.left + 1, self.columns - 1),
                Some(1) => self.columns -= 1,
                Some(2) => (self.top, self.rows) = (self.top + 1, self.rows - 1),
                Some(_) => self.rows -= 1,
            }
        }
        None
    }
}
