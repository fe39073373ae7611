//! Frames, points, rotations and poses.
