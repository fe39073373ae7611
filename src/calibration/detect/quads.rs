//! Dark quadrilaterals in a photo: threshold, connected areas, outline, four fitted sides.

use crate::calibration::grey::Grey;
use nalgebra::Vector2;

/// Smallest side of a square, pixels of the searched image: below it no edge has a straight part left.
const MIN_SIDE_PX: f64 = 6.0;
/// Most quadrilaterals kept, the largest first: bounds the work on photos full of clutter.
const MAX_QUADS: usize = 2000;

/// A dark quadrilateral, corners clockwise as seen (column to the right, row down).
#[derive(Debug, Clone)]
pub(super) struct Quad {
    /// Corner pixels (column, row), from the intersection of fitted sides.
    pub corners: [Vector2<f64>; 4],
    /// Outline: midpoints of the pixel edges around the dark area.
    pub outline: Vec<Vector2<f64>>,
    /// Light inside a dark outline.
    pub hollow: bool,
}

impl Quad {
    /// Where the diagonals meet: the image of the square's centre.
    pub fn centre(&self) -> Vector2<f64> {
        let [a, b, c, d] = self.corners;
        let (ac, bd) = (c - a, d - b);
        let t = (b - a).perp(&bd) / ac.perp(&bd);
        a + ac * t
    }
    /// Area, px².
    pub fn area(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        0.5 * (c - a).perp(&(d - b))
    }
    /// Pixel at fractions (right, down) of the square, bilinear in the corners.
    fn inside(&self, right: f64, down: f64) -> Vector2<f64> {
        let [a, b, c, d] = self.corners;
        (a * (1.0 - right) + b * right) * (1.0 - down) + (d * (1.0 - right) + c * right) * down
    }
}

/// All dark quadrilaterals, for one window of the local threshold.
pub(super) fn find_quads(smooth: &Grey, radius: usize, margin: f32) -> Vec<Quad> {
    let (w, h) = (smooth.width(), smooth.height());
    let dark = smooth.darker_than_surroundings(radius, margin);
    let mut seen = vec![false; w * h];
    let mut stack = Vec::new();
    let mut quads = Vec::new();
    for start in 0..w * h {
        if !dark[start] || seen[start] {
            continue;
        }
        let (mut left, mut right, mut top, mut bottom) = (w, 0, h, 0);
        seen[start] = true;
        stack.push(start);
        while let Some(at) = stack.pop() {
            let (c, r) = (at % w, at / w);
            (left, right) = (left.min(c), right.max(c));
            (top, bottom) = (top.min(r), bottom.max(r));
            let mut visit = |next: usize| {
                if dark[next] && !seen[next] {
                    seen[next] = true;
                    stack.push(next);
                }
            };
            if c > 0 {
                visit(at - 1);
            }
            if c + 1 < w {
                visit(at + 1);
            }
            if r > 0 {
                visit(at - w);
            }
            if r + 1 < h {
                visit(at + w);
            }
        }
        // What touches the frame is cut by it; what is narrower than the smallest square is none.
        let cut = left == 0 || top == 0 || right + 1 == w || bottom + 1 == h;
        let extent = (right - left).min(bottom - top) as f64;
        if cut || extent < MIN_SIDE_PX {
            continue;
        }
        // The outline of a convex area has exactly the length of its bounding box's.
        let box_length = 2 * (right - left + bottom - top + 2);
        let Some(outline) = trace(&dark, w, start, box_length + box_length / 4) else {
            continue;
        };
        if let Some(corners) = four_sides(&outline) {
            let mut quad = Quad { corners, outline, hollow: false };
            if let Some(hollow) = is_hollow(&quad, smooth, margin) {
                quad.hollow = hollow;
                quads.push(quad);
            }
        }
    }
    quads.sort_by(|a, b| b.area().total_cmp(&a.area()));
    quads.truncate(MAX_QUADS);
    quads
}

