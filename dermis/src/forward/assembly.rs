//! Assembly of the system matrix from conductivities, with a plan that is computed once.

use super::ForwardError;
use crate::fem::{Gradients, mass};
use crate::geom::vector::{distance, triangle_area};
use crate::mesh::{ElectrodePatch, Mesh};
use std::sync::Arc;

/// A node that is not an interior unknown of the system.
const UNSET: usize = usize::MAX;

/// The system's pattern, and each entry as `fixed + sum of coefficient * conductivity[cell]`.
#[derive(Debug, Clone)]
pub(super) struct Assembly {
    pub pattern: Arc<Pattern>,
    fixed: Vec<f64>,
    /// One for each of the pattern's terms.
    coefficients: Vec<f64>,
}

/// The part that depends on the nodes of the cells and electrodes, but not on their positions.
#[derive(Debug)]
pub(super) struct Pattern {
    /// Unknown of each node: the interior ones first, then one per electrode; a point electrode is its node.
    pub unknown_of_node: Vec<usize>,
    pub unknown_count: usize,
    pub entries: Vec<[usize; 2]>,
    /// Where each entry's terms start.
    starts: Vec<usize>,
    /// The cell of each term.
    cells: Vec<usize>,
    /// The term of each pair of corners of each cell, in the order of [`for_each_pair`].
    term_of_stiffness: Vec<usize>,
    /// The entry of each part of a contact, in the order of [`for_each_contact`].
    entry_of_contact: Vec<usize>,
}

impl Pattern {
    fn new(mesh: &Mesh) -> Result<Self, ForwardError> {
        let (unknown_of_node, unknown_count) = number_unknowns(mesh)?;
        let (mut stiffness, mut contacts) = (Vec::new(), Vec::new());
        for_each_pair(mesh, |cell, [i, j]| {
            let corners = mesh.cells.corners(cell);
            stiffness.push((ordered(unknown_of_node[corners[i]], unknown_of_node[corners[j]]), cell));
        });
        let unknown = |end| match end {
            End::Node(node) => unknown_of_node[node],
            End::Electrode(electrode) => unknown_count - mesh.electrodes.len() + electrode,
        };
        let ones = vec![1.0; mesh.electrodes.len()];
        for_each_contact(mesh, &ones, |_, _, [a, b], _| contacts.push(ordered(unknown(a), unknown(b))));

        let diagonal = (0..unknown_count).map(|unknown| [unknown, unknown]);
        let pairs = stiffness.iter().map(|(pair, _)| *pair).chain(contacts.iter().copied()).chain(diagonal);
        let mut entries: Vec<[usize; 2]> = pairs.collect();
        entries.sort_unstable();
        entries.dedup();
        let entry = |pair| entries.binary_search(pair).expect("every pair was collected");
        let entry_of_stiffness: Vec<usize> = stiffness.iter().map(|(pair, _)| entry(pair)).collect();
        let entry_of_contact = contacts.iter().map(entry).collect();

        let mut starts = vec![0; entries.len() + 1];
        entry_of_stiffness.iter().for_each(|&entry| starts[entry + 1] += 1);
        (0..entries.len()).for_each(|entry| starts[entry + 1] += starts[entry]);
        let (mut next, mut cells) = (starts.clone(), vec![0; stiffness.len()]);
        let mut place = |(entry, (_, cell)): (&usize, &([usize; 2], usize))| {
            let term = next[*entry];
            next[*entry] += 1;
            cells[term] = *cell;
            term
        };
        let term_of_stiffness = entry_of_stiffness.iter().zip(&stiffness).map(&mut place).collect();
        Ok(Pattern { unknown_of_node, unknown_count, entries, starts, cells, term_of_stiffness, entry_of_contact })
    }
}

impl Assembly {
    pub(super) fn new(mesh: &Mesh, contact_impedances: &[f64]) -> Result<Self, ForwardError> {
        let pattern = Arc::new(Pattern::new(mesh)?);
        let coefficients = vec![0.0; pattern.cells.len()];
        let fixed = fixed(&pattern, mesh, contact_impedances);
        let mut assembly = Assembly { pattern, fixed, coefficients };
        assembly.set_stiffness(mesh, |_| true);
        Ok(assembly)
    }

    /// The same cells and electrodes with nodes at other positions, and other contacts; `before` is the mesh of this one.
    pub(super) fn moved(&self, before: &Mesh, mesh: &Mesh, contact_impedances: &[f64]) -> Self {
        let fixed = fixed(&self.pattern, mesh, contact_impedances);
        let mut assembly = Assembly { fixed, ..self.clone() };
        let has_moved: Vec<bool> = before.nodes.iter().zip(&mesh.nodes).map(|(before, now)| before != now).collect();
        assembly.set_stiffness(mesh, |cell| mesh.cells.corners(cell).iter().any(|&node| has_moved[node]));
        assembly
    }

    /// Computes the coefficients of some cells.
    fn set_stiffness(&mut self, mesh: &Mesh, is_wanted: impl Fn(usize) -> bool) {
        let mut terms = &self.pattern.term_of_stiffness[..];
        for cell in 0..mesh.cell_count() {
            let count = mesh.cells.corners(cell).len();
            let (own, others) = terms.split_at(count * (count + 1) / 2);
            terms = others;
            if is_wanted(cell) {
                let gradients = Gradients::new(mesh, cell);
                let pairs = (0..count).flat_map(|i| (0..=i).map(move |j| (i, j)));
                own.iter().zip(pairs).for_each(|(&term, (i, j))| self.coefficients[term] = gradients.stiffness(i, j));
            }
        }
    }

