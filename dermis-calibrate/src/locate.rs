//! The position of a press from its frame: the inverse of the forward map by its likelihood.

use crate::covariance::PressInput;
use crate::error::CalibrateError;
use crate::forward_map::{ForwardMap, Hyperparameters, Samples};
use crate::region::Region;
use dermis::geom::Point3;
use dermis::geom::vector::{add, cross, distance, dot, normalize, scale, sub};
use faer::Mat;
use rayon::prelude::*;

/// Share of the regions that contain the true position.
pub const REGION_SHARE: f64 = 0.95;
/// Degrees of freedom of the Student t distribution of the residuals: some frames are far off.
const DEGREES_OF_FREEDOM: f64 = 5.0;
/// A triangle is divided where the logarithm of its posterior density is at most this far below the largest.
const DIVIDED_WITHIN: f64 = 14.0;
/// Parts of each edge of a divided triangle.
const PARTS: usize = 5;
/// Standard deviation below which a posterior is not resolved, m.
const SMALLEST_SD_M: f64 = 1e-5;
/// Triangles that are divided, at most: a posterior that is wider needs no finer resolution.
const MOST_DIVIDED: usize = 400;
/// A contact counts as found if it lies within this distance, m: the gate of scores and confidences.
const GATE_M: f64 = dermis::detect::GATE_M;

/// The posterior of a press's position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Mean position, m.
    pub position_m: Point3,
    /// Covariance of the position, m2.
    pub covariance_m2: [[f64; 3]; 3],
    /// Probability of a position within 20 mm of the mean.
    pub confidence: f64,
    /// Outward or inward unit normal of the skin there.
    pub normal: Point3,
    /// Mean square of the whitened residuals in their standard deviations at the most likely position: about 1 for a press like
    /// the labelled ones.
    pub misfit: f64,
    /// Smallest squared whitened residual of all positions.
    pub(crate) square: f64,
}

impl Located {
    /// Whether the region of 95 % of the posterior, an ellipse about the mean, contains a position.
    pub fn region_contains(&self, position_m: Point3) -> bool {
        self.squared_distance(position_m) <= limit(REGION_SHARE)
    }

    /// The squared distance of a position in units of the covariance, along the surface.
    fn squared_distance(&self, position_m: Point3) -> f64 {
        let error = sub(position_m, self.position_m);
        let tangents = tangents(self.normal);
        let covariance = |i: usize, j: usize| {
            let times = |k: usize| dot(self.covariance_m2[k], tangents[j]);
            (0..3).map(|k| tangents[i][k] * times(k)).sum::<f64>() + if i == j { SMALLEST_SD_M.powi(2) } else { 0.0 }
        };
        let [a, b, c] = [covariance(0, 0), covariance(0, 1), covariance(1, 1)];
        let [x, y] = tangents.map(|tangent| dot(error, tangent));
        (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
    }

    /// The same with the mean moved along the normal onto the surface, and the probability of a position near it.
    fn on_surface(self, candidates: &[Candidate]) -> Self {
        let off_m = dot(sub(self.position_m, nearest(candidates, self.position_m).position_m), self.normal);
        let position_m = sub(self.position_m, scale(self.normal, off_m));
        let near = candidates.iter().zip(weights(candidates));
        let near = near.filter(|(candidate, _)| distance(candidate.position_m, position_m) <= GATE_M);
        Located { position_m, confidence: near.map(|(_, weight)| weight).sum::<f64>().min(1.0), ..self }
    }

    /// Standard deviation per axis of the surface, m.
    pub fn sd_m(&self) -> f64 {
        (0.5 * (0..3).map(|axis| self.covariance_m2[axis][axis]).sum::<f64>()).sqrt()
    }
}

/// A forward map with its response at every node of a region.
#[derive(Debug, Clone)]
pub(crate) struct Locator {
    map: ForwardMap,
    whitening: Mat<f64>,
    region: Region,
    /// Areas of the triangles, m2.
    areas_m2: Vec<f64>,
    /// Responses at the nodes without the history, nodes x channels.
    responses: Vec<f64>,
    /// Change of the responses per unit of the position before along an axis, nodes x channels.
    shifts: Vec<(usize, Vec<f64>)>,
    /// Variance of the residuals at the nodes: that of the noise, 1, and that of the map.
    variances: Vec<f64>,
    /// Exponent of the likelihood: below 1 where residuals are less independent than their covariance states.
    pub temperature: f64,
}

/// A point of the posterior.
struct Candidate {
    triangle: usize,
    position_m: Point3,
    log_density: f64,
    area_m2: f64,
}

impl Locator {
    /// Conditions the map on samples and computes its responses.
    pub(crate) fn new(
        samples: &Samples,
        hyperparameters: &Hyperparameters,
        region: &Region,
    ) -> Result<Self, CalibrateError> {
        let (map, factor) = ForwardMap::condition(samples, hyperparameters)?;
        let variances = map.variances(&region.nodes, &factor).into_iter().map(|variance| 1.0 + variance).collect();
        Ok(Self::assemble(map, hyperparameters.whitening.clone(), region.clone(), variances, 1.0))
    }

