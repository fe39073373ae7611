//! The CE90 of every place of the map, following the frame that shows the place best.

use super::propagation::{FramePropagation, PixelAccuracy};
use crate::camera::ImagePoint;
use crate::geodesy::{Geodetic, MapPoint, MapProjection, ProjectionError, WGS84};
use crate::mosaic::MapBounds;
use crate::raster::{GridTransform, Raster};
use rayon::prelude::*;

/// Cells along the longer side of a map, at most.
const LONGEST_SIDE: f64 = 400.0;

/// CE90 over the ground the frames see.
#[derive(Debug, Clone, PartialEq)]
pub struct Ce90Map {
    /// Where the cells lie: a grid of square cells aligned to whole multiples of their size.
    pub grid: GridTransform,
    /// Side of a cell, in the map's unit.
    pub cell: f64,
    /// CE90 in metres; NaN where no frame sees the ground or the model moves nothing.
    pub ce90_m: Raster<f32>,
    /// Area of the cells that have a value, m².
    pub area_m2: f64,
}

/// Figures of a [`Ce90Map`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ce90Summary {
    /// Half of the area is better, metres.
    pub median_m: f64,
    /// 95 % of the area is better, metres.
    pub p95_m: f64,
    /// Nothing is worse, metres.
    pub worst_m: f64,
}

impl Ce90Map {
    /// Maps the CE90 of some frames.
    ///
    /// A place takes the frame in which it lies farthest from the image's edge, which is also the frame
    /// that weighs most in the mosaic. That something in between may hide the place is not asked.
    ///
    /// # Errors
    /// [`ProjectionError`] when the frames' outlines have no image on the map. `Ok(None)` without frames.
    pub fn new(
        frames: &[FramePropagation<'_>],
        projection: &dyn MapProjection,
    ) -> Result<Option<Self>, ProjectionError> {
        let mut outlines = Vec::with_capacity(frames.len());
        for propagation in frames {
            let outline = &propagation.frame().footprint.outline;
            let positions: Vec<Geodetic> = outline.iter().map(|vertex| vertex.position).collect();
            let Some(bounds) = MapBounds::around(&projection.map_from_geodetic(&positions)?) else {
                continue;
            };
            outlines.push((propagation, bounds));
        }
        let Some(bounds) = outlines.iter().map(|(_, b)| *b).reduce(|a, b| a.union(&b)) else {
            return Ok(None);
        };
        let cell = round_up(bounds.width().max(bounds.height()) / LONGEST_SIDE);
        let west = (bounds.west / cell).floor() * cell;
        let north = (bounds.north / cell).ceil() * cell;
        let columns = ((bounds.east - west) / cell).ceil().max(1.0) as usize;
        let rows = ((north - bounds.south) / cell).ceil().max(1.0) as usize;
        let grid = GridTransform::north_up(MapPoint { easting: west, northing: north }, cell);
        let lines: Vec<Vec<f32>> = (0..rows)
            .into_par_iter()
            .map(|row| line(&outlines, projection, &grid, row, columns))
            .collect::<Result<_, _>>()?;
        let samples: Vec<f32> = lines.into_iter().flatten().collect();
        let seen = samples.iter().filter(|v| v.is_finite()).count();
        let area_m2 = seen as f64 * cell_area_m2(projection, &grid, columns as f64 / 2.0, rows as f64 / 2.0)?;
        Ok(Raster::new(columns, rows, samples).map(|ce90_m| Self { grid, cell, ce90_m, area_m2 }))
    }

    /// Median, 95th percentile and maximum over the area; `None` when no cell has a value.
    #[must_use]
    pub fn summary(&self) -> Option<Ce90Summary> {
        let mut values: Vec<f32> = self.ce90_m.samples().iter().copied().filter(|v| v.is_finite()).collect();
        values.sort_by(f32::total_cmp);
        let last = values.len().checked_sub(1)?;
        let at = |share: f64| f64::from(values[(share * last as f64).round() as usize]);
        Some(Ce90Summary { median_m: at(0.5), p95_m: at(0.95), worst_m: at(1.0) })
    }

    /// Share of the area whose CE90 is at most `limit_m`, 0 to 1; `None` when no cell has a value.
    #[must_use]
    pub fn share_within(&self, limit_m: f64) -> Option<f64> {
        let seen = self.ce90_m.samples().iter().filter(|v| v.is_finite());
        let (count, good) = seen.fold((0_u64, 0_u64), |(count, good), value| {
            (count + 1, good + u64::from(f64::from(*value) <= limit_m))
        });
        (count > 0).then(|| good as f64 / count as f64)
    }
}

/// 1, 2 or 5 times a power of ten, not below a value.
fn round_up(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|step| *step >= value).unwrap_or(10.0 * power)
}

