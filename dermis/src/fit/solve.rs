//! Gauss-Newton steps with the variances of the channels estimated between them.

use crate::fit::model::{Linear, Model};
use crate::fit::noise::{least_variance, model_variance, variances_of_mean};
use crate::fit::{Contacts, Determination, FitError, Misfit, Offset, PRIOR_SD, factor};
use crate::frame::{Frame, mean};
use crate::linalg::{Matrix, invert_spd};
use crate::protocol::Protocol;
use crate::stats::rms;

/// Steps at given variances, halvings of a step, and estimates of the variances; the equations are nearly linear in the
/// logarithms, and few of each are used.
const MOST_STEPS: usize = 25;
const MOST_HALVINGS: usize = 10;
const MOST_VARIANCES: usize = 12;
/// Longest step of a logarithm.
const LONGEST_STEP: f64 = 2.0;
/// A step that is shorter ends the iteration.
const SHORTEST_STEP: f64 = 1e-8;
/// Relative change of the variances that ends their estimation.
const VARIANCE_CHANGE: f64 = 0.01;
/// Fewer channels give no scale of their own.
const LEAST_GROUP: usize = 3;

/// The mean of the frames, and what is known of its channels.
pub(super) struct Data {
    /// The channels in use.
    pub channels: Vec<usize>,
    values: Vec<f64>,
    /// Variance of the mean from the scatter of the frames.
    noise: Vec<f64>,
    /// The channels in use that read no voltage at a driven electrode, and those that do.
    groups: [Vec<usize>; 2],
    /// The least variance of a channel in each group.
    least: [f64; 2],
}

/// Unknowns with their standard deviations.
pub(super) struct Estimate {
    pub unknowns: Vec<f64>,
    /// Standard deviations; `NaN` for unknowns that were kept.
    pub sd: Vec<f64>,
    /// The mean of the frames minus the model.
    residuals: Vec<f64>,
    /// Variance of the model in each group.
    model_variances: [f64; 2],
}

/// The unknowns that are fitted, and the centres of their priors.
struct Search {
    free: Vec<usize>,
    centres: Vec<f64>,
}

impl Data {
    pub(super) fn new(protocol: &Protocol, frames: &[Frame], left_out: &[usize]) -> Self {
        let amplitudes = |frame: &Frame| {
            let mut frame = frame.clone();
            protocol.drop_signs(&mut frame);
            frame
        };
        let frames: Vec<Frame> = frames.iter().map(amplitudes).collect();
        let values = mean(&frames).expect("a frame").0;
        let mut used = vec![true; values.len()];
        left_out.iter().for_each(|&channel| used[channel] = false);
        let channels: Vec<usize> = (0..values.len()).filter(|&channel| used[channel]).collect();
        let (driven, others) = channels.iter().partition(|&&channel| protocol.channels()[channel].touches_driven());
        let groups: [Vec<usize>; 2] = [others, driven];
        let noise = variances_of_mean(&frames, &values, &groups);
        let least = [0, 1].map(|group: usize| least_variance(groups[group].iter().map(|&channel| values[channel])));
        Data { channels, values, noise, groups, least }
    }

    /// The mean of the frames minus a frame of the model; 0 in channels that are left out.
    fn residuals(&self, frame: &[f64]) -> Vec<f64> {
        let mut residuals = vec![0.0; frame.len()];
        self.channels.iter().for_each(|&channel| residuals[channel] = self.values[channel] - frame[channel]);
        residuals
    }

    /// The inverse variance of each channel; 0 for those that are left out.
    fn weights(&self, model_variances: [f64; 2]) -> Vec<f64> {
        let mut weights = vec![0.0; self.values.len()];
        for (group, variance) in model_variances.into_iter().enumerate() {
            for &channel in &self.groups[group] {
                weights[channel] = 1.0 / (self.noise[channel] + variance + self.least[group]);
            }
        }
        weights
    }

    /// The variance of the model in each group, from residuals and their degrees of freedom.
    fn model_variances(&self, residuals: &[f64], freedom: [f64; 2]) -> [f64; 2] {
        let of = |channels: &[usize], freedom: f64| {
            let squares: Vec<f64> = channels.iter().map(|&channel| residuals[channel].powi(2)).collect();
            let noise: Vec<f64> = channels.iter().map(|&channel| self.noise[channel] + self.least[0]).collect();
            model_variance(&squares, &noise, freedom)
        };
        // A group with hardly a degree of freedom has no scale of its own.
        if let Some(group) = (0..2).find(|&group| freedom[group] < 1.0 && !self.groups[group].is_empty()) {
            let both = of(&self.channels, freedom[0] + freedom[1]);
            let mut variances = [both; 2];
            let other = 1 - group;
            if freedom[other] >= 1.0 {
                variances[other] = of(&self.groups[other], freedom[other]);
            }
            return variances;
        }
        [0, 1].map(|group: usize| of(&self.groups[group], freedom[group]))
    }

    /// The logarithm of the factor from a frame of the model to the data, by least squares.
    fn log_scale(&self, frame: &[f64]) -> Result<f64, FitError> {
        let channels = if self.groups[0].len() >= LEAST_GROUP { &self.groups[0] } else { &self.channels };
        Ok(factor(&self.values, frame, channels)?.ln())
    }

