//! Dependence of an image's peak on the force.

use crate::experiment::{PressSet, Recording, record};
use crate::twin::{Press, Twin};
use dermis::frame::Frame;
use dermis::reconstruct::Reconstruct;
use dermis::stats::{coefficient_of_variation, quantile, rank_correlation, sorted};
use rayon::prelude::*;
use serde::Serialize;

/// Forces at each fixed position, N: steps of a third of an octave, rounded.
pub(super) const FORCES_N: [f64; 8] = [1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0];

/// Number of presses at each fixed position.
pub const FORCES_PER_POSITION: usize = FORCES_N.len();

/// Dependence of the peaks on the force, and that of the twin itself.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForceScore {
    /// Standard deviation over mean of the twin's true strength per newton ([`Twin::strength_m2`]) for the grid's
    /// presses and the random presses: a lower limit for any method that measures the strength of a touch.
    pub true_spread: [f64; 2],
    /// At each fixed position the rank correlation (Spearman's) of the image's peak with the force.
    pub rank_correlations: Vec<f64>,
    /// At each fixed position the ratio of the peaks at 4 N and at 1 N over the ratio of the twin's true strengths.
    pub peak_ratios: Vec<f64>,
}

impl ForceScore {
    /// Median and minimum of the rank correlations.
    pub fn rank_correlation(&self) -> [f64; 2] {
        median_and_least(&self.rank_correlations)
    }

    /// Median and minimum of the ratios of peaks over the true ones.
    pub fn peak_ratio(&self) -> [f64; 2] {
        median_and_least(&self.peak_ratios)
    }
}

/// Presses each position with every force, from the twin's frame `first_index` on, and evaluates the peaks.
pub(super) fn at_fixed_places(
    twin: &Twin,
    method: &dyn Reconstruct,
    set: &PressSet,
    first_index: u64,
    on_step: &(impl Fn(usize) + Sync),
) -> crate::Result<(Vec<f64>, Vec<f64>, u64)> {
    let Recording { frames, baseline, next_index, .. } = record(twin, &set.presses, first_index, || on_step(1))?;
    let peak =
        |frame: &Frame| Ok(method.reconstruct(&(frame - &baseline))?.peak().map_or(f64::NAN, |(_, value)| value));
    let peaks = frames.par_iter().map(peak).collect::<crate::Result<Vec<f64>>>()?;
    let place = FORCES_PER_POSITION;
    let correlations = peaks.chunks_exact(place).map(|peaks| rank_correlation(&FORCES_N, peaks)).collect();
    let at = |force_n: f64| FORCES_N.iter().position(|&force| force == force_n).expect("one of the forces");
    let (one, four) = (at(1.0), at(4.0));
    let ratio = |(peaks, presses): (&[f64], &[Vec<Press>])| {
        let truly = twin.strength_m2(&presses[four])? / twin.strength_m2(&presses[one])?;
        Ok(peaks[four] / peaks[one] / truly)
    };
    let ratios = peaks.chunks_exact(place).zip(set.presses.chunks_exact(place)).map(ratio);
    Ok((correlations, ratios.collect::<crate::Result<Vec<f64>>>()?, next_index))
}

/// Standard deviation over mean of the true strength per newton of single presses.
pub(super) fn true_spread(twin: &Twin, presses: &[Vec<Press>]) -> crate::Result<f64> {
    let per_newton = |presses: &Vec<Press>| {
        let force_n: f64 = presses.iter().map(|press| press.force_n).sum();
        Ok(twin.strength_m2(presses)? / force_n)
    };
    Ok(coefficient_of_variation(&presses.par_iter().map(per_newton).collect::<crate::Result<Vec<f64>>>()?))
}

/// Median and minimum; `NaN` without a number. A value that is not a number counts as the minimum.
fn median_and_least(values: &[f64]) -> [f64; 2] {
    let sorted = sorted(values.iter().map(|value| if value.is_nan() { f64::NEG_INFINITY } else { *value }));
    if sorted.is_empty() { [f64::NAN; 2] } else { [quantile(&sorted, 0.5), sorted[0]] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_without_a_number_is_the_least() {
        assert_eq!(median_and_least(&[0.9, 1.0, 0.8])[..], [0.9, 0.8]);
        assert_eq!(median_and_least(&[0.9, f64::NAN])[1], f64::NEG_INFINITY);
        assert!(median_and_least(&[]).iter().all(|value| value.is_nan()));
    }
}
