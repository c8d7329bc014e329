//! The posterior of a position, from the residuals of a frame at the nodes of a region.

use crate::locate::Locator;
use crate::located::{Located, REGION_SHARE, limit};
use dermis::geom::Point3;
use dermis::geom::vector::{add, distance, dot, scale, sub};
use rayon::prelude::*;

/// Degrees of freedom of the Student t distribution of the residuals: some frames are far off.
const DEGREES_OF_FREEDOM: f64 = 5.0;
/// A triangle is divided where the logarithm of its posterior density is at most this far below the largest.
const DIVIDED_WITHIN: f64 = 14.0;
/// Parts of each edge of a divided triangle.
const PARTS: usize = 5;
/// Triangles that are divided, at most: a posterior that is wider needs no finer resolution.
const MAX_DIVIDED: usize = 400;
/// A contact counts as found if it lies within this distance, m: the gate of scores and confidences.
const GATE_M: f64 = dermis::contact::GATE_M;

/// What a frame states about the position of a press.
pub(crate) struct Posterior<'a> {
    locator: &'a Locator,
    /// The whitened residual at a node.
    residual: Box<dyn Fn(usize) -> Vec<f64> + Send + Sync + 'a>,
    /// Squared whitened residual at each node; infinite where the press is not looked for.
    squares: Vec<f64>,
    /// Factor on the response of a labelled press.
    amplitude: f64,
    /// Squared whitened difference of the frame from the untouched one, at the same scale as the residuals.
    untouched_square: f64,
}

/// A point of the posterior.
struct Candidate {
    triangle: usize,
    position_m: Point3,
    log_density: f64,
    area_m2: f64,
}

impl<'a> Posterior<'a> {
    /// The posterior of a touch of an amplitude, from its whitened residuals at the nodes of the locator's region,
    /// their squares, and that of the difference from the untouched frame.
    pub(crate) fn new(
        locator: &'a Locator,
        amplitude: f64,
        residual: impl Fn(usize) -> Vec<f64> + Send + Sync + 'a,
        squares: Vec<f64>,
        untouched_square: f64,
    ) -> Self {
        Posterior { locator, residual: Box::new(residual), squares, amplitude, untouched_square }
    }

    /// Whether the frame is nearer to the untouched one than to that of any press.
    pub(crate) fn is_untouched(&self) -> bool {
        self.untouched_square <= self.squares.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The posterior's mean and covariance, with the likelihood raised to a power.
    pub(crate) fn located(&self, temperature: f64) -> Located {
        let nodes = self.log_densities(temperature);
        let best = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let triangles = &self.locator.region().triangles;
        let highest =
            |triangle: &[usize; 3]| triangle.iter().map(|&node| nodes[node]).fold(f64::NEG_INFINITY, f64::max);
        let likely: Vec<usize> =
            (0..triangles.len()).filter(|&number| highest(&triangles[number]) > best - DIVIDED_WITHIN).collect();
        let parts = if likely.len() <= MAX_DIVIDED { PARTS } else { 1 };
        let candidates: Vec<Candidate> =
            likely.iter().flat_map(|&number| self.divide(number, parts, temperature)).collect();
        let node = (0..nodes.len()).max_by(|&a, &b| nodes[a].total_cmp(&nodes[b])).expect("a region has nodes");
        let (position_m, covariance_m2, triangle) = moments(&candidates);
        let located = Located {
            position_m,
            covariance_m2,
            confidence: 0.0,
            normal: self.locator.region().normal(triangle),
            misfit: self.squares[node] / (self.locator.variances()[node] * self.locator.component_count() as f64),
            amplitude: self.amplitude,
        };
        on_surface(located, &candidates)
    }

    /// The density at each node of the region, relative to the largest.
    pub(crate) fn relative_density(&self, temperature: f64) -> Vec<f64> {
        let nodes = self.log_densities(temperature);
        let best = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        nodes.into_iter().map(|value| (value - best).exp()).collect()
    }

    /// The logarithm of the integral of the likelihood over the region, without a constant.
    pub(crate) fn log_evidence(&self) -> f64 {
        let nodes = self.log_densities(1.0);
        let best = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        best + nodes.iter().map(|value| (value - best).exp()).sum::<f64>().ln()
    }

    fn log_densities(&self, temperature: f64) -> Vec<f64> {
        let squares = self.squares.iter().zip(self.locator.variances());
        squares
            .map(|(square, variance)| temperature * log_student(*square, *variance, self.locator.component_count()))
            .collect()
    }

    /// Points inside a triangle. The response is linear within it, so its squared residual is a quadratic form of the
    /// barycentric coordinates.
    fn divide(&self, number: usize, parts: usize, temperature: f64) -> Vec<Candidate> {
        let locator = self.locator;
        let triangle = locator.region().triangles[number];
        let gram = self.gram(triangle);
        let area_m2 = locator.areas_m2()[number] / (parts * parts) as f64;
        let candidate = |weights: [f64; 3]| {
            let square: f64 = (0..3).map(|i| (0..3).map(|j| weights[i] * weights[j] * gram[i][j]).sum::<f64>()).sum();
            let variance: f64 = (0..3).map(|i| weights[i] * locator.variances()[triangle[i]]).sum();
            let corner = |i: usize| scale(locator.region().nodes[triangle[i]], weights[i]);
            Candidate {
                triangle: number,
                position_m: add(add(corner(0), corner(1)), corner(2)),
                log_density: temperature * log_student(square.max(0.0), variance, locator.component_count()),
                area_m2,
            }
        };
        centres_of_parts(parts).map(candidate).collect()
    }

    /// The scalar products of the residuals at the corners.
    fn gram(&self, triangle: [usize; 3]) -> [[f64; 3]; 3] {
        let residuals = triangle.map(|node| (self.residual)(node));
        let product = |i: usize, j: usize| residuals[i].iter().zip(&residuals[j]).map(|(a, b)| a * b).sum();
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| product(i, j)))
    }
}

