//! Tables with one row per photo: columns by name, positions in a stated CRS, angles of a stated system.

use super::angles::{self, AngleSystem, AngleUnit, Axes};
use super::columns::{Column, is_comment};
use super::declared::{Coordinates, Crs, Declared};
use super::text::{Delimiter, bad, lines, number, optional, short, std};
use super::{Exposure, FlightLog, LoggedAttitude, LoggedPosition, LoggedStd, Origin, ReadError};
use crate::geodesy::HeightKind;
use crate::units::Radians;
use nalgebra::Matrix3;
use std::sync::Arc;

/// Beyond, it is no table of poses; rows are looked up by column, so their time counts by this.
const MOST_COLUMNS: usize = 1_000;

/// What one table's columns are.
#[derive(Debug)]
pub(super) struct Table {
    columns: Vec<Column>,
    names: Vec<String>,
    delimiter: Delimiter,
    crs: Crs,
    heights: HeightKind,
    angles: Option<AngleSystem>,
    unit: AngleUnit,
    /// Axes of ω, φ, κ.
    axes: Axes,
    /// Added to every x, y, z.
    pub(super) offset: [f64; 3],
    /// Three zero angles mean that there are none.
    pub(super) zero_angles_are_none: bool,
    origins: Arc<[Origin]>,
}

/// What a reader knows of its format before it looks at the rows.
#[derive(Debug)]
pub(super) struct Plan<'a> {
    /// Names of the columns, as the header or the format has them.
    pub(super) names: Vec<String>,
    /// What they are.
    pub(super) columns: Vec<Column>,
    /// From the first row.
    pub(super) delimiter: Delimiter,
    /// CRS the file states.
    pub(super) crs: Option<Crs>,
    /// Kind of heights that the format's documentation states, where neither file nor user say.
    pub(super) heights: Option<HeightKind>,
    /// Angle system that the format defines for its named columns.
    pub(super) angles: Option<AngleSystem>,
    /// Latitude and longitude columns with ω, φ, κ: the angles count from the declared grid, not from true north.
    pub(super) angles_need_grid: bool,
    /// What the user declares.
    pub(super) declared: Declared<'a>,
}

impl Table {
    /// Puts file, format and declarations together; notes what was understood.
    ///
    /// # Errors
    /// [`ReadError`] for missing or repeated columns, and for whatever is neither stated nor declared.
    pub(super) fn new(plan: Plan<'_>, log: &mut FlightLog) -> Result<Self, ReadError> {
        if plan.columns.len() > MOST_COLUMNS {
            return Err(ReadError::new(format!(
                "has {} columns; a table of poses has at most {MOST_COLUMNS}",
                plan.columns.len()
            )));
        }
        no_repeats(&plan)?;
        let has = |c| plan.columns.contains(&c);
        let geographic = has(Column::Latitude) && has(Column::Longitude);
        let mapped = has(Column::X) && has(Column::Y);
        if !has(Column::Frame) || !(geographic || mapped) || !has(Column::Height) {
            return Err(lacks(&plan, "the photo's name, two horizontal coordinates and a height"));
        }
        let declared_crs = plan.declared.crs.map(Crs::of).transpose()?;
        let stated = plan.crs.clone().or(declared_crs);
        let crs = position_crs(stated.as_ref(), geographic)?;
        let heights = heights(&plan, stated.as_ref(), &crs)?;
        let angles = angle_system(&plan)?;
        let counts_from_grid =
            matches!(angles, Some(AngleSystem::OmegaPhiKappa | AngleSystem::PhiOmegaKappa));
        // A map grid stated beside latitude and longitude is that of the angles.
        let grid = stated.as_ref().filter(|c| geographic && c.coordinates == Coordinates::Grid);
        if counts_from_grid && plan.angles_need_grid && geographic && grid.is_none() {
            return Err(ReadError::new(
                "its omega, phi, kappa count from a map grid that neither it nor the pipeline names",
            )
            .help("declare that grid as `position_crs`"));
        }
        let on_grid = grid.is_some() || matches!(crs.coordinates, Coordinates::Grid | Coordinates::Degrees);
        if counts_from_grid && crs.coordinates == Coordinates::Ecef {
            return Err(ReadError::new("states omega, phi, kappa beside Earth-centred positions")
                .help("export positions and angles in a map projection"));
        }
        log.crs = grid.filter(|_| counts_from_grid).map_or_else(|| crs.kept(), Crs::kept);
        if geographic && let Some(grid) = &stated {
            log.notes.push(match (grid.coordinates, counts_from_grid) {
                (Coordinates::Grid, true) => format!(
                    "Latitude and longitude are WGS 84; omega, phi, kappa count from the grid of {}.",
                    short(&grid.definition)
                ),
                (Coordinates::Grid | Coordinates::Ecef, _) => format!(
                    "Latitude and longitude are WGS 84; the CRS {} is not used.",
                    short(&grid.definition)
                ),
                (Coordinates::Wgs84 | Coordinates::Degrees, _) => {
                    format!("Latitude and longitude are in {}.", short(&grid.definition))
                }
            });
        }
        if counts_from_grid && !on_grid {
            log.notes.push(
                "Omega, phi, kappa count from true east and north at each photo, since no map grid is stated."
                    .to_owned(),
            );
        }
        let table = Self {
            origins: origins(&plan, &crs, heights, angles).into(),
            names: plan.names,
            columns: plan.columns,
            delimiter: plan.delimiter,
            axes: if on_grid { Axes::Grid } else { Axes::Local },
            crs,
            heights,
            angles,
            unit: plan.declared.angle_unit,
            offset: [0.0; 3],
            zero_angles_are_none: false,
        };
        table.notes(log);
        Ok(table)
    }

