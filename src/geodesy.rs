//! The ellipsoid, geodetic positions, local tangent frames and map projections.
//!
//! All heights in here are ellipsoidal. A height of another kind is converted where it is read, by the
//! datum its file declares, and never travels further. Nothing is flattened: the tangent frame is exact,
//! so grid convergence and scale come out by construction.

mod ellipsoid;
mod height;
mod projection;

pub use ellipsoid::{Ellipsoid, Geodetic, LocalTangent, WGS84};
pub use height::{GeoidModel, HeightKind};
pub use projection::{MapPoint, MapProjection, ProjectionError, grid_convergence};
