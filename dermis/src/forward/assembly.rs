//! From conductivities to the entries of the system: the plan computed once.

use super::ForwardError;
use crate::fem::{Gradients, mass};
use crate::geom::vector::{distance, triangle_area};
use crate::mesh::{ElectrodePatch, Mesh};
use std::collections::BTreeMap;

/// One entry while it is gathered: its fixed part, and cells with their coefficients.
type Entry = (f64, Vec<(usize, f64)>);

/// Not a node of the system's interior.
const UNSET: usize = usize::MAX;

/// The system's pattern, and each entry as `fixed + sum of coefficient * conductivity[cell]`.
#[derive(Debug, Clone)]
pub(super) struct Assembly {
    /// Unknown of each node: the interior ones first, then one per electrode; a point electrode is its node.
    pub unknown_of_node: Vec<usize>,
    pub unknown_count: usize,
    pub entries: Vec<[usize; 2]>,
    fixed: Vec<f64>,
    /// Where each entry's terms start.
    starts: Vec<usize>,
    terms: Vec<(usize, f64)>,
}

impl Assembly {
    pub fn new(mesh: &Mesh, contact_impedances: &[f64]) -> Result<Self, ForwardError> {
        let (unknown_of_node, unknown_count) = number_unknowns(mesh)?;
        let mut entries: BTreeMap<[usize; 2], Entry> = BTreeMap::new();
        for unknown in 0..unknown_count {
            entries.insert([unknown, unknown], (0.0, Vec::new()));
        }
        for cell in 0..mesh.cell_count() {
            let gradients = Gradients::new(mesh, cell);
            let corners = mesh.cells.corners(cell);
            for i in 0..corners.len() {
                for j in 0..=i {
                    let pair = ordered(unknown_of_node[corners[i]], unknown_of_node[corners[j]]);
                    entries.entry(pair).or_default().1.push((cell, gradients.stiffness(i, j)));
                }
            }
        }
        let first_electrode = unknown_count - mesh.electrodes.len();
        for (electrode, patch) in mesh.electrodes.iter().enumerate() {
            let admittance = 1.0 / contact_impedances[electrode];
            for (corners, measure) in patch_parts(mesh, patch) {
                add_contact(&mut entries, &unknown_of_node, first_electrode + electrode, &corners, measure, admittance);
            }
        }
        Ok(Self::from_map(unknown_of_node, unknown_count, entries))
    }

    fn from_map(unknown_of_node: Vec<usize>, unknown_count: usize, map: BTreeMap<[usize; 2], Entry>) -> Self {
        let (mut entries, mut fixed, mut starts, mut terms) = (Vec::new(), Vec::new(), vec![0], Vec::new());
        for (entry, (constant, list)) in map {
            entries.push(entry);
            fixed.push(constant);
            terms.extend(list);
            starts.push(terms.len());
        }
        Assembly { unknown_of_node, unknown_count, entries, fixed, starts, terms }
    }

    /// An entry's fixed part, and cells with their coefficients.
    pub fn entry(&self, index: usize) -> (f64, &[(usize, f64)]) {
        (self.fixed[index], &self.terms[self.starts[index]..self.starts[index + 1]])
    }

    /// The entries' values at a conductivity per cell.
    pub fn values_into(&self, conductivity: &[f64], values: &mut [f64]) {
        for (index, value) in values.iter_mut().enumerate() {
            let (fixed, terms) = self.entry(index);
            *value = fixed + terms.iter().map(|&(cell, c)| c * conductivity[cell]).sum::<f64>();
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

/// Adds `integral of (u - U)^2 / z` over one simplex of a patch.
fn add_contact(
    entries: &mut BTreeMap<[usize; 2], Entry>,
    unknown_of_node: &[usize],
    electrode: usize,
    corners: &[usize],
    measure: f64,
    admittance: f64,
) {
    let count = corners.len();
    for i in 0..count {
        let unknown = unknown_of_node[corners[i]];
        for j in 0..=i {
            let pair = ordered(unknown, unknown_of_node[corners[j]]);
            entries.entry(pair).or_default().0 += admittance * mass(count, measure, i, j);
        }
        entries.entry(ordered(electrode, unknown)).or_default().0 -= admittance * measure / count as f64;
    }
    entries.entry([electrode, electrode]).or_default().0 += admittance * measure;
}
