//! `dermis.Simulation`: datasets that are generated into folders, as by `dermis simulate`.

use crate::failure::{Failure, Outcome};
use crate::samples::Dataset;
use crate::skin::Skin;
use crate::worker;
use dermis_sim::dataset::{self, DatasetError, Generator, Recipe, Record, Run, Shard};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Interval between two looks at files that other processes generate.
const WAIT: Duration = Duration::from_millis(500);
/// As `dermis simulate --threads`.
const MAX_THREADS: usize = 1024;

/// A dataset that is generated into a folder: the files are those of `dermis simulate`.
#[pyclass(frozen, module = "dermis")]
pub struct Simulation {
    generator: Generator,
    record: Record,
}

impl Simulation {
    /// The dataset of a recipe's samples on a skin.
    pub fn of(py: Python<'_>, skin: &Skin, recipe: &Recipe) -> Outcome<Self> {
        let skin = skin.skin();
        let design = skin.design();
        let text = skin.design_text().ok_or_else(|| Failure::given("a skin without a design file"))?;
        let generator =
            worker::run(py, "preparing samples", 1, |_| Ok(Generator::new(design, skin.forward(), recipe)?))?;
        Ok(Simulation { record: Record::new(&generator, &design.name, text), generator })
    }

    fn prepare(&self, py: Python<'_>, folder: &Path, shard: Shard) -> Outcome<Run<'_>> {
        worker::run(py, "checking the folder", 1, |_| Ok(Run::new(&self.generator, &self.record, folder, shard)?))
    }
}

/// Why a run has ended early.
enum Stop {
    /// Other processes generate the remaining files.
    Busy(Failure),
    Failed(Failure),
}

impl From<Failure> for Stop {
    fn from(failure: Failure) -> Self {
        Stop::Failed(failure)
    }
}

impl From<dermis_sim::Error> for Stop {
    fn from(error: dermis_sim::Error) -> Self {
        let is_busy =
            matches!(&error, dermis_sim::Error::Dataset(error) if matches!(**error, DatasetError::Busy { .. }));
        if is_busy { Stop::Busy(error.into()) } else { Stop::Failed(error.into()) }
    }
}

#[pymethods]
impl Simulation {
    /// Number of files.
    #[getter]
    fn files(&self) -> u64 {
        self.record.file_count()
    }

    /// Number of samples.
    #[getter]
    fn samples(&self) -> u64 {
        self.record.recipe.samples
    }

    #[doc = stub_doc!(Simulation.begin)]
    fn begin(&self, py: Python<'_>, folder: PathBuf) -> Outcome<Vec<u64>> {
        Ok(self.prepare(py, &folder, Shard::WHOLE)?.missing_files().collect())
    }

    #[doc = stub_doc!(Simulation.run)]
    #[pyo3(signature = (folder, shard=(0, 1), *, threads=None, wait=false))]
    fn run(
        &self,
        py: Python<'_>,
        folder: PathBuf,
        shard: (u64, u64),
        threads: Option<usize>,
        wait: bool,
    ) -> Outcome<u64> {
        let shard = Shard::new(shard.0, shard.1)?;
        let pool = threads.map(threads_of).transpose()?;
        let made = AtomicU64::new(0);
        loop {
            let run = self.prepare(py, &folder, shard)?;
            let is_done = worker::run(py, "simulating", run.missing_samples() as usize, |watch| {
                let make = || {
                    run.make(|count| {
                        made.fetch_add(count, Ordering::Relaxed);
                        watch.steps(count as usize);
                        Ok::<_, Stop>(watch.check()?)
                    })
                };
                match pool.as_ref().map_or_else(make, |pool| pool.install(make)) {
                    Ok(_) => Ok(true),
                    Err(Stop::Busy(_)) if wait => {
                        std::thread::sleep(WAIT);
                        Ok(false)
                    }
                    Err(Stop::Busy(failure) | Stop::Failed(failure)) => Err(failure),
                }
            })?;
            if is_done {
                return Ok(made.into_inner());
            }
        }
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Simulation of {}: {} samples>", self.record.design.name, self.samples())
    }
}

/// A number of threads.
fn threads_of(count: usize) -> Outcome<ThreadPool> {
    if !(1..=MAX_THREADS).contains(&count) {
        let hint = format!("give 1 to {MAX_THREADS}");
        return Err(Failure::with_hint(format!("`threads` is {count}"), &hint));
    }
    ThreadPoolBuilder::new().num_threads(count).build().map_err(Failure::given)
}

#[doc = stub_doc!(finish_dataset)]
#[pyfunction]
pub fn finish_dataset(py: Python<'_>, folder: PathBuf) -> Outcome<Dataset> {
    let count = Record::read(&folder)?.file_count() as usize;
    worker::run(py, "checking files", count, |watch| Ok(dataset::finish(&folder, || watch.steps(1))?))?;
    Dataset::open(py, folder)
}
