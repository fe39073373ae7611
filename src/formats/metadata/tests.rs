//! Golden frames of the makers, real surveys, hostile files.
