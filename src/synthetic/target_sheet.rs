//! Photos of the paper's calibration target, with the true pixel of every corner.
//!
//! The pattern is 7 × 7 black squares of 15.7 mm with 15.7 mm between them, on white paper. The upper left square
//! is hollow: black outside, white inside a border of a fifth of its side. Target coordinates are millimetres, x right
//! and y down from the hollow square's upper left corner.
//!
//! # Source
//! Hemerly, section 2: 48 full squares give 192 corners per photo.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Unit, Vector2, Vector3};
use rand::prelude::*;
use rand_chacha::ChaCha8Rng;

use super::lens::Lens;
use super::noise::fractal;
use super::scenario::{Camera, Scenario};
use super::stream;

const SQUARES: u32 = 7;
const SIDE_MM: f64 = 15.7;
const PITCH_MM: f64 = 2.0 * SIDE_MM;
const PATTERN_MM: f64 = SIDE_MM * (2 * SQUARES - 1) as f64;
/// White paper around the pattern.
const MARGIN_MM: f64 = 1.3 * SIDE_MM;
/// Border of the hollow square as a part of its side.
const HOLLOW_BORDER: f64 = 0.2;
/// Corners stay this far inside the frame, pixels.
const CLEAR_PX: f64 = 14.0;

/// One corner of the target: where it is and where the camera sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetCorner {
    /// Row and column of its square in the pattern, from 0 at the hollow one.
    pub square_row: u32,
    pub square_column: u32,
    /// 0 to 3: upper left, upper right, lower right, lower left of the square.
    pub corner: u32,
    /// Target coordinates, millimetres.
    pub x_mm: f64,
    pub y_mm: f64,
    /// True pixel; (0, 0) is the centre of the top-left pixel.
    pub column: f64,
    pub row: f64,
}

/// One calibration photo's pose: `camera_from_target` and the target's origin in camera axes, millimetres.
pub(super) struct View {
    pub camera_from_target: Matrix3<f64>,
    pub origin_in_camera_mm: Vector3<f64>,
    light: Vector2<f64>,
}

impl View {
    /// Views differ in the direction of their tilt by the golden angle and step through tilt and fill; each shifts
    /// the target to another part of the frame as far as it stays inside.
    pub fn new(scenario: &Scenario, lens: &Lens, index: u32) -> Self {
        let (photos, camera) = (&scenario.calibration, &scenario.camera);
        let mut random = ChaCha8Rng::seed_from_u64(scenario.seed);
        random.set_stream(stream::VIEWS + u64::from(index));
        let part = |step: u32| ((f64::from(index * step) + 0.5) / f64::from(photos.views.max(1))).fract();
        let tilt = (photos.tilt_deg[0] + (photos.tilt_deg[1] - photos.tilt_deg[0]) * part(1)).to_radians();
        let fill = photos.fill[0] + (photos.fill[1] - photos.fill[0]) * part(5);
        let azimuth = f64::from(index) * 2.399_963 + random.random_range(-0.3..0.3);
        let turn = random.random_range(-0.35..0.35);
        let axis = Unit::new_normalize(Vector3::new(azimuth.cos(), azimuth.sin(), 0.0));
        let camera_from_target =
            nalgebra::Rotation3::from_axis_angle(&axis, tilt).into_inner() * super::earth::rotation_z(turn);
        let middle = Vector2::new(
            (0.5 * f64::from(camera.width_px) - 0.5 - camera.cx_px) / camera.fx_px,
            (0.5 * f64::from(camera.height_px) - 0.5 - camera.cy_px) / camera.fy_px,
        );
        let aside =
            Vector2::new((f64::from(index) * 2.1 + 0.6).cos() * 0.42, (f64::from(index) * 1.3).sin() * 0.15);
        let light_angle = random.random_range(0.0..TAU);
        let light = Vector2::new(light_angle.cos(), light_angle.sin());
        let mut view = Self { camera_from_target, origin_in_camera_mm: Vector3::zeros(), light };
        let mut shift = 1.0;
        loop {
            view.place(&scenario.camera, middle + aside * shift, fill);
            if shift < 0.02 || view.is_inside(lens) {
                return view;
            }
            shift *= 0.85;
        }
    }

