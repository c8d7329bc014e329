//! Covariance of residuals from fewer samples than channels.

use faer::Mat;

/// The covariance of residuals (samples x channels, mean zero) with its correlations shrunk towards zero by the factor
/// of least expected error (Ledoit and Wolf 2004, DOI 10.1016/S0047-259X(03)00096-4; for correlations Schaefer and
/// Strimmer 2005, DOI 10.2202/1544-6115.1175).
pub(crate) fn shrunk_covariance(residuals: &Mat<f64>) -> Mat<f64> {
    let (samples, channels) = (residuals.nrows(), residuals.ncols());
    let count = samples as f64;
    let variance = |channel: usize| {
        let square: f64 = residuals.col(channel).iter().map(|value| value * value).sum();
        // A channel that is constant has no residual; it gets the smallest weight that keeps the matrix regular.
        (square / count).max(f64::MIN_POSITIVE)
    };
    let sd: Vec<f64> = (0..channels).map(|channel| variance(channel).sqrt()).collect();
    let unit = Mat::from_fn(samples, channels, |i, j| residuals[(i, j)] / sd[j]);
    let squares = Mat::from_fn(samples, channels, |i, j| unit[(i, j)] * unit[(i, j)]);
    let correlation = unit.transpose() * &unit;
    let fourth = squares.transpose() * &squares;
    let (mut error, mut signal) = (0.0, 0.0);
    for i in 0..channels {
        for j in 0..i {
            let value = correlation[(i, j)] / count;
            error += (fourth[(i, j)] / count - value * value).max(0.0) / count;
            signal += value * value;
        }
    }
    let kept = if signal > 0.0 { (1.0 - error / signal).clamp(0.0, 1.0) } else { 0.0 };
    Mat::from_fn(channels, channels, |i, j| {
        let value = if i == j { 1.0 } else { kept * correlation[(i, j)] / count };
        value * sd[i] * sd[j]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Samples of two correlated channels and independent ones.
    fn samples(count: usize, channels: usize) -> Mat<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let mut values = Mat::from_fn(count, channels, |_, _| normal());
        for i in 0..count {
            values[(i, 1)] = 2.0 * (0.9 * values[(i, 0)] + 0.19_f64.sqrt() * values[(i, 1)]);
        }
        values
    }

    #[test]
    fn many_samples_give_the_true_covariance() {
        let covariance = shrunk_covariance(&samples(20_000, 5));
        assert!((covariance[(0, 1)] - 1.8).abs() < 0.06, "{}", covariance[(0, 1)]);
        assert!((covariance[(1, 1)] - 4.0).abs() < 0.15 && covariance[(2, 3)].abs() < 0.02);
    }

    #[test]
    fn few_samples_give_a_regular_matrix() {
        let covariance = shrunk_covariance(&samples(10, 40));
        assert!(covariance.llt(faer::Side::Lower).is_ok());
    }
}
