//! Correction of the discretisation error of linear elements at the ends of arc electrodes, as a transform between the
//! electrodes and the mesh.
//!
//! At the end of an electrode on an edge the potential behaves like `r^(1/2)` down to the length `l = s z` of the
//! contact. Linear elements of size `h` represent it with an error of the order `h`, so that the resistances between the
//! electrodes are too low. An arc has no exact near field like a disc. So the untouched skin is solved on the mesh, with
//! the transfer impedance `S`, and on copies that are refined at the ends and then everywhere, with `S_fine`. The error is that of
//! the sheet, so what an even current meets in the contact of each electrode, `C = z / w` on the diagonal, is left out. From
//! then on the matrix `M` with
//!
//! `M (S - C) M' = S_fine - C`
//!
//! is applied to every solution: `S` becomes `M S M' + K` with `K = C - M C M'`, so that an electrode's potential changes by
//! that of the mesh times `M`. `M` is near 1, and exact for the untouched skin; of changes it corrects the part of first order, and
//! none of the contacts, which remain where the sheet conducts far better.

use super::network::series;
use super::{ElectrodeNetwork, ForwardError, ForwardModel};
use crate::linalg::Matrix;
use crate::mesh::{Mesh, Refined};
use std::collections::BTreeMap;

/// Halvings of the edges at an end. Each halves the error of the end, which is 7 % of the voltages of driven electrodes
/// for edges of a twelfth of the electrode's length (`dermis/tests/rim_arcs.rs`): 0.05 % are left.
const HALVINGS: usize = 7;
/// Iterations for `M`; each multiplies the misfit by the deviation of `M` from 1, a few per cent.
const ITERATIONS: usize = 8;

/// The correction of transfer impedances `S` of a mesh: `M S M' + K`.
#[derive(Debug)]
pub(super) struct Transform {
    /// `M`, electrodes x electrodes; it keeps the constant, and so does its transpose.
    pub matrix: Matrix,
    /// `K`, electrodes x electrodes, ohm.
    pub constant: Matrix,
    /// The size of each electrode, m2, or m of an arc; 0 of a point.
    pub sizes: Vec<f64>,
}

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

    /// The transform of the skin or an instance of it with other resistances.
    pub(super) fn transform(&self, model: &ForwardModel) -> crate::Result<Transform> {
        let own = || model.network(model.rest_conductivity());
        let (own, (graded, finest)) =
            rayon::join(own, || rayon::join(|| self.graded.impedances(model), || self.finest.impedances(model)));
        let (own, graded, mut target) = (own?, graded?, finest?);
        extrapolate(&mut target, &graded);
        Ok(Transform::of(own, target, model)?)
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

impl Transform {
    /// From the transfer impedances of the mesh and of the limit of finer ones.
    fn of(own: ElectrodeNetwork, mut target: Matrix, model: &ForwardModel) -> Result<Self, ForwardError> {
        let sizes: Vec<f64> = (0..target.rows).map(|electrode| model.mesh().electrode_size(electrode)).collect();
        let contacts_ohm = contacts_ohm(model.contact_impedances(), &sizes);
        let sheet = own.with_series(&contacts_ohm.iter().map(|ohm| -ohm).collect::<Vec<f64>>())?;
        subtract(&mut target, &series(&contacts_ohm));
        Ok(Transform::new(matching(&sheet, &target), sizes, model.contact_impedances()))
    }

    fn new(matrix: Matrix, sizes: Vec<f64>, contact_impedances: &[f64]) -> Self {
        let mut constant = series(&contacts_ohm(contact_impedances, &sizes));
        let of_mesh = matrix.times(&constant).times(&matrix.transposed());
        subtract(&mut constant, &of_mesh);
        Transform { matrix, constant, sizes }
    }

    /// The same matrix with other contact impedances.
    pub(super) fn with_contacts(&self, contact_impedances: &[f64]) -> Self {
        Transform::new(self.matrix.clone(), self.sizes.clone(), contact_impedances)
    }
}

/// What an even current meets in the contact of each electrode, ohm.
fn contacts_ohm(impedances: &[f64], sizes: &[f64]) -> Vec<f64> {
    let of = |(impedance, size): (&f64, &f64)| if *size > 0.0 { impedance / size } else { 0.0 };
    impedances.iter().zip(sizes).map(of).collect()
}

fn subtract(from: &mut Matrix, other: &Matrix) {
    from.values.iter_mut().zip(&other.values).for_each(|(value, other)| *value -= other);
}

/// `M` with `M S M' = target`, from `M = 1` by adding half of the misfit times `Y`: to first order in the misfit both
/// sides of the product take half of it.
fn matching(own: &ElectrodeNetwork, target: &Matrix) -> Matrix {
    let mut transform = Matrix::identity(target.rows);
    for _ in 0..ITERATIONS {
        let mut misfit = transform.times(&own.transfer_impedance).times(&transform.transposed());
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
