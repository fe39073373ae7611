//! Detection on drawn photos of circle grids.

use super::*;
use crate::calibration::rendered::{
    Look, any_blocks, facing, hard_renders, hard_seeds, paper_camera, photo, see,
};
use crate::calibration::target::Target;
use crate::calibration::zhang::BoardPose;

fn symmetric(rows: usize, columns: usize, diameter: f64) -> CirclesTarget {
    CirclesTarget::new(rows, columns, 0.03, 0.03 * diameter, CircleLayout::Symmetric).unwrap()
}

fn asymmetric(rows: usize, columns: usize) -> CirclesTarget {
    CirclesTarget::new(rows, columns, 0.02, 0.02, CircleLayout::Asymmetric).unwrap()
}

fn far_end(target: &CirclesTarget) -> BoardPoint {
    let (rows, columns) = (target.rows(), target.columns());
    let right = target.centre(rows.min(2) - 1, columns - 1).x_m.max(target.centre(0, columns - 1).x_m);
    BoardPoint { x_m: right, y_m: target.centre(rows - 1, 0).y_m }
}

/// The board's middle in front of the paper's camera.
fn posed(target: &CirclesTarget, distance_m: f64, turns: (f64, f64, f64)) -> BoardPose {
    let far = far_end(target);
    facing(BoardPoint { x_m: 0.5 * far.x_m, y_m: 0.5 * far.y_m }, distance_m, (0.0, -0.01), turns)
}

fn drawn(target: &CirclesTarget, pose: &BoardPose, look: Look) -> Grey {
    photo(&paper_camera(), pose, &Target::Circles(*target), look)
}

/// Mean and root mean square of the distance from the truth, px.
fn error(detection: &Detection, pose: &BoardPose) -> (Vector2<f64>, f64) {
    let misses: Vec<Vector2<f64>> = detection
        .corners
        .iter()
        .map(|corner| {
            let truth = see(&paper_camera(), pose, corner.board);
            Vector2::new(corner.sharp.column - truth.column, corner.sharp.row - truth.row)
        })
        .collect();
    let n = misses.len() as f64;
    let mean = misses.iter().sum::<Vector2<f64>>() / n;
    (mean, (misses.iter().map(Vector2::norm_squared).sum::<f64>() / n).sqrt())
}

#[test]
fn large_tilted_discs_show_no_bias_of_their_centres() {
    let target = symmetric(5, 7, 0.7);
    for (turns, light_at_right) in [((45.0, 0.0, 5.0), 1.0), ((-30.0, 35.0, 20.0), 0.3)] {
        let pose = posed(&target, 0.28, turns);
        let image = drawn(&target, &pose, Look { noise: 0.5, light_at_right, ..Look::PAPER });
        let detection = detect(&image, &target).unwrap();
        assert_eq!(detection.corners.len(), 35);
        let (mean, rms) = error(&detection, &pose);
        assert!(mean.norm() < 0.01 && rms < 0.02, "{turns:?}: {mean:?} mean, {rms} px");
    }
}

#[test]
fn centres_are_found_to_a_thirtieth_of_a_pixel_under_usual_noise() {
    for target in [symmetric(7, 9, 0.5), asymmetric(11, 4)] {
        let pose = posed(&target, 0.4, (25.0, -20.0, 3.0));
        let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
        assert!(detection.missing.is_empty());
        let (_, rms) = error(&detection, &pose);
        assert!(rms < 0.03, "{rms} px");
    }
}

#[test]
fn an_asymmetric_grid_of_an_odd_number_of_rows_is_read_the_same_way_at_any_turn() {
    let target = asymmetric(7, 4);
    for in_plane in [0.0, 50.0, 90.0, 170.0, 180.0, 260.0, 330.0] {
        let pose = posed(&target, 0.35, (20.0, -25.0, in_plane));
        let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
        let (_, rms) = error(&detection, &pose);
        assert!(detection.missing.is_empty() && rms < 0.05, "{in_plane}°: {rms} px");
    }
}

