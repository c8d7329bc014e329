//! `dermis.Twin`.

use crate::arrays::{self, Column, Rows};
use crate::contacts;
use crate::failure::{Failure, Outcome};
use crate::skin::Skin;
use crate::worker;
use dermis::frame::Frame;
use dermis_sim::experiment::{PaperExperiment, Recording, Sizes, truth};
use dermis_sim::twin::{self, Press, TwinOptions};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

/// A digital twin: one skin with manufacturing errors, foam, electronics and noise, all drawn from a seed.
#[pyclass(frozen, module = "dermis")]
pub struct Twin {
    twin: twin::Twin,
}

/// The options of a twin by a shipped name or the path of a file.
fn options(py: Python<'_>, name: &Bound<'_, PyAny>) -> Outcome<TwinOptions> {
    let name: String = py.import("os")?.call_method1("fspath", (name,))?.extract()?;
    Ok(TwinOptions::load(&name)?)
}

impl Twin {
    /// Makes the twin of a skin.
    pub fn of(py: Python<'_>, skin: &Skin, name: &Bound<'_, PyAny>, seed: u64) -> Outcome<Self> {
        let (options, design) = (options(py, name)?, skin.skin().design());
        let twin = worker::run(py, "preparing the twin", 1, |_| Ok(twin::Twin::new(design, &options, seed)?))?;
        Ok(Twin { twin })
    }

    /// The frames of presses, from frame `first` on.
    fn record<'py>(&self, py: Python<'py>, presses: &[Vec<Press>], first: u64) -> Outcome<Bound<'py, PyAny>> {
        let channels = self.twin.design().protocol.channel_count();
        // The time of a frame is computed in double precision.
        if first > 1 << 53 {
            return Err(Failure::with_hint(format!("`first` is {first}"), "give at most 2**53"));
        }
        let values = worker::run(py, "pressing", presses.len(), |watch| {
            let frame = |(number, presses): (usize, &Vec<Press>)| {
                watch.check()?;
                let frame = self.twin.frame(presses, first + number as u64)?;
                watch.steps(1);
                Ok::<_, Failure>(frame.0)
            };
            Ok(presses.par_iter().enumerate().map(frame).collect::<Outcome<Vec<_>>>()?.concat())
        })?;
        arrays::rows(py, values, &[channels], false)
    }
}

#[pymethods]
impl Twin {
    /// Name of the options.
    #[getter]
    fn name(&self) -> &str {
        &self.twin.options().name
    }

    /// The seed.
    #[getter]
    fn seed(&self) -> u64 {
        self.twin.seed()
    }

    /// Frames per second.
    #[getter]
    fn frame_rate_hz(&self) -> f64 {
        self.twin.options().electronics.frame_rate_hz
    }

    /// Untouched frames, (count, channels), ohm.
    #[pyo3(signature = (count=100, *, first=0))]
    fn untouched<'py>(&self, py: Python<'py>, count: usize, first: u64) -> Outcome<Bound<'py, PyAny>> {
        arrays::check_size("count", count as u64, self.twin.design().protocol.channel_count())?;
        self.record(py, &vec![Vec::new(); count], first)
    }

    #[doc = stub_doc!(Twin.press)]
    #[pyo3(signature = (positions, *, force_n=None, tip_radius_m=None, frame=None, first=100))]
    fn press<'py>(
        &self,
        py: Python<'py>,
        positions: &Bound<'py, PyAny>,
        force_n: Option<&Bound<'py, PyAny>>,
        tip_radius_m: Option<&Bound<'py, PyAny>>,
        frame: Option<&Bound<'py, PyAny>>,
        first: u64,
    ) -> Outcome<Bound<'py, PyAny>> {
        let rows = Rows::of(positions, "positions", 3)?;
        let (centres, _) = rows.values()?.as_chunks::<3>();
        let force_n = Column::of(force_n, "force_n", centres.len(), 2.0)?;
        let tip_radius_m = Column::of(tip_radius_m, "tip_radius_m", centres.len(), 0.005)?;
        let frames = match frame {
            None => (0..centres.len()).collect(),
            Some(frame) => arrays::indices(frame, "frame", centres.len())?,
        };
        let last = frames.iter().max().map_or(0, |last| *last as u64 + 1);
        arrays::check_size("frame", last, self.twin.design().protocol.channel_count())?;
        let mut presses = vec![Vec::new(); frames.iter().max().map_or(0, |last| last + 1)];
        for (index, (&centre_m, frame)) in centres.iter().zip(frames).enumerate() {
            presses[frame].push(Press { centre_m, force_n: force_n.at(index), tip_radius_m: tip_radius_m.at(index) });
        }
        self.record(py, &presses, first)
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Twin {:?} of {:?}, seed {}>", self.name(), self.twin.design().name, self.twin.seed())
    }
}

/// The paper's indentation experiment on a twin, as `dermis experiment` writes it: sets of presses by name.
pub fn experiment<'py>(
    py: Python<'py>,
    skin: &Skin,
    name: &Bound<'py, PyAny>,
    seed: u64,
) -> Outcome<Bound<'py, PyDict>> {
    let (options, design) = (options(py, name)?, skin.skin().design());
    let (mesh, pixels) = (skin.skin().mesh(), skin.skin().pixels());
    let experiment = worker::run(py, "preparing the twin", 1, |_| {
        Ok(PaperExperiment::draw(design, mesh, pixels, &options, seed, &Sizes::default())?)
    })?;
    let count = experiment.frame_count();
    let recordings = worker::run(py, "pressing", count, |watch| Ok(experiment.record(|| watch.steps(1))?))?;
    let surface = design.body.surface();
    let channels = design.protocol.channel_count();
    let array = |frames: &[Frame]| {
        arrays::rows(py, frames.iter().flat_map(|frame| frame.0.clone()).collect(), &[channels], false)
    };
    let sets = PyDict::new(py);
    for (set, recording) in experiment.sets.iter().zip(recordings.iter()) {
        let Recording { untouched, frames, .. } = recording;
        let truths: Vec<_> = set.presses.iter().map(|presses| truth(&surface, presses)).collect();
        let arrays = PyDict::new(py);
        arrays.set_item("frames", array(frames)?)?;
        arrays.set_item("baseline", array(untouched)?)?;
        arrays.set_item("truth", contacts::table(py, &truths)?)?;
        sets.set_item(set.name, arrays)?;
    }
    Ok(sets)
}
