//! Mesh quality: counts, angles, edges, and each electrode compared with its design.

use crate::design::{Body, Electrode, ElectrodeShape, SkinDesign};
use crate::geom::vector::{Point3, distance, dot, norm, sub, triangle_area};
use crate::mesh::{Cells, ElectrodePatch, Mesh};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

/// Number of directions in which a clipped disc is measured: the relative error of the area decreases with its square,
/// here to 1e-8.
const DIRECTIONS: usize = 20_000;

/// Relative error of the voltages of a driven arc over the length of the edges at its ends in lengths of the arc, with a
/// contact layer `l = s z` much shorter than the edges; an edge shorter than `l` is as good as one of second order. They
/// are measured against the exact disk from 2 to 25 edges per arc (`dermis/tests/rim_arcs.rs`), where the estimate is
/// within a factor of two of the error: with the correction of the forward model, and without.
const CORRECTED: f64 = 0.012;
const UNCORRECTED: f64 = 0.6;

/// Statistics of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshReport {
    /// Number of nodes.
    pub node_count: usize,
    /// Number of cells.
    pub cell_count: usize,
    /// Smallest angle between two edges of a triangle (of a face, on tetrahedra), rad.
    pub smallest_angle_rad: f64,
    /// Shortest edge, m.
    pub shortest_edge_m: f64,
    /// Longest edge, m.
    pub longest_edge_m: f64,
    /// Closed curves of edges that belong to one triangle alone, and the number of these edges: rims and holes of a surface; 0 on
    /// tetrahedra.
    pub open_curves: [usize; 2],
    /// The size of each electrode, in their order.
    pub electrodes: Vec<ElectrodeReport>,
}

/// An electrode's size on a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElectrodeReport {
    /// Area (m2) of a patch of cells or faces, length (m) of edges, 0 for a point.
    pub size: f64,
    /// The size of the designed outline, clipped at the body's edges; `None` if the design does not define it: points,
    /// groups, and discs on a body known only by its mesh.
    pub designed_size: Option<f64>,
    /// Ends of an arc.
    pub ends: Option<ArcEndReport>,
}

/// The mesh at the ends of an arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArcEndReport {
    /// Mean length of the edges at the two ends, m.
    pub edge_m: f64,
    /// Estimate of the relative error of voltages while the electrode is driven.
    pub voltage_error: f64,
}

impl ElectrodeReport {
    /// Size over designed size.
    pub fn ratio(&self) -> Option<f64> {
        self.designed_size.map(|designed| self.size / designed)
    }
}

impl MeshReport {
    /// The report of a mesh of a design.
    pub fn new(design: &SkinDesign, mesh: &Mesh) -> Self {
        let (mut angle, mut shortest, mut longest) = (PI, f64::INFINITY, 0.0f64);
        for cell in 0..mesh.cell_count() {
            let corners = mesh.cells.corners(cell);
            for (k, &at) in corners.iter().enumerate() {
                for (i, &from) in corners.iter().enumerate().filter(|&(i, _)| i != k) {
                    let length = distance(mesh.nodes[at], mesh.nodes[from]);
                    (shortest, longest) = (shortest.min(length), longest.max(length));
                    for &to in corners[..i].iter().filter(|&&to| to != at) {
                        angle = angle.min(angle_rad(mesh.nodes[at], mesh.nodes[from], mesh.nodes[to]));
                    }
                }
            }
        }
        let designed = |index: usize| design.electrodes.get(index).and_then(|one| designed_size(&design.body, one));
        let ends = mesh.arc_ends();
        let electrode = |index: usize| ElectrodeReport {
            size: mesh.electrode_size(index),
            designed_size: designed(index),
            ends: end_report(design, mesh, &ends, index),
        };
        MeshReport {
            node_count: mesh.node_count(),
            cell_count: mesh.cell_count(),
            smallest_angle_rad: angle,
            shortest_edge_m: shortest,
            longest_edge_m: longest,
            open_curves: mesh.open_curves(),
            electrodes: (0..mesh.electrodes.len()).map(electrode).collect(),
        }
    }

