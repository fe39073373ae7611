//! The pipeline file: text to validated, typed settings.
