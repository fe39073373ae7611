//! The ground: surfaces of constant height and elevation models, met by viewing rays.
//!
//! Heights are ellipsoidal. A ray either meets the ground, or the answer says why not; no substitute
//! point is ever returned.

mod dem;
mod ray;

pub use dem::{Dem, Filled};
pub use ray::{GroundMiss, Ray, ground_from_ray};

use crate::geodesy::Geodetic;

/// Why there is no ground height at a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoGround {
    /// Outside the elevation model.
    #[error("outside the elevation model")]
    Outside,
    /// Inside it, where it holds no data.
    #[error("the elevation model has no data there")]
    NoData,
}

/// A ground surface.
pub trait Terrain: Send + Sync {
    /// Ellipsoidal ground height in metres at each position (whose own heights are ignored), in order.
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>>;

    /// Lowest and highest ellipsoidal height anywhere, metres.
    fn height_range(&self) -> (f64, f64);

    /// Horizontal distance over which the surface may bend, metres; `None` for a surface that does not.
    fn spacing(&self) -> Option<f64>;
}

/// Ground at one ellipsoidal height everywhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantHeight {
    /// Metres above the ellipsoid.
    pub height_m: f64,
}

impl Terrain for ConstantHeight {
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
        vec![Ok(self.height_m); positions.len()]
    }
    fn height_range(&self) -> (f64, f64) {
        (self.height_m, self.height_m)
    }
    fn spacing(&self) -> Option<f64> {
        None
    }
}
