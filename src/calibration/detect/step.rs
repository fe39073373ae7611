//! What a blurred step from dark to light looks like: the normal distribution, for four pixels at a time. Fitting
//! edges asks for it millions of times per photo.

use std::ops::{Add, Mul, Neg, Sub};

/// Four numbers that the processor works on at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lanes(pub [f32; 4]);

impl Lanes {
    pub const ZERO: Self = Self([0.0; 4]);

    pub const fn all(value: f64) -> Self {
        Self([value as f32; 4])
    }
    /// Lane by lane.
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|k| f(self.0[k], other.0[k])))
    }
    pub fn sum(self) -> f64 {
        self.0.into_iter().map(f64::from).sum()
    }
}

impl Add for Lanes {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}
impl Sub for Lanes {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}
impl Mul for Lanes {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}
impl Neg for Lanes {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|a| -a))
    }
}

/// A step from −1 to 1 with unit blur, 2 Φ(z) − 1, and its derivative; errors below 10⁻⁶ and 10⁻⁵.
///
/// # Source
/// Abramowitz and Stegun, 7.1.28.
#[inline]
pub(super) fn step(z: Lanes) -> (Lanes, Lanes) {
    const A: [f64; 6] = [
        0.070_523_078_4,
        0.042_282_012_3,
        0.009_270_527_2,
        0.000_152_014_3,
        0.000_276_567_2,
        0.000_043_063_8,
    ];
    let x = Lanes(z.0.map(|v| v.abs() * std::f32::consts::FRAC_1_SQRT_2));
    let (mut value, mut slope) = (Lanes::all(A[5]), Lanes::ZERO);
    for a in [A[4], A[3], A[2], A[1], A[0], 1.0] {
        slope = slope * x + value;
        value = value * x + Lanes::all(a);
    }
    let square = value * value;
    let eighth = (square * square) * (square * square);
    // erf x = 1 − value⁻¹⁶
    let rest = Lanes((eighth * eighth).0.map(|v| 1.0 / v));
    let erf = (Lanes::all(1.0) - rest).zip(z, f32::copysign);
    let derivative =
        Lanes::all(16.0 * std::f64::consts::FRAC_1_SQRT_2) * rest * slope.zip(value, |s, v| s / v);
    (erf, derivative)
}

/// Normal distribution function.
#[inline]
pub(super) fn normal(z: f64) -> f64 {
    0.5 + 0.5 * f64::from(step(Lanes::all(z)).0.0[0])
}

/// Lower triangle of the sum of products of `N` numbers, each for four pixels.
pub(super) struct Products<const N: usize>([[Lanes; N]; N]);

impl<const N: usize> Products<N> {
    pub const fn new() -> Self {
        Self([[Lanes::ZERO; N]; N])
    }
    #[inline(always)]
    pub fn add(&mut self, row: &[Lanes; N]) {
        for i in 0..N {
            for j in 0..=i {
                self.0[i][j] = self.0[i][j] + row[i] * row[j];
            }
        }
    }
    /// Sum of products of two of the numbers.
    pub fn sum(&self, i: usize, j: usize) -> f64 {
        self.0[i.max(j)][i.min(j)].sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_matches_tables() {
        for (z, p) in [
            (0.0, 0.5),
            (1.0, 0.841_344_746),
            (-1.96, 0.024_997_895),
            (3.0, 0.998_650_102),
            (-4.01, 0.000_030_359),
        ] {
            assert!((normal(z) - p).abs() < 1e-6, "Φ({z}) = {}", normal(z));
            let density = 2.0 * (-0.5_f64 * z * z).exp() / std::f64::consts::TAU.sqrt();
            let slope = f64::from(step(Lanes::all(z)).1.0[2]);
            assert!((slope - density).abs() < 1e-5, "slope at {z} = {slope}");
        }
        assert_eq!((normal(1e4), normal(-1e4)), (1.0, 0.0));
        assert!(normal(f64::NAN).is_nan());
    }

    #[test]
    fn products_are_summed_over_all_lanes() {
        let mut products = Products::<2>::new();
        products.add(&[Lanes([1.0, 2.0, 3.0, 4.0]), Lanes::all(2.0)]);
        products.add(&[Lanes::ZERO, Lanes::all(1.0)]);
        assert_eq!([products.sum(0, 0), products.sum(0, 1), products.sum(1, 1)], [30.0, 20.0, 20.0]);
    }
}
