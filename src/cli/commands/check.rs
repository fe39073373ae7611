//! `check`: what a run would use, what it would reject and why, and what a careful colleague would say about the flight;
//! nothing is written but the picture that was asked for.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use serde_json::json;

use super::run::{describe, skipped};
use crate::cli::args::CheckArguments;
use crate::cli::console::Console;
use crate::cli::exit::ExitClass;
use crate::cli::output::{print, print_json};
use crate::config::Config;
use crate::formats::atomic::write_atomic;
use crate::formats::metadata::Severity;
use crate::pipeline::{Plan, inputs};
use crate::stages::doctor::{self, Diagnosis, FrameRow, Options, PhotosByName, TurnVerdict};
use crate::stages::georeference::{Georeferenced, photos};
use crate::stages::session::Session;
use crate::stages::{ErrorClass, StageError};

pub fn run(arguments: &CheckArguments, console: &Arc<Console>) -> Result<ExitClass, StageError> {
    let vector = arguments.picture.as_deref().map(|file| is_vector(file, arguments.force)).transpose()?;
    let config = Config::load(&arguments.pipeline.file, &arguments.pipeline.overrides)?;
    let absent: Vec<_> = inputs::absent(&config)
        .into_iter()
        .map(|missing| (missing.path.value.clone(), missing.hint.clone()))
        .collect();
    if !absent.is_empty() {
        return skipped(&absent, arguments.json);
    }
    let plan = Plan::new(&config, None, None)?;
    let (found, missing) = inputs::declared(&config);
    for error in &missing {
        console.error(error);
    }
    if !missing.is_empty() {
        return Ok(ExitClass::Input);
    }
    let (session, camera) = Session::rehearse(&config)?;
    let survey = session.survey().ok();
    let options = Options { sharpness: arguments.sharpness, overlaps: arguments.overlaps };
    let diagnosis =
        survey.map(|survey| doctor::examine(&config, survey, &photos_of(&config, survey), options));
    // A mosaic that cannot be laid out is told after what the frames look like: that may be why.
    let size = session.mosaic_size(&config);
    let stages: Vec<_> = plan.steps.iter().map(|(stage, _)| stage.name()).collect();
    let (used, rejected, notes) = match survey {
        Some(survey) => (survey.frames.len(), &survey.rejected[..], &survey.notes[..]),
        None => (0, &[][..], &[][..]),
    };
    let all_notes: Vec<&String> = camera.notes.iter().chain(notes).collect();
    if arguments.json {
        print_json(&json!({
            "pipeline": config.source.name,
            "stages": stages,
            "inputs": found,
            "frames_used": used,
            "frames_rejected": rejected,
            "crs": survey.map(|survey| survey.projection.definition()),
            "mosaic": size.as_ref().ok().copied().flatten(),
            "photos_used": camera.photos.len(),
            "photos_rejected": camera.rejected,
            "notes": all_notes,
            "flight": diagnosis,
        }))?;
    } else {
        let mut text = format!("stages    {}\n", stages.join(", "));
        for input in &found {
            let _ = writeln!(text, "input     {}", describe(input));
        }
        if !(camera.photos.is_empty() && camera.rejected.is_empty()) {
            let (used, all) = (camera.photos.len(), camera.photos.len() + camera.rejected.len());
            let _ = writeln!(text, "photos    {used} of {all} show the target");
        }
        for photo in &camera.rejected {
            let _ = writeln!(text, "rejected  {}: {}", photo.file, photo.reason);
        }
        if let Some(survey) = survey {
            let _ = writeln!(text, "frames    {used} of {} would be used", used + rejected.len());
            for frame in rejected {
                let _ = writeln!(text, "rejected  {}: {}", frame.frame, frame.reason);
            }
            let _ =
                writeln!(text, "crs       {} ({})", survey.projection.definition(), survey.projection.name());
        }
        if let Ok(Some(size)) = &size {
            let _ = writeln!(text, "mosaic    {} × {} pixels of {} m", size.columns, size.rows, size.gsd_m);
        }
        if let Some(diagnosis) = &diagnosis {
            text.push_str(&flight(diagnosis));
        }
        for note in all_notes {
            let _ = writeln!(text, "note      {note}");
        }
        if let Some(diagnosis) = diagnosis.as_ref().filter(|_| arguments.frames) {
            text.push_str(&table(&diagnosis.frames));
        }
        print(&text)?;
    }
    if let (Some(file), Some(vector), Some(diagnosis)) = (&arguments.picture, vector, &diagnosis) {
        let name = config.source.name.file_stem().unwrap_or_default().to_string_lossy();
        draw(diagnosis, &name, file, vector)?;
    }
    size?;
    if config.run.max_rejected_frames.is_exceeded_by(rejected.len()) {
        return Err(StageError::new(
            ErrorClass::Limits,
            format!("{} frames would be rejected, more than run.max_rejected_frames allows", rejected.len()),
        )
        .help(format!(
            "to accept this, write max_rejected_frames = {} (or \"any\") in [run]",
            rejected.len()
        )));
    }
    let errors = diagnosis.as_ref().map_or(0, |diagnosis| diagnosis.count(Severity::Error));
    if errors > 0 {
        let message = format!("{} of the flight would make the products wrong", count(errors, "finding"));
        return Err(StageError::new(ErrorClass::Limits, message));
    }
    Ok(ExitClass::Done)
}

