//! Gauss-Newton steps with the variances of the channels estimated between them.

use crate::estimate::least_squares::{Control, LeastSquares, Normal, Steps, minimise};
use crate::estimate::noise::{ChannelNoise, NoiseSource};
use crate::fit::model::Model;
use crate::fit::variance::{least_variance, model_variance};
use crate::fit::{Contacts, Determination, FitError, Misfit, Offset, PRIOR_SD, factor};
use crate::frame::{Frame, mean, without_signs};
use crate::linalg::Matrix;
use crate::protocol::Protocol;
use crate::stats::rms;

/// Steps at given variances; the equations are nearly linear in the logarithms, and few are used.
const STEPS: Steps = Steps { most: 25, control: Control::Halving(10), shortest: 1e-8, least_decrease: 0.0 };
/// Longest step of a logarithm.
const LONGEST_STEP: f64 = 2.0;
/// Maximum number of estimates of the variances, and the relative change that ends them.
const MAX_VARIANCES: usize = 12;
const VARIANCE_CHANGE: f64 = 0.01;
/// Fewer channels give no scale of their own.
const MIN_GROUP: usize = 3;

/// The mean of the frames, and what is known of its channels.
pub(super) struct Data {
    /// The channels in use.
    pub channels: Vec<usize>,
    values: Vec<f64>,
    /// Standard deviation of one frame, of each group.
    frame_noise_ohm: [f64; 2],
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
    /// # Panics
    /// Without a frame.
    pub(super) fn new(protocol: &Protocol, frames: &[Frame], left_out: &[usize]) -> Self {
        let frames = without_signs(protocol, frames);
        let values = mean(&frames).expect("a frame").0;
        let used = |channel: &usize| !left_out.contains(channel);
        let channels: Vec<usize> = (0..values.len()).filter(used).collect();
        let groups = protocol.channels_by_drive().map(|group| group.into_iter().filter(used).collect::<Vec<usize>>());
        let noise = ChannelNoise::of_used(&frames, protocol, |channel| used(&channel)).expect("a frame");
        let frame_noise_ohm = noise.by_group_ohm();
        // Of frames without scatter, the variance of the model contains that of the noise.
        let noise = match noise.source() {
            NoiseSource::Scatter => noise.sd_of_mean_ohm().into_iter().map(|sd| sd * sd).collect(),
            NoiseSource::Reciprocity | NoiseSource::Frames | NoiseSource::Assumed => vec![0.0; values.len()],
        };
        let least = [0, 1].map(|group: usize| least_variance(groups[group].iter().map(|&channel| values[channel])));
        Data { channels, values, frame_noise_ohm, noise, groups, least }
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
        let channels = if self.groups[0].len() >= MIN_GROUP { &self.groups[0] } else { &self.channels };
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
            noise_ohm: self.frame_noise_ohm[group],
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
    let information = search.information(&model.derivatives(&at_design)?, data, &weights)?;
    let there = information.sd(search.centres.len(), &search.free);
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

/// The information of the data about the free unknowns.
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
        let counts = [data.groups[0].len() as f64, data.groups[1].len() as f64];
        let mut point = Point::new(model, data, start.to_vec())?;
        let mut variances = data.model_variances(&point.residuals, counts);
        let mut derivatives = Matrix::zeros(0, 0);
        for _ in 0..MAX_VARIANCES {
            let weights = data.weights(variances);
            point = minimise(&Weighted { search: self, model, data, weights: &weights }, point, &STEPS)?.point;
            derivatives = model.derivatives(&point.unknowns)?;
            let information = self.information(&derivatives, data, &weights)?;
            let freedom = [0, 1].map(|group: usize| information.freedom(group, data.groups[group].len()));
            let next = data.model_variances(&point.residuals, freedom);
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
        let Point { unknowns, residuals } = point;
        let weights = data.weights(variances);
        let information = self.information(&derivatives, data, &weights)?;
        let mut sd = information.sd(unknowns.len(), &self.free);
        for kept in (0..unknowns.len()).filter(|one| !self.free.contains(one)) {
            let shifts = self.shifts(kept, &derivatives, &weights, &information.covariance);
            let add = |(&one, shift): (&usize, f64)| sd[one] = sd[one].hypot(PRIOR_SD * shift);
            self.free.iter().zip(shifts).for_each(add);
        }
        Ok(Estimate { residuals, unknowns, sd, model_variances: variances })
    }

    /// How much the free unknowns change with one that is kept.
    fn shifts(&self, kept: usize, derivatives: &Matrix, weights: &[f64], covariance: &Matrix) -> Vec<f64> {
        let with_kept = |&one: &usize| -> f64 {
            let products = weights.iter().enumerate();
            products
                .map(|(channel, weight)| weight * derivatives.at(channel, one) * derivatives.at(channel, kept))
                .sum()
        };
        let mut shifts = vec![0.0; self.free.len()];
        covariance.product_into(&self.free.iter().map(with_kept).collect::<Vec<f64>>(), &mut shifts);
        shifts
    }

    fn information(&self, derivatives: &Matrix, data: &Data, weights: &[f64]) -> crate::Result<Information> {
        let of_group = |channels: &Vec<usize>| self.normal(derivatives, weights, channels, &[]);
        let [others, driven] = data.groups.each_ref().map(of_group);
        let mut all = others.clone();
        all.matrix.values.iter_mut().zip(&driven.matrix.values).for_each(|(value, other)| *value += other);
        self.free.iter().enumerate().for_each(|(index, &one)| all.add_prior(index, self.prior(one), 0.0));
        let covariance = all.factor()?.inverse();
        Ok(Information { parts: [others.matrix, driven.matrix], covariance })
    }

    /// The equations of a step of the free unknowns from some channels, without the prior; without residuals those of the
    /// information.
    fn normal(&self, derivatives: &Matrix, weights: &[f64], channels: &[usize], residuals: &[f64]) -> Normal {
        let used: Vec<usize> = channels.iter().copied().filter(|&channel| weights[channel] > 0.0).collect();
        let weighted = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            used.iter().map(|&channel| weights[channel].sqrt() * value(channel)).collect()
        };
        let columns: Vec<Vec<f64>> =
            self.free.iter().map(|&one| weighted(&|channel| derivatives.at(channel, one))).collect();
        let residual = |channel: usize| residuals.get(channel).copied().unwrap_or(0.0);
        Normal::new(&columns.iter().map(Vec::as_slice).collect::<Vec<&[f64]>>(), &weighted(&residual))
    }
}

