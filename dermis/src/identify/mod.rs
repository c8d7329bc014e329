//! The skin as it was made, from its untouched frame: uneven coating, displaced electrodes and contact impedances.
//!
//! An untouched frame determines far more than the sheet resistance that [`fit`](crate::fit) finds: its 435 independent
//! values are known to a thousandth, while an uneven coating changes them by several per cent. The unknowns are the
//! logarithm of the coating's conductance (a smooth field), the displacements of the electrodes, and the logarithms of
//! their contact impedances. Their estimate is the one of greatest posterior probability,
//!
//! `minimise |W (y - f(x))|^2 + |x|^2`,
//!
//! with `f` the complete electrode model, `W` the inverse standard deviations of the values, and `x` the unknowns over
//! their standard deviations of the prior (Gauss-Newton steps; Kaipio and Somersalo, 2005, DOI 10.1007/b138659, section
//! 3.1). A model of the identified skin tells where a touch changes the frame and how, which a model of the design does
//! not.
//!
//! ```
//! use dermis::design::SkinDesign;
//! use dermis::forward::ForwardModel;
//! use dermis::identify::{IdentifyOptions, Identifier};
//! use dermis::mesh::Mesh;
//!
//! let mut design = SkinDesign::shipped("tank16").expect("a shipped design");
//! design.mesh = design.mesh.scaled(2.0);
//! let model = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
//! let even: Vec<f64> = model.rest_conductivity().iter().map(|s| 1.3 * s).collect();
//! let untouched = model.solve(&even)?; // ohm
//! let identifier = Identifier::new(&design, &model, IdentifyOptions::default())?.on_equal_mesh();
//! let found = identifier.identify(&untouched, &vec![1e-3; untouched.len()])?;
//! let factor = found.conductivity()[0] / model.rest_conductivity()[0];
//! assert!((factor - 1.3).abs() < 0.02 && found.misfit < 1.0);
//! # Ok::<(), dermis::Error>(())
//! ```

mod coating;
mod linear;
mod placement;
#[cfg(test)]
mod tests;

use crate::design::SkinDesign;
use crate::estimate::least_squares::{Control, LeastSquares, Normal, Steps, minimise};
use crate::forward::{ForwardError, ForwardModel};
use crate::frame::{Frame, quantities};
use crate::geom::{Point3, Surface};
use crate::linalg::Matrix;
use crate::mesh::Refined;
use crate::stats::rms;
use placement::{Displacement, displacements};
use thiserror::Error;

/// What is known of a skin before it is measured, and of the instrument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifyOptions {
    /// Standard deviation of the logarithm of the coating's conductance about its mean.
    pub coating_sd: f64,
    /// Correlation length of the coating, m: at a straight-line distance d the correlation is `exp(-d^2 / (2 l^2))`.
    pub correlation_m: f64,
    /// Root mean square of the electrodes' displacements, m.
    pub displacement_m: f64,
    /// Standard deviation of the radius of all electrodes, relative; 0 where it is that of the design.
    pub radius_sd: f64,
    /// Standard deviation of the length of a cylinder over its diameter, or of the width of a rectangle over its height,
    /// relative; 0 where it is that of the design.
    pub length_sd: f64,
    /// Standard deviation of the logarithm of a contact impedance about their mean.
    pub contact_sd: f64,
    /// Standard deviation of the logarithms of the mean conductance and of the mean contact impedance.
    pub scale_sd: f64,
    /// Error of the model and the instrument, relative to the root mean square of the values without a driven
    /// electrode; the error of a value with a driven electrode is [`DRIVEN_ERROR`] of it.
    pub relative_error: f64,
}

/// Relative error of a value that uses a driven electrode, whose contact is not exactly a uniform film.
pub const DRIVEN_ERROR: f64 = 4e-3;

