//! Settling of the multiplexers' lines until a reading is sampled.
//!
//! Four multiplexers connect the source, the ground, and the two inputs of the amplifier to one electrode each, through
//! their on-resistances. Source line and inputs have a capacitance `C`; the ground line has a fixed potential. With the
//! currents `i` from the three lines into the skin, their potentials are `V = M i`,
//!
//! `M_jk = S_jk - S_jb - S_bk + S_bb + r_b + delta_jk r_k`,
//!
//! where `S` is the skin's transfer impedance, `b` the grounded electrode and `r` the on-resistances; the skin itself
//! stores no charge. So `C dV/dt = -A V + (U / R) e`, `A = M^-1 + e e' / R`, with `U` and `R` the source's voltage and
//! reference resistor and `e` the source line: three equations per slot, solved by the exponential of a 3 x 3 matrix.
//! It is exact for this circuit; the capacitance of every single wire is lumped into the line to which it is connected.

use crate::elementary::log2;
use dermis::forward::ElectrodeNetwork;
use dermis::stats::bisect;

type Matrix3 = [[f64; 3]; 3];

/// The lines of a slot, in this order.
pub(super) const SOURCE: usize = 0;
pub(super) const PLUS: usize = 1;
pub(super) const MINUS: usize = 2;

/// An exponential with this exponent is zero in double precision relative to its initial value.
const DECAYED: f64 = 40.0;

/// Minimum on-resistance, ohm: with zero, the settling time of a line on the grounded electrode is not defined.
const MIN_OHM: f64 = 1e-3;

/// The circuit of one slot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slot {
    /// `A`, S.
    conductance: Matrix3,
    /// The settled potentials of the lines, V.
    pub steady_v: [f64; 3],
    /// The longest time constant of the slot is at most the capacitance times this, ohm.
    slowest_ohm: f64,
}

/// The source of a frame's drives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source {
    pub voltage_v: f64,
    pub reference_ohm: f64,
}

/// The connection of a slot to the skin: the electrodes, and the on-resistances.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joined {
    /// Electrode of the source line, of the plus and of the minus input.
    pub electrodes: [usize; 3],
    pub on_ohm: [f64; 3],
    pub sink: usize,
    pub sink_on_ohm: f64,
}

impl Joined {
    /// `M_jk`.
    fn impedance(&self, network: &ElectrodeNetwork, j: usize, k: usize) -> f64 {
        let s = &network.transfer_impedance;
        let (a, b, sink) = (self.electrodes[j], self.electrodes[k], self.sink);
        let own = if j == k { self.on_ohm[j].max(MIN_OHM) } else { 0.0 };
        (s.at(a, b) - s.at(sink, b)) - (s.at(a, sink) - s.at(sink, sink)) + self.sink_on_ohm.max(MIN_OHM) + own
    }
}

impl Slot {
    /// A slot that measures the voltage between two electrodes.
    pub(super) fn measuring(network: &ElectrodeNetwork, source: Source, joined: &Joined) -> Self {
        let m: Matrix3 = std::array::from_fn(|j| std::array::from_fn(|k| joined.impedance(network, j, k)));
        let current_a = source.voltage_v / (source.reference_ohm + m[SOURCE][SOURCE]);
        let mut conductance = inverse(&m);
        conductance[SOURCE][SOURCE] += 1.0 / source.reference_ohm;
        Slot {
            conductance,
            steady_v: std::array::from_fn(|line| m[line][SOURCE] * current_a),
            slowest_ohm: m[0][0] + m[1][1] + m[2][2],
        }
    }

    /// A slot that measures the current: plus is connected to the source, minus to the far end of the reference
    /// resistor.
    pub(super) fn referring(network: &ElectrodeNetwork, source: Source, joined: &Joined) -> Self {
        let skin_ohm = joined.impedance(network, SOURCE, SOURCE);
        let current_a = source.voltage_v / (source.reference_ohm + skin_ohm);
        let [_, plus_ohm, minus_ohm] = joined.on_ohm.map(|ohm| ohm.max(MIN_OHM));
        let line_v = skin_ohm * current_a;
        Slot {
            conductance: [
                [1.0 / skin_ohm + 1.0 / source.reference_ohm + 1.0 / minus_ohm, 0.0, -1.0 / minus_ohm],
                [0.0, 1.0 / plus_ohm, 0.0],
                [-1.0 / minus_ohm, 0.0, 1.0 / minus_ohm],
            ],
            steady_v: [line_v, source.voltage_v, line_v],
            slowest_ohm: 2.0 * skin_ohm + plus_ohm + minus_ohm,
        }
    }

