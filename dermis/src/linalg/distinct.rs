//! A matrix that has some columns twice.

use super::matrix::Matrix;
use super::normal::products;

/// Columns whose differences are less than this part of their largest value are equal.
const EQUAL: f64 = 1e-9;

/// The distinct columns of a matrix: those that are equal or opposite, as those of reciprocal channels are, are one. A product with
/// them reads half as much memory.
#[derive(Debug, Clone)]
pub(crate) struct DistinctColumns {
    /// By column of the matrix, the distinct one and the factor, 1 or -1.
    of_column: Vec<(usize, f64)>,
    count: usize,
}

impl DistinctColumns {
    /// Those of a matrix, with the matrix of them.
    pub(crate) fn of(matrix: &Matrix) -> (Self, Matrix) {
        let columns = matrix.transposed();
        let column = |index: usize| columns.row(index);
        let size = |index: usize| column(index).iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
        // Equal columns have neighbouring products with a vector without structure.
        let probe: Vec<f64> = (0..matrix.rows).map(|row| (1.0 + row as f64 * row as f64).sin()).collect();
        let all: Vec<&[f64]> = (0..matrix.columns).map(column).collect();
        let marks: Vec<f64> = products(&all, &probe);
        let mut order: Vec<usize> = (0..matrix.columns).collect();
        order.sort_by(|&a, &b| marks[a].abs().total_cmp(&marks[b].abs()));
        let mut of_column = vec![(0, 1.0); matrix.columns];
        let mut distinct: Vec<usize> = Vec::new();
        for index in order {
            let of_last = distinct.last().and_then(|&last| {
                let least = EQUAL * size(last);
                let is_near =
                    |sign: f64| column(last).iter().zip(column(index)).all(|(a, b)| (a - sign * b).abs() <= least);
                [1.0, -1.0].into_iter().find(|&sign| is_near(sign))
            });
            if of_last.is_none() {
                distinct.push(index);
            }
            of_column[index] = (distinct.len() - 1, of_last.unwrap_or(1.0));
        }
        let rows = (0..matrix.rows).flat_map(|row| distinct.iter().map(move |&index| matrix.at(row, index)));
        let of_distinct = Matrix { rows: matrix.rows, columns: distinct.len(), values: rows.collect() };
        (DistinctColumns { of_column, count: distinct.len() }, of_distinct)
    }

    /// What is multiplied with the distinct columns in place of a vector.
    pub(crate) fn sums(&self, vector: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.count];
        self.of_column.iter().zip(vector).for_each(|((distinct, sign), value)| sums[*distinct] += sign * value);
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_whole_matrix() {
        let value = |row: usize, column: usize| ((3 * row + 1) as f64 * (column + 2) as f64).sin();
        // Two columns of each kind, one of them opposite, one that is zero, and one that is alone.
        let column = |row: usize, column: usize| match column {
            0..6 => value(row, column / 2) * if column == 3 { -1.0 } else { 1.0 } * (1.0 + 1e-14 * column as f64),
            6 => 0.0,
            _ => value(row, column),
        };
        let (rows, columns) = (5, 8);
        let values = (0..rows * columns).map(|k| column(k / columns, k % columns)).collect();
        let matrix = Matrix { rows, columns, values };
        let (distinct, of_distinct) = DistinctColumns::of(&matrix);
        assert_eq!(of_distinct.columns, 5);
        let vector: Vec<f64> = (0..columns).map(|k| (k as f64).cos()).collect();
        let [mut whole, mut found] = [[0.0; 5]; 2];
        matrix.product_into(&vector, &mut whole);
        of_distinct.product_into(&distinct.sums(&vector), &mut found);
        assert!(whole.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-12), "{whole:?} {found:?}");
    }
}
