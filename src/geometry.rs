//! Frames, points, rotations and poses.
//!
//! The *kind* of a frame is a type parameter, so a point of one frame cannot be used in another.
//! Transforms are named and typed `a_from_b`: `Pose<A, B>` maps points of `B` into `A`, and
//! `Pose<A, B> * Pose<B, C>` is a `Pose<A, C>`; the inner letters touch, and any other order does not
//! compile.
//!
//! ```
//! use boresight::geometry::{Body, Ned, Point, Pose, Rotation};
//! use boresight::geometry::attitude::YawPitchRoll;
//! use boresight::units::Radians;
//! let ned_from_body = YawPitchRoll::from_degrees(90.0, 0.0, 0.0).rotation::<Ned, Body>();
//! let ahead = ned_from_body * boresight::geometry::Displacement::<Body>::new(1.0, 0.0, 0.0);
//! assert!((ahead.y() - 1.0).abs() < 1e-12, "the nose points east");
//! ```
//!
//! The wrong order of frames is a compile error:
//!
//! ```compile_fail,E0308
//! use boresight::geometry::{Body, Ned, Displacement};
//! use boresight::geometry::attitude::YawPitchRoll;
//! let ned_from_body = YawPitchRoll::from_degrees(90.0, 0.0, 0.0).rotation::<Ned, Body>();
//! let ahead = ned_from_body * Displacement::<Ned>::new(1.0, 0.0, 0.0);
//! ```

pub mod attitude;
mod frames;
mod pose;

pub use frames::{Body, Camera, Ecef, Frame, Gimbal, Ned};
pub use pose::{Displacement, Point, Pose, Rotation};
