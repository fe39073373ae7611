//! Which parameters a calibration estimates.

use crate::camera::{Interior, LensKind, MAX_INTERIOR};

/// Places in every lens's interior parameters.
pub(super) const FX: usize = 0;
pub(super) const FY: usize = 1;
pub(super) const SKEW: usize = 2;
pub(super) const CX: usize = 3;
pub(super) const CY: usize = 4;
/// The first lens term.
pub(super) const TERMS: usize = 5;

/// What is estimated: a lens, which of its parameters, and what of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensModel {
    /// The lens.
    pub kind: LensKind,
    /// Which interior parameters are estimated, in the order of the lens's names; the others stay where the
    /// model puts them: principal point in the middle of the image, skew and lens terms zero.
    pub free: [bool; MAX_INTERIOR],
    /// fx / fy where it is known; fy alone is then estimated, and fx follows.
    pub aspect: Option<f64>,
    /// Whether the squares' apparent side is estimated along; as declared otherwise. Not part of the camera:
    /// ink spreads and bright paper blooms over the black, which moves all corners of a square in or out.
    pub side: bool,
    /// Whether the board's bend is estimated along; flat otherwise. See [`super::BoardShape`].
    pub bend: bool,
}

impl LensModel {
    /// The paper's model: all ten interior parameters, squares as declared, board flat.
    pub const PAPER: Self = Self::of(LensKind::Brown, &["k1", "k2", "p1", "p2", "k3"]).with_skew(true);
    /// Brown's lens without skew: OpenCV's standard model.
    pub const BROWN: Self = Self::PAPER.with_skew(false);
    /// k1 and k2 only.
    pub const RADIAL2: Self = Self::of(LensKind::Brown, &["k1", "k2"]);
    /// k1, k2, p1 and p2.
    pub const RADIAL2_TANGENTIAL2: Self = Self::of(LensKind::Brown, &["k1", "k2", "p1", "p2"]);
    /// OpenCV's rational lens, without skew.
    pub const RATIONAL: Self =
        Self::of(LensKind::Rational, &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]);
    /// Kannala–Brandt fisheye, without skew.
    pub const FISHEYE: Self = Self::of(LensKind::Fisheye, &["k1", "k2", "k3", "k4"]);

    /// Focal lengths, principal point and these lens terms of a lens; no skew, squares as declared, flat.
    #[must_use]
    pub const fn of(kind: LensKind, terms: &[&str]) -> Self {
        let names = kind.names();
        let mut free = [false; MAX_INTERIOR];
        let mut k = 0;
        while k < names.len() {
            free[k] = k < TERMS && k != SKEW;
            let mut t = 0;
            while k >= TERMS && t < terms.len() {
                free[k] = free[k] || same(names[k], terms[t]);
                t += 1;
            }
            k += 1;
        }
        Self { kind, free, aspect: None, side: false, bend: false }
    }

    /// With or without the skew.
    #[must_use]
    pub const fn with_skew(mut self, skew: bool) -> Self {
        self.free[SKEW] = skew;
        self
    }

    /// With the squares' side estimated along, or not.
    #[must_use]
    pub const fn with_side(mut self, side: bool) -> Self {
        self.side = side;
        self
    }

    /// With the board's bend estimated along, or not.
    #[must_use]
    pub const fn with_bend(mut self, bend: bool) -> Self {
        self.bend = bend;
        self
    }

    /// With fx = `ratio` · fy.
    #[must_use]
    pub const fn with_aspect(mut self, ratio: f64) -> Self {
        self.aspect = Some(ratio);
        self.free[FX] = false;
        self
    }

    /// With the principal point in the middle of the image, or estimated.
    #[must_use]
    pub const fn with_principal_point(mut self, estimated: bool) -> Self {
        self.free[CX] = estimated;
        self.free[CY] = estimated;
        self
    }

    /// Whether the skew is estimated.
    #[must_use]
    pub const fn skew(&self) -> bool {
        self.free[SKEW]
    }

    /// Number of estimated interior parameters.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.free.iter().filter(|free| **free).count()
    }

    /// Short words for it, such as "brown (k1 k2 p1 p2 k3, skew)".
    #[must_use]
    pub fn describe(&self) -> String {
        let names = self.kind.names();
        let mut parts: Vec<&str> = (TERMS..names.len()).filter(|&k| self.free[k]).map(|k| names[k]).collect();
        if parts.is_empty() {
            parts.push("no lens terms");
        }
        let mut text = format!("{} ({}", self.kind.word(), parts.join(" "));
        if self.skew() {
            text.push_str(", skew");
        }
        if self.aspect.is_some() {
            text.push_str(", fixed aspect");
        }
        if !self.free[CX] {
            text.push_str(", fixed principal point");
        }
        text.push(')');
        text
    }

    /// A start with the parameters that are not estimated put where the model wants them.
    pub(super) fn constrained(&self, mut interior: Interior, width: u32, height: u32) -> Interior {
        let middle = |size: u32| 0.5 * (f64::from(size) - 1.0);
        for (k, value) in interior.iter_mut().enumerate().filter(|&(k, _)| !self.free[k]) {
            *value = match k {
                FX | FY => *value,
                CX => middle(width),
                CY => middle(height),
                _ => 0.0,
            };
        }
        if let Some(ratio) = self.aspect {
            interior[FX] = ratio * interior[FY];
        }
        interior
    }
}

/// String equality in constants.
const fn same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut equal = a.len() == b.len();
    let mut i = 0;
    while equal && i < a.len() {
        equal = a[i] == b[i];
        i += 1;
    }
    equal
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_say_what_they_estimate() {
        assert_eq!(LensModel::PAPER.parameters(), 10);
        assert_eq!(LensModel::PAPER.describe(), "brown (k1 k2 p1 p2 k3, skew)");
        assert_eq!(LensModel::RADIAL2.parameters(), 6);
        assert_eq!(LensModel::RATIONAL.parameters(), 12);
        assert_eq!(LensModel::FISHEYE.describe(), "fisheye (k1 k2 k3 k4)");
        let square = LensModel::of(LensKind::Brown, &[]).with_aspect(1.0).with_principal_point(false);
        assert_eq!((square.parameters(), square.describe().contains("fixed aspect")), (1, true));
    }

    #[test]
    fn what_is_not_estimated_stands_where_the_model_puts_it() {
        let model = LensModel::RADIAL2.with_aspect(1.25).with_principal_point(false);
        let start = model.constrained([9.0; MAX_INTERIOR], 101, 51);
        assert_eq!(start[..8], [11.25, 9.0, 0.0, 50.0, 25.0, 9.0, 9.0, 0.0]);
    }
}
