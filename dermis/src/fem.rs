//! Element matrices of linear triangles in space and linear tetrahedra.
//!
//! On a cell of measure `|e|` (area or volume) the basis function of corner `i` has the constant gradient `g_i`; the
//! stiffness matrix at unit conductivity is `K_ij = |e| g_i . g_j`, and the mass matrix of an edge, triangle or
//! tetrahedron with `n` corners is `M_ij = |e| (1 + delta_ij) / (n (n + 1))`
//! (Zienkiewicz and Taylor, The Finite Element Method, 5th ed. 2000, section 4.3 and 8.8).

use crate::geom::vector::{Point3, cross, dot, norm, scale, sub};
use crate::mesh::{Cells, Mesh};

/// Gradients of the basis functions of one cell, and its measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gradients {
    /// One gradient per corner, 1/m; a triangle's lie in its plane and the last is unused (zero).
    pub(crate) of_corner: [Point3; 4],
    /// Number of corners: 3 or 4.
    pub(crate) corner_count: usize,
    /// Area, m2, or volume, m3.
    pub(crate) measure: f64,
}

impl Gradients {
    /// The gradients on a cell of a mesh.
    pub fn new(mesh: &Mesh, cell: usize) -> Self {
        match &mesh.cells {
            Cells::Triangles(cells) => triangle_gradients(cells[cell].map(|node| mesh.nodes[node])),
            Cells::Tetrahedra(cells) => tetrahedron_gradients(cells[cell].map(|node| mesh.nodes[node])),
        }
    }

    /// Entry `(i, j)` of the stiffness matrix at unit conductivity.
    pub(crate) fn stiffness(&self, i: usize, j: usize) -> f64 {
        self.measure * dot(self.of_corner[i], self.of_corner[j])
    }
}

/// `g_i = n x e_i / (2 |e|)`, with `e_i` the edge opposite to corner `i` and `n` the unit normal.
fn triangle_gradients(corners: [Point3; 3]) -> Gradients {
    let [a, b, c] = corners;
    let edges = [sub(c, b), sub(a, c), sub(b, a)];
    let twice_normal = cross(edges[0], edges[1]);
    let twice_area = norm(twice_normal);
    let mut of_corner = [[0.0; 3]; 4];
    for (gradient, edge) in of_corner.iter_mut().zip(edges) {
        *gradient = scale(cross(twice_normal, edge), 1.0 / (twice_area * twice_area));
    }
    Gradients { of_corner, corner_count: 3, measure: 0.5 * twice_area }
}

/// `g_i = -(area vector of the face opposite to corner i, outward) / (3 |e|)`.
fn tetrahedron_gradients(corners: [Point3; 4]) -> Gradients {
    let [a, b, c, d] = corners;
    let six_volumes = dot(cross(sub(b, a), sub(c, a)), sub(d, a));
    let normals = [
        cross(sub(d, b), sub(c, b)),
        cross(sub(c, a), sub(d, a)),
        cross(sub(d, a), sub(b, a)),
        cross(sub(b, a), sub(c, a)),
    ];
    Gradients {
        of_corner: normals.map(|normal| scale(normal, 1.0 / six_volumes)),
        corner_count: 4,
        measure: six_volumes / 6.0,
    }
}

/// Entry `(i, j)` of the mass matrix of a simplex with `corner_count` corners and the given measure.
pub(crate) fn mass(corner_count: usize, measure: f64, i: usize, j: usize) -> f64 {
    let share = measure / (corner_count * (corner_count + 1)) as f64;
    if i == j { 2.0 * share } else { share }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exact property of linear elements: the gradient of a linear function is reproduced.
    #[test]
    fn a_linear_function_has_its_own_gradient() {
        let slope = [0.3, -1.7, 2.2];
        let corners = [[0.1, 0.0, 0.2], [1.3, 0.1, -0.1], [0.2, 0.9, 0.3], [0.1, 0.2, 1.4]];
        let tetrahedron = tetrahedron_gradients(corners);
        let mut sum = [0.0; 3];
        for (gradient, corner) in tetrahedron.of_corner.iter().zip(corners) {
            sum = crate::geom::vector::add(sum, scale(*gradient, dot(slope, corner)));
        }
        assert!(norm(sub(sum, slope)) < 1e-14);

        let triangle = triangle_gradients([corners[0], corners[1], corners[2]]);
        let mut sum = [0.0; 3];
        for (gradient, corner) in triangle.of_corner.iter().zip(corners) {
            sum = crate::geom::vector::add(sum, scale(*gradient, dot(slope, corner)));
        }
        let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
        let along = scale(normal, dot(slope, normal) / dot(normal, normal));
        assert!(norm(sub(sum, sub(slope, along))) < 1e-14);
    }
}
