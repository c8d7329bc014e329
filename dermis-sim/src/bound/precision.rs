//! The precision of a frame: its inverse covariance, from white noise, the noise of the drives' currents, and drift.

use crate::noise::Noise;
use dermis::estimate::drift::{DriftSpread, directions};
use dermis::estimate::whitening::Whitening;
use dermis::forward::{ElectrodeNetwork, ForwardModel};
use dermis::protocol::Protocol;

/// The transform of frames after which their inner product is that of the inverse covariance.
///
/// The covariance is `s^2 I + M M'`: white noise, and a column of `M` for every disturbance, as long as its standard
/// deviation.
#[derive(Debug, Clone)]
pub(super) struct Precision {
    sd_ohm: f64,
    /// Of values over the white noise.
    whitening: Whitening,
}

impl Precision {
    /// The precision of the mean of `frames` frames: noise decreases with their number, drift does not.
    pub(super) fn new(
        model: &ForwardModel,
        untouched: &ElectrodeNetwork,
        noise: Noise,
        drift: DriftSpread,
        frames: usize,
    ) -> crate::Result<Self> {
        let protocol = model.protocol();
        let sd_ohm = noise.sd_ohm / (frames as f64).sqrt();
        let mut disturbances = drive_errors(protocol, &frame_of(untouched, protocol), sd_ohm / noise.reference_ohm);
        let drifts = directions(model, &drift)?;
        disturbances.extend((0..drifts.rows).map(|row| drifts.row(row).to_vec()));
        Ok(Precision { sd_ohm, whitening: Whitening::default() }.with_disturbances(disturbances))
    }

    /// The precision of a frame with more disturbances.
    pub(super) fn with_disturbances(self, more: Vec<Vec<f64>>) -> Precision {
        let over_noise = |change: Vec<f64>| change.into_iter().map(|value| value / self.sd_ohm).collect();
        Precision { whitening: self.whitening.with(more.into_iter().map(over_noise)), ..self }
    }

    pub(super) fn whiten(&self, mut change: Vec<f64>) -> Vec<f64> {
        change.iter_mut().for_each(|value| *value /= self.sd_ohm);
        self.whitening.apply(&mut change);
        change
    }
}

/// A frame as the instrument reports it.
pub(super) fn frame_of(network: &ElectrodeNetwork, protocol: &Protocol) -> Vec<f64> {
    let mut frame = network.frame(protocol);
    protocol.drop_signs(&mut frame);
    frame.0
}

/// For every drive the change of its values by one standard deviation of the error of its current.
fn drive_errors(protocol: &Protocol, rest: &[f64], relative: f64) -> Vec<Vec<f64>> {
    if relative == 0.0 {
        return Vec::new();
    }
    let (drives, drive_of) = protocol.drives();
    let of_drive = |drive: usize| {
        let value = |(own, value): (&usize, &f64)| if *own == drive { relative * value } else { 0.0 };
        drive_of.iter().zip(rest).map(value).collect()
    };
    (0..drives.len()).map(of_drive).collect()
}
