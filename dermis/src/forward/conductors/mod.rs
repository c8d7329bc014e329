//! Floating conductors on the sheet: the effect of their contacts on the network between the electrodes.
//!
//! A conductor at potential `v` takes the current density `g(x) (u - v)` out of the sheet, and its net current is zero.
//! The potential under it is described by a few moments `m_k' u`, the coefficients of functions `phi_k(x)`: for example
//! the means over small sites, or polynomials over the whole conductor. With `C_kl = integral of g phi_k phi_l`, and
//! `e_k` the moments of a potential of 1 V, the power into the conductor is `(M'u - v e)' C (M'u - v e)`. Let
//! `C = R R'`, `K` be the system of the sheet and its electrodes, `K_ii` its interior part. With the electrodes at the
//! potentials `U`, `y = R' (M'u - v e)` follows from
//!
//! `(1 + R' Gamma R) y + R' E v = R' B U`, `E' R y = 0`, `Gamma = M' K_ii^-1 M`, `B = M' u_0`,
//!
//! where `Gamma` contains the Green's functions between the moments with all electrodes grounded and `u_0` the
//! potentials per volt of each electrode without any contact. The admittance between the electrodes increases by
//! `Q' (A^-1 - A^-1 P (P' A^-1 P)^-1 P' A^-1) Q` with `A = 1 + R' Gamma R`, `P = R' E`, `Q = R' B`: a low-rank update
//! (Woodbury, 1950; Hager, 1989, DOI 10.1137/1031049) whose cost depends only on the touched conductors, not on the
//! size of the mesh.

mod moments;
mod once;
mod system;
mod table;

pub use moments::{ConductorMoments, PotentialMoments};
pub use once::OnceMemory;

use super::{ElectrodeNetwork, ForwardError, ForwardModel};
use crate::linalg::{Cholesky, Matrix, NotPositiveDefinite, UpdateMemory, dot, eliminate_in_place};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};
use system::{System, Voltages};
use table::Table;

/// The remainder of a contact's matrix below this fraction of it is rounding error.
const RANK_TOLERANCE: f64 = 1e-15;
/// A contact whose matrix is below that at rest by more than this fraction is an error: it exceeds rounding.
const LOSS_TOLERANCE: f64 = 1e-9;

/// A conductor in contact with the sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct ConductorContact {
    /// The conductor.
    pub conductor: usize,
    /// `C`: symmetric, positive semidefinite, of the order of the conductor's moments; S if the moments are in volts.
    pub conductance: Matrix,
}

/// A skin with floating conductors, prepared for many contacts.
///
/// The Green's functions of a conductor are computed when it is first touched, and stored, up to a
/// [limit](Self::limit_table). Can be shared between threads by reference.
#[derive(Debug)]
pub struct FloatingConductors {
    model: ForwardModel,
    moments: Arc<PotentialMoments>,
    base: System,
    /// The contacts at rest, by conductor.
    at_rest: BTreeMap<usize, Matrix>,
    /// `B`: moments x electrodes; computed when a table is first used.
    potentials: OnceLock<Matrix>,
    /// Work memory of updates without a table, one for each thread that is in one.
    memories: Mutex<Vec<UpdateMemory>>,
    /// Per conductor the Green's functions between its own moments and its own and all later ones, moments x own
    /// moments.
    columns: Table,
}

impl ForwardModel {
    /// The network between the electrodes with conductors in contact, by the direct method: one more unknown per
    /// touched conductor, and a new factorisation. [`FloatingConductors::network`] gives the same result much faster.
    ///
    /// # Errors
    /// A conductivity or conductance that is not positive and finite.
    ///
    /// # Panics
    /// If a contact does not fit its conductor's moments.
    pub fn network_with_conductors(
        &self,
        conductivity: &[f64],
        moments: &PotentialMoments,
        contacts: &[ConductorContact],
    ) -> Result<ElectrodeNetwork, ForwardError> {
        let system = System::new(self, conductivity, moments, contacts)?;
        self.with_own_series(ElectrodeNetwork::new(system.factor.schur().clone())?)
    }
}

/// One touched conductor of an update.
struct Touch {
    conductor: usize,
    /// `R`: moments x rank.
    root: Matrix,
    /// Start of its part in the update.
    start: usize,
    /// Whether the base system has no unknown for its potential.
    floating: bool,
}

/// The touched conductors of an update and their sizes.
struct Update {
    touches: Vec<Touch>,
    rank: usize,
    floating_count: usize,
}

