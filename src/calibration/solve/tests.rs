//! The adjustment against known cameras: exactness, noise, covariance, refusals.

use super::super::rendered::{observe, paper_camera, paper_poses, pose};
use super::super::simulated::{Scene, around};
use super::super::target::SquaresTarget;
use super::*;
use nalgebra::{Rotation3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// √(0.0943 / 2) px per axis: the paper's J/576.
const PAPER_NOISE_PX: f64 = 0.2198;

fn paper_views(noise_px: f64, seed: u64) -> Vec<ViewPoints> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let target = SquaresTarget::paper();
    paper_poses()
        .iter()
        .enumerate()
        .map(|(i, pose)| ViewPoints {
            name: format!("view {}", i + 1),
            observations: observe(&paper_camera(), pose, &target, noise_px, &mut random),
        })
        .collect()
}

#[test]
fn the_target_fills_the_frame_as_the_reference_assumes() {
    for view in paper_views(0.0, 0) {
        let rows = || view.observations.iter().map(|o| o.pixel.row);
        let columns = || view.observations.iter().map(|o| o.pixel.column);
        let (top, bottom) = (rows().fold(f64::MAX, f64::min), rows().fold(f64::MIN, f64::max));
        let (left, right) = (columns().fold(f64::MAX, f64::min), columns().fold(f64::MIN, f64::max));
        let share = (bottom - top) / 648.0;
        assert!((0.72..=0.87).contains(&share), "{}: {share}", view.name);
        assert!(top > 5.0 && bottom < 642.0 && left > 5.0 && right < 1146.0);
    }
}

#[test]
fn noise_free_points_return_the_papers_camera() {
    let calibration = calibrate(&paper_views(0.0, 0), 1152, 648, LensModel::PAPER).unwrap();
    let truth = paper_camera().interior();
    for (k, value) in calibration.camera.lens.interior().into_iter().enumerate().take(10) {
        let relative = (value / truth[k] - 1.0).abs();
        assert!(relative < 1e-6, "{} {value} for {}: {relative:.1e}", Brown::NAMES[k], truth[k]);
    }
    for (view, pose) in calibration.views.iter().zip(paper_poses()) {
        assert!((view.camera_from_board.origin.vector() - pose.translation).norm() < 1e-9);
        assert!(view.camera_from_board.rotation.matrix().relative_eq(pose.rotation.matrix(), 1e-9, 1e-9));
    }
    assert!(calibration.rms_px < 1e-8);
}

#[test]
fn noisy_points_return_it_within_four_standard_deviations() {
    let truth = paper_camera().interior();
    for seed in 0..20 {
        let views = paper_views(PAPER_NOISE_PX, seed);
        let calibration = calibrate(&views, 1152, 648, LensModel::PAPER).unwrap();
        for (k, value) in calibration.camera.lens.interior().into_iter().enumerate().take(10) {
            let z = (value - truth[k]) / calibration.std[k];
            assert!(z.abs() < 4.0, "seed {seed}: {} is {z:.1} standard deviations off", Brown::NAMES[k]);
        }
        let j = calibration.j_per_point;
        assert!((j - 0.0943).abs() < 0.0105, "seed {seed}: J/576 = {j}");
    }
}

#[test]
fn standard_deviations_are_those_of_the_reference() {
    let calibration = calibrate(&paper_views(PAPER_NOISE_PX, 3), 1152, 648, LensModel::PAPER).unwrap();
    // paper-numbers e), for an unpublished choice of three views: order of magnitude only.
    let reference = [1.08, 0.97, 0.34, 0.71, 0.78, 0.011, 0.115, 0.0004, 0.0004, 0.35];
    for (k, expected) in reference.into_iter().enumerate() {
        let ratio = calibration.std[k] / expected;
        assert!(
            (1.0 / 3.0..3.0).contains(&ratio),
            "{}: {} for {expected}",
            Brown::NAMES[k],
            calibration.std[k]
        );
    }
    assert!(calibration.insignificant.contains(&"k3"), "{:?}", calibration.insignificant);
}

