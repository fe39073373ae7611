//! Points, displacements, rotations and rigid poses tagged with their frames.

use super::frames::Frame;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use std::marker::PhantomData;
use std::ops::{Add, Mul, Sub};

macro_rules! triple {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name<F> {
            vector: Vector3<f64>,
            frame: PhantomData<F>,
        }
        impl<F: Frame> $name<F> {
            /// From components along the frame's x, y and z, in metres.
            #[must_use]
            pub const fn new(x: f64, y: f64, z: f64) -> Self {
                Self { vector: Vector3::new(x, y, z), frame: PhantomData }
            }
            /// Labels a bare vector as belonging to this frame, in metres.
            #[must_use]
            pub const fn from_vector(vector: Vector3<f64>) -> Self {
                Self { vector, frame: PhantomData }
            }
            /// The bare vector in metres.
            #[must_use]
            pub const fn vector(&self) -> Vector3<f64> {
                self.vector
            }
            /// Component along the frame's x axis.
            #[must_use]
            pub fn x(&self) -> f64 {
                self.vector.x
            }
            /// Component along the frame's y axis.
            #[must_use]
            pub fn y(&self) -> f64 {
                self.vector.y
            }
            /// Component along the frame's z axis.
            #[must_use]
            pub fn z(&self) -> f64 {
                self.vector.z
            }
            /// True when all components are finite.
            #[must_use]
            pub fn is_finite(&self) -> bool {
                self.vector.iter().all(|c| c.is_finite())
            }
        }
    };
}

triple!(
    /// A position in frame `F`, metres.
    Point
);
triple!(
    /// A displacement or direction in frame `F`, metres; it rotates but does not translate.
    Displacement
);

impl<F: Frame> Point<F> {
    /// The frame's origin.
    #[must_use]
    pub const fn origin() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }
    /// Distance to another point of the same frame, metres.
    #[must_use]
    pub fn distance_to(&self, other: &Self) -> f64 {
        (self.vector - other.vector).norm()
    }
}

impl<F: Frame> Displacement<F> {
    /// No displacement.
    #[must_use]
    pub const fn zero() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }
}

impl<F: Frame> Add<Displacement<F>> for Point<F> {
    type Output = Self;
    fn add(self, d: Displacement<F>) -> Self {
        Self::from_vector(self.vector + d.vector)
    }
}
impl<F: Frame> Sub for Point<F> {
    type Output = Displacement<F>;
    fn sub(self, other: Self) -> Displacement<F> {
        Displacement::from_vector(self.vector - other.vector)
    }
}
impl<F: Frame> Add for Displacement<F> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::from_vector(self.vector + other.vector)
    }
}
impl<F: Frame> Mul<f64> for Displacement<F> {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        Self::from_vector(self.vector * k)
    }
}

/// Rotation that turns components in `From` into components in `To` (a direction cosine matrix).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation<To, From> {
    matrix: Rotation3<f64>,
    frames: PhantomData<(To, From)>,
}

