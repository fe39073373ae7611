//! Detection on drawn photos of ChArUco boards.

use super::*;
use crate::calibration::rendered::{
    Look, any_blocks, facing, hard_renders, hard_seeds, paper_camera, photo, see,
};
use crate::calibration::target::{Dictionary, Target};
use crate::calibration::zhang::BoardPose;

fn board(rows: usize, columns: usize, dictionary: &str, legacy: bool) -> CharucoTarget {
    let dictionary = Dictionary::named(dictionary).unwrap();
    CharucoTarget::new(rows, columns, 0.03, 0.0225, dictionary, 0, legacy).unwrap()
}

fn five_by_seven() -> CharucoTarget {
    board(5, 7, "DICT_4X4_50", false)
}

/// The board's middle in front of the paper's camera, moved by metres.
fn posed(target: &CharucoTarget, distance_m: f64, shift_m: (f64, f64), turns: (f64, f64, f64)) -> BoardPose {
    let far = target.corner(target.rows() - 2, target.columns() - 2);
    facing(BoardPoint { x_m: 0.5 * far.x_m, y_m: 0.5 * far.y_m }, distance_m, shift_m, turns)
}

fn drawn(target: &CharucoTarget, pose: &BoardPose, look: Look) -> Grey {
    photo(&paper_camera(), pose, &Target::Charuco(*target), look)
}

/// Root mean square of the distance from the truth, px.
fn error(detection: &Detection, pose: &BoardPose) -> f64 {
    let square = |c: &DetectedCorner| {
        let truth = see(&paper_camera(), pose, c.board);
        (c.sharp.column - truth.column).powi(2) + (c.sharp.row - truth.row).powi(2)
    };
    (detection.corners.iter().map(square).sum::<f64>() / detection.corners.len() as f64).sqrt()
}

#[test]
fn corners_are_found_to_a_thirtieth_of_a_pixel() {
    for target in
        [five_by_seven(), board(8, 5, "DICT_6X6_250", true), board(6, 9, "DICT_APRILTAG_36h11", false)]
    {
        for turns in [(20.0, -25.0, 4.0), (-30.0, 20.0, 100.0), (0.0, 45.0, 200.0)] {
            let pose = posed(&target, 0.35, (0.0, -0.01), turns);
            let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
            assert!(detection.missing.is_empty(), "{turns:?}: {:?}", detection.missing);
            let rms = error(&detection, &pose);
            assert!(rms < 0.03, "{turns:?}: {rms} px");
        }
    }
}

#[test]
fn a_part_of_the_board_is_enough() {
    let target = board(9, 12, "DICT_5X5_100", false);
    let pose = posed(&target, 0.17, (0.05, 0.04), (15.0, -20.0, 10.0));
    let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
    assert!((LEAST_CORNERS..70).contains(&detection.corners.len()), "{}", detection.corners.len());
    assert_eq!(detection.missing.len() + detection.corners.len(), 8 * 11);
    assert!(error(&detection, &pose) < 0.05);
}

#[test]
fn squares_are_counted_from_the_numbers() {
    for target in [five_by_seven(), board(6, 5, "DICT_5X5_100", true), board(6, 8, "DICT_5X5_100", false)] {
        let pose = posed(&target, 0.35, (0.0, 0.0), (20.0, -15.0, 130.0));
        let image = drawn(&target, &pose, Look::PAPER);
        // Whether the number of rows is even decides how the old layout begins.
        let other = board(target.rows() + 2, 4, target.dictionary().name(), target.legacy());
        assert_eq!(count(&image, &other), Ok((target.rows(), target.columns())));
    }
}

#[test]
fn what_is_not_the_target_is_said() {
    let target = board(6, 7, "DICT_4X4_50", false);
    let image = drawn(&target, &posed(&target, 0.35, (0.0, 0.0), (20.0, -15.0, 5.0)), Look::PAPER);
    let say = |image: &Grey, target: &CharucoTarget| detect(image, target).unwrap_err().to_string();
    let other = |rows, columns, legacy| board(rows, columns, "DICT_4X4_50", legacy);
    assert_eq!(say(&image, &other(6, 9, false)), "found 6 × 7 squares of the target's 6 × 9");
    assert_eq!(say(&image, &other(4, 7, false)), "found 6 × 7 squares, more than the target's 4 × 7");
    assert!(say(&image, &other(6, 7, true)).contains("not in the declared layout"));
    let even = board(6, 8, "DICT_4X4_50", true);
    let seen = drawn(&even, &posed(&even, 0.35, (0.0, 0.0), (20.0, -15.0, 5.0)), Look::PAPER);
    assert!(say(&seen, &other(6, 8, false)).contains("not in the declared layout"));
    let mirrored: Vec<f32> =
        image.values().chunks_exact(image.width()).flat_map(|row| row.iter().rev().copied()).collect();
    let mirrored = Grey::new(image.width(), image.height(), mirrored).unwrap();
    assert!(say(&mirrored, &target).ends_with("the photo is mirrored"));
    assert!(say(&image, &board(6, 7, "DICT_7X7_50", false)).starts_with("no lattice of markers"));
}

#[test]
fn hard_views_are_found_and_never_labelled_wrongly() {
    let seeds = hard_seeds(60);
    let outcome = hard_renders(&Target::Charuco(five_by_seven()), &[0], seeds.clone());
    println!("{outcome:?}");
    assert!(outcome.is_found_in(0.96, &seeds) && outcome.rms_px < 0.15, "{outcome:?}");
}

proptest::proptest! {
    #[test]
    fn any_image_is_answered_without_panic(
        width in 1..70_usize, height in 1..70_usize, seed in 0..u64::MAX, coarse in 1..9_usize,
    ) {
        let image = any_blocks(width, height, seed, coarse, 0.5);
        let target = Target::Charuco(board(4, 4, "DICT_ARUCO_ORIGINAL", true));
        let _ = crate::calibration::detect(&image, &target);
        let _ = crate::calibration::count(&image, &target);
    }
}
