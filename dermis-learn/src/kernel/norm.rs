//! Batch normalisation (Ioffe and Szegedy, 2015, arXiv 1502.03167, Algorithm 1 and the gradients of its section 3).

use pulp::{Simd, WithSimd};
use rayon::prelude::*;

/// Number of columns that one thread sums at a time.
const COLUMNS: usize = 64;

/// For each column of two row-major matrices of the same shape, the sums over the rows of the function `of` of a pair
/// of values. Rows are added in their order, for any number of threads.
pub(crate) fn column_sums(
    a: &[f32],
    b: &[f32],
    columns: usize,
    of: impl Fn(usize, f32, f32) -> [f32; 2] + Sync + Copy,
) -> [Vec<f32>; 2] {
    let (mut first, mut second) = (vec![0.0; columns], vec![0.0; columns]);
    first.par_chunks_mut(COLUMNS).zip(second.par_chunks_mut(COLUMNS)).enumerate().for_each(|(block, sums)| {
        super::run(ColumnSums { a, b, columns, start: block * COLUMNS, sums, of });
    });
    [first, second]
}

struct ColumnSums<'a, F> {
    a: &'a [f32],
    b: &'a [f32],
    columns: usize,
    start: usize,
    sums: (&'a mut [f32], &'a mut [f32]),
    of: F,
}

impl<F: Fn(usize, f32, f32) -> [f32; 2]> WithSimd for ColumnSums<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (first, second) = self.sums;
        let width = first.len();
        for (a, b) in self.a.chunks_exact(self.columns).zip(self.b.chunks_exact(self.columns)) {
            let (a, b) = (&a[self.start..][..width], &b[self.start..][..width]);
            for at in 0..width {
                let [one, two] = (self.of)(self.start + at, a[at], b[at]);
                first[at] += one;
                second[at] += two;
            }
        }
    }
}

/// Changes each value of a matrix by a function of the value, its column and the corresponding value of another matrix.
pub(crate) fn change_rows(
    values: &mut [f32],
    other: &[f32],
    columns: usize,
    of: impl Fn(usize, f32, f32) -> f32 + Sync + Copy,
) {
    values.par_chunks_mut(columns).zip(other.par_chunks(columns)).for_each(|(values, other)| {
        super::run(ChangeRow { values, other, of });
    });
}

struct ChangeRow<'a, F> {
    values: &'a mut [f32],
    other: &'a [f32],
    of: F,
}

impl<F: Fn(usize, f32, f32) -> f32> WithSimd for ChangeRow<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (at, (value, &other)) in self.values.iter_mut().zip(self.other).enumerate() {
            *value = (self.of)(at, *value, other);
        }
    }
}
