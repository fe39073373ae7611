//! Synthetic surveys with known truth: farmland, runway and targets photographed by a known camera on a known
//! flight, and the log a unit of stated accuracy would have kept.
//!
//! The geometry here (ellipsoid, rotations, lens and its inverse, ray and terrain) is written anew and imports
//! nothing from the rest of the crate: an error in the code under test cannot cancel itself. Frames and angle
//! senses are nevertheless those of [`crate::conventions`].
//!
//! Everything is decided by the scenario and its seed: the same bytes come out at any number of threads. This
//! module reads and writes no files; `stages::simulate` does.

#![expect(
    clippy::disallowed_methods,
    reason = "plain degrees and radians here: the crate's own units belong to the code under test"
)]

mod earth;
mod exposure;
mod flight;
mod ground;
mod lens;
mod noise;
mod scenario;
mod scene;
mod target_sheet;

use image::{GrayImage, RgbImage};
use nalgebra::{Vector2, Vector3};
use rand::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

pub use earth::GeodeticPosition;
pub use flight::{Attitude, LogRow, TrueFrame};
pub use scenario::{
    Adahrs, CalibrationPhotos, Camera, Flight, Mounting, Photo, Relief, ReliefShape, Runway, Scenario, Scene,
    Site, Targets,
};
pub use target_sheet::TargetCorner;

use exposure::Light;
use flight::Flown;
use ground::{Ground, ScenePoint};
use lens::Lens;
use scene::{Painting, Rgb};
use target_sheet::View;

/// Random streams of the scenario's seed; photos take one stream per row from their base on.
mod stream {
    pub const RELIEF: u64 = 1;
    pub const WANDER: u64 = 2;
    pub const ADAHRS: u64 = 3;
    pub const GAIN: u64 = 4;
    pub const VIEWS: u64 = 1 << 20;
    pub const FRAMES: u64 = 1 << 40;
    pub const SHEETS: u64 = 1 << 60;
    /// Streams set aside for one photo.
    pub const PER_PHOTO: u64 = 1 << 20;
}

/// Samples over a pixel that a hard edge passes through: a Fibonacci number and the one before it, so that the samples
/// form a lattice on which no two share a row or a column. A square grid of as many would misplace edges along the
/// pixel axes by up to a twelfth of a pixel, this one by a hundredth.
const EDGE_SAMPLES: [u32; 2] = [55, 34];
const SHEET_SAMPLES: [u32; 2] = [89, 55];
/// What a ray that misses the ground sees.
const SKY: [f32; 3] = [0.72, 0.80, 0.90];
/// Observations keep this far from the frame's edge, pixels.
const OBSERVATION_MARGIN_PX: f64 = 12.0;

/// What is wrong with a scenario.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SyntheticError {
    /// A value outside its limits, or not a number.
    #[error("{key} is {value}, allowed is {low} to {high}")]
    Value { key: &'static str, value: f64, low: f64, high: f64 },
    /// Two keys that exclude each other.
    #[error("{first} and {second} are both given; keep one of them")]
    Both { first: &'static str, second: &'static str },
}

/// A ground target with its true centre.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    pub name: String,
    /// Height is ellipsoidal, metres.
    pub centre: GeodeticPosition,
}

/// A point seen in a frame: its true pixel; (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    pub point: String,
    /// File name of the frame.
    pub frame: String,
    pub column: f64,
    pub row: f64,
}

/// The runway's outline on the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct RunwayOutline {
    /// In turn: end 1 left, end 2 left, end 2 right, end 1 right, seen along the runway's heading.
    pub corners: [GeodeticPosition; 4],
    /// Middle of end 1 and of end 2.
    pub ends: [GeodeticPosition; 2],
}

impl RunwayOutline {
    /// The same points with the names they have in observations and tables.
    pub fn points(&self) -> Vec<(String, GeodeticPosition)> {
        let ends = self.ends.iter().enumerate().map(|(index, at)| (format!("runway-end-{}", index + 1), *at));
        let corners =
            self.corners.iter().enumerate().map(|(index, at)| (format!("runway-corner-{}", index + 1), *at));
        ends.chain(corners).collect()
    }
}

