//! Photos of targets drawn from a known camera and pose, for tests: area sampling, light, clutter, blur, noise.

pub(super) mod hard;
mod print;

pub(super) use hard::{hard_renders, hard_seeds};

use super::grey::Grey;
use super::target::{BoardPoint, Observation, SquaresTarget, Target, TargetPoint};
use super::zhang::BoardPose;
use crate::camera::{Brown, ImagePoint};
use crate::units::Radians;
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use print::{Print, Stray};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// Any picture: dark and light blocks of random places, `coarse` pixels wide, with noise. Blocks make quadrilaterals,
/// crossings and blobs of all kinds likely.
///
/// - `dark`: share of the blocks that are dark.
pub(super) fn any_blocks(width: usize, height: usize, seed: u64, coarse: usize, dark: f64) -> Grey {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let side = width.max(height);
    let blocks: Vec<f32> =
        (0..side * side).map(|_| if random.random_bool(dark) { 20.0 } else { 230.0 }).collect();
    let values = (0..width * height)
        .map(|i| blocks[i / width / coarse * side + i % width / coarse] + random.random_range(-9.0..9.0))
        .collect();
    Grey::new(width, height, values).unwrap()
}

/// Eqs. (6) and (7) of the paper.
pub(super) fn paper_camera() -> Brown {
    Brown::new([743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018])
        .unwrap()
}

/// Board facing the camera, then turned about its middle by the two tilts (degrees) and in its plane.
pub(super) fn pose(
    target: &SquaresTarget,
    distance_m: f64,
    shift_m: (f64, f64),
    turns: (f64, f64, f64),
) -> BoardPose {
    let far = target.corner(target.rows() - 1, target.columns() - 1, 2);
    facing(BoardPoint { x_m: 0.5 * far.x_m, y_m: 0.5 * far.y_m }, distance_m, shift_m, turns)
}

/// The same about any point of the board.
pub(super) fn facing(
    middle: BoardPoint,
    distance_m: f64,
    (right_m, down_m): (f64, f64),
    (about_x, about_y, in_plane): (f64, f64, f64),
) -> BoardPose {
    let middle = Vector3::new(middle.x_m, middle.y_m, 0.0);
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

/// How a photo is drawn. Brightness runs from 0 to 255.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    pub width: usize,
    pub height: usize,
    pub blur_px: f64,
    /// Standard deviation of a pixel's brightness.
    pub noise: f64,
    /// Brightness at the right border as a share of that at the left one.
    pub light_at_right: f64,
    /// Brightness at the lower border as a share of that at the upper one.
    pub light_at_bottom: f64,
    /// Share of the brightness that is lost in the corners of the photo.
    pub vignetting: f64,
    /// Exponent on the brightness as a share of 255, after the blur.
    pub gamma: f64,
    /// Brightness added in the middle of a spot somewhere on the print.
    pub glare: f64,
    /// Width of the light sheet around the print, in widths of the first thing printed.
    pub margin: f64,
    /// Brightness range of the table's pattern.
    pub texture: f64,
    /// Dark and light polygons and strokes around the print, up to a quarter of such a width from it.
    pub clutter: usize,
    /// Discs over the print.
    pub occluders: usize,
    /// Share of the print's area that one of them hides at most.
    pub hidden: f64,
    pub seed: u64,
}

impl Look {
    /// The conditions of the published comparison: noise σ 3 of 255, blur 0.8 px.
    pub const PAPER: Self = Self {
        width: 1152,
        height: 648,
        blur_px: 0.8,
        noise: 3.0,
        light_at_right: 1.0,
        light_at_bottom: 1.0,
        vignetting: 0.0,
        gamma: 1.0,
        glare: 0.0,
        margin: 1.0,
        texture: 0.0,
        clutter: 0,
        occluders: 0,
        hidden: 0.0,
        seed: 1,
    };
}

const TABLE: f64 = 70.0;
const SHEET: f64 = 215.0;
const INK: f64 = 30.0;

