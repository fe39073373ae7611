//! Detection on drawn photos of the target: every corner, its accuracy, refusals.

use super::super::MarkerSeen;
use super::*;
use crate::calibration::rendered::{
    Look, any_blocks, hard_renders, hard_seeds, paper_camera, paper_poses, photo, pose, see,
};
use crate::calibration::target::{Marker, Target};
use crate::calibration::zhang::BoardPose;

/// Root mean square distance of an estimate to the truth, and mean distance outwards of the square, px.
fn errors(
    detection: &Detection,
    pose: &BoardPose,
    target: &SquaresTarget,
    estimate: impl Fn(&DetectedCorner) -> ImagePoint,
) -> (f64, f64) {
    let camera = paper_camera();
    let (mut squares, mut outwards) = (0.0, 0.0);
    for corner in &detection.corners {
        let truth = see(&camera, pose, corner.board);
        let opposite = see(&camera, pose, target.corner(corner.row, corner.column, corner.corner + 2));
        let found = estimate(corner);
        let miss = Vector2::new(found.column - truth.column, found.row - truth.row);
        let out = Vector2::new(truth.column - opposite.column, truth.row - opposite.row).normalize();
        squares += miss.norm_squared();
        outwards += miss.dot(&out);
    }
    let n = detection.corners.len() as f64;
    ((squares / n).sqrt(), outwards / n)
}

#[test]
fn the_papers_target_is_found_to_a_thirtieth_of_a_pixel_without_inward_bias() {
    let target = SquaresTarget::paper();
    for (i, pose) in paper_poses().iter().enumerate() {
        let image = photo(&paper_camera(), pose, &Target::Squares(target), Look::PAPER);
        let detection = detect(&image, &target).unwrap();
        assert_eq!(detection.corners.len(), 192, "view {i}");
        assert_eq!(detection.marker, MarkerSeen::Hollow);
        let (blunt, _) = errors(&detection, pose, &target, |c| c.blunt);
        let (refined, _) = errors(&detection, pose, &target, |c| c.refined);
        let (sharp, outwards) = errors(&detection, pose, &target, |c| c.sharp);
        assert!(sharp < 0.03, "view {i}: {sharp} px");
        assert!(outwards.abs() < 0.005, "view {i}: {outwards} px outwards");
        assert!(blunt < 3.0 && refined < 2.5 && sharp < 0.05 * refined, "{blunt} {refined} {sharp}");
    }
}

#[test]
fn any_turn_of_the_board_gives_the_same_labels() {
    let target = SquaresTarget::paper();
    for in_plane in [20.0, 47.0, 90.0, 135.0, 180.0, 250.0, 315.0] {
        let pose = pose(&target, 0.36, (0.01, 0.0), (20.0, -25.0, in_plane));
        let image = photo(&paper_camera(), &pose, &Target::Squares(target), Look { seed: 4, ..Look::PAPER });
        let detection = detect(&image, &target).unwrap();
        assert_eq!(detection.corners.len(), 192, "turned by {in_plane}°");
        let (sharp, outwards) = errors(&detection, &pose, &target, |c| c.sharp);
        assert!(sharp < 0.05 && outwards.abs() < 0.01, "{in_plane}°: {sharp:.4} {outwards:.4} px");
    }
}

#[test]
fn uneven_light_blur_noise_small_and_tilted_targets() {
    let target = SquaresTarget::paper();
    let easy = Look::PAPER;
    let cases = [
        ("light 1:5", 0.33, 25.0, Look { light_at_right: 0.2, ..easy }, 0.09),
        ("blur 2 px", 0.33, 25.0, Look { blur_px: 2.0, ..easy }, 0.08),
        ("noise 12", 0.33, 25.0, Look { noise: 12.0, ..easy }, 0.15),
        ("a quarter of the frame", 0.90, 20.0, easy, 0.12),
        ("tilt 55°", 0.40, 55.0, easy, 0.08),
    ];
    for (name, distance, tilt, look, limit) in cases {
        let pose = pose(&target, distance, (0.0, 0.0), (0.6 * tilt, 0.8 * tilt, 10.0));
        let image = photo(&paper_camera(), &pose, &Target::Squares(target), look);
        let detection = detect(&image, &target).unwrap_or_else(|e| panic!("{name}: {e}"));
        let (sharp, _) = errors(&detection, &pose, &target, |c| c.sharp);
        assert_eq!(detection.corners.len(), 192, "{name}");
        assert!(sharp < limit, "{name}: {sharp} px");
    }
}

