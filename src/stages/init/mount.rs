//! How the camera sits in the UAV, and which stored pixels were turned since.

use super::Survey;
use super::poses::{Attitude, Source, yaw};
use super::scan::{Photo, shown};
use super::tables::Role;
use super::write::{Line, key, quoted, text};
use crate::formats::metadata::TurnEvidence;
use crate::units::Radians;

/// `[georeference.mount]`, for a source and what is known of the aircraft.
pub fn mount(survey: &Survey<'_>, source: &Source) -> Vec<Line> {
    let mut lines = vec![Line::Table("georeference.mount")];
    if let (Some(scenario), false) = (&survey.scenario, source.is_photos) {
        let m = &scenario.mounting;
        lines.push(Line::Note("As the simulated survey's own scenario.toml has it ([mounting]).".to_owned()));
        lines.push(text("gimbal_pan", &format!("{} deg", m.gimbal_pan_deg)));
        lines.push(text("gimbal_elevation", &format!("{} deg", m.gimbal_elevation_deg)));
        lines.push(text("gimbal_roll", &format!("{} deg", m.gimbal_roll_deg)));
        for (name, [forward, right, down]) in [
            ("antenna_in_body", m.antenna_in_body_m),
            ("gimbal_in_body", m.gimbal_in_body_m),
            ("camera_in_gimbal", m.camera_in_gimbal_m),
        ] {
            lines.push(key(
                name,
                format!("{{ forward = \"{forward} m\", right = \"{right} m\", down = \"{down} m\" }}"),
            ));
        }
        let angles =
            [("yaw", m.boresight_yaw_deg), ("pitch", m.boresight_pitch_deg), ("roll", m.boresight_roll_deg)];
        let angles = angles.map(|(name, angle)| format!("{name} = \"{angle} deg\"")).join(", ");
        lines.push(key("boresight", format!("{{ {angles} }}")));
        return lines;
    }
    let arms = "antenna, gimbal and camera are in one place; lever arms are antenna_in_body, gimbal_in_body and \
                camera_in_gimbal (forward, right, down)";
    match source.attitude {
        Attitude::OfCamera => {
            lines.push(Line::Note(
                "The attitude is the camera's own: nothing of the mounting has to be known.".to_owned(),
            ));
            if let Some(reference) = source.gimbal_reference {
                lines.push(Line::Note(match reference {
                    "nav" => {
                        "The gimbal's pan goes along with the UAV's yaw: it counts from north.".to_owned()
                    }
                    _ => "The gimbal's pan stays near zero while the UAV turns: it counts from the nose."
                        .to_owned(),
                }));
                lines.push(text("gimbal_reference", reference));
            }
        }
        Attitude::OfBody | Attitude::OfBodyByCourse => {
            let maker = survey.maker();
            if maker.is_some_and(|maker| maker.contains("senseFly")) {
                lines.push(Line::Assumed(
                    "the camera is fixed to the airframe and looks straight down, image top towards the nose, as in \
                     senseFly's aircraft"
                        .to_owned(),
                ));
            } else {
                lines.push(Line::Question(
                    "how does the camera sit in the UAV? The log gives the attitude of the UAV, and nothing here says it. \
                     Meanwhile it looks straight down with the top of the image towards the nose. If neighbouring photos of \
                     the mosaic do not fit, try gimbal_pan = \"90 deg\" (top to the right wing), \"-90 deg\" or \"180 deg\""
                        .to_owned(),
                ));
            }
            lines.push(text("gimbal_elevation", "-90 deg"));
            lines.push(Line::Assumed(arms.to_owned()));
        }
        Attitude::Missing => {
            lines.push(Line::Question(
                "where does the top of each image point? No attitude was found. Meanwhile every photo looks straight down \
                 with its top to the north, which is wrong unless the UAV always flew so; give a log with yaw, pitch and roll"
                    .to_owned(),
            ));
            lines.push(text("gimbal_reference", "nav"));
            lines.push(text("gimbal_pan", "0 deg"));
            lines.push(text("gimbal_elevation", "-90 deg"));
        }
    }
    lines
}

