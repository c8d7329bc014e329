//! Degenerate cells.

use crate::geom::Point3;
use crate::geom::vector::{self, distance};
use crate::mesh::{Cells, Mesh};

/// A cell whose measure is this fraction of that of a cube of its longest edge is degenerate: rounding errors are of
/// this size.
const FLAT: f64 = 1e-12;

pub(super) fn is_flat(mesh: &Mesh, cell: usize) -> bool {
    match &mesh.cells {
        Cells::Triangles(cells) => is_flat_triangle(cells[cell].map(|node| mesh.nodes[node])),
        Cells::Tetrahedra(cells) => {
            let corners = cells[cell].map(|node| mesh.nodes[node]);
            vector::tetrahedron_volume(corners).abs() <= FLAT * longest(&corners).powi(3)
        }
    }
}

pub(super) fn is_flat_triangle(corners: [Point3; 3]) -> bool {
    vector::triangle_area(corners) <= FLAT * longest(&corners).powi(2)
}

fn longest(corners: &[Point3]) -> f64 {
    let pairs = corners.iter().flat_map(|a| corners.iter().map(|b| distance(*a, *b)));
    pairs.fold(0.0, f64::max)
}