impl FloatingConductors {
    /// The skin of a model with some conductors in contact at rest.
    ///
    /// # Errors
    /// A conductivity or a resting conductance that is not positive and finite.
    ///
    /// # Panics
    /// If a contact does not fit its conductor's moments, or a moment contains a node that does not exist.
    pub fn new(
        model: &ForwardModel,
        conductivity: &[f64],
        moments: Arc<PotentialMoments>,
        at_rest: &[ConductorContact],
    ) -> Result<Self, ForwardError> {
        let base = System::new(model, conductivity, &moments, at_rest)?;
        Ok(FloatingConductors {
            model: model.clone(),
            at_rest: at_rest.iter().map(|contact| (contact.conductor, contact.conductance.clone())).collect(),
            columns: Table::new(moments.conductors().len()),
            moments,
            base,
            potentials: OnceLock::new(),
            memories: Mutex::default(),
        })
    }

    /// `B`: moments x electrodes.
    fn potentials(&self) -> &Matrix {
        self.potentials.get_or_init(|| {
            let (symbolic, count) = (self.base.symbolic(&self.model), self.electrode_count());
            let interior = symbolic.unknown_count() - count;
            let mut unknowns = Matrix::zeros(symbolic.unknown_count(), count);
            (0..count).for_each(|electrode| *unknowns.at_mut(interior + electrode, electrode) = 1.0);
            self.base.factor.extend_homogeneous(symbolic, &mut unknowns);
            self.base.moments_of(&self.moments, 0, &unknowns)
        })
    }

    fn electrode_count(&self) -> usize {
        self.model.mesh().electrodes.len()
    }

    /// The model of the skin.
    pub fn model(&self) -> &ForwardModel {
        &self.model
    }

    /// The moments.
    pub fn moments(&self) -> &PotentialMoments {
        &self.moments
    }

    /// The network of the skin at rest.
    ///
    /// # Errors
    /// A part of the skin without an electrode.
    pub fn resting_network(&self) -> Result<ElectrodeNetwork, ForwardError> {
        self.model.with_own_series(ElectrodeNetwork::new(self.base.factor.schur().clone())?)
    }

    /// Computes the Green's functions of all conductors now, on all threads, instead of when each is first touched.
    pub fn prepare(&self) {
        (0..self.columns.len()).into_par_iter().for_each(|conductor| {
            self.column(conductor);
        });
    }

    /// Keeps at most this many bytes of Green's functions from now on: beyond, those computed first are dropped and
    /// computed again when they are needed. The results are the same.
    pub fn limit_table(&mut self, most_bytes: usize) {
        self.columns.limit(most_bytes);
    }

    /// Memory of the stored Green's functions, and of all of them, bytes.
    pub fn table_bytes(&self) -> [usize; 2] {
        let whole = (0..self.columns.len()).map(|conductor| self.moments.range(conductor));
        let whole = whole.map(|own| (self.moments.count() - own.start) * own.len());
        [self.columns.bytes(), whole.sum::<usize>() * size_of::<f64>()]
    }

    /// The network with some conductors in contact, by the table of Green's functions; the others are at rest.
    ///
    /// # Errors
    /// A contact below that at rest.
    ///
    /// # Panics
    /// If a contact does not fit its conductor's moments, or a conductor occurs twice.
    pub fn network(&self, contacts: &[ConductorContact]) -> Result<ElectrodeNetwork, ForwardError> {
        let update = self.update(contacts)?;
        if update.rank == 0 {
            return self.resting_network();
        }
        let order = update.rank + update.floating_count + self.electrode_count();
        let mut front = vec![0.0; order * order];
        self.fill_from_table(&update, &mut front, order);
        self.complete(&update, &mut front, order);
        self.finish(&update, front, order)
    }

    /// The moments `C (M'u - v e)` of the current into each touched conductor, in addition to that at rest, for
    /// electrodes at the given potentials of the mesh's own network, V. Their product with the moments of 1 V, the
    /// second list, is the conductor's net current.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    ///
    /// # Panics
    /// As [`network`](Self::network).
    pub fn currents(
        &self,
        contacts: &[ConductorContact],
        potentials_v: &[f64],
    ) -> Result<Vec<[Vec<f64>; 2]>, ForwardError> {
        let update = self.update(contacts)?;
        let order = update.rank + update.floating_count + self.electrode_count();
        let mut front = vec![0.0; order * order];
        self.fill_from_table(&update, &mut front, order);
        self.complete(&update, &mut front, order);
        let rank = update.rank;
        let mut system = Matrix::zeros(rank, rank);
        for (row, column) in (0..rank).flat_map(|column| (column..rank).map(move |row| (row, column))) {
            *system.at_mut(row, column) = front[column * order + row];
            *system.at_mut(column, row) = front[column * order + row];
        }
        let factor = Cholesky::new(&system).map_err(name_contact)?;
        let below = |column: usize, first: usize, count: usize| &front[column * order + first..][..count];
        let mut driving: Vec<f64> =
            (0..rank).map(|k| dot(below(k, order - potentials_v.len(), potentials_v.len()), potentials_v)).collect();
        let conductors = update.floating_count;
        let joins: Vec<&[f64]> = (0..rank).map(|k| below(k, rank, conductors)).collect();
        let potentials = conductor_potentials(&factor, &joins, &driving)?;
        driving.iter_mut().zip(&joins).for_each(|(value, joined)| *value -= dot(joined, &potentials));
        let y = factor.solve(&driving);
        let of_touch = |touch: &Touch| {
            let own = &y[touch.start..touch.start + touch.root.columns];
            let current = (0..touch.root.rows).map(|k| dot(touch.root.row(k), own)).collect();
            [current, self.moments.conductors()[touch.conductor].of_one()]
        };
        Ok(update.touches.iter().map(of_touch).collect())
    }

