//! Quadrature: points and weights whose weighted sum is a mean.

use crate::elementary::cos;
use dermis::geom::Point3;
use dermis::geom::vector::{add, longest_edge, scale};
use dermis::mesh::{Cells, Mesh};
use std::f64::consts::PI;

/// A point in `D` coordinates and its weight.
pub(crate) type Weighted<const D: usize> = ([f64; D], f64);

/// Seven points of a triangle whose weighted sum is the mean of a polynomial of degree 5 or less (Radon, 1948; Stroud,
/// Approximate Calculation of Multiple Integrals, 1971, T2: 5-1). The first is the centre.
pub(crate) fn triangle_points<const D: usize>(corners: &[[f64; D]; 3]) -> [Weighted<D>; 7] {
    let root = 15f64.sqrt();
    let near = [(6.0 - root) / 21.0, (6.0 + root) / 21.0];
    let weights = [(155.0 - root) / 1200.0, (155.0 + root) / 1200.0];
    std::array::from_fn(|point| match point {
        0 => (combination(corners, [1.0 / 3.0; 3]), 9.0 / 40.0),
        _ => {
            let (orbit, far) = ((point - 1) / 3, (point - 1) % 3);
            (combination(corners, one_far(near[orbit], far)), weights[orbit])
        }
    })
}

/// Four points of a tetrahedron whose weighted sum is the mean of a polynomial of degree 2 or less (Stroud, 1971, T3:
/// 2-1).
pub(crate) fn tetrahedron_points<const D: usize>(corners: &[[f64; D]; 4]) -> [Weighted<D>; 4] {
    let near = (5.0 - 5f64.sqrt()) / 20.0;
    std::array::from_fn(|far| (combination(corners, one_far(near, far)), 0.25))
}

/// Barycentric coordinates with one different value.
fn one_far<const N: usize>(near: f64, far: usize) -> [f64; N] {
    std::array::from_fn(|corner| if corner == far { 1.0 - (N - 1) as f64 * near } else { near })
}

fn combination<const D: usize, const N: usize>(corners: &[[f64; D]; N], weights: [f64; N]) -> [f64; D] {
    std::array::from_fn(|axis| {
        corners.iter().zip(weights).fold(0.0, |sum, (corner, weight)| sum + corner[axis] * weight)
    })
}

