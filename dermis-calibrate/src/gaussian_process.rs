//! Regression of one quantity over positions and features.

use crate::covariance::matern;
use crate::error::CalibrateError;
use crate::minimize::minimize;
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use faer::linalg::solvers::{DenseSolveCore, Llt, PartialPivLu, Solve};
use faer::{Mat, Side};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Steps of the estimation of hyperparameters.
const ITERATIONS: usize = 40;
/// Standard deviation of the logarithm of a hyperparameter about its typical value.
const PRIOR_SD: f64 = 2.0;
/// Samples from which the hyperparameters are estimated, at most: their cost is cubic in it.
const MAX_FOR_HYPERPARAMETERS: usize = 300;

/// Where a quantity is predicted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Input {
    /// Position, m.
    pub position_m: Point3,
    /// Features; the same number in each input.
    pub features: Vec<f64>,
}

/// A Gaussian process (Rasmussen and Williams 2006, Eq. 2.23 and 2.39): a constant, a linear function of the
/// standardised features, a smooth function of the position (Matern 5/2), and noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct GaussianProcess {
    inputs: Vec<Input>,
    /// Mean and standard deviation of each feature.
    scales: Vec<(f64, f64)>,
    hyperparameters: Hyperparameters,
    mean: f64,
    /// `K^-1 (values - mean)`.
    weights: Vec<f64>,
}

/// Variances are relative to that of the noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Hyperparameters {
    /// Length of the function of the position, m.
    length_m: f64,
    /// Variance of the function of the position.
    position_variance: f64,
    /// Variance of each coefficient of the features.
    feature_variance: f64,
}

impl Hyperparameters {
    fn from_log(log: &[f64]) -> Self {
        Hyperparameters { length_m: log[0].exp(), position_variance: log[1].exp(), feature_variance: log[2].exp() }
    }

    /// The covariance of two inputs with standardised features. The constant has the variance of the noise.
    fn covariance(&self, a: &Input, b: &Input) -> f64 {
        let linear: f64 = a.features.iter().zip(&b.features).map(|(a, b)| a * b).sum();
        let smooth = matern(distance(a.position_m, b.position_m) / self.length_m);
        1.0 + self.feature_variance * linear + self.position_variance * smooth
    }

    fn factor(&self, inputs: &[Input]) -> Option<Llt<f64>> {
        let noise = |i: usize, j: usize| f64::from(u8::from(i == j));
        Mat::from_fn(inputs.len(), inputs.len(), |i, j| self.covariance(&inputs[i], &inputs[j]) + noise(i, j))
            .llt(Side::Lower)
            .ok()
    }
}

impl GaussianProcess {
    /// Fits the values at some inputs; hyperparameters maximise the marginal likelihood, with log-normal priors about
    /// `length_m` and variances like that of the noise. Returns the process and the residual of each sample from the others
    /// without those of its group (Rasmussen and Williams 2006, Eq. 5.12; for groups the same with blocks of the inverse).
    /// Samples of one group that are also alike, by a key, count once for the hyperparameters: their errors are not independent.
    ///
    /// # Errors
    /// Samples with a singular covariance.
    pub(crate) fn fit(
        inputs: &[Input],
        values: &[f64],
        groups: &[Group],
        length_m: f64,
    ) -> Result<(Self, Vec<f64>), CalibrateError> {
        let singular = || CalibrateError::Fit("the covariance of the labels is singular".into());
        let scales = scales(inputs);
        let inputs: Vec<Input> = inputs.iter().map(|input| standardised(input, &scales)).collect();
        let mean = dermis::stats::mean(values);
        let centred: Vec<f64> = values.iter().map(|value| value - mean).collect();
        let mut first: BTreeMap<Group, usize> = BTreeMap::new();
        groups.iter().enumerate().for_each(|(index, group)| _ = first.entry(*group).or_insert(index));
        let mut distinct: Vec<usize> = first.into_values().collect();
        distinct.sort_unstable();
        let hyperparameters = estimate(&inputs, &centred, &distinct, length_m);
        let factor = hyperparameters.factor(&inputs).ok_or_else(singular)?;
        let weights = factor.solve(Mat::from_fn(centred.len(), 1, |i, _| centred[i]));
        let inverse = factor.inverse();
        let mut places: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        groups.iter().enumerate().for_each(|(index, group)| places.entry(group.place).or_default().push(index));
        let mut residuals = vec![0.0; centred.len()];
        for members in places.values() {
            let block = Mat::from_fn(members.len(), members.len(), |i, j| inverse[(members[i], members[j])]);
            let left = PartialPivLu::new(block.as_ref())
                .solve(Mat::from_fn(members.len(), 1, |i, _| weights[(members[i], 0)]));
            members.iter().enumerate().for_each(|(i, &member)| residuals[member] = left[(i, 0)]);
        }
        let weights = (0..centred.len()).map(|i| weights[(i, 0)]).collect();
        Ok((GaussianProcess { inputs, scales, hyperparameters, mean, weights }, residuals))
    }

