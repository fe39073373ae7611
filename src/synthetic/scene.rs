//! What the synthetic ground looks like: farmland, runway and targets as colours over the site's east and north.
//!
//! Texture is averaged over the pixel's footprint as it is made: every pattern finer than the footprint fades
//! instead of aliasing. Only targets and runway have hard edges, for the renderer to sample more densely
//! ([`Painting::has_edge`]).

use std::f64::consts::TAU;

use nalgebra::{Vector2, Vector3};

use super::ground::ScenePoint;
use super::noise::{coverage, ease, floor, fractal, fraction, hash, line_coverage, smooth, survival};
use super::scenario::Scenario;

/// Red, green, blue in [0, 1], as the camera would store them.
pub(super) type Rgb = Vector3<f64>;

/// Elevation of the sun; it stands in the north-east, right for a southern morning and pleasant anywhere.
const SUN_ELEVATION_RAD: f64 = 0.85;
const SUN_AZIMUTH_RAD: f64 = 0.75;
/// Length of a tree's shadow, metres.
const SHADOW_M: f64 = 4.5;
/// Distance between the tramlines of a sprayed crop, metres, and between the two wheels.
const TRAMLINE_M: f64 = 24.0;
const WHEELS_M: f64 = 1.9;
/// A track's wheel ruts: their distance from its middle and their width, metres.
const HALF_AXLE_M: f64 = 1.15;
const RUT_M: f64 = 1.3;
/// Width of the turning strip at both ends of a field, metres.
const HEADLAND_M: f64 = 11.0;
/// Plate diameter over target diameter.
const PLATE: f64 = 1.8;
/// Mown grass around the runway, metres beyond its ends and sides.
const AIRFIELD_M: Vector2<f64> = Vector2::new(45.0, 24.0);

const AIRFIELD_CORNER_M: f64 = 20.0;

/// One ground target.
pub(super) struct Mark {
    pub name: String,
    pub centre: ScenePoint,
    cross: bool,
}

struct Crop {
    colour: [u8; 3],
    /// What shows where the crop is thin.
    soil: [u8; 3],
    rows: f64,
    patches: f64,
    roughness: f64,
    tramlines: bool,
    trees: Trees,
}

#[derive(Clone, Copy, PartialEq)]
enum Trees {
    None,
    Single,
    Wood,
}

const CROPS: [Crop; 10] = [
    // Young cereal.
    Crop {
        colour: [104, 134, 66],
        soil: [142, 124, 88],
        rows: 0.05,
        patches: 0.35,
        roughness: 0.05,
        tramlines: true,
        trees: Trees::None,
    },
    // Ripe cereal.
    Crop {
        colour: [204, 180, 118],
        soil: [170, 146, 100],
        rows: 0.03,
        patches: 0.5,
        roughness: 0.05,
        tramlines: true,
        trees: Trees::None,
    },
    // Tilled red-brown soil.
    Crop {
        colour: [158, 116, 88],
        soil: [184, 148, 118],
        rows: 0.05,
        patches: 0.9,
        roughness: 0.07,
        tramlines: false,
        trees: Trees::None,
    },
    // Dark ploughed soil.
    Crop {
        colour: [116, 90, 72],
        soil: [146, 116, 92],
        rows: 0.08,
        patches: 0.8,
        roughness: 0.09,
        tramlines: false,
        trees: Trees::None,
    },
    // Maize.
    Crop {
        colour: [74, 108, 54],
        soil: [110, 118, 70],
        rows: 0.09,
        patches: 0.4,
        roughness: 0.07,
        tramlines: false,
        trees: Trees::None,
    },
    // Flowering rape.
    Crop {
        colour: [190, 182, 74],
        soil: [128, 140, 66],
        rows: 0.03,
        patches: 0.5,
        roughness: 0.06,
        tramlines: true,
        trees: Trees::None,
    },
    // Pasture.
    Crop {
        colour: [122, 140, 82],
        soil: [160, 152, 104],
        rows: 0.0,
        patches: 1.0,
        roughness: 0.09,
        tramlines: false,
        trees: Trees::Single,
    },
    // Stubble.
    Crop {
        colour: [190, 166, 126],
        soil: [164, 132, 100],
        rows: 0.06,
        patches: 0.7,
        roughness: 0.06,
        tramlines: false,
        trees: Trees::None,
    },
    // Clover.
    Crop {
        colour: [90, 138, 76],
        soil: [116, 140, 78],
        rows: 0.02,
        patches: 0.7,
        roughness: 0.05,
        tramlines: false,
        trees: Trees::None,
    },
    // Wood.
    Crop {
        colour: [62, 82, 48],
        soil: [74, 84, 52],
        rows: 0.0,
        patches: 0.4,
        roughness: 0.12,
        tramlines: false,
        trees: Trees::Wood,
    },
];

