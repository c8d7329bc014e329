//! Pivoted Cholesky of a semidefinite matrix.
//!
//! A pivot is not the largest remainder but the first that is not far below it, so that the columns of the root begin in the
//! order of the rows as far as the rank permits.

use super::matrix::Matrix;
use pulp::{Simd, WithSimd};

/// The remainder's diagonal is below this fraction of the largest value where the matrix has no more rank: rounding.
/// What is left out changes the result by less than this fraction.
const RANK_TOLERANCE: f64 = 1e-14;
/// A row may be the next pivot if the share of its diagonal that is left is above this fraction of the largest such share.
/// A pivot smaller by a factor `f` raises the effect of rounding by `1 / f`.
const FIRST_SHARE: f64 = 0.1;
/// Nor is a pivot smaller than this fraction `f` of the largest remainder, though all of a small diagonal is left: entries
/// are rounded relative to the largest value, and the other remainders of their rows would be wrong by `1 / sqrt(f)` of that.
const FIRST_SIZE: f64 = 1e-4;
/// Entries of the root below this fraction of the square root of the largest value are rounding, and are zero.
const ROUNDING: f64 = 1e-15;
/// A remainder below zero by more than this fraction is not rounding.
const LOSS_TOLERANCE: f64 = 1e-9;

/// `U` with `U U' = C`, order x rank, for a symmetric positive semidefinite matrix: Cholesky with pivots (Higham, 1990,
/// "Analysis of the Cholesky decomposition of a semi-definite matrix", section 1, where the largest is first). `None` if
/// it is not finite or not semidefinite.
///
/// `scale` is the size of the numbers that the matrix is a difference of, at least its own largest: they are rounded.
pub(crate) fn semidefinite_root(matrix: &Matrix, scale: f64) -> Option<Matrix> {
    pulp::Arch::new().dispatch(Root { matrix, scale })
}

struct Root<'a> {
    matrix: &'a Matrix,
    scale: f64,
}

impl WithSimd for Root<'_> {
    type Output = Option<Matrix>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Root { matrix, scale } = self;
        let order = matrix.rows;
        let mut left: Vec<f64> = (0..order).map(|k| matrix.at(k, k)).collect();
        let diagonal = left.clone();
        let mut largest = scale;
        for &value in &left {
            if !value.is_finite() {
                return None;
            }
            largest = largest.max(value.abs());
        }
        // The columns of `U` one after the other.
        let mut columns: Vec<f64> = Vec::with_capacity(order * order);
        let mut pivots: Vec<usize> = Vec::with_capacity(order);
        for rank in 0..order {
            if left.iter().any(|rest| *rest < -LOSS_TOLERANCE * largest) {
                return None;
            }
            let Some(pivot) = next_pivot(&left, &diagonal, RANK_TOLERANCE * largest) else { break };
            let value = left[pivot];
            columns.extend_from_slice(matrix.row(pivot));
            let (done, column) = columns.split_at_mut(rank * order);
            // Four at a time, so that the column is read and written less often.
            let fours = done.chunks_exact(4 * order);
            let rest = fours.remainder();
            for four in fours {
                let (a, others) = four.split_at(order);
                let (b, others) = others.split_at(order);
                let (c, d) = others.split_at(order);
                let factors = [a[pivot], b[pivot], c[pivot], d[pivot]];
                for ((((sum, a), b), c), d) in column.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *sum -= factors[0] * a + factors[1] * b + (factors[2] * c + factors[3] * d);
                }
            }
            for before in rest.chunks_exact(order) {
                let factor = before[pivot];
                column.iter_mut().zip(before).for_each(|(sum, value)| *sum -= factor * value);
            }
            // Zero but for rounding.
            pivots.iter().for_each(|&done| column[done] = 0.0);
            pivots.push(pivot);
            let inverse = 1.0 / value.sqrt();
            let rounding = ROUNDING * largest.sqrt();
            for (entry, rest) in column.iter_mut().zip(&mut left) {
                *entry *= inverse;
                if entry.abs() <= rounding {
                    *entry = 0.0;
                }
                *rest -= *entry * *entry;
            }
            // Of a finite diagonal, a value that is not finite makes a remainder that is not a number.
            if !column.iter().fold(0.0, |sum, value| sum + value).is_finite() {
                return None;
            }
            left[pivot] = 0.0;
        }
        let rank = columns.len().checked_div(order).unwrap_or(0);
        let mut root = Matrix::zeros(order, rank);
        for (k, column) in columns.chunks_exact(order.max(1)).enumerate() {
            column.iter().enumerate().for_each(|(row, &value)| *root.at_mut(row, k) = value);
        }
        Some(root)
    }
}

