//! Random texture: a hash of lattice points, smooth noise on it, and how much of a pattern survives the averaging
//! over a pixel's footprint.

/// A well-mixed 64-bit hash of two integers and a seed.
pub(super) fn hash(seed: u64, x: i64, y: i64) -> u64 {
    let mut h = seed
        ^ (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f).rotate_left(31);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    h ^ (h >> 32)
}

/// A hash as a number in [0, 1).
pub(super) fn fraction(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}

/// Smooth noise in [-1, 1] with one random value per unit square.
pub(super) fn smooth(seed: u64, x: f64, y: f64) -> f64 {
    let (column, row) = (floor(x), floor(y));
    let (fx, fy) = (ease(x - column as f64), ease(y - row as f64));
    let value = |dx, dy| fraction(hash(seed, column.wrapping_add(dx), row.wrapping_add(dy)));
    let top = value(0, 0) * (1.0 - fx) + value(1, 0) * fx;
    let bottom = value(0, 1) * (1.0 - fx) + value(1, 1) * fx;
    2.0 * (top * (1.0 - fy) + bottom * fy) - 1.0
}

/// Sum of `octaves` of smooth noise, each half as wide and 0.6 times as strong as the last, about in [-1, 1];
/// octaves finer than the footprint fade out.
pub(super) fn fractal(seed: u64, x: f64, y: f64, widest_m: f64, octaves: u32, footprint_m: f64) -> f64 {
    let (mut sum, mut total, mut strength, mut width) = (0.0, 0.0, 1.0, widest_m);
    for octave in 0..octaves {
        let left = strength * survival(2.0 * width, footprint_m);
        if left > 0.01 {
            sum += left * smooth(seed.wrapping_add(u64::from(octave) * 7919), x / width, y / width);
        }
        total += strength;
        strength *= 0.6;
        width *= 0.5;
    }
    1.5 * sum / total
}

/// Part of a wave's amplitude that survives averaging over the footprint: a third at two pixels per wave, nothing from
/// 1.33 on, where it would alias.
pub(super) fn survival(wavelength_m: f64, footprint_m: f64) -> f64 {
    let cycles = footprint_m / (0.75 * wavelength_m);
    (1.0 - cycles * cycles).max(0.0).powi(2)
}

/// Part of a pixel's footprint that lies inside an edge, from the signed distance to it (positive inside).
pub(super) fn coverage(inside_m: f64, footprint_m: f64) -> f64 {
    (0.5 + inside_m / footprint_m).clamp(0.0, 1.0)
}

/// Part of a pixel's footprint covered by a line, from the distance to its axis.
pub(super) fn line_coverage(distance_m: f64, width_m: f64, footprint_m: f64) -> f64 {
    let (half, reach) = (0.5 * width_m, 0.5 * footprint_m);
    let covered = (distance_m + reach).min(half) - (distance_m - reach).max(-half);
    (covered / footprint_m).clamp(0.0, 1.0)
}

/// The next integer below; the standard function is a call on processors without a rounding instruction.
pub(super) fn floor(x: f64) -> i64 {
    let toward_zero = x as i64;
    toward_zero - i64::from(x < toward_zero as f64)
}

/// A step from 0 to 1 without kinks.
pub(super) fn ease(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smooth_noise_is_continuous_bounded_and_centred() {
        let (mut sum, mut greatest) = (0.0, 0.0_f64);
        for index in 0..20_000 {
            let (x, y) = (f64::from(index % 200) * 0.37 - 31.0, f64::from(index / 200) * 0.41 - 17.0);
            let value = smooth(5, x, y);
            greatest = greatest.max((smooth(5, x + 1e-4, y) - value).abs());
            assert!(value.abs() <= 1.0);
            sum += value;
        }
        // The steepest ease is 1.875 per unit and values differ by at most 2.
        assert!(greatest < 1e-4 * 3.76 && (sum / 20_000.0_f64).abs() < 0.03, "{greatest} {sum}");
    }

    #[test]
    fn floor_is_the_floor() {
        for x in [-2.5, -2.0, -0.1, 0.0, 0.9, 1.0, 7.3] {
            assert_eq!(floor(x), x.floor() as i64);
        }
    }

    #[test]
    fn a_line_covers_its_share_of_the_footprint() {
        assert_eq!(line_coverage(0.0, 0.2, 1.0), 0.2);
        assert_eq!(line_coverage(0.5, 0.2, 1.0), 0.1);
        assert_eq!(line_coverage(0.7, 0.2, 1.0), 0.0);
        assert_eq!(line_coverage(0.3, 3.0, 1.0), 1.0);
    }
}
