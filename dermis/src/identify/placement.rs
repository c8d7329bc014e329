//! Displacements and sizes of electrodes, and the body's, as displacements of the mesh's nodes.

use crate::design::{Body, SkinDesign};
use crate::forward::NodeVelocities;
use crate::geom::vector::{add, cross, distance, dot, node_normals, normalize, scale, sub};
use crate::geom::{Point3, Surface};
use crate::identify::IdentifyOptions;
use crate::mesh::{Cells, ElectrodePatch, Mesh};
use std::collections::HashMap;

/// The nodes within this many radii of an electrode's centre move with it.
const RIGID_RADII: f64 = 1.2;
/// Those beyond this many stay; those between move in part.
const REACH_RADII: f64 = 4.5;
/// At most this fraction of the distance to the next electrode.
const REACH_SHARE: f64 = 0.45;
/// An electrode whose centre is this close to the body's edge lies on it, m.
const ON_EDGE_M: f64 = 1e-6;
/// Step of the difference quotient of a displacement along the surface, m, or relative: its square over that of a radius is
/// far below the error of the model.
const STEP: f64 = 1e-4;

/// One way in which nodes may be displaced: one electrode in one direction (m), the radius of all electrodes or the body along
/// one axis (relative).
#[derive(Debug, Clone)]
pub(super) struct Displacement {
    /// The electrode and its direction in the surface's chart, or in the tangent plane of a body from a mesh; `None` for a
    /// change of size.
    pub electrode: Option<(usize, [f64; 2])>,
    /// Standard deviation of its prior.
    pub sd: f64,
    nodes: Moved,
}

/// The nodes that move, with their displacements for a displacement by one unit.
#[derive(Debug, Clone)]
enum Moved {
    /// In the surface's chart.
    Along(Vec<(usize, [f64; 2])>),
    /// In the tangent planes of a mesh.
    Straight(NodeVelocities),
}

impl Displacement {
    /// The velocities of the nodes, m per unit of displacement.
    pub(super) fn velocities(&self, surface: &Surface, nodes_m: &[Point3]) -> NodeVelocities {
        let velocity = |&(node, unit): &(usize, [f64; 2])| {
            let at = |by: f64| surface.walk(nodes_m[node], unit.map(|axis| axis * by));
            (node, scale(sub(at(STEP), at(-STEP)), 0.5 / STEP))
        };
        match &self.nodes {
            Moved::Along(nodes) => nodes.iter().map(velocity).collect(),
            Moved::Straight(velocities) => velocities.clone(),
        }
    }

    /// Adds a displacement to the nodes.
    pub(super) fn apply(&self, surface: &Surface, by: f64, nodes_m: &mut [Point3]) {
        match &self.nodes {
            Moved::Along(nodes) => {
                for &(node, unit) in nodes {
                    nodes_m[node] = surface.walk(nodes_m[node], unit.map(|axis| axis * by));
                }
            }
            Moved::Straight(velocities) => {
                velocities.iter().for_each(|&(node, unit)| nodes_m[node] = add(nodes_m[node], scale(unit, by)));
            }
        }
    }
}

/// The displacements of all electrodes that are patches of cells, in both directions or along the edge that they are on, of those
/// that are parts of the edge of a flat body along it, and, on a body with a chart, of the sizes that have a deviation.
pub(super) fn displacements(design: &SkinDesign, mesh: &Mesh, options: &IdentifyOptions) -> Vec<Displacement> {
    let surface = design.body.surface();
    if surface == Surface::Free {
        return in_tangent_planes(design, mesh, options.displacement_m);
    }
    let (mut all, mut wider) = (Vec::new(), Vec::new());
    let (mut longer, in_chart) = longer(&design.body, mesh);
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        let centre_m = design.electrodes[electrode].centre_m;
        let directions = match patch {
            ElectrodePatch::Cells(_) => directions(&design.body, centre_m),
            ElectrodePatch::Edges(edges) if surface == Surface::Plane => along(mesh, edges).into_iter().collect(),
            _ => continue,
        };
        let nodes = moving(design, mesh, electrode);
        let sd = options.displacement_m / (directions.len() as f64).sqrt();
        all.extend(directions.into_iter().map(|direction| {
            let at = |node: usize| kept_on_rim(&design.body, centre_m, mesh.nodes[node], direction);
            let nodes = nodes.iter().map(|&(node, part)| (node, at(node).map(|axis| axis * part))).collect();
            Displacement { electrode: Some((electrode, direction)), sd, nodes: Moved::Along(nodes) }
        }));
        let from_centre = |&(node, part): &(usize, f64)| {
            let by = surface.chart(centre_m, mesh.nodes[node]).map(|axis| axis * part);
            (node, kept_on_rim(&design.body, centre_m, mesh.nodes[node], by))
        };
        wider.extend(nodes.iter().map(from_centre));
        // The electrodes move with the body, but keep their shape.
        for (node, by) in nodes.iter().map(from_centre) {
            if let Some((_, longer)) = longer.get_mut(node) {
                (0..2).for_each(|axis| longer[axis] -= in_chart[axis] * by[axis]);
            }
        }
    }
    let sizes = [(options.radius_sd, wider), (options.length_sd, longer)];
    let sizes = sizes.into_iter().filter(|(sd, nodes)| *sd > 0.0 && !nodes.is_empty());
    all.extend(sizes.map(|(sd, nodes)| Displacement { electrode: None, sd, nodes: Moved::Along(nodes) }));
    all
}

