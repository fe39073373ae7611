//! The error map by drawing: what first-order propagation says, without its linearisation.
//!
//! Every draw links the whole chain of eq. (8) anew with its own errors and meets the ground again. Two
//! things are first order: the ground is replaced by its tangent plane at the undisturbed point (over a
//! 100 m error the Earth curves 0.8 mm away), and errors of the lens move a ray by its derivative.
//!
//! Draws come in chunks, each with its own stream of the generator, and every cell adds them up in their
//! order: the result is the same at any number of threads.

use super::error_map::PixelGrid;
use super::model::{ErrorModel, PARAMETERS, ParameterCovariance, Source};
use super::propagation::{FramePropagation, PropagationError, View};
use crate::camera::{InteriorCovariance, MAX_INTERIOR};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Displacement, Ned, Rotation};
use crate::georeference::{Chain, GeoreferencedFrame};
use crate::navigation::{GimbalAngles, GimbalReference};
use crate::units::Radians;
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Draws per stream of the generator; part of the definition of a seed's result.
const CHUNK: u32 = 1024;
/// Streams held in memory at once.
const CHUNKS_PER_BATCH: u32 = 16;
/// Histogram of the radial error: bins up to [`REACH`] first-order semi-major axes.
const BINS: usize = 4096;
const REACH: f64 = 10.0;

/// Seed and number of draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draws {
    /// Seed of the generator.
    pub seed: u64,
    /// How many.
    pub count: u32,
}

/// Statistics of one cell's ground errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellStatistics {
    /// Mean error north, metres.
    pub mean_north_m: f64,
    /// Mean error east, metres.
    pub mean_east_m: f64,
    /// Standard deviation north, metres.
    pub std_north_m: f64,
    /// Standard deviation east, metres.
    pub std_east_m: f64,
    /// Radius about the undisturbed point that holds half of the draws, metres; from a histogram whose
    /// bins are 1/400 of the first-order semi-major axis. `None` when it lies beyond ten of those axes.
    pub cep50_m: Option<f64>,
    /// The same for ninety percent.
    pub ce90_m: Option<f64>,
    /// Draws whose ray missed the ground (above the horizon); they count as infinitely far.
    pub misses: u32,
}

/// Statistics over a grid of pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct MonteCarloMap {
    /// Where.
    pub grid: PixelGrid,
    /// Seed and number of draws.
    pub draws: Draws,
    /// Row by row; `None` where the undisturbed pixel has no ground or the model moves nothing.
    pub cells: Vec<Option<CellStatistics>>,
}

/// Draws errors of the model for a frame and maps what they do to a grid of pixels.
///
/// Pass `model.only(&budget::ATTITUDE)` for the attitude-error map, the whole model for everything.
/// Picking errors, which every pixel has for itself, are drawn once for all cells: each cell's own
/// statistics are right, statistics between cells are not meant.
///
/// # Errors
/// As [`FramePropagation::new`].
pub fn monte_carlo(
    frame: &GeoreferencedFrame,
    model: &ErrorModel,
    grid: PixelGrid,
    draws: Draws,
) -> Result<MonteCarloMap, PropagationError> {
    let propagation = FramePropagation::new(frame, model)?;
    let drawer = Drawer::new(&propagation);
    let mut cells: Vec<Option<Cell>> = grid
        .pixels()
        .into_par_iter()
        .map(|pixel| {
            let ground = frame.ground_from_pixel(pixel).ok()?;
            let slope = propagation.slope(&ground.position).ok()?;
            let view = propagation.view(pixel, &ground, slope).ok()?;
            let semi_major_m = propagation.at(pixel).ok()?.ellipse.semi_major_m;
            (semi_major_m > 0.0).then(|| Cell::new(view, semi_major_m))
        })
        .collect();
    let chunks = draws.count.div_ceil(CHUNK);
    for first in (0..chunks).step_by(CHUNKS_PER_BATCH as usize) {
        let batch: Vec<Vec<Drawn>> = (first..chunks.min(first + CHUNKS_PER_BATCH))
            .into_par_iter()
            .map(|chunk| drawer.draw(draws, chunk))
            .collect();
        cells.par_iter_mut().flatten().for_each(|cell| {
            for drawn in batch.iter().flatten() {
                cell.add(drawn);
            }
        });
    }
    Ok(MonteCarloMap {
        grid,
        draws,
        cells: cells.into_iter().map(|cell| cell.map(|cell| cell.statistics(draws.count))).collect(),
    })
}

