//! Division of edges of a mesh of triangles.

use super::{Cells, ElectrodePatch, Mesh};
use crate::geom::vector::{add, scale};
use std::collections::HashMap;

/// A finer mesh of the same surface.
#[derive(Debug)]
pub(crate) struct Refined {
    /// The finer mesh; the first nodes are those of the coarse one.
    pub mesh: Mesh,
    /// The coarse cell that contains each cell.
    pub parents: Vec<usize>,
}

impl Refined {
    /// The mesh refined once more; the parents are those of the first mesh.
    pub(crate) fn refined(&self, divides: impl Fn([usize; 2]) -> bool) -> Option<Refined> {
        let finer = self.mesh.refined(divides)?;
        let parents = finer.parents.iter().map(|&cell| self.parents[cell]).collect();
        Some(Refined { parents, ..finer })
    }
}

impl Mesh {
    /// Divides edges at their midpoints: a triangle becomes two, three or four by the number of its divided edges, so
    /// that no node is inside an edge of a neighbour. The patches of electrodes stay where they are; named regions are
    /// left out. `None` for tetrahedra.
    pub(crate) fn refined(&self, divides: impl Fn([usize; 2]) -> bool) -> Option<Refined> {
        let Cells::Triangles(triangles) = &self.cells else { return None };
        let mut nodes = self.nodes.clone();
        let mut middles: HashMap<[usize; 2], Option<usize>> = HashMap::new();
        let mut middle = |a: usize, b: usize| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                divides([a, b]).then(|| {
                    nodes.push(scale(add(self.nodes[a], self.nodes[b]), 0.5));
                    nodes.len() - 1
                })
            })
        };
        let (mut cells, mut parents, mut starts) = (Vec::new(), Vec::new(), vec![0]);
        for (parent, &[a, b, c]) in triangles.iter().enumerate() {
            cells.extend(parts([a, b, c], [middle(b, c), middle(c, a), middle(a, b)]));
            parents.resize(cells.len(), parent);
            starts.push(cells.len());
        }
        let patch = |patch: &ElectrodePatch| match patch {
            ElectrodePatch::Cells(patch) => {
                ElectrodePatch::Cells(patch.iter().flat_map(|&cell| starts[cell]..starts[cell + 1]).collect())
            }
            ElectrodePatch::Edges(edges) => {
                let halves = |&[a, b]: &[usize; 2]| match middles.get(&[a.min(b), a.max(b)]) {
                    Some(&Some(m)) => vec![[a, m], [m, b]],
                    _ => vec![[a, b]],
                };
                ElectrodePatch::Edges(edges.iter().flat_map(halves).collect())
            }
            other => other.clone(),
        };
        let electrodes = self.electrodes.iter().map(patch).collect();
        Some(Refined { mesh: Mesh { nodes, cells: Cells::Triangles(cells), electrodes, regions: Vec::new() }, parents })
    }
}

/// The parts of a triangle with midpoints on some of its edges, each opposite to its corner; the orientation stays.
fn parts([a, b, c]: [usize; 3], middles: [Option<usize>; 3]) -> Vec<[usize; 3]> {
    match middles {
        [None, None, None] => vec![[a, b, c]],
        [Some(m), None, None] => vec![[a, b, m], [a, m, c]],
        [Some(p), Some(q), Some(r)] => vec![[a, r, q], [r, b, p], [q, p, c], [p, q, r]],
        // The corner between the two divided edges is cut off.
        [None, Some(q), Some(r)] => vec![[a, r, q], [r, b, c], [r, c, q]],
        [p, q, r] => parts([b, c, a], [q, r, p]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::geom::vector::distance;

    /// Any choice of edges keeps the surface whole: its area, and every edge inside belongs to two triangles.
    #[test]
    fn a_refined_mesh_is_whole() {
        let mesh = Mesh::generate(&SkinDesign::shipped("tank16").unwrap()).unwrap();
        let area = |mesh: &Mesh| (0..mesh.cell_count()).map(|cell| mesh.cell_measure(cell)).sum::<f64>();
        for every in [1, 2, 3, 7] {
            let Refined { mesh: fine, parents } = mesh.refined(|[a, b]| (a + b) % every == 0).unwrap();
            fine.validate().unwrap();
            assert!((area(&fine) / area(&mesh) - 1.0).abs() < 1e-12);
            let mut children = vec![0.0; mesh.cell_count()];
            (0..fine.cell_count()).for_each(|cell| children[parents[cell]] += fine.cell_measure(cell));
            for (cell, measure) in children.into_iter().enumerate() {
                assert!((measure / mesh.cell_measure(cell) - 1.0).abs() < 1e-9);
            }
            let Cells::Triangles(cells) = &fine.cells else { unreachable!("triangles stay triangles") };
            let mut sides: HashMap<[usize; 2], i32> = HashMap::new();
            for &[a, b, c] in cells {
                [[a, b], [b, c], [c, a]].into_iter().for_each(|side| *sides.entry(side).or_default() += 1);
            }
            assert!(sides.values().all(|&count| count == 1), "every directed side belongs to one triangle");
            let rim = sides
                .keys()
                .filter(|[a, b]| !sides.contains_key(&[*b, *a]))
                .map(|&[a, b]| distance(fine.nodes[a], fine.nodes[b]));
            assert!((rim.sum::<f64>() / (std::f64::consts::PI * 0.2) - 1.0).abs() < 1e-3, "no gaps");
            for electrode in 0..16 {
                assert!((fine.electrode_size(electrode) / mesh.electrode_size(electrode) - 1.0).abs() < 1e-12);
            }
        }
    }
}
