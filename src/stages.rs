//! Thin stage adapters: load, call, save.