/// One row of cells.
fn line(
    frames: &[(&FramePropagation<'_>, MapBounds)],
    projection: &dyn MapProjection,
    grid: &GridTransform,
    row: usize,
    columns: usize,
) -> Result<Vec<f32>, ProjectionError> {
    let places: Vec<MapPoint> = (0..columns).map(|c| grid.map_from_pixel(c as f64, row as f64)).collect();
    let positions = projection.geodetic_from_map(&places)?;
    // The best frame so far: how far from its edge, which, and what it says.
    let mut best: Vec<Option<(f64, usize, ImagePoint, Geodetic)>> = vec![None; columns];
    let margin = grid.per_column.0;
    for (index, (propagation, bounds)) in frames.iter().enumerate() {
        let frame = propagation.frame();
        let inside: Vec<usize> = (0..columns)
            .filter(|&c| {
                let at = places[c];
                (bounds.west - margin..=bounds.east + margin).contains(&at.easting)
                    && (bounds.south - margin..=bounds.north + margin).contains(&at.northing)
            })
            .collect();
        let there: Vec<Geodetic> = inside.iter().map(|&c| positions[c]).collect();
        for (&column, (position, height)) in inside.iter().zip(there.iter().zip(frame.ground.heights(&there)))
        {
            let Ok(height) = height else { continue };
            let position = position.at_height(height);
            let Some(pixel) = frame.pixel_from_ecef(&WGS84.ecef_from_geodetic(&position)) else { continue };
            if !frame.contains(pixel) {
                continue;
            }
            let (w, h) = frame.stored_size();
            let edge = (pixel.column + 0.5)
                .min(f64::from(w) - 0.5 - pixel.column)
                .min(pixel.row + 0.5)
                .min(f64::from(h) - 0.5 - pixel.row);
            if best[column].is_none_or(|(so_far, ..)| edge > so_far) {
                best[column] = Some((edge, index, pixel, position));
            }
        }
    }
    Ok(best
        .into_iter()
        .map(|best| {
            best.and_then(|(_, index, pixel, position)| frames[index].0.at_place(pixel, position).ok())
                .and_then(|at: PixelAccuracy| at.ce90_m().ok())
                .map_or(f32::NAN, |ce90| ce90 as f32)
        })
        .collect())
}

/// Area on the ellipsoid of the cell at a column and row, m².
fn cell_area_m2(
    projection: &dyn MapProjection,
    grid: &GridTransform,
    column: f64,
    row: f64,
) -> Result<f64, ProjectionError> {
    let at = |c, r| grid.map_from_pixel(column + c, row + r);
    let ecef: Vec<_> = projection
        .geodetic_from_map(&[at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)])?
        .iter()
        .map(|place| WGS84.ecef_from_geodetic(place))
        .collect();
    Ok((ecef[1] - ecef[0]).vector().cross(&(ecef[2] - ecef[0]).vector()).norm())
}

#[cfg(test)]
mod tests {
    use super::super::model::ErrorModel;
    use super::super::scenes;
    use super::*;
    use crate::geodesy::LocalTangent;
    use crate::geometry::{Ned, Point};

    /// A map whose easting and northing are those of a tangent plane.
    struct Plane(LocalTangent);

    impl MapProjection for Plane {
        fn map_from_geodetic(&self, positions: &[Geodetic]) -> Result<Vec<MapPoint>, ProjectionError> {
            let of = |p: &Geodetic| {
                let ned = scenes::ned_of(&self.0, &p.at_height(700.0));
                MapPoint { easting: ned.y(), northing: ned.x() }
            };
            Ok(positions.iter().map(of).collect())
        }
        fn geodetic_from_map(&self, positions: &[MapPoint]) -> Result<Vec<Geodetic>, ProjectionError> {
            let of = |p: &MapPoint| {
                let in_ned = Point::<Ned>::new(p.northing, p.easting, 0.0);
                WGS84.geodetic_from_ecef(&(*self.0.ecef_from_ned() * in_ned)).at_height(0.0)
            };
            Ok(positions.iter().map(of).collect())
        }
    }

    #[test]
    fn a_cell_says_what_its_pixel_says() {
        let frame = scenes::flight();
        let plane = Plane(LocalTangent::at(frame.record.antenna.at_height(700.0)));
        let model = ErrorModel { position_std_m: 2.0, height_std_m: 5.0, ..ErrorModel::default() };
        let propagation = [FramePropagation::new(&frame, &model).unwrap()];
        let map = Ce90Map::new(&propagation, &plane).unwrap().unwrap();
        let mut compared = 0;
        for row in (0..map.ce90_m.height()).step_by(7) {
            for column in (0..map.ce90_m.width()).step_by(7) {
                let place = map.grid.map_from_pixel(column as f64, row as f64);
                let ground = plane.geodetic_from_map(&[place]).unwrap()[0].at_height(700.0);
                let pixel = frame.pixel_from_ecef(&WGS84.ecef_from_geodetic(&ground));
                let expected = pixel
                    .filter(|p| frame.contains(*p))
                    .and_then(|p| propagation[0].at(p).ok())
                    .map(|at| at.ce90_m().unwrap());
                let found = f64::from(map.ce90_m.at(column, row));
                match expected {
                    Some(expected) => assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}"),
                    None => assert!(found.is_nan(), "{found} where nothing is seen"),
                }
                compared += u32::from(found.is_finite());
            }
        }
        assert!(compared > 500);
        // 1152 × 648 pixels of about 0.48 m, less the folded corners.
        let expected = 1152.0 * 648.0 * 0.4837 * 0.4806;
        assert!((map.area_m2 / expected - 1.0).abs() < 0.15, "{}", map.area_m2);
        let summary = map.summary().unwrap();
        assert!(summary.median_m < summary.p95_m && summary.p95_m < summary.worst_m);
        assert_eq!(map.share_within(summary.worst_m + 1e-6), Some(1.0));
        assert!(map.share_within(summary.median_m).unwrap() > 0.49);
    }

    #[test]
    fn the_frame_that_shows_a_place_best_counts() {
        let near = scenes::flight();
        let mut model = ErrorModel { height_std_m: 5.0, ..ErrorModel::default() };
        let other = scenes::moved_north(&near, 150.0);
        let plane = Plane(LocalTangent::at(near.record.antenna.at_height(700.0)));
        model.position_std_m = 1.0;
        let both =
            [FramePropagation::new(&near, &model).unwrap(), FramePropagation::new(&other, &model).unwrap()];
        let map = Ce90Map::new(&both, &plane).unwrap().unwrap();
        let alone = Ce90Map::new(&both[..1], &plane).unwrap().unwrap();
        // In the overlap two frames never make it worse at the far edge of one of them.
        assert!(map.summary().unwrap().median_m < alone.summary().unwrap().median_m);
        assert!(map.area_m2 > 1.2 * alone.area_m2);
        assert_eq!(Ce90Map::new(&[], &plane).unwrap(), None);
    }

    #[test]
    fn cells_have_round_sizes() {
        for (value, expected) in [(1.0, 1.0), (1.2, 2.0), (0.021, 0.05), (700.0, 1000.0), (4e-5, 5e-5)] {
            assert!((round_up(value) / expected - 1.0).abs() < 1e-12, "{value}");
        }
    }
}
