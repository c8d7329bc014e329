//! The mean untouched frame, and what is known of its errors.

use dermis::estimate::noise::{ChannelNoise, disagreement};
use dermis::estimate::scale::robust;
use dermis::frame::{Frame, mean, reciprocal};
use dermis::identify::DRIVEN_ERROR;
use dermis::protocol::Protocol;
use dermis::stats::rms;

/// Error of the model and the instrument, relative to the root mean square of the values without a driven electrode.
const RELATIVE_ERROR: f64 = 2e-3;

/// Reciprocal values disagree by the converter's steps and noise: a disagreement of more than this part of the root mean square
/// of the values is a fault.
const MAX_DISAGREEMENT: f64 = 0.03;

/// Difference of reciprocal values that errors of the currents may explain, relative, and how often their noise.
const UNLIKE_SHARE: f64 = 5e-3;
const UNLIKE_NOISE: f64 = 6.0;
/// Values that are this close to the largest of their drive are as large, relative.
const AS_LARGE: f64 = 2e-3;
/// Standard deviation of a value without weight, relative.
const WITHOUT_WEIGHT: f64 = 1e6;

/// The sign of a value is that of the model if the model's value is this many of its standard deviations from zero.
const KNOWN_SD: f64 = 3.0;

/// The amplitude of noise about zero scatters by 0.76 of its mean (the half-normal distribution): one that scatters by more
/// than half of that over at least this many frames is noise.
const NOISE_SHARE: f64 = 0.38;
const NOISE_FRAMES: usize = 4;

/// The mean untouched frame, divided by one factor.
#[derive(Debug, Clone)]
pub(super) struct Data {
    /// Ohm, over the factor.
    pub values: Vec<f64>,
    /// Standard deviation of each value about the model, ohm.
    pub sd: Vec<f64>,
    /// Ohm of the frame per ohm of the design.
    pub scale: f64,
    /// Noise of one frame.
    pub noise: ChannelNoise,
    /// Whether each value scatters like noise about zero, or its amplitude.
    pub is_noise: Vec<bool>,
    /// Whether the values have lost their signs.
    amplitude_only: bool,
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
        let (mut mean, mut model) = (mean(frames)?, model.to_vec());
        protocol.drop_signs(&mut mean);
        protocol.drop_signs(&mut model);
        let scale = scale(protocol, &mean, &model)?;
        let values: Vec<f64> = mean.iter().map(|value| value / scale).collect();
        let groups = protocol.channels_by_drive();
        let reciprocal = reciprocal(protocol);
        let noise = ChannelNoise::of(frames, protocol)?;
        // That of the mean; reciprocal channels also contain what the scatter does not, as the steps of the converter.
        let of_mean_ohm = noise.by_group_ohm().map(|sd| sd / (frames.len() as f64).sqrt() / scale);
        // A wrong value must not widen what is allowed for the others: the model gives the size of the frame.
        let part = if groups[0].is_empty() { &groups[1] } else { &groups[0] };
        let size = rms(part.iter().map(|&channel| model[channel]));
        let noise_ohm = [0, 1].map(|group: usize| {
            of_mean_ohm[group].max(disagreement(&reciprocal, &values, &groups[group]).min(MAX_DISAGREEMENT * size))
        });
        let sd = |(channel, value): (usize, &f64)| {
            let driven = protocol.channels()[channel].touches_driven();
            let own = if driven { DRIVEN_ERROR * value.abs().max(model[channel].abs()) } else { 0.0 };
            noise_ohm[usize::from(driven)].hypot(RELATIVE_ERROR * size).hypot(own).hypot(discretisation_ohm[channel])
        };
        let mut sd: Vec<f64> = values.iter().enumerate().map(sd).collect();
        for channel in out_of_range(protocol, &reciprocal, &values, &noise_ohm) {
            sd[channel] = WITHOUT_WEIGHT * values[channel].abs().max(size);
        }
        let is_noise = (0..values.len()).map(|channel| is_noise(frames, channel)).collect();
        Some(Data { values, sd, scale, noise, is_noise, amplitude_only: protocol.amplitude_only() })
    }

    /// The value of a channel, ohm, with the sign of the model's value if signs are lost: their difference is then that of
    /// the amplitudes, and derivatives of the model's values are derivatives of it.
    pub(super) fn value(&self, channel: usize, of_model: f64) -> f64 {
        let value = self.values[channel];
        if self.amplitude_only { value.copysign(of_model) } else { value }
    }

    /// The data for a model with some values, ohm, and standard deviations of these: where the model does not tell the sign
    /// that was lost, a value may differ from it as much as the model may be off.
    pub(super) fn with_known_signs(&self, model: &[f64], spread_ohm: impl Fn(usize) -> f64) -> Self {
        let mut data = self.clone();
        for channel in (0..model.len()).filter(|_| self.amplitude_only) {
            let spread_ohm = spread_ohm(channel);
            if model[channel].abs() < KNOWN_SD * spread_ohm {
                data.sd[channel] = data.sd[channel].hypot(spread_ohm);
            }
        }
        data
    }
}

