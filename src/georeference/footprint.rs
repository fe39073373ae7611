//! What a frame sees of the ground: an outline clipped at the horizon, its area's scale, its tilt.

use super::frame::{GeoreferencedFrame, LocateError};
use crate::camera::ImagePoint;
use crate::geodesy::{Geodetic, WGS84};
use crate::geometry::{Camera, Displacement, Ecef};

/// One corner of the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootprintVertex {
    /// Stored pixel.
    pub pixel: ImagePoint,
    /// Ground point.
    pub position: Geodetic,
}

/// The ground a frame sees.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Footprint {
    /// Outline, clockwise in the image, starting near its top-left corner; not closed.
    pub outline: Vec<FootprintVertex>,
    /// True when part of the image sees no usable ground (horizon, folded lens, missing terrain) and the
    /// outline was drawn in to what does.
    pub clipped: bool,
    /// Ground sample distance at the anchor: square root of the ground area of one pixel, metres.
    pub gsd_m: f64,
    /// Height of the projection centre above the ground at the anchor, metres.
    pub height_above_ground_m: f64,
    /// Angle between the optical axis and straight down, radians.
    pub off_nadir: f64,
    /// The pixel from which the outline was grown: the image centre where that sees ground.
    pub anchor: Option<FootprintVertex>,
}

/// Outline points along each side of the image.
const PER_SIDE: u32 = 16;
/// The outline of a clipped frame is found to this many pixels.
const CLIP_RESOLUTION_PX: f64 = 0.25;

impl Footprint {
    pub(super) fn of(frame: &GeoreferencedFrame) -> Result<Self, LocateError> {
        let (anchor_pixel, anchor) = find_anchor(frame)?;
        let (w, h) = frame.stored_size();
        let (right, bottom) = (f64::from(w) - 0.5, f64::from(h) - 0.5);
        let mut border = Vec::with_capacity(4 * PER_SIDE as usize);
        for (from, to) in [
            ((-0.5, -0.5), (right, -0.5)),
            ((right, -0.5), (right, bottom)),
            ((right, bottom), (-0.5, bottom)),
            ((-0.5, bottom), (-0.5, -0.5)),
        ] {
            for i in 0..PER_SIDE {
                let k = f64::from(i) / f64::from(PER_SIDE);
                border.push(ImagePoint::new(from.0 + k * (to.0 - from.0), from.1 + k * (to.1 - from.1)));
            }
        }
        let mut clipped = false;
        let mut outline = Vec::with_capacity(border.len());
        for edge in border {
            let vertex = match usable_ground(frame, edge) {
                Some(ground) => FootprintVertex { pixel: edge, position: ground.position },
                None => {
                    clipped = true;
                    draw_in(frame, anchor_pixel, anchor.position, edge)
                }
            };
            outline.push(vertex);
        }
        let centre = frame.ecef_from_camera().origin;
        let ground = anchor.position;
        let axis = *frame.ecef_from_camera() * Displacement::<Camera>::new(0.0, 0.0, 1.0);
        let up = WGS84.geodetic_from_ecef(&centre).up();
        Ok(Self {
            outline,
            clipped,
            gsd_m: gsd_at(frame, anchor_pixel, &ground)?,
            height_above_ground_m: WGS84.geodetic_from_ecef(&centre).height.get() - ground.height.get(),
            off_nadir: (-axis.vector().dot(&up.vector())).clamp(-1.0, 1.0).acos(),
            anchor: Some(FootprintVertex { pixel: anchor_pixel, position: ground }),
        })
    }
}

/// The image centre, or the pixel nearest to it on a coarse grid that sees ground.
fn find_anchor(frame: &GeoreferencedFrame) -> Result<(ImagePoint, super::frame::GroundPoint), LocateError> {
    let centre = frame.image_centre();
    let why = match frame.ground_from_pixel(centre) {
        Ok(ground) => return Ok((centre, ground)),
        Err(why) => why,
    };
    const GRID: u32 = 24;
    let (w, h) = frame.stored_size();
    let mut candidates: Vec<ImagePoint> = (0..=GRID)
        .flat_map(|r| (0..=GRID).map(move |c| (c, r)))
        .map(|(c, r)| {
            ImagePoint::new(
                (f64::from(w) - 1.0) * f64::from(c) / f64::from(GRID),
                (f64::from(h) - 1.0) * f64::from(r) / f64::from(GRID),
            )
        })
        .collect();
    let distance = |p: &ImagePoint| (p.column - centre.column).hypot(p.row - centre.row);
    candidates.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    candidates.into_iter().find_map(|p| frame.ground_from_pixel(p).ok().map(|g| (p, g))).ok_or(why)
}

/// The ground of a pixel that is material for a map.
fn usable_ground(frame: &GeoreferencedFrame, pixel: ImagePoint) -> Option<super::frame::GroundPoint> {
    if frame.resolves(pixel) { frame.ground_from_pixel(pixel).ok() } else { None }
}

/// The last pixel that sees ground on the way from the anchor to a border pixel that does not.
fn draw_in(
    frame: &GeoreferencedFrame,
    anchor: ImagePoint,
    anchor_position: Geodetic,
    edge: ImagePoint,
) -> FootprintVertex {
    let length = (edge.column - anchor.column).hypot(edge.row - anchor.row);
    let at = |k: f64| {
        ImagePoint::new(
            anchor.column + k * (edge.column - anchor.column),
            anchor.row + k * (edge.row - anchor.row),
        )
    };
    let (mut seen, mut unseen) = (0.0, 1.0);
    let mut best = FootprintVertex { pixel: anchor, position: anchor_position };
    while (unseen - seen) * length > CLIP_RESOLUTION_PX {
        let mid = 0.5 * (seen + unseen);
        match usable_ground(frame, at(mid)) {
            Some(ground) => {
                best = FootprintVertex { pixel: at(mid), position: ground.position };
                seen = mid;
            }
            None => unseen = mid,
        }
    }
    best
}

/// Square root of the ground area of one pixel, at the ground height under it.
fn gsd_at(frame: &GeoreferencedFrame, pixel: ImagePoint, ground: &Geodetic) -> Result<f64, LocateError> {
    let height = ground.height.get();
    let centre = frame.image_centre();
    // One pixel towards the middle of the image, so that a pixel on its border steps inwards.
    let inwards = |from: f64, to: f64| if from > to { -1.0 } else { 1.0 };
    let step = |dc: f64, dr: f64| -> Result<Displacement<Ecef>, LocateError> {
        let to = ImagePoint::new(pixel.column + dc, pixel.row + dr);
        let there = frame.ground_from_pixel_at_height(to, height)?;
        Ok(WGS84.ecef_from_geodetic(&there.position) - WGS84.ecef_from_geodetic(ground))
    };
    let right = step(inwards(pixel.column, centre.column), 0.0)?;
    let down = step(0.0, inwards(pixel.row, centre.row))?;
    Ok(right.vector().cross(&down.vector()).norm().sqrt())
}
