//! Means, standard deviations, quantiles and ranks of samples.
//!
//! Conventions:
//! - A standard deviation is that of a population: the sum of squares is divided by the number of values n, not n - 1.
//! - [`quantile`] interpolates linearly between the two nearest values (type 7 of Hyndman and Fan, 1996, DOI
//!   10.2307/2684934). The others give a value of the sample: [`inverse_cdf_quantile`] the smallest value with at least
//!   the given fraction of the sample at or below it (type 1), [`nearest_quantiles`] the one nearest to the
//!   interpolated rank, [`upper_median`] the upper one of the two middle values.
//! - Means and deviations of an empty sample are `NaN`.
//!
//! ```
//! use dermis::stats::{Summary, quantile, upper_median};
//!
//! let sample = [1.0, 2.0, 3.0, 4.0];
//! assert_eq!(Summary::of(&sample).mean, 2.5);
//! assert_eq!((quantile(&sample, 0.5), upper_median(&sample)), (2.5, Some(3.0)));
//! ```

use serde::Serialize;
use std::cmp::Ordering;

/// Mean, standard deviation, median, 95th percentile and mean of the largest tenth of a sample; `NaN` (in JSON `null`) if
/// it is empty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// The mean.
    pub mean: f64,
    /// The standard deviation (divided by the number of values).
    pub sd: f64,
    /// The median, by [`quantile`].
    pub median: f64,
    /// The 95th percentile, by [`quantile`].
    pub p95: f64,
    /// The mean of the largest tenth of the values, of at least one.
    pub largest_tenth: f64,
}

impl Summary {
    /// The summary of a sample.
    pub fn of(values: &[f64]) -> Self {
        if values.is_empty() {
            return Summary { mean: f64::NAN, sd: f64::NAN, median: f64::NAN, p95: f64::NAN, largest_tenth: f64::NAN };
        }
        let (mean, sd) = mean_and_sd(values);
        let sorted = sorted(values.iter().copied());
        let largest_tenth = self::mean(&sorted[sorted.len() - sorted.len().div_ceil(10)..]);
        Summary { mean, sd, median: quantile(&sorted, 0.5), p95: quantile(&sorted, 0.95), largest_tenth }
    }
}

/// Errors of estimated forces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ForceErrors {
    /// Mean of |estimate / truth - 1|.
    pub error: f64,
    /// Standard deviation over mean of estimate / truth.
    pub spread: f64,
}

impl ForceErrors {
    /// From the ratios of estimated and true forces; `None` without any.
    pub fn of(ratios: &[f64]) -> Option<Self> {
        let errors: Vec<f64> = ratios.iter().map(|ratio| (ratio - 1.0).abs()).collect();
        (!ratios.is_empty()).then(|| ForceErrors { error: mean(&errors), spread: coefficient_of_variation(ratios) })
    }
}

/// A floating-point number with a total order.
pub trait Real: Copy {
    /// The total order of IEEE 754.
    fn total_order(&self, other: &Self) -> Ordering;
}

impl Real for f32 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Real for f64 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// The mean; `NaN` if there are no values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Mean and standard deviation (divided by the number of values); `NaN` if there are no values.
pub fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let mean = mean(values);
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64;
    (mean, variance.sqrt())
}

/// The standard deviation over the mean; `NaN` if there are no values.
pub fn coefficient_of_variation(values: &[f64]) -> f64 {
    let (mean, sd) = mean_and_sd(values);
    sd / mean
}

/// The standard deviation of `count` values, from their sum and the sum of their squares. Inaccurate if the mean is far
/// larger than the deviation.
pub fn sd_of_sums(sum: f64, squares: f64, count: f64) -> f64 {
    let mean = sum / count;
    (squares / count - mean * mean).max(0.0).sqrt()
}

/// The root mean square; `NaN` if there are no values.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0usize), |(sum, count), value| (sum + value * value, count + 1));
    (sum / count as f64).sqrt()
}

/// Values in ascending order.
pub fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// A quantile of values in ascending order, linear between the two nearest.
///
/// # Panics
/// If there are no values.
pub fn quantile(sorted: &[f64], part: f64) -> f64 {
    let place = part * (sorted.len() - 1) as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
}

/// The smallest of some ascending values such that at least the given fraction of them does not exceed it; `None` if
/// there are no values. It never interpolates between two values, one of which may be infinite.
pub fn inverse_cdf_quantile(sorted: &[f64], part: f64) -> Option<f64> {
    let rank = (part * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

/// For each fraction, such as 0.5 for the median, the value whose rank is nearest to the interpolated one; 0 if there
/// are no values.
pub fn nearest_quantiles<const N: usize>(values: &[f32], parts: [f64; N]) -> [f32; N] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    parts.map(|part| match sorted.len() {
        0 => 0.0,
        count => sorted[((count - 1) as f64 * part).round() as usize],
    })
}

/// Where a condition begins to hold between two values, by so many halvings: the upper end of the last interval.
pub fn bisect([mut low, mut high]: [f64; 2], halvings: usize, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..halvings {
        let middle = 0.5 * (low + high);
        if holds(middle) { high = middle } else { low = middle }
    }
    high
}

/// The value of a rank, counted from 0 in ascending order.
///
/// # Panics
/// If the rank is out of range.
pub(crate) fn order_statistic<T: Real>(values: &[T], rank: usize) -> T {
    *values.to_vec().select_nth_unstable_by(rank, T::total_order).1
}

/// The median; for an even number of values the upper one of the two in the middle; `None` if there are no values.
pub fn upper_median<T: Real>(values: &[T]) -> Option<T> {
    (!values.is_empty()).then(|| order_statistic(values, values.len() / 2))
}

/// The rank of each value, counted from 0 in ascending order; equal values share the mean of their ranks.
pub fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut start = 0;
    while start < order.len() {
        let same = order[start..].iter().take_while(|&&index| values[index] == values[order[start]]).count().max(1);
        let rank = start as f64 + (same as f64 - 1.0) / 2.0;
        order[start..start + same].iter().for_each(|&index| ranks[index] = rank);
        start += same;
    }
    ranks
}

