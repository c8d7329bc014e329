//! The region in which presses are located.

use crate::calibration::Label;
use crate::error::CalibrateError;
use dermis::design::Body;
use dermis::geom::Point3;
use dermis::geom::vector::{bounding_box, cross, norm, normalize, sub};
use dermis::mesh::{Cells, Mesh};
use dermis::skin::Skin;
use rayon::prelude::*;

/// Edges of the triangles along the radius of a region around labels.
const EDGES: f64 = 20.0;

/// A triangulated surface: the positions that a press can have.
///
/// ```
/// use dermis_calibrate::Region;
///
/// let region = Region::disk([0.0, 0.0, 0.0], 0.04, 0.004);
/// let area_m2 = std::f64::consts::PI * 0.04 * 0.04;
/// assert!((region.area_m2() / area_m2 - 1.0).abs() < 0.1);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    pub(crate) nodes: Vec<Point3>,
    pub(crate) triangles: Vec<[usize; 3]>,
}

impl Region {
    /// A disk parallel to the plane of x and y: the triangles of a square grid whose centres lie in it. m.
    pub fn disk(centre_m: Point3, radius_m: f64, edge_m: f64) -> Self {
        let steps = (radius_m / edge_m).ceil() as i64;
        let side = (2 * steps + 1) as usize;
        let at = |k: usize| (k as i64 - steps) as f64 * edge_m;
        let nodes: Vec<Point3> =
            (0..side * side).map(|k| [centre_m[0] + at(k / side), centre_m[1] + at(k % side), centre_m[2]]).collect();
        let mut triangles = Vec::new();
        for (row, column) in (0..side - 1).flat_map(|row| (0..side - 1).map(move |column| (row, column))) {
            let corner = row * side + column;
            triangles.push([corner, corner + side, corner + 1]);
            triangles.push([corner + side, corner + side + 1, corner + 1]);
        }
        let inside = |triangle: &[usize; 3]| {
            let offset =
                |axis: usize| triangle.iter().map(|&node| nodes[node][axis]).sum::<f64>() / 3.0 - centre_m[axis];
            offset(0).hypot(offset(1)) <= radius_m
        };
        triangles.retain(inside);
        Region { nodes, triangles }.without_unused_nodes()
    }

    /// The surface of a skin: a regular grid on flat bodies, the triangles of the mesh on others.
    ///
    /// # Errors
    /// A skin of tetrahedra.
    pub fn of_skin(skin: &Skin) -> Result<Self, CalibrateError> {
        match skin.design().body {
            Body::Disk { diameter_m } => Ok(Region::disk([0.0; 3], 0.5 * diameter_m, 0.5 * diameter_m / EDGES)),
            Body::Rectangle { width_m, height_m } => Ok(Region::rectangle(width_m, height_m)),
            Body::Cylinder { .. } | Body::Mesh { .. } => Self::of_mesh(skin.mesh()),
        }
    }

    /// A rectangle from the origin: a grid of equal triangles. m.
    fn rectangle(width_m: f64, height_m: f64) -> Self {
        let edge_m = 0.5 * width_m.max(height_m) / EDGES;
        let [columns, rows] = [width_m, height_m].map(|side_m| (side_m / edge_m).ceil() as usize);
        let at = |k: usize, count: usize, side_m: f64| side_m * k as f64 / count as f64;
        let node = |k: usize| [at(k % (columns + 1), columns, width_m), at(k / (columns + 1), rows, height_m), 0.0];
        let corners = (0..rows).flat_map(|row| (0..columns).map(move |column| row * (columns + 1) + column));
        let triangles = corners.flat_map(|corner| {
            let above = corner + columns + 1;
            [[corner, corner + 1, above], [corner + 1, above + 1, above]]
        });
        Region { nodes: (0..(rows + 1) * (columns + 1)).map(node).collect(), triangles: triangles.collect() }
    }

    fn of_mesh(mesh: &Mesh) -> Result<Self, CalibrateError> {
        let Cells::Triangles(triangles) = &mesh.cells else {
            let message = "presses are located on surfaces, but this body is a volume of tetrahedra";
            return Err(CalibrateError::Body(message.into()));
        };
        Ok(Region { nodes: mesh.nodes.clone(), triangles: triangles.clone() }.without_unused_nodes())
    }

