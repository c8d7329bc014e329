//! Convolutions of 3 x 3 pixels over an image, optionally with periodic columns.
//!
//! An image is stored as `[row][column][channel]` with a border one pixel wide: rows above and below are zero; columns
//! at the sides are copies of the opposite end if the columns are periodic, else zero. With the border filled, every
//! pixel is computed in the same way.

use crate::kernel::run;
use crate::network::CHANNELS_TOGETHER;
use pulp::{Simd, WithSimd};

/// Taps of a convolution.
pub(crate) const TAPS: usize = 9;

/// Neighbouring pixels that are computed together, each with a vector of sums in a register.
const TOGETHER: usize = 15;

/// The shape of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shape {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Whether the last column is adjacent to the first.
    pub is_ring: bool,
}

impl Shape {
    /// Number of pixels without the border.
    pub(crate) fn pixels(&self) -> usize {
        self.rows * self.columns
    }

    /// Number of pixels of a row with its border.
    fn stride(&self) -> usize {
        self.columns + 2
    }

    /// Number of values of an image with its border.
    pub(crate) fn bordered(&self, channels: usize) -> usize {
        (self.rows + 2) * self.stride() * channels
    }

    /// The range of the pixels of a row in a bordered image.
    pub(crate) fn row(&self, row: usize, channels: usize) -> std::ops::Range<usize> {
        let start = ((row + 1) * self.stride() + 1) * channels;
        start..start + self.columns * channels
    }

    /// Copies an image without a border into one with a border.
    pub(crate) fn put(&self, values: &[f32], channels: usize, picture: &mut [f32]) {
        for (row, values) in values.chunks_exact(self.columns * channels).enumerate() {
            picture[self.row(row, channels)].copy_from_slice(values);
        }
        self.fill_border(picture, channels);
    }

    /// Copies an image with a border into one without.
    pub(crate) fn take(&self, picture: &[f32], channels: usize, values: &mut [f32]) {
        for (row, values) in values.chunks_exact_mut(self.columns * channels).enumerate() {
            values.copy_from_slice(&picture[self.row(row, channels)]);
        }
    }

    /// Fills the columns of the border; the rows above and below are never written and stay zero.
    pub(crate) fn fill_border(&self, picture: &mut [f32], channels: usize) {
        if !self.is_ring {
            return;
        }
        for row in 0..self.rows {
            let inside = self.row(row, channels);
            picture.copy_within(inside.end - channels..inside.end, inside.start - channels);
            picture.copy_within(inside.start..inside.start + channels, inside.end);
        }
    }
}

/// `output[pixel] = bias + sum over taps and channels of input[pixel + tap] weight[tap]`, for numbers of output
/// channels that fill whole vectors (a multiple of 16).
#[derive(Debug)]
pub(crate) struct Wide<'a> {
    /// The shape of the images.
    pub shape: Shape,
    /// With border.
    pub input: &'a [f32],
    /// Channels of the input and the output.
    pub channels: [usize; 2],
    /// `[tap][input channel][output channel]`.
    pub weight: &'a [f32],
    /// One for each output channel, or none.
    pub bias: Option<&'a [f32]>,
    /// With border; the border is not written.
    pub output: &'a mut [f32],
    /// The function applied to a sum before it is stored.
    pub last: Last<'a>,
}

/// The function applied to a sum.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Last<'a> {
    /// None.
    Keep,
    /// A rectifier: negative sums become zero.
    Relu,
    /// The gradient of a rectifier: the sum becomes zero where this image is not positive.
    Where(&'a [f32]),
}

impl WithSimd for Wide<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // With the number of input channels as a constant, all pixels of a block share one address.
        match self.channels[0] {
            1 => wide(simd, self, 1),
            4 => wide(simd, self, 4),
            16 => wide(simd, self, 16),
            32 => wide(simd, self, 32),
            channels => wide(simd, self, channels),
        }
    }
}

