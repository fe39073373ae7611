//! The paper's Fig. 3: where the calibrated camera sees the target's corners, over the photo.

use crate::calibration::PointResidual;
use crate::raster::Image8;
use crate::stages::context::{ErrorClass, StageError};
use image::{ImageFormat, Rgb, RgbImage};
use std::io::Cursor;

/// PNG of the photo with a small white rectangle, outlined in red, around every predicted point.
pub(super) fn draw(photo: Image8, points: &[PointResidual]) -> Result<Vec<u8>, StageError> {
    let bug = || StageError::new(ErrorClass::Bug, "the overlay cannot be drawn");
    let (width, height) = (photo.width(), photo.height());
    let mut picture = RgbImage::from_raw(width as u32, height as u32, photo.into_rgb().samples().to_vec())
        .ok_or_else(bug)?;
    // Visible on a screen whatever the photo's size.
    let half = (width.max(height) as i64 / 500).max(2);
    for point in points {
        let column = point.predicted.column.round() as i64;
        let row = point.predicted.row.round() as i64;
        for (reach, colour) in [(half + 1, Rgb([214, 40, 40])), (half, Rgb([255, 255, 255]))] {
            for along in -reach..=reach {
                for (dx, dy) in [(along, -reach), (along, reach), (-reach, along), (reach, along)] {
                    let (x, y) = (column + dx, row + dy);
                    if x >= 0 && y >= 0 && x < width as i64 && y < height as i64 {
                        picture.put_pixel(x as u32, y as u32, colour);
                    }
                }
            }
        }
    }
    let mut bytes = Vec::new();
    picture.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).map_err(|e| bug().because(e))?;
    Ok(bytes)
}
