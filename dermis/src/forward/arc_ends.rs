//! Correction of the discretisation error of linear elements at the ends of arc electrodes, as a transform between the
//! electrodes and the mesh.
//!
//! At the end of an electrode on an edge the potential behaves like `r^(1/2)` down to the length `l = s z` of the
//! contact. Linear elements of size `h` represent it with an error of the order `h`, so that the resistances between the
//! electrodes are too low. An arc has no exact near field like a disc. So the untouched skin is solved on the mesh, with
//! the transfer impedance `S`, and on copies that are refined at the ends and then everywhere, with `S_fine`. From then on the
//! matrix `M` with
//!
//! `M S M' = S_fine`
//!
//! is applied to every solution: an electrode's potential is that of the mesh times `M`, and currents `I` of the
//! electrodes are currents `M' I` of the mesh. `M` is near 1, and exact for the untouched skin and for every multiple of
//! its resistances; of other changes it corrects the part of first order.

use super::{ElectrodeNetwork, ForwardModel};
use crate::linalg::Matrix;
use crate::mesh::{Mesh, Refined};
use std::collections::BTreeMap;

/// Halvings of the edges at an end. Each halves the error of the end, which is 7 % of the voltages of driven electrodes
/// for edges of a twelfth of the electrode's length (`dermis/tests/rim_arcs.rs`): 0.05 % are left.
const HALVINGS: usize = 7;
/// Iterations for `M`; each multiplies the misfit by the deviation of `M` from 1, a few per cent.
const ITERATIONS: usize = 8;

/// The models on the finer meshes, for a skin and its instances with other resistances.
#[derive(Debug)]
pub(super) struct ArcEnds {
    graded: Finer,
    finest: Finer,
}

/// A model on a finer mesh.
#[derive(Debug)]
struct Finer {
    model: ForwardModel,
    /// The coarse cell that contains each cell.
    parents: Vec<usize>,
}

impl ArcEnds {
    /// The finer meshes of a model's; `None` without arcs.
    pub(super) fn new(model: &ForwardModel) -> crate::Result<Option<Self>> {
        let ends = model.mesh().arc_ends();
        if ends.is_empty() {
            return Ok(None);
        }
        let Some(graded) = graded(model.mesh(), &ends) else { return Ok(None) };
        let Some(finest) = graded.refined(|_| true) else { return Ok(None) };
        let (graded, finest) = rayon::join(|| Finer::new(model, &graded), || Finer::new(model, &finest));
        Ok(Some(ArcEnds { graded: graded?, finest: finest? }))
    }

    /// The transform `M`, electrodes x electrodes, of the skin or an instance of it with other resistances.
    pub(super) fn transform(&self, model: &ForwardModel) -> crate::Result<Matrix> {
        let own = || model.network(model.rest_conductivity());
        let (own, (graded, finest)) =
            rayon::join(own, || rayon::join(|| self.graded.impedances(model), || self.finest.impedances(model)));
        let (own, graded, mut target) = (own?, graded?, finest?);
        extrapolate(&mut target, &graded);
        Ok(matching(&own, &target))
    }

    /// The derivatives of the untouched frame by the contact impedances: channels x electrodes. The corrected untouched
    /// frame is that of the finer meshes, so these are theirs.
    pub(super) fn contact_jacobian(&self, model: &ForwardModel) -> crate::Result<Matrix> {
        let (graded, finest) =
            rayon::join(|| self.graded.contact_jacobian(model), || self.finest.contact_jacobian(model));
        let (graded, mut target) = (graded?, finest?);
        extrapolate(&mut target, &graded);
        Ok(target)
    }
}

impl Finer {
    fn new(model: &ForwardModel, refined: &Refined) -> crate::Result<Self> {
        let rest = of_parents(model.rest_conductivity(), &refined.parents);
        let fine = ForwardModel::from_parts(&refined.mesh, model.contact_impedances(), model.protocol(), &rest)?;
        Ok(Finer { model: fine, parents: refined.parents.clone() })
    }

    /// The model with the resistances of that on the coarse mesh.
    fn with_resistances(&self, model: &ForwardModel) -> crate::Result<ForwardModel> {
        let rest = of_parents(model.rest_conductivity(), &self.parents);
        Ok(self.model.with_parameters(&self.model.mesh().nodes, model.contact_impedances(), &rest)?)
    }

    fn impedances(&self, model: &ForwardModel) -> crate::Result<Matrix> {
        let fine = self.with_resistances(model)?;
        Ok(fine.network(fine.rest_conductivity())?.transfer_impedance)
    }

    fn contact_jacobian(&self, model: &ForwardModel) -> crate::Result<Matrix> {
        let fine = self.with_resistances(model)?;
        Ok(fine.contact_jacobian(fine.rest_conductivity())?)
    }
}

/// The limit for ever finer meshes: without the ends the error is that of smooth fields, of second order, and the finest
/// mesh has a quarter of it.
fn extrapolate(finest: &mut Matrix, graded: &Matrix) {
    for (value, graded) in finest.values.iter_mut().zip(&graded.values) {
        *value += (*value - graded) / 3.0;
    }
}

fn of_parents(values: &[f64], parents: &[usize]) -> Vec<f64> {
    parents.iter().map(|&parent| values[parent]).collect()
}

/// `M` with `M S M' = target`, from `M = 1` by adding half of the misfit times `Y`: to first order in the misfit both
/// sides of the product take half of it.
fn matching(own: &ElectrodeNetwork, target: &Matrix) -> Matrix {
    let count = target.rows;
    let mut transform = Matrix::zeros(count, count);
    (0..count).for_each(|i| *transform.at_mut(i, i) = 1.0);
    for _ in 0..ITERATIONS {
        let mut misfit = own.transformed_impedance(&transform);
        misfit.values.iter_mut().zip(&target.values).for_each(|(value, target)| *value = 0.5 * (target - *value));
        let step = misfit.times(&own.admittance);
        transform.values.iter_mut().zip(&step.values).for_each(|(value, step)| *value += step);
    }
    transform
}

/// The mesh with the edges at the ends halved again and again.
fn graded(mesh: &Mesh, ends: &BTreeMap<usize, usize>) -> Option<Refined> {
    let mut graded = Refined { parents: (0..mesh.cell_count()).collect(), mesh: mesh.clone() };
    for _ in 0..HALVINGS {
        graded = graded.refined(|edge| edge.iter().any(|node| ends.contains_key(node)))?;
    }
    Some(graded)
}