impl Default for IdentifyOptions {
    /// Priors as wide as the skins of the training recipes (`dermis-study/recipes`: coatings of 15 % over 30 to 60 mm,
    /// displacements of 0.7 mm, contacts of 35 %); any scale within a factor of two. The relative error is twice the
    /// discretisation error that is left in the untouched frame of `cylinder30`.
    fn default() -> Self {
        IdentifyOptions {
            coating_sd: 0.15,
            correlation_m: 0.04,
            displacement_m: 7e-4,
            radius_sd: 0.0,
            length_sd: 0.0,
            contact_sd: 0.35,
            scale_sd: 0.7,
            relative_error: 1e-3,
        }
    }
}

/// A skin that cannot be identified.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum IdentifyError {
    /// A list of another length than the protocol.
    #[error("{what} has {got} values, but the protocol has {expected}")]
    Length {
        /// The list.
        what: &'static str,
        /// Its number of values.
        got: usize,
        /// Channels of the protocol.
        expected: usize,
    },
    /// An instrument without signs.
    #[error("frames without signs (`amplitude_only`) do not identify a skin: give a protocol with signs")]
    AmplitudeOnly,
    /// No usable value.
    #[error(
        "no channel has a finite value and a finite, positive standard deviation: give frames of the untouched skin"
    )]
    NoChannel,
}

/// The frame is nearly linear in the logarithms: after the second step what is left of the step is below a hundredth of the
/// noise on most skins with 20 % of unevenness.
const STEPS: Steps = Steps { most: 12, control: Control::Halving(6), shortest: 0.0, least_decrease: 1e-3 };
/// Longest displacement, in standard deviations of its prior, so that cells stay valid.
const MAX_SD: f64 = 5.0;

/// A skin as it was made.
#[derive(Debug, Clone)]
pub struct Identified {
    model: ForwardModel,
    /// Displacement of each electrode in the chart of the surface, m.
    pub displacements_m: Vec<[f64; 2]>,
    /// Root mean square of the residuals and of the unknowns, over what noise and prior predict: about one or less for
    /// a skin that the model describes.
    pub misfit: f64,
}

impl Identified {
    /// The forward model with the displaced electrodes, the contact impedances and the coating, which is its rest
    /// conductivity.
    pub fn model(&self) -> &ForwardModel {
        &self.model
    }

    /// The conductance of the coating, a value per cell.
    pub fn conductivity(&self) -> &[f64] {
        self.model.rest_conductivity()
    }
}

/// What does not depend on the frame: the unknowns of a design, and the discretisation error of its mesh.
#[derive(Debug, Clone)]
pub struct Identifier {
    model: ForwardModel,
    surface: Surface,
    options: IdentifyOptions,
    /// Channels that measure the same quantity, with their signs.
    quantities: Vec<Vec<(usize, f64)>>,
    /// Unit coating field, cells x coefficients.
    basis: Matrix,
    displacements: Vec<Displacement>,
    /// The exact untouched frame of the design minus that of its mesh.
    discretisation_ohm: Vec<f64>,
}

/// Values of the unknowns.
#[derive(Debug, Clone)]
struct Unknowns {
    log_conductivity: Vec<f64>,
    log_contacts: Vec<f64>,
    /// In the unit of each displacement.
    displaced: Vec<f64>,
}

impl Identifier {
    /// The identifier of a design on a mesh, with the forward model of both.
    ///
    /// On a body that can be meshed, the discretisation error of the model is measured with a finer mesh.
    ///
    /// # Errors
    /// An instrument without signs; a design that cannot be meshed or solved.
    pub fn new(design: &SkinDesign, model: &ForwardModel, options: IdentifyOptions) -> crate::Result<Self> {
        if design.protocol.amplitude_only() {
            return Err(IdentifyError::AmplitudeOnly.into());
        }
        let surface = design.body.surface();
        let basis = coating::basis(model.mesh(), options.correlation_m)?;
        Ok(Identifier {
            surface,
            options,
            quantities: quantities(&design.protocol),
            basis,
            displacements: displacements(design, model.mesh(), &options),
            discretisation_ohm: discretisation_ohm(design, model)?,
            model: model.clone(),
        })
    }