/// A scenario worked out: true poses, log, targets, and a renderer for every photo.
pub struct Survey {
    scenario: Scenario,
    lens: Lens,
    ground: Ground,
    painting: Painting,
    flown: Flown,
    targets: Vec<Target>,
    gains: Vec<f64>,
    /// Ideal ray of every pixel, row by row; `None` where the lens has no inverse.
    rays: Vec<Option<Vector2<f64>>>,
}

impl Survey {
    /// Works out a scenario.
    ///
    /// # Errors
    /// Those of [`Scenario::validate`].
    pub fn new(scenario: &Scenario) -> Result<Self, SyntheticError> {
        scenario.validate()?;
        let lens = Lens::new(&scenario.camera);
        let Camera { width_px, height_px, .. } = scenario.camera;
        let rays = (0..height_px)
            .into_par_iter()
            .flat_map_iter(|row| {
                let lens = &lens;
                (0..width_px).map(move |column| lens.ideal_from_pixel(f64::from(column), f64::from(row)))
            })
            .collect();
        let ground = Ground::new(scenario);
        let painting = Painting::new(scenario);
        let flown = flight::fly(scenario, &ground);
        let targets = painting
            .marks()
            .iter()
            .map(|mark| Target { name: mark.name.clone(), centre: ground.geodetic(mark.centre) })
            .collect();
        let mut random = ChaCha8Rng::seed_from_u64(scenario.seed);
        random.set_stream(stream::GAIN);
        let gains = flown
            .frames
            .iter()
            .map(|_| (scenario.photo.gain_std * random.sample::<f64, _>(StandardNormal)).exp())
            .collect();
        Ok(Self { scenario: scenario.clone(), lens, ground, painting, flown, targets, gains, rays })
    }

    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Frames in order of exposure.
    pub fn frames(&self) -> &[TrueFrame] {
        &self.flown.frames
    }

    /// The unit's continuous log, from before the first exposure until after the last.
    pub fn track(&self) -> &[LogRow] {
        &self.flown.track
    }

    pub fn targets(&self) -> &[Target] {
        &self.targets
    }

    /// The runway, or `None` if the scene has none.
    pub fn runway(&self) -> Option<RunwayOutline> {
        let (corners, ends) = self.painting.runway_outline()?;
        Some(RunwayOutline {
            corners: corners.map(|at| self.ground.geodetic(at)),
            ends: ends.map(|at| self.ground.geodetic(at)),
        })
    }

    /// Ellipsoidal height of the ground, metres.
    pub fn ground_height(&self, latitude_deg: f64, longitude_deg: f64) -> f64 {
        self.ground.height_m(self.ground.scene_from_geodetic(latitude_deg, longitude_deg))
    }

    /// True colour of the ground in [0, 1], averaged over a footprint of about `gsd_m` metres; hard edges of runway
    /// and targets are not averaged.
    pub fn ground_colour(&self, latitude_deg: f64, longitude_deg: f64, gsd_m: f64) -> [f64; 3] {
        let at = self.ground.scene_from_geodetic(latitude_deg, longitude_deg);
        self.painting.colour(at, self.ground.slope(at), gsd_m).into()
    }

    /// Pixels of every frame in which the lens has no inverse; they are rendered grey.
    pub fn blind_pixels(&self) -> usize {
        self.rays.iter().filter(|ray| ray.is_none()).count()
    }

    /// Where a frame sees a ground point: column and row; `None` behind the camera, outside the frame or where the
    /// lens has folded back.
    pub fn pixel_from_ground(&self, frame: &TrueFrame, point: &GeodeticPosition) -> Option<[f64; 2]> {
        let in_camera = frame.ecef_from_camera.transpose() * (point.ecef() - frame.camera_in_ecef);
        let ideal = in_camera.xy() / in_camera.z;
        let camera = &self.scenario.camera;
        if in_camera.z <= 0.0 || !self.lens.is_single_valued(ideal) {
            return None;
        }
        let pixel = self.lens.pixel_from_ideal(ideal);
        let inside = (-0.5..f64::from(camera.width_px) - 0.5).contains(&pixel.x)
            && (-0.5..f64::from(camera.height_px) - 0.5).contains(&pixel.y);
        inside.then_some([pixel.x, pixel.y])
    }

    /// The ground point a frame's pixel sees; `None` where the lens has no inverse or the ray misses the ground.
    pub fn ground_from_pixel(&self, frame: &TrueFrame, column: f64, row: f64) -> Option<GeodeticPosition> {
        let point = self.ground_hit(frame, self.lens.ideal_from_pixel(column, row)?)?;
        Some(GeodeticPosition::from_ecef(&point.0))
    }