#[test]
fn predicted_covariance_is_the_spread_of_recalibrations() {
    const RUNS: u64 = 200;
    let truth = paper_camera().interior();
    let mut predicted = [0.0; 10];
    let mut squares = [0.0; 10];
    let mut pose_squares = [0.0; 6];
    let mut pose_predicted = [0.0; 6];
    for seed in 0..RUNS {
        let views = paper_views(PAPER_NOISE_PX, 1000 + seed);
        let calibration = calibrate(&views, 1152, 648, LensModel::PAPER).unwrap();
        let interior = calibration.camera.lens.interior();
        for k in 0..10 {
            squares[k] += (interior[k] - truth[k]).powi(2) / RUNS as f64;
            predicted[k] += calibration.std[k].powi(2) / RUNS as f64;
        }
        let (view, pose) = (&calibration.views[1], paper_poses()[1]);
        let turn = Rotation3::from_matrix_unchecked(view.camera_from_board.rotation.matrix())
            * pose.rotation.inverse();
        let shift = view.camera_from_board.origin.vector() - pose.translation;
        let error = [turn.scaled_axis(), shift];
        for k in 0..6 {
            pose_squares[k] += error[k / 3][k % 3].powi(2) / RUNS as f64;
            pose_predicted[k] += view.pose_covariance[(k, k)] / RUNS as f64;
        }
    }
    // 200 draws know a standard deviation to 5 %; 4 of those.
    for k in 0..10 {
        let ratio = (squares[k] / predicted[k]).sqrt();
        assert!((ratio - 1.0).abs() < 0.2, "{}: spread / predicted = {ratio:.3}", Brown::NAMES[k]);
    }
    for k in 0..6 {
        let ratio = (pose_squares[k] / pose_predicted[k]).sqrt();
        assert!((ratio - 1.0).abs() < 0.2, "pose {k}: spread / predicted = {ratio:.3}");
    }
}

#[test]
fn fixed_parameters_stay_zero_and_certain() {
    let model = LensModel::RADIAL2;
    let calibration = calibrate(&paper_views(PAPER_NOISE_PX, 5), 1152, 648, model).unwrap();
    let interior = calibration.camera.lens.interior();
    let covariance = calibration.camera.covariance.unwrap();
    for k in [2, 7, 8, 9] {
        assert_eq!(interior[k], 0.0);
        assert_eq!(covariance.row(k).amax(), 0.0);
        assert_eq!(calibration.views[0].interior_pose_covariance.row(k).amax(), 0.0);
    }
    for k in [0, 1, 3, 4, 5, 6] {
        assert!(calibration.std[k] > 0.0 && (calibration.correlation[(k, k)] - 1.0).abs() < 1e-12);
    }
}

#[test]
fn squares_that_look_larger_than_declared_are_measured_and_do_not_bend_the_camera() {
    let excess = 0.0002;
    let mut views = paper_views(PAPER_NOISE_PX, 9);
    for o in views.iter_mut().flat_map(|view| &mut view.observations) {
        // Points were drawn as declared: declare them smaller instead.
        o.board.x_m -= o.growth.x_m * excess;
        o.board.y_m -= o.growth.y_m * excess;
    }
    let with_side = LensModel::PAPER.with_side(true);
    let calibration = calibrate(&views, 1152, 648, with_side).unwrap();
    let (found, std) = calibration.side_excess_m.unwrap();
    assert!((found - excess).abs() < 4.0 * std && std < 0.1 * excess, "{found} ± {std} m");
    assert!((calibration.j_per_point - 0.0943).abs() < 0.0105, "{}", calibration.j_per_point);
    let truth = paper_camera().interior();
    for (k, value) in calibration.camera.lens.interior().into_iter().enumerate().take(10) {
        assert!((value - truth[k]).abs() < 4.0 * calibration.std[k], "{}", Brown::NAMES[k]);
    }
    // Taken as declared, the squares leave their excess in the residuals.
    let without = calibrate(&views, 1152, 648, LensModel::PAPER).unwrap();
    assert!(without.j_per_point > 1.5 * calibration.j_per_point && without.side_excess_m.is_none());
}

