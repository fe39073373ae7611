//! Circular errors and ellipses of a bivariate normal error, exact for unequal sigmas.
//!
//! CEP50 is the radius that holds half of all errors, CE90 ninety percent. With unequal principal sigmas
//! no closed form exists; the usual linear formulas are off by up to 17 % and are kept here only so that
//! their error can be stated.

use crate::units::Radians;
use nalgebra::Matrix2;
use std::f64::consts::{FRAC_PI_2, PI};

/// Radius over σ that holds half of a circular normal error: √(2 ln 2).
pub const CEP50_PER_SIGMA: f64 = 1.177_410_022_515_474_7;

/// Why there is no circular error to state.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CircularError {
    /// A sigma is negative, NaN or infinite.
    #[error("a standard deviation is {value} m, it must be finite and not negative")]
    Sigma {
        /// What was given.
        value: f64,
    },
    /// Both sigmas are zero.
    #[error("both standard deviations are zero: there is no spread to describe")]
    NoSpread,
    /// The level is not a probability strictly between 0 and 1.
    #[error("level {level} is not a probability between 0 and 1")]
    Level {
        /// What was given.
        level: f64,
    },
    /// A covariance is no covariance.
    #[error(
        "[[{north_var}, {north_east_cov}], [{north_east_cov}, {east_var}]] m² is not a covariance: it must be finite, with no negative variance in any direction"
    )]
    Covariance {
        /// North variance.
        north_var: f64,
        /// East variance.
        east_var: f64,
        /// Covariance of north and east.
        north_east_cov: f64,
    },
    /// A radius is negative or NaN.
    #[error("radius {radius} m must not be negative")]
    Radius {
        /// What was given.
        radius: f64,
    },
}

/// Probability that a zero-mean bivariate normal error with these principal sigmas (any order, m) lies
/// within `radius` (m).
///
/// # Errors
/// [`CircularError::Sigma`], [`CircularError::NoSpread`], [`CircularError::Radius`].
///
/// # Source
/// Polar integration in the coordinates that make the error circular (as Craig 1991 does for the
/// one-dimensional tail): `1 − (1/2π) ∮ exp(−r² / (2 (s₁² cos²t + s₂² sin²t))) dt`.
pub fn probability_within(radius: f64, s1: f64, s2: f64) -> Result<f64, CircularError> {
    let (major, minor) = principal(s1, s2)?;
    if radius.is_nan() || radius < 0.0 {
        return Err(CircularError::Radius { radius });
    }
    Ok(inside(radius / major, minor / major).0)
}

/// Radius (m) that holds the share `level` of all errors: level 0.5 is CEP50, 0.9 CE90, 0.95 CE95.
///
/// Exact to 1e-9 relative for any ratio of the principal sigmas, 0 included.
///
/// # Errors
/// [`CircularError::Sigma`], [`CircularError::NoSpread`], [`CircularError::Level`].
pub fn radius_of(level: f64, s1: f64, s2: f64) -> Result<f64, CircularError> {
    let (major, minor) = principal(s1, s2)?;
    if !(level > 0.0 && level < 1.0) {
        return Err(CircularError::Level { level });
    }
    let ratio = minor / major;
    // The circle needs most room when both sigmas are the larger one, and is never emptier than nothing.
    let (mut low, mut high) = (0.0, (-2.0 * (-level).ln_1p()).sqrt());
    // Half of the spread of the circular case and of the one-dimensional one is a start within 20 %.
    let mut radius = high * (0.5 + 0.5 * ratio).sqrt();
    for _ in 0..200 {
        let (within, density) = inside(radius, ratio);
        let excess = within - level;
        if excess > 0.0 {
            high = radius;
        } else {
            low = radius;
        }
        let newton = radius - excess / density;
        let next = if density > 0.0 && newton > low && newton < high { newton } else { 0.5 * (low + high) };
        let moved = (next - radius).abs();
        radius = next;
        if moved <= 1e-14 * radius {
            break;
        }
    }
    Ok(major * radius)
}

