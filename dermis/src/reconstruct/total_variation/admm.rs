//! Total variation by the alternating direction method of multipliers, with a bound of its error.
//!
//! With `z = D x` and the scaled multipliers `u` (Boyd et al. 2011, DOI 10.1561/2200000016, sections 3.1.1 and 6.4):
//!
//! ```text
//! x = argmin 1/2 |J x - d|^2 + rho/2 |D x - z + u|^2
//! h = a D x + (1 - a) z,    z = shrink(h + u, lambda / rho),    u = u + h - z
//! ```
//!
//! The first line costs one solution with `D'D` and two products, for any `rho`: with `k = (D'D)^-1 D'(z - u)` its
//! solution is `k` plus the one-step image of `d - J k` for the penalty `D'D` and `mu = rho` (see [`Modes`]).
//!
//! That line's solution satisfies `J'(d - J x) = D'p` with `p = rho (D x - z + u)`. By duality, for every `t` with
//! `t |p| <= lambda` in each pixel,
//!
//! ```text
//! t r'd - t^2/2 |r|^2  <=  min of the objective  <=  objective(x),    r = d - J x
//! ```

use super::gradients::{Gradients, norm};
use crate::linalg::Matrix;
use crate::reconstruct::ReconstructError;
use crate::reconstruct::prior::{FactoredGraph, Penalty};
use crate::reconstruct::system::{DataForm, Modes};
use faer::{Mat, MatRef};

/// `a`: from 1.5 to 1.8 is usual (Boyd et al. 2011, section 3.4.3).
const RELAXATION: f64 = 1.8;
/// Iterations from one computation of the bound to the next: it costs as much as an iteration.
const BOUND_EVERY: usize = 10;
/// `rho` is balanced this often, and no more after [`BALANCED_UNTIL`], because the method converges for a constant one.
const BALANCED_EVERY: usize = 20;
const BALANCED_UNTIL: usize = 400;

/// The problem without its data, in coordinates along the modes of the channels.
#[derive(Debug, Clone)]
pub(super) struct Admm {
    gradients: Gradients,
    laplacian: FactoredGraph,
    modes: Modes,
    /// Modes x channels, with orthonormal rows: data to coordinates.
    coordinates: Matrix,
    /// `J` in coordinates, modes x pixels.
    jacobian: Matrix,
    /// `J'`, pixels x modes.
    transposed: Matrix,
    /// Coordinates to images, pixels x modes.
    images: Matrix,
}

/// A minimum.
pub(super) struct Minimum {
    pub(super) image: Vec<f64>,
    /// The difference between the objective and its lower bound, over the objective.
    pub(super) gap: f64,
}

impl Admm {
    pub(super) fn new(
        jacobian: MatRef<'_, f64>,
        gradients: Gradients,
        neighbours: &[Vec<usize>],
    ) -> Result<Self, ReconstructError> {
        let graph = gradients.laplacian(neighbours)?;
        let laplacian = graph.factored()?;
        let modes = Modes::new(&DataForm::new(jacobian, &Penalty::Graph(graph))?)?;
        let in_modes = modes.channels.transpose() * jacobian;
        Ok(Admm {
            coordinates: row_major(modes.channels.transpose()),
            transposed: row_major(in_modes.transpose()),
            jacobian: row_major(in_modes.as_ref()),
            images: row_major(modes.pixels.as_ref()),
            gradients,
            laplacian,
            modes,
        })
    }

    /// Data in the coordinates of the problem. What is left out is explained by no image.
    pub(super) fn coordinates(&self, data: &[f64]) -> Vec<f64> {
        product(&self.coordinates, data)
    }

    /// `J'r`.
    pub(super) fn pull(&self, residual: &[f64]) -> Vec<f64> {
        product(&self.transposed, residual)
    }

    /// `d - J x`.
    pub(super) fn residual(&self, data: &[f64], image: &[f64]) -> Vec<f64> {
        let explained = product(&self.jacobian, image);
        data.iter().zip(explained).map(|(d, e)| d - e).collect()
    }

    /// The best image without variation.
    pub(super) fn flat(&self, data: &[f64]) -> Vec<f64> {
        self.one_step(data, f64::INFINITY)
    }

    /// The image with the penalty `mu |D x|^2`.
    fn one_step(&self, data: &[f64], mu: f64) -> Vec<f64> {
        let scaled: Vec<f64> = data.iter().zip(self.modes.gains(mu)).map(|(d, gain)| d * gain).collect();
        product(&self.images, &scaled)
    }