    /// The same for frames that were solved on the same mesh, without discretisation error.
    #[must_use]
    pub fn on_equal_mesh(mut self) -> Self {
        self.discretisation_ohm.fill(0.0);
        self
    }

    /// Identifies the skin from the mean of its untouched frames and the standard deviation of each value of the mean,
    /// ohm. Channels whose value is not finite, or whose deviation is not finite and positive, are left out.
    ///
    /// # Errors
    /// Lists of the wrong length, no usable channel, a forward problem without a solution.
    pub fn identify(&self, untouched: &Frame, sd_ohm: &[f64]) -> crate::Result<Identified> {
        let search = Search { identifier: self, data: self.data(untouched, sd_ohm)? };
        let start = search.candidate(vec![0.0; self.unknown_count()])?;
        let Candidate { x, model, residuals, squares } = minimise(&search, start, &STEPS)?.point;
        let displacements_m = self.displacements_m(&x);
        Ok(Identified { model, displacements_m, misfit: (squares / residuals.len() as f64).sqrt() })
    }

    /// The unknowns from their values in standard deviations of the prior.
    fn unknowns(&self, x: &[f64]) -> Unknowns {
        let IdentifyOptions { coating_sd, contact_sd, scale_sd, .. } = self.options;
        let (coating, rest) = x.split_at(1 + self.basis.columns);
        let (contacts, displaced) = rest.split_at(1 + self.model.contact_impedances().len());
        let mut log_conductivity = vec![0.0; self.basis.rows];
        self.basis.product_into(&coating[1..], &mut log_conductivity);
        log_conductivity.iter_mut().for_each(|value| *value = scale_sd * coating[0] + coating_sd * *value);
        let log_contacts = contacts[1..].iter().map(|own| scale_sd * contacts[0] + contact_sd * own).collect();
        let displaced = self.displacements.iter().zip(displaced).map(|(one, x)| one.sd * x).collect();
        Unknowns { log_conductivity, log_contacts, displaced }
    }

    fn nodes_m(&self, displaced: &[f64]) -> Vec<Point3> {
        let mut nodes_m = self.model.mesh().nodes.clone();
        for (displacement, &by) in self.displacements.iter().zip(displaced) {
            displacement.apply(&self.surface, by, &mut nodes_m);
        }
        nodes_m
    }

    fn model_at(&self, state: &Unknowns) -> Result<ForwardModel, ForwardError> {
        let times = |values: &[f64], logs: &[f64]| -> Vec<f64> {
            values.iter().zip(logs).map(|(value, log)| value * log.exp()).collect()
        };
        let conductivity = times(self.model.rest_conductivity(), &state.log_conductivity);
        let contacts = times(self.model.contact_impedances(), &state.log_contacts);
        self.model.with_parameters(&self.nodes_m(&state.displaced), &contacts, &conductivity)
    }

    /// The derivative of the weighted values with respect to the unknowns in standard deviations, values x unknowns.
    fn jacobian(&self, model: &ForwardModel, data: &Data) -> Result<Matrix, ForwardError> {
        let mut jacobian = Matrix::zeros(data.values.len(), self.unknown_count());
        self.fill_coating(model, data, &mut jacobian)?;
        self.fill_contacts(model, data, &mut jacobian)?;
        self.fill_displacements(model, data, &mut jacobian)?;
        Ok(jacobian)
    }

    fn fill_coating(&self, model: &ForwardModel, data: &Data, out: &mut Matrix) -> Result<(), ForwardError> {
        let conductivity = model.rest_conductivity();
        let by_cell = model.jacobian(conductivity)?;
        let mut by_log = Matrix::zeros(data.values.len(), conductivity.len());
        for (value, row) in data.values.iter().zip(by_log.values.chunks_exact_mut(conductivity.len())) {
            // Reciprocal channels have the same derivative.
            let factor = value.sign() / value.sd;
            let changes = by_cell.row(value.channels[0].0).iter().zip(conductivity);
            row.iter_mut().zip(changes).for_each(|(change, (derivative, s))| *change = factor * derivative * s);
        }
        let by_coefficient = by_log.times(&self.basis);
        for row in 0..by_log.rows {
            let (first, coating) = out.row_mut(row)[..1 + self.basis.columns].split_first_mut().expect("the scale");
            *first = self.options.scale_sd * by_log.row(row).iter().sum::<f64>();
            let changes = coating.iter_mut().zip(by_coefficient.row(row));
            changes.for_each(|(out, change)| *out = self.options.coating_sd * change);
        }
        Ok(())
    }

