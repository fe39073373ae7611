//! Random views under hard conditions, a new one for every seed.

use super::print::Print;
use super::{BoardPose, Look, facing, photo, see};
use crate::calibration::detect::{Detection, detect};
use crate::calibration::grey::Grey;
use crate::calibration::target::{BoardPoint, Target};
use crate::camera::{Brown, ImagePoint};
use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::ops::Range;

/// A camera, where it is, and how the photo comes out.
#[derive(Debug, Clone, Copy)]
pub(in crate::calibration) struct HardView {
    pub camera: Brown,
    pub pose: BoardPose,
    pub look: Look,
}

/// What came of looking for a target in many hard views.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::calibration) struct Outcome {
    /// Views in which it was found.
    pub found: usize,
    /// Seeds of views with a point more than 2 px from its truth.
    pub wrong: Vec<u64>,
    /// Root mean square distance of all points to their truth, px.
    pub rms_px: f64,
}

/// Seeds of so many views; of as many as `BORESIGHT_HARD_VIEWS` said when the tests were built, for a thorough look:
/// `BORESIGHT_HARD_VIEWS=1000 cargo test --release hard_views` takes minutes.
pub(in crate::calibration) fn hard_seeds(usual: u64) -> Range<u64> {
    let asked = option_env!("BORESIGHT_HARD_VIEWS").and_then(|count| count.parse().ok());
    0..asked.unwrap_or(usual)
}

impl Outcome {
    /// Whether the target was found in this share of the views, and nowhere wrongly.
    pub fn is_found_in(&self, share: f64, seeds: &Range<u64>) -> bool {
        self.found as f64 >= share * (seeds.end - seeds.start) as f64 && self.wrong.is_empty()
    }
}

/// Looks for a target in the views of many seeds.
///
/// - `turns`: quarter turns of the board that cannot be told apart; the best of them counts.
pub(in crate::calibration) fn hard_renders(target: &Target, turns: &[usize], seeds: Range<u64>) -> Outcome {
    let results: Vec<_> = seeds
        .into_par_iter()
        .filter_map(|seed| {
            let view = hard_view(target, seed);
            let detection = detect(&view.photo(target), target).ok()?;
            let misses = turns.iter().map(|&turn| view.misses(target, &detection, turn));
            let squares = |misses: &[f64]| misses.iter().map(|m| m * m).sum::<f64>();
            let best = misses.min_by(|a, b| squares(a).total_cmp(&squares(b)))?;
            Some((seed, squares(&best), best.len(), best.iter().any(|m| *m > 2.0)))
        })
        .collect();
    let points: usize = results.iter().map(|r| r.2).sum();
    Outcome {
        found: results.len(),
        wrong: results.iter().filter(|r| r.3).map(|r| r.0).collect(),
        rms_px: (results.iter().map(|r| r.1).sum::<f64>() / points as f64).sqrt(),
    }
}

impl HardView {
    pub(in crate::calibration) fn photo(&self, target: &Target) -> Grey {
        photo(&self.camera, &self.pose, target, self.look)
    }
    /// Distances of found points from where they truly are if the board was turned by quarters, px.
    fn misses(&self, target: &Target, detection: &Detection, turn: usize) -> Vec<f64> {
        let middle = Print::new(target, 0.0).point(0.5, 0.5);
        let misses = detection.corners.iter().map(|corner| {
            let (mut x, mut y) = (corner.board.x_m - middle.x_m, corner.board.y_m - middle.y_m);
            for _ in 0..turn {
                (x, y) = (-y, x);
            }
            let board = BoardPoint { x_m: x + middle.x_m, y_m: y + middle.y_m };
            self.miss(board, corner.sharp)
        });
        misses.collect()
    }
    /// Distance of a pixel from where a point of the board truly is, px.
    pub(in crate::calibration) fn miss(&self, board: BoardPoint, pixel: ImagePoint) -> f64 {
        let truth = see(&self.camera, &self.pose, board);
        f64::hypot(pixel.column - truth.column, pixel.row - truth.row)
    }
}

/// The whole print in a 640 × 480 photo: any turn, tilt up to 60°, noise up to σ 10, blur up to σ 2 px, light
/// falling to a fifth, gamma, vignetting, glare, clutter, up to two discs over the print.
///
/// Views in which points of the target come nearer to each other than 8 px + 2 σ of the blur are not used.
pub(in crate::calibration) fn hard_view(target: &Target, seed: u64) -> HardView {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    loop {
        let view = random_view(target, seed, &mut random);
        if nearest_points_px(&view, target) >= 8.0 + 2.0 * view.look.blur_px {
            return view;
        }
    }
}

