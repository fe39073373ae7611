//! Camera calibration from photos of a planar target.
