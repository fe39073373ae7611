//! Photos of a drawn ground, some of them turned.

use super::*;
use crate::camera::{Brown, Camera};
use crate::geometry::attitude::YawPitchRoll;
use crate::navigation::{GimbalAngles, Mount, NavigationRecord};
use crate::terrain::ConstantHeight;
use std::sync::Arc;

const GROUND_M: f64 = 200.0;

fn site() -> LocalTangent {
    LocalTangent::at(Geodetic::from_degrees(41.0, -83.0, GROUND_M))
}

/// A frame 60 m above the ground; 1 px is 0.3 m.
fn frame(name: &str, north: f64, east: f64, yaw: f64, size: (u32, u32)) -> GeoreferencedFrame {
    let centre = [0.5 * (f64::from(size.0) - 1.0), 0.5 * (f64::from(size.1) - 1.0)];
    let brown = Brown::new([200.0, 200.0, 0.0, centre[0], centre[1], 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let camera = Arc::new(Camera::new(brown, size.0, size.1, None).unwrap());
    let antenna =
        WGS84.geodetic_from_ecef(&(*site().ecef_from_ned() * Point::<Ned>::new(north, east, -60.0)));
    let record = NavigationRecord {
        line: 1,
        time: None,
        antenna,
        attitude: YawPitchRoll::from_degrees(yaw, 1.0, -2.0),
        gimbal: None,
        height_above_ground_m: None,
        ground_speed_m_s: None,
        velocity: None,
        pixel_rotation: None,
    };
    let mount = Mount { gimbal: GimbalAngles::NADIR, ..Mount::default() };
    let ground = Arc::new(ConstantHeight { height_m: GROUND_M });
    GeoreferencedFrame::new(name.to_owned(), record, &mount, camera, ground, 1e4).unwrap()
}

/// Patches of brightness, a few metres wide, that repeat nowhere: hashes of the nearest posts, blended.
fn brightness(north: f64, east: f64) -> f64 {
    let hash = |n: f64, e: f64| ((n * 127.1 + e * 311.7).sin() * 43_758.545_3).rem_euclid(1.0);
    let octave = |size: f64| {
        let (n, e) = (north / size, east / size);
        let (n0, e0) = (n.floor(), e.floor());
        let (u, v) = (n - n0, e - e0);
        let lower = hash(n0, e0) * (1.0 - v) + hash(n0, e0 + 1.0) * v;
        let upper = hash(n0 + 1.0, e0) * (1.0 - v) + hash(n0 + 1.0, e0 + 1.0) * v;
        lower * (1.0 - u) + upper * u
    };
    60.0 + 90.0 * octave(4.0) + 60.0 * octave(1.7)
}

/// The photo that a frame really took; its pixels turned by quarter turns after that.
fn photo(frame: &GeoreferencedFrame, turns: i64, drawn: impl Fn(f64, f64) -> f64) -> Option<Small> {
    let (w, h) = frame.stored_size();
    let turned = PixelRotation::from_quarter_turns(turns);
    let values: Vec<f32> = (0..h)
        .flat_map(|row| (0..w).map(move |column| ImagePoint::new(f64::from(column), f64::from(row))))
        .map(|stored| {
            let sensor = turned.sensor_from_stored(stored, w, h);
            let ground = frame.ground_from_pixel(sensor).unwrap().position;
            let at: Point<Ned> = site().ecef_from_ned().inverse() * WGS84.ecef_from_geodetic(&ground);
            drawn(at.x(), at.y()) as f32
        })
        .collect();
    Small::of(w as usize, h as usize, &values, 1)
}

/// Two strips of four frames with 60 % overlap both ways, flown to and fro.
fn survey(size: (u32, u32)) -> Vec<(f64, f64, f64)> {
    let (along, across) = (0.4 * 0.3 * f64::from(size.1), 0.4 * 0.3 * f64::from(size.0));
    (0..8)
        .map(|i| {
            let strip = i / 4;
            (along * f64::from(i % 4), across * f64::from(strip), if strip == 0 { 0.0 } else { 180.0 })
        })
        .collect()
}

/// Verdicts on frames whose stated poses are off by metres and degrees.
fn verdicts(size: (u32, u32), turned: &[(usize, i64)], drawn: impl Fn(f64, f64) -> f64 + Copy) -> Turns {
    let turns = |i: usize| turned.iter().find(|(k, _)| *k == i).map_or(0, |(_, turns)| *turns);
    let mut frames = Vec::new();
    let mut photos = Vec::new();
    for (i, (north, east, yaw)) in survey(size).into_iter().enumerate() {
        let truth = frame("", north, east, yaw, size);
        photos.push(photo(&truth, turns(i), drawn));
        let off = |k: f64| 2.0 * ((i as f64 + 1.0) * k).sin();
        frames.push(frame(&format!("{i}.jpg"), north + off(1.3), east + off(2.1), yaw + off(0.7), size));
    }
    judge(&frames, &photos)
}

fn named(turns: &Turns, verdict: &str) -> Vec<(String, Option<u32>)> {
    let of = turns.frames.iter().filter(|found| found.verdict == verdict);
    of.map(|found| (found.frame.clone(), found.turned_deg)).collect()
}

#[test]
fn frames_stored_as_taken_fit_their_neighbours() {
    let found = verdicts((160, 120), &[], brightness);
    assert_eq!(named(&found, "as declared").len(), 8, "{found:?}");
    assert!(
        found.frames.iter().all(|f| f.neighbours >= 2 && f.score_as_declared.unwrap() > 0.5),
        "{found:?}"
    );
}

#[test]
fn a_turned_strip_is_found_by_its_neighbours_and_by_itself() {
    let found = verdicts((160, 120), &[(4, 2), (5, 2), (6, 2), (7, 2)], brightness);
    let expected: Vec<_> = (4..8).map(|i| (format!("{i}.jpg"), Some(180))).collect();
    assert_eq!(named(&found, "turned"), expected, "{found:?}");
    assert_eq!(named(&found, "as declared").len(), 4, "{found:?}");
}

#[test]
fn a_quarter_turn_shows_only_where_the_image_is_square() {
    let found = verdicts((140, 140), &[(2, 1), (5, 3)], brightness);
    let expected = [("2.jpg".to_owned(), Some(90)), ("5.jpg".to_owned(), Some(270))];
    assert_eq!(named(&found, "turned"), expected, "{found:?}");
}

#[test]
fn without_texture_nothing_can_be_told() {
    let level = verdicts((160, 120), &[(5, 2)], |_, _| 120.0);
    assert_eq!(named(&level, "cannot tell").len(), 8, "{level:?}");
    // Rows of crops look the same from both sides and at many shifts.
    let rows = verdicts((160, 120), &[], |north, _| 120.0 + 40.0 * (north * 2.0).sin());
    assert_eq!(named(&rows, "turned"), [], "{rows:?}");
}
