//! Files to types and back; the only user of the file system below the engine.
