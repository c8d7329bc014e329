//! Amplitudes of presses: how much stronger the change of a frame is than that of a typical labelled press, and the
//! force that it states.

use crate::calibration::Label;
use crate::correction::MIN_FOUND;
use crate::units::Change;
use dermis::detect::Forces;
use dermis::stats::{coefficient_of_variation, mean, mean_and_sd, quantile, rms, sorted};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Fewest labels with a force.
const MIN_FORCES: usize = 20;
/// Smallest standard deviation of the logarithm of the forces: below it they are equal.
const MIN_LOG_SD: f64 = 0.05;
/// Smallest exponent that is used, and smallest in its standard errors.
const MIN_EXPONENT: f64 = 0.05;
const MIN_SIGNIFICANCE: f64 = 4.0;
/// Fewest labels whose amplitudes are compared without forces, and the smallest standard deviation of their logarithms
/// above which presses count as unequal. Presses of equal depth on two real membranes have 0.03 to 0.13, from 50 labels
/// on.
const MIN_AMPLITUDES: usize = 50;
const MIN_AMPLITUDE_LOG_SD: f64 = 0.25;
/// The standard deviation of a normal distribution over the distance of its quartiles.
const SD_PER_QUARTILES: f64 = 0.741_3;
/// Amplitudes that are tried, in standard deviations from the mean: this far on both sides, in these steps; then about
/// the best in steps that are smaller by a factor.
const WIDTH: f64 = 3.0;
const STEPS: i32 = 5;
const FINER: i32 = 4;
/// Part of normal values within one standard deviation.
const WITHIN_ONE_SD: f64 = 0.682_689_492;

/// Why the forces of labels are not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum UnusedForces {
    /// Fewer labels than a relation needs.
    #[error("at least {MIN_FORCES} labels are needed, and there are {0}")]
    TooFew(usize),
    /// Fewer labels that the corrected method finds and that have a force.
    #[error("fewer than {MIN_FOUND} of the labels that the method finds have a force above zero")]
    TooFewFound,
    /// The label of this frame has no force above zero.
    #[error("the label of frame {0} has no force above zero")]
    NotPositive(usize),
    /// The forces do not differ.
    #[error("their standard deviation is below {} %", 1e2 * MIN_LOG_SD)]
    Equal,
    /// The change of a frame does not grow with the force.
    #[error("the change of the frame does not grow with the force")]
    Unrelated,
}

/// Whether any label has a force.
pub(crate) fn has_force(labels: &[Label]) -> bool {
    labels.iter().any(|label| !label.force_n.is_nan())
}

/// The amplitudes of presses that are not equally strong.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Strength {
    /// Standard deviation of the logarithm of the labels' amplitudes.
    pub log_sd: f64,
    /// Their relation to forces, where these are known.
    pub law: Option<ForceLaw>,
}

/// A power law from the force of a press to the amplitude of its change: `amplitude = (force / typical)^exponent`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ForceLaw {
    /// Mean of the logarithms of the labels' forces.
    mean_log_force: f64,
    exponent: f64,
    /// Range of the logarithm of the forces: that of the labels, and a factor of [`Forces::EXTRAPOLATION`] on each side.
    range: [f64; 2],
    /// Relative standard deviation of a force: 0 as long as it is not known.
    pub relative_sd: f64,
}

impl Strength {
    /// The strengths of labelled presses from their forces, or without forces from their amplitudes alone; `None` where
    /// all count as equally strong.
    pub(crate) fn fit(labels: &[Label], amplitudes: &[f64]) -> Option<Self> {
        if let Ok(law) = ForceLaw::fit(labels, amplitudes) {
            let logs: Vec<f64> = labels.iter().map(|label| law.amplitude(label.force_n).ln()).collect();
            return Some(Strength { log_sd: rms(logs), law: Some(law) });
        }
        let logs = sorted(amplitudes.iter().map(|amplitude| amplitude.ln()));
        // Robust: the amplitude of a press that the map does not know yet is far off.
        let log_sd = SD_PER_QUARTILES * (quantile(&logs, 0.75) - quantile(&logs, 0.25));
        let varies = labels.len() >= MIN_AMPLITUDES && log_sd > MIN_AMPLITUDE_LOG_SD;
        varies.then_some(Strength { log_sd, law: None })
    }

