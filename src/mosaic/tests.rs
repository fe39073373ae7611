//! The mosaic against its definition, evaluated pixel by pixel without lattice, plan or kernel.

use super::*;
use crate::camera::{Brown, Camera, ImagePoint};
use crate::geodesy::{Geodetic, MapPoint, MapProjection, ProjectionError, WGS84};
use crate::geometry::attitude::YawPitchRoll;
use crate::georeference::GeoreferencedFrame;
use crate::navigation::{Mount, NavigationRecord};
use crate::raster::{Image8, ImagePyramid, Kernel};
use crate::terrain::{ConstantHeight, NoGround, Terrain};
use crate::units::{Metres, Radians};
use std::collections::BTreeMap;
use std::sync::Arc;

const RADIUS_M: f64 = 6_371_000.0;
const LATITUDE: f64 = 45.0;
const LONGITUDE: f64 = 7.0;

/// Equidistant cylindrical about the site: simple, smooth, and with an exact inverse.
struct Cylinder;

impl MapProjection for Cylinder {
    fn map_from_geodetic(&self, positions: &[Geodetic]) -> Result<Vec<MapPoint>, ProjectionError> {
        Ok(positions
            .iter()
            .map(|g| MapPoint {
                easting: Radians::from_degrees(g.longitude.degrees() - LONGITUDE).get()
                    * RADIUS_M
                    * Radians::from_degrees(LATITUDE).get().cos(),
                northing: Radians::from_degrees(g.latitude.degrees() - LATITUDE).get() * RADIUS_M,
            })
            .collect())
    }
    fn geodetic_from_map(&self, positions: &[MapPoint]) -> Result<Vec<Geodetic>, ProjectionError> {
        Ok(positions
            .iter()
            .map(|p| Geodetic {
                latitude: Radians::new(Radians::from_degrees(LATITUDE).get() + p.northing / RADIUS_M),
                longitude: Radians::new(
                    Radians::from_degrees(LONGITUDE).get()
                        + p.easting / (RADIUS_M * Radians::from_degrees(LATITUDE).get().cos()),
                ),
                height: Metres::new(0.0),
            })
            .collect())
    }
}

/// Flat at 100 m with a step of 10 m up along a slanting line and a hole without data.
struct Step;

impl Terrain for Step {
    fn heights(&self, positions: &[Geodetic]) -> Vec<Result<f64, NoGround>> {
        let map = Cylinder.map_from_geodetic(positions).unwrap();
        map.iter()
            .map(|p| {
                if (p.easting + 15.0).hypot(p.northing - 8.0) < 4.0 {
                    return Err(NoGround::NoData);
                }
                let along = (p.easting - 0.3 * p.northing) / 2.0;
                Ok(100.0 + 10.0 * along.clamp(0.0, 1.0))
            })
            .collect()
    }
    fn height_range(&self) -> (f64, f64) {
        (100.0, 110.0)
    }
    fn spacing(&self) -> Option<f64> {
        Some(2.0)
    }
}

fn pinhole(width: u32, height: u32) -> Arc<Camera> {
    let (cx, cy) = (0.5 * (f64::from(width) - 1.0) + 1.3, 0.5 * (f64::from(height) - 1.0) - 0.8);
    let brown = Brown::new([200.0, 201.0, 0.1, cx, cy, -0.08, 0.02, 1e-3, -8e-4, 0.0]).unwrap();
    Arc::new(Camera::new(brown, width, height, None).unwrap())
}

fn flat() -> Arc<dyn Terrain> {
    Arc::new(ConstantHeight { height_m: 100.0 })
}

struct Pose {
    east_m: f64,
    north_m: f64,
    yaw: f64,
    pitch: f64,
    roll: f64,
}

const LEVEL: Pose = Pose { east_m: 0.0, north_m: 0.0, yaw: 0.0, pitch: 0.0, roll: 0.0 };
const TILTED: Pose = Pose { east_m: 3.0, north_m: -4.0, yaw: 57.0, pitch: 4.0, roll: -6.0 };

