//! Columns of tables with one row per photo, and the lines above the rows.

use super::ReadError;
use super::declared::Crs;
use super::text::{Delimiter, lines};

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Column {
    /// The photo's file name.
    Frame,
    /// WGS 84 latitude (or the stated geographic CRS's), degrees.
    Latitude,
    /// Longitude, degrees.
    Longitude,
    /// Easting of the CRS, or its longitude in degrees.
    X,
    /// Northing of the CRS, or its latitude in degrees.
    Y,
    /// Height, metres.
    Height,
    /// ω.
    Omega,
    /// φ.
    Phi,
    /// κ.
    Kappa,
    /// Yaw, heading.
    Yaw,
    /// Pitch.
    Pitch,
    /// Roll.
    Roll,
    /// Standard deviation of each horizontal coordinate, metres.
    HorizontalStd,
    /// Standard deviation of the height, metres.
    VerticalStd,
    /// Standard deviation of every coordinate, metres.
    PositionStd,
    /// Standard deviation of the easting or longitude, metres.
    EastStd,
    /// Standard deviation of the northing or latitude, metres.
    NorthStd,
    /// Standard deviation of every angle.
    AngleStd,
    /// Element of the rotation matrix, row by row from 0.
    Matrix(u8),
    /// Not used here.
    Unused,
}

impl Column {
    /// The column that a header's name means; [`Column::Unused`] for a name this reader has no use for.
    #[must_use]
    pub fn named(name: &str) -> Self {
        let mut bare = String::new();
        let mut depth = 0u32;
        for c in name.chars() {
            match c {
                '(' | '[' => depth += 1,
                ')' | ']' => depth = depth.saturating_sub(1),
                _ if depth == 0 && (c.is_alphanumeric() || c == '/') => bare.extend(c.to_lowercase()),
                _ => {}
            }
        }
        match bare.as_str() {
            "label" | "photoid" | "imagename" | "imagefilename" | "image" | "filename" | "file" | "photo"
            | "name" | "imageid" => Self::Frame,
            "latitude" | "lat" => Self::Latitude,
            "longitude" | "lon" | "long" | "lng" => Self::Longitude,
            "x" | "easting" | "east" | "x/east" | "x/easting" | "x/longitude" => Self::X,
            "y" | "northing" | "north" | "y/north" | "y/northing" | "y/latitude" => Self::Y,
            "z" | "altitude" | "alt" | "height" | "elevation" | "z/altitude" | "z/height" => Self::Height,
            "omega" => Self::Omega,
            "phi" => Self::Phi,
            "kappa" => Self::Kappa,
            "yaw" | "heading" => Self::Yaw,
            "pitch" => Self::Pitch,
            "roll" => Self::Roll,
            "accuracyhorz" | "accuracyhorizontal" | "horizontalaccuracy" | "horzaccuracy" | "hacc"
            | "haccuracy" | "accuracyx/y" | "x/yaccuracy" | "accuracyxy" | "xyaccuracy" => {
                Self::HorizontalStd
            }
            "accuracyvert" | "accuracyvertical" | "verticalaccuracy" | "vertaccuracy" | "vacc"
            | "vaccuracy" | "accuracyz" | "zaccuracy" => Self::VerticalStd,
            "accuracyx/y/z" | "accuracyxyz" | "xyzaccuracy" => Self::PositionStd,
            "accuracyx" | "xaccuracy" => Self::EastStd,
            "accuracyy" | "yaccuracy" => Self::NorthStd,
            "accuracyyaw/pitch/roll" | "accuracyomega/phi/kappa" => Self::AngleStd,
            _ => match bare.strip_prefix('r').map(str::as_bytes) {
                Some([row @ b'1'..=b'3', column @ b'1'..=b'3']) => {
                    Self::Matrix((row - b'1') * 3 + (column - b'1'))
                }
                _ => Self::Unused,
            },
        }
    }
}

/// A line without data.
pub(super) fn is_comment(line: &str) -> bool {
    let line = line.trim_start();
    line.is_empty() || line.starts_with('#')
}

/// The lines above the first row of a table.
#[derive(Debug)]
pub(super) struct Head {
    /// Names of the columns as the header writes them; empty without a header.
    pub(super) names: Vec<String>,
    /// The header's line; 0 without one.
    pub(super) place: u64,
    /// From a comment `CoordinateSystem: …`.
    pub(super) crs: Option<Crs>,
    /// From the first row.
    pub(super) delimiter: Delimiter,
}

/// Finds the header of a table: the last line above the rows, a comment or not, whose cells name the photo and at least two
/// more known columns.
///
/// # Errors
/// [`ReadError`] for UTF-16 and for a coordinate system that cannot be used.
pub(super) fn head(bytes: &[u8]) -> Result<Head, ReadError> {
    let mut head = Head { names: Vec::new(), place: 0, crs: None, delimiter: Delimiter::Blanks };
    for (place, line) in lines(bytes)? {
        let Ok(line) = line else { continue };
        let bare = line.trim_start().trim_start_matches('#').trim();
        if let Some((_, crs)) = bare.split_once("CoordinateSystem:").filter(|_| is_comment(line)) {
            head.crs = Some(Crs::of(crs).map_err(|e| e.line(place))?);
            continue;
        }
        let names: Vec<String> = Delimiter::of(bare).cells(bare).into_iter().map(|(_, name)| name).collect();
        let columns: Vec<_> = names.iter().map(|name| Column::named(name)).collect();
        let known = columns.iter().filter(|c| **c != Column::Unused).count();
        if columns.contains(&Column::Frame) && known >= 3 {
            (head.names, head.place) = (names, place);
        } else if !is_comment(line) {
            head.delimiter = Delimiter::of(line);
            break;
        }
    }
    Ok(head)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_as_programs_write_them() {
        let cases = [
            ("imagename", Column::Frame),
            ("# PhotoID", Column::Frame),
            ("Image File Name", Column::Frame),
            ("Latitude [decimal degrees]", Column::Latitude),
            ("X/Longitude", Column::X),
            ("Y/North", Column::Y),
            ("Z/Altitude", Column::Height),
            ("altitude (m)", Column::Height),
            ("Accuracy_X/Y/Z_(m)", Column::PositionStd),
            ("Accuracy_Yaw/Pitch/Roll_(deg)", Column::AngleStd),
            ("Accuracy_X/Y_(m)", Column::HorizontalStd),
            ("Accuracy Vert [meter]", Column::VerticalStd),
            ("Heading", Column::Yaw),
            ("r11", Column::Matrix(0)),
            ("r33", Column::Matrix(8)),
            ("r44", Column::Unused),
            ("Yaw_est", Column::Unused),
            ("X_var", Column::Unused),
            ("", Column::Unused),
        ];
        for (name, column) in cases {
            assert_eq!(Column::named(name), column, "{name}");
        }
    }

    #[test]
    fn the_header_is_the_last_line_above_the_rows_that_names_columns() {
        let found = head(b"# made by x\n# label, lat\n\n#Label,X,Y,Z\na\t1\t2\t3\n#Label,Y,X,Z\n").unwrap();
        assert_eq!((found.place, found.names.len(), found.delimiter), (4, 4, Delimiter::Character('\t')));
        let none = head(b"a.jpg,1,2,3\n").unwrap();
        assert_eq!((none.place, none.names.len(), none.delimiter), (0, 0, Delimiter::Character(',')));
    }
}