#[test]
fn degenerate_sets_are_refused_with_words() {
    let say = |views: &[ViewPoints]| calibrate(views, 1152, 648, LensModel::PAPER).unwrap_err().to_string();
    let views = paper_views(PAPER_NOISE_PX, 7);
    assert!(say(&views[..2]).contains("at least 3"));
    let twice = [views[0].clone(), views[0].clone(), views[1].clone()];
    assert!(say(&twice).contains("only 2 different"), "{}", say(&twice));
    let target = SquaresTarget::paper();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let parallel: Vec<ViewPoints> = [0.0, 30.0, 60.0, 90.0]
        .into_iter()
        .map(|in_plane| {
            let pose = pose(&target, 0.35, (0.001 * in_plane, 0.0), (0.0, 0.0, in_plane));
            let observations = observe(&paper_camera(), &pose, &target, 0.1, &mut random);
            ViewPoints { name: format!("{in_plane}°"), observations }
        })
        .collect();
    assert!(say(&parallel).contains("tilt the target"), "{}", say(&parallel));
    let mut broken = views.clone();
    broken[1].observations[3].pixel.row = f64::NAN;
    assert!(say(&broken).contains("view 2"));
    broken[1].observations.truncate(3);
    assert!(say(&broken).contains("3 points"));
}

#[test]
fn support_says_how_far_out_the_lens_was_seen() {
    let calibration = calibrate(&paper_views(0.0, 0), 1152, 648, LensModel::PAPER).unwrap();
    let support = calibration.support;
    assert!((0.3..0.8).contains(&support.max_ideal_radius), "{support:?}");
    assert!(support.supported_share < 0.9 && support.covered_cells > 0.3, "{support:?}");
    // 0.76 % of the paper's frame has no inverse.
    assert!((0.003..0.02).contains(&support.folded_share), "{support:?}");
}

#[test]
fn a_wide_rational_lens_and_a_fisheye_beyond_ninety_degrees_come_back() {
    let rational =
        Rational::new([520.0, 523.0, 0.0, 570.0, 330.0, 0.4, 0.1, 5e-4, -4e-4, 0.01, 0.7, 0.2, 0.03])
            .unwrap();
    let fisheye = Fisheye::new([250.0, 251.0, 0.0, 570.0, 330.0, 0.03, -0.008, 0.003, -6e-4]).unwrap();
    let cases = [(Lens::from(rational), LensModel::RATIONAL), (Lens::from(fisheye), LensModel::FISHEYE)];
    for (lens, model) in cases {
        let exact = calibrate(&around(&Scene::new(lens, 0.0), 16, 4), 1152, 648, model).unwrap();
        assert!(exact.rms_px < 1e-6, "{}", exact.rms_px);
        let noisy = calibrate(&around(&Scene::new(lens, 0.1), 16, 4), 1152, 648, model).unwrap();
        for (k, name) in lens.names().iter().enumerate().filter(|&(k, _)| model.free[k]) {
            let z = (noisy.camera.lens.interior()[k] - lens.interior()[k]) / noisy.std[k];
            assert!(z.abs() < 4.0, "{name} is {z:.1} standard deviations off");
        }
    }
}

#[test]
fn a_fixed_aspect_and_a_fixed_principal_point_are_obeyed() {
    let lens = Brown::new([750.0, 600.0, 0.0, 575.5, 323.5, -0.2, 0.05, 0.0, 0.0, 0.0]).unwrap();
    let views = around(&Scene::new(lens, 0.1), 8, 2);
    let model = LensModel::RADIAL2.with_aspect(1.25).with_principal_point(false);
    let calibration = calibrate(&views, 1152, 648, model).unwrap();
    let [fx, fy, _, cx, cy, ..] = calibration.camera.lens.interior();
    assert!((fx - 1.25 * fy).abs() < 1e-9 && (cx, cy) == (575.5, 323.5));
    assert!((fy - 600.0).abs() < 4.0 * calibration.std[1]);
    assert!((calibration.std[0] / calibration.std[1] - 1.25).abs() < 1e-9);
    assert!((calibration.correlation[(0, 1)] - 1.0).abs() < 1e-9 && calibration.std[3] == 0.0);
}

