//! Synthetic surveys with known truth.
