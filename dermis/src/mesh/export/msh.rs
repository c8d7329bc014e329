//! Gmsh .msh version 4.1, ASCII.

use super::{Part, electrode_parts, electrodes_of_cells};
use crate::geom::vector::bounding_box;
use crate::mesh::import::{ELECTRODE, UNGROUPED};
use crate::mesh::{Cells, ElectrodePatch, Mesh};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// A set of physical groups, by tag; elements of one dimension with the same set form an entity.
type Groups = Vec<usize>;

/// Elements, each with its tag and nodes, by dimension and groups.
type Entities<'a> = BTreeMap<(usize, Groups), Vec<(usize, &'a [usize])>>;

pub(super) fn write(mesh: &Mesh, conductivity: Option<&[f64]>, out: &mut dyn Write) -> io::Result<()> {
    let dimension = match mesh.cells {
        Cells::Triangles(_) => 2,
        Cells::Tetrahedra(_) => 3,
    };
    let parts = electrode_parts(mesh);
    // Elements by entity, each with its tag; cells are first, so that their tags are their numbers from 1.
    let mut entities = Entities::new();
    for (cell, groups) in groups_of_cells(mesh).into_iter().enumerate() {
        entities.entry((dimension, groups)).or_default().push((cell + 1, mesh.cells.corners(cell)));
    }
    for (k, Part { electrode, nodes }) in parts.iter().enumerate() {
        let tagged = (mesh.cell_count() + k + 1, nodes.as_slice());
        entities.entry((nodes.len() - 1, vec![electrode + 1])).or_default().push(tagged);
    }
    writeln!(out, "$MeshFormat\n4.1 0 8\n$EndMeshFormat")?;
    physical_names(mesh, dimension, out)?;
    entity_table(&entities, mesh, out)?;
    let node_count = mesh.node_count();
    writeln!(out, "$Nodes\n1 {node_count} 1 {node_count}\n{dimension} 1 0 {node_count}")?;
    for tag in 1..=node_count {
        writeln!(out, "{tag}")?;
    }
    for [x, y, z] in &mesh.nodes {
        writeln!(out, "{x:?} {y:?} {z:?}")?;
    }
    let element_count = mesh.cell_count() + parts.len();
    writeln!(out, "$EndNodes\n$Elements\n{} {element_count} 1 {element_count}", entities.len())?;
    for (tag, ((dimension, _), elements)) in entities.iter().enumerate() {
        let kind = [15, 1, 2, 4][*dimension];
        writeln!(out, "{dimension} {} {kind} {}", tag + 1, elements.len())?;
        for (element_tag, nodes) in elements {
            write!(out, "{element_tag}")?;
            nodes.iter().try_for_each(|node| write!(out, " {}", node + 1))?;
            writeln!(out)?;
        }
    }
    writeln!(out, "$EndElements")?;
    if let Some(values) = conductivity {
        writeln!(out, "$ElementData\n1\n\"conductivity\"\n1\n0.0\n3\n0\n1\n{element_count}")?;
        // A value for every element in the order of the blocks, as required by meshio; 0 for elements that only show an
        // electrode.
        for (tag, _) in entities.values().flatten() {
            writeln!(out, "{tag} {:?}", values.get(tag - 1).copied().unwrap_or(0.0))?;
        }
        writeln!(out, "$EndElementData")?;
    }
    Ok(())
}

/// The tag of the group of all cells without another group: some programs (Gmsh when it saves, meshio) drop cells
/// without a group.
fn ungrouped_tag(mesh: &Mesh) -> usize {
    mesh.electrodes.len() + mesh.regions.len() + 1
}

/// The tags of the groups of each cell: electrode `n` has `n + 1`, the regions follow.
fn groups_of_cells(mesh: &Mesh) -> Vec<Groups> {
    let mut groups: Vec<Groups> =
        electrodes_of_cells(mesh).into_iter().map(|list| list.into_iter().map(|e| e + 1).collect()).collect();
    for (k, (_, cells)) in mesh.regions.iter().enumerate() {
        cells.iter().for_each(|&cell| groups[cell].push(mesh.electrodes.len() + k + 1));
    }
    groups.iter_mut().filter(|list| list.is_empty()).for_each(|list| list.push(ungrouped_tag(mesh)));
    groups
}

fn physical_names(mesh: &Mesh, dimension: usize, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "$PhysicalNames\n{}", ungrouped_tag(mesh))?;
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        let dimension = match patch {
            ElectrodePatch::Node(_) => 0,
            ElectrodePatch::Edges(_) => 1,
            ElectrodePatch::Cells(_) => dimension,
            ElectrodePatch::Faces(_) => 2,
        };
        writeln!(out, "{dimension} {} \"{ELECTRODE}{electrode}\"", electrode + 1)?;
    }
    for (k, (name, _)) in mesh.regions.iter().enumerate() {
        writeln!(out, "{dimension} {} \"{name}\"", mesh.electrodes.len() + k + 1)?;
    }
    writeln!(out, "{dimension} {} \"{UNGROUPED}\"", ungrouped_tag(mesh))?;
    writeln!(out, "$EndPhysicalNames")
}

/// The entities with their groups; Gmsh requires a bounding box for each; that of the mesh is used for all.
fn entity_table(entities: &Entities<'_>, mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let [low, high] = bounding_box(mesh.nodes.iter().copied());
    let count = |dimension: usize| entities.keys().filter(|key| key.0 == dimension).count();
    writeln!(out, "$Entities\n{} {} {} {}", count(0), count(1), count(2), count(3))?;
    for (tag, ((dimension, groups), elements)) in entities.iter().enumerate() {
        write!(out, "{}", tag + 1)?;
        let corners = if *dimension == 0 { vec![mesh.nodes[elements[0].1[0]]] } else { vec![low, high] };
        corners.iter().flatten().try_for_each(|value| write!(out, " {value:?}"))?;
        write!(out, " {}", groups.len())?;
        groups.iter().try_for_each(|group| write!(out, " {group}"))?;
        writeln!(out, "{}", if *dimension == 0 { "" } else { " 0" })?;
    }
    writeln!(out, "$EndEntities")
}