/// Larger and smaller of two sigmas.
fn principal(s1: f64, s2: f64) -> Result<(f64, f64), CircularError> {
    for value in [s1, s2] {
        if !value.is_finite() || value < 0.0 {
            return Err(CircularError::Sigma { value });
        }
    }
    if s1.max(s2) == 0.0 {
        return Err(CircularError::NoSpread);
    }
    Ok((s1.max(s2), s1.min(s2)))
}

/// Probability within `r` and its derivative by `r` for principal sigmas 1 and `ratio`.
///
/// The integrand is periodic and smooth, so the trapezium rule converges faster than any power; points
/// are doubled until the answer stands still.
fn inside(r: f64, ratio: f64) -> (f64, f64) {
    if r == 0.0 {
        return (0.0, 0.0);
    }
    let (q2, r2) = (ratio * ratio, r * r);
    let at = |t: f64| {
        let (s, c) = t.sin_cos();
        let variance = c * c + q2 * s * s;
        let tail = (-0.5 * r2 / variance).exp();
        // The inside is summed rather than the tail, so that small probabilities keep their digits.
        let within = -(-0.5 * r2 / variance).exp_m1();
        (within, if tail > 0.0 { tail * r / variance } else { 0.0 })
    };
    let ends = [at(0.0), at(FRAC_PI_2)];
    let mut sum = (0.5 * (ends[0].0 + ends[1].0), 0.5 * (ends[0].1 + ends[1].1));
    let mut points = 1_u32;
    let mut answer = sum;
    // At ratio 0 and tiny radii the integrand has a corner as narrow as the radius: hence the generous end.
    while points < 1 << 20 {
        let step = FRAC_PI_2 / f64::from(points);
        for i in 0..points {
            let (within, density) = at((f64::from(i) + 0.5) * step);
            sum.0 += within;
            sum.1 += density;
        }
        points *= 2;
        let next = (sum.0 / f64::from(points), sum.1 / f64::from(points));
        let settled = points >= 32 && (next.0 - answer.0).abs() <= 1e-13 * next.0;
        answer = next;
        if settled {
            break;
        }
    }
    answer
}

/// σ per axis of a circular error whose `radius` (m) holds the share `level`: a CEP of 3 m is 2.548 m.
///
/// # Errors
/// [`CircularError::Level`], [`CircularError::Radius`].
pub fn std_from_circular(radius: f64, level: f64) -> Result<f64, CircularError> {
    if !(level > 0.0 && level < 1.0) {
        return Err(CircularError::Level { level });
    }
    if !radius.is_finite() || radius < 0.0 {
        return Err(CircularError::Radius { radius });
    }
    Ok(radius / (-2.0 * (-level).ln_1p()).sqrt())
}

/// The common approximation `0.589 (s₁ + s₂)` of CEP50, on principal sigmas.
#[must_use]
pub fn approximate_cep_by_sum(s1: f64, s2: f64) -> f64 {
    0.589 * (s1 + s2)
}

/// The common approximation `0.615 s_min + 0.562 s_max` of CEP50, on principal sigmas.
#[must_use]
pub fn approximate_cep_by_min_max(s1: f64, s2: f64) -> f64 {
    0.615 * s1.min(s2) + 0.562 * s1.max(s2)
}

/// The 1σ ellipse of a horizontal error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEllipse {
    /// Larger principal sigma, metres.
    pub semi_major_m: f64,
    /// Smaller principal sigma, metres.
    pub semi_minor_m: f64,
    /// Direction of the larger one, clockwise from true north, in [0, π).
    pub azimuth: Radians,
}

