//! The skin as it was made, under the assumption of some faults: fit and evidence.

use super::cut::remaining;
use super::data::Data;
use super::fault::{Fault, Network};
use dermis::design::SkinDesign;
use dermis::estimate::least_squares::{Control, End, Equations, LeastSquares, Normal, Steps, minimise};
use dermis::estimate::scale::robust;
use dermis::forward::{ForwardModel, Solver};
use dermis::frame::Frame;
use dermis::geom::Surface;
use dermis::identify::{Identifier, IdentifyOptions};
use dermis::linalg::{Cholesky, Matrix, NotPositiveDefinite, dot};
use dermis::protocol::{Channel, Protocol};
use dermis::skin::Skin;
use dermis::stats::rms;
use std::f64::consts::TAU;

/// The derivatives are those of the even skin, so each step leaves a part of the error that is like the unevenness. A step
/// shorter than a fiftieth of the standard deviations of the prior ends a fit.
const STEPS: Steps = Steps { most: 14, control: Control::Full, shortest: 0.02, least_decrease: 0.0 };
/// A step takes the errors of the values to be at least this part of what the last one has left: far from the solution,
/// unknowns whose priors are narrow would explain what the sheet resistance and the contacts do.
const MIN_ERROR: f64 = 0.1;
/// A fit is given up after this many steps if what it leaves is larger than the least misfit by this factor.
const TRIAL_STEPS: usize = 6;
const HOPELESS: f64 = 2.0;
/// Longest distance of an unknown from the design in its standard deviations.
const MAX_SD: f64 = 6.0;
/// Step of the derivative by the size of a fault, standard deviations of its prior.
const SIZE_STEP: f64 = 1e-5;
/// Decades of a value that may be anything: the logarithm of its size is uniform over them.
const DECADES: f64 = 10.0;
/// Smallest such value, over the root mean square of the frame.
const MIN_SHARE: f64 = 1e-3;

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
    /// The derivatives of the channels.
    pub linear: Linear,
    /// The frame, as the faults leave its signs known.
    pub data: Data,
}

/// The derivatives of the weighted channels, channels x unknowns, and the normal matrix `1 + A'A` with its factor.
#[derive(Debug, Clone)]
pub(super) struct Linear {
    pub a: Matrix,
    normal: Matrix,
    pub factor: Cholesky,
}

