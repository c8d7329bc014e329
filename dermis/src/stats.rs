//! Mean, spread and quantiles.

use serde::Serialize;

/// Mean, standard deviation, median and 95th percentile of some numbers; `NaN` (in JSON `null`) without a number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// The mean.
    pub mean: f64,
    /// The standard deviation, over the number of values.
    pub sd: f64,
    /// The median.
    pub median: f64,
    /// The 95th percentile.
    pub p95: f64,
}

impl Summary {
    /// The summary of some values.
    pub fn of(values: &[f64]) -> Self {
        if values.is_empty() {
            return Summary { mean: f64::NAN, sd: f64::NAN, median: f64::NAN, p95: f64::NAN };
        }
        let (mean, sd) = mean_and_sd(values);
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        Summary { mean, sd, median: quantile(&sorted, 0.5), p95: quantile(&sorted, 0.95) }
    }
}

/// Mean and standard deviation over the number of values; `NaN` without one.
pub fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
    (mean, variance.sqrt())
}

/// A quantile of values in ascending order, linear between the two nearest.
///
/// # Panics
/// Without a value.
pub fn quantile(sorted: &[f64], part: f64) -> f64 {
    let place = part * (sorted.len() - 1) as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
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
    }
}
