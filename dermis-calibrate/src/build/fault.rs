//! Faults of a built skin, as changes of the network between its electrodes.

use dermis::geom::Point3;
use dermis::linalg::Matrix;
use dermis::protocol::{Channel, Protocol};
use serde::Serialize;

/// A fault of a built skin or of its reader.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Fault {
    /// An electrode without connection: its values are noise.
    OpenElectrode {
        /// The electrode.
        electrode: usize,
    },
    /// An electrode with a series resistance: a poor contact, a bad solder joint.
    PoorContact {
        /// The electrode.
        electrode: usize,
        /// The resistance, ohm.
        ohm: f64,
    },
    /// Two electrodes whose wires touch.
    Short {
        /// The electrodes.
        electrodes: [usize; 2],
        /// The resistance between them, ohm.
        ohm: f64,
    },
    /// Two electrodes whose wires are exchanged.
    ExchangedWires {
        /// The electrodes.
        electrodes: [usize; 2],
    },
    /// A drive whose current is read wrongly, as with a reference resistor of another value.
    Reference {
        /// The drive, by its place in the protocol.
        drive: usize,
        /// Its reference resistor over the expected one: its values are divided by it.
        factor: f64,
    },
    /// A straight cut through the coat.
    Cut(Cut),
}

/// A straight cut through the coat.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cut {
    /// Its middle, m.
    pub centre_m: Point3,
    /// Its angle from the first axis of the surface's chart (around on a cylinder, x on a plane), rad.
    pub angle_rad: f64,
    /// Its length, m.
    pub length_m: f64,
}

/// Prior standard deviation of the logarithm of a reference resistor's factor: a factor of two.
const FACTOR_SD: f64 = std::f64::consts::LN_2;

/// Least resistance of a short, of that of a typical pair of electrodes: the values between its two electrodes keep the signs
/// that they would have with any larger one.
const LEAST_SHORT: f64 = 1e-6;

/// Impedances of all electrodes to the first one, and how the frame follows from them.
#[derive(Debug, Clone)]
pub(super) struct Network {
    /// `T`, electrodes x electrodes, ohm; with zeros for the first electrode.
    pub impedance: Matrix,
    /// `W`: a change `dT` of the sound skin changes `T` by `W dT W'`.
    pub passed: Matrix,
    /// The factor of each drive's values.
    gains: Vec<f64>,
    /// The electrodes without connection.
    open: Vec<usize>,
}

impl Network {
    /// The network of a sound skin.
    pub(super) fn sound(impedance: Matrix, drives: usize) -> Self {
        let passed = Matrix::identity(impedance.rows);
        Network { impedance, passed, gains: vec![1.0; drives], open: Vec::new() }
    }

    /// The network with a fault. A cut is no change of the network: it is one of the coat.
    pub(super) fn add(&mut self, fault: &Fault) {
        match *fault {
            Fault::OpenElectrode { electrode } => self.open.push(electrode),
            Fault::PoorContact { electrode, ohm } => *self.impedance.at_mut(electrode, electrode) += ohm,
            Fault::Short { electrodes, ohm } => self.join(electrodes, ohm),
            Fault::ExchangedWires { electrodes } => self.exchange(electrodes),
            Fault::Reference { drive, factor } => self.gains[drive] /= factor,
            Fault::Cut(_) => {}
        }
    }

    /// `T' = T - T d d' T / (r + d' T d)`, `d = e_a - e_b` (Sherman and Morrison, 1950, DOI 10.1214/aoms/1177729893), and
    /// `dT' = W dT W'` with `W = 1 - T d d' / (r + d' T d)`.
    fn join(&mut self, [a, b]: [usize; 2], ohm: f64) {
        let across = |matrix: &Matrix, row: usize| matrix.at(row, a) - matrix.at(row, b);
        let count = self.impedance.rows;
        let column: Vec<f64> = (0..count).map(|row| across(&self.impedance, row)).collect();
        let total = ohm + column[a] - column[b];
        // A network that is not positive, as unlikely unknowns give it, has no joined one.
        if total <= 0.0 {
            return;
        }
        let joined: Vec<f64> = (0..count).map(|at| self.passed.at(a, at) - self.passed.at(b, at)).collect();
        for (row, part) in column.iter().map(|value| value / total).enumerate() {
            for at in 0..count {
                *self.impedance.at_mut(row, at) -= part * column[at];
                *self.passed.at_mut(row, at) -= part * joined[at];
            }
        }
    }

