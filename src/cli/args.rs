//! The command line as typed arguments. What an argument means is said here once, for `--help` and for readers.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use super::exit::EXIT_CODES;
use crate::config::height::VerticalDatum;
use crate::config::quantity::Length;
use crate::config::target::TargetKind;
use crate::stages::Stage;

/// Georeferenced mosaics with a stated accuracy, from UAV photos and the log of their attitude-and-position unit.
#[derive(Debug, Parser)]
#[command(name = "boresight", version, after_help = EXIT_CODES, max_term_width = 100)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// How to talk about it.
    #[command(flatten)]
    pub talk: Talk,
}

/// How much, and in which form, is written to the terminal. Data goes to stdout, everything else to stderr.
#[derive(Debug, Args)]
pub struct Talk {
    /// Form of messages and progress on stderr.
    #[arg(long, global = true, value_enum, default_value_t = LogFormat::Text, value_name = "FORMAT", help_heading = "Messages")]
    pub log: LogFormat,
    /// Say more.
    #[arg(short, long, global = true, conflicts_with = "quiet", help_heading = "Messages")]
    pub verbose: bool,
    /// Say only what went wrong.
    #[arg(short, long, global = true, help_heading = "Messages")]
    pub quiet: bool,
    /// When to use colours; "auto" does on a terminal, unless NO_COLOR is set.
    #[arg(long, global = true, value_enum, default_value_t = Colour::Auto, value_name = "WHEN", help_heading = "Messages")]
    pub color: Colour,
}

/// Form of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people, progress bars on a terminal.
    Text,
    /// One JSON object per line, for programs.
    Json,
}

/// When to use colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Colour {
    /// On a terminal, unless NO_COLOR is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a pipeline: photos and log in, mosaic and accuracy report out.
    Run(RunArguments),
    /// Validate a pipeline file and every input; write nothing.
    Check(CheckArguments),
    /// Look at a folder of photos and logs and write a commented pipeline file that runs.
    Init(InitArguments),
    /// Where on the ground is this pixel, and how sure is that?
    Locate(LocateArguments),
    /// Print every matrix and vector from the Earth to the pixel for one frame.
    Explain(ExplainArguments),
    /// Make a synthetic survey with known truth.
    Simulate(SimulateArguments),
    /// Make a calibration target to print in true size, and the table that declares it in a pipeline.
    Target(Box<TargetArguments>),
    /// Convert a camera file of one program into that of another.
    Camera(CameraArguments),
    /// Print the JSON Schema of the pipeline file.
    Schema,
    /// Print a completion script for a shell.
    Completions {
        /// The shell.
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
}

/// A pipeline file with overrides.
#[derive(Debug, Args)]
pub struct PipelineArguments {
    /// The pipeline file (TOML).
    pub file: PathBuf,
    /// Override a value of the pipeline file, for example mosaic.gsd="20 cm"; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
}

/// `run`.
#[derive(Debug, Args)]
pub struct RunArguments {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArguments,
    /// Run one stage with the products of its predecessors that are in the run folder.
    #[arg(long, value_enum, value_name = "STAGE", conflicts_with = "until")]
    pub only: Option<StageName>,
    /// Stop after this stage.
    #[arg(long, value_enum, value_name = "STAGE")]
    pub until: Option<StageName>,
    /// Run folder, instead of the pipeline file's.
    #[arg(long, short, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Threads; the products do not depend on it. Default: one per core.
    #[arg(long, short, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Write into the run folder although another pipeline made it, or it holds other files.
    #[arg(long)]
    pub force: bool,
    /// Print what would be done; write nothing.
    #[arg(long)]
    pub dry_run: bool,
    /// Print the outcome as JSON.
    #[arg(long)]
    pub json: bool,
}

/// `check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArguments,
    /// Print a table with a row for every frame as well.
    #[arg(long)]
    pub frames: bool,
    /// Measure how sharp each photo is against the others (decodes the photos).
    #[arg(long)]
    pub sharpness: bool,
    /// Compare neighbouring photos on the ground, to find pixels that were turned (decodes the photos).
    #[arg(long)]
    pub overlaps: bool,
    /// Draw how often the ground is seen, with the flight line, into a file .svg or .png.
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Replace the picture if it is there.
    #[arg(long, requires = "picture")]
    pub force: bool,
    /// Print everything as JSON.
    #[arg(long)]
    pub json: bool,
}