const GRASS: [u8; 3] = [124, 142, 80];
const DRY_GRASS: [u8; 3] = [160, 154, 106];
const EARTH: [u8; 3] = [186, 158, 124];
const CROWN: [u8; 3] = [70, 94, 52];
const ASPHALT: [u8; 3] = [122, 122, 124];
const PAINT: [u8; 3] = [232, 232, 228];
const PLATE_DARK: [u8; 3] = [44, 44, 48];
const TARGET_WHITE: [u8; 3] = [238, 238, 236];

/// A field: a rectangle in the field axes (metres), its neighbours' borders and its hash.
struct Parcel {
    low: Vector2<f64>,
    high: Vector2<f64>,
    /// Indices of the column borders left and right, when this parcel touches them.
    column: i64,
    /// Distances to those borders, metres (positive: right of the left one, left of the right one).
    from_left: f64,
    from_right: f64,
    /// Distance to the nearest border of any kind.
    to_border: f64,
    identity: u64,
}

pub(super) struct Painting {
    seed: u64,
    scene: super::scenario::Scene,
    marks: Vec<Mark>,
    /// Index into `marks` of every place of the target grid, rows after one another.
    places: Vec<Option<usize>>,
    field_axes: Axes,
    runway_axes: Axes,
    target_axes: Axes,
    sun: Vector2<f64>,
    /// The sun across and along the fields.
    sun_in_field: Vector2<f64>,
}

impl Painting {
    pub fn new(scenario: &Scenario) -> Self {
        let scene = scenario.scene.clone();
        let (runway, targets) = (&scene.runway, &scene.targets);
        let field_axes = Axes::new(0.0, 0.0, scene.field_direction_deg);
        let runway_axes = Axes::new(runway.east_m, runway.north_m, runway.heading_deg);
        let target_axes = Axes::new(targets.east_m, targets.north_m, targets.heading_deg);
        let (mut marks, mut places) = (Vec::new(), Vec::new());
        for row in 0..targets.rows {
            for column in 0..targets.columns {
                let centre = target_axes.scene(
                    (f64::from(column) - 0.5 * f64::from(targets.columns - 1)) * targets.column_spacing_m,
                    (f64::from(row) - 0.5 * f64::from(targets.rows - 1)) * targets.row_spacing_m,
                );
                let from_runway = runway_axes.local(centre).abs();
                let clear = 5.0 + 0.5 * PLATE * targets.diameter_m;
                let on_runway = runway.present
                    && from_runway.x < 0.5 * runway.length_m + clear
                    && from_runway.y < 0.5 * runway.width_m + clear;
                places.push((!on_runway).then_some(marks.len()));
                if !on_runway {
                    let name = format!("T{:02}", row * targets.columns + column + 1);
                    marks.push(Mark { name, centre, cross: (row + column) % 2 == 1 });
                }
            }
        }
        let sun = Vector2::new(SUN_AZIMUTH_RAD.sin(), SUN_AZIMUTH_RAD.cos());
        let sun_in_field = field_axes.local(ScenePoint { east: sun.x, north: sun.y }).yx();
        let seed = hash(scenario.seed, 11, 17);
        Self { seed, scene, marks, places, field_axes, runway_axes, target_axes, sun, sun_in_field }
    }

