//! Starts of the adjustment for any lens, and the sets of views that have none.

use super::model::LensModel;
use super::product::ViewPoints;
use super::zhang::{self, BoardPose, ClosedForm};
use crate::camera::{Interior, LensKind, MAX_INTERIOR};
use crate::units::Radians;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Board normals closer than this give the same constraint on the camera twice.
const PARALLEL: Radians = Radians::from_degrees(2.0);

/// Fewest points of a view.
const LEAST_POINTS: usize = 6;

/// Why there is no start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StartError {
    /// Too few views.
    #[error("{views} usable views, at least 3 are needed; photograph the target from more directions")]
    TooFewViews {
        /// Views given.
        views: usize,
    },
    /// A view with too few points.
    #[error("view {view} has {points} points, at least 6 that are not on one line are needed")]
    TooFewPoints {
        /// Name of the photo.
        view: String,
        /// Points given.
        points: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("view {view} has a point that is not finite")]
    NotFinite {
        /// Name of the photo.
        view: String,
    },
    /// The photos show the same thing.
    #[error(
        "{views} views, but only {different} different: {first} and {second} show the target in the same place \
         to {apart_px:.2} px"
    )]
    Repeated {
        /// Views given.
        views: usize,
        /// How many of them differ.
        different: usize,
        /// Name of a photo.
        first: String,
        /// Name of a photo that shows the same.
        second: String,
        /// Largest distance between their points, px.
        apart_px: f64,
    },
    /// The board was parallel to itself in too many views.
    #[error(
        "the board stood in only {directions} different direction(s) ({widest_deg:.1}° apart at most), \
         {needed} are needed; tilt the target by 20° to 45° to different sides"
    )]
    Parallel {
        /// Directions of the board's normal more than 2° apart.
        directions: usize,
        /// Largest angle between two normals, degrees.
        widest_deg: f64,
        /// Directions needed.
        needed: usize,
    },
    /// No camera explains the homographies.
    #[error("no camera explains the views: the points are labelled wrongly, or the target is not flat")]
    NoCamera,
}

/// A start for the adjustment.
#[derive(Debug, Clone)]
pub(super) struct Start {
    pub form: ClosedForm,
    pub interior: Interior,
    pub poses: Vec<BoardPose>,
}

/// Candidate starts, for the adjustment to choose from by their cost.
pub(super) fn starts(
    views: &[ViewPoints],
    width: u32,
    height: u32,
    model: &LensModel,
) -> Result<Vec<Start>, StartError> {
    check(views)?;
    // Two directions fix a camera without skew, three one with it.
    let needed = if model.skew() { 3 } else { 2 };
    let frame = Frame::new(width, height);
    if model.kind.is_fisheye() {
        let start = ladder(views, frame, model.kind).ok_or(StartError::NoCamera)?;
        directions(start.poses.iter().map(|pose| pose.rotation * Vector3::z()), needed)?;
        return Ok(vec![start]);
    }
    let homographies = views
        .iter()
        .map(|view| {
            let points = bearings(view, |pixel| Some(frame.centred(pixel).push(1.0)));
            zhang::homography(&points).ok_or_else(|| too_few(view))
        })
        .collect::<Result<Vec<_>, _>>()?;
    // Parallel boards share their vanishing line, hence the normal computed with any interior orientation:
    // a nominal one will do before the true one is known.
    directions(homographies.iter().map(|h| h.column(0).cross(&h.column(1)).normalize()), needed)?;
    let mut forms = vec![ClosedForm::NoSkew, ClosedForm::Centred];
    if model.skew() {
        forms.insert(0, ClosedForm::WithSkew);
    }
    let mut starts: Vec<Start> = forms
        .into_iter()
        .filter_map(|form| closed_form(&homographies, form, frame, views))
        .flatten()
        .collect();
    if starts.is_empty() {
        starts.extend(ladder(views, frame, model.kind));
    }
    if starts.is_empty() { Err(StartError::NoCamera) } else { Ok(starts) }
}

/// The image: its middle, and its larger side as the unit of length.
#[derive(Clone, Copy)]
struct Frame {
    centre: Vector2<f64>,
    unit: f64,
}

impl Frame {
    fn new(width: u32, height: u32) -> Self {
        let centre = Vector2::new(0.5 * (f64::from(width) - 1.0), 0.5 * (f64::from(height) - 1.0));
        Self { centre, unit: f64::from(width.max(height)) }
    }

