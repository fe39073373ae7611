//! The picture of photos matched with the log's exposures: what is left between the two clocks, over the flight.

use super::figures::{
    ACCENT, FAINT, Figure, FigureError, LINE, RULE, by_step, finished, frame_of, line, scene, text, tick_step,
};
use kuva::render::render::{Primitive, TextAnchor};

const WIDTH: f64 = 620.0;
const HEIGHT: f64 = 240.0;
const LEFT: f64 = 78.0;
const TOP: f64 = 20.0;
const BOTTOM: f64 = 78.0;

/// Residuals of matched photos over the log's time, and exposures that no photo fits as strokes on the lower edge.
///
/// - `pairs`: time of the exposure and residual, seconds.
/// - `lonely`: times of exposures without a photo, seconds.
///
/// # Errors
/// [`FigureError`].
pub fn match_residuals(pairs: &[(f64, f64)], lonely: &[f64]) -> Result<Figure, FigureError> {
    let mut scene = scene(LEFT + WIDTH + 24.0, TOP + HEIGHT + BOTTOM);
    let times = || pairs.iter().map(|(time, _)| *time).chain(lonely.iter().copied());
    let first = times().fold(f64::INFINITY, f64::min);
    let span = (times().fold(f64::NEG_INFINITY, f64::max) - first).max(1.0);
    let reach = 1.15 * pairs.iter().map(|(_, residual)| residual.abs()).fold(1e-3, f64::max);
    let x = |time: f64| LEFT + (time - first) / span * WIDTH;
    let y = |residual: f64| TOP + HEIGHT / 2.0 - residual / reach * HEIGHT / 2.0;
    frame_of(&mut scene, LEFT, TOP, WIDTH, HEIGHT);
    let step = tick_step(reach * 2.0);
    let count = (reach / step).floor() as i64;
    for k in -count..=count {
        let value = k as f64 * step;
        line(&mut scene, (LEFT, y(value)), (LEFT + WIDTH, y(value)), RULE, 1.0);
        text(&mut scene, (LEFT - 8.0, y(value) + 4.5), &by_step(value, step), 13, TextAnchor::End, FAINT);
    }
    let minutes = tick_step(span / 60.0 * 0.8);
    for k in 0..=(span / 60.0 / minutes).floor() as i64 {
        let value = k as f64 * minutes;
        let at = x(first + 60.0 * value);
        line(&mut scene, (at, TOP + HEIGHT), (at, TOP + HEIGHT + 5.0), FAINT, 1.0);
        text(&mut scene, (at, TOP + HEIGHT + 20.0), &by_step(value, minutes), 13, TextAnchor::Middle, FAINT);
    }
    for time in lonely {
        line(&mut scene, (x(*time), TOP + HEIGHT), (x(*time), TOP + HEIGHT - 14.0), ACCENT, 2.0);
    }
    for (time, residual) in pairs {
        scene.add(Primitive::Circle {
            cx: x(*time),
            cy: y(*residual),
            r: 2.6,
            fill: LINE,
            fill_opacity: Some(0.7),
            stroke: None,
            stroke_width: None,
        });
    }
    let below = TOP + HEIGHT + 40.0;
    text(
        &mut scene,
        (LEFT + WIDTH / 2.0, below),
        "minutes from the first exposure",
        13,
        TextAnchor::Middle,
        FAINT,
    );
    scene.add(Primitive::Text {
        x: 16.0,
        y: TOP + HEIGHT / 2.0,
        content: "residual (s)".to_owned(),
        size: 13,
        anchor: TextAnchor::Middle,
        rotate: Some(-90.0),
        bold: false,
        color: Some(FAINT),
    });
    text(&mut scene, (LEFT, below + 24.0), "● photo and its exposure", 13, TextAnchor::Start, LINE);
    if !lonely.is_empty() {
        text(
            &mut scene,
            (LEFT + 190.0, below + 24.0),
            "| exposure without a photo",
            13,
            TextAnchor::Start,
            ACCENT,
        );
    }
    finished(&scene)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_and_every_lonely_exposure_is_drawn() {
        let figure = match_residuals(&[(0.0, 0.01), (60.0, -0.02), (120.0, 0.0)], &[30.0]).unwrap();
        assert_eq!(figure.svg.matches("<circle").count(), 3);
        assert!(figure.svg.contains("exposure without a photo") && !figure.png.is_empty());
        assert!(match_residuals(&[(5.0, 0.0)], &[]).is_ok(), "one pair has no span");
    }
}
