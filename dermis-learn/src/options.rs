//! The target, noise and options of a training, as the card of a model records them.

use serde::{Deserialize, Serialize};

/// The target image of a network.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Target {
    /// The mean relative change of conductance of each pixel.
    Conductance,
    /// Every touch as a Gaussian of this standard deviation (m), its height the square root of the touch's size: the
    /// force of a press (N), the strength of a Gaussian touch (in cm2). The image is the square of the network's output
    /// with its sign. For scale-free inputs ([`Input::scale_free`](crate::Input::scale_free)), the height is the square root of
    /// the touch's fraction of the total size of all touches, and the image is that times the frame's size.
    Touches {
        /// Standard deviation, m.
        width_m: f64,
    },
}

impl Target {
    /// A pixel of the image from the network's output.
    pub(crate) fn image(&self, output: f32) -> f32 {
        match self {
            Target::Conductance => output,
            Target::Touches { .. } => output * output.abs(),
        }
    }
}

/// Noise that is added to a difference, drawn for each training step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Standard deviation of each channel's noise, ohm.
    pub sd_ohm: Vec<f32>,
    /// The noise of each sample is this times a factor between these, uniform in its logarithm.
    pub factor: [f32; 2],
    /// Drift of the coating's conductance after the untouched frame: standard deviation of the relative change.
    pub coat_drift: f32,
    /// Drift of each contact's resistance: standard deviation relative to the design's.
    pub contact_drift: f32,
    /// Domain randomization; none by default.
    #[serde(default, rename = "misfit", skip_serializing_if = "Option::is_none")]
    pub domain_randomization: Option<DomainRandomization>,
}

/// Differences between simulation and real skins, relative to the change by a touch (domain randomization: Tobin et
/// al., 2017, DOI 10.1109/IROS.2017.8202133).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DomainRandomization {
    /// A touch also changes the whole coating uniformly, as in a stretched membrane: the root mean square of this
    /// change over the root mean square of the touch's own change. Uniform between two bounds.
    pub whole: [f32; 2],
    /// Gain error of each channel: standard deviation of the logarithm of the gain.
    pub loudness_sd: f32,
    /// White noise of the inputs, its standard deviation over their root mean square. Uniform between two bounds.
    pub relative: [f32; 2],
    /// Each input is missing with a probability that is uniform from zero to this.
    pub missing: f32,
}

impl DomainRandomization {
    /// For real skins with an unknown instrument: 0.3 to 0.6, 0.5, up to 2, 0.3.
    pub fn usual() -> Self {
        DomainRandomization { whole: [0.3, 0.6], loudness_sd: 0.5, relative: [0.0, 2.0], missing: 0.3 }
    }
}

impl Noise {
    /// Only white noise, with given standard deviations.
    pub fn white(sd_ohm: Vec<f32>) -> Self {
        Noise { sd_ohm, factor: [1.0, 1.0], coat_drift: 0.0, contact_drift: 0.0, domain_randomization: None }
    }
}

/// Training options.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainOptions {
    /// Samples per step.
    pub batch: usize,
    /// Maximum number of epochs.
    pub epochs: usize,
    /// Samples per epoch; all of them by default.
    pub epoch_samples: Option<usize>,
    /// Learning rate of Adam.
    pub rate: f32,
    /// Learning rate schedule.
    pub schedule: Schedule,
    /// The seed of weights, order and noise.
    pub seed: u64,
    /// Training ends when the smallest test loss has not decreased by this fraction...
    pub least_gain: f64,
    /// ... in this many epochs.
    pub patience: usize,
}

/// Learning rate schedule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// Constant.
    Constant,
    /// Half a cosine, to zero at the end of the last epoch (Loshchilov and Hutter, 2017, arXiv 1608.03983, Eq. 5).
    Cosine,
}

impl Default for TrainOptions {
    /// The paper's minibatch, Keras' learning rate; training ends if the test loss has not decreased by 0.5 % in 5
    /// epochs.
    fn default() -> Self {
        TrainOptions {
            batch: 360,
            epochs: 40,
            epoch_samples: None,
            rate: 1e-3,
            schedule: Schedule::Constant,
            seed: 1,
            least_gain: 0.005,
            patience: 5,
        }
    }
}

impl TrainOptions {
    /// Whether all epochs are finished, or the test loss has stopped decreasing.
    pub(crate) fn is_done(&self, epochs: &[Epoch]) -> bool {
        let least = |epochs: &[Epoch]| epochs.iter().map(|epoch| epoch.test_loss).fold(f64::INFINITY, f64::min);
        let before = epochs.len().saturating_sub(self.patience);
        let stands = before > 0 && least(&epochs[before..]) > (1.0 - self.least_gain) * least(&epochs[..before]);
        // With a decreasing learning rate the best loss is reached at the end.
        epochs.len() >= self.epochs || stands && self.schedule == Schedule::Constant
    }

    /// Steps per epoch, for a number of training samples.
    pub(crate) fn steps_per_epoch(&self, samples: usize) -> usize {
        (self.epoch_samples.unwrap_or(usize::MAX).min(samples) / self.batch).max(1)
    }

    /// The learning rate of a step, numbered from 1.
    pub(crate) fn rate_at(&self, step: u64, steps_per_epoch: usize) -> f32 {
        match self.schedule {
            Schedule::Constant => self.rate,
            Schedule::Cosine => {
                let part = (step as f64 / (steps_per_epoch * self.epochs) as f64).min(1.0);
                (f64::from(self.rate) * 0.5 * (1.0 + (std::f64::consts::PI * part).cos())) as f32
            }
        }
    }
}

/// A finished epoch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Mean square error over the steps, on disturbed inputs, while the weights change.
    pub training_loss: f64,
    /// Mean square error on the test samples after the epoch, with the same disturbances.
    pub test_loss: f64,
    /// Its duration, s.
    pub seconds: f64,
}