    pub fn marks(&self) -> &[Mark] {
        &self.marks
    }

    /// The runway's corners, in turn, and the middles of its two ends; `None` without a runway.
    pub fn runway_outline(&self) -> Option<([ScenePoint; 4], [ScenePoint; 2])> {
        let runway = &self.scene.runway;
        let at = |along: f64, right: f64| self.runway_axes.scene(along, right);
        let (length, width) = (0.5 * runway.length_m, 0.5 * runway.width_m);
        runway.present.then(|| {
            (
                [at(-length, -width), at(length, -width), at(length, width), at(-length, width)],
                [at(-length, 0.0), at(length, 0.0)],
            )
        })
    }

    /// Whether a hard edge may pass through the footprint.
    pub fn has_edge(&self, at: ScenePoint, footprint: f64) -> bool {
        let reach = 1.5 * footprint;
        let plate = 0.5 * PLATE * self.scene.targets.diameter_m + reach;
        if self.nearest_mark(at).is_some_and(|(_, offset)| offset.norm() < plate) {
            return true;
        }
        let runway = &self.scene.runway;
        if !runway.present {
            return false;
        }
        let local = self.runway_axes.local(at).abs();
        let (length, width) = (0.5 * runway.length_m, 0.5 * runway.width_m);
        let plain = local.x < length - 16.0 - reach && local.y > 0.3 + reach && local.y < width - reach;
        local.x < length + reach && local.y < width + reach && !plain
    }

    /// Colour of the ground, averaged over a footprint (metres); `slope` is the ground's rise per metre east, north.
    pub fn colour(&self, at: ScenePoint, slope: Vector2<f64>, footprint: f64) -> Rgb {
        let light = (SUN_ELEVATION_RAD.sin() - SUN_ELEVATION_RAD.cos() * slope.dot(&self.sun)).max(0.0)
            / (SUN_ELEVATION_RAD.sin() * (1.0 + slope.norm_squared()).sqrt());
        (self.paint(at, footprint) * light).map(|channel| channel.clamp(0.0, 1.0))
    }

    fn paint(&self, at: ScenePoint, footprint: f64) -> Rgb {
        if let Some(colour) = self.mark_colour(at) {
            return colour;
        }
        let runway = &self.scene.runway;
        if !runway.present {
            return self.farmland(at, footprint);
        }
        let local = self.runway_axes.local(at);
        let (length, width) = (0.5 * runway.length_m, 0.5 * runway.width_m);
        if local.x.abs() <= length && local.y.abs() <= width {
            return self.runway_colour(local, footprint);
        }
        let ragged = 1.5 * smooth(self.seed ^ 21, at.east / 9.0, at.north / 9.0);
        // A rectangle with rounded corners.
        let beyond = local.abs() - Vector2::new(length, width) - AIRFIELD_M.add_scalar(-AIRFIELD_CORNER_M);
        let inside =
            AIRFIELD_CORNER_M + ragged - beyond.sup(&Vector2::zeros()).norm() - beyond.max().min(0.0);
        let share = coverage(inside, footprint.max(1.5));
        let mown = |footprint| {
            let stripe = (TAU * local.y / 12.0).sin() * survival(12.0, footprint);
            let patches = fractal(self.seed ^ 22, at.east, at.north, 40.0, 6, footprint);
            let worn = ease((2.5 - (local.y.abs() - width).max(local.x.abs() - length)) / 2.5) * 0.5;
            blend(rgb(GRASS), rgb(DRY_GRASS), 0.35 + 0.45 * patches + worn) * (1.0 + 0.035 * stripe)
        };
        if share >= 1.0 {
            mown(footprint)
        } else {
            blend(self.farmland(at, footprint), mown(footprint), share)
        }
    }

