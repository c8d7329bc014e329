//! `dermis.Dataset` and `dermis.Samples`: training samples in files, and computed when they are asked for.

use crate::arrays;
use crate::failure::{Failure, Outcome};
use crate::skin::Skin;
use crate::worker;
use dermis_sim::dataset::{self, DatasetError, Generator, Recipe, Sample, TOUCH_COLUMNS};
use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Samples that are computed at once, in parallel with the next ones.
const BLOCK: u64 = 1024;

/// A dataset in a folder, as `dermis simulate` writes it.
#[pyclass(frozen, module = "dermis")]
pub struct Dataset {
    dataset: dataset::Dataset,
}

impl Dataset {
    /// The finished dataset in a folder.
    pub fn open(py: Python<'_>, folder: PathBuf) -> Outcome<Self> {
        Ok(Dataset { dataset: worker::run(py, "opening the dataset", 1, |_| Ok(dataset::Dataset::open(&folder)?))? })
    }
}

#[pymethods]
impl Dataset {
    #[new]
    fn new(py: Python<'_>, folder: PathBuf) -> Outcome<Self> {
        Dataset::open(py, folder)
    }

    /// The folder.
    #[getter]
    fn folder(&self) -> PathBuf {
        self.dataset.folder().to_path_buf()
    }

    /// The manifest: recipe, design, pixels, statistics.
    #[getter]
    fn manifest<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let text = serde_json::to_string(self.dataset.manifest()).map_err(Failure::given)?;
        Ok(py.import("json")?.call_method1("loads", (text,))?)
    }

    fn __len__(&self) -> Outcome<usize> {
        usize::try_from(self.dataset.len()).map_err(Failure::given)
    }

    #[doc = stub_doc!(Dataset.batch)]
    fn batch<'py>(&self, py: Python<'py>, indices: &Bound<'py, PyAny>) -> Outcome<Bound<'py, PyDict>> {
        let count = indices.len()?;
        let indices = arrays::indices(indices, "indices", count)?;
        let length = self.dataset.len();
        if let Some(index) = indices.iter().find(|index| **index as u64 >= length) {
            return Err(Failure::given(format!("`indices` has {index}: the dataset has {length} samples")));
        }
        let (dataset, record) = (&self.dataset, &self.dataset.manifest().record);
        let channels = dataset.channel_count();
        let read = |index: &usize| {
            let index = *index as u64;
            let (mut frame, mut rest) = (vec![0.0; channels], vec![0.0; channels]);
            let mut image = vec![0.0; dataset.pixel_count()];
            dataset.frame_into(index, &mut frame)?;
            dataset.rest_into(index, &mut rest)?;
            dataset.image_into(index, &mut image)?;
            Ok::<_, Failure>(Sample { index, frame, rest, image, touches: dataset.touches(index)? })
        };
        let samples: Vec<Sample> = worker::run(py, "reading samples", 1, |_| indices.par_iter().map(read).collect())?;
        arrays_of(py, &samples, record.recipe.most_touches())
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Dataset {}: {} samples>", self.dataset.folder().display(), self.dataset.len())
    }
}

/// Samples of a recipe, computed when they are asked for: sample i is the same as in the files of `dermis simulate`.
#[pyclass(frozen, module = "dermis")]
pub struct Samples {
    generator: Generator,
}

impl Samples {
    /// The samples of a recipe's text on a skin; the path is for messages.
    pub fn of(py: Python<'_>, skin: &Skin, text: &str, path: &Path, seed: u64) -> Outcome<Self> {
        // The number of samples limits files only.
        let recipe = Recipe::parse(text, path, seed, 1)?;
        let skin = skin.skin();
        let prepared =
            worker::run(py, "preparing samples", 1, |_| Ok(Generator::new(skin.design(), skin.forward(), &recipe)?))?;
        Ok(Samples { generator: prepared })
    }
}

#[pymethods]
impl Samples {
    /// The seed.
    #[getter]
    fn seed(&self) -> u64 {
        self.generator.recipe().seed
    }

    /// The samples `first` to `first + count`.
    fn batch<'py>(&self, py: Python<'py>, first: u64, count: u64) -> Outcome<Bound<'py, PyDict>> {
        arrays::check_size("count", count, 2 * self.generator.channel_count() + self.generator.pixel_count())?;
        let end = first.checked_add(count).filter(|end| *end < 1 << 60);
        let end = end.ok_or_else(|| Failure::given(format!("`first` is {first}: samples are numbered below 2**60")))?;
        let samples = worker::run(py, "computing samples", count as usize, |watch| {
            let mut samples = Vec::new();
            for from in (first..end).step_by(BLOCK as usize) {
                watch.check()?;
                let block = self.generator.samples(from..end.min(from + BLOCK))?;
                watch.steps(block.len());
                samples.extend(block);
            }
            Ok(samples)
        })?;
        arrays_of(py, &samples, self.generator.recipe().most_touches())
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Samples: {} channels, seed {}>", self.generator.channel_count(), self.seed())
    }
}

/// Samples as arrays of single precision.
fn arrays_of<'py>(py: Python<'py>, samples: &[Sample], most_touches: usize) -> Outcome<Bound<'py, PyDict>> {
    let result = PyDict::new(py);
    let matrix = |of: &dyn Fn(&Sample) -> &[f32]| {
        let values: Vec<f32> = samples.iter().flat_map(|sample| of(sample).iter().copied()).collect();
        let columns = values.len() / samples.len().max(1);
        PyArray1::from_vec(py, values).reshape([samples.len(), columns])
    };
    result.set_item("index", PyArray1::from_iter(py, samples.iter().map(|sample| sample.index)))?;
    result.set_item("frame", matrix(&|sample| &sample.frame)?)?;
    result.set_item("rest", matrix(&|sample| &sample.rest)?)?;
    result.set_item("image", matrix(&|sample| &sample.image)?)?;
    let mut touches = vec![f32::NAN; samples.len() * most_touches * TOUCH_COLUMNS];
    for (place, sample) in touches.chunks_exact_mut((most_touches * TOUCH_COLUMNS).max(1)).zip(samples) {
        place
            .chunks_exact_mut(TOUCH_COLUMNS)
            .zip(&sample.touches)
            .for_each(|(row, touch)| row.copy_from_slice(&touch.row()));
    }
    let touches = PyArray1::from_vec(py, touches).reshape([samples.len(), most_touches, TOUCH_COLUMNS])?;
    result.set_item("touches", touches)?;
    Ok(result)
}

impl From<DatasetError> for Failure {
    fn from(error: DatasetError) -> Self {
        Failure::given(error)
    }
}
