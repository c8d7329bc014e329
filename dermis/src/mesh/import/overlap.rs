//! Tetrahedra that overlap.

use crate::geom::Point3;
use crate::geom::vector::tetrahedron_volume;
use std::collections::BTreeMap;

/// The first two tetrahedra on the same side of their common face; the order of their nodes does not matter.
pub(super) fn overlapping(nodes: &[Point3], cells: &[[usize; 4]]) -> Option<[usize; 2]> {
    // The first cell of each face, with its corner opposite to the face.
    let mut first: BTreeMap<[usize; 3], (usize, usize)> = BTreeMap::new();
    for (cell, corners) in cells.iter().enumerate() {
        for off in 0..4 {
            let mut face = [1, 2, 3].map(|k| corners[(off + k) % 4]);
            face.sort_unstable();
            let Some(&(other, other_corner)) = first.get(&face) else {
                first.insert(face, (cell, corners[off]));
                continue;
            };
            let side = |corner: usize| {
                let [a, b, c] = face.map(|node| nodes[node]);
                tetrahedron_volume([a, b, c, nodes[corner]]) > 0.0
            };
            if side(corners[off]) == side(other_corner) {
                return Some([other, cell]);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_on_one_side_of_their_face_overlap_in_whatever_order() {
        let nodes = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.2, -1.0], [0.2, 0.2, 2.0]];
        for second in [[0, 1, 2, 4], [1, 0, 2, 4], [4, 2, 1, 0]] {
            assert_eq!(overlapping(&nodes, &[[0, 1, 2, 3], second]), None);
        }
        for second in [[0, 1, 2, 5], [1, 0, 2, 5]] {
            assert_eq!(overlapping(&nodes, &[[0, 1, 2, 3], second]), Some([0, 1]));
        }
    }
}