    /// The contacts minus those at rest.
    fn update(&self, contacts: &[ConductorContact]) -> Result<Update, ForwardError> {
        let mut sorted: Vec<&ConductorContact> = contacts.iter().collect();
        sorted.sort_by_key(|contact| contact.conductor);
        assert!(sorted.windows(2).all(|pair| pair[0].conductor != pair[1].conductor), "each conductor once");
        let mut update = Update { touches: Vec::new(), rank: 0, floating_count: 0 };
        for contact in sorted {
            check_fits(&self.moments, contact);
            let added = match self.at_rest.get(&contact.conductor) {
                Some(resting) => difference(&contact.conductance, resting),
                None => contact.conductance.clone(),
            };
            let root = root(contact.conductor, &added, &contact.conductance)?;
            if root.columns > 0 {
                let floating = !self.base.unknown_of_conductor.contains_key(&contact.conductor);
                let start = update.rank;
                update.rank += root.columns;
                update.floating_count += usize::from(floating);
                update.touches.push(Touch { conductor: contact.conductor, root, start, floating });
            }
        }
        Ok(update)
    }

    /// Completes `[A; P' 0; Q' 0 0]`, column-major, its lower triangle, from `R' Gamma R`.
    fn complete(&self, update: &Update, front: &mut [f64], order: usize) {
        let (potentials, mut conductor) = (self.potentials(), update.rank);
        for touch in &update.touches {
            let range = self.moments.range(touch.conductor);
            let of_one = self.moments.conductors()[touch.conductor].of_one();
            for k in 0..touch.root.columns {
                let column = &mut front[(touch.start + k) * order..(touch.start + k + 1) * order];
                column[touch.start + k] += 1.0;
                for (moment, index) in range.clone().enumerate() {
                    let factor = touch.root.at(moment, k);
                    if touch.floating {
                        column[conductor] += factor * of_one[moment];
                    }
                    let target = &mut column[order - self.electrode_count()..];
                    target.iter_mut().zip(potentials.row(index)).for_each(|(sum, value)| *sum += factor * value);
                }
            }
            conductor += usize::from(touch.floating);
        }
    }

    /// Eliminates contacts, then conductors, and adds the remainder to the admittance.
    fn finish(&self, update: &Update, mut front: Vec<f64>, order: usize) -> Result<ElectrodeNetwork, ForwardError> {
        let (rank, conductors) = (update.rank, update.floating_count);
        eliminate_in_place(&mut front, order, rank).map_err(name_contact)?;
        // The remainder is `-[P Q]' A^-1 [P Q]`.
        let rest = order - rank;
        let mut schur = vec![0.0; rest * rest];
        for column in 0..rest {
            let source = &front[(rank + column) * order + rank..(rank + column + 1) * order];
            schur[column * rest..(column + 1) * rest].iter_mut().zip(source).for_each(|(s, value)| *s = -value);
        }
        eliminate_in_place(&mut schur, rest, conductors).map_err(name_contact)?;
        let mut admittance = self.base.factor.schur().clone();
        for column in 0..self.electrode_count() {
            for row in column..self.electrode_count() {
                let rise = schur[(conductors + column) * rest + conductors + row];
                *admittance.at_mut(row, column) += rise;
                if row != column {
                    *admittance.at_mut(column, row) += rise;
                }
            }
        }
        self.model.with_own_series(ElectrodeNetwork::new(admittance)?)
    }

