//! Error propagation, circular errors and budgets.