/// The displacements of electrodes that are patches of cells on a body known only by its mesh: in two directions of the tangent
/// plane of the patch, each node in its own tangent plane; along the edge of the mesh for a patch that is on it.
fn in_tangent_planes(design: &SkinDesign, mesh: &Mesh, displacement_m: f64) -> Vec<Displacement> {
    let triangles = if let Cells::Triangles(triangles) = &mesh.cells { &triangles[..] } else { &[] };
    let normals = node_normals(&mesh.nodes, triangles.iter().copied());
    let edge = edge_nodes(mesh);
    let edge_m = |at: Point3| edge.keys().map(|&node| distance(mesh.nodes[node], at)).fold(f64::INFINITY, f64::min);
    let mut all = Vec::new();
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        if !matches!(patch, ElectrodePatch::Cells(_)) {
            continue;
        }
        let own = mesh.electrode_nodes(electrode);
        let normal = normalize(own.iter().fold([0.0; 3], |sum, &node| add(sum, normals[node])));
        let along_edge = own.iter().find_map(|node| edge.get(node));
        let directions: Vec<([f64; 2], Point3)> = match along_edge {
            Some(&along) => vec![([1.0, 0.0], along)],
            None => {
                let mut axis = [0.0; 3];
                axis[(0..3).min_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(0)] = 1.0;
                let second = normalize(cross(normal, axis));
                vec![([1.0, 0.0], cross(second, normal)), ([0.0, 1.0], second)]
            }
        };
        let centre_m = mesh.electrode_centre(electrode);
        let space_m = if along_edge.is_some() { None } else { Some(edge_m(centre_m)) };
        let nodes = moving_within(design, mesh, electrode, centre_m, space_m);
        let sd = displacement_m / (directions.len() as f64).sqrt();
        all.extend(directions.into_iter().map(|(direction, in_space)| {
            let velocity = |&(node, part): &(usize, f64)| {
                let held = match edge.get(&node) {
                    Some(&along) => scale(along, dot(along, in_space)),
                    None => sub(in_space, scale(normals[node], dot(normals[node], in_space))),
                };
                (node, scale(held, part))
            };
            let nodes = Moved::Straight(nodes.iter().map(velocity).collect());
            Displacement { electrode: Some((electrode, direction)), sd, nodes }
        }));
    }
    all
}

/// The nodes on the edge of a mesh of triangles, with the direction of the edge.
fn edge_nodes(mesh: &Mesh) -> HashMap<usize, Point3> {
    let mut along = HashMap::new();
    for [a, b] in mesh.edge_sides() {
        let by = sub(mesh.nodes[b], mesh.nodes[a]);
        [a, b].into_iter().for_each(|node| {
            let sum = along.entry(node).or_insert([0.0; 3]);
            *sum = add(*sum, by);
        });
    }
    along.into_iter().map(|(node, by)| (node, normalize(by))).collect()
}

/// The displacements of all nodes when the body becomes longer, on one axis, and this axis in the chart. None on other bodies:
/// those of another size have the same frames.
fn longer(body: &Body, mesh: &Mesh) -> (Vec<(usize, [f64; 2])>, [f64; 2]) {
    // A cylinder along its axis, a rectangle along x.
    let (axis, in_chart, middle_m) = match *body {
        Body::Cylinder { length_m, .. } => (2, [0.0, 1.0], 0.5 * length_m),
        Body::Rectangle { width_m, .. } => (0, [1.0, 0.0], 0.5 * width_m),
        _ => return (Vec::new(), [0.0; 2]),
    };
    let moved = |(node, at): (usize, &Point3)| (node, in_chart.map(|part| part * (at[axis] - middle_m)));
    (mesh.nodes.iter().enumerate().map(moved).collect(), in_chart)
}

