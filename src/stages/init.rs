//! `init`: a folder of photos and logs in, a commented pipeline file that runs out.
//!
//! What lies in the folder is recognised by its content ([`scan`]), one source is chosen for poses, camera and ground, each
//! with its reason, and the file is tried in memory before it is written. What was taken for true without being stated stands
//! in the file as "assumed", what only the user can decide as "QUESTION", with a value that holds meanwhile.

mod camera;
mod ground;
mod mount;
mod poses;
mod scan;
mod sigmas;
mod tables;
mod write;

use super::georeference::RejectedFrame;
use super::session::{MosaicSize, Session};
use super::{ErrorClass, StageError};
use crate::config::Config;
use crate::formats::atomic;
use crate::synthetic::Scenario;
use poses::Source;
use scan::{FileKind, PhotoFolder, Scan, shown};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use write::{Line, Rendered, comment, quoted, quoted_path, render, text};

/// The file's name in the folder, unless another is asked for.
pub const FILE_NAME: &str = "boresight.toml";
/// A source that places this share of the photos needs no other tried.
const ENOUGH: f64 = 0.9;
/// Sources that are tried.
const MOST_TRIED: usize = 4;

/// What was written.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Written {
    /// The pipeline file.
    pub file: PathBuf,
    /// Photos of the survey.
    pub photos: usize,
    /// Where poses come from.
    pub poses: String,
    /// Photos that get a pose and a footprint.
    pub frames_used: usize,
    /// The others.
    pub frames_rejected: Vec<RejectedFrame>,
    /// The mosaic's size.
    pub mosaic: Option<MosaicSize>,
    /// Why the file does not run as it stands, when it does not.
    pub failure: Option<String>,
    /// What only the user can decide.
    pub questions: Vec<String>,
    /// What was taken for true.
    pub assumptions: Vec<String>,
    /// What was found and not used, and why.
    pub left_out: Vec<String>,
}

/// What is known of the folder.
struct Survey<'a> {
    /// The folder that was named.
    root: &'a Path,
    /// The folder of the pipeline file.
    base: &'a Path,
    scan: &'a Scan,
    photos: &'a PhotoFolder,
    tables: Vec<tables::Poses>,
    scenario: Option<Scenario>,
}

impl Survey<'_> {
    /// Columns and rows of the photos.
    fn size(&self) -> (u32, u32) {
        self.photos.photos.first().map_or((1, 1), |photo| photo.size)
    }

    /// Who made the aircraft or the camera, as far as the photos tell.
    fn maker(&self) -> Option<&str> {
        let metadata = self.photos.photos.iter().find_map(|photo| photo.metadata.as_ref())?;
        let sensefly = metadata.exposure.origins.iter().any(|origin| origin.from.starts_with("sensefly:"));
        if sensefly { Some("senseFly") } else { metadata.make.as_deref() }
    }
}

/// Looks at a folder and writes a pipeline file for what is in it.
///
/// - `output`: where the file goes; by default `boresight.toml` in the folder.
/// - `force`: replace a file that is there.
///
/// # Errors
/// [`ErrorClass::Input`] when the folder holds no photos or nothing that places them; [`ErrorClass::Usage`] when the file is
/// there already; [`ErrorClass::Io`] when it cannot be written. A file that does not run is written nevertheless:
/// [`Written::failure`].
pub fn init(folder: &Path, output: Option<&Path>, force: bool) -> Result<Written, StageError> {
    let file = output.map_or_else(|| folder.join(FILE_NAME), Path::to_owned);
    if file.exists() && !force {
        return Err(StageError::new(ErrorClass::Usage, format!("{} is there already", file.display()))
            .help("replace it with --force, or name another file with -o"));
    }
    let base = match file.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    if !base.is_dir() {
        return Err(StageError::new(ErrorClass::Usage, format!("folder {} does not exist", base.display()))
            .help("name a file in a folder that is there"));
    }
    let found = scan::scan(folder).map_err(|error| {
        StageError::input(format!("folder {} cannot be listed", folder.display())).because(error)
    })?;
    let (written, text) = propose(folder, &file, base, &found)?;
    atomic::write_atomic(&file, text.as_bytes()).map_err(|error| {
        StageError::new(ErrorClass::Io, format!("{} cannot be written", file.display()))
            .because(error)
            .help("name a file elsewhere with -o")
    })?;
    Ok(written)
}