    fn fill_contacts(&self, model: &ForwardModel, data: &Data, out: &mut Matrix) -> Result<(), ForwardError> {
        let by_contact = model.contact_jacobian(model.rest_conductivity())?;
        let first = 1 + self.basis.columns;
        for (row, value) in data.values.iter().enumerate() {
            for (electrode, impedance) in model.contact_impedances().iter().enumerate() {
                let change = impedance * value.of(&|channel| by_contact.at(channel, electrode)) / value.sd;
                *out.at_mut(row, first) += self.options.scale_sd * change;
                *out.at_mut(row, first + 1 + electrode) = self.options.contact_sd * change;
            }
        }
        Ok(())
    }

    fn fill_displacements(&self, model: &ForwardModel, data: &Data, out: &mut Matrix) -> Result<(), ForwardError> {
        let nodes_m = &model.mesh().nodes;
        let velocities: Vec<_> =
            self.displacements.iter().map(|displacement| displacement.velocities(&self.surface, nodes_m)).collect();
        let by_m = model.displacement_jacobian(model.rest_conductivity(), &velocities)?;
        let first = out.columns - self.displacements.len();
        for (row, value) in data.values.iter().enumerate() {
            for (index, displacement) in self.displacements.iter().enumerate() {
                let change = value.of(&|channel| by_m.at(channel, index));
                *out.at_mut(row, first + index) = displacement.sd * change / value.sd;
            }
        }
        Ok(())
    }
}

/// The search of the skin that explains some data.
struct Search<'a> {
    identifier: &'a Identifier,
    data: Data,
}

impl Search<'_> {
    /// The skin of some unknowns, in standard deviations of their priors.
    fn candidate(&self, x: Vec<f64>) -> Result<Candidate, ForwardError> {
        let model = self.identifier.model_at(&self.identifier.unknowns(&x))?;
        let residuals = self.data.residuals(&model.solve(model.rest_conductivity())?);
        let squares = residuals.iter().chain(&x).map(|value| value * value).sum();
        Ok(Candidate { x, model, residuals, squares })
    }
}

impl LeastSquares for Search<'_> {
    type Point = Candidate;
    type Equations = Normal;
    type Error = crate::Error;

    fn cost(&self, point: &Candidate) -> f64 {
        point.squares
    }

    fn equations(&self, point: &Candidate) -> crate::Result<Normal> {
        let derivatives = self.identifier.jacobian(&point.model, &self.data)?;
        Ok(Normal::of(&derivatives, &point.residuals).with_unit_priors(&point.x))
    }

    /// Displacements keep cells valid.
    fn limit(&self, from: &Candidate, step: &mut [f64]) {
        let first = step.len() - self.identifier.displacements.len();
        for (part, from) in step.iter_mut().zip(&from.x).skip(first) {
            *part = (from + *part).clamp(-MAX_SD, MAX_SD) - from;
        }
    }

    fn moved(&self, from: &Candidate, step: &[f64]) -> Option<Candidate> {
        self.candidate(from.x.iter().zip(step).map(|(from, by)| from + by).collect()).ok()
    }
}

/// A skin that may be the measured one.
struct Candidate {
    /// The unknowns, in standard deviations of their priors.
    x: Vec<f64>,
    model: ForwardModel,
    /// What it leaves of the values, in standard deviations.
    residuals: Vec<f64>,
    /// Sum of the squares of both.
    squares: f64,
}

/// A measured quantity: the mean of its usable channels.
struct Value {
    channels: Vec<(usize, f64)>,
    measured: f64,
    sd: f64,
}

