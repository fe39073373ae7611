//! Predicted spreads against the spread of simulated recalibrations.

use super::super::rendered::{observe, pose};
use super::super::target::SquaresTarget;
use super::super::{LensModel, ViewPoints, calibrate};
use super::*;
use crate::camera::Brown;
use nalgebra::{DMatrix, SVector, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

const NOISE_PX: f64 = 0.1;
const RUNS: u64 = 500;
const SIZE: (u32, u32) = (1152, 648);

fn truth() -> Brown {
    Brown::new([743.8, 749.0, -0.77, 566.4, 345.5, -0.12, 0.08, 1e-3, -5e-4, -0.02]).unwrap()
}

/// Nine views over the frame, tilted to all sides.
fn views(noise_px: f64, seed: u64) -> Vec<ViewPoints> {
    let target = SquaresTarget::paper();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..9)
        .map(|k| {
            let (right, down) = (0.12 * f64::from(k % 3 - 1), 0.055 * f64::from(k / 3 - 1));
            let tilt = [(30.0, -15.0, 5.0), (-25.0, 20.0, -10.0), (10.0, 35.0, 80.0)][k as usize % 3];
            let pose = pose(&target, 0.36, (right, down), tilt);
            let observations = observe(&truth(), &pose, &target, noise_px, &mut random);
            ViewPoints { name: format!("view {k}"), observations }
        })
        .collect()
}

#[test]
fn predictions_are_the_spread_of_five_hundred_recalibrations() {
    let calibrated = |seed| calibrate(&views(NOISE_PX, seed), SIZE.0, SIZE.1, LensModel::PAPER).unwrap();
    let runs: Vec<Calibration> = (0..RUNS).into_par_iter().map(|run| calibrated(1 + run)).collect();
    let truth = Lens::from(truth());
    let spread = |of: &dyn Fn(&Calibration) -> f64, about: f64| {
        (runs.iter().map(|run| (of(run) - about).powi(2)).sum::<f64>() / RUNS as f64).sqrt()
    };
    let mean_square = |of: &dyn Fn(&Calibration) -> f64| {
        (runs.iter().map(|run| of(run).powi(2)).sum::<f64>() / RUNS as f64).sqrt()
    };
    // 500 draws know a standard deviation to 3 %; 10 % is three of those.
    for (k, name) in Brown::NAMES.iter().enumerate() {
        let ratio = spread(&|run| run.camera.lens.interior()[k], truth.interior()[k])
            / mean_square(&|run| run.std[k]);
        assert!((ratio - 1.0).abs() < 0.1, "{name}: spread / predicted = {ratio:.3}");
    }
    let (columns, rows) = (9, 7);
    let maps: Vec<UncertaintyMap> =
        runs.iter().map(|run| projection_uncertainty(run, columns, rows)).collect();
    let seen = seen_by(&runs, &truth, &maps[0]);
    let (middle, corner) = (columns * rows / 2, 0);
    for (place, node) in [("centre", middle), ("corner", corner), ("edge", columns / 2)] {
        for (what, covariance, predicted) in [
            ("fixed", seen.fixed[node], rms_over(&maps, node, |s| s.fixed_axes_px)),
            ("turned", seen.turned[node], rms_over(&maps, node, |s| s.px)),
        ] {
            let ratio = worst(&covariance) / predicted;
            assert!((ratio - 1.0).abs() < 0.1, "{place} {what}: spread / predicted = {ratio:.3}");
        }
    }
    // Far from the principal point the lens is known less well than at it.
    let px = |node: usize| maps[0].nodes[node].spread.unwrap().px;
    assert!(px(corner) > 2.0 * px(middle), "{} {}", px(corner), px(middle));
}

fn rms_over(maps: &[UncertaintyMap], node: usize, of: impl Fn(&ProjectionSpread) -> f64) -> f64 {
    let squares: f64 = maps.iter().map(|map| of(&map.nodes[node].spread.unwrap()).powi(2)).sum();
    (squares / maps.len() as f64).sqrt()
}

struct Seen {
    fixed: Vec<Matrix2<f64>>,
    turned: Vec<Matrix2<f64>>,
}

/// Covariance of the pixels in which the recalibrated cameras see the truth's directions, before and after
/// each camera's own best rotation; by least squares on differences, without the map's derivatives.
fn seen_by(runs: &[Calibration], truth: &Lens, map: &UncertaintyMap) -> Seen {
    let nodes = map.nodes.len();
    let directions: Vec<Vector3<f64>> =
        map.nodes.iter().map(|node| truth.direction_from_pixel(node.pixel).unwrap()).collect();
    let see = |lens: &Lens, turn: Vector3<f64>, node: usize| {
        let p = lens.pixel_from_point(&(directions[node] + turn.cross(&directions[node]))).unwrap();
        Vector2::new(p.column, p.row)
    };
    let mut seen = Seen { fixed: vec![Matrix2::zeros(); nodes], turned: vec![Matrix2::zeros(); nodes] };
    for run in runs {
        let lens = &run.camera.lens;
        let errors: Vec<Vector2<f64>> =
            (0..nodes).map(|n| see(lens, Vector3::zeros(), n) - see(truth, Vector3::zeros(), n)).collect();
        let supported: Vec<usize> = (0..nodes).filter(|n| map.nodes[*n].supported).collect();
        const STEP: f64 = 1e-6;
        let by_turn = DMatrix::from_fn(2 * supported.len(), 3, |row, axis| {
            let turn = Vector3::ith(axis, STEP);
            let node = supported[row / 2];
            (see(truth, turn, node) - see(truth, Vector3::zeros(), node))[row % 2] / STEP
        });
        let right = DMatrix::from_fn(2 * supported.len(), 1, |row, _| -errors[supported[row / 2]][row % 2]);
        let solved = by_turn.svd(true, true).solve(&right, 1e-12).unwrap();
        let turn = SVector::<f64, 3>::new(solved[0], solved[1], solved[2]);
        for (node, error) in errors.iter().enumerate() {
            seen.fixed[node] += error * error.transpose() / runs.len() as f64;
            let e = see(lens, turn, node) - see(truth, Vector3::zeros(), node);
            seen.turned[node] += e * e.transpose() / runs.len() as f64;
        }
    }
    seen
}

#[test]
fn the_ground_below_a_nadir_camera_is_known_to_the_pixels_share_of_it() {
    let calibration = calibrate(&views(NOISE_PX, 1), SIZE.0, SIZE.1, LensModel::PAPER).unwrap();
    let map = projection_uncertainty(&calibration, 9, 7);
    let centre = map.nearest(calibration.camera.image_centre()).unwrap();
    let spread = centre.spread.unwrap();
    // 100 m up, a pixel covers 100 / 746 m near the axis.
    let expected = spread.px * 100.0 / 746.0;
    assert!((spread.ground_m(100.0).unwrap() / expected - 1.0).abs() < 0.05);
    assert!(centre.supported && spread.px < spread.fixed_axes_px);
}

#[test]
fn what_no_photo_shows_is_not_supported() {
    let mut only_left = views(NOISE_PX, 1);
    for view in &mut only_left {
        view.observations.retain(|o| o.pixel.column < 600.0);
    }
    only_left.retain(|view| view.observations.len() > 40);
    let calibration = calibrate(&only_left, SIZE.0, SIZE.1, LensModel::RADIAL2).unwrap();
    let map = projection_uncertainty(&calibration, 13, 7);
    for node in &map.nodes {
        assert!(node.pixel.column < 600.0 || !node.supported, "{:?}", node.pixel);
    }
    assert!(map.unsupported_share() > 0.45 && map.unsupported_share() < 0.9);
}
