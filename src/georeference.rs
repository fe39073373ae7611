//! Frames and log to one pose and ground footprint per frame.
//!
//! ```text
//! ECEF ← NAV ← UAV ← gimbal ← camera ← image
//! C    = Pos + C_nb (ArmG − antenna + C_bg ArmC)          eq. (8), with the antenna's own lever arm
//! P    = C + s · nav_from_camera · [x, y, 1]               s > 0 where the ray meets the ground
//! ```

mod chain;
mod footprint;
mod frame;

pub use chain::Chain;
pub use footprint::{Footprint, FootprintVertex};
pub use frame::{FrameError, GeoreferencedFrame, GroundPoint, LocateError};
