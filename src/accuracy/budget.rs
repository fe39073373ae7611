//! The paper's error budget, eq. (11): the ADAHRS' own circular error and what attitude and height add.

use super::circular::CircularError;
use super::model::{ErrorModel, Source};
use super::propagation::{FramePropagation, PixelAccuracy, PropagationError};
use crate::camera::ImagePoint;
use crate::geodesy::Geodetic;
use crate::georeference::GeoreferencedFrame;

/// Sources of `ε` that turn the camera.
pub const ATTITUDE: [Source; 4] = [Source::Yaw, Source::Pitch, Source::Roll, Source::Gimbal];
/// Sources of `ε` that change the height above ground.
pub const HEIGHTS: [Source; 2] = [Source::Height, Source::GroundHeight];

/// The budget at one pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct BudgetPoint {
    /// "image centre", "upper left corner", …
    pub place: String,
    /// The stored pixel.
    pub pixel: ImagePoint,
    /// Ground point.
    pub position: Geodetic,
    /// `ε` from attitude alone: CEP50, metres.
    pub epsilon_attitude_m: f64,
    /// `ε` from attitude and heights: CEP50, metres.
    pub epsilon_m: f64,
    /// Eq. (11) as printed: CEP50 of the position plus `ε`, metres.
    pub linear_m: f64,
    /// The same two added as independent errors: root of the sum of squares, metres.
    pub quadrature_m: f64,
    /// CEP50 of position, attitude and heights together, exact for unequal sigmas, metres.
    pub cep50_m: f64,
    /// CEP50 under the whole error model, metres.
    pub full_cep50_m: f64,
    /// CE90 under the whole error model, metres.
    pub full_ce90_m: f64,
    /// The 1σ ellipse under the whole error model.
    pub full: PixelAccuracy,
}

/// Eq. (11) over a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Budget {
    /// Name of the frame.
    pub frame: String,
    /// Circular error of the antenna's position, CEP50, metres.
    pub position_cep50_m: f64,
    /// How far from the image centre the corners were taken: 1 is the middle of the corner pixel.
    pub corner_fraction: f64,
    /// Image centre, then upper left, upper right, lower right, lower left.
    pub points: Vec<BudgetPoint>,
    /// Corners without a budget, with the reason.
    pub missing: Vec<(String, PropagationError)>,
}

/// The part of a pixel's covariance that some sources cause, as CEP50; 0 where they cause none.
fn cep50_from(
    at: &PixelAccuracy,
    propagation: &FramePropagation<'_>,
    sources: &[Source],
) -> Result<f64, CircularError> {
    let covariance = sources.iter().map(|source| propagation.covariance_from(*source, &at.jacobian)).sum();
    match super::circular::ErrorEllipse::of(&covariance)?.radius_of(0.5) {
        Err(CircularError::NoSpread) => Ok(0.0),
        other => other,
    }
}

/// Eq. (11) at one pixel.
///
/// # Errors
/// As [`FramePropagation::at`].
///
/// # Source
/// Hemerly (2014), eq. (11), `CEP_GEOREF = CEP_ADAHRS + ε`. Independent errors add as squares: that sum and
/// the exact circular error stand beside the printed linear one.
pub fn budget_at(
    propagation: &FramePropagation<'_>,
    place: &str,
    pixel: ImagePoint,
) -> Result<BudgetPoint, PropagationError> {
    let at = propagation.at(pixel)?;
    let with = |groups: &[&[Source]]| cep50_from(&at, propagation, &groups.concat());
    let position = with(&[&[Source::Position]])?;
    let epsilon_attitude_m = with(&[&ATTITUDE])?;
    let epsilon_m = with(&[&ATTITUDE, &HEIGHTS])?;
    let everything = [&Source::ALL[..]];
    let full_ce90_m = match at.ce90_m() {
        Err(CircularError::NoSpread) => 0.0,
        other => other?,
    };
    Ok(BudgetPoint {
        place: place.to_owned(),
        pixel,
        position: at.ground.position,
        epsilon_attitude_m,
        epsilon_m,
        linear_m: position + epsilon_m,
        quadrature_m: position.hypot(epsilon_m),
        cep50_m: with(&[&[Source::Position], &ATTITUDE, &HEIGHTS])?,
        full_cep50_m: with(&everything)?,
        full_ce90_m,
        full: at,
    })
}

/// The pixel that stands for the middle of a frame: the image centre, or the nearest pixel to it that sees
/// ground; with its name.
#[must_use]
pub fn centre(frame: &GeoreferencedFrame) -> (&'static str, ImagePoint) {
    let centre = frame.image_centre();
    match frame.footprint.anchor {
        Some(anchor) if anchor.pixel != centre => {
            ("nearest pixel to the image centre that sees ground", anchor.pixel)
        }
        _ => ("image centre", centre),
    }
}

/// The stored pixels of the four corners, `fraction` of the way from the image centre to the centre of
/// each corner pixel: upper left, upper right, lower right, lower left.
#[must_use]
pub fn corners(frame: &GeoreferencedFrame, fraction: f64) -> [(&'static str, ImagePoint); 4] {
    let (w, h) = frame.stored_size();
    let centre = frame.image_centre();
    let (half_width, half_height) = (0.5 * (f64::from(w) - 1.0), 0.5 * (f64::from(h) - 1.0));
    [
        ("upper left", -1.0, -1.0),
        ("upper right", 1.0, -1.0),
        ("lower right", 1.0, 1.0),
        ("lower left", -1.0, 1.0),
    ]
    .map(|(name, right, down)| {
        (
            name,
            ImagePoint::new(
                centre.column + right * fraction * half_width,
                centre.row + down * fraction * half_height,
            ),
        )
    })
}

/// How far out all four corners see ground: 1, or the next tenth below where the lens folds back or the
/// horizon is in view; 0.9 is the paper's frame.
#[must_use]
pub fn corner_fraction(frame: &GeoreferencedFrame) -> Option<f64> {
    (1..=10).rev().map(|tenths| f64::from(tenths) / 10.0).find(|fraction| {
        corners(frame, *fraction).iter().all(|(_, pixel)| frame.ground_from_pixel(*pixel).is_ok())
    })
}

/// Eq. (11) at the centre and the corners of a frame.
///
/// Where a corner pixel has no inverse lens or no ground, all four are taken nearer to the centre, by the
/// fraction the result states.
///
/// # Errors
/// As [`FramePropagation::new`]; and as [`FramePropagation::at`] for the image centre.
pub fn budget(frame: &GeoreferencedFrame, model: &ErrorModel) -> Result<Budget, PropagationError> {
    let propagation = FramePropagation::new(frame, model)?;
    let (place, anchor) = centre(frame);
    let mut points = vec![budget_at(&propagation, place, anchor)?];
    let mut missing = Vec::new();
    // Without any common fraction the full corners are asked, so that the reasons are on record.
    let fraction = corner_fraction(frame).unwrap_or(1.0);
    for (name, pixel) in corners(frame, fraction) {
        match budget_at(&propagation, name, pixel) {
            Ok(point) => points.push(point),
            Err(reason) => missing.push((name.to_owned(), reason)),
        }
    }
    Ok(Budget {
        frame: frame.name.clone(),
        position_cep50_m: super::circular::CEP50_PER_SIGMA * model.position_std_m,
        corner_fraction: fraction,
        points,
        missing,
    })
}
