//! Interior orientation with the Brown lens: the paper's K and five distortion terms.
//!
//! ```text
//! x = X/Z, y = Y/Z, r² = x² + y²
//! x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
//! y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y
//! column = fx x_d + skew y_d + cx,  row = fy y_d + cy
//! ```
//!
//! # Source
//! Hemerly (2014), eqs. (2)–(4), with k3, k4, k5 of the paper named p1, p2, k3 as Bouguet and OpenCV do,
//! and the squares that eq. (3) lost in print restored (2x², 2y²).

use super::ImagePoint;
use nalgebra::{Matrix2, SMatrix, Vector2};

/// Names of the ten interior parameters in the order of every vector and covariance of them.
pub const INTERIOR_NAMES: [&str; 10] =
    ["fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3"];

/// Covariance of the interior parameters in the order of [`INTERIOR_NAMES`], units squared.
pub type InteriorCovariance = SMatrix<f64, 10, 10>;

/// Why a set of interior parameters is no camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A parameter is NaN or infinite.
    #[error("camera parameter {name} is {value}")]
    NotFinite {
        /// One of [`INTERIOR_NAMES`].
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A focal length is not positive.
    #[error("focal length {name} is {value} px, it must be positive")]
    FocalLength {
        /// `fx_px` or `fy_px`.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// The image has no pixels.
    #[error("camera image size {width} × {height} px has no pixels")]
    EmptyImage {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// Brown's lens over an affine image plane: the ten interior parameters of the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Brown {
    fx: f64,
    fy: f64,
    skew: f64,
    cx: f64,
    cy: f64,
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
    k3: f64,
    /// Square of the ideal radius at which the radial polynomial turns over; infinite when it never does.
    fold_radius_squared: f64,
}

/// A forward projection with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projected {
    /// Where the ray meets the image.
    pub pixel: ImagePoint,
    /// d(column, row) / d(x, y), px per unit of the ideal image plane.
    pub by_ideal: Matrix2<f64>,
    /// d(column, row) / d(interior), columns in the order of [`INTERIOR_NAMES`].
    pub by_interior: SMatrix<f64, 2, 10>,
}

impl Brown {
    /// From the parameters in the order of [`INTERIOR_NAMES`]; lengths in pixels, terms dimensionless.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::FocalLength`].
    pub fn new(interior: [f64; 10]) -> Result<Self, CameraError> {
        for (name, value) in INTERIOR_NAMES.into_iter().zip(interior) {
            if !value.is_finite() {
                return Err(CameraError::NotFinite { name, value });
            }
        }
        let [fx, fy, skew, cx, cy, k1, k2, p1, p2, k3] = interior;
        for (name, value) in [("fx_px", fx), ("fy_px", fy)] {
            if value <= 0.0 {
                return Err(CameraError::FocalLength { name, value });
            }
        }
        let fold_radius_squared = first_fold(k1, k2, k3);
        Ok(Self { fx, fy, skew, cx, cy, k1, k2, p1, p2, k3, fold_radius_squared })
    }

    /// The parameters in the order of [`INTERIOR_NAMES`].
    #[must_use]
    pub const fn interior(&self) -> [f64; 10] {
        [self.fx, self.fy, self.skew, self.cx, self.cy, self.k1, self.k2, self.p1, self.p2, self.k3]
    }

    /// Ideal radius (tangent of the off-axis angle) beyond which the lens folds back; infinite if never.
    #[must_use]
    pub fn fold_radius(&self) -> f64 {
        self.fold_radius_squared.sqrt()
    }

    /// Pixel of the ideal point (x, y), or `None` where the lens has folded back.
    #[must_use]
    pub fn pixel_from_ideal(&self, ideal: Vector2<f64>) -> Option<ImagePoint> {
        let (distorted, jacobian) = self.distort(ideal);
        self.is_single_valued(ideal, &jacobian).then(|| self.pixel_from_distorted(distorted))
    }

    /// Image area per area of the ideal plane, relative to a lens without distortion: 1 on the axis of most
    /// lenses, falling to 0 where the lens folds.
    #[must_use]
    pub fn magnification(&self, ideal: Vector2<f64>) -> f64 {
        self.distort(ideal).1.determinant()
    }

    /// Pixel of the ideal point with derivatives, without asking whether the lens folds there: the
    /// calibration may pass through such points on its way.
    #[must_use]
    pub fn project(&self, ideal: Vector2<f64>) -> Projected {
        let (d, jacobian) = self.distort(ideal);
        let affine = Matrix2::new(self.fx, self.skew, 0.0, self.fy);
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let mut by_interior = SMatrix::<f64, 2, 10>::zeros();
        by_interior[(0, 0)] = d.x;
        by_interior[(1, 1)] = d.y;
        by_interior[(0, 2)] = d.y;
        by_interior[(0, 3)] = 1.0;
        by_interior[(1, 4)] = 1.0;
        let terms = [
            (5, Vector2::new(x * r2, y * r2)),
            (6, Vector2::new(x * r4, y * r4)),
            (7, Vector2::new(2.0 * x * y, r2 + 2.0 * y * y)),
            (8, Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y)),
            (9, Vector2::new(x * r6, y * r6)),
        ];
        for (column, term) in terms {
            by_interior.set_column(column, &(affine * term));
        }
        Projected { pixel: self.pixel_from_distorted(d), by_ideal: affine * jacobian, by_interior }
    }

    /// Ideal point (x, y) = (X/Z, Y/Z) of a pixel, or `None` where the lens has no inverse.
    ///
    /// Newton's method from the undistorted guess; where that leaves the lens's first sheet, the pixel is
    /// approached from the principal point along the image in small steps, so that the answer is always
    /// the one connected to the axis.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: ImagePoint) -> Option<Vector2<f64>> {
        if !(pixel.column.is_finite() && pixel.row.is_finite()) {
            return None;
        }
        let yd = (pixel.row - self.cy) / self.fy;
        let target = Vector2::new((pixel.column - self.cx - self.skew * yd) / self.fx, yd);
        if let Some(ideal) = self.newton(target, target) {
            return Some(ideal);
        }
        const STEPS: u32 = 32;
        let mut ideal = Vector2::zeros();
        for step in 1..=STEPS {
            ideal = self.newton(target * (f64::from(step) / f64::from(STEPS)), ideal)?;
        }
        Some(ideal)
    }

    fn newton(&self, target: Vector2<f64>, start: Vector2<f64>) -> Option<Vector2<f64>> {
        const ROUNDS: u32 = 25;
        const TOLERANCE: f64 = 1e-14;
        let mut ideal = start;
        let (mut distorted, mut jacobian) = self.distort(ideal);
        for _ in 0..ROUNDS {
            if !self.is_single_valued(ideal, &jacobian) {
                return None;
            }
            let step = jacobian.try_inverse()? * (target - distorted);
            ideal += step;
            (distorted, jacobian) = self.distort(ideal);
            if step.norm_squared() < TOLERANCE * TOLERANCE * (1.0 + ideal.norm_squared()) {
                break;
            }
        }
        let reached = (target - distorted).norm() < 1e-10 * (1.0 + target.norm());
        (reached && self.is_single_valued(ideal, &jacobian)).then_some(ideal)
    }

    fn is_single_valued(&self, ideal: Vector2<f64>, jacobian: &Matrix2<f64>) -> bool {
        ideal.norm_squared() < self.fold_radius_squared && jacobian.determinant() > 0.0
    }

    /// Distorted point and d(distorted)/d(ideal).
    fn distort(&self, ideal: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let radial_by_r2 = self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3);
        let distorted = Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        );
        let cross = 2.0 * x * y * radial_by_r2 + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        let jacobian = Matrix2::new(
            radial + 2.0 * x * x * radial_by_r2 + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * radial_by_r2 + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        );
        (distorted, jacobian)
    }

    fn pixel_from_distorted(&self, d: Vector2<f64>) -> ImagePoint {
        ImagePoint::new(self.fx * d.x + self.skew * d.y + self.cx, self.fy * d.y + self.cy)
    }
}

