//! The ellipsoid, geodetic positions, local tangent frames and heights.
