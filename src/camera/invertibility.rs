//! Whether every pixel of the frame has exactly one viewing ray: a proof, or the pixels that have none.
//!
//! Where the symmetric part of a lens's derivative on the ideal plane is positive definite on a disc, no two of
//! the disc's points share a pixel, for (D(a) − D(b))·(a − b) is the integral of a positive form along the
//! way from b to a; without a prism the derivative is symmetric itself. And where the image of the disc's rim stays outside the frame, while a pixel inside the
//! frame has its ray in the disc, the whole frame is covered: it is connected and cannot cross the rim's
//! image. Both are shown with intervals, box by box and arc by arc, so that rounding cannot fake them. Of a
//! fisheye the radius alone has to rise, up to the farthest corner of the frame: its affine plane is regular by
//! construction.

use super::ImagePoint;
use super::interval::Interval;
use super::lens::Lens;
use super::sensor::Camera;
use crate::units::Radians;
use nalgebra::Vector2;

/// What is known about the inverse of a camera's lens over its frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Invertibility {
    /// Every pixel has exactly one ray within this off-axis angle: proved.
    Proved {
        /// Off-axis angle up to which the lens is proved not to fold.
        to: Radians,
    },
    /// Not every pixel has a ray, or the proof did not come to an end.
    Unproved {
        /// Samples over the frame that have no inverse.
        mask: FoldMask,
    },
}

/// A grid of samples over the frame, and whether each has an inverse.
#[derive(Debug, Clone, PartialEq)]
pub struct FoldMask {
    /// Distance of neighbouring samples, px.
    pub step_px: u32,
    /// Columns of samples.
    pub columns: usize,
    /// Rows of samples.
    pub rows: usize,
    /// Row by row: true where the lens has folded back.
    pub folded: Vec<bool>,
}

impl FoldMask {
    /// Share of the samples without inverse.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.folded.iter().filter(|folded| **folded).count() as f64 / self.folded.len().max(1) as f64
    }
}