    /// Every target in every frame that shows it well inside its edges and in front of any hill.
    pub fn observations(&self) -> Vec<Observation> {
        let points: Vec<_> = self.targets.iter().map(|target| (target.name.clone(), target.centre)).collect();
        self.observe(&points)
    }

    /// The same for the runway's ends (`runway-end-1`, `-2`) and corners (`runway-corner-1` to `-4`).
    pub fn runway_observations(&self) -> Vec<Observation> {
        self.runway().map(|runway| self.observe(&runway.points())).unwrap_or_default()
    }

    fn observe(&self, points: &[(String, GeodeticPosition)]) -> Vec<Observation> {
        let camera = &self.scenario.camera;
        let margin = OBSERVATION_MARGIN_PX;
        let mut observations = Vec::new();
        for (name, point) in points {
            for frame in self.frames() {
                let Some([column, row]) = self.pixel_from_ground(frame, point) else { continue };
                let inside = (margin..f64::from(camera.width_px) - 1.0 - margin).contains(&column)
                    && (margin..f64::from(camera.height_px) - 1.0 - margin).contains(&row);
                let in_sight = self
                    .ground_from_pixel(frame, column, row)
                    .is_some_and(|seen| (seen.ecef() - point.ecef()).norm() < 1e-3);
                if inside && in_sight {
                    observations.push(Observation {
                        point: name.clone(),
                        frame: frame.name.clone(),
                        column,
                        row,
                    });
                }
            }
        }
        observations
    }

    /// First ground point (ECEF, metres) on an ideal ray, and the ray's length.
    fn ground_hit(&self, frame: &TrueFrame, ideal: Vector2<f64>) -> Option<(Vector3<f64>, f64)> {
        let ray = (frame.ecef_from_camera * Vector3::new(ideal.x, ideal.y, 1.0)).normalize();
        let distance = self.ground.distance_along(&frame.camera_in_ecef, &ray)?;
        Some((frame.camera_in_ecef + ray * distance, distance))
    }

    /// Renders one frame as its camera file would hold it, before compression.
    ///
    /// # Panics
    /// If `index` is not below the number of frames.
    pub fn render_frame(&self, index: usize) -> RgbImage {
        let frame = &self.flown.frames[index];
        let Camera { width_px, height_px, .. } = self.scenario.camera;
        let (width, photo) = (width_px as usize, &self.scenario.photo);
        let middle = Vector2::new(f64::from(width_px) - 1.0, f64::from(height_px) - 1.0) * 0.5;
        let pixels = self
            .rays
            .par_chunks(width)
            .enumerate()
            .flat_map_iter(|(row, rays)| {
                rays.iter().enumerate().map(move |(column, ray)| {
                    let at = Vector2::new(column as f64, row as f64);
                    let dimming = photo.vignetting * (at - middle).norm_squared() / middle.norm_squared();
                    let gain = (self.gains[index] * (1.0 - dimming)) as f32;
                    ray.map(|ray| self.pixel_light(frame, at, ray).map(|channel| channel * gain))
                })
            })
            .collect();
        let mut light = Light { width, pixels };
        light.blur(photo.blur_px);
        let stream = stream::FRAMES + stream::PER_PHOTO * index as u64;
        let bytes = light.expose(photo.noise_std, self.scenario.seed, stream);
        image_from_bytes(width_px, height_px, &bytes)
    }

    fn pixel_light(&self, frame: &TrueFrame, pixel: Vector2<f64>, ideal: Vector2<f64>) -> [f32; 3] {
        let camera = &self.scenario.camera;
        let Some((point, distance)) = self.ground_hit(frame, ideal) else { return SKY };
        let at = self.ground.scene_from_ecef(&point);
        let slope = self.ground.slope(at);
        let footprint = distance / camera.fx_px.min(camera.fy_px);
        let colour = if self.painting.has_edge(at, footprint) {
            self.edge_colour(frame, pixel, footprint)
        } else {
            None
        };
        let colour = colour.unwrap_or_else(|| self.painting.colour(at, slope, footprint));
        [colour.x as f32, colour.y as f32, colour.z as f32]
    }

