//! Pictures over photos of the target: the paper's Fig. 3 (where the calibrated camera sees the points) and Fig. 1
//! (the three estimates of one corner).

use crate::calibration::{DetectedCorner, PointResidual};
use crate::camera::ImagePoint;
use crate::raster::Image8;
use crate::stages::context::{ErrorClass, StageError};
use image::imageops::FilterType;
use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
use std::io::Cursor;

/// Overlays are no larger than this, pixels, so that a run folder can be sent by mail.
const MOST_PX: u32 = 1200;
const RED: Rgb<u8> = Rgb([214, 40, 40]);
const WHITE: Rgb<u8> = Rgb([255, 255, 255]);
const BLUE: Rgb<u8> = Rgb([40, 110, 230]);
const ORANGE: Rgb<u8> = Rgb([240, 140, 20]);

/// What is marked in a photo.
pub(super) enum Marks<'a> {
    /// Points as the calibrated camera sees them.
    Predicted(&'a [PointResidual]),
    /// Points as found, of a photo that is not used.
    Found(&'a [DetectedCorner]),
}

/// PNG of the photo, reduced where it is large, with a small white rectangle outlined in red around every point.
pub(super) fn draw(photo: RgbImage, marks: &Marks) -> Result<Vec<u8>, StageError> {
    let scale = f64::from(MOST_PX) / f64::from(photo.width().max(photo.height()));
    let (mut picture, scale) = if scale < 1.0 {
        let size = |px: u32| ((f64::from(px) * scale).round() as u32).max(1);
        let (width, height) = (size(photo.width()), size(photo.height()));
        let reduced = DynamicImage::ImageRgb8(photo).resize_exact(width, height, FilterType::Triangle);
        (reduced.into_rgb8(), scale)
    } else {
        (photo, 1.0)
    };
    let places: Vec<ImagePoint> = match marks {
        Marks::Predicted(points) => points.iter().map(|p| p.predicted).collect(),
        Marks::Found(corners) => corners.iter().map(|c| c.sharp).collect(),
    };
    // Visible on a screen whatever the photo's size.
    let half = (i64::from(picture.width().max(picture.height())) / 500).max(2);
    for place in places {
        let column = ((place.column + 0.5) * scale - 0.5).round() as i64;
        let row = ((place.row + 0.5) * scale - 0.5).round() as i64;
        for (reach, colour) in [(half + 1, RED), (half, WHITE)] {
            rectangle(&mut picture, (column - reach, row - reach), (column + reach, row + reach), colour);
        }
    }
    png(&picture)
}

/// PNG of one square's surroundings, enlarged: the bounding box in blue, the second estimates as orange rings, the
/// final ones as red crosses.
///
/// - `corners`: the four of one square or tag, or the points around one cell.
pub(super) fn three_steps(photo: RgbImage, corners: &[DetectedCorner]) -> Result<Vec<u8>, StageError> {
    const PICTURE_PX: f64 = 720.0;
    let around = |value: &dyn Fn(&DetectedCorner) -> f64| {
        let (low, high) = corners
            .iter()
            .map(value)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let margin = 4.0 + 0.25 * (high - low);
        ((low - margin).floor().max(0.0), (high + margin).ceil())
    };
    let (left, right) = around(&|c| c.sharp.column);
    let (top, bottom) = around(&|c| c.sharp.row);
    let width = (right.min(f64::from(photo.width() - 1)) - left + 1.0).max(1.0);
    let height = (bottom.min(f64::from(photo.height() - 1)) - top + 1.0).max(1.0);
    let scale = (PICTURE_PX / width.max(height)).floor().max(1.0);
    let cut =
        image::imageops::crop_imm(&photo, left as u32, top as u32, width as u32, height as u32).to_image();
    let size = |px: f64| (px * scale) as u32;
    let mut picture = image::imageops::resize(&cut, size(width), size(height), FilterType::Nearest);
    // Pixel (0, 0) is a centre in the photo and in the picture.
    let place = |p: ImagePoint| {
        let at = |value: f64, from: f64| (value - from + 0.5) * scale - 0.5;
        (at(p.column, left).round() as i64, at(p.row, top).round() as i64)
    };
    for k in 0..corners.len() {
        line(&mut picture, place(corners[k].blunt), place(corners[(k + 1) % corners.len()].blunt), BLUE);
    }
    let reach = (0.35 * scale).max(5.0) as i64;
    for corner in corners {
        ring(&mut picture, place(corner.refined), reach, ORANGE);
        let (x, y) = place(corner.sharp);
        line(&mut picture, (x - reach, y), (x + reach, y), RED);
        line(&mut picture, (x, y - reach), (x, y + reach), RED);
    }
    png(&picture)
}

fn bug() -> StageError {
    StageError::new(ErrorClass::Bug, "the overlay cannot be drawn")
}

/// The photo as an image to draw on.
pub(super) fn rgb(photo: Image8) -> Result<RgbImage, StageError> {
    let (width, height) = (photo.width() as u32, photo.height() as u32);
    RgbImage::from_raw(width, height, photo.into_rgb().samples().to_vec()).ok_or_else(bug)
}

fn png(picture: &RgbImage) -> Result<Vec<u8>, StageError> {
    let mut bytes = Vec::new();
    picture.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).map_err(|e| bug().because(e))?;
    Ok(bytes)
}

fn put(picture: &mut RgbImage, x: i64, y: i64, colour: Rgb<u8>) {
    if x >= 0 && y >= 0 && x < i64::from(picture.width()) && y < i64::from(picture.height()) {
        picture.put_pixel(x as u32, y as u32, colour);
    }
}

fn rectangle(picture: &mut RgbImage, from: (i64, i64), to: (i64, i64), colour: Rgb<u8>) {
    for x in from.0..=to.0 {
        put(picture, x, from.1, colour);
        put(picture, x, to.1, colour);
    }
    for y in from.1..=to.1 {
        put(picture, from.0, y, colour);
        put(picture, to.0, y, colour);
    }
}

/// Three pixels wide.
fn line(picture: &mut RgbImage, from: (i64, i64), to: (i64, i64), colour: Rgb<u8>) {
    let steps = (to.0 - from.0).abs().max((to.1 - from.1).abs()).max(1);
    for k in 0..=steps {
        let along = |a: i64, b: i64| a + (b - a) * k / steps;
        let (x, y) = (along(from.0, to.0), along(from.1, to.1));
        for dy in -1..=1 {
            for dx in -1..=1 {
                put(picture, x + dx, y + dy, colour);
            }
        }
    }
}

/// Two pixels wide.
fn ring(picture: &mut RgbImage, (x, y): (i64, i64), radius: i64, colour: Rgb<u8>) {
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let square = dx * dx + dy * dy;
            if square <= radius * radius && square > (radius - 2) * (radius - 2) {
                put(picture, x + dx, y + dy, colour);
            }
        }
    }
}