    /// Puts the pattern's centre on a ray at the distance where the pattern fills its part of the frame's height.
    fn place(&mut self, camera: &Camera, ray: Vector2<f64>, fill: f64) {
        let centre_in_target = Vector3::new(0.5 * PATTERN_MM, 0.5 * PATTERN_MM, 0.0);
        let (mut near, mut far) = (PATTERN_MM, 1000.0 * PATTERN_MM);
        for _ in 0..60 {
            let distance = 0.5 * (near + far);
            self.origin_in_camera_mm =
                Vector3::new(ray.x, ray.y, 1.0) * distance - self.camera_from_target * centre_in_target;
            let rows = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
                .map(|(x, y)| self.ideal(Vector2::new(x, y) * PATTERN_MM).y * camera.fy_px);
            let spread =
                rows.into_iter().fold(f64::MIN, f64::max) - rows.into_iter().fold(f64::MAX, f64::min);
            if spread > fill * f64::from(camera.height_px) { near = distance } else { far = distance }
        }
    }

    fn is_inside(&self, lens: &Lens) -> bool {
        let camera = lens.camera();
        (0..=20).all(|step| {
            let along = PATTERN_MM * f64::from(step) / 20.0;
            [(along, 0.0), (along, PATTERN_MM), (0.0, along), (PATTERN_MM, along)].into_iter().all(
                |(x, y)| {
                    let ideal = self.ideal(Vector2::new(x, y));
                    let pixel = lens.pixel_from_ideal(ideal);
                    lens.is_well_inside(ideal)
                        && pixel.x > CLEAR_PX
                        && pixel.x < f64::from(camera.width_px) - 1.0 - CLEAR_PX
                        && pixel.y > CLEAR_PX
                        && pixel.y < f64::from(camera.height_px) - 1.0 - CLEAR_PX
                },
            )
        })
    }

    /// Ideal image coordinates of a target point.
    pub fn ideal(&self, at_mm: Vector2<f64>) -> Vector2<f64> {
        let point = self.origin_in_camera_mm + self.camera_from_target * Vector3::new(at_mm.x, at_mm.y, 0.0);
        point.xy() / point.z
    }

    /// The target point on a ray, millimetres; `None` where the ray misses the target's plane.
    pub fn target_from_ideal(&self, ideal: Vector2<f64>) -> Option<Vector2<f64>> {
        let normal = self.camera_from_target.column(2);
        let ray = Vector3::new(ideal.x, ideal.y, 1.0);
        let distance = normal.dot(&self.origin_in_camera_mm) / normal.dot(&ray);
        (distance > 0.0 && distance.is_finite())
            .then(|| (self.camera_from_target.transpose() * (ray * distance - self.origin_in_camera_mm)).xy())
    }

    /// The 192 corners of the full squares, squares row by row.
    pub fn corners(&self, lens: &Lens) -> Vec<TargetCorner> {
        let mut corners = Vec::with_capacity(192);
        for square_row in 0..SQUARES {
            for square_column in 0..SQUARES {
                if (square_row, square_column) == (0, 0) {
                    continue;
                }
                for (corner, (dx, dy)) in
                    [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].into_iter().enumerate()
                {
                    let at = Vector2::new(
                        f64::from(square_column) * PITCH_MM + dx * SIDE_MM,
                        f64::from(square_row) * PITCH_MM + dy * SIDE_MM,
                    );
                    let pixel = lens.pixel_from_ideal(self.ideal(at));
                    corners.push(TargetCorner {
                        square_row,
                        square_column,
                        corner: corner as u32,
                        x_mm: at.x,
                        y_mm: at.y,
                        column: pixel.x,
                        row: pixel.y,
                    });
                }
            }
        }
        corners
    }

