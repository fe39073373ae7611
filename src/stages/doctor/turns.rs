//! Whether stored pixels are turned against what is declared, by the pixels themselves.
//!
//! Every frame is laid on the ground together with its neighbours, as declared and turned by every angle that keeps the
//! image's shape. Two frames that are laid right show the same ground: their fine brightness correlates. Each pair of
//! neighbours has a vote when one combination of turns fits clearly better than all others; small shifts are allowed, so
//! that poses need to be right to some metres and degrees only.

use super::pixels::{self, Small};
use super::view::distance;
use crate::camera::{ImagePoint, PixelRotation};
use crate::geodesy::{Geodetic, LocalTangent, WGS84};
use crate::geometry::{Ned, Point};
use crate::georeference::GeoreferencedFrame;
use rayon::prelude::*;
use std::path::Path;

/// What the pixels say.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Turns {
    /// One verdict per used frame, in the survey's order.
    pub frames: Vec<TurnVerdict>,
}

/// What the pixels say about one frame.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct TurnVerdict {
    /// The image's file name.
    pub frame: String,
    /// "as declared", "turned" or "cannot tell".
    pub verdict: &'static str,
    /// With "turned": how far the stored pixels are turned clockwise beyond what is declared.
    pub turned_deg: Option<u32>,
    /// Mean correlation with the neighbours that have a vote, the pixels as declared.
    pub score_as_declared: Option<f64>,
    /// The same with the pixels turned back; the best turn, where the verdict is not "turned".
    pub score_turned: Option<f64>,
    /// Neighbours that have a vote.
    pub neighbours: usize,
    /// Neighbours it was compared with.
    pub compared: usize,
}

impl Turns {
    /// Frames whose pixels are turned.
    pub(super) fn turned(&self) -> impl Iterator<Item = &TurnVerdict> {
        self.frames.iter().filter(|verdict| verdict.turned_deg.is_some())
    }

    /// Whether there is a verdict about a frame.
    pub(super) fn judged(&self, frame: &str) -> bool {
        self.frames.iter().any(|verdict| verdict.frame == frame && verdict.verdict != "cannot tell")
    }
}

/// Photos are made this small: texture of decimetres to metres is what neighbours share in spite of wind and shadows.
const PHOTO_SIDE: usize = 320;
/// Cells along the longer side of the ground that two frames share.
const CELLS: f64 = 64.0;
/// Shifts are looked for up to this many cells, in every direction: a fifth of what is shared.
const REACH: usize = 13;
/// A frame is compared with this many of its neighbours.
const NEIGHBOURS: usize = 6;
/// Neighbours share at least this part of a frame's width.
const NEAR: f64 = 0.75;
/// Brightness that changes over more cells than this is light, not texture.
const TEXTURE_CELLS: usize = 6;
/// A pair has a vote from this correlation on; chance gives about 0.2 at the best of all shifts.
const LEAST_SCORE: f64 = 0.3;
/// By which the best combination of turns exceeds the others.
const LEAST_MARGIN: f64 = 0.12;
/// Cells that two frames have to share, for a correlation to mean anything.
const FEWEST_CELLS: usize = 250;

/// Decodes the photos and compares neighbours.
pub(super) fn of(frames: &[GeoreferencedFrame], folder: &Path) -> Turns {
    judge(frames, &pixels::small(frames, folder, PHOTO_SIDE))
}

/// Two neighbours and how well they fit by the turns of the first and the second.
struct Pair {
    a: usize,
    b: usize,
    /// `scores[turn of a][turn of b]`, by the places in the lists of turns.
    scores: Vec<Vec<f64>>,
}

impl Pair {
    /// Places of the best combination, when it is clearly better than every other.
    fn vote(&self) -> Option<(usize, usize)> {
        let mut all: Vec<(f64, (usize, usize))> = self
            .scores
            .iter()
            .enumerate()
            .flat_map(|(a, row)| row.iter().enumerate().map(move |(b, score)| (*score, (a, b))))
            .collect();
        all.sort_by(|x, y| y.0.total_cmp(&x.0));
        let (best, second) = (all.first()?, all.get(1)?);
        (best.0 >= LEAST_SCORE && best.0 - second.0 >= LEAST_MARGIN).then_some(best.1)
    }
}

