//! What lies in view of a drawn photo: the print, things around it, things over it.

use crate::calibration::target::{BoardPoint, Ink, Target};
use crate::camera::ImagePoint;
use nalgebra::Vector2;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// The ink of a target, quick to look up.
pub(super) struct Print {
    ink: Vec<Ink>,
    /// Upper left and lower right of all ink, metres.
    from: BoardPoint,
    to: BoardPoint,
    /// Width of the first thing printed, metres.
    unit_m: f64,
    margin_m: f64,
    /// What may cover a point of each cell of a lattice over the ink, the last printed first.
    cells: Vec<Vec<usize>>,
}

impl Print {
    const CELLS: usize = 64;

    pub(super) fn new(target: &Target, margin: f64) -> Self {
        let ink = target.ink();
        let (mut from, mut to) = ink[0].shape.bounds();
        let unit_m = to.x_m - from.x_m;
        for (low, high) in ink.iter().map(|i| i.shape.bounds()) {
            (from.x_m, from.y_m) = (from.x_m.min(low.x_m), from.y_m.min(low.y_m));
            (to.x_m, to.y_m) = (to.x_m.max(high.x_m), to.y_m.max(high.y_m));
        }
        let mut print = Self { ink, from, to, unit_m, margin_m: margin * unit_m, cells: vec![] };
        print.cells = vec![vec![]; Self::CELLS * Self::CELLS];
        for (i, ink) in print.ink.iter().enumerate().rev() {
            let (low, high) = ink.shape.bounds();
            let ((c0, r0), (c1, r1)) = (print.cell(low), print.cell(high));
            for row in r0..=r1 {
                (c0..=c1).for_each(|column| print.cells[row * Self::CELLS + column].push(i));
            }
        }
        print
    }
    fn cell(&self, p: BoardPoint) -> (usize, usize) {
        let index = |share: f64| ((share * Self::CELLS as f64) as usize).min(Self::CELLS - 1);
        (
            index((p.x_m - self.from.x_m) / (self.to.x_m - self.from.x_m)),
            index((p.y_m - self.from.y_m) / (self.to.y_m - self.from.y_m)),
        )
    }
    fn is_within(&self, p: BoardPoint, margin_m: f64) -> bool {
        p.x_m > self.from.x_m - margin_m
            && p.y_m > self.from.y_m - margin_m
            && p.x_m < self.to.x_m + margin_m
            && p.y_m < self.to.y_m + margin_m
    }
    /// On the sheet and too near to the print for clutter.
    pub(super) fn is_near(&self, p: BoardPoint) -> bool {
        self.is_within(p, self.margin_m.min(0.25 * self.unit_m))
    }
    pub(super) fn is_on_sheet(&self, p: BoardPoint) -> bool {
        self.is_within(p, self.margin_m)
    }
    pub(super) fn is_dark(&self, p: BoardPoint) -> bool {
        let (column, row) = self.cell(p);
        let cover = self.cells[row * Self::CELLS + column].iter().map(|&i| self.ink[i]);
        cover.into_iter().find(|ink| ink.shape.contains(p)).is_some_and(|ink| ink.dark)
    }
    /// Point at shares of the print's width and height.
    pub(super) fn point(&self, right: f64, down: f64) -> BoardPoint {
        BoardPoint {
            x_m: self.from.x_m + right * (self.to.x_m - self.from.x_m),
            y_m: self.from.y_m + down * (self.to.y_m - self.from.y_m),
        }
    }
    /// Diagonal, metres.
    pub(super) fn size_m(&self) -> f64 {
        f64::hypot(self.to.x_m - self.from.x_m, self.to.y_m - self.from.y_m)
    }
    /// Area of the print's outline in the photo, px².
    pub(super) fn area_px(&self, see: impl Fn(BoardPoint) -> ImagePoint) -> f64 {
        let [a, b, c, d] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(right, down)| {
            let p = see(self.point(right, down));
            Vector2::new(p.column, p.row)
        });
        0.5 * (c - a).perp(&(d - b)).abs()
    }
}

/// A thing in the photo that is not the target.
pub(super) struct Stray {
    outline: Outline,
    pub(super) brightness: f64,
    /// Over the sheet's margin, not under the sheet.
    pub(super) on_top: bool,
}

enum Outline {
    /// Convex, clockwise as seen; pixels.
    Polygon(Vec<Vector2<f64>>),
    Disc {
        centre: Vector2<f64>,
        radius: f64,
    },
}

impl Stray {
    /// A triangle, quadrilateral or pentagon, or a stroke at least 2 px wide.
    pub(super) fn clutter(width: usize, height: usize, random: &mut ChaCha8Rng) -> Self {
        let centre =
            Vector2::new(random.random_range(0.0..width as f64), random.random_range(0.0..height as f64));
        let size = width as f64 * random.random_range(0.01..0.12);
        let turn: f64 = random.random_range(0.0..std::f64::consts::TAU);
        let points = if random.random_bool(0.3) {
            let (along, across) =
                (Vector2::new(turn.cos(), turn.sin()), Vector2::new(-turn.sin(), turn.cos()));
            let (length, half) = (3.0 * size, random.random_range(1.0..4.0));
            [(-length, -half), (length, -half), (length, half), (-length, half)]
                .map(|(u, v)| centre + along * u + across * v)
                .to_vec()
        } else {
            let count = random.random_range(3..6_usize);
            (0..count)
                .map(|k| {
                    let angle = turn + k as f64 * std::f64::consts::TAU / count as f64;
                    centre + size * Vector2::new(angle.cos(), angle.sin())
                })
                .collect()
        };
        let brightness = random.random_range(5.0..250.0);
        Self { outline: Outline::Polygon(points), brightness, on_top: random.random_bool(0.5) }
    }
    /// A disc of any brightness.
    pub(super) fn disc(centre: ImagePoint, radius: f64, random: &mut ChaCha8Rng) -> Self {
        let centre = Vector2::new(centre.column, centre.row);
        let brightness = random.random_range(5.0..250.0);
        Self { outline: Outline::Disc { centre, radius }, brightness, on_top: true }
    }
    pub(super) fn contains(&self, p: Vector2<f64>) -> bool {
        match &self.outline {
            Outline::Polygon(points) => {
                let next = points.iter().cycle().skip(1);
                points.iter().zip(next).all(|(a, b)| (b - a).perp(&(p - a)) >= 0.0)
            }
            Outline::Disc { centre, radius } => (p - centre).norm_squared() < radius * radius,
        }
    }
}
