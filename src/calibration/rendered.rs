//! Photos of the target drawn from a known camera and pose, for tests: area sampling, blur, noise.

use super::grey::Grey;
use super::target::{BoardPoint, Observation, SquaresTarget, TargetPoint};
use super::zhang::BoardPose;
use crate::camera::{Brown, ImagePoint};
use crate::units::Radians;
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// Eqs. (6) and (7) of the paper.
pub(super) fn paper_camera() -> Brown {
    Brown::new([743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018])
        .unwrap()
}

/// Board facing the camera, then turned about its middle by the two tilts (degrees) and in its plane.
pub(super) fn pose(
    target: &SquaresTarget,
    distance_m: f64,
    (right_m, down_m): (f64, f64),
    (about_x, about_y, in_plane): (f64, f64, f64),
) -> BoardPose {
    let far = target.corner(target.rows() - 1, target.columns() - 1, 2);
    let middle = Vector3::new(0.5 * far.x_m, 0.5 * far.y_m, 0.0);
    let turn = |axis, degrees: f64| Rotation3::from_axis_angle(&axis, Radians::from_degrees(degrees).get());
    let rotation = turn(Vector3::x_axis(), about_x)
        * turn(Vector3::y_axis(), about_y)
        * turn(Vector3::z_axis(), in_plane);
    let translation = Vector3::new(right_m, down_m, distance_m) - rotation * middle;
    BoardPose { rotation, translation }
}

/// Three views of the paper's target filling 72–87 % of the frame's height, as paper-numbers e) states.
pub(super) fn paper_poses() -> Vec<BoardPose> {
    let target = SquaresTarget::paper();
    vec![
        pose(&target, 0.335, (0.0, -0.008), (25.0, -20.0, 3.0)),
        pose(&target, 0.335, (0.004, -0.008), (-25.0, 20.0, -5.0)),
        pose(&target, 0.335, (0.002, -0.008), (5.0, 30.0, 8.0)),
    ]
}

/// Where the camera sees a point of the board.
pub(super) fn see(brown: &Brown, pose: &BoardPose, board: BoardPoint) -> ImagePoint {
    let p = pose.rotation * Vector3::new(board.x_m, board.y_m, 0.0) + pose.translation;
    brown.project(Vector2::new(p.x / p.z, p.y / p.z)).pixel
}

/// All points of the target in one view, with Gaussian noise per coordinate.
pub(super) fn observe(
    brown: &Brown,
    pose: &BoardPose,
    target: &SquaresTarget,
    noise_px: f64,
    random: &mut ChaCha8Rng,
) -> Vec<Observation> {
    let normal = Normal::new(0.0, noise_px).unwrap();
    target
        .points()
        .into_iter()
        .map(|TargetPoint { board, growth, .. }| {
            let p = see(brown, pose, board);
            let pixel = ImagePoint::new(p.column + normal.sample(random), p.row + normal.sample(random));
            Observation { board, growth, pixel }
        })
        .collect()
}

/// How a photo is drawn.
#[derive(Clone, Copy)]
pub(super) struct Look {
    pub width: usize,
    pub height: usize,
    pub blur_px: f64,
    pub noise: f64,
    /// Brightness at the right border as a share of that at the left one.
    pub light_at_right: f64,
    pub seed: u64,
}

impl Look {
    /// The conditions of the published comparison: noise σ 3 of 255, blur 0.8 px.
    pub const PAPER: Self =
        Self { width: 1152, height: 648, blur_px: 0.8, noise: 3.0, light_at_right: 1.0, seed: 1 };
}