/// Photos whose stored pixels were turned after the camera wrote them: lines of `[georeference.mount]`.
pub fn turned(survey: &Survey<'_>, source: &Source) -> Vec<Line> {
    let evidence = |photo: &Photo| photo.metadata.as_ref().and_then(|m| m.turned.clone());
    let names = |test: &dyn Fn(&TurnEvidence) -> bool| -> Vec<String> {
        let photos = survey.photos.photos.iter();
        photos.filter(|p| evidence(p).is_some_and(|e| test(&e))).map(|p| p.name.clone()).collect()
    };
    let list = |names: &[String], clockwise: &str| {
        let names: Vec<String> = names.iter().map(|name| quoted(name)).collect();
        format!("turned_frames = [{{ frames = [{}], clockwise = \"{clockwise}\" }}]", names.join(", "))
    };
    let mut quarter = names(&|e| matches!(e, TurnEvidence::QuarterTurn));
    quarter.extend(survey.photos.swapped.iter().cloned());
    let half = names(&|e| matches!(e, TurnEvidence::PerhapsHalfTurn(_)));
    // A table that says so settles it; as the log its own column is in force.
    let table = survey
        .tables
        .iter()
        .find(|table| table.column(Role::HalfTurns).or(table.column(Role::Turned)).is_some());
    let mut lines = Vec::new();
    if let Some(table) = table {
        let said: Vec<String> = table.half_turned.iter().cloned().collect();
        let by_its_own = source.name == format!("the table {}", shown(survey.root, &table.path));
        if !by_its_own && !said.is_empty() {
            let too = if half == said { "; the same photos were rewritten by a photo viewer" } else { "" };
            lines.push(Line::Note(format!(
                "{} says that the stored pixels of these {} photos were turned by half a turn{too}.",
                shown(survey.root, &table.path),
                said.len()
            )));
            lines.push(Line::Key(
                "turned_frames".to_owned(),
                list(&said, "180")["turned_frames = ".len()..].to_owned(),
            ));
        }
        return lines;
    }
    if !quarter.is_empty() {
        lines.push(Line::Question(format!(
            "were the stored pixels of these {} photos turned by 90 or by 270 degrees? Their width and height are swapped. \
             Meanwhile nothing is turned back, and they are left out for their size; compare \
             one of them with its neighbours",
            quarter.len()
        )));
        lines.push(Line::Dormant(list(&quarter, "90")));
    } else if !half.is_empty() {
        lines.extend(half_turn(survey, source, &half, &list(&half, "180")));
    }
    lines
}

/// The question about photos that a viewer rewrote, and the likelier answer.
fn half_turn(survey: &Survey<'_>, source: &Source, half: &[String], toml: &str) -> Vec<Line> {
    let programs: Vec<&str> = survey
        .photos
        .photos
        .iter()
        .filter_map(|p| match p.metadata.as_ref()?.turned.as_ref()? {
            TurnEvidence::PerhapsHalfTurn(program) => Some(program.as_str()),
            _ => None,
        })
        .collect();
    let program = programs.first().copied().unwrap_or("a photo viewer");
    let direction = |inside: bool| -> Option<Radians> {
        let of =
            source.exposures.iter().filter(|e| e.frame.as_ref().is_some_and(|f| half.contains(f)) == inside);
        let (mut north, mut east) = (0.0, 0.0);
        for yaw in of.filter_map(yaw) {
            north += yaw.get().cos();
            east += yaw.get().sin();
        }
        (f64::hypot(north, east) > 1.0).then(|| Radians::new(east.atan2(north)))
    };
    let apart = direction(true).zip(direction(false)).map(|(a, b)| (a - b).wrapped().degrees().abs());
    let what = format!(
        "were the stored pixels of these {} photos ({} to {}) turned by half a turn? {program} rewrote them after they were \
         taken, which viewers do when they turn a photo, and EXIF Orientation no longer says so",
        half.len(),
        half.first().map_or("", String::as_str),
        half.last().map_or("", String::as_str)
    );
    match apart {
        Some(apart) if apart > 135.0 => vec![
            Line::Question(format!(
                "{what}. Meanwhile they count as turned, because they are the ones flown in the opposite direction ({apart:.0} \
                 deg from the others): somebody turned them to look alike. If they do not fit their neighbours in the mosaic, \
                 remove the next line"
            )),
            Line::Key("turned_frames".to_owned(), toml["turned_frames = ".len()..].to_owned()),
        ],
        _ => vec![
            Line::Question(format!(
                "{what}. Meanwhile they count as they are; if they do not fit their neighbours in the mosaic, put the next line \
                 in force by removing its #"
            )),
            Line::Dormant(toml.to_owned()),
        ],
    }
}
