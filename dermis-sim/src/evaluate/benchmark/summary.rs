//! The benchmark of a method on several twins.

use super::{Benchmark, BenchmarkBound, BenchmarkOptions, BenchmarkResult, FamiliesResult};
use crate::twin::TwinOptions;
use dermis::method::Method;
use dermis::skin::Skin;
use serde::Serialize;
use std::ops::Range;

/// The results of a method on several twins; serialised to the JSON output of `dermis benchmark --json`.
#[derive(Debug, Clone, Serialize)]
pub struct BenchmarkSummary {
    /// Name of the design.
    pub design: String,
    /// Name of the twins' options.
    pub twin: String,
    /// The method.
    pub method: String,
    /// Its alpha, if it has one.
    pub alpha: Option<f64>,
    /// What the skin allows any method; `None` for twins without noise.
    pub bound: Option<BenchmarkBound>,
    /// The results on each twin.
    pub twins: Vec<BenchmarkResult>,
}

/// The results of a method for families of objects on several skins.
#[derive(Debug, Clone, Serialize)]
pub struct FamiliesSummary {
    /// Name of the design.
    pub design: String,
    /// The method.
    pub method: String,
    /// The results on each skin.
    pub skins: Vec<FamiliesResult>,
}

impl<'a> Benchmark<'a> {
    /// The benchmark of a method that was prepared for a skin.
    pub fn new(skin: &'a Skin, method: &'a Method, options: &'a TwinOptions) -> Self {
        let (design, mesh, pixels) = (skin.design(), skin.mesh(), skin.pixels());
        Benchmark { design, mesh, pixels, options, method: method.reconstruct().as_ref(), alpha: method.alpha() }
    }
}

/// Scores a method on a twin of each seed, and computes what the skin allows. `on_step` is called with the number of frames
/// done since the last call, from several threads.
///
/// ```no_run
/// use dermis::method::{MethodOptions, Methods};
/// use dermis::skin::Skin;
/// use dermis_sim::evaluate::{BenchmarkOptions, benchmark};
/// use dermis_sim::twin::TwinOptions;
///
/// let skin = Skin::load("cylinder30").unwrap();
/// let method = Methods::linear().method(&skin, "noser", &MethodOptions::default()).unwrap();
/// let lab = TwinOptions::shipped("lab").unwrap();
/// let found = benchmark(&skin, &method, &lab, 1001..1011, &BenchmarkOptions::quick(), |_| ())?;
/// println!("{:.2} mm", 1e3 * found.twins[0].single_m.mean);
/// # Ok::<(), dermis_sim::Error>(())
/// ```
///
/// # Errors
/// As [`Benchmark::run`] and [`Benchmark::bound`].
pub fn benchmark(
    skin: &Skin,
    method: &Method,
    twin: &TwinOptions,
    seeds: Range<u64>,
    options: &BenchmarkOptions,
    on_step: impl Fn(usize) + Sync,
) -> crate::Result<BenchmarkSummary> {
    let benchmark = Benchmark::new(skin, method, twin);
    let twins = seeds.clone().map(|seed| benchmark.run(seed, options, &on_step)).collect::<crate::Result<_>>()?;
    Ok(BenchmarkSummary {
        design: skin.design().name.clone(),
        twin: twin.name.clone(),
        method: method.label().into(),
        alpha: method.alpha(),
        bound: benchmark.bound(seeds, options)?,
        twins,
    })
}

/// Scores a method on `count` frames of each family of objects on a skin of each seed; `on_step` as for [`benchmark`].
///
/// # Errors
/// As [`Benchmark::families`].
pub fn benchmark_families(
    skin: &Skin,
    method: &Method,
    twin: &TwinOptions,
    seeds: Range<u64>,
    count: usize,
    on_step: impl Fn(usize) + Sync,
) -> crate::Result<FamiliesSummary> {
    let benchmark = Benchmark::new(skin, method, twin);
    let skins = seeds.map(|seed| benchmark.families(seed, count, &on_step)).collect::<crate::Result<_>>()?;
    Ok(FamiliesSummary { design: skin.design().name.clone(), method: method.label().into(), skins })
}

impl BenchmarkSummary {
    /// The share of resolved pairs over all twins for each distance: [distance (m), share].
    pub fn two_resolved(&self) -> Vec<[f64; 2]> {
        let steps = self.twins.first().map_or(&[][..], |twin| &twin.two_resolved);
        let share = |step: usize| self.mean(|twin| twin.two_resolved[step].1);
        steps.iter().enumerate().map(|(step, (distance_m, _))| [*distance_m, share(step)]).collect()
    }

    /// The mean over the twins of the smallest force at each pixel, N; `NaN` where it was not searched.
    pub fn least_forces_n(&self, pixel_count: usize, options: &BenchmarkOptions) -> Vec<f64> {
        let mut forces = vec![f64::NAN; pixel_count];
        for (place, pixel) in (0..pixel_count).step_by(options.force_step.max(1)).enumerate() {
            forces[pixel] = self.mean(|twin| twin.least_forces_n[place]);
        }
        forces
    }

    fn mean(&self, value: impl Fn(&BenchmarkResult) -> f64) -> f64 {
        self.twins.iter().map(value).sum::<f64>() / self.twins.len() as f64
    }
}
