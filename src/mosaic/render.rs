//! One tile: map, sample, blend.

use super::ground::TileGround;
use super::mapping::{CELL, Cell, FramePoint, map_frame};
use super::plan::{Blend, MosaicPlan, Tile, Window};
use super::weight::EdgeWeight;
use crate::geodesy::ProjectionError;
use crate::raster::{Image8, ImagePyramid, Run, sample_run};
use std::sync::Arc;

/// A frame whose pixels cannot be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("frame {name}: {cause}")]
pub struct FrameFailure {
    /// Index in the plan.
    pub frame: usize,
    /// Its name.
    pub name: String,
    /// Why.
    pub cause: String,
}

/// Where the pixels of the frames come from.
pub trait FrameSource: Sync {
    /// The stored pixels of a frame of the plan: of one channel for a grey plan, padded for a coloured one (see
    /// [`Image8::into_padded`]).
    ///
    /// # Errors
    /// [`FrameFailure`] when the image cannot be decoded or is not the image that was planned.
    fn frame(&self, index: usize) -> Result<Arc<ImagePyramid>, FrameFailure>;
}

/// Why a tile cannot be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// The tile lies outside the map projection.
    #[error(transparent)]
    Projection(#[from] ProjectionError),
    /// The projection is too rough to be interpolated.
    #[error(
        "the map projection is not smooth around pixel ({column}, {row}) of the mosaic: interpolation \
         over 8 pixels is {off_m:.3} m off; choose a projection made for this place or a smaller gsd"
    )]
    RoughProjection {
        /// Column in the mosaic.
        column: usize,
        /// Row in the mosaic.
        row: usize,
        /// Deviation, metres.
        off_m: f64,
    },
    /// A frame's pixels cannot be had.
    #[error(transparent)]
    Frame(#[from] FrameFailure),
}

/// The pixels of one tile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TilePixels {
    /// Its place in the mosaic.
    pub window: Window,
    /// One plane of `width × height` samples per channel, 0 where transparent.
    pub planes: Vec<Vec<u8>>,
    /// 255 where at least one frame sees the ground, else 0.
    pub alpha: Vec<u8>,
    /// Frames that see at least one pixel of it, ascending.
    pub frames: Vec<usize>,
}

impl TilePixels {
    fn transparent(window: Window, channels: usize) -> Self {
        let pixels = window.width * window.height;
        Self { window, planes: vec![vec![0; pixels]; channels], alpha: vec![0; pixels], frames: Vec::new() }
    }
    /// The tile at half the resolution: colours are averaged over what is seen, and the transparency says how much
    /// that is. Its window counts pixels of the halved mosaic; it is exact while the tile's corner is even.
    #[must_use]
    pub fn halved(&self) -> Self {
        let Window { column, row, width, height } = self.window;
        let window =
            Window { column: column / 2, row: row / 2, width: width.div_ceil(2), height: height.div_ceil(2) };
        let mut half = Self::transparent(window, self.planes.len());
        half.frames.clone_from(&self.frames);
        for r in 0..window.height {
            // An odd last column or row is taken twice, which is the mean of what exists.
            let (upper, lower) = (2 * r * width, (2 * r + 1).min(height - 1) * width);
            let four_of = |plane: &[u8], c: usize| -> [u32; 4] {
                let (left, right) = (2 * c, (2 * c + 1).min(width - 1));
                [upper + left, upper + right, lower + left, lower + right].map(|i| u32::from(plane[i]))
            };
            let to = r * window.width;
            for c in 0..window.width {
                let alpha = four_of(&self.alpha, c);
                let seen: u32 = alpha.iter().sum();
                half.alpha[to + c] = ((seen + 2) / 4) as u8;
                for (plane, whole) in half.planes.iter_mut().zip(&self.planes) {
                    let values = four_of(whole, c);
                    plane[to + c] = match seen {
                        0 => 0,
                        // All opaque, the usual case.
                        1020 => ((values.iter().sum::<u32>() + 2) / 4) as u8,
                        _ => {
                            let sum: u32 = values.iter().zip(alpha).map(|(v, a)| v * a).sum();
                            ((sum + seen / 2) / seen) as u8
                        }
                    };
                }
            }
        }
        half
    }

    /// True when nothing is seen anywhere.
    #[must_use]
    pub fn is_transparent(&self) -> bool {
        self.alpha.iter().all(|a| *a == 0)
    }
}

/// Renders one tile: a function of the plan, the tile and the frames' pixels, and of nothing else.
///
/// # Errors
/// [`RenderError`].
///
/// # Panics
/// When `tile` is not the index of a tile of the plan.
pub fn render_tile(
    plan: &MosaicPlan,
    tile: usize,
    source: &dyn FrameSource,
) -> Result<TilePixels, RenderError> {
    let tile = &plan.tiles[tile];
    if tile.frames.is_empty() {
        return Ok(TilePixels::transparent(tile.window, plan.channels));
    }
    match plan.channels {
        1 => render::<1>(plan, tile, source),
        _ => render::<4>(plan, tile, source),
    }
}

