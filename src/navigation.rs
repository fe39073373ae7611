//! The navigation log: records, interpolation and mounting.
