//! Results to HTML, SVG and JSON text; computes nothing.