/// A photo of the target on a light sheet over a dark table.
pub(super) fn photo(brown: &Brown, pose: &BoardPose, target: &Target, look: Look) -> Grey {
    let mut random = ChaCha8Rng::seed_from_u64(look.seed);
    let scene = Scene::new(brown, pose, target, look, &mut random);
    let mut sharp = scene.sampled(&scene.pixel_corners(brown));
    scene.light(&mut sharp);
    let (w, h) = (look.width, look.height);
    let blurred = blur(&blur(&sharp, w, h, look.blur_px, 1), w, h, look.blur_px, w);
    let noise = Normal::new(0.0, look.noise).unwrap();
    let values = blurred
        .into_iter()
        .map(|v| {
            let seen = 255.0 * (v / 255.0).clamp(0.0, 1.0).powf(look.gamma);
            (seen + noise.sample(&mut random)).round().clamp(0.0, 255.0) as f32
        })
        .collect();
    Grey::new(w, h, values).unwrap()
}

/// Everything in view, before the lens blurs it.
struct Scene {
    look: Look,
    print: Print,
    board_from_ideal: Matrix3<f64>,
    /// Under the sheet, or over its margin.
    clutter: Vec<Stray>,
    /// Over everything.
    occluders: Vec<Stray>,
    glare: ImagePoint,
    /// Brightness of a coarse lattice of points of the table, 0–1.
    pattern: Vec<f64>,
}

impl Scene {
    const PATTERN_SIZE: usize = 64;

    fn new(brown: &Brown, pose: &BoardPose, target: &Target, look: Look, random: &mut ChaCha8Rng) -> Self {
        let r = pose.rotation.matrix();
        let ideal_from_board =
            Matrix3::from_columns(&[r.column(0).into(), r.column(1).into(), pose.translation]);
        let print = Print::new(target, look.margin);
        let on_print = |random: &mut ChaCha8Rng| {
            let p = print.point(random.random(), random.random());
            see(brown, pose, p)
        };
        let clutter = (0..look.clutter).map(|_| Stray::clutter(look.width, look.height, random)).collect();
        let area = print.area_px(|p| see(brown, pose, p));
        let occluders = (0..look.occluders)
            .map(|_| {
                let share = look.hidden * random.random_range(0.2..1.0);
                Stray::disc(on_print(random), (share * area / std::f64::consts::PI).sqrt(), random)
            })
            .collect();
        let glare = on_print(random);
        let pattern = (0..Self::PATTERN_SIZE * Self::PATTERN_SIZE).map(|_| random.random()).collect();
        let board_from_ideal = ideal_from_board.try_inverse().unwrap();
        Self { look, print, board_from_ideal, clutter, occluders, glare, pattern }
    }

    /// Ideal points of the corners of all pixels, row by row, one more than there are pixels each way.
    fn pixel_corners(&self, brown: &Brown) -> Vec<Option<Vector2<f64>>> {
        let (w, h) = (self.look.width, self.look.height);
        let corner =
            |c: usize, r: usize| brown.ideal_from_pixel(ImagePoint::new(c as f64 - 0.5, r as f64 - 0.5));
        (0..=h).flat_map(|r| (0..=w).map(move |c| corner(c, r))).collect()
    }

