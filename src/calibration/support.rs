//! Where in the frame the lens is supported by points.

use super::product::{Support, View};
use crate::camera::{Camera, ImagePoint};
use crate::units::Radians;
use nalgebra::Vector3;

/// Cells of the frame that points are counted in: columns and rows.
pub(super) const CELLS: (usize, usize) = (8, 6);

/// The cell of a pixel, row by row; `None` outside the frame.
pub(super) fn cell_of(pixel: ImagePoint, width: u32, height: u32) -> Option<usize> {
    let cell = |at: f64, size: u32, cells: usize| {
        let share = (at + 0.5) / f64::from(size);
        (0.0..1.0).contains(&share).then_some((share * cells as f64) as usize)
    };
    Some(cell(pixel.row, height, CELLS.1)? * CELLS.0 + cell(pixel.column, width, CELLS.0)?)
}

/// How far out the lens was seen, and which share of the frame that is.
pub(super) fn support(camera: &Camera, views: &[View]) -> Support {
    const GRID: (u32, u32) = (48, 36);
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let off_axis = |p: &Vector3<f64>| p.xy().norm().atan2(p.z);
    let mut covered = [false; CELLS.0 * CELLS.1];
    let mut max_angle = 0.0_f64;
    for view in views {
        let rotation = view.camera_from_board.rotation.matrix();
        let origin = view.camera_from_board.origin.vector();
        for point in &view.points {
            let p = rotation * Vector3::new(point.board.x_m, point.board.y_m, 0.0) + origin;
            max_angle = max_angle.max(off_axis(&p));
            if let Some(cell) = cell_of(point.observed, camera.width, camera.height) {
                covered[cell] = true;
            }
        }
    }
    let (mut supported, mut folded) = (0_u32, 0_u32);
    for r in 0..GRID.1 {
        for c in 0..GRID.0 {
            let at = |k: u32, cells: u32, size: f64| (f64::from(k) + 0.5) / f64::from(cells) * size - 0.5;
            let pixel = ImagePoint::new(at(c, GRID.0, width), at(r, GRID.1, height));
            match camera.lens.direction_from_pixel(pixel) {
                None => folded += 1,
                Some(direction) if off_axis(&direction) <= max_angle => supported += 1,
                Some(_) => {}
            }
        }
    }
    let cells = f64::from(GRID.0 * GRID.1);
    let quarter_turn = std::f64::consts::FRAC_PI_2;
    Support {
        max_angle: Radians::new(max_angle),
        max_ideal_radius: if max_angle < quarter_turn { max_angle.tan() } else { f64::INFINITY },
        fold_radius: camera.lens.fold_radius(),
        supported_share: f64::from(supported) / cells,
        folded_share: f64::from(folded) / cells,
        covered_cells: covered.iter().filter(|c| **c).count() as f64 / covered.len() as f64,
    }
}
