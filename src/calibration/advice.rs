//! What to photograph next: missing tilts, empty parts of the frame, and the one photo that would help most.

use super::product::{Calibration, ViewPoints};
use super::start::{nominal_normals, repeated};
use super::uncertainty::FrameSights;
use crate::camera::{Camera, ImagePoint, InteriorCovariance, MAX_INTERIOR};
use crate::units::Radians;
use nalgebra::{Matrix6, Rotation3, SMatrix, Vector3};
use std::fmt;

/// Which edge of the target stands nearer to the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NearEdge {
    /// The one at the image's left.
    Left,
    /// The one at the image's right.
    Right,
    /// The one at the image's top.
    Top,
    /// The one at the image's bottom.
    Bottom,
}

impl NearEdge {
    /// All four.
    pub const ALL: [Self; 4] = [Self::Left, Self::Right, Self::Top, Self::Bottom];

    /// Direction of the board's far normal, seen from the camera, when this edge is near.
    fn lean(self) -> Vector3<f64> {
        match self {
            Self::Left => -Vector3::x(),
            Self::Right => Vector3::x(),
            Self::Top => -Vector3::y(),
            Self::Bottom => Vector3::y(),
        }
    }

    const fn word(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Top => "top",
            Self::Bottom => "bottom",
        }
    }
}

/// A ninth of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FramePart {
    /// 0 left, 1 middle, 2 right.
    pub column: usize,
    /// 0 top, 1 middle, 2 bottom.
    pub row: usize,
}

impl FramePart {
    fn all() -> impl Iterator<Item = Self> {
        (0..3).flat_map(|row| (0..3).map(move |column| Self { column, row }))
    }

    fn middle(self, width: u32, height: u32) -> ImagePoint {
        let at = |part: usize, size: u32| (part as f64 + 0.5) / 3.0 * f64::from(size) - 0.5;
        ImagePoint::new(at(self.column, width), at(self.row, height))
    }

    fn holds(self, pixel: ImagePoint, width: u32, height: u32) -> bool {
        let third = |at: f64, size: u32| ((at + 0.5) / f64::from(size.max(1)) * 3.0).floor();
        third(pixel.column, width) == self.column as f64 && third(pixel.row, height) == self.row as f64
    }
}

impl fmt::Display for FramePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = [
            ["upper left", "top", "upper right"],
            ["left", "middle", "right"],
            ["lower left", "bottom", "lower right"],
        ];
        f.write_str(words[self.row.min(2)][self.column.min(2)])
    }
}

/// One thing to photograph, or to leave out.
#[derive(Debug, Clone, PartialEq)]
pub enum Advice {
    /// There are few photos.
    MorePhotos {
        /// Photos given.
        have: usize,
        /// How many make a sound calibration.
        wanted: usize,
    },
    /// Two photos show the same thing: the second adds certainty that is not there.
    SamePhoto {
        /// Name of a photo.
        first: String,
        /// Name of a photo that shows the target in the same place.
        second: String,
    },
    /// The target never leant that way by more than 10°.
    Tilt {
        /// The edges that were never near.
        missing: Vec<NearEdge>,
    },
    /// No point of the target was ever there.
    Fill {
        /// The empty parts.
        parts: Vec<FramePart>,
    },
    /// The photo that would lower the projection's uncertainty most.
    Next(NextPhoto),
}

/// A photo not yet taken, and what it would be worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NextPhoto {
    /// Where in the frame the target's middle should be.
    pub part: FramePart,
    /// Which edge should be near, 35° tilted; none for a target that faces the camera.
    pub near: Option<NearEdge>,
    /// Root mean square of the projection's standard deviation over the frame now, px.
    pub now_px: f64,
    /// The same with that photo, px.
    pub then_px: f64,
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MorePhotos { have, wanted } => {
                write!(f, "take more photos: {have} are few, {wanted} make a sound calibration")
            }
            Self::SamePhoto { first, second } => {
                write!(f, "{second} shows the target where {first} does: move the target between photos")
            }
            Self::Tilt { missing } => {
                let edges = missing.iter().map(|edge| edge.word()).collect::<Vec<_>>().join(", ");
                write!(
                    f,
                    "tilt the target by 20° to 45° so that its edge at the image's {edges} comes nearer"
                )
            }
            Self::Fill { parts } => {
                let parts = parts.iter().map(FramePart::to_string).collect::<Vec<_>>().join(", ");
                write!(f, "bring the target into the frame's {parts}: no corner was seen there")
            }
            Self::Next(next) => {
                let tilt = next.near.map_or("facing the camera".to_owned(), |edge| {
                    format!("its {} edge nearer by 35°", edge.word())
                });
                write!(
                    f,
                    "the next photo that helps most: the target in the frame's {}, {tilt}; it would lower the \
                     projection's uncertainty from {:.3} to {:.3} px",
                    next.part, next.now_px, next.then_px
                )
            }
        }
    }
}

