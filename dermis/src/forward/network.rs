//! The resistor network between the electrodes that remains after elimination of all nodes.

use super::ForwardError;
use super::arc_ends::Transform;
use crate::frame::Frame;
use crate::linalg::{Cholesky, Matrix};
use crate::protocol::Protocol;

/// The skin as a network between its electrodes: `I = Y U` and `U = S I`.
///
/// `Y` is the Schur complement of the nodes in the finite-element system (Kron, 1939: Tensor Analysis of Networks);
/// `S`, the paper's transfer impedance (its Eq. 3-5), is the pseudo-inverse of `Y`. Both are symmetric of rank `L - 1`,
/// their null vector the constant.
#[derive(Debug, Clone)]
pub struct ElectrodeNetwork {
    /// `Y`, electrodes x electrodes, S.
    pub admittance: Matrix,
    /// `S`, electrodes x electrodes, ohm.
    pub transfer_impedance: Matrix,
}

impl ElectrodeNetwork {
    /// The network of an admittance.
    pub(super) fn new(admittance: Matrix) -> Result<Self, ForwardError> {
        let transfer_impedance = pseudo_inverse(&admittance)?;
        Ok(ElectrodeNetwork { admittance, transfer_impedance })
    }

    /// The network with a resistance in series with each electrode, ohm: `S' = S + P diag(r) P`, `P` the projector onto currents
    /// with zero sum.
    ///
    /// # Errors
    /// Negative resistances so large that the network is not positive.
    ///
    /// # Panics
    /// If the number of resistances differs from the number of electrodes.
    pub fn with_series(mut self, resistances: &[f64]) -> Result<Self, ForwardError> {
        assert_eq!(resistances.len(), self.transfer_impedance.rows, "a resistance for each electrode");
        add(&mut self.transfer_impedance, &series(resistances));
        self.admittance = pseudo_inverse(&self.transfer_impedance)?;
        Ok(self)
    }

    /// The network with a resistance between two electrodes, ohm: `Y' = Y + d d' / r` with `d = e_a - e_b`, so that
    /// `S' = S - S d d' S / (r + d' S d)` (Sherman and Morrison, 1950, DOI 10.1214/aoms/1177729893).
    ///
    /// # Panics
    /// If the resistance is not positive, or if both electrodes are the same.
    #[must_use]
    pub fn with_resistance_between(mut self, [a, b]: [usize; 2], resistance_ohm: f64) -> Self {
        assert!(resistance_ohm > 0.0 && a != b, "a positive resistance between two electrodes");
        let s = &mut self.transfer_impedance;
        let across: Vec<f64> = (0..s.rows).map(|row| s.at(row, a) - s.at(row, b)).collect();
        let total_ohm = resistance_ohm + across[a] - across[b];
        for (row, left) in across.iter().enumerate() {
            s.row_mut(row).iter_mut().zip(&across).for_each(|(value, right)| *value -= left * right / total_ohm);
        }
        for (row, column, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
            *self.admittance.at_mut(row, column) += sign / resistance_ohm;
        }
        self
    }

    /// The network with two electrodes exchanged: each has the number of the other.
    #[must_use]
    pub fn exchanged(self, [a, b]: [usize; 2]) -> Self {
        let number = |electrode: usize| match electrode {
            electrode if electrode == a => b,
            electrode if electrode == b => a,
            electrode => electrode,
        };
        let exchanged = |matrix: &Matrix| {
            let mut out = matrix.clone();
            for row in 0..matrix.rows {
                (0..matrix.columns)
                    .for_each(|column| *out.at_mut(row, column) = matrix.at(number(row), number(column)));
            }
            out
        };
        ElectrodeNetwork {
            admittance: exchanged(&self.admittance),
            transfer_impedance: exchanged(&self.transfer_impedance),
        }
    }

    /// The network with corrected transfer impedances, `S' = M S M' + K`.
    ///
    /// # Errors
    /// A network that is not positive.
    pub(super) fn transformed(&self, Transform { matrix, constant, .. }: &Transform) -> Result<Self, ForwardError> {
        let mut transfer_impedance = matrix.times(&self.transfer_impedance).times(&matrix.transposed());
        add(&mut transfer_impedance, constant);
        Ok(ElectrodeNetwork { admittance: pseudo_inverse(&transfer_impedance)?, transfer_impedance })
    }

