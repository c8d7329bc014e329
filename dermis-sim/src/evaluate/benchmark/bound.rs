//! What the bounds of a skin allow for the figures of a benchmark.

use super::{Benchmark, BenchmarkOptions, least_force, separation};
use crate::bound::{BoundOptions, Bounds};
use crate::experiment::Presses;
use crate::twin::Press;
use dermis::design::SkinDesign;
use dermis::stats::mean;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;

/// The bounds are those of every n-th press on the grid, and of one in some pairs: their mean is within a few per cent of
/// that of all.
const SINGLES_STEP: usize = 5;
const PAIRS_STEP: usize = 10;
/// Touches that are told from one with this probability at one distance are so at all greater ones, too.
const CERTAIN: f64 = 0.9999;

/// The bounds of the figures of a benchmark: for single frames of the skin as designed, without its manufacturing errors;
/// but for the misses, with all electrodes.
#[derive(Debug, Clone, Serialize)]
pub struct BenchmarkBound {
    /// Expected number of the single presses on the grid and at random places that one frame does not show without the
    /// disconnected electrodes, at one false alarm an hour; mean of the twins. `None` with all electrodes.
    pub misses: Option<[f64; 2]>,
    /// Mean localisation error of single presses, m.
    pub localisation_m: f64,
    /// Median and 95th percentile of the smallest force that is found, N.
    pub least_force_n: [f64; 2],
    /// For each distance of two touches: the distance (m) and the mean probability with which they are told from one.
    /// Empty on a body from a mesh, along which presses cannot be displaced.
    pub two_resolved: Vec<(f64, f64)>,
}

impl BenchmarkBound {
    /// The smallest distance such that at least 90 % of the pairs are told from one at this and every greater tested
    /// distance, m; `NaN` if there is none.
    pub fn resolved_from_m(&self) -> f64 {
        separation::resolved_from_m(&self.two_resolved)
    }

    /// The share of the pairs that is told from one at a tested distance (m), `NaN` at any other.
    pub fn resolved_at(&self, separation_m: f64) -> f64 {
        separation::resolved_at(&self.two_resolved, separation_m)
    }
}

impl Benchmark<'_> {
    /// The bounds for presses as [`run`](Self::run) draws them from seeds: the misses for those of all, the others for
    /// those of the first. `None` for twins without noise, whose bounds are zero. Does not depend on the method.
    ///
    /// # Errors
    /// As [`Bounds::new`]; presses that the twin cannot simulate.
    pub fn bound(&self, seeds: Range<u64>, options: &BenchmarkOptions) -> crate::Result<Option<BenchmarkBound>> {
        if self.options.electronics.snr_db.is_none() {
            return Ok(None);
        }
        let tip_radius_m = self.options.press.tip_radius_m;
        let bounds = Bounds::new(self.design, self.options, &BoundOptions { tip_radius_m, ..BoundOptions::default() })?;
        let presses = Presses::new(self.design, self.mesh, self.pixels, self.options.press, seeds.start);
        let step = SINGLES_STEP * options.sizes.grid_step;
        Ok(Some(BenchmarkBound {
            localisation_m: self.mean_error_m(&bounds, &presses.on_grid(step).presses, step)?,
            least_force_n: self.least_forces(&bounds, step)?,
            two_resolved: if bounds.has_chart() { told_apart(&bounds, &presses, options)? } else { Vec::new() },
            misses: self.misses(seeds, options)?,
        }))
    }

    /// The misses of the best test, without the disconnected electrodes of each twin.
    fn misses(&self, seeds: Range<u64>, options: &BenchmarkOptions) -> crate::Result<Option<[f64; 2]>> {
        let mut sums = [0.0; 2];
        for seed in seeds.clone() {
            let dead = self.with_dead_electrodes(seed, options.dead_electrodes)?.faults.dead_electrodes;
            if dead.is_empty() {
                return Ok(None);
            }
            let protocol = self.design.protocol.without_electrodes(&dead).map_err(dermis::Error::from)?;
            let design = SkinDesign { protocol, ..self.design.clone() };
            // A known press has known patches.
            let bounds = BoundOptions { known_patches: true, ..BoundOptions::default() };
            let bounds = Bounds::new(&design, self.options, &bounds)?;
            let presses = Presses::new(self.design, self.mesh, self.pixels, self.options.press, seed);
            let sets = [presses.on_grid(options.sizes.grid_step), presses.at_random(options.sizes.random)];
            for (sum, set) in sums.iter_mut().zip(sets) {
                let missed = |press: &Vec<Press>| Ok(1.0 - bounds.probability_found(&press[0], self.pixels.len())?);
                *sum += set.presses.par_iter().map(missed).collect::<crate::Result<Vec<f64>>>()?.iter().sum::<f64>();
            }
        }
        Ok(Some(sums.map(|sum| sum / (seeds.end - seeds.start) as f64)))
    }

    /// The mean error of presses at every `step`-th pixel.
    fn mean_error_m(&self, bounds: &Bounds, presses: &[Vec<Press>], step: usize) -> crate::Result<f64> {
        let normals: Vec<_> = self.pixels.normals.iter().copied().step_by(step).collect();
        let error_m = |(presses, normal): (&Vec<Press>, &_)| {
            Ok(bounds.position_of(&presses[0], *normal)?.map_or(f64::NAN, |bound| bound.mean_error_m()))
        };
        Ok(mean(&presses.par_iter().zip(&normals).map(error_m).collect::<crate::Result<Vec<f64>>>()?))
    }

    fn least_forces(&self, bounds: &Bounds, step: usize) -> crate::Result<[f64; 2]> {
        let places: Vec<_> = self.pixels.centres_m.iter().copied().step_by(step).collect();
        let least = |&place| Ok(bounds.smallest_force_n(place, self.pixels.len())?.unwrap_or(f64::NAN));
        let forces_n = places.par_iter().map(least).collect::<crate::Result<Vec<f64>>>()?;
        Ok(least_force::median_and_p95(&forces_n))
    }
}

/// The mean probability at each distance with which pairs are told from one.
fn told_apart(bounds: &Bounds, presses: &Presses<'_>, options: &BenchmarkOptions) -> crate::Result<Vec<(f64, f64)>> {
    let mut told = Vec::with_capacity(options.sizes.separations_m.len());
    let mut certain_from_m = f64::INFINITY;
    for &separation_m in &options.sizes.separations_m {
        let is_certain = separation_m >= certain_from_m;
        let probability = if is_certain { 1.0 } else { told_apart_at(bounds, presses, options, separation_m)? };
        if probability > CERTAIN {
            certain_from_m = certain_from_m.min(separation_m);
        }
        told.push((separation_m, probability));
    }
    Ok(told)
}

fn told_apart_at(
    bounds: &Bounds,
    presses: &Presses<'_>,
    options: &BenchmarkOptions,
    separation_m: f64,
) -> crate::Result<f64> {
    let pairs = presses.in_pairs(&[separation_m], options.sizes.pairs.div_ceil(PAIRS_STEP)).presses;
    let probability = |pair: &Vec<Press>| bounds.told_apart(&[pair[0], pair[1]]);
    Ok(mean(&pairs.par_iter().map(probability).collect::<crate::Result<Vec<f64>>>()?))
}