/// Spearman's rank correlation of two lists of equal length; ties share the mean of their ranks. `NaN` if one list is
/// constant or contains a value that is not a number.
pub fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    if a.iter().chain(b).any(|value| value.is_nan()) {
        return f64::NAN;
    }
    let (a, b) = (ranks(a), ranks(b));
    let (mean_a, sd_a) = mean_and_sd(&a);
    let (mean_b, sd_b) = mean_and_sd(&b);
    let product = a.iter().zip(&b).map(|(a, b)| (a - mean_a) * (b - mean_b)).sum::<f64>() / a.len() as f64;
    product / (sd_a * sd_b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_the_nearest_values() {
        let summary = Summary::of(&[4.0, 1.0, 2.0, 3.0]);
        assert_eq!((summary.mean, summary.median), (2.5, 2.5));
        assert!((summary.p95 - 3.85).abs() < 1e-12);
        assert!((summary.sd - 1.25_f64.sqrt()).abs() < 1e-12);
        assert!(Summary::of(&[]).mean.is_nan());
        assert_eq!(Summary::of(&[7.0]).p95, 7.0);
        let twenty: Vec<f64> = (1..=20).rev().map(f64::from).collect();
        assert_eq!([summary.largest_tenth, Summary::of(&twenty).largest_tenth], [4.0, 19.5]);
    }

    #[test]
    fn a_bisection_ends_above_the_place_by_no_more_than_its_last_interval() {
        let root = bisect([0.0, 2.0], 10, |value| value * value >= 2.0);
        assert!((0.0..=2.0 / 1024.0).contains(&(root - 2f64.sqrt())), "{root}");
        assert_eq!(bisect([0.0, 2.0], 10, |_| false), 2.0);
    }

    #[test]
    fn the_other_quantiles_are_values_of_the_sample() {
        let values: Vec<f32> = (0..=100).rev().map(|value| value as f32).collect();
        assert_eq!(nearest_quantiles(&values, [0.0, 0.5, 0.99, 1.0]), [0.0, 50.0, 99.0, 100.0]);
        assert_eq!(nearest_quantiles(&[3.0], [0.01, 0.99]), [3.0; 2]);
        assert_eq!(nearest_quantiles(&[], [0.5]), [0.0]);
        assert_eq!(upper_median(&[4.0, 1.0, 3.0, 2.0]), Some(3.0));
        assert_eq!(upper_median(&[9.0f32, 1.0, 3.0]), Some(3.0));
        assert_eq!(upper_median::<f64>(&[]), None);
        assert_eq!(order_statistic(&[4.0, 1.0, 3.0, 2.0], 0), 1.0);
        let sorted = [0.1, 0.2, f64::INFINITY];
        assert_eq!([0.0, 0.5, 0.95].map(|part| inverse_cdf_quantile(&sorted, part)), sorted.map(Some));
        assert_eq!(inverse_cdf_quantile(&[], 0.5), None);
    }

    #[test]
    fn deviations_of_sums_and_of_values_agree() {
        let values = [1.0, 4.0, 9.0, 16.0];
        let (sum, squares) = values.iter().fold((0.0, 0.0), |(sum, squares), v| (sum + v, squares + v * v));
        let (mean, sd) = mean_and_sd(&values);
        assert!((sd_of_sums(sum, squares, 4.0) - sd).abs() < 1e-12);
        assert!((rms(values).powi(2) - sd * sd - mean * mean).abs() < 1e-12);
        assert!(rms([]).is_nan());
    }

    #[test]
    fn ranks_correlate_as_spearman_defines() {
        // Without ties 1 - 6 sum d^2 / (n (n^2 - 1)): d = 1, 1, 0, 0 gives 1 - 12 / 60.
        assert!((rank_correlation(&[1.0, 2.0, 3.0, 4.0], &[20.0, 10.0, 30.0, 99.0]) - 0.8).abs() < 1e-12);
        assert!((rank_correlation(&[1.0, 1.25, 5.0], &[0.1, 0.2, 0.3]) - 1.0).abs() < 1e-12);
        assert!((rank_correlation(&[1.0, 2.0, 3.0], &[3.0, 2.0, 1.0]) + 1.0).abs() < 1e-12);
        // Ranks 0, 1.5, 1.5, 3 against 0, 1, 2, 3: 4.5 / sqrt(4.5 * 5).
        assert!((rank_correlation(&[1.0, 2.0, 2.0, 3.0], &[1.0, 2.0, 3.0, 4.0]) - 0.9f64.sqrt()).abs() < 1e-12);
        assert!(rank_correlation(&[1.0, 2.0], &[1.0, 1.0]).is_nan());
        assert!(rank_correlation(&[1.0, 2.0], &[1.0, f64::NAN]).is_nan());
    }

    #[test]
    fn equal_values_share_their_ranks() {
        assert_eq!(ranks(&[2.0, 1.0, 2.0, 5.0]), [1.5, 0.0, 1.5, 3.0]);
        assert_eq!(ranks(&[f64::NAN, 0.0]), [1.0, 0.0]);
    }
}
