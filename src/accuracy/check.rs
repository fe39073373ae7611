//! Check points: known places seen in the photos, used only to judge.
//!
//! A residual is `observed − predicted`: where the photo puts the point, minus where it is known to be.

use super::propagation::{FramePropagation, PixelAccuracy, PropagationError};
use crate::camera::ImagePoint;
use crate::geodesy::{Geodetic, LocalTangent, WGS84};
use nalgebra::Vector2;
use std::collections::BTreeMap;

/// Fewer check points than this support no firm statement (ASPRS 2023).
pub const FEW: usize = 30;

/// A place known better than the product under test.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckPoint {
    /// Its name.
    pub name: String,
    /// Where it is, ellipsoidal height.
    pub position: Geodetic,
}

/// Which ground a check point's pixel is brought down to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroundUsed {
    /// The check point's own height: what remains is pose, camera and picking.
    OwnHeight,
    /// The frame's ground, as in the mosaic: its height error takes part.
    FrameGround,
}

/// One check point seen in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// Name of the check point.
    pub point: String,
    /// Name of the frame.
    pub frame: String,
    /// Where it was seen, stored pixel.
    pub pixel: ImagePoint,
    /// Observed − predicted along north, metres.
    pub north_m: f64,
    /// Observed − predicted along east, metres.
    pub east_m: f64,
    /// What the error model claims for this pixel.
    pub claimed: PixelAccuracy,
    /// `rᵀ Σ⁻¹ r`: 2 on average when the claim is honest; `None` when the claim has no spread in some direction.
    pub normalised_squared: Option<f64>,
}

impl Residual {
    /// Horizontal length of the residual, metres.
    #[must_use]
    pub fn radial_m(&self) -> f64 {
        self.north_m.hypot(self.east_m)
    }
}

/// The residual of one observation.
///
/// # Errors
/// As [`FramePropagation::at`].
pub fn residual(
    propagation: &FramePropagation<'_>,
    point: &CheckPoint,
    pixel: ImagePoint,
    ground: GroundUsed,
) -> Result<Residual, PropagationError> {
    let claimed = match ground {
        GroundUsed::OwnHeight => propagation.at_height(pixel, point.position.height.get())?,
        GroundUsed::FrameGround => propagation.at(pixel)?,
    };
    let observed_in_ned = LocalTangent::at(point.position).ecef_from_ned().inverse()
        * WGS84.ecef_from_geodetic(&claimed.ground.position);
    let r = Vector2::new(observed_in_ned.x(), observed_in_ned.y());
    Ok(Residual {
        point: point.name.clone(),
        frame: propagation.frame().name.clone(),
        pixel,
        north_m: r.x,
        east_m: r.y,
        normalised_squared: claimed
            .covariance
            .try_inverse()
            .map(|inverse| (r.transpose() * inverse * r)[(0, 0)]),
        claimed,
    })
}

/// Figures of a set of residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckStatistics {
    /// How many observations.
    pub count: usize,
    /// Mean residual north and east, metres: the bias.
    pub mean_m: [f64; 2],
    /// Root mean square north and east about zero, metres.
    pub rmse_m: [f64; 2],
    /// Root mean square of the radial residual, metres.
    pub rmse_radial_m: f64,
    /// Sample CE90: 90th percentile of the radial residuals, linear between order statistics, metres.
    pub ce90_sample_m: f64,
    /// Sample CEP50: their median, metres.
    pub cep50_sample_m: f64,
    /// Largest radial residual, metres, and which.
    pub worst: (f64, String, String),
    /// Mean of `rᵀ Σ⁻¹ r`, 2 when the claim is honest; over the residuals that have one.
    pub mean_normalised_squared: Option<f64>,
}

impl CheckStatistics {
    /// Figures of residuals; `None` when there are none.
    #[must_use]
    pub fn of<'r>(residuals: impl IntoIterator<Item = &'r Residual>) -> Option<Self> {
        let residuals: Vec<&Residual> = residuals.into_iter().collect();
        let worst = residuals.iter().max_by(|a, b| a.radial_m().total_cmp(&b.radial_m()))?;
        let n = residuals.len() as f64;
        let mean = |f: &dyn Fn(&Residual) -> f64| residuals.iter().map(|r| f(r)).sum::<f64>() / n;
        let mut radial: Vec<f64> = residuals.iter().map(|r| r.radial_m()).collect();
        radial.sort_by(f64::total_cmp);
        let normalised: Vec<f64> = residuals.iter().filter_map(|r| r.normalised_squared).collect();
        Some(Self {
            count: residuals.len(),
            mean_m: [mean(&|r| r.north_m), mean(&|r| r.east_m)],
            rmse_m: [mean(&|r| r.north_m.powi(2)).sqrt(), mean(&|r| r.east_m.powi(2)).sqrt()],
            rmse_radial_m: mean(&|r| r.radial_m().powi(2)).sqrt(),
            ce90_sample_m: percentile(&radial, 0.9),
            cep50_sample_m: percentile(&radial, 0.5),
            worst: (worst.radial_m(), worst.point.clone(), worst.frame.clone()),
            mean_normalised_squared: (!normalised.is_empty())
                .then(|| normalised.iter().sum::<f64>() / normalised.len() as f64),
        })
    }

    /// Too few to support a firm statement.
    #[must_use]
    pub const fn is_few(&self) -> bool {
        self.count < FEW
    }
}

