//! `locate`: pixels to places on the ground, one row out for every row in.

use std::path::Path;

use crate::camera::ImagePoint;
use crate::cli::args::LocateArguments;
use crate::cli::exit::ExitClass;
use crate::cli::output::print;
use crate::config::Config;
use crate::config::height::VerticalDatum;
use crate::formats::InputError;
use crate::formats::table::{Column, Row, Table};
use crate::stages::locate::{Asked, Location, Locator};
use crate::stages::session::Session;
use crate::stages::{ErrorClass, StageError};

pub fn run(arguments: &LocateArguments) -> Result<ExitClass, StageError> {
    let config = Config::load(&arguments.pipeline.file, &arguments.pipeline.overrides)?;
    let datum = arguments.height_datum.map(VerticalDatum::from);
    // The list of pixels first: reading it is quicker than georeferencing a survey.
    let ground_datum = config.georeference.as_ref().and_then(|declared| declared.ground.datum());
    let pixels =
        arguments.pixels.as_deref().map(|file| Pixels::read(file, datum, ground_datum)).transpose()?;
    let session = Session::look(&config, arguments.output.as_deref().unwrap_or(&config.run.output))?;
    let locator = Locator::new(&config, session.survey()?);
    if !locator.knows_spread() {
        tracing::warn!("the pipeline has no [accuracy.sigmas], so the ellipse and CE90 stay empty");
    }
    let mut rows = Rows { json: arguments.json, failed: 0, all: 0 };
    match (&pixels, &arguments.frame, arguments.column, arguments.row) {
        (Some(pixels), ..) => {
            rows.header()?;
            for row in pixels.table.rows() {
                rows.put(&pixels.locate(&locator, &row))?;
            }
        }
        (None, Some(frame), Some(column), Some(row)) => {
            // Alone on the command line, a frame that is not there is an error of its own, with its hint.
            locator.frame(frame)?;
            rows.header()?;
            let asked = Asked { frame: frame.clone(), pixel: ImagePoint::new(column, row), ground: None };
            rows.put(&locator.locate(&asked))?;
        }
        _ => return Err(StageError::new(ErrorClass::Usage, "give FRAME, COLUMN and ROW, or --pixels P.csv")),
    }
    if rows.failed > 0 {
        return Err(StageError::input(format!("{} of {} pixels have no answer", rows.failed, rows.all))
            .help("the column `error` says why, row by row"));
    }
    Ok(ExitClass::Done)
}

/// The rows of `--pixels`.
struct Pixels {
    table: Table,
    frame: Column,
    column: Column,
    row: Column,
    height: Option<(Column, VerticalDatum)>,
}

impl Pixels {
    /// `datum` as asked on the command line, `ground_datum` that of the pipeline's ground.
    fn read(
        file: &Path,
        datum: Option<VerticalDatum>,
        ground_datum: Option<VerticalDatum>,
    ) -> Result<Self, StageError> {
        let refused = |error: InputError| {
            let failure = StageError::input(error.to_string());
            error.help.iter().fold(failure, |failure, help| failure.help(help.clone()))
        };
        let table = Table::read_path(file, b',').map_err(refused)?;
        let column = |name| table.column_named(name).map_err(refused);
        let height = match (table.has("height_m"), datum.or(ground_datum)) {
            (true, Some(datum)) => Some((column("height_m")?, datum)),
            (false, _) if datum.is_none() => None,
            (true, None) => {
                return Err(StageError::new(
                    ErrorClass::Usage,
                    format!("{} has a column height_m, whose datum is not stated", file.display()),
                )
                .help("add --height-datum ellipsoid or --height-datum egm96"));
            }
            (false, _) => {
                return Err(StageError::new(
                    ErrorClass::Usage,
                    format!("--height-datum is given, but {} has no column height_m", file.display()),
                ));
            }
        };
        let (frame, column, row) = (column("frame")?, column("column")?, column("row")?);
        Ok(Self { table, frame, column, row, height })
    }

    fn locate(&self, locator: &Locator<'_>, row: &Row<'_>) -> Location {
        let frame = row.text(self.frame);
        let (column, line) = (row.number(self.column), row.number(self.row));
        let pixel = [column.clone().ok(), line.clone().ok()];
        let read = || -> Result<Asked, String> {
            let ground = match self.height {
                // An empty cell asks for the pipeline's own ground.
                Some((height, _)) if row.text(height).is_empty() => None,
                Some((height, datum)) => Some((row.number(height)?, datum)),
                None => None,
            };
            Ok(Asked { frame: frame.to_owned(), pixel: ImagePoint::new(column?, line?), ground })
        };
        match read() {
            Ok(asked) => locator.locate(&asked),
            Err(error) => locator.failed(frame, pixel, format!("line {}: {error}", row.line())),
        }
    }
}

/// Rows on stdout, each as soon as it is known.
struct Rows {
    json: bool,
    failed: usize,
    all: usize,
}

const HEADER: &str = "frame,column,row,latitude_deg,longitude_deg,height_ellipsoid_m,easting,northing,crs,\
                      ellipse_semi_major_m,ellipse_semi_minor_m,ellipse_azimuth_deg,ce90_m,error\n";

impl Rows {
    fn header(&self) -> Result<(), StageError> {
        if self.json { Ok(()) } else { print(HEADER) }
    }

    fn put(&mut self, location: &Location) -> Result<(), StageError> {
        self.all += 1;
        self.failed += usize::from(!location.error.is_empty());
        let bug = |error: String| StageError::new(ErrorClass::Bug, error);
        if self.json {
            let line = serde_json::to_string(location).map_err(|error| bug(error.to_string()))?;
            return print(&format!("{line}\n"));
        }
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(cells(location)).map_err(|error| bug(error.to_string()))?;
        let line = writer.into_inner().map_err(|error| bug(error.to_string()))?;
        print(&String::from_utf8_lossy(&line))
    }
}

/// A millimetre on the ground is 1e-8 degrees; sigmas are known to two or three digits, map units may be degrees.
fn cells(location: &Location) -> [String; 14] {
    let number = |value: Option<f64>, decimals: usize| {
        value.map_or_else(String::new, |value| format!("{value:.decimals$}"))
    };
    let plain = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let map_decimals = if location.easting.is_some_and(|easting| easting.abs() <= 360.0) { 9 } else { 4 };
    [
        location.frame.clone(),
        plain(location.column),
        plain(location.row),
        number(location.latitude_deg, 9),
        number(location.longitude_deg, 9),
        number(location.height_ellipsoid_m, 3),
        number(location.easting, map_decimals),
        number(location.northing, map_decimals),
        location.crs.clone(),
        number(location.ellipse_semi_major_m, 3),
        number(location.ellipse_semi_minor_m, 3),
        number(location.ellipse_azimuth_deg, 1),
        number(location.ce90_m, 3),
        location.error.clone(),
    ]
}
