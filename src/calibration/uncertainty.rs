//! How well the calibrated camera projects, over the frame: what the covariance of its parameters means.
//!
//! Standard deviations of single parameters say little, because the parameters make up for each other. What
//! counts is by how much the pixel of a fixed direction moves from one calibration to the next:
//!
//! ```text
//! δpixel = J_interior δ,   cov = J_interior Σ J_interiorᵀ
//! δpixel = (J_interior − J_rotation G) δ,   G = (Σ J_rotᵀ J_rot)⁻¹ Σ J_rotᵀ J_interior
//! ```
//! The second line turns each calibration by the small rotation that brings it closest to the others over the
//! supported part of the frame: a camera is used through a boresight, which takes up just that rotation.
//!
//! # Source
//! Kogan, mrcal documentation, "Projection uncertainty": the spread after the implied rotation, here with the
//! rotation fitted to the frame instead of to the board's poses.

use super::product::{Calibration, View};
use crate::camera::{Camera, ImagePoint, InteriorCovariance, Lens, MAX_INTERIOR};
use nalgebra::{Matrix2, Matrix3, SMatrix, Vector3};

/// Projection uncertainty over a grid of pixels that spans the frame, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct UncertaintyMap {
    /// Columns of the grid.
    pub columns: usize,
    /// Rows of the grid.
    pub rows: usize,
    /// Its nodes.
    pub nodes: Vec<UncertaintyNode>,
}

/// One pixel of the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncertaintyNode {
    /// Where.
    pub pixel: ImagePoint,
    /// Whether the pixel lies within the outline of the target's points in some photo: elsewhere the lens is
    /// extrapolated, and the spread is that of the model, not of the truth.
    pub supported: bool,
    /// The spread; `None` where the lens has no inverse.
    pub spread: Option<ProjectionSpread>,
}

/// Standard deviations in the direction in which they are largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectionSpread {
    /// Of the pixel, the camera's axes being those of the calibration, px.
    pub fixed_axes_px: f64,
    /// Of the pixel after the best common rotation, px.
    pub px: f64,
    /// Of the ground point after the best common rotation, in metres per metre of height of a camera that
    /// looks straight down; `None` 89° and more off axis.
    pub ground_per_height: Option<f64>,
}

impl ProjectionSpread {
    /// On the ground, metres, from a height in metres.
    #[must_use]
    pub fn ground_m(&self, height_m: f64) -> Option<f64> {
        self.ground_per_height.map(|per_height| per_height * height_m)
    }
}

impl UncertaintyMap {
    /// The node nearest to a pixel.
    #[must_use]
    pub fn nearest(&self, pixel: ImagePoint) -> Option<&UncertaintyNode> {
        let square =
            |n: &UncertaintyNode| (n.pixel.column - pixel.column).powi(2) + (n.pixel.row - pixel.row).powi(2);
        self.nodes.iter().min_by(|a, b| square(a).total_cmp(&square(b)))
    }

    /// Share of the nodes that no photo supports.
    #[must_use]
    pub fn unsupported_share(&self) -> f64 {
        let unsupported = self.nodes.iter().filter(|node| !node.supported).count();
        unsupported as f64 / self.nodes.len().max(1) as f64
    }
}

/// The map of a calibration, on a grid of at least 2 × 2 pixels from corner to corner of the frame.
#[must_use]
pub fn projection_uncertainty(calibration: &Calibration, columns: usize, rows: usize) -> UncertaintyMap {
    let covariance = calibration.camera.covariance.unwrap_or_else(InteriorCovariance::zeros);
    let FrameSights { columns, rows, pixels, supported, sights, turn } =
        FrameSights::new(calibration, columns, rows);
    let nodes = pixels
        .into_iter()
        .zip(supported)
        .zip(sights)
        .map(|((pixel, supported), sight)| UncertaintyNode {
            pixel,
            supported,
            spread: sight.map(|sight| sight.spread(&covariance, &turn)),
        })
        .collect();
    UncertaintyMap { columns, rows, nodes }
}

/// What a grid of pixels sees, and the common rotation that is taken out of every change of the camera.
pub(super) struct FrameSights {
    columns: usize,
    rows: usize,
    pixels: Vec<ImagePoint>,
    supported: Vec<bool>,
    sights: Vec<Option<Sight>>,
    turn: TurnByInterior,
}

impl FrameSights {
    /// Over a grid of at least 2 × 2 pixels from corner to corner of the frame.
    pub fn new(calibration: &Calibration, columns: usize, rows: usize) -> Self {
        let (columns, rows) = (columns.max(2), rows.max(2));
        let camera = &calibration.camera;
        let outlines: Vec<Vec<ImagePoint>> = calibration.views.iter().map(outline).collect();
        let pixels: Vec<ImagePoint> = grid(camera, columns, rows).collect();
        let supported: Vec<bool> =
            pixels.iter().map(|pixel| outlines.iter().any(|outline| contains(outline, *pixel))).collect();
        let sights: Vec<Option<Sight>> = pixels.iter().map(|pixel| Sight::of(&camera.lens, *pixel)).collect();
        // A frame that no photo supports anywhere is fitted as a whole.
        let any = supported.contains(&true);
        let fitted = sights.iter().zip(&supported).filter(|(_, s)| **s || !any);
        let turn = common_rotation(fitted.filter_map(|(sight, _)| sight.as_ref()));
        Self { columns, rows, pixels, supported, sights, turn }
    }

