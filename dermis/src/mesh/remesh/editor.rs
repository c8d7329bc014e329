//! A surface of triangles that can be split, collapsed and flipped edge by edge.

use crate::geom::Point3;
use crate::geom::vector::{add, cross, distance, dot, norm, scale, sub};

/// The kind of a line of edges that remeshing keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Curve {
    /// The surface's boundary or a sharp crease.
    Crease,
    /// The outline of an electrode, by its number.
    Outline(usize),
}

/// The corners of a deleted triangle.
const GONE: [usize; 3] = [usize::MAX; 3];

/// A surface that is being changed. Points and triangles keep their numbers until [`MeshEditor::compact`].
#[derive(Debug, Clone, Default)]
pub(crate) struct MeshEditor {
    pub points: Vec<Point3>,
    pub triangles: Vec<[usize; 3]>,
    /// The electrode that covers each triangle.
    pub covered_by: Vec<Option<usize>>,
    /// The triangles at each point.
    around: Vec<Vec<usize>>,
    /// The curves through each point, with the point at the other end of the edge.
    curves: Vec<Vec<(usize, Curve)>>,
    /// Points that never move and are never deleted.
    pinned: Vec<bool>,
}

impl MeshEditor {
    pub(crate) fn new(points: Vec<Point3>, triangles: Vec<[usize; 3]>) -> Self {
        let mut around = vec![Vec::new(); points.len()];
        for (index, triangle) in triangles.iter().enumerate() {
            triangle.iter().for_each(|&point| around[point].push(index));
        }
        MeshEditor {
            covered_by: vec![None; triangles.len()],
            curves: vec![Vec::new(); points.len()],
            pinned: vec![false; points.len()],
            points,
            triangles,
            around,
        }
    }

    pub(crate) fn is_alive(&self, triangle: usize) -> bool {
        self.triangles[triangle] != GONE
    }

