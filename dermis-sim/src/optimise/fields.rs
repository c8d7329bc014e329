//! The fields of currents from candidate places, and what a weak press changes.

use super::local::COMPONENTS;
use super::places::with_points;
use super::touch::{PARAMETERS, Response};
use crate::elementary::ln;
use dermis::design::{ElectrodeShape, SkinDesign};
use dermis::forward::ForwardModel;
use dermis::geom::vector::{Point3, distance, dot, normalize, sub};
use dermis::linalg::Matrix;
use dermis::mesh::{ElectrodePatch, Mesh};

/// The fields of unit currents from candidate places.
///
/// A press changes the voltage between `b` per ampere through `a` by `-integral d_sigma grad u_a . grad u_b` (Geselowitz,
/// 1971, DOI 10.1109/TBME.1971.4502787; Lehr, 1972, DOI 10.1109/TBME.1972.324058).
#[derive(Debug)]
pub(super) struct Fields {
    pub(super) positions_m: Vec<Point3>,
    /// Potential of each place per ampere into each, ohm; differences of rows and of columns have a meaning.
    pub(super) impedance_ohm: Matrix,
    presses: Vec<PressFields>,
}

/// The fields of all candidates around a press, and its answers.
#[derive(Debug)]
pub(super) struct PressFields {
    pub(super) place_m: Point3,
    /// By candidate the coefficients of its field.
    fields: Vec<[f32; COMPONENTS]>,
    matrix: [[[f32; PARAMETERS]; COMPONENTS]; COMPONENTS],
}

impl Fields {
    /// The fields of candidates on a mesh with edges of `edge_m`.
    pub(super) fn new(
        design: &SkinDesign,
        positions_m: &[Point3],
        responses: &[Response],
        edge_m: f64,
    ) -> crate::Result<Self> {
        let points = with_points(design, positions_m, edge_m)?;
        let mesh = Mesh::generate(&points)?;
        let model = ForwardModel::new(&points, &mesh)?;
        let potentials = model.potentials(model.rest_conductivity())?;
        let nodes = electrode_nodes(&mesh);
        let electrode = &design.electrodes[0];
        let radius_m = effective_radius_m(electrode.shape);
        let contact = Contact { radius_m, impedance: electrode.contact_impedance, shape: electrode.shape };
        let surroundings =
            Surroundings { mesh: &mesh, conductance: model.rest_conductivity(), potentials: &potentials };
        let count = positions_m.len();
        let mut impedance_ohm = Matrix::zeros(count, count);
        for (a, &node) in nodes.iter().enumerate() {
            impedance_ohm.row_mut(a).copy_from_slice(potentials.row(node));
            if radius_m > 0.0 {
                *impedance_ohm.at_mut(a, a) = surroundings.self_impedance_ohm(a, node, contact, edge_m);
            }
        }
        let press = |response: &Response| {
            let found = response.around.coefficients(&mesh.nodes, &potentials);
            let of = |candidate: usize| std::array::from_fn(|component| found.at(component, candidate) as f32);
            PressFields {
                place_m: response.around.place_m,
                fields: (0..count).map(of).collect(),
                matrix: response.matrix.map(|row| row.map(|values| values.map(|value| value as f32))),
            }
        };
        Ok(Fields {
            presses: responses.iter().map(press).collect(),
            impedance_ohm,
            positions_m: nodes.iter().map(|&node| mesh.nodes[node]).collect(),
        })
    }

    pub(super) fn presses(&self) -> &[PressFields] {
        &self.presses
    }
}

impl PressFields {
    /// The coefficients of a candidate's field.
    pub(super) fn field(&self, candidate: usize) -> &[f32; COMPONENTS] {
        &self.fields[candidate]
    }

    /// `M g` for every parameter.
    pub(super) fn answered(&self, field: &[f32; COMPONENTS]) -> [[f32; PARAMETERS]; COMPONENTS] {
        let mut answered = [[0.0; PARAMETERS]; COMPONENTS];
        for (sum, row) in answered.iter_mut().zip(&self.matrix) {
            for (values, &part) in row.iter().zip(field) {
                sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value * part);
            }
        }
        answered
    }
}

fn electrode_nodes(mesh: &Mesh) -> Vec<usize> {
    let node = |patch: &ElectrodePatch| match patch {
        ElectrodePatch::Node(node) => *node,
        _ => unreachable!("every candidate is a point"),
    };
    mesh.electrodes.iter().map(node).collect()
}

/// The radius of the disc with the spreading resistance of an electrode, m: a straight electrode of length `l` has a
/// quarter of it (the transfinite diameter of a segment).
fn effective_radius_m(shape: ElectrodeShape) -> f64 {
    match shape {
        ElectrodeShape::Disc { radius_m } => radius_m,
        ElectrodeShape::Arc { length_m } => 0.25 * length_m,
        ElectrodeShape::Point | ElectrodeShape::Group => 0.0,
    }
}

#[derive(Clone, Copy)]
struct Contact {
    radius_m: f64,
    impedance: f64,
    shape: ElectrodeShape,
}

/// The coat around a candidate.
struct Surroundings<'a> {
    mesh: &'a Mesh,
    conductance: &'a [f64],
    potentials: &'a Matrix,
}

impl Surroundings<'_> {
    /// The potential of an electrode per ampere into it, ohm: that of the point's field on the nodes around it, continued
    /// to the electrode's radius by the logarithm of a line source in a sheet with the angle of the cells around, and the
    /// contact.
    fn self_impedance_ohm(&self, candidate: usize, node: usize, contact: Contact, edge_m: f64) -> f64 {
        let Contact { radius_m, impedance, shape } = contact;
        let (angle_rad, conductance_s) = self.around(node);
        let slope_ohm = 1.0 / (angle_rad * conductance_s);
        let reach_m = 2.0 * edge_m.max(radius_m);
        let centre = self.mesh.nodes[node];
        let (mut sum, mut count) = (0.0, 0.0);
        for (other, place) in self.mesh.nodes.iter().enumerate() {
            let away_m = distance(*place, centre);
            if away_m > 0.0 && away_m < reach_m {
                sum += self.potentials.at(other, candidate) + slope_ohm * ln(away_m / radius_m);
                count += 1.0;
            }
        }
        let contact_ohm = match shape {
            ElectrodeShape::Disc { radius_m } => impedance / (0.5 * angle_rad * radius_m * radius_m),
            ElectrodeShape::Arc { length_m } => impedance / length_m,
            ElectrodeShape::Point | ElectrodeShape::Group => 0.0,
        };
        if count > 0.0 { sum / count + contact_ohm } else { self.potentials.at(node, candidate) + contact_ohm }
    }

    /// The angle of the cells at a node, rad, and their mean conductance, S.
    fn around(&self, node: usize) -> (f64, f64) {
        let (mut angle_rad, mut weighted) = (0.0, 0.0);
        for cell in 0..self.mesh.cell_count() {
            let corners = self.mesh.cells.corners(cell);
            let Some(own) = corners.iter().position(|&corner| corner == node) else { continue };
            let to = |step: usize| normalize(sub(self.mesh.nodes[corners[(own + step) % 3]], self.mesh.nodes[node]));
            let angle = dot(to(1), to(2)).clamp(-1.0, 1.0).acos();
            angle_rad += angle;
            weighted += angle * self.conductance[cell];
        }
        (angle_rad, weighted / angle_rad)
    }
}
