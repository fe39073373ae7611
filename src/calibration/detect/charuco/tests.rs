//! Detection on drawn photos of ChArUco boards.

use super::*;
use crate::calibration::rendered::{Look, facing, hard_renders, paper_camera, photo, see};
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
            eprintln!("{turns:?}: {} px missing {:?}", error(&detection, &pose), detection.missing);
        }
    }
}

#[test]
fn hard_views_are_found_and_never_labelled_wrongly() {
    let target = five_by_seven();
    let outcome = hard_renders(&Target::Charuco(target), &[0], 0..60);
    eprintln!("{outcome:?}");
}
