//! Checks that a forward problem can be solved on a mesh.

use crate::geom::vector::{Point3, cross, distance, longest_edge, sub, tetrahedron_volume};
use crate::mesh::{Cells, ElectrodePatch, Mesh, MeshError};
use std::collections::{BTreeMap, HashMap, HashSet};

/// A triangle whose height is less than this fraction of its longest edge is degenerate, as its area is a rounding
/// error; likewise a tetrahedron whose volume is less than this fraction of its longest edge cubed.
const FLAT: f64 = 1e-10;
/// Nodes on the edge of a surface that are nearer to each other than this part of the mean edge there and than this distance, m, and not
/// joined by an edge, are a crack, as of a body whose faces were written one by one. Lasers and knives cut wider ones.
const CRACK: f64 = 0.01;
const CRACK_M: f64 = 5e-5;
/// Rounding of places, m.
const ROUNDING_M: f64 = 1e-12;

impl Mesh {
    /// Checks that a forward problem can be solved on this mesh.
    ///
    /// # Errors
    /// A node that is not finite or belongs to no cell; an index out of range; a cell without area or inverted; an edge
    /// of more than two triangles (a face of more than two tetrahedra); a crack, where two boundary nodes have nearly the
    /// same position; an electrode without faces, or two on one cell; a part of the mesh without an electrode.
    pub fn validate(&self) -> Result<(), MeshError> {
        self.check_indices()?;
        self.check_nodes()?;
        self.check_cells()?;
        let boundary = match &self.cells {
            Cells::Triangles(cells) => triangle_boundary(cells)?,
            Cells::Tetrahedra(cells) => tetrahedron_boundary(cells)?,
        };
        self.check_tears(&boundary)?;
        self.check_electrodes(&boundary)?;
        self.check_parts()
    }

    fn check_indices(&self) -> Result<(), MeshError> {
        let (nodes, cells) = (self.node_count(), self.cell_count());
        if self.cells.is_empty() {
            return invalid("the mesh has no cells");
        }
        for cell in 0..cells {
            let corners = self.cells.corners(cell);
            if let Some(node) = corners.iter().find(|&&node| node >= nodes) {
                return invalid(format!("cell {cell} names node {node}, but the mesh has {nodes} nodes"));
            }
            if (1..corners.len()).any(|k| corners[..k].contains(&corners[k])) {
                return invalid(format!("cell {cell} names a node twice: {corners:?}"));
            }
        }
        for (electrode, patch) in self.electrodes.iter().enumerate() {
            let (what, count, highest) = match patch {
                ElectrodePatch::Cells(list) => ("cell", cells, list.iter().max().copied()),
                ElectrodePatch::Edges(list) => ("node", nodes, list.iter().flatten().max().copied()),
                ElectrodePatch::Faces(list) => ("node", nodes, list.iter().flatten().max().copied()),
                ElectrodePatch::Node(node) => ("node", nodes, Some(*node)),
            };
            match highest {
                None => return invalid(format!("electrode {electrode} has no faces")),
                Some(index) if index >= count => {
                    return invalid(format!("electrode {electrode} names {what} {index}, but there are {count}"));
                }
                Some(_) => {}
            }
        }
        for (name, list) in &self.regions {
            if let Some(cell) = list.iter().find(|&&cell| cell >= cells) {
                return invalid(format!("region `{name}` names cell {cell}, but the mesh has {cells} cells"));
            }
        }
        Ok(())
    }

    fn check_nodes(&self) -> Result<(), MeshError> {
        if let Some(node) = self.nodes.iter().position(|node| node.iter().any(|x| !x.is_finite())) {
            return invalid(format!("node {node} is at {:?}: its place must be finite", self.nodes[node]));
        }
        let mut used = vec![false; self.node_count()];
        for cell in 0..self.cell_count() {
            self.cells.corners(cell).iter().for_each(|&node| used[node] = true);
        }
        match used.iter().position(|used| !used) {
            Some(node) => invalid(format!("node {node} belongs to no cell")),
            None => Ok(()),
        }
    }