/// `init`.
#[derive(Debug, Args)]
pub struct InitArguments {
    /// The folder with photos and, if there are any, logs, camera file and elevation model.
    pub folder: PathBuf,
    /// The pipeline file to write. Default: boresight.toml in the folder.
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace the file if it is there.
    #[arg(long)]
    pub force: bool,
    /// Print what was found, assumed and left open as JSON.
    #[arg(long)]
    pub json: bool,
}

/// `locate`.
#[derive(Debug, Args)]
#[command(
    override_usage = "boresight locate [OPTIONS] <FILE> <FRAME> <COLUMN> <ROW>\n       boresight locate [OPTIONS] <FILE> --pixels <P.csv>"
)]
pub struct LocateArguments {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArguments,
    /// File name of the frame.
    #[arg(required_unless_present = "pixels", conflicts_with = "pixels")]
    pub frame: Option<String>,
    /// Column of the pixel; 0 is the centre of the leftmost pixels.
    #[arg(required_unless_present = "pixels", allow_negative_numbers = true)]
    pub column: Option<f64>,
    /// Row of the pixel; 0 is the centre of the topmost pixels.
    #[arg(required_unless_present = "pixels", allow_negative_numbers = true)]
    pub row: Option<f64>,
    /// Many pixels: a CSV with columns frame, column, row and optionally height_m, the height of the ground for that row.
    #[arg(long, value_name = "P.csv")]
    pub pixels: Option<PathBuf>,
    /// What height_m is measured from. Default: the datum of [georeference.ground]; required where that states none.
    #[arg(long, value_enum, value_name = "DATUM", requires = "pixels")]
    pub height_datum: Option<DatumName>,
    /// Run folder that holds the calibrated camera, instead of the pipeline file's.
    #[arg(long, short, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Print JSON lines instead of CSV.
    #[arg(long)]
    pub json: bool,
}

/// `explain`.
#[derive(Debug, Args)]
pub struct ExplainArguments {
    /// The pipeline.
    #[command(flatten)]
    pub pipeline: PipelineArguments,
    /// File name of the frame.
    pub frame: String,
    /// Run folder that holds the calibrated camera, instead of the pipeline file's.
    #[arg(long, short, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `simulate`.
#[derive(Debug, Args)]
pub struct SimulateArguments {
    /// The scenario (TOML); what it leaves out has the values of the built-in demo.
    pub scenario: PathBuf,
    /// Folder for the survey.
    #[arg(long, short, value_name = "DIR")]
    pub output: PathBuf,
    /// Override a value of the scenario, for example flight.strips=2; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Replace a survey that stands in the folder.
    #[arg(long)]
    pub force: bool,
    /// Print what was written as JSON.
    #[arg(long)]
    pub json: bool,
}

/// `camera`.
#[derive(Debug, Args)]
#[command(
    after_help = "Formats read, recognised by their content: boresight, OpenCV, ROS, Kalibr, OpenDroneMap and OpenSfM,\northority, Metashape, Pix4D, COLMAP, DJI DewarpData."
)]
pub struct CameraArguments {
    /// The camera file.
    pub file: PathBuf,
    /// Format to write: boresight, opencv, ros, odm, kalibr, orthority, metashape, pix4d or colmap.
    #[arg(long, value_name = "FORMAT", default_value = "boresight")]
    pub to: String,
    /// Name of the camera, in a file of several.
    #[arg(long)]
    pub name: Option<String>,
    /// Columns and rows of the photos, for a file that does not state them, for example 4000x3000.
    #[arg(long, value_name = "WxH", value_parser = image_size)]
    pub size: Option<(u32, u32)>,
    /// File to write; without it the camera goes to the terminal.
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace the file if it is there.
    #[arg(long)]
    pub force: bool,
}

fn image_size(text: &str) -> Result<(u32, u32), String> {
    text.split_once(['x', '×', 'X'])
        .and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)))
        .ok_or_else(|| "write columns and rows as 4000x3000".to_owned())
}