#[test]
fn rows_and_columns_are_counted_as_the_target_is_read() {
    let wide = |marker| SquaresTarget::new(4, 6, 0.02, 0.02, marker).unwrap();
    for (marker, in_plane, expected) in [
        (Marker::UpperLeft, 10.0, (4, 6)),
        (Marker::UpperLeft, 95.0, (4, 6)),
        (Marker::UpperLeft, -100.0, (4, 6)),
        (Marker::None, 80.0, (4, 6)),
    ] {
        let pose = pose(&wide(marker), 0.45, (0.0, 0.0), (20.0, -15.0, in_plane));
        let image = photo(&paper_camera(), &pose, &Target::Squares(wide(marker)), Look::PAPER);
        let unsized_target = SquaresTarget::new(2, 2, 0.02, 0.02, marker).unwrap();
        assert_eq!(count(&image, &unsized_target), Ok(expected), "{marker:?} turned by {in_plane}°");
    }
}

#[test]
fn what_is_not_the_target_is_said() {
    let seven = SquaresTarget::paper();
    let six = SquaresTarget::new(6, 6, 0.0157, 0.0157, Marker::None).unwrap();
    let plain = SquaresTarget::new(7, 7, 0.0157, 0.0157, Marker::None).unwrap();
    let pose = pose(&seven, 0.35, (0.0, 0.0), (20.0, -15.0, 5.0));
    let drawn =
        |target: &SquaresTarget| photo(&paper_camera(), &pose, &Target::Squares(*target), Look::PAPER);
    let say = |image: &Grey, target: &SquaresTarget| detect(image, target).unwrap_err().to_string();
    assert_eq!(say(&drawn(&six), &seven), "found 6 × 6 squares of the target's 7 × 7");
    assert!(say(&drawn(&plain), &six).contains("more than the target's 6 × 6"));
    assert!(say(&drawn(&plain), &seven).contains("no hollow square"));
    assert!(say(&drawn(&seven), &plain).contains("none was declared"));
    let refuse = |width, height| {
        let flat = Grey::new(width, height, vec![90.0; width * height]).unwrap();
        crate::calibration::detect(&flat, &Target::Squares(seven)).unwrap_err().to_string()
    };
    assert_eq!(refuse(200, 100), "the photo has no contrast");
    assert!(refuse(20, 20).contains("too small"));
}

#[test]
fn photos_larger_than_the_search_are_located_in_full() {
    let target = SquaresTarget::paper();
    let scale = 3.0;
    let mut interior = paper_camera().interior();
    for value in &mut interior[..5] {
        *value *= scale;
    }
    let camera = crate::camera::Brown::new(interior).unwrap();
    let look = Look { width: 3456, height: 1944, blur_px: 1.5, ..Look::PAPER };
    let pose = paper_poses()[0];
    let detection = detect(&photo(&camera, &pose, &Target::Squares(target), look), &target).unwrap();
    assert_eq!(detection.corners.len(), 192);
    for corner in &detection.corners {
        let truth = see(&camera, &pose, corner.board);
        let miss = f64::hypot(corner.sharp.column - truth.column, corner.sharp.row - truth.row);
        assert!(miss < 0.1, "{corner:?} misses by {miss} px");
    }
}

#[test]
fn hard_views_are_found_and_never_labelled_wrongly() {
    let seeds = hard_seeds(60);
    let outcome = hard_renders(&Target::Squares(SquaresTarget::paper()), &[0], seeds.clone());
    println!("{outcome:?}");
    assert!(outcome.is_found_in(0.98, &seeds), "{outcome:?}");
}

proptest::proptest! {
    #[test]
    fn any_image_is_answered_without_panic(
        width in 1..70_usize, height in 1..70_usize, seed in 0..u64::MAX, coarse in 1..16_usize,
    ) {
        let image = any_blocks(width, height, seed, coarse, 0.4);
        let target = SquaresTarget::new(2, 2, 0.01, 0.01, Marker::None).unwrap();
        let _ = detect(&image, &target);
    }
}
