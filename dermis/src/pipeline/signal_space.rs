//! The part of a frame that a touch can explain.

use crate::forward::Matrix;
use crate::skin::Skin;
use faer::Mat;

/// Dimensions of the signal space: at most this part of the channels, and at most so many.
const PART: f64 = 0.25;
const MOST: usize = 64;
/// Iterations of the subspace; the singular values of a Jacobian decay by orders of magnitude over its dimensions.
const ITERATIONS: usize = 3;
/// A touch explains at least this part of the energy of a difference, beyond noise.
const EXPLAINED: f64 = 0.5;
/// Standard errors of the explained energy.
const ERRORS: f64 = 4.0;
/// A channel or drive with more than this part of the unexplained energy is its cause.
const CAUSE: f64 = 0.6;

/// The subspace of frames that changes of the skin cause most: the dominant left singular vectors of its Jacobian, in
/// units of each channel's noise.
///
/// A touch lies in it but for the nonlinearity of the skin and errors of the model. Noise, a wrong reading, a wrong
/// current or a loose wire lie mostly outside. The basis is computed by subspace iteration (Halko, Martinsson and Tropp
/// 2011, DOI 10.1137/090771806).
#[derive(Debug, Clone)]
pub(super) struct SignalSpace {
    /// Orthonormal vectors, dimensions x channels.
    basis: Matrix,
    /// Standard deviation of the noise of each channel, ohm.
    noise_ohm: Vec<f64>,
}

/// What is left of a difference outside the signal space.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Residual {
    /// In units of each channel's noise; zero in masked channels.
    pub values: Vec<f64>,
    /// Whether a touch explains the difference.
    pub is_explained: bool,
}

impl SignalSpace {
    /// Of a skin with this noise of its channels.
    ///
    /// # Errors
    /// A forward problem that cannot be solved.
    pub(super) fn new(skin: &Skin, noise_ohm: &[f64]) -> crate::Result<Self> {
        let jacobian = &skin.linearised()?.jacobian;
        let (channels, pixels) = (jacobian.rows, jacobian.columns);
        let count = ((PART * channels as f64) as usize).clamp(1, MOST).min(pixels);
        let whitened =
            Mat::from_fn(channels, pixels, |channel, pixel| jacobian.at(channel, pixel) / noise_ohm[channel]);
        // Signs that look random, the same in every run.
        let sign = |row: usize, column: usize| {
            let mixed = (row * count + column + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15_u64 as usize);
            if (mixed >> 40) & 1 == 0 { 1.0 } else { -1.0 }
        };
        let mut basis = orthonormal(&(&whitened * Mat::from_fn(pixels, count, sign)));
        for _ in 0..ITERATIONS {
            basis = orthonormal(&(&whitened * (whitened.transpose() * &basis)));
        }
        let values = (0..count).flat_map(|vector| (0..channels).map(move |channel| (channel, vector)));
        let values = values.map(|(channel, vector)| basis[(channel, vector)]).collect();
        Ok(SignalSpace { basis: Matrix { rows: count, columns: channels, values }, noise_ohm: noise_ohm.to_vec() })
    }

    /// The residual of a difference, ohm, whose masked channels are zero.
    pub(super) fn residual(&self, difference_ohm: &[f64], masked: &[bool]) -> Residual {
        let mut values: Vec<f64> = difference_ohm.iter().zip(&self.noise_ohm).map(|(value, sd)| value / sd).collect();
        let energy: f64 = values.iter().map(|value| value * value).sum();
        let mut amounts = vec![0.0; self.basis.rows];
        self.basis.product_into(&values, &mut amounts);
        let explained: f64 = amounts.iter().map(|amount| amount * amount).sum();
        for (vector, amount) in amounts.iter().enumerate() {
            values.iter_mut().zip(self.basis.row(vector)).for_each(|(value, unit)| *value -= amount * unit);
        }
        values.iter_mut().zip(masked).filter(|(_, masked)| **masked).for_each(|(value, _)| *value = 0.0);
        let used = masked.iter().filter(|masked| !**masked).count() as f64;
        let dimensions = self.basis.rows as f64;
        // The energy of noise of one standard deviation is the number of channels, of which the space has its share.
        let (signal, error) = (explained - dimensions, ERRORS * (2.0 * dimensions).sqrt());
        Residual { values, is_explained: signal + error >= EXPLAINED * (energy - used) }
    }
}

impl Residual {
    /// The group of channels (a drive, or a single channel) that has most of the residual, if one has.
    pub(super) fn cause(&self, group_of: &[usize], group_count: usize) -> Option<usize> {
        let mut energy = vec![0.0; group_count];
        self.values.iter().zip(group_of).for_each(|(value, &group)| energy[group] += value * value);
        let total: f64 = energy.iter().sum();
        let (group, most) = energy.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        (*most > CAUSE * total).then_some(group)
    }
}

/// An orthonormal basis of the columns.
fn orthonormal(columns: &Mat<f64>) -> Mat<f64> {
    columns.qr().compute_thin_Q()
}
