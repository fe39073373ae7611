//! Dark elliptic areas: what discs look like.

use super::super::areas::{Area, dark_areas};
use crate::calibration::grey::Grey;
use nalgebra::{Matrix2, Vector2};

/// Smallest semi-axis, pixels of the searched image.
const LEAST_SEMI_AXIS_PX: f64 = 1.6;
/// Fewest pixels: below, an area is noise.
const LEAST_PIXELS: usize = 14;
/// A disc takes no more than this share of the image: at least 2 × 2 of them and gaps must fit.
const MOST_SHARE: f64 = 0.16;
/// Discs seen at up to 75° are less oblong than this.
const MOST_OBLONG: f64 = 4.0;
/// Most discs kept, the largest first: bounds the work on photos full of clutter.
const MAX_DISCS: usize = 1500;

/// A dark ellipse.
#[derive(Debug, Clone)]
pub(super) struct Disc {
    /// Middle of the bounding box.
    pub middle: Vector2<f64>,
    /// Centroid.
    pub centre: Vector2<f64>,
    /// Takes offsets from the centre, px, to a plane where the ellipse is the unit circle.
    pub rounding: Matrix2<f64>,
}

impl Disc {
    /// Area, px².
    pub fn area(&self) -> f64 {
        std::f64::consts::PI / self.rounding.determinant()
    }
    /// The disc if the area is an ellipse.
    fn new(area: &Area) -> Option<Self> {
        // Glare may punch holes into a disc; a ring of other things is none.
        if 3 * area.dark < 2 * area.filled {
            return None;
        }
        // A filled ellipse with semi-axes a and b has the moments a²/4 and b²/4.
        let axes = square_root(&(area.covariance * 4.0))?;
        let rounding = axes.try_inverse()?;
        let (long, short) = {
            let half = 0.5 * axes.trace();
            let apart = (half * half - axes.determinant()).max(0.0).sqrt();
            (half + apart, half - apart)
        };
        if short < LEAST_SEMI_AXIS_PX || long > MOST_OBLONG * short {
            return None;
        }
        let disc = Self { middle: area.middle(), centre: area.centre, rounding };
        // Stairs of pixels leave 0.3 px, noise a little more; a square's sides spread by 0.2 of its half side.
        let allowed = 0.09 + 0.45 / short;
        (disc.roughness(area) < allowed.min(0.2)).then_some(disc)
    }
    /// Root mean square distance of the outline from the ellipse, in semi-axes.
    fn roughness(&self, area: &Area) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (row, &(first, last)) in area.rows.iter().enumerate() {
            for column in [first as f64 - 0.5, last as f64 + 0.5] {
                let offset = Vector2::new(column, (area.top + row) as f64) - self.centre;
                sum += ((self.rounding * offset).norm() - 1.0).powi(2);
                count += 1.0;
            }
        }
        f64::sqrt(sum / count)
    }
}

/// All dark ellipses, for one window of the local threshold.
pub(super) fn find_discs(smooth: &Grey, radius: usize, margin: f32) -> Vec<Disc> {
    let dark = smooth.darker_than_surroundings(radius, margin);
    let most = (MOST_SHARE * dark.len() as f64) as usize;
    let mut discs: Vec<Disc> =
        dark_areas(&dark, smooth.width(), LEAST_PIXELS, most).iter().filter_map(Disc::new).collect();
    discs.sort_by(|a, b| b.area().total_cmp(&a.area()));
    discs.truncate(MAX_DISCS);
    discs
}

/// Symmetric square root of a symmetric positive definite matrix.
fn square_root(m: &Matrix2<f64>) -> Option<Matrix2<f64>> {
    let determinant = m.determinant();
    if determinant.is_nan() || determinant <= 0.0 {
        return None;
    }
    let root = determinant.sqrt();
    Some((m + Matrix2::identity() * root) / (m.trace() + 2.0 * root).sqrt())
}
