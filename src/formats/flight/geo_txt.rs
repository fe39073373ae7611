//! OpenDroneMap's `geo.txt`: a CRS, then `image x y [z] [yaw pitch roll] [h_accuracy v_accuracy]`, parted by blanks.
//!
//! # Source
//! OpenDroneMap documentation, "Image Geolocation Files", and `opendm/geo.py`: the first line is `EPSG:n`, a PROJ string or
//! `WGS84 UTM 17N`; x is the easting or longitude; angles may be 0 where there are none. Up to 2022 the three angles were
//! read as ω, φ, κ (issue 1473), since then as yaw, pitch, roll of a camera whose pitch 0 looks straight down.

use super::angles::AngleSystem;
use super::columns::{Column, is_comment};
use super::declared::{Crs, Declared};
use super::poses::{Plan, Table};
use super::text::{Delimiter, bad, lines, not_empty, short};
use super::{Clock, FlightLog, ReadError};

/// Reads a `geo.txt`. [`Declared::crs`] and [`Declared::columns`] are not used: the file states both.
///
/// # Errors
/// [`ReadError`] when the first line is no CRS, when rows hold angles and [`Declared::angles`] does not say which, when
/// neither the CRS nor [`Declared::heights`] says what heights are measured from, and when no row is usable.
pub fn read(bytes: &[u8], declared: &Declared<'_>) -> Result<FlightLog, ReadError> {
    let mut log = FlightLog::new(Clock::Own);
    let (crs_place, crs) = crs(bytes)?;
    let rows = || Ok(lines(bytes)?.filter(|(place, line)| *place > crs_place && !is_blank(line)));
    let with_angles = rows()?.find_map(|(place, line)| {
        let cells = cells(line.ok()?);
        has_angles(&cells).then_some((place, cells))
    });
    let angles = match (declared.angles, with_angles) {
        (Some(angles), _) => angles,
        (None, None) => AngleSystem::CameraYawPitchRoll(super::North::True),
        (None, Some((place, cells))) => {
            return Err(ReadError::new(format!(
                "columns 5 to 7 hold angles ({}): yaw, pitch, roll in new files, omega, phi, kappa in old ones",
                short(&cells[4..7].join(" "))
            ))
            .line(place)
            .help("declare its `angles`: camera_yaw_pitch_roll or omega_phi_kappa"));
        }
    };
    let table = table(crs, angles, declared, &mut log)?;
    for (place, line) in rows()? {
        let mut cells = match line {
            Ok(line) => cells(line),
            Err(cause) => {
                bad(&mut log, place, None, cause)?;
                continue;
            }
        };
        if cells.len() < 3 {
            let cause = format!("has {} cells, at least image, x and y are needed", cells.len());
            bad(&mut log, place, cells.first().cloned(), cause)?;
            continue;
        }
        // Four to six cells hold no angles, eight no accuracies; what is behind the ninth is a label.
        match cells.len() {
            ..7 => cells.truncate(4),
            7..9 => cells.truncate(7),
            _ => cells.truncate(9),
        }
        cells.resize(9, String::new());
        table.read_cells(place, &cells, &mut log)?;
    }
    log.notes.push(
        "Three angles that are all 0 are taken for none, as ODM's documentation writes them.".to_owned(),
    );
    not_empty(log, "a geo.txt")
}

/// An empty line, or a comment.
fn is_blank(line: &Result<&str, String>) -> bool {
    line.as_ref().is_ok_and(|line| is_comment(line))
}

fn cells(line: &str) -> Vec<String> {
    Delimiter::Blanks.cells(line).into_iter().map(|(_, cell)| cell).collect()
}

/// The first line with something on it.
fn crs(bytes: &[u8]) -> Result<(u64, Crs), ReadError> {
    for (place, line) in lines(bytes)? {
        let line = line.map_err(|cause| ReadError::new(cause).line(place))?.trim();
        if !line.is_empty() {
            return Crs::of(line).map(|crs| (place, crs)).map_err(|e| e.line(place));
        }
    }
    Err(ReadError::new("is empty").help("the first line of a geo.txt is its CRS: EPSG:n"))
}

/// A row whose fifth to seventh cells are angles: not all 0, not NaN.
fn has_angles(cells: &[String]) -> bool {
    cells.len() >= 7 && cells[4..7].iter().any(|c| c.parse::<f64>().is_ok_and(|v| v != 0.0 && !v.is_nan()))
}

fn table(
    crs: Crs,
    angles: AngleSystem,
    declared: &Declared<'_>,
    log: &mut FlightLog,
) -> Result<Table, ReadError> {
    let [a, b, c] = angles.names();
    let names = ["image", "geo_x", "geo_y", "geo_z", a, b, c, "horz accuracy", "vert accuracy"];
    let mut columns: Vec<_> = names.iter().map(|name| Column::named(name)).collect();
    columns[..4].copy_from_slice(&[Column::Frame, Column::X, Column::Y, Column::Height]);
    let plan = Plan {
        names: names.map(str::to_owned).to_vec(),
        columns,
        delimiter: Delimiter::Blanks,
        crs: Some(crs),
        heights: None,
        angles: Some(angles),
        angles_need_grid: false,
        declared: Declared { crs: None, angles: Some(angles), columns: None, ..*declared },
    };
    let mut table = Table::new(plan, log)?;
    table.zero_angles_are_none = true;
    Ok(table)
}

#[cfg(test)]
mod tests;
