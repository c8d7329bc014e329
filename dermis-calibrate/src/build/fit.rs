//! The skin as it was made, under the assumption of some faults: fit and evidence.

use super::cut::remaining;
use super::data::Data;
use super::fault::{Fault, Network};
use dermis::design::SkinDesign;
use dermis::forward::{ForwardModel, Solver};
use dermis::frame::Frame;
use dermis::geom::Surface;
use dermis::identify::{Identifier, IdentifyError, IdentifyOptions};
use dermis::linalg::{Matrix, invert_spd};
use dermis::protocol::{Channel, Protocol};
use dermis::skin::Skin;
use dermis::stats::rms;
use std::f64::consts::TAU;

/// Steps of a fit. The derivatives are those of the even skin, so each step leaves a part of the error that is like the
/// unevenness.
const STEPS: usize = 14;
/// A step takes the errors of the values to be at least this part of what the last one has left: far from the solution,
/// unknowns whose priors are narrow would explain what the sheet resistance and the contacts do.
const LEAST_ERROR: f64 = 0.1;
/// A fit is given up after this many steps if what it leaves is larger than the least misfit by this factor.
const TRIAL_STEPS: usize = 6;
const HOPELESS: f64 = 2.0;
/// A shorter step ends a fit, standard deviations of the prior.
const SHORTEST_STEP: f64 = 0.02;
/// Longest distance of an unknown from the design in its standard deviations.
const MOST_SD: f64 = 6.0;
/// Step of the derivative by the size of a fault, standard deviations of its prior.
const SIZE_STEP: f64 = 1e-5;
/// Decades of a value that may be anything: the logarithm of its size is uniform over them.
const DECADES: f64 = 10.0;
/// Smallest such value, over the root mean square of the frame.
const LEAST_SHARE: f64 = 1e-3;

/// The model of a design, linear about the even skin.
#[derive(Debug)]
pub(super) struct Model {
    pub(super) protocol: Protocol,
    pub(super) drive_of: Vec<usize>,
    pub(super) drives: usize,
    pub(super) identifier: Identifier,
    /// The impedances of the even skin, electrodes x electrodes.
    pub(super) even: Matrix,
    /// The derivatives of the impedances, one row for each pair of electrodes but the first.
    jacobian: Matrix,
    /// The even skin's untouched frame, ohm.
    pub(super) frame: Vec<f64>,
    /// What the discretisation changes of it, ohm.
    pub(super) discretisation: Vec<f64>,
    /// Resistance of a typical pair of electrodes, ohm.
    pub(super) typical_ohm: f64,
    pub(super) surface: Surface,
    sound: Matrix,
}

/// A fit under some faults.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// The faults, with their sizes.
    pub faults: Vec<Fault>,
    /// The unknowns of the skin.
    pub x: Vec<f64>,
    /// Logarithm of the probability of the frame.
    log_evidence: f64,
    /// Channels without open electrodes.
    used: usize,
    /// Root mean square of residuals and unknowns over what is expected: 1 for a skin that the model describes.
    pub misfit: f64,
    /// What the fit leaves of each channel, in standard deviations; 0 for those of open electrodes.
    pub residuals: Vec<f64>,
    /// The impedances of the skin without faults of the wires, ohm.
    pub impedance: Matrix,
    /// The derivatives of the channels, and the inverse of `1 + A'A`.
    pub linear: Linear,
}

/// The derivatives of the weighted channels, channels x unknowns, and the normal matrix `1 + A'A` with its inverse.
#[derive(Debug, Clone)]
pub(super) struct Linear {
    pub a: Matrix,
    normal: Matrix,
    pub inverse: Matrix,
    log_determinant: f64,
}

impl Model {
    /// The model of a skin.
    ///
    /// # Errors
    /// A design that cannot be solved, or without signs.
    pub(super) fn new(skin: &Skin, options: IdentifyOptions) -> dermis::Result<Self> {
        // Not refused by the identifier, which gets a protocol of its own.
        if skin.design().protocol.amplitude_only() {
            return Err(IdentifyError::AmplitudeOnly.into());
        }
        let design = SkinDesign { protocol: pairs(skin.design().protocol.electrode_count())?, ..skin.design().clone() };
        let forward = ForwardModel::new(&design, skin.mesh())?;
        let identifier = Identifier::new(&design, &forward, options)?;
        let protocol = skin.design().protocol.clone();
        let (drives, drive_of) = protocol.drives();
        let mut model = Model {
            jacobian: identifier.derivatives(&forward)?,
            sound: Matrix::zeros(0, 0),
            surface: design.body.surface(),
            even: Matrix::zeros(0, 0),
            frame: Vec::new(),
            discretisation: Vec::new(),
            typical_ohm: 0.0,
            drives: drives.len(),
            protocol,
            drive_of,
            identifier,
        };
        let values = forward.solve(forward.rest_conductivity())?;
        model.even = model.with_discretisation(&values);
        let network = Network::sound(model.even.clone(), model.drives);
        model.frame = network.frame(&model.protocol, &model.drive_of);
        let off = model.impedance_from(model.identifier.discretisation_ohm().iter().copied());
        model.discretisation = model.values(&off, &[]);
        let pair = |[a, b]: [usize; 2]| model.even.at(a, a) - 2.0 * model.even.at(a, b) + model.even.at(b, b);
        model.typical_ohm = rms(drives.into_iter().map(pair));
        model.sound = model.rows(&network);
        Ok(model)
    }