    fn exchange(&mut self, [a, b]: [usize; 2]) {
        let count = self.impedance.rows;
        for at in 0..count {
            self.impedance.values.swap(a * count + at, b * count + at);
            self.passed.values.swap(a * count + at, b * count + at);
        }
        for row in 0..count {
            self.impedance.values.swap(row * count + a, row * count + b);
        }
    }

    /// The value of each channel, ohm.
    pub(super) fn frame(&self, protocol: &Protocol, drive_of: &[usize]) -> Vec<f64> {
        let t = &self.impedance;
        let value = |(&Channel { drive: [a, b], measure: [c, d] }, &drive): (&Channel, &usize)| {
            self.gains[drive] * ((t.at(a, c) - t.at(a, d)) - (t.at(b, c) - t.at(b, d)))
        };
        protocol.channels().iter().zip(drive_of).map(value).collect()
    }

    /// The factor of a drive's values.
    pub(super) fn gain(&self, drive: usize) -> f64 {
        self.gains[drive]
    }

    /// Whether a channel uses an electrode without connection.
    pub(super) fn is_open(&self, channel: &Channel) -> bool {
        self.open.iter().any(|&electrode| channel.uses(electrode))
    }
}

impl Fault {
    /// Whether another fault is of the same kind and at the same place.
    pub(super) fn is_like(&self, other: &Fault) -> bool {
        match (self, other) {
            (Fault::OpenElectrode { electrode: a }, Fault::OpenElectrode { electrode: b })
            | (Fault::PoorContact { electrode: a, .. }, Fault::PoorContact { electrode: b, .. })
            | (Fault::Reference { drive: a, .. }, Fault::Reference { drive: b, .. }) => a == b,
            (Fault::Short { electrodes: a, .. }, Fault::Short { electrodes: b, .. })
            | (Fault::ExchangedWires { electrodes: a }, Fault::ExchangedWires { electrodes: b }) => a == b,
            _ => false,
        }
    }

    /// Its size in standard deviations of its prior; `None` for a fault without a size. `typical_ohm` is the resistance
    /// of a typical pair of electrodes.
    pub(super) fn size(&self, typical_ohm: f64) -> Option<f64> {
        match *self {
            Fault::PoorContact { ohm, .. } | Fault::Short { ohm, .. } => Some(ohm / typical_ohm),
            Fault::Reference { factor, .. } => Some(factor.ln() / FACTOR_SD),
            _ => None,
        }
    }

    /// The same fault with another size.
    #[must_use]
    pub(super) fn with_size(self, size: f64, typical_ohm: f64) -> Self {
        let ohm = (size * typical_ohm).max(0.0);
        match self {
            Fault::PoorContact { electrode, .. } => Fault::PoorContact { electrode, ohm },
            Fault::Short { electrodes, .. } => Fault::Short { electrodes, ohm: ohm.max(LEAST_SHORT * typical_ohm) },
            Fault::Reference { drive, .. } => Fault::Reference { drive, factor: (FACTOR_SD * size).exp() },
            other => other,
        }
    }

    /// The same fault with its resistances multiplied.
    #[must_use]
    pub(super) fn scaled(self, factor: f64) -> Self {
        match self {
            Fault::PoorContact { electrode, ohm } => Fault::PoorContact { electrode, ohm: factor * ohm },
            Fault::Short { electrodes, ohm } => Fault::Short { electrodes, ohm: factor * ohm },
            other => other,
        }
    }
}
