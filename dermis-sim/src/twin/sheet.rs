//! A coating whose own conductance a press changes.

use super::{GaussianOptions, LayerOptions, Press, TwinError};
use crate::touch::{GaussianTouch, touched_conductivity};
use dermis::design::{Body, TouchEffect};
use dermis::forward::{ElectrodeNetwork, ForwardModel, Solver};
use dermis::mesh::Mesh;
use std::sync::{Mutex, PoisonError};

/// A coating on a body, whose conductance per cell presses change.
#[derive(Debug)]
pub(super) struct TouchedSheet {
    body: Body,
    change: Change,
    /// Memory of finished frames, to be reused.
    solvers: Mutex<Vec<Solver>>,
}

#[derive(Debug)]
enum Change {
    Gaussian(GaussianOptions, TouchEffect),
    Layer(LayerOptions),
}

impl TouchedSheet {
    pub(super) fn gaussian(options: GaussianOptions, body: &Body, effect: TouchEffect) -> Self {
        Self::new(Change::Gaussian(options, effect), body)
    }

    pub(super) fn layer(options: LayerOptions, body: &Body) -> Self {
        Self::new(Change::Layer(options), body)
    }

    fn new(change: Change, body: &Body) -> Self {
        TouchedSheet { body: body.clone(), change, solvers: Mutex::new(Vec::new()) }
    }

    /// The network between the electrodes during some presses.
    ///
    /// # Errors
    /// Presses that are off the skin, without a force, or too strong.
    pub(super) fn network(&self, forward: &ForwardModel, presses: &[Press]) -> crate::Result<ElectrodeNetwork> {
        let conductivity = self.conductivity(forward, presses)?;
        // A solver contains only work memory: its content from another thread has no effect.
        let pool = || self.solvers.lock().unwrap_or_else(PoisonError::into_inner);
        let free = pool().pop();
        let mut solver = free.unwrap_or_else(|| forward.solver());
        let network = solver.network(&conductivity)?;
        pool().push(solver);
        Ok(network)
    }

    /// The relative change of conductance by some presses together, integrated over the surface, m2.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    pub(super) fn strength_m2(&self, forward: &ForwardModel, presses: &[Press]) -> crate::Result<f64> {
        let (mesh, rest) = (forward.mesh(), forward.rest_conductivity());
        let touched = self.conductivity(forward, presses)?;
        let change =
            |(cell, (touched, rest)): (usize, (&f64, &f64))| mesh.cell_measure(cell) * (touched / rest - 1.0).abs();
        Ok(touched.iter().zip(rest).enumerate().map(change).sum())
    }

    fn conductivity(&self, forward: &ForwardModel, presses: &[Press]) -> crate::Result<Vec<f64>> {
        let (mesh, rest) = (forward.mesh(), forward.rest_conductivity());
        match &self.change {
            Change::Gaussian(options, effect) => {
                let touches = options.touches(presses, &self.body, mesh)?;
                Ok(touched_conductivity(mesh, &self.body.surface(), *effect, rest, &touches)?)
            }
            Change::Layer(options) => Ok(options.conductivity(presses, &self.body, mesh, rest)?),
        }
    }
}

impl GaussianOptions {
    fn touches(&self, presses: &[Press], body: &Body, mesh: &Mesh) -> Result<Vec<GaussianTouch>, TwinError> {
        let touch = |press: &Press| {
            press.check(body, mesh, self.width_m)?;
            let amplitude = self.amplitude_per_n * press.force_n;
            Ok(GaussianTouch { centre_m: press.centre_m, amplitude, width_m: self.width_m })
        };
        presses.iter().map(touch).collect()
    }
}
