//! Products of dense matrices in tiles of registers, their columns in SIMD lanes.
//!
//! Matrices are row-major with rows of whole vectors. With four rows and three vectors a tile needs twelve sums, three
//! values and one factor: the sixteen registers of AVX2. Two chains of twelve sums hide the latency of a multiply-add.

use super::AlignedVec;
use super::batch::LANES;
use pulp::Simd;

/// Rows of a tile.
pub(super) const ROWS: usize = 4;

/// A dense matrix, row-major, with rows filled up to whole vectors of any instruction set.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    pub values: AlignedVec,
    /// Numbers per row: whole cache lines, but not a multiple of eight of them, so that a column's rows are in many sets
    /// of a cache.
    pub stride: usize,
}

impl Default for Rows {
    fn default() -> Self {
        Rows { values: AlignedVec::new(0), stride: 0 }
    }
}

impl Rows {
    /// The stride for a number of columns.
    pub(super) fn stride(columns: usize) -> usize {
        let lines = columns.div_ceil(LANES);
        (lines + usize::from(lines.is_multiple_of(8))) * LANES
    }

    /// Another size in the same memory, whose values are any.
    pub(super) fn resize(&mut self, rows: usize, columns: usize) {
        self.stride = Self::stride(columns);
        self.values.resize(rows * self.stride);
    }

    #[inline(always)]
    pub(super) fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.values.values_mut()[row * self.stride..(row + 1) * self.stride]
    }
}

/// Runs a block of code for tiles of three vectors, then of two or one, from vector `$first` to `$end`: `$at` is the first
/// vector of the tile, `$N` the constant number of its vectors.
macro_rules! column_tiles {
    ($first:expr, $end:expr, |$at:ident, $N:ident| $body:expr) => {{
        let (mut $at, end) = ($first, $end);
        while $at + 3 <= end {
            const $N: usize = 3;
            $body;
            $at += 3;
        }
        if $at + 2 == end {
            const $N: usize = 2;
            $body;
        } else if $at + 1 == end {
            const $N: usize = 1;
            $body;
        }
    }};
}
pub(super) use column_tiles;

/// `sums[r][n] - sum over k < count of a[k * a_stride + r] * b[k * b_stride + n]`: strides in numbers for `a`, in vectors
/// for `b`. By value, so that the sums stay in registers.
#[inline(always)]
pub(super) fn subtract_product<S: Simd, const R: usize, const N: usize>(
    simd: S,
    mut sums: [[S::f64s; N]; R],
    (a, a_stride): (&[f64], usize),
    (b, b_stride): (&[S::f64s], usize),
    count: usize,
) -> [[S::f64s; N]; R] {
    for (a, b) in a.chunks(a_stride).zip(b.chunks(b_stride)).take(count) {
        let (Some(factors), Some(values)) = (a.first_chunk::<R>(), b.first_chunk::<N>()) else { return sums };
        for r in 0..R {
            let factor = simd.splat_f64s(factors[r]);
            for n in 0..N {
                sums[r][n] = simd.negate_mul_add_e_f64s(factor, values[n], sums[r][n]);
            }
        }
    }
    sums
}

/// A tile of consecutive rows.
#[inline(always)]
pub(super) fn load<S: Simd, const R: usize, const N: usize>(
    simd: S,
    rows: &[S::f64s],
    stride: usize,
) -> [[S::f64s; N]; R] {
    let mut sums = [[simd.splat_f64s(0.0); N]; R];
    for (r, sums) in sums.iter_mut().enumerate() {
        sums.copy_from_slice(&rows[r * stride..][..N]);
    }
    sums
}

/// Writes a tile.
#[inline(always)]
pub(super) fn store<T: Copy, const R: usize, const N: usize>(sums: &[[T; N]; R], rows: &mut [T], stride: usize) {
    for (r, sums) in sums.iter().enumerate() {
        rows[r * stride..][..N].copy_from_slice(sums);
    }
}