    /// The arc with the largest estimated error of voltages.
    pub fn least_accurate_arc(&self) -> Option<(usize, ArcEndReport)> {
        let arcs = self.electrodes.iter().enumerate().filter_map(|(index, electrode)| Some((index, electrode.ends?)));
        arcs.max_by(|(_, a), (_, b)| a.voltage_error.total_cmp(&b.voltage_error))
    }
}

/// The edges at the ends of an arc and the error they cause; `None` for other electrodes.
fn end_report(
    design: &SkinDesign,
    mesh: &Mesh,
    ends: &BTreeMap<usize, usize>,
    electrode: usize,
) -> Option<ArcEndReport> {
    let is_end = |node: usize| ends.get(&node) == Some(&electrode);
    let (mut sum_m, mut count) = (0.0, 0.0);
    for cell in 0..mesh.cell_count() {
        let corners = mesh.cells.corners(cell);
        for &at in corners.iter().filter(|&&node| is_end(node)) {
            for &to in corners.iter().filter(|&&node| node != at) {
                sum_m += distance(mesh.nodes[at], mesh.nodes[to]);
                count += 1.0;
            }
        }
    }
    let contact_impedance = design.electrodes.get(electrode)?.contact_impedance;
    let edge_m = if count > 0.0 { sum_m / count } else { return None };
    let share = if design.mesh.correct_arc_ends { CORRECTED } else { UNCORRECTED };
    let layer_m = contact_impedance * design.sheet.conductance;
    let voltage_error = share * edge_m / mesh.electrode_size(electrode) / (1.0 + layer_m / edge_m);
    Some(ArcEndReport { edge_m, voltage_error })
}

/// The angle at a corner.
fn angle_rad(at: Point3, from: Point3, to: Point3) -> f64 {
    let (a, b) = (sub(from, at), sub(to, at));
    (dot(a, b) / (norm(a) * norm(b))).clamp(-1.0, 1.0).acos()
}

impl Mesh {
    /// The ends of arcs on a mesh of triangles, which are nodes with one edge of an electrode, and that electrode.
    pub(crate) fn arc_ends(&self) -> BTreeMap<usize, usize> {
        let mut ends = BTreeMap::new();
        for (electrode, patch) in self.electrodes.iter().enumerate() {
            let (Cells::Triangles(_), ElectrodePatch::Edges(edges)) = (&self.cells, patch) else { continue };
            let mut edge_counts: BTreeMap<usize, usize> = BTreeMap::new();
            edges.as_flattened().iter().for_each(|&node| *edge_counts.entry(node).or_default() += 1);
            ends.extend(edge_counts.into_iter().filter(|&(_, count)| count == 1).map(|(node, _)| (node, electrode)));
        }
        ends
    }

    /// Area (m2) of an electrode's patch of cells or faces, length (m) of its edges, 0 for a point.
    pub fn electrode_size(&self, electrode: usize) -> f64 {
        let length = |&[a, b]: &[usize; 2]| distance(self.nodes[a], self.nodes[b]);
        match &self.electrodes[electrode] {
            ElectrodePatch::Cells(cells) => cells.iter().map(|&cell| self.cell_measure(cell)).sum(),
            ElectrodePatch::Edges(edges) => edges.iter().map(length).sum(),
            ElectrodePatch::Faces(faces) => {
                faces.iter().map(|face| triangle_area(face.map(|node| self.nodes[node]))).sum()
            }
            ElectrodePatch::Node(_) => 0.0,
        }
    }
}

/// The size of an electrode as designed, clipped at the body's edges.
fn designed_size(body: &Body, electrode: &Electrode) -> Option<f64> {
    match electrode.shape {
        ElectrodeShape::Arc { length_m } => Some(length_m),
        ElectrodeShape::Disc { radius_m } => {
            // Bodies are convex when unrolled, so the clipped disc is star-shaped about its centre.
            let step = TAU / DIRECTIONS as f64;
            let mut twice = 0.0;
            for k in 0..DIRECTIONS {
                let reach = reach_m(body, electrode.centre_m, (k as f64 + 0.5) * step)?.clamp(0.0, radius_m);
                twice += reach * reach * step;
            }
            Some(0.5 * twice)
        }
        ElectrodeShape::Point | ElectrodeShape::Group => None,
    }
}