/// What to photograph next, the most important first.
///
/// - `calibration`: of these views, when there is one; without it the tilts are those that a lens of 53° would
///   give them.
#[must_use]
pub fn advice(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    calibration: Option<&Calibration>,
) -> Vec<Advice> {
    /// Photos that make a sound calibration: each tilt twice, and the frame's corners.
    const WANTED: usize = 8;
    let mut advice = Vec::new();
    if views.len() < WANTED {
        advice.push(Advice::MorePhotos { have: views.len(), wanted: WANTED });
    }
    advice.extend(repeated(views).into_iter().map(|(first, second, _)| Advice::SamePhoto {
        first: views[first].name.clone(),
        second: views[second].name.clone(),
    }));
    let normals: Vec<Vector3<f64>> = match calibration {
        Some(c) => c.views.iter().map(|v| v.camera_from_board.rotation.matrix().column(2).into()).collect(),
        None => nominal_normals(views, width, height),
    };
    let missing = missing_tilts(&normals);
    if !missing.is_empty() {
        advice.push(Advice::Tilt { missing });
    }
    let pixels = || views.iter().flat_map(|view| &view.observations).map(|o| o.pixel);
    let parts: Vec<FramePart> =
        FramePart::all().filter(|part| !pixels().any(|pixel| part.holds(pixel, width, height))).collect();
    if !parts.is_empty() {
        advice.push(Advice::Fill { parts });
    }
    advice.extend(calibration.and_then(next_photo).map(Advice::Next));
    advice
}

/// Edges that were never near: no normal leans that way by 10° or more.
fn missing_tilts(normals: &[Vector3<f64>]) -> Vec<NearEdge> {
    const LEAST: Radians = Radians::from_degrees(10.0);
    let leans = |normal: &Vector3<f64>, edge: NearEdge| {
        let towards = if normal.z < 0.0 { -normal } else { *normal };
        towards.dot(&edge.lean()) > LEAST.get().sin()
    };
    NearEdge::ALL.into_iter().filter(|&edge| !normals.iter().any(|normal| leans(normal, edge))).collect()
}

/// The photo that would lower the projection's uncertainty most, among the ninths of the frame and five tilts;
/// `None` when none of them could be seen.
///
/// Every candidate's points add what they would tell of the lens, once their pose is paid for, to what is known:
/// Σ' = (Σ⁻¹ + M/σ²)⁻¹.
#[must_use]
pub fn next_photo(calibration: &Calibration) -> Option<NextPhoto> {
    const GRID: (usize, usize) = (12, 9);
    let covariance = calibration.camera.covariance?;
    let sights = FrameSights::new(calibration, GRID.0, GRID.1);
    let now_px = sights.rms_px(&covariance);
    let board = Board::of(calibration)?;
    let tilts = std::iter::once(None).chain(NearEdge::ALL.into_iter().map(Some));
    let photos = FramePart::all().flat_map(|part| tilts.clone().map(move |near| (part, near)));
    photos
        .filter_map(|(part, near)| {
            let information = board.information(&calibration.camera, part, near)?;
            let weighed = covariance * information / calibration.sigma0_px.powi(2);
            let updated = (InteriorCovariance::identity() + weighed).try_inverse()? * covariance;
            let then_px = sights.rms_px(&updated);
            then_px.is_finite().then_some(NextPhoto { part, near, now_px, then_px })
        })
        .min_by(|a, b| a.then_px.total_cmp(&b.then_px))
}

/// The target as the photos showed it.
struct Board {
    points: Vec<Vector3<f64>>,
    middle: Vector3<f64>,
    distance_m: f64,
}

impl Board {
    /// The points of the fullest view, at the median distance of all.
    fn of(calibration: &Calibration) -> Option<Self> {
        let fullest = calibration.views.iter().max_by_key(|view| view.points.len())?;
        let points: Vec<Vector3<f64>> =
            fullest.points.iter().map(|p| Vector3::new(p.board.x_m, p.board.y_m, 0.0)).collect();
        let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        let distance = |view: &super::product::View| {
            let pose = &view.camera_from_board;
            (pose.rotation.matrix() * middle + pose.origin.vector()).norm()
        };
        let distance_m = super::outliers::median(calibration.views.iter().map(distance).collect());
        Some(Self { points, middle, distance_m })
    }

    /// JᵀJ of the interior parameters from a view, its pose eliminated; `None` when less than half of the
    /// points would be seen.
    fn information(
        &self,
        camera: &Camera,
        part: FramePart,
        near: Option<NearEdge>,
    ) -> Option<InteriorCovariance> {
        const TILT: Radians = Radians::from_degrees(35.0);
        let sight = camera.lens.direction_from_pixel(part.middle(camera.width, camera.height))?.normalize();
        // A turn about z × lean tips the far normal towards the lean.
        let turn = near.map_or(Vector3::zeros(), |edge| Vector3::z().cross(&edge.lean()) * TILT.get());
        let facing = Rotation3::rotation_between(&Vector3::z(), &sight)?;
        let rotation = facing * Rotation3::new(turn);
        let mut lens = InteriorCovariance::zeros();
        let mut coupling = SMatrix::<f64, MAX_INTERIOR, 6>::zeros();
        let mut block = Matrix6::zeros();
        let mut seen = 0;
        for point in &self.points {
            let rotated = rotation * (point - self.middle);
            let p = rotated + sight * self.distance_m;
            let Some(projected) = camera.lens.project(&p) else { continue };
            if !camera.contains(projected.pixel) || camera.lens.pixel_from_point(&p).is_none() {
                continue;
            }
            seen += 1;
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&(-projected.by_point * rotated.cross_matrix()));
            by_pose.fixed_columns_mut::<3>(3).copy_from(&projected.by_point);
            lens += projected.by_interior.transpose() * projected.by_interior;
            coupling += projected.by_interior.transpose() * by_pose;
            block += by_pose.transpose() * by_pose;
        }
        if 2 * seen < self.points.len() {
            return None;
        }
        let inverse = super::adjust::inverse_scaled(block)?;
        Some(lens - coupling * inverse * coupling.transpose())
    }
}

#[cfg(test)]
mod tests;
