//! Simple solids: prisms and hulls. Lengths in mm.

use dermis::geom::vector::{add, cross, scale};
use dermis::geom::{Point2, Point3};
use manifold_rust::linalg::Vec3;
use manifold_rust::manifold::Manifold;
use manifold_rust::types::MeshGL64;
use std::f64::consts::TAU;

/// A frame: origin and two unit vectors at right angles; the third is their vector product.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    pub origin: Point3,
    pub u: Point3,
    pub v: Point3,
}

impl Frame {
    /// Any frame whose third vector is a given unit vector.
    pub(crate) fn along(origin: Point3, axis: Point3) -> Self {
        // The coordinate axis that is farthest from the given one.
        let least = (0..3).min_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs())).expect("three axes");
        let mut other = [0.0; 3];
        other[least] = 1.0;
        let u = dermis::geom::vector::normalize(cross(other, axis));
        Frame { origin, u, v: cross(axis, u) }
    }

    fn at(&self, [x, y]: Point2, height: f64) -> Point3 {
        let axis = cross(self.u, self.v);
        add(self.origin, add(add(scale(self.u, x), scale(self.v, y)), scale(axis, height)))
    }
}

/// A solid of triangles.
pub(crate) fn solid(corners: &[Point3], triangles: &[[usize; 3]]) -> Manifold {
    let mesh = MeshGL64 {
        num_prop: 3,
        vert_properties: corners.as_flattened().to_vec(),
        tri_verts: triangles.as_flattened().iter().map(|&corner| corner as u64).collect(),
        ..MeshGL64::default()
    };
    Manifold::from_mesh_gl64(&mesh)
}

/// A convex profile, counter-clockwise, extruded along the frame's third vector between two heights.
pub(crate) fn prism(profile: &[Point2], frame: &Frame, [low, high]: [f64; 2]) -> Manifold {
    let count = profile.len();
    let corners: Vec<Point3> =
        [low, high].iter().flat_map(|&height| profile.iter().map(move |&at| frame.at(at, height))).collect();
    let mut triangles = Vec::with_capacity(4 * count);
    for k in 0..count {
        let next = (k + 1) % count;
        triangles.extend([[k, next, count + next], [k, count + next, count + k]]);
    }
    for k in 1..count - 1 {
        triangles.extend([[0, k + 1, k], [count, count + k, count + k + 1]]);
    }
    solid(&corners, &triangles)
}

/// Corners of a circle round the origin.
pub(crate) fn circle(radius: f64, chord_error: f64) -> Vec<Point2> {
    let count = crate::outline::chords(radius, chord_error);
    (0..count)
        .map(|k| TAU * k as f64 / count as f64)
        .map(|angle| [radius * angle.cos(), radius * angle.sin()])
        .collect()
}

/// A box in a frame.
pub(crate) fn cuboid(frame: &Frame, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2], heights: [f64; 2]) -> Manifold {
    prism(&[[x0, y0], [x1, y0], [x1, y1], [x0, y1]], frame, heights)
}

/// The convex hull of balls.
pub(crate) fn hull_of_balls(centres: &[Point3], radius: f64) -> Manifold {
    // Twenty directions of a dodecahedron lie on the ball; the hull is within it.
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut directions: Vec<Point3> = Vec::with_capacity(20);
    for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        directions.extend([[a, b, 1.0], [a, b, -1.0]]);
        directions.extend([
            [0.0, a / golden, b * golden],
            [a / golden, b * golden, 0.0],
            [b * golden, 0.0, a / golden],
        ]);
    }
    let points = centres.iter().flat_map(|&centre| {
        directions.iter().map(move |&direction| {
            let [x, y, z] = add(centre, scale(direction, radius / 3f64.sqrt()));
            Vec3::new(x, y, z)
        })
    });
    Manifold::hull(&points.collect::<Vec<Vec3>>())
}

/// The union of solids, in pairs, so that every solid takes part in few unions.
pub(crate) fn union(mut solids: Vec<Manifold>) -> Manifold {
    while solids.len() > 1 {
        solids = solids.chunks(2).map(|pair| pair[1..].iter().fold(pair[0].clone(), |a, b| a.union(b))).collect();
    }
    solids.pop().unwrap_or_else(Manifold::empty)
}
