//! The surface of a body from a mesh file: normals, edges, places.

use crate::error::FabricateError;
use dermis::design::MeshFile;
use dermis::geom::vector::{add, cross, distance, dot, norm, normalize, scale, sub, triangle_area, volume};
use dermis::geom::{Point3, TriangleTree};
use dermis::mesh::{Cells, import};
use std::collections::HashMap;
use std::f64::consts::TAU;

/// A surface of triangles, counter-clockwise as seen from outside.
#[derive(Debug, Clone)]
pub struct BodyMesh {
    /// Nodes, m.
    pub(crate) nodes: Vec<Point3>,
    /// Triangles, as indices of nodes.
    pub(crate) triangles: Vec<[usize; 3]>,
    /// Outward unit normal at each node: the mean of those of its triangles, weighted by their angles.
    pub(crate) normals: Vec<Point3>,
    /// Edges of one triangle, in its direction.
    pub(crate) boundary: Vec<[usize; 2]>,
    /// Angle that is missing to a full turn at each node, rad: its Gaussian curvature; 0 on the boundary.
    pub(crate) defects_rad: Vec<f64>,
    tree: TriangleTree,
}

impl BodyMesh {
    pub(crate) fn load(file: &MeshFile, unit_m: f64) -> Result<Self, FabricateError> {
        let mesh = import::load_body(file, unit_m)?;
        let Cells::Triangles(triangles) = mesh.cells else {
            let message = format!("{}: a body of tetrahedra has no coat", file.path.display());
            return Err(FabricateError::part(message, "give its surface as triangles"));
        };
        let mut body = BodyMesh::new(mesh.nodes, triangles);
        if body.boundary.is_empty() && body.volume_m3() < 0.0 {
            body = BodyMesh::new(body.nodes, body.triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect());
        }
        Ok(body)
    }