    /// The mean prediction at an input.
    pub(crate) fn predict(&self, input: &Input) -> f64 {
        let input = standardised(input, &self.scales);
        let terms = self.inputs.iter().zip(&self.weights);
        self.mean + terms.map(|(known, weight)| weight * self.hyperparameters.covariance(known, &input)).sum::<f64>()
    }

    /// How it changes where all features grow by a standard deviation.
    pub(crate) fn slope(&self) -> f64 {
        let terms = self.inputs.iter().zip(&self.weights);
        let of_features = terms.map(|(known, weight)| weight * known.features.iter().sum::<f64>()).sum::<f64>();
        self.hyperparameters.feature_variance * of_features
    }

    /// Whether it was stored whole, for a number of features.
    pub(crate) fn is_consistent(&self, features: usize) -> bool {
        let fits = |input: &Input| input.features.len() == features;
        self.scales.len() == features && self.weights.len() == self.inputs.len() && self.inputs.iter().all(fits)
    }
}

/// What a sample shares with others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Group {
    /// Samples of one place are left out together.
    pub(crate) place: [u64; 3],
    /// Of one place and one key they are repetitions.
    pub(crate) key: u64,
}

/// The hyperparameters of the largest posterior density of some samples; the scale of the values is profiled.
fn estimate(inputs: &[Input], values: &[f64], samples: &[usize], length_m: f64) -> Hyperparameters {
    let count = samples.len().min(MAX_FOR_HYPERPARAMETERS);
    let chosen: Vec<usize> = (0..count).map(|k| samples[k * samples.len() / count]).collect();
    let inputs: Vec<Input> = chosen.iter().map(|&index| inputs[index].clone()).collect();
    let values = Mat::from_fn(count, 1, |i, _| values[chosen[i]]);
    let typical = [length_m.ln(), 0.0, 0.0];
    let objective = |log: &[f64]| {
        let Some(factor) = Hyperparameters::from_log(log).factor(&inputs) else { return f64::INFINITY };
        let mut half = values.clone();
        factor.L().solve_lower_triangular_in_place(half.as_mut());
        let square = half.col(0).iter().map(|value| value * value).sum::<f64>() / count as f64;
        let determinant: f64 = (0..count).map(|i| factor.L()[(i, i)].ln()).sum();
        let prior: f64 = log.iter().zip(&typical).map(|(value, centre)| ((value - centre) / PRIOR_SD).powi(2)).sum();
        0.5 * count as f64 * square.max(1e-300).ln() + determinant + 0.5 * prior
    };
    Hyperparameters::from_log(&minimize(&typical, ITERATIONS, objective))
}

