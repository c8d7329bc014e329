//! Points in cubes of space, to find those near a point.

use crate::geom::Point3;
use crate::geom::vector::bounding_box;
use std::array::from_fn;
use std::ops::Range;

/// Cubes are larger where they would be more than this.
const MAX_CUBES: f64 = 1e6;

/// The box around some points in cubes of one size.
#[derive(Debug, Clone)]
pub(super) struct Cubes {
    low: Point3,
    size_m: f64,
    counts: [usize; 3],
    /// By cube, the number of points in those before it.
    first: Vec<usize>,
}

impl Cubes {
    /// The cubes of some points, and the points by their cubes: those along the last axis one after the other.
    pub(super) fn new(points: &[Point3], size_m: f64) -> (Self, Vec<usize>) {
        let [low, high] = bounding_box(points.iter().copied());
        let extent: Point3 = from_fn(|axis| high[axis] - low[axis]);
        let count = |size_m: f64| extent.map(|extent| (extent / size_m).floor() + 1.0);
        let mut size_m = size_m;
        while count(size_m).iter().product::<f64>() > MAX_CUBES {
            size_m *= 2.0;
        }
        let mut cubes = Cubes { low, size_m, counts: count(size_m).map(|count| count as usize), first: Vec::new() };
        let cube_of = |&point: &usize| cubes.cube(from_fn(|axis| cubes.along(axis, points[point][axis])));
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(cube_of);
        let total = cubes.counts.iter().product::<usize>();
        let mut first = vec![0; total + 1];
        order.iter().for_each(|point| first[cube_of(point) + 1] += 1);
        (0..total).for_each(|cube| first[cube + 1] += first[cube]);
        cubes.first = first;
        (cubes, order)
    }

    /// The cube along an axis that contains a coordinate, or the nearest one.
    fn along(&self, axis: usize, coordinate_m: f64) -> usize {
        (((coordinate_m - self.low[axis]) / self.size_m).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    fn cube(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.counts[1] + y) * self.counts[2] + z
    }

    /// The points by their cubes that may be within a distance of a point, as ranges.
    pub(super) fn near(&self, point_m: Point3, reach_m: f64) -> impl Iterator<Item = Range<usize>> + '_ {
        let end = |axis: usize, sign: f64| self.along(axis, point_m[axis] + sign * reach_m);
        let [x, y, z] = [0, 1, 2].map(|axis| end(axis, -1.0)..=end(axis, 1.0));
        x.flat_map(move |x| y.clone().map(move |y| [x, y]))
            .map(move |[x, y]| self.first[self.cube([x, y, *z.start()])]..self.first[self.cube([x, y, *z.end()]) + 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::vector::distance;

    #[test]
    fn all_points_within_a_distance_are_found() {
        let value = |k: usize, axis: usize| ((k * (7 + 4 * axis)) as f64).sin() * [0.1, 0.02, 0.0][axis];
        let points: Vec<Point3> = (0..500).map(|k| from_fn(|axis| value(k, axis))).collect();
        for size_m in [1e-7, 4e-3, 1.0] {
            let (cubes, order) = Cubes::new(&points, size_m);
            for (from, reach_m) in [([0.0; 3], 0.03), (points[7], 1e-3), ([-0.2, 0.0, 0.1], 0.15), ([0.1; 3], 0.2)] {
                let found: Vec<usize> = cubes.near(from, reach_m).flatten().map(|at| order[at]).collect();
                let near = (0..points.len()).filter(|&point| distance(points[point], from) <= reach_m);
                let missing: Vec<usize> = near.filter(|point| !found.contains(point)).collect();
                assert!(missing.is_empty(), "{size_m}, {from:?}: {missing:?}");
                assert!(size_m > 0.1 || found.len() < 400 || reach_m > 0.1, "{size_m}, {from:?}: {}", found.len());
            }
        }
    }
}