    /// The impedances from the values of all pairs.
    fn with_discretisation(&self, values: &Frame) -> Matrix {
        self.impedance_from(values.iter().zip(self.identifier.discretisation_ohm()).map(|(value, off)| value + off))
    }

    fn impedance_from(&self, values: impl Iterator<Item = f64>) -> Matrix {
        let count = self.protocol.electrode_count();
        let mut impedance = Matrix::zeros(count, count);
        let pairs = (1..count).flat_map(|k| (k..count).map(move |m| (k, m)));
        for ((k, m), value) in pairs.zip(values) {
            *impedance.at_mut(k, m) = value;
            *impedance.at_mut(m, k) = value;
        }
        impedance
    }

    /// The impedances of the skin at some unknowns, with the cuts among some faults; `None` for unknowns without a
    /// solution.
    fn impedance(&self, x: &[f64], faults: &[Fault]) -> Option<Matrix> {
        let model = self.identifier.model_of(x).ok()?;
        self.impedance_of(&mut model.solver(), faults)
    }

    /// The same, of a model.
    pub(super) fn impedance_of(&self, solver: &mut Solver, faults: &[Fault]) -> Option<Matrix> {
        let model = solver.model().clone();
        let mut conductivity = model.rest_conductivity().to_vec();
        for fault in faults {
            if let Fault::Cut(cut) = fault {
                let parts = remaining(model.mesh(), &self.surface, cut);
                conductivity.iter_mut().zip(parts).for_each(|(value, part)| *value *= part);
            }
        }
        let network = solver.network(&conductivity).ok()?;
        Some(self.with_discretisation(&network.frame(model.protocol())))
    }

    /// The network with some faults.
    pub(super) fn network(&self, impedance: &Matrix, faults: &[Fault]) -> Network {
        let mut network = Network::sound(impedance.clone(), self.drives);
        faults.iter().for_each(|fault| network.add(fault));
        network
    }

    /// The values of the channels with some faults, ohm.
    pub(super) fn values(&self, impedance: &Matrix, faults: &[Fault]) -> Vec<f64> {
        self.network(impedance, faults).frame(&self.protocol, &self.drive_of)
    }

    /// The derivative of the channels by the unknowns of the skin, ohm.
    fn rows(&self, network: &Network) -> Matrix {
        let (count, columns) = (network.impedance.rows, self.jacobian.columns);
        let side = |[a, b]: [usize; 2]| -> Vec<(usize, f64)> {
            let parts = (1..count).map(|at| (at, network.passed.at(a, at) - network.passed.at(b, at)));
            parts.filter(|(_, part)| *part != 0.0).collect()
        };
        // The row of a pair in the list of all.
        let row_of = |k: usize, m: usize| {
            let (k, m) = (k.min(m), k.max(m));
            (k - 1) * count - k * (k - 1) / 2 + m - k
        };
        let mut rows = Matrix::zeros(self.protocol.channel_count(), columns);
        for (channel, one) in self.protocol.channels().iter().enumerate() {
            let gain = network.gain(self.drive_of[channel]);
            let (left, right) = (side(one.drive), side(one.measure));
            let out = rows.row_mut(channel);
            for &(k, a) in &left {
                for &(m, b) in &right {
                    let factor = gain * a * b;
                    let derivatives = self.jacobian.row(row_of(k, m));
                    out.iter_mut().zip(derivatives).for_each(|(sum, one)| *sum += factor * one);
                }
            }
        }
        rows
    }

    /// The derivatives of the weighted channels by the unknowns of the skin and by the sizes of the faults.
    fn linear(&self, data: &Data, impedance: &Matrix, faults: &[Fault]) -> Option<Linear> {
        let network = self.network(impedance, faults);
        let changes_nothing = |fault: &Fault| matches!(fault, Fault::Cut(_) | Fault::OpenElectrode { .. });
        let rows = if faults.iter().all(changes_nothing) { &self.sound } else { &self.rows(&network) };
        let by_size: Vec<Vec<f64>> = self.sized(faults).map(|at| self.by_size(impedance, faults, at)).collect();
        let mut a = Matrix::zeros(rows.rows, rows.columns + by_size.len());
        for (channel, one) in self.protocol.channels().iter().enumerate() {
            if network.is_open(one) {
                continue;
            }
            let all = rows.row(channel).iter().copied().chain(by_size.iter().map(|column| column[channel]));
            a.row_mut(channel).iter_mut().zip(all).for_each(|(out, value)| *out = value / data.sd[channel]);
        }
        Linear::new(a)
    }

