//! Positions drawn uniformly by area from the surface of a skin.

use crate::elementary::sin_cos;
use dermis::design::Body;
use dermis::geom::Point3;
use dermis::geom::vector::{add, scale, sub, triangle_area};
use dermis::mesh::{Cells, Mesh};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::collections::HashMap;
use std::f64::consts::TAU;

/// The surface of a skin, for drawing positions uniformly by area, edges included.
#[derive(Debug, Clone)]
pub(super) enum Places {
    Cylinder {
        radius_m: f64,
        length_m: f64,
    },
    Disk {
        radius_m: f64,
    },
    Rectangle {
        size_m: [f64; 2],
    },
    /// The triangles of a surface or the outer faces of a volume, with the cumulative areas.
    Triangles {
        corners: Vec<[Point3; 3]>,
        areas_up_to: Vec<f64>,
    },
}

impl Places {
    pub(super) fn new(body: &Body, mesh: &Mesh) -> Self {
        match (*body).clone() {
            Body::Cylinder { length_m, diameter_m } => Places::Cylinder { radius_m: 0.5 * diameter_m, length_m },
            Body::Disk { diameter_m } => Places::Disk { radius_m: 0.5 * diameter_m },
            Body::Rectangle { width_m, height_m } => Places::Rectangle { size_m: [width_m, height_m] },
            Body::Mesh { .. } => {
                let corners: Vec<[Point3; 3]> =
                    outer_triangles(mesh).iter().map(|triangle| triangle.map(|node| mesh.nodes[node])).collect();
                let mut sum = 0.0;
                let areas_up_to = (corners.iter())
                    .map(|&triangle| {
                        sum += triangle_area(triangle);
                        sum
                    })
                    .collect();
                Places::Triangles { corners, areas_up_to }
            }
        }
    }

    /// A position, in the body's frame.
    pub(super) fn draw(&self, rng: &mut ChaCha8Rng) -> Point3 {
        let (first, second): (f64, f64) = (rng.random(), rng.random());
        match self {
            &Places::Cylinder { radius_m, length_m } => {
                let (sine, cosine) = sin_cos(TAU * second);
                [radius_m * cosine, radius_m * sine, length_m * first]
            }
            &Places::Disk { radius_m } => {
                let (sine, cosine) = sin_cos(TAU * second);
                let from_centre_m = radius_m * first.sqrt();
                [from_centre_m * cosine, from_centre_m * sine, 0.0]
            }
            Places::Rectangle { size_m } => [size_m[0] * first, size_m[1] * second, 0.0],
            Places::Triangles { corners, areas_up_to } => {
                let total = areas_up_to.last().expect("a mesh has cells");
                let asked: f64 = rng.random::<f64>() * total;
                let index = areas_up_to.partition_point(|&area| area <= asked).min(corners.len() - 1);
                in_triangle(corners[index], first, second)
            }
        }
    }
}

/// Uniform in a triangle (Turk, 1990: Generating random points in triangles, Graphics Gems).
fn in_triangle([a, b, c]: [Point3; 3], first: f64, second: f64) -> Point3 {
    let root = first.sqrt();
    add(a, add(scale(sub(b, a), root * (1.0 - second)), scale(sub(c, a), root * second)))
}

/// The triangles of a surface, or the faces that belong to only one tetrahedron.
fn outer_triangles(mesh: &Mesh) -> Vec<[usize; 3]> {
    match &mesh.cells {
        Cells::Triangles(triangles) => triangles.clone(),
        Cells::Tetrahedra(cells) => {
            let faces = |&[a, b, c, d]: &[usize; 4]| [[a, b, c], [a, b, d], [a, c, d], [b, c, d]];
            let sorted = |mut face: [usize; 3]| {
                face.sort_unstable();
                face
            };
            let mut seen: HashMap<[usize; 3], usize> = HashMap::new();
            for face in cells.iter().flat_map(faces) {
                *seen.entry(sorted(face)).or_default() += 1;
            }
            cells.iter().flat_map(faces).filter(|&face| seen[&sorted(face)] == 1).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elementary::unrolled;
    use crate::random::sample_rng;
    use dermis::geom::Surface;
    use dermis::geom::vector::distance;

    const COUNT: u64 = 40_000;

    /// Fraction of positions that fulfil a condition; a fraction `p` of 40,000 has a standard deviation below 0.0025.
    fn share(places: &Places, holds: impl Fn(Point3) -> bool) -> f64 {
        let drawn = (0..COUNT).map(|index| places.draw(&mut sample_rng(3, index)));
        drawn.filter(|&place| holds(place)).count() as f64 / COUNT as f64
    }

    const TOLERANCE: f64 = 0.01;

    #[test]
    fn places_are_uniform_by_area_with_rim_and_seam() {
        let none = Mesh { nodes: vec![], cells: Cells::Triangles(vec![]), electrodes: vec![], regions: vec![] };
        let cylinder = Places::new(&Body::Cylinder { length_m: 0.3, diameter_m: 0.1 }, &none);
        let chart = unrolled(&Surface::Cylinder { radius_m: 0.05, length_m: 0.3 });
        let rim = share(&cylinder, |p| p[2] < 0.02 || p[2] > 0.28);
        let seam = share(&cylinder, |p| chart.unroll(p)[0].abs() < 0.015);
        println!("rim {rim:.4} for {:.4}, seam {seam:.4} for {:.4}", 0.04 / 0.3, 0.03 / (TAU * 0.05));
        assert!((rim - 0.04 / 0.3).abs() < TOLERANCE && (seam - 0.03 / (TAU * 0.05)).abs() < TOLERANCE);
        let disk = Places::new(&Body::Disk { diameter_m: 0.2 }, &none);
        assert!((share(&disk, |p| p[0].hypot(p[1]) < 0.05) - 0.25).abs() < TOLERANCE);
        let sheet = Places::new(&Body::Rectangle { width_m: 0.4, height_m: 0.1 }, &none);
        assert!((share(&sheet, |p| p[0] < 0.1 && p[1] < 0.05) - 0.125).abs() < TOLERANCE);
    }

    #[test]
    fn places_on_a_mesh_follow_the_area_of_its_outside() {
        // Two triangles of areas 1 and 3, and a single tetrahedron whose four faces are all outside.
        let nodes = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let body = Body::Mesh { file: "skin.msh".into(), unit_m: 1.0 };
        let cells = Cells::Triangles(vec![[0, 1, 2], [0, 2, 3]]);
        let mesh = Mesh { nodes, cells, electrodes: vec![], regions: vec![] };
        let places = Places::new(&body, &mesh);
        assert!((share(&places, |p| p[0] > 0.0) - 0.25).abs() < TOLERANCE);
        // The quarter next to a corner, scaled by one half.
        assert!((share(&places, |p| p[0] > 0.0 && p[0] + p[1] / 2.0 < 0.5) - 0.0625).abs() < TOLERANCE);
        let volume = Mesh { cells: Cells::Tetrahedra(vec![[0, 1, 2, 4]]), ..mesh };
        let places = Places::new(&body, &volume);
        let Places::Triangles { corners, .. } = &places else { panic!("a mesh") };
        assert_eq!(corners.len(), 4);
        assert!((0..100).all(|index| {
            let [x, y, z] = places.draw(&mut sample_rng(4, index));
            let off = [x, y, z, (1.0 - x - y / 2.0 - z).abs()].into_iter().fold(f64::INFINITY, f64::min);
            off < 1e-12 && distance([x, y, z], [0.0; 3]) <= 2.0
        }));
    }
}
