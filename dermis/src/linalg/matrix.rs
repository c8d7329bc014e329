//! A dense matrix in row-major order.

use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

/// A dense matrix in row-major order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Matrix {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Row-major values.
    pub values: Vec<f64>,
}

impl Matrix {
    /// A matrix of zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Matrix { rows, columns, values: vec![0.0; rows * columns] }
    }

    /// The identity.
    pub fn identity(order: usize) -> Self {
        let mut identity = Matrix::zeros(order, order);
        (0..order).for_each(|at| *identity.at_mut(at, at) = 1.0);
        identity
    }

    /// One row.
    #[inline]
    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.columns..(row + 1) * self.columns]
    }

    /// One row, mutable.
    #[inline]
    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.values[row * self.columns..(row + 1) * self.columns]
    }

    /// One value.
    #[inline]
    pub fn at(&self, row: usize, column: usize) -> f64 {
        self.values[row * self.columns + column]
    }

    /// One value, mutable.
    #[inline]
    pub fn at_mut(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.values[row * self.columns + column]
    }

    /// The transposed matrix.
    pub fn transposed(&self) -> Matrix {
        let mut transposed = Matrix::zeros(self.columns, self.rows);
        for i in 0..self.rows {
            self.row(i).iter().enumerate().for_each(|(j, value)| *transposed.at_mut(j, i) = *value);
        }
        transposed
    }

    /// The product with a matrix of as many rows as this has columns.
    pub fn times(&self, other: &Matrix) -> Matrix {
        assert_eq!(self.columns, other.rows, "the sizes match");
        let mut product = Matrix::zeros(self.rows, other.columns);
        pulp::Arch::new().dispatch(Times { a: self, b: other, product: &mut product });
        product
    }

    /// The product with a vector, written to `out`.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn product_into(&self, vector: &[f64], out: &mut [f64]) {
        assert_eq!(vector.len(), self.columns, "vector length");
        assert_eq!(out.len(), self.rows, "output length");
        pulp::Arch::new().dispatch(Product { matrix: self, vector, out });
    }
}

/// Rows of the second factor that are used for all rows of the product while they are in the cache.
const BLOCK: usize = 64;

struct Times<'a> {
    a: &'a Matrix,
    b: &'a Matrix,
    product: &'a mut Matrix,
}

impl WithSimd for Times<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let columns = self.b.columns.max(1);
        for (block, rows) in self.b.values.chunks(BLOCK * columns).enumerate() {
            let rows_of_product = self.product.values.chunks_exact_mut(columns);
            for (sums, factors) in rows_of_product.zip(self.a.values.chunks_exact(self.a.columns.max(1))) {
                let factors = &factors[block * BLOCK..];
                for (factors, rows) in factors.chunks(UNROLLED).zip(rows.chunks(UNROLLED * columns)) {
                    add_rows(sums, factors, rows);
                }
            }
        }
    }
}

/// Rows that are added in one pass over the sums.
const UNROLLED: usize = 4;

/// Adds rows times factors in their order, as one after the other.
#[inline(always)]
fn add_rows(sums: &mut [f64], factors: &[f64], rows: &[f64]) {
    let columns = sums.len();
    if let &[a, b, c, d] = factors {
        let (first, second) = rows.split_at(2 * columns);
        let ((r, s), (t, u)) = (first.split_at(columns), second.split_at(columns));
        for ((((sum, r), s), t), u) in sums.iter_mut().zip(r).zip(s).zip(t).zip(u) {
            *sum = (((*sum + a * r) + b * s) + c * t) + d * u;
        }
    } else {
        for (factor, row) in factors.iter().zip(rows.chunks_exact(columns)) {
            sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += factor * value);
        }
    }
}

struct Product<'a> {
    matrix: &'a Matrix,
    vector: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (value, row) in self.out.iter_mut().zip(self.matrix.values.chunks_exact(self.matrix.columns)) {
            *value = lane_dot(row, self.vector);
        }
    }
}

/// A scalar product summed in eight lanes, so that every instruction set gives the same bits.
#[inline(always)]
fn lane_dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (a_chunks, b_chunks) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        for lane in 0..8 {
            lanes[lane] += x[lane] * y[lane];
        }
    }
    lanes.iter().sum::<f64>() + tail
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sizes below, at and above those of the blocks.
    #[test]
    fn products_are_sums_in_order() {
        let matrix = |rows: usize, columns: usize| {
            let values = (0..rows * columns).map(|k| (k as f64 * 0.7).sin()).collect();
            Matrix { rows, columns, values }
        };
        for (rows, inner, columns) in [(3, 1, 5), (2, 64, 7), (5, 67, 9), (1, 131, 1), (4, 0, 3), (0, 5, 2)] {
            let (a, b) = (matrix(rows, inner), matrix(inner, columns));
            let product = a.times(&b);
            assert_eq!((product.rows, product.columns), (rows, columns));
            for i in 0..rows {
                for j in 0..columns {
                    let expected = (0..inner).fold(0.0, |sum, k| sum + a.at(i, k) * b.at(k, j));
                    assert_eq!(product.at(i, j), expected, "{rows} x {inner} x {columns}");
                }
            }
        }
    }
}