#[inline(always)]
fn wide<S: Simd>(simd: S, job: Wide<'_>, channels_in: usize) {
    let Wide { shape, input, channels: [_, channels_out], weight, bias, output, last } = job;
    let weight = S::as_simd_f32s(weight).0;
    let output = S::as_mut_simd_f32s(output).0;
    let vectors = channels_out / lanes::<S>();
    for row in 0..shape.rows {
        for vector in 0..vectors {
            let start = match bias {
                Some(bias) => S::as_simd_f32s(bias).0[vector],
                None => simd.splat_f32s(0.0),
            };
            let block = Block { shape, input, channels_in, weight, vectors, vector, start };
            let mut column = 0;
            while column < shape.columns {
                let first = ((row + 1) * shape.stride() + column + 1) * vectors + vector;
                if shape.columns - column >= TOGETHER {
                    let sums = block.sums::<TOGETHER>(simd, row, column);
                    for (pixel, sum) in sums.into_iter().enumerate() {
                        output[first + pixel * vectors] = finish(simd, last, first + pixel * vectors, sum);
                    }
                    column += TOGETHER;
                } else {
                    let [sum] = block.sums::<1>(simd, row, column);
                    output[first] = finish(simd, last, first, sum);
                    column += 1;
                }
            }
        }
    }
}

#[inline(always)]
fn finish<S: Simd>(simd: S, last: Last<'_>, at: usize, sum: S::f32s) -> S::f32s {
    let zero = simd.splat_f32s(0.0);
    match last {
        Last::Keep => sum,
        Last::Relu => simd.max_f32s(sum, zero),
        Last::Where(picture) => {
            let is_positive = simd.greater_than_f32s(S::as_simd_f32s(picture).0[at], zero);
            simd.select_f32s(is_positive, sum, zero)
        }
    }
}

/// Number of values in a vector.
fn lanes<S: Simd>() -> usize {
    size_of::<S::f32s>() / size_of::<f32>()
}

struct Block<'a, S: Simd> {
    shape: Shape,
    input: &'a [f32],
    channels_in: usize,
    weight: &'a [S::f32s],
    vectors: usize,
    vector: usize,
    start: S::f32s,
}

impl<S: Simd> Block<'_, S> {
    /// The sums of `N` pixels of a row from a column on.
    #[inline(always)]
    fn sums<const N: usize>(&self, simd: S, row: usize, column: usize) -> [S::f32s; N] {
        let (channels, vectors) = (self.channels_in, self.vectors);
        let mut sums = [self.start; N];
        for tap in 0..TAPS {
            let from = ((row + tap / 3) * self.shape.stride() + column + tap % 3) * channels;
            let input = &self.input[from..from + N * channels];
            let weight = &self.weight[tap * channels * vectors..][..channels * vectors];
            for channel in 0..channels {
                let weight = weight[channel * vectors + self.vector];
                for pixel in 0..N {
                    sums[pixel] =
                        simd.mul_add_e_f32s(simd.splat_f32s(input[pixel * channels + channel]), weight, sums[pixel]);
                }
            }
        }
        sums
    }
}

/// The same for few output channels, with a number of input channels that fills whole vectors.
#[derive(Debug)]
pub(crate) struct Narrow<'a> {
    /// The shape of the images.
    pub shape: Shape,
    /// With border.
    pub input: &'a [f32],
    /// Channels of the input and the output.
    pub channels: [usize; 2],
    /// `[output channel][tap][input channel]`.
    pub weight: &'a [f32],
    /// One for each output channel, or none.
    pub bias: Option<&'a [f32]>,
    /// With border; the border is not written.
    pub output: &'a mut [f32],
}

impl WithSimd for Narrow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Narrow { shape, input, channels: [channels_in, channels_out], weight, bias, output } = self;
        let (input, weight) = (S::as_simd_f32s(input).0, S::as_simd_f32s(weight).0);
        let vectors = channels_in / lanes::<S>();
        for row in 0..shape.rows {
            for column in 0..shape.columns {
                let at = ((row + 1) * shape.stride() + column + 1) * channels_out;
                for (out, weight) in weight.chunks_exact(TAPS * vectors).enumerate() {
                    let mut sums = [simd.splat_f32s(0.0); 3];
                    for (line, weight) in weight.chunks_exact(3 * vectors).enumerate() {
                        let from = ((row + line) * shape.stride() + column) * vectors;
                        // Three neighbours in a row are contiguous.
                        let pixels = &input[from..from + 3 * vectors];
                        for (value, weight) in pixels.iter().zip(weight) {
                            sums[line] = simd.mul_add_e_f32s(*value, *weight, sums[line]);
                        }
                    }
                    let sum = simd.add_f32s(simd.add_f32s(sums[0], sums[1]), sums[2]);
                    output[at + out] = simd.reduce_sum_f32s(sum) + bias.map_or(0.0, |bias| bias[out]);
                }
            }
        }
    }
}

