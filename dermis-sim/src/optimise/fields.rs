//! The fields of currents from candidate places, and what a weak press changes.

use super::places::with_points;
use super::touch::{PARAMETERS, TouchPoint};
use crate::elementary::{exp, ln};
use dermis::design::{ElectrodeShape, SkinDesign};
use dermis::fem::Gradients;
use dermis::forward::ForwardModel;
use dermis::geom::Point2;
use dermis::geom::vector::{Point3, cross, distance, dot, normalize, scale, sub};
use dermis::linalg::Matrix;
use dermis::mesh::{ElectrodePatch, Mesh};

/// Standard deviation of the kernel that makes a smooth field of the constant gradients of the cells, over their edges:
/// sums over a lattice of this spacing differ from the integral by less than a thousandth.
const KERNEL: f64 = 0.6;
/// Standard deviations after which the kernel ends.
const REACH: f64 = 2.5;

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

/// The fields of all candidates at the points of a press.
#[derive(Debug)]
pub(super) struct PressFields {
    pub(super) place_m: Point3,
    /// By candidate, then by point: two components, V/m.
    fields: Vec<f32>,
    /// For each point the derivatives of the change of conductance, S m2 (per m for lengths), along each pair of
    /// directions.
    weights: Vec<[[f32; 3]; PARAMETERS]>,
}

/// A place of a press, two tangents there, and the points at which it changes the conductance.
#[derive(Debug)]
pub(super) struct PressPoints {
    pub(super) place_m: Point3,
    pub(super) axes: [Point3; 2],
    pub(super) points: Vec<TouchPoint>,
}

impl Fields {
    /// The fields of candidates on a mesh with edges of `edge_m`.
    pub(super) fn new(
        design: &SkinDesign,
        positions_m: &[Point3],
        presses: &[PressPoints],
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
        let surroundings = Surroundings { mesh: &mesh, conductance: model.rest_conductivity(), potentials: &potentials };
        let count = positions_m.len();
        let mut impedance_ohm = Matrix::zeros(count, count);
        for (a, &node) in nodes.iter().enumerate() {
            impedance_ohm.row_mut(a).copy_from_slice(potentials.row(node));
            if radius_m > 0.0 {
                *impedance_ohm.at_mut(a, a) = surroundings.self_impedance_ohm(a, node, contact, edge_m);
            }
        }
        let cells = CellFields::new(&model, &potentials, &nodes, radius_m, edge_m);
        Ok(Fields {
            presses: presses.iter().map(|press| cells.at(press)).collect(),
            impedance_ohm,
            positions_m: nodes.iter().map(|&node| mesh.nodes[node]).collect(),
        })
    }

    pub(super) fn presses(&self) -> &[PressFields] {
        &self.presses
    }
}

impl PressFields {
    /// The field of a candidate at the points, two components each.
    pub(super) fn field(&self, candidate: usize) -> &[f32] {
        let count = 2 * self.weights.len();
        &self.fields[candidate * count..][..count]
    }

    pub(super) fn weights(&self) -> &[[[f32; 3]; PARAMETERS]] {
        &self.weights
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
            let to = |step: usize| {
                normalize(sub(self.mesh.nodes[corners[(own + step) % 3]], self.mesh.nodes[node]))
            };
            let angle = dot(to(1), to(2)).clamp(-1.0, 1.0).acos();
            angle_rad += angle;
            weighted += angle * self.conductance[cell];
        }
        (angle_rad, weighted / angle_rad)
    }
}

/// The fields on the cells of a mesh.
struct CellFields<'a> {
    model: &'a ForwardModel,
    potentials: &'a Matrix,
    nodes: &'a [usize],
    radius_m: f64,
    kernel_m: f64,
    centres_m: Vec<Point3>,
}

/// A cell near a point, and its share of the field there.
type Share = (usize, f64);