    /// A locator of stored parts; the responses are computed.
    pub(crate) fn assemble(
        map: ForwardMap,
        whitening: Mat<f64>,
        region: Region,
        variances: Vec<f64>,
        temperature: f64,
    ) -> Self {
        let (responses, shifts) = map.responses(&region.nodes);
        let areas_m2 = region.triangles.iter().map(|triangle| region.triangle_area_m2(triangle)).collect();
        Locator { map, whitening, region, areas_m2, responses, shifts, variances, temperature }
    }

    pub(crate) fn map(&self) -> &ForwardMap {
        &self.map
    }

    pub(crate) fn whitening(&self) -> &Mat<f64> {
        &self.whitening
    }

    pub(crate) fn region(&self) -> &Region {
        &self.region
    }

    pub(crate) fn variances(&self) -> &[f64] {
        &self.variances
    }

    /// Locates the press of a frame, in units of the channels.
    pub(crate) fn locate(&self, values: &[f64], previous_m: Option<Point3>, number: f64) -> Located {
        self.posterior(values, previous_m, number).located(self.temperature)
    }

    /// The squared distance of two frames, whitened.
    pub(crate) fn whitened_square(&self, a: &[f64], b: &[f64]) -> f64 {
        let component = |column: usize| {
            let weights = self.whitening.col(column).iter();
            weights.zip(a.iter().zip(b)).map(|(weight, (a, b))| weight * (a - b)).sum::<f64>()
        };
        (0..self.whitening.ncols()).map(|column| component(column).powi(2)).sum()
    }

    /// The squared whitened residuals over the region.
    pub(crate) fn posterior(&self, values: &[f64], previous_m: Option<Point3>, number: f64) -> Posterior<'_> {
        let previous_m = previous_m.unwrap_or(self.map.extent.centre_m);
        let press = PressInput { position_m: self.map.extent.centre_m, previous_m, number };
        let history = self.map.history(&press);
        let channels = self.map.component_count();
        let target: Vec<f64> = (0..channels)
            .map(|j| self.whitening.col(j).iter().zip(values).map(|(w, v)| w * v).sum::<f64>() - history[j])
            .collect();
        let relative = self.map.extent.relative(previous_m);
        let shifts: Vec<(f64, &[f64])> =
            self.shifts.iter().map(|(axis, table)| (relative[*axis], table.as_slice())).collect();
        let squares = (0..self.region.nodes.len())
            .map(|node| {
                let row = node * channels..(node + 1) * channels;
                let residual = self.residual(&target, &shifts, row);
                residual.iter().map(|value| value * value).sum()
            })
            .collect();
        Posterior { locator: self, target, relative, squares }
    }

    fn residual(&self, target: &[f64], shifts: &[(f64, &[f64])], row: std::ops::Range<usize>) -> Vec<f64> {
        let mut residual: Vec<f64> =
            target.iter().zip(&self.responses[row.clone()]).map(|(value, response)| value - response).collect();
        for (factor, table) in shifts {
            residual.iter_mut().zip(&table[row.clone()]).for_each(|(value, shift)| *value -= factor * shift);
        }
        residual
    }
}

/// What a frame states about its position.
pub(crate) struct Posterior<'a> {
    locator: &'a Locator,
    target: Vec<f64>,
    relative: Point3,
    /// Squared whitened residual at each node.
    squares: Vec<f64>,
}

