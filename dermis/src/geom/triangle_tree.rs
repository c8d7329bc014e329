//! Nearest points on a surface of many triangles.

use super::surface::nearest_on_triangle;
use super::vector::{Point3, bounding_box, distance};

/// A binary tree of bounding boxes of triangles, for the point of a surface that is nearest to a given one.
#[derive(Debug, Clone)]
pub struct TriangleTree {
    corners: Vec<[Point3; 3]>,
    /// Original indices of the triangles, in the order of `corners`.
    numbers: Vec<usize>,
    boxes: Vec<Node>,
}

#[derive(Debug, Clone)]
struct Node {
    low: Point3,
    high: Point3,
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    /// A range of `corners`.
    Leaf { start: usize, end: usize },
    /// The second child; the first follows its parent.
    Fork { second: usize },
}

/// Triangles in a leaf: for fewer triangles, boxes save no time.
const LEAF: usize = 8;

/// A point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Its position, m.
    pub point: Point3,
    /// The triangle that contains it.
    pub triangle: usize,
    /// Its distance from the given point, m.
    pub distance_m: f64,
}

impl TriangleTree {
    /// Builds the tree of some triangles.
    ///
    /// # Panics
    /// If there is no triangle.
    pub fn new(triangles: impl IntoIterator<Item = [Point3; 3]>) -> Self {
        let mut items: Vec<(usize, [Point3; 3])> = triangles.into_iter().enumerate().collect();
        assert!(!items.is_empty(), "a surface has triangles");
        let mut boxes = Vec::new();
        build(&mut items, 0, &mut boxes);
        let (numbers, corners) = items.into_iter().unzip();
        TriangleTree { corners, numbers, boxes }
    }

    /// The point of the surface nearest to `point`.
    pub fn nearest(&self, point: Point3) -> Nearest {
        let mut best = Nearest { point, triangle: 0, distance_m: f64::INFINITY };
        let mut stack = vec![0];
        while let Some(at) = stack.pop() {
            let node = &self.boxes[at];
            if node.distance(point) >= best.distance_m {
                continue;
            }
            match node.kind {
                Kind::Leaf { start, end } => {
                    for k in start..end {
                        let on_triangle = nearest_on_triangle(point, self.corners[k]);
                        let distance_m = distance(on_triangle, point);
                        if distance_m < best.distance_m {
                            best = Nearest { point: on_triangle, triangle: self.numbers[k], distance_m };
                        }
                    }
                }
                Kind::Fork { second } => {
                    let (first, second) = (at + 1, second);
                    // The nearer child is visited first: it is pushed last.
                    if self.boxes[first].distance(point) <= self.boxes[second].distance(point) {
                        stack.extend([second, first]);
                    } else {
                        stack.extend([first, second]);
                    }
                }
            }
        }
        best
    }
}

impl Node {
    fn distance(&self, point: Point3) -> f64 {
        let outside = [0, 1, 2].map(|axis| point[axis] - point[axis].clamp(self.low[axis], self.high[axis]));
        super::vector::norm(outside)
    }
}

fn build(items: &mut [(usize, [Point3; 3])], start: usize, boxes: &mut Vec<Node>) {
    let [low, high] = bounding_box(items.iter().flat_map(|item| item.1));
    let at = boxes.len();
    boxes.push(Node { low, high, kind: Kind::Leaf { start, end: start + items.len() } });
    if items.len() <= LEAF {
        return;
    }
    let axis = (0..3).max_by(|&a, &b| (high[a] - low[a]).total_cmp(&(high[b] - low[b]))).unwrap_or(0);
    let middle = items.len() / 2;
    let centre = |corners: &[Point3; 3]| corners[0][axis] + corners[1][axis] + corners[2][axis];
    items.select_nth_unstable_by(middle, |a, b| centre(&a.1).total_cmp(&centre(&b.1)).then(a.0.cmp(&b.0)));
    let (left, right) = items.split_at_mut(middle);
    build(left, start, boxes);
    boxes[at].kind = Kind::Fork { second: boxes.len() };
    build(right, start + middle, boxes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn the_tree_finds_what_a_search_of_all_triangles_finds() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut point = || [0; 3].map(|_: i32| random.random_range(-1.0..1.0));
        let triangles: Vec<[Point3; 3]> = (0..500)
            .map(|_| {
                let at: Point3 = point();
                [(); 3].map(|()| super::super::vector::add(at, super::super::vector::scale(point(), 0.1)))
            })
            .collect();
        let tree = TriangleTree::new(triangles.iter().copied());
        for _ in 0..500 {
            let asked = point();
            let all = triangles.iter().map(|&t| distance(nearest_on_triangle(asked, t), asked));
            let found = tree.nearest(asked);
            assert_eq!(found.distance_m, all.fold(f64::INFINITY, f64::min));
            assert_eq!(nearest_on_triangle(asked, triangles[found.triangle]), found.point);
        }
    }
}