/// Figures by frame, in the order of the frames' names.
#[must_use]
pub fn statistics_by_frame(residuals: &[Residual]) -> BTreeMap<String, CheckStatistics> {
    let mut by_frame: BTreeMap<&str, Vec<&Residual>> = BTreeMap::new();
    for r in residuals {
        by_frame.entry(&r.frame).or_default().push(r);
    }
    by_frame.into_iter().filter_map(|(name, of)| Some((name.to_owned(), CheckStatistics::of(of)?))).collect()
}

/// Percentile of sorted values, linear between order statistics.
fn percentile(sorted: &[f64], level: f64) -> f64 {
    let at = level * (sorted.len() - 1) as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    sorted[low] + (at - at.floor()) * (sorted[high] - sorted[low])
}

#[cfg(test)]
mod tests {
    use super::super::model::{AngleStd, ErrorModel};
    use super::super::scenes;
    use super::*;
    use crate::geometry::{Ned, Point};

    #[test]
    fn a_point_that_lies_elsewhere_leaves_its_offset_behind() {
        let frame = scenes::flight();
        let model =
            ErrorModel { position_std_m: 2.0, attitude_std: AngleStd::equal(1e-3), ..ErrorModel::default() };
        let propagation = FramePropagation::new(&frame, &model).unwrap();
        let pixel = ImagePoint::new(300.0, 400.0);
        let seen = frame.ground_from_pixel(pixel).unwrap().position;
        // Known to lie 3 m south and 4 m west of where the photo puts it: observed − predicted = (+3, +4).
        let known = WGS84.geodetic_from_ecef(
            &(*LocalTangent::at(seen).ecef_from_ned() * Point::<Ned>::new(-3.0, -4.0, 0.0)),
        );
        let point = CheckPoint { name: "P1".to_owned(), position: known.at_height(seen.height.get()) };
        for ground in [GroundUsed::OwnHeight, GroundUsed::FrameGround] {
            let r = residual(&propagation, &point, pixel, ground).unwrap();
            assert!((r.north_m - 3.0).abs() < 1e-4 && (r.east_m - 4.0).abs() < 1e-4, "{r:?}");
            assert!((r.radial_m() - 5.0).abs() < 1e-4);
            let expected = 25.0 / r.claimed.covariance[(0, 0)];
            assert!((r.normalised_squared.unwrap() / expected - 1.0).abs() < 0.1);
        }
        // A wrong height moves the observed point along the view on its own height only.
        let high = CheckPoint { position: seen.at_height(seen.height.get() + 30.0), ..point };
        let own = residual(&propagation, &high, pixel, GroundUsed::OwnHeight).unwrap();
        let ground = residual(&propagation, &high, pixel, GroundUsed::FrameGround).unwrap();
        assert!(own.radial_m() > 5.0 && ground.radial_m() < 0.01, "{own:?} {ground:?}");
    }

    #[test]
    fn statistics_of_known_residuals() {
        let frame = scenes::flight();
        let model = ErrorModel { position_std_m: 2.0, ..ErrorModel::default() };
        let propagation = FramePropagation::new(&frame, &model).unwrap();
        let pixel = ImagePoint::new(300.0, 400.0);
        let claimed = propagation.at(pixel).unwrap();
        let with = |point: &str, north_m: f64, east_m: f64| Residual {
            point: point.to_owned(),
            frame: "a".to_owned(),
            pixel,
            north_m,
            east_m,
            claimed: claimed.clone(),
            normalised_squared: Some(north_m.hypot(east_m).powi(2) / 4.0),
        };
        let residuals: Vec<Residual> =
            vec![with("1", 1.0, 0.0), with("2", -1.0, 0.0), with("3", 0.0, 3.0), with("4", 0.0, 1.0)];
        let s = CheckStatistics::of(&residuals).unwrap();
        assert_eq!((s.count, s.mean_m), (4, [0.0, 1.0]));
        assert!((s.rmse_m[0] - 0.5_f64.sqrt()).abs() < 1e-15);
        assert!((s.rmse_radial_m - 3.0_f64.sqrt()).abs() < 1e-15);
        assert!((s.ce90_sample_m - 2.4).abs() < 1e-12);
        assert_eq!(s.worst.1, "3");
        assert_eq!(s.mean_normalised_squared, Some(0.75));
        assert!(s.is_few());
        assert!(CheckStatistics::of(&[]).is_none());
        assert_eq!(statistics_by_frame(&residuals)["a"], s);
    }
}