/// Mean and standard deviation of each feature; 1 for a feature that does not vary.
fn scales(inputs: &[Input]) -> Vec<(f64, f64)> {
    let column = |feature: usize| inputs.iter().map(|input| input.features[feature]).collect::<Vec<f64>>();
    let scale = |feature: usize| {
        let (mean, sd) = dermis::stats::mean_and_sd(&column(feature));
        (mean, if sd > 0.0 { sd } else { 1.0 })
    };
    (0..inputs.first().map_or(0, |input| input.features.len())).map(scale).collect()
}

fn standardised(input: &Input, scales: &[(f64, f64)]) -> Input {
    let features = input.features.iter().zip(scales).map(|(value, (mean, sd))| (value - mean) / sd).collect();
    Input { position_m: input.position_m, features }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each sample for itself.
    fn single(count: usize) -> Vec<Group> {
        (0..count).map(|index| Group { place: [index as u64; 3], key: 0 }).collect()
    }

    fn samples(count: usize) -> (Vec<Input>, Vec<f64>) {
        let input = |k: usize| {
            let k = k as f64;
            Input { position_m: [0.05 * (1.7 * k).sin(), 0.05 * (2.3 * k).cos(), 0.0], features: vec![(0.9 * k).sin()] }
        };
        let inputs: Vec<Input> = (0..count).map(input).collect();
        let value = |input: &Input| 3.0 + 2.0 * input.features[0] + (input.position_m[0] / 0.02).sin();
        let values = inputs.iter().map(value).collect();
        (inputs, values)
    }

    #[test]
    fn a_smooth_function_is_learnt_and_the_residuals_are_those_without_the_sample() {
        let (inputs, values) = samples(80);
        let (_, residuals) = GaussianProcess::fit(&inputs, &values, &single(80), 0.03).unwrap();
        let error = (residuals.iter().map(|value| value * value).sum::<f64>() / 80.0).sqrt();
        assert!(error < 0.1, "{error}");
        // The fit without the last sample, with its own hyperparameters, misses it by about the residual.
        let (without, _) = GaussianProcess::fit(&inputs[..79], &values[..79], &single(79), 0.03).unwrap();
        let missed = values[79] - without.predict(&inputs[79]);
        assert!((missed - residuals[79]).abs() < 0.02, "{missed} and {}", residuals[79]);
    }

    /// Several frames of each press promise no more than one of each.
    #[test]
    fn repetitions_are_left_out_together() {
        let (inputs, _) = samples(15);
        let values: Vec<f64> = (0..15).map(|k| ((k * k * 37 + 11 * k) % 101) as f64 / 50.0 - 1.0).collect();
        let (_, single_left) = GaussianProcess::fit(&inputs, &values, &single(15), 0.03).unwrap();
        let repeated: Vec<usize> = (0..15).flat_map(|k| [k; 8]).collect();
        let of = |k: &usize| inputs[*k].clone();
        let (many, values): (Vec<Input>, Vec<f64>) = repeated.iter().map(|k| (of(k), values[*k])).unzip();
        let groups: Vec<Group> = repeated.iter().map(|k| single(15)[*k]).collect();
        let (_, left) = GaussianProcess::fit(&many, &values, &groups, 0.03).unwrap();
        let size = |left: &[f64]| dermis::stats::rms(left.iter().copied());
        assert!(size(&left) > 0.9 * size(&single_left), "{} of {}", size(&left), size(&single_left));
    }

    #[test]
    fn noise_alone_is_not_learnt() {
        let (inputs, _) = samples(60);
        let values: Vec<f64> = (0..60).map(|k| ((k * k * 37 + 11 * k) % 101) as f64 / 50.0 - 1.0).collect();
        let (process, residuals) = GaussianProcess::fit(&inputs, &values, &single(60), 0.03).unwrap();
        let square = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>();
        let spread = square(&mut values.iter().map(|value| value - dermis::stats::mean(&values)));
        assert!(square(&mut residuals.into_iter()) < 1.2 * spread);
        assert!(square(&mut inputs.iter().map(|input| process.predict(input) - process.mean)) < 0.5 * spread);
    }
}
