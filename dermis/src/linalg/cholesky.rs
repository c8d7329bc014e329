//! The Cholesky factor of a small dense matrix.

use super::dense::factor_lower;
use super::factor::NotPositiveDefinite;
use super::matrix::Matrix;
use super::normal::{add_scaled, dot};

/// The factor `L` of a symmetric positive definite matrix `A = L L'`.
///
/// Scaling the unknowns of a system does not change the accuracy of its solution by this factor (van der Sluis, 1969, DOI
/// 10.1007/BF02165096), so they may have any units.
///
/// ```
/// use dermis::linalg::{Cholesky, Matrix};
///
/// let matrix = Matrix { rows: 2, columns: 2, values: vec![4.0, 2.0, 2.0, 3.0] };
/// let factor = Cholesky::new(&matrix)?;
/// assert!((factor.solve(&[8.0, 8.0])[0] - 1.0).abs() < 1e-12); // (1, 2)
/// assert!((factor.log_determinant() - 8f64.ln()).abs() < 1e-12);
/// # Ok::<(), dermis::linalg::NotPositiveDefinite>(())
/// ```
#[derive(Debug, Clone)]
pub struct Cholesky {
    /// In the lower triangle.
    factor: Matrix,
}

impl Cholesky {
    /// The factor of a matrix, of which only the lower triangle is read.
    ///
    /// # Errors
    /// The index of a pivot that is not positive.
    ///
    /// # Panics
    /// If the matrix is not square.
    pub fn new(matrix: &Matrix) -> Result<Self, NotPositiveDefinite> {
        let mut factor = matrix.clone();
        factor_lower(&mut factor)?;
        Ok(Cholesky { factor })
    }

    /// The factor of a matrix whose unknowns are to be determined: a pivot that is no more than the rounding errors of its
    /// diagonal entry is an error, too.
    ///
    /// # Errors
    /// The index of the first unknown that is not determined.
    ///
    /// # Panics
    /// If the matrix is not square.
    pub fn determined(matrix: &Matrix) -> Result<Self, NotPositiveDefinite> {
        let factor = Cholesky::new(matrix)?;
        let rounding = matrix.rows as f64 * f64::EPSILON;
        let is_vague = |&i: &usize| factor.factor.at(i, i).powi(2) <= rounding * matrix.at(i, i);
        match (0..matrix.rows).find(is_vague) {
            Some(unknown) => Err(NotPositiveDefinite { unknown }),
            None => Ok(factor),
        }
    }

    /// The solution `x` of `A x = b`.
    ///
    /// # Panics
    /// If the length of `b` is not the order of the matrix.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        assert_eq!(right.len(), self.factor.rows, "a value per unknown");
        let mut x = right.to_vec();
        self.forward_substitute(&mut x);
        for i in (0..x.len()).rev() {
            let (before, rest) = x.split_at_mut(i);
            rest[0] /= self.factor.at(i, i);
            add_scaled(before, -rest[0], &self.factor.row(i)[..i]);
        }
        x
    }

    /// Replaces `b` by the solution of `L x = b`.
    pub(crate) fn forward_substitute(&self, x: &mut [f64]) {
        for i in 0..x.len() {
            let row = self.factor.row(i);
            x[i] = (x[i] - dot(&row[..i], &x[..i])) / row[i];
        }
    }

    /// `A^-1`, both triangles: a covariance, or a transfer impedance. Systems are [solved](Self::solve) without it.
    pub fn inverse(&self) -> Matrix {
        let (order, factor) = (self.factor.rows, &self.factor);
        // Rows are the solutions for the unit vectors; the matrix is symmetric, so rows are columns.
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
        inverse
    }

    /// The logarithm of the determinant of the matrix.
    pub fn log_determinant(&self) -> f64 {
        2.0 * (0..self.factor.rows).map(|i| self.factor.at(i, i).ln()).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unknowns whose units differ by up to 1e9.
    #[test]
    fn the_solution_satisfies_the_system_and_dependent_unknowns_are_named() {
        let count = 7;
        let entry =
            |i: usize, j: usize| ((3 * i * j + i + j) as f64).sin() / count as f64 + f64::from(u8::from(i == j));
        let unit = |i: usize| 10f64.powi(3 * (i % 4) as i32);
        let mut matrix = Matrix::zeros(count, count);
        (0..count * count).for_each(|k| {
            let (i, j) = (k / count, k % count);
            *matrix.at_mut(i, j) = unit(i) * unit(j) * entry(i, j);
        });
        let right: Vec<f64> = (0..count).map(|i| unit(i) * (i as f64 - 2.2)).collect();
        let factor = Cholesky::determined(&matrix).unwrap();
        let (x, by_inverse) = (factor.solve(&right), factor.inverse());
        for i in 0..count {
            let left: f64 = (0..count).map(|j| matrix.at(i, j) * x[j]).sum();
            assert!((left - right[i]).abs() < 1e-12 * unit(i), "{i}: {left}");
            let same: f64 = (0..count).map(|j| by_inverse.at(i, j) * right[j]).sum();
            assert!((same - x[i]).abs() < 1e-12 / unit(i), "{i}: {same}");
        }
        // The last unknown acts as the first one.
        for i in 0..count {
            let value = matrix.at(i, 0);
            *matrix.at_mut(i, count - 1) = value;
            *matrix.at_mut(count - 1, i) = value;
        }
        *matrix.at_mut(count - 1, count - 1) = matrix.at(0, 0);
        assert_eq!(Cholesky::determined(&matrix).unwrap_err().unknown, count - 1);
    }
}
