//! `target`: the description of a target in, a sheet to print and its table for the pipeline file out.

use crate::cli::args::{HollowName, TargetArguments};
use crate::cli::exit::ExitClass;
use crate::cli::output::print;
use crate::config::Located;
use crate::config::target::{HollowSquare, TargetKind, TargetSpec};
use crate::formats::atomic::write_atomic;
use crate::report::{Sheet, SheetError};
use crate::stages::target::target;
use crate::stages::{ErrorClass, StageError};

pub fn run(arguments: &TargetArguments) -> Result<ExitClass, StageError> {
    let usage = |what: String| StageError::new(ErrorClass::Usage, what);
    let extension = arguments.output.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !matches!(extension.as_str(), "pdf" | "svg") {
        return Err(usage(format!("{}: a target is written as .pdf or .svg", arguments.output.display())));
    }
    if !arguments.force && arguments.output.exists() {
        return Err(usage(format!("{} exists", arguments.output.display()))
            .help("choose another name, or replace it with --force"));
    }
    let spec = spec(arguments);
    let declared = spec.resolve().map_err(|fault| usage(fault.what))?;
    let title = format!(
        "{} {} × {}{}",
        spec.kind.name(),
        arguments.rows,
        arguments.columns,
        lengths(&spec).iter().map(|(key, length)| format!(", {key} {length}")).collect::<String>()
    );
    let made = target(&declared).map_err(|e| e.of_class(ErrorClass::Usage))?;
    let sheet = Sheet::new(made, title, arguments.paper.as_deref()).map_err(|e| match e {
        SheetError::TooLarge { .. } => {
            usage(e.to_string()).help("fewer or smaller squares, or a larger --paper")
        }
        _ => usage(e.to_string()),
    })?;
    let bytes = if extension == "pdf" { sheet.pdf() } else { sheet.svg().into_bytes() };
    write_atomic(&arguments.output, &bytes).map_err(|e| {
        StageError::new(ErrorClass::Io, format!("{} cannot be written", arguments.output.display()))
            .because(e)
    })?;
    let table = toml::to_string(&spec)
        .map_err(|e| StageError::new(ErrorClass::Bug, "the table cannot be written").because(e))?;
    print(&format!(
        "# {} for {} paper: print at 100 %, glue it to something flat, and measure it.\n[calibrate.target]\n{table}",
        arguments.output.display(),
        sheet.paper().name
    ))?;
    Ok(ExitClass::Done)
}

fn spec(arguments: &TargetArguments) -> TargetSpec {
    fn placed<T: Clone>(value: &Option<T>) -> Option<Located<T>> {
        value.clone().map(Located::unplaced)
    }
    let kind = TargetKind::from(arguments.kind);
    let hollow = match arguments.hollow {
        Some(HollowName::None) => Some(HollowSquare::None),
        Some(HollowName::UpperLeft) => Some(HollowSquare::UpperLeft),
        None => (kind == TargetKind::Squares).then_some(HollowSquare::UpperLeft),
    };
    TargetSpec {
        rows: Some(Located::unplaced(arguments.rows)),
        columns: Some(Located::unplaced(arguments.columns)),
        square: placed(&arguments.square),
        gap: placed(&arguments.gap),
        hollow: placed(&hollow),
        marker: placed(&arguments.marker),
        tag: placed(&arguments.tag),
        dictionary: placed(&arguments.dictionary),
        first_marker: placed(&arguments.first_marker),
        joints: placed(&arguments.no_joints.then_some(false)),
        spacing: placed(&arguments.spacing),
        diameter: placed(&arguments.diameter),
        ..TargetSpec::of_kind(kind)
    }
}

/// The lengths that were given, for the sheet's title.
fn lengths(spec: &TargetSpec) -> Vec<(&'static str, String)> {
    [
        ("square", &spec.square),
        ("marker", &spec.marker),
        ("tag", &spec.tag),
        ("gap", &spec.gap),
        ("spacing", &spec.spacing),
        ("diameter", &spec.diameter),
    ]
    .into_iter()
    .filter_map(|(key, length)| length.as_ref().map(|length| (key, length.to_string())))
    .collect()
}
