//! The field of a current around a place, as harmonic polynomials.

use crate::elementary::exp;
use dermis::geom::vector::{Point3, distance, dot, sub};
use dermis::geom::{Point2, Surface};
use dermis::linalg::{Cholesky, Matrix};

/// Real and imaginary parts of the powers 1 to 3 of the place: the field, its slope and its curvature. What a press
/// answers to higher powers falls with the size of its contact over the distance of the electrodes.
pub(super) const COMPONENTS: usize = 6;
/// Standard deviation of the weights of the nodes over the radius, and where they end.
const WEIGHT: f64 = 0.6;
const REACH: f64 = 1.5;
/// Relative diagonal of the normal equations: nodes on one side of an edge hardly tell some powers apart.
const RIDGE: f64 = 1e-9;

/// Where a field is described, and how far around.
#[derive(Debug, Clone, Copy)]
pub(super) struct Neighbourhood {
    pub(super) surface: Surface,
    pub(super) place_m: Point3,
    /// Two tangents, for a body without a chart.
    pub(super) tangents: [Point3; 2],
    pub(super) radius_m: f64,
}

impl Neighbourhood {
    fn chart(&self, point: Point3) -> Point2 {
        match self.surface {
            Surface::Free => self.tangents.map(|tangent| dot(tangent, sub(point, self.place_m))),
            surface => surface.chart(self.place_m, point),
        }
    }

    /// Whether a point belongs to it.
    pub(super) fn holds(&self, point: Point3) -> bool {
        distance(point, self.place_m) <= REACH * self.radius_m
    }

    /// The coefficients of the columns of some potentials (nodes x columns), COMPONENTS x columns, V: least squares over
    /// the nodes around, nearer ones counting more.
    pub(super) fn coefficients(&self, nodes_m: &[Point3], potentials: &Matrix) -> Matrix {
        let near: Vec<usize> = (0..nodes_m.len()).filter(|&node| self.holds(nodes_m[node])).collect();
        let rows: Vec<([f64; COMPONENTS + 1], f64)> = near.iter().map(|&node| self.row(nodes_m[node])).collect();
        let order = COMPONENTS + 1;
        let mut normal = Matrix::zeros(order, order);
        for (row, weight) in &rows {
            for i in 0..order {
                (0..order).for_each(|j| *normal.at_mut(i, j) += weight * row[i] * row[j]);
            }
        }
        let trace: f64 = (0..order).map(|i| normal.at(i, i)).sum();
        (0..order).for_each(|i| *normal.at_mut(i, i) += RIDGE * trace.max(f64::MIN_POSITIVE));
        let mut coefficients = Matrix::zeros(COMPONENTS, potentials.columns);
        let Ok(factor) = Cholesky::new(&normal) else { return coefficients };
        for (&node, (row, weight)) in near.iter().zip(&rows) {
            let solved = factor.solve(row);
            // The first power is the constant, which drives no current.
            for (component, solved) in solved[1..].iter().enumerate() {
                let factor = weight * solved;
                let target = coefficients.row_mut(component);
                target.iter_mut().zip(potentials.row(node)).for_each(|(sum, value)| *sum += factor * value);
            }
        }
        coefficients
    }

    /// The powers at a point, and its weight.
    fn row(&self, point: Point3) -> ([f64; COMPONENTS + 1], f64) {
        let [x, y] = self.chart(point).map(|along| along / self.radius_m);
        let mut row = [1.0; COMPONENTS + 1];
        let (mut real, mut imaginary) = (1.0, 0.0);
        for power in 0..COMPONENTS / 2 {
            (real, imaginary) = (real * x - imaginary * y, real * y + imaginary * x);
            (row[1 + 2 * power], row[2 + 2 * power]) = (real, imaginary);
        }
        (row, exp(-0.5 * (x * x + y * y) / (WEIGHT * WEIGHT)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_harmonic_potential_has_its_own_coefficients() {
        let around = Neighbourhood {
            surface: Surface::Plane,
            place_m: [0.05, 0.04, 0.0],
            tangents: [[0.0; 3]; 2],
            radius_m: 0.01,
        };
        let nodes: Vec<Point3> =
            (0..900).map(|k| [0.03 + 0.0015 * f64::from(k % 30), 0.02 + 0.0015 * f64::from(k / 30), 0.0]).collect();
        let mut potentials = Matrix::zeros(nodes.len(), 1);
        for (node, [x, y, _]) in nodes.iter().enumerate() {
            let (x, y) = ((x - 0.05) / 0.01, (y - 0.04) / 0.01);
            potentials.values[node] = 7.0 + 2.0 * x - y + 0.5 * (x * x - y * y) + 0.3 * (3.0 * x * x * y - y * y * y);
        }
        let found = around.coefficients(&nodes, &potentials);
        for (value, expected) in found.values.iter().zip([2.0, -1.0, 0.5, 0.0, 0.0, 0.3]) {
            assert!((value - expected).abs() < 1e-6, "{found:?}");
        }
    }
}
