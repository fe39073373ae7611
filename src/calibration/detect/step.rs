//! What a blurred step from dark to light looks like: the normal distribution, from a table made at compile
//! time. Fitting edges asks for it millions of times per photo.

/// The table reaches to ±5, where 3 · 10⁻⁷ of the step are left.
const REACH: f64 = 5.0;
const PER_UNIT: usize = 32;
const INTERVALS: usize = 2 * PER_UNIT * REACH as usize;
/// Distribution function at every node, and its density times the distance of nodes.
static TABLE: [[f64; 2]; INTERVALS + 1] = table();

const fn table() -> [[f64; 2]; INTERVALS + 1] {
    let mut table = [[0.0; 2]; INTERVALS + 1];
    let mut i = 0;
    while i <= INTERVALS {
        let z = i as f64 / PER_UNIT as f64 - REACH;
        let half = 0.5 * z * z;
        let (mut exponential, mut power) = (0.0, 1.0);
        // Φ(z) = ½ + φ(z) (z + z³/3 + z⁵/(3·5) + …)
        let (mut series, mut odd) = (0.0, z);
        let mut k = 1;
        while k < 120 {
            exponential += power;
            power *= half / k as f64;
            series += odd;
            odd *= z * z / (2 * k + 1) as f64;
            k += 1;
        }
        let density = 0.398_942_280_401_432_7 / exponential;
        table[i] = [0.5 + density * series, density / PER_UNIT as f64];
        i += 1;
    }
    table
}

/// Normal distribution function and density, by cubic interpolation; errors below 10⁻⁸ and 10⁻⁵, and the
/// second is exactly the derivative of the first. Constant beyond ±5.
pub(super) fn normal(z: f64) -> (f64, f64) {
    let along = (z.clamp(-REACH, REACH) + REACH) * PER_UNIT as f64;
    let node = (along as usize).min(INTERVALS - 1);
    let t = along - node as f64;
    let ([p, u], [q, v]) = (TABLE[node], TABLE[node + 1]);
    let (square, cube) = (3.0 * (q - p) - 2.0 * u - v, 2.0 * (p - q) + u + v);
    let value = p + t * (u + t * (square + t * cube));
    let slope = u + t * (2.0 * square + 3.0 * t * cube);
    (value, slope * PER_UNIT as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_matches_tables() {
        for (z, p) in [
            (0.0, 0.5),
            (1.0, 0.841_344_746_07),
            (-1.96, 0.024_997_895_15),
            (3.0, 0.998_650_101_97),
            (-4.01, 0.000_030_359_37),
        ] {
            assert!((normal(z).0 - p).abs() < 1e-8, "Φ({z}) = {}", normal(z).0);
            let density = (-0.5_f64 * z * z).exp() / std::f64::consts::TAU.sqrt();
            assert!((normal(z).1 - density).abs() < 1e-5, "φ({z}) = {}", normal(z).1);
        }
        assert!(normal(80.0).0 > 0.999_999 && normal(-80.0).0 < 1e-6 && normal(f64::NAN).0.is_nan());
    }
}
