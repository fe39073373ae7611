//! Why numbered or staggered grids are not the target, besides what can be wrong with any lattice.

use super::LatticeError;

/// A lattice of another size than declared.
pub(super) fn other_size(
    what: &'static str,
    (found_rows, found_columns): (usize, usize),
    (rows, columns): (usize, usize),
) -> LatticeError {
    if found_rows > rows || found_columns > columns {
        LatticeError::TooMany { what, found_rows, found_columns, rows, columns }
    } else {
        LatticeError::TooFew { what, found_rows, found_columns, rows, columns }
    }
}

/// Why what was found is not the target. `what` is what the target is counted in.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    /// A grid, but not in this layout.
    #[error("found {found} {what} in rows and columns, but not in the declared layout")]
    Layout {
        /// For example `circles`.
        what: &'static str,
        /// How many.
        found: usize,
    },
    /// Only one row of numbered things, so that their columns cannot be told.
    #[error("the {what} found do not show two rows")]
    OneRow {
        /// For example `tags`.
        what: &'static str,
    },
    /// Numbers in the wrong direction.
    #[error("the tags are numbered from the {from} left, unlike declared")]
    Order {
        /// `upper` or `lower`.
        from: &'static str,
    },
    /// Markers can be read in a mirror only.
    #[error("{found} {what} can be read in a mirror only: the photo is mirrored")]
    Mirrored {
        /// For example `tags`.
        what: &'static str,
        /// How many.
        found: usize,
    },
}