/// One realisation of all errors.
struct Drawn {
    ned_from_camera: Matrix3<f64>,
    camera_in_ned: Vector3<f64>,
    ground_height_m: f64,
    interior: SVector<f64, MAX_INTERIOR>,
    picking: Vector2<f64>,
}

/// Turns a generator's numbers into realisations.
struct Drawer<'a> {
    frame: &'a GeoreferencedFrame,
    parameters: &'a ParameterCovariance,
    /// A square root of the interior parameters' covariance.
    interior_root: Option<InteriorCovariance>,
    velocity: [Vector3<f64>; 2],
}

impl<'a> Drawer<'a> {
    fn new(propagation: &'a FramePropagation<'_>) -> Self {
        let parameters = propagation.parameters();
        // Eigenvalues rather than Cholesky: fixed parameters have zero variance.
        let interior_root = parameters.interior.map(|covariance| {
            let eigen = covariance.symmetric_eigen();
            let roots = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
            eigen.eigenvectors * SMatrix::from_diagonal(&roots)
        });
        Self { frame: propagation.frame(), parameters, interior_root, velocity: *propagation.velocity() }
    }

    fn draw(&self, draws: Draws, chunk: u32) -> Vec<Drawn> {
        let mut generator = ChaCha8Rng::seed_from_u64(draws.seed);
        generator.set_stream(u64::from(chunk));
        let count = CHUNK.min(draws.count - chunk * CHUNK);
        (0..count)
            .map(|_| {
                let mut errors = [0.0; PARAMETERS];
                for (error, std) in errors.iter_mut().zip(&self.parameters.std) {
                    if *std > 0.0 {
                        let normal: f64 = StandardNormal.sample(&mut generator);
                        *error = std * normal;
                    }
                }
                let interior = self.interior_root.map_or_else(SVector::zeros, |root| {
                    root * SVector::<f64, MAX_INTERIOR>::from_fn(|_, _| StandardNormal.sample(&mut generator))
                });
                self.realise(&errors, interior)
            })
            .collect()
    }

    fn realise(&self, errors: &[f64; PARAMETERS], interior: SVector<f64, MAX_INTERIOR>) -> Drawn {
        let of = |source: Source| &errors[source.parameters()];
        let turned = |angle: Radians, by: f64| Radians::new(angle.get() + by);
        let mut record = self.frame.record.clone();
        let mut mount = self.frame.mount;
        record.attitude = YawPitchRoll::new(
            turned(record.attitude.yaw, of(Source::Yaw)[0]),
            turned(record.attitude.pitch, of(Source::Pitch)[0]),
            turned(record.attitude.roll, of(Source::Roll)[0]),
        );
        let angles = record.gimbal.unwrap_or(mount.gimbal);
        let gimbal = of(Source::Gimbal);
        record.gimbal = Some(match mount.gimbal_reference {
            GimbalReference::Body => GimbalAngles {
                pan: turned(angles.pan, gimbal[0]),
                elevation: turned(angles.elevation, gimbal[1]),
                roll: turned(angles.roll, gimbal[2]),
            },
            GimbalReference::Nav if gimbal.iter().all(|g| *g == 0.0) => angles,
            GimbalReference::Nav => {
                let (s, c) = angles.pan.get().sin_cos();
                let turn = Vector3::z() * gimbal[0]
                    + Vector3::new(-s, c, 0.0) * gimbal[1]
                    + Vector3::new(c, s, 0.0) * gimbal[2];
                let head =
                    Rotation::<Ned, Ned>::from_rotation(Rotation3::new(turn)) * angles.rotation::<Ned>();
                let turned = YawPitchRoll::of(&head);
                GimbalAngles { pan: turned.yaw, elevation: turned.pitch, roll: turned.roll }
            }
        });
        let boresight = of(Source::Boresight);
        mount.boresight = YawPitchRoll::new(
            turned(mount.boresight.yaw, boresight[0]),
            turned(mount.boresight.pitch, boresight[1]),
            turned(mount.boresight.roll, boresight[2]),
        );
        let arm = of(Source::LeverArm);
        mount.gimbal_in_body = mount.gimbal_in_body + Displacement::new(arm[0], arm[1], arm[2]);
        let position = of(Source::Position);
        let time = of(Source::Time);
        let antenna = Vector3::new(position[0], position[1], -of(Source::Height)[0])
            + self.velocity[0] * time[0]
            + self.velocity[1] * time[1];
        let pose = Chain::new(&record, &mount).ned_from_camera();
        Drawn {
            ned_from_camera: pose.rotation.matrix(),
            camera_in_ned: pose.origin.vector() + antenna,
            ground_height_m: of(Source::GroundHeight)[0],
            interior,
            picking: Vector2::new(of(Source::Picking)[0], of(Source::Picking)[1]),
        }
    }
}

