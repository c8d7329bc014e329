//! Dependence of an image's peak on the force.

use crate::experiment::{PressSet, Recording, record};
use crate::twin::{Press, Twin};
use dermis::frame::Frame;
use dermis::reconstruct::Reconstruct;
use dermis::stats::{mean_and_sd, quantile, ranks};
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
    let (mean, sd) = mean_and_sd(&presses.par_iter().map(per_newton).collect::<crate::Result<Vec<f64>>>()?);
    Ok(sd / mean)
}

/// Spearman's rank correlation of two lists of equal length; ties share the mean of their ranks. `NaN` if one list is
/// constant or contains a value that is not a number.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    if a.iter().chain(b).any(|value| value.is_nan()) {
        return f64::NAN;
    }
    let (a, b) = (ranks(a), ranks(b));
    let (mean_a, sd_a) = mean_and_sd(&a);
    let (mean_b, sd_b) = mean_and_sd(&b);
    let product = a.iter().zip(&b).map(|(a, b)| (a - mean_a) * (b - mean_b)).sum::<f64>() / a.len() as f64;
    product / (sd_a * sd_b)
}

/// Median and minimum; `NaN` without a number. A value that is not a number counts as the minimum.
fn median_and_least(values: &[f64]) -> [f64; 2] {
    let mut sorted: Vec<f64> =
        values.iter().map(|value| if value.is_nan() { f64::NEG_INFINITY } else { *value }).collect();
    sorted.sort_by(f64::total_cmp);
    if sorted.is_empty() { [f64::NAN; 2] } else { [quantile(&sorted, 0.5), sorted[0]] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_correlate_as_spearman_defines() {
        // Without ties 1 - 6 sum d^2 / (n (n^2 - 1)): d = 1, 1, 0, 0 gives 1 - 12 / 60.
        assert!((rank_correlation(&[1.0, 2.0, 3.0, 4.0], &[20.0, 10.0, 30.0, 99.0]) - 0.8).abs() < 1e-12);
        assert!((rank_correlation(&FORCES_N, &FORCES_N.map(|force| force.powf(0.3))) - 1.0).abs() < 1e-12);
        assert!((rank_correlation(&[1.0, 2.0, 3.0], &[3.0, 2.0, 1.0]) + 1.0).abs() < 1e-12);
        // Ranks 0, 1.5, 1.5, 3 against 0, 1, 2, 3: 4.5 / sqrt(4.5 * 5).
        assert!((rank_correlation(&[1.0, 2.0, 2.0, 3.0], &[1.0, 2.0, 3.0, 4.0]) - 0.9f64.sqrt()).abs() < 1e-12);
        assert!(rank_correlation(&[1.0, 2.0], &[1.0, 1.0]).is_nan());
        assert!(rank_correlation(&[1.0, 2.0], &[1.0, f64::NAN]).is_nan());
        assert_eq!(median_and_least(&[0.9, 1.0, 0.8])[..], [0.9, 0.8]);
        assert!(median_and_least(&[]).iter().all(|value| value.is_nan()));
    }
}
