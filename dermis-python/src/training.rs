//! The training of `dermis.torch.train`: samples, options and files; the steps are PyTorch's.

use crate::arrays;
use crate::failure::{Failure, Outcome};
use crate::worker;
use dermis::geom::Point3;
use dermis_learn::{Epoch, Input, LearnError, Network, Precision, Samples, Target, TrainingRun};
use dermis_sim::dataset::Sample;
use numpy::prelude::*;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use rayon::prelude::*;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Values of a touch in a batch: its centre (m) and its size.
const TOUCH: usize = 4;

/// Memory of the symmetries as matrices: those of 30 electrodes take 60 MB.
const MAX_SYMMETRY_BYTES: usize = 1 << 30;

/// A sample and its difference, ohm.
type Read = (Sample, Vec<f32>);

#[doc = stub_doc!(Training)]
#[pyclass(frozen, module = "dermis")]
pub struct Training {
    run: TrainingRun,
    input: Input,
    target_scale: f32,
}

#[pymethods]
impl Training {
    #[new]
    fn new(py: Python<'_>, arguments: Vec<OsString>) -> Outcome<Self> {
        worker::run(py, "preparing", 1, |_| {
            let run = TrainingRun::new(dermis_cli::training_options(arguments)?)?;
            let trainer = run.training().trainer()?;
            let (input, target_scale) = (trainer.input().clone(), trainer.target_scale());
            drop(trainer);
            Ok(Training { run, input, target_scale })
        })
    }

    /// The folder for the model.
    #[getter]
    fn output(&self) -> PathBuf {
        self.run.output().to_path_buf()
    }

    /// Preset and training options as JSON, and what the network is made of.
    #[getter]
    fn settings(&self) -> String {
        let (preset, training) = (self.run.training().preset(), self.run.training());
        let noise = &preset.noise;
        serde_json::json!({
            "plan": preset.architecture,
            "input": self.input,
            "target": preset.target,
            "skin": { "channels": noise.sd_ohm.len() },
            "noise": noise,
            "options": preset.options,
            "samples": training.training().source().len(),
            "test_samples": training.test().source().len(),
            "target_scale": self.target_scale,
        })
        .to_string()
    }