/// The first row whose remainder is not far below the largest, of all and relative to the diagonal; `None` if all are
/// rounding.
#[inline(always)]
fn next_pivot(left: &[f64], diagonal: &[f64], rounding: f64) -> Option<usize> {
    let least = left.iter().fold(rounding, |least, rest| least.max(FIRST_SIZE * rest));
    let mut most = 0.0f64;
    for (&rest, &whole) in left.iter().zip(diagonal) {
        most = most.max(if rest > least { rest / whole } else { 0.0 });
    }
    let may_follow = |(&rest, &whole): (&f64, &f64)| rest > least && rest >= FIRST_SHARE * most * whole;
    left.iter().zip(diagonal).position(may_follow)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `sum of v_k v_k'` of some vectors.
    fn gram(order: usize, count: usize) -> Matrix {
        let value = |row: usize, k: usize| ((row * row + row * k * k * 3) as f64).sin() * 10f64.powi(-(k as i32));
        let mut matrix = Matrix::zeros(order, order);
        for (row, column) in (0..order).flat_map(|row| (0..order).map(move |column| (row, column))) {
            *matrix.at_mut(row, column) = (0..count).map(|k| value(row, k) * value(column, k)).sum();
        }
        matrix
    }

    #[test]
    fn the_root_has_the_rank_of_its_matrix_and_gives_it_back() {
        for (order, count) in [(7, 3), (12, 12), (20, 5)] {
            let matrix = gram(order, count);
            let root = semidefinite_root(&matrix, 0.0).unwrap();
            // The vectors decrease by 100 in their squares; eight of them are above the tolerance.
            assert_eq!([root.rows, root.columns], [order, count.min(8)], "{order} {count}");
            let largest = matrix.values.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
            for (row, column) in (0..order).flat_map(|row| (0..order).map(move |column| (row, column))) {
                let product: f64 = root.row(row).iter().zip(root.row(column)).map(|(a, b)| a * b).sum();
                assert!((product - matrix.at(row, column)).abs() < 1e-13 * largest);
            }
            let first = |k: usize| (0..order).find(|&row| root.at(row, k) != 0.0);
            assert!((0..root.columns).is_sorted_by_key(first), "columns begin in the order of the rows");
        }
        assert_eq!(semidefinite_root(&Matrix::zeros(4, 4), 0.0).unwrap().columns, 0);
    }

    /// The first rows are almost in the null space of the others: their diagonal is small, and what is rounded is not.
    #[test]
    fn small_rows_whose_entries_are_rounded_as_large_ones_do_not_spoil_the_root() {
        let (order, count) = (12, 5);
        let mut matrix = gram(order, count);
        for row in 0..3 {
            for column in 0..order {
                let scale = if column < 3 { 1e-12 } else { 1e-6 };
                *matrix.at_mut(row, column) *= scale;
                *matrix.at_mut(column, row) = matrix.at(row, column);
            }
        }
        let largest = (0..order).fold(0.0f64, |largest, k| largest.max(matrix.at(k, k)));
        // Rounded relative to the largest value.
        let rounded = |value: f64| (value + 4.0 * largest) - 4.0 * largest;
        for (row, column) in (0..order).flat_map(|row| (0..order).map(move |column| (row, column))) {
            if row != column {
                *matrix.at_mut(row, column) = rounded(matrix.at(row, column));
            }
        }
        let root = semidefinite_root(&matrix, 0.0).expect("semidefinite but for rounding");
        for (row, column) in (0..order).flat_map(|row| (0..order).map(move |column| (row, column))) {
            let product: f64 = root.row(row).iter().zip(root.row(column)).map(|(a, b)| a * b).sum();
            assert!((product - matrix.at(row, column)).abs() < 1e-12 * largest, "{row} {column}");
        }
    }

    #[test]
    fn a_matrix_that_is_not_semidefinite_has_none() {
        let mut matrix = gram(6, 6);
        *matrix.at_mut(2, 2) = -1e-3;
        assert!(semidefinite_root(&matrix, 0.0).is_none());
        *matrix.at_mut(2, 2) = f64::NAN;
        assert!(semidefinite_root(&matrix, 0.0).is_none());
        let mut matrix = gram(6, 6);
        *matrix.at_mut(5, 0) = f64::INFINITY;
        *matrix.at_mut(0, 5) = f64::INFINITY;
        assert!(semidefinite_root(&matrix, 0.0).is_none());
    }
}