impl Model {
    /// The model of a skin.
    ///
    /// # Errors
    /// A design that cannot be solved.
    pub(super) fn new(skin: &Skin, options: IdentifyOptions) -> dermis::Result<Self> {
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

    /// The contact impedance over that of the design, by the values with a driven electrode: these are linear in it. Single
    /// wrong values do not matter.
    pub(super) fn contact_factor(&self, data: &Data) -> f64 {
        let [_, driven] = self.protocol.channels_by_drive();
        let unknown = self.identifier.unknown_of_contacts();
        let by_factor: Vec<f64> =
            (0..self.sound.rows).map(|channel| self.sound.at(channel, unknown) / super::SCALE_SD).collect();
        let change: Vec<f64> = (0..self.frame.len())
            .map(|channel| data.value(channel, self.frame[channel]) - self.frame[channel])
            .collect();
        1.0 + robust(&change, &by_factor, driven)
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
    fn linear(&self, data: &Data, impedance: &Matrix, rows: &Matrix, faults: &[Fault]) -> Option<Linear> {
        let network = self.network(impedance, faults);
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

    /// The data as far as the signs of the model's values are known: uneven coats and displaced electrodes may turn those
    /// of small values. A factor of the sheet or of a contact turns none.
    fn with_known_signs(&self, data: &Data, impedance: &Matrix, rows: &Matrix, faults: &[Fault]) -> Data {
        let last = self.identifier.unknown_of_contact(self.protocol.electrode_count() - 1);
        let (coat, displacements) = (1..self.identifier.unknown_of_contacts(), last + 1..rows.columns);
        let spread_ohm = |channel: usize| {
            let row = rows.row(channel);
            dot(&row[coat.clone()], &row[coat.clone()])
                .sqrt()
                .hypot(dot(&row[displacements.clone()], &row[displacements.clone()]).sqrt())
        };
        data.with_known_signs(&self.values(impedance, faults), spread_ohm)
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
            let off = (data.value(channel, residuals[channel]) - residuals[channel]) / data.sd[channel];
            residuals[channel] = if network.is_open(one) { 0.0 } else { off };
        }
        residuals
    }

    /// The fit under some faults, from some unknowns; `None` where the model has no solution, and where the fit cannot
    /// become as good as one with the misfit `least`.
    pub(super) fn fit(&self, data: &Data, faults: &[Fault], start: &[f64], least: f64) -> Option<Fit> {
        self.fit_in(STEPS.most, data, faults, start, least)
    }

    /// A fit without a step: the skin at some unknowns.
    pub(super) fn at(&self, data: &Data, faults: &[Fault], x: &[f64]) -> Option<Fit> {
        self.fit_in(0, data, faults, x, f64::INFINITY)
    }

    fn fit_in(&self, most: usize, data: &Data, faults: &[Fault], start: &[f64], least: f64) -> Option<Fit> {
        let impedance = self.impedance(start, faults)?;
        let changes_nothing = |fault: &Fault| matches!(fault, Fault::Cut(_) | Fault::OpenElectrode { .. });
        let is_sound = faults.iter().all(changes_nothing);
        let rows = if is_sound { &self.sound } else { &self.rows(&self.network(&impedance, faults)) };
        let data = self.with_known_signs(data, &impedance, rows, faults);
        let linear = self.linear(&data, &impedance, rows, faults)?;
        let search = Search { model: self, data: &data, linear: &linear, count: start.len(), least };
        let sizes = faults.iter().filter_map(|fault| fault.size(self.typical_ohm));
        let start = search.point(start.iter().copied().chain(sizes).collect(), faults)?;
        let found = minimise(&search, start, &Steps { most, ..STEPS }).ok()?;
        // A skin without a solution, or one that will not become good enough.
        if found.end == End::NoDecrease || search.is_hopeless(&found.point, found.costs.len() - 1) {
            return None;
        }
        let Point { mut x, faults, impedance, residuals } = found.point;
        let squares = dot(&residuals, &residuals) + dot(&x, &x);
        let open = self.network(&impedance, &faults);
        let log_evidence = self.log_evidence(&data, &open, squares, &linear);
        let used = self.protocol.channels().iter().filter(|one| !open.is_open(one)).count().max(1);
        x.truncate(search.count);
        let misfit = (squares / used as f64).sqrt();
        Some(Fit { faults, x, log_evidence, used, misfit, residuals, impedance, linear, data })
    }

    /// The logarithm of the probability of the data, by Laplace's approximation about the fit; the values of open
    /// electrodes may be anything.
    fn log_evidence(&self, data: &Data, network: &Network, squares: f64, linear: &Linear) -> f64 {
        let size = rms(self.frame.iter().copied());
        let channel = |(channel, one): (usize, &Channel)| match network.is_open(one) {
            true => {
                let value = data.values[channel].abs().max(MIN_SHARE * size);
                -(2.0 * DECADES * std::f64::consts::LN_10 * value).ln()
            }
            false => -(data.sd[channel] * TAU.sqrt()).ln(),
        };
        let channels: f64 = self.protocol.channels().iter().enumerate().map(channel).sum();
        channels - 0.5 * (squares + linear.factor.log_determinant())
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

/// The search of the skin under some faults, with the derivatives at the start.
struct Search<'a> {
    model: &'a Model,
    data: &'a Data,
    linear: &'a Linear,
    /// Unknowns of the skin; those that follow are sizes of faults.
    count: usize,
    /// The least misfit so far.
    least: f64,
}

/// A skin with faults of some sizes.
struct Point {
    x: Vec<f64>,
    faults: Vec<Fault>,
    impedance: Matrix,
    residuals: Vec<f64>,
}

impl Search<'_> {
    fn point(&self, x: Vec<f64>, faults: &[Fault]) -> Option<Point> {
        let mut faults = faults.to_vec();
        let sized: Vec<usize> = self.model.sized(&faults).collect();
        for (at, size) in sized.into_iter().zip(&x[self.count..]) {
            faults[at] = faults[at].with_size(*size, self.model.typical_ohm);
        }
        let impedance = self.model.impedance(&x[..self.count], &faults)?;
        let residuals = self.model.residuals(self.data, &impedance, &faults);
        Some(Point { x, faults, impedance, residuals })
    }

    /// Whether a fit cannot become as good as the best one.
    fn is_hopeless(&self, point: &Point, steps: usize) -> bool {
        steps == TRIAL_STEPS && rms(point.residuals.iter().copied()) > HOPELESS * self.least
    }
}

/// The equations of a step if the errors have `times` their standard deviations: `(times^2 + A'A) s = A' r - times^2 x`.
struct Inflated<'a> {
    linear: &'a Linear,
    times: f64,
    right: Vec<f64>,
}

impl Equations for Inflated<'_> {
    fn step(&self, _: f64) -> Result<Vec<f64>, NotPositiveDefinite> {
        if self.times == 1.0 {
            return Ok(self.linear.factor.solve(&self.right));
        }
        let mut normal = self.linear.normal.clone();
        (0..normal.rows).for_each(|i| *normal.at_mut(i, i) += self.times * self.times - 1.0);
        Ok(Cholesky::new(&normal)?.solve(&self.right))
    }
}

