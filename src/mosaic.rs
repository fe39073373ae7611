//! Georeferenced frames to one mosaic.