    /// The first `rho`: images of total variation have steps of about those of a smooth image, in few pixels. On
    /// simulated and real frames of `tank16` and `cylinder30` the balanced value is a half to twice this one.
    fn first_rho(&self, data: &[f64], weight: f64) -> f64 {
        /// Relative weight of the smooth image's penalty.
        const SMOOTH: f64 = 1e-3;
        /// Fraction of the pixels with steps.
        const WITH_STEPS: f64 = 0.02;
        let smooth = self.one_step(data, SMOOTH * self.modes.largest());
        let mut field = vec![0.0; self.gradients.len()];
        self.gradients.apply_into(&smooth, &mut field);
        let mut norms: Vec<f64> = self.gradients.norms(&field).collect();
        norms.sort_by(|a, b| b.total_cmp(a));
        norms.truncate((WITH_STEPS * norms.len() as f64).ceil() as usize);
        4.0 * weight * norms.len() as f64 / norms.iter().sum::<f64>()
    }

    /// Iterates until the gap is at most `tolerance` of the objective, or at most `max_iterations` times.
    pub(super) fn minimise(&self, data: &[f64], weight: f64, tolerance: f64, max_iterations: usize) -> Minimum {
        let steps = self.gradients.len();
        let mut rho = self.first_rho(data, weight);
        let mut minimum = Minimum { image: self.flat(data), gap: f64::INFINITY };
        if !rho.is_finite() {
            // No variation in any image of these data.
            return Minimum { gap: 0.0, ..minimum };
        }
        let (mut split, mut multipliers) = (vec![0.0; steps], vec![0.0; steps]);
        let (mut target, mut gradient, mut pull) = (vec![0.0; steps], vec![0.0; steps], vec![0.0; minimum.image.len()]);
        for iteration in 1..=max_iterations {
            difference_into(&split, &multipliers, &mut target);
            self.gradients.transposed_into(&target, &mut pull);
            minimum.image.copy_from_slice(&pull);
            self.laplacian.solve_in_place(&mut minimum.image);
            let smooth = self.one_step(&self.residual(data, &minimum.image), rho);
            minimum.image.iter_mut().zip(&smooth).for_each(|(value, part)| *value += part);
            self.gradients.apply_into(&minimum.image, &mut gradient);
            if iteration % BOUND_EVERY == 0 || iteration == max_iterations {
                minimum.gap = self.gap(data, weight, &minimum.image, &gradient, &target, rho);
                if minimum.gap <= tolerance {
                    break;
                }
            }
            let previous = split.clone();
            for (((split, u), g), previous) in split.iter_mut().zip(&mut multipliers).zip(&gradient).zip(&previous) {
                *u += RELAXATION * g + (1.0 - RELAXATION) * previous;
                *split = *u;
            }
            self.gradients.shrink(&mut split, weight / rho);
            multipliers.iter_mut().zip(&split).for_each(|(u, z)| *u -= z);
            if iteration % BALANCED_EVERY == 0 && iteration <= BALANCED_UNTIL {
                let factor = balance(&gradient, &split, &previous, &multipliers);
                rho *= factor;
                multipliers.iter_mut().for_each(|u| *u /= factor);
            }
        }
        minimum
    }

    /// The relative gap after the first line of an iteration.
    fn gap(&self, data: &[f64], weight: f64, image: &[f64], gradient: &[f64], target: &[f64], rho: f64) -> f64 {
        let residual = self.residual(data, image);
        let square = residual.iter().map(|r| r * r).sum::<f64>();
        let along = residual.iter().zip(data).map(|(r, d)| r * d).sum::<f64>();
        let objective = 0.5 * square + weight * self.gradients.norms(gradient).sum::<f64>();
        let flux: Vec<f64> = gradient.iter().zip(target).map(|(g, t)| rho * (g - t)).collect();
        let largest = self.gradients.norms(&flux).fold(0.0, f64::max);
        let scale = (weight / largest).min(along / square);
        let bound = if scale.is_finite() { scale * along - 0.5 * scale * scale * square } else { 0.0 };
        (objective - bound) / objective
    }
}

/// The factor for `rho` that brings the relative primal and dual residuals together (Wohlberg 2017, arXiv:1704.06209,
/// section III): 2 or 1/2 where one is more than five times the other.
fn balance(gradient: &[f64], split: &[f64], previous: &[f64], multipliers: &[f64]) -> f64 {
    let away = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let primal = away(gradient, split) / norm(gradient).max(norm(split));
    let dual = away(split, previous) / norm(multipliers);
    match primal / dual {
        ratio if ratio > 5.0 => 2.0,
        ratio if ratio < 0.2 => 0.5,
        _ => 1.0,
    }
}

fn difference_into(a: &[f64], b: &[f64], out: &mut [f64]) {
    out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| *out = a - b);
}

fn product(matrix: &Matrix, vector: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; matrix.rows];
    matrix.product_into(vector, &mut out);
    out
}

fn row_major(matrix: MatRef<'_, f64>) -> Matrix {
    let transposed: Mat<f64> = matrix.transpose().to_owned();
    let values = transposed.col_iter().flat_map(|column| column.iter().copied().collect::<Vec<f64>>()).collect();
    Matrix { rows: matrix.nrows(), columns: matrix.ncols(), values }
}