fn judge(frames: &[GeoreferencedFrame], photos: &[Option<Small>]) -> Turns {
    let turns: Vec<Vec<i64>> = frames.iter().map(possible_turns).collect();
    let pairs: Vec<Pair> = neighbours(frames)
        .into_par_iter()
        .filter_map(|(a, b)| {
            let (photo_a, photo_b) = (photos[a].as_ref()?, photos[b].as_ref()?);
            let scores = compare((&frames[a], photo_a, &turns[a]), (&frames[b], photo_b, &turns[b]))?;
            Some(Pair { a, b, scores })
        })
        .collect();
    let frames = (0..frames.len()).map(|index| verdict(index, &frames[index].name, &turns[index], &pairs));
    Turns { frames: frames.collect() }
}

fn verdict(index: usize, name: &str, turns: &[i64], pairs: &[Pair]) -> TurnVerdict {
    let own: Vec<&Pair> = pairs.iter().filter(|pair| pair.a == index || pair.b == index).collect();
    let mut votes = vec![0_usize; turns.len()];
    let mut sums = vec![0.0; turns.len()];
    for pair in &own {
        let Some((a, b)) = pair.vote() else { continue };
        votes[if pair.a == index { a } else { b }] += 1;
        for (turn, sum) in sums.iter_mut().enumerate() {
            *sum += if pair.a == index { pair.scores[turn][b] } else { pair.scores[a][turn] };
        }
    }
    let voters: usize = votes.iter().sum();
    let best = (1..turns.len()).max_by_key(|turn| (votes[*turn], std::cmp::Reverse(*turn)));
    let outvoted = |mine: usize, other: usize| mine > 2 * other && (mine > 1 || own.len() == 1);
    // Poses that are off by more than is searched for leave few neighbours that fit, some of them by chance.
    let turned =
        best.filter(|turn| outvoted(votes[*turn], voters - votes[*turn]) && 2 * votes[*turn] >= own.len());
    let upright = outvoted(votes[0], voters - votes[0]);
    let mean = |turn: usize| (voters > 0).then(|| sums[turn] / voters as f64);
    TurnVerdict {
        frame: name.to_owned(),
        verdict: match (turned, upright) {
            (Some(_), _) => "turned",
            (None, true) => "as declared",
            (None, false) => "cannot tell",
        },
        turned_deg: turned.map(|turn| 90 * turns[turn] as u32),
        score_as_declared: mean(0),
        score_turned: turned
            .or_else(|| (1..turns.len()).max_by(|a, b| sums[*a].total_cmp(&sums[*b])))
            .and_then(mean),
        neighbours: voters,
        compared: own.len(),
    }
}

/// Quarter turns beyond the declared one that leave width and height as they are; none at all comes first.
fn possible_turns(frame: &GeoreferencedFrame) -> Vec<i64> {
    let size = frame.stored_size();
    let (w, h) = (frame.camera.width, frame.camera.height);
    (0..4).filter(|turn| turned(frame, *turn).stored_size(w, h) == size).collect()
}

fn turned(frame: &GeoreferencedFrame, by: i64) -> PixelRotation {
    PixelRotation::from_quarter_turns(i64::from(frame.pixel_rotation.degrees()) / 90 + by)
}

