//! The system of a sheet with some conductors in contact.

use super::{ConductorContact, PotentialMoments, check_fits, dot, root};
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
        touching.iter().for_each(|contact| system.add(moments, contact));
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

    /// The moments of `u - v` of a conductor; of `u` only if the system has no `v`.
    pub(super) fn voltages(&self, moments: &PotentialMoments, conductor: usize) -> Voltages {
        let own = self.unknown_of_conductor.get(&conductor).copied();
        Voltages::new(moments, conductor, &self.unknown_of_node, own)
    }
}

/// The moments of `u - v` of a conductor as weighted sums of unknowns.
pub(super) struct Voltages {
    /// The unknowns of its nodes and, if there is one, of its potential.
    pub unknowns: Vec<usize>,
    /// Unknowns x moments.
    pub weights: Matrix,
}

impl Voltages {
    fn new(moments: &PotentialMoments, conductor: usize, unknown_of_node: &[usize], own: Option<usize>) -> Self {
        let moments = &moments.conductors()[conductor];
        let mut unknowns: Vec<usize> = moments.nodes.iter().map(|&node| unknown_of_node[node]).collect();
        let mut weights = moments.weights.clone();
        if let Some(own) = own {
            unknowns.push(own);
            weights.rows += 1;
            weights.values.extend(moments.of_one().into_iter().map(|moment| -moment));
        }
        Voltages { unknowns, weights }
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
    fn add(&mut self, moments: &PotentialMoments, contact: &ConductorContact) {
        let own = self.unknown_of_conductor[&contact.conductor];
        let Voltages { unknowns, weights } =
            Voltages::new(moments, contact.conductor, &self.unknown_of_node, Some(own));
        // `W C W'`, its lower triangle by the unknowns.
        let mut product = vec![0.0; weights.columns];
        for (row, &a) in unknowns.iter().enumerate() {
            contact.conductance.product_into(weights.row(row), &mut product);
            for (column, &b) in unknowns.iter().enumerate().filter(|(_, b)| **b <= a) {
                *self.entries.entry([a, b]).or_default() += dot(weights.row(column), &product);
            }
        }
    }
}

impl System {
    /// The moments of some fields of the conductors from `first` on, moments x fields, from their values at the unknowns.
    pub(super) fn moments_of(&self, moments: &PotentialMoments, first: usize, fields: &Matrix) -> Matrix {
        let before = moments.range(first).start;
        let mut out = Matrix::zeros(moments.count() - before, fields.columns);
        for conductor in first..moments.conductors().len() {
            let range = moments.range(conductor);
            let Voltages { unknowns, weights } = self.voltages(moments, conductor);
            for (row, &unknown) in unknowns.iter().enumerate() {
                for (moment, &weight) in range.clone().zip(weights.row(row)) {
                    let target = out.row_mut(moment - before);
                    target.iter_mut().zip(fields.row(unknown)).for_each(|(sum, value)| *sum += weight * value);
                }
            }
        }
        out
    }
}