    /// Whether an edge of pattern or paper may lie within `reach_mm`.
    pub fn has_edge(at_mm: Vector2<f64>, reach_mm: f64) -> bool {
        let sheet = (at_mm.add_scalar(-0.5 * PATTERN_MM)).abs().max() - 0.5 * PATTERN_MM - MARGIN_MM;
        let line = |v: f64| {
            let within = v.rem_euclid(PITCH_MM);
            within < reach_mm || (within - SIDE_MM).abs() < reach_mm || PITCH_MM - within < reach_mm
        };
        let hollow = at_mm.abs().max() < SIDE_MM;
        sheet.abs() < reach_mm || (sheet < 0.0 && (hollow || line(at_mm.x) || line(at_mm.y)))
    }

    /// Brightness at a target point, in [0, 1], with ideal hard edges on the paper.
    pub fn brightness(&self, at_mm: Vector2<f64>, footprint_mm: f64) -> f64 {
        let centred = at_mm.add_scalar(-0.5 * PATTERN_MM) / PATTERN_MM;
        let falloff = 1.0 + 0.05 * centred.dot(&self.light);
        let paper = at_mm.iter().all(|v| (-MARGIN_MM..=PATTERN_MM + MARGIN_MM).contains(v));
        if !paper {
            // A desk with a faint grain, far from black and white alike.
            let grain = fractal(17, at_mm.x / 6.0, at_mm.y, 12.0, 4, footprint_mm);
            let broad = fractal(18, at_mm.x, at_mm.y, 220.0, 2, footprint_mm);
            return (0.50 + 0.04 * grain + 0.05 * broad) * falloff.clamp(0.8, 1.2);
        }
        let within = at_mm.map(|v| v.rem_euclid(PITCH_MM));
        let inside = at_mm.iter().all(|v| (0.0..=PATTERN_MM).contains(v)) && within.max() < SIDE_MM;
        let border = HOLLOW_BORDER * SIDE_MM;
        let hollow = at_mm.max() < SIDE_MM && at_mm.min() > border && at_mm.max() < SIDE_MM - border;
        let ink = if inside && !hollow { 1.0 } else { 0.0 };
        (0.86 - 0.76 * ink) * falloff
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_view_is_tilted_as_asked_and_lies_inside_the_frame() {
        let scenario = Scenario::demo();
        let lens = Lens::new(&scenario.camera);
        for index in 0..scenario.calibration.views {
            let view = View::new(&scenario, &lens, index);
            assert!(view.is_inside(&lens), "view {index}");
            let tilt = view.camera_from_target[(2, 2)].acos().to_degrees();
            assert!((15.0..=45.0).contains(&tilt), "{tilt}");
            let corners = view.corners(&lens);
            assert_eq!(corners.len(), 192);
            let rows = corners.iter().map(|corner| corner.row);
            let height = rows.clone().fold(f64::MIN, f64::max) - rows.fold(f64::MAX, f64::min);
            assert!((0.5..0.9).contains(&(height / 648.0)), "view {index} fills {height} rows");
        }
    }

    #[test]
    fn corners_and_plane_intersection_are_inverse() {
        let scenario = Scenario::demo();
        let lens = Lens::new(&scenario.camera);
        let view = View::new(&scenario, &lens, 2);
        for corner in view.corners(&lens) {
            let ideal = lens.ideal_from_pixel(corner.column, corner.row).unwrap();
            let back = view.target_from_ideal(ideal).unwrap();
            assert!((back - Vector2::new(corner.x_mm, corner.y_mm)).norm() < 1e-6);
        }
    }

    #[test]
    fn the_pattern_has_a_hollow_first_square() {
        let scenario = Scenario::demo();
        let view = View::new(&scenario, &Lens::new(&scenario.camera), 0);
        let black = |x: f64, y: f64| view.brightness(Vector2::new(x, y), 0.1) < 0.2;
        assert!(black(1.0, 1.0) && black(14.9, 7.0) && !black(7.85, 7.85) && !black(3.5, 3.5));
        assert!(black(PITCH_MM + 7.85, 7.85) && !black(SIDE_MM + 7.85, 7.85) && !black(-5.0, 40.0));
        assert!(black(PATTERN_MM - 1.0, PATTERN_MM - 1.0) && !black(PATTERN_MM + 1.0, PATTERN_MM - 1.0));
    }
}
