//! A correlated random field on a surface.
//!
//! White noise on a regular grid, smoothed by a Gaussian kernel (process convolution: Higdon, 2002, DOI
//! 10.1007/978-1-4471-0657-9_2): with the kernel `exp(-d^2 / l^2)` the covariance at a distance `d` is
//! `exp(-d^2 / (2 l^2))`. Distances are along the surface, across the seam of a cylinder; on a body known only by its
//! mesh they are straight-line distances in space.

use crate::elementary::{Chart, exp, unrolled};
use crate::random::standard_normal;
use dermis::geom::vector::bounding_box;
use dermis::geom::{Point3, Surface};
use dermis::mesh::Mesh;
use pulp::{Simd, WithSimd};
use rand_chacha::ChaCha8Rng;
use std::ops::Range;

/// Grid points per correlation length: with two, the effect of the grid on the covariance is 3e-9
/// (`exp(-2 pi^2 (l / 2h)^2)`, Poisson's summation formula).
const POINTS_PER_LENGTH: f64 = 2.0;
/// Correlation lengths beyond which the kernel is truncated: `exp(-3.3^2) = 2e-5`.
const REACH_LENGTHS: f64 = 3.3;
/// Maximum number of grid points: more mean a correlation length far below the cell size of any mesh.
const MAX_POINTS: f64 = 2e7;

/// A Gaussian field of mean 0 and variance 1.
#[derive(Debug, Clone)]
pub(crate) struct CorrelatedField {
    chart: Chart,
    axes: Vec<Axis>,
    length_m: f64,
    noise: Vec<f64>,
}

/// One direction of the grid.
#[derive(Debug, Clone, Copy)]
struct Axis {
    first_m: f64,
    step_m: f64,
    count: usize,
    period_m: Option<f64>,
}

impl CorrelatedField {
    /// A field over the nodes of a mesh; `None` if the correlation length is too short for it.
    pub(super) fn new(surface: Surface, mesh: &Mesh, length_m: f64, rng: &mut ChaCha8Rng) -> Option<Self> {
        let (axes, count) = axes_over(surface, mesh, length_m)?;
        let noise = (0..count).map(|_| standard_normal(rng)).collect();
        Some(CorrelatedField { chart: unrolled(&surface), axes, length_m, noise })
    }

    /// The field at a point.
    pub(super) fn at(&self, point_m: Point3) -> f64 {
        let place = self.chart.unroll_in_space(point_m);
        let weights: Vec<Vec<(usize, f64)>> =
            self.axes.iter().zip(place).map(|(axis, place)| axis.weights(place, self.length_m)).collect();
        self.sum(&weights, 0)
    }

    /// The weighted sum over the axes from the given one on, at a grid index along the axes before.
    fn sum(&self, weights: &[Vec<(usize, f64)>], before: usize) -> f64 {
        let Some((first, rest)) = weights.split_first() else { return self.noise[before] };
        let count = self.axes[self.axes.len() - weights.len()].count;
        first.iter().map(|&(index, weight)| weight * self.sum(rest, before * count + index)).sum()
    }
}

/// The grid over the nodes of a mesh, and the number of its points.
fn axes_over(surface: Surface, mesh: &Mesh, length_m: f64) -> Option<(Vec<Axis>, usize)> {
    let dimensions = if surface == Surface::Free { 3 } else { 2 };
    let chart = unrolled(&surface);
    let [low_m, high_m] = bounding_box(mesh.nodes.iter().map(|&node| chart.unroll_in_space(node)));
    let axes: Vec<Axis> = (0..dimensions)
        .map(|index| match (index, chart.period_m()) {
            (0, Some(period_m)) => Axis::round(period_m, length_m),
            _ => Axis::between(low_m[index], high_m[index], length_m),
        })
        .collect();
    let points = axes.iter().map(|axis| axis.count as f64).product::<f64>();
    (points <= MAX_POINTS).then_some((axes, points as usize))
}

/// Precomputed noise weights for evaluating many fields at the same points.
///
/// [`draw`](Self::draw) gives the values of [`CorrelatedField::at`] for the same random numbers, up to rounding.
#[derive(Debug, Clone)]
pub(crate) struct FieldPlaces {
    noise_count: usize,
    points: Vec<NoiseUnder>,
    /// The starts of rows of noise, and their weights.
    rows: Vec<(usize, f64)>,
}

/// The noise that a point sees: some rows, with the same weights along each.
#[derive(Debug, Clone)]
struct NoiseUnder {
    rows: Range<usize>,
    /// Followed by zeros.
    along: Lanes,
}

