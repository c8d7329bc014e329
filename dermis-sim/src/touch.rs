//! The effect of a touch on the conductance of the sheet.
//!
//! The model is the paper's training touch: a Gaussian rise of conductance. With the relative change
//! `g(x) = A exp(-d(x)^2 / (2 w^2))`, where `d` is the distance along the surface, the conductance becomes
//! `sigma0 (1 + e g)`, and `e` is +1 or -1 according to [`TouchEffect::sign`]. Several touches add up.
//!
//! ```
//! use dermis::geom::Surface;
//! use dermis_sim::touch::GaussianTouch;
//!
//! let touch = GaussianTouch { centre_m: [0.01, 0.0, 0.0], amplitude: 0.5, width_m: 0.008 };
//! assert_eq!(touch.value(&Surface::Plane, [0.01, 0.0, 0.0]), 0.5);
//! assert!((touch.value(&Surface::Plane, [0.018, 0.0, 0.0]) - 0.5 * (-0.5f64).exp()).abs() < 1e-12);
//! ```

use crate::elementary::{exp, unrolled};
use crate::quadrature::LocalFunction;
use dermis::design::TouchEffect;
use dermis::geom::vector::{distance, longest_edge};
use dermis::geom::{Point3, Surface};
use dermis::mesh::Mesh;
use thiserror::Error;

/// A touch or a noise that cannot be simulated.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum TouchError {
    /// A touch that would leave no conductance at its centre.
    #[error(
        "touches with an amplitude of {amplitude:.4} together leave no conductance where touches lower it: amplitudes must stay \
         below 1, those of all touches of a frame together"
    )]
    TooStrong {
        /// The amplitude, or the sum of those that overlap in one cell.
        amplitude: f64,
    },
    /// A number that must be positive and finite.
    #[error("{what} is {value}: it must be positive and finite")]
    NotPositive {
        /// The name of the number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A protocol for which the signal-to-noise ratio is not defined.
    #[error("every value of the protocol shares an electrode with its drive: the noise in dB is not defined")]
    NoUndrivenValue,
}

/// A touch as a Gaussian change of conductance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianTouch {
    /// Its centre on the surface, m.
    pub centre_m: Point3,
    /// Relative change of conductance at the centre: 1 doubles it.
    pub amplitude: f64,
    /// Standard deviation of the Gaussian along the surface, m.
    pub width_m: f64,
}

/// Distance in widths beyond which a Gaussian is below the resolution of a double relative to 1.
const REACH_WIDTHS: f64 = 8.6;

/// Longest edge of a cell in widths for which the quadrature rules are accurate enough: at 1 the mean over a triangle
/// is correct to 1e-6 of the amplitude, at 0.5 the coarser rule for tetrahedra to 1e-3. Larger cells are split.
pub(crate) const TRIANGLE_EDGE_WIDTHS: f64 = 1.0;
pub(crate) const TETRAHEDRON_EDGE_WIDTHS: f64 = 0.5;

impl GaussianTouch {
    /// The relative change of conductance at a point of the surface.
    pub fn value(&self, surface: &Surface, point_m: Point3) -> f64 {
        let chart = unrolled(surface);
        let [centre, point] = [self.centre_m, point_m].map(|point_m| chart.unroll_in_space(point_m));
        let squared_m2 = chart.squared_distance_m2(centre, point);
        self.amplitude * exp(-0.5 * squared_m2 / (self.width_m * self.width_m))
    }

    /// The mean of the change over each cell of a mesh, added to `sums` (one value per cell).
    ///
    /// The mean is used instead of the value at the cell's centre, because a cell has a constant conductivity, and
    /// because the integral of the touch is then independent of its position on the mesh.
    ///
    /// # Panics
    /// If the length of `sums` differs from the number of cells.
    pub(crate) fn add_cell_means(&self, surface: &Surface, mesh: &Mesh, sums: &mut [f64]) {
        self.over_cells(surface).add_cell_means(mesh, sums);
    }

