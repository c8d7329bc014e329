//! `dermis.Method`.

use crate::arrays;
use crate::contacts;
use crate::failure::{Failure, Outcome};
use crate::picture;
use crate::skin::Skin;
use crate::worker::{self, Watch};
use dermis::finding::Finding;
use dermis::frame::{Differences, Frame, broken_channels};
use dermis::method;
use dermis::plausibility::Plausibility;
use dermis_sim::evaluate::score_contacts;
use pyo3::prelude::*;
use rayon::prelude::*;

/// What pickle calls to make a method again, and with what.
type Reduced<'py> = (Bound<'py, PyAny>, (Skin, String, Option<f64>));

/// The name of a method that a caller has given: a text, or the path of a folder.
pub fn method_name(py: Python<'_>, given: Option<&Bound<'_, PyAny>>) -> Outcome<Option<String>> {
    let Some(given) = given else { return Ok(None) };
    if let Ok(name) = given.extract::<String>() {
        return Ok(Some(name));
    }
    // A path without a separator is a folder all the same.
    let path = py.import("os")?.call_method1("fspath", (given,))?;
    Ok(Some(py.import("os.path")?.call_method1("abspath", (path,))?.extract()?))
}

/// The name of methods that no other process can prepare.
pub const IN_MEMORY: &str = "memory";

/// A reconstruction method prepared for a skin.
#[pyclass(frozen, module = "dermis")]
pub struct Method {
    skin: Skin,
    method: method::Method,
    /// The regularization parameter that was asked for.
    alpha: Option<f64>,
}

impl Method {
    pub fn prepared(skin: Skin, method: method::Method, alpha: Option<f64>) -> Self {
        Method { skin, method, alpha }
    }

    fn differences(
        &self,
        py: Python<'_>,
        frames: &Bound<'_, PyAny>,
        baseline: Option<&Bound<'_, PyAny>>,
        force: bool,
    ) -> Outcome<(Differences, bool)> {
        let (differences, is_single) = differences(py, &self.skin, frames, baseline, force)?;
        // What is made of data may have units of its own.
        let name = self.method.name();
        if let Some(baseline) = differences.baseline.as_ref().filter(|_| !method::is_path(name) && name != IN_MEMORY) {
            let skin = self.skin.skin();
            let check = Plausibility::new(&skin.design().protocol, skin.untouched().map_err(Failure::given)?, &[]);
            if let Some(Finding { evidence, fix, .. }) = check.of_size(baseline) {
                doubt(py, &evidence, &fix, false)?;
            }
        }
        Ok((differences, is_single))
    }

    /// The method adapted to the untouched skin, with a warning where it does less than it could.
    fn adapted(&self, py: Python<'_>, differences: &Differences) -> Outcome<method::Method> {
        let adapted = worker::run(py, "adapting the method", 1, |_| Ok(self.method.adapted(differences)?))?;
        if let Some(reason) = adapted.reconstruct().warning() {
            py.import("warnings")?.call_method1("warn", (reason,))?;
        }
        Ok(adapted)
    }
}

/// The differences of frames from a baseline, and whether one frame was given. Frames that cannot be those of the skin are
/// refused, as by the program; doubtful ones give a warning.
pub fn differences(
    py: Python<'_>,
    skin: &Skin,
    frames: &Bound<'_, PyAny>,
    baseline: Option<&Bound<'_, PyAny>>,
    force: bool,
) -> Outcome<(Differences, bool)> {
    let skin = skin.skin();
    let protocol = &skin.design().protocol;
    let (mut differences, is_single) = arrays::differences(frames, baseline, protocol)?;
    for (frame, values) in differences.frames.iter().enumerate() {
        let is_rest_finite =
            |channel: usize| differences.baseline.as_ref().is_none_or(|rest| rest[channel].is_finite());
        let is_wrong = |&channel: &usize| !values[channel].is_finite() && is_rest_finite(channel);
        if let Some(channel) = (0..values.len()).find(is_wrong) {
            let message = format!("frame {frame}, channel {channel} is {}", values[channel]);
            return Err(Failure::with_hint(message, "leave the frame out, or give the channel a number"));
        }
    }
    let model = skin.untouched().map_err(Failure::given)?;
    let broken = broken_channels(&differences.untouched);
    let found = Plausibility::new(protocol, model, &broken).of(&differences, skin).map_err(Failure::given)?;
    differences.is_doubtful = Plausibility::is_doubtful(&found);
    for found in &found {
        doubt(py, &found.evidence, &found.fix, found.is_fault() && !force)?;
    }
    Ok((differences, is_single))
}

/// Refuses for a reason, or gives it as a warning.
pub fn doubt(py: Python<'_>, reason: &str, fix: &str, refuses: bool) -> Outcome<()> {
    if refuses {
        return Err(Failure::with_hint(reason, &format!("{fix}; `force=True` goes on all the same")));
    }
    py.import("warnings")?.call_method1("warn", (format!("{reason}; {fix}"),))?;
    Ok(())
}

/// The results for all frames, in parallel.
fn for_each<T: Send>(frames: &[Frame], watch: &Watch, of: impl Fn(&Frame) -> Outcome<T> + Sync) -> Outcome<Vec<T>> {
    let one = |frame: &Frame| {
        watch.check()?;
        let result = of(frame);
        watch.steps(1);
        result
    };
    frames.par_iter().map(one).collect()
}

#[pymethods]
impl Method {
    /// The name by which it is selected.
    #[getter]
    fn name(&self) -> &str {
        self.method.name()
    }