    /// Mean colour over a pixel, from samples between its four corners on the ground; `None` at the lens's fold.
    fn edge_colour(&self, frame: &TrueFrame, pixel: Vector2<f64>, footprint: f64) -> Option<Rgb> {
        let corner = |dx: f64, dy: f64| {
            let ideal = self.lens.ideal_from_pixel(pixel.x + dx, pixel.y + dy)?;
            let at = self.ground.scene_from_ecef(&self.ground_hit(frame, ideal)?.0);
            Some(Vector2::new(at.east, at.north))
        };
        let corners = [corner(-0.5, -0.5)?, corner(0.5, -0.5)?, corner(-0.5, 0.5)?, corner(0.5, 0.5)?];
        Some(mean_over_pixel(EDGE_SAMPLES, &corners, |at| {
            let at = ScenePoint { east: at.x, north: at.y };
            self.painting.colour(at, self.ground.slope(at), footprint)
        }))
    }

    /// True pixels of the target's corners in a calibration photo.
    pub fn target_corners(&self, index: u32) -> Vec<TargetCorner> {
        View::new(&self.scenario, &self.lens, index).corners(&self.lens)
    }

    /// Renders one photo of the calibration target.
    pub fn render_target_photo(&self, index: u32) -> GrayImage {
        let (camera, photos) = (&self.scenario.camera, &self.scenario.calibration);
        let view = View::new(&self.scenario, &self.lens, index);
        let width = camera.width_px as usize;
        let pixels = self
            .rays
            .par_chunks(width)
            .enumerate()
            .flat_map_iter(|(row, rays)| {
                let view = &view;
                rays.iter().enumerate().map(move |(column, ray)| {
                    ray.map(|ray| [sheet_light(view, &self.lens, column as f64, row as f64, ray) as f32])
                })
            })
            .collect();
        let mut light = Light { width, pixels };
        light.blur(photos.blur_px);
        let stream = stream::SHEETS + stream::PER_PHOTO * u64::from(index);
        let bytes = light.expose(photos.noise_std, self.scenario.seed, stream);
        image_from_bytes(camera.width_px, camera.height_px, &bytes)
    }
}

fn sheet_light(view: &View, lens: &Lens, column: f64, row: f64, ideal: Vector2<f64>) -> f64 {
    const BEYOND: f64 = 0.4;
    let Some(at) = view.target_from_ideal(ideal) else { return BEYOND };
    let footprint = view.origin_in_camera_mm.z / lens.camera().fx_px.min(lens.camera().fy_px);
    if View::has_edge(at, 2.0 * footprint) {
        let corner = |dx: f64, dy: f64| view.target_from_ideal(lens.ideal_from_pixel(column + dx, row + dy)?);
        if let (Some(a), Some(b), Some(c), Some(d)) =
            (corner(-0.5, -0.5), corner(0.5, -0.5), corner(-0.5, 0.5), corner(0.5, 0.5))
        {
            return mean_over_pixel(SHEET_SAMPLES, &[a, b, c, d], |at| {
                Rgb::repeat(view.brightness(at, footprint))
            })
            .x;
        }
    }
    view.brightness(at, footprint)
}

/// Mean of lattice samples over the quadrilateral between four corners (upper left, upper right, lower left, lower
/// right).
fn mean_over_pixel(
    [count, step]: [u32; 2],
    corners: &[Vector2<f64>; 4],
    value: impl Fn(Vector2<f64>) -> Rgb,
) -> Rgb {
    let part = |index: u32| (f64::from(index % count) + 0.5) / f64::from(count);
    let mut sum = Rgb::zeros();
    for index in 0..count {
        let (x, y) = (part(index), part(index * step));
        let (left, right) = (corners[0].lerp(&corners[2], y), corners[1].lerp(&corners[3], y));
        sum += value(left.lerp(&right, x));
    }
    sum / f64::from(count)
}

fn image_from_bytes<P: image::Pixel<Subpixel = u8>>(
    width: u32,
    height: u32,
    bytes: &[u8],
) -> image::ImageBuffer<P, Vec<u8>> {
    let channels = usize::from(P::CHANNEL_COUNT);
    image::ImageBuffer::from_fn(width, height, |column, row| {
        let start = (row as usize * width as usize + column as usize) * channels;
        *P::from_slice(&bytes[start..start + channels])
    })
}

#[cfg(test)]
mod tests;