    fn fill_from_table(&self, update: &Update, front: &mut [f64], order: usize) {
        for (index, touch) in update.touches.iter().enumerate() {
            let column = self.column(touch.conductor);
            let first = self.moments.range(touch.conductor).start;
            let (rank, mut product) = (touch.root.columns, Vec::new());
            for later in &update.touches[index..] {
                // `Gamma R` of this conductor at the other's moments, then `R'` of the other.
                let rows = self.moments.range(later.conductor);
                product.clear();
                product.resize(rows.len() * rank, 0.0);
                for (target, row) in product.chunks_exact_mut(rank).zip(rows) {
                    for (&green, factors) in column.row(row - first).iter().zip(touch.root.values.chunks_exact(rank)) {
                        target.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += green * factor);
                    }
                }
                for (source, factors) in
                    product.chunks_exact(rank).zip(later.root.values.chunks_exact(later.root.columns))
                {
                    for (k, value) in source.iter().enumerate() {
                        let target = &mut front[(touch.start + k) * order + later.start..][..later.root.columns];
                        target.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += value * factor);
                    }
                }
            }
        }
    }

    /// The Green's functions of a conductor.
    fn column(&self, conductor: usize) -> Arc<Matrix> {
        self.columns.column(conductor, || {
            let symbolic = self.base.symbolic(&self.model);
            let Voltages { unknowns, weights } = self.base.voltages(&self.moments, conductor);
            let mut fields = Matrix::zeros(symbolic.unknown_count(), weights.columns);
            for (row, &unknown) in unknowns.iter().enumerate() {
                fields.row_mut(unknown).iter_mut().zip(weights.row(row)).for_each(|(sum, weight)| *sum += weight);
            }
            self.base.factor.solve_grounded(symbolic, &mut fields);
            self.base.moments_of(&self.moments, conductor, &fields)
        })
    }
}

/// `R` with `R R' = C`, moments x rank, by Cholesky with the largest pivot first: it ends when the remainder is
/// negligible relative to the whole contact, of which `C` may be a part.
fn root(conductor: usize, conductance: &Matrix, whole: &Matrix) -> Result<Matrix, ForwardError> {
    let order = conductance.rows;
    let mut left = conductance.clone();
    let largest = (0..order).map(|k| whole.at(k, k).abs()).fold(0.0, f64::max);
    let mut columns: Vec<Vec<f64>> = Vec::new();
    while columns.len() < order {
        let pivot = (0..order).max_by(|&a, &b| left.at(a, a).total_cmp(&left.at(b, b))).expect("order is positive");
        let value = left.at(pivot, pivot);
        // NaN is the largest in the total order, and all comparisons with it are false.
        if !value.is_finite() || (0..order).any(|k| left.at(k, k) < -LOSS_TOLERANCE * largest) {
            return Err(ForwardError::ConductorContact { conductor, value: left.at(pivot, pivot) });
        }
        if value <= RANK_TOLERANCE * largest {
            break;
        }
        let column: Vec<f64> = (0..order).map(|k| left.at(k, pivot) / value.sqrt()).collect();
        // Contacts described by sites are diagonal: most of a column is zero.
        let own: Vec<usize> = (0..order).filter(|&k| column[k] != 0.0).collect();
        for (i, j) in own.iter().flat_map(|&i| own.iter().map(move |&j| (i, j))) {
            *left.at_mut(i, j) -= column[i] * column[j];
        }
        columns.push(column);
    }
    let mut root = Matrix::zeros(order, columns.len());
    for (index, column) in columns.iter().enumerate() {
        (0..order).for_each(|k| *root.at_mut(k, index) = column[k]);
    }
    Ok(root)
}

/// `v` with `P' A^-1 P v = P' A^-1 Q U`: the potentials at which the net current of every conductor is zero.
fn conductor_potentials(factor: &Cholesky, joins: &[&[f64]], driving: &[f64]) -> Result<Vec<f64>, ForwardError> {
    let conductors = joins.first().map_or(0, |joined| joined.len());
    let column = |k: usize| joins.iter().map(|joined| joined[k]).collect::<Vec<f64>>();
    let columns: Vec<Vec<f64>> = (0..conductors).map(column).collect();
    let (mut net, free) = (Matrix::zeros(conductors, conductors), factor.solve(driving));
    for (k, own) in columns.iter().enumerate() {
        let solved = factor.solve(own);
        net.row_mut(k).iter_mut().zip(&columns).for_each(|(value, other)| *value = dot(&solved, other));
    }
    let free: Vec<f64> = columns.iter().map(|own| dot(own, &free)).collect();
    Ok(Cholesky::new(&net).map_err(name_contact)?.solve(&free))
}

fn difference(a: &Matrix, b: &Matrix) -> Matrix {
    let values = a.values.iter().zip(&b.values).map(|(a, b)| a - b).collect();
    Matrix { rows: a.rows, columns: a.columns, values }
}

fn name_contact(error: NotPositiveDefinite) -> ForwardError {
    ForwardError::Singular { place: format!("unknown {} of the touched conductors", error.unknown) }
}

fn check_fits(moments: &PotentialMoments, contact: &ConductorContact) {
    let order = moments.range(contact.conductor).len();
    assert!(order > 0, "conductor {} has moments", contact.conductor);
    assert_eq!([contact.conductance.rows, contact.conductance.columns], [order; 2], "a value per pair of moments");
}