/// One pixel and the sums of its errors.
struct Cell {
    view: View,
    bins_per_metre: f64,
    histogram: Vec<u32>,
    misses: u32,
    sum: Vector2<f64>,
    sum_of_squares: Vector2<f64>,
}

impl Cell {
    fn new(view: View, semi_major_m: f64) -> Self {
        Self {
            view,
            bins_per_metre: BINS as f64 / (REACH * semi_major_m),
            // One more for what lies beyond.
            histogram: vec![0; BINS + 1],
            misses: 0,
            sum: Vector2::zeros(),
            sum_of_squares: Vector2::zeros(),
        }
    }

    fn add(&mut self, drawn: &Drawn) {
        let view = &self.view;
        let ray = view.ray + view.ray_by_interior * drawn.interior + view.ray_by_stored * drawn.picking;
        let direction = drawn.ned_from_camera * Vector3::new(ray.x, ray.y, 1.0);
        let camera_to_point = view.end - drawn.camera_in_ned;
        let range = (view.normal.dot(&camera_to_point) + drawn.ground_height_m) / view.normal.dot(&direction);
        if !(range > 0.0 && range.is_finite()) {
            self.misses += 1;
            return;
        }
        let moved = direction * range - camera_to_point;
        let error = Vector2::new(view.north.dot(&moved), view.east.dot(&moved));
        self.sum += error;
        self.sum_of_squares += error.component_mul(&error);
        // A float too large for the index saturates and lands in the last bin.
        let bin = (error.norm() * self.bins_per_metre) as usize;
        self.histogram[bin.min(BINS)] += 1;
    }

    fn statistics(&self, draws: u32) -> CellStatistics {
        let hits = f64::from(draws - self.misses);
        let mean = self.sum / hits;
        let std =
            (self.sum_of_squares / hits - mean.component_mul(&mean)).map(|variance| variance.max(0.0).sqrt());
        CellStatistics {
            mean_north_m: mean.x,
            mean_east_m: mean.y,
            std_north_m: std.x,
            std_east_m: std.y,
            cep50_m: self.radius_of(0.5, draws),
            ce90_m: self.radius_of(0.9, draws),
            misses: self.misses,
        }
    }

