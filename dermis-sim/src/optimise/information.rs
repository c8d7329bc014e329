//! The information of the readings of a layout about a weak press.

use super::touch::PARAMETERS;
use dermis::linalg::Matrix;
use dermis::protocol::{Channel, Protocol};
use pulp::{Simd, WithSimd};

/// A symmetric matrix of the parameters of a press.
pub(super) type Square = [[f64; PARAMETERS]; PARAMETERS];

/// The parameters of a press, filled up with zeros for wide instructions.
pub(super) const LANES: usize = 8;

/// The change of a transfer impedance by each parameter.
pub(super) type Change = [f32; LANES];

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
    /// For each channel its four pairs of electrodes, as indices in a list of all pairs.
    pairs: Vec<[usize; 4]>,
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
        let count = protocol.electrode_count();
        let pairs = |Channel { drive: [source, sink], measure: [plus, minus] }: &Channel| {
            [(source, plus), (source, minus), (sink, plus), (sink, minus)].map(|(a, b)| a * count + b)
        };
        let pairs = protocol.channels().iter().map(pairs).collect();
        Readings { drive_count: drives.len(), drive_of, pairs, protocol: protocol.clone(), instrument }
    }

    pub(super) fn channels(&self) -> &[Channel] {
        self.protocol.channels()
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
        let sd_ohm = self.protocol.undriven_rms(&values_ohm).max(0.0) / signal_to_noise;
        let mut scales = vec![reference_ohm * reference_ohm; self.drive_count];
        self.drive_of.iter().zip(&values_ohm).for_each(|(&drive, value)| scales[drive] += value * value);
        Rest { values_ohm, sd_ohm, scales }
    }

    /// The information about a press, with what is known before. `change` has for each pair of electrodes
    /// the change of the transfer impedance by each parameter.
    ///
    /// The noise of a drive's current is common to its values: by the formula of Sherman and Morrison it takes
    /// `a a' / (R_ref^2 + z' z)` from the information of a drive, with `a = J' z`.
    pub(super) fn information(&self, change: &[Change], rest: &Rest) -> Square {
        let sums = pulp::Arch::new().dispatch(Sums { readings: self, change, rest });
        self.with_prior(sums, rest.sd_ohm)
    }

    /// The change of each reading by each parameter.
    pub(super) fn rows(&self, change: &[Change]) -> Vec<[f64; PARAMETERS]> {
        self.pairs.iter().map(|&pairs| std::array::from_fn(|parameter| row(change, pairs)[parameter])).collect()
    }

    /// In units of the noise, with what is known before.
    pub(super) fn with_prior(&self, mut information: Square, sd_ohm: f64) -> Square {
        information.iter_mut().flatten().for_each(|value| *value /= sd_ohm * sd_ohm);
        (0..PARAMETERS).for_each(|i| information[i][i] += self.instrument.known[i]);
        information
    }
}

/// The change of a reading by each parameter.
#[inline(always)]
fn row(change: &[Change], pairs: [usize; 4]) -> [f64; LANES] {
    let [a, b, c, d] = [&change[pairs[0]], &change[pairs[1]], &change[pairs[2]], &change[pairs[3]]];
    let mut row = [0.0; LANES];
    for lane in 0..LANES {
        row[lane] = f64::from((a[lane] - b[lane]) - (c[lane] - d[lane]));
    }
    row
}

/// The information in units of an ohm: the sum over the readings of the products of their changes, without that along each
/// drive's current. The sums have the same bits on every instruction set.
struct Sums<'a> {
    readings: &'a Readings,
    change: &'a [Change],
    rest: &'a Rest,
}

impl WithSimd for Sums<'_> {
    type Output = Square;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Square {
        let Sums { readings, change, rest } = self;
        let mut all = [[0.0f64; LANES]; PARAMETERS];
        let mut along = vec![[0.0f64; LANES]; readings.drive_count];
        for ((&pairs, &drive), &value) in readings.pairs.iter().zip(&readings.drive_of).zip(&rest.values_ohm) {
            let row = row(change, pairs);
            add_product(&mut all, &row, 1.0);
            along[drive].iter_mut().zip(&row).for_each(|(sum, change)| *sum += change * value);
        }
        for (a, scale) in along.iter().zip(&rest.scales) {
            add_product(&mut all, a, -1.0 / scale);
        }
        all.map(|row| std::array::from_fn(|parameter| row[parameter]))
    }
}

/// Adds the product of a row with itself, times a factor.
#[inline(always)]
fn add_product(sum: &mut [[f64; LANES]; PARAMETERS], row: &[f64; LANES], factor: f64) {
    for (sum, value) in sum.iter_mut().zip(row) {
        for lane in 0..LANES {
            sum[lane] += factor * value * row[lane];
        }
    }
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
