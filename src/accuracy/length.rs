//! Recovery of a known length from two picked pixels, with its interval.

use super::circular::{self, CircularError};
use super::model::{PARAMETERS, ParameterCovariance, Persistence, Source};
use super::propagation::{FramePropagation, PixelAccuracy, PropagationError};
use crate::camera::{ImagePoint, MAX_INTERIOR};
use crate::geodesy::{Geodetic, LocalTangent, WGS84};
use crate::units::{Metres, Radians};
use nalgebra::{Matrix1, RowSVector, Vector2};

/// One end of a length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PickedPixel {
    /// Stored pixel.
    pub pixel: ImagePoint,
    /// Ellipsoidal ground height there, when known better than the frame's ground, metres.
    pub height_m: Option<f64>,
}

/// A recovered horizontal length.
#[derive(Debug, Clone, PartialEq)]
pub struct RecoveredLength {
    /// Ground points of both ends.
    pub ends: [Geodetic; 2],
    /// Horizontal distance between them, at their mean height, metres.
    pub length_m: f64,
    /// Azimuth from the first to the second, clockwise from true north.
    pub azimuth: Radians,
    /// 1σ of the length, metres.
    pub std_m: f64,
    /// Variance of the length by source, in the order of [`Source::ALL`], m².
    pub variance_by_source: [f64; Source::ALL.len()],
}

impl RecoveredLength {
    /// The interval that holds the true length with probability `confidence`, metres.
    ///
    /// # Errors
    /// [`CircularError::Level`] when that is not a probability.
    pub fn interval_m(&self, confidence: f64) -> Result<[f64; 2], CircularError> {
        // A circular error without a second axis is the one-dimensional normal.
        let reach = self.std_m * circular::radius_of(confidence, 1.0, 0.0)?;
        Ok([self.length_m - reach, self.length_m + reach])
    }

    /// Deviation from a known length in units of σ: `(recovered − known) / σ`.
    ///
    /// # Errors
    /// [`CircularError::NoSpread`] when the model gives the length no spread.
    pub fn z_score(&self, known_m: f64) -> Result<f64, CircularError> {
        if self.std_m > 0.0 {
            Ok((self.length_m - known_m) / self.std_m)
        } else {
            Err(CircularError::NoSpread)
        }
    }
}