    fn notes(&self, log: &mut FlightLog) {
        log.origins.extend(self.origins.iter().cloned());
        let unused: Vec<_> = self
            .names
            .iter()
            .zip(&self.columns)
            .filter(|(_, column)| **column == Column::Unused)
            .map(|(name, _)| format!("\"{}\"", short(name)))
            .collect();
        if !unused.is_empty() {
            let some = unused[..unused.len().min(20)].join(", ");
            log.notes.push(format!("Columns that are not used: {some}."));
        }
        let stds = [Column::HorizontalStd, Column::VerticalStd, Column::PositionStd, Column::EastStd];
        if stds.iter().any(|c| self.columns.contains(c)) {
            log.notes.push("Accuracies are taken as one standard deviation of each coordinate.".to_owned());
        }
        if self.columns.contains(&Column::Matrix(0)) && self.angles.is_some() {
            log.notes.push("The matrix r11 … r33 of every row is checked against its angles.".to_owned());
        }
    }

    /// Reads the rows of a text: every line but comments and the header.
    ///
    /// # Errors
    /// As [`lines`] and [`bad`].
    pub(super) fn read_rows(&self, bytes: &[u8], header: u64, log: &mut FlightLog) -> Result<(), ReadError> {
        for (place, line) in lines(bytes)? {
            match line {
                Ok(line) if place == header || is_comment(line) => {}
                Ok(line) => {
                    let mut cells = self.delimiter.cells(line);
                    self.mend(line, &mut cells);
                    let cells: Vec<String> = cells.into_iter().map(|(_, cell)| cell).collect();
                    self.read_cells(place, &cells, log)?;
                }
                Err(cause) => bad(log, place, None, cause)?,
            }
        }
        Ok(())
    }

    /// Reads a row into the log: as an exposure, or as a bad record.
    ///
    /// # Errors
    /// As [`bad`].
    pub(super) fn read_cells(
        &self,
        place: u64,
        cells: &[String],
        log: &mut FlightLog,
    ) -> Result<(), ReadError> {
        let frame = self.cell(cells, Column::Frame).to_owned();
        match self.exposure(place, cells) {
            Ok(exposure) => {
                log.exposures.push(Exposure { frame: Some(frame), ..exposure });
                Ok(())
            }
            Err(cause) => bad(log, place, (!frame.is_empty()).then_some(frame), cause),
        }
    }

    /// A name with blanks leads a row whose cells are parted by blanks: what the numbers leave over is the name.
    fn mend(&self, line: &str, cells: &mut Vec<(usize, String)>) {
        let extra = cells.len().saturating_sub(self.columns.len());
        // A number there is a cell too many rather than a part of the name.
        let named = self.delimiter == Delimiter::Blanks && self.columns.first() == Some(&Column::Frame);
        if named && extra > 0 && self.columns.len() > 1 && cells[extra].1.parse::<f64>().is_err() {
            let end = cells[extra + 1].0;
            let name = line.get(..end).unwrap_or("").trim().trim_matches('"').to_owned();
            cells.splice(..=extra, [(0, name)]);
        }
        // A delimiter at the end of the line.
        while cells.len() > self.columns.len() && cells.last().is_some_and(|(_, cell)| cell.is_empty()) {
            cells.pop();
        }
    }

