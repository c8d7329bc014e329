//! Contacts of a skin that is touched only a few times, without a table of Green's functions.
//!
//! With the potential of its conductor eliminated, a contact adds `u' M D M' u` to the power,
//! `D = C - C e e' C / (e' C e)`. Contacts that have nodes in common are one addition `U U'`, `U` from a Cholesky
//! factorisation with pivots. Its rank is at most the number of the touched nodes, which is less than that of the moments
//! where conductors are not much larger than cells.

use super::system::Voltages;
use super::{ConductorContact, FloatingConductors, check_fits, difference, dot, name_contact, root};
use crate::forward::{ElectrodeNetwork, ForwardError};
use crate::frame::Frame;
use crate::linalg::{
    BadLanes, LANES, Matrix, SparseColumns, Symbolic, UpdateMemory, pseudo_inverses, semidefinite_root,
};
use std::sync::PoisonError;

/// Work memory of [`FloatingConductors::frames_once`], for any number of skins one after the other.
#[derive(Debug, Default)]
pub struct OnceMemory(UpdateMemory);

impl FloatingConductors {
    /// [`network`](Self::network) without a table, by a forward substitution for the touched conductors: for a skin
    /// that is touched only a few times.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    ///
    /// # Panics
    /// As [`network`](Self::network).
    pub fn network_once(&self, contacts: &[ConductorContact]) -> Result<ElectrodeNetwork, ForwardError> {
        let idle = self.memories.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut memory = idle.unwrap_or_default();
        let admittance = self.admittance_once(contacts, &mut memory);
        self.memories.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
        self.model.with_own_series(ElectrodeNetwork::new(admittance?)?)
    }

    /// The frames of [`network_once`](Self::network_once) for some lists of contacts, eight of them at once.
    ///
    /// # Errors
    /// As [`network`](Self::network).
    ///
    /// # Panics
    /// As [`network`](Self::network).
    pub fn frames_once(
        &self,
        lists: &[Vec<ConductorContact>],
        memory: &mut OnceMemory,
    ) -> Result<Vec<Frame>, ForwardError> {
        let mut frames = Vec::with_capacity(lists.len());
        let mut lanes = vec![[0.0; LANES]; self.model.protocol().channel_count()];
        for lists in lists.chunks(LANES) {
            let admittance = |contacts: &Vec<ConductorContact>| self.admittance_once(contacts, &mut memory.0);
            let admittances = lists.iter().map(admittance).collect::<Result<Vec<Matrix>, ForwardError>>()?;
            let mut impedances = pseudo_inverses(&admittances).map_err(|bad| name_singular(&admittances, bad))?;
            self.model.read_frames(&mut impedances, &mut lanes);
            frames.extend((0..lists.len()).map(|lane| Frame(lanes.iter().map(|values| values[lane]).collect())));
        }
        Ok(frames)
    }

    /// The admittance between the electrodes of the mesh's own network.
    fn admittance_once(
        &self,
        contacts: &[ConductorContact],
        memory: &mut UpdateMemory,
    ) -> Result<Matrix, ForwardError> {
        let symbolic = self.base.symbolic(&self.model);
        let forms = contacts.iter().map(|contact| self.form(contact)).collect::<Vec<Form>>();
        let additions = joined(&forms, symbolic)
            .into_iter()
            .map(|form| match semidefinite_root(&form.values, form.scale) {
                Some(root) => Ok(SparseColumns { unknowns: form.unknowns, values: root }),
                None => Err(self.refusal(contacts)),
            })
            .filter(|addition| !matches!(addition, Ok(addition) if addition.values.columns == 0))
            .collect::<Result<Vec<SparseColumns>, ForwardError>>()?;
        self.base.factor.schur_with(symbolic, &additions, memory).map_err(name_contact)
    }