    fn centred(self, pixel: Vector2<f64>) -> Vector2<f64> {
        (pixel - self.centre) / self.unit
    }

    /// Interior parameters in pixels of K in this frame's units, without lens terms.
    fn interior(self, k: &Matrix3<f64>) -> Interior {
        let mut interior = [0.0; MAX_INTERIOR];
        let affine = [
            k[(0, 0)] * self.unit,
            k[(1, 1)] * self.unit,
            k[(0, 1)] * self.unit,
            k[(0, 2)] * self.unit + self.centre.x,
            k[(1, 2)] * self.unit + self.centre.y,
        ];
        interior[..5].copy_from_slice(&affine);
        interior
    }
}

fn too_few(view: &ViewPoints) -> StartError {
    StartError::TooFewPoints { view: view.name.clone(), points: view.observations.len() }
}

fn check(views: &[ViewPoints]) -> Result<(), StartError> {
    const LEAST_VIEWS: usize = 3;
    if views.len() < LEAST_VIEWS {
        return Err(StartError::TooFewViews { views: views.len() });
    }
    for view in views {
        let finite = |o: &super::target::Observation| {
            [o.board.x_m, o.board.y_m, o.pixel.column, o.pixel.row].iter().all(|v| v.is_finite())
        };
        if !view.observations.iter().all(finite) {
            return Err(StartError::NotFinite { view: view.name.clone() });
        }
        if view.observations.len() < LEAST_POINTS {
            return Err(too_few(view));
        }
    }
    let repeats = repeated(views);
    let different = views.len() - repeats.len();
    match repeats.first() {
        Some(&(first, second, apart_px)) if different < LEAST_VIEWS => Err(StartError::Repeated {
            views: views.len(),
            different,
            first: views[first].name.clone(),
            second: views[second].name.clone(),
            apart_px,
        }),
        _ => Ok(()),
    }
}

/// Views that show the same points of the board in the same places as an earlier one: the earlier one, the
/// view, and the largest distance between their points, px.
pub(super) fn repeated(views: &[ViewPoints]) -> Vec<(usize, usize, f64)> {
    /// Two photos from a tripod differ by their noise only.
    const SAME_PX: f64 = 1.0;
    let apart = |a: &ViewPoints, b: &ViewPoints| {
        let mut largest = 0.0_f64;
        for (p, q) in a.observations.iter().zip(&b.observations) {
            if p.board != q.board {
                return None;
            }
            largest = largest.max(f64::hypot(p.pixel.column - q.pixel.column, p.pixel.row - q.pixel.row));
            if largest > SAME_PX {
                return None;
            }
        }
        (a.observations.len() == b.observations.len()).then_some(largest)
    };
    (1..views.len())
        .filter_map(|i| (0..i).find_map(|j| apart(&views[j], &views[i]).map(|distance| (j, i, distance))))
        .collect()
}

/// Board points of a view with their bearings, where the pixel has one.
fn bearings(
    view: &ViewPoints,
    bearing: impl Fn(Vector2<f64>) -> Option<Vector3<f64>>,
) -> Vec<(Vector2<f64>, Vector3<f64>)> {
    view.observations
        .iter()
        .filter_map(|o| {
            let bearing = bearing(Vector2::new(o.pixel.column, o.pixel.row))?;
            Some((Vector2::new(o.board.x_m, o.board.y_m), bearing))
        })
        .collect()
}

/// Directions of the board's normal in the views, away from the camera, as a lens of 53° would give them; views
/// whose points do not tell are left out.
pub(super) fn nominal_normals(views: &[ViewPoints], width: u32, height: u32) -> Vec<Vector3<f64>> {
    let frame = Frame::new(width, height);
    let finite = |v: &&ViewPoints| {
        v.observations.iter().all(|o| o.pixel.column.is_finite() && o.pixel.row.is_finite())
    };
    views
        .iter()
        .filter(finite)
        .filter_map(|view| {
            let points = bearings(view, |pixel| Some(frame.centred(pixel).push(1.0)));
            let pose = zhang::pose(&zhang::homography(&points)?)?;
            Some(pose.rotation * Vector3::z())
        })
        .collect()
}