/// Some unknowns, and what they leave of the mean of the frames.
struct Point {
    unknowns: Vec<f64>,
    residuals: Vec<f64>,
}

impl Point {
    fn new(model: &Model<'_>, data: &Data, unknowns: Vec<f64>) -> crate::Result<Self> {
        let residuals = data.residuals(&model.frame(&unknowns)?);
        Ok(Point { unknowns, residuals })
    }
}

/// The search at given weights of the channels.
struct Weighted<'a> {
    search: &'a Search,
    model: &'a Model<'a>,
    data: &'a Data,
    weights: &'a [f64],
}

impl Weighted<'_> {
    fn distance_from_prior(&self, point: &Point, unknown: usize) -> f64 {
        point.unknowns[unknown] - self.search.centres[unknown]
    }
}

impl LeastSquares for Weighted<'_> {
    type Point = Point;
    type Equations = Normal;
    type Error = crate::Error;

    fn cost(&self, point: &Point) -> f64 {
        let squares = point.residuals.iter().zip(self.weights).map(|(residual, weight)| weight * residual * residual);
        let prior = |&one: &usize| self.search.prior(one) * self.distance_from_prior(point, one).powi(2);
        squares.sum::<f64>() + self.search.free.iter().map(prior).sum::<f64>()
    }

    fn equations(&self, point: &Point) -> crate::Result<Normal> {
        let derivatives = self.model.derivatives(&point.unknowns)?;
        let mut normal = self.search.normal(&derivatives, self.weights, &self.data.channels, &point.residuals);
        for (index, &one) in self.search.free.iter().enumerate() {
            normal.add_prior(index, self.search.prior(one), self.distance_from_prior(point, one));
        }
        Ok(normal)
    }

    fn limit(&self, _: &Point, step: &mut [f64]) {
        let longest = step.iter().map(|change| change.abs()).fold(0.0, f64::max);
        let share = (LONGEST_STEP / longest).min(1.0);
        step.iter_mut().for_each(|change| *change *= share);
    }

    fn moved(&self, from: &Point, step: &[f64]) -> Option<Point> {
        let mut unknowns = from.unknowns.clone();
        self.search.free.iter().zip(step).for_each(|(&one, change)| unknowns[one] += change);
        Point::new(self.model, self.data, unknowns).ok()
    }
}