/// The file's text, tried in memory.
fn propose(root: &Path, file: &Path, base: &Path, scan: &Scan) -> Result<(Written, String), StageError> {
    let mut left_out = scan.notes.clone();
    let photos = scan
        .photos
        .first()
        .ok_or_else(|| nothing(root, "holds no photos (jpg, jpeg, png, tif, tiff without a georeference)"))?;
    let survey = Survey {
        root,
        base,
        scan,
        photos,
        tables: tables_of(scan, photos),
        scenario: scenario(scan, photos),
    };
    for other in scan.photos.iter().skip(1).filter(|other| !other.of_target) {
        left_out.push(match &other.photos[..] {
            [one] => format!(
                "{}: a picture outside the photos' folder",
                shown(root, &other.folder.join(&one.name))
            ),
            many => format!(
                "{} more photos in {}: a pipeline takes those of one folder",
                many.len(),
                if other.folder == root {
                    "the folder itself".to_owned()
                } else {
                    shown(root, &other.folder)
                }
            ),
        });
    }
    let sources = poses::sources(&survey, &mut left_out);
    if sources.is_empty() {
        return Err(nothing(
            root,
            &format!(
                "has {} photos and nothing that says where they were taken{}",
                photos.photos.len(),
                if left_out.is_empty() { String::new() } else { format!(" ({})", left_out.join("; ")) }
            ),
        )
        .help(
            "looked for: EXIF and XMP positions in the photos; ArduPilot .bin, PX4 .ulg, MAVLink .tlog; .MRK, .pos, geo.txt, \
             exterior orientations, reconstruction.json; tables with columns such as file, latitude, longitude, height, yaw, \
             pitch, roll",
        ));
    }
    let mut best: Option<Tried> = None;
    for source in sources.iter().take(MOST_TRIED) {
        let tried = attempt(&survey, source, file);
        let enough = tried.used() as f64 >= ENOUGH * photos.photos.len() as f64;
        let better = best.as_ref().is_none_or(|best| tried.used() > best.used());
        if better && let Some(worse) = best.replace(tried) {
            left_out.push(format!("{}: places {} photos", worse.source, worse.used()));
        }
        if enough {
            break;
        }
    }
    let Some(tried) = best else { return Err(nothing(root, "holds no source of poses")) };
    left_out.extend(tried.left_out.iter().cloned());
    left_out.extend(not_used(&survey));
    Ok(finish(&survey, file, tried, left_out))
}

fn nothing(root: &Path, cause: &str) -> StageError {
    StageError::input(format!("folder {} {cause}", root.display()))
}

/// Tables that name photos of the survey.
fn tables_of(scan: &Scan, photos: &PhotoFolder) -> Vec<tables::Poses> {
    let names: BTreeSet<&str> = photos.photos.iter().map(|photo| photo.name.as_str()).collect();
    let tables = scan.files.iter().filter_map(|found| match found.kind {
        FileKind::Table { delimiter } => tables::read(&found.path, delimiter, &names),
        _ => None,
    });
    tables.collect()
}

/// The scenario beside the photos' folder: that of another survey says nothing of this one.
fn scenario(scan: &Scan, photos: &PhotoFolder) -> Option<Scenario> {
    let of_these = |path: &Path| path.parent() == photos.folder.parent();
    let found = scan.files.iter().find(|f| matches!(f.kind, FileKind::Scenario) && of_these(&f.path))?;
    crate::config::load_document(&found.path, &[]).ok()
}

/// Files that were understood and have no place in the pipeline.
fn not_used(survey: &Survey<'_>) -> Vec<String> {
    let known = |path: &Path| survey.tables.iter().any(|table| table.path == path);
    let (mut notes, mut alien) = (Vec::new(), Vec::new());
    for found in &survey.scan.files {
        let name = shown(survey.root, &found.path);
        match &found.kind {
            FileKind::Raster(scan::RasterKind::Other) => {
                notes.push(format!("{name}: a picture with a place on the map, no photo"));
            }
            FileKind::Table { .. } if !known(&found.path) => alien.push(name),
            _ => {}
        }
    }
    if !alien.is_empty() {
        notes.push(format!("{}: tables without a row for each photo", alien.join(", ")));
    }
    notes
}

/// A source, the file's text with it, and what came of it.
struct Tried {
    source: String,
    lines: Vec<Line>,
    outcome: Result<(usize, Vec<RejectedFrame>, Option<MosaicSize>), String>,
    left_out: Vec<String>,
}

impl Tried {
    fn used(&self) -> usize {
        self.outcome.as_ref().map_or(0, |(used, ..)| *used)
    }
}

fn attempt(survey: &Survey<'_>, source: &Source, file: &Path) -> Tried {
    let mut left_out = Vec::new();
    let lines = body(survey, source, &mut left_out);
    let outcome = rehearse(file, &assemble("", &[], &render(&lines).text));
    Tried { source: source.name.clone(), lines, outcome, left_out }
}