/// `target`.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  boresight target squares --rows 7 --columns 7 --square '15.7 mm' --gap '15.7 mm' \\\n      --hollow upper-left -o target.pdf\n  boresight target chessboard --rows 6 --columns 9 --square '25 mm' -o chessboard.svg"
)]
pub struct TargetArguments {
    /// Kind of target.
    #[arg(value_enum)]
    pub kind: TargetName,
    /// Rows of squares, inner corners (chessboard), tags or circles.
    #[arg(long, value_name = "N")]
    pub rows: u32,
    /// Columns of them.
    #[arg(long, value_name = "N")]
    pub columns: u32,
    /// Side of a square, for example "15.7 mm" (squares, chessboard, charuco).
    #[arg(long, value_name = "LENGTH")]
    pub square: Option<Length>,
    /// Space between neighbours (squares, aprilgrid).
    #[arg(long, value_name = "LENGTH")]
    pub gap: Option<Length>,
    /// Which square is hollow (squares). Default: upper-left.
    #[arg(long, value_enum, value_name = "WHICH")]
    pub hollow: Option<HollowName>,
    /// Side of a marker, its black border included (charuco).
    #[arg(long, value_name = "LENGTH")]
    pub marker: Option<Length>,
    /// Side of a tag, its black border included (aprilgrid).
    #[arg(long, value_name = "LENGTH")]
    pub tag: Option<Length>,
    /// Dictionary of the markers, for example "DICT_4X4_50" (charuco) or "tag36h11" (aprilgrid, its default).
    #[arg(long, value_name = "NAME")]
    pub dictionary: Option<String>,
    /// Number of the first marker (charuco, aprilgrid). Default 0.
    #[arg(long, value_name = "N")]
    pub first_marker: Option<u32>,
    /// Leave out the small black squares between the corners of tags (aprilgrid).
    #[arg(long)]
    pub no_joints: bool,
    /// Distance between rows of circles (circles, asymmetric-circles).
    #[arg(long, value_name = "LENGTH")]
    pub spacing: Option<Length>,
    /// Diameter of a circle.
    #[arg(long, value_name = "LENGTH")]
    pub diameter: Option<Length>,
    /// Paper: A5 to A0, LETTER or TABLOID. Default: the smallest of A5 to A0 that holds the target.
    #[arg(long, value_name = "NAME")]
    pub paper: Option<String>,
    /// File to write: .pdf or .svg.
    #[arg(long, short, value_name = "FILE")]
    pub output: PathBuf,
    /// Replace the file if it is there.
    #[arg(long)]
    pub force: bool,
}

/// A kind of target on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TargetName {
    /// Separated black squares: the paper's.
    Squares,
    /// A chessboard, counted by inner corners.
    Chessboard,
    /// A chessboard with markers, counted by squares.
    Charuco,
    /// AprilTags in rows and columns.
    Aprilgrid,
    /// Discs in rows and columns.
    Circles,
    /// Discs of which every second row is moved.
    AsymmetricCircles,
}

impl From<TargetName> for TargetKind {
    fn from(name: TargetName) -> Self {
        match name {
            TargetName::Squares => Self::Squares,
            TargetName::Chessboard => Self::Chessboard,
            TargetName::Charuco => Self::Charuco,
            TargetName::Aprilgrid => Self::Aprilgrid,
            TargetName::Circles => Self::Circles,
            TargetName::AsymmetricCircles => Self::AsymmetricCircles,
        }
    }
}

/// Which square is hollow, on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum HollowName {
    /// The upper left one: tells how the target lies.
    UpperLeft,
    /// None.
    None,
}

/// A stage's name on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum StageName {
    /// Camera from photos, file or parameters.
    Calibrate,
    /// Frames and log to poses and footprints.
    Georeference,
    /// Frames to one map.
    Mosaic,
    /// What the products are worth.
    Accuracy,
}

impl From<StageName> for Stage {
    fn from(name: StageName) -> Self {
        match name {
            StageName::Calibrate => Self::Calibrate,
            StageName::Georeference => Self::Georeference,
            StageName::Mosaic => Self::Mosaic,
            StageName::Accuracy => Self::Accuracy,
        }
    }
}

/// A datum's name on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DatumName {
    /// The WGS 84 ellipsoid.
    Ellipsoid,
    /// The EGM96 geoid (mean sea level).
    Egm96,
    /// The EGM2008 geoid (mean sea level).
    Egm2008,
}

impl From<DatumName> for VerticalDatum {
    fn from(name: DatumName) -> Self {
        match name {
            DatumName::Ellipsoid => Self::Ellipsoid,
            DatumName::Egm96 => Self::Egm96,
            DatumName::Egm2008 => Self::Egm2008,
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn locate_takes_one_pixel_or_a_file_of_them() {
        let parse = |words: &str| Arguments::try_parse_from(words.split(' '));
        assert!(parse("boresight locate p.toml a.jpg -0.5 3").is_ok());
        assert!(parse("boresight locate p.toml --pixels p.csv --height-datum egm96").is_ok());
        assert!(parse("boresight locate p.toml a.jpg 1").is_err());
        assert!(parse("boresight locate p.toml a.jpg 1 2 --pixels p.csv").is_err());
    }
}