    fn check_cells(&self) -> Result<(), MeshError> {
        for cell in 0..self.cell_count() {
            let corners = self.cells.corners(cell);
            let corners_m: Vec<Point3> = corners.iter().map(|&node| self.nodes[node]).collect();
            let longest = longest_edge(&corners_m);
            let (relative, what) = match &self.cells {
                Cells::Triangles(_) => (2.0 * self.cell_measure(cell) / (longest * longest), "area"),
                Cells::Tetrahedra(cells) => {
                    let volume = tetrahedron_volume(cells[cell].map(|node| self.nodes[node]));
                    (6.0 * volume / longest.powi(3), "volume")
                }
            };
            if relative < -FLAT {
                return invalid(format!("cell {cell} is inverted: its volume is negative"));
            }
            // A cell whose corners coincide gives NaN, which also counts as no area.
            if relative.is_nan() || relative <= FLAT {
                return invalid(format!("cell {cell} has no {what}"));
            }
        }
        match &self.cells {
            Cells::Triangles(cells) => self.check_flat_orientation(cells),
            Cells::Tetrahedra(_) => Ok(()),
        }
    }

    /// In a plane, triangles of the less frequent orientation are folded over.
    fn check_flat_orientation(&self, cells: &[[usize; 3]]) -> Result<(), MeshError> {
        let normal = |corners: &[usize; 3]| {
            let [a, b, c] = corners.map(|node| self.nodes[node]);
            cross(sub(b, a), sub(c, a))
        };
        let Some(axis) = plane_axis(&self.nodes) else { return Ok(()) };
        let negative: Vec<usize> =
            (0..cells.len()).filter(|&cell| normal(&cells[cell])[axis].is_sign_negative()).collect();
        let first = if 2 * negative.len() <= cells.len() {
            negative.first().copied()
        } else {
            (0..cells.len()).find(|cell| negative.binary_search(cell).is_err())
        };
        match first {
            Some(cell) => invalid(format!("cell {cell} is inverted: its corners run the other way round")),
            None => Ok(()),
        }
    }