    /// Whether it was stored whole.
    pub(crate) fn is_consistent(&self) -> bool {
        self.log_sd > 0.0 && self.log_sd.is_finite() && self.law.is_none_or(|law| law.is_consistent())
    }

    /// The amplitude of the largest posterior density, with a log-normal prior of the labels' spread.
    pub(crate) fn most_likely_amplitude(&self, log_evidence: impl Fn(f64) -> f64) -> f64 {
        let log_density =
            |deviations: f64| log_evidence((self.log_sd * deviations).exp()) - 0.5 * deviations * deviations;
        let step = WIDTH / f64::from(STEPS);
        let best_of = |tried: &[(f64, f64)]| {
            (0..tried.len()).max_by(|&a, &b| tried[a].1.total_cmp(&tried[b].1)).expect("some are tried")
        };
        let about = |centre: f64, step: f64, steps: i32| -> Vec<(f64, f64)> {
            (-steps..=steps).map(|k| centre + f64::from(k) * step).map(|at| (at, log_density(at))).collect()
        };
        let coarse = about(0.0, step, STEPS);
        let step = step / f64::from(FINER);
        let tried = about(coarse[best_of(&coarse)].0, step, FINER - 1);
        let best = best_of(&tried);
        let at = match (best.checked_sub(1).map(|before| tried[before].1), tried.get(best + 1).map(|after| after.1)) {
            (Some(before), Some(after)) => tried[best].0 + step * vertex(before, tried[best].1, after),
            _ => tried[best].0,
        };
        (self.log_sd * at).exp()
    }
}

impl ForceLaw {
    /// The logarithms of the forces of labels, if a relation can be fitted to them.
    pub(crate) fn log_forces(labels: &[Label]) -> Result<Vec<f64>, UnusedForces> {
        if labels.len() < MIN_FORCES {
            return Err(UnusedForces::TooFew(labels.len()));
        }
        if let Some(label) = labels.iter().find(|label| label.force_n.is_nan() || label.force_n <= 0.0) {
            return Err(UnusedForces::NotPositive(label.row));
        }
        let forces: Vec<f64> = labels.iter().map(|label| label.force_n.ln()).collect();
        if mean_and_sd(&forces).1 <= MIN_LOG_SD { Err(UnusedForces::Equal) } else { Ok(forces) }
    }

    /// The law that relates the amplitudes of labelled presses to their forces, by linear regression of the logarithms.
    fn fit(labels: &[Label], amplitudes: &[f64]) -> Result<Self, UnusedForces> {
        let forces = Self::log_forces(labels)?;
        let amplitudes: Vec<f64> = amplitudes.iter().map(|amplitude| amplitude.ln()).collect();
        let (mean_log_force, mean_amplitude) = (mean(&forces), mean(&amplitudes));
        let product =
            |a: &[f64], b: &[f64], of: [f64; 2]| a.iter().zip(b).map(|(a, b)| (a - of[0]) * (b - of[1])).sum::<f64>();
        let spread = product(&forces, &forces, [mean_log_force; 2]);
        let exponent = product(&forces, &amplitudes, [mean_log_force, mean_amplitude]) / spread;
        let explained = exponent * exponent * spread;
        let left = (product(&amplitudes, &amplitudes, [mean_amplitude; 2]) - explained).max(0.0);
        let standard_error = (left / (labels.len() - 2) as f64 / spread).sqrt();
        let law = ForceLaw { mean_log_force, exponent, range: force_range(&forces), relative_sd: 0.0 };
        let determined = exponent > (MIN_SIGNIFICANCE * standard_error).max(MIN_EXPONENT);
        if determined { Ok(law) } else { Err(UnusedForces::Unrelated) }
    }