fn frame(name: &str, pose: &Pose, camera: &Arc<Camera>, ground: &Arc<dyn Terrain>) -> GeoreferencedFrame {
    let site = MapPoint { easting: pose.east_m, northing: pose.north_m };
    let record = NavigationRecord {
        line: 1,
        time: None,
        antenna: Cylinder.geodetic_from_map(&[site]).unwrap()[0].at_height(160.0),
        attitude: YawPitchRoll::from_degrees(pose.yaw, pose.pitch, pose.roll),
        gimbal: None,
        height_above_ground_m: None,
        ground_speed_m_s: None,
        velocity: None,
        pixel_rotation: None,
    };
    GeoreferencedFrame::new(
        name.to_owned(),
        record,
        &Mount::default(),
        Arc::clone(camera),
        Arc::clone(ground),
        400.0,
    )
    .unwrap()
}

fn settings(gsd_m: Option<f64>) -> PlanSettings {
    PlanSettings {
        gsd_m,
        bounds: None,
        metres_per_unit: 1.0,
        channels: 1,
        kernel: Kernel::Bilinear,
        blend: Blend::Feather,
    }
}

fn plan(frames: Vec<GeoreferencedFrame>, settings: &PlanSettings) -> MosaicPlan {
    MosaicPlan::new(frames, Arc::new(Cylinder), settings).unwrap()
}

/// Images held in memory.
struct Held(Vec<Arc<ImagePyramid>>);

impl FrameSource for Held {
    fn frame(&self, index: usize) -> Result<Arc<ImagePyramid>, FrameFailure> {
        Ok(Arc::clone(&self.0[index]))
    }
}

fn held(images: Vec<Image8>) -> Held {
    Held(images.into_iter().map(|i| Arc::new(ImagePyramid::new(i))).collect())
}

fn constant(frame: &GeoreferencedFrame, value: u8) -> Image8 {
    let (w, h) = frame.stored_size();
    Image8::new(w as usize, h as usize, 1, vec![value; (w * h) as usize]).unwrap()
}

/// What the ground looks like: waves of 12 m and 9 m.
fn paint(at: MapPoint) -> f64 {
    let turn = std::f64::consts::TAU;
    128.0 + 60.0 * (turn * at.easting / 12.0).sin() + 50.0 * (turn * at.northing / 9.0).cos()
}

/// The photo of the painted ground, through the forward chain.
fn photo(frame: &GeoreferencedFrame) -> Image8 {
    let (w, h) = frame.stored_size();
    let samples = (0..h)
        .flat_map(|r| (0..w).map(move |c| ImagePoint::new(f64::from(c), f64::from(r))))
        .map(|pixel| match frame.ground_from_pixel(pixel) {
            Ok(ground) => {
                let map = Cylinder.map_from_geodetic(&[ground.position]).unwrap()[0];
                paint(map).round() as u8
            }
            Err(_) => 0,
        })
        .collect();
    Image8::new(w as usize, h as usize, 1, samples).unwrap()
}

/// The whole mosaic as value and alpha, row by row.
struct Whole {
    values: Vec<u8>,
    alpha: Vec<u8>,
}

fn render(plan: &MosaicPlan, source: &dyn FrameSource) -> Whole {
    let mut whole =
        Whole { values: vec![0; plan.width * plan.height], alpha: vec![0; plan.width * plan.height] };
    render_all(
        plan,
        source,
        |tile| tile,
        |tile: TilePixels| {
            for row in 0..tile.window.height {
                let from = row * tile.window.width;
                let to = (tile.window.row + row) * plan.width + tile.window.column;
                let n = tile.window.width;
                whole.values[to..to + n].copy_from_slice(&tile.planes[0][from..from + n]);
                whole.alpha[to..to + n].copy_from_slice(&tile.alpha[from..from + n]);
            }
            Ok::<(), std::convert::Infallible>(())
        },
    )
    .unwrap();
    whole
}

/// The frame pixel that sees a mosaic pixel, by the chain itself.
fn exact(plan: &MosaicPlan, frame: usize, column: usize, row: usize) -> Option<ImagePoint> {
    let map = plan.grid.map_from_pixel(column as f64, row as f64);
    let position = Cylinder.geodetic_from_map(&[map]).unwrap()[0];
    let frame = &plan.frames[frame].frame;
    let height = frame.ground.heights(&[position])[0].ok()?;
    frame.pixel_from_ecef(&WGS84.ecef_from_geodetic(&position.at_height(height)))
}

