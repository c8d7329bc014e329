//! Mean and variance of untouched frames.

/// Mean and variance of each value over several frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Statistics {
    /// The means.
    pub mean: Vec<f64>,
    /// The variances, not defined for fewer than two frames.
    pub variance: Vec<f64>,
}

impl Statistics {
    /// Of frames of one length.
    pub(super) fn of<'a>(frames: impl Iterator<Item = &'a [f64]> + Clone) -> Self {
        let count = frames.clone().count() as f64;
        let length = frames.clone().next().map_or(0, <[f64]>::len);
        let (mut mean, mut variance) = (vec![0.0; length], vec![0.0; length]);
        for frame in frames.clone() {
            mean.iter_mut().zip(frame).for_each(|(mean, value)| *mean += value / count);
        }
        for frame in frames {
            let squares = frame.iter().zip(&mean).map(|(value, mean)| (value - mean).powi(2) / (count - 1.0));
            variance.iter_mut().zip(squares).for_each(|(variance, square)| *variance += square);
        }
        Statistics { mean, variance }
    }
}

/// The difference of two frames.
pub(super) fn difference(frame: &[f64], baseline: &[f64]) -> Vec<f64> {
    frame.iter().zip(baseline).map(|(value, baseline)| value - baseline).collect()
}