impl Camera {
    /// Proves that every pixel has exactly one ray, or says which have none.
    #[must_use]
    pub fn invertibility(&self) -> Invertibility {
        let proved = match &self.lens {
            Lens::Fisheye(lens) => {
                let [.., k1, k2, k3, k4] = lens.interior();
                self.prove_angular(&AngularLens {
                    factor: [1.0, k1, k2, k3, k4],
                    slope: [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4],
                    variable: Interval::square,
                })
            }
            Lens::Pix4dFisheye(lens) => {
                let [[f0, f1, f2, f3], [s0, s1, s2, s3]] = lens.terms();
                self.prove_angular(&AngularLens {
                    factor: [f0, f1, f2, f3, 0.0],
                    slope: [s0, s1, s2, s3, 0.0],
                    variable: |theta| theta,
                })
            }
            Lens::Brown(lens) => {
                let [.., k1, k2, p1, p2, k3] = lens.interior();
                let (above, below) = ([1.0, k1, k2, k3], [1.0, 0.0, 0.0, 0.0]);
                self.prove_plane(&PlaneLens { above, below, p1, p2, prism: None })
            }
            Lens::Rational(lens) => {
                let [.., k1, k2, p1, p2, k3, k4, k5, k6] = lens.interior();
                let (above, below) = ([1.0, k1, k2, k3], [1.0, k4, k5, k6]);
                self.prove_plane(&PlaneLens { above, below, p1, p2, prism: None })
            }
            Lens::ThinPrism(lens) => {
                let [.., k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = lens.interior();
                let (above, below) = ([1.0, k1, k2, k3], [1.0, k4, k5, k6]);
                self.prove_plane(&PlaneLens { above, below, p1, p2, prism: Some([s1, s2, s3, s4]) })
            }
        };
        proved.map_or_else(
            || Invertibility::Unproved { mask: self.fold_mask() },
            |to| Invertibility::Proved { to },
        )
    }

    fn fold_mask(&self) -> FoldMask {
        const SAMPLES: f64 = 250_000.0;
        let pixels = f64::from(self.width) * f64::from(self.height);
        let step_px = (pixels / SAMPLES).sqrt().ceil().max(1.0) as u32;
        let (columns, rows) = (self.width.div_ceil(step_px), self.height.div_ceil(step_px));
        let folded = (0..rows)
            .flat_map(|r| (0..columns).map(move |c| (c, r)))
            .map(|(c, r)| {
                let pixel = ImagePoint::new(f64::from(c * step_px), f64::from(r * step_px));
                self.lens.direction_from_pixel(pixel).is_none()
            })
            .collect();
        FoldMask { step_px, columns: columns as usize, rows: rows as usize, folded }
    }

    /// The frame's corners, half a pixel beyond the outermost pixel centres.
    fn corners(&self) -> [ImagePoint; 4] {
        let (right, bottom) = (f64::from(self.width) - 0.5, f64::from(self.height) - 0.5);
        [(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)].map(|(c, r)| ImagePoint::new(c, r))
    }

    fn prove_angular(&self, lens: &AngularLens) -> Option<Radians> {
        // In the distorted plane the frame is a parallelogram: its farthest point is a corner. The margin is far
        // above the rounding of the affine map's inverse.
        let reach =
            |corner: &ImagePoint| self.lens.distorted_from_pixel(*corner).map_or(f64::NAN, |d| d.norm());
        let farthest = self.corners().into_iter().max_by(|a, b| reach(a).total_cmp(&reach(b)))?;
        let radius = reach(&farthest) * (1.0 + 1e-11);
        // The angle whose image lies just outside the farthest corner.
        let direction = self.lens.direction_from_pixel(farthest)?;
        let theta = direction.xy().norm().atan2(direction.z) * (1.0 + 1e-9);
        let variable = (lens.variable)(Interval::exactly(theta));
        let covers = (Interval::exactly(theta) * variable.polynomial(&lens.factor)).low > radius;
        let rises = everywhere(Interval::new(0.0, variable.high), &|t| t.polynomial(&lens.slope).low > 0.0);
        (covers && rises && theta < std::f64::consts::PI).then(|| Radians::new(theta))
    }

    fn prove_plane(&self, lens: &PlaneLens) -> Option<Radians> {
        // Room for the rim's image to clear the frame.
        const MARGINS: [f64; 3] = [1.001, 1.01, 1.05];
        let centre = self.lens.ideal_from_pixel(self.image_centre())?;
        let needed = self.border_radius()?;
        let radius = MARGINS.into_iter().map(|margin| margin * needed).find(|&radius| {
            centre.norm() < radius && lens.is_one_to_one(radius) && self.rim_is_outside(lens, radius)
        })?;
        Some(Radians::new(radius.atan()))
    }

    /// Largest ideal radius along the frame's border; `None` when a border pixel has no inverse.
    fn border_radius(&self) -> Option<f64> {
        const SAMPLES: u32 = 64;
        let corners = self.corners();
        let mut largest = 0.0_f64;
        for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
            for k in 0..SAMPLES {
                let t = f64::from(k) / f64::from(SAMPLES);
                let pixel = ImagePoint::new(
                    from.column + t * (to.column - from.column),
                    from.row + t * (to.row - from.row),
                );
                largest = largest.max(self.lens.ideal_from_pixel(pixel)?.norm());
            }
        }
        Some(largest)
    }

    /// True when the image of the circle of this ideal radius has no point in the frame.
    fn rim_is_outside(&self, lens: &PlaneLens, radius: f64) -> bool {
        let [fx, fy, skew, cx, cy, ..] = self.lens.interior().map(Interval::exactly);
        let (right, bottom) = (f64::from(self.width) - 0.5, f64::from(self.height) - 0.5);
        let outside = |t: Interval| {
            // t counts eighths of the circle; within each the sine and the cosine are monotone.
            let point = Vector2::new(arc(t, radius, f64::cos), arc(t, radius, f64::sin));
            let Some([x, y]) = lens.image(point) else { return false };
            let (column, row) = (fx * x + skew * y + cx, fy * y + cy);
            column.high < -0.5 || column.low > right || row.high < -0.5 || row.low > bottom
        };
        (0..8).all(|eighth| everywhere(Interval::new(f64::from(eighth), f64::from(eighth) + 1.0), &outside))
    }
}

