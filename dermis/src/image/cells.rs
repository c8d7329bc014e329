//! One pixel per mesh cell.

use crate::geom::vector::{Point3, add, cross, normalize, scale, sub};
use crate::geom::{Surface, vector};
use crate::image::PixelSpace;
use crate::mesh::{Cells, Mesh};
use std::collections::{HashMap, VecDeque};

pub(super) fn pixels(mesh: &Mesh, surface: Surface) -> PixelSpace {
    let count = mesh.cell_count();
    let centres_m: Vec<Point3> = (0..count).map(|cell| mesh.cell_centre(cell)).collect();
    let (neighbours, normals) = match &mesh.cells {
        Cells::Triangles(triangles) => {
            let sides = |t: &[usize; 3]| [vec![t[0], t[1]], vec![t[1], t[2]], vec![t[2], t[0]]];
            let (neighbours, _) = adjacency(triangles.iter().map(sides));
            let normal = |(cell, corners): (usize, &[usize; 3])| {
                surface.normal(centres_m[cell]).unwrap_or_else(|| face_normal(corners.map(|node| mesh.nodes[node])))
            };
            (neighbours, triangles.iter().enumerate().map(normal).collect())
        }
        Cells::Tetrahedra(tetrahedra) => {
            let sides = |t: &[usize; 4]| [0, 1, 2, 3].map(|left_out| face_opposite(t, left_out).to_vec());
            let (neighbours, outside) = adjacency(tetrahedra.iter().map(sides));
            let normals = volume_normals(mesh, tetrahedra, &neighbours, &outside);
            (neighbours, normals)
        }
    };
    PixelSpace {
        surface,
        grid: None,
        position_in_grid: (0..count).collect(),
        centres_m,
        normals,
        areas: (0..count).map(|cell| mesh.cell_measure(cell)).collect(),
        neighbours,
        edge_m: Vec::new(),
        overlaps: (0..count).map(|cell| vec![(cell, 1.0)]).collect(),
    }
}

/// The three corners of a tetrahedron's face opposite to a corner.
fn face_opposite(corners: &[usize; 4], left_out: usize) -> [usize; 3] {
    let mut others = corners.iter().enumerate().filter(|&(index, _)| index != left_out).map(|(_, &node)| node);
    std::array::from_fn(|_| others.next().expect("three corners remain of four"))
}

/// For each cell, given the nodes of its sides, the cells that share a side; and the sides that belong to only one
/// cell, as (cell, side).
fn adjacency<const N: usize>(sides: impl Iterator<Item = [Vec<usize>; N]>) -> (Vec<Vec<usize>>, Vec<(usize, usize)>) {
    let mut owners: HashMap<Vec<usize>, Vec<(usize, usize)>> = HashMap::new();
    let mut count = 0;
    for (cell, sides) in sides.enumerate() {
        count = cell + 1;
        for (side, mut nodes) in sides.into_iter().enumerate() {
            nodes.sort_unstable();
            owners.entry(nodes).or_default().push((cell, side));
        }
    }
    let mut neighbours = vec![Vec::new(); count];
    let mut outside = Vec::new();
    for cells in owners.into_values() {
        if let [only] = cells[..] {
            outside.push(only);
        }
        for &(cell, _) in &cells {
            neighbours[cell].extend(cells.iter().map(|&(other, _)| other).filter(|&other| other != cell));
        }
    }
    neighbours.iter_mut().for_each(|list| list.sort_unstable());
    outside.sort_unstable();
    (neighbours, outside)
}

fn face_normal([a, b, c]: [Point3; 3]) -> Point3 {
    normalize(cross(sub(b, a), sub(c, a)))
}

/// Outward normals of cells with an outer face (the mean of its outer faces), propagated inwards from neighbour to
/// neighbour.
fn volume_normals(
    mesh: &Mesh,
    tetrahedra: &[[usize; 4]],
    neighbours: &[Vec<usize>],
    outside: &[(usize, usize)],
) -> Vec<Point3> {
    let mut sums = vec![[0.0; 3]; tetrahedra.len()];
    for &(cell, side) in outside {
        let face = face_opposite(&tetrahedra[cell], side).map(|node| mesh.nodes[node]);
        let mut area = scale(cross(sub(face[1], face[0]), sub(face[2], face[0])), 0.5);
        let inwards = sub(mesh.nodes[tetrahedra[cell][side]], face[0]);
        if vector::dot(area, inwards) > 0.0 {
            area = scale(area, -1.0);
        }
        sums[cell] = add(sums[cell], area);
    }
    let mut normals: Vec<Option<Point3>> = vec![None; tetrahedra.len()];
    let mut queue = VecDeque::new();
    for &(cell, _) in outside {
        if normals[cell].is_none() {
            normals[cell] = Some(normalize(sums[cell]));
            queue.push_back(cell);
        }
    }
    while let Some(cell) = queue.pop_front() {
        for &other in &neighbours[cell] {
            if normals[other].is_none() {
                normals[other] = normals[cell];
                queue.push_back(other);
            }
        }
    }
    normals.into_iter().map(|normal| normal.expect("every part of a finite mesh has an outside")).collect()
}