impl<'a> LeastSquares for Search<'a> {
    type Point = Point;
    type Equations = Inflated<'a>;
    type Error = NotPositiveDefinite;

    fn cost(&self, point: &Point) -> f64 {
        dot(&point.residuals, &point.residuals) + dot(&point.x, &point.x)
    }

    fn equations(&self, point: &Point) -> Result<Inflated<'a>, NotPositiveDefinite> {
        let times = (MIN_ERROR * rms(point.residuals.iter().copied())).max(1.0);
        let mut right = self.linear.transposed_product(&point.residuals);
        right.iter_mut().zip(&point.x).for_each(|(right, x)| *right -= times * times * x);
        Ok(Inflated { linear: self.linear, times, right })
    }

    fn limit(&self, from: &Point, step: &mut [f64]) {
        step.iter_mut().zip(&from.x).for_each(|(part, x)| *part = (x + *part).clamp(-MAX_SD, MAX_SD) - x);
    }

    fn moved(&self, from: &Point, step: &[f64]) -> Option<Point> {
        self.point(from.x.iter().zip(step).map(|(x, part)| x + part).collect(), &from.faults)
    }

    fn is_enough(&self, point: &Point, steps: usize) -> bool {
        self.is_hopeless(point, steps)
    }
}

impl Linear {
    fn new(a: Matrix) -> Option<Self> {
        let Normal { matrix: normal, .. } = Normal::of(&a, &vec![0.0; a.rows]).with_unit_priors(&vec![0.0; a.columns]);
        let factor = Cholesky::new(&normal).ok()?;
        Some(Linear { a, normal, factor })
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
        let mut explained = vec![0.0; target.len()];
        self.a.product_into(&self.factor.solve(&self.transposed_product(&target)), &mut explained);
        target.iter().zip(explained).map(|(target, explained)| target - explained).collect()
    }

    /// Half of the least squares of residuals and unknowns about a fit: residuals `r` there, and `A x`.
    pub(super) fn least_squares(&self, residuals: &[f64], moved: &[f64]) -> f64 {
        let target: Vec<f64> = residuals.iter().zip(moved).map(|(residual, moved)| residual + moved).collect();
        let passed = self.transposed_product(&target);
        0.5 * (dot(&target, &target) - dot(&passed, &self.factor.solve(&passed)))
    }
}

/// Values between all electrodes and the first, for currents between the same: they determine the network.
fn pairs(electrodes: usize) -> Result<Protocol, dermis::protocol::ProtocolError> {
    let pairs = (1..electrodes).flat_map(|k| (k..electrodes).map(move |m| Channel { drive: [k, 0], measure: [m, 0] }));
    Protocol::new(electrodes, pairs.collect())
}
