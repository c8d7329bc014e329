//! Dense kernels: the partial factorisation of a front, and small symmetric matrices.

use super::factor::NotPositiveDefinite;
use super::matrix::Matrix;
use pulp::{Simd, WithSimd};

/// Number of pivots applied to a column together: the column's values are loaded once per four updates, so that the
/// speed is limited by arithmetic and not by memory.
const PANEL: usize = 4;

/// Eliminates the first `width` unknowns of a symmetric front in place.
///
/// `front` is column-major of order `height`; only its lower triangle is read and written. Afterwards its first `width`
/// columns contain the factor, and the rest the Schur complement. If a pivot is not positive, its index is returned.
#[inline(always)]
pub(super) fn eliminate(front: &mut [f64], height: usize, width: usize) -> Result<(), usize> {
    let mut first = 0;
    while first < width {
        let end = (first + PANEL).min(width);
        factor_panel(front, height, first, end)?;
        let (panel, rest) = front.split_at_mut(end * height);
        let panel = &panel[first * height..];
        if end - first == PANEL {
            for (column, target) in rest.chunks_exact_mut(height).enumerate() {
                subtract_four(panel, height, end + column, target);
            }
        } else {
            for (column, target) in rest.chunks_exact_mut(height).enumerate() {
                for pivot in panel.chunks_exact(height) {
                    subtract_one(pivot, end + column, target);
                }
            }
        }
        first = end;
    }
    Ok(())
}

/// Factors the columns `first..end` as a block.
#[inline(always)]
fn factor_panel(front: &mut [f64], height: usize, first: usize, end: usize) -> Result<(), usize> {
    for pivot in first..end {
        let (head, tail) = front.split_at_mut((pivot + 1) * height);
        let column = &mut head[pivot * height..];
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
        for (offset, target) in tail.chunks_exact_mut(height).take(end - pivot - 1).enumerate() {
            subtract_one(column, pivot + 1 + offset, target);
        }
    }
    Ok(())
}

/// `target[row..] -= pivot[row] * pivot[row..]`
#[inline(always)]
fn subtract_one(pivot: &[f64], row: usize, target: &mut [f64]) {
    let factor = pivot[row];
    for (value, below) in target[row..].iter_mut().zip(&pivot[row..]) {
        *value -= factor * below;
    }
}

/// [`subtract_one`] for four pivots.
#[inline(always)]
fn subtract_four(panel: &[f64], height: usize, row: usize, target: &mut [f64]) {
    let (a, rest) = panel.split_at(height);
    let (b, rest) = rest.split_at(height);
    let (c, d) = rest.split_at(height);
    let factors = [a[row], b[row], c[row], d[row]];
    let (a, b, c, d) = (&a[row..], &b[row..], &c[row..], &d[row..height]);
    for ((((value, a), b), c), d) in target[row..].iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *value -= factors[0] * a + factors[1] * b + (factors[2] * c + factors[3] * d);
    }
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
    let outcome = pulp::Arch::new().dispatch(EliminateDense { values, order, width });
    outcome.map_err(|unknown| NotPositiveDefinite { unknown })
}

/// The Cholesky factor of a symmetric positive definite matrix, in its lower triangle; the upper one is not changed.
///
/// # Errors
/// The index of a pivot that is not positive.
///
/// # Panics
/// If the matrix is not square.
pub fn cholesky_in_place(matrix: &mut Matrix) -> Result<(), NotPositiveDefinite> {
    assert_eq!(matrix.rows, matrix.columns, "a square matrix");
    let order = matrix.rows;
    transpose(matrix);
    let outcome = pulp::Arch::new().dispatch(EliminateDense { values: &mut matrix.values, order, width: order });
    transpose(matrix);
    outcome.map_err(|unknown| NotPositiveDefinite { unknown })
}

struct EliminateDense<'a> {
    values: &'a mut [f64],
    order: usize,
    width: usize,
}

impl WithSimd for EliminateDense<'_> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        eliminate(self.values, self.order, self.width)
    }
}

fn transpose(matrix: &mut Matrix) {
    let order = matrix.rows;
    for i in 0..order {
        for j in 0..i {
            matrix.values.swap(i * order + j, j * order + i);
        }
    }
}

/// The inverse of a symmetric positive definite matrix, both triangles.
///
/// # Errors
/// The index of a pivot that is not positive.
///
/// # Panics
/// If the matrix is not square.
pub fn invert_spd(matrix: &Matrix) -> Result<Matrix, NotPositiveDefinite> {
    let order = matrix.rows;
    let mut factor = matrix.clone();
    cholesky_in_place(&mut factor)?;
    // Rows of `inverse` are the solutions for the unit vectors; the matrix is symmetric, so rows are columns.
    let mut inverse = Matrix::zeros(order, order);
    for unit in 0..order {
        let x = inverse.row_mut(unit);
        x[unit] = 1.0;
        for i in unit..order {
            let row = factor.row(i);
            let sum: f64 = (unit..i).map(|j| row[j] * x[j]).sum();
            x[i] = (x[i] - sum) / row[i];
        }
        for i in (0..order).rev() {
            x[i] /= factor.at(i, i);
            let value = x[i];
            for (j, x) in x[..i].iter_mut().enumerate() {
                *x -= factor.at(i, j) * value;
            }
        }
    }
    Ok(inverse)
}