    /// A surface of triangles that are counter-clockwise as seen from outside.
    pub(crate) fn new(nodes: Vec<Point3>, triangles: Vec<[usize; 3]>) -> Self {
        let mut normals = vec![[0.0; 3]; nodes.len()];
        let mut angles_rad = vec![0.0; nodes.len()];
        let mut open: HashMap<[usize; 2], ()> = HashMap::new();
        for triangle in &triangles {
            let corners = triangle.map(|node| nodes[node]);
            let normal = normalize(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])));
            for k in 0..3 {
                let (from, to) = (triangle[k], triangle[(k + 1) % 3]);
                let (a, b) = (sub(corners[(k + 1) % 3], corners[k]), sub(corners[(k + 2) % 3], corners[k]));
                let angle = norm(cross(a, b)).atan2(dot(a, b));
                normals[from] = add(normals[from], scale(normal, angle));
                angles_rad[from] += angle;
                if open.remove(&[to, from]).is_none() {
                    open.insert([from, to], ());
                }
            }
        }
        let mut boundary: Vec<[usize; 2]> = open.into_keys().collect();
        boundary.sort_unstable();
        let mut defects_rad: Vec<f64> = angles_rad.into_iter().map(|angle| TAU - angle).collect();
        boundary.iter().flatten().for_each(|&node| defects_rad[node] = 0.0);
        let tree = TriangleTree::new(triangles.iter().map(|triangle| triangle.map(|node| nodes[node])));
        BodyMesh {
            normals: normals.into_iter().map(normalize).collect(),
            nodes,
            triangles,
            boundary,
            defects_rad,
            tree,
        }
    }

    fn corners(&self, triangle: usize) -> [Point3; 3] {
        self.triangles[triangle].map(|node| self.nodes[node])
    }

    fn volume_m3(&self) -> f64 {
        volume((0..self.triangles.len()).map(|triangle| self.corners(triangle)))
    }

    /// The point of the surface nearest to a point, and the outward unit normal there, interpolated between nodes.
    pub(crate) fn nearest(&self, point_m: Point3) -> (Point3, Point3) {
        let found = self.tree.nearest(point_m);
        let [a, b, c] = self.corners(found.triangle);
        let nodes = self.triangles[found.triangle];
        let weights = [[b, c], [c, a], [a, b]].map(|[p, q]| triangle_area([found.point, p, q]));
        let mixed = (0..3).fold([0.0; 3], |sum, k| add(sum, scale(self.normals[nodes[k]], weights[k])));
        (found.point, normalize(mixed))
    }

    /// Distance of a point from the surface, m.
    pub(crate) fn distance_m(&self, point_m: Point3) -> f64 {
        self.tree.nearest(point_m).distance_m
    }

    /// Distance of a point from the nearest edge of the surface, with the nearest point of the edge; `None` for a closed
    /// surface.
    fn edge(&self, point_m: Point3) -> Option<(f64, Point3)> {
        let on = |&[from, to]: &[usize; 2]| {
            let (a, along) = (self.nodes[from], sub(self.nodes[to], self.nodes[from]));
            let t = (dot(sub(point_m, a), along) / dot(along, along)).clamp(0.0, 1.0);
            let nearest = add(a, scale(along, t));
            (distance(nearest, point_m), nearest)
        };
        self.boundary.iter().map(on).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Distance of a point from the nearest edge of the surface, m; `None` for a closed surface.
    pub(crate) fn edge_distance_m(&self, point_m: Point3) -> Option<f64> {
        self.edge(point_m).map(|(distance_m, _)| distance_m)
    }

    /// Area of the surface, m2.
    pub(crate) fn area_m2(&self) -> f64 {
        (0..self.triangles.len()).map(|triangle| triangle_area(self.corners(triangle))).sum()
    }

    /// The place nearest to a point of the surface, within steps of a tenth, that is at least a distance from every edge,
    /// and its normal; `None` if none is found.
    pub(crate) fn away_from_edges(&self, point_m: Point3, least_m: f64) -> Option<(Point3, Point3)> {
        const STEPS: usize = 100;
        let (mut place, mut normal) = self.nearest(point_m);
        for _ in 0..STEPS {
            let Some((apart_m, edge)) = self.edge(place).filter(|(apart_m, _)| *apart_m < least_m) else {
                return Some((place, normal));
            };
            let away = if apart_m > 1e-6 { normalize(sub(place, edge)) } else { self.inward(edge) };
            (place, normal) = self.nearest(add(place, scale(away, (least_m - apart_m).max(0.1 * least_m))));
        }
        None
    }

    /// The direction from a point of the edge into the surface.
    fn inward(&self, edge_m: Point3) -> Point3 {
        let triangle = self.tree.nearest(edge_m).triangle;
        let [a, b, c] = self.corners(triangle);
        normalize(sub(scale(add(add(a, b), c), 1.0 / 3.0), edge_m))
    }

    /// Places on the surface at least a distance apart and from the edges, with their normals: one after the other, each
    /// the candidate that is farthest from those taken.
    pub(crate) fn spread_m(&self, apart_m: f64, edge_m: f64) -> Vec<(Point3, Point3)> {
        let far_from_edge = |point: &Point3| self.edge(*point).is_none_or(|(distance_m, _)| distance_m >= edge_m);
        let candidates: Vec<Point3> = self.samples(0.2 * apart_m).into_iter().filter(far_from_edge).collect();
        let mut nearest_m = vec![f64::INFINITY; candidates.len()];
        let mut places = Vec::new();
        let mut next = (!candidates.is_empty()).then_some(0);
        while let Some(chosen) = next {
            places.push(self.nearest(candidates[chosen]));
            for (least, &candidate) in nearest_m.iter_mut().zip(&candidates) {
                *least = least.min(distance(candidate, candidates[chosen]));
            }
            let farthest = (0..candidates.len()).max_by(|&a, &b| nearest_m[a].total_cmp(&nearest_m[b]));
            next = farthest.filter(|&farthest| nearest_m[farthest] >= apart_m);
        }
        places
    }

    /// Points on every triangle, at most a step apart.
    fn samples(&self, step_m: f64) -> Vec<Point3> {
        let mut points = Vec::new();
        for triangle in 0..self.triangles.len() {
            let [a, b, c] = self.corners(triangle);
            let longest_m = distance(a, b).max(distance(b, c)).max(distance(c, a));
            let steps = (longest_m / step_m).ceil().max(1.0) as usize;
            for (i, j) in (0..steps).flat_map(|i| (0..steps - i).map(move |j| (i, j))) {
                // Points inside: a shared edge gives no point twice.
                let [u, v] = [i, j].map(|k| (k as f64 + 1.0 / 3.0) / steps as f64);
                points.push(add(a, add(scale(sub(b, a), u), scale(sub(c, a), v))));
            }
        }
        points
    }

    /// Relative change of the length of a disc's edge when the disc is laid on the surface: a circle of radius `r` round
    /// a point of curvature `K` is `2 pi r (1 - K r^2 / 6 + ...)` long (Bertrand, Diguet and Puiseux, 1848), and
    /// `pi r^2 K` is the curvature below the disc. That of nodes is spread over their thirds of the triangles around.
    pub(crate) fn disc_strain(&self, centre_m: Point3, radius_m: f64) -> f64 {
        -self.curvature_per_m2(centre_m, radius_m) * radius_m * radius_m / 6.0
    }

    /// Mean Gaussian curvature of the surface within a radius, but at least of the triangle there with its neighbours.
    fn curvature_per_m2(&self, centre_m: Point3, radius_m: f64) -> f64 {
        let own = self.tree.nearest(centre_m).triangle;
        let longest_m = (0..3).map(|k| {
            let corners = self.corners(own);
            distance(corners[k], corners[(k + 1) % 3])
        });
        let reach_m = longest_m.fold(radius_m, f64::max);
        let (mut defect_rad, mut area_m2) = (0.0, 0.0);
        let mut near = vec![false; self.nodes.len()];
        for (node, place) in self.nodes.iter().enumerate() {
            near[node] = distance(*place, centre_m) <= reach_m;
            defect_rad += if near[node] { self.defects_rad[node] } else { 0.0 };
        }
        for (index, triangle) in self.triangles.iter().enumerate() {
            let share = triangle.iter().filter(|&&node| near[node]).count() as f64 / 3.0;
            area_m2 += share * triangle_area(self.corners(index));
        }
        if area_m2 > 0.0 { defect_rad / area_m2 } else { 0.0 }
    }

    /// Number of boundary loops, and the genus of the surface, from Euler's formula; of the largest part of it alone.
    pub(crate) fn topology(&self) -> (usize, i64) {
        let next: HashMap<usize, usize> = self.boundary.iter().map(|&[from, to]| (from, to)).collect();
        let mut left: Vec<usize> = next.keys().copied().collect();
        left.sort_unstable();
        let mut seen = std::collections::HashSet::new();
        let mut loops = 0;
        for start in left {
            if !seen.insert(start) {
                continue;
            }
            loops += 1;
            let mut at = next[&start];
            while seen.insert(at) {
                at = next[&at];
            }
        }
        let edges = (3 * self.triangles.len() + self.boundary.len()) / 2;
        let euler = self.nodes.len() as i64 - edges as i64 + self.triangles.len() as i64;
        // V - E + F = 2 - 2 g - b for one part.
        (loops, (2 - loops as i64 - euler) / 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A sphere of rings and meridians.
    fn sphere(radius_m: f64, rings: usize) -> BodyMesh {
        let round = 2 * rings;
        let mut nodes = vec![[0.0, 0.0, radius_m], [0.0, 0.0, -radius_m]];
        for ring in 1..rings {
            let polar = PI * ring as f64 / rings as f64;
            for k in 0..round {
                let angle = TAU * k as f64 / round as f64;
                nodes.push([polar.sin() * angle.cos(), polar.sin() * angle.sin(), polar.cos()].map(|x| radius_m * x));
            }
        }
        let at = |ring: usize, k: usize| 2 + (ring - 1) * round + k % round;
        let mut triangles = Vec::new();
        for k in 0..round {
            triangles.push([0, at(1, k), at(1, k + 1)]);
            triangles.push([1, at(rings - 1, k + 1), at(rings - 1, k)]);
            for ring in 1..rings - 1 {
                triangles.push([at(ring, k), at(ring + 1, k), at(ring + 1, k + 1)]);
                triangles.push([at(ring, k), at(ring + 1, k + 1), at(ring, k + 1)]);
            }
        }
        BodyMesh::new(nodes, triangles)
    }

    /// A circle on a sphere of radius `R` is `2 pi R sin(r / R)` long.
    #[test]
    fn the_strain_of_a_disc_on_a_sphere_is_that_of_its_circle() {
        let body = sphere(0.05, 48);
        assert_eq!(body.topology(), (0, 0));
        assert!((body.defects_rad.iter().sum::<f64>() - 4.0 * PI).abs() < 1e-9);
        for radius_m in [0.008, 0.015] {
            let x = radius_m / 0.05f64;
            let exact = x.sin() / x - 1.0;
            let strain = body.disc_strain(body.nearest([0.03, 0.02, 0.01]).0, radius_m);
            assert!((strain / exact - 1.0).abs() < 0.05, "{strain} {exact}");
        }
    }

    #[test]
    fn spread_places_keep_their_distance() {
        let body = sphere(0.05, 24);
        let places = body.spread_m(0.01, 0.0);
        for (j, a) in places.iter().enumerate() {
            assert!(places[..j].iter().all(|b| distance(a.0, b.0) >= 0.01), "{j}");
        }
        // Between the densest packing, one in sqrt(3)/2 d^2, and one place in each circle of radius d.
        let (area, square) = (4.0 * PI * 0.05f64.powi(2), 1e-4);
        assert!((places.len() as f64) < area / (0.866 * square) && places.len() as f64 > area / (PI * square));
    }
}