    /// Its name in words.
    #[getter]
    fn label(&self) -> &str {
        self.method.label()
    }

    /// The regularization parameter of a linear method, else `None`.
    #[getter]
    fn alpha(&self) -> Option<f64> {
        self.method.alpha()
    }

    #[doc = stub_doc!(Method.images)]
    #[pyo3(signature = (frames, baseline=None, *, force=false))]
    fn images<'py>(
        &self,
        py: Python<'py>,
        frames: &Bound<'py, PyAny>,
        baseline: Option<&Bound<'py, PyAny>>,
        force: bool,
    ) -> Outcome<Bound<'py, PyAny>> {
        let (differences, is_single) = self.differences(py, frames, baseline, force)?;
        let frames = &differences.frames;
        let images = worker::run(py, "reconstructing", frames.len(), |watch| {
            let images = for_each(frames, watch, |frame| Ok(self.method.image(frame)?.to_grid()))?;
            Ok(images.concat())
        })?;
        let space = self.skin.skin().pixels();
        let shape = space.grid.map_or_else(|| vec![space.len()], Vec::from);
        arrays::rows(py, images, &shape, is_single)
    }

    #[doc = stub_doc!(Method.to_xarray)]
    #[pyo3(signature = (frames, baseline=None))]
    fn to_xarray<'py>(
        slf: &Bound<'py, Self>,
        frames: &Bound<'py, PyAny>,
        baseline: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("dermis._exchange")?.call_method1("to_xarray", (slf, frames, baseline))
    }

    #[doc = stub_doc!(Method.contacts)]
    #[pyo3(signature = (frames, baseline=None, *, both_signs=false, force=false))]
    fn contacts<'py>(
        &self,
        py: Python<'py>,
        frames: &Bound<'py, PyAny>,
        baseline: Option<&Bound<'py, PyAny>>,
        both_signs: bool,
        force: bool,
    ) -> Outcome<Bound<'py, PyAny>> {
        let (differences, _) = self.differences(py, frames, baseline, force)?;
        let method = self.adapted(py, &differences)?;
        let found = worker::run(py, "reconstructing", differences.frames.len(), |watch| {
            let mut detector = method.detector_of(&differences, &self.skin.skin().design().protocol)?;
            if both_signs {
                self.method.check_both_signs()?;
                detector = detector.with_both_signs(self.skin.skin().design().sheet.touch.change());
            }
            for_each(&differences.frames, watch, |frame| Ok(method.contacts(frame, &detector)?))
        })?;
        contacts::table(py, &found)
    }

    #[doc = stub_doc!(Method.score)]
    #[pyo3(signature = (frames, truth, baseline=None, *, force=false))]
    fn score<'py>(
        &self,
        py: Python<'py>,
        frames: &Bound<'py, PyAny>,
        truth: &Bound<'py, PyAny>,
        baseline: Option<&Bound<'py, PyAny>>,
        force: bool,
    ) -> Outcome<Bound<'py, PyAny>> {
        let (differences, _) = self.differences(py, frames, baseline, force)?;
        let frames = &differences.frames;
        let truth = contacts::truth(truth, self.skin.skin(), frames.len())?;
        let method = self.adapted(py, &differences)?;
        let score = worker::run(py, "reconstructing", frames.len(), |watch| {
            let detector = method.detector_of(&differences, &self.skin.skin().design().protocol)?;
            let found =
                for_each(frames, watch, |frame| Ok(method.reconstruct().image_and_contacts(frame, &detector)?))?;
            let (images, found): (Vec<_>, Vec<_>) = found.into_iter().unzip();
            Ok(score_contacts(&images, &found, &truth, self.method.label(), self.method.alpha())?)
        })?;
        let text = serde_json::to_string(&score).map_err(Failure::given)?;
        Ok(py.import("json")?.call_method1("loads", (text,))?)
    }

    /// The image of a frame with its contacts, as the text of an SVG.
    #[pyo3(signature = (frame, baseline=None))]
    fn svg(&self, py: Python<'_>, frame: &Bound<'_, PyAny>, baseline: Option<&Bound<'_, PyAny>>) -> Outcome<String> {
        let (differences, _) = self.differences(py, frame, baseline, false)?;
        let [frame] = &differences.frames[..] else {
            return Err(Failure::with_hint("`frame` has rows", "give one frame, (channels,)"));
        };
        let method = self.adapted(py, &differences)?;
        worker::run_short(py, || {
            let detector = method.detector_of(&differences, &self.skin.skin().design().protocol)?;
            let (image, contacts) = method.reconstruct().image_and_contacts(frame, &detector)?;
            picture::of_image(self.skin.skin(), &image, self.method.reconstruct().quantity(), &contacts)
        })
    }

    /// The skin.
    #[getter]
    fn skin(&self) -> Skin {
        self.skin.clone()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> Outcome<Reduced<'py>> {
        let Method { skin, method, alpha } = slf.get();
        if method.name() == IN_MEMORY {
            let hint = "save it to a folder and prepare it by the folder: Skin.method(folder)";
            return Err(Failure::with_hint("a method of a calibration in memory cannot be pickled", hint));
        }
        let prepare = slf.py().import("dermis._pickle")?.getattr("method")?;
        // Another process may run in another folder.
        let name = match method::is_path(method.name()) {
            true => std::path::absolute(method.name())
                .map_or_else(|_| method.name().into(), |path| path.display().to_string()),
            false => method.name().to_string(),
        };
        Ok((prepare, (skin.clone(), name, *alpha)))
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Method {:?}: {}>", self.name(), self.method.description())
    }
}
