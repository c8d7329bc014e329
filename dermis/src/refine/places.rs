//! Places on a body and the axes of its tangent plane there.

use crate::design::Body;
use crate::geom::vector::{add, cross, distance, dot, norm, normalize, scale, sub};
use crate::geom::{Chart, Point2, Point3, Surface, TriangleTree};
use crate::mesh::Mesh;

/// A place on a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// The point, m.
    pub point_m: Point3,
    /// The same in the chart, m; zero without one.
    pub unrolled: Point2,
    /// Unit vectors: two in the tangent plane, and the outward normal.
    pub axes: [Point3; 3],
}

/// The places of a body: of its chart, or of the triangles of its mesh with their planes.
#[derive(Debug, Clone)]
pub(super) enum Space {
    Chart(Surface, Chart),
    Triangles(TriangleTree, Vec<Point3>),
}

impl Space {
    /// The places of a body.
    pub(super) fn new(body: &Body, mesh: &Mesh) -> Self {
        if let Some(chart) = body.chart() {
            return Space::Chart(body.surface(), chart);
        }
        let corners =
            |cell: usize| -> [Point3; 3] { std::array::from_fn(|corner| mesh.nodes[mesh.cells.corners(cell)[corner]]) };
        let triangles: Vec<[Point3; 3]> = (0..mesh.cell_count()).map(corners).collect();
        let normal = |[a, b, c]: &[Point3; 3]| normalize(cross(sub(*b, *a), sub(*c, *a)));
        let normals = triangles.iter().map(normal).collect();
        Space::Triangles(TriangleTree::new(triangles), normals)
    }

    /// The place of a point, or the nearest one.
    pub(super) fn place(&self, point_m: Point3) -> Place {
        match self {
            Space::Chart(surface, chart) => Self::in_chart(surface, chart, chart.unroll(point_m)),
            Space::Triangles(tree, normals) => {
                let nearest = tree.nearest(point_m);
                let normal = normals[nearest.triangle];
                // The axis of space that is most nearly in the plane.
                let flattest = (0..3).min_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(0);
                let mut axis = [0.0; 3];
                axis[flattest] = 1.0;
                Place { point_m: nearest.point, unrolled: [0.0; 2], axes: axes_near(axis, normal) }
            }
        }
    }

    /// The place nearest to one in the chart.
    fn in_chart(surface: &Surface, chart: &Chart, unrolled: Point2) -> Place {
        let unrolled = chart.wrap(chart.nearest(unrolled));
        let point_m = chart.roll(unrolled);
        let normal = surface.normal(point_m).unwrap_or([0.0, 0.0, 1.0]);
        let second = if matches!(surface, Surface::Plane) { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        Place { point_m, unrolled, axes: [cross(second, normal), second, normal] }
    }

    /// The place reached by a step along the tangent plane, with the axes carried along.
    pub(super) fn walk(&self, from: &Place, [along, across]: Point2) -> Place {
        if let Space::Chart(surface, chart) = self {
            let [x, y] = from.unrolled;
            return Self::in_chart(surface, chart, [x + along, y + across]);
        }
        let there = self.place(add(from.point_m, add(scale(from.axes[0], along), scale(from.axes[1], across))));
        Place { axes: axes_near(from.axes[0], there.axes[2]), ..there }
    }

    /// The step from a place to one near it: in the chart, or in the tangent plane with the length of the straight line.
    pub(super) fn step(&self, from: &Place, to: &Place) -> Point2 {
        match self {
            Space::Chart(_, chart) => chart.difference(from.unrolled, to.unrolled),
            Space::Triangles(..) => {
                let by = sub(to.point_m, from.point_m);
                let flat = [dot(by, from.axes[0]), dot(by, from.axes[1])];
                let factor = norm(by) / flat[0].hypot(flat[1]).max(f64::MIN_POSITIVE);
                if factor.is_finite() { flat.map(|part| part * factor) } else { [0.0; 2] }
            }
        }
    }

    /// Cosine and sine of the angle from the axes of a place to those of another one near it, in its plane.
    pub(super) fn turn(&self, from: &Place, to: &Place) -> Point2 {
        if matches!(self, Space::Chart(..)) {
            return [1.0, 0.0];
        }
        let parts = [dot(from.axes[0], to.axes[0]), -dot(from.axes[0], to.axes[1])];
        let length = parts[0].hypot(parts[1]);
        if length > 0.0 { parts.map(|part| part / length) } else { [1.0, 0.0] }
    }

    /// The distance of two places along the surface; through space without a chart.
    pub(super) fn distance_m(&self, a: &Place, b: &Place) -> f64 {
        match self {
            Space::Chart(_, chart) => chart.distance_m(a.unrolled, b.unrolled),
            Space::Triangles(..) => distance(a.point_m, b.point_m),
        }
    }
}

impl Place {
    /// The vector of a step in the tangent plane.
    pub(super) fn vector(&self, [along, across]: Point2) -> Point3 {
        add(scale(self.axes[0], along), scale(self.axes[1], across))
    }
}

/// Axes about a normal, the first near a vector that is not parallel to it.
fn axes_near(first: Point3, normal: Point3) -> [Point3; 3] {
    let first = normalize(sub(first, scale(normal, dot(first, normal))));
    [first, cross(normal, first), normal]
}
