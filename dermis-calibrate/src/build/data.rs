//! The mean untouched frame, and what is known of its errors.

use dermis::frame::{Frame, mean, twins};
use dermis::identify::DRIVEN_ERROR;
use dermis::protocol::Protocol;
use dermis::stats::{rms, upper_median};

/// Error of the model and the instrument, relative to the root mean square of the values without a driven electrode.
const RELATIVE_ERROR: f64 = 2e-3;

/// The mean untouched frame, divided by one factor.
#[derive(Debug, Clone)]
pub(super) struct Data {
    /// Ohm, over the factor.
    pub values: Vec<f64>,
    /// Standard deviation of each value about the model, ohm.
    pub sd: Vec<f64>,
    /// Ohm of the frame per ohm of the design.
    pub scale: f64,
    /// Noise of the mean frame in the channels without and with a driven electrode, over the factor, ohm.
    pub noise_ohm: [f64; 2],
}

impl Data {
    /// The data of some frames; `None` where their sign is opposite to that of the model, or where they are zero.
    /// `discretisation_ohm` is what the mesh of the model may be off in each channel.
    pub(super) fn new(
        protocol: &Protocol,
        frames: &[Frame],
        model: &[f64],
        discretisation_ohm: &[f64],
    ) -> Option<Self> {
        let mean = mean(frames)?;
        let scale = scale(protocol, &mean, model)?;
        let values: Vec<f64> = mean.iter().map(|value| value / scale).collect();
        let groups = [false, true].map(|driven| {
            let channels = protocol.channels().iter().enumerate();
            channels.filter(|(_, one)| one.touches_driven() == driven).map(|(at, _)| at).collect::<Vec<usize>>()
        });
        let noise_ohm = [0, 1].map(|group: usize| {
            let scatter = scatter(frames, &mean, &groups[group]) / scale;
            scatter.max(disagreement(protocol, &values, &groups[group]))
        });
        // A wrong value must not widen what is allowed for the others: the model gives the size of the frame.
        let part = if groups[0].is_empty() { &groups[1] } else { &groups[0] };
        let size = rms(part.iter().map(|&channel| model[channel]));
        let sd = |(channel, value): (usize, &f64)| {
            let driven = protocol.channels()[channel].touches_driven();
            let own = if driven { DRIVEN_ERROR * value.abs().max(model[channel].abs()) } else { 0.0 };
            noise_ohm[usize::from(driven)].hypot(RELATIVE_ERROR * size).hypot(own).hypot(discretisation_ohm[channel])
        };
        let sd = values.iter().enumerate().map(sd).collect();
        Some(Data { values, sd, scale, noise_ohm })
    }
}

/// The median ratio of a frame to the model, over the larger half of the channels without a driven electrode: wrong
/// values of some electrodes do not change it.
fn scale(protocol: &Protocol, frame: &[f64], model: &[f64]) -> Option<f64> {
    let free: Vec<usize> = (0..frame.len()).filter(|&channel| !protocol.channels()[channel].touches_driven()).collect();
    let channels = if free.is_empty() { (0..frame.len()).collect() } else { free };
    let sizes: Vec<f64> = channels.iter().map(|&channel| model[channel].abs()).collect();
    let least = upper_median(&sizes)?;
    let large = channels.iter().filter(|&&channel| model[channel].abs() >= least && model[channel] != 0.0);
    let ratios: Vec<f64> = large.map(|&channel| frame[channel] / model[channel]).collect();
    upper_median(&ratios).filter(|&scale| scale > 0.0)
}

/// Standard deviation of the mean of the frames from their scatter, the median over some channels; 0 for one frame.
fn scatter(frames: &[Frame], mean: &[f64], channels: &[usize]) -> f64 {
    let count = frames.len() as f64;
    if frames.len() < 2 {
        return 0.0;
    }
    let variance = |&channel: &usize| {
        let squares: f64 = frames.iter().map(|frame| (frame[channel] - mean[channel]).powi(2)).sum();
        squares / (count - 1.0) / count
    };
    upper_median(&channels.iter().map(variance).collect::<Vec<f64>>()).unwrap_or(0.0).sqrt()
}

/// Robust standard deviation of a value from the difference of channels that measure the same quantity: it contains
/// what the scatter does not, as the steps of the converter.
fn disagreement(protocol: &Protocol, values: &[f64], channels: &[usize]) -> f64 {
    let twins = twins(protocol);
    let differences: Vec<f64> = channels
        .iter()
        .flat_map(|&channel| twins[channel].iter().map(move |&(twin, sign)| (channel, twin, sign)))
        .map(|(channel, twin, sign)| (values[channel] - sign * values[twin]).abs() / 2f64.sqrt())
        .collect();
    // Of a normal distribution: 1.4826 times the median of the absolute values.
    1.4826 * upper_median(&differences).unwrap_or(0.0)
}
