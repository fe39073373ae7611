//! Scalar units: newtypes whose constructors name the unit.
