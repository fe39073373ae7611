//! Reading an image between its pixels.
//!
//! The caller decides which positions are valid; a position up to half a pixel outside the outermost
//! pixel centres is on the image, and there the kernels repeat the outermost pixel. Nothing is ever
//! taken from farther out.

use super::Image8;

/// How a value between pixel centres is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kernel {
    /// The nearest pixel.
    Nearest,
    /// Linear between the four pixels around.
    #[default]
    Bilinear,
    /// Cubic convolution over the sixteen pixels around, clipped to 0–255.
    ///
    /// # Source
    /// Keys (1981), "Cubic convolution interpolation for digital image processing", a = −1/2.
    Cubic,
}

/// Positions at equal steps along a straight line through an image, in pixels; (0, 0) is the centre of
/// the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Column of the first position.
    pub column: f64,
    /// Row of the first position.
    pub row: f64,
    /// Columns from one position to the next.
    pub column_step: f64,
    /// Rows from one position to the next.
    pub row_step: f64,
}

impl Run {
    /// The same line in an image reduced `level` times by 2 (see [`Image8::halved`]).
    #[must_use]
    pub fn at_level(&self, level: usize) -> Self {
        let k = 1.0 / f64::from(1_u32 << level.min(31));
        Self {
            column: (self.column + 0.5) * k - 0.5,
            row: (self.row + 0.5) * k - 0.5,
            column_step: self.column_step * k,
            row_step: self.row_step * k,
        }
    }
}

/// Fills `values` with the image along the run, one pixel of `CH` channels per position.
///
/// Positions beyond the outermost pixel centres take the outermost pixel. `well_inside` promises that
/// every position lies between the outermost pixel centres, which spares the test; a broken promise
/// gives wrong values or a panic, never an access out of bounds.
///
/// # Panics
/// When the image does not have `CH` channels.
pub fn sample_run<const CH: usize>(
    image: &Image8,
    kernel: Kernel,
    run: Run,
    well_inside: bool,
    values: &mut [[f32; CH]],
) {
    assert_eq!(image.channels(), CH, "channels of the image");
    match kernel {
        Kernel::Nearest => nearest(image, run, values),
        Kernel::Bilinear if well_inside && image.width() > 1 && image.height() > 1 => {
            bilinear_inside(image, run, values);
        }
        Kernel::Bilinear => bilinear(image, run, values),
        Kernel::Cubic => cubic(image, run, values),
    }
}

fn positions(run: Run, count: usize) -> impl Iterator<Item = (f64, f64)> {
    (0..count).map(move |i| {
        let i = i as f64;
        (run.column + i * run.column_step, run.row + i * run.row_step)
    })
}

/// The last index of an axis as a coordinate.
fn last(count: usize) -> f64 {
    (count - 1) as f64
}

fn nearest<const CH: usize>(image: &Image8, run: Run, values: &mut [[f32; CH]]) {
    let (right, bottom) = (last(image.width()), last(image.height()));
    for ((column, row), value) in positions(run, values.len()).zip(values.iter_mut()) {
        let c = (column + 0.5).floor().clamp(0.0, right) as usize;
        let r = (row + 0.5).floor().clamp(0.0, bottom) as usize;
        let pixel = &image.samples()[(r * image.width() + c) * CH..][..CH];
        *value = std::array::from_fn(|k| f32::from(pixel[k]));
    }
}

fn bilinear<const CH: usize>(image: &Image8, run: Run, values: &mut [[f32; CH]]) {
    let (width, height) = (image.width(), image.height());
    for ((column, row), value) in positions(run, values.len()).zip(values.iter_mut()) {
        let (column, row) = (column.clamp(0.0, last(width)), row.clamp(0.0, last(height)));
        let (c0, r0) = (column as usize, row as usize);
        let (c1, r1) = ((c0 + 1).min(width - 1), (r0 + 1).min(height - 1));
        let (fc, fr) = ((column - c0 as f64) as f32, (row - r0 as f64) as f32);
        let at = |c: usize, r: usize, k: usize| f32::from(image.samples()[(r * width + c) * CH + k]);
        *value = std::array::from_fn(|k| {
            let upper = at(c0, r0, k) + fc * (at(c1, r0, k) - at(c0, r0, k));
            let lower = at(c0, r1, k) + fc * (at(c1, r1, k) - at(c0, r1, k));
            upper + fr * (lower - upper)
        });
    }
}

/// Fixed point: 32 bits of fraction keep the position exact to 1e-9 px over a run.
const ONE: f64 = 4_294_967_296.0;

fn bilinear_inside<const CH: usize>(image: &Image8, run: Run, values: &mut [[f32; CH]]) {
    let samples = image.samples();
    let stride = image.width() * CH;
    // A position exactly on the last pixel centre has that pixel as its upper left neighbour and none
    // to the right: hold the corner one pixel back and let the fraction reach 1.
    let (last_column, last_row) = (image.width() as i64 - 2, image.height() as i64 - 2);
    let (mut column, mut row) = ((run.column * ONE) as i64, (run.row * ONE) as i64);
    let (column_step, row_step) = ((run.column_step * ONE) as i64, (run.row_step * ONE) as i64);
    // Written as plain loops over whole pixels, which the compiler turns into vector instructions.
    let load = |start: usize| -> ([f32; CH], [f32; CH]) {
        let pair = &samples[start..start + 2 * CH];
        let (mut left, mut right) = ([0.0; CH], [0.0; CH]);
        for k in 0..CH {
            left[k] = f32::from(pair[k]);
            right[k] = f32::from(pair[CH + k]);
        }
        (left, right)
    };
    for value in values.iter_mut() {
        let (c, r) = ((column >> 32).clamp(0, last_column), (row >> 32).clamp(0, last_row));
        const FRACTION: f32 = 1.0 / 16_777_216.0;
        let fc = ((column - (c << 32)) >> 8) as i32 as f32 * FRACTION;
        let fr = ((row - (r << 32)) >> 8) as i32 as f32 * FRACTION;
        let start = r as usize * stride + c as usize * CH;
        let (ul, ur) = load(start);
        let (ll, lr) = load(start + stride);
        for k in 0..CH {
            let u = ul[k] + fc * (ur[k] - ul[k]);
            let l = ll[k] + fc * (lr[k] - ll[k]);
            value[k] = u + fr * (l - u);
        }
        column += column_step;
        row += row_step;
    }
}

