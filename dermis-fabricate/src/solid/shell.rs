//! The wall below a surface from a mesh file. Lengths in m, of the solid in mm.

use crate::body::BodyMesh;
use crate::error::FabricateError;
use crate::solid::cutter;
use dermis::geom::Point3;
use dermis::geom::vector::{add, cross, dot, norm, normalize, scale, sub};
use manifold_rust::manifold::Manifold;
use manifold_rust::types::Error;
use std::collections::HashMap;

/// Least part of the wall that may be left where the body is curved.
const MIN_WALL: f64 = 0.8;
/// Most by which a node is farther from its inner one than the wall, where triangles meet at an angle.
const MAX_STRETCH: f64 = 1.5;

/// The solid between a surface and its inner face.
pub(crate) fn shell(mesh: &BodyMesh, wall_m: f64) -> Result<Manifold, FabricateError> {
    let inner = inner_m(mesh, wall_m);
    check_wall(mesh, &inner, wall_m)?;
    let count = mesh.nodes.len();
    let mut triangles = mesh.triangles.clone();
    triangles.extend(mesh.triangles.iter().map(|&[a, b, c]| [count + a, count + c, count + b]));
    for &[from, to] in &mesh.boundary {
        // The edge runs against its triangle's direction on the side of the wall.
        triangles.extend([[to, from, count + from], [to, count + from, count + to]]);
    }
    let corners: Vec<Point3> = mesh.nodes.iter().chain(&inner).map(|node| scale(*node, 1e3)).collect();
    let solid = cutter::solid(&corners, &triangles);
    if solid.status() != Error::NoError || solid.has_self_intersections() {
        return Err(too_thick(wall_m, "its inner face crosses itself"));
    }
    Ok(solid)
}

/// The inner node of each node: a wall's thickness below all triangles of the node. The inner face ends in the same
/// plane as the surface where an edge of the surface lies in a plane that it meets steeply.
pub(crate) fn inner_m(mesh: &BodyMesh, wall_m: f64) -> Vec<Point3> {
    let mut inward: Vec<Point3> = mesh.normals.iter().map(|normal| scale(*normal, -1.0)).collect();
    for (nodes, across) in flat_edges(mesh) {
        for node in nodes {
            inward[node] = normalize(sub(inward[node], scale(across, dot(inward[node], across))));
        }
    }
    let mut least_cosine = vec![1.0f64; mesh.nodes.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|node| mesh.nodes[node]);
        let normal = normalize(cross(sub(b, a), sub(c, a)));
        for &node in triangle {
            least_cosine[node] = least_cosine[node].min(-dot(normal, inward[node]));
        }
    }
    let place = |node: usize| {
        let stretch = 1.0 / least_cosine[node].max(1.0 / MAX_STRETCH);
        add(mesh.nodes[node], scale(inward[node], wall_m * stretch))
    };
    (0..mesh.nodes.len()).map(place).collect()
}

/// The nodes of each boundary loop that lies in a plane which the surface meets steeply, and the normal of the plane.
fn flat_edges(mesh: &BodyMesh) -> Vec<(Vec<usize>, Point3)> {
    /// Largest distance from the plane, relative to the size of the loop, that is rounding of a file.
    const FLAT: f64 = 1e-4;
    let mut next: HashMap<usize, usize> = mesh.boundary.iter().map(|&[from, to]| (from, to)).collect();
    let mut flat = Vec::new();
    for &[start, _] in &mesh.boundary {
        let (mut nodes, mut at) = (Vec::new(), start);
        while let Some(following) = next.remove(&at) {
            nodes.push(at);
            at = following;
        }
        if nodes.len() < 3 {
            continue;
        }
        let middle = dermis::geom::vector::centroid(&nodes.iter().map(|&node| mesh.nodes[node]).collect::<Vec<_>>());
        let radius = |node: usize| sub(mesh.nodes[node], middle);
        // Newell's normal: the sum of the vector products along the loop.
        let round = nodes.iter().zip(nodes.iter().cycle().skip(1));
        let across = normalize(round.fold([0.0; 3], |sum, (&a, &b)| add(sum, cross(radius(a), radius(b)))));
        let size_m = nodes.iter().map(|&node| norm(radius(node))).fold(0.0, f64::max);
        // Where the surface is nearly parallel to that plane, as a plate or a shallow dome, the wall ends across it instead.
        let steep = (1.0 - MAX_STRETCH.powi(-2)).sqrt();
        let is_across = |node: usize| dot(mesh.normals[node], across).abs() <= steep;
        if nodes.iter().all(|&node| dot(radius(node), across).abs() <= FLAT * size_m && is_across(node)) {
            flat.push((nodes, across));
        }
    }
    flat
}

fn check_wall(mesh: &BodyMesh, inner: &[Point3], wall_m: f64) -> Result<(), FabricateError> {
    for (node, &place) in inner.iter().enumerate() {
        let left_m = mesh.distance_m(place);
        if left_m < MIN_WALL * wall_m {
            let [x, y, z] = mesh.nodes[node].map(|value| 1e3 * value);
            let message = format!("only {:.2} mm are left at ({x:.1}, {y:.1}, {z:.1}) mm", 1e3 * left_m);
            return Err(too_thick(wall_m, &message));
        }
    }
    for triangle in &mesh.triangles {
        let turned = |nodes: &dyn Fn(usize) -> Point3| {
            let [a, b, c] = triangle.map(nodes);
            cross(sub(b, a), sub(c, a))
        };
        if dot(turned(&|node| mesh.nodes[node]), turned(&|node| inner[node])) <= 0.0 {
            let [x, y, z] = mesh.nodes[triangle[0]].map(|value| 1e3 * value);
            return Err(too_thick(wall_m, &format!("its inner face folds at ({x:.1}, {y:.1}, {z:.1}) mm")));
        }
    }
    Ok(())
}

fn too_thick(wall_m: f64, why: &str) -> FabricateError {
    let message = format!("a wall of {:.2} mm is too thick for this body: {why}", 1e3 * wall_m);
    FabricateError::part(message, "make `wall_m` smaller, or smooth the body")
}
