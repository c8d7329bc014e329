//! Dense kernels: the partial factorisation of a front, and small symmetric matrices.

use super::AlignedVec;
use super::factor::NotPositiveDefinite;
use super::matrix::Matrix;
use super::tile::{ROWS, Rows, column_tiles, load, store, subtract_product};
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Eliminates the first `width` unknowns of a symmetric front in place.
///
/// `front` is column-major of order `height`, its columns [`Rows::stride`] apart, with zeros below. Only its lower triangle is
/// read; the upper one is overwritten. Afterwards its first `width` columns contain the factor, and the rest the Schur
/// complement. If a pivot is not positive, its index is returned.
#[inline(always)]
pub(super) fn eliminate<S: Simd>(simd: S, front: &mut [f64], height: usize, width: usize) -> Result<(), usize> {
    let stride = Rows::stride(height);
    for first in (0..width).step_by(ROWS) {
        let end = (first + ROWS).min(width);
        subtract_pivots(simd, front, [height, stride], first..end, first);
        factor_panel(front, stride, first..end)?;
    }
    for first in (width..height).step_by(ROWS) {
        subtract_pivots(simd, front, [height, stride], first..(first + ROWS).min(height), width);
    }
    Ok(())
}

/// Subtracts the contributions of the first `pivots` columns from one to four later columns.
#[inline(always)]
fn subtract_pivots<S: Simd>(simd: S, front: &mut [f64], size: [usize; 2], columns: Range<usize>, pivots: usize) {
    match columns.len() {
        4 => subtract_pivots_from::<S, 4>(simd, front, size, columns.start, pivots),
        3 => subtract_pivots_from::<S, 3>(simd, front, size, columns.start, pivots),
        2 => subtract_pivots_from::<S, 2>(simd, front, size, columns.start, pivots),
        _ => subtract_pivots_from::<S, 1>(simd, front, size, columns.start, pivots),
    }
}

#[inline(always)]
fn subtract_pivots_from<S: Simd, const COUNT: usize>(
    simd: S,
    front: &mut [f64],
    [height, stride]: [usize; 2],
    first: usize,
    pivots: usize,
) {
    if pivots == 0 {
        return;
    }
    let (done, own) = front.split_at_mut(first * stride);
    let (factors, vectors) = (&done[first..], stride / S::F64_LANES);
    let (done, own) = (S::as_simd_f64s(done).0, S::as_mut_simd_f64s(own).0);
    column_tiles!(first / S::F64_LANES, height.div_ceil(S::F64_LANES), |at, N| {
        let sums = load::<S, COUNT, N>(simd, &own[at..], vectors);
        let sums = subtract_product(simd, sums, (factors, stride), (&done[at..], vectors), pivots);
        store(&sums, &mut own[at..], vectors);
    });
}

/// Factors some columns as a block.
#[inline(always)]
fn factor_panel(front: &mut [f64], stride: usize, columns: Range<usize>) -> Result<(), usize> {
    for pivot in columns.clone() {
        let (head, tail) = front.split_at_mut((pivot + 1) * stride);
        let column = &mut head[pivot * stride..];
        let diagonal = column[pivot];
        if diagonal.is_nan() || diagonal <= 0.0 {
            return Err(pivot);
        }
        let root = diagonal.sqrt();
        let inverse = 1.0 / root;
        column[pivot] = root;
        for value in &mut column[pivot + 1..] {
            *value *= inverse;
        }
        for (row, target) in (pivot + 1..columns.end).zip(tail.chunks_exact_mut(stride)) {
            let factor = column[row];
            for (value, below) in target[row..].iter_mut().zip(&column[row..]) {
                *value -= factor * below;
            }
        }
    }
    Ok(())
}

/// Eliminates the first `width` unknowns of a symmetric matrix of the given order in place: the rest becomes the Schur
/// complement.
///
/// `values` is column-major; only the lower triangle is read and written.
///
/// # Errors
/// The index of a pivot that is not positive.
///
/// # Panics
/// If `values` is not a square matrix of the order, or `width` exceeds it.
pub(crate) fn eliminate_in_place(values: &mut [f64], order: usize, width: usize) -> Result<(), NotPositiveDefinite> {
    assert_eq!(values.len(), order * order, "a square matrix");
    assert!(width <= order, "no more unknowns than there are");
    eliminate_lower(values, order, width, |column, row| column * order + row)
}

/// The Cholesky factor of a symmetric positive definite matrix, in its lower triangle; the upper one is not changed.
///
/// # Errors
/// The index of a pivot that is not positive.
///
/// # Panics
/// If the matrix is not square.
pub(super) fn factor_lower(matrix: &mut Matrix) -> Result<(), NotPositiveDefinite> {
    assert_eq!(matrix.rows, matrix.columns, "a square matrix");
    let order = matrix.rows;
    eliminate_lower(&mut matrix.values, order, order, |column, row| row * order + column)
}

/// Eliminates unknowns of a symmetric matrix whose lower triangle has the value of a column and a row at the given index.
fn eliminate_lower(
    values: &mut [f64],
    order: usize,
    width: usize,
    index: impl Fn(usize, usize) -> usize,
) -> Result<(), NotPositiveDefinite> {
    let stride = Rows::stride(order);
    let mut front = AlignedVec::new(order * stride);
    for (column, target) in front.values_mut().chunks_exact_mut(stride).enumerate() {
        (column..order).for_each(|row| target[row] = values[index(column, row)]);
    }
    let outcome = pulp::Arch::new().dispatch(EliminateDense { front: front.values_mut(), order, width });
    for (column, source) in front.values().chunks_exact(stride).enumerate() {
        (column..order).for_each(|row| values[index(column, row)] = source[row]);
    }
    outcome.map_err(|unknown| NotPositiveDefinite { unknown })
}

struct EliminateDense<'a> {
    front: &'a mut [f64],
    order: usize,
    width: usize,
}

impl WithSimd for EliminateDense<'_> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        eliminate(simd, self.front, self.order, self.width)
    }
}