/// At least the number of grid points within the reach of a kernel along an axis that is not periodic.
type Lanes = [f64; LANES];
const LANES: usize = 16;
const _: () = assert!(2.0 * REACH_LENGTHS * POINTS_PER_LENGTH + 1.0 <= LANES as f64);

impl FieldPlaces {
    /// The weights of some points, for fields over the nodes of a mesh; `None` if the correlation length is too short.
    pub(crate) fn new(surface: Surface, mesh: &Mesh, length_m: f64, points: &[Point3]) -> Option<Self> {
        let (axes, noise_count) = axes_over(surface, mesh, length_m)?;
        let (last, before) = axes.split_last()?;
        let mut places = FieldPlaces { noise_count, points: Vec::new(), rows: Vec::new() };
        for &point in points {
            let place = unrolled(&surface).unroll_in_space(point);
            // The last axis is never periodic, so that its points are contiguous.
            let along = last.weights(place[before.len()], length_m);
            let first = along.first()?.0;
            let mut rows = vec![(0, 1.0)];
            for (axis, place) in before.iter().zip(place) {
                let across = axis.weights(place, length_m);
                let next = rows.iter().flat_map(|&(row, weight)| {
                    across.iter().map(move |&(index, more)| (row * axis.count + index, weight * more))
                });
                rows = next.collect();
            }
            let from = places.rows.len();
            places.rows.extend(rows.into_iter().map(|(row, weight)| (row * last.count + first, weight)));
            let mut lanes = [0.0; LANES];
            lanes.iter_mut().zip(&along).for_each(|(lane, (_, weight))| *lane = *weight);
            places.points.push(NoiseUnder { rows: from..places.rows.len(), along: lanes });
        }
        Some(places)
    }

    /// A new field at all of the points.
    pub(crate) fn draw(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut noise: Vec<f64> = (0..self.noise_count).map(|_| standard_normal(rng)).collect();
        // The last lanes of the last row.
        noise.resize(self.noise_count + LANES, 0.0);
        let mut values = vec![0.0; self.points.len()];
        pulp::Arch::new().dispatch(Smooth { places: self, noise: &noise, values: &mut values });
        values
    }
}

/// The weighted sums of a noise, one for each point.
struct Smooth<'a> {
    places: &'a FieldPlaces,
    noise: &'a [f64],
    values: &'a mut [f64],
}

impl WithSimd for Smooth<'_> {
    type Output = ();

    /// Compiled once per instruction set, with the same bits: no operation is fused, and the sums have eight parts
    /// everywhere.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let FieldPlaces { points, rows, .. } = self.places;
        for (value, NoiseUnder { rows: own, along }) in self.values.iter_mut().zip(points) {
            let mut across = [0.0; LANES];
            for &(first, weight) in &rows[own.clone()] {
                let noise = &self.noise[first..first + LANES];
                for lane in 0..LANES {
                    across[lane] += weight * noise[lane];
                }
            }
            let mut sums = [0.0; 8];
            for lane in 0..LANES {
                sums[lane % 8] += along[lane] * across[lane];
            }
            *value = ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
        }
    }
}

impl Axis {
    fn round(period_m: f64, length_m: f64) -> Self {
        let count = (POINTS_PER_LENGTH * period_m / length_m).ceil().max(1.0);
        Axis { first_m: 0.0, step_m: period_m / count, count: count as usize, period_m: Some(period_m) }
    }

    fn between(low_m: f64, high_m: f64, length_m: f64) -> Self {
        let (first_m, step_m) = (low_m - REACH_LENGTHS * length_m, length_m / POINTS_PER_LENGTH);
        let count = ((high_m - low_m) / step_m + 2.0 * REACH_LENGTHS * POINTS_PER_LENGTH).ceil() + 1.0;
        Axis { first_m, step_m, count: count as usize, period_m: None }
    }