/// The directions in which an electrode may be displaced.
fn directions(body: &Body, [x, y, z]: Point3) -> Vec<[f64; 2]> {
    let near = |a: f64, b: f64| (a - b).abs() <= ON_EDGE_M;
    match *body {
        Body::Cylinder { length_m, .. } if near(z, 0.0) || near(z, length_m) => vec![[1.0, 0.0]],
        Body::Disk { diameter_m } if near(x.hypot(y), diameter_m / 2.0) => {
            let radius = x.hypot(y);
            vec![[-y / radius, x / radius]]
        }
        Body::Rectangle { width_m, height_m } => {
            let (on_x, on_y) = (near(x, 0.0) || near(x, width_m), near(y, 0.0) || near(y, height_m));
            [([1.0, 0.0], on_x), ([0.0, 1.0], on_y)].iter().filter(|(_, on)| !on).map(|(along, _)| *along).collect()
        }
        _ => vec![[1.0, 0.0], [0.0, 1.0]],
    }
}

/// The direction of a part of the edge of a flat body.
fn along(mesh: &Mesh, edges: &[[usize; 2]]) -> Option<[f64; 2]> {
    let [from, to] = (*edges.get(edges.len() / 2)?).map(|node| mesh.nodes[node]);
    let (x, y) = (to[0] - from[0], to[1] - from[1]);
    let length = x.hypot(y);
    (length > 0.0).then(|| [x / length, y / length])
}

/// A displacement of a node near an electrode, turned round the middle of the disk on whose rim the electrode is: the rim
/// remains a circle.
fn kept_on_rim(body: &Body, centre_m: Point3, node_m: Point3, [u, v]: [f64; 2]) -> [f64; 2] {
    let radius = centre_m[0].hypot(centre_m[1]);
    match *body {
        Body::Disk { diameter_m } if (radius - diameter_m / 2.0).abs() <= ON_EDGE_M => {
            let along = (centre_m[0] * v - centre_m[1] * u) / radius;
            [-node_m[1] * along / radius, node_m[0] * along / radius]
        }
        _ => [u, v],
    }
}

/// The nodes that move with an electrode: fully within it, and less with the distance, so that cells stay valid.
fn moving(design: &SkinDesign, mesh: &Mesh, electrode: usize) -> Vec<(usize, f64)> {
    let centre_m = design.electrodes[electrode].centre_m;
    let edge_m = design.body.edge_distance_m(centre_m).filter(|&edge_m| edge_m > ON_EDGE_M);
    moving_within(design, mesh, electrode, centre_m, edge_m)
}

/// The same about a centre, where nothing farther than a distance moves, if there is one.
fn moving_within(
    design: &SkinDesign,
    mesh: &Mesh,
    electrode: usize,
    centre_m: Point3,
    space_m: Option<f64>,
) -> Vec<(usize, f64)> {
    let surface = design.body.surface();
    let distance_m = |point: Point3| surface.distance_m(centre_m, point);
    let own = mesh.electrode_nodes(electrode).into_iter();
    let radius_m = own.map(|node| distance_m(mesh.nodes[node])).fold(0.0, f64::max);
    let others = design.electrodes.iter().enumerate().filter(|(other, _)| *other != electrode);
    let next_m = others.map(|(_, other)| distance_m(other.centre_m)).fold(f64::INFINITY, f64::min);
    let reach_m = (REACH_RADII * radius_m).min(REACH_SHARE * next_m).min(space_m.unwrap_or(f64::INFINITY));
    let rigid_m = (RIGID_RADII * radius_m).min(0.5 * (radius_m + reach_m));
    let part = |distance_m: f64| {
        let t = ((distance_m - rigid_m) / (reach_m - rigid_m)).clamp(0.0, 1.0);
        1.0 - t * t * (3.0 - 2.0 * t)
    };
    let nodes = mesh.nodes.iter().enumerate().map(|(node, &at)| (node, part(distance_m(at))));
    nodes.filter(|(_, part)| *part > 0.0).collect()
}
