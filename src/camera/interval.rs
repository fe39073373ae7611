//! Numbers known to lie between two bounds, rounded outwards: what a proof computes with.

use std::ops::{Add, Mul, Neg, Sub};

/// All numbers from `low` to `high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interval {
    pub low: f64,
    pub high: f64,
}

impl Interval {
    pub const fn new(low: f64, high: f64) -> Self {
        Self { low, high }
    }

    pub const fn exactly(value: f64) -> Self {
        Self { low: value, high: value }
    }

    /// Squares of its numbers: tighter than the product with itself.
    pub fn square(self) -> Self {
        let (a, b) = (self.low.abs(), self.high.abs());
        let least = if self.low <= 0.0 && self.high >= 0.0 { 0.0 } else { a.min(b) };
        let most = a.max(b);
        Self { low: (least * least).next_down().max(0.0), high: (most * most).next_up() }
    }

    /// 1 / its numbers; `None` when 0 is one of them.
    pub fn reciprocal(self) -> Option<Self> {
        (self.low > 0.0 || self.high < 0.0)
            .then(|| Self { low: (1.0 / self.high).next_down(), high: (1.0 / self.low).next_up() })
    }

    /// Polynomial with these coefficients, from the constant term up.
    pub fn polynomial(self, coefficients: &[f64]) -> Self {
        coefficients.iter().rev().fold(Self::exactly(0.0), |sum, c| sum * self + Self::exactly(*c))
    }

    /// Its two halves.
    pub fn halves(self) -> [Self; 2] {
        let middle = 0.5 * (self.low + self.high);
        [Self::new(self.low, middle), Self::new(middle, self.high)]
    }
}

impl Add for Interval {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { low: (self.low + other.low).next_down(), high: (self.high + other.high).next_up() }
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        Self { low: -self.high, high: -self.low }
    }
}

impl Sub for Interval {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Interval {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let ends =
            [self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high];
        let low = ends.into_iter().fold(f64::INFINITY, f64::min);
        let high = ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
        Self { low: low.next_down(), high: high.next_up() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn results_hold_what_their_numbers_give(
            a in -3.0..3.0f64, b in -3.0..3.0f64, wide in 0.0..0.5f64, s in 0.0..1.0f64, t in 0.0..1.0f64,
        ) {
            let (x, y) = (Interval::new(a, a + wide), Interval::new(b, b + wide));
            let (u, v) = (a + s * wide, b + t * wide);
            let holds = |i: Interval, value: f64| i.low <= value && value <= i.high;
            prop_assert!(holds(x + y, u + v) && holds(x - y, u - v) && holds(x * y, u * v));
            prop_assert!(holds(x.square(), u * u) && holds(-x, -u));
            prop_assert!(holds(x.polynomial(&[1.0, -2.0, 0.5]), 1.0 - 2.0 * u + 0.5 * u * u));
            if let Some(r) = x.reciprocal() {
                prop_assert!(holds(r, 1.0 / u));
            }
        }
    }
}
