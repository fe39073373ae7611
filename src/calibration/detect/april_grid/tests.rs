//! Detection on drawn photos of AprilGrids.

use super::*;
use crate::calibration::rendered::{
    Look, any_blocks, facing, hard_renders, hard_seeds, paper_camera, photo, see,
};
use crate::calibration::target::{BoardPoint, Dictionary, TagPrint, Target};
use crate::calibration::zhang::BoardPose;

fn kalibr(rows: usize, columns: usize) -> AprilGridTarget {
    AprilGridTarget::new(rows, columns, 0.03, 0.009, TagPrint::kalibr()).unwrap()
}

fn plain(rows: usize, columns: usize) -> AprilGridTarget {
    let print =
        TagPrint { border: 1, corner_squares: false, order: TagOrder::FromUpperLeft, ..TagPrint::kalibr() };
    AprilGridTarget::new(rows, columns, 0.03, 0.009, print).unwrap()
}

/// The board's middle in front of the paper's camera, moved by metres.
fn posed(
    target: &AprilGridTarget,
    distance_m: f64,
    shift_m: (f64, f64),
    turns: (f64, f64, f64),
) -> BoardPose {
    let far = target.corner(target.rows() - 1, target.columns() - 1, 2);
    facing(BoardPoint { x_m: 0.5 * far.x_m, y_m: 0.5 * far.y_m }, distance_m, shift_m, turns)
}

fn drawn(target: &AprilGridTarget, pose: &BoardPose, look: Look) -> Grey {
    photo(&paper_camera(), pose, &Target::AprilGrid(*target), look)
}

/// Root mean square of the distance from the truth and mean distance outwards of the tag, px.
fn errors(detection: &Detection, pose: &BoardPose, target: &AprilGridTarget) -> (f64, f64) {
    let (mut squares, mut outwards) = (0.0, 0.0);
    for c in &detection.corners {
        let pixel = |board| {
            let p = see(&paper_camera(), pose, board);
            Vector2::new(p.column, p.row)
        };
        let truth = pixel(c.board);
        let out = (truth - pixel(target.corner(c.row, c.column, c.corner + 2))).normalize();
        let miss = Vector2::new(c.sharp.column, c.sharp.row) - truth;
        squares += miss.norm_squared();
        outwards += miss.dot(&out);
    }
    let n = detection.corners.len() as f64;
    ((squares / n).sqrt(), outwards / n)
}

#[test]
fn corners_are_found_to_a_thirtieth_of_a_pixel_without_bias() {
    for target in [kalibr(6, 6), plain(5, 7)] {
        for turns in [(20.0, -25.0, 4.0), (-30.0, 20.0, 100.0), (0.0, 45.0, 200.0)] {
            let pose = posed(&target, 0.42, (0.0, -0.01), turns);
            let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
            let (rms, outwards) = errors(&detection, &pose, &target);
            assert!(detection.missing.is_empty(), "{turns:?}: {:?}", detection.missing);
            assert!(rms < 0.033 && outwards.abs() < 0.015, "{turns:?}: {rms} px, {outwards} px outwards");
        }
    }
}

#[test]
fn a_part_of_the_board_is_enough() {
    let target = kalibr(6, 6);
    // Much nearer than the board is large, off to the side: most of it is outside the photo.
    let pose = posed(&target, 0.15, (0.06, 0.05), (15.0, -20.0, 10.0));
    let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
    assert!((8..100).contains(&detection.corners.len()), "{}", detection.corners.len());
    let missing = |c: &DetectedCorner| detection.missing.contains(&(c.row, c.column));
    assert!(detection.missing.len() < 36 && !detection.corners.iter().any(missing));
    // Near the border of the photo the lens bends the edges of such large tags most.
    let (rms, _) = errors(&detection, &pose, &target);
    assert!(rms < 0.15, "{rms} px");
}

#[test]
fn rows_and_columns_are_counted_from_the_numbers() {
    for target in [kalibr(4, 5), plain(5, 3)] {
        let pose = posed(&target, 0.4, (0.0, 0.0), (20.0, -15.0, 130.0));
        let image = drawn(&target, &pose, Look::PAPER);
        let other = target.resized(2, 2).unwrap();
        assert_eq!(count(&image, &other), Ok((target.rows(), target.columns())));
    }
}

#[test]
fn what_is_not_the_target_is_said() {
    let target = kalibr(4, 5);
    let image = drawn(&target, &posed(&target, 0.4, (0.0, 0.0), (20.0, -15.0, 5.0)), Look::PAPER);
    let say = |image: &Grey, target: &AprilGridTarget| detect(image, target).unwrap_err().to_string();
    assert_eq!(say(&image, &kalibr(4, 6)), "found 4 × 5 tags of the target's 4 × 6");
    assert_eq!(say(&image, &kalibr(3, 5)), "found 4 × 5 tags, more than the target's 3 × 5");
    let downwards = TagPrint { order: TagOrder::FromUpperLeft, ..TagPrint::kalibr() };
    let downwards = AprilGridTarget::new(4, 5, 0.03, 0.009, downwards).unwrap();
    assert_eq!(say(&image, &downwards), "the tags are numbered from the lower left, unlike declared");
    let mirrored: Vec<f32> =
        image.values().chunks_exact(image.width()).flat_map(|row| row.iter().rev().copied()).collect();
    let mirrored = Grey::new(image.width(), image.height(), mirrored).unwrap();
    assert_eq!(say(&mirrored, &target), "20 tags can be read in a mirror only: the photo is mirrored");
    let other = TagPrint { family: Dictionary::named("tag25h9").unwrap(), ..TagPrint::kalibr() };
    let other = AprilGridTarget::new(4, 5, 0.03, 0.009, other).unwrap();
    assert!(say(&image, &other).starts_with("no lattice of tags found"));
}

#[test]
fn hard_views_are_found_and_never_labelled_wrongly() {
    for target in [kalibr(6, 6), plain(5, 7)] {
        let seeds = hard_seeds(30);
        let outcome = hard_renders(&Target::AprilGrid(target), &[0], seeds.clone());
        println!("{:?}: {outcome:?}", target.print());
        assert!(outcome.is_found_in(0.96, &seeds), "{outcome:?}");
    }
}

proptest::proptest! {
    #[test]
    fn any_image_is_answered_without_panic(
        width in 1..70_usize, height in 1..70_usize, seed in 0..u64::MAX, coarse in 1..9_usize,
    ) {
        let image = any_blocks(width, height, seed, coarse, 0.5);
        let target = Target::AprilGrid(plain(2, 2));
        let _ = crate::calibration::detect(&image, &target);
        let _ = crate::calibration::count(&image, &target);
    }
}