/// A photo of the target on a white sheet over a dark table. The upper left square of a target with a
/// marker is white inside an outline a quarter of its side wide.
pub(super) fn photo(brown: &Brown, pose: &BoardPose, target: &SquaresTarget, look: Look) -> Grey {
    // A rank-1 lattice: edges along pixel rows and columns meet 199 levels, not the 8 of an 8 × 8 grid,
    // whose steps would move drawn edges by up to 1/16 px.
    const SAMPLES: usize = 199;
    const STRIDE: usize = 73;
    let (w, h) = (look.width, look.height);
    let r = pose.rotation.matrix();
    let to_image = Matrix3::from_columns(&[r.column(0).into(), r.column(1).into(), pose.translation]);
    let to_board = to_image.try_inverse().unwrap();
    let pitch = target.side_m() * target.pitch_in_sides();
    let far = target.corner(target.rows() - 1, target.columns() - 1, 2);
    let shade = |ideal: Vector2<f64>| {
        let p = to_board * ideal.push(1.0);
        let (x, y) = (p.x / p.z, p.y / p.z);
        let margin = target.side_m();
        if x < -margin || y < -margin || x > far.x_m + margin || y > far.y_m + margin {
            return 70.0;
        }
        let (c, r) = ((x / pitch).floor(), (y / pitch).floor());
        let (u, v) = ((x - c * pitch) / target.side_m(), (y - r * pitch) / target.side_m());
        let on_target = c >= 0.0 && r >= 0.0 && c < target.columns() as f64 && r < target.rows() as f64;
        if !on_target || u > 1.0 || v > 1.0 {
            return 215.0;
        }
        let hollow = !target.is_used(r as usize, c as usize);
        if hollow && (0.25..0.75).contains(&u) && (0.25..0.75).contains(&v) { 215.0 } else { 30.0 }
    };
    // The lens is inverted at pixel corners and interpolated within pixels.
    let corner = |c: usize, r: usize| brown.ideal_from_pixel(ImagePoint::new(c as f64 - 0.5, r as f64 - 0.5));
    let grid: Vec<Option<Vector2<f64>>> = (0..=h).flat_map(|r| (0..=w).map(move |c| corner(c, r))).collect();
    let mut sharp = vec![0.0_f64; w * h];
    for (i, value) in sharp.iter_mut().enumerate() {
        let at = i / w * (w + 1) + i % w;
        let (Some(a), Some(b), Some(c), Some(d)) =
            (grid[at], grid[at + 1], grid[at + w + 1], grid[at + w + 2])
        else {
            *value = 70.0;
            continue;
        };
        let shades = [a, b, c, d].map(shade);
        let mut sum = 0.0;
        if shades.iter().all(|s| *s == shades[0]) {
            sum = SAMPLES as f64 * shades[0];
        } else {
            for k in 0..SAMPLES {
                let share = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
                let (u, v) = (share(k), share(k * STRIDE % SAMPLES));
                sum += shade((a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v);
            }
        }
        let light = 1.0 + (look.light_at_right - 1.0) * (i % w) as f64 / w as f64;
        *value = light * sum / SAMPLES as f64;
    }
    let blurred = blur(&blur(&sharp, w, h, look.blur_px, true), w, h, look.blur_px, false);
    let mut random = ChaCha8Rng::seed_from_u64(look.seed);
    let noise = Normal::new(0.0, look.noise).unwrap();
    let values = blurred
        .into_iter()
        .map(|v| (v + noise.sample(&mut random)).round().clamp(0.0, 255.0) as f32)
        .collect();
    Grey::new(w, h, values).unwrap()
}

fn blur(values: &[f64], w: usize, h: usize, sigma: f64, across: bool) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as isize;
    let kernel: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let mut out = vec![0.0; w * h];
    for (i, value) in out.iter_mut().enumerate() {
        let (c, r) = ((i % w) as isize, (i / w) as isize);
        for (k, weight) in (-reach..=reach).zip(&kernel) {
            let (c, r) = if across { (c + k, r) } else { (c, r + k) };
            let c = c.clamp(0, w as isize - 1) as usize;
            let r = r.clamp(0, h as isize - 1) as usize;
            *value += weight / total * values[r * w + c];
        }
    }
    out
}