    /// Mean brightness of every pixel; the lens is interpolated within pixels.
    fn sampled(&self, corners: &[Option<Vector2<f64>>]) -> Vec<f64> {
        // A rank-1 lattice: edges along pixel rows and columns meet 199 levels, not the 8 of an 8 × 8 grid,
        // whose steps would move drawn edges by up to 1/16 px.
        const SAMPLES: usize = 199;
        const STRIDE: usize = 73;
        let (w, h) = (self.look.width, self.look.height);
        let mut sharp = vec![TABLE; w * h];
        for (i, value) in sharp.iter_mut().enumerate() {
            let (column, row) = ((i % w) as f64, (i / w) as f64);
            let at = i / w * (w + 1) + i % w;
            let (Some(a), Some(b), Some(c), Some(d)) =
                (corners[at], corners[at + 1], corners[at + w + 1], corners[at + w + 2])
            else {
                continue;
            };
            let sample = |u: f64, v: f64| {
                let ideal = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v;
                self.shade(ideal, Vector2::new(column + u - 0.5, row + v - 0.5))
            };
            let shades = [sample(0.0, 0.0), sample(1.0, 0.0), sample(0.0, 1.0), sample(1.0, 1.0)];
            *value = if shades.iter().all(|s| *s == shades[0]) {
                shades[0]
            } else {
                let share = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
                let sum: f64 = (0..SAMPLES).map(|k| sample(share(k), share(k * STRIDE % SAMPLES))).sum();
                sum / SAMPLES as f64
            };
            if *value == TABLE {
                *value += self.look.texture * (self.pattern_at(column, row) - 0.5);
            }
        }
        sharp
    }

    fn shade(&self, ideal: Vector2<f64>, pixel: Vector2<f64>) -> f64 {
        if let Some(stray) = self.occluders.iter().find(|s| s.contains(pixel)) {
            return stray.brightness;
        }
        let p = self.board_from_ideal * ideal.push(1.0);
        let board = BoardPoint { x_m: p.x / p.z, y_m: p.y / p.z };
        if p.z > 0.0 && self.print.is_near(board) {
            return if self.print.is_dark(board) { INK } else { SHEET };
        }
        let stray = self.clutter.iter().rfind(|s| s.contains(pixel));
        let ground = if p.z > 0.0 && self.print.is_on_sheet(board) { SHEET } else { TABLE };
        stray.filter(|s| s.on_top || ground == TABLE).map_or(ground, |s| s.brightness)
    }

    /// Bilinear between random values 9 px apart.
    fn pattern_at(&self, column: f64, row: f64) -> f64 {
        let (x, y) = (column / 9.0, row / 9.0);
        let at = |c: f64, r: f64| {
            self.pattern
                [r as usize % Self::PATTERN_SIZE * Self::PATTERN_SIZE + c as usize % Self::PATTERN_SIZE]
        };
        let (c, r) = (x.floor(), y.floor());
        let (u, v) = (x - c, y - r);
        (at(c, r) * (1.0 - u) + at(c + 1.0, r) * u) * (1.0 - v)
            + (at(c, r + 1.0) * (1.0 - u) + at(c + 1.0, r + 1.0) * u) * v
    }

    /// Uneven light, vignetting and glare.
    fn light(&self, sharp: &mut [f64]) {
        let look = &self.look;
        let (w, h) = (look.width as f64, look.height as f64);
        let spot = 0.1 * w;
        for (i, value) in sharp.iter_mut().enumerate() {
            let (x, y) = ((i % look.width) as f64, (i / look.width) as f64);
            let (u, v) = (2.0 * x / w - 1.0, 2.0 * y / h - 1.0);
            let even =
                (1.0 + (look.light_at_right - 1.0) * x / w) * (1.0 + (look.light_at_bottom - 1.0) * y / h);
            *value *= even * (1.0 - 0.5 * look.vignetting * (u * u + v * v));
            if look.glare > 0.0 {
                let away = f64::hypot(x - self.glare.column, y - self.glare.row) / spot;
                *value += look.glare * (-0.5 * away * away).exp();
            }
        }
    }
}

/// Gaussian blur along the pixels that are `stride` apart.
fn blur(values: &[f64], w: usize, h: usize, sigma: f64, stride: usize) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as isize;
    let kernel: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let length = if stride == 1 { w } else { h } as isize;
    let mut out = vec![0.0; w * h];
    for (i, value) in out.iter_mut().enumerate() {
        let along = (if stride == 1 { i % w } else { i / w }) as isize;
        let start = i - along as usize * stride;
        *value = (-reach..=reach)
            .zip(&kernel)
            .map(|(k, weight)| weight * values[start + (along + k).clamp(0, length - 1) as usize * stride])
            .sum::<f64>()
            / total;
    }
    out
}