    pub(crate) fn alive(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.triangles.len()).filter(|&triangle| self.is_alive(triangle))
    }

    /// The triangles at a point; none for a deleted one.
    pub(crate) fn around(&self, point: usize) -> &[usize] {
        &self.around[point]
    }

    pub(crate) fn corners(&self, triangle: usize) -> [Point3; 3] {
        self.triangles[triangle].map(|point| self.points[point])
    }

    /// Twice the area, along the normal.
    pub(crate) fn area_vector(&self, triangle: usize) -> Point3 {
        area_vector(self.corners(triangle))
    }

    /// The edges, lower point first, in the order of the triangles.
    pub(crate) fn edges(&self) -> Vec<[usize; 2]> {
        let mut edges = Vec::new();
        for triangle in self.alive() {
            let [a, b, c] = self.triangles[triangle];
            for [from, to] in [[a, b], [b, c], [c, a]] {
                // The other triangle at an inner edge traverses it in the opposite direction; a boundary edge has only
                // one triangle.
                if from < to || self.at_edge_unordered(from, to).len() == 1 {
                    edges.push([from.min(to), from.max(to)]);
                }
            }
        }
        edges
    }

    /// The triangles at an edge, in their order at `a`; none if it was deleted.
    pub(crate) fn at_edge(&self, a: usize, b: usize) -> Vec<usize> {
        self.around[a].iter().copied().filter(|&triangle| self.triangles[triangle].contains(&b)).collect()
    }

    /// The same in any order. The tip of a long spike has thousands of triangles: those at the other end are searched.
    pub(crate) fn at_edge_unordered(&self, a: usize, b: usize) -> Vec<usize> {
        if self.around[b].len() < self.around[a].len() { self.at_edge(b, a) } else { self.at_edge(a, b) }
    }

    pub(crate) fn length(&self, a: usize, b: usize) -> f64 {
        distance(self.points[a], self.points[b])
    }

    pub(crate) fn middle(&self, a: usize, b: usize) -> Point3 {
        scale(add(self.points[a], self.points[b]), 0.5)
    }

    /// The points joined to a point by an edge, each once.
    pub(crate) fn neighbours(&self, point: usize) -> Vec<usize> {
        let corners = self.around[point].iter().flat_map(|&triangle| self.triangles[triangle]);
        let mut neighbours: Vec<usize> = corners.filter(|&corner| corner != point).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        neighbours
    }

    pub(crate) fn curve(&self, a: usize, b: usize) -> Option<Curve> {
        self.curves[a].iter().find(|(other, _)| *other == b).map(|(_, curve)| *curve)
    }

    /// The curves' edges at a point.
    pub(crate) fn curves_at(&self, point: usize) -> &[(usize, Curve)] {
        &self.curves[point]
    }

    pub(crate) fn set_curve(&mut self, a: usize, b: usize, curve: Curve) {
        self.clear_curve(a, b);
        self.curves[a].push((b, curve));
        self.curves[b].push((a, curve));
    }

    fn clear_curve(&mut self, a: usize, b: usize) {
        self.curves[a].retain(|(other, _)| *other != b);
        self.curves[b].retain(|(other, _)| *other != a);
    }

    pub(crate) fn pin(&mut self, point: usize) {
        self.pinned[point] = true;
    }

    pub(crate) fn is_pinned(&self, point: usize) -> bool {
        self.pinned[point]
    }

    /// Whether a point may be moved over the surface: it is neither pinned nor on a curve.
    pub(crate) fn is_free(&self, point: usize) -> bool {
        !self.pinned[point] && self.curves[point].is_empty()
    }

    fn add_point(&mut self, position: Point3) -> usize {
        self.points.push(position);
        self.around.push(Vec::new());
        self.curves.push(Vec::new());
        self.pinned.push(false);
        self.points.len() - 1
    }

    fn add_triangle(&mut self, corners: [usize; 3], covered_by: Option<usize>) {
        self.triangles.push(corners);
        self.covered_by.push(covered_by);
        corners.iter().for_each(|&point| self.around[point].push(self.triangles.len() - 1));
    }

    fn remove_triangle(&mut self, triangle: usize) {
        for point in std::mem::replace(&mut self.triangles[triangle], GONE) {
            self.around[point].retain(|&other| other != triangle);
        }
    }

    /// Splits an edge at a new point on it.
    pub(crate) fn split(&mut self, a: usize, b: usize, position: Point3) -> usize {
        let middle = self.add_point(position);
        for triangle in self.at_edge(a, b) {
            let corners = self.triangles[triangle];
            let replaced = |old: usize| corners.map(|corner| if corner == old { middle } else { corner });
            let (with_a, with_b) = (replaced(b), replaced(a));
            self.triangles[triangle] = with_a;
            self.around[b].retain(|&other| other != triangle);
            self.around[middle].push(triangle);
            self.add_triangle(with_b, self.covered_by[triangle]);
        }
        if let Some(curve) = self.curve(a, b) {
            self.clear_curve(a, b);
            self.set_curve(a, middle, curve);
            self.set_curve(middle, b, curve);
        }
        middle
    }

    /// Inserts a new point into a triangle.
    pub(crate) fn split_triangle(&mut self, triangle: usize, position: Point3) -> usize {
        let [a, b, c] = self.triangles[triangle];
        let covered_by = self.covered_by[triangle];
        let middle = self.add_point(position);
        self.remove_triangle(triangle);
        for corners in [[a, b, middle], [b, c, middle], [c, a, middle]] {
            self.add_triangle(corners, covered_by);
        }
        middle
    }

    /// Flips the edge between two triangles to their other corners, unless a curve or the surface's shape prevents it.
    pub(crate) fn flip(&mut self, a: usize, b: usize) -> bool {
        let [first, second] = self.at_edge(a, b)[..] else { return false };
        if self.curve(a, b).is_some() || self.covered_by[first] != self.covered_by[second] {
            return false;
        }
        let (Some(c), Some(d)) = (self.opposite(first, a, b), self.opposite(second, a, b)) else { return false };
        if c == d || !self.at_edge_unordered(c, d).is_empty() {
            return false;
        }
        // One of the triangles contains the directed edge `a` to `b`, and the new ones keep its orientation.
        let (a, b) = if runs(self.triangles[first], a, b) { (a, b) } else { (b, a) };
        let new = [[a, d, c], [d, b, c]];
        let normal = add(self.area_vector(first), self.area_vector(second));
        if new.iter().any(|corners| !faces_along(area_vector(corners.map(|p| self.points[p])), normal)) {
            return false;
        }
        let covered_by = self.covered_by[first];
        self.remove_triangle(first);
        self.remove_triangle(second);
        new.into_iter().for_each(|corners| self.add_triangle(corners, covered_by));
        true
    }

    /// The corner of a triangle that is neither of two others.
    pub(crate) fn opposite(&self, triangle: usize, a: usize, b: usize) -> Option<usize> {
        self.triangles[triangle].into_iter().find(|&corner| corner != a && corner != b)
    }

    /// Collapses `gone` into `kept`, unless this would change a curve, fold the surface or make an edge longer than
    /// `longest` at its midpoint.
    pub(crate) fn collapse(&mut self, gone: usize, kept: usize, longest: impl Fn(Point3) -> f64) -> bool {
        if self.pinned[gone] || !self.curves_allow(gone, kept) || !self.link_allows(gone, kept) {
            return false;
        }
        let (removed, moved): (Vec<usize>, Vec<usize>) =
            self.around[gone].iter().partition(|&&triangle| self.triangles[triangle].contains(&kept));
        for &triangle in &moved {
            let corners =
                self.triangles[triangle].map(|corner| self.points[if corner == gone { kept } else { corner }]);
            let (old, new) = (self.area_vector(triangle), area_vector(corners));
            if !faces_along(new, old) || smallest_angle(corners) < smallest_angle(self.corners(triangle)).min(MIN_ANGLE)
            {
                return false;
            }
        }
        for neighbour in self.neighbours(gone) {
            if self.length(neighbour, kept) > longest(self.middle(neighbour, kept)) {
                return false;
            }
        }
        let beyond = self.curves[gone].iter().copied().find(|(other, _)| *other != kept);
        removed.into_iter().for_each(|triangle| self.remove_triangle(triangle));
        for triangle in moved {
            self.triangles[triangle] =
                self.triangles[triangle].map(|corner| if corner == gone { kept } else { corner });
            self.around[kept].push(triangle);
        }
        self.around[gone].clear();
        self.clear_curve(gone, kept);
        if let Some((other, curve)) = beyond {
            self.clear_curve(gone, other);
            self.set_curve(kept, other, curve);
        }
        true
    }

    /// A point on a curve only moves along it, if the curve is nearly straight there.
    fn curves_allow(&self, gone: usize, kept: usize) -> bool {
        match self.curves[gone][..] {
            [] => true,
            [(a, one), (b, other)] => {
                let beyond = if a == kept { b } else { a };
                let along = sub(self.points[kept], self.points[gone]);
                let back = sub(self.points[gone], self.points[beyond]);
                (a == kept || b == kept)
                    && one == other
                    && self.curve(kept, beyond).is_none()
                    && dot(along, back) > STRAIGHT * norm(along) * norm(back)
            }
            _ => false,
        }
    }

    /// The surface stays a manifold if the only common neighbours of the two points are those in their common
    /// triangles.
    fn link_allows(&self, gone: usize, kept: usize) -> bool {
        let shared = self.at_edge(gone, kept);
        let theirs = self.neighbours(kept);
        let common = self.neighbours(gone).into_iter().filter(|point| theirs.binary_search(point).is_ok()).count();
        let on_boundary =
            |point: usize| self.neighbours(point).iter().any(|&n| self.at_edge_unordered(point, n).len() == 1);
        // An inner edge between two points of the boundary: the collapse would pinch the surface.
        let pinches = shared.len() == 2 && on_boundary(gone) && on_boundary(kept);
        !shared.is_empty() && common == shared.len() && !pinches && self.around[gone].len() > shared.len()
    }

    /// Moves a point, unless this folds the surface.
    pub(crate) fn shift(&mut self, point: usize, position: Point3) -> bool {
        let before = self.points[point];
        let old: Vec<Point3> = self.around[point].iter().map(|&triangle| self.area_vector(triangle)).collect();
        self.points[point] = position;
        let folds = |(&triangle, &old): (&usize, &Point3)| !faces_along(self.area_vector(triangle), old);
        if self.around[point].iter().zip(&old).any(folds) {
            self.points[point] = before;
            return false;
        }
        true
    }

    /// The remaining points and triangles, renumbered in their order: positions, corners, and the electrode on each
    /// triangle.
    pub(crate) fn compact(&self) -> (Vec<Point3>, Vec<[usize; 3]>, Vec<Option<usize>>) {
        let mut number_of = vec![usize::MAX; self.points.len()];
        let mut points = Vec::new();
        for (point, position) in self.points.iter().enumerate() {
            if !self.around[point].is_empty() {
                number_of[point] = points.len();
                points.push(*position);
            }
        }
        let triangles = self.alive().map(|t| self.triangles[t].map(|point| number_of[point])).collect();
        let covered_by = self.alive().map(|t| self.covered_by[t]).collect();
        (points, triangles, covered_by)
    }
}