    pub(super) fn misfit(&self, estimate: &Estimate, driven: bool) -> Option<Misfit> {
        let group = usize::from(driven);
        let channels = &self.groups[group];
        let of = |values: &[f64]| rms(channels.iter().map(|&channel| values[channel]));
        (!channels.is_empty()).then(|| Misfit {
            channels: channels.len(),
            rms_ohm: of(&self.values),
            misfit_ohm: of(&estimate.residuals),
            noise_ohm: rms(channels.iter().map(|&channel| self.noise[channel].sqrt())),
            model_sd_ohm: estimate.model_variances[group].sqrt(),
        })
    }

    /// The constant part of each residual: its expectation, where the model and the noise have their variances.
    pub(super) fn offsets(&self, estimate: &Estimate) -> Vec<Offset> {
        let mut offsets: Vec<Offset> = Vec::with_capacity(self.channels.len());
        for (channels, variance) in self.groups.iter().zip(estimate.model_variances) {
            offsets.extend(channels.iter().map(|&channel| {
                let share = variance / (variance + self.noise[channel]).max(f64::MIN_POSITIVE);
                let sd_ohm = (share * self.noise[channel]).sqrt();
                Offset { channel, offset_ohm: share * estimate.residuals[channel], sd_ohm }
            }));
        }
        offsets.sort_by_key(|offset| offset.channel);
        offsets
    }
}

/// The estimate of all unknowns that the data determine; the others keep the values of the design, times the common
/// factor of the contact impedances if that is determined.
pub(super) fn determined(model: &Model<'_>, data: &Data) -> crate::Result<(Estimate, Vec<Determination>)> {
    let start = start(model, data)?;
    let all: Vec<usize> = (0..start.len()).collect();
    let mut search = Search { free: all.clone(), centres: start };
    let estimate = search.run(model, data, &search.centres)?;
    let mut determinations = vec![Determination::Determined; all.len()];
    let limits = model.limits(&data.channels);
    let vague: Vec<usize> = all.into_iter().filter(|&one| estimate.sd[one] > limits[one]).collect();
    if vague.is_empty() {
        return Ok((estimate, determinations));
    }
    // What is vague at the estimate but not at the design's value is not what the design says.
    let mut at_design = estimate.unknowns.clone();
    vague.iter().for_each(|&one| at_design[one] = search.centres[one]);
    let weights = data.weights(estimate.model_variances);
    let there = search.information(&model.linear(&at_design)?, &weights)?.sd(search.centres.len(), &search.free);
    for &one in &vague {
        let limit = there[one] <= limits[one];
        determinations[one] = if limit { Determination::Limit } else { Determination::Kept };
    }
    search.free.retain(|&one| determinations[one] != Determination::Kept);
    let estimate = search.run(model, data, &at_design)?;
    Ok((estimate, determinations))
}

/// Unknowns to begin with: the scale of the frames, and the common factor of the contact impedances for each.
fn start(model: &Model<'_>, data: &Data) -> crate::Result<Vec<f64>> {
    if model.contacts() == Contacts::Each {
        let common = model.with_common();
        let (estimate, _) = determined(&common, data)?;
        let factor = estimate.unknowns.get(1).copied().unwrap_or(0.0);
        let mut start = vec![factor; model.unknowns()];
        start[0] = estimate.unknowns[0];
        return Ok(start);
    }
    let mut start = vec![0.0; model.unknowns()];
    start[0] = data.log_scale(&model.frame(&start)?)?;
    Ok(start)
}

/// The equations of a step, of the free unknowns.
struct Information {
    /// Of each group, without the prior.
    parts: [Matrix; 2],
    covariance: Matrix,
}

impl Information {
    /// The degrees of freedom that a group's channels leave.
    fn freedom(&self, group: usize, channels: usize) -> f64 {
        let used: f64 = self.parts[group].values.iter().zip(&self.covariance.values).map(|(a, b)| a * b).sum();
        channels as f64 - used
    }

    /// The standard deviation of each unknown; `NaN` for those that are not free.
    fn sd(&self, count: usize, free: &[usize]) -> Vec<f64> {
        let mut sd = vec![f64::NAN; count];
        free.iter().enumerate().for_each(|(index, &one)| sd[one] = self.covariance.at(index, index).sqrt());
        sd
    }
}

impl Search {
    /// The inverse variance of an unknown's prior: that of the sheet has none.
    fn prior(&self, unknown: usize) -> f64 {
        if unknown == 0 { 0.0 } else { PRIOR_SD.powi(-2) }
    }

