//! The run: order, run folder, manifest, events.