/// A point may be removed from a curve that turns by less than this angle there (cosine of 30 degrees).
const STRAIGHT: f64 = 0.866;
/// Maximum rotation of a triangle when a point moves (cosine of 60 degrees): beyond, the surface folds.
const FOLD: f64 = 0.5;
/// A collapse creates no angle smaller than this (10 degrees), unless there was one before.
const MIN_ANGLE: f64 = 0.1745;

fn area_vector([a, b, c]: [Point3; 3]) -> Point3 {
    cross(sub(b, a), sub(c, a))
}

/// Whether two normals agree and neither has zero length.
fn faces_along(new: Point3, old: Point3) -> bool {
    // A triangle without area may get any orientation.
    let lengths = norm(new) * norm(old);
    norm(new) > 0.0 && dot(new, old) >= FOLD * lengths
}

fn runs([a, b, c]: [usize; 3], from: usize, to: usize) -> bool {
    [(a, b), (b, c), (c, a)].contains(&(from, to))
}

/// The angle of a triangle at its first corner.
pub(crate) fn angle([a, b, c]: [Point3; 3]) -> f64 {
    let (u, v) = (sub(b, a), sub(c, a));
    norm(cross(u, v)).atan2(dot(u, v))
}

/// The smallest angle of a triangle.
pub(crate) fn smallest_angle([a, b, c]: [Point3; 3]) -> f64 {
    angle([a, b, c]).min(angle([b, c, a])).min(angle([c, a, b]))
}