    fn run(&self, model: &Model<'_>, data: &Data, start: &[f64]) -> crate::Result<Estimate> {
        let mut unknowns = start.to_vec();
        let counts = [data.groups[0].len() as f64, data.groups[1].len() as f64];
        let mut linear = model.linear(&unknowns)?;
        let mut variances = data.model_variances(&data.residuals(&linear.frame), counts);
        for _ in 0..MOST_VARIANCES {
            let weights = data.weights(variances);
            linear = self.converge(model, data, &weights, &mut unknowns, linear)?;
            let information = self.information_by_group(&linear, data, &weights)?;
            let freedom = [0, 1].map(|group: usize| information.freedom(group, data.groups[group].len()));
            let next = data.model_variances(&data.residuals(&linear.frame), freedom);
            let settled = |group: usize| {
                let scale = next[group].max(variances[group]).max(data.least[group]);
                (next[group] - variances[group]).abs() <= VARIANCE_CHANGE * scale
            };
            let done = settled(0) && settled(1);
            variances = next;
            if done {
                break;
            }
        }
        let weights = data.weights(variances);
        let sd = self.information(&linear, &weights)?.sd(unknowns.len(), &self.free);
        Ok(Estimate { residuals: data.residuals(&linear.frame), unknowns, sd, model_variances: variances })
    }

    /// Gauss-Newton steps at given weights; the model at the last unknowns.
    fn converge(
        &self,
        model: &Model<'_>,
        data: &Data,
        weights: &[f64],
        unknowns: &mut Vec<f64>,
        mut linear: Linear,
    ) -> crate::Result<Linear> {
        for _ in 0..MOST_STEPS {
            let step = self.step(&linear, data, weights, unknowns)?;
            let longest = step.iter().map(|change| change.abs()).fold(0.0, f64::max);
            if longest < SHORTEST_STEP {
                break;
            }
            let before = self.objective(&data.residuals(&linear.frame), weights, unknowns);
            let mut share = (LONGEST_STEP / longest).min(1.0);
            let mut better = None;
            for _ in 0..MOST_HALVINGS {
                let there: Vec<f64> = unknowns.iter().zip(&step).map(|(one, change)| one + share * change).collect();
                let residuals = data.residuals(&model.frame(&there)?);
                if self.objective(&residuals, weights, &there) < before {
                    better = Some(there);
                    break;
                }
                share *= 0.5;
            }
            let Some(there) = better else { break };
            *unknowns = there;
            linear = model.linear(unknowns)?;
        }
        Ok(linear)
    }

    /// Weighted squares of the residuals, and of the distances from the priors' centres.
    fn objective(&self, residuals: &[f64], weights: &[f64], unknowns: &[f64]) -> f64 {
        let misfit: f64 = residuals.iter().zip(weights).map(|(residual, weight)| weight * residual * residual).sum();
        let prior = |&one: &usize| self.prior(one) * (unknowns[one] - self.centres[one]).powi(2);
        misfit + self.free.iter().map(prior).sum::<f64>()
    }

    /// The Gauss-Newton step; 0 for unknowns that are not free.
    fn step(&self, linear: &Linear, data: &Data, weights: &[f64], unknowns: &[f64]) -> crate::Result<Vec<f64>> {
        let information = self.information(linear, weights)?;
        let residuals = data.residuals(&linear.frame);
        let gradient = |&one: &usize| {
            let terms = residuals.iter().zip(weights).enumerate();
            let data: f64 = terms.map(|(channel, (r, w))| w * r * linear.jacobian.at(channel, one)).sum();
            data - self.prior(one) * (unknowns[one] - self.centres[one])
        };
        let gradient: Vec<f64> = self.free.iter().map(gradient).collect();
        let mut short = vec![0.0; self.free.len()];
        information.covariance.product_into(&gradient, &mut short);
        let mut step = vec![0.0; unknowns.len()];
        self.free.iter().zip(short).for_each(|(&one, change)| step[one] = change);
        Ok(step)
    }

    /// The information of all channels as one group.
    fn information(&self, linear: &Linear, weights: &[f64]) -> crate::Result<Information> {
        let all: Vec<usize> = (0..weights.len()).collect();
        self.gather(linear, weights, [&all, &[]])
    }

    fn information_by_group(&self, linear: &Linear, data: &Data, weights: &[f64]) -> crate::Result<Information> {
        self.gather(linear, weights, [&data.groups[0], &data.groups[1]])
    }

    fn gather(&self, linear: &Linear, weights: &[f64], groups: [&[usize]; 2]) -> crate::Result<Information> {
        let count = self.free.len();
        let mut parts = [Matrix::zeros(count, count), Matrix::zeros(count, count)];
        for (part, channels) in parts.iter_mut().zip(groups) {
            for &channel in channels.iter().filter(|&&channel| weights[channel] > 0.0) {
                let row = linear.jacobian.row(channel);
                for (i, &one) in self.free.iter().enumerate() {
                    let factor = weights[channel] * row[one];
                    let target = part.row_mut(i).iter_mut().zip(&self.free);
                    target.for_each(|(value, &other)| *value += factor * row[other]);
                }
            }
        }
        let mut sum = parts[0].clone();
        sum.values.iter_mut().zip(&parts[1].values).for_each(|(value, other)| *value += other);
        (0..count).for_each(|i| *sum.at_mut(i, i) += self.prior(self.free[i]));
        let covariance = invert_spd(&sum).map_err(|_| FitError::Singular)?;
        Ok(Information { parts, covariance })
    }
}
