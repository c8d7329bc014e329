//! The information of the readings of a layout about a weak press.

use super::touch::PARAMETERS;
use crate::noise::undriven_rms;
use dermis::linalg::Matrix;
use dermis::protocol::{Channel, Protocol};

/// A symmetric matrix of the parameters of a press.
pub(super) type Square = [[f64; PARAMETERS]; PARAMETERS];

/// The noise of the readings, and what is known of a press.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Instrument {
    /// Root mean square of the untouched frame's values without a driven electrode, over the noise of a reading.
    pub(super) signal_to_noise: f64,
    /// The resistor across which the currents are read, ohm.
    pub(super) reference_ohm: f64,
    /// What is known of each parameter before: the inverse of its variance.
    pub(super) known: [f64; PARAMETERS],
}

/// The readings of a frame.
#[derive(Debug, Clone)]
pub(super) struct Readings {
    protocol: Protocol,
    /// For each channel the index of its drive.
    pub(super) drive_of: Vec<usize>,
    pub(super) drive_count: usize,
    instrument: Instrument,
}

/// The untouched frame of a layout.
#[derive(Debug, Clone, Default)]
pub(super) struct Rest {
    pub(super) values_ohm: Vec<f64>,
    pub(super) sd_ohm: f64,
    /// For each drive `R_ref^2 + z' z`.
    pub(super) scales: Vec<f64>,
}

impl Readings {
    pub(super) fn new(protocol: &Protocol, instrument: Instrument) -> Self {
        let (drives, drive_of) = protocol.drives();
        Readings { drive_count: drives.len(), drive_of, protocol: protocol.clone(), instrument }
    }

    pub(super) fn channels(&self) -> &[Channel] {
        self.protocol.channels()
    }

    pub(super) fn electrode_count(&self) -> usize {
        self.protocol.electrode_count()
    }

    /// The untouched frame of the electrodes at some candidates.
    pub(super) fn rest(&self, impedance_ohm: &Matrix, chosen: &[usize]) -> Rest {
        let at = |a: usize, b: usize| impedance_ohm.at(chosen[a], chosen[b]);
        let value = |channel: &Channel| {
            let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
            (at(plus, source) - at(minus, source)) - (at(plus, sink) - at(minus, sink))
        };
        let values_ohm: Vec<f64> = self.channels().iter().map(value).collect();
        let Instrument { signal_to_noise, reference_ohm, .. } = self.instrument;
        let sd_ohm = undriven_rms(&self.protocol, &values_ohm).unwrap_or(0.0) / signal_to_noise;
        let mut scales = vec![reference_ohm * reference_ohm; self.drive_count];
        self.drive_of.iter().zip(&values_ohm).for_each(|(&drive, value)| scales[drive] += value * value);
        Rest { values_ohm, sd_ohm, scales }
    }

    /// The information about a press, with what is known before. `change` has for each pair of electrodes
    /// the change of the transfer impedance by each parameter.
    ///
    /// The noise of a drive's current is common to its values: by the formula of Sherman and Morrison it takes
    /// `a a' / (R_ref^2 + z' z)` from the information of a drive, with `a = J' z`.
    pub(super) fn information(&self, change: &[[f32; PARAMETERS]], rest: &Rest) -> Square {
        let count = self.electrode_count();
        let mut all = [[0.0f64; PARAMETERS]; PARAMETERS];
        let mut along = vec![[0.0f64; PARAMETERS]; self.drive_count];
        for ((channel, &drive), &value) in self.channels().iter().zip(&self.drive_of).zip(&rest.values_ohm) {
            let row = reading(change, count, channel);
            for i in 0..PARAMETERS {
                for j in 0..PARAMETERS {
                    all[i][j] += row[i] * row[j];
                }
                along[drive][i] += row[i] * value;
            }
        }
        for (a, scale) in along.iter().zip(&rest.scales) {
            for i in 0..PARAMETERS {
                for j in 0..PARAMETERS {
                    all[i][j] -= a[i] * a[j] / scale;
                }
            }
        }
        self.with_prior(all, rest.sd_ohm)
    }

    /// In units of the noise, with what is known before.
    pub(super) fn with_prior(&self, mut information: Square, sd_ohm: f64) -> Square {
        information.iter_mut().flatten().for_each(|value| *value /= sd_ohm * sd_ohm);
        (0..PARAMETERS).for_each(|i| information[i][i] += self.instrument.known[i]);
        information
    }
}

/// The change of a reading by each parameter.
pub(super) fn reading(change: &[[f32; PARAMETERS]], count: usize, channel: &Channel) -> [f64; PARAMETERS] {
    let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
    let [a, b, c, d] =
        [(source, plus), (source, minus), (sink, plus), (sink, minus)].map(|(i, j)| change[i * count + j]);
    let mut row = [0.0; PARAMETERS];
    for (parameter, value) in row.iter_mut().enumerate() {
        *value = f64::from((a[parameter] - b[parameter]) - (c[parameter] - d[parameter]));
    }
    row
}

/// The standard deviation of the position, m: the root of the trace of the first block of the inverse; infinite where
/// the information is singular.
pub(super) fn position_sd_m(information: &Square) -> f64 {
    let mut left = *information;
    // The other parameters are eliminated, the last first (Schur complement).
    for last in (2..PARAMETERS).rev() {
        let pivot = left[last][last];
        if pivot.is_nan() || pivot <= f64::EPSILON * information[last][last] {
            return f64::INFINITY;
        }
        let eliminated = left[last];
        for row in &mut left[..last] {
            let factor = row[last] / pivot;
            row.iter_mut().zip(&eliminated).for_each(|(value, other)| *value -= factor * other);
        }
    }
    let [a, b, d] = [left[0][0], left[0][1], left[1][1]];
    let determinant = a * d - b * b;
    if determinant.is_nan() || determinant <= f64::EPSILON * information[0][0] * information[1][1] {
        return f64::INFINITY;
    }
    ((a + d) / determinant).sqrt()
}