    fn cell<'a>(&self, cells: &'a [String], column: Column) -> &'a str {
        self.columns.iter().position(|c| *c == column).and_then(|i| cells.get(i)).map_or("", String::as_str)
    }

    fn number(&self, cells: &[String], column: Column) -> Result<f64, String> {
        number(self.name(column), self.cell(cells, column))
    }

    fn name(&self, column: Column) -> &str {
        self.columns.iter().position(|c| *c == column).map_or("", |i| self.names[i].as_str())
    }

    fn exposure(&self, place: u64, cells: &[String]) -> Result<Exposure, String> {
        if cells.len() != self.columns.len() {
            return Err(format!("has {} cells, the table has {} columns", cells.len(), self.columns.len()));
        }
        if self.cell(cells, Column::Frame).is_empty() {
            return Err("names no photo".to_owned());
        }
        Ok(Exposure {
            position: Some(self.position(cells)?),
            attitude: self.attitude(cells)?,
            std: self.std(cells)?,
            origins: Arc::clone(&self.origins),
            ..Exposure::at(place)
        })
    }

    fn position(&self, cells: &[String]) -> Result<LoggedPosition, String> {
        let geographic = self.columns.contains(&Column::Latitude);
        let [x, y] = if geographic { [Column::Longitude, Column::Latitude] } else { [Column::X, Column::Y] };
        let [dx, dy, dz] = self.offset;
        let (x, y, z) = (self.number(cells, x)?, self.number(cells, y)?, self.number(cells, Column::Height)?);
        if [dx, dy] != [0.0; 2] && (x - dx).abs() < x.abs() && (y - dy).abs() < y.abs() {
            return Err(format!("x {x:.1}, y {y:.1} hold the offset {dx:.1}, {dy:.1} already"));
        }
        self.crs.position([x + dx, y + dy, z + dz], self.heights)
    }

    fn attitude(&self, cells: &[String]) -> Result<Option<LoggedAttitude>, String> {
        let Some(system) = self.angles else { return Ok(None) };
        let mut angles = [Radians::new(0.0); 3];
        let mut missing = Vec::new();
        for (angle, name) in angles.iter_mut().zip(system.names()) {
            let column = Column::named(name);
            match optional(self.name(column), self.cell(cells, column))? {
                Some(value) => *angle = self.unit.angle(value),
                None => missing.push(name),
            }
        }
        match missing.len() {
            0 => {}
            3 => return Ok(None),
            _ => return Err(format!("states no {}, but the other angles", missing.join(" and no "))),
        }
        if self.zero_angles_are_none && angles.iter().all(|a| a.get() == 0.0) {
            return Ok(None);
        }
        let attitude = angles::attitude(system, angles, self.axes)?;
        self.check_matrix(cells, system, angles)?;
        Ok(Some(attitude))
    }

    fn check_matrix(
        &self,
        cells: &[String],
        system: AngleSystem,
        angles: [Radians; 3],
    ) -> Result<(), String> {
        if !(0..9).all(|i| self.columns.contains(&Column::Matrix(i))) {
            return Ok(());
        }
        let mut elements = [0.0; 9];
        for (i, element) in (0..).zip(&mut elements) {
            *element = self.number(cells, Column::Matrix(i))?;
        }
        angles::agree(system, angles, &Matrix3::from_row_slice(&elements))
    }

    fn std(&self, cells: &[String]) -> Result<LoggedStd, String> {
        let of = |column| std(self.name(column), self.cell(cells, column));
        let all = of(Column::PositionStd)?;
        let horizontal = of(Column::HorizontalStd)?.or(all);
        let angle = of(Column::AngleStd)?.map(|a| self.unit.angle(a));
        Ok(LoggedStd {
            north_m: of(Column::NorthStd)?.or(horizontal),
            east_m: of(Column::EastStd)?.or(horizontal),
            up_m: of(Column::VerticalStd)?.or(all),
            yaw: angle,
            pitch: angle,
            roll: angle,
        })
    }
}

fn no_repeats(plan: &Plan<'_>) -> Result<(), ReadError> {
    let repeated = plan
        .columns
        .iter()
        .enumerate()
        .find(|(i, column)| **column != Column::Unused && plan.columns[..*i].contains(column));
    match repeated {
        None => Ok(()),
        Some((i, _)) => Err(ReadError::new(format!(
            "column {} (\"{}\") means the same as one before it",
            i + 1,
            short(plan.names.get(i).map_or("", String::as_str))
        ))
        .help("declare the columns")),
    }
}

fn lacks(plan: &Plan<'_>, what: &str) -> ReadError {
    let names: Vec<_> = plan.names.iter().take(30).map(|n| format!("\"{}\"", short(n))).collect();
    ReadError::new(format!("its columns are not {what}: {}", names.join(", ")))
        .help("declare the `column_order`")
}

