//! The untouched frame as a function of the unknowns, for other inferences than [`Identifier::identify`].

use super::{Data, Identifier, MAX_SD, Value};
use crate::forward::{ForwardError, ForwardModel};
use crate::linalg::Matrix;

impl Identifier {
    /// Number of unknowns: scale, coating, common contact, contacts, displacements, sizes.
    pub fn unknown_count(&self) -> usize {
        1 + self.basis.columns + 1 + self.model.contact_impedances().len() + self.displacements.len()
    }

    /// The unknown that is the common factor of all contact impedances.
    pub fn unknown_of_contacts(&self) -> usize {
        1 + self.basis.columns
    }

    /// The unknown that is the contact impedance of an electrode over the common factor of all.
    pub fn unknown_of_contact(&self, electrode: usize) -> usize {
        2 + self.basis.columns + electrode
    }

    /// The model at some unknowns, in standard deviations of their priors. Displacements are limited to five of them, so
    /// that cells stay valid.
    ///
    /// # Errors
    /// Unknowns that are not finite, or so large that the model has no solution.
    ///
    /// # Panics
    /// If there are not [`unknown_count`](Self::unknown_count) of them.
    pub fn model_of(&self, x: &[f64]) -> Result<ForwardModel, ForwardError> {
        assert_eq!(x.len(), self.unknown_count(), "a value for each unknown");
        let mut state = self.unknowns(x);
        for (by, displacement) in state.displaced.iter_mut().zip(&self.displacements) {
            *by = by.clamp(-MAX_SD * displacement.sd, MAX_SD * displacement.sd);
        }
        self.model_at(&state)
    }

    /// The derivative of the untouched frame of such a model, channels x unknowns; ohm for a standard deviation.
    ///
    /// # Errors
    /// A forward problem without a solution.
    pub fn derivatives(&self, model: &ForwardModel) -> Result<Matrix, ForwardError> {
        let value = |channel| Value { channels: vec![(channel, 1.0)], measured: 0.0, sd: 1.0 };
        let values = (0..model.protocol().channel_count()).map(value).collect();
        self.jacobian(model, &Data { values })
    }

    /// The exact untouched frame of the design minus that of its mesh, ohm.
    pub fn discretisation_ohm(&self) -> &[f64] {
        &self.discretisation_ohm
    }

    /// The displacement of each electrode in the chart of the surface at some unknowns, m.
    pub fn displacements_m(&self, x: &[f64]) -> Vec<[f64; 2]> {
        let mut all = vec![[0.0; 2]; self.model.contact_impedances().len()];
        for (displacement, by_m) in self.displacements.iter().zip(self.unknowns(x).displaced) {
            if let Some((electrode, direction)) = displacement.electrode {
                (0..2).for_each(|axis| all[electrode][axis] += by_m * direction[axis]);
            }
        }
        all
    }
}