    /// The quadratic form that a contact adds to that at rest.
    fn form(&self, contact: &ConductorContact) -> Form {
        check_fits(&self.moments, contact);
        let Voltages { unknowns, weights } = self.base.voltages(&self.moments, contact.conductor);
        let mut added = match self.at_rest.get(&contact.conductor) {
            Some(resting) => difference(&contact.conductance, resting),
            None => contact.conductance.clone(),
        };
        if !self.base.unknown_of_conductor.contains_key(&contact.conductor) {
            let ones = self.moments.conductors()[contact.conductor].of_one();
            let currents: Vec<f64> = (0..added.rows).map(|k| dot(added.row(k), &ones)).collect();
            let whole = dot(&currents, &ones);
            for (k, current) in currents.iter().enumerate().filter(|_| whole != 0.0) {
                let factor = current / whole;
                added.row_mut(k).iter_mut().zip(&currents).for_each(|(value, other)| *value -= factor * other);
            }
        }
        // The contact is rounded, of which the form may be a small part.
        let [whole, part] = [largest(&contact.conductance), largest(&added)];
        let order = weights.columns;
        let mut values = Matrix::zeros(unknowns.len(), unknowns.len());
        let mut product = vec![0.0; order];
        for (row, weights_of_row) in weights.values.chunks_exact(order).enumerate() {
            product.fill(0.0);
            for (weight, row) in weights_of_row.iter().zip(added.values.chunks_exact(order)) {
                product.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
            }
            for (column, other) in weights.values.chunks_exact(order).take(row + 1).enumerate() {
                let value = dot(&product, other);
                *values.at_mut(row, column) = value;
                *values.at_mut(column, row) = value;
            }
        }
        let scale = if part > 0.0 { largest(&values) * (whole / part) } else { 0.0 };
        Form { unknowns, values, scale }
    }

    /// The error of the first contact that is below that at rest or not finite.
    fn refusal(&self, contacts: &[ConductorContact]) -> ForwardError {
        let wrong = |contact: &ConductorContact| {
            let added = match self.at_rest.get(&contact.conductor) {
                Some(resting) => difference(&contact.conductance, resting),
                None => contact.conductance.clone(),
            };
            root(contact.conductor, &added, &contact.conductance).err()
        };
        contacts.iter().find_map(wrong).unwrap_or_else(|| ForwardError::Singular {
            place: "the touched conductors, whose contacts are of too different magnitude".into(),
        })
    }
}

/// The error of the first matrix that has no pseudo-inverse.
fn name_singular(admittances: &[Matrix], bad: BadLanes) -> ForwardError {
    let first = admittances.iter().zip(bad.0).find(|(_, bad)| *bad).map(|(admittance, _)| admittance.clone());
    let error = first.and_then(|admittance| ElectrodeNetwork::new(admittance).err());
    error.unwrap_or_else(|| ForwardError::Singular { place: "the electrodes".into() })
}

/// A quadratic form on some unknowns.
struct Form {
    unknowns: Vec<usize>,
    values: Matrix,
    /// The size of the numbers that it is a difference of.
    scale: f64,
}

/// The largest value of a diagonal.
fn largest(matrix: &Matrix) -> f64 {
    (0..matrix.rows).map(|k| matrix.at(k, k).abs()).fold(0.0, f64::max)
}

impl Form {
    /// The sum of some forms, its unknowns in the order of elimination.
    fn sum(forms: &[&Form], symbolic: &Symbolic, place: &mut [usize]) -> Form {
        let mut unknowns: Vec<usize> = Vec::new();
        for &unknown in forms.iter().flat_map(|form| &form.unknowns) {
            // The places of other sums are not in this list, or hold another unknown.
            if unknowns.get(place[unknown]) != Some(&unknown) {
                place[unknown] = unknowns.len();
                unknowns.push(unknown);
            }
        }
        unknowns.sort_unstable_by_key(|&unknown| symbolic.place(unknown));
        unknowns.iter().enumerate().for_each(|(index, &unknown)| place[unknown] = index);
        let mut values = Matrix::zeros(unknowns.len(), unknowns.len());
        for form in forms {
            for (row, unknown) in form.unknowns.iter().enumerate() {
                let target = values.row_mut(place[*unknown]);
                for (column, value) in form.unknowns.iter().zip(form.values.row(row)) {
                    target[place[*column]] += value;
                }
            }
        }
        Form { unknowns, values, scale: forms.iter().map(|form| form.scale).fold(0.0, f64::max) }
    }
}

/// The sums of those forms that have unknowns in common, directly or by others between them.
fn joined(forms: &[Form], symbolic: &Symbolic) -> Vec<Form> {
    // The group of each form, and the last form of each unknown.
    let mut groups: Vec<usize> = (0..forms.len()).collect();
    let mut form_of = vec![usize::MAX; symbolic.unknown_count()];
    for (index, form) in forms.iter().enumerate() {
        for &unknown in &form.unknowns {
            if let Some(&other) = groups.get(form_of[unknown])
                && other != groups[index]
            {
                let own = groups[index];
                groups.iter_mut().filter(|group| **group == own).for_each(|group| *group = other);
            }
            form_of[unknown] = index;
        }
    }
    let mut place = form_of;
    let of_group =
        |group: usize| forms.iter().zip(&groups).filter(move |(_, own)| **own == group).map(|(form, _)| form);
    (0..forms.len())
        .map(|group| of_group(group).collect::<Vec<&Form>>())
        .filter(|members| !members.is_empty())
        .map(|members| Form::sum(&members, symbolic, &mut place))
        .collect()
}
