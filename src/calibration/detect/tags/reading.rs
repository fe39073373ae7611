//! What a quadrilateral says: cells to a word to a marker.

use super::super::plane::{homography, mapped};
use super::Kind;
use crate::calibration::grey::Grey;
use crate::calibration::target::quarter_turned;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Blur takes from a cell what it gives to its neighbours: these multiples of the difference are put back, the
/// first in photos as they should be, the second where the blur is more than half a cell wide.
const SHARPENINGS: [f64; 2] = [0.6, 1.6];
/// The threshold cuts blurred markers smaller than they are: they are read as found, and a little larger.
const SIZES: [f64; 2] = [1.0, 1.07];
/// Share of the border's cells that must be dark.
const DARK_BORDER: f64 = 0.85;

/// A quadrilateral that was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Read {
    /// A marker of the dictionary.
    Marker {
        /// Its number.
        marker: usize,
        /// The quadrilateral's corner that is the marker's upper left.
        first_corner: usize,
        /// Cells otherwise than printed.
        misread: usize,
    },
    /// A marker seen in a mirror.
    Mirrored,
}

/// All words of a dictionary in all turns.
pub(super) struct Reader<'a> {
    kind: &'a Kind,
    /// Word, marker, quarter turns clockwise.
    words: Vec<(u64, usize, usize)>,
    /// Misread cells that are put right. Fewer than the words' distance allows: quadrilaterals that are no
    /// markers are read too.
    correctable: usize,
}

impl<'a> Reader<'a> {
    pub fn new(kind: &'a Kind) -> Self {
        let dictionary = kind.dictionary;
        let side = dictionary.side();
        let mut words = Vec::with_capacity(4 * dictionary.markers());
        for marker in 0..dictionary.markers() {
            let mut word = dictionary.word(marker).unwrap_or_default();
            for turn in 0..4 {
                words.push((word, marker, turn));
                word = quarter_turned(word, side);
            }
        }
        Self { kind, words, correctable: dictionary.correctable().min(side * side / 9) }
    }

    /// The marker that a quadrilateral is, in the reading with the fewest misread cells.
    pub fn read(&self, image: &Grey, corners: &[Vector2<f64>; 4]) -> Option<Read> {
        let side = self.kind.dictionary.side();
        let mut best: Option<Read> = None;
        for (size, border) in SIZES.iter().flat_map(|size| self.kind.borders.iter().map(move |b| (*size, *b)))
        {
            let Some(cells) = View::new(image, corners, size).and_then(|view| self.cells(&view, border))
            else {
                continue;
            };
            for sharpening in SHARPENINGS {
                let word = cells.word(side, border, sharpening);
                let read = self.marker(word).or_else(|| {
                    let inverse = self.marker(mirrored(word, side));
                    inverse.map(|_| Read::Mirrored)
                });
                if let Some(read) = read
                    && best.is_none_or(|best| read.misread() < best.misread())
                {
                    best = Some(read);
                }
            }
            if best.is_some_and(|best| best.misread() == 0) {
                break;
            }
        }
        best
    }

    /// The marker nearest to a word; `None` when none is near or several are.
    fn marker(&self, word: u64) -> Option<Read> {
        let mut best: Option<(usize, usize, usize)> = None;
        let mut tied = false;
        for &(other, marker, turn) in &self.words {
            let misread = (word ^ other).count_ones() as usize;
            if misread <= self.correctable && best.is_none_or(|best| misread <= best.0) {
                tied = best.is_some_and(|best| misread == best.0);
                best = Some((misread, marker, turn));
            }
        }
        let (misread, marker, first_corner) = best.filter(|_| !tied)?;
        Some(Read::Marker { marker, first_corner, misread })
    }

    /// The cells with a border of so many, if what is around them is a dark border in a light surround.
    fn cells(&self, view: &View, border: usize) -> Option<Cells> {
        let side = self.kind.dictionary.side();
        let total = side + 2 * border;
        let cell = 1.0 / total as f64;
        let (light, dark) = (view.light(0.5 * self.kind.surround.min(cell))?, view.dark(border, total)?);
        let mut shares = vec![0.0; total * total];
        for (at, share) in shares.iter_mut().enumerate() {
            let middle = Vector2::new((at % total) as f64 + 0.5, (at / total) as f64 + 0.5) * cell;
            let (light, dark) = (light.at(middle), dark.at(middle));
            if light <= dark {
                return None;
            }
            *share = (view.cell(middle, cell) - dark) / (light - dark);
        }
        let inner = border..border + side;
        let around =
            (0..shares.len()).filter(|at| !inner.contains(&(at % total)) || !inner.contains(&(at / total)));
        let (mut dark, mut all) = (0.0, 0.0);
        for at in around {
            dark += f64::from(u8::from(shares[at] < 0.5));
            all += 1.0;
        }
        (dark >= DARK_BORDER * all).then_some(Cells { shares, total })
    }
}