    /// Two boundary nodes at nearly the same position are a crack that current cannot cross.
    fn check_tears(&self, boundary: &BTreeMap<Vec<usize>, usize>) -> Result<(), MeshError> {
        let length_m = |&[a, b]: &[usize; 2]| distance(self.nodes[a], self.nodes[b]);
        let (crack_m, edges) = match &self.cells {
            Cells::Triangles(cells) => {
                let edges: HashSet<[usize; 2]> = triangle_edges(cells).into_keys().collect();
                let mean_m = boundary.keys().map(|edge| length_m(&[edge[0], edge[1]])).sum::<f64>()
                    / boundary.len().max(1) as f64;
                ((CRACK * mean_m).min(CRACK_M), edges)
            }
            // A volume may be thin: there only nodes at one place are.
            Cells::Tetrahedra(_) => (ROUNDING_M, HashSet::new()),
        };
        let mut in_box: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        let mut seen = vec![false; self.node_count()];
        for &node in boundary.keys().flatten() {
            if std::mem::replace(&mut seen[node], true) {
                continue;
            }
            let home = self.nodes[node].map(|x| (x / crack_m).floor() as i64);
            let near = (0..27).map(|k| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1]);
            let near = near.map(|by| [0, 1, 2].map(|axis| home[axis].wrapping_add(by[axis])));
            let near = near.filter_map(|place| in_box.get(&place)).flatten().copied();
            let pair = near.map(|other| [other.min(node), other.max(node)]);
            if let Some([low, high]) = pair.into_iter().find(|pair| !edges.contains(pair) && length_m(pair) <= crack_m)
            {
                let place = match length_m(&[low, high]) {
                    0.0 => "at one place".to_string(),
                    apart_m => format!("{:.2e} m apart", apart_m),
                };
                return invalid(format!(
                    "the mesh is torn at {:?} m, where nodes {low} and {high} lie {place}: merge vertices that are there \
                     twice; a vertex on the edge of another triangle must be a corner of it",
                    self.nodes[node]
                ));
            }
            in_box.entry(home).or_default().push(node);
        }
        Ok(())
    }

    fn check_electrodes(&self, boundary: &BTreeMap<Vec<usize>, usize>) -> Result<(), MeshError> {
        let mut owner: HashMap<Vec<usize>, usize> = HashMap::new();
        let edges = match &self.cells {
            Cells::Triangles(cells) => triangle_edges(cells),
            Cells::Tetrahedra(_) => HashMap::new(),
        };
        for (electrode, patch) in self.electrodes.iter().enumerate() {
            let on = |what: &str| format!("electrode {electrode} covers {what}");
            let pieces: Vec<Vec<usize>> = match (patch, &self.cells) {
                (ElectrodePatch::Node(node), _) => vec![vec![*node]],
                (ElectrodePatch::Cells(list), Cells::Triangles(cells)) => {
                    list.iter().map(|&cell| sorted(&cells[cell])).collect()
                }
                (ElectrodePatch::Edges(list), Cells::Triangles(_)) => list.iter().map(|edge| sorted(edge)).collect(),
                (ElectrodePatch::Faces(list), Cells::Tetrahedra(_)) => list.iter().map(|face| sorted(face)).collect(),
                (ElectrodePatch::Faces(_), _) => return invalid(on("faces, which a surface has not")),
                (ElectrodePatch::Cells(_) | ElectrodePatch::Edges(_), _) => {
                    return invalid(on("cells or edges of a volume: it must cover faces of its boundary"));
                }
            };
            for piece in pieces {
                let known = match (piece.len(), patch) {
                    (2, _) => edges.contains_key(&[piece[0], piece[1]]),
                    (3, ElectrodePatch::Faces(_)) => boundary.contains_key(&piece),
                    _ => true,
                };
                if !known {
                    return invalid(on(&format!("nodes {piece:?}, which are no edge or outer face of the mesh")));
                }
                if let Some(other) = owner.insert(piece, electrode) {
                    return invalid(if other == electrode {
                        on("the same face twice")
                    } else {
                        format!("electrodes {other} and {electrode} cover the same face")
                    });
                }
            }
        }
        Ok(())
    }

    fn check_parts(&self) -> Result<(), MeshError> {
        let mut part: Vec<usize> = (0..self.node_count()).collect();
        fn root(part: &mut [usize], mut node: usize) -> usize {
            while part[node] != node {
                part[node] = part[part[node]];
                node = part[node];
            }
            node
        }
        for cell in 0..self.cell_count() {
            let corners = self.cells.corners(cell);
            for &corner in &corners[1..] {
                let (a, b) = (root(&mut part, corners[0]), root(&mut part, corner));
                part[a.max(b)] = a.min(b);
            }
        }
        let mut touched = vec![false; self.node_count()];
        for patch in &self.electrodes {
            let nodes: Vec<usize> = match patch {
                ElectrodePatch::Cells(list) => list.iter().map(|&cell| self.cells.corners(cell)[0]).collect(),
                ElectrodePatch::Edges(list) => list.iter().map(|edge| edge[0]).collect(),
                ElectrodePatch::Faces(list) => list.iter().map(|face| face[0]).collect(),
                ElectrodePatch::Node(node) => vec![*node],
            };
            for node in nodes {
                touched[root(&mut part, node)] = true;
            }
        }
        for cell in 0..self.cell_count() {
            if !touched[root(&mut part, self.cells.corners(cell)[0])] {
                let near_m = self.nodes[self.cells.corners(cell)[0]];
                return invalid(format!(
                    "a part of the body, at {near_m:?} m, has no electrode (cell {cell} is in it): remove the part, join it to \
                     the rest, or place an electrode on it"
                ));
            }
        }
        Ok(())
    }
}

fn invalid<T>(message: impl Into<String>) -> Result<T, MeshError> {
    Err(MeshError::Invalid(message.into()))
}

fn sorted(nodes: &[usize]) -> Vec<usize> {
    let mut nodes = nodes.to_vec();
    nodes.sort_unstable();
    nodes
}

/// The axis across the plane z = constant (or x, or y) in which all nodes lie.
fn plane_axis(nodes: &[Point3]) -> Option<usize> {
    (0..3).find(|&axis| nodes.iter().all(|node| node[axis] == nodes[0][axis]))
}

/// Each edge with the cells on it.
fn triangle_edges(cells: &[[usize; 3]]) -> HashMap<[usize; 2], Vec<usize>> {
    let mut edges: HashMap<[usize; 2], Vec<usize>> = HashMap::with_capacity(cells.len() * 3 / 2);
    for (cell, &[a, b, c]) in cells.iter().enumerate() {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            edges.entry([from.min(to), from.max(to)]).or_default().push(cell);
        }
    }
    edges
}

