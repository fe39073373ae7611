//! What the measurements are worth: by the log's own word, else by the grade of what measured them.

use super::Survey;
use super::poses::{Attitude, Source, median};
use super::write::{Line, key, rounded, text};

/// 1σ of one grade of equipment: metres and degrees.
struct Grade {
    words: &'static str,
    position: f64,
    height: f64,
    tilt: f64,
    yaw: f64,
    boresight: f64,
}

/// A consumer drone's gimbal and receiver.
const CONSUMER: Grade = Grade {
    words: "typical of a consumer drone: receiver without corrections, gimbal level to half a degree, compass",
    position: 1.5,
    height: 2.0,
    tilt: 0.5,
    yaw: 3.0,
    boresight: 0.0,
};
/// A small autopilot without a compass in use.
const COURSE: Grade = Grade {
    words: "typical of a light autopilot: receiver without corrections, low-cost inertial sensors, the camera put in by hand; \
            yaw is what is left beside the crab angle",
    position: 2.5,
    height: 2.0,
    tilt: 4.0,
    yaw: 1.0,
    boresight: 3.0,
};
/// A usual autopilot.
const AUTOPILOT: Grade = Grade {
    words: "typical of an autopilot: receiver without corrections, low-cost inertial sensors, compass, the camera put in by hand",
    position: 2.0,
    height: 3.0,
    tilt: 1.5,
    yaw: 5.0,
    boresight: 2.0,
};
/// Poses of a photogrammetric adjustment.
const ADJUSTED: Grade = Grade {
    words: "typical of poses that a photogrammetric program adjusted without control points: their own report says more",
    position: 1.0,
    height: 1.5,
    tilt: 0.1,
    yaw: 0.1,
    boresight: 0.0,
};
/// No attitude at all.
const UNKNOWN: Grade = Grade {
    words: "the attitude is not known at all",
    position: 2.5,
    height: 3.0,
    tilt: 5.0,
    yaw: 60.0,
    boresight: 0.0,
};

/// `[accuracy.sigmas]`, and why.
pub fn sigmas(survey: &Survey<'_>, source: &Source, on_model: bool) -> Vec<Line> {
    let mut lines = vec![Line::Table("accuracy.sigmas")];
    if let Some(scenario) = survey.scenario.as_ref().filter(|_| !source.is_photos) {
        let a = &scenario.adahrs;
        lines.push(Line::Note("As the simulated survey's own scenario.toml has it ([adahrs]).".to_owned()));
        lines.push(match a.position_cep_m {
            Some(cep) => key("position", format!("{{ cep = \"{cep} m\" }}")),
            None => key("position", format!("{{ std = \"{} m\" }}", a.position_std_m.unwrap_or(0.0))),
        });
        lines.push(text("height", &format!("{} m", a.height_std_m)));
        for (name, value) in
            [("roll", a.roll_std_deg), ("pitch", a.pitch_std_deg), ("yaw", a.heading_std_deg)]
        {
            lines.push(text(name, &format!("{value} deg")));
        }
        lines.push(text("ground_height", "1 m"));
        lines.push(text("picking", "1 px"));
        return lines;
    }
    let adjusted = source.by_name && !source.is_photos && source.attitude == Attitude::OfCamera;
    let grade = match source.attitude {
        Attitude::OfCamera if adjusted && source.gimbal_reference.is_none() => &ADJUSTED,
        Attitude::OfCamera => &CONSUMER,
        Attitude::OfBodyByCourse => &COURSE,
        Attitude::OfBody => &AUTOPILOT,
        Attitude::Missing => &UNKNOWN,
    };
    let of = |value: &dyn Fn(&crate::formats::flight::LoggedStd) -> Option<f64>| {
        let stated: Vec<f64> = source.exposures.iter().filter_map(|e| value(&e.std)).collect();
        // Of a few photos only it says nothing of the others.
        (2 * stated.len() > source.exposures.len()).then(|| median(stated)).flatten().filter(|std| *std > 0.0)
    };
    let position = of(&|std| Some(std.north_m?.max(std.east_m?)));
    let height = of(&|std| std.up_m);
    if position.is_some() && height.is_some() {
        lines
            .push(Line::Note("Position and height: the median of what the source itself states.".to_owned()));
    }
    lines.push(Line::Assumed(format!("{}. Data sheets and test flights say more", grade.words)));
    let metres = |value: f64| format!("{} m", rounded(value, 3));
    lines.push(key("position", format!("{{ std = \"{}\" }}", metres(position.unwrap_or(grade.position)))));
    lines.push(text("height", &metres(height.unwrap_or(grade.height))));
    for (name, value) in [("roll", grade.tilt), ("pitch", grade.tilt), ("yaw", grade.yaw)] {
        lines.push(text(name, &format!("{value} deg")));
    }
    if grade.boresight > 0.0 {
        let angle = grade.boresight;
        lines.push(key(
            "boresight",
            format!("{{ roll = \"{angle} deg\", pitch = \"{angle} deg\", yaw = \"{angle} deg\" }}"),
        ));
    }
    let moving = source.exposures.iter().filter_map(|e| e.ground_speed_m_s).any(|speed| speed > 3.0);
    if source.attitude == Attitude::OfBodyByCourse && moving {
        lines.push(Line::Assumed("the camera fires within half a second of the record".to_owned()));
        lines.push(text("time", "0.5 s"));
    }
    let (ground, words) = if on_model {
        (1.0, "the elevation model is good to a metre")
    } else {
        (3.0, "the ground is level to three metres")
    };
    lines.push(Line::Assumed(words.to_owned()));
    lines.push(text("ground_height", &format!("{ground} m")));
    lines.push(text("picking", "1 px"));
    lines
}