    /// An entry's constant part, and cells with their coefficients.
    pub(super) fn entry(&self, index: usize) -> (f64, impl Iterator<Item = (usize, f64)>) {
        let terms = self.pattern.starts[index]..self.pattern.starts[index + 1];
        let cells = self.pattern.cells[terms.clone()].iter().copied();
        (self.fixed[index], cells.zip(self.coefficients[terms].iter().copied()))
    }

    /// Calls the closure for every pair of corners of every cell, with the index of their entry.
    pub(super) fn for_each_stiffness(&self, mesh: &Mesh, mut callback: impl FnMut(usize, [usize; 2], usize)) {
        let starts = &self.pattern.starts;
        let mut terms = self.pattern.term_of_stiffness.iter();
        for_each_pair(mesh, |cell, pair| {
            let term = terms.next().expect("a term for each pair of corners");
            callback(cell, pair, starts.partition_point(|start| start <= term) - 1);
        });
    }

    /// Calls the closure for every part of every electrode's contact: the electrode, the simplex of its patch, and the
    /// index of the entry with the value of the part.
    pub(super) fn for_each_contact_part(
        &self,
        mesh: &Mesh,
        contact_impedances: &[f64],
        mut callback: impl FnMut(usize, &[usize], usize, f64),
    ) {
        let mut entries = self.pattern.entry_of_contact.iter();
        for_each_contact(mesh, contact_impedances, |electrode, corners, _, value| {
            callback(electrode, corners, *entries.next().expect("an entry for each part of a contact"), value);
        });
    }

    /// The entries' values at a conductivity per cell.
    pub(super) fn values_into(&self, conductivity: &[f64], values: &mut [f64]) {
        for (index, value) in values.iter_mut().enumerate() {
            let (fixed, terms) = self.entry(index);
            *value = fixed + terms.map(|(cell, coefficient)| coefficient * conductivity[cell]).sum::<f64>();
        }
    }
}

/// The parts of the entries that do not depend on the conductivity.
fn fixed(pattern: &Pattern, mesh: &Mesh, contact_impedances: &[f64]) -> Vec<f64> {
    let mut fixed = vec![0.0; pattern.entries.len()];
    let mut entries = pattern.entry_of_contact.iter();
    for_each_contact(mesh, contact_impedances, |_, _, _, value| {
        fixed[*entries.next().expect("an entry for each part of a contact")] += value;
    });
    fixed
}

/// Calls the closure for every pair of corners of every cell, each once.
fn for_each_pair(mesh: &Mesh, mut callback: impl FnMut(usize, [usize; 2])) {
    for cell in 0..mesh.cell_count() {
        for i in 0..mesh.cells.corners(cell).len() {
            for j in 0..=i {
                callback(cell, [i, j]);
            }
        }
    }
}

fn ordered(i: usize, j: usize) -> [usize; 2] {
    [i.max(j), i.min(j)]
}

fn number_unknowns(mesh: &Mesh) -> Result<(Vec<usize>, usize), ForwardError> {
    let mut electrode_at = vec![UNSET; mesh.node_count()];
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        if let ElectrodePatch::Node(node) = *patch {
            if electrode_at[node] != UNSET {
                return Err(ForwardError::SharedNode { first: electrode_at[node], second: electrode, node });
            }
            electrode_at[node] = electrode;
        }
    }
    let interior = electrode_at.iter().filter(|&&electrode| electrode == UNSET).count();
    let mut next = 0;
    let unknown_of_node = electrode_at
        .iter()
        .map(|&electrode| {
            if electrode != UNSET {
                return interior + electrode;
            }
            next += 1;
            next - 1
        })
        .collect();
    Ok((unknown_of_node, interior + mesh.electrodes.len()))
}

/// The simplices of a patch: their corners and measures. A point has none.
pub(super) fn patch_parts(mesh: &Mesh, patch: &ElectrodePatch) -> Vec<(Vec<usize>, f64)> {
    match patch {
        ElectrodePatch::Cells(cells) => {
            cells.iter().map(|&cell| (mesh.cells.corners(cell).to_vec(), mesh.cell_measure(cell))).collect()
        }
        ElectrodePatch::Edges(edges) => {
            edges.iter().map(|edge| (edge.to_vec(), distance(mesh.nodes[edge[0]], mesh.nodes[edge[1]]))).collect()
        }
        ElectrodePatch::Faces(faces) => {
            faces.iter().map(|face| (face.to_vec(), triangle_area(face.map(|node| mesh.nodes[node])))).collect()
        }
        ElectrodePatch::Node(_) => Vec::new(),
    }
}

/// The unknowns that a part of a contact connects.
#[derive(Clone, Copy)]
enum End {
    Node(usize),
    Electrode(usize),
}

/// Calls the closure for every part of `integral of (u - U)^2 / z` over every electrode's patch: the electrode, the
/// corners of the simplex, the unknowns, and the value.
fn for_each_contact(mesh: &Mesh, contact_impedances: &[f64], mut callback: impl FnMut(usize, &[usize], [End; 2], f64)) {
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        let (own, admittance) = (End::Electrode(electrode), 1.0 / contact_impedances[electrode]);
        for (corners, measure) in patch_parts(mesh, patch) {
            let count = corners.len();
            for i in 0..count {
                for j in 0..=i {
                    let value = admittance * mass(count, measure, i, j);
                    callback(electrode, &corners, [End::Node(corners[i]), End::Node(corners[j])], value);
                }
                callback(electrode, &corners, [own, End::Node(corners[i])], -admittance * measure / count as f64);
            }
            callback(electrode, &corners, [own, own], admittance * measure);
        }
    }
}