    fn is_consistent(&self) -> bool {
        let ForceLaw { mean_log_force, exponent, range, relative_sd } = *self;
        mean_log_force.is_finite()
            && exponent > 0.0
            && exponent.is_finite()
            && range[0] <= range[1]
            && relative_sd >= 0.0
    }

    /// The amplitude of a press of a force, N.
    pub(crate) fn amplitude(&self, force_n: f64) -> f64 {
        (self.exponent * (force_n.ln() - self.mean_log_force)).exp()
    }

    /// The force of a press and its standard deviation, N.
    pub(crate) fn force_n(&self, amplitude: f64) -> [f64; 2] {
        force_within(self.mean_log_force + amplitude.ln() / self.exponent, self.range, self.relative_sd)
    }

    /// Sets the relative deviation from labels that the map had not seen.
    pub(crate) fn set_deviation(&mut self, log_ratios: &[f64]) {
        self.relative_sd = relative_deviation(log_ratios);
    }
}

/// The range of the logarithms of forces: that of some, and a factor of [`Forces::EXTRAPOLATION`] on each side.
pub(crate) fn force_range(log_forces: &[f64]) -> [f64; 2] {
    let lowest = log_forces.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = log_forces.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    [lowest - Forces::EXTRAPOLATION.ln(), highest + Forces::EXTRAPOLATION.ln()]
}

/// The force of a logarithm and its standard deviation, N. Beyond the range it is a bound, whose deviation is `NaN`.
pub(crate) fn force_within(log: f64, [lowest, highest]: [f64; 2], relative_sd: f64) -> [f64; 2] {
    let force_n = log.clamp(lowest, highest).exp();
    [force_n, if (lowest..=highest).contains(&log) { relative_sd * force_n } else { f64::NAN }]
}

/// The mean relative error of forces, from the logarithms of the estimated over the true ones.
pub(crate) fn relative_error(log_ratios: &[f64]) -> f64 {
    mean(&log_ratios.iter().map(|log| (log.exp() - 1.0).abs()).collect::<Vec<f64>>())
}

/// The standard deviation over the mean of the ratios of estimated and true forces, from their logarithms.
pub(crate) fn ratio_spread(log_ratios: &[f64]) -> f64 {
    coefficient_of_variation(&log_ratios.iter().map(|log| log.exp()).collect::<Vec<f64>>())
}

/// The relative error that 68 % of the forces do not exceed: the standard deviation of normal ones.
pub(crate) fn relative_deviation(log_ratios: &[f64]) -> f64 {
    quantile(&sorted(log_ratios.iter().map(|log| (log.exp() - 1.0).abs())), WITHIN_ONE_SD)
}