/// Counts the directions of the board's normal.
fn directions(normals: impl Iterator<Item = Vector3<f64>>, needed: usize) -> Result<(), StartError> {
    let angle = |a: &Vector3<f64>, b: &Vector3<f64>| a.cross(b).norm().atan2(a.dot(b).abs());
    let normals: Vec<Vector3<f64>> = normals.collect();
    let mut kept: Vec<Vector3<f64>> = Vec::new();
    for normal in &normals {
        if kept.iter().all(|other| angle(normal, other) > PARALLEL.get()) {
            kept.push(*normal);
            if kept.len() == needed {
                return Ok(());
            }
        }
    }
    let pairs = normals.iter().enumerate().flat_map(|(i, a)| normals[..i].iter().map(move |b| (a, b)));
    let widest = pairs.map(|(a, b)| angle(a, b)).fold(0.0, f64::max);
    Err(StartError::Parallel { directions: kept.len(), widest_deg: Radians::new(widest).degrees(), needed })
}

/// Zhang's closed form, with and without the two lens terms that its poses suggest.
fn closed_form(
    homographies: &[Matrix3<f64>],
    form: ClosedForm,
    frame: Frame,
    views: &[ViewPoints],
) -> Option<[Start; 2]> {
    let k = zhang::interior(homographies, form)?;
    let inverse = k.try_inverse()?;
    let poses: Vec<BoardPose> =
        homographies.iter().map(|h| zhang::pose(&(inverse * h))).collect::<Option<_>>()?;
    let plain = frame.interior(&k);
    let mut with_lens = plain;
    (with_lens[5], with_lens[6]) = zhang::radial_terms(&plain, &poses, views);
    Some([with_lens, plain].map(|interior| Start { form, interior, poses: poses.clone() }))
}

/// Poses in closed form for a ladder of focal lengths, lens undistorted, and the rung that fits best.
///
/// Bearings make the poses linear however wide the lens is, so this needs no guess; what it leaves to the
/// adjustment is the distance to the next rung, the principal point and the lens terms.
fn ladder(views: &[ViewPoints], frame: Frame, kind: LensKind) -> Option<Start> {
    // From a fisheye that sees backwards to a telephoto lens, in units of the image's larger side.
    const LOWEST: f64 = 0.15;
    const STEP: f64 = 1.15;
    const RUNGS: i32 = 25;
    let mut best: Option<(f64, f64, Vec<BoardPose>)> = None;
    for rung in 0..RUNGS {
        let focal = LOWEST * STEP.powi(rung);
        let Some((cost, poses)) = rung_of(views, frame, kind, focal) else { continue };
        if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
            best = Some((cost, focal, poses));
        }
    }
    let (_, focal, poses) = best?;
    let k = Matrix3::new(focal, 0.0, 0.0, 0.0, focal, 0.0, 0.0, 0.0, 1.0);
    Some(Start { form: ClosedForm::Ladder, interior: frame.interior(&k), poses })
}

/// Poses for one focal length, and the sum of squared residuals in units of the image.
fn rung_of(views: &[ViewPoints], frame: Frame, kind: LensKind, focal: f64) -> Option<(f64, Vec<BoardPose>)> {
    let mut cost = 0.0;
    let mut poses = Vec::with_capacity(views.len());
    for view in views {
        let points = bearings(view, |pixel| undistorted_bearing(kind, frame.centred(pixel) / focal));
        if points.len() < LEAST_POINTS {
            return None;
        }
        let pose = zhang::pose(&zhang::homography(&points)?)?;
        for o in &view.observations {
            let p = pose.rotation * Vector3::new(o.board.x_m, o.board.y_m, 0.0) + pose.translation;
            let seen = frame.centred(Vector2::new(o.pixel.column, o.pixel.row));
            cost += (undistorted_image(kind, &p)? * focal - seen).norm_squared();
        }
        poses.push(pose);
    }
    cost.is_finite().then_some((cost, poses))
}

/// Unit bearing of an image point in units of the focal length.
fn undistorted_bearing(kind: LensKind, image: Vector2<f64>) -> Option<Vector3<f64>> {
    if !kind.is_fisheye() {
        return Some(image.push(1.0).normalize());
    }
    let theta = image.norm();
    let scale = if theta > 0.0 { theta.sin() / theta } else { 1.0 };
    (theta < std::f64::consts::PI).then(|| (image * scale).push(theta.cos()))
}

/// Image point, in units of the focal length, of a point in the camera frame.
fn undistorted_image(kind: LensKind, point: &Vector3<f64>) -> Option<Vector2<f64>> {
    if !kind.is_fisheye() {
        return (point.z > 0.0).then(|| point.xy() / point.z);
    }
    let r = point.xy().norm();
    let theta = r.atan2(point.z);
    Some(if r > 0.0 { point.xy() * (theta / r) } else { Vector2::zeros() })
}