#[test]
fn weighing_outliers_down_leaves_a_clean_set_as_it_is_and_mends_a_bad_one() {
    let weighed = Options { model: LensModel::BROWN, outliers: OutlierPolicy::WeighDown };
    let scene =
        Scene::new(Brown::new([744.0, 749.0, 0.0, 566.4, 335.5, -0.2, 0.06, 1e-3, 0.0, 0.0]).unwrap(), 0.1);
    let clean = around(&scene, 10, 5);
    let plain = calibrate(&clean, 1152, 648, LensModel::BROWN).unwrap();
    assert_eq!(calibrate_with(&clean, 1152, 648, weighed).unwrap(), plain);
    assert!(plain.outliers.is_empty() && plain.suspects.is_empty());
    let mut bad = clean;
    for (k, view) in bad.iter_mut().enumerate() {
        let count = view.observations.len();
        view.observations[(7 * k) % count].pixel.column += 15.0 + k as f64;
        view.observations[(11 * k + 5) % count].pixel.row -= 4.0;
    }
    let pulled = calibrate(&bad, 1152, 648, LensModel::BROWN).unwrap();
    let mended = calibrate_with(&bad, 1152, 648, weighed).unwrap();
    let worst = |c: &Calibration| {
        let free = |k: &usize| LensModel::BROWN.free[*k];
        (0..10)
            .filter(free)
            .map(|k| ((c.camera.lens.interior()[k] - scene.lens.interior()[k]) / plain.std[k]).abs())
            .fold(0.0, f64::max)
    };
    assert!(worst(&pulled) > 6.0 && worst(&mended) < 4.0, "{} {}", worst(&pulled), worst(&mended));
    // Named, with the weight they had.
    assert_eq!(mended.outliers.len(), 20, "{:?}", mended.outliers);
    let first = mended.outliers[0];
    assert!(first.distance_px > 20.0 && mended.views[first.view].points[first.point].weight == 0.0);
    assert!((mended.sigma0_px / 0.1 - 1.0).abs() < 0.1, "{}", mended.sigma0_px);
}

#[test]
fn a_view_that_fits_badly_is_named() {
    let mut views = paper_views(0.1, 4);
    views.extend(
        paper_views(0.1, 5).into_iter().map(|v| ViewPoints { name: format!("again {}", v.name), ..v }),
    );
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let pose = pose(&SquaresTarget::paper(), 0.4, (0.01, 0.0), (-20.0, -25.0, 30.0));
    let observations = observe(&paper_camera(), &pose, &SquaresTarget::paper(), 0.6, &mut random);
    views.push(ViewPoints { name: "blurred".to_owned(), observations });
    let calibration = calibrate(&views, 1152, 648, LensModel::PAPER).unwrap();
    let names: Vec<&str> = calibration.suspects.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["blurred"]);
}

#[test]
fn a_bent_board_and_an_uneven_print_are_measured() {
    let lens = Brown::new([744.0, 749.0, 0.0, 566.4, 335.5, -0.2, 0.06, 1e-3, -1e-3, 0.0]).unwrap();
    let flat = calibrate(&around(&Scene::new(lens, 0.1), 12, 7), 1152, 648, LensModel::BROWN).unwrap();
    assert!(!flat.board.bend.unwrap().is_significant(), "{:?}", flat.board);
    assert!(!flat.board.pitch_excess.unwrap().is_significant());
    let bent = Scene { sag_m: [0.0006, -0.0002], ..Scene::new(lens, 0.1) };
    let views = around(&bent, 12, 7);
    let seen = calibrate(&views, 1152, 648, LensModel::BROWN).unwrap();
    assert!(seen.board.bend.unwrap().is_significant());
    let joint = calibrate(&views, 1152, 648, LensModel::BROWN.with_bend(true)).unwrap();
    let bend = joint.board.bend.unwrap();
    for (found, truth) in [(bend.along_x_m, 0.0006), (bend.along_y_m, -0.0002)] {
        assert!((found.value - truth).abs() < 4.0 * found.std && found.std < 5e-5, "{found:?}");
    }
    assert!(bend.is_significant() && (bend.depth_m() - 0.0008).abs() < 1e-4);
    // Taken as flat, the board bends the camera.
    assert!(joint.sigma0_px < 0.105 && seen.sigma0_px > 1.1 * joint.sigma0_px);
    let uneven = Scene { pitch_ratio: 1.004, ..Scene::new(lens, 0.1) };
    let seen = calibrate(&around(&uneven, 12, 7), 1152, 648, LensModel::BROWN).unwrap();
    let pitch = seen.board.pitch_excess.unwrap();
    assert!(pitch.is_significant() && (pitch.value - 0.004).abs() < 4.0 * pitch.std, "{pitch:?}");
}