/// Pixels whose transparency differs from the definition although they are not within 0.05 px of an edge
/// of the image; and the number of opaque pixels.
fn alpha_errors(plan: &MosaicPlan, whole: &Whole) -> (usize, usize) {
    let (mut wrong, mut opaque) = (0, 0);
    for row in 0..plan.height {
        for column in 0..plan.width {
            let seen = |by: f64| {
                (0..plan.frames.len()).any(|i| {
                    let (w, h) = plan.frames[i].frame.stored_size();
                    exact(plan, i, column, row).is_some_and(|p| {
                        p.column >= -0.5 - by
                            && p.row >= -0.5 - by
                            && p.column <= f64::from(w) - 0.5 + by
                            && p.row <= f64::from(h) - 0.5 + by
                    })
                })
            };
            let is = whole.alpha[row * plan.width + column];
            assert!(is == 0 || is == 255);
            opaque += usize::from(is == 255);
            wrong += usize::from(if is == 255 { !seen(0.05) } else { seen(-0.05) });
        }
    }
    (wrong, opaque)
}

#[test]
fn values_lie_where_the_ground_is() {
    let camera = pinhole(240, 160);
    let frames = || vec![frame("a", &LEVEL, &camera, &flat()), frame("b", &TILTED, &camera, &flat())];
    let source = held(frames().iter().map(photo).collect());
    // Nearest is off by up to half a photo pixel, at slopes of up to 10 grey values per pixel.
    for (kernel, blend, limit_rms) in [
        (Kernel::Bilinear, Blend::Feather, 0.7),
        (Kernel::Bilinear, Blend::None, 0.7),
        (Kernel::Cubic, Blend::Feather, 0.5),
        (Kernel::Nearest, Blend::Feather, 4.0),
    ] {
        let plan = plan(frames(), &PlanSettings { kernel, blend, ..settings(Some(0.25)) });
        let whole = render(&plan, &source);
        // Least squares shift along the two axes, in mosaic pixels, and the sum of squares.
        let (mut shift, mut norm, mut squares, mut count) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
        for row in 0..plan.height {
            for column in 0..plan.width {
                let i = row * plan.width + column;
                if whole.alpha[i] == 255 {
                    let at = |c: f64, r: f64| paint(plan.grid.map_from_pixel(c, r));
                    let (c, r) = (column as f64, row as f64);
                    let off = f64::from(whole.values[i]) - at(c, r);
                    let slope =
                        [0.5 * (at(c + 1.0, r) - at(c - 1.0, r)), 0.5 * (at(c, r + 1.0) - at(c, r - 1.0))];
                    for k in 0..2 {
                        shift[k] += off * slope[k];
                        norm[k] += slope[k] * slope[k];
                    }
                    squares += off * off;
                    count += 1.0;
                }
            }
        }
        let shift = [shift[0] / norm[0], shift[1] / norm[1]];
        assert!(shift.iter().all(|s| s.abs() < 0.02), "{kernel:?} {blend:?}: shifted by {shift:?} px");
        let rms = f64::sqrt(squares / count);
        assert!(rms < limit_rms, "{kernel:?} {blend:?}: rms {rms}");
    }
}

#[test]
fn transparency_is_exact() {
    let camera = pinhole(240, 160);
    let frames = vec![frame("a", &LEVEL, &camera, &flat()), frame("b", &TILTED, &camera, &flat())];
    let images = frames.iter().map(|f| constant(f, 77)).collect();
    let plan = plan(frames, &settings(None));
    let whole = render(&plan, &held(images));
    let (wrong, opaque) = alpha_errors(&plan, &whole);
    assert_eq!(wrong, 0);
    // The level frame alone covers 240 × 160 of its own pixels.
    assert!(opaque > 240 * 160, "{opaque}");
}