impl<To: Frame, From: Frame> Rotation<To, From> {
    /// Labels a bare rotation.
    #[must_use]
    pub const fn from_rotation(matrix: Rotation3<f64>) -> Self {
        Self { matrix, frames: PhantomData }
    }
    /// Labels a matrix that is already orthonormal with determinant +1 (not checked).
    #[must_use]
    pub fn from_matrix_unchecked(matrix: Matrix3<f64>) -> Self {
        Self::from_rotation(Rotation3::from_matrix_unchecked(matrix))
    }
    /// The axes coincide.
    #[must_use]
    pub fn identity() -> Self {
        Self::from_rotation(Rotation3::identity())
    }
    /// The bare 3×3 matrix; its columns are the axes of `From` in `To`.
    #[must_use]
    pub fn matrix(&self) -> Matrix3<f64> {
        *self.matrix.matrix()
    }
    /// The same rotation as a unit quaternion.
    #[must_use]
    pub fn quaternion(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_rotation_matrix(&self.matrix)
    }
    /// `from_to`: swaps the frames.
    #[must_use]
    pub fn inverse(&self) -> Rotation<From, To> {
        Rotation::from_rotation(self.matrix.inverse())
    }
    /// Angle between this rotation and another, radians.
    #[must_use]
    pub fn angle_to(&self, other: &Self) -> f64 {
        self.matrix.angle_to(&other.matrix)
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<Rotation<B, C>> for Rotation<A, B> {
    type Output = Rotation<A, C>;
    fn mul(self, b_from_c: Rotation<B, C>) -> Rotation<A, C> {
        Rotation::from_rotation(self.matrix * b_from_c.matrix)
    }
}
impl<A: Frame, B: Frame> Mul<Displacement<B>> for Rotation<A, B> {
    type Output = Displacement<A>;
    fn mul(self, d: Displacement<B>) -> Displacement<A> {
        Displacement::from_vector(self.matrix * d.vector)
    }
}

/// Rigid transform: where `From` stands and how it is turned, seen in `To`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose<To, From> {
    /// Axes of `From` in `To`.
    pub rotation: Rotation<To, From>,
    /// Origin of `From` in `To`, metres.
    pub origin: Point<To>,
}

impl<To: Frame, From: Frame> Pose<To, From> {
    /// From the rotation and the position of `From`'s origin in `To`.
    #[must_use]
    pub const fn new(rotation: Rotation<To, From>, origin: Point<To>) -> Self {
        Self { rotation, origin }
    }
    /// `from_to`: swaps the frames.
    #[must_use]
    pub fn inverse(&self) -> Pose<From, To> {
        let from_to = self.rotation.inverse();
        let back = from_to * Displacement::from_vector(-self.origin.vector());
        Pose::new(from_to, Point::from_vector(back.vector()))
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<Pose<B, C>> for Pose<A, B> {
    type Output = Pose<A, C>;
    fn mul(self, b_from_c: Pose<B, C>) -> Pose<A, C> {
        Pose::new(self.rotation * b_from_c.rotation, self * b_from_c.origin)
    }
}
impl<A: Frame, B: Frame> Mul<Point<B>> for Pose<A, B> {
    type Output = Point<A>;
    fn mul(self, point_in_b: Point<B>) -> Point<A> {
        self.origin + self.rotation * Displacement::from_vector(point_in_b.vector())
    }
}
impl<A: Frame, B: Frame> Mul<Displacement<B>> for Pose<A, B> {
    type Output = Displacement<A>;
    fn mul(self, d: Displacement<B>) -> Displacement<A> {
        self.rotation * d
    }
}

#[cfg(test)]
mod tests {
    use super::super::attitude::YawPitchRoll;
    use super::super::{Body, Camera, Ned};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverse_undoes_and_composition_associates(
            yaw in -180.0..180.0f64, pitch in -89.0..89.0f64, roll in -180.0..180.0f64,
            x in -1e3..1e3f64, y in -1e3..1e3f64, z in -1e3..1e3f64,
        ) {
            let ned_from_body = Pose::new(
                YawPitchRoll::from_degrees(yaw, pitch, roll).rotation::<Ned, Body>(),
                Point::new(x, y, z),
            );
            let body_from_camera = Pose::new(
                YawPitchRoll::from_degrees(roll, -pitch, yaw).rotation::<Body, Camera>(),
                Point::new(z, x, y),
            );
            let p = Point::<Camera>::new(y, z, x);
            let together = (ned_from_body * body_from_camera) * p;
            let stepwise = ned_from_body * (body_from_camera * p);
            prop_assert!(together.distance_to(&stepwise) < 1e-9);
            let back = (ned_from_body * body_from_camera).inverse() * together;
            prop_assert!(back.distance_to(&p) < 1e-9);
        }
    }
}
