//! Frames and log to one pose and footprint per frame.
