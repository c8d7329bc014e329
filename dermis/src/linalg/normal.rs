//! Normal equations of small least-squares problems.
//!
//! Scalar products have eight sums each, so that they have the same bits on every instruction set.

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

/// The scalar product of two lists of one length, in eight sums.
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
}