    /// The grid points within the kernel radius of a position, with their weights, whose squares sum to 1.
    fn weights(&self, place_m: f64, length_m: f64) -> Vec<(usize, f64)> {
        let reach_m = REACH_LENGTHS * length_m;
        let first = ((place_m - reach_m - self.first_m) / self.step_m).ceil() as i64;
        let last = ((place_m + reach_m - self.first_m) / self.step_m).floor() as i64;
        let mut weights: Vec<(usize, f64)> = Vec::new();
        for index in first..=last {
            let off = (self.first_m + index as f64 * self.step_m - place_m) / length_m;
            let weight = exp(-off * off);
            if self.period_m.is_none() {
                if (0..self.count as i64).contains(&index) {
                    weights.push((index as usize, weight));
                }
                continue;
            }
            // Several periods of a short axis coincide in one point.
            let index = index.rem_euclid(self.count as i64) as usize;
            match weights.iter_mut().find(|entry| entry.0 == index) {
                Some(entry) => entry.1 += weight,
                None => weights.push((index, weight)),
            }
        }
        let norm = weights.iter().map(|(_, weight)| weight * weight).sum::<f64>().sqrt();
        weights.iter_mut().for_each(|(_, weight)| *weight /= norm);
        weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::sample_rng;
    use dermis::mesh::Cells;

    const LENGTH_M: f64 = 0.04;

    /// Mean product of the field at pairs of points over many draws.
    fn covariances(surface: Surface, corners: [Point3; 2], pairs: &[[Point3; 2]]) -> Vec<f64> {
        let mesh =
            Mesh { nodes: corners.to_vec(), cells: Cells::Triangles(vec![]), electrodes: vec![], regions: vec![] };
        let draws = 4000;
        let mut sums = vec![0.0; pairs.len()];
        for draw in 0..draws {
            let field = CorrelatedField::new(surface, &mesh, LENGTH_M, &mut sample_rng(5, draw)).unwrap();
            for (sum, pair) in sums.iter_mut().zip(pairs) {
                *sum += field.at(pair[0]) * field.at(pair[1]);
            }
        }
        sums.iter().map(|sum| sum / draws as f64).collect()
    }

    /// A mean of 4,000 products of unit normals has a standard deviation of at most 1.41 / 63 = 0.022.
    const TOLERANCE: f64 = 0.07;

    #[test]
    fn variance_and_correlation_are_as_stated_and_go_round_the_seam() {
        let body = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
        let at = |z: f64, s: f64| body.at(z, s / 0.05).unwrap();
        let pairs = [
            [at(0.1, 0.1), at(0.1, 0.1)],
            [at(0.0, 0.2), at(0.0, 0.2)],
            [at(0.1, 0.1), at(0.14, 0.1)],
            [at(0.1, 0.1), at(0.124, 0.132)],
            [at(0.1, 0.1), at(0.1, 0.16)],
            [at(0.1, 0.01), at(0.1, -0.03)],
            [at(0.3, 0.1), at(0.1, 0.1)],
        ];
        let found = covariances(body, [at(0.0, 0.0), at(0.3, 0.1)], &pairs);
        for (pair, found) in pairs.iter().zip(&found) {
            let apart = body.distance_m(pair[0], pair[1]) / LENGTH_M;
            let exact = (-0.5 * apart * apart).exp();
            println!("{apart:.2} correlation lengths apart: covariance {found:.3}, exact {exact:.3}");
            assert!((found - exact).abs() < TOLERANCE);
        }
    }

    #[test]
    fn points_computed_once_see_the_same_field() {
        let body = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
        let points: Vec<Point3> = (0..50).map(|k| body.at(0.006 * k as f64, 1.7 * k as f64).unwrap()).collect();
        for surface in [body, Surface::Free] {
            let mesh =
                Mesh { nodes: points.clone(), cells: Cells::Triangles(vec![]), electrodes: vec![], regions: vec![] };
            let field = CorrelatedField::new(surface, &mesh, LENGTH_M, &mut sample_rng(6, 1)).unwrap();
            let places = FieldPlaces::new(surface, &mesh, LENGTH_M, &points).unwrap();
            for (value, &point) in places.draw(&mut sample_rng(6, 1)).iter().zip(&points) {
                assert!((value - field.at(point)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_field_through_space_has_its_covariance_too() {
        let pairs = [[[0.0; 3], [0.0; 3]], [[0.0; 3], [0.02, 0.02, 0.02]]];
        let found = covariances(Surface::Free, [[0.0; 3], [0.05; 3]], &pairs);
        let exact = (-0.5f64 * 0.75).exp();
        println!("in space: variance {:.3}, covariance {:.3}, exact {exact:.3}", found[0], found[1]);
        assert!((found[0] - 1.0).abs() < TOLERANCE && (found[1] - exact).abs() < TOLERANCE);
    }

    #[test]
    fn a_length_far_below_any_mesh_is_refused() {
        let nodes = vec![[0.0; 3], [1.0; 3]];
        let mesh = Mesh { nodes, cells: Cells::Triangles(vec![]), electrodes: vec![], regions: vec![] };
        assert!(CorrelatedField::new(Surface::Plane, &mesh, 1e-5, &mut sample_rng(1, 0)).is_none());
    }
}