    /// Radius that holds a share of the draws, linear inside a bin.
    fn radius_of(&self, level: f64, draws: u32) -> Option<f64> {
        let wanted = level * f64::from(draws);
        let mut below = 0.0;
        for (bin, count) in self.histogram[..BINS].iter().enumerate() {
            let count = f64::from(*count);
            if below + count >= wanted && count > 0.0 {
                return Some((bin as f64 + (wanted - below) / count) / self.bins_per_metre);
            }
            below += count;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::budget::ATTITUDE;
    use super::super::error_map::{self, Angle};
    use super::super::model::AngleStd;
    use super::super::scenes;
    use super::*;
    use crate::navigation::Mount;

    fn paper_model() -> ErrorModel {
        ErrorModel {
            position_std_m: 2.548,
            height_std_m: 5.0,
            attitude_std: AngleStd {
                yaw: Radians::from_degrees(0.6).get(),
                pitch: Radians::from_degrees(0.2).get(),
                roll: Radians::from_degrees(0.2).get(),
            },
            ..ErrorModel::default()
        }
    }

    #[test]
    fn drawing_confirms_the_first_order() {
        let frame = scenes::flight();
        let grid = PixelGrid::over(&frame, 6, 4).unwrap();
        for model in [paper_model(), paper_model().only(&ATTITUDE)] {
            let draws = Draws { seed: 7, count: 200_000 };
            let map = monte_carlo(&frame, &model, grid, draws).unwrap();
            let propagation = FramePropagation::new(&frame, &model).unwrap();
            for (pixel, cell) in grid.pixels().into_iter().zip(&map.cells) {
                let cell = cell.unwrap();
                let at = propagation.at(pixel).unwrap();
                // The relative std of a sample quantile from 2e5 draws is 0.2 %: four of those.
                let close = |drawn: f64, first_order: f64| {
                    assert!(
                        (drawn / first_order - 1.0).abs() < 0.008,
                        "{pixel:?}: {drawn} drawn, {first_order} by first order"
                    );
                };
                close(cell.cep50_m.unwrap(), at.cep50_m().unwrap());
                close(cell.ce90_m.unwrap(), at.ce90_m().unwrap());
                close(cell.std_north_m, at.covariance[(0, 0)].sqrt());
                close(cell.std_east_m, at.covariance[(1, 1)].sqrt());
                assert_eq!(cell.misses, 0);
            }
        }
    }

    #[test]
    fn every_source_is_drawn() {
        let mut frame = scenes::flight();
        frame.record.velocity = Some(Displacement::new(20.0, -3.0, 0.0));
        let mut camera = scenes::paper_camera();
        let mut covariance = InteriorCovariance::zeros();
        covariance[(0, 0)] = 4.0;
        covariance[(3, 3)] = 9.0;
        covariance[(0, 3)] = 3.0;
        covariance[(3, 0)] = 3.0;
        camera.covariance = Some(covariance);
        frame.camera = std::sync::Arc::new(camera);
        let sources = [
            ErrorModel { height_std_m: 3.0, ..ErrorModel::default() },
            ErrorModel {
                gimbal_std: Some(AngleStd { yaw: 0.0, pitch: 1e-3, roll: 0.0 }),
                ..ErrorModel::default()
            },
            ErrorModel { boresight_std: AngleStd::equal(1e-3), ..ErrorModel::default() },
            ErrorModel { lever_arm_std_m: 0.3, ..ErrorModel::default() },
            ErrorModel { time_std_s: 0.05, ..ErrorModel::default() },
            ErrorModel { ground_height_std_m: 3.0, ..ErrorModel::default() },
            ErrorModel { interior: true, ..ErrorModel::default() },
            ErrorModel { picking_std_px: 1.0, ..ErrorModel::default() },
        ];
        let grid = PixelGrid::over(&frame, 2, 2).unwrap();
        // A head counted from the horizon has another pose, so the frame is linked anew.
        frame.mount.gimbal_reference = GimbalReference::Nav;
        let head = error_map::turned(&frame, Angle::Yaw, Radians::new(0.0)).unwrap();
        frame.mount.gimbal_reference = GimbalReference::Body;
        for frame in [frame, head] {
            for model in &sources {
                let draws = Draws { seed: 1, count: 20_000 };
                let map = monte_carlo(&frame, model, grid, draws).unwrap();
                let propagation = FramePropagation::new(&frame, model).unwrap();
                for (pixel, cell) in grid.pixels().into_iter().zip(&map.cells) {
                    let at = propagation.at(pixel).unwrap();
                    let drawn = cell.unwrap().std_north_m.powi(2) + cell.unwrap().std_east_m.powi(2);
                    let claimed = at.covariance.trace();
                    // Std of a variance from 2e4 draws: 1 %.
                    assert!((drawn / claimed - 1.0).abs() < 0.05, "{model:?}: {drawn} {claimed}");
                }
            }
        }
    }

    #[test]
    fn the_same_at_any_number_of_threads() {
        let frame = scenes::flight();
        let grid = PixelGrid::over(&frame, 5, 3).unwrap();
        let draws = Draws { seed: 3, count: 40_001 };
        let with = |threads: usize| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| monte_carlo(&frame, &paper_model(), grid, draws).unwrap())
        };
        let one = with(1);
        assert_eq!(one, with(2));
        let other = Draws { seed: 4, ..draws };
        assert_ne!(one.cells, monte_carlo(&frame, &paper_model(), grid, other).unwrap().cells);
    }

    #[test]
    fn rays_above_the_horizon_are_counted_not_averaged() {
        let mount = Mount { gimbal: scenes::gimbal(0.0, -12.0, 0.0), ..Mount::default() };
        let frame = scenes::frame(
            scenes::record(crate::geodesy::Geodetic::from_degrees(10.0, 20.0, 300.0), 0.0, 0.0, 0.0),
            &mount,
            scenes::paper_camera(),
            std::sync::Arc::new(crate::terrain::ConstantHeight { height_m: 200.0 }),
        );
        let model = ErrorModel {
            attitude_std: AngleStd::equal(Radians::from_degrees(5.0).get()),
            ..ErrorModel::default()
        };
        let grid = PixelGrid::over(&frame, 8, 36).unwrap();
        let draws = Draws { seed: 5, count: 4_000 };
        let map = monte_carlo(&frame, &model, grid, draws).unwrap();
        let top = map.cells.iter().flatten().next().unwrap();
        assert!(top.misses > 400, "{top:?}");
        assert_eq!(top.ce90_m, None);
        assert_eq!(map.cells.last().unwrap().unwrap().misses, 0);
        assert!(map.cells[0].is_none(), "above the horizon already");
    }
}
