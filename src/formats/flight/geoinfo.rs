//! Geolocation tables for Pix4D and its kin (senseFly's geoinfo among them): photo, latitude, longitude, height, perhaps
//! angles and accuracies.
//!
//! # Source
//! Pix4D support, "Image geolocation and orientation import format": columns come without a header, or with one in a comment,
//! and in the order of the chosen coordinate system's axes. So nothing is understood by its place alone: either a header
//! names the columns, or they are declared.

use super::columns::{Column, head};
use super::declared::Declared;
use super::poses::{Plan, Table};
use super::text::not_empty;
use super::{Clock, FlightLog, ReadError};

/// Reads a table with one row per photo, parted by commas, semicolons, tabs or blanks.
///
/// A header with ω, φ, κ says what they are. Yaw, pitch, roll it does not settle: Pix4D means those of a camera looking down,
/// senseFly and autopilots those of the UAV, so [`Declared::angles`] is needed. ω, φ, κ beside latitude and longitude count
/// from east and north at the photo itself.
///
/// # Errors
/// [`ReadError`] when the columns, the kind of heights, the CRS of projected positions or the meaning of the angles are
/// neither stated nor declared, and when no row is usable.
pub fn read(bytes: &[u8], declared: &Declared<'_>) -> Result<FlightLog, ReadError> {
    let head = head(bytes)?;
    let (names, columns): (Vec<String>, Vec<Column>) = match declared.columns {
        Some(columns) => {
            // A header may still lend its names to the messages.
            let named = head.names.len() == columns.len();
            let name = |(i, column): (usize, &Column)| {
                if named { head.names[i].clone() } else { format!("column {} ({column:?})", i + 1) }
            };
            (columns.iter().enumerate().map(name).collect(), columns.to_vec())
        }
        None if head.names.is_empty() => {
            return Err(ReadError::new("has no header that names its columns")
                .help("declare its `column_order`: frame, latitude, longitude, height, …"));
        }
        None => (head.names.clone(), head.names.iter().map(|name| Column::named(name)).collect()),
    };
    let mut log = FlightLog::new(Clock::Own);
    let table = Table::new(
        Plan {
            names,
            columns,
            delimiter: head.delimiter,
            crs: head.crs,
            heights: None,
            angles: None,
            angles_need_grid: false,
            declared: *declared,
        },
        &mut log,
    )?;
    table.read_rows(bytes, head.place, &mut log)?;
    not_empty(log, "an image geolocation table")
}

#[cfg(test)]
mod tests;