fn render<const CH: usize>(
    plan: &MosaicPlan,
    tile: &Tile,
    source: &dyn FrameSource,
) -> Result<TilePixels, RenderError> {
    let window = tile.window;
    let side = window.width.max(window.height).next_multiple_of(CELL);
    let mut ground = TileGround::new(plan.projection.as_ref(), &plan.grid, &window, side)?;
    let mut canvas = Canvas::<CH>::new(plan.blend, window.width, window.height);
    let mut seen = Vec::new();
    for &index in &tile.frames {
        let Some(reach) = plan.pixels_of(index, &window) else {
            continue;
        };
        let part = Window { column: reach.column - window.column, row: reach.row - window.row, ..reach };
        let frame = &plan.frames[index].frame;
        let map = map_frame(&mut ground, frame, &part);
        if map.is_empty() {
            continue;
        }
        let pyramid = checked(plan, index, source)?;
        let painter = Painter {
            pyramid: &pyramid,
            plan,
            part,
            // A frame alone is shown as it is.
            weight: (plan.frames.len() > 1).then_some(plan.frames[index].weight.as_ref()),
            size: frame.stored_size(),
        };
        canvas.painted = false;
        for cell in &map.cells {
            painter.paint_cell(cell, &mut canvas);
        }
        let scale = plan.gsd_m / frame.footprint.gsd_m;
        for pixel in &map.pixels {
            painter.paint_pixel(pixel.column, pixel.row, &pixel.at, scale, &mut canvas);
        }
        if canvas.painted {
            seen.push(index);
        }
    }
    Ok(canvas.finish(window, seen))
}

/// The frame's pixels, after a look whether they are what the plan was made for.
fn checked(
    plan: &MosaicPlan,
    index: usize,
    source: &dyn FrameSource,
) -> Result<Arc<ImagePyramid>, FrameFailure> {
    let frame = &plan.frames[index].frame;
    let pyramid = source.frame(index)?;
    let image = pyramid.base();
    let (width, height) = frame.stored_size();
    if (image.width(), image.height()) != (width as usize, height as usize)
        || image.channels() != stored_channels(plan.channels)
    {
        return Err(FrameFailure {
            frame: index,
            name: frame.name.clone(),
            cause: format!(
                "its image has {} × {} pixels of {} channels, {width} × {height} of {} were planned",
                image.width(),
                image.height(),
                image.channels(),
                stored_channels(plan.channels)
            ),
        });
    }
    Ok(pyramid)
}

/// Channels of the decoded frames of a plan: colour is padded.
#[must_use]
pub const fn stored_channels(channels: usize) -> usize {
    if channels == 1 { 1 } else { 4 }
}

/// The tile while frames are laid onto it.
struct Canvas<const CH: usize> {
    blend: Blend,
    width: usize,
    height: usize,
    /// Feather: weighted sums. None: the best frame's value.
    values: Vec<[f32; CH]>,
    /// Feather: sum of weights. None: the best frame's weight. 0 where nothing is seen.
    weights: Vec<f32>,
    /// Whether the frame under way showed anywhere.
    painted: bool,
}

impl<const CH: usize> Canvas<CH> {
    fn new(blend: Blend, width: usize, height: usize) -> Self {
        Self {
            blend,
            width,
            height,
            values: vec![[0.0; CH]; width * height],
            weights: vec![0.0; width * height],
            painted: false,
        }
    }

    /// Lays values with weights onto neighbouring pixels; a weight of 0 is no value.
    fn add(&mut self, start: usize, values: &[[f32; CH]], weights: &[f32]) {
        self.painted |= weights.iter().any(|w| *w > 0.0);
        let held = self.values[start..].iter_mut().zip(&mut self.weights[start..]);
        let laid = values.iter().zip(weights);
        match self.blend {
            Blend::Feather => {
                for ((sums, total), (value, weight)) in held.zip(laid) {
                    for (sum, v) in sums.iter_mut().zip(value) {
                        *sum += weight * v;
                    }
                    *total += weight;
                }
            }
            Blend::None => {
                for ((best, most), (value, weight)) in held.zip(laid) {
                    // Strictly greater: of equals the first frame stays.
                    if weight > most {
                        *best = *value;
                        *most = *weight;
                    }
                }
            }
        }
    }

    fn finish(self, window: Window, frames: Vec<usize>) -> TilePixels {
        let factors: Vec<f32> = self
            .weights
            .iter()
            .map(|weight| match self.blend {
                _ if *weight == 0.0 => 0.0,
                Blend::Feather => 1.0 / weight,
                Blend::None => 1.0,
            })
            .collect();
        // The fourth channel only pads.
        let mut planes = vec![vec![0_u8; self.values.len()]; CH.min(3)];
        let mut row = vec![[0_u8; CH]; self.width];
        for (r, values) in self.values.chunks_exact(self.width).enumerate() {
            let at = r * self.width..(r + 1) * self.width;
            for ((bytes, value), factor) in row.iter_mut().zip(values).zip(&factors[at.clone()]) {
                for k in 0..CH {
                    // `as` saturates; half up.
                    bytes[k] = (value[k] * factor + 0.5) as u8;
                }
            }
            for (k, plane) in planes.iter_mut().enumerate() {
                for (to, bytes) in plane[at.clone()].iter_mut().zip(&row) {
                    *to = bytes[k];
                }
            }
        }
        let alpha = self.weights.iter().map(|w| if *w > 0.0 { 255 } else { 0 }).collect();
        TilePixels { window, planes, alpha, frames }
    }
}