fn random_view(target: &Target, seed: u64, random: &mut ChaCha8Rng) -> HardView {
    let (width, height) = (640, 480);
    let focal = random.random_range(430.0..900.0);
    let barrel = random.random_range(-0.30..0.08);
    let middle = |size: f64, random: &mut ChaCha8Rng| 0.5 * size + random.random_range(-15.0..15.0);
    let (column, row) = (middle(640.0, random), middle(480.0, random));
    let camera =
        Brown::new([focal, focal, 0.0, column, row, barrel, -0.3 * barrel, 0.001, -0.001, 0.0]).unwrap();
    let tilt = random.random_range(0.0..60.0_f64);
    let towards = random.random_range(0.0..std::f64::consts::TAU);
    let turns = (tilt * towards.cos(), tilt * towards.sin(), random.random_range(0.0..360.0));
    let light =
        |random: &mut ChaCha8Rng| if random.random_bool(0.5) { random.random_range(0.2..1.0) } else { 1.0 };
    let (light_at_right, light_at_bottom) =
        if random.random_bool(0.5) { (light(random), 1.0) } else { (1.0, light(random)) };
    let look = Look {
        width,
        height,
        blur_px: random.random_range(0.5..2.0),
        noise: random.random_range(1.0..10.0),
        light_at_right,
        light_at_bottom,
        vignetting: random.random_range(0.0..0.4),
        gamma: random.random_range(0.6..1.5),
        glare: if random.random_bool(0.2) { random.random_range(20.0..80.0) } else { 0.0 },
        margin: random.random_range(0.5..2.0),
        texture: random.random_range(0.0..60.0),
        clutter: random.random_range(0..16),
        occluders: random.random_range(0..3),
        hidden: 0.04,
        seed,
    };
    let fill = random.random_range(0.45..0.98);
    let (across, down) = (random.random_range(-1.0..1.0), random.random_range(-1.0..1.0));
    let pose = fitted(&camera, target, turns, fill, (across, down));
    HardView { camera, pose, look }
}

/// The pose at the distance where the print takes up a share of the frame that it could fill, moved off the
/// middle by shares of what is left.
fn fitted(
    camera: &Brown,
    target: &Target,
    turns: (f64, f64, f64),
    fill: f64,
    (across, down): (f64, f64),
) -> BoardPose {
    let print = Print::new(target, 0.0);
    let outline: Vec<_> = (0..=8)
        .map(|k| f64::from(k) / 8.0)
        .flat_map(|s| [(s, 0.0), (s, 1.0), (0.0, s), (1.0, s)])
        .map(|(right, down)| print.point(right, down))
        .collect();
    let size_m = print.size_m();
    let bounds = |pose: &BoardPose| {
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = Vector2::repeat(f64::NEG_INFINITY);
        for p in &outline {
            let pixel = see(camera, pose, *p);
            low = low.inf(&Vector2::new(pixel.column, pixel.row));
            high = high.sup(&Vector2::new(pixel.column, pixel.row));
        }
        (low, high)
    };
    let interior = camera.interior();
    let (mut distance, mut shift) = (3.0 * size_m, Vector2::zeros());
    // Each round corrects the distance by the size seen and the shift by the place seen.
    for _ in 0..12 {
        let pose = facing(print.point(0.5, 0.5), distance, (shift.x, shift.y), turns);
        let (low, high) = bounds(&pose);
        let seen = high - low;
        let factor = (seen.x / (620.0 * fill)).max(seen.y / (460.0 * fill)).clamp(0.7, 1.4);
        let free = Vector2::new(620.0 - seen.x, 460.0 - seen.y).map(|v| 0.45 * v.max(0.0));
        let wanted = Vector2::new(319.5 + across * free.x, 239.5 + down * free.y);
        shift += (wanted - 0.5 * (low + high)) * (0.9 * distance / interior[0]);
        distance *= factor;
    }
    facing(print.point(0.5, 0.5), distance, (shift.x, shift.y), turns)
}

/// Least distance between any two points of the target; zero when one is outside the photo or the lens has
/// folded there.
fn nearest_points_px(view: &HardView, target: &Target) -> f64 {
    let print = Print::new(target, 0.0);
    let is_seen = |right: f64, down: f64| {
        let p = see(&view.camera, &view.pose, print.point(right, down));
        let inside = p.column > 3.0 && p.row > 3.0 && p.column < 636.0 && p.row < 476.0;
        inside && view.camera.ideal_from_pixel(p).is_some()
    };
    let shares: Vec<f64> = (0..=8).map(|k| f64::from(k) / 8.0).collect();
    if !shares.iter().all(|&s| is_seen(s, 0.0) && is_seen(s, 1.0) && is_seen(0.0, s) && is_seen(1.0, s)) {
        return 0.0;
    }
    let points: Vec<_> = target.points().iter().map(|p| see(&view.camera, &view.pose, p.board)).collect();
    let mut least = f64::INFINITY;
    for (i, p) in points.iter().enumerate() {
        for q in &points[..i] {
            least = least.min(f64::hypot(p.column - q.column, p.row - q.row));
        }
    }
    least
}
