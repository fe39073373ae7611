//! What the fisheyes share: the image radius is a function of the off-axis angle alone.

use crate::units::Radians;
use nalgebra::{Matrix2x3, Vector2, Vector3};

/// Largest off-axis angle whose tangent is used: beyond it a ray with component 1 along the axis outgrows
/// all arithmetic.
const LARGEST_TANGENT_ANGLE: Radians = Radians::from_degrees(89.0);

/// A point seen by a fisheye: off-axis angle, θ/R and R and distance of the point.
pub(super) struct Polar {
    pub theta: f64,
    /// θ / √(X² + Y²), continued onto the axis; per unit of the point.
    pub theta_by_r: f64,
    r: f64,
    rho: f64,
}

impl Polar {
    /// Of a point in the camera frame; `None` of the camera itself and of the axis behind it.
    #[inline]
    pub fn of(point: &Vector3<f64>) -> Option<Self> {
        let (r, rho) = (point.xy().norm(), point.norm());
        // On the axis in front atan(r/z)/r is 1/z; behind the camera the axis has no one direction.
        if !(rho.is_finite() && rho > 0.0) || (r == 0.0 && point.z < 0.0) {
            return None;
        }
        let theta = r.atan2(point.z);
        let theta_by_r = if r > 1e-8 * rho { theta / r } else { 1.0 / point.z };
        Some(Self { theta, theta_by_r, r, rho })
    }

    /// d(x_d, y_d)/d(X, Y, Z) of (x_d, y_d) = θ `factor`(θ) (X, Y)/R, with `slope` = d(θ factor)/dθ.
    #[inline]
    pub fn derivative(&self, point: &Vector3<f64>, factor: f64, slope: f64) -> Matrix2x3<f64> {
        let Self { theta_by_r, r, rho, .. } = *self;
        let scale = factor * theta_by_r;
        // With u = (X, Y)/R: d(x_d, y_d) = u slope dθ + scale (dX, dY) across u; dθ = (Z dR − R dZ)/ρ².
        let (ux, uy) = if r > 0.0 { (point.x / r, point.y / r) } else { (1.0, 0.0) };
        let along = slope * point.z / (rho * rho);
        let fall = -slope * r / (rho * rho);
        Matrix2x3::new(
            ux * ux * along + uy * uy * scale,
            ux * uy * (along - scale),
            ux * fall,
            ux * uy * (along - scale),
            uy * uy * along + ux * ux * scale,
            uy * fall,
        )
    }
}

/// Unit direction of a distorted point, or `None` where the lens has no inverse.
///
/// - `fold`: off-axis angle at which the image radius turns over, radians.
/// - `polynomial`: image radius by θ, and its derivative, at θ.
#[inline]
pub(super) fn direction(
    distorted: Vector2<f64>,
    fold: f64,
    polynomial: impl Fn(f64) -> (f64, f64),
) -> Option<Vector3<f64>> {
    let radius = distorted.norm();
    let (sin, cos) = angle_from_radius(radius, fold, polynomial)?.sin_cos();
    // On the axis sin θ / θ_d is 1.
    let scale = if radius > 0.0 { sin / radius } else { 1.0 };
    Some(Vector3::new(distorted.x * scale, distorted.y * scale, cos))
}

/// (X/Z, Y/Z) of a direction, or `None` 89° and more off axis.
#[inline]
pub(super) fn ideal(direction: &Vector3<f64>) -> Option<Vector2<f64>> {
    let within = direction.xy().norm().atan2(direction.z) < LARGEST_TANGENT_ANGLE.get();
    within.then(|| direction.xy() / direction.z)
}

/// The angle θ < fold of an image radius: Newton's method between bounds, the radius rising up to the fold.
#[inline]
fn angle_from_radius(radius: f64, fold: f64, polynomial: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
    const ROUNDS: u32 = 100;
    let (mut low, mut high) = (0.0, fold.min(std::f64::consts::PI));
    if radius.is_nan() || radius >= high * polynomial(high).0 {
        return None;
    }
    let mut theta = radius.min(0.5 * high);
    for _ in 0..ROUNDS {
        let (factor, slope) = polynomial(theta);
        let excess = theta * factor - radius;
        if excess > 0.0 {
            high = theta
        } else {
            low = theta
        }
        let newton = theta - excess / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - theta).abs() <= 1e-15 * (1.0 + theta) {
            return Some(next);
        }
        theta = next;
    }
    Some(theta)
}
