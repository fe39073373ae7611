//! Why what was found does not make up the target: for targets other than separated squares.

/// Why single findings do not make up the target. `unit` is what the target is counted in.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    /// Nothing in rows and columns.
    #[error("no grid of {unit} found ({found} single candidates)")]
    NoGrid {
        /// For example `circles`.
        unit: &'static str,
        /// Candidates seen.
        found: usize,
    },
    /// A grid of another size.
    #[error("found {found_rows} × {found_columns} {unit} of the declared {rows} × {columns}")]
    Size {
        /// For example `circles`.
        unit: &'static str,
        /// Rows found.
        found_rows: usize,
        /// Columns found.
        found_columns: usize,
        /// Rows declared.
        rows: usize,
        /// Columns declared.
        columns: usize,
    },
    /// A grid, but not in this layout.
    #[error("found {found} {unit} in rows and columns, but not in the declared layout")]
    Layout {
        /// For example `circles`.
        unit: &'static str,
        /// How many.
        found: usize,
    },
    /// Too many are hidden.
    #[error("only {found} of the target's {expected} {unit} are visible")]
    Incomplete {
        /// For example `circles`.
        unit: &'static str,
        /// Found.
        found: usize,
        /// On the target.
        expected: usize,
    },
    /// Only one row of numbered things, so that their columns cannot be told.
    #[error("the {unit} found do not show two rows")]
    OneRow {
        /// For example `tags`.
        unit: &'static str,
    },
    /// Numbers in the wrong direction.
    #[error("the tags are numbered from the {from} left, unlike declared")]
    Order {
        /// `upper` or `lower`.
        from: &'static str,
    },
    /// Markers can be read in a mirror only.
    #[error("{found} {unit} can be read in a mirror only: the photo is mirrored")]
    Mirrored {
        /// For example `tags`.
        unit: &'static str,
        /// How many.
        found: usize,
    },
    /// More than one grid that could be the target.
    #[error("more than one grid of {unit} in the photo")]
    Several {
        /// For example `circles`.
        unit: &'static str,
    },
    /// Found, but too few could be located.
    #[error("only {located} of {found} {unit} could be located: the photo is blurred or they are too small")]
    Unsharp {
        /// For example `circles`.
        unit: &'static str,
        /// Located.
        located: usize,
        /// Found.
        found: usize,
    },
}
