//! Which markers lie where the board has them.

use super::super::plane::{homography, mapped};
use super::Tag;
use nalgebra::{Matrix3, Vector2};
use std::collections::{BTreeMap, BTreeSet};

/// Markers tell each other's places up to this far away, in sides.
const REACH: f64 = 3.0;
/// A marker's centre may miss its place by this share of its side.
const TOLERANCE: f64 = 0.35;

/// Groups of markers that agree on where the board is, the largest first. Single markers are no groups.
///
/// - `place`: corners of a marker on the board, any unit; `None` when the board does not have it.
pub(crate) fn agreeing(tags: &[Tag], place: impl Fn(usize) -> Option<[Vector2<f64>; 4]>) -> Vec<Vec<usize>> {
    let seen: Vec<Option<Seen>> =
        tags.iter().map(|tag| place(tag.marker).and_then(|board| Seen::new(tag, board))).collect();
    let agree = |i: usize, j: usize| match (&seen[i], &seen[j]) {
        (Some(a), Some(b)) => a.expects(b) && b.expects(a),
        _ => false,
    };
    let mut left: BTreeSet<usize> = (0..tags.len()).filter(|&at| seen[at].is_some()).collect();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    while let Some(start) = left.pop_first() {
        let mut members = vec![start];
        let mut next = 0;
        while next < members.len() {
            let here = members[next];
            let beside: Vec<usize> = left.iter().copied().filter(|&other| agree(here, other)).collect();
            left.retain(|other| !beside.contains(other));
            members.extend(beside);
            next += 1;
        }
        groups.push(members);
    }
    groups.sort_by_key(|members| std::cmp::Reverse(members.len()));
    let mut groups = joined(groups, &seen);
    groups.retain(|members| members.len() > 1);
    groups.iter_mut().for_each(|members| members.sort_unstable());
    groups.sort_by_key(|members| std::cmp::Reverse(members.len()));
    groups
}

/// Groups that lie apart on one board made one. The largest comes first.
fn joined(groups: Vec<Vec<usize>>, seen: &[Option<Seen>]) -> Vec<Vec<usize>> {
    let mut whole: Vec<Vec<usize>> = Vec::new();
    for group in groups {
        let fits = |other: &Vec<usize>| {
            let markers: Vec<&Seen> =
                other.iter().chain(&group).filter_map(|&at| seen[at].as_ref()).collect();
            let once = markers.iter().map(|s| s.marker).collect::<BTreeSet<_>>().len() == markers.len();
            once && one_plane(&markers)
        };
        match whole.iter_mut().find(|other| fits(other)) {
            Some(other) => other.extend(group),
            None => whole.push(group),
        }
    }
    whole
}

/// Whether the corners of all markers lie as on the board, to the tolerance.
fn one_plane(markers: &[&Seen]) -> bool {
    let pairs: Vec<_> = markers.iter().flat_map(|s| s.pairs).collect();
    homography(&pairs).is_some_and(|h| {
        let lies = |s: &&Seen| {
            let allowed = TOLERANCE * s.side_px;
            s.pairs.iter().all(|(board, pixel)| (mapped(&h, *board) - pixel).norm() < allowed)
        };
        markers.iter().all(lies)
    })
}

/// A marker with its place on the board.
struct Seen {
    marker: usize,
    /// Corners on the board and in the image.
    pairs: [(Vector2<f64>, Vector2<f64>); 4],
    image_from_board: Matrix3<f64>,
    /// On the board.
    middle: Vector2<f64>,
    side: f64,
    /// In the image.
    centre: Vector2<f64>,
    side_px: f64,
}

impl Seen {
    fn new(tag: &Tag, board: [Vector2<f64>; 4]) -> Option<Self> {
        let pairs: [_; 4] = std::array::from_fn(|k| (board[k], tag.quad.corners[k]));
        Some(Self {
            marker: tag.marker,
            pairs,
            image_from_board: homography(&pairs)?,
            middle: board.iter().sum::<Vector2<f64>>() / 4.0,
            side: (board[1] - board[0]).norm(),
            centre: tag.quad.centre(),
            side_px: tag.side(),
        })
    }
    /// Whether another marker is where this one expects it.
    fn expects(&self, other: &Self) -> bool {
        self.marker != other.marker
            && (self.middle - other.middle).norm() < REACH * self.side
            && (mapped(&self.image_from_board, other.middle) - other.centre).norm()
                < TOLERANCE * other.side_px
    }
}

/// By how much the numbers of markers grow from one to the one below it; what most of them say.
///
/// - `pitch`: distance of markers, in sides.
pub(crate) fn vertical_step(tags: &[Tag], pitch: f64) -> Option<i64> {
    let unit = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, y)| Vector2::new(x, y));
    let mut votes: BTreeMap<i64, usize> = BTreeMap::new();
    for tag in tags {
        let pairs: [_; 4] = std::array::from_fn(|k| (tag.quad.corners[k], unit[k]));
        let Some(unit_from_image) = homography(&pairs) else {
            continue;
        };
        for other in tags {
            let offset = mapped(&unit_from_image, other.quad.centre()) / pitch;
            if (offset - Vector2::new(0.0, 1.0)).norm() < TOLERANCE && other.marker != tag.marker {
                *votes.entry(other.marker as i64 - tag.marker as i64).or_default() += 1;
            }
        }
    }
    votes
        .into_iter()
        .max_by_key(|&(step, votes)| (votes, std::cmp::Reverse(step.abs())))
        .map(|(step, _)| step)
}