    /// Root mean square over the frame of the standard deviation of a projected coordinate, px.
    pub fn rms_px(&self, covariance: &InteriorCovariance) -> f64 {
        let variances = self.sights.iter().flatten().map(|sight| {
            let turned = sight.by_interior - sight.by_rotation * self.turn;
            0.5 * (turned * covariance * turned.transpose()).trace()
        });
        let (sum, count) = variances.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        (sum / f64::max(count, 1.0)).sqrt()
    }
}

/// Pixels of a grid from corner to corner of the frame, row by row.
fn grid(camera: &Camera, columns: usize, rows: usize) -> impl Iterator<Item = ImagePoint> + use<> {
    let at = |k: usize, cells: usize, size: u32| k as f64 / (cells - 1) as f64 * (f64::from(size) - 1.0);
    let (width, height) = (camera.width, camera.height);
    (0..rows).flat_map(move |r| {
        (0..columns).map(move |c| ImagePoint::new(at(c, columns, width), at(r, rows, height)))
    })
}

/// d(parameters) → the rotation that undoes most of what it does to the frame.
type TurnByInterior = SMatrix<f64, 3, MAX_INTERIOR>;

/// What one pixel sees, with derivatives.
struct Sight {
    by_interior: SMatrix<f64, 2, MAX_INTERIOR>,
    /// d(pixel) by a small rotation of the scene about the camera's axes.
    by_rotation: SMatrix<f64, 2, 3>,
    /// d(X/Z, Y/Z) by the pixel, where it has a tangent.
    ideal_by_pixel: Option<Matrix2<f64>>,
}

impl Sight {
    fn of(lens: &Lens, pixel: ImagePoint) -> Option<Self> {
        let direction = lens.direction_from_pixel(pixel)?;
        let projected = lens.project(&direction)?;
        let ideal_by_pixel = lens.ideal_from_pixel(pixel).and_then(|ideal| {
            lens.project(&ideal.push(1.0))?.by_point.fixed_columns::<2>(0).into_owned().try_inverse()
        });
        Some(Self {
            by_interior: projected.by_interior,
            by_rotation: -projected.by_point * direction.cross_matrix(),
            ideal_by_pixel,
        })
    }

    fn spread(&self, covariance: &InteriorCovariance, turn: &TurnByInterior) -> ProjectionSpread {
        let turned = self.by_interior - self.by_rotation * turn;
        let fixed = self.by_interior * covariance * self.by_interior.transpose();
        let free = turned * covariance * turned.transpose();
        ProjectionSpread {
            fixed_axes_px: worst(&fixed),
            px: worst(&free),
            ground_per_height: self
                .ideal_by_pixel
                .map(|by_pixel| worst(&(by_pixel * free * by_pixel.transpose()))),
        }
    }
}

fn common_rotation<'a>(sights: impl Iterator<Item = &'a Sight>) -> TurnByInterior {
    let mut normal = Matrix3::zeros();
    let mut right = TurnByInterior::zeros();
    for sight in sights {
        normal += sight.by_rotation.transpose() * sight.by_rotation;
        right += sight.by_rotation.transpose() * sight.by_interior;
    }
    normal.cholesky().map_or_else(TurnByInterior::zeros, |cholesky| cholesky.solve(&right))
}

/// Square root of the larger eigenvalue.
fn worst(covariance: &Matrix2<f64>) -> f64 {
    let half_sum = 0.5 * covariance.trace();
    let half_difference = 0.5 * (covariance[(0, 0)] - covariance[(1, 1)]);
    (half_sum + half_difference.hypot(covariance[(0, 1)])).max(0.0).sqrt()
}

/// Convex outline of a view's points, counter-clockwise (Andrew's monotone chain).
fn outline(view: &View) -> Vec<ImagePoint> {
    let mut points: Vec<ImagePoint> = view.points.iter().map(|p| p.observed).collect();
    points.sort_by(|a, b| a.column.total_cmp(&b.column).then(a.row.total_cmp(&b.row)));
    let mut outline: Vec<ImagePoint> = Vec::with_capacity(2 * points.len());
    for pass in 0..2 {
        let start = outline.len();
        for &point in &points {
            while outline.len() >= start + 2
                && side(outline[outline.len() - 2], outline[outline.len() - 1], point) <= 0.0
            {
                outline.pop();
            }
            outline.push(point);
        }
        // The last point of each half is the first of the next.
        outline.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    outline
}

fn contains(outline: &[ImagePoint], pixel: ImagePoint) -> bool {
    outline.len() >= 3
        && outline.iter().zip(outline.iter().cycle().skip(1)).all(|(a, b)| side(*a, *b, pixel) >= 0.0)
}

/// Positive when `c` lies to one and the same side of the line from `a` to `b`.
fn side(a: ImagePoint, b: ImagePoint, c: ImagePoint) -> f64 {
    let (ab, ac) = (
        Vector3::new(b.column - a.column, b.row - a.row, 0.0),
        Vector3::new(c.column - a.column, c.row - a.row, 0.0),
    );
    ab.cross(&ac).z
}

#[cfg(test)]
mod tests;