#[test]
fn the_first_circle_of_a_square_grid_is_the_one_nearest_to_the_images_upper_left() {
    let target = symmetric(5, 5, 0.5);
    for in_plane in [-30.0, 60.0, 150.0, 240.0] {
        let pose = posed(&target, 0.3, (15.0, 10.0, in_plane));
        let detection = detect(&drawn(&target, &pose, Look::PAPER), &target).unwrap();
        let at = |c: &DetectedCorner| f64::hypot(c.sharp.column, c.sharp.row);
        let outer = detection.corners.iter().filter(|c| c.row % 4 == 0 && c.column % 4 == 0);
        let first = outer.min_by(|a, b| at(a).total_cmp(&at(b))).unwrap();
        assert_eq!((first.row, first.column), (0, 0), "turned by {in_plane}°");
    }
}

#[test]
fn white_discs_on_black_are_found_too() {
    let target = symmetric(5, 7, 0.5);
    let pose = posed(&target, 0.3, (20.0, 10.0, 5.0));
    let image = drawn(&target, &pose, Look::PAPER).negative();
    let detection = detect(&image, &target).unwrap();
    assert!(detection.missing.is_empty() && error(&detection, &pose).1 < 0.03);
}

#[test]
fn rows_and_columns_are_counted() {
    for (target, expected) in [
        (symmetric(4, 7, 0.5), (4, 7)),
        (asymmetric(11, 4), (11, 4)),
        (asymmetric(4, 5), (4, 5)),
        (asymmetric(6, 3), (6, 3)),
    ] {
        for in_plane in [5.0, 95.0] {
            let pose = posed(&target, 0.45, (20.0, -15.0, in_plane));
            let image = drawn(&target, &pose, Look::PAPER);
            assert_eq!(count(&image, &target), Ok(expected), "turned by {in_plane}°");
        }
    }
}

#[test]
fn what_is_not_the_target_is_said() {
    let target = symmetric(5, 7, 0.5);
    let image = drawn(&target, &posed(&target, 0.4, (20.0, -15.0, 5.0)), Look::PAPER);
    let say = |image: &Grey, target: &CirclesTarget| detect(image, target).unwrap_err().to_string();
    assert_eq!(say(&image, &symmetric(6, 7, 0.5)), "found 5 × 7 circles of the target's 6 × 7");
    assert_eq!(say(&image, &symmetric(4, 7, 0.5)), "found 5 × 7 circles, more than the target's 4 × 7");
    assert!(say(&image, &asymmetric(5, 4)).contains("not in the declared layout"));
    // The same board twice: the left half of one photo and the right half of another.
    let small = |turn: f64| drawn(&target, &posed(&target, 0.9, (10.0, 5.0, turn)), Look::PAPER);
    let (width, shift) = (image.width(), image.width() / 4);
    let (one, two) = (small(5.0), small(40.0));
    let twice = (0..width * image.height()).map(|i| {
        let (column, row) = (i % width, i / width);
        let (photo, from) = if column < width / 2 { (&one, column + shift) } else { (&two, column - shift) };
        photo.values()[row * width + from]
    });
    let twice = Grey::new(width, image.height(), twice.collect()).unwrap();
    assert_eq!(say(&twice, &target), "2 targets are in the photo, the points of one are wanted");
    let flat = Grey::new(100, 100, (0..10_000).map(|i| (i % 7) as f32).collect()).unwrap();
    assert!(say(&flat, &target).starts_with("no lattice of circles"));
}

/// Quarter turns after which a board looks the same.
fn turns(target: &CirclesTarget) -> &'static [usize] {
    let unique = target.layout() == CircleLayout::Asymmetric && target.rows() % 2 == 1;
    if unique { &[0] } else { &[0, 2] }
}

#[test]
fn hard_views_are_found_and_never_labelled_wrongly() {
    for target in [symmetric(7, 9, 0.5), asymmetric(11, 4)] {
        let seeds = hard_seeds(40);
        let outcome = hard_renders(&Target::Circles(target), turns(&target), seeds.clone());
        println!("{:?}: {outcome:?}", target.layout());
        assert!(outcome.is_found_in(0.97, &seeds) && outcome.rms_px < 0.1, "{outcome:?}");
    }
}

proptest::proptest! {
    #[test]
    fn any_image_is_answered_without_panic(
        width in 1..70_usize, height in 1..70_usize, seed in 0..u64::MAX, coarse in 1..9_usize,
    ) {
        let image = any_blocks(width, height, seed, coarse, 0.3);
        for target in [symmetric(2, 2, 0.5), asymmetric(2, 2)] {
            let _ = crate::calibration::detect(&image, &Target::Circles(target));
            let _ = crate::calibration::count(&image, &Target::Circles(target));
        }
    }
}
