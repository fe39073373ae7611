//! How good every pixel is: covariances, ellipses, circular errors, maps, lengths, check points.
//!
//! Everything in here speaks about one [`ErrorModel`]: 1σ of every source of error, each with its own
//! column in the Jacobian of a ground point. The covariance of a pixel, the budget of eq. (11), the
//! Monte Carlo map, the interval of a recovered length and the test against check points are different
//! questions to that one model, so they cannot contradict each other.
//!
//! ```text
//! dP = v − d (n·v − δh) / (n·d)        v = dC + s·dd: what the error does to the far end of the ray
//! Σ  = J S Jᵀ                          J: 2 × parameters (north, east), S: covariance of the parameters
//! ```
//!
//! `d` is the viewing ray, `n` the normal of the ground (up, or across the slope of an elevation model) and
//! `δh` an error of the ground's height.

pub mod budget;
pub mod ce90_map;
pub mod check;
pub mod circular;
pub mod error_map;
pub mod length;
pub mod model;
pub mod monte_carlo;
pub mod propagation;

#[cfg(test)]
mod paper;
#[cfg(test)]
mod scenes;

pub use circular::{CircularError, ErrorEllipse};
pub use model::{AngleStd, ErrorModel, ModelError, Persistence, Source};
pub use propagation::{FramePropagation, PixelAccuracy, PropagationError};