    fn runway_colour(&self, local: Vector2<f64>, footprint: f64) -> Rgb {
        let runway = &self.scene.runway;
        let from_end = 0.5 * runway.length_m - local.x.abs();
        let across = local.y.abs();
        let centre_dash =
            across < 0.3 && from_end > 24.0 && (local.x + 0.5 * runway.length_m).rem_euclid(20.0) < 12.0;
        let threshold =
            (3.0..15.0).contains(&from_end) && across < 0.42 * runway.width_m && across.rem_euclid(1.5) > 0.5;
        let wear = fractal(self.seed ^ 31, local.x, local.y, 24.0, 6, footprint);
        if centre_dash || threshold {
            return rgb(PAINT) * (0.96 + 0.03 * wear);
        }
        let rubber = (-((from_end - 42.0) / 16.0).powi(2)).exp() * (-(across / 1.8).powi(2)).exp();
        let streaks = smooth(self.seed ^ 32, local.x / 30.0, local.y / 0.8) * survival(1.6, footprint);
        let joints = line_coverage((local.x + 1.0e4).rem_euclid(25.0) - 12.5, 0.25, footprint);
        rgb(ASPHALT) * (1.0 + 0.07 * wear + 0.05 * streaks - 0.25 * rubber - 0.2 * joints)
    }

    /// The nearest place of the target grid and the offset from it, along the grid's heading and to its right.
    fn nearest_mark(&self, at: ScenePoint) -> Option<(&Mark, Vector2<f64>)> {
        let targets = &self.scene.targets;
        if self.marks.is_empty() {
            return None;
        }
        let local = self.target_axes.local(at);
        let place = |offset: f64, spacing: f64, count: u32| {
            // Rounded to the nearest place; the cast stops at 0 from below.
            ((offset / spacing + 0.5 * f64::from(count - 1) + 0.5) as u32).min(count - 1)
        };
        let column = place(local.x, targets.column_spacing_m, targets.columns);
        let row = place(local.y, targets.row_spacing_m, targets.rows);
        let mark = &self.marks[self.places[(row * targets.columns + column) as usize]?];
        Some((mark, local - self.target_axes.local(mark.centre)))
    }

    fn mark_colour(&self, at: ScenePoint) -> Option<Rgb> {
        let (mark, offset) = self.nearest_mark(at)?;
        let radius = 0.5 * self.scene.targets.diameter_m;
        if offset.norm() > PLATE * radius {
            return None;
        }
        let span = offset.abs();
        let white = if mark.cross {
            span.max() < radius && span.min() < 0.25 * radius
        } else {
            offset.norm() < radius
        };
        Some(rgb(if white { TARGET_WHITE } else { PLATE_DARK }))
    }

    fn farmland(&self, at: ScenePoint, footprint: f64) -> Rgb {
        let seed = self.seed;
        // Field axes: `across` counts columns of fields, `along` runs along their borders; both gently bent.
        let flat = self.field_axes.local(at);
        let bend = |seed: u64| 7.0 * smooth(seed, flat.x / 330.0, flat.y / 330.0);
        let place = Vector2::new(flat.y + bend(seed ^ 41), flat.x + bend(seed ^ 42));
        let parcel = self.parcel(place);
        let kind = fraction(parcel.identity.rotate_left(9));
        let crop = &CROPS[((kind * kind.sqrt().sqrt() * 10.0) as usize).min(9)];

        let mut colour = self.crop_colour(crop, &parcel, place, footprint);
        let winding = place.x
            - 0.8 * self.scene.field_size_m
            - 46.0 * (place.y / 210.0 + 1.0).sin()
            - 14.0 * (place.y / 83.0).sin();
        let mut to_track = winding.abs();
        for (border, distance) in [(parcel.column, parcel.from_left), (parcel.column + 1, parcel.from_right)]
        {
            if distance < to_track && self.border_kind(border) == Border::Track {
                to_track = distance;
            }
        }
        if parcel.to_border.min(to_track - 2.0) < 4.0 + footprint {
            let rough = fractal(seed ^ 43, place.x, place.y, 6.0, 4, footprint);
            let grass = blend(rgb(GRASS), rgb(DRY_GRASS), 0.4 + 0.9 * rough);
            let margin = if crop.trees == Trees::Wood { 0.0 } else { 1.1 + 0.6 * rough };
            colour = blend(colour, grass, coverage(margin - parcel.to_border, footprint));
            colour = blend(colour, grass, coverage(3.7 + 0.6 * rough - to_track, footprint));
            let ruts = line_coverage(to_track - HALF_AXLE_M, RUT_M, footprint);
            colour = blend(colour, rgb(EARTH) * (1.0 + 0.08 * rough), ruts);
        }

        let (shadow, _) = self.crown(crop, &parcel, place + self.sun_in_field * SHADOW_M, footprint);
        let (share, shade) = self.crown(crop, &parcel, place, footprint);
        if share == 0.0 {
            return colour * (1.0 - 0.5 * shadow);
        }
        let leaves = 1.0 + 0.25 * fractal(seed ^ 44, place.x, place.y, 2.0, 3, footprint);
        blend(colour * (1.0 - 0.5 * shadow), rgb(CROWN) * (shade * leaves), share)
    }