/// The four triangles of equal area between the corners and the midpoints of the edges.
pub(crate) fn quarters([a, b, c]: [Point3; 3]) -> [[Point3; 3]; 4] {
    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

/// The eight tetrahedra of equal volume between the corners and the midpoints of the edges.
pub(crate) fn eighths([a, b, c, d]: [Point3; 4]) -> [[Point3; 4]; 8] {
    let (ab, ac, ad) = (middle(a, b), middle(a, c), middle(a, d));
    let (bc, bd, cd) = (middle(b, c), middle(b, d), middle(c, d));
    [
        [a, ab, ac, ad],
        [ab, b, bc, bd],
        [ac, bc, c, cd],
        [ad, bd, cd, d],
        // The octahedron in the centre, split along its diagonal from `ab` to `cd`.
        [ab, cd, ac, ad],
        [ab, cd, ad, bd],
        [ab, cd, bd, bc],
        [ab, cd, bc, ac],
    ]
}

fn middle(a: Point3, b: Point3) -> Point3 {
    scale(add(a, b), 0.5)
}

/// A function that is zero beyond some distance of a few places, to be averaged over cells.
pub(crate) struct LocalFunction<R, V> {
    /// Whether it is not zero somewhere in a cell with these corners.
    pub(crate) reaches: R,
    /// Its value at a point.
    pub(crate) value: V,
    /// Longest edge of a triangle and of a tetrahedron for which the rules are accurate enough, m; larger cells are
    /// split.
    pub(crate) longest_edge_m: [f64; 2],
}

impl<R: Fn(&[Point3]) -> bool, V: Fn(Point3) -> f64> LocalFunction<R, V> {
    /// The mean over each cell of a mesh, added to `sums` (one value per cell).
    ///
    /// # Panics
    /// If the length of `sums` differs from the number of cells.
    pub(crate) fn add_cell_means(&self, mesh: &Mesh, sums: &mut [f64]) {
        assert_eq!(sums.len(), mesh.cell_count(), "one sum per cell");
        match &mesh.cells {
            Cells::Triangles(cells) => {
                for (sum, cell) in sums.iter_mut().zip(cells) {
                    let corners = cell.map(|node| mesh.nodes[node]);
                    if (self.reaches)(&corners) {
                        *sum += self.triangle_mean(corners);
                    }
                }
            }
            Cells::Tetrahedra(cells) => {
                for (sum, cell) in sums.iter_mut().zip(cells) {
                    let corners = cell.map(|node| mesh.nodes[node]);
                    if (self.reaches)(&corners) {
                        *sum += self.tetrahedron_mean(corners);
                    }
                }
            }
        }
    }

    /// The mean over one triangle; a triangle that is too large is split into quarters. Quarters out of reach are not
    /// split further: their number would grow with the square of the size.
    pub(crate) fn triangle_mean(&self, corners: [Point3; 3]) -> f64 {
        if longest_edge(&corners) > self.longest_edge_m[0] {
            let reached = quarters(corners).into_iter().filter(|quarter| (self.reaches)(quarter));
            return 0.25 * reached.map(|quarter| self.triangle_mean(quarter)).sum::<f64>();
        }
        triangle_points(&corners).iter().map(|&(point, weight)| weight * (self.value)(point)).sum()
    }

    /// The mean over one tetrahedron; a tetrahedron that is too large is split into eighths.
    pub(crate) fn tetrahedron_mean(&self, corners: [Point3; 4]) -> f64 {
        if longest_edge(&corners) > self.longest_edge_m[1] {
            let reached = eighths(corners).into_iter().filter(|eighth| (self.reaches)(eighth));
            return 0.125 * reached.map(|eighth| self.tetrahedron_mean(eighth)).sum::<f64>();
        }
        tetrahedron_points(&corners).iter().map(|&(point, weight)| weight * (self.value)(point)).sum()
    }
}

/// The Gauss-Legendre rule on -1 to 1: points and weights (which sum to 2), exact for polynomials of degree
/// `2 count - 1`. Roots of the Legendre polynomial by Newton's method (Abramowitz and Stegun, 1964, 25.4.29).
pub(crate) fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let root = |k: usize| {
        let mut t = cos(PI * (k as f64 + 0.75) / (count as f64 + 0.5));
        let mut slope = 1.0;
        for _ in 0..20 {
            let (mut before, mut value) = (1.0, t);
            for n in 1..count {
                (before, value) = (value, ((2 * n + 1) as f64 * t * value - n as f64 * before) / (n + 1) as f64);
            }
            slope = count as f64 * (t * value - before) / (t * t - 1.0);
            t -= value / slope;
        }
        (t, 2.0 / ((1.0 - t * t) * slope * slope))
    };
    (0..count).map(root).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::geom::vector::{cross, dot, sub, triangle_area};

    fn factorial(n: u32) -> f64 {
        (1..=n).map(f64::from).product()
    }

    /// The error of the mean of `x^a y^b z^c` over the simplex of the origin and the unit vectors, whose exact value is
    /// `D! a! b! c! / (a + b + c + D)!`.
    fn error<const D: usize>(points: &[Weighted<D>], powers: [u32; D]) -> f64 {
        let value = |point: &[f64; D]| point.iter().zip(powers).map(|(x, power)| x.powi(power as i32)).product::<f64>();
        let mean: f64 = points.iter().map(|(point, weight)| weight * value(point)).sum();
        let exact = factorial(D as u32) * powers.iter().map(|&power| factorial(power)).product::<f64>()
            / factorial(powers.iter().sum::<u32>() + D as u32);
        (mean - exact).abs()
    }

    #[test]
    fn the_triangle_rule_is_exact_to_degree_five_and_no_further() {
        let points = triangle_points(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
        for (a, b) in (0..=5u32).flat_map(|a| (0..=5 - a).map(move |b| (a, b))) {
            assert!(error(&points, [a, b]) < 1e-15, "{a} {b}");
        }
        assert!(error(&points, [6, 0]) > 1e-5);
        assert!(points.iter().all(|([x, y], weight)| *weight > 0.0 && *x > 0.0 && *y > 0.0 && x + y < 1.0));
    }

    #[test]
    fn the_tetrahedron_rule_is_exact_to_degree_two_and_no_further() {
        let points = tetrahedron_points(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        for (a, b) in (0..=2u32).flat_map(|a| (0..=2 - a).map(move |b| (a, b))) {
            for c in 0..=2 - a - b {
                assert!(error(&points, [a, b, c]) < 1e-15, "{a} {b} {c}");
            }
        }
        assert!(error(&points, [3, 0, 0]) > 1e-4);
    }

    #[test]
    fn gauss_legendre_is_exact_to_its_degree_and_no_further() {
        for count in [1, 3, 8] {
            let rule = gauss_legendre(count);
            let integral = |power: usize| rule.iter().map(|(t, weight)| weight * t.powi(power as i32)).sum::<f64>();
            for power in 0..2 * count {
                let exact = if power % 2 == 0 { 2.0 / (power + 1) as f64 } else { 0.0 };
                assert!((integral(power) - exact).abs() < 1e-14, "{count} points, degree {power}");
            }
            assert!((integral(2 * count) - 2.0 / (2 * count + 1) as f64).abs() > 1e-6, "{count} points");
        }
    }

    #[test]
    fn parts_have_equal_shares_of_the_whole() {
        let triangle = [[0.1, 0.0, 0.3], [1.0, 0.2, 0.0], [0.3, 0.9, 0.1]];
        let whole = triangle_area(triangle);
        assert!(quarters(triangle).iter().all(|&part| (4.0 * triangle_area(part) / whole - 1.0).abs() < 1e-12));
        let volume = |[a, b, c, d]: [Point3; 4]| dot(cross(sub(b, a), sub(c, a)), sub(d, a)).abs();
        let tetrahedron = [[0.1, 0.0, 0.3], [1.0, 0.2, 0.0], [0.3, 0.9, 0.1], [0.2, 0.3, 1.1]];
        let whole = volume(tetrahedron);
        assert!(eighths(tetrahedron).iter().all(|&part| (8.0 * volume(part) / whole - 1.0).abs() < 1e-12));
    }
}