/// Pairs of frames that look at the same ground: the nearest ones of each.
fn neighbours(frames: &[GeoreferencedFrame]) -> Vec<(usize, usize)> {
    let Some(plane) = frames.first().map(|first| LocalTangent::at(first.record.antenna.at_height(0.0)))
    else {
        return Vec::new();
    };
    let seen: Vec<([f64; 2], f64)> = frames
        .iter()
        .map(|frame| {
            let flat = |at: &Geodetic| {
                let p: Point<Ned> = plane.ecef_from_ned().inverse() * WGS84.ecef_from_geodetic(at);
                [p.y(), p.x()]
            };
            let outline: Vec<[f64; 2]> = frame.footprint.outline.iter().map(|v| flat(&v.position)).collect();
            let middle = frame.footprint.anchor.map_or([f64::INFINITY; 2], |anchor| flat(&anchor.position));
            let reach = outline.iter().map(|p| distance(*p, middle)).fold(0.0, f64::max);
            (middle, reach)
        })
        .collect();
    let mut pairs = Vec::new();
    for (a, (middle, reach)) in seen.iter().enumerate() {
        let mut near: Vec<(f64, usize)> = seen
            .iter()
            .enumerate()
            .filter(|(b, _)| *b != a)
            .map(|(b, (other, its))| (distance(*middle, *other) / (reach + its), b))
            .filter(|(share, _)| *share < NEAR)
            .collect();
        near.sort_by(|x, y| x.0.total_cmp(&y.0));
        pairs.extend(near.into_iter().take(NEIGHBOURS).map(|(_, b)| (a.min(b), a.max(b))));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

type Seen<'a> = (&'a GeoreferencedFrame, &'a Small, &'a [i64]);

/// Correlations of two frames on the ground by their turns; `None` when they share too little.
fn compare(a: Seen<'_>, b: Seen<'_>) -> Option<Vec<Vec<f64>>> {
    let grid = Grid::between(a.0, b.0)?;
    let patches = |(frame, photo, turns): Seen<'_>| -> Option<Vec<Patch>> {
        let block = (grid.cell_m / (frame.footprint.gsd_m * photo.factor as f64)).round().max(1.0);
        let photo = photo.smaller(block as usize)?;
        let stored = grid.stored_pixels(frame);
        Some(turns.iter().map(|turn| grid.patch(frame, &photo, *turn, &stored)).collect())
    };
    let (of_a, of_b) = (patches(a)?, patches(b)?);
    let scores: Vec<Vec<f64>> =
        of_a.iter().map(|a| of_b.iter().map(|b| grid.best_fit(a, b)).collect()).collect();
    scores.iter().flatten().any(|score| *score > f64::NEG_INFINITY).then_some(scores)
}

/// Equal cells on the ground that two frames share, with room for shifts around.
struct Grid {
    plane: LocalTangent,
    /// North and east of the upper left cell, metres.
    corner: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
}

/// Texture of the ground as one frame shows it; not finite where the frame does not see it.
struct Patch(Vec<f32>);

impl Grid {
    fn between(a: &GeoreferencedFrame, b: &GeoreferencedFrame) -> Option<Self> {
        let plane = LocalTangent::at(a.footprint.anchor?.position);
        let bounds = |frame: &GeoreferencedFrame| {
            let flat = frame.footprint.outline.iter().map(|vertex| {
                let p: Point<Ned> =
                    plane.ecef_from_ned().inverse() * WGS84.ecef_from_geodetic(&vertex.position);
                [p.x(), p.y()]
            });
            let points: Vec<[f64; 2]> = flat.collect();
            super::overlap::bounds(points.iter())
        };
        let ((low_a, high_a), (low_b, high_b)) = (bounds(a)?, bounds(b)?);
        let low = [low_a[0].max(low_b[0]), low_a[1].max(low_b[1])];
        let high = [high_a[0].min(high_b[0]), high_a[1].min(high_b[1])];
        let (north, east) = (high[0] - low[0], high[1] - low[1]);
        if !(north > 0.0 && east > 0.0) {
            return None;
        }
        let cell_m = (north.max(east) / CELLS).max(a.footprint.gsd_m).max(b.footprint.gsd_m);
        let room = REACH as f64 * cell_m;
        let cells = |length: f64| (length / cell_m).ceil() as usize + 2 * REACH;
        Some(Self {
            plane,
            corner: [high[0] + room, low[1] - room],
            cell_m,
            columns: cells(east),
            rows: cells(north),
        })
    }

