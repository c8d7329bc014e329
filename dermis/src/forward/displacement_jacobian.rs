//! The derivative of a frame with respect to displacements of the mesh's nodes, by the adjoint method.
//!
//! With `A` the system matrix, `u_d` its solution for 1 A through drive `d` and `u_m` that for 1 A through measure pair
//! `m`, the voltage at `m` for `d` changes by `-u_m' dA u_d`. A corner `a` of an element that moves by `v` changes the
//! stiffness `K_ij = |e| g_i . g_j`, `g_i` the gradients of the basis functions, by
//! `|e| ((g_i . g_j)(g_a . v) - (g_i . g_a)(g_j . v) - (g_j . g_a)(g_i . v))`. A part of a contact is proportional to its
//! measure.

use super::assembly::patch_parts;
use super::contact_jacobian::{add_drops, of_channel};
use super::gradient::logarithmic_slopes;
use super::{ForwardError, ForwardModel, Matrix};
use crate::fem::Gradients;
use crate::geom::Point3;
use crate::geom::vector::dot;

/// A displacement of some nodes: each with its velocity, m per unit of the displacement.
pub type NodeVelocities = Vec<(usize, Point3)>;

impl ForwardModel {
    /// The derivative of the frame with respect to displacements of nodes, channels x displacements, ohm per unit. The
    /// [series resistances](Self::series_resistances) and the correction at the ends of arcs are held constant.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    ///
    /// # Panics
    /// If a node is not in the mesh.
    pub fn displacement_jacobian(
        &self,
        conductivity: &[f64],
        displacements: &[NodeVelocities],
    ) -> Result<Matrix, ForwardError> {
        let (nodes, electrodes) = self.solver().fields(conductivity)?;
        let fields = Fields { model: self, conductivity, nodes: &nodes, electrodes: &electrodes };
        let channels = self.protocol().channels();
        let mut jacobian = Matrix::zeros(channels.len(), displacements.len());
        let mut velocities = vec![[0.0; 3]; self.mesh().node_count()];
        for (index, displacement) in displacements.iter().enumerate() {
            displacement.iter().for_each(|&(node, velocity)| velocities[node] = velocity);
            let products = fields.products(&velocities);
            displacement.iter().for_each(|&(node, _)| velocities[node] = [0.0; 3]);
            for (channel, value) in channels.iter().enumerate() {
                *jacobian.at_mut(channel, index) = -of_channel(&products, value);
            }
        }
        Ok(jacobian)
    }
}

struct Fields<'a> {
    model: &'a ForwardModel,
    conductivity: &'a [f64],
    nodes: &'a Matrix,
    electrodes: &'a Matrix,
}

impl Fields<'_> {
    /// `u_k' dA u_l` for the fields of all electrodes `k` and `l`.
    fn products(&self, velocities: &[Point3]) -> Matrix {
        let (mesh, impedances) = (self.model.mesh(), self.model.contact_impedances());
        let count = self.electrodes.rows;
        let mut products = Matrix::zeros(count, count);
        let moves = |corners: &[usize]| corners.iter().any(|&node| velocities[node] != [0.0; 3]);
        for cell in (0..mesh.cell_count()).filter(|&cell| moves(mesh.cells.corners(cell))) {
            self.add_cell(cell, velocities, &mut products);
        }
        for (electrode, patch) in mesh.electrodes.iter().enumerate() {
            for (corners, measure) in patch_parts(mesh, patch).iter().filter(|(corners, _)| moves(corners)) {
                let slopes = logarithmic_slopes(corners, &mesh.nodes);
                let growth: f64 = corners.iter().zip(slopes).map(|(&node, slope)| dot(slope, velocities[node])).sum();
                let weight = growth * measure / impedances[electrode];
                add_drops(corners, weight, self.nodes, self.electrodes.row(electrode), &mut products);
            }
        }
        products
    }

    /// Adds `sum over i, j of u_i' dK_ij u_j` of a cell.
    fn add_cell(&self, cell: usize, velocities: &[Point3], products: &mut Matrix) {
        let corners = self.model.mesh().cells.corners(cell);
        let Gradients { of_corner, measure, .. } = Gradients::new(self.model.mesh(), cell);
        let scale = measure * self.conductivity[cell];
        for (i, &gi) in of_corner[..corners.len()].iter().enumerate() {
            for (j, &gj) in of_corner[..corners.len()].iter().enumerate() {
                let by_corner = |(&node, &ga): (&usize, &Point3)| {
                    let v = velocities[node];
                    dot(gi, gj) * dot(ga, v) - dot(gi, ga) * dot(gj, v) - dot(gj, ga) * dot(gi, v)
                };
                let weight = scale * corners.iter().zip(&of_corner).map(by_corner).sum::<f64>();
                add_outer(weight, self.nodes.row(corners[i]), self.nodes.row(corners[j]), products);
            }
        }
    }
}