    /// The network of a skin whose conductances are all multiplied by a factor.
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        scaled.admittance.values.iter_mut().for_each(|value| *value *= factor);
        scaled.transfer_impedance.values.iter_mut().for_each(|value| *value /= factor);
        scaled
    }

    /// The frame of a protocol: for each channel the measured voltage per ampere driven, ohm.
    pub fn frame(&self, protocol: &Protocol) -> Frame {
        let mut values = vec![0.0; protocol.channel_count()];
        self.frame_into(protocol, &mut values);
        Frame(values)
    }

    /// [`frame`](Self::frame), written to the caller's memory.
    pub fn frame_into(&self, protocol: &Protocol, values: &mut [f64]) {
        let s = &self.transfer_impedance;
        for (value, channel) in values.iter_mut().zip(protocol.channels()) {
            let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
            *value = (s.at(source, plus) - s.at(source, minus)) - (s.at(sink, plus) - s.at(sink, minus));
        }
    }
}

/// What resistances in series with the electrodes, ohm, add to transfer impedances: `P diag(r) P`, `P` the projector onto currents
/// with zero sum.
pub(super) fn series(resistances: &[f64]) -> Matrix {
    let count = resistances.len();
    let mean = resistances.iter().sum::<f64>() / count as f64;
    let mut series = Matrix::zeros(count, count);
    for i in 0..count {
        for j in 0..count {
            let own = if i == j { resistances[i] } else { 0.0 };
            *series.at_mut(i, j) = own - (resistances[i] + resistances[j] - mean) / count as f64;
        }
    }
    series
}

fn add(to: &mut Matrix, other: &Matrix) {
    to.values.iter_mut().zip(&other.values).for_each(|(value, other)| *value += other);
}

/// The pseudo-inverse of a symmetric matrix of order `L` whose null vector is the constant: with `c = trace(Y) / L` and
/// `P = 1 1' / L` the projector on the null space, `(Y + c P)^-1 - P / c`.
fn pseudo_inverse(matrix: &Matrix) -> Result<Matrix, ForwardError> {
    let count = matrix.rows;
    let trace: f64 = (0..count).map(|electrode| matrix.at(electrode, electrode)).sum();
    let scale = trace / count as f64;
    let mut shifted = matrix.clone();
    shifted.values.iter_mut().for_each(|value| *value += scale / count as f64);
    let factor = Cholesky::new(&shifted)
        .map_err(|error| ForwardError::Singular { place: format!("electrode {}", error.unknown) })?;
    let mut inverse = factor.inverse();
    inverse.values.iter_mut().for_each(|value| *value -= 1.0 / (scale * count as f64));
    Ok(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Resistors of 1, 2, 3, 4 and 5 ohm between some of four electrodes.
    fn network() -> ElectrodeNetwork {
        let mut admittance = Matrix::zeros(4, 4);
        for (a, b, ohm) in [(0, 1, 1.0), (1, 2, 2.0), (2, 3, 3.0), (3, 0, 4.0), (0, 2, 5.0)] {
            for (row, column, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                *admittance.at_mut(row, column) += sign / ohm;
            }
        }
        ElectrodeNetwork::new(admittance).unwrap()
    }

    fn assert_equal(a: &Matrix, b: &Matrix) {
        a.values.iter().zip(&b.values).for_each(|(a, b)| assert!((a - b).abs() < 1e-12, "{a} {b}"));
    }

    #[test]
    fn a_resistance_between_two_electrodes_is_in_parallel() {
        let across = |network: &ElectrodeNetwork| {
            let s = &network.transfer_impedance;
            s.at(1, 1) - 2.0 * s.at(1, 3) + s.at(3, 3)
        };
        let (before, after) = (network(), network().with_resistance_between([1, 3], 0.7));
        assert!((1.0 / across(&after) - 1.0 / across(&before) - 1.0 / 0.7).abs() < 1e-12);
        // Both forms of the network agree.
        assert_equal(&after.transfer_impedance, &pseudo_inverse(&after.admittance).unwrap());
    }

    #[test]
    fn exchanged_electrodes_have_the_voltages_of_each_other() {
        let (before, after) = (network(), network().exchanged([1, 3]));
        let moved = [0, 3, 2, 1];
        for row in 0..4 {
            for column in 0..4 {
                let there = before.transfer_impedance.at(moved[row], moved[column]);
                assert_eq!(after.transfer_impedance.at(row, column), there);
            }
        }
        assert_equal(&after.transfer_impedance, &pseudo_inverse(&after.admittance).unwrap());
        assert_equal(&after.exchanged([3, 1]).admittance, &before.admittance);
    }
}