    /// The weights before the first step, a safetensors file.
    fn initial_weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let preset = self.run.training().preset();
        let network = Network::new(&preset.architecture, preset.options.seed);
        PyBytes::new(py, &network.to_safetensors(Precision::Single))
    }

    #[doc = stub_doc!(Training.augmentation)]
    fn augmentation<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyDict>> {
        let samples = self.run.training().training();
        let channels = self.run.training().preset().noise.sd_ohm.len();
        let result = PyDict::new(py);
        let symmetries = samples.symmetries().filter(|symmetries| symmetries.len() > 1);
        let elements = 0..symmetries.map_or(0, |symmetries| symmetries.len());
        let bytes = elements.len() * channels * channels * size_of::<f32>();
        if bytes > MAX_SYMMETRY_BYTES {
            let message = format!("the symmetries of this skin take {} MB as matrices", bytes >> 20);
            return Err(Failure::with_hint(message, "add without=[\"symmetries\"], or use `dermis train`"));
        }
        let matrices: Vec<f32> = worker::run_short(py, || {
            let matrices = elements.clone().into_par_iter();
            Ok(matrices.flat_map_iter(|element| symmetries.map(|s| s.matrix(element)).into_iter().flatten()).collect())
        })?;
        result.set_item("frames", PyArray1::from_vec(py, matrices).reshape([elements.len(), channels, channels])?)?;
        let motions: Vec<f64> = (elements.clone().filter_map(|element| Some(symmetries?.motion(element))))
            .flat_map(|rows| rows.into_iter().flatten())
            .collect();
        result.set_item("motions", PyArray1::from_vec(py, motions).reshape([elements.len(), 3, 4])?)?;
        let drifts = samples.contact_drifts();
        result.set_item("contacts", PyArray1::from_vec(py, drifts.concat()).reshape([drifts.len(), channels])?)?;
        let (surface, pixels) = samples.pixels();
        let pixels: Vec<Vec<f64>> = pixels.iter().map(|pixel: &Point3| pixel.to_vec()).collect();
        result.set_item("pixels", PyArray2::from_vec2(py, &pixels).map_err(Failure::given)?)?;
        result.set_item("period", surface.period_m())?;
        Ok(result)
    }

    /// The samples of an epoch in their order.
    fn order<'py>(&self, py: Python<'py>, epoch: u64) -> Bound<'py, PyArray1<u64>> {
        let training = self.run.training();
        let order = training.training().source().order(training.preset().options.seed, epoch);
        PyArray1::from_iter(py, order.into_iter().map(|number| number as u64))
    }

    #[doc = stub_doc!(Training.batch)]
    #[pyo3(signature = (numbers, *, test = false))]
    fn batch<'py>(&self, py: Python<'py>, numbers: &Bound<'py, PyAny>, test: bool) -> Outcome<Bound<'py, PyDict>> {
        let count = numbers.len()?;
        let numbers = arrays::indices(numbers, "numbers", count)?;
        let samples = if test { self.run.training().test() } else { self.run.training().training() };
        let with_image = self.run.training().preset().target == Target::Conductance;
        let read = worker::run(py, "reading samples", 1, |_| Ok(read(samples, &numbers, with_image)?))?;
        batch_of(py, &read, with_image)
    }

    /// The learning rate of a step, numbered from 1.
    fn rate(&self, step: u64) -> f32 {
        self.run.training().preset().options.rate_at(step, self.steps_per_epoch())
    }

    /// Whether every epoch has new samples.
    #[getter]
    fn is_stream(&self) -> bool {
        self.run.training().is_stream()
    }

    /// Number of steps of an epoch.
    #[getter]
    fn steps_per_epoch(&self) -> usize {
        let training = self.run.training();
        training.preset().options.steps_per_epoch(training.training().source().len())
    }

    /// Whether the training ends after these epochs, a list of dicts.
    fn is_done(&self, epochs: &str) -> Outcome<bool> {
        Ok(self.run.training().preset().options.is_done(&parse(epochs)?))
    }

    /// Writes the plot of the losses.
    fn write_losses(&self, epochs: &str) -> Outcome<()> {
        Ok(dermis_cli::losses(&parse(epochs)?).write_svg(&self.run.output().join("losses.svg"))?)
    }

    /// Writes the model of trained weights, a safetensors file.
    fn save(&self, py: Python<'_>, weights: Vec<u8>, epochs: &str) -> Outcome<()> {
        let epochs = parse(epochs)?;
        worker::run(py, "saving", 1, |_| {
            let architecture = &self.run.training().preset().architecture;
            let network = Network::parse(architecture, Path::new("weights"), &weights)?;
            self.run.save(&self.input, network.scaled(self.target_scale.recip()), &epochs)?;
            Ok(())
        })
    }
}

fn parse(epochs: &str) -> Outcome<Vec<Epoch>> {
    serde_json::from_str(epochs).map_err(Failure::given)
}

fn read(samples: &Samples, numbers: &[usize], with_image: bool) -> Result<Vec<Read>, LearnError> {
    samples.source().prepare(numbers)?;
    numbers.par_iter().map(|&number| samples.read(number, with_image)).collect()
}

/// Samples and their differences as arrays.
fn batch_of<'py>(py: Python<'py>, samples: &[Read], with_image: bool) -> Outcome<Bound<'py, PyDict>> {
    let result = PyDict::new(py);
    let matrix = |of: for<'a> fn(&'a Read) -> &'a [f32]| -> Outcome<Bound<'py, PyArray2<f32>>> {
        let values: Vec<f32> = samples.iter().flat_map(of).copied().collect();
        let columns = values.len() / samples.len().max(1);
        Ok(PyArray1::from_vec(py, values).reshape([samples.len(), columns])?)
    };
    result.set_item("difference", matrix(|(_, difference)| difference)?)?;
    result.set_item("rest", matrix(|(sample, _)| &sample.rest)?)?;
    if with_image {
        result.set_item("image", matrix(|(sample, _)| &sample.image)?)?;
        return Ok(result);
    }
    let most = samples.iter().map(|(sample, _)| sample.touches.len()).max().unwrap_or(0);
    let mut touches = vec![0.0; samples.len() * most * TOUCH];
    for (rows, (sample, _)) in touches.chunks_exact_mut((most * TOUCH).max(1)).zip(samples) {
        for (row, touch) in rows.chunks_exact_mut(TOUCH).zip(&sample.touches) {
            row[..3].copy_from_slice(&touch.centre_m);
            row[3] = touch.size();
        }
    }
    let touches: Bound<'py, PyArray3<f32>> = PyArray1::from_vec(py, touches).reshape([samples.len(), most, TOUCH])?;
    result.set_item("touches", touches)?;
    Ok(result)
}