    fn crop_colour(&self, crop: &Crop, parcel: &Parcel, place: Vector2<f64>, footprint: f64) -> Rgb {
        let seed = self.seed ^ parcel.identity;
        let size = parcel.high - parcel.low;
        let from_low = place - parcel.low;
        // Rows run along the longer side; on the headlands they turn along the shorter one.
        let (mut across, mut along) =
            if size.y >= size.x { (from_low.x, from_low.y) } else { (from_low.y, from_low.x) };
        let length = size.max();
        let headland = along.min(length - along) < HEADLAND_M && crop.trees == Trees::None;
        if headland {
            std::mem::swap(&mut across, &mut along);
        }
        let tone = 0.16 * (fraction(parcel.identity.rotate_left(23)) - 0.5);
        let patches = fractal(self.seed ^ 51, place.x, place.y, 110.0, 4, footprint)
            + 0.4 * fractal(seed, place.x, place.y, 30.0, 2, footprint);
        let rough = fractal(self.seed ^ 52, place.x, place.y, 4.0, 4, footprint);
        let period = self.scene.row_period_m;
        let wobble = 0.3 * smooth(seed ^ 2, across / 60.0, along / 60.0) * period;
        let rows = (TAU * (across + wobble) / period).sin() * survival(period, footprint);
        // Drill and harvester passes: long streaks a few metres wide.
        let streaks = smooth(seed ^ 3, across / 3.0, along / 90.0) * survival(6.0, footprint)
            + 0.7 * smooth(seed ^ 4, across / 9.0, along / 160.0);
        let streaks = if crop.trees == Trees::None { streaks } else { 0.0 };
        let mut colour = blend(rgb(crop.colour), rgb(crop.soil), 0.25 + crop.patches * patches)
            * (1.0 + tone + 0.05 * patches + crop.rows * rows + 0.035 * streaks + crop.roughness * rough);
        if crop.tramlines && !headland {
            let from_pass =
                (across / TRAMLINE_M - 0.5 - (across / TRAMLINE_M - 0.5).round()).abs() * TRAMLINE_M;
            let wheel = line_coverage(from_pass - 0.5 * WHEELS_M, 0.45, footprint);
            colour = blend(colour, rgb(crop.soil) * 0.92, 0.8 * wheel);
        }
        colour
    }

    fn border_kind(&self, border: i64) -> Border {
        match fraction(hash(self.seed ^ 61, border, 0)) {
            kind if kind < 0.4 => Border::Hedge,
            kind if kind < 0.65 => Border::Track,
            _ => Border::Plain,
        }
    }