/// Everything but `[run]` and the head.
fn body(survey: &Survey<'_>, source: &Source, left_out: &mut Vec<String>) -> Vec<Line> {
    let mut lines = camera::camera(survey, left_out);
    let (w, h) = survey.size();
    let model = survey.photos.photos.iter().find_map(|photo| photo.metadata.as_ref()?.model.as_deref());
    lines.push(Line::Table("georeference"));
    lines.push(Line::Note(format!(
        "{} photos of {w} × {h} pixels{}.",
        survey.photos.photos.len(),
        match (survey.maker(), model) {
            (Some(maker), Some(model)) => format!(", {maker}, {model}"),
            (None, Some(model)) => format!(", {model}"),
            _ => String::new(),
        }
    )));
    for (name, why) in survey.photos.others.iter().take(5) {
        lines.push(Line::Note(format!("{name} is in the folder too and will be left out: it {why}.")));
    }
    lines.push(Line::Key("images".to_owned(), quoted_path(survey.base, &survey.photos.folder)));
    lines.push(Line::Note("The UTM zone of the survey; or an EPSG code.".to_owned()));
    lines.push(text("crs", "auto"));
    let (takeoff, ground) = ground::ground(survey, source, left_out);
    // The keys of the log's own table come before the table of its columns.
    let columns = source.lines.iter().position(|line| *line == Line::Table("georeference.log.columns"));
    let (log, columns) = source.lines.split_at(columns.unwrap_or(source.lines.len()));
    lines.extend(log.iter().cloned().chain(takeoff).chain(columns.iter().cloned()));
    let on_model = ground.iter().any(|line| matches!(line, Line::Key(_, value) if *value == quoted("dem")));
    lines.extend(mount::mount(survey, source));
    lines.extend(mount::turned(survey, source));
    lines.extend(ground);
    lines.push(Line::Table("mosaic"));
    lines
        .push(Line::Note("The pixel size follows from the photos; or a length such as \"5 cm\".".to_owned()));
    lines.push(text("gsd", "auto"));
    lines.extend(sigmas::sigmas(survey, source, on_model));
    lines
}

/// Head, version, `[run]` and the rest.
fn assemble(head: &str, run: &[Line], body: &str) -> String {
    let run = render(&[&[Line::Table("run"), text("output", "out")], run].concat()).text;
    format!("{head}version = 1\n{run}{body}")
}

/// What a run of the text would use: in memory, nothing is written.
fn rehearse(file: &Path, text: &str) -> Result<(usize, Vec<RejectedFrame>, Option<MosaicSize>), String> {
    let failed = |error: &dyn std::error::Error| {
        let mut words = error.to_string();
        let mut cause = error.source();
        while let Some(inner) = cause {
            words.push_str(&format!(": {inner}"));
            cause = inner.source();
        }
        words
    };
    let config = Config::from_text(file, text, &[]).map_err(|error| failed(&error))?;
    let (session, _) = Session::rehearse(&config).map_err(|error| failed(&error))?;
    let survey = session.survey().map_err(|error| failed(&error))?;
    let size = session.mosaic_size(&config).map_err(|error| failed(&error))?;
    Ok((survey.frames.len(), survey.rejected.clone(), size))
}

/// The file's text with its head, and the report.
fn finish(survey: &Survey<'_>, file: &Path, tried: Tried, left_out: Vec<String>) -> (Written, String) {
    let Rendered { text: body, questions, assumptions } = render(&tried.lines);
    let photos = survey.photos.photos.len();
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut run = Vec::new();
    let mut head = String::new();
    comment(
        &mut head,
        "Written by `boresight init`. What was found is said above each value; \"assumed\" marks what was taken \
                        for true without being stated anywhere, \"QUESTION\" what only you can decide.",
    );
    let (used, rejected, mosaic, failure) = match tried.outcome {
        Ok((used, rejected, mosaic)) => (used, rejected, mosaic, None),
        Err(failure) => (0, Vec::new(), None, Some(failure)),
    };
    match &failure {
        Some(failure) => comment(&mut head, &format!("It does NOT run as it stands: {failure}")),
        None => {
            let size = mosaic.map_or(String::new(), |m| {
                format!("; the mosaic has {} × {} pixels of {} m", m.columns, m.rows, m.gsd_m)
            });
            comment(
                &mut head,
                &format!("It runs as it stands: {used} of {} images are used{size}.", used + rejected.len()),
            );
        }
    }
    if !rejected.is_empty() {
        for frame in rejected.iter().take(10) {
            run.push(Line::Note(format!("{}: {}", frame.frame, frame.reason)));
        }
        run.push(Line::Note(format!(
            "{} images cannot be used, the first of them as above.",
            rejected.len()
        )));
        run.push(Line::Key("max_rejected_frames".to_owned(), rejected.len().to_string()));
    }
    comment(&mut head, &format!("boresight check {name}   then   boresight run {name}"));
    comment(
        &mut head,
        &match questions.len() {
            0 => "No question is open.".to_owned(),
            1 => "One question is open.".to_owned(),
            count => format!("{count} questions are open."),
        },
    );
    for note in &left_out {
        comment(&mut head, &format!("Not used: {note}."));
    }
    let text = assemble(&head, &run, &body);
    let written = Written {
        file: file.to_owned(),
        photos,
        poses: tried.source,
        frames_used: used,
        frames_rejected: rejected,
        mosaic,
        failure,
        questions,
        assumptions,
        left_out,
    };
    (written, text)
}

#[cfg(test)]
mod tests;