/// The distance to the edge of an unrolled body in a direction; `None` for a body known only by its mesh.
fn reach_m(body: &Body, centre: Point3, angle: f64) -> Option<f64> {
    let (sin, cos) = angle.sin_cos();
    let along =
        |position: f64, step: f64, size: f64| if step > 0.0 { (size - position) / step } else { -position / step };
    match *body {
        Body::Cylinder { length_m, .. } => Some(along(centre[2], sin, length_m)),
        Body::Rectangle { width_m, height_m } => {
            Some(along(centre[0], cos, width_m).min(along(centre[1], sin, height_m)))
        }
        Body::Disk { diameter_m } => {
            let outward = centre[0] * cos + centre[1] * sin;
            let square = centre[0].powi(2) + centre[1].powi(2) - (diameter_m / 2.0).powi(2);
            Some((outward * outward - square).max(0.0).sqrt() - outward)
        }
        Body::Mesh { .. } => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(centre_m: Point3, radius_m: f64) -> Electrode {
        Electrode { centre_m, shape: ElectrodeShape::Disc { radius_m }, contact_impedance: 1e-3 }
    }

    fn area(body: &Body, centre_m: Point3, radius_m: f64) -> f64 {
        designed_size(body, &disc(centre_m, radius_m)).unwrap()
    }

    #[test]
    fn clipped_discs_have_their_exact_areas() {
        let sheet = Body::Rectangle { width_m: 0.2, height_m: 0.1 };
        let whole = PI * 0.01 * 0.01;
        assert!((area(&sheet, [0.05, 0.05, 0.0], 0.01) / whole - 1.0).abs() < 1e-7);
        assert!((area(&sheet, [0.05, 0.0, 0.0], 0.01) / whole - 0.5).abs() < 1e-7);
        assert!((area(&sheet, [0.2, 0.1, 0.0], 0.01) / whole - 0.25).abs() < 1e-7);
        // A segment beyond half a radius is acos(1/2) - sqrt(3)/4 of the square of the radius.
        let segment = (0.5f64.acos() - 0.75f64.sqrt() * 0.5) / PI;
        assert!((area(&sheet, [0.05, 0.005, 0.0], 0.01) / whole - (1.0 - segment)).abs() < 1e-7);
        let tube = Body::Cylinder { length_m: 0.3, diameter_m: 0.1 };
        assert!((area(&tube, [0.05, 0.0, 0.3], 0.004) / (PI * 0.004 * 0.004) - 0.5).abs() < 1e-7);
    }

    #[test]
    fn a_disc_on_the_rim_of_a_disk_is_a_lens() {
        // Two unit circles whose centres are 1 apart overlap in 2 pi / 3 - sqrt(3) / 2.
        let overlap = area(&Body::Disk { diameter_m: 2.0 }, [0.0, 1.0, 0.0], 1.0);
        assert!((overlap / (TAU / 3.0 - 0.75f64.sqrt()) - 1.0).abs() < 1e-7, "{overlap}");
    }

    #[test]
    fn angles_and_edges_of_one_triangle() {
        let mesh = Mesh {
            nodes: vec![[0.0; 3], [3f64.sqrt(), 0.0, 0.0], [0.0, 0.0, 1.0]],
            cells: crate::mesh::Cells::Triangles(vec![[0, 1, 2]]),
            electrodes: vec![ElectrodePatch::Cells(vec![0])],
            regions: Vec::new(),
        };
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let report = MeshReport::new(&design, &mesh);
        assert!((report.smallest_angle_rad - PI / 6.0).abs() < 1e-12);
        assert!((report.shortest_edge_m - 1.0).abs() < 1e-12 && (report.longest_edge_m - 2.0).abs() < 1e-12);
        assert!((report.electrodes[0].size - 3f64.sqrt() / 2.0).abs() < 1e-12);
    }
}