    /// The faults that have a size.
    fn sized<'a>(&'a self, faults: &'a [Fault]) -> impl Iterator<Item = usize> + 'a {
        (0..faults.len()).filter(|&at| faults[at].size(self.typical_ohm).is_some())
    }

    /// The derivative of the channels by the size of a fault, ohm.
    pub(super) fn by_size(&self, impedance: &Matrix, faults: &[Fault], at: usize) -> Vec<f64> {
        let size = faults[at].size(self.typical_ohm).unwrap_or_default();
        let mut moved = faults.to_vec();
        moved[at] = faults[at].with_size(size + SIZE_STEP, self.typical_ohm);
        let (before, after) = (self.values(impedance, faults), self.values(impedance, &moved));
        after.iter().zip(before).map(|(after, before)| (after - before) / SIZE_STEP).collect()
    }

    /// What a frame of some faults leaves of the data, in standard deviations; 0 for open electrodes.
    pub(super) fn residuals(&self, data: &Data, impedance: &Matrix, faults: &[Fault]) -> Vec<f64> {
        let network = self.network(impedance, faults);
        let mut residuals = network.frame(&self.protocol, &self.drive_of);
        for (channel, one) in self.protocol.channels().iter().enumerate() {
            let off = (data.values[channel] - residuals[channel]) / data.sd[channel];
            residuals[channel] = if network.is_open(one) { 0.0 } else { off };
        }
        residuals
    }

    /// The fit under some faults, from some unknowns; `None` where the model has no solution, and where the fit cannot
    /// become as good as one with the misfit `least`.
    pub(super) fn fit(&self, data: &Data, faults: &[Fault], start: &[f64], least: f64) -> Option<Fit> {
        self.fit_in(STEPS, data, faults, start, least)
    }

    /// A fit without a step: the skin at some unknowns.
    pub(super) fn at(&self, data: &Data, faults: &[Fault], x: &[f64]) -> Option<Fit> {
        self.fit_in(0, data, faults, x, f64::INFINITY)
    }

    fn fit_in(&self, steps: usize, data: &Data, faults: &[Fault], start: &[f64], least: f64) -> Option<Fit> {
        let mut faults = faults.to_vec();
        let mut x = start.to_vec();
        let mut impedance = self.impedance(&x, &faults)?;
        let linear = self.linear(data, &impedance, &faults)?;
        let sized: Vec<usize> = self.sized(&faults).collect();
        x.extend(sized.iter().filter_map(|&at| faults[at].size(self.typical_ohm)));
        let count = start.len();
        let mut residuals = self.residuals(data, &impedance, &faults);
        for step in 0..steps {
            let times = (LEAST_ERROR * rms(residuals.iter().copied())).max(1.0);
            let next = linear.step(&residuals, &x, times)?;
            let longest = next.iter().zip(&x).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            x = next;
            for (&at, size) in sized.iter().zip(&x[count..]) {
                faults[at] = faults[at].with_size(*size, self.typical_ohm);
            }
            impedance = self.impedance(&x[..count], &faults)?;
            residuals = self.residuals(data, &impedance, &faults);
            if longest < SHORTEST_STEP {
                break;
            }
            if step + 1 == TRIAL_STEPS && rms(residuals.iter().copied()) > HOPELESS * least {
                return None;
            }
        }
        let squares: f64 = residuals.iter().chain(&x).map(|value| value * value).sum();
        let open = self.network(&impedance, &faults);
        let log_evidence = self.log_evidence(data, &open, squares, &linear);
        let used = self.protocol.channels().iter().filter(|one| !open.is_open(one)).count();
        x.truncate(count);
        let used = used.max(1);
        let misfit = (squares / used as f64).sqrt();
        Some(Fit { faults, x, log_evidence, used, misfit, residuals, impedance, linear })
    }

    /// The logarithm of the probability of the data, by Laplace's approximation about the fit; the values of open
    /// electrodes may be anything.
    fn log_evidence(&self, data: &Data, network: &Network, squares: f64, linear: &Linear) -> f64 {
        let size = rms(self.frame.iter().copied());
        let channel = |(channel, one): (usize, &Channel)| match network.is_open(one) {
            true => {
                let value = data.values[channel].abs().max(LEAST_SHARE * size);
                -(2.0 * DECADES * std::f64::consts::LN_10 * value).ln()
            }
            false => -(data.sd[channel] * TAU.sqrt()).ln(),
        };
        let channels: f64 = self.protocol.channels().iter().enumerate().map(channel).sum();
        channels - 0.5 * (squares + linear.log_determinant)
    }
}