/// Follows the pixel edges around the dark area that begins at `start` (its first pixel in reading
/// order), clockwise, dark on the right. `None` when longer than `limit`: too ragged for a square.
fn trace(dark: &[bool], width: usize, start: usize, limit: usize) -> Option<Vec<Vector2<f64>>> {
    const STEPS: [(isize, isize); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];
    let height = dark.len() / width;
    let is_dark = |c: isize, r: isize| {
        c >= 0
            && r >= 0
            && (c as usize) < width
            && (r as usize) < height
            && dark[r as usize * width + c as usize]
    };
    // Vertices lie half a pixel left of and above the pixel of the same indices.
    let first = ((start % width) as isize, (start / width) as isize);
    let (mut c, mut r) = first;
    let mut heading = 0;
    let mut outline = Vec::with_capacity(limit);
    loop {
        let (dc, dr) = STEPS[heading];
        outline.push(Vector2::new(c as f64 - 0.5 + 0.5 * dc as f64, r as f64 - 0.5 + 0.5 * dr as f64));
        (c, r) = (c + dc, r + dr);
        // The pixels ahead of the vertex, on the right and on the left of the heading.
        let (ahead_right, ahead_left) = match heading {
            0 => ((c, r), (c, r - 1)),
            1 => ((c - 1, r), (c, r)),
            2 => ((c - 1, r - 1), (c - 1, r)),
            _ => ((c, r - 1), (c - 1, r - 1)),
        };
        if !is_dark(ahead_right.0, ahead_right.1) {
            heading = (heading + 1) % 4;
        } else if is_dark(ahead_left.0, ahead_left.1) {
            heading = (heading + 3) % 4;
        }
        if (c, r) == first && heading == 0 {
            return Some(outline);
        }
        if outline.len() >= limit {
            return None;
        }
    }
}

/// Four straight sides of an outline and where neighbours intersect, or `None` if it is no quadrilateral.
pub(super) fn four_sides(outline: &[Vector2<f64>]) -> Option<[Vector2<f64>; 4]> {
    let n = outline.len();
    let farthest = |distance: &dyn Fn(&Vector2<f64>) -> f64| {
        let mut best = (0, f64::NEG_INFINITY);
        for (i, p) in outline.iter().enumerate() {
            let d = distance(p);
            if d > best.1 {
                best = (i, d);
            }
        }
        best.0
    };
    let mean = outline.iter().sum::<Vector2<f64>>() / n as f64;
    let a = farthest(&|p| (p - mean).norm_squared());
    let c = farthest(&|p| (p - outline[a]).norm_squared());
    let diagonal = outline[c] - outline[a];
    let b = farthest(&|p| diagonal.perp(&(p - outline[a])));
    let d = farthest(&|p| -diagonal.perp(&(p - outline[a])));
    let mut at = [a, b, c, d];
    at.sort_unstable();
    let mut sides = [(Vector2::zeros(), Vector2::zeros()); 4];
    for (k, side) in sides.iter_mut().enumerate() {
        let (from, to) = (at[k], at[(k + 1) % 4]);
        let count = (to + n - from) % n;
        // The ends are rounded by blur and smoothing.
        let trim = (count / 8).max(1);
        if count < 2 * trim + 3 {
            return None;
        }
        let points: Vec<_> = (trim..=count - trim).map(|i| outline[(from + i) % n]).collect();
        let (centre, direction, spread) = fit_line(&points);
        // Stairs of pixel edges leave 0.3 px; noise and a lens that bends a side by 1 % add to it.
        if spread > 0.5 + 0.008 * count as f64 {
            return None;
        }
        let forward = direction.dot(&(outline[to] - outline[from]));
        *side = (centre, direction * forward.signum());
    }
    let mut corners = [Vector2::zeros(); 4];
    for k in 0..4 {
        let ((p, u), (q, v)) = (sides[(k + 3) % 4], sides[k]);
        // Neighbouring sides turn clockwise by 25° to 155°.
        let sine = u.perp(&v);
        if sine < 0.42 {
            return None;
        }
        corners[k] = p + u * ((q - p).perp(&v) / sine);
    }
    for k in 0..4 {
        let side = corners[(k + 1) % 4] - corners[k];
        if side.norm() < MIN_SIDE_PX || side.dot(&sides[k].1) <= 0.0 {
            return None;
        }
        // The corner of the fitted sides lies near the outline's own.
        if (corners[k] - outline[at[k]]).norm() > 3.0 + 0.25 * side.norm() {
            return None;
        }
    }
    Some(corners)
}