/// Radius times a function that is monotone between eighths of the circle, over an interval of them.
fn arc(eighths: Interval, radius: f64, function: fn(f64) -> f64) -> Interval {
    // The functions of the machine are good to an ulp or two; this is far more.
    const SLACK: f64 = 1e-14;
    let at = |t: f64| radius * function(t * std::f64::consts::FRAC_PI_4);
    let (a, b) = (at(eighths.low), at(eighths.high));
    Interval::new(a.min(b) - SLACK * radius, a.max(b) + SLACK * radius)
}

/// True when a condition holds on all of an interval, shown piece by piece.
fn everywhere(whole: Interval, holds: &impl Fn(Interval) -> bool) -> bool {
    const FINEST: f64 = 1e-6;
    let mut open = vec![whole];
    while let Some(piece) = open.pop() {
        if holds(piece) {
            continue;
        }
        if piece.high - piece.low < FINEST * (whole.high - whole.low) {
            return false;
        }
        open.extend(piece.halves());
    }
    true
}

/// A fisheye: θ_d/θ and dθ_d/dθ by powers of a variable that rises with θ.
struct AngularLens {
    factor: [f64; 5],
    slope: [f64; 5],
    /// The variable of an angle.
    variable: fn(Interval) -> Interval,
}

/// Brown's or the rational lens: numerator and denominator of the radial factor by powers of r², decentring, and
/// s1, s2, s3, s4 when there is a prism.
struct PlaneLens {
    above: [f64; 4],
    below: [f64; 4],
    p1: f64,
    p2: f64,
    prism: Option<[f64; 4]>,
}

impl PlaneLens {
    /// Radial factor and its derivative by r².
    fn radial(&self, r2: Interval) -> Option<[Interval; 2]> {
        let slope = |c: &[f64; 4]| r2.polynomial(&[c[1], 2.0 * c[2], 3.0 * c[3]]);
        let reciprocal = r2.polynomial(&self.below).reciprocal()?;
        let factor = r2.polynomial(&self.above) * reciprocal;
        let by_r2 = (slope(&self.above) - factor * slope(&self.below)) * reciprocal;
        // The reciprocal of a negative number lies beyond a pole.
        (reciprocal.low > 0.0).then_some([factor, by_r2])
    }

    /// Distorted point.
    fn image(&self, ideal: Vector2<Interval>) -> Option<[Interval; 2]> {
        let (x, y) = (ideal.x, ideal.y);
        let (xx, yy) = (x.square(), y.square());
        let [factor, _] = self.radial(xx + yy)?;
        let [two, three] = [2.0, 3.0].map(Interval::exactly);
        let (p1, p2) = (Interval::exactly(self.p1), Interval::exactly(self.p2));
        let image = [
            x * factor + two * p1 * x * y + p2 * (three * xx + yy),
            y * factor + p1 * (xx + three * yy) + two * p2 * x * y,
        ];
        let Some(prism) = self.prism else { return Some(image) };
        let [s1, s2, s3, s4] = prism.map(Interval::exactly);
        let r2 = xx + yy;
        Some([image[0] + r2 * (s1 + s2 * r2), image[1] + r2 * (s3 + s4 * r2)])
    }

    /// True when the symmetric part of the derivative is positive definite on all of a box.
    fn is_definite(&self, x: Interval, y: Interval) -> bool {
        let (xx, yy) = (x.square(), y.square());
        let Some([factor, by_r2]) = self.radial(xx + yy) else { return false };
        let [two, six] = [2.0, 6.0].map(Interval::exactly);
        let (p1, p2) = (Interval::exactly(self.p1), Interval::exactly(self.p2));
        let mut a = factor + two * xx * by_r2 + two * p1 * y + six * p2 * x;
        let mut d = factor + two * yy * by_r2 + six * p1 * y + two * p2 * x;
        let mut b = two * (x * y * by_r2 + p1 * x + p2 * y);
        if let Some(prism) = self.prism {
            // d(s r² + s′ r⁴) = 2 (s + 2 s′ r²) (x, y); off the diagonal the mean of both.
            let [s1, s2, s3, s4] = prism.map(Interval::exactly);
            let r2 = two * (xx + yy);
            let (along_x, along_y) = (s1 + s2 * r2, s3 + s4 * r2);
            a = a + two * x * along_x;
            d = d + two * y * along_y;
            b = b + y * along_x + x * along_y;
        }
        a.low > 0.0 && d.low > 0.0 && (a * d - b.square()).low > 0.0
    }

