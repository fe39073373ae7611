//! Scalar units: newtypes whose constructors name the unit.
//!
//! A scalar that crosses a function boundary and could be misread is one of these; inside a kernel
//! everything is SI `f64`. Conversion to and from degrees happens here and in `config`, nowhere else.

use std::fmt;
use std::ops::{Add, Neg, Sub};

macro_rules! scalar {
    ($(#[$doc:meta])* $name:ident, $unit:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
        pub struct $name(f64);

        impl $name {
            /// The value in this type's SI unit.
            #[must_use]
            pub const fn get(self) -> f64 {
                self.0
            }
            /// True when the value is neither NaN nor infinite.
            #[must_use]
            pub fn is_finite(self) -> bool {
                self.0.is_finite()
            }
        }
        impl Add for $name {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }
        impl Sub for $name {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }
        impl Neg for $name {
            type Output = Self;
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(&self.0, f)?;
                f.write_str(concat!(" ", $unit))
            }
        }
    };
}

scalar!(
    /// An angle, kept in radians.
    Radians,
    "rad"
);
scalar!(
    /// A length, kept in metres.
    Metres,
    "m"
);
scalar!(
    /// A duration, kept in seconds.
    Seconds,
    "s"
);

impl Radians {
    /// An angle from radians.
    #[must_use]
    pub const fn new(radians: f64) -> Self {
        Self(radians)
    }
    /// An angle from degrees.
    #[must_use]
    pub const fn from_degrees(degrees: f64) -> Self {
        Self(degrees * (std::f64::consts::PI / 180.0))
    }
    /// The angle in degrees.
    #[must_use]
    pub const fn degrees(self) -> f64 {
        self.0 * (180.0 / std::f64::consts::PI)
    }
    /// The same direction in `(-π, π]`.
    #[must_use]
    pub fn wrapped(self) -> Self {
        let turn = std::f64::consts::TAU;
        let r = self.0.rem_euclid(turn);
        Self(if r > turn / 2.0 { r - turn } else { r })
    }
}

impl Metres {
    /// A length from metres.
    #[must_use]
    pub const fn new(metres: f64) -> Self {
        Self(metres)
    }
}

impl Seconds {
    /// A duration from seconds.
    #[must_use]
    pub const fn new(seconds: f64) -> Self {
        Self(seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_direction_and_prefers_plus_pi() {
        assert!((Radians::from_degrees(190.0).wrapped().degrees() + 170.0).abs() < 1e-12);
        assert!((Radians::from_degrees(-180.0).wrapped().degrees() - 180.0).abs() < 1e-12);
        assert!((Radians::from_degrees(725.0).wrapped().degrees() - 5.0).abs() < 1e-12);
    }
}