    /// Coverage and brightness of the tree crown over a place.
    fn crown(&self, crop: &Crop, parcel: &Parcel, place: Vector2<f64>, footprint: f64) -> (f64, f64) {
        // The deepest point inside any crown wins: (depth, offset from the centre, radius).
        let mut best: Option<(f64, Vector2<f64>, f64)> = None;
        let mut offer = |centre: Vector2<f64>, radius: f64| {
            let offset = place - centre;
            let depth = radius - offset.norm();
            if best.is_none_or(|(deepest, ..)| depth > deepest) {
                best = Some((depth, offset, radius));
            }
        };
        for border in [parcel.column, parcel.column + 1] {
            let axis = self.column_border(border);
            if self.border_kind(border) != Border::Hedge || (place.x - axis).abs() > 6.0 {
                continue;
            }
            let cell = floor(place.y / 4.0);
            for index in cell - 1..=cell + 1 {
                let random = hash(self.seed ^ 62, border, index);
                if fraction(random) < 0.85 {
                    let centre = Vector2::new(
                        axis + 2.0 * (fraction(random.rotate_left(17)) - 0.5),
                        (index as f64 + fraction(random.rotate_left(31))) * 4.0,
                    );
                    offer(centre, 1.6 + 1.9 * fraction(random.rotate_left(47)));
                }
            }
        }
        let (cell, chance, radius) = match crop.trees {
            Trees::None => (0.0, 0.0, 0.0),
            Trees::Single => (38.0, 0.4, 4.0),
            Trees::Wood => (6.5, 0.95, 3.2),
        };
        if chance > 0.0 {
            let (column, row) = (floor(place.x / cell), floor(place.y / cell));
            for column in column - 1..=column + 1 {
                for row in row - 1..=row + 1 {
                    let random = hash(self.seed ^ 63, column, row);
                    let jitter =
                        Vector2::new(fraction(random.rotate_left(17)), fraction(random.rotate_left(31)));
                    let centre = (Vector2::new(column as f64, row as f64) + jitter) * cell;
                    let inside = (centre - parcel.low).inf(&(parcel.high - centre)).min();
                    if fraction(random) < chance && inside > radius {
                        offer(centre, radius * (0.7 + 0.6 * fraction(random.rotate_left(47))));
                    }
                }
            }
        }
        match best {
            Some((depth, offset, radius)) if depth > -2.0 => {
                let ragged = 0.35 * smooth(self.seed ^ 64, place.x / 1.2, place.y / 1.2);
                (
                    coverage(depth + ragged, footprint.max(0.4)),
                    0.92 + 0.42 * offset.dot(&self.sun_in_field) / radius,
                )
            }
            _ => (0.0, 1.0),
        }
    }

    fn column_border(&self, border: i64) -> f64 {
        (border as f64 + 0.5 * (fraction(hash(self.seed ^ 71, border, 0)) - 0.5)) * self.scene.field_size_m
    }

    /// The field that a place lies in: columns of fields, cut across at each column's own places, and many of
    /// those cut again into two or three.
    fn parcel(&self, place: Vector2<f64>) -> Parcel {
        let size = self.scene.field_size_m;
        let column = between(place.x / size, |index| self.column_border(index), place.x);
        let (left, right) = (self.column_border(column), self.column_border(column + 1));
        let depth = size * (0.9 + 0.9 * fraction(hash(self.seed ^ 72, column, 1)));
        let cut = |index: i64| (index as f64 + 0.6 * fraction(hash(self.seed ^ 73, column, index))) * depth;
        let row = between(place.y / depth, cut, place.y);
        let (mut low, mut high) = (Vector2::new(left, cut(row)), Vector2::new(right, cut(row + 1)));
        let mut identity = hash(self.seed ^ 74, column, row);
        let parts = [1, 1, 2, 2, 3][(identity % 5) as usize];
        let axis = usize::from(identity.rotate_left(40).is_multiple_of(3));
        let side = |part: i64, identity: u64| {
            let inner = part > 0 && part < parts;
            let jitter = if inner { 0.3 * (fraction(hash(identity, part, 5)) - 0.5) } else { 0.0 };
            low[axis] + (high[axis] - low[axis]) * ((part as f64 + jitter) / parts as f64)
        };
        let part = (1..parts).find(|&part| place[axis] < side(part, identity)).unwrap_or(parts) - 1;
        (low[axis], high[axis]) = (side(part, identity), side(part + 1, identity));
        identity = hash(identity, part, 3);
        let to_border = (place - low).inf(&(high - place)).min();
        Parcel {
            low,
            high,
            column,
            from_left: place.x - left,
            from_right: right - place.x,
            to_border,
            identity,
        }
    }
}