impl Mesh {
    /// The number of connected curves of edges that belong to one triangle alone, and of these edges; 0 on tetrahedra.
    pub(super) fn open_curves(&self) -> [usize; 2] {
        let Cells::Triangles(cells) = &self.cells else { return [0; 2] };
        let Ok(edges) = triangle_boundary(cells) else { return [0; 2] };
        let mut next: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for edge in edges.keys() {
            next.entry(edge[0]).or_default().push(edge[1]);
            next.entry(edge[1]).or_default().push(edge[0]);
        }
        let mut curves = 0;
        while let Some((node, others)) = next.pop_first() {
            curves += 1;
            let mut waiting = others;
            waiting.push(node);
            while let Some(node) = waiting.pop() {
                waiting.extend(next.remove(&node).into_iter().flatten());
            }
        }
        [curves, edges.len()]
    }
}

/// The edges that belong to one triangle, with the triangle; also checks that all other edges have two triangles of
/// consistent orientation.
fn triangle_boundary(cells: &[[usize; 3]]) -> Result<BTreeMap<Vec<usize>, usize>, MeshError> {
    let mut directed: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    for (edge, owners) in triangle_edges(cells) {
        if owners.len() > 2 {
            let listed = &owners[..owners.len().min(4)];
            return invalid(format!(
                "the edge between nodes {} and {} has more than two cells: {listed:?}",
                edge[0], edge[1]
            ));
        }
    }
    for (cell, &[a, b, c]) in cells.iter().enumerate() {
        for edge in [[a, b], [b, c], [c, a]] {
            if let Some(other) = directed.insert(edge, cell) {
                return invalid(format!(
                    "cells {other} and {cell} do not agree which side is outside: one is inverted"
                ));
            }
        }
    }
    let open = directed.iter().filter(|(edge, _)| !directed.contains_key(&[edge[1], edge[0]]));
    Ok(open.map(|(edge, &cell)| (sorted(edge), cell)).collect())
}