#[test]
fn copies_of_one_photo_are_no_set() {
    let view = paper_views(0.1, 1).remove(0);
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let target = SquaresTarget::paper();
    let tripod: Vec<ViewPoints> = (0..6)
        .map(|k| ViewPoints {
            name: format!("photo {k}"),
            observations: observe(&paper_camera(), &paper_poses()[0], &target, 0.1, &mut random),
        })
        .collect();
    for views in [vec![view; 5], tripod] {
        let error = calibrate(&views, 1152, 648, LensModel::PAPER).unwrap_err();
        assert!(
            matches!(error, CalibrationError::Start(StartError::Repeated { different: 1, .. })),
            "{error}"
        );
        assert!(error.help().contains("between photos"));
    }
}

#[test]
fn photos_of_two_cameras_are_told_apart() {
    let lens = |focal: f64| Brown::new([focal, focal, 0.0, 566.4, 335.5, -0.1, 0.02, 0.0, 0.0, 0.0]).unwrap();
    let mut views = around(&Scene::new(lens(700.0), 0.1), 6, 3);
    for (k, view) in around(&Scene::new(lens(800.0), 0.1), 6, 8).into_iter().enumerate() {
        views.push(ViewPoints { name: format!("zoomed {}", k + 1), ..view });
    }
    let error = calibrate(&views, 1152, 648, LensModel::BROWN).unwrap_err();
    let CalibrationError::MixedCameras { longer, shorter, .. } = &error else { panic!("{error}") };
    assert!(longer.starts_with("zoomed 1") && shorter.starts_with("view 1"), "{error}");
}

#[test]
fn a_lens_that_the_model_cannot_follow_is_not_taken_for_two_cameras() {
    let lens = Brown::new([744.0, 749.0, 0.0, 566.4, 335.5, -0.3, 0.1, 4e-3, -3e-3, -0.02]).unwrap();
    let views = around(&Scene::new(lens, 0.1), 12, 3);
    let pinhole = LensModel::of(LensKind::Brown, &[]);
    let calibration = calibrate(&views, 1152, 648, pinhole).unwrap();
    assert!(calibration.rms_px > 1.0, "{}", calibration.rms_px);
}

#[test]
fn a_target_in_one_corner_and_a_target_hardly_tilted_are_refused() {
    let mut scene = Scene::new(paper_camera(), 0.1);
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let turns = [(0.5, 0.0), (-0.5, 0.2), (0.1, 0.5), (0.0, -0.5)];
    let mut set = |scene: &Scene, middle: Vector3<f64>, tilt: f64| -> Vec<ViewPoints> {
        let poses = turns.map(|(x, y)| scene.pose(middle, Vector3::new(tilt * x, tilt * y, 0.1)));
        poses.iter().enumerate().map(|(k, pose)| scene.view(&format!("{k}"), pose, &mut random)).collect()
    };
    let views = set(&scene, Vector3::new(-0.9, -0.4, 2.0), 1.0);
    let corner = calibrate(&views, 1152, 648, LensModel::RADIAL2).map(|c| c.std).unwrap_err();
    assert!(matches!(corner, CalibrationError::SmallPart { .. }), "{corner}");
    assert!(corner.help().contains("all parts of the frame"));
    scene.noise_px = 0.5;
    let views = set(&scene, Vector3::new(0.0, 0.0, 0.8), 0.15);
    let flat = calibrate(&views, 1152, 648, LensModel::RADIAL2).map(|c| c.std).unwrap_err();
    assert!(matches!(flat, CalibrationError::WeakFocalLength { .. }), "{flat}");
    assert!(flat.help().contains("from nearer and tilted"));
}
