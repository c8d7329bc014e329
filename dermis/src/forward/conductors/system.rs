//! The system of a sheet with some conductors in contact.

use super::{ConductorContact, PotentialMoment, PotentialMoments, check_fits, dot, root};
use crate::forward::assembly::Assembly;
use crate::forward::model::check_conductivity;
use crate::forward::{ForwardError, ForwardModel};
use crate::linalg::{Factor, Matrix, NotPositiveDefinite, Symbolic};
use std::collections::BTreeMap;

/// The system of a sheet with some conductors in contact, factored.
#[derive(Debug)]
pub(super) struct System {
    /// `None` if it is the model's own system.
    extended: Option<Symbolic>,
    pub factor: Factor,
    /// The unknown of each node.
    unknown_of_node: Vec<usize>,
    /// The unknown of each conductor that is part of the system.
    pub unknown_of_conductor: BTreeMap<usize, usize>,
}

impl System {
    pub(super) fn new(
        model: &ForwardModel,
        conductivity: &[f64],
        moments: &PotentialMoments,
        contacts: &[ConductorContact],
    ) -> Result<Self, ForwardError> {
        check_conductivity(model.mesh(), conductivity)?;
        let mut touching = Vec::new();
        for contact in contacts {
            check_fits(moments, contact);
            if root(contact.conductor, &contact.conductance, &contact.conductance)?.columns > 0 {
                touching.push(contact);
            }
        }
        let assembly = model.assembly();
        let mut values = vec![0.0; assembly.pattern.entries.len()];
        assembly.values_into(conductivity, &mut values);
        let singular = |error: NotPositiveDefinite| ForwardError::Singular {
            place: format!("unknown {} of the skin under its conductors", error.unknown),
        };
        if touching.is_empty() {
            let factor = model.symbolic().factor(&values).map_err(singular)?;
            let unknown_of_node = model.unknown_of_node().to_vec();
            return Ok(System { extended: None, factor, unknown_of_node, unknown_of_conductor: BTreeMap::new() });
        }
        let mut system = Extended::new(model, assembly, &values, &touching);
        touching.iter().for_each(|contact| system.add(moments.of_conductor(contact.conductor), contact));
        let (entries, values): (Vec<[usize; 2]>, Vec<f64>) = system.entries.into_iter().unzip();
        let symbolic = Symbolic::new(system.unknown_count, model.mesh().electrodes.len(), &entries);
        let factor = symbolic.factor(&values).map_err(singular)?;
        Ok(System {
            extended: Some(symbolic),
            factor,
            unknown_of_node: system.unknown_of_node,
            unknown_of_conductor: system.unknown_of_conductor,
        })
    }

    pub(super) fn symbolic<'a>(&'a self, model: &'a ForwardModel) -> &'a Symbolic {
        self.extended.as_ref().unwrap_or(model.symbolic())
    }

    /// The unknowns of a moment of `u - v` with their weights; of `u` only if the system has no `v`.
    pub(super) fn voltage(&self, moment: &PotentialMoment) -> impl Iterator<Item = (usize, f64)> {
        let nodes = moment.nodes.iter().map(|&(node, weight)| (self.unknown_of_node[node], weight));
        let own = self.unknown_of_conductor.get(&moment.conductor);
        nodes.chain(own.map(|&unknown| (unknown, -moment.of_one())))
    }
}

/// The entries of a system while conductors are added.
struct Extended {
    unknown_of_node: Vec<usize>,
    unknown_of_conductor: BTreeMap<usize, usize>,
    unknown_count: usize,
    entries: BTreeMap<[usize; 2], f64>,
}

impl Extended {
    /// The sheet's own entries, with space for the conductors between its interior and the electrodes.
    fn new(model: &ForwardModel, assembly: &Assembly, values: &[f64], contacts: &[&ConductorContact]) -> Self {
        let interior = assembly.pattern.unknown_count - model.mesh().electrodes.len();
        let mut touched: Vec<usize> = contacts.iter().map(|contact| contact.conductor).collect();
        touched.sort_unstable();
        touched.dedup();
        let shift = |unknown: usize| if unknown < interior { unknown } else { unknown + touched.len() };
        let sheet = assembly.pattern.entries.iter().map(|pair| pair.map(shift)).zip(values.iter().copied());
        let mut entries: BTreeMap<[usize; 2], f64> = sheet.collect();
        let unknown_of_conductor: BTreeMap<usize, usize> = touched.iter().copied().zip(interior..).collect();
        entries.extend(unknown_of_conductor.values().map(|&unknown| ([unknown, unknown], 0.0)));
        Extended {
            unknown_of_node: model.unknown_of_node().iter().map(|&unknown| shift(unknown)).collect(),
            unknown_count: assembly.pattern.unknown_count + touched.len(),
            unknown_of_conductor,
            entries,
        }
    }

    /// Adds `(M'u - v e)' C (M'u - v e)` of one contact.
    fn add(&mut self, moments: &[PotentialMoment], contact: &ConductorContact) {
        // `W C W'` by the unknowns that the moments share: `W` has a row per unknown.
        let mut weights: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        let conductor = self.unknown_of_conductor[&contact.conductor];
        for (k, moment) in moments.iter().enumerate() {
            let nodes = moment.nodes.iter().map(|&(node, weight)| (self.unknown_of_node[node], weight));
            for (unknown, weight) in nodes.chain([(conductor, -moment.of_one())]) {
                weights.entry(unknown).or_insert_with(|| vec![0.0; moments.len()])[k] += weight;
            }
        }
        let rows: Vec<(usize, Vec<f64>)> = weights.into_iter().collect();
        let mut product = vec![0.0; moments.len()];
        for (index, (a, first)) in rows.iter().enumerate() {
            contact.conductance.product_into(first, &mut product);
            for (b, second) in &rows[..=index] {
                *self.entries.entry([*a, *b]).or_default() += dot(second, &product);
            }
        }
    }
}

impl System {
    /// The moments of some fields, moments x fields, from their values at the unknowns.
    pub(super) fn moments_of(&self, moments: &[PotentialMoment], fields: &Matrix) -> Matrix {
        let mut out = Matrix::zeros(moments.len(), fields.columns);
        for (index, moment) in moments.iter().enumerate() {
            let target = out.row_mut(index);
            for (unknown, weight) in self.voltage(moment) {
                target.iter_mut().zip(fields.row(unknown)).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        out
    }
}
