//! Observed points of a chessboard-like lattice from a known camera of any lens, for tests.

use super::product::ViewPoints;
use super::target::{BoardPoint, Observation};
use super::zhang::BoardPose;
use crate::camera::{ImagePoint, Lens};
use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// A lattice of points and the camera that sees it.
pub(super) struct Scene {
    pub lens: Lens,
    pub noise_px: f64,
    pub columns: usize,
    pub rows: usize,
    pub pitch_m: f64,
    /// Sag of the board's middle along x and y, metres.
    pub sag_m: [f64; 2],
    /// Pitch down over pitch across.
    pub pitch_ratio: f64,
}

impl Scene {
    /// 12 × 9 points 30 mm apart on a flat board, for a camera of 1152 × 648 pixels.
    pub fn new(lens: impl Into<Lens>, noise_px: f64) -> Self {
        Self {
            lens: lens.into(),
            noise_px,
            columns: 12,
            rows: 9,
            pitch_m: 0.03,
            sag_m: [0.0; 2],
            pitch_ratio: 1.0,
        }
    }

    fn middle(&self) -> Vector3<f64> {
        let half = |n: usize| 0.5 * (n - 1) as f64 * self.pitch_m;
        Vector3::new(half(self.columns), half(self.rows), 0.0)
    }

    /// Board whose middle stands at `middle_m` in the camera, turned by a rotation vector.
    pub fn pose(&self, middle_m: Vector3<f64>, turn: Vector3<f64>) -> BoardPose {
        let rotation = Rotation3::new(turn);
        BoardPose { rotation, translation: middle_m - rotation * self.middle() }
    }

    /// The points within the frame, with noise.
    pub fn view(&self, name: &str, pose: &BoardPose, random: &mut ChaCha8Rng) -> ViewPoints {
        let normal = Normal::new(0.0, self.noise_px).unwrap();
        let middle = self.middle();
        let observations = (0..self.rows * self.columns)
            .filter_map(|i| {
                let (x, y) =
                    ((i % self.columns) as f64 * self.pitch_m, (i / self.columns) as f64 * self.pitch_m);
                let arch = |at: f64, middle: f64| 1.0 - ((at - middle) / middle).powi(2);
                let sag = self.sag_m[0] * arch(x, middle.x) + self.sag_m[1] * arch(y, middle.y);
                let p = pose.rotation * Vector3::new(x, y * self.pitch_ratio, sag) + pose.translation;
                let exact = self.lens.pixel_from_point(&p)?;
                let pixel =
                    ImagePoint::new(exact.column + normal.sample(random), exact.row + normal.sample(random));
                let seen = (0.0..1151.0).contains(&pixel.column) && (0.0..647.0).contains(&pixel.row);
                let still = BoardPoint { x_m: 0.0, y_m: 0.0 };
                seen.then_some(Observation { board: BoardPoint { x_m: x, y_m: y }, growth: still, pixel })
            })
            .collect();
        ViewPoints { name: name.to_owned(), observations }
    }
}

/// Views from all sides, over the whole frame.
pub(super) fn around(scene: &Scene, count: usize, seed: u64) -> Vec<ViewPoints> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count)
        .map(|k| {
            let cell = |k: usize| (k % 3) as f64 - 1.0;
            let pixel = ImagePoint::new(576.0 + 230.0 * cell(k), 324.0 + 110.0 * cell(k / 3 + k / 9));
            let direction = scene.lens.direction_from_pixel(pixel).unwrap().normalize();
            let mut jitter = |size: f64| size * random.random_range(-1.0..1.0);
            let side = [(0.5, 0.1), (-0.5, 0.0), (0.1, 0.5), (0.0, -0.5)][k % 4];
            let turn = Vector3::new(side.0 + jitter(0.1), side.1 + jitter(0.1), jitter(0.8));
            let pose = scene.pose(direction * (0.45 + jitter(0.05)), turn);
            scene.view(&format!("view {}", k + 1), &pose, &mut random)
        })
        .collect()
}