    /// True when no two points of the disc of this radius share an image: shown box by box.
    fn is_one_to_one(&self, radius: f64) -> bool {
        /// A lens that folds is given up at once; one that does not needs some hundred boxes.
        const MOST_BOXES: usize = 100_000;
        let side = Interval::new(-radius, radius);
        let mut open = vec![(side, side)];
        let mut boxes = 0;
        while let Some((x, y)) = open.pop() {
            boxes += 1;
            let out_of_the_disc = (x.square() + y.square()).low > radius * radius;
            if out_of_the_disc || self.is_definite(x, y) {
                continue;
            }
            let finest = x.high - x.low < 1e-4 * radius;
            if finest || boxes > MOST_BOXES {
                return false;
            }
            for x in x.halves() {
                open.extend(y.halves().map(|y| (x, y)));
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Brown, Fisheye, Pix4dFisheye, Rational, ThinPrism};
    use super::*;
    use proptest::prelude::*;

    fn camera(lens: impl Into<Lens>, width: u32, height: u32) -> Camera {
        Camera::new(lens, width, height, None).unwrap()
    }

    #[test]
    fn an_ordinary_lens_is_proved_invertible() {
        // OpenCV's left camera, with barrel distortion and decentring.
        let brown =
            Brown::new([536.07, 536.01, 0.0, 342.37, 235.53, -0.26512, -0.0466, 0.00183, -0.00031, 0.2522]);
        let Invertibility::Proved { to } = camera(brown.unwrap(), 640, 480).invertibility() else {
            panic!("not proved")
        };
        // The farthest corner lies 38° off axis.
        assert!((38.0..42.0).contains(&to.degrees()), "{}", to.degrees());
    }

    #[test]
    fn the_papers_lens_is_not_and_its_corners_are_named() {
        let paper = Brown::new([
            743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018,
        ]);
        let Invertibility::Unproved { mask } = camera(paper.unwrap(), 1152, 648).invertibility() else {
            panic!("it folds back in its corners")
        };
        // paper-numbers: 5707 pixels, 0.76 %.
        assert!((mask.share() - 0.0076).abs() < 0.0006, "{}", mask.share());
        assert!(mask.folded[0] && !mask.folded[mask.folded.len() / 2]);
    }

    #[test]
    fn a_pole_in_the_frame_is_no_proof() {
        let pole = Rational::new([500.0, 500.0, 0.0, 320.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0, -3.0, 0.0, 0.0]);
        // With 1 − 3 r² below, the image radius grows without bound towards r = 0.577: the frame is covered.
        assert!(matches!(camera(pole.unwrap(), 640, 480).invertibility(), Invertibility::Proved { .. }));
        let folded =
            Rational::new([500.0, 500.0, 0.0, 320.0, 240.0, -1.5, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0]);
        assert!(matches!(camera(folded.unwrap(), 640, 480).invertibility(), Invertibility::Unproved { .. }));
    }

    #[test]
    fn a_fisheye_is_proved_beyond_ninety_degrees_and_refuted_at_its_fold() {
        let wide = Fisheye::new([300.0, 300.0, 0.0, 639.5, 479.5, 0.01, -0.002, 0.0, 0.0]);
        let Invertibility::Proved { to } = camera(wide.unwrap(), 1280, 960).invertibility() else {
            panic!("not proved")
        };
        assert!(to.degrees() > 120.0, "{}", to.degrees());
        let folding = Fisheye::new([300.0, 300.0, 0.0, 639.5, 479.5, -1.0 / 3.0, 0.0, 0.0, 0.0]);
        let Invertibility::Unproved { mask } = camera(folding.unwrap(), 1280, 960).invertibility() else {
            panic!("it folds at 1 rad, 200 px from the centre")
        };
        assert!(mask.share() > 0.8, "{}", mask.share());
    }

    #[test]
    fn a_prism_is_proved_or_refuted() {
        let prism = |s1: f64| {
            let mut interior = [0.0; 17];
            interior[..6].copy_from_slice(&[500.0, 500.0, 0.0, 319.5, 239.5, -0.1]);
            interior[13..].copy_from_slice(&[s1, -0.1 * s1, -0.5 * s1, 0.0]);
            camera(ThinPrism::new(interior).unwrap(), 640, 480).invertibility()
        };
        assert!(matches!(prism(0.01), Invertibility::Proved { .. }));
        // x + 2 r² turns over at x = −0.25, an eighth of a focal length from the centre.
        let Invertibility::Unproved { mask } = prism(2.0) else { panic!("it folds") };
        assert!(mask.share() > 0.3, "{}", mask.share());
    }

    #[test]
    fn pix4ds_fisheye_is_proved_and_refuted() {
        let lens = |rho2: f64| {
            let lens = Pix4dFisheye::new([1120.0, 1119.0, 1.0, 640.0, 480.0, -2.0, rho2, -0.03, 0.0]);
            camera(lens.unwrap(), 1280, 960).invertibility()
        };
        let Invertibility::Proved { to } = lens(-0.13) else { panic!("not proved") };
        // The farthest corner lies about 44° off axis.
        assert!((42.0..50.0).contains(&to.degrees()), "{}", to.degrees());
        // 1 − 4 t − 0.09 t² vanishes at t = 0.25, 22° off axis.
        let Invertibility::Unproved { mask } = lens(-2.0) else { panic!("it folds") };
        assert!(mask.share() > 0.5, "{}", mask.share());
    }

    /// Random lenses of every kind, many of them folding.
    fn any_camera() -> impl Strategy<Value = Camera> {
        let term = |size: f64| -size..size;
        let terms = (
            proptest::array::uniform6(term(0.5)),
            proptest::array::uniform2(term(0.01)),
            proptest::array::uniform4(term(0.02)),
        );
        let plane = (250.0..1500.0f64, 0.9..1.1f64, term(3.0), term(60.0), term(60.0));
        (0..5usize, plane, terms).prop_map(|(kind, (f, aspect, skew, x, y), (k, p, s))| {
            let [fx, fy, cx, cy] = [f * aspect, f, 511.5 + x, 383.5 + y];
            let lens: Lens = match kind {
                0 => Brown::new([fx, fy, skew, cx, cy, k[0], k[1], p[0], p[1], k[2]]).unwrap().into(),
                1 => Rational::new([fx, fy, skew, cx, cy, k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5]])
                    .unwrap()
                    .into(),
                2 => ThinPrism::new([
                    fx, fy, skew, cx, cy, k[0], k[1], p[0], p[1], k[2], k[3], k[4], k[5], s[0], s[1], s[2],
                    s[3],
                ])
                .unwrap()
                .into(),
                3 => Fisheye::new([fx, fy, skew, cx, cy, 0.3 * k[0], 0.1 * k[1], 0.1 * k[2], 0.03 * k[3]])
                    .unwrap()
                    .into(),
                _ => {
                    Pix4dFisheye::new([fx, fy, skew, cx, cy, s[0] * 100.0, k[0], k[1], k[2]]).unwrap().into()
                }
            };
            camera(lens, 1024, 768)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn where_it_is_proved_every_pixel_comes_back(
            camera in any_camera(), at in proptest::collection::vec((-0.5..1023.5f64, -0.5..767.5f64), 40),
        ) {
            let proved = matches!(camera.invertibility(), Invertibility::Proved { .. });
            for (column, row) in at {
                let direction = camera.lens.direction_from_pixel(ImagePoint::new(column, row));
                prop_assert!(direction.is_some() || !proved, "({column}, {row}) has no ray");
                let Some(direction) = direction else { continue };
                let back = camera.lens.pixel_from_point(&direction);
                // Also of a lens that folds elsewhere: a ray that is given is a ray that the lens sees.
                let near = back.is_some_and(|p| f64::hypot(p.column - column, p.row - row) < 1e-6);
                prop_assert!(near, "{back:?} for ({column}, {row})");
            }
        }
    }
}