/// The photos' metadata: what georeferencing read, or read now.
fn photos_of(config: &Config, survey: &Georeferenced) -> PhotosByName {
    let Some(declared) = &config.georeference else { return BTreeMap::new() };
    if !survey.photos.is_empty() {
        return survey.photos.clone();
    }
    let used = survey.frames.iter().map(|frame| frame.name.clone());
    let names: Vec<String> = used.chain(survey.rejected.iter().map(|r| r.frame.clone())).collect();
    let found = photos(&declared.images, &names);
    names.into_iter().zip(found).collect()
}

/// Whether a picture is to be SVG (true) or PNG.
fn is_vector(file: &Path, force: bool) -> Result<bool, StageError> {
    let usage = |what: String| StageError::new(ErrorClass::Usage, what);
    let extension = file.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let vector = match extension.as_str() {
        "svg" => true,
        "png" => false,
        _ => return Err(usage(format!("{}: the picture is written as .svg or .png", file.display()))),
    };
    if file.exists() && !force {
        return Err(usage(format!("{} exists", file.display()))
            .help("choose another name, or replace it with --force"));
    }
    Ok(vector)
}

fn draw(diagnosis: &Diagnosis, name: &str, file: &Path, vector: bool) -> Result<(), StageError> {
    let title = format!("{name}: how often the ground is seen");
    let drawn = doctor::picture(diagnosis, &title)
        .map_err(|error| StageError::new(ErrorClass::Bug, "the picture cannot be drawn").because(error))?;
    let Some(figure) = drawn else { return Ok(()) };
    let bytes = if vector { figure.svg.into_bytes() } else { figure.png };
    write_atomic(file, &bytes).map_err(|error| {
        StageError::new(ErrorClass::Io, format!("{} cannot be written", file.display())).because(error)
    })
}

