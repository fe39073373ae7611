//! The ground: planes and elevation models, met by viewing rays.