/// Smallest positive root s = r² of d/dr [r (1 + k1 r² + k2 r⁴ + k3 r⁶)] = 1 + 3 k1 s + 5 k2 s² + 7 k3 s³.
fn first_fold(k1: f64, k2: f64, k3: f64) -> f64 {
    let slope = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
    // Between neighbouring turning points of the cubic it is monotone, so one bisection finds the root.
    let (a, b, c) = (21.0 * k3, 10.0 * k2, 3.0 * k1);
    let mut stops: Vec<f64> = if a == 0.0 {
        if b == 0.0 { vec![] } else { vec![-c / b] }
    } else {
        let disc = b * b - 4.0 * a * c;
        if disc < 0.0 {
            vec![]
        } else {
            let q = -0.5 * (b + disc.sqrt().copysign(b));
            if q == 0.0 { vec![0.0] } else { vec![q / a, c / q] }
        }
    };
    // Past s = 1e6 (89.94° off axis) a pinhole-type lens sees nothing.
    const FAR: f64 = 1e6;
    stops.retain(|s| *s > 0.0 && *s < FAR);
    stops.push(FAR);
    stops.sort_by(f64::total_cmp);
    let mut low = 0.0;
    for high in stops {
        if slope(high) <= 0.0 {
            let (mut lo, mut hi) = (low, high);
            for _ in 0..200 {
                let mid = 0.5 * (lo + hi);
                if slope(mid) > 0.0 { lo = mid } else { hi = mid }
            }
            return lo;
        }
        low = high;
    }
    f64::INFINITY
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Eqs. (6) and (7) of the paper.
    fn paper() -> Brown {
        Brown::new([
            743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018,
        ])
        .unwrap()
    }

    #[test]
    fn the_papers_lens_folds_where_the_reference_says() {
        assert!((paper().fold_radius() - 0.9578).abs() < 1e-4, "{}", paper().fold_radius());
    }

    #[test]
    fn the_papers_corner_pixels_have_no_inverse() {
        let camera = paper();
        let invalid = |columns: std::ops::Range<u32>, rows: std::ops::Range<u32>| {
            rows.flat_map(|r| columns.clone().map(move |c| (c, r)))
                .filter(|&(c, r)| {
                    camera.ideal_from_pixel(ImagePoint::new(f64::from(c), f64::from(r))).is_none()
                })
                .count() as i64
        };
        // paper-numbers: upper left, upper right, lower left, lower right, each ±20.
        for (columns, rows, expected) in [
            (0..576, 0..324, 2605_i64),
            (576..1152, 0..324, 2775),
            (0..576, 324..648, 125),
            (576..1152, 324..648, 202),
        ] {
            let found = invalid(columns, rows);
            assert!((found - expected).abs() <= 20, "{found} invalid pixels, {expected} expected");
        }
    }

    #[test]
    fn points_past_the_fold_do_not_reappear_inside_the_frame() {
        assert!(paper().pixel_from_ideal(Vector2::new(0.9, 0.5)).is_none());
        assert!(paper().pixel_from_ideal(Vector2::new(0.5, 0.3)).is_some());
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let mut p = paper().interior();
        p[6] = f64::NAN;
        assert!(Brown::new(p).unwrap_err().to_string().contains("k2"));
        p = paper().interior();
        p[1] = -3.0;
        assert!(matches!(Brown::new(p), Err(CameraError::FocalLength { name: "fy_px", .. })));
    }

    proptest! {
        #[test]
        fn inverse_returns_every_visible_point(
            k1 in -0.4..0.4f64, k2 in -0.3..0.3f64, k3 in -0.3..0.3f64,
            p1 in -0.01..0.01f64, p2 in -0.01..0.01f64, skew in -5.0..5.0f64,
            x in -0.7..0.7f64, y in -0.5..0.5f64,
        ) {
            let camera = Brown::new([800.0, 790.0, skew, 500.0, 400.0, k1, k2, p1, p2, k3]).unwrap();
            let ideal = Vector2::new(x, y);
            if let Some(pixel) = camera.pixel_from_ideal(ideal) {
                // Well inside the first sheet the inverse exists and is the same point.
                if ideal.norm() < 0.9 * camera.fold_radius() {
                    let back = camera.ideal_from_pixel(pixel);
                    prop_assert!(back.is_some_and(|b| (b - ideal).norm() < 1e-8), "{back:?} for {ideal:?}");
                }
            }
        }

        #[test]
        fn jacobians_match_differences(
            k1 in -0.4..0.4f64, k2 in -0.3..0.3f64, k3 in -0.3..0.3f64, p1 in -0.01..0.01f64,
            p2 in -0.01..0.01f64, skew in -5.0..5.0f64, x in -0.5..0.5f64, y in -0.5..0.5f64,
        ) {
            let interior = [800.0, 790.0, skew, 500.0, 400.0, k1, k2, p1, p2, k3];
            let at = |interior: [f64; 10], x: f64, y: f64| {
                let p = Brown::new(interior).unwrap().project(Vector2::new(x, y)).pixel;
                Vector2::new(p.column, p.row)
            };
            let projected = Brown::new(interior).unwrap().project(Vector2::new(x, y));
            let h = 1e-6;
            for k in 0..10 {
                let (mut up, mut down) = (interior, interior);
                up[k] += h;
                down[k] -= h;
                let numeric = (at(up, x, y) - at(down, x, y)) / (2.0 * h);
                prop_assert!((numeric - projected.by_interior.column(k)).norm() < 1e-5);
            }
            let by_x = (at(interior, x + h, y) - at(interior, x - h, y)) / (2.0 * h);
            let by_y = (at(interior, x, y + h) - at(interior, x, y - h)) / (2.0 * h);
            prop_assert!((by_x - projected.by_ideal.column(0)).norm() < 1e-4);
            prop_assert!((by_y - projected.by_ideal.column(1)).norm() < 1e-4);
        }
    }
}
