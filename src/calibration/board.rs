//! The printed board against its drawing: squares too large, pitches unequal, board not flat.
//!
//! ```text
//! x = x₀ + g_x s,  y = (y₀ + g_y s)(1 + a),  z = b_x (1 − x̂²) + b_y (1 − ŷ²)
//! ```
//! s is the excess of the squares' side, a the excess of the pitch down over the pitch across, b_x and b_y the
//! sag of the board's middle along and across, x̂ and ŷ run from −1 to 1 over the board.
//!
//! # Source
//! The two parabolas are those of mrcal's `calobject_warp` (Kogan, mrcal documentation, "Calibration object
//! shape"); Strobl and Hirzinger (2011), "More Accurate Pinhole Camera Calibration with Imperfect Planar
//! Target", free every point instead, which needs far more views for the same certainty.

use super::adjust::Sight;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

/// Number of the board's terms: side, pitch ratio, sag along x, sag along y.
pub(super) const BOARD_TERMS: usize = 4;
pub(super) const SIDE: usize = 0;
pub(super) const PITCH: usize = 1;
pub(super) const SAG_X: usize = 2;
pub(super) const SAG_Y: usize = 3;

/// Middle and half size of the points on the board, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BoardExtent {
    middle: Vector2<f64>,
    half: Vector2<f64>,
}

impl BoardExtent {
    /// Of all points.
    pub fn of<'a>(points: impl Iterator<Item = &'a Vector2<f64>>) -> Self {
        let (low, high) = points
            .fold((Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY)), |(low, high), p| {
                (low.inf(p), high.sup(p))
            });
        Self { middle: (low + high) * 0.5, half: (high - low) * 0.5 }
    }

    /// 1 − x̂² and 1 − ŷ².
    fn arches(&self, sight: &Sight) -> Vector2<f64> {
        let hat = (sight.board - self.middle).component_div(&self.half);
        Vector2::repeat(1.0) - hat.component_mul(&hat)
    }

    /// Where a point is, given the board's terms.
    #[inline]
    pub fn place(&self, sight: &Sight, terms: &[f64; BOARD_TERMS]) -> Vector3<f64> {
        let flat = sight.board + sight.growth * terms[SIDE];
        if terms[SAG_X] == 0.0 && terms[SAG_Y] == 0.0 {
            return Vector3::new(flat.x, flat.y * (1.0 + terms[PITCH]), 0.0);
        }
        let arches = self.arches(sight);
        let sag = terms[SAG_X] * arches.x + terms[SAG_Y] * arches.y;
        Vector3::new(flat.x, flat.y * (1.0 + terms[PITCH]), sag)
    }

    /// Derivative of [`Self::place`] by the terms.
    #[inline]
    pub fn place_by_terms(&self, sight: &Sight, terms: &[f64; BOARD_TERMS]) -> SMatrix<f64, 3, BOARD_TERMS> {
        let arches = self.arches(sight);
        SMatrix::<f64, 3, BOARD_TERMS>::from_columns(&[
            Vector3::new(sight.growth.x, sight.growth.y * (1.0 + terms[PITCH]), 0.0),
            Vector3::new(0.0, sight.board.y + sight.growth.y * terms[SIDE], 0.0),
            Vector3::new(0.0, 0.0, arches.x),
            Vector3::new(0.0, 0.0, arches.y),
        ])
    }
}

/// A quantity with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Its value.
    pub value: f64,
    /// One standard deviation.
    pub std: f64,
}

impl Measured {
    /// True when it differs from zero by more than three standard deviations.
    #[must_use]
    pub fn is_significant(&self) -> bool {
        self.value.abs() > 3.0 * self.std
    }
}

/// How far the board is from flat: a parabola along x and one along y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bend {
    /// Sag of the middle against the left and right border, metres, positive away from the camera.
    pub along_x_m: Measured,
    /// Sag of the middle against the upper and lower border, metres.
    pub along_y_m: Measured,
    /// Probability that a flat board shows this much: the F test of both terms together.
    pub flat_probability: f64,
}

impl Bend {
    /// Distance between the highest and the lowest point of the board, metres.
    #[must_use]
    pub fn depth_m(&self) -> f64 {
        let (x, y) = (self.along_x_m.value, self.along_y_m.value);
        if x * y < 0.0 { x.abs() + y.abs() } else { (x + y).abs() }
    }

