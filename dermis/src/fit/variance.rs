//! Variance of the model in a group of channels.

use crate::stats::bisect;

/// Least standard deviation, relative to the values of the group: the rounding of the forward model.
const ROUNDING: f64 = 1e-10;

/// The least variance of a channel of a group.
pub(super) fn least_variance(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value * value, count + 1));
    ROUNDING * ROUNDING * sum / count.max(1) as f64 + f64::MIN_POSITIVE
}

/// The variance of the model in a group at which the weighted squares of the residuals equal their degrees of freedom
/// (Paule and Mandel, 1982, DOI 10.6028/jres.087.022); 0 where the noise explains them.
pub(super) fn model_variance(squares: &[f64], noise: &[f64], freedom: f64) -> f64 {
    let total = squares.iter().sum::<f64>();
    let excess = |variance: f64| squares.iter().zip(noise).map(|(square, own)| square / (own + variance)).sum::<f64>();
    if freedom <= 0.0 || total == 0.0 || excess(0.0) <= freedom {
        return 0.0;
    }
    // The sum falls with the variance, and is below the degrees of freedom at the upper end.
    bisect([0.0, total / freedom], 100, |variance| excess(variance) <= freedom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_noise_gives_the_excess_of_the_mean_square() {
        let (squares, noise) = ([4.0, 9.0, 5.0], [1.0; 3]);
        assert!((model_variance(&squares, &noise, 2.0) - 8.0).abs() < 1e-9);
        assert_eq!(model_variance(&squares, &[9.0; 3], 2.0), 0.0);
        assert_eq!(model_variance(&squares, &noise, 0.0), 0.0);
    }
}