/// Adds the gradient of the weights: `gradient[tap] += sum over pixels of input[pixel + tap] error[pixel]`, for numbers
/// of error channels that fill whole vectors.
#[derive(Debug)]
pub(crate) struct WeightGradient<'a> {
    /// The shape of the images.
    pub shape: Shape,
    /// With border.
    pub input: &'a [f32],
    /// With border, with the output's channels.
    pub error: &'a [f32],
    /// Channels of the input and the output.
    pub channels: [usize; 2],
    /// `[tap][input channel][output channel]`.
    pub gradient: &'a mut [f32],
}

impl WithSimd for WeightGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let WeightGradient { shape, input, error, channels: [channels_in, channels_out], gradient } = self;
        let error = S::as_simd_f32s(error).0;
        let gradient = S::as_mut_simd_f32s(gradient).0;
        let vectors = channels_out / lanes::<S>();
        for tap in 0..TAPS {
            for vector in 0..vectors {
                let job = TapGradient { shape, input, error, channels_in, vectors, vector, tap };
                let mut channel = 0;
                while channel < channels_in {
                    let at = (tap * channels_in + channel) * vectors + vector;
                    let mut add = |sums: &[S::f32s]| {
                        for (index, sum) in sums.iter().enumerate() {
                            let place = &mut gradient[at + index * vectors];
                            *place = simd.add_f32s(*place, *sum);
                        }
                    };
                    if channels_in - channel >= 8 {
                        add(&job.sums::<8>(simd, channel));
                        channel += 8;
                    } else if channels_in - channel >= 4 {
                        add(&job.sums::<4>(simd, channel));
                        channel += 4;
                    } else {
                        add(&job.sums::<1>(simd, channel));
                        channel += 1;
                    }
                }
            }
        }
    }
}

struct TapGradient<'a, S: Simd> {
    shape: Shape,
    input: &'a [f32],
    error: &'a [S::f32s],
    channels_in: usize,
    vectors: usize,
    vector: usize,
    tap: usize,
}

impl<S: Simd> TapGradient<'_, S> {
    /// The sums over all pixels for `N` input channels from one on.
    #[inline(always)]
    fn sums<const N: usize>(&self, simd: S, channel: usize) -> [S::f32s; N] {
        let stride = self.shape.stride();
        let mut sums = [simd.splat_f32s(0.0); N];
        for row in 0..self.shape.rows {
            let from = (row + self.tap / 3) * stride + self.tap % 3;
            let input = &self.input[from * self.channels_in..(from + self.shape.columns) * self.channels_in];
            let error = &self.error[((row + 1) * stride + 1) * self.vectors..][..self.shape.columns * self.vectors];
            for (pixel, error) in input.chunks_exact(self.channels_in).zip(error.chunks_exact(self.vectors)) {
                let error = error[self.vector];
                let values: &[f32; N] = pixel[channel..channel + N].try_into().expect("as many");
                for n in 0..N {
                    sums[n] = simd.mul_add_e_f32s(simd.splat_f32s(values[n]), error, sums[n]);
                }
            }
        }
        sums
    }
}

/// In the order of [`Wide`] if there are many output channels, else of [`Narrow`].
pub(crate) fn pack(weight: &[f32], [from, to]: [usize; 2]) -> Vec<f32> {
    if to.is_multiple_of(CHANNELS_TOGETHER) {
        return weight.to_vec();
    }
    (0..to * TAPS * from).map(|at| weight[at % (TAPS * from) * to + at / (TAPS * from)]).collect()
}