#[derive(PartialEq)]
enum Border {
    Hedge,
    Track,
    Plain,
}

/// The index whose border and next border enclose `value`, starting from a guess that is at most one off.
fn between(guess: f64, border: impl Fn(i64) -> f64, value: f64) -> i64 {
    let index = floor(guess);
    if value < border(index) {
        index - 1
    } else if value >= border(index + 1) {
        index + 1
    } else {
        index
    }
}

/// Axes along a heading (x) and to its right (y) from an origin in the scene.
struct Axes {
    east: f64,
    north: f64,
    sin: f64,
    cos: f64,
}

impl Axes {
    fn new(east: f64, north: f64, heading_deg: f64) -> Self {
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        Self { east, north, sin, cos }
    }

    fn local(&self, at: ScenePoint) -> Vector2<f64> {
        let (east, north) = (at.east - self.east, at.north - self.north);
        Vector2::new(east * self.sin + north * self.cos, east * self.cos - north * self.sin)
    }

    fn scene(&self, along: f64, right: f64) -> ScenePoint {
        ScenePoint {
            east: self.east + along * self.sin + right * self.cos,
            north: self.north + along * self.cos - right * self.sin,
        }
    }
}

fn rgb(colour: [u8; 3]) -> Rgb {
    Rgb::new(f64::from(colour[0]), f64::from(colour[1]), f64::from(colour[2])) / 255.0
}

fn blend(under: Rgb, over: Rgb, share: f64) -> Rgb {
    under.lerp(&over, share.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn painting() -> Painting {
        Painting::new(&Scenario::demo())
    }

    #[test]
    fn fields_tile_the_plane() {
        let painting = painting();
        for index in 0..4000 {
            let place =
                Vector2::new(f64::from(index % 80) * 31.7 - 1200.0, f64::from(index / 80) * 43.1 - 1000.0);
            let parcel = painting.parcel(place);
            assert!(parcel.to_border >= 0.0, "{place} lies outside its field");
            let same = painting.parcel(place + Vector2::new(0.4, -0.4) * parcel.to_border);
            assert_eq!(parcel.identity, same.identity);
        }
    }

    #[test]
    fn runway_has_its_length_and_width() {
        let (corners, ends) = painting().runway_outline().unwrap();
        let distance = |a: ScenePoint, b: ScenePoint| (a.east - b.east).hypot(a.north - b.north);
        assert!((distance(ends[0], ends[1]) - 225.0).abs() < 1e-9);
        assert!((distance(corners[0], corners[1]) - 225.0).abs() < 1e-9);
        assert!((distance(corners[1], corners[2]) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn targets_keep_clear_of_the_runway() {
        let painting = painting();
        let targets = &painting.scene.targets;
        assert!(painting.marks().len() < (targets.columns * targets.rows) as usize);
        for mark in painting.marks() {
            assert_eq!(
                painting.colour(mark.centre, Vector2::zeros(), 0.1),
                rgb(TARGET_WHITE),
                "{}",
                mark.name
            );
            assert!(painting.has_edge(mark.centre, 0.1));
        }
    }

    /// A wide footprint gives nearly the mean of the fine colours inside it.
    #[test]
    fn coarse_colours_are_averages_of_fine_ones() {
        let painting = painting();
        let mut worst: f64 = 0.0;
        for place in 0..60 {
            let (east, north) = (f64::from(place % 10) * 97.0 - 480.0, f64::from(place / 10) * 131.0 + 60.0);
            let coarse = painting.colour(ScenePoint { east, north }, Vector2::zeros(), 2.0);
            let mut mean = Rgb::zeros();
            for sample in 0..400 {
                let (dx, dy) = (f64::from(sample % 20) / 10.0 - 0.95, f64::from(sample / 20) / 10.0 - 0.95);
                mean +=
                    painting.colour(ScenePoint { east: east + dx, north: north + dy }, Vector2::zeros(), 0.1)
                        / 400.0;
            }
            worst = worst.max((coarse - mean).abs().max());
        }
        assert!(worst < 0.12, "{worst}");
    }
}