/// The logarithm of the multivariate Student t density of a squared whitened residual, without its constant.
pub(crate) fn log_student(square: f64, variance: f64, components: usize) -> f64 {
    let components = components as f64;
    -0.5 * (DEGREES_OF_FREEDOM + components) * (square / (variance * DEGREES_OF_FREEDOM)).ln_1p()
        - 0.5 * components * variance.ln()
}

/// The barycentric coordinates of the centres of the `parts^2` equal triangles of a triangle.
fn centres_of_parts(parts: usize) -> impl Iterator<Item = [f64; 3]> {
    let third = 1.0 / 3.0;
    let upright = (0..parts).flat_map(move |i| (0..parts - i).map(move |j| (i as f64 + third, j as f64 + third)));
    let inverted = (0..parts.saturating_sub(1))
        .flat_map(move |i| (0..parts - 1 - i).map(move |j| (i as f64 + 2.0 * third, j as f64 + 2.0 * third)));
    upright.chain(inverted).map(move |(i, j)| {
        let (a, b) = (i / parts as f64, j / parts as f64);
        [a, b, 1.0 - a - b]
    })
}

/// The weights of candidates in the posterior; their sum is 1.
fn weights(candidates: &[Candidate]) -> Vec<f64> {
    let best = candidates.iter().map(|candidate| candidate.log_density).fold(f64::NEG_INFINITY, f64::max);
    let mut weights: Vec<f64> =
        candidates.iter().map(|candidate| candidate.area_m2 * (candidate.log_density - best).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= total);
    weights
}

/// Mean and covariance of the posterior, and the triangle nearest to the mean.
fn moments(candidates: &[Candidate]) -> (Point3, [[f64; 3]; 3], usize) {
    let weights = weights(candidates);
    let weighted = |value: &dyn Fn(&Candidate) -> f64| {
        candidates.iter().zip(&weights).map(|(candidate, weight)| weight * value(candidate)).sum::<f64>()
    };
    let mean_m = [0, 1, 2].map(|axis| weighted(&|candidate| candidate.position_m[axis]));
    let off = |candidate: &Candidate| sub(candidate.position_m, mean_m);
    let covariance_m2 =
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| weighted(&|candidate| off(candidate)[i] * off(candidate)[j])));
    (mean_m, covariance_m2, nearest(candidates, mean_m).triangle)
}

/// The same with the mean moved along the normal onto the surface, and the probability of a position near it.
fn on_surface(located: Located, candidates: &[Candidate]) -> Located {
    let off_m = dot(sub(located.position_m, nearest(candidates, located.position_m).position_m), located.normal);
    let position_m = sub(located.position_m, scale(located.normal, off_m));
    let near = candidates.iter().zip(weights(candidates));
    let near = near.filter(|(candidate, _)| distance(candidate.position_m, position_m) <= GATE_M);
    Located { position_m, confidence: near.map(|(_, weight)| weight).sum::<f64>().min(1.0), ..located }
}

fn nearest(candidates: &[Candidate], position_m: Point3) -> &Candidate {
    let apart = |candidate: &Candidate| distance(candidate.position_m, position_m);
    let closer = |a: &&Candidate, b: &&Candidate| apart(a).total_cmp(&apart(b));
    candidates.iter().min_by(closer).expect("at least one candidate")
}

/// The exponent of the likelihood with which 95 % of the regions contain the true position.
pub(crate) fn fit_temperature(posteriors: &[Posterior<'_>], truth_m: &[Point3]) -> f64 {
    let limit = limit(REGION_SHARE);
    let covered = |temperature: f64| {
        let inside = posteriors.par_iter().zip(truth_m).filter(|(posterior, truth_m)| {
            let located = posterior.located(temperature);
            located.squared_distance(**truth_m) <= limit
        });
        inside.count() as f64 / truth_m.len() as f64
    };
    // The share falls with the exponent.
    let (mut low, mut high) = (0.003_f64.ln(), 3.0_f64.ln());
    for _ in 0..14 {
        let middle: f64 = 0.5 * (low + high);
        if covered(middle.exp()) > REGION_SHARE { low = middle } else { high = middle }
    }
    (0.5 * (low + high)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_triangle_have_its_centre_and_its_second_moments() {
        for parts in [1, 2, 5] {
            let centres: Vec<[f64; 3]> = centres_of_parts(parts).collect();
            assert_eq!(centres.len(), parts * parts);
            for axis in 0..3 {
                let mean = centres.iter().map(|centre| centre[axis]).sum::<f64>() / centres.len() as f64;
                assert!((mean - 1.0 / 3.0).abs() < 1e-12);
            }
        }
        // The second moment of a barycentric coordinate over a triangle is 1/6.
        let square = centres_of_parts(40).map(|centre| centre[0] * centre[0]).sum::<f64>() / 1600.0;
        assert!((square - 1.0 / 6.0).abs() < 1e-4, "{square}");
    }
}