/// The CRS of the positions: latitude and longitude are WGS 84 unless the CRS is known to be another geographic one.
fn position_crs(stated: Option<&Crs>, geographic: bool) -> Result<Crs, ReadError> {
    let wgs84 = || Crs { definition: "EPSG:4326".to_owned(), coordinates: Coordinates::Wgs84, heights: None };
    match stated {
        Some(crs) if geographic && crs.coordinates != Coordinates::Degrees => {
            Ok(Crs { heights: crs.heights, ..wgs84() })
        }
        Some(crs) => Ok(crs.clone()),
        None if geographic => Ok(wgs84()),
        None => Err(ReadError::new("does not state the coordinate reference system of its positions")
            .help("declare its `position_crs`, for example \"EPSG:32617\"")),
    }
}

fn heights(plan: &Plan<'_>, stated: Option<&Crs>, crs: &Crs) -> Result<HeightKind, ReadError> {
    let of_file = stated.and_then(|c| c.heights).or(crs.heights);
    match (of_file, plan.declared.heights) {
        (Some(file), Some(declared)) if file != declared => Err(ReadError::new(format!(
            "the CRS measures heights from {}, the declaration from {}",
            words(file),
            words(declared)
        ))),
        (Some(kind), _) | (None, Some(kind)) => Ok(kind),
        (None, None) if crs.coordinates == Coordinates::Ecef => Ok(HeightKind::Ellipsoid),
        (None, None) => plan.heights.ok_or_else(|| {
            ReadError::new("does not state what its heights are measured from")
                .help("declare its `height_datum`: ellipsoid, egm96, egm2008, above_takeoff or above_ground")
        }),
    }
}

/// Words for what a height is measured from.
pub(super) fn words(kind: HeightKind) -> String {
    match kind {
        HeightKind::Ellipsoid => "the WGS 84 ellipsoid".to_owned(),
        HeightKind::SeaLevel(model) => format!("mean sea level ({})", model.name()),
        HeightKind::Barometric => "a pressure surface".to_owned(),
        HeightKind::AboveTakeoff => "the take-off point".to_owned(),
        HeightKind::AboveGround => "the ground".to_owned(),
    }
}

/// The system of the angle columns: the one declared, or the one the format defines for the names it has.
fn angle_system(plan: &Plan<'_>) -> Result<Option<AngleSystem>, ReadError> {
    let all = |names: [&str; 3]| names.iter().all(|n| plan.columns.contains(&Column::named(n)));
    let opk = all(AngleSystem::OmegaPhiKappa.names());
    let ypr = all(["yaw", "pitch", "roll"]);
    if !opk && !ypr {
        return Ok(None);
    }
    let ask = |what: &str| {
        ReadError::new(format!("does not state what its angles mean: {what}")).help(
            "declare its `angles`: omega_phi_kappa, phi_omega_kappa, camera_yaw_pitch_roll or body_yaw_pitch_roll, \
             and what yaw is counted from",
        )
    };
    let system = match (plan.declared.angles, plan.angles) {
        (Some(declared), _) => declared,
        (None, Some(format)) => format,
        (None, None) if opk && !ypr => AngleSystem::OmegaPhiKappa,
        (None, None) => return Err(ask("yaw, pitch, roll of the camera or of the UAV, from which north")),
    };
    if all(system.names()) {
        Ok(Some(system))
    } else {
        Err(ReadError::new(format!("has no columns {}", system.names().join(", ")))
            .help("declare `angles` by the columns there are"))
    }
}

fn origins(plan: &Plan<'_>, crs: &Crs, heights: HeightKind, angles: Option<AngleSystem>) -> Vec<Origin> {
    let name = |column| {
        plan.columns
            .iter()
            .position(|c| *c == column)
            .and_then(|i| plan.names.get(i))
            .map_or("", |n| n.as_str())
    };
    let geographic = plan.columns.contains(&Column::Latitude);
    let [x, y] = if geographic { [Column::Longitude, Column::Latitude] } else { [Column::X, Column::Y] };
    let degrees = geographic || matches!(crs.coordinates, Coordinates::Wgs84 | Coordinates::Degrees);
    let (first, second, unit) =
        if degrees { ("longitude", "latitude", "degrees") } else { ("easting", "northing", "CRS units") };
    let place = format!("in {}", short(&crs.definition));
    let mut origins = vec![
        Origin { quantity: first, from: format!("{}, {unit}", name(x)), meaning: place.clone() },
        Origin { quantity: second, from: format!("{}, {unit}", name(y)), meaning: place },
        Origin {
            quantity: "height",
            from: format!("{}, metres", name(Column::Height)),
            meaning: format!("above {}", words(heights)),
        },
    ];
    if let Some(system) = angles {
        let unit = plan.declared.angle_unit.name();
        for angle in system.names() {
            origins.push(Origin {
                quantity: angle,
                from: format!("{}, {unit}", name(Column::named(angle))),
                meaning: system.meaning().to_owned(),
            });
        }
    }
    origins
}
