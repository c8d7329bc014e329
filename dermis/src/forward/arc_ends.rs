//! Correction of the discretisation error of linear elements at the ends of arc electrodes, as impedances in series with
//! the electrodes.
//!
//! At the end of an electrode on an edge the potential behaves like `r^(1/2)` down to the length `l = s z` of the
//! contact. Linear elements of size `h` represent it with an error of the order `h`, so that the resistances between the
//! electrodes are too low. An arc has no exact near field like a disc. So the untouched skin is solved twice: on the mesh,
//! and on copies that are refined at the ends and around them. The difference of the transfer impedances,
//!
//! `C = S_fine - S`,
//!
//! is added to those of the mesh. It is symmetric and applies to every drive, because the amplitude at an end depends on
//! all electrodes. A change of the skin away from the ends does not change it; with the conductance at the electrodes it
//! changes in inverse proportion.

use super::{ForwardError, ForwardModel};
use crate::geom::vector::{add, distance, scale};
use crate::linalg::Matrix;
use crate::mesh::{Cells, ElectrodePatch, Mesh, Refined};
use std::collections::BTreeMap;

/// Halvings of the edges at an end. Each halves the error of the end, which is 7 % of the voltages of driven electrodes
/// for edges of a twelfth of the electrode's length (`dermis/tests/rim_arcs.rs`): 0.05 % are left.
const HALVINGS: usize = 7;
/// Distance from an end, in lengths of its electrode, within which all edges are halved once more.
const REACH: f64 = 1.0;

/// The impedances to add, electrodes x electrodes, ohm; `None` without arcs.
pub(super) fn added_impedances(model: &ForwardModel) -> crate::Result<Option<Matrix>> {
    let ends = ends(model.mesh());
    if ends.is_empty() {
        return Ok(None);
    }
    let Some(graded) = graded(model.mesh(), &ends) else { return Ok(None) };
    let Some(finer) = halved(&graded, &ends) else { return Ok(None) };
    let (coarse, (graded, finer)) =
        rayon::join(|| impedances(model), || rayon::join(|| refined(model, &graded), || refined(model, &finer)));
    let (mut added, graded, finer) = (coarse?, graded?, finer?);
    // Without the ends the error is that of smooth fields, of second order: the finer mesh has a quarter of it.
    for ((value, graded), finer) in added.values.iter_mut().zip(&graded.values).zip(&finer.values) {
        *value = finer + (finer - graded) / 3.0 - *value;
    }
    Ok(Some(added))
}

fn impedances(model: &ForwardModel) -> Result<Matrix, ForwardError> {
    Ok(model.network(model.rest_conductivity())?.transfer_impedance)
}

/// The transfer impedances on a finer mesh.
fn refined(model: &ForwardModel, finer: &Refined) -> crate::Result<Matrix> {
    let rest: Vec<f64> = finer.parents.iter().map(|&parent| model.rest_conductivity()[parent]).collect();
    let fine = ForwardModel::from_parts(&finer.mesh, model.contact_impedances(), model.protocol(), &rest)?;
    Ok(impedances(&fine)?)
}

/// The ends of arcs on a mesh of triangles, nodes with one edge of an electrode, and the length of the electrode, m.
fn ends(mesh: &Mesh) -> BTreeMap<usize, f64> {
    let mut ends = BTreeMap::new();
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        let (Cells::Triangles(_), ElectrodePatch::Edges(edges)) = (&mesh.cells, patch) else { continue };
        let mut edge_counts: BTreeMap<usize, usize> = BTreeMap::new();
        edges.as_flattened().iter().for_each(|&node| *edge_counts.entry(node).or_default() += 1);
        let single = edge_counts.into_iter().filter(|&(_, count)| count == 1);
        ends.extend(single.map(|(node, _)| (node, mesh.electrode_size(electrode))));
    }
    ends
}

/// The mesh with the edges at the ends halved again and again.
fn graded(mesh: &Mesh, ends: &BTreeMap<usize, f64>) -> Option<Refined> {
    let mut graded = Refined { parents: (0..mesh.cell_count()).collect(), mesh: mesh.clone() };
    for _ in 0..HALVINGS {
        graded = graded.refined(|edge| edge.iter().any(|node| ends.contains_key(node)))?;
    }
    Some(graded)
}

/// The mesh with all edges near the ends halved.
fn halved(graded: &Refined, ends: &BTreeMap<usize, f64>) -> Option<Refined> {
    let nodes = &graded.mesh.nodes;
    graded.refined(|[a, b]| {
        let middle = scale(add(nodes[a], nodes[b]), 0.5);
        ends.iter().any(|(&end, length_m)| distance(nodes[end], middle) < REACH * length_m)
    })
}