fn cubic_weights(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [
        0.5 * (-f3 + 2.0 * f2 - f),
        0.5 * (3.0 * f3 - 5.0 * f2 + 2.0),
        0.5 * (-3.0 * f3 + 4.0 * f2 + f),
        0.5 * (f3 - f2),
    ]
}

fn cubic<const CH: usize>(image: &Image8, run: Run, values: &mut [[f32; CH]]) {
    let (width, height) = (image.width(), image.height());
    let around = |at: f64, count: usize| -> [usize; 4] {
        let first = at as isize - 1;
        std::array::from_fn(|i| (first + i as isize).clamp(0, count as isize - 1) as usize)
    };
    for ((column, row), value) in positions(run, values.len()).zip(values.iter_mut()) {
        let (column, row) = (column.clamp(0.0, last(width)), row.clamp(0.0, last(height)));
        let (columns, rows) = (around(column, width), around(row, height));
        let by_column = cubic_weights(column.fract() as f32);
        let by_row = cubic_weights(row.fract() as f32);
        let mut sums = [0.0_f32; CH];
        for (r, wr) in rows.into_iter().zip(by_row) {
            for (c, wc) in columns.into_iter().zip(by_column) {
                let pixel = &image.samples()[(r * width + c) * CH..][..CH];
                for k in 0..CH {
                    sums[k] += wr * wc * f32::from(pixel[k]);
                }
            }
        }
        *value = sums.map(|s| s.clamp(0.0, 255.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Grey value 2 · column + 3 · row: every kernel but nearest must reproduce it between pixels.
    fn ramp(width: usize, height: usize) -> Image8 {
        let samples = (0..height).flat_map(|r| (0..width).map(move |c| (2 * c + 3 * r) as u8)).collect();
        Image8::new(width, height, 1, samples).unwrap()
    }
    fn at(image: &Image8, kernel: Kernel, column: f64, row: f64, well_inside: bool) -> f32 {
        let run = Run { column, row, column_step: 0.0, row_step: 0.0 };
        let mut value = [[0.0_f32; 1]];
        sample_run::<1>(image, kernel, run, well_inside, &mut value);
        value[0][0]
    }

    #[test]
    fn half_a_pixel_outside_repeats_the_border() {
        let image = ramp(20, 10);
        for kernel in [Kernel::Nearest, Kernel::Bilinear, Kernel::Cubic] {
            assert_eq!(at(&image, kernel, -0.49, -0.49, false), 0.0);
            assert_eq!(at(&image, kernel, 19.49, 9.49, false), 65.0);
        }
        assert_eq!(at(&image, Kernel::Bilinear, 19.0, 9.0, true), 65.0);
        let one = Image8::new(1, 1, 1, vec![200]).unwrap();
        assert_eq!(at(&one, Kernel::Bilinear, 0.0, 0.0, true), 200.0);
    }

    #[test]
    fn nearest_changes_half_way() {
        let image = ramp(20, 10);
        assert_eq!(at(&image, Kernel::Nearest, 4.49, 2.0, false), 14.0);
        assert_eq!(at(&image, Kernel::Nearest, 4.51, 2.0, false), 16.0);
    }

    #[test]
    fn cubic_is_clipped() {
        let image = Image8::new(4, 1, 1, vec![0, 255, 255, 0]).unwrap();
        let value = at(&image, Kernel::Cubic, 1.5, 0.0, false);
        assert_eq!(value, 255.0);
    }

    proptest! {
        #[test]
        fn a_ramp_stays_a_ramp(
            column in 2.0..17.0f64, row in 2.0..7.0f64, dc in -0.05..0.05f64, dr in -0.05..0.05f64,
        ) {
            let image = ramp(20, 10);
            let run = Run { column, row, column_step: dc, row_step: dr };
            for (kernel, inside) in [
                (Kernel::Bilinear, false), (Kernel::Bilinear, true), (Kernel::Cubic, false),
            ] {
                let mut values = [[0.0_f32; 1]; 16];
                sample_run::<1>(&image, kernel, run, inside, &mut values);
                for (i, value) in values.iter().enumerate() {
                    let (c, r) = (column + i as f64 * dc, row + i as f64 * dr);
                    prop_assert!((f64::from(value[0]) - (2.0 * c + 3.0 * r)).abs() < 1e-4);
                }
            }
        }

        #[test]
        fn a_reduced_ramp_lies_where_the_ramp_lies(column in 3.0..15.0f64, row in 3.0..5.0f64) {
            let image = ramp(20, 10).halved();
            let run = Run { column, row, column_step: 0.0, row_step: 0.0 }.at_level(1);
            // Averages of whole numbers are rounded; half a grey value is a quarter pixel here.
            let value = f64::from(at(&image, Kernel::Bilinear, run.column, run.row, false));
            prop_assert!((value - (2.0 * column + 3.0 * row)).abs() <= 0.5 + 1e-3);
        }
    }
}