#[test]
fn equal_frames_blend_to_themselves_without_dark_borders() {
    let camera = pinhole(241, 163);
    // At the photo's own scale and where two and eight photo pixels are averaged.
    for gsd_m in [0.3, 0.7, 2.6] {
        let frames = vec![frame("a", &LEVEL, &camera, &flat()), frame("b", &TILTED, &camera, &flat())];
        let images = frames.iter().map(|f| constant(f, 201)).collect();
        let plan = plan(frames, &settings(Some(gsd_m)));
        let whole = render(&plan, &held(images));
        for (value, alpha) in whole.values.iter().zip(&whole.alpha) {
            assert_eq!(*value, if *alpha == 255 { 201 } else { 0 });
        }
        assert_eq!(alpha_errors(&plan, &whole).0, 0);
    }
}

#[test]
fn a_coarse_mosaic_averages() {
    // A chequerboard of single pixels has no business in a mosaic four times coarser.
    let camera = pinhole(240, 160);
    let frames = vec![frame("a", &LEVEL, &camera, &flat())];
    let samples =
        (0..160).flat_map(|r| (0..240).map(move |c| if (r + c) % 2 == 0 { 255 } else { 0 })).collect();
    let plan = plan(frames, &settings(Some(1.2)));
    let whole = render(&plan, &held(vec![Image8::new(240, 160, 1, samples).unwrap()]));
    let values = whole.values.iter().zip(&whole.alpha);
    for (value, _) in values.filter(|(_, a)| **a == 255) {
        assert!((126..=129).contains(value), "{value}");
    }
}

#[test]
fn without_blending_the_most_central_frame_wins() {
    let camera = pinhole(240, 160);
    let east = Pose { east_m: 36.0, ..LEVEL };
    let frames = vec![frame("west", &LEVEL, &camera, &flat()), frame("east", &east, &camera, &flat())];
    let images = vec![constant(&frames[0], 10), constant(&frames[1], 20)];
    let plan = plan(frames, &PlanSettings { blend: Blend::None, ..settings(Some(0.3)) });
    let whole = render(&plan, &held(images));
    let value_at = |easting: f64| {
        let (c, r) = plan.grid.pixel_from_map(MapPoint { easting, northing: 0.0 });
        whole.values[r.round() as usize * plan.width + c.round() as usize]
    };
    // Both see -0.3 m … 36.3 m; the middle is at 18 m.
    assert_eq!((value_at(16.0), value_at(20.0)), (10, 20));
    assert!(whole.values.iter().all(|v| [0, 10, 20].contains(v)));
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let camera = pinhole(240, 160);
    let frames: Vec<_> = (0..6)
        .map(|i| {
            let pose = Pose { east_m: 60.0 * f64::from(i), yaw: 30.0 * f64::from(i), ..TILTED };
            frame(&format!("{i}"), &pose, &camera, &flat())
        })
        .collect();
    let source = held(frames.iter().map(photo).collect());
    let plan = plan(frames, &settings(Some(0.1)));
    assert!(plan.tiles.len() > 4, "{} tiles", plan.tiles.len());
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut tiles = BTreeMap::new();
        pool.install(|| {
            render_all(
                &plan,
                &source,
                |tile| tile,
                |tile: TilePixels| {
                    tiles.insert((tile.window.row, tile.window.column), tile);
                    Ok::<(), std::convert::Infallible>(())
                },
            )
        })
        .unwrap();
        tiles
    };
    let one = with_threads(1);
    assert_eq!(one.len(), plan.tiles.len());
    assert!(one == with_threads(2));
    assert!(one == with_threads(7));
}

#[test]
fn a_step_and_a_hole_in_the_terrain_are_followed() {
    let camera = pinhole(240, 160);
    let ground: Arc<dyn Terrain> = Arc::new(Step);
    let frames = vec![frame("a", &TILTED, &camera, &ground)];
    let images = frames.iter().map(|f| constant(f, 50)).collect();
    let plan = plan(frames, &settings(Some(0.1)));
    let whole = render(&plan, &held(images));
    assert_eq!(alpha_errors(&plan, &whole).0, 0);
    let hole = plan.grid.pixel_from_map(MapPoint { easting: -15.0, northing: 8.0 });
    assert_eq!(whole.alpha[hole.1.round() as usize * plan.width + hole.0.round() as usize], 0);
}

