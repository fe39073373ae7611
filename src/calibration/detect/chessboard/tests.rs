//! Detection on drawn photos of chessboards: every corner, its accuracy, refusals.

use super::*;
use crate::calibration::rendered::{
    Look, any_blocks, facing, hard_renders, hard_seeds, paper_camera, photo, see,
};
use crate::calibration::target::{BoardPoint, Target};
use crate::calibration::zhang::BoardPose;
use crate::camera::Brown;

const SQUARE_M: f64 = 0.02;

fn board(rows: usize, columns: usize) -> ChessboardTarget {
    ChessboardTarget::new(rows, columns, SQUARE_M).unwrap()
}

/// The board's middle before the camera.
fn posed(target: &ChessboardTarget, distance_m: f64, turns: (f64, f64, f64)) -> BoardPose {
    let last = target.corner(target.rows() - 1, target.columns() - 1);
    let middle = BoardPoint { x_m: 0.5 * last.x_m, y_m: 0.5 * last.y_m };
    facing(middle, distance_m, (0.0, 0.0), turns)
}

fn drawn(target: &ChessboardTarget, pose: &BoardPose, look: Look) -> Grey {
    photo(&paper_camera(), pose, &Target::Chessboard(*target), look)
}

/// Root mean square distance of all corners to the truth, px.
fn rms(camera: &Brown, detection: &Detection, pose: &BoardPose) -> f64 {
    let misses = detection.corners.iter().map(|corner| {
        let truth = see(camera, pose, corner.board);
        (corner.sharp.column - truth.column).powi(2) + (corner.sharp.row - truth.row).powi(2)
    });
    (misses.sum::<f64>() / detection.corners.len() as f64).sqrt()
}

#[test]
fn corners_are_found_to_a_fiftieth_of_a_pixel() {
    let target = board(11, 12);
    for turns in [(25.0, -20.0, 3.0), (-25.0, 20.0, -5.0), (5.0, 30.0, 8.0)] {
        let pose = posed(&target, 0.42, turns);
        let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
        assert_eq!(detection.corners.len(), 132);
        let error = rms(&paper_camera(), &detection, &pose);
        assert!(error < 0.02, "turned by {turns:?}: {error} px");
    }
}

#[test]
fn blur_noise_gamma_light_tilt_and_missing_margins() {
    let target = board(6, 9);
    let easy = Look::PAPER;
    let cases = [
        ("light 1:5", 25.0, Look { light_at_right: 0.2, ..easy }, 0.05),
        ("blur 2 px", 25.0, Look { blur_px: 2.0, ..easy }, 0.03),
        ("noise 10", 25.0, Look { noise: 10.0, ..easy }, 0.06),
        ("gamma 2.2", 25.0, Look { gamma: 2.2, ..easy }, 0.03),
        ("tilt 60°", 60.0, easy, 0.04),
        ("no margin", 25.0, Look { margin: 0.0, ..easy }, 0.02),
    ];
    for (name, tilt, look, limit) in cases {
        let pose = posed(&target, 0.3, (0.6 * tilt, 0.8 * tilt, 10.0));
        let detection = detect(&drawn(&target, &pose, look), &target);
        let detection = detection.unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(detection.corners.len(), 54, "{name}");
        let error = rms(&paper_camera(), &detection, &pose);
        assert!(error < limit, "{name}: {error} px");
    }
}

#[test]
fn odd_and_even_numbers_of_corners_make_one_upright_position() {
    let target = board(6, 9);
    for in_plane in [0.0, 20.0, 47.0, 90.0, 135.0, 180.0, 250.0, 315.0] {
        let pose = posed(&target, 0.35, (20.0, -25.0, in_plane));
        let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
        let error = rms(&paper_camera(), &detection, &pose);
        assert!(detection.corners.len() == 54 && error < 0.03, "turned by {in_plane}°: {error} px");
    }
}

#[test]
fn boards_without_an_upright_position_begin_at_the_upper_left() {
    for (rows, columns, in_plane) in [(7, 7, 5.0), (6, 8, 10.0), (5, 7, -10.0)] {
        let target = board(rows, columns);
        let pose = posed(&target, 0.35, (15.0, -15.0, in_plane));
        let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
        assert!(rms(&paper_camera(), &detection, &pose) < 0.03, "{rows} × {columns}");
    }
}