/// One convolution of a bordered image, by the suitable kernel.
pub(crate) fn convolve(
    shape: Shape,
    channels: [usize; 2],
    weight: &[f32],
    bias: Option<&[f32]>,
    input: &[f32],
    output: &mut [f32],
    last: Last<'_>,
) {
    match channels[1].is_multiple_of(CHANNELS_TOGETHER) {
        true => run(Wide { shape, input, channels, weight, bias, output, last }),
        false => run(Narrow { shape, input, channels, weight, bias, output }),
    }
    shape.fill_border(output, channels[1]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(count: usize, step: f32) -> Vec<f32> {
        (0..count).map(|at| (at as f32 * step).sin()).collect()
    }

    fn bordered(shape: Shape, channels: usize, values: &[f32]) -> Vec<f32> {
        let mut picture = vec![0.0; shape.bordered(channels)];
        shape.put(values, channels, &mut picture);
        picture
    }

    /// A value of an image without a border, zero outside of it.
    fn at(shape: Shape, channels: usize, values: &[f32], row: isize, column: isize, channel: usize) -> f64 {
        let columns = shape.columns as isize;
        let column = if shape.is_ring { column.rem_euclid(columns) } else { column };
        let inside = (0..shape.rows as isize).contains(&row) && (0..columns).contains(&column);
        if inside { f64::from(values[(row * columns + column) as usize * channels + channel]) } else { 0.0 }
    }

    fn plain(shape: Shape, [from, to]: [usize; 2], values: &[f32], weight: &[f32]) -> Vec<f32> {
        let mut out = Vec::new();
        for row in 0..shape.rows as isize {
            for column in 0..shape.columns as isize {
                for o in 0..to {
                    let term = |tap: usize, i: usize| {
                        let (dr, dc) = (tap as isize / 3 - 1, tap as isize % 3 - 1);
                        at(shape, from, values, row + dr, column + dc, i) * f64::from(weight[(tap * from + i) * to + o])
                    };
                    let sum: f64 =
                        (0..TAPS).flat_map(|tap| (0..from).map(move |i| (tap, i))).map(|(t, i)| term(t, i)).sum();
                    out.push(sum as f32);
                }
            }
        }
        out
    }

    fn near(a: &[f32], b: &[f32]) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4 * b.abs().max(1.0))
    }

    const SHAPES: [Shape; 3] = [
        Shape { rows: 5, columns: 23, is_ring: true },
        Shape { rows: 7, columns: 10, is_ring: false },
        Shape { rows: 2, columns: 3, is_ring: true },
    ];

    #[test]
    fn convolutions_are_those_of_plain_sums() {
        for shape in SHAPES {
            for channels in [[1, 16], [4, 16], [16, 32], [3, 16]] {
                let (input, weight) =
                    (filled(shape.pixels() * channels[0], 0.7), filled(TAPS * channels[0] * channels[1], 1.9));
                let mut output = vec![0.0; shape.bordered(channels[1])];
                let picture = bordered(shape, channels[0], &input);
                run(Wide {
                    shape,
                    input: &picture,
                    channels,
                    weight: &weight,
                    bias: None,
                    output: &mut output,
                    last: Last::Keep,
                });
                let mut inside = vec![0.0; shape.pixels() * channels[1]];
                shape.take(&output, channels[1], &mut inside);
                assert!(near(&inside, &plain(shape, channels, &input, &weight)), "{shape:?} {channels:?}");
            }
            for channels in [[16, 1], [32, 4], [16, 3]] {
                let (input, weight) =
                    (filled(shape.pixels() * channels[0], 0.7), filled(TAPS * channels[0] * channels[1], 1.9));
                let packed: Vec<f32> = (0..channels[1])
                    .flat_map(|o| (0..TAPS * channels[0]).map(move |ti| (o, ti)))
                    .map(|(o, ti)| weight[ti * channels[1] + o])
                    .collect();
                let mut output = vec![0.0; shape.bordered(channels[1])];
                let picture = bordered(shape, channels[0], &input);
                run(Narrow { shape, input: &picture, channels, weight: &packed, bias: None, output: &mut output });
                let mut inside = vec![0.0; shape.pixels() * channels[1]];
                shape.take(&output, channels[1], &mut inside);
                assert!(near(&inside, &plain(shape, channels, &input, &weight)), "{shape:?} {channels:?}");
            }
        }
    }

    #[test]
    fn the_gradient_of_the_weights_is_that_of_plain_sums() {
        for shape in SHAPES {
            for channels @ [from, to] in [[1, 16], [4, 16], [16, 16], [13, 32]] {
                let (input, error) = (filled(shape.pixels() * from, 0.7), filled(shape.pixels() * to, 0.31));
                let mut gradient = vec![1.0; TAPS * from * to];
                run(WeightGradient {
                    shape,
                    input: &bordered(shape, from, &input),
                    error: &bordered(shape, to, &error),
                    channels,
                    gradient: &mut gradient,
                });
                for (place, value) in gradient.iter().enumerate() {
                    let (tap, i, o) = (place / (from * to), place / to % from, place % to);
                    let (dr, dc) = (tap as isize / 3 - 1, tap as isize % 3 - 1);
                    let mut sum = 1.0;
                    for row in 0..shape.rows as isize {
                        for column in 0..shape.columns as isize {
                            sum += at(shape, from, &input, row + dr, column + dc, i)
                                * at(shape, to, &error, row, column, o);
                        }
                    }
                    assert!((f64::from(*value) - sum).abs() < 1e-3, "{shape:?} {channels:?} {place}: {value} {sum}");
                }
            }
        }
    }
}
