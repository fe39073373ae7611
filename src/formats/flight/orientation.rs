//! Exterior orientations that other programs computed: Pix4D, Metashape, orthority. Each is known by its own header.
//!
//! # Source
//! Pix4D support, "What does the output params folder contain?"; Agisoft Metashape manual, "Export cameras" and "Reference
//! pane"; orthority documentation, "CSV exterior parameters" and "Orthority exterior parameters".

use super::angles::{self, AngleSystem, AngleUnit, Axes};
use super::columns::{Column, Head, head};
use super::declared::{Coordinates, Crs, Declared};
use super::json::{three, without_nan};
use super::poses::{Plan, Table, words};
use super::text::{bad, lines, not_empty, number, short};
use super::{Clock, Exposure, FlightLog, North, Origin, ReadError};
use crate::geodesy::HeightKind;
use crate::units::Radians;
use serde_json::Value;
use std::sync::Arc;

/// Columns of Pix4D's `…_calibrated_images_position.txt`, which has no header: for [`Declared::columns`].
pub const PIX4D_IMAGES_POSITION: [Column; 4] = [Column::Frame, Column::X, Column::Y, Column::Height];

/// The program that wrote a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Program {
    /// `imageName X Y Z Omega Phi Kappa`, degrees, in the output coordinate system.
    Pix4d,
    /// `# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11, … r33`.
    MetashapeAngles,
    /// `Label,X/Longitude,Y/Latitude,Z/Altitude,Yaw,Pitch,Roll,…`.
    MetashapeReference,
    /// `filename`, `x y z` or `latitude longitude altitude`, `omega phi kappa` or `roll pitch yaw`.
    Orthority,
    /// The columns are declared.
    Declared,
}

impl Program {
    fn of(head: &Head, declared: &Declared<'_>) -> Result<Self, ReadError> {
        let bare = |name: &String| name.trim().to_lowercase();
        let names: Vec<String> = head.names.iter().map(bare).collect();
        let has = |name: &str| names.iter().any(|n| n == name);
        if declared.columns.is_some() {
            Ok(Self::Declared)
        } else if names == ["imagename", "x", "y", "z", "omega", "phi", "kappa"] {
            Ok(Self::Pix4d)
        } else if has("photoid") {
            Ok(Self::MetashapeAngles)
        } else if has("label") {
            Ok(Self::MetashapeReference)
        } else if has("filename") {
            Ok(Self::Orthority)
        } else {
            Err(ReadError::new("has no header of Pix4D, Metashape or orthority")
                .help("declare its `column_order`: frame, x, y, height, omega, phi, kappa, …"))
        }
    }

    /// What the program's documentation says of its angle columns; `None` where it leaves something open.
    fn angles(self, columns: &[Column], grid: bool) -> Option<AngleSystem> {
        if columns.contains(&Column::Omega) {
            return Some(AngleSystem::OmegaPhiKappa);
        }
        match self {
            Self::Orthority => Some(AngleSystem::CameraYawPitchRoll(North::True)),
            // Whether a yaw beside map coordinates counts from grid or true north is not documented.
            Self::MetashapeReference if !grid => Some(AngleSystem::CameraYawPitchRoll(North::True)),
            _ => None,
        }
    }
}

/// Reads a table or a GeoJSON of exterior orientations.
///
/// `offset`: the bytes of Pix4D's `…_offset.xyz`, when the positions were written less that offset; refused when they hold
/// it already. The matrix r11 … r33 of Metashape's table must agree with its angles to 1e-4.
///
/// ω, φ, κ beside map coordinates count from the map's grid. Beside WGS 84 degrees they count from east and north at the
/// camera, except in orthority's files: there from the grid of [`Declared::crs`].
///
/// # Errors
/// [`ReadError`] when the file is none of these, when CRS, kind of heights or the meaning of angles is neither stated nor
/// declared, and when no record is usable.
pub fn read(bytes: &[u8], declared: &Declared<'_>, offset: Option<&[u8]>) -> Result<FlightLog, ReadError> {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    if text.trim_ascii_start().first() == Some(&b'{') {
        return geojson(bytes, declared);
    }
    let head = head(bytes)?;
    let program = Program::of(&head, declared)?;
    let columns: Vec<Column> = match declared.columns {
        Some(columns) => columns.to_vec(),
        None => head.names.iter().map(|name| Column::named(name)).collect(),
    };
    let names = match declared.columns {
        Some(columns) if columns.len() != head.names.len() => {
            (1..).zip(columns).map(|(i, column)| format!("column {i} ({column:?})")).collect()
        }
        _ => head.names.clone(),
    };
    let geographic = columns.contains(&Column::Latitude);
    let stated = match &head.crs {
        Some(crs) => Some(crs.clone()),
        None => declared.crs.map(Crs::of).transpose()?,
    };
    let degrees = |crs: &Crs| matches!(crs.coordinates, Coordinates::Wgs84 | Coordinates::Degrees);
    let grid = !geographic && !stated.as_ref().is_some_and(degrees);
    let mut log = FlightLog::new(Clock::Own);
    let plan = Plan {
        angles: program.angles(&columns, grid),
        names,
        columns,
        delimiter: head.delimiter,
        crs: head.crs,
        // Orthority's own default for latitude, longitude, altitude is EPSG:4979.
        heights: (program == Program::Orthority && geographic).then_some(HeightKind::Ellipsoid),
        angles_need_grid: program == Program::Orthority,
        declared: *declared,
    };
    let mut table = Table::new(plan, &mut log)?;
    if let Some(offset) = offset {
        table.offset = offset_of(offset, program)?;
        let [x, y, z] = table.offset;
        log.notes.push(format!("The offset {x}, {y}, {z} is added to every position."));
    }
    table.read_rows(bytes, head.place, &mut log)?;
    not_empty(log, "exterior orientation")
}