impl Posterior<'_> {
    /// The posterior's mean and covariance, with the likelihood raised to a power.
    pub(crate) fn located(&self, temperature: f64) -> Located {
        let nodes = self.log_densities(temperature);
        let best = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let triangles = &self.locator.region.triangles;
        let highest =
            |triangle: &[usize; 3]| triangle.iter().map(|&node| nodes[node]).fold(f64::NEG_INFINITY, f64::max);
        let likely: Vec<usize> =
            (0..triangles.len()).filter(|&number| highest(&triangles[number]) > best - DIVIDED_WITHIN).collect();
        let parts = if likely.len() <= MOST_DIVIDED { PARTS } else { 1 };
        let candidates: Vec<Candidate> =
            likely.iter().flat_map(|&number| self.divide(number, parts, temperature)).collect();
        let node = (0..nodes.len()).max_by(|&a, &b| nodes[a].total_cmp(&nodes[b])).expect("a region has nodes");
        let (position_m, covariance_m2, triangle) = moments(&candidates);
        let located = Located {
            position_m,
            covariance_m2,
            confidence: 0.0,
            normal: self.locator.region.normal(triangle),
            misfit: self.squares[node] / (self.locator.variances[node] * self.target.len() as f64),
            square: self.squares.iter().copied().fold(f64::INFINITY, f64::min),
        };
        located.on_surface(&candidates)
    }

    /// The density at each node of the region, relative to the largest.
    pub(crate) fn relative_density(&self, temperature: f64) -> Vec<f64> {
        let nodes = self.log_densities(temperature);
        let best = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        nodes.into_iter().map(|value| (value - best).exp()).collect()
    }

    fn log_densities(&self, temperature: f64) -> Vec<f64> {
        let squares = self.squares.iter().zip(&self.locator.variances);
        squares.map(|(square, variance)| temperature * self.log_likelihood(*square, *variance)).collect()
    }

    /// The logarithm of the multivariate Student t density, without its constant.
    fn log_likelihood(&self, square: f64, variance: f64) -> f64 {
        let channels = self.target.len() as f64;
        -0.5 * (DEGREES_OF_FREEDOM + channels) * (square / (variance * DEGREES_OF_FREEDOM)).ln_1p()
            - 0.5 * channels * variance.ln()
    }

    /// Points inside a triangle. The response is linear within it, so its squared residual is a quadratic form of the
    /// barycentric coordinates.
    fn divide(&self, number: usize, parts: usize, temperature: f64) -> Vec<Candidate> {
        let locator = self.locator;
        let triangle = locator.region.triangles[number];
        let gram = self.gram(triangle);
        let area_m2 = locator.areas_m2[number] / (parts * parts) as f64;
        let candidate = |weights: [f64; 3]| {
            let square: f64 = (0..3).map(|i| (0..3).map(|j| weights[i] * weights[j] * gram[i][j]).sum::<f64>()).sum();
            let variance: f64 = (0..3).map(|i| weights[i] * locator.variances[triangle[i]]).sum();
            let corner = |i: usize| scale(locator.region.nodes[triangle[i]], weights[i]);
            Candidate {
                triangle: number,
                position_m: add(add(corner(0), corner(1)), corner(2)),
                log_density: temperature * self.log_likelihood(square.max(0.0), variance),
                area_m2,
            }
        };
        centres_of_parts(parts).map(candidate).collect()
    }

    /// The scalar products of the residuals at the corners.
    fn gram(&self, triangle: [usize; 3]) -> [[f64; 3]; 3] {
        let channels = self.target.len();
        let shifts: Vec<(f64, &[f64])> =
            self.locator.shifts.iter().map(|(axis, table)| (self.relative[*axis], table.as_slice())).collect();
        let residuals =
            triangle.map(|node| self.locator.residual(&self.target, &shifts, node * channels..(node + 1) * channels));
        let product = |i: usize, j: usize| residuals[i].iter().zip(&residuals[j]).map(|(a, b)| a * b).sum();
        [0, 1, 2].map(|i| [0, 1, 2].map(|j| product(i, j)))
    }
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

/// Two unit vectors along the surface.
fn tangents(normal: Point3) -> [Point3; 2] {
    let axis = if normal[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let first = normalize(cross(axis, normal));
    [first, cross(normal, first)]
}

/// The squared distance in standard deviations within which two normal variables lie with a probability.
fn limit(share: f64) -> f64 {
    -2.0 * (1.0 - share).ln()
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