/// Recovers the horizontal length between two pixels of one frame or of two.
///
/// Errors are shared as [`Source::persistence`] says: within one frame both ends move with the same pose, so
/// only their difference counts; two frames have their own poses but one boresight, camera and ground.
///
/// # Errors
/// As [`FramePropagation::at`], for either end.
pub fn recover(
    first: (&FramePropagation<'_>, PickedPixel),
    second: (&FramePropagation<'_>, PickedPixel),
) -> Result<RecoveredLength, PropagationError> {
    let locate = |(propagation, pick): (&FramePropagation<'_>, PickedPixel)| match pick.height_m {
        Some(height) => propagation.at_height(pick.pixel, height),
        None => propagation.at(pick.pixel),
    };
    let (from, to) = (locate(first)?, locate(second)?);
    let same_frame =
        std::ptr::eq(first.0.frame(), second.0.frame()) || first.0.frame().name == second.0.frame().name;
    let middle = middle_of(&from, &to);
    let ned_from_ecef = LocalTangent::at(middle).ecef_from_ned().inverse();
    let span = ned_from_ecef
        * (WGS84.ecef_from_geodetic(&to.ground.position) - WGS84.ecef_from_geodetic(&from.ground.position));
    let horizontal = Vector2::new(span.x(), span.y());
    let length_m = horizontal.norm();
    // Two ends on one point have no direction; any will do for the spread of a zero length.
    let along = if length_m > 0.0 { horizontal / length_m } else { Vector2::x() };
    let [at_from, at_to] = [&from, &to].map(|end| along.transpose() * end.jacobian);
    let mut variance_by_source = [0.0; Source::ALL.len()];
    for (source, variance) in Source::ALL.into_iter().zip(&mut variance_by_source) {
        let shared = match source.persistence() {
            Persistence::Pixel => false,
            Persistence::Frame => same_frame,
            Persistence::Survey => true,
        };
        let of = |row: RowSVector<f64, PARAMETERS>, end: &FramePropagation<'_>| {
            variance_from(source, &row, end.parameters())
        };
        *variance =
            if shared { of(at_to - at_from, first.0) } else { of(at_to, second.0) + of(at_from, first.0) };
    }
    let std_m = variance_by_source.iter().sum::<f64>().max(0.0).sqrt();
    Ok(RecoveredLength {
        ends: [from.ground.position, to.ground.position],
        length_m,
        azimuth: Radians::new(span.y().atan2(span.x()).rem_euclid(std::f64::consts::TAU)),
        std_m,
        variance_by_source,
    })
}

/// The point between two ends, at their mean height.
fn middle_of(from: &PixelAccuracy, to: &PixelAccuracy) -> Geodetic {
    let (a, b) =
        (WGS84.ecef_from_geodetic(&from.ground.position), WGS84.ecef_from_geodetic(&to.ground.position));
    let mut middle = WGS84.geodetic_from_ecef(&(a + (b - a) * 0.5));
    // The chord's middle lies below the surface by the Earth's bulge.
    middle.height = Metres::new(0.5 * (from.ground.position.height.get() + to.ground.position.height.get()));
    middle
}

fn variance_from(source: Source, row: &RowSVector<f64, PARAMETERS>, parameters: &ParameterCovariance) -> f64 {
    let independent: f64 = source.parameters().map(|k| (row[k] * parameters.std[k]).powi(2)).sum();
    match (source, &parameters.interior) {
        (Source::Interior, Some(interior)) => {
            let columns = row.fixed_columns::<MAX_INTERIOR>(Source::Interior.parameters().start);
            let variance: Matrix1<f64> = columns * interior * columns.transpose();
            independent + variance[(0, 0)]
        }
        _ => independent,
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::{AngleStd, ErrorModel};
    use super::super::scenes;
    use super::*;

    fn pick(column: f64, row: f64) -> PickedPixel {
        PickedPixel { pixel: ImagePoint::new(column, row), height_m: None }
    }

    #[test]
    fn two_frames_share_the_boresight_but_not_the_pose() {
        let frame = scenes::flight();
        let mut other = frame.clone();
        other.name = "IMG_0002.jpg".to_owned();
        let ends = (pick(200.0, 300.0), pick(900.0, 320.0));
        let std = |model: &ErrorModel, second: &crate::georeference::GeoreferencedFrame| {
            let a = FramePropagation::new(&frame, model).unwrap();
            let b = FramePropagation::new(second, model).unwrap();
            recover((&a, ends.0), (&b, ends.1)).unwrap().std_m
        };
        let position = ErrorModel { position_std_m: 2.0, ..ErrorModel::default() };
        assert!(std(&position, &frame) < 1e-3, "one pose moves both ends alike");
        assert!((std(&position, &other) - 8.0_f64.sqrt()).abs() < 1e-3, "two poses differ");
        let boresight = ErrorModel { boresight_std: AngleStd::equal(1e-2), ..ErrorModel::default() };
        assert!((std(&boresight, &frame) - std(&boresight, &other)).abs() < 1e-12);
    }

    #[test]
    fn a_length_is_the_horizontal_distance_whatever_the_order() {
        let frame = scenes::flight();
        let model = ErrorModel { height_std_m: 5.0, ..ErrorModel::default() };
        let p = FramePropagation::new(&frame, &model).unwrap();
        let there = recover((&p, pick(200.0, 300.0)), (&p, pick(900.0, 320.0))).unwrap();
        let back = recover((&p, pick(900.0, 320.0)), (&p, pick(200.0, 300.0))).unwrap();
        assert!((there.length_m - back.length_m).abs() < 1e-9);
        assert!((there.std_m - back.std_m).abs() < 1e-9);
        let turned = (there.azimuth.degrees() - back.azimuth.degrees()).abs();
        assert!((turned - 180.0).abs() < 1e-9);
        assert!((there.z_score(there.length_m + there.std_m).unwrap() + 1.0).abs() < 1e-12);
        let [low, high] = there.interval_m(0.95).unwrap();
        assert!((high - low - 2.0 * 1.959_963_985 * there.std_m).abs() < 1e-8);
        let same = recover((&p, pick(500.0, 300.0)), (&p, pick(500.0, 300.0))).unwrap();
        assert_eq!(same.length_m, 0.0);
        assert!(same.z_score(1.0).is_err());
    }
}