/// Adds `weight * a b'`.
pub(super) fn add_outer(weight: f64, a: &[f64], b: &[f64], products: &mut Matrix) {
    for (k, a) in a.iter().enumerate() {
        let factor = weight * a;
        products.row_mut(k).iter_mut().zip(b).for_each(|(product, b)| *product += factor * b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::mesh::Mesh;

    /// Arcs with their correction, and discs: all nodes of a part of the skin are moved smoothly.
    #[test]
    fn the_derivative_is_that_of_central_differences() {
        for name in ["tank16", "cylinder30"] {
            let mut design = SkinDesign::shipped(name).unwrap();
            design.mesh = design.mesh.scaled(3.0);
            let mesh = Mesh::generate(&design).unwrap();
            let model = ForwardModel::new(&design, &mesh).unwrap();
            let rest: Vec<f64> = (0..mesh.cell_count()).map(|cell| 1.0 + 0.2 * (cell as f64).sin()).collect();
            let rest: Vec<f64> = rest.iter().zip(model.rest_conductivity()).map(|(factor, s)| factor * s).collect();
            // The series resistances are those of the conductivity.
            let model = model.with_parameters(&mesh.nodes, model.contact_impedances(), &rest).unwrap();
            let displacement: NodeVelocities = (mesh.nodes.iter().enumerate())
                .filter(|(_, at)| at[0] > 0.02)
                .map(|(node, at)| (node, [(40.0 * at[1]).sin(), (30.0 * at[0]).cos(), 0.3 * (50.0 * at[2]).sin()]))
                .collect();
            let jacobian = model.displacement_jacobian(&rest, &[displacement.clone(), Vec::new()]).unwrap();
            let step_m = 1e-7;
            let frame = |by_m: f64| {
                let mut nodes = mesh.nodes.clone();
                for (node, velocity) in &displacement {
                    (0..3).for_each(|axis| nodes[*node][axis] += by_m * velocity[axis]);
                }
                model.with_parameters(&nodes, model.contact_impedances(), &rest).unwrap().solve(&rest).unwrap()
            };
            let (below, above) = (frame(-step_m), frame(step_m));
            let expected: Vec<f64> = above.iter().zip(below.iter()).map(|(a, b)| (a - b) / (2.0 * step_m)).collect();
            let largest = expected.iter().map(|value| value.abs()).fold(0.0, f64::max);
            // The voltages are rounded, as differences of larger transfer impedances.
            let rounding = 1e-11 * above.iter().map(|value| value.abs()).fold(0.0, f64::max) / step_m;
            for (channel, expected) in expected.iter().enumerate() {
                let off = (jacobian.at(channel, 0) - expected).abs();
                assert!(off < 1e-5 * largest + rounding, "{name}, channel {channel}: {off} of {largest}");
                assert_eq!(jacobian.at(channel, 1), 0.0);
            }
        }
    }
}
