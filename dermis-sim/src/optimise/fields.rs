//! The fields of currents from candidate places, and what a weak press changes.

use super::places::with_points;
use crate::bound::tangents;
use crate::elementary::{exp, ln};
use dermis::design::{ElectrodeShape, SkinDesign};
use dermis::fem::Gradients;
use dermis::forward::ForwardModel;
use dermis::geom::vector::{Point3, cross, distance, dot, normalize, sub};
use dermis::geom::{Point2, Surface};
use dermis::linalg::Matrix;
use dermis::mesh::{ElectrodePatch, Mesh};
use std::f64::consts::PI;

/// Parameters of a press: two of its position, the logarithms of its strength and of its width.
pub(super) const PARAMETERS: usize = 4;
/// Standard deviations of a press beyond which its change is left out: 4 % of its strength.
const REACH: f64 = 2.5;

/// A weak press: a Gaussian rise of the coat's conductance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Touch {
    /// The relative rise integrated over the surface, m2.
    pub(super) strength_m2: f64,
    /// Standard deviation, m.
    pub(super) width_m: f64,
}

/// The fields of unit currents from candidate places.
///
/// A press changes the voltage between `b` per ampere through `a` by `-integral d_sigma grad u_a . grad u_b` (Geselowitz,
/// 1971, DOI 10.1109/TBME.1971.4502787; Lehr, 1972, DOI 10.1109/TBME.1972.324058).
#[derive(Debug)]
pub(super) struct Fields {
    pub(super) positions_m: Vec<Point3>,
    /// Potential of each place per ampere into each, ohm; differences of rows and of columns have a meaning.
    pub(super) impedance_ohm: Matrix,
    /// Two components per cell, V/m; by place, then by cell.
    gradients: Vec<f32>,
    cell_count: usize,
    presses: Vec<PressCells>,
}

/// A press on the cells around its place.
#[derive(Debug)]
pub(super) struct PressCells {
    pub(super) place_m: Point3,
    cells: Vec<u32>,
    /// Derivatives of the change of conductance by the parameters times the area, S m2 (per m for the position).
    weights: Vec<[f32; PARAMETERS]>,
}

/// Places of presses and their outward normals.
pub(super) type Targets<'a> = &'a [(Point3, Point3)];

impl Fields {
    /// The fields of candidates on a mesh with edges of `edge_m`.
    pub(super) fn new(
        design: &SkinDesign,
        positions_m: &[Point3],
        targets: Targets<'_>,
        touch: Touch,
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
        let surface = design.body.surface();
        Ok(Fields {
            gradients: gradients(&mesh, &potentials, &nodes, radius_m),
            cell_count: mesh.cell_count(),
            presses: targets.iter().map(|target| press(&model, surface, *target, touch)).collect(),
            impedance_ohm,
            positions_m: nodes.iter().map(|&node| mesh.nodes[node]).collect(),
        })
    }

    pub(super) fn presses(&self) -> &[PressCells] {
        &self.presses
    }

    /// The field of a candidate on the cells of a press, two components each.
    pub(super) fn field<'a>(&'a self, press: &'a PressCells, candidate: usize) -> impl Iterator<Item = f32> + 'a {
        let own = &self.gradients[2 * candidate * self.cell_count..][..2 * self.cell_count];
        press.cells.iter().flat_map(|&cell| [own[2 * cell as usize], own[2 * cell as usize + 1]])
    }
}

impl PressCells {
    /// Number of components of a field on its cells.
    pub(super) fn len(&self) -> usize {
        2 * self.cells.len()
    }

    /// The weights of a component of the field.
    pub(super) fn weight(&self, component: usize) -> [f32; PARAMETERS] {
        self.weights[component / 2]
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

/// The field of every candidate on every cell. Within an electrode's radius the field is that of a current that enters
/// evenly over its area: the part of the current within the distance `d`, `(d / r)^2`, times that of the point.
fn gradients(mesh: &Mesh, potentials: &Matrix, nodes: &[usize], radius_m: f64) -> Vec<f32> {
    let (cell_count, count) = (mesh.cell_count(), nodes.len());
    let mut fields = vec![0.0f32; 2 * cell_count * count];
    for cell in 0..cell_count {
        let (corners, gradients) = (mesh.cells.corners(cell), Gradients::new(mesh, cell));
        let [a, b, c] = [0, 1, 2].map(|corner| mesh.nodes[corners[corner]]);
        let along = normalize(sub(b, a));
        let across = cross(normalize(cross(sub(b, a), sub(c, a))), along);
        let slopes: [Point2; 3] =
            [0, 1, 2].map(|corner| [along, across].map(|axis| dot(axis, gradients.of_corner[corner])));
        let centre = mesh.cell_centre(cell);
        for candidate in 0..count {
            let away_m = distance(centre, mesh.nodes[nodes[candidate]]);
            let inside = if away_m < radius_m { (away_m / radius_m).powi(2) } else { 1.0 };
            for axis in 0..2 {
                let slope: f64 =
                    (0..3).map(|corner| slopes[corner][axis] * potentials.at(corners[corner], candidate)).sum();
                fields[2 * (candidate * cell_count + cell) + axis] = (inside * slope) as f32;
            }
        }
    }
    fields
}

fn press(model: &ForwardModel, surface: Surface, (place_m, normal): (Point3, Point3), touch: Touch) -> PressCells {
    let mesh = model.mesh();
    let Touch { strength_m2, width_m } = touch;
    let [u, v] = tangents(normal);
    let from = |centre: Point3| match surface {
        Surface::Free => [dot(u, sub(centre, place_m)), dot(v, sub(centre, place_m))],
        surface => surface.chart(place_m, centre),
    };
    let (mut cells, mut weights) = (Vec::new(), Vec::new());
    for cell in 0..mesh.cell_count() {
        let centre = mesh.cell_centre(cell);
        if distance(centre, place_m) > REACH * width_m {
            continue;
        }
        let [x, y] = from(centre).map(|along| along / width_m);
        let square = x * x + y * y;
        let rise = strength_m2 / (2.0 * PI * width_m * width_m) * exp(-0.5 * square);
        let change = rise * model.rest_conductivity()[cell] * mesh.cell_measure(cell);
        cells.push(cell as u32);
        weights.push([x / width_m, y / width_m, 1.0, square - 2.0].map(|factor| (change * factor) as f32));
    }
    PressCells { place_m, cells, weights }
}