    /// The lines' potentials at the end of a slot of `duration_s` that started with `lines_v`.
    pub(super) fn settle(&self, lines_v: [f64; 3], capacitance_f: f64, duration_s: f64) -> [f64; 3] {
        let rate = duration_s / capacitance_f;
        if rate > DECAYED * self.slowest_ohm {
            return self.steady_v;
        }
        let decay = exponential(&self.conductance.map(|row| row.map(|value| -value * rate)));
        let off: [f64; 3] = std::array::from_fn(|line| lines_v[line] - self.steady_v[line]);
        std::array::from_fn(|j| self.steady_v[j] + (0..3).map(|k| decay[j][k] * off[k]).sum::<f64>())
    }
}

impl Slot {
    /// The time after which the voltage between the inputs is off by at most this share of the largest initial error of
    /// a line, whatever the errors of the three lines were at first; s.
    pub(super) fn settling_s(&self, capacitance_f: f64, share: f64) -> f64 {
        // Row sum of the difference of two rows of the exponential: the largest error for initial errors up to one.
        let error = |duration_s: f64| {
            let rate = duration_s / capacitance_f;
            let decay = exponential(&self.conductance.map(|row| row.map(|value| -value * rate)));
            (0..3).map(|k| (decay[PLUS][k] - decay[MINUS][k]).abs()).sum::<f64>()
        };
        // Downwards in small steps to the last crossing, then between the two steps.
        let mut above_s = DECAYED * capacitance_f * self.slowest_ohm;
        while error(above_s / STEP) <= share {
            above_s /= STEP;
            if above_s < MIN_S {
                return MIN_S;
            }
        }
        bisect([above_s / STEP, above_s], HALVINGS, |duration_s| error(duration_s) <= share)
    }
}

/// Ratio of two steps of the search for the settling time, and the bisections after it: 0.1 %.
const STEP: f64 = 1.1;
const HALVINGS: usize = 7;
/// The shortest settling time, s: no switch is faster.
const MIN_S: f64 = 1e-9;

/// The inverse of a symmetric positive definite matrix by its cofactors.
fn inverse(m: &Matrix3) -> Matrix3 {
    let minor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / determinant))
}

/// The exponential of a matrix: scaling and squaring, with the Taylor series of a matrix scaled so that thirteen terms
/// are exact in double precision (Moler and Van Loan, 2003, DOI 10.1137/S00361445024180, method 3).
fn exponential(matrix: &Matrix3) -> Matrix3 {
    const TERMS: u32 = 13;
    let norm = matrix.iter().map(|row| row.iter().map(|value| value.abs()).sum::<f64>()).fold(0.0, f64::max);
    let halvings = if norm > 0.5 { log2(2.0 * norm).ceil() as i32 } else { 0 };
    let part = matrix.map(|row| row.map(|value| value * 0.5f64.powi(halvings)));
    let identity: Matrix3 = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    // Horner's scheme: 1 + X (1 + X / 2 (1 + X / 3 (...))).
    let mut sum = identity;
    for term in (1..=TERMS).rev() {
        let product = multiply(&part, &sum);
        sum = std::array::from_fn(|i| std::array::from_fn(|j| identity[i][j] + product[i][j] / f64::from(term)));
    }
    for _ in 0..halvings {
        sum = multiply(&sum, &sum);
    }
    sum
}

fn multiply(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_of_a_symmetric_matrix_is_that_of_its_eigenvalues() {
        // Eigenvectors (1, 1, 0), (1, -1, 0) / sqrt 2 and (0, 0, 1).
        let (slow, fast, third) = (-0.3f64, -700.0, -12.0);
        let matrix = [
            [0.5 * (slow + fast), 0.5 * (slow - fast), 0.0],
            [0.5 * (slow - fast), 0.5 * (slow + fast), 0.0],
            [0.0, 0.0, third],
        ];
        let found = exponential(&matrix);
        let half = 0.5 * slow.exp();
        let exact = [[half, half, 0.0], [half, half, 0.0], [0.0, 0.0, third.exp()]];
        for (found, exact) in found.as_flattened().iter().zip(exact.as_flattened()) {
            assert!((found - exact).abs() < 1e-12, "{found} for {exact}");
        }
    }

    #[test]
    fn the_inverse_is_one() {
        let m = [[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]];
        let product = multiply(&m, &inverse(&m));
        for (i, row) in product.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert!((value - f64::from(u8::from(i == j))).abs() < 1e-14);
            }
        }
    }
}
