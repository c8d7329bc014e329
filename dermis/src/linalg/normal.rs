//! Normal equations of small least-squares problems.
//!
//! Scalar products have eight sums each, so that they have the same bits on every instruction set.

use super::dense::cholesky_in_place;
use super::matrix::Matrix;
use pulp::{Arch, Simd, WithSimd};

/// The scalar products of all pairs of columns.
pub(crate) fn gram(columns: &[&[f64]]) -> Matrix {
    let mut gram = Matrix::zeros(columns.len(), columns.len());
    for (i, column) in columns.iter().enumerate() {
        for (j, product) in products(&columns[..=i], column).into_iter().enumerate() {
            *gram.at_mut(i, j) = product;
            *gram.at_mut(j, i) = product;
        }
    }
    gram
}

/// The scalar product of each column with some values.
pub(crate) fn products(columns: &[&[f64]], values: &[f64]) -> Vec<f64> {
    let mut products = vec![0.0; columns.len()];
    Arch::new().dispatch(Products { columns, values, products: &mut products });
    products
}

/// The scalar product of two columns.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut product = [0.0];
    Arch::new().dispatch(Products { columns: &[a], values: b, products: &mut product });
    product[0]
}

/// Adds a column times a factor to some values.
pub(crate) fn add_scaled(values: &mut [f64], factor: f64, column: &[f64]) {
    Arch::new().dispatch(AddScaled { values, factor, column });
}

struct Products<'a> {
    columns: &'a [&'a [f64]],
    values: &'a [f64],
    products: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (fours, rest) = self.columns.as_chunks::<4>();
        let (of_fours, of_rest) = self.products.as_chunks_mut::<4>();
        for (columns, products) in fours.iter().zip(of_fours) {
            *products = dots(columns, self.values);
        }
        for (column, product) in rest.iter().zip(of_rest) {
            [*product] = dots(&[column], self.values);
        }
    }
}

/// The scalar products of some columns with the same values: side by side, they hide each other's latency.
#[inline(always)]
fn dots<const N: usize>(columns: &[&[f64]; N], values: &[f64]) -> [f64; N] {
    const SUMS: usize = 8;
    let (eights, rest) = values.as_chunks::<SUMS>();
    let mut own = [[].as_slice(); N];
    for (own, column) in own.iter_mut().zip(columns) {
        *own = &column.as_chunks::<SUMS>().0[..eights.len()];
    }
    let mut sums = [[0.0; SUMS]; N];
    for (index, values) in eights.iter().enumerate() {
        for column in 0..N {
            let factors = &own[column][index];
            for lane in 0..SUMS {
                sums[column][lane] += factors[lane] * values[lane];
            }
        }
    }
    let mut products = [0.0; N];
    for column in 0..N {
        let last = columns[column][values.len() - rest.len()..].iter().zip(rest).map(|(a, b)| a * b).sum::<f64>();
        products[column] = sums[column].iter().sum::<f64>() + last;
    }
    products
}

struct AddScaled<'a> {
    values: &'a mut [f64],
    factor: f64,
    column: &'a [f64],
}

impl WithSimd for AddScaled<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (value, column) in self.values.iter_mut().zip(self.column) {
            *value += self.factor * column;
        }
    }
}

/// The solution of a symmetric positive definite system, scaled to a unit diagonal first: its unknowns may have different
/// units. `None` where the matrix is not positive definite.
pub(crate) fn solve_scaled(normal: &Matrix, right: &[f64]) -> Option<Vec<f64>> {
    let count = normal.rows;
    let scale: Vec<f64> = (0..count).map(|i| normal.at(i, i).sqrt().recip()).collect();
    if scale.iter().any(|scale| !scale.is_finite()) {
        return None;
    }
    let mut factor = normal.clone();
    for i in 0..count {
        (0..count).for_each(|j| *factor.at_mut(i, j) *= scale[i] * scale[j]);
    }
    cholesky_in_place(&mut factor).ok()?;
    let mut x: Vec<f64> = right.iter().zip(&scale).map(|(value, scale)| value * scale).collect();
    for i in 0..count {
        let known: f64 = (0..i).map(|j| factor.at(i, j) * x[j]).sum();
        x[i] = (x[i] - known) / factor.at(i, i);
    }
    for i in (0..count).rev() {
        let known: f64 = (i + 1..count).map(|j| factor.at(j, i) * x[j]).sum();
        x[i] = (x[i] - known) / factor.at(i, i);
    }
    x.iter_mut().zip(&scale).for_each(|(value, scale)| *value *= scale);
    x.iter().all(|value| value.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(count: usize, length: usize) -> Vec<Vec<f64>> {
        let value = |column: usize, row: usize| ((3 * column + 7 * row * row) as f64).sin();
        (0..count).map(|column| (0..length).map(|row| value(column, row)).collect()).collect()
    }

    #[test]
    fn products_of_any_number_and_length_are_the_sums() {
        for (count, length) in [(1, 0), (3, 7), (4, 8), (6, 435), (9, 17)] {
            let all = columns(count + 1, length);
            let (values, own) = all.split_last().unwrap();
            let own: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
            for (column, product) in own.iter().zip(products(&own, values)) {
                let exact: f64 = column.iter().zip(values).map(|(a, b)| a * b).sum();
                assert!((product - exact).abs() < 1e-12 * (1.0 + length as f64), "{count} {length}");
                assert_eq!(product, dot(column, values), "in groups and alone");
            }
            assert_eq!(gram(&own).rows, count);
        }
    }

    /// Columns of units that differ by 1e9.
    #[test]
    fn the_solution_satisfies_the_normal_equations() {
        let mut all = columns(5, 40);
        all[1].iter_mut().for_each(|value| *value *= 1e9);
        let values = all.pop().unwrap();
        let own: Vec<&[f64]> = all.iter().map(Vec::as_slice).collect();
        let solution = solve_scaled(&gram(&own), &products(&own, &values)).unwrap();
        let mut residuals = values.clone();
        for (column, factor) in own.iter().zip(&solution) {
            add_scaled(&mut residuals, -factor, column);
        }
        for column in &own {
            assert!(dot(column, &residuals).abs() < 1e-9 * dot(column, column).sqrt());
        }
        let dependent = [own[0], own[0]];
        assert!(solve_scaled(&gram(&dependent), &products(&dependent, &values)).is_none());
    }
}