impl<'a> CellFields<'a> {
    fn new(model: &'a ForwardModel, potentials: &'a Matrix, nodes: &'a [usize], radius_m: f64, edge_m: f64) -> Self {
        let centres_m = (0..model.mesh().cell_count()).map(|cell| model.mesh().cell_centre(cell)).collect();
        CellFields { model, potentials, nodes, radius_m, kernel_m: KERNEL * edge_m, centres_m }
    }

    fn at(&self, press: &PressPoints) -> PressFields {
        let reach_m = press.points.iter().map(|point| distance(point.place_m, press.place_m)).fold(0.0, f64::max);
        let around: Vec<usize> = (0..self.centres_m.len())
            .filter(|&cell| distance(self.centres_m[cell], press.place_m) <= reach_m + REACH * self.kernel_m)
            .collect();
        let own: Vec<Vec<f32>> = around.iter().map(|&cell| self.of_cell(cell, press.axes)).collect();
        let shares: Vec<Vec<Share>> = press.points.iter().map(|point| self.shares(&around, point.place_m)).collect();
        let mut fields = Vec::with_capacity(2 * self.nodes.len() * shares.len());
        for candidate in 0..self.nodes.len() {
            for shares in &shares {
                for axis in 0..2 {
                    let part = |&(cell, share): &Share| share * f64::from(own[cell][2 * candidate + axis]);
                    fields.push(shares.iter().map(part).sum::<f64>() as f32);
                }
            }
        }
        let weight = |(point, shares): (&TouchPoint, &Vec<Share>)| {
            let part = |&(cell, share): &Share| share * self.model.rest_conductivity()[around[cell]];
            let conductance_s: f64 = shares.iter().map(part).sum();
            point.weights.map(|parts| parts.map(|part| (conductance_s * part) as f32))
        };
        let weights = press.points.iter().zip(&shares).map(weight).collect();
        PressFields { place_m: press.place_m, fields, weights }
    }

    /// The shares of the cells around a point: a Gaussian kernel times their areas.
    fn shares(&self, around: &[usize], place_m: Point3) -> Vec<Share> {
        let share = |(index, &cell): (usize, &usize)| {
            let away = distance(self.centres_m[cell], place_m) / self.kernel_m;
            (away <= REACH).then(|| (index, exp(-0.5 * away * away) * self.model.mesh().cell_measure(cell)))
        };
        let mut shares: Vec<Share> = around.iter().enumerate().filter_map(share).collect();
        let whole: f64 = shares.iter().map(|share| share.1).sum();
        shares.iter_mut().for_each(|share| share.1 /= whole);
        shares
    }

    /// The field of every candidate on a cell, along two tangents. Within an electrode's radius the field is
    /// that of a current that enters evenly over its area: the part of the current within the distance `d`, `(d / r)^2`,
    /// times that of the point.
    fn of_cell(&self, cell: usize, [u, v]: [Point3; 2]) -> Vec<f32> {
        let mesh = self.model.mesh();
        let (corners, gradients) = (mesh.cells.corners(cell), Gradients::new(mesh, cell));
        let [a, b, c] = [0, 1, 2].map(|corner| mesh.nodes[corners[corner]]);
        let own_normal = normalize(cross(sub(b, a), sub(c, a)));
        let first = normalize(sub(u, scale(own_normal, dot(u, own_normal))));
        let axes = [first, scale(cross(own_normal, first), dot(cross(own_normal, first), v).signum())];
        let slopes: [Point2; 3] = [0, 1, 2].map(|corner| axes.map(|axis| dot(axis, gradients.of_corner[corner])));
        let mut fields = Vec::with_capacity(2 * self.nodes.len());
        for (candidate, &node) in self.nodes.iter().enumerate() {
            let away_m = distance(self.centres_m[cell], mesh.nodes[node]);
            let inside = if away_m < self.radius_m { (away_m / self.radius_m).powi(2) } else { 1.0 };
            for axis in 0..2 {
                let slope: f64 =
                    (0..3).map(|corner| slopes[corner][axis] * self.potentials.at(corners[corner], candidate)).sum();
                fields.push((inside * slope) as f32);
            }
        }
        fields
    }
}