    /// The part of the plane that a flat skin may cover in a robot's frame, in which its pose is not known: the disks
    /// of the skin's size that contain all labels.
    pub(crate) fn around_labels(skin: &Skin, labels: &[Label]) -> Result<Self, CalibrateError> {
        let radius_m = match skin.design().body {
            Body::Disk { diameter_m } => 0.5 * diameter_m,
            Body::Rectangle { width_m, height_m } => 0.5 * width_m.hypot(height_m),
            Body::Cylinder { .. } | Body::Mesh { .. } => {
                let message = "labels in a robot's frame calibrate flat skins only: give them in the skin's own frame, \
                               with a header";
                return Err(CalibrateError::Body(message.into()));
            }
        };
        let positions: Vec<Point3> = labels.iter().map(|label| label.position_m).collect();
        let middle_m = middle_of(&positions);
        let spread_m = positions.iter().map(|position| flat_distance(*position, middle_m)).fold(0.0, f64::max);
        if spread_m > 1.5 * radius_m {
            return Err(CalibrateError::Label(format!(
                "the labels extend over {:.3} m, but the skin only over {:.3} m: positions are in metres",
                2.0 * spread_m,
                2.0 * radius_m
            )));
        }
        let deepest_m = positions.iter().map(|position| (position[2] - middle_m[2]).abs()).fold(0.0, f64::max);
        if deepest_m > 0.25 * radius_m {
            return Err(CalibrateError::Label(format!(
                "the labels differ by {:.3} m along z: the skin must be parallel to x and y of the robot's frame",
                2.0 * deepest_m
            )));
        }
        let radius_m = radius_m.max(spread_m);
        let edge_m = radius_m / EDGES;
        let candidates = Region::disk(middle_m, 0.6 * radius_m, 0.5 * edge_m).nodes;
        let holds = |centre: &Point3| positions.iter().all(|position| flat_distance(*position, *centre) <= radius_m);
        let centres: Vec<Point3> = candidates.into_iter().filter(holds).chain([middle_m]).collect();
        let mut region = Region::disk(middle_m, 1.6 * radius_m, edge_m);
        let nodes = std::mem::take(&mut region.nodes);
        let covered: Vec<bool> = nodes
            .par_iter()
            .map(|node| centres.iter().any(|centre| flat_distance(*node, *centre) <= radius_m + 0.5 * edge_m))
            .collect();
        region.triangles.retain(|triangle| triangle.iter().all(|&node| covered[node]));
        Ok(Region { nodes, ..region }.without_unused_nodes())
    }

    /// The middle of its bounding box, m.
    pub(crate) fn middle_m(&self) -> Point3 {
        middle_of(&self.nodes)
    }

    /// Its area, m2.
    pub fn area_m2(&self) -> f64 {
        self.triangles.iter().map(|triangle| self.triangle_area_m2(triangle)).sum()
    }

    /// The unit normal of a triangle.
    pub(crate) fn normal(&self, triangle: usize) -> Point3 {
        let [a, b, c] = self.triangles[triangle].map(|node| self.nodes[node]);
        normalize(cross(sub(b, a), sub(c, a)))
    }

    /// A unit normal at each node: that of one of its triangles.
    pub(crate) fn node_normals(&self) -> Vec<Point3> {
        let mut normals = vec![[0.0, 0.0, 1.0]; self.nodes.len()];
        for (number, triangle) in self.triangles.iter().enumerate() {
            triangle.iter().for_each(|&node| normals[node] = self.normal(number));
        }
        normals
    }

    pub(crate) fn triangle_area_m2(&self, triangle: &[usize; 3]) -> f64 {
        let [a, b, c] = triangle.map(|node| self.nodes[node]);
        0.5 * norm(cross(sub(b, a), sub(c, a)))
    }

    /// Whether it was stored whole: triangles of nodes that exist, each node in one of them.
    pub(crate) fn is_consistent(&self) -> bool {
        let mut used = vec![false; self.nodes.len()];
        let mut mark = |node: &usize| used.get_mut(*node).map(|used| *used = true).is_some();
        !self.triangles.is_empty() && self.triangles.iter().flatten().all(&mut mark) && used.iter().all(|used| *used)
    }

    fn without_unused_nodes(self) -> Self {
        let mut number = vec![usize::MAX; self.nodes.len()];
        let mut nodes = Vec::new();
        let mut keep = |node: usize| {
            if number[node] == usize::MAX {
                number[node] = nodes.len();
                nodes.push(self.nodes[node]);
            }
            number[node]
        };
        let triangles = self.triangles.iter().map(|triangle| triangle.map(&mut keep)).collect();
        Region { nodes, triangles }
    }
}

/// The middle of the bounding box of some points.
fn middle_of(points: &[Point3]) -> Point3 {
    let [low, high] = bounding_box(points.iter().copied());
    [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]))
}

/// The distance of two points in the plane of x and y.
fn flat_distance(a: Point3, b: Point3) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_is_covered_once() {
        let body = Body::Rectangle { width_m: 0.12, height_m: 0.05 };
        let region = Region::rectangle(0.12, 0.05);
        assert!((region.area_m2() - 0.12 * 0.05).abs() < 1e-12, "{}", region.area_m2());
        assert!(region.nodes.iter().all(|&position| body.holds(position) && position[2] == 0.0));
        assert!((0..region.triangles.len()).all(|triangle| region.normal(triangle)[2] > 0.0));
    }
}
