//! The camera: interior orientation and lens, both ways, with Jacobians.
