//! The faces of a mesh that are seen from outside.

use super::{Cells, Mesh};
use crate::geom::vector::{centroid, cross, dot, sub};
use std::collections::HashMap;

impl Mesh {
    /// The triangles of a surface as they are, or the faces of a volume that belong to one tetrahedron only, counter-clockwise as
    /// seen from outside; each with its cell, in the order of the cells.
    pub fn outer_faces(&self) -> Vec<([usize; 3], usize)> {
        match &self.cells {
            Cells::Triangles(cells) => cells.iter().enumerate().map(|(cell, &corners)| (corners, cell)).collect(),
            Cells::Tetrahedra(cells) => {
                let faces = |&[a, b, c, d]: &[usize; 4]| [[a, c, b], [a, b, d], [a, d, c], [b, c, d]];
                let key = |mut face: [usize; 3]| {
                    face.sort_unstable();
                    face
                };
                let mut seen: HashMap<[usize; 3], usize> = HashMap::new();
                cells.iter().flat_map(faces).for_each(|face| *seen.entry(key(face)).or_default() += 1);
                let all = cells.iter().enumerate().flat_map(|(cell, corners)| faces(corners).map(|face| (face, cell)));
                all.filter(|(face, _)| seen[&key(*face)] == 1)
                    .map(|(face, cell)| (self.outwards(face, cell), cell))
                    .collect()
            }
        }
    }

    /// A face turned away from its cell.
    fn outwards(&self, [a, b, c]: [usize; 3], cell: usize) -> [usize; 3] {
        let corners = [a, b, c].map(|node| self.nodes[node]);
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let is_outwards = dot(normal, sub(centroid(&corners), self.cell_centre(cell))) > 0.0;
        if is_outwards { [a, b, c] } else { [a, c, b] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::geom::vector::volume;

    #[test]
    fn faces_of_a_volume_enclose_its_cells() {
        let mesh = Mesh::generate(&SkinDesign::shipped("skin16").unwrap()).unwrap();
        assert_eq!(mesh.outer_faces().len(), mesh.cell_count(), "a surface has its own triangles");

        // Two tetrahedra with a common face, the second of the other orientation.
        let nodes = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]];
        let cells = Cells::Tetrahedra(vec![[0, 1, 2, 3], [1, 2, 3, 4]]);
        let mesh = Mesh { nodes, cells, electrodes: Vec::new(), ..mesh };
        let faces = mesh.outer_faces();
        assert_eq!(faces.iter().filter(|(_, cell)| *cell == 0).count(), 3);
        assert_eq!(faces.len(), 6);
        // 1/6 and, by the determinant of its edges, 1/3.
        let of_faces = volume(faces.iter().map(|(face, _)| face.map(|node| mesh.nodes[node])));
        assert!((of_faces - 0.5).abs() < 1e-12, "{of_faces}");
    }
}