    fn over_cells(&self, surface: &Surface) -> LocalFunction<impl Fn(&[Point3]) -> bool, impl Fn(Point3) -> f64> {
        LocalFunction {
            reaches: |corners: &[Point3]| self.reaches(corners),
            value: |point| self.value(surface, point),
            longest_edge_m: [TRIANGLE_EDGE_WIDTHS, TETRAHEDRON_EDGE_WIDTHS].map(|widths| widths * self.width_m),
        }
    }

    /// Whether the touch changes a cell: elsewhere it is 0 within the resolution of a double. A distance in space is at
    /// most the distance along the surface.
    fn reaches(&self, corners: &[Point3]) -> bool {
        distance(corners[0], self.centre_m) <= REACH_WIDTHS * self.width_m + longest_edge(corners)
    }
}

/// The conductivity of each cell with some touches on a skin with the given untouched conductivity.
///
/// # Errors
/// A width or amplitude that is not positive; touches that leave no conductance in a cell.
///
/// # Panics
/// If the length of `rest_conductivity` differs from the number of cells.
pub fn touched_conductivity(
    mesh: &Mesh,
    surface: &Surface,
    effect: TouchEffect,
    rest_conductivity: &[f64],
    touches: &[GaussianTouch],
) -> Result<Vec<f64>, TouchError> {
    let mut change = vec![0.0; rest_conductivity.len()];
    for touch in touches {
        for (what, value) in
            [("the width of a touch in m", touch.width_m), ("the amplitude of a touch", touch.amplitude)]
        {
            if !(value > 0.0 && value.is_finite()) {
                return Err(TouchError::NotPositive { what, value });
            }
        }
        touch.add_cell_means(surface, mesh, &mut change);
    }
    let sign = effect.sign();
    rest_conductivity
        .iter()
        .zip(change)
        .map(|(rest, change)| {
            let factor = 1.0 + sign * change;
            if factor > 0.0 { Ok(rest * factor) } else { Err(TouchError::TooStrong { amplitude: change }) }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::geom::vector::{add, scale};
    use dermis::mesh::Cells;
    use std::f64::consts::TAU;

    const WIDTH_M: f64 = 0.008;

    fn touch(x: f64, y: f64) -> GaussianTouch {
        GaussianTouch { centre_m: [x, y, 0.0], amplitude: 0.7, width_m: WIDTH_M }
    }

    fn weighted(corners: &[Point3], weights: &[f64]) -> Point3 {
        corners.iter().zip(weights).fold([0.0; 3], |sum, (&corner, &weight)| add(sum, scale(corner, weight)))
    }

    /// The mean by the midpoint rule on `n^2` equal parts of the triangle.
    fn fine_mean(touch: &GaussianTouch, [a, b, c]: [Point3; 3], n: usize) -> f64 {
        let at = |i: f64, j: f64| weighted(&[a, b, c], &[1.0 - (i + j) / n as f64, i / n as f64, j / n as f64]);
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n - i {
                let (u, v) = (i as f64, j as f64);
                sum += touch.value(&Surface::Plane, at(u + 1.0 / 3.0, v + 1.0 / 3.0));
                if i + j + 1 < n {
                    sum += touch.value(&Surface::Plane, at(u + 2.0 / 3.0, v + 2.0 / 3.0));
                }
            }
        }
        sum / (n * n) as f64
    }

    #[test]
    fn the_mean_over_a_triangle_agrees_with_a_fine_quadrature() {
        let mut worst = 0.0f64;
        for size in [0.3, 1.0, 4.0, 12.0] {
            let corners = [
                [0.0; 3],
                [size * WIDTH_M, 0.1 * size * WIDTH_M, 0.0],
                [0.2 * size * WIDTH_M, 0.9 * size * WIDTH_M, 0.0],
            ];
            for centre in [[0.0, 0.0], [0.004, 0.003], [-0.011, 0.02]] {
                let touch = touch(centre[0], centre[1]);
                let exact = fine_mean(&touch, corners, 2000);
                worst = worst.max((touch.over_cells(&Surface::Plane).triangle_mean(corners) - exact).abs());
            }
        }
        println!("largest error of a triangle's mean: {worst:.1e}");
        assert!(worst < 1e-6, "{worst}");
    }

    #[test]
    fn the_value_at_the_centre_is_not_the_mean() {
        let corners = [[0.0; 3], [0.016, 0.0, 0.0], [0.0, 0.016, 0.0]];
        let touch = touch(0.016 / 3.0, 0.016 / 3.0);
        assert!(touch.amplitude - touch.over_cells(&Surface::Plane).triangle_mean(corners) > 0.1);
    }

    #[test]
    fn a_gaussian_over_a_plane_integrates_to_two_pi_w2() {
        let n = 12;
        let step = 0.2 / n as f64;
        let nodes: Vec<Point3> =
            (0..=n).flat_map(|j| (0..=n).map(move |i| [i as f64 * step - 0.1, j as f64 * step - 0.1, 0.0])).collect();
        let mut cells = Vec::new();
        for j in 0..n {
            for i in 0..n {
                let corner = j * (n + 1) + i;
                cells.push([corner, corner + 1, corner + n + 2]);
                cells.push([corner, corner + n + 2, corner + n + 1]);
            }
        }
        let mesh = Mesh { nodes, cells: Cells::Triangles(cells), electrodes: vec![], regions: vec![] };
        let mut means = vec![0.0; mesh.cell_count()];
        let touch = touch(0.003, -0.004);
        touch.add_cell_means(&Surface::Plane, &mesh, &mut means);
        let integral: f64 = means.iter().enumerate().map(|(cell, mean)| mean * mesh.cell_measure(cell)).sum();
        let exact = TAU * 0.7 * WIDTH_M * WIDTH_M;
        println!("integral of a touch: relative error {:.1e}", (integral / exact - 1.0).abs());
        assert!((integral / exact - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_mean_over_a_tetrahedron_agrees_with_its_parts() {
        let size = 0.03;
        let corners = [[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]];
        let touch = GaussianTouch { centre_m: [0.01, 0.0, 0.008], amplitude: 1.0, width_m: WIDTH_M };
        // Midpoints of n^3 cubes that are inside x + y + z < size; the boundary layer gives an error of about 1 / n.
        let n = 240;
        let (mut sum, mut count) = (0.0, 0usize);
        for i in 0..n {
            for j in 0..n - i {
                for k in 0..n - i - j {
                    let at = [i, j, k].map(|index| (index as f64 + 0.25) * size / n as f64);
                    sum += touch.value(&Surface::Free, at);
                    count += 1;
                }
            }
        }
        let fine = sum / count as f64;
        let mean = touch.over_cells(&Surface::Free).tetrahedron_mean(corners);
        println!("mean over a tetrahedron {mean:.5}, by counting {fine:.5}");
        assert!((mean / fine - 1.0).abs() < 0.01);
    }

    #[test]
    fn touches_go_round_the_seam_and_the_sign_follows_the_skin() {
        let body = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
        let at = |theta: f64, z: f64| body.at(z, theta).unwrap();
        let mesh = Mesh {
            nodes: vec![at(-0.02, 0.1), at(0.02, 0.1), at(0.0, 0.102)],
            cells: Cells::Triangles(vec![[0, 1, 2]]),
            electrodes: vec![],
            regions: vec![],
        };
        let touch = GaussianTouch { centre_m: at(TAU - 0.01, 0.1), amplitude: 0.9, width_m: WIDTH_M };
        let rise = touched_conductivity(&mesh, &body, TouchEffect::ConductanceRises, &[2.0], &[touch]).unwrap()[0];
        let fall = touched_conductivity(&mesh, &body, TouchEffect::ConductanceFalls, &[2.0], &[touch]).unwrap()[0];
        assert!(rise > 3.6 && rise < 3.8, "{rise}");
        assert!((rise + fall - 4.0).abs() < 1e-12);
        let twice = touched_conductivity(&mesh, &body, TouchEffect::ConductanceFalls, &[2.0], &[touch, touch]);
        assert!(matches!(twice, Err(TouchError::TooStrong { amplitude }) if amplitude > 1.0));
    }
}
