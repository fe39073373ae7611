//! Advice that names what is missing, and a next photo that keeps what it promises.

use super::super::rendered::paper_camera;
use super::super::simulated::{Scene, around};
use super::super::{LensModel, calibrate};
use super::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

#[test]
fn a_full_set_lacks_nothing_but_one_more_photo() {
    let views = around(&Scene::new(paper_camera(), 0.1), 16, 1);
    let calibration = calibrate(&views, 1152, 648, LensModel::BROWN).unwrap();
    let advice = advice(&views, 1152, 648, Some(&calibration));
    assert!(matches!(advice[..], [Advice::Next(_)]), "{advice:?}");
}

#[test]
fn missing_tilts_and_empty_parts_are_named() {
    let scene = Scene::new(paper_camera(), 0.1);
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let views: Vec<ViewPoints> = (0..3)
        .map(|k| {
            // The far normal leans to the left: the left edge is near.
            let turn = Vector3::new(0.0, -0.3 - 0.1 * f64::from(k), 0.0);
            let pose = scene.pose(Vector3::new(-0.1, -0.05, 0.6), turn);
            scene.view(&format!("view {k}"), &pose, &mut random)
        })
        .collect();
    for calibration in [None, calibrate(&views, 1152, 648, LensModel::RADIAL2).ok()] {
        let advice = advice(&views, 1152, 648, calibration.as_ref());
        assert!(advice.contains(&Advice::MorePhotos { have: 3, wanted: 8 }));
        let missing = vec![NearEdge::Right, NearEdge::Top, NearEdge::Bottom];
        assert!(advice.contains(&Advice::Tilt { missing }), "{advice:?}");
        let empty = advice.iter().find_map(|a| match a {
            Advice::Fill { parts } => Some(parts.clone()),
            _ => None,
        });
        assert!(empty.unwrap().contains(&FramePart { column: 2, row: 2 }));
    }
    let said = Advice::Fill { parts: vec![FramePart { column: 2, row: 2 }] }.to_string();
    assert!(said.contains("lower right"), "{said}");
}

#[test]
fn the_next_photo_keeps_its_promise() {
    let scene = Scene::new(paper_camera(), 0.1);
    let mut views = around(&scene, 5, 8);
    let calibrated = |views: &[ViewPoints]| calibrate(views, 1152, 648, LensModel::BROWN).unwrap();
    let before = calibrated(&views);
    let next = next_photo(&before).unwrap();
    assert!(next.then_px < 0.95 * next.now_px, "{next:?}");
    // Take it, as advised.
    let board = Board::of(&before).unwrap();
    let sight = scene.lens.direction_from_pixel(next.part.middle(1152, 648)).unwrap().normalize();
    let turn = next.near.map_or(Vector3::zeros(), |edge| Vector3::z().cross(&edge.lean()) * 35_f64 / 57.3);
    let rotation = Rotation3::rotation_between(&Vector3::z(), &sight).unwrap() * Rotation3::new(turn);
    let pose = scene.pose(sight * board.distance_m, rotation.scaled_axis());
    views.push(scene.view("next", &pose, &mut ChaCha8Rng::seed_from_u64(9)));
    let after = calibrated(&views);
    let sights = FrameSights::new(&after, 12, 9);
    let now_px = sights.rms_px(&after.camera.covariance.unwrap()) * before.sigma0_px / after.sigma0_px;
    assert!((now_px / next.then_px - 1.0).abs() < 0.25, "{now_px} for {next:?}");
}

#[test]
fn a_photo_taken_twice_is_named() {
    let mut views = around(&Scene::new(paper_camera(), 0.1), 8, 1);
    views.push(ViewPoints { name: "copy".to_owned(), ..views[2].clone() });
    let said: Vec<String> = advice(&views, 1152, 648, None).iter().map(Advice::to_string).collect();
    assert!(said.iter().any(|s| s.starts_with("copy shows the target where view 3 does")), "{said:?}");
}