fn count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Coverage and findings.
fn flight(diagnosis: &Diagnosis) -> String {
    let mut text = String::new();
    if let Some(overlap) = &diagnosis.overlap {
        let _ = writeln!(
            text,
            "ground    {:.0} m2 seen; by one frame {:.0} %, by two {:.0} %, by more {:.0} % (cells of {:.2} m); holes \
             {:.0} m2",
            overlap.area_m2,
            100.0 * overlap.seen_by.one,
            100.0 * overlap.seen_by.two,
            100.0 * overlap.seen_by.more,
            overlap.cell_m,
            overlap.holes_m2
        );
        if let Some(forward) = overlap.forward_median {
            let _ = writeln!(
                text,
                "overlap   {:.0} % of a frame's ground is seen by the next in order of {} (median)",
                100.0 * forward,
                overlap.order
            );
        }
    }
    if let Some(turns) = &diagnosis.pixel_turns {
        let of = |verdict: &str| turns.frames.iter().filter(|found| found.verdict == verdict).count();
        let _ = writeln!(
            text,
            "pixels    {} as declared, {} turned, {} cannot tell",
            of("as declared"),
            of("turned"),
            of("cannot tell")
        );
        for found in turns.frames.iter().filter(|found| found.turned_deg.is_some()) {
            let _ = writeln!(text, "turned    {}", turned(found));
        }
    }
    let counts = [(Severity::Error, "error"), (Severity::Warning, "warning"), (Severity::Note, "note")]
        .map(|(severity, word)| count(diagnosis.count(severity), word));
    let _ = writeln!(text, "findings  {}", counts.join(", "));
    for finding in &diagnosis.findings {
        let word = match finding.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        let _ = writeln!(text, "{word:<9} {}: {}", finding.code, finding.text);
        if let Some(help) = &finding.help {
            let _ = writeln!(text, "          help: {help}");
        }
    }
    text
}

fn turned(found: &TurnVerdict) -> String {
    format!(
        "{} by {} deg clockwise: correlation {:.2} turned back, {:.2} as declared, {} of {} neighbours",
        found.frame,
        found.turned_deg.unwrap_or(0),
        found.score_turned.unwrap_or(0.0),
        found.score_as_declared.unwrap_or(0.0),
        found.neighbours,
        found.compared
    )
}

/// A column of the table: its heading, and what it says of a frame.
type Column = (&'static str, fn(&FrameRow) -> Option<String>);

const COLUMNS: [Column; 13] = [
    ("frame", |row| Some(row.frame.clone())),
    ("status", |row| Some(row.status.to_owned())),
    ("gsd_m", |row| row.gsd_m.map(|v| format!("{v:.4}"))),
    ("height_m", |row| row.height_above_ground_m.map(|v| format!("{v:.1}"))),
    ("off_nadir", |row| row.off_nadir_deg.map(|v| format!("{v:.1}"))),
    ("horizon", |row| row.horizon.map(|v| if v { "yes" } else { "no" }.to_owned())),
    ("speed_m_s", |row| row.speed_m_s.map(|v| format!("{v:.1}"))),
    ("exposure_s", |row| row.exposure_time_s.map(|v| format!("{v:.5}"))),
    ("blur_px", |row| row.motion_blur_px.map(|v| format!("{v:.2}"))),
    ("overlap", |row| row.forward_overlap.map(|v| format!("{:.0}%", 100.0 * v))),
    ("match_s", |row| row.match_residual_s.map(|v| format!("{v:+.3}"))),
    ("sharpness", |row| row.sharpness.map(|v| format!("{v:.2}"))),
    ("pose", |row| row.pose_found.clone().or_else(|| row.reason.clone())),
];

/// A row per frame; columns that say nothing of any frame are left out.
fn table(rows: &[FrameRow]) -> String {
    let columns: Vec<(&str, Vec<String>)> = COLUMNS
        .iter()
        .filter(|(_, say)| rows.iter().any(|row| say(row).is_some()))
        .map(|(heading, say)| (*heading, rows.iter().map(|row| say(row).unwrap_or("-".to_owned())).collect()))
        .collect();
    let width = |(heading, cells): &(&str, Vec<String>)| {
        cells.iter().map(|cell| cell.chars().count()).chain([heading.len()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = columns.iter().map(width).collect();
    let mut text = String::new();
    for row in 0..=rows.len() {
        let mut line = String::new();
        for ((heading, cells), width) in columns.iter().zip(&widths) {
            let cell = if row == 0 { heading } else { cells[row - 1].as_str() };
            let _ = write!(line, "{cell:<width$}  ");
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}
