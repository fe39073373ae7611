//! Where the cells of a raster lie on the map.

use crate::geodesy::MapPoint;

/// Affine relation between pixel centres and map positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridTransform {
    /// Map position of the centre of the top-left cell.
    pub origin: MapPoint,
    /// Map step from one column to the next.
    pub per_column: (f64, f64),
    /// Map step from one row to the next.
    pub per_row: (f64, f64),
}

impl GridTransform {
    /// North-up grid with square cells whose top-left *corner* lies at `corner`.
    #[must_use]
    pub fn north_up(corner: MapPoint, cell: f64) -> Self {
        Self {
            origin: MapPoint { easting: corner.easting + 0.5 * cell, northing: corner.northing - 0.5 * cell },
            per_column: (cell, 0.0),
            per_row: (0.0, -cell),
        }
    }
    /// From the six numbers GDAL uses, which count from the corner of the top-left cell; `None` when
    /// rows and columns are not independent.
    #[must_use]
    pub fn from_gdal(t: [f64; 6]) -> Option<Self> {
        let determinant = t[1] * t[5] - t[2] * t[4];
        (determinant != 0.0 && t.iter().all(|v| v.is_finite())).then(|| Self {
            origin: MapPoint { easting: t[0] + 0.5 * (t[1] + t[2]), northing: t[3] + 0.5 * (t[4] + t[5]) },
            per_column: (t[1], t[4]),
            per_row: (t[2], t[5]),
        })
    }
    /// The six numbers GDAL uses.
    #[must_use]
    pub fn to_gdal(&self) -> [f64; 6] {
        let corner = self.map_from_pixel(-0.5, -0.5);
        [
            corner.easting,
            self.per_column.0,
            self.per_row.0,
            corner.northing,
            self.per_column.1,
            self.per_row.1,
        ]
    }
    /// Map position of a pixel; (0, 0) is the centre of the top-left cell.
    #[must_use]
    pub fn map_from_pixel(&self, column: f64, row: f64) -> MapPoint {
        MapPoint {
            easting: self.origin.easting + column * self.per_column.0 + row * self.per_row.0,
            northing: self.origin.northing + column * self.per_column.1 + row * self.per_row.1,
        }
    }
    /// Pixel of a map position.
    #[must_use]
    pub fn pixel_from_map(&self, at: MapPoint) -> (f64, f64) {
        let (e, n) = (at.easting - self.origin.easting, at.northing - self.origin.northing);
        let determinant = self.per_column.0 * self.per_row.1 - self.per_row.0 * self.per_column.1;
        (
            (e * self.per_row.1 - n * self.per_row.0) / determinant,
            (n * self.per_column.0 - e * self.per_column.1) / determinant,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corner_of_gdal_is_half_a_cell_from_our_centre() {
        let t = [500_000.0, 0.2, 0.0, 4_000_000.0, 0.0, -0.2];
        let grid = GridTransform::from_gdal(t).unwrap();
        assert_eq!(grid, GridTransform::north_up(MapPoint { easting: t[0], northing: t[3] }, 0.2));
        let centre = grid.map_from_pixel(0.0, 0.0);
        assert!((centre.easting - 500_000.1).abs() < 1e-9 && (centre.northing - 3_999_999.9).abs() < 1e-9);
        for (back, given) in grid.to_gdal().into_iter().zip(t) {
            assert!((back - given).abs() < 1e-9);
        }
        let turned = GridTransform { per_column: (0.1, 0.05), per_row: (0.05, -0.1), ..grid };
        let (c, r) = turned.pixel_from_map(turned.map_from_pixel(12.5, 7.25));
        assert!((c - 12.5).abs() < 1e-6 && (r - 7.25).abs() < 1e-6);
        assert!(GridTransform::from_gdal([0.0; 6]).is_none());
    }
}