#[test]
fn rows_and_columns_are_counted() {
    for (rows, columns, in_plane) in [(6, 9, 10.0), (9, 6, 95.0), (5, 5, -100.0), (3, 8, 170.0)] {
        let pose = posed(&board(rows, columns), 0.35, (20.0, -15.0, in_plane));
        let image = drawn(&board(rows, columns), &pose, Look { clutter: 10, ..Look::PAPER });
        let expected = (rows.min(columns), rows.max(columns));
        assert_eq!(count(&image, &board(2, 2)), Ok(expected), "turned by {in_plane}°");
    }
}

#[test]
fn what_is_not_the_board_is_said() {
    let say = |image: &Grey, target: &ChessboardTarget| detect(image, target).unwrap_err().to_string();
    let target = board(6, 9);
    let pose = posed(&target, 0.35, (20.0, -15.0, 5.0));
    let image = drawn(&target, &pose, Look::PAPER);
    assert_eq!(say(&image, &board(7, 9)), "found 6 × 9 inner corners of the target's 7 × 9");
    assert_eq!(say(&image, &board(9, 7)), "found 9 × 6 inner corners of the target's 9 × 7");
    assert_eq!(say(&image, &board(6, 8)), "found 6 × 9 inner corners, more than the target's 6 × 8");
    // Two of the nine columns are outside the frame.
    let mut beside = pose;
    beside.translation.x += 0.26;
    let cut = say(&drawn(&target, &beside, Look::PAPER), &target);
    assert!(cut.contains("of the target's 6 × 9"), "{cut}");
    let flat = Grey::new(300, 200, (0..60_000).map(|i| (i % 300) as f32).collect()).unwrap();
    assert!(say(&flat, &target).contains("no lattice of crossings of edges found"));
}

#[test]
fn two_boards_in_one_photo_are_refused() {
    let target = board(4, 5);
    let mut pose = posed(&target, 0.4, (10.0, -15.0, 5.0));
    pose.translation.x -= 0.12;
    let one = drawn(&target, &pose, Look::PAPER);
    assert!(detect(&one, &target).is_ok());
    // The left half twice.
    let (w, h) = (one.width(), one.height());
    let values = (0..w * h).map(|i| one.values()[i / w * w + i % w % (w / 2)]).collect();
    let two = Grey::new(w, h, values).unwrap();
    assert_eq!(detect(&two, &target), Err(DetectError::Lattice(LatticeError::Several { targets: 2 })));
}

#[test]
fn large_photos_are_searched_reduced_and_located_in_full() {
    let target = board(6, 9);
    let mut interior = paper_camera().interior();
    interior[..5].iter_mut().for_each(|value| *value *= 3.0);
    let camera = Brown::new(interior).unwrap();
    let look = Look { width: 3456, height: 1944, blur_px: 1.5, ..Look::PAPER };
    // A board as wide as the frame, and one of a fifth of it.
    for distance in [0.2, 1.0] {
        let pose = posed(&target, distance, (15.0, -20.0, 3.0));
        let image = photo(&camera, &pose, &Target::Chessboard(target), look);
        let detection = detect(&image, &target).unwrap();
        let error = rms(&camera, &detection, &pose);
        assert!(detection.corners.len() == 54 && error < 0.03, "{distance} m: {error} px");
    }
}

#[test]
fn hard_views_are_found_and_never_labelled_wrongly() {
    let seeds = hard_seeds(60);
    let outcome = hard_renders(&Target::Chessboard(board(6, 9)), &[0], seeds.clone());
    println!("{outcome:?}");
    assert!(outcome.is_found_in(0.98, &seeds) && outcome.rms_px < 0.1, "{outcome:?}");
}

proptest::proptest! {
    #[test]
    fn any_image_is_answered_without_panic(
        width in 1..90_usize, height in 1..90_usize, seed in 0..u64::MAX, coarse in 1..16_usize,
    ) {
        let image = any_blocks(width, height, seed, coarse, 0.5);
        let _ = detect(&image, &board(2, 2));
        let _ = count(&image, &board(2, 2));
    }
}
