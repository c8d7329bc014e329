//! The precision of a frame: its inverse covariance, from white noise, the noise of the drives' currents, and drift.

use super::{LOG_RADIUS, LOG_RADIUS_SD, PARAMETERS};
use crate::noise::Noise;
use dermis::forward::{ElectrodeNetwork, ForwardModel};
use dermis::linalg::{Matrix, invert_spd};
use dermis::protocol::Protocol;

/// Drift since the untouched frame was taken, which is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriftSpread {
    /// Standard deviation of the relative change of the whole coat's conductance.
    pub coat: f64,
    /// Standard deviation of the change of each contact's resistance, relative to the design's.
    pub contact: f64,
}

/// Vectors whose inner product is that of the inverse covariance of a frame.
///
/// The covariance is `s^2 I + M M'`: white noise, and a column of `M` for every disturbance, as long as its standard
/// deviation. By the formula of Woodbury its inverse is `(I - M C^-1 M') / s^2` with `C = s^2 I + M' M`.
#[derive(Debug, Clone)]
pub(super) struct Precision {
    sd_ohm: f64,
    disturbances: Vec<Vec<f64>>,
    /// `C^-1`.
    inverse: Matrix,
}

/// A change of a frame, prepared for inner products.
#[derive(Debug, Clone)]
pub(super) struct Whitened {
    change: Vec<f64>,
    /// `M' a`.
    along: Vec<f64>,
    /// `C^-1 M' a`.
    removed: Vec<f64>,
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
        let frame = |network: &ElectrodeNetwork| frame_of(network, protocol);
        let rest = frame(untouched);
        let mut disturbances = drive_errors(protocol, &rest, sd_ohm / noise.reference_ohm);
        if drift.coat > 0.0 {
            disturbances.push(rest.iter().map(|value| drift.coat * value).collect());
        }
        if drift.contact > 0.0 {
            let count = protocol.electrode_count();
            for electrode in 0..count {
                let mut series_ohm = vec![0.0; count];
                series_ohm[electrode] = drift.contact * model.contact_resistance_ohm(electrode);
                let changed = frame(&untouched.clone().with_series(&series_ohm)?);
                disturbances.push(changed.iter().zip(&rest).map(|(changed, rest)| changed - rest).collect());
            }
        }
        Ok(Precision::with_covariance(sd_ohm, disturbances))
    }

    /// The precision of a frame with more disturbances.
    pub(super) fn with_disturbances(&self, more: Vec<Vec<f64>>) -> Precision {
        Precision::with_covariance(self.sd_ohm, self.disturbances.iter().cloned().chain(more).collect())
    }

    fn with_covariance(sd_ohm: f64, disturbances: Vec<Vec<f64>>) -> Precision {
        let count = disturbances.len();
        let mut gram = Matrix::zeros(count, count);
        for (i, row) in gram.values.chunks_exact_mut(count.max(1)).enumerate() {
            row.iter_mut().zip(&disturbances).for_each(|(value, other)| *value = dot(&disturbances[i], other));
            row[i] += sd_ohm * sd_ohm;
        }
        let inverse = invert_spd(&gram).expect("a Gram matrix plus a positive diagonal");
        Precision { sd_ohm, disturbances, inverse }
    }

    pub(super) fn whiten(&self, change: Vec<f64>) -> Whitened {
        let along: Vec<f64> = self.disturbances.iter().map(|column| dot(column, &change)).collect();
        let mut removed = vec![0.0; along.len()];
        self.inverse.product_into(&along, &mut removed);
        Whitened { change, along, removed }
    }

    /// The information about the parameters of a press along which the frame changes by `columns`, with what is known of
    /// the tip radius before.
    pub(super) fn information(&self, columns: &[Whitened; PARAMETERS]) -> Matrix {
        let mut information = Matrix::zeros(PARAMETERS, PARAMETERS);
        for (i, a) in columns.iter().enumerate() {
            columns.iter().enumerate().for_each(|(j, b)| *information.at_mut(i, j) = self.inner(a, b));
        }
        *information.at_mut(LOG_RADIUS, LOG_RADIUS) += LOG_RADIUS_SD.powi(-2);
        information
    }

    /// `a' R^-1 b` for the covariance `R`.
    pub(super) fn inner(&self, a: &Whitened, b: &Whitened) -> f64 {
        (dot(&a.change, &b.change) - dot(&a.along, &b.removed)) / (self.sd_ohm * self.sd_ohm)
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

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
