//! Correlations between the columns of a table.

use dermis::frame::Frame;
use dermis::stats::{mean_and_sd, upper_median};
use faer::Mat;

/// Smallest unit of a channel, in its standard deviations.
const MIN_UNIT: f64 = 0.1;

/// The columns with mean 0 and mean square 1; constant ones become 0.
pub(crate) fn standardised(values: &Mat<f64>) -> Mat<f64> {
    let rows = values.nrows() as f64;
    let mut result = values.clone();
    for j in 0..result.ncols() {
        let mean = values.col(j).iter().sum::<f64>() / rows;
        let square = values.col(j).iter().map(|value| (value - mean).powi(2)).sum::<f64>() / rows;
        // Relative to the mean, so that rounding errors of a constant are no signal.
        let factor = if square > 1e-20 * mean * mean { 1.0 / square.sqrt() } else { 0.0 };
        result.col_mut(j).iter_mut().for_each(|value| *value = (*value - mean) * factor);
    }
    result
}

/// Frames in units of their channels, as `ChannelUnits`; a channel whose median deviation is small against its standard
/// deviation (most presses do not reach it) has a unit from that.
pub(crate) fn in_robust_units(frames: &[Frame]) -> Mat<f64> {
    let columns = frames.first().map_or(0, |frame| frame.len());
    let mut values = Mat::from_fn(frames.len(), columns, |i, j| frames[i][j]);
    for j in 0..columns {
        let column: Vec<f64> = values.col(j).iter().copied().collect();
        let middle = upper_median(&column).unwrap_or(0.0);
        let apart: Vec<f64> = column.iter().map(|value| (value - middle).abs()).collect();
        let unit = (1.4826 * upper_median(&apart).unwrap_or(0.0)).max(MIN_UNIT * mean_and_sd(&column).1);
        let convert = |value: f64| if unit > 0.0 { ((value - middle) / unit).asinh() } else { 0.0 };
        values.col_mut(j).iter_mut().for_each(|value| *value = convert(*value));
    }
    values
}

/// The correlation of each two columns of a standardised table.
pub(crate) fn correlations(standardised: &Mat<f64>) -> Mat<f64> {
    let rows = standardised.nrows().max(1) as f64;
    let mut product = standardised.transpose() * standardised;
    for j in 0..product.ncols() {
        product.col_mut(j).iter_mut().for_each(|value| *value /= rows);
    }
    product
}

/// The cosine of the angle between two vectors; 0 where one of them is 0.
pub(crate) fn cosine(a: impl IntoIterator<Item = f64>, b: impl IntoIterator<Item = f64>) -> f64 {
    let (mut product, mut squares) = (0.0, [0.0; 2]);
    for (a, b) in a.into_iter().zip(b) {
        product += a * b;
        squares[0] += a * a;
        squares[1] += b * b;
    }
    let norms = (squares[0] * squares[1]).sqrt();
    if norms > 0.0 { product / norms } else { 0.0 }
}

/// The rows with norm 1; rows of zeros stay zero.
pub(crate) fn unit_rows(values: &Mat<f64>) -> Mat<f64> {
    let norm = |i: usize| values.row(i).iter().map(|value| value * value).sum::<f64>().sqrt();
    let norms: Vec<f64> = (0..values.nrows()).map(norm).collect();
    Mat::from_fn(values.nrows(), values.ncols(), |i, j| if norms[i] > 0.0 { values[(i, j)] / norms[i] } else { 0.0 })
}

/// A matrix as rows of numbers.
pub(crate) fn to_rows(matrix: &Mat<f64>) -> Vec<Vec<f64>> {
    (0..matrix.nrows()).map(|i| matrix.row(i).iter().copied().collect()).collect()
}

/// Rows of numbers as a matrix.
pub(crate) fn to_matrix(rows: &[Vec<f64>]) -> Mat<f64> {
    Mat::from_fn(rows.len(), rows.first().map_or(0, Vec::len), |i, j| rows[i][j])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_are_those_of_the_columns() {
        let values = Mat::from_fn(100, 3, |i, j| match j {
            0 => i as f64,
            1 => -2.0 * i as f64 + 7.0,
            _ => 4.0,
        });
        let found = correlations(&standardised(&values));
        assert!((found[(0, 1)] + 1.0).abs() < 1e-12 && (found[(0, 0)] - 1.0).abs() < 1e-12);
        assert_eq!(found[(0, 2)], 0.0, "a constant has no correlation");
        assert!((cosine([1.0, 0.0], [1.0, 1.0]) - 0.5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(cosine([0.0], [1.0]), 0.0);
    }
}