/// Lays one frame onto a canvas.
struct Painter<'a> {
    pyramid: &'a ImagePyramid,
    plan: &'a MosaicPlan,
    /// The part of the tile that the frame reaches, in pixels of the tile.
    part: Window,
    weight: Option<&'a EdgeWeight>,
    size: (u32, u32),
}

impl Painter<'_> {
    fn paint_cell<const CH: usize>(&self, cell: &Cell, canvas: &mut Canvas<CH>) {
        let [ul, ur, ll, lr] = cell.corners;
        let side = cell.side as f64;
        let (across, down) = (
            ((ur.column - ul.column) / side, (ur.row - ul.row) / side),
            ((ll.column - ul.column) / side, (ll.row - ul.row) / side),
        );
        let scale = (across.0 * down.1 - across.1 * down.0).abs().sqrt();
        let level = ImagePyramid::level_for_scale(scale);
        let image = self.pyramid.level(level);
        let all_valid = cell.corners.iter().all(|p| self.is_on_image(p));
        let well_inside = all_valid
            && cell.corners.iter().all(|p| {
                let at = run_to(*p, *p, 1.0).at_level(level);
                lies_between_centres(image, at.column, at.row)
            });
        let first = cell.column.max(self.part.column);
        let end = (cell.column + cell.side).min(self.part.column + self.part.width);
        if first >= end {
            return;
        }
        let (mut values, mut weights) = ([[0.0_f32; CH]; CELL], [0.0_f32; CELL]);
        let top = cell.row.max(self.part.row);
        let bottom = (cell.row + cell.side).min(self.part.row + self.part.height);
        for row in top..bottom {
            let k = (row - cell.row) as f64 / side;
            let left = between(&ul, &ll, k);
            let right = between(&ur, &lr, k);
            let mut run = run_to(left, right, side);
            run.column += (first - cell.column) as f64 * run.column_step;
            run.row += (first - cell.column) as f64 * run.row_step;
            let values = &mut values[..end - first];
            sample_run(image, self.plan.kernel, run.at_level(level), well_inside, values);
            let weights = &mut weights[..end - first];
            self.weigh(&run, weights);
            if !all_valid {
                for (i, weight) in weights.iter_mut().enumerate() {
                    let i = i as f64;
                    let at = FramePoint {
                        column: run.column + i * run.column_step,
                        row: run.row + i * run.row_step,
                    };
                    if !self.is_on_image(&at) {
                        *weight = 0.0;
                    }
                }
            }
            canvas.add(row * canvas.width + first, values, weights);
        }
    }

    fn paint_pixel<const CH: usize>(
        &self,
        column: usize,
        row: usize,
        at: &FramePoint,
        scale: f64,
        canvas: &mut Canvas<CH>,
    ) {
        if column >= canvas.width || row >= canvas.height || !self.is_on_image(at) {
            return;
        }
        let level = ImagePyramid::level_for_scale(scale);
        let (mut value, mut weight) = ([[0.0_f32; CH]], [0.0_f32]);
        let run = run_to(*at, *at, 1.0);
        let image = self.pyramid.level(level);
        sample_run(image, self.plan.kernel, run.at_level(level), false, &mut value);
        self.weigh(&run, &mut weight);
        canvas.add(row * canvas.width + column, &value, &weight);
    }

    fn weigh(&self, run: &Run, weights: &mut [f32]) {
        match self.weight {
            Some(weight) => weight.along(run, weights),
            None => weights.fill(1.0),
        }
    }

    /// Within half a pixel of a pixel centre, as [`crate::camera::Camera::contains`].
    fn is_on_image(&self, at: &FramePoint) -> bool {
        at.column >= -0.5
            && at.row >= -0.5
            && at.column <= f64::from(self.size.0) - 0.5
            && at.row <= f64::from(self.size.1) - 0.5
    }
}

fn lies_between_centres(image: &Image8, column: f64, row: f64) -> bool {
    column >= 0.0 && row >= 0.0 && column <= (image.width() - 1) as f64 && row <= (image.height() - 1) as f64
}

fn between(a: &FramePoint, b: &FramePoint, k: f64) -> FramePoint {
    FramePoint { column: a.column + k * (b.column - a.column), row: a.row + k * (b.row - a.row) }
}

fn run_to(from: FramePoint, to: FramePoint, steps: f64) -> Run {
    Run {
        column: from.column,
        row: from.row,
        column_step: (to.column - from.column) / steps,
        row_step: (to.row - from.row) / steps,
    }
}