/// Where a parabola through values at -1, 0 and 1 has its vertex, if that of 0 is the largest.
pub(crate) fn vertex(before: f64, here: f64, after: f64) -> f64 {
    let curvature = before - 2.0 * here + after;
    if curvature < 0.0 { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
}

/// The factor on the change of one frame from the untouched one with which it is nearest to another, all in units of
/// the channels: between 1/8 and 8.
pub(crate) fn amplitude_between(frame: &[f64], other: &[f64], untouched: &[f64]) -> f64 {
    const STEP: f64 = 0.05;
    const MAX: i32 = 41;
    let change = Change::of(frame, untouched);
    let square = |k: i32| -> f64 {
        let factor = (f64::from(k) * STEP).exp();
        change.amplified(factor).zip(other).map(|(value, other)| (value - other).powi(2)).sum()
    };
    let squares: Vec<f64> = (-MAX..=MAX).map(|k| -square(k)).collect();
    let best = (1..squares.len() - 1).max_by(|&a, &b| squares[a].total_cmp(&squares[b])).expect("some are tried");
    let at = best as f64 - f64::from(MAX) + vertex(squares[best - 1], squares[best], squares[best + 1]);
    (at * STEP).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(forces: &[f64]) -> Vec<Label> {
        let label = |(row, &force_n): (usize, &f64)| Label { row, position_m: [0.0; 3], force_n };
        forces.iter().enumerate().map(label).collect()
    }

    #[test]
    fn a_power_law_is_found_and_inverted() {
        let forces: Vec<f64> = (0..40).map(|k| 1.0 + 0.1 * f64::from(k)).collect();
        let amplitudes: Vec<f64> = forces.iter().map(|force| 0.3 * force.powf(0.7)).collect();
        let law = ForceLaw::fit(&labels(&forces), &amplitudes).unwrap();
        assert!((law.exponent - 0.7).abs() < 1e-9);
        assert!((law.force_n(law.amplitude(2.5))[0] - 2.5).abs() < 1e-9);
        assert!((law.amplitude(4.0) / law.amplitude(2.0) - 2.0_f64.powf(0.7)).abs() < 1e-9);
        // The labels reach to 4.9 N, and half as much again is known.
        assert!(law.force_n(law.amplitude(7.0))[1].is_finite());
        let [bound_n, sd_n] = law.force_n(law.amplitude(70.0));
        assert!((bound_n - 1.5 * 4.9).abs() < 1e-9 && sd_n.is_nan());
    }

    #[test]
    fn equal_forces_and_amplitudes_without_relation_give_no_law() {
        assert_eq!(ForceLaw::fit(&labels(&[2.0; 40]), &[1.0; 40]), Err(UnusedForces::Equal));
        let forces: Vec<f64> = (0..40).map(|k| 1.0 + 0.1 * f64::from(k)).collect();
        let amplitudes: Vec<f64> = (0..40).map(|k| if k % 2 == 0 { 1.0 } else { 1.2 }).collect();
        assert_eq!(ForceLaw::fit(&labels(&forces), &amplitudes), Err(UnusedForces::Unrelated));
        assert_eq!(ForceLaw::fit(&labels(&forces[..10]), &amplitudes[..10]), Err(UnusedForces::TooFew(10)));
        let without = [&forces[..39], &[0.0]].concat();
        assert_eq!(ForceLaw::fit(&labels(&without), &amplitudes), Err(UnusedForces::NotPositive(39)));
    }

    #[test]
    fn without_forces_amplitudes_that_vary_are_unequal() {
        let unknown = labels(&[f64::NAN; 60]);
        let amplitudes = |width: f64| -> Vec<f64> { (0..60).map(|k| (width * f64::from(k)).exp()).collect() };
        assert_eq!(Strength::fit(&unknown, &amplitudes(0.001)), None);
        let strength = Strength::fit(&unknown, &amplitudes(0.05)).unwrap();
        assert!(strength.law.is_none() && strength.log_sd > 0.5, "{strength:?}");
        assert_eq!(Strength::fit(&unknown[..30], &amplitudes(0.05)[..30]), None, "too few");
    }

    #[test]
    fn the_most_likely_amplitude_is_the_largest_of_a_density() {
        let strength = Strength { log_sd: 0.4, law: None };
        for amplitude in [0.6, 0.83, 1.0, 1.3, 1.71] {
            // The density of 24 residuals about an amplitude, beside a wide prior.
            let square = |tried: f64| 24.0 + (20.0 * (tried / amplitude).ln()).powi(2);
            let found = strength.most_likely_amplitude(|tried| crate::posterior::log_student(square(tried), 1.0, 24));
            assert!((found / amplitude - 1.0).abs() < 0.02, "{found} for {amplitude}");
        }
    }

    #[test]
    fn the_amplitude_between_two_frames_is_their_factor() {
        let untouched = [0.1, -0.4, 0.0];
        let frame = [2.0, 0.3, -1.0];
        let other: Vec<f64> = Change::of(&frame, &untouched).amplified(1.37).collect();
        assert!((amplitude_between(&frame, &other, &untouched) - 1.37).abs() < 0.002);
    }
}