/// Total least squares line: a point, a unit direction, root mean square distance of the points.
fn fit_line(points: &[Vector2<f64>]) -> (Vector2<f64>, Vector2<f64>, f64) {
    let n = points.len() as f64;
    let centre = points.iter().sum::<Vector2<f64>>() / n;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = p - centre;
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
    }
    let angle = 0.5 * f64::atan2(2.0 * xy, xx - yy);
    let direction = Vector2::new(angle.cos(), angle.sin());
    let least = 0.5 * (xx + yy - f64::hypot(xx - yy, 2.0 * xy));
    (centre, direction, (least.max(0.0) / n).sqrt())
}

/// Whether the middle is light inside a dark outline; `None` when outline and surroundings do not differ
/// by `margin`, so that there is no square at all.
fn is_hollow(quad: &Quad, image: &Grey, margin: f32) -> Option<bool> {
    let sample = |right: f64, down: f64| {
        let p = quad.inside(right, down);
        image.at(p.x.round() as isize, p.y.round() as isize)
    };
    // Across the middle of each side, from outside to inside.
    let mut outside = 0.0;
    let mut outline = 0.0;
    for across in [|s: f64| (0.5, s), |s: f64| (1.0 - s, 0.5), |s: f64| (0.5, 1.0 - s), |s: f64| (s, 0.5)] {
        let at = |s: f64| {
            let (right, down) = across(s);
            sample(right, down)
        };
        outside += 0.25 * at(-0.3);
        let darkest = (0..=6).map(|i| at(0.05 * f64::from(i))).fold(f32::INFINITY, f32::min);
        outline += 0.25 * darkest;
    }
    if outside - outline < margin {
        return None;
    }
    let mut middle = 0.0;
    for (right, down) in [(0.5, 0.5), (0.4, 0.5), (0.6, 0.5), (0.5, 0.4), (0.5, 0.6)] {
        middle += 0.2 * sample(right, down);
    }
    Some(middle > 0.5 * (outside + outline))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dark convex polygon on white, 8 × 8 samples per pixel.
    fn polygon(corners: &[(f64, f64)], width: usize, height: usize) -> Grey {
        let inside = |x: f64, y: f64| {
            (0..corners.len()).all(|k| {
                let ((ax, ay), (bx, by)) = (corners[k], corners[(k + 1) % corners.len()]);
                (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0
            })
        };
        let mut values = Vec::new();
        for r in 0..height {
            for c in 0..width {
                let hits = (0..64)
                    .filter(|s| {
                        let sub = |k: i32| (f64::from(k) + 0.5) / 8.0 - 0.5;
                        inside(c as f64 + sub(s % 8), r as f64 + sub(s / 8))
                    })
                    .count();
                values.push(220.0 - 190.0 * hits as f32 / 64.0);
            }
        }
        Grey::new(width, height, values).unwrap()
    }

    #[test]
    fn a_tilted_square_comes_back_within_a_third_of_a_pixel() {
        let truth = [(20.3, 15.1), (52.7, 21.9), (47.2, 55.4), (13.8, 46.6)];
        let quads = find_quads(&polygon(&truth, 70, 70), 30, 20.0);
        assert_eq!(quads.len(), 1);
        assert!(!quads[0].hollow);
        for (x, y) in truth {
            let miss = quads[0]
                .corners
                .iter()
                .map(|c| (c - Vector2::new(x, y)).norm())
                .fold(f64::INFINITY, f64::min);
            assert!(miss < 0.35, "corner ({x}, {y}) missed by {miss} px");
        }
        assert!(quads[0].area() > 0.0, "corners run clockwise");
    }

    #[test]
    fn discs_triangles_and_cut_squares_are_no_quadrilaterals() {
        let disc: Vec<_> = (0..48)
            .map(|k| (f64::from(k) * std::f64::consts::TAU / 48.0).sin_cos())
            .map(|(s, c)| (35.0 + 18.0 * c, 35.0 + 18.0 * s))
            .collect();
        assert!(find_quads(&polygon(&disc, 70, 70), 30, 20.0).is_empty());
        let triangle = [(20.0, 15.0), (50.0, 30.0), (25.0, 55.0)];
        assert!(find_quads(&polygon(&triangle, 70, 70), 30, 20.0).is_empty());
        let cut = [(-5.0, 20.0), (30.0, 20.0), (30.0, 50.0), (-5.0, 50.0)];
        assert!(find_quads(&polygon(&cut, 70, 70), 30, 20.0).is_empty());
    }
}
