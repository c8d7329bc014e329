//! A surface from a file of triangles: duplicate vertices merged, all triangles with the same orientation.

use super::cursor::Problem;
use super::orient;
use super::shape::is_flat_triangle;
use crate::geom::Point3;
use crate::geom::vector::{self, bounding_box, distance};
use crate::mesh::{Cells, Mesh};
use std::collections::HashMap;

/// Points and triangles as stored in a file.
#[derive(Debug, Default, Clone)]
pub(super) struct Soup {
    pub points: Vec<Point3>,
    pub triangles: Vec<[usize; 3]>,
}

/// Points closer than this fraction of the body's extent are one: single precision has seven digits.
const WELD: f64 = 1e-6;

impl Soup {
    /// Adds a polygon as a fan of triangles.
    pub(super) fn add_polygon(&mut self, corners: &[usize]) {
        for pair in corners.windows(2).skip(1) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
        }
    }

    /// The surface, without electrodes.
    pub(super) fn into_mesh(mut self, unit_m: f64) -> Result<Mesh, Problem> {
        self.check()?;
        for point in &mut self.points {
            *point = vector::scale(*point, unit_m);
        }
        self.weld()?;
        if self.triangles.is_empty() {
            return Err(Problem::new("the file has no triangles"));
        }
        if let Some(flat) = self.triangles.iter().find(|t| is_flat_triangle(t.map(|node| self.points[node]))) {
            let corners = flat.map(|node| self.points[node]);
            return Err(Problem(format!(
                "the triangle with the corners {corners:?} m has no area: repair the surface"
            )));
        }
        // The order of the corners is often arbitrary in such files, and has no meaning for the shape.
        for (triangle, turn) in orient::parts(&self.points, &self.triangles)?.into_iter().flatten() {
            if turn {
                self.triangles[triangle].swap(1, 2);
            }
        }
        Ok(Mesh {
            nodes: self.points,
            cells: Cells::Triangles(self.triangles),
            electrodes: Vec::new(),
            regions: Vec::new(),
        })
    }

    pub(super) fn check(&self) -> Result<(), Problem> {
        if let Some(at) = self.points.iter().position(|point| point.iter().any(|x| !x.is_finite())) {
            return Err(Problem(format!("vertex {} is at {:?}", at + 1, self.points[at])));
        }
        let outside = |triangle: &[usize; 3]| triangle.iter().any(|&corner| corner >= self.points.len());
        if let Some(at) = self.triangles.iter().position(outside) {
            let message = format!(
                "triangle {} has the corners {:?}, but the file has {} vertices",
                at + 1,
                self.triangles[at].map(|corner| corner + 1),
                self.points.len()
            );
            return Err(Problem(message));
        }
        Ok(())
    }

    /// Merges all points at the same position, drops triangles that become degenerate and unused points.
    fn weld(&mut self) -> Result<(), Problem> {
        let [low, high] = bounding_box(self.points.iter().copied());
        let tolerance = WELD * distance(low, high);
        if !self.points.is_empty() && !tolerance.is_normal() {
            return Err(Problem::new("the body has no extent, or one that overflows"));
        }
        let box_of = |point: Point3| [0, 1, 2].map(|axis| ((point[axis] - low[axis]) / tolerance).floor() as i64);
        let mut in_box: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        let mut kept = Vec::new();
        let mut index_of = vec![usize::MAX; self.points.len()];
        for corner in self.triangles.iter_mut().flatten() {
            if index_of[*corner] == usize::MAX {
                let point = self.points[*corner];
                let home = box_of(point);
                let near = (0..27).map(|k| [home[0] + k % 3 - 1, home[1] + k / 3 % 3 - 1, home[2] + k / 9 - 1]);
                let known = near
                    .filter_map(|key| in_box.get(&key))
                    .flatten()
                    .copied()
                    .filter(|&index| distance(kept[index], point) <= tolerance);
                index_of[*corner] = known.min().unwrap_or_else(|| {
                    kept.push(point);
                    in_box.entry(home).or_default().push(kept.len() - 1);
                    kept.len() - 1
                });
            }
            *corner = index_of[*corner];
        }
        self.points = kept;
        self.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
        self.drop_unused();
        Ok(())
    }

    /// Drops points of dropped triangles.
    fn drop_unused(&mut self) {
        let mut index_of = vec![usize::MAX; self.points.len()];
        let mut kept = Vec::new();
        for corner in self.triangles.iter_mut().flatten() {
            if index_of[*corner] == usize::MAX {
                index_of[*corner] = kept.len();
                kept.push(self.points[*corner]);
            }
            *corner = index_of[*corner];
        }
        self.points = kept;
    }
}
