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
        for i in 0..self.rows {
            let target = product.row_mut(i);
            for (factor, row) in self.row(i).iter().zip(other.values.chunks_exact(other.columns)) {
                target.iter_mut().zip(row).for_each(|(sum, value)| *sum += factor * value);
            }
        }
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
