//! From a design and a recipe to the files of a dataset.

use super::{Generator, Recipe, Record, Run, RunReport, Shard};
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A run of a simulation; serialised to the JSON output of `dermis simulate --json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Simulated {
    /// The folder of the dataset.
    pub folder: PathBuf,
    /// What was generated.
    #[serde(flatten)]
    pub report: RunReport,
    /// Number of files of the whole dataset.
    pub file_count: u64,
    /// Time of the generation, s.
    pub seconds: f64,
    /// Samples generated in a second.
    pub samples_per_second: f64,
}

/// Generates the files of a shard that a folder lacks, in the current thread pool; then [`finish`](super::finish) writes the
/// manifest. `design` is the path of a design file or a shipped name. `progress` is called from several threads with the
/// number of samples generated since the last call, and the number of all that were missing.
///
/// ```no_run
/// use dermis::design::TouchEffect;
/// use dermis_sim::dataset::{GaussianTouches, Recipe, Shard, Skins, Touch, simulate};
///
/// let touch = Touch::Gaussian(GaussianTouches::for_effect(TouchEffect::ConductanceRises));
/// let recipe = Recipe { seed: 1, samples: 8192, touch, skins: Skins::Even };
/// let made = simulate("cylinder30", &recipe, "data".as_ref(), Shard::WHOLE, |_, _| ())?;
/// println!("{:.0} samples/s", made.samples_per_second);
/// # Ok::<(), dermis_sim::Error>(())
/// ```
///
/// # Errors
/// A design that cannot be read, a recipe that it does not allow; as [`Run::new`] and [`Run::make`].
pub fn simulate(
    design: &str,
    recipe: &Recipe,
    folder: &Path,
    shard: Shard,
    progress: impl Fn(u64, u64) + Sync,
) -> crate::Result<Simulated> {
    let text = SkinDesign::with_files(&SkinDesign::text_of(design)?, design)?;
    let design = SkinDesign::parse(&text, design)?;
    recipe.check(design.sheet.touch)?;
    let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
    let generator = Generator::new(&design, &forward, recipe)?;
    let record = Record::new(&generator, &design.name, &text);
    let run = Run::new(&generator, &record, folder, shard)?;
    let (missing, begun) = (run.missing_samples(), Instant::now());
    let report = run.make(|count| {
        progress(count, missing);
        Ok::<_, crate::Error>(())
    })?;
    let seconds = begun.elapsed().as_secs_f64();
    let samples_per_second = if report.made_samples > 0 { report.made_samples as f64 / seconds } else { 0.0 };
    Ok(Simulated { folder: folder.to_path_buf(), report, file_count: record.file_count(), seconds, samples_per_second })
}
