//! First positive root of a polynomial: where a lens folds back or its denominator vanishes.

/// Smallest root in (0, `far`] at which the polynomial, positive at 0, falls to zero; infinite without one.
///
/// - `coefficients`: of 1, s, s², …
pub(super) fn first_root(coefficients: &[f64], far: f64) -> f64 {
    sign_changes(coefficients, far).first().copied().unwrap_or(f64::INFINITY)
}

/// Product of two polynomials, coefficients from the constant term up.
pub(super) fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            product[i + j] += x * y;
        }
    }
    product
}

/// Derivative of a polynomial, coefficients from the constant term up.
pub(super) fn derivative(coefficients: &[f64]) -> Vec<f64> {
    coefficients.iter().enumerate().skip(1).map(|(power, c)| power as f64 * c).collect()
}

fn value(coefficients: &[f64], s: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * s + c)
}

/// Where the polynomial changes sign in (0, far], ascending.
///
/// Between neighbouring turning points a polynomial is monotone, so one bisection finds each root; the
/// turning points are the roots of the derivative, of one degree less.
fn sign_changes(coefficients: &[f64], far: f64) -> Vec<f64> {
    if coefficients.len() < 2 {
        return Vec::new();
    }
    let mut stops = sign_changes(&derivative(coefficients), far);
    stops.push(far);
    let mut roots = Vec::new();
    let mut low = 0.0;
    for high in stops {
        let rising = value(coefficients, low) < 0.0;
        if (value(coefficients, high) < 0.0) != rising {
            roots.push(bisect(coefficients, low, high, rising));
        }
        low = high;
    }
    roots
}

/// The last number before the change of sign between `low` and `high`.
fn bisect(coefficients: &[f64], mut low: f64, mut high: f64, rising: bool) -> f64 {
    const HALVINGS: u32 = 200;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if (value(coefficients, middle) < 0.0) == rising { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_several_roots_is_found() {
        // (1 − s)(1 − s/2)(1 − s/7).
        let cubic = product(&product(&[1.0, -1.0], &[1.0, -0.5]), &[1.0, -1.0 / 7.0]);
        assert!((first_root(&cubic, 1e6) - 1.0).abs() < 1e-12);
        assert_eq!(sign_changes(&cubic, 1e6).len(), 3);
        assert!(first_root(&cubic, 0.5).is_infinite());
    }

    #[test]
    fn a_polynomial_that_stays_positive_has_none() {
        assert!(first_root(&[1.0, 0.0, 0.3], 1e6).is_infinite());
        assert!(first_root(&[1.0], 1e6).is_infinite());
        assert!(first_root(&[1.0, 0.0, 0.0, 0.0], 1e6).is_infinite());
    }
}
