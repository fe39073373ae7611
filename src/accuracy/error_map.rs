//! The paper's Fig. 7: how far every pixel's ground point moves when one angle changes by a given amount.

use crate::camera::ImagePoint;
use crate::geodesy::{LocalTangent, WGS84};
use crate::georeference::{FrameError, GeoreferencedFrame};
use crate::units::Radians;
use rayon::prelude::*;
use std::sync::Arc;

/// An angle of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Angle {
    /// Gimbal elevation, positive up (the paper's tilt of sect. 4.1).
    Tilt,
    /// Gimbal pan.
    Pan,
    /// Roll of the UAV.
    Roll,
    /// Pitch of the UAV.
    Pitch,
    /// Yaw of the UAV.
    Yaw,
}

impl Angle {
    /// Name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tilt => "tilt",
            Self::Pan => "pan",
            Self::Roll => "roll",
            Self::Pitch => "pitch",
            Self::Yaw => "yaw",
        }
    }
}

/// A regular grid of pixels over a stored image: the centres of equal cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelGrid {
    /// Image width, pixels.
    pub image_width: u32,
    /// Image height, pixels.
    pub image_height: u32,
    /// Cells across.
    pub columns: usize,
    /// Cells down.
    pub rows: usize,
}

impl PixelGrid {
    /// A grid over a frame's stored image; `None` when it has no cells or more cells than pixels.
    #[must_use]
    pub fn over(frame: &GeoreferencedFrame, columns: usize, rows: usize) -> Option<Self> {
        let (image_width, image_height) = frame.stored_size();
        let fits =
            (1..=image_width as usize).contains(&columns) && (1..=image_height as usize).contains(&rows);
        fits.then_some(Self { image_width, image_height, columns, rows })
    }
    /// Pixels from one cell to the next, across and down.
    #[must_use]
    pub fn step(&self) -> (f64, f64) {
        (f64::from(self.image_width) / self.columns as f64, f64::from(self.image_height) / self.rows as f64)
    }
    /// Stored pixel at the centre of a cell.
    #[must_use]
    pub fn pixel(&self, column: usize, row: usize) -> ImagePoint {
        let (across, down) = self.step();
        ImagePoint::new((column as f64 + 0.5) * across - 0.5, (row as f64 + 0.5) * down - 0.5)
    }
    /// Stored pixels of all cells, row by row.
    #[must_use]
    pub fn pixels(&self) -> Vec<ImagePoint> {
        (0..self.rows)
            .flat_map(|row| (0..self.columns).map(move |column| (column, row)))
            .map(|(column, row)| self.pixel(column, row))
            .collect()
    }
}

/// A ground point's displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundShift {
    /// Metres north.
    pub north_m: f64,
    /// Metres east.
    pub east_m: f64,
}

impl GroundShift {
    /// Its length, metres.
    #[must_use]
    pub fn radial_m(&self) -> f64 {
        self.north_m.hypot(self.east_m)
    }
}

/// Displacements over a grid of pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorMap {
    /// Where.
    pub grid: PixelGrid,
    /// Row by row; `None` where the pixel sees no ground before or after the change.
    pub cells: Vec<Option<GroundShift>>,
}

/// A frame whose one angle is changed.
///
/// # Errors
/// As [`GeoreferencedFrame::new`].
pub fn turned(
    frame: &GeoreferencedFrame,
    angle: Angle,
    by: Radians,
) -> Result<GeoreferencedFrame, FrameError> {
    let mut record = frame.record.clone();
    let mut mount = frame.mount;
    let gimbal = record.gimbal.as_mut().unwrap_or(&mut mount.gimbal);
    let turned = match angle {
        Angle::Tilt => &mut gimbal.elevation,
        Angle::Pan => &mut gimbal.pan,
        Angle::Roll => &mut record.attitude.roll,
        Angle::Pitch => &mut record.attitude.pitch,
        Angle::Yaw => &mut record.attitude.yaw,
    };
    *turned = *turned + by;
    GeoreferencedFrame::new(
        frame.name.clone(),
        record,
        &mount,
        Arc::clone(&frame.camera),
        Arc::clone(&frame.ground),
        frame.max_range_m,
    )
}

/// How far a pixel's ground point lies from another's, north and east at the first.
#[must_use]
pub fn shift_between(
    from: &GeoreferencedFrame,
    to: &GeoreferencedFrame,
    pixel: ImagePoint,
) -> Option<GroundShift> {
    let here = from.ground_from_pixel(pixel).ok()?.position;
    let there = to.ground_from_pixel(pixel).ok()?.position;
    let in_ned = LocalTangent::at(here).ecef_from_ned().inverse() * WGS84.ecef_from_geodetic(&there);
    Some(GroundShift { north_m: in_ned.x(), east_m: in_ned.y() })
}

/// The error map of one angle: exact, through the whole chain, not linearised.
///
/// # Errors
/// As [`GeoreferencedFrame::new`] for the changed frame.
///
/// # Source
/// Hemerly (2014), Fig. 7.
pub fn error_map(
    frame: &GeoreferencedFrame,
    angle: Angle,
    by: Radians,
    grid: PixelGrid,
) -> Result<ErrorMap, FrameError> {
    let changed = turned(frame, angle, by)?;
    let cells = grid.pixels().into_par_iter().map(|pixel| shift_between(frame, &changed, pixel)).collect();
    Ok(ErrorMap { grid, cells })
}