    /// Stored pixel, as declared, of every cell.
    fn stored_pixels(&self, frame: &GeoreferencedFrame) -> Vec<Option<ImagePoint>> {
        let cells = (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)));
        let places: Vec<_> = cells
            .map(|(column, row)| {
                let north = self.corner[0] - (row as f64 + 0.5) * self.cell_m;
                let east = self.corner[1] + (column as f64 + 0.5) * self.cell_m;
                let at: Point<Ned> = Point::new(north, east, 0.0);
                WGS84.geodetic_from_ecef(&(*self.plane.ecef_from_ned() * at))
            })
            .collect();
        // Beside the elevation model the ground is taken to be level.
        let level = frame.footprint.anchor.map_or(0.0, |anchor| anchor.position.height.get());
        let heights = frame.ground.heights(&places);
        places
            .iter()
            .zip(heights)
            .map(|(place, height)| {
                let at = place.at_height(height.unwrap_or(level));
                frame.pixel_from_ecef(&WGS84.ecef_from_geodetic(&at))
            })
            .collect()
    }

    fn patch(
        &self,
        frame: &GeoreferencedFrame,
        photo: &Small,
        turn: i64,
        stored: &[Option<ImagePoint>],
    ) -> Patch {
        let rotation = turned(frame, turn);
        let (w, h) = (frame.camera.width, frame.camera.height);
        let values: Vec<f32> = stored
            .iter()
            .map(|stored| {
                let found = stored.and_then(|stored| {
                    photo.at(rotation.stored_from_sensor(frame.sensor_from_stored(stored), w, h))
                });
                found.unwrap_or(f32::NAN)
            })
            .collect();
        Patch(self.texture(&values))
    }

    /// Brightness less its mean over the cells around.
    fn texture(&self, values: &[f32]) -> Vec<f32> {
        let (w, h) = (self.columns, self.rows);
        // Sums of everything above and to the left: of brightness, and of cells that have one.
        let mut sums = vec![(0.0_f64, 0.0_f64); (w + 1) * (h + 1)];
        for row in 0..h {
            for column in 0..w {
                let value = values[row * w + column];
                let (v, n) = if value.is_finite() { (f64::from(value), 1.0) } else { (0.0, 0.0) };
                let at = |c: usize, r: usize| sums[r * (w + 1) + c];
                let (left, up, corner) = (at(column, row + 1), at(column + 1, row), at(column, row));
                sums[(row + 1) * (w + 1) + column + 1] =
                    (v + left.0 + up.0 - corner.0, n + left.1 + up.1 - corner.1);
            }
        }
        let mut texture = values.to_vec();
        for row in 0..h {
            for column in 0..w {
                let (c0, c1) = (column.saturating_sub(TEXTURE_CELLS), (column + TEXTURE_CELLS + 1).min(w));
                let (r0, r1) = (row.saturating_sub(TEXTURE_CELLS), (row + TEXTURE_CELLS + 1).min(h));
                let at = |c: usize, r: usize| sums[r * (w + 1) + c];
                let (a, b, c, d) = (at(c1, r1), at(c0, r1), at(c1, r0), at(c0, r0));
                let count = a.1 - b.1 - c.1 + d.1;
                if count > 0.0 {
                    texture[row * w + column] -= ((a.0 - b.0 - c.0 + d.0) / count) as f32;
                }
            }
        }
        texture
    }

    /// Best correlation over all shifts; negative infinity when too few cells are shared.
    fn best_fit(&self, a: &Patch, b: &Patch) -> f64 {
        let reach = REACH as isize;
        let mut best = f64::NEG_INFINITY;
        for down in -reach..=reach {
            for right in -reach..=reach {
                if let Some(score) = self.correlation(a, b, right, down) {
                    best = best.max(score);
                }
            }
        }
        best
    }

    /// Normalised correlation of what both show, the second one shifted.
    fn correlation(&self, a: &Patch, b: &Patch, right: isize, down: isize) -> Option<f64> {
        let (w, h) = (self.columns as isize, self.rows as isize);
        let (mut n, mut sa, mut sb, mut saa, mut sbb, mut sab) = (0_usize, 0.0_f64, 0.0, 0.0, 0.0, 0.0);
        for row in 0.max(-down)..h.min(h - down) {
            let from = 0.max(-right);
            let length = w.min(w - right) - from;
            if length <= 0 {
                continue;
            }
            let start_a = (row * w + from) as usize;
            let start_b = ((row + down) * w + from + right) as usize;
            let (line_a, line_b) =
                (&a.0[start_a..start_a + length as usize], &b.0[start_b..start_b + length as usize]);
            for (x, y) in line_a.iter().zip(line_b) {
                if x.is_finite() && y.is_finite() {
                    let (x, y) = (f64::from(*x), f64::from(*y));
                    n += 1;
                    sa += x;
                    sb += y;
                    saa += x * x;
                    sbb += y * y;
                    sab += x * y;
                }
            }
        }
        if n < FEWEST_CELLS {
            return None;
        }
        let count = n as f64;
        let (var_a, var_b) = (saa - sa * sa / count, sbb - sb * sb / count);
        // Less than a grey level of texture is noise.
        (var_a > count && var_b > count).then(|| (sab - sa * sb / count) / (var_a * var_b).sqrt())
    }
}

#[cfg(test)]
mod tests;