impl ErrorEllipse {
    /// From a covariance in (north, east), m².
    ///
    /// # Errors
    /// [`CircularError::Covariance`] when it is not finite, or negative in some direction beyond rounding.
    pub fn of(covariance: &Matrix2<f64>) -> Result<Self, CircularError> {
        let (nn, ee) = (covariance[(0, 0)], covariance[(1, 1)]);
        let ne = 0.5 * (covariance[(0, 1)] + covariance[(1, 0)]);
        let refused = CircularError::Covariance { north_var: nn, east_var: ee, north_east_cov: ne };
        let mean = 0.5 * (nn + ee);
        let half_span = (0.5 * (nn - ee)).hypot(ne);
        let (large, small) = (mean + half_span, mean - half_span);
        // NaN fails both comparisons.
        if !(large.is_finite() && small >= -1e-12 * large.abs()) {
            return Err(refused);
        }
        let azimuth = 0.5 * (2.0 * ne).atan2(nn - ee);
        Ok(Self {
            semi_major_m: large.max(0.0).sqrt(),
            semi_minor_m: small.max(0.0).sqrt(),
            azimuth: Radians::new(if azimuth < 0.0 { azimuth + PI } else { azimuth }),
        })
    }

    /// Radius that holds the share `level` of the errors, metres.
    ///
    /// # Errors
    /// As [`radius_of`].
    pub fn radius_of(&self, level: f64) -> Result<f64, CircularError> {
        radius_of(level, self.semi_major_m, self.semi_minor_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn close(found: f64, expected: f64, relative: f64) {
        assert!(
            (found - expected).abs() <= relative * expected.abs(),
            "{found} is not {expected} within {relative}"
        );
    }

    #[test]
    fn circular_and_linear_cases_have_their_closed_forms() {
        for (level, per_sigma) in [(0.5, 1.177_410_023), (0.9, 2.145_966_026), (0.95, 2.447_746_831)] {
            close(radius_of(level, 2.0, 2.0).unwrap(), 2.0 * per_sigma, 1e-9);
        }
        // Ratio 0 is the one-dimensional normal: its two-sided quantiles.
        for (level, quantile) in [
            (0.5, 0.674_489_750_196_081_7),
            (0.9, 1.644_853_626_951_472_2),
            (0.95, 1.959_963_984_540_054),
            (0.001, 0.001_253_314_465_431_8),
        ] {
            close(radius_of(level, 1.0, 0.0).unwrap(), quantile, 1e-9);
            close(radius_of(level, 1.0, 1e-9).unwrap(), quantile, 1e-7);
        }
        // peers: ratio 4.
        close(radius_of(0.5, 4.0, 1.0).unwrap(), 4.0 * 0.726, 1e-3);
        close(radius_of(0.9, 4.0, 1.0).unwrap(), 4.0 * 1.666, 1e-3);
    }

    #[test]
    fn probability_agrees_with_an_integral_done_another_way() {
        // Cartesian: ∫ φ(x/s1)/s1 · erf-free inner integral by Simpson's rule over the chord.
        let (s1, s2, r) = (2.0, 0.7, 1.9);
        let normal = |x: f64, s: f64| (-0.5 * (x / s).powi(2)).exp() / (s * (2.0 * PI).sqrt());
        let simpson = |f: &dyn Fn(f64) -> f64, a: f64, b: f64, n: usize| {
            let h = (b - a) / n as f64;
            (0..=n)
                .map(|i| {
                    let w = if i == 0 || i == n {
                        1.0
                    } else if i % 2 == 1 {
                        4.0
                    } else {
                        2.0
                    };
                    w * f(a + i as f64 * h)
                })
                .sum::<f64>()
                * h
                / 3.0
        };
        // x = r sin t removes the square root's infinite slope at the rim.
        let outer = |t: f64| {
            let (s, c) = t.sin_cos();
            let chord = r * c;
            normal(r * s, s1) * r * c * simpson(&|y| normal(y, s2), -chord, chord, 200)
        };
        let reference = simpson(&outer, -FRAC_PI_2, FRAC_PI_2, 400);
        close(probability_within(r, s1, s2).unwrap(), reference, 1e-8);
    }

    #[test]
    fn cep_of_the_papers_receiver_is_2_548_m_per_axis() {
        close(std_from_circular(3.0, 0.5).unwrap(), 2.548, 1e-4);
        close(3.0 / CEP50_PER_SIGMA, std_from_circular(3.0, 0.5).unwrap(), 1e-14);
    }

    #[test]
    fn errors_of_the_common_approximations() {
        // In percent of the exact CEP50. The reference prints one digit, some cut off and some rounded.
        let percent = |approximation: fn(f64, f64) -> f64, ratio: f64| {
            100.0 * (approximation(1.0, ratio) / radius_of(0.5, 1.0, ratio).unwrap() - 1.0)
        };
        for (ratio, expected, tolerance) in
            [(1.0, 0.05, 0.005), (0.5, 1.5, 0.05), (0.2, 0.1, 0.06), (0.1, -5.0, 0.06), (0.0, -12.7, 0.06)]
        {
            let found = percent(approximate_cep_by_sum, ratio);
            assert!((found - expected).abs() <= tolerance, "sum at {ratio}: {found} %");
        }
        for (ratio, expected, tolerance) in
            [(1.0, -0.03, 0.005), (0.3, -0.5, 0.06), (0.2, -2.9, 0.06), (0.1, -8.6, 0.06), (0.0, -16.7, 0.06)]
        {
            let found = percent(approximate_cep_by_min_max, ratio);
            assert!((found - expected).abs() <= tolerance, "min-max at {ratio}: {found} %");
        }
    }

    #[test]
    fn nonsense_is_refused_with_words() {
        assert_eq!(radius_of(0.5, 0.0, 0.0), Err(CircularError::NoSpread));
        assert_eq!(radius_of(0.5, -1.0, 1.0), Err(CircularError::Sigma { value: -1.0 }));
        assert!(matches!(radius_of(0.5, f64::NAN, 1.0), Err(CircularError::Sigma { .. })));
        assert!(matches!(radius_of(0.5, 1.0, f64::INFINITY), Err(CircularError::Sigma { .. })));
        for level in [0.0, 1.0, -0.1, f64::NAN] {
            assert!(matches!(radius_of(level, 1.0, 1.0), Err(CircularError::Level { .. })));
        }
        let not_positive = Matrix2::new(1.0, 2.0, 2.0, 1.0);
        let said = ErrorEllipse::of(&not_positive).unwrap_err().to_string();
        assert!(said.contains("not a covariance"), "{said}");
        assert!(ErrorEllipse::of(&Matrix2::new(f64::NAN, 0.0, 0.0, 1.0)).is_err());
        assert!(probability_within(-1.0, 1.0, 1.0).is_err());
    }

    #[test]
    fn the_ellipse_points_where_the_spread_is() {
        // 3 m along azimuth 30°, 1 m across.
        let (s, c) = Radians::from_degrees(30.0).get().sin_cos();
        let axes = Matrix2::new(c, -s, s, c);
        let covariance = axes * Matrix2::new(9.0, 0.0, 0.0, 1.0) * axes.transpose();
        let ellipse = ErrorEllipse::of(&covariance).unwrap();
        close(ellipse.semi_major_m, 3.0, 1e-12);
        close(ellipse.semi_minor_m, 1.0, 1e-12);
        close(ellipse.azimuth.degrees(), 30.0, 1e-12);
        let mirrored = ErrorEllipse::of(&Matrix2::new(
            covariance[(0, 0)],
            -covariance[(0, 1)],
            -covariance[(1, 0)],
            covariance[(1, 1)],
        ));
        close(mirrored.unwrap().azimuth.degrees(), 150.0, 1e-12);
    }

    proptest! {
        #[test]
        fn radius_and_probability_are_inverse(level in 0.001..0.9999f64, ratio in 0.0..=1.0f64, scale in 0.01..50.0f64) {
            let radius = radius_of(level, scale, scale * ratio).unwrap();
            let back = probability_within(radius, scale * ratio, scale).unwrap();
            prop_assert!((back - level).abs() < 1e-10, "{back} for {level}");
        }
    }
}