/// Three numbers parted by blanks or commas.
fn offset_of(bytes: &[u8], program: Program) -> Result<[f64; 3], ReadError> {
    if !matches!(program, Program::Pix4d | Program::Declared) {
        return Err(
            ReadError::new("only Pix4D's tables come with an offset file").help("leave the offset out")
        );
    }
    let mut numbers = Vec::new();
    for (_, line) in lines(bytes)? {
        let line = line.map_err(|e| ReadError::new(format!("the offset file {e}")))?;
        for cell in line.split([' ', '\t', ',', ';']).filter(|c| !c.is_empty()).take(4) {
            let value =
                number("offset", cell).map_err(|e| ReadError::new(format!("in the offset file {e}")))?;
            numbers.push(value);
        }
        if numbers.len() > 3 {
            break;
        }
    }
    let count = numbers.len();
    <[f64; 3]>::try_from(numbers)
        .map_err(|_| ReadError::new(format!("the offset file holds {count} numbers or more, not three")))
}

/// The parts of orthority's GeoJSON that are read here.
#[derive(serde::Deserialize)]
struct Collection {
    world_crs: Option<String>,
    features: Vec<Value>,
}

fn geojson(bytes: &[u8], declared: &Declared<'_>) -> Result<FlightLog, ReadError> {
    let collection: Collection = serde_json::from_slice(&without_nan(bytes))
        .map_err(|e| ReadError::new(format!("is no GeoJSON of exterior orientations ({e})")))?;
    let stated = collection.world_crs.as_deref().or(declared.crs).ok_or_else(|| {
        ReadError::new("does not state the coordinate reference system of its positions (world_crs)")
            .help("declare its `position_crs`, for example \"EPSG:32617\"")
    })?;
    let crs = Crs::of(stated)?;
    if crs.coordinates != Coordinates::Grid {
        return Err(ReadError::new(format!("world_crs \"{}\" is no map projection", short(stated))));
    }
    let heights = match (crs.heights, declared.heights) {
        (Some(kind), _) | (None, Some(kind)) => kind,
        (None, None) => {
            return Err(ReadError::new("its world_crs does not state what heights are measured from").help(
                "declare its `height_datum`: ellipsoid, egm96, egm2008, above_takeoff or above_ground",
            ));
        }
    };
    let mut log = FlightLog::new(Clock::Own);
    log.crs = crs.kept();
    let origins: Arc<[Origin]> = geojson_origins(&crs, heights).into();
    for (place, feature) in (1..).zip(&collection.features) {
        let properties = feature.get("properties");
        let get = |name: &str| properties.and_then(|p| p.get(name));
        let frame = get("filename").and_then(Value::as_str).filter(|f| !f.is_empty()).map(str::to_owned);
        let exposure = || -> Result<Exposure, String> {
            let frame = frame.clone().ok_or("names no photo (filename)")?;
            let position = crs.position(three("xyz", get("xyz"))?, heights)?;
            let opk = three("opk", get("opk"))?.map(Radians::new);
            let attitude = angles::attitude(AngleSystem::OmegaPhiKappa, opk, Axes::Grid)?;
            Ok(Exposure {
                frame: Some(frame),
                position: Some(position),
                attitude: Some(attitude),
                origins: Arc::clone(&origins),
                ..Exposure::at(place)
            })
        };
        match exposure() {
            Ok(exposure) => log.exposures.push(exposure),
            Err(cause) => bad(&mut log, place, frame.clone(), cause)?,
        }
    }
    log.origins = origins.to_vec();
    not_empty(log, "orthority's GeoJSON")
}

fn geojson_origins(crs: &Crs, heights: HeightKind) -> Vec<Origin> {
    let unit = AngleUnit::Radians.name();
    vec![
        Origin {
            quantity: "position",
            from: "properties.xyz, CRS units and metres".to_owned(),
            meaning: format!("in {}, height above {}", short(&crs.definition), words(heights)),
        },
        Origin {
            quantity: "omega, phi, kappa",
            from: format!("properties.opk, {unit}"),
            meaning: AngleSystem::OmegaPhiKappa.meaning().to_owned(),
        },
    ]
}

#[cfg(test)]
mod tests;