impl Value {
    /// The mean of a property of its channels, with their signs.
    fn of(&self, property: &dyn Fn(usize) -> f64) -> f64 {
        let sum: f64 = self.channels.iter().map(|&(channel, sign)| sign * property(channel)).sum();
        sum / self.channels.len() as f64
    }

    fn sign(&self) -> f64 {
        self.channels[0].1
    }

    /// The standard error of its mean by how far its channels are apart in a frame: a saturated one is not as its reciprocal one.
    fn disagreement(&self, frame: &Frame) -> f64 {
        let (count, mean) = (self.channels.len() as f64, self.of(&|channel| frame[channel]));
        let squares: f64 = self.channels.iter().map(|&(channel, sign)| (sign * frame[channel] - mean).powi(2)).sum();
        if count > 1.0 { (squares / (count * (count - 1.0))).sqrt() } else { 0.0 }
    }
}

struct Data {
    values: Vec<Value>,
}

impl Data {
    /// What a frame leaves of the values, over their standard deviations.
    fn residuals(&self, frame: &Frame) -> Vec<f64> {
        self.values.iter().map(|value| (value.measured - value.of(&|channel| frame[channel])) / value.sd).collect()
    }
}

impl Identifier {
    /// The usable quantities, less the discretisation error.
    fn data(&self, untouched: &Frame, sd_ohm: &[f64]) -> Result<Data, IdentifyError> {
        let channels = self.model.protocol().channels();
        let expected = channels.len();
        for (what, got) in [("the untouched frame", untouched.len()), ("the list of deviations", sd_ohm.len())] {
            if got != expected {
                return Err(IdentifyError::Length { what, got, expected });
            }
        }
        let usable =
            |channel: usize| untouched[channel].is_finite() && sd_ohm[channel].is_finite() && sd_ohm[channel] > 0.0;
        let free = (0..expected).filter(|&channel| usable(channel) && !channels[channel].touches_driven());
        let free_rms = rms(free.map(|channel| untouched[channel]));
        let value = |group: &Vec<(usize, f64)>| {
            let channels: Vec<(usize, f64)> = group.iter().copied().filter(|&(channel, _)| usable(channel)).collect();
            let count = channels.len() as f64;
            let variance = channels.iter().map(|&(channel, _)| sd_ohm[channel].powi(2)).sum::<f64>() / (count * count);
            let mut value = Value { channels, measured: 0.0, sd: 0.0 };
            value.measured = value.of(&|channel| untouched[channel] - self.discretisation_ohm[channel]);
            let driven = self.model.protocol().channels()[value.channels[0].0].touches_driven();
            let error = match driven || !free_rms.is_finite() {
                true => DRIVEN_ERROR * value.measured.abs(),
                false => self.options.relative_error * free_rms,
            };
            value.sd = variance.sqrt().hypot(error).hypot(value.disagreement(untouched));
            value
        };
        let groups = self.quantities.iter().filter(|group| group.iter().any(|&(channel, _)| usable(channel)));
        let values: Vec<Value> = groups.map(value).filter(|value| value.sd > 0.0).collect();
        if values.is_empty() { Err(IdentifyError::NoChannel) } else { Ok(Data { values }) }
    }
}

/// The untouched frame of a design on a finer mesh minus that of its model; zero on tetrahedra. The cells of the finer mesh are
/// quarters of the model's, with their new corners on the surface, or on the triangles of a body that is a mesh file.
fn discretisation_ohm(design: &SkinDesign, model: &ForwardModel) -> crate::Result<Vec<f64>> {
    let surface = design.body.surface();
    let Some(Refined { mesh: mut finer, .. }) = model.mesh().refined(|_| true) else {
        return Ok(vec![0.0; design.protocol.channel_count()]);
    };
    if surface != Surface::Free {
        finer.nodes.iter_mut().for_each(|node| *node = surface.walk(*node, [0.0; 2]));
    }
    let finer = ForwardModel::new(design, &finer)?;
    let exact = finer.solve(finer.rest_conductivity())?;
    Ok((&exact - &model.solve(model.rest_conductivity())?).0)
}
