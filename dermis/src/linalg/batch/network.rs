//! The pseudo-inverse of the kept unknowns' matrices, eight simultaneously.

use super::plan::update_column;
use super::{AlignedVec, BadLanes, LANES};
use crate::linalg::Matrix;
use pulp::{Simd, WithSimd};

/// The pseudo-inverses of some matrices as [`BatchPlan::transfer_impedances`](super::BatchPlan::transfer_impedances) gives
/// them, row-major with a lane per matrix; lanes without a matrix repeat the last.
///
/// # Errors
/// Matrices that are not positive definite beside the constant.
///
/// # Panics
/// If there is no matrix or more than [`LANES`], or if their sizes differ.
pub(crate) fn pseudo_inverses(matrices: &[Matrix]) -> Result<Vec<[f64; LANES]>, BadLanes> {
    assert!((1..=LANES).contains(&matrices.len()), "at least one matrix and at most one per lane");
    let order = matrices[0].rows;
    let mut lower = AlignedVec::new(order * (order + 1) / 2 * LANES);
    let mut places = lower.values_mut().as_chunks_mut::<LANES>().0.iter_mut();
    for (column, row) in (0..order).flat_map(|column| (column..order).map(move |row| (column, row))) {
        let place = places.next().expect("a place for each pair of rows");
        for (lane, value) in place.iter_mut().enumerate() {
            *value = matrices[lane.min(matrices.len() - 1)].at(row, column);
        }
    }
    let mut memory = AlignedVec::new(2 * order * order * LANES);
    let mut inverses = vec![[0.0; LANES]; order * order];
    let all = PseudoInverses { order, lower: lower.values(), memory: memory.values_mut(), inverses: &mut inverses };
    let good = pulp::Arch::new().dispatch(all);
    if good.iter().all(|&good| good) { Ok(inverses) } else { Err(BadLanes(good.map(|good| !good))) }
}

struct PseudoInverses<'a> {
    order: usize,
    lower: &'a [f64],
    memory: &'a mut [f64],
    inverses: &'a mut [[f64; LANES]],
}

impl WithSimd for PseudoInverses<'_> {
    type Output = [bool; LANES];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let PseudoInverses { order, lower, memory, inverses } = self;
        let (width, memory) = (S::F64_LANES, S::as_mut_simd_f64s(memory).0);
        let mut good = [true; LANES];
        let mut own = vec![simd.splat_f64s(0.0); order * (order + 1) / 2];
        for pass in 0..LANES / width {
            let lanes = S::as_simd_f64s(lower).0.iter().skip(pass).step_by(LANES / width);
            own.iter_mut().zip(lanes).for_each(|(own, value)| *own = *value);
            let least = pseudo_inverse(simd, &own, order, memory);
            let least: &[f64] = pulp::bytemuck::cast_slice(std::slice::from_ref(&least));
            for (good, pivot) in good[pass * width..].iter_mut().zip(least) {
                *good = *pivot > 0.0;
            }
            for (target, value) in inverses.iter_mut().zip(&*memory) {
                let value: &[f64] = pulp::bytemuck::cast_slice(std::slice::from_ref(value));
                target[pass * width..][..width].copy_from_slice(value);
            }
        }
        good
    }
}

/// The pseudo-inverse of symmetric matrices of order `L` whose null vector is the constant: with `c = trace(Y) / L` and
/// `P = 1 1' / L`, `(Y + c P)^-1 - P / c`. Gives the smallest pivots.
///
/// `lower` contains their lower triangles column by column; the result is in the first `L x L` numbers of `memory`, row
/// by row; the rest is scratch memory.
#[inline(always)]
pub(super) fn pseudo_inverse<S: Simd>(simd: S, lower: &[S::f64s], order: usize, memory: &mut [S::f64s]) -> S::f64s {
    let count = simd.splat_f64s(order as f64);
    let mut trace = simd.splat_f64s(0.0);
    for column in 0..order {
        trace = simd.add_f64s(trace, lower[update_column(column, order) + column]);
    }
    let scale = simd.div_f64s(trace, count);
    let share = simd.div_f64s(scale, count);
    let (inverse, factor) = memory[..2 * order * order].split_at_mut(order * order);
    for column in 0..order {
        for row in column..order {
            // Row-major, so that a row of the factor is contiguous.
            factor[row * order + column] = simd.add_f64s(lower[update_column(column, order) + row], share);
        }
    }
    let least = cholesky(simd, factor, order);
    invert(simd, factor, order, inverse);
    let null = simd.div_f64s(simd.splat_f64s(1.0), simd.mul_f64s(scale, count));
    for value in inverse {
        *value = simd.sub_f64s(*value, null);
    }
    least
}

/// The Cholesky factor in place, row by row; the reciprocals of its diagonal in the diagonal's place.
#[inline(always)]
fn cholesky<S: Simd>(simd: S, factor: &mut [S::f64s], order: usize) -> S::f64s {
    let mut least = simd.splat_f64s(f64::MAX);
    for row in 0..order {
        let (above, own) = factor.split_at_mut(row * order);
        for column in 0..row {
            let other = &above[column * order..][..=column];
            let sum = subtract_dot(simd, own[column], &own[..column], other);
            own[column] = simd.mul_f64s(sum, other[column]);
        }
        let pivot = subtract_dot(simd, own[row], &own[..row], &own[..row]);
        least = simd.min_f64s(least, pivot);
        own[row] = simd.div_f64s(simd.splat_f64s(1.0), simd.sqrt_f64s(pivot));
    }
    least
}

/// `start - a . b`
#[inline(always)]
fn subtract_dot<S: Simd>(simd: S, start: S::f64s, a: &[S::f64s], b: &[S::f64s]) -> S::f64s {
    a.iter().zip(b).fold(start, |sum, (&a, &b)| simd.negate_mul_add_e_f64s(a, b, sum))
}

/// The inverse from the factor: first the inverse of the factor in place, then the product with its transpose.
#[inline(always)]
fn invert<S: Simd>(simd: S, factor: &mut [S::f64s], order: usize, inverse: &mut [S::f64s]) {
    for row in 0..order {
        let (above, own) = factor.split_at_mut(row * order);
        let scale = own[row];
        // Row of the factor's inverse: minus the row times the rows above, which are already inverted.
        for column in 0..row {
            let mut sum = simd.splat_f64s(0.0);
            for middle in column..row {
                sum = simd.negate_mul_add_e_f64s(own[middle], above[middle * order + column], sum);
            }
            inverse[column] = simd.mul_f64s(sum, scale);
        }
        own[..row].copy_from_slice(&inverse[..row]);
    }
    inverse.fill(simd.splat_f64s(0.0));
    for row in factor.chunks_exact(order).enumerate() {
        let (last, row) = row;
        for i in 0..=last {
            let target = &mut inverse[i * order..][..=i];
            for (target, &value) in target.iter_mut().zip(row) {
                *target = simd.mul_add_e_f64s(row[i], value, *target);
            }
        }
    }
    for i in 0..order {
        for j in 0..i {
            inverse[j * order + i] = inverse[i * order + j];
        }
    }
}