impl Fit {
    /// The logarithm of the probability of the frame if residuals and unknowns were this many times as large as expected.
    /// Explanations that all leave more than expected are compared at what the best one leaves: otherwise an open
    /// electrode, whose values may be anything, explains every other fault nearby.
    pub(super) fn log_evidence_at(&self, times: f64) -> f64 {
        let used = self.used as f64;
        self.log_evidence + used * (0.5 * self.misfit.powi(2) * (1.0 - times.powi(-2)) - times.ln())
    }

    /// The unknowns of the skin and the sizes of the faults.
    pub(super) fn all_unknowns(&self, model: &Model) -> Vec<f64> {
        let sizes = self.faults.iter().filter_map(|fault| fault.size(model.typical_ohm));
        self.x.iter().copied().chain(sizes).collect()
    }
}

impl Linear {
    fn new(a: Matrix) -> Option<Self> {
        let mut normal = a.transposed().times(&a);
        (0..normal.rows).for_each(|i| *normal.at_mut(i, i) += 1.0);
        let mut factor = normal.clone();
        dermis::linalg::cholesky_in_place(&mut factor).ok()?;
        let log_determinant = 2.0 * (0..factor.rows).map(|i| factor.at(i, i).ln()).sum::<f64>();
        let inverse = invert_spd(&normal).ok()?;
        Some(Linear { a, normal, inverse, log_determinant })
    }

    /// `A' v`.
    pub(super) fn transposed_product(&self, values: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.a.columns];
        for (row, value) in self.a.values.chunks_exact(self.a.columns).zip(values) {
            out.iter_mut().zip(row).for_each(|(sum, a)| *sum += a * value);
        }
        out
    }

    /// What the best unknowns to first order leave of the data: residuals `r` at some unknowns, and `A x`.
    pub(super) fn left(&self, residuals: &[f64], moved: &[f64]) -> Vec<f64> {
        let target: Vec<f64> = residuals.iter().zip(moved).map(|(residual, moved)| residual + moved).collect();
        let mut unknowns = vec![0.0; self.a.columns];
        self.inverse.product_into(&self.transposed_product(&target), &mut unknowns);
        let mut explained = vec![0.0; target.len()];
        self.a.product_into(&unknowns, &mut explained);
        target.iter().zip(explained).map(|(target, explained)| target - explained).collect()
    }

    /// Half of the least squares of residuals and unknowns about a fit: residuals `r` there, and `A x`.
    pub(super) fn least_squares(&self, residuals: &[f64], moved: &[f64]) -> f64 {
        let target: Vec<f64> = residuals.iter().zip(moved).map(|(residual, moved)| residual + moved).collect();
        let passed = self.transposed_product(&target);
        let mut unknowns = vec![0.0; passed.len()];
        self.inverse.product_into(&passed, &mut unknowns);
        let squares: f64 = target.iter().map(|value| value * value).sum();
        0.5 * (squares - passed.iter().zip(unknowns).map(|(a, b)| a * b).sum::<f64>())
    }

    /// `(times^2 + A'A)^-1`.
    fn inverse_with_errors(&self, times: f64) -> Option<Matrix> {
        let mut normal = self.normal.clone();
        (0..normal.rows).for_each(|i| *normal.at_mut(i, i) += times * times - 1.0);
        invert_spd(&normal).ok()
    }

    /// The next unknowns of a fit if the errors have `times` their standard deviations: `(times^2 + A'A)^-1 A' (r + A x)`.
    fn step(&self, residuals: &[f64], x: &[f64], times: f64) -> Option<Vec<f64>> {
        let mut target = vec![0.0; self.a.rows];
        self.a.product_into(x, &mut target);
        target.iter_mut().zip(residuals).for_each(|(sum, residual)| *sum += residual);
        let inverse = if times > 1.0 { &self.inverse_with_errors(times)? } else { &self.inverse };
        let mut next = vec![0.0; x.len()];
        inverse.product_into(&self.transposed_product(&target), &mut next);
        next.iter_mut().for_each(|value| *value = value.clamp(-MOST_SD, MOST_SD));
        Some(next)
    }
}

/// Values between all electrodes and the first, for currents between the same: they determine the network.
fn pairs(electrodes: usize) -> Result<Protocol, dermis::protocol::ProtocolError> {
    let pairs = (1..electrodes).flat_map(|k| (k..electrodes).map(move |m| Channel { drive: [k, 0], measure: [m, 0] }));
    Protocol::new(electrodes, pairs.collect())
}
