//! The first two of the paper's three corner estimates: blunt (bounding box) and refined (Harris).
//!
//! # Source
//! Hemerly (2014), section 2 and Fig. 1; Harris and Stephens (1988), "A combined corner and edge detector".

use super::quads::Quad;
use crate::calibration::grey::Grey;
use nalgebra::Vector2;

/// Corners of the square's bounding box. The box is turned with the square: its sides run along the mean
/// directions of opposite sides, so that it bounds closely at any angle.
pub(super) fn blunt(quad: &Quad) -> [Vector2<f64>; 4] {
    let [a, b, c, d] = quad.corners;
    let right = ((b - a) + (c - d)).normalize();
    let down = ((d - a) + (c - b)).normalize();
    let sine = right.perp(&down);
    let (mut least, mut most) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    for p in &quad.outline {
        let along = Vector2::new(p.perp(&down), right.perp(p)) / sine;
        least = least.inf(&along);
        most = most.sup(&along);
    }
    [(least.x, least.y), (most.x, least.y), (most.x, most.y), (least.x, most.y)]
        .map(|(x, y)| right * x + down * y)
}

/// Strongest Harris corner near a blunt estimate, `side` being the length of the square's side in pixels.
pub(super) fn refined(image: &Grey, blunt: Vector2<f64>, side: f64) -> Vector2<f64> {
    const WINDOW: isize = 1;
    const WEIGHTS: [f32; 3] = [0.25, 0.5, 0.25];
    const SENSITIVITY: f32 = 0.04;
    // The box misses a corner by a few per cent of the side under perspective, and by the blur.
    let reach = (2.0 + 0.12 * side).min(12.0) as isize;
    let (c0, r0) = (blunt.x.round() as isize, blunt.y.round() as isize);
    // Products of gradients over the patch, then sums over the window of each candidate.
    let patch = reach + 1 + WINDOW;
    let size = (2 * patch + 1) as usize;
    let mut products = vec![[0.0_f32; 3]; size * size];
    for dr in -patch..=patch {
        for dc in -patch..=patch {
            let (c, r) = (c0 + dc, r0 + dr);
            let gx = 0.5 * (image.at(c + 1, r) - image.at(c - 1, r));
            let gy = 0.5 * (image.at(c, r + 1) - image.at(c, r - 1));
            let at = (dr + patch) as usize * size + (dc + patch) as usize;
            products[at] = [gx * gx, gx * gy, gy * gy];
        }
    }
    let response = |dc: isize, dr: isize| {
        let mut sums = [0.0_f32; 3];
        for (r, down) in (dr - WINDOW..=dr + WINDOW).zip(WEIGHTS) {
            let start = (r + patch) as usize * size + (dc - WINDOW + patch) as usize;
            for (product, across) in products[start..=start + 2 * WINDOW as usize].iter().zip(WEIGHTS) {
                for k in 0..3 {
                    sums[k] += down * across * product[k];
                }
            }
        }
        let [xx, xy, yy] = sums;
        xx * yy - xy * xy - SENSITIVITY * (xx + yy) * (xx + yy)
    };
    let mut best = (f32::NEG_INFINITY, 0, 0);
    for dr in -reach..=reach {
        for dc in -reach..=reach {
            let value = response(dc, dr);
            if value > best.0 {
                best = (value, dc, dr);
            }
        }
    }
    let (peak, dc, dr) = best;
    // Vertex of the parabola through the peak and its two neighbours.
    let vertex = |before: f32, after: f32| {
        let bend = before - 2.0 * peak + after;
        if bend < 0.0 { f64::from(0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    Vector2::new(
        (c0 + dc) as f64 + vertex(response(dc - 1, dr), response(dc + 1, dr)),
        (r0 + dr) as f64 + vertex(response(dc, dr - 1), response(dc, dr + 1)),
    )
}
