//! Benchmark results of the methods on the reported twins, in a serialisable form.

use crate::bench::Bench;
use crate::scale::{REPORTED_SEED, Scale};
use crate::stage::{Parts, Work};
use dermis::stats::mean;
use dermis_sim::dataset::{Generator, Recipe};
use dermis_sim::evaluate::{Benchmark, BenchmarkResult, CalibrationRun};
use dermis_study::Result;
use dermis_study::comparison::Named;
use dermis_study::metrics::{benchmark_frames, figures};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The distribution of the Gaussian touches on which the paper's network was trained.
const GAUSSIAN: &str = include_str!("../../../dermis-study/recipes/gaussian.toml");
/// Seed of fresh Gaussian touches, separate from those of training and test.
const EXPLAINED_SEED: u64 = 3002;

/// The figures of one method on one twin; `None` if a figure does not exist.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct TwinFigures {
    /// The twin's seed.
    pub seed: u64,
    /// Every figure of [`figures`] by its key, SI units.
    pub figures: BTreeMap<String, Option<f64>>,
    /// Distance of two touches (m) and the fraction of resolved pairs.
    pub two_resolved: Vec<(f64, f64)>,
}

impl TwinFigures {
    fn of(result: &BenchmarkResult) -> Self {
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        let figures = figures().map(|figure| (figure.key.to_string(), finite((figure.of)(result))));
        TwinFigures {
            seed: result.seed,
            figures: figures.collect(),
            two_resolved: result.two_resolved.iter().copied().filter(|step| step.1.is_finite()).collect(),
        }
    }

    fn value(&self, key: &str) -> f64 {
        self.figures.get(key).copied().flatten().unwrap_or(f64::NAN)
    }
}

/// The results of one method on all reported twins.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Benchmarked {
    /// The method's identifier.
    pub key: String,
    /// The method's name in tables and pictures.
    pub name: String,
    /// Its alpha, if it has one.
    pub alpha: Option<f64>,
    /// Fraction of the variance of Gaussian touches that its images do not explain, with noise and one optimal gain.
    pub unexplained: Option<f64>,
    /// The figures of each twin.
    pub twins: Vec<TwinFigures>,
}

impl Benchmarked {
    /// Benchmarks a method on the reported twins, or reads saved results.
    pub(crate) fn make(
        bench: &Bench<'_>,
        method: &Named,
        scale: Scale,
        work: &Work,
        parts: &Parts<'_>,
        total: usize,
    ) -> Result<Self> {
        let benchmark = Benchmark::new(&bench.skin, &method.method, bench.twin);
        let size = scale.result();
        let frames = benchmark_frames(&size, bench.skin.pixels().len());
        let seeds = REPORTED_SEED..REPORTED_SEED + scale.twins();
        let twin = |seed: u64| {
            let key = format!("{}, {:?}, {size:?}", method.identity, method.method.reconstruct().detection());
            work.kept(&format!("benchmark-{}-{seed}", method.key), &key, || {
                let task = bench.progress.begin(&format!("{}, twin {seed}", method.name), frames);
                let result = benchmark.run(seed, &size, |done| task.advance(done))?;
                Ok(TwinFigures::of(&result))
            })
        };
        let twins = seeds.map(|seed| parts.part(total, work, || twin(seed))).collect::<Result<_>>()?;
        let unexplained =
            work.kept(&format!("explained-{}", method.key), &method.identity, || unexplained(bench, method, scale))?;
        Ok(Benchmarked {
            key: method.key.clone(),
            name: method.name.clone(),
            alpha: method.method.alpha(),
            unexplained,
            twins,
        })
    }

    /// A figure by its key: its mean over the twins and the worst twin, SI units; `NaN` if a twin has none.
    pub(crate) fn figure(&self, key: &str) -> [f64; 2] {
        let figure = figures().find(|figure| figure.key == key).expect("a figure of the list");
        let values: Vec<f64> = self.twins.iter().map(|twin| twin.value(key)).collect();
        [mean(&values), figure.worst(&values)]
    }

    /// The mean over the twins of the fraction of resolved pairs, by their distance (m).
    pub(crate) fn two_resolved(&self) -> Vec<[f64; 2]> {
        let Some(first) = self.twins.first() else { return Vec::new() };
        let at = |distance_m: f64| {
            let same = |step: &&(f64, f64)| (step.0 - distance_m).abs() < 1e-9;
            let parts: Vec<f64> =
                self.twins.iter().filter_map(|twin| twin.two_resolved.iter().find(same)).map(|step| step.1).collect();
            mean(&parts)
        };
        first.two_resolved.iter().map(|step| [step.0, at(step.0)]).collect()
    }
}

/// The unexplained fraction of the variance of touches like those for training the paper's network; `None` on skins
/// that do not support such touches.
fn unexplained(bench: &Bench<'_>, method: &Named, scale: Scale) -> Result<Option<f64>> {
    let samples = scale.explained();
    let recipe = Recipe::parse(GAUSSIAN, Path::new("gaussian.toml"), EXPLAINED_SEED, samples)?;
    if recipe.check(bench.skin.design().sheet.touch).is_err() {
        return Ok(None);
    }
    let task = bench.progress.begin(&format!("{}, Gaussian touches", method.name), samples as usize);
    let generator = Generator::new(bench.skin.design(), bench.skin.forward(), &recipe)?;
    let reconstruct = method.method.reconstruct().as_ref();
    let run = CalibrationRun::of(reconstruct, &reconstruct.detection(), &generator, 0..samples, || task.advance(1))?;
    Ok(Some(run.images.unexplained()))
}