/// Whether the values of a channel are noise.
fn is_noise(frames: &[Frame], channel: usize) -> bool {
    let values = || frames.iter().map(|frame| frame[channel]);
    let mean = values().sum::<f64>() / frames.len() as f64;
    frames.len() >= NOISE_FRAMES && rms(values().map(|value| value - mean)) > NOISE_SHARE * mean.abs()
}

/// The channels whose value seems to be out of the converter's range: it is the largest of its drive with the same gain (with
/// or without a driven electrode), and unlike that of a reciprocal channel. By faults, such as exchanged wires, values become
/// much larger than those of the design.
fn out_of_range(
    protocol: &Protocol,
    reciprocal: &[Vec<(usize, f64)>],
    values: &[f64],
    noise_ohm: &[f64; 2],
) -> Vec<usize> {
    let (drives, drive_of) = protocol.drives();
    let is_driven = |channel: usize| usize::from(protocol.channels()[channel].touches_driven());
    let mut largest = vec![[0.0f64; 2]; drives.len()];
    for (channel, value) in values.iter().enumerate() {
        let of_gain = &mut largest[drive_of[channel]][is_driven(channel)];
        *of_gain = of_gain.max(value.abs());
    }
    let is_largest =
        |channel: usize| values[channel].abs() >= (1.0 - AS_LARGE) * largest[drive_of[channel]][is_driven(channel)];
    let noise = |channel: usize| noise_ohm[is_driven(channel)];
    let is_unlike = |channel: usize| {
        reciprocal[channel].iter().any(|&(partner, sign)| {
            let noise = UNLIKE_NOISE * noise(channel).hypot(noise(partner));
            let size = values[channel].abs().max(values[partner].abs());
            (values[channel] - sign * values[partner]).abs() > noise.max(UNLIKE_SHARE * size)
        })
    };
    (0..values.len()).filter(|&channel| is_largest(channel) && is_unlike(channel)).collect()
}

/// The factor from the model to a frame, of the channels without a driven electrode if there are any; `None` where it is not
/// positive.
fn scale(protocol: &Protocol, frame: &[f64], model: &[f64]) -> Option<f64> {
    let [free, driven] = protocol.channels_by_drive();
    Some(robust(frame, model, if free.is_empty() { driven } else { free })).filter(|&scale| scale > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of a network with random symmetric impedances.
    fn values(protocol: &Protocol) -> Vec<f64> {
        let impedance = |a: usize, b: usize| (1.7 * (a.min(b) as f64) + 0.3 * (a.max(b) as f64).powi(2)).sin();
        let value = |one: &dermis::protocol::Channel| {
            let ([a, b], [c, d]) = (one.drive, one.measure);
            impedance(a, c) - impedance(a, d) - impedance(b, c) + impedance(b, d)
        };
        protocol.channels().iter().map(value).collect()
    }

    #[test]
    fn a_clipped_value_is_out_of_range_and_a_reciprocal_frame_has_none() {
        let protocol = Protocol::adjacent(12).unwrap();
        let reciprocal = reciprocal(&protocol);
        let mut values = values(&protocol);
        let noise_ohm = [1e-4; 2];
        assert_eq!(out_of_range(&protocol, &reciprocal, &values, &noise_ohm), Vec::<usize>::new());
        // The largest value of a drive that is not the largest of the reciprocal one's drive.
        let channels = protocol.channels();
        let of_drive = |drive: [usize; 2]| {
            (0..values.len()).filter(move |&c| channels[c].drive == drive && !channels[c].touches_driven())
        };
        let largest =
            |drive: [usize; 2]| of_drive(drive).max_by(|&a, &b| values[a].abs().total_cmp(&values[b].abs())).unwrap();
        let clipped = (0..12).map(|k| largest([k, (k + 1) % 12])).find(|&c| {
            let partner = reciprocal[c][0].0;
            largest(channels[partner].drive) != partner
        });
        let clipped = clipped.unwrap();
        values[clipped] *= 0.99;
        assert_eq!(out_of_range(&protocol, &reciprocal, &values, &noise_ohm), [clipped]);
    }
}