/// Brightness of the cells of a marker and its border, from 0 for black to 1 for white.
struct Cells {
    shares: Vec<f64>,
    total: usize,
}

impl Cells {
    /// What the cells inside the border say.
    fn word(&self, side: usize, border: usize, sharpening: f64) -> u64 {
        let (shares, total) = (&self.shares, self.total);
        let mut word = 0;
        for row in border..border + side {
            for at in row * total + border..row * total + border + side {
                let neighbours = shares[at - 1] + shares[at + 1] + shares[at - total] + shares[at + total];
                let sharpened = shares[at] + sharpening * (shares[at] - 0.25 * neighbours);
                word = word << 1 | u64::from(sharpened > 0.5);
            }
        }
        word
    }
}

impl Read {
    /// Misread cells; more than any marker has when it is mirrored.
    const fn misread(&self) -> usize {
        match self {
            Self::Marker { misread, .. } => *misread,
            Self::Mirrored => usize::MAX,
        }
    }
}

/// The same cells with left and right swapped.
fn mirrored(word: u64, side: usize) -> u64 {
    (0..side * side).fold(0, |out, at| {
        let from = at / side * side + (side - 1 - at % side);
        out << 1 | (word >> (side * side - 1 - from) & 1)
    })
}

/// A quadrilateral as a unit square.
struct View<'a> {
    image: &'a Grey,
    image_from_unit: Matrix3<f64>,
}

impl<'a> View<'a> {
    fn new(image: &'a Grey, corners: &[Vector2<f64>; 4], size: f64) -> Option<Self> {
        let unit = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Vector2::new(x, y));
        let centre = corners.iter().sum::<Vector2<f64>>() / 4.0;
        let pairs: [_; 4] = std::array::from_fn(|k| (unit[k], centre + (corners[k] - centre) * size));
        Some(Self { image, image_from_unit: homography(&pairs)? })
    }
    /// Brightness at a point of the unit square or around it, bilinear.
    fn at(&self, p: Vector2<f64>) -> f64 {
        let p = mapped(&self.image_from_unit, p);
        let (c, r) = (p.x.floor(), p.y.floor());
        let (u, v) = (p.x - c, p.y - r);
        let value = |dc: isize, dr: isize| f64::from(self.image.at(c as isize + dc, r as isize + dr));
        (value(0, 0) * (1.0 - u) + value(1, 0) * u) * (1.0 - v)
            + (value(0, 1) * (1.0 - u) + value(1, 1) * u) * v
    }
    /// Mean over the middle of a cell.
    fn cell(&self, middle: Vector2<f64>, size: f64) -> f64 {
        const OFFSETS: [f64; 3] = [-0.25, 0.0, 0.25];
        let mut sum = 0.0;
        for down in OFFSETS {
            for right in OFFSETS {
                sum += self.at(middle + Vector2::new(right, down) * size);
            }
        }
        sum / 9.0
    }
    /// The surround `out` sides away from the square.
    fn light(&self, out: f64) -> Option<Plane> {
        self.ring(-out, 0.15)
    }
    /// The middle of the border.
    fn dark(&self, border: usize, total: usize) -> Option<Plane> {
        let middle = 0.5 * border as f64 / total as f64;
        self.ring(middle, middle)
    }
    /// Along the four sides, so far inside them, from one end of each to the other.
    fn ring(&self, inside: f64, end: f64) -> Option<Plane> {
        const POINTS: usize = 8;
        let mut points = Vec::with_capacity(4 * POINTS);
        for k in 0..POINTS {
            let along = end + (1.0 - 2.0 * end) * k as f64 / (POINTS - 1) as f64;
            for (x, y) in [(along, inside), (1.0 - inside, along), (along, 1.0 - inside), (inside, along)] {
                let p = Vector2::new(x, y);
                points.push((p, self.at(p)));
            }
        }
        Plane::fitted(&points)
    }
}

/// Brightness that changes linearly over the unit square.
struct Plane(Vector3<f64>);

impl Plane {
    fn fitted(points: &[(Vector2<f64>, f64)]) -> Option<Self> {
        let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (p, value) in points {
            let row = p.push(1.0);
            matrix += row * row.transpose();
            right += row * *value;
        }
        matrix.cholesky().map(|cholesky| Self(cholesky.solve(&right)))
    }
    fn at(&self, p: Vector2<f64>) -> f64 {
        self.0.dot(&p.push(1.0))
    }
}