/// The faces that belong to one tetrahedron, with the tetrahedron; also checks that no face has more than two.
fn tetrahedron_boundary(cells: &[[usize; 4]]) -> Result<BTreeMap<Vec<usize>, usize>, MeshError> {
    let mut faces: BTreeMap<Vec<usize>, Vec<usize>> = BTreeMap::new();
    for (cell, &[a, b, c, d]) in cells.iter().enumerate() {
        for face in [[b, c, d], [a, c, d], [a, b, d], [a, b, c]] {
            let owners = faces.entry(sorted(&face)).or_default();
            owners.push(cell);
            if owners.len() > 2 {
                return invalid(format!("the face of nodes {face:?} has more than two cells: {owners:?}"));
            }
        }
    }
    Ok(faces.into_iter().filter(|(_, owners)| owners.len() == 1).map(|(face, owners)| (face, owners[0])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of four triangles around a central node, electrodes on two of its edges.
    fn square() -> Mesh {
        Mesh {
            nodes: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.0]],
            cells: Cells::Triangles(vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]),
            electrodes: vec![ElectrodePatch::Edges(vec![[0, 1]]), ElectrodePatch::Cells(vec![2])],
            regions: Vec::new(),
        }
    }

    fn complaint(change: impl FnOnce(&mut Mesh)) -> String {
        let mut mesh = square();
        change(&mut mesh);
        mesh.validate().unwrap_err().to_string()
    }

    fn triangles(mesh: &mut Mesh) -> &mut Vec<[usize; 3]> {
        match &mut mesh.cells {
            Cells::Triangles(cells) => cells,
            Cells::Tetrahedra(_) => unreachable!("the square has triangles"),
        }
    }

    #[test]
    fn a_good_mesh_passes() {
        square().validate().unwrap();
    }

    #[test]
    fn bad_nodes_and_cells_are_named() {
        assert!(complaint(|mesh| mesh.nodes[3][1] = f64::NAN).contains("node 3"));
        assert!(complaint(|mesh| mesh.nodes.push([9.0; 3])).contains("node 5 belongs to no cell"));
        assert!(complaint(|mesh| triangles(mesh)[1][0] = 77).contains("cell 1 names node 77"));
        assert!(complaint(|mesh| triangles(mesh)[1] = [1, 1, 4]).contains("cell 1 names a node twice"));
        assert!(complaint(|mesh| mesh.nodes[4] = [0.5, 0.0, 0.0]).contains("cell 0 has no area"));
        assert!(complaint(|mesh| mesh.nodes[4] = [0.5, -0.1, 0.0]).contains("cell 0 is inverted"));
        assert!(complaint(|mesh| triangles(mesh)[2].swap(0, 1)).contains("cell 2 is inverted"));
        assert!(complaint(|mesh| mesh.cells = Cells::Triangles(Vec::new())).contains("no cells"));
    }

    #[test]
    fn an_inverted_cell_in_space_is_named() {
        let bent = complaint(|mesh| {
            mesh.nodes[4][2] = 0.3;
            triangles(mesh)[2].swap(0, 1);
        });
        assert!(bent.contains("inverted") && bent.contains('2'), "{bent}");
    }

    #[test]
    fn tears_and_fins_are_named() {
        let torn = complaint(|mesh| {
            mesh.nodes.push(mesh.nodes[4]);
            triangles(mesh)[2][2] = 5;
        });
        assert!(torn.contains("where nodes 4 and 5 lie at one place"), "{torn}");
        // A gap of a micrometre, as of a body whose faces were written one by one, and one that a knife can cut.
        let gap = |width_m: f64| {
            move |mesh: &mut Mesh| {
                let [x, y, z] = mesh.nodes[4];
                mesh.nodes.push([x, y + width_m, z]);
                triangles(mesh)[2][2] = 5;
            }
        };
        let cracked = complaint(gap(1e-6));
        assert!(cracked.contains("where nodes 4 and 5 lie 1.00e-6 m apart"), "{cracked}");
        let mut cut = square();
        gap(1e-4)(&mut cut);
        assert!(!cut.validate().is_err_and(|error| error.to_string().contains("torn")));
        let fin = complaint(|mesh| {
            mesh.nodes.push([0.5, 0.5, 1.0]);
            triangles(mesh).push([0, 4, 5]);
        });
        assert!(fin.contains("nodes 0 and 4 has more than two cells"), "{fin}");
    }

    #[test]
    fn bad_electrodes_are_named() {
        let set = |index: usize, patch: ElectrodePatch| complaint(move |mesh| mesh.electrodes[index] = patch);
        assert!(set(1, ElectrodePatch::Cells(Vec::new())).contains("electrode 1 has no faces"));
        assert!(set(0, ElectrodePatch::Edges(Vec::new())).contains("electrode 0 has no faces"));
        assert!(set(1, ElectrodePatch::Cells(vec![4])).contains("electrode 1 names cell 4"));
        assert!(set(1, ElectrodePatch::Node(5)).contains("electrode 1 names node 5"));
        assert!(set(0, ElectrodePatch::Edges(vec![[0, 2]])).contains("electrode 0 covers nodes [0, 2]"));
        assert!(set(0, ElectrodePatch::Cells(vec![2])).contains("electrodes 0 and 1"));
        assert!(set(0, ElectrodePatch::Faces(vec![[0, 1, 4]])).contains("faces, which a surface has not"));
    }

    #[test]
    fn a_part_without_an_electrode_is_named() {
        let apart = complaint(|mesh| {
            mesh.nodes.extend([[3.0, 0.0, 0.0], [4.0, 0.0, 0.0], [3.0, 1.0, 0.0]]);
            triangles(mesh).push([5, 6, 7]);
        });
        assert!(apart.contains("at [3.0, 0.0, 0.0] m, has no electrode (cell 4"), "{apart}");
    }

    #[test]
    fn an_inverted_tetrahedron_is_named() {
        let mut mesh = Mesh {
            nodes: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            cells: Cells::Tetrahedra(vec![[0, 1, 2, 3]]),
            electrodes: vec![ElectrodePatch::Faces(vec![[0, 1, 2]])],
            regions: Vec::new(),
        };
        mesh.validate().unwrap();
        mesh.nodes[3][2] = -1.0;
        assert!(mesh.validate().unwrap_err().to_string().contains("cell 0 is inverted"));
    }
}