#[test]
fn interpolated_positions_are_within_a_twentieth_of_a_pixel() {
    let camera = pinhole(240, 160);
    let step: Arc<dyn Terrain> = Arc::new(Step);
    let steep = Pose { pitch: 40.0, ..TILTED };
    for (pose, ground, gsd_m) in
        [(&TILTED, flat(), 0.3), (&steep, flat(), 0.1), (&TILTED, step.clone(), 0.1), (&steep, step, 0.05)]
    {
        let plan = plan(vec![frame("a", pose, &camera, &ground)], &settings(Some(gsd_m)));
        let (mut interpolated, mut worst) = (0, 0.0_f64);
        for tile in plan.tiles.iter().filter(|t| !t.frames.is_empty()) {
            let side = tile.window.width.max(tile.window.height).next_multiple_of(mapping::CELL);
            let mut lattice = ground::TileGround::new(&Cylinder, &plan.grid, &tile.window, side).unwrap();
            let whole = Window { column: 0, row: 0, ..tile.window };
            let map = mapping::map_frame(&mut lattice, &plan.frames[0].frame, &whole);
            let mut check = |column: usize, row: usize, at: mapping::FramePoint| {
                let (column, row) = (tile.window.column + column, tile.window.row + row);
                let exact = super::tests::exact(&plan, 0, column, row).unwrap();
                worst = worst.max((exact.column - at.column).hypot(exact.row - at.row));
            };
            for cell in &map.cells {
                for i in 0..cell.side * cell.side {
                    let (c, r) = (i % cell.side, i / cell.side);
                    let (x, y) = (c as f64 / cell.side as f64, r as f64 / cell.side as f64);
                    let mix = |pick: fn(&mapping::FramePoint) -> f64| {
                        let [ul, ur, ll, lr] = cell.corners.each_ref().map(pick);
                        (1.0 - y) * (ul + x * (ur - ul)) + y * (ll + x * (lr - ll))
                    };
                    let at = mapping::FramePoint { column: mix(|p| p.column), row: mix(|p| p.row) };
                    check(cell.column + c, cell.row + r, at);
                    interpolated += 1;
                }
            }
            for pixel in &map.pixels {
                check(pixel.column, pixel.row, pixel.at);
            }
        }
        assert!(interpolated > 1000, "only {interpolated} pixels interpolated");
        assert!(worst < 0.05, "gsd {gsd_m} m: {worst} px");
    }
}

#[test]
fn corners_that_the_papers_lens_cannot_see_stay_transparent() {
    let brown = Brown::new([
        743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018,
    ])
    .unwrap();
    let camera = Arc::new(Camera::new(brown, 1152, 648, None).unwrap());
    let frames = vec![frame("a", &LEVEL, &camera, &flat())];
    let images = frames.iter().map(|f| constant(f, 90)).collect();
    let plan = plan(frames, &settings(Some(0.2)));
    let whole = render(&plan, &held(images));
    let (wrong, opaque) = alpha_errors(&plan, &whole);
    assert_eq!(wrong, 0);
    assert!(opaque > 100_000);
    assert!(whole.values.iter().all(|v| [0, 90].contains(v)));
}

#[test]
fn a_frame_with_the_horizon_is_cut_at_its_range() {
    let camera = pinhole(240, 160);
    let oblique = Pose { pitch: 75.0, ..LEVEL };
    let frames = vec![frame("a", &oblique, &camera, &flat())];
    assert!(frames[0].footprint.clipped);
    let images = frames.iter().map(|f| constant(f, 90)).collect();
    let plan = plan(frames, &settings(Some(0.5)));
    let whole = render(&plan, &held(images));
    let (wrong, opaque) = alpha_errors(&plan, &whole);
    // Pixels whose range is within a hair of the limit may fall on either side in 64-bit arithmetic.
    assert!(wrong <= 2, "{wrong} of {opaque}");
    assert!(opaque > 10_000);
}

