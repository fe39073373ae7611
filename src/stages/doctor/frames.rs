//! One row per image: what is known about it before its pixels are looked at.

use super::Georeferenced;
use super::view::{Flight, distance};
use crate::formats::metadata::TurnEvidence;

/// One image of the survey.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct FrameRow {
    /// The image's file name.
    pub frame: String,
    /// "used" or "rejected".
    pub status: &'static str,
    /// Why it is rejected.
    pub reason: Option<String>,
    /// How it found its pose: "line 7 of log.csv names it".
    pub pose_found: Option<String>,
    /// With `join = "match"`: the exposure's time less the photo's, on one clock.
    pub match_residual_s: Option<f64>,
    /// With `join = "match"`: probability of the pair.
    pub match_probability: Option<f64>,
    /// On the log's clock, or the photos' own where the log has none.
    pub time_s: Option<f64>,
    /// The tag or column of its height, and what that was taken for.
    pub height_as_logged: Option<String>,
    /// Speed over ground.
    pub speed_m_s: Option<f64>,
    /// Whence the speed: "log", "photo", or "neighbours" (distance and time to the nearer frame).
    pub speed_from: Option<&'static str>,
    /// Exposure time, as the photo states it.
    pub exposure_time_s: Option<f64>,
    /// Speed × exposure time / GSD.
    pub motion_blur_px: Option<f64>,
    /// Angle between the optical axis and straight down.
    pub off_nadir_deg: Option<f64>,
    /// True when part of the image sees the horizon, or ground that is missing or out of range.
    pub horizon: Option<bool>,
    /// Ground length of a pixel in the middle of the image.
    pub gsd_m: Option<f64>,
    /// Of the camera.
    pub height_above_ground_m: Option<f64>,
    /// Share of its ground that the next frame sees as well.
    pub forward_overlap: Option<f64>,
    /// How its stored pixels are declared to be turned.
    pub turned_deg: Option<u32>,
    /// Signs in the file that a viewer turned the pixels.
    pub turn_evidence: Option<TurnEvidence>,
    /// Variance of the Laplacian of its brightness against the median of the set; only on request.
    pub sharpness: Option<f64>,
}

/// Frames farther apart in time than this say nothing about the speed in between.
const LONGEST_STEP_S: f64 = 60.0;

/// Rows by name, used frames and rejected ones.
pub(super) fn rows(flight: &Flight<'_>, survey: &Georeferenced) -> Vec<FrameRow> {
    let speeds = neighbours_speeds(flight);
    let mut rows: Vec<FrameRow> = flight
        .rejected
        .iter()
        .map(|(frame, reason)| FrameRow {
            frame: frame.clone(),
            status: "rejected",
            reason: Some(reason.clone()),
            exposure_time_s: flight.photo(frame).and_then(|photo| photo.exposure_time_s),
            turn_evidence: flight.photo(frame).and_then(|photo| photo.turned.clone()),
            ..FrameRow::default()
        })
        .collect();
    for (view, by_neighbours) in flight.views.iter().zip(speeds) {
        let speed = view.stated_speed.or(by_neighbours.map(|speed| (speed, "neighbours")));
        let matched = flight.matches.get(&view.name).copied().unwrap_or_default();
        let source = survey.sources.get(&view.name);
        let height = source.and_then(|source| source.origins.iter().find(|o| o.quantity == "height"));
        rows.push(FrameRow {
            frame: view.name.clone(),
            status: "used",
            reason: None,
            pose_found: source.map(|source| source.found.clone()),
            match_residual_s: matched.residual_s,
            match_probability: matched.probability,
            time_s: view.time_s,
            height_as_logged: height.map(|height| format!("{}: {}", height.from, height.meaning)),
            speed_m_s: speed.map(|(speed, _)| speed),
            speed_from: speed.map(|(_, from)| from),
            exposure_time_s: view.exposure_time_s,
            motion_blur_px: speed
                .zip(view.exposure_time_s)
                .map(|((speed, _), exposure)| speed * exposure / view.gsd_m)
                .filter(|blur| blur.is_finite()),
            off_nadir_deg: Some(view.off_nadir_deg),
            horizon: Some(view.clipped),
            gsd_m: Some(view.gsd_m),
            height_above_ground_m: Some(view.height_above_ground_m),
            forward_overlap: flight.overlap.as_ref().and_then(|o| o.forward_of(&view.name)),
            turned_deg: Some(view.turned_deg),
            turn_evidence: flight.photo(&view.name).and_then(|photo| photo.turned.clone()),
            sharpness: flight.sharpness.get(&view.name).copied(),
        });
    }
    rows.sort_by(|a, b| a.frame.cmp(&b.frame));
    rows
}

/// Speed of each view by the frame next to it in time.
fn neighbours_speeds(flight: &Flight<'_>) -> Vec<Option<f64>> {
    let mut nearest: Vec<Option<(f64, f64)>> = vec![None; flight.views.len()];
    for pair in flight.order.windows(2) {
        let (a, b) = (&flight.views[pair[0]], &flight.views[pair[1]]);
        let Some(step) = a.time_s.zip(b.time_s).map(|(a, b)| b - a) else { continue };
        if step <= 0.0 || step > LONGEST_STEP_S {
            continue;
        }
        let speed = distance(a.place, b.place) / step;
        for index in pair {
            if nearest[*index].is_none_or(|(other, _)| step < other) {
                nearest[*index] = Some((step, speed));
            }
        }
    }
    nearest.into_iter().map(|nearest| nearest.map(|(_, speed)| speed)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::findings::tests::{photos, strip};
    use super::*;

    #[test]
    fn neighbours_give_a_speed_unless_they_are_too_far_apart_in_time() {
        let none = photos();
        // 20 m in 2 s.
        let mut flight = Flight::made(strip(4), &none);
        for speed in neighbours_speeds(&flight) {
            assert!((speed.unwrap() - 10.0).abs() < 1e-9);
        }
        flight.views[3].time_s = Some(1000.0);
        assert_eq!(neighbours_speeds(&flight)[3], None);
        assert!(neighbours_speeds(&flight)[2].is_some());
        flight.views.iter_mut().for_each(|view| view.time_s = None);
        assert!(neighbours_speeds(&flight).iter().all(Option::is_none));
    }
}
