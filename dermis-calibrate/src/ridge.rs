//! Linear regression with a ridge.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// A linear prediction of some targets.
#[derive(Debug, Clone)]
pub(crate) struct Regression {
    /// Inputs x targets.
    pub weights: Mat<f64>,
    /// One offset per target.
    pub offsets: Vec<f64>,
}

impl Regression {
    /// The least squares fit of targets (rows x targets) by inputs (rows x inputs) with a ridge of `ridge` times the
    /// number of rows (Hoerl and Kennard 1970, DOI 10.1080/00401706.1970.10488634). `None` where the equations are
    /// singular.
    pub(crate) fn fit(input: &Mat<f64>, target: &Mat<f64>, ridge: f64) -> Option<Self> {
        let rows = input.nrows() as f64;
        let means = |matrix: &Mat<f64>| -> Vec<f64> {
            (0..matrix.ncols()).map(|j| matrix.col(j).iter().sum::<f64>() / rows).collect()
        };
        let (input_means, target_means) = (means(input), means(target));
        let centred = |matrix: &Mat<f64>, means: &[f64]| {
            Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] - means[j])
        };
        let (input, target) = (centred(input, &input_means), centred(target, &target_means));
        let mut matrix = input.transpose() * &input;
        for k in 0..matrix.nrows() {
            matrix[(k, k)] += ridge * rows + f64::MIN_POSITIVE;
        }
        let weights = matrix.llt(Side::Lower).ok()?.solve(input.transpose() * target);
        let offset = |j: usize| {
            target_means[j] - weights.col(j).iter().zip(&input_means).map(|(weight, mean)| weight * mean).sum::<f64>()
        };
        let offsets = (0..weights.ncols()).map(offset).collect();
        Some(Regression { weights, offsets })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_relation_is_found() {
        let input = Mat::from_fn(50, 2, |i, j| ((i * (j + 2)) as f64).sin());
        let target = Mat::from_fn(50, 1, |i, _| 3.0 * input[(i, 0)] - 2.0 * input[(i, 1)] + 1.5);
        let found = Regression::fit(&input, &target, 0.0).unwrap();
        assert!((found.weights[(0, 0)] - 3.0).abs() < 1e-9 && (found.weights[(1, 0)] + 2.0).abs() < 1e-9);
        assert!((found.offsets[0] - 1.5).abs() < 1e-9);
    }
}