    /// True when a flat board would show this much less than once in a thousand times.
    #[must_use]
    pub fn is_significant(&self) -> bool {
        self.flat_probability < 1e-3
    }
}

/// What the photos say about the board. Where a quantity was not estimated with the camera it is the one that
/// a further step would find, each on its own; `None` where the photos cannot tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardShape {
    /// How much larger than declared the squares look, metres.
    pub side_excess_m: Option<Measured>,
    /// How much larger the pitch downwards is than the pitch across, relative: 0.001 is 1 mm in a metre.
    pub pitch_excess: Option<Measured>,
    /// How far the board is from flat.
    pub bend: Option<Bend>,
}

/// Estimates of groups of the board's terms from what their equations are when all else is eliminated.
pub(super) struct BoardEquations {
    /// Equations of the board's terms.
    pub matrix: SMatrix<f64, BOARD_TERMS, BOARD_TERMS>,
    /// Their right-hand side.
    pub right: SVector<f64, BOARD_TERMS>,
    /// Σ weight · ‖residual‖² before the step, px².
    pub cost: f64,
    /// Observed coordinates less parameters.
    pub freedom: f64,
    /// Values at which the equations were set up.
    pub at: [f64; BOARD_TERMS],
    /// Which terms are estimated with the camera.
    pub estimated: [bool; BOARD_TERMS],
    /// Which terms the points can tell at all.
    pub visible: [bool; BOARD_TERMS],
}

impl BoardEquations {
    /// The board's shape.
    pub fn shape(&self) -> BoardShape {
        BoardShape { side_excess_m: self.one(SIDE), pitch_excess: self.one(PITCH), bend: self.bend() }
    }

    /// A term on its own, beside those that are estimated with the camera.
    fn one(&self, term: usize) -> Option<Measured> {
        if !self.visible[term] {
            return None;
        }
        let (step, cofactor, variance) = self.solve(&[term])?;
        let k = term;
        Some(Measured { value: self.at[k] + step[k], std: (cofactor[(k, k)] * variance).sqrt() })
    }

    fn bend(&self) -> Option<Bend> {
        if !(self.visible[SAG_X] && self.visible[SAG_Y]) {
            return None;
        }
        let (step, cofactor, variance) = self.solve(&[SAG_X, SAG_Y])?;
        let sag = Vector2::new(self.at[SAG_X] + step[SAG_X], self.at[SAG_Y] + step[SAG_Y]);
        let block = cofactor.fixed_view::<2, 2>(SAG_X, SAG_X).into_owned();
        let f = 0.5 * sag.dot(&(block.try_inverse()? * sag)) / variance;
        let measured = |k: usize, value| Measured { value, std: (cofactor[(k, k)] * variance).sqrt() };
        Some(Bend {
            along_x_m: measured(SAG_X, sag.x),
            along_y_m: measured(SAG_Y, sag.y),
            // Tail of Fisher's distribution with 2 and `freedom` degrees of freedom, in closed form.
            flat_probability: (1.0 + 2.0 * f / self.freedom).powf(-0.5 * self.freedom),
        })
    }

    /// Step, cofactors and variance of unit weight when the terms in question are estimated beside those that
    /// are anyway.
    fn solve(
        &self,
        terms: &[usize],
    ) -> Option<(SVector<f64, BOARD_TERMS>, SMatrix<f64, BOARD_TERMS, BOARD_TERMS>, f64)> {
        let (mut matrix, mut right) = (self.matrix, self.right);
        let mut added = 0.0;
        for k in 0..BOARD_TERMS {
            let asked = terms.contains(&k);
            if asked && !self.estimated[k] {
                added += 1.0;
            }
            if !(asked || self.estimated[k]) {
                matrix.fill_row(k, 0.0);
                matrix.fill_column(k, 0.0);
                matrix[(k, k)] = 1.0;
                right[k] = 0.0;
            }
        }
        let cofactor = super::adjust::inverse_scaled(matrix)?;
        let step = cofactor * right;
        let variance = (self.cost - step.dot(&right)).max(0.0) / (self.freedom - added).max(1.0);
        (step.iter().all(|s| s.is_finite()) && variance > 0.0).then_some((step, cofactor, variance))
    }
}
