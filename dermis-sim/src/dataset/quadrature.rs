//! Points and weights whose weighted sum is the mean over a cell.

use dermis::geom::Point3;
use dermis::geom::vector::{add, distance, scale};

/// Longest edge in widths of a Gaussian over which a rule is exact enough; the reasons are beside the plain rasteriser's
/// ([`GaussianTouch::add_cell_means`](crate::touch::GaussianTouch::add_cell_means)).
const TRIANGLE_EDGE_WIDTHS: f64 = 1.0;
const TETRAHEDRON_EDGE_WIDTHS: f64 = 0.5;

/// How the mean over a cell of a kind is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    /// Radon's rule of degree 5 with seven points (Stroud 1971, T2: 5-1), on quarters of quarters as needed.
    Triangle,
    /// The rule of degree 2 with four points (Stroud 1971, T3: 2-1), on eighths of eighths.
    Tetrahedron,
}

impl Rule {
    /// How often a cell is divided for a Gaussian of a width.
    pub fn level(self, longest_edge_m: f64, width_m: f64) -> usize {
        let enough = match self {
            Rule::Triangle => TRIANGLE_EDGE_WIDTHS,
            Rule::Tetrahedron => TETRAHEDRON_EDGE_WIDTHS,
        };
        let (mut edge_m, mut level) = (longest_edge_m, 0);
        while edge_m > enough * width_m {
            (edge_m, level) = (0.5 * edge_m, level + 1);
        }
        level
    }

    /// The weights of the points of one part; those of a cell repeat for each of its parts, over their number.
    pub fn weights(self) -> Vec<f64> {
        let root = 15f64.sqrt();
        let (near, far) = ((155.0 - root) / 1200.0, (155.0 + root) / 1200.0);
        match self {
            Rule::Triangle => vec![9.0 / 40.0, near, near, near, far, far, far],
            Rule::Tetrahedron => vec![0.25; 4],
        }
    }

    /// Parts of a cell at a level.
    pub fn part_count(self, level: usize) -> usize {
        match self {
            Rule::Triangle => 4usize.pow(level as u32),
            Rule::Tetrahedron => 8usize.pow(level as u32),
        }
    }

    /// The points of a cell at a level, part by part.
    pub fn points(self, corners: &[Point3], level: usize) -> Vec<Point3> {
        let mut parts = vec![corners.to_vec()];
        for _ in 0..level {
            parts = parts.iter().flat_map(|part| self.divide(part)).collect();
        }
        parts.iter().flat_map(|part| self.points_of_part(part)).collect()
    }

    fn points_of_part(self, corners: &[Point3]) -> Vec<Point3> {
        let count = corners.len();
        let with_far = |near: f64| {
            (0..count).map(move |far| {
                let weight = |corner| if corner == far { 1.0 - (count - 1) as f64 * near } else { near };
                (0..count).fold([0.0; 3], |sum, corner| add(sum, scale(corners[corner], weight(corner))))
            })
        };
        match self {
            Rule::Triangle => {
                let root = 15f64.sqrt();
                let middle = corners.iter().fold([0.0; 3], |sum, &corner| add(sum, scale(corner, 1.0 / 3.0)));
                std::iter::once(middle)
                    .chain(with_far((6.0 - root) / 21.0))
                    .chain(with_far((6.0 + root) / 21.0))
                    .collect()
            }
            Rule::Tetrahedron => with_far((5.0 - 5f64.sqrt()) / 20.0).collect(),
        }
    }

    fn divide(self, corners: &[Point3]) -> Vec<Vec<Point3>> {
        let middle = |i: usize, j: usize| scale(add(corners[i], corners[j]), 0.5);
        match self {
            Rule::Triangle => {
                let (ab, bc, ca) = (middle(0, 1), middle(1, 2), middle(2, 0));
                vec![vec![corners[0], ab, ca], vec![ab, corners[1], bc], vec![ca, bc, corners[2]], vec![ab, bc, ca]]
            }
            Rule::Tetrahedron => {
                let [a, b, c, d] = [corners[0], corners[1], corners[2], corners[3]];
                let (ab, ac, ad) = (middle(0, 1), middle(0, 2), middle(0, 3));
                let (bc, bd, cd) = (middle(1, 2), middle(1, 3), middle(2, 3));
                vec![
                    vec![a, ab, ac, ad],
                    vec![ab, b, bc, bd],
                    vec![ac, bc, c, cd],
                    vec![ad, bd, cd, d],
                    // The octahedron in the middle, split along its diagonal from `ab` to `cd`.
                    vec![ab, cd, ac, ad],
                    vec![ab, cd, ad, bd],
                    vec![ab, cd, bd, bc],
                    vec![ab, cd, bc, ac],
                ]
            }
        }
    }
}

/// The longest edge of a cell, m.
pub(super) fn longest_edge_m(corners: &[Point3]) -> f64 {
    let mut longest = 0.0f64;
    for (index, &a) in corners.iter().enumerate() {
        for &b in &corners[index + 1..] {
            longest = longest.max(distance(a, b));
        }
    }
    longest
}
