//! Small structured meshes with known answers.

use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use std::f64::consts::TAU;

/// A fan of rings around the origin: node 0 in the centre, then `sectors` nodes (one more if open) per radius. Returns
/// the mesh without electrodes; triangles are ordered by rings from the inside.
pub fn polar(radii: &[f64], sectors: usize, angle_rad: f64) -> Mesh {
    let closed = (angle_rad - TAU).abs() < 1e-12;
    let per_ring = if closed { sectors } else { sectors + 1 };
    let mut nodes = vec![[0.0; 3]];
    for &radius in radii {
        for k in 0..per_ring {
            let (sin, cos) = (angle_rad * k as f64 / sectors as f64).sin_cos();
            nodes.push([radius * cos, radius * sin, 0.0]);
        }
    }
    let node = |ring: usize, k: usize| 1 + ring * per_ring + if closed { k % sectors } else { k };
    let mut cells = Vec::new();
    for k in 0..sectors {
        cells.push([0, node(0, k), node(0, k + 1)]);
    }
    for ring in 1..radii.len() {
        for k in 0..sectors {
            let (a, b, c, d) = (node(ring - 1, k), node(ring, k), node(ring, k + 1), node(ring - 1, k + 1));
            cells.extend([[a, b, c], [a, c, d]]);
        }
    }
    Mesh { nodes, cells: Cells::Triangles(cells), electrodes: Vec::new(), regions: Vec::new() }
}

/// Number of triangles of [`polar`] within its first `rings` radii.
pub fn polar_cells(rings: usize, sectors: usize) -> usize {
    sectors * (2 * rings - 1)
}

/// The edges of the outermost ring of a closed [`polar`].
pub fn polar_rim(radii: &[f64], sectors: usize) -> Vec<[usize; 2]> {
    let start = 1 + (radii.len() - 1) * sectors;
    (0..sectors).map(|k| [start + k, start + (k + 1) % sectors]).collect()
}

/// A rectangular strip `length x width` of `nx x ny` squares, two triangles each; node `(i, j)` is `j * (nx + 1) + i`.
/// Electrodes 0 and 1 are its ends, 2 and 3 points on the lower edge at one and two thirds (`nx` a multiple of 3).
pub fn strip(length: f64, width: f64, nx: usize, ny: usize) -> Mesh {
    let node = |i: usize, j: usize| j * (nx + 1) + i;
    let mut nodes = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            nodes.push([length * i as f64 / nx as f64, width * j as f64 / ny as f64, 0.0]);
        }
    }
    let mut cells = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            cells.push([node(i, j), node(i + 1, j), node(i + 1, j + 1)]);
            cells.push([node(i, j), node(i + 1, j + 1), node(i, j + 1)]);
        }
    }
    let end = |i: usize| ElectrodePatch::Edges((0..ny).map(|j| [node(i, j), node(i, j + 1)]).collect());
    let electrodes =
        vec![end(0), end(nx), ElectrodePatch::Node(node(nx / 3, 0)), ElectrodePatch::Node(node(2 * nx / 3, 0))];
    Mesh { nodes, cells: Cells::Triangles(cells), electrodes, regions: Vec::new() }
}

/// A block of `n[0] x n[1] x n[2]` boxes, six tetrahedra each (Kuhn's subdivision), with side lengths `size`.
/// Electrodes 0 and 1 are the faces x = 0 and x = size; 2 and 3 points at one and two thirds of an edge along x.
pub fn block(size: [f64; 3], n: [usize; 3]) -> Mesh {
    let node = |p: [usize; 3]| (p[2] * (n[1] + 1) + p[1]) * (n[0] + 1) + p[0];
    let mut nodes = Vec::new();
    for k in 0..=n[2] {
        for j in 0..=n[1] {
            for i in 0..=n[0] {
                nodes.push([
                    size[0] * i as f64 / n[0] as f64,
                    size[1] * j as f64 / n[1] as f64,
                    size[2] * k as f64 / n[2] as f64,
                ]);
            }
        }
    }
    let mut cells = Vec::new();
    let axes = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                for order in axes {
                    let mut at = [i, j, k];
                    let mut corners = vec![node(at)];
                    for axis in order {
                        at[axis] += 1;
                        corners.push(node(at));
                    }
                    let odd = matches!(order, [0, 2, 1] | [1, 0, 2] | [2, 1, 0]);
                    let [a, b, c, d] = [corners[0], corners[1], corners[2], corners[3]];
                    cells.push(if odd { [a, c, b, d] } else { [a, b, c, d] });
                }
            }
        }
    }
    let end = |i: usize| {
        let mut faces = Vec::new();
        for k in 0..n[2] {
            for j in 0..n[1] {
                let quad = [node([i, j, k]), node([i, j + 1, k]), node([i, j + 1, k + 1]), node([i, j, k + 1])];
                faces.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
            }
        }
        ElectrodePatch::Faces(faces)
    };
    let electrodes = vec![
        end(0),
        end(n[0]),
        ElectrodePatch::Node(node([n[0] / 3, 0, 0])),
        ElectrodePatch::Node(node([2 * n[0] / 3, 0, 0])),
    ];
    Mesh { nodes, cells: Cells::Tetrahedra(cells), electrodes, regions: Vec::new() }
}