#[test]
fn the_grid_lies_on_whole_multiples_of_its_cell() {
    let camera = pinhole(240, 160);
    let plan = plan(vec![frame("a", &TILTED, &camera, &flat())], &settings(None));
    // 60 m over 200 px is 0.3 m; rounded down to two digits.
    assert!((0.29..=0.31).contains(&plan.gsd_m), "{}", plan.gsd_m);
    assert_eq!((plan.gsd_m * 100.0).round() / 100.0, plan.gsd_m);
    let corner = plan.grid.map_from_pixel(-0.5, -0.5);
    for side in [corner.easting, corner.northing] {
        let lines = side / plan.cell;
        assert!((lines - lines.round()).abs() < 1e-6, "{lines}");
    }
    let feet = PlanSettings { metres_per_unit: 0.3048, ..settings(Some(0.3048)) };
    let in_feet = super::tests::plan(vec![frame("a", &TILTED, &camera, &flat())], &feet);
    assert!((in_feet.cell - 1.0).abs() < 1e-12);
}

#[test]
fn a_wild_pose_is_named_before_anything_is_allocated() {
    let camera = pinhole(240, 160);
    let wild = Pose { east_m: 400_000.0, ..LEVEL };
    let frames = vec![
        frame("good-1", &LEVEL, &camera, &flat()),
        frame("wild", &wild, &camera, &flat()),
        frame("good-2", &TILTED, &camera, &flat()),
    ];
    let error = MosaicPlan::new(frames, Arc::new(Cylinder), &settings(Some(0.3))).unwrap_err();
    assert!(matches!(&error, PlanError::TooLarge { frame, .. } if frame == "wild"), "{error}");
}

#[test]
fn bounds_are_kept_and_must_hold_something() {
    let camera = pinhole(240, 160);
    let frames = || vec![frame("a", &LEVEL, &camera, &flat())];
    let with = |west: f64, east: f64| {
        let bounds = Some(MapBounds { west, south: -5.0, east, north: 5.0 });
        MosaicPlan::new(frames(), Arc::new(Cylinder), &PlanSettings { bounds, ..settings(Some(0.5)) })
    };
    let plan = with(-10.1, 10.0).unwrap();
    assert_eq!((plan.width, plan.height), (41, 20));
    assert!(matches!(with(10.0, -10.0), Err(PlanError::EmptyBounds { .. })));
    assert!(matches!(with(1000.0, 1010.0), Err(PlanError::NothingInside)));
    let none = MosaicPlan::new(vec![], Arc::new(Cylinder), &settings(Some(0.5)));
    assert!(matches!(none, Err(PlanError::NoFrames)));
    let zero = MosaicPlan::new(frames(), Arc::new(Cylinder), &settings(Some(0.0)));
    assert!(matches!(zero, Err(PlanError::Gsd { .. })));
}

#[test]
fn an_image_that_was_not_planned_is_a_failure_of_its_frame() {
    let camera = pinhole(240, 160);
    let plan = plan(vec![frame("a", &LEVEL, &camera, &flat())], &settings(None));
    let other = Image8::new(240, 159, 1, vec![0; 240 * 159]).unwrap();
    let error =
        render_all(&plan, &held(vec![other]), |tile| tile, |_| Ok::<(), std::convert::Infallible>(()))
            .unwrap_err();
    assert!(matches!(&error, ScheduleError::Render(RenderError::Frame(f)) if f.name == "a"), "{error}");
    assert!(error.to_string().contains("240 × 159"), "{error}");
}

#[test]
fn tiles_are_visited_once_each_and_by_neighbours() {
    let camera = pinhole(240, 160);
    let plan = plan(
        vec![
            frame("a", &LEVEL, &camera, &flat()),
            frame("b", &Pose { east_m: 250.0, ..LEVEL }, &camera, &flat()),
        ],
        &settings(Some(0.05)),
    );
    let order = plan.order();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, (0..plan.tiles.len()).collect::<Vec<_>>());
    for pair in order.windows(2) {
        let [a, b] = [pair[0], pair[1]].map(|i| plan.tiles[i].window);
        let steps = a.column.abs_diff(b.column) + a.row.abs_diff(b.row);
        assert_eq!(steps, plan::TILE);
    }
}
