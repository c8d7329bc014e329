//! Variances of the channels: of the mean of the frames, and of the model.

use crate::frame::Frame;

/// The scatter of all channels of a group counts as this many frames of a channel's own.
const POOLED_FRAMES: f64 = 32.0;

/// Least standard deviation, relative to the values of the group: the rounding of the forward model.
const ROUNDING: f64 = 1e-10;

/// The variance of the mean of the frames in each channel, from their scatter; 0 for a single frame.
///
/// The scatter of a channel over few frames is uncertain, so it is averaged with that of its group.
pub(super) fn variances_of_mean(frames: &[Frame], mean: &[f64], groups: &[Vec<usize>]) -> Vec<f64> {
    let count = frames.len() as f64;
    let mut variances = vec![0.0; mean.len()];
    if frames.len() < 2 {
        return variances;
    }
    for group in groups {
        let squares = |&channel: &usize| frames.iter().map(|f| (f[channel] - mean[channel]).powi(2)).sum::<f64>();
        let squares: Vec<f64> = group.iter().map(squares).collect();
        let pooled = squares.iter().sum::<f64>() / ((count - 1.0) * group.len().max(1) as f64);
        for (&channel, own) in group.iter().zip(&squares) {
            variances[channel] = (POOLED_FRAMES * pooled + own) / (POOLED_FRAMES + count - 1.0) / count;
        }
    }
    variances
}

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
    let (mut low, mut high) = (0.0, total / freedom);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if excess(middle) > freedom { low = middle } else { high = middle }
    }
    high
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

    #[test]
    fn the_scatter_of_few_frames_is_pooled() {
        let frames = [Frame(vec![1.0, 5.0]), Frame(vec![3.0, 5.0])];
        let variances = variances_of_mean(&frames, &[2.0, 5.0], &[vec![0, 1]]);
        // Squares 2 and 0, pooled 1; the mean of two frames has half of the variance.
        assert_eq!(variances, [(32.0 + 2.0) / 33.0 / 2.0, 32.0 / 33.0 / 2.0]);
        assert_eq!(variances_of_mean(&frames[..1], &[1.0, 5.0], &[vec![0, 1]]), [0.0; 2]);
    }
}
