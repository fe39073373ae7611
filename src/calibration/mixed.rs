//! Photos of more than one camera, or of one at several zooms: each view's own focal length.

use super::product::View;
use crate::camera::Lens;
use nalgebra::{SMatrix, SVector, Vector3};

/// Views that agree among themselves on a focal length that the others contradict.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mixture {
    /// Names of the photos with the shorter focal length.
    pub shorter: Vec<String>,
    /// Names of those with the longer one.
    pub longer: Vec<String>,
    /// Longest over shortest focal length.
    pub ratio: f64,
}

/// The focal length of one view against the common one, and how much of the view's squared residuals it
/// explains.
struct Own {
    scale: f64,
    gain_px2: f64,
}

/// Two groups of views by focal length, when that is what the residuals come from.
///
/// Giving every view its own focal length has to explain three quarters of all squared residuals, the focal
/// lengths have to differ by more than 3 %, and to fall into two groups with a gap between them of at least half
/// of that difference: a wrong lens model makes them vary over the frame, without a gap.
pub(super) fn mixture(lens: &Lens, views: &[View]) -> Option<Mixture> {
    const EXPLAINED: f64 = 0.75;
    const LEAST_RATIO: f64 = 1.03;
    const LEAST_GAP: f64 = 0.5;
    let own: Vec<Own> = views.iter().map(|view| own_focal_length(lens, view)).collect::<Option<_>>()?;
    let total: f64 = views.iter().flat_map(|v| &v.points).map(|p| p.distance_px().powi(2)).sum();
    let gain: f64 = own.iter().map(|own| own.gain_px2).sum();
    let mut scales: Vec<f64> = own.iter().map(|own| own.scale).collect();
    scales.sort_by(f64::total_cmp);
    let (&low, &high) = scales.first().zip(scales.last())?;
    let gap = scales.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))?;
    let apart = gap[1] - gap[0] > LEAST_GAP * (high - low);
    if !(gain > EXPLAINED * total && low > 0.0 && high > LEAST_RATIO * low && apart) {
        return None;
    }
    let names = |longer: bool| {
        let of = views.iter().zip(&own).filter(|(_, own)| (own.scale > gap[0]) == longer);
        of.map(|(view, _)| view.name.clone()).collect()
    };
    Some(Mixture { shorter: names(false), longer: names(true), ratio: high / low })
}

/// One Gauss–Newton step of a view's pose and of a factor on its focal lengths.
fn own_focal_length(lens: &Lens, view: &View) -> Option<Own> {
    let [fx, fy, skew, ..] = lens.interior();
    let rotation = view.camera_from_board.rotation.matrix();
    let origin = view.camera_from_board.origin.vector();
    let mut normal = SMatrix::<f64, 7, 7>::zeros();
    let mut right = SVector::<f64, 7>::zeros();
    for point in &view.points {
        let rotated = rotation * Vector3::new(point.board.x_m, point.board.y_m, 0.0);
        let projected = lens.project(&(rotated + origin))?;
        let by_scale = projected.by_interior.column(0) * fx
            + projected.by_interior.column(1) * fy
            + projected.by_interior.column(2) * skew;
        let turn = -projected.by_point * rotated.cross_matrix();
        let residual =
            [point.observed.column - point.predicted.column, point.observed.row - point.predicted.row];
        for axis in 0..2 {
            let mut row = SVector::<f64, 7>::zeros();
            for k in 0..3 {
                row[k] = turn[(axis, k)];
                row[3 + k] = projected.by_point[(axis, k)];
            }
            row[6] = by_scale[axis];
            normal += row * row.transpose();
            right += row * residual[axis];
        }
    }
    let step = super::adjust::inverse_scaled(normal)? * right;
    Some(Own { scale: 1.0 + step[6], gain_px2: step.dot(&right) })
}
