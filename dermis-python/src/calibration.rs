//! `dermis.Calibration`.

use crate::arrays::{self, Column, Rows};
use crate::failure::{Failure, Outcome};
use crate::method::{IN_MEMORY, Method, differences, doubt};
use crate::skin::Skin;
use crate::worker;
use dermis::contact::DOUBT;
use dermis::frame::Differences;
use dermis::method::MethodOptions;
use dermis_calibrate::checks::check_labels;
use dermis_calibrate::{Alternatives, CalibrateError, Fitted, Label, LabelFrame, Located};
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A calibration of a real skin with measured presses.
#[pyclass(frozen, module = "dermis")]
pub struct Calibration {
    skin: Skin,
    fitted: Fitted,
}

/// What pickle calls to make a calibration again, and with what.
type Reduced<'py> = (Bound<'py, PyAny>, (Skin, Bound<'py, PyAny>));

/// What is known of the presses of a calibration.
pub struct Presses<'a, 'py> {
    pub positions: &'a Bound<'py, PyAny>,
    pub force_n: Option<&'a Bound<'py, PyAny>>,
    pub rows: Option<&'a Bound<'py, PyAny>>,
    pub in_robot_frame: bool,
}

impl Presses<'_, '_> {
    /// The labels, in the order of their rows.
    fn labels(&self) -> Outcome<Vec<Label>> {
        let given = Rows::of(self.positions, "positions", 3)?;
        let (positions, _) = given.values()?.as_chunks::<3>();
        let force_n = Column::of(self.force_n, "force_n", positions.len(), f64::NAN)?;
        let rows = match self.rows {
            Some(rows) => arrays::indices(rows, "rows", positions.len())?,
            None => (0..positions.len()).collect(),
        };
        let label = |(index, &position_m)| Label { row: rows[index], position_m, force_n: force_n.at(index) };
        let mut labels: Vec<Label> = positions.iter().enumerate().map(label).collect();
        labels.sort_by_key(|label| label.row);
        Ok(labels)
    }
}

impl Calibration {
    /// Fits the presses of frames.
    pub fn fit(
        py: Python<'_>,
        skin: &Skin,
        differences: &Differences,
        presses: &Presses<'_, '_>,
        method: Option<&str>,
        force: bool,
    ) -> Outcome<Self> {
        let labels = presses.labels()?;
        let frame = if presses.in_robot_frame { LabelFrame::Robot } else { LabelFrame::Skin };
        let (fitted, alternatives, doubts) = worker::run(py, "calibrating", 1, |_| {
            let (fitted, alternatives) =
                Fitted::fit(&dermis_learn::methods(), skin.skin(), differences, &labels, frame, method)?;
            Ok((fitted, alternatives, check_labels(skin.skin(), &differences.frames, &labels, frame)?))
        })?;
        for found in doubts {
            doubt(py, &format!("{}: {} = {}", found.title(), found.evidence, found.value_text()), &found.fix, false)?;
        }
        if let Some(reason) = alternatives.reason(&fitted) {
            doubt(py, &reason, Alternatives::FIX, !force)?;
        }
        let unused = fitted.unused_forces(&labels).map(|why| format!("forces are not used: {why}"));
        for reason in fitted.doubts(skin.skin(), &labels).into_iter().chain(unused) {
            py.import("warnings")?.call_method1("warn", (reason,))?;
        }
        Ok(Calibration { skin: skin.clone(), fitted })
    }

    /// Reads a folder.
    pub fn load(py: Python<'_>, skin: &Skin, folder: PathBuf) -> Outcome<Self> {
        let fitted = worker::run(py, "reading", 1, |_| Ok(Fitted::load(&folder, skin.skin())?))?;
        fitted.map(|fitted| Calibration { skin: skin.clone(), fitted }).ok_or_else(|| {
            Failure::with_hint(format!("{} holds no calibration", folder.display()), "Skin.calibrate makes one")
        })
    }
}

#[pymethods]
impl Calibration {
    /// The calibrated method: `forward-map`, or the name of the method whose contacts are corrected.
    #[getter]
    fn name(&self) -> &str {
        match &self.fitted {
            Fitted::ForwardMap(_) => Fitted::FORWARD_MAP,
            Fitted::Correction(correction) => correction.method(),
        }
    }

    /// What cross-validation on the labels states: errors in m, relative errors of forces.
    #[getter]
    fn quality<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let text = match &self.fitted {
            Fitted::ForwardMap(map) => serde_json::to_string(map.quality()),
            Fitted::Correction(correction) => serde_json::to_string(correction.quality()),
        };
        Ok(py.import("json")?.call_method1("loads", (text.map_err(Failure::given)?,))?)
    }

    #[doc = stub_doc!(Calibration.locate)]
    #[pyo3(signature = (frames, baseline=None, *, first=0, force=false))]
    fn locate<'py>(
        &self,
        py: Python<'py>,
        frames: &Bound<'py, PyAny>,
        baseline: Option<&Bound<'py, PyAny>>,
        first: usize,
        force: bool,
    ) -> Outcome<Bound<'py, PyDict>> {
        let Fitted::ForwardMap(map) = &self.fitted else {
            let message = format!("a correction of {} does not locate a press in every frame", self.name());
            return Err(Failure::with_hint(message, "use method().contacts, or calibrate with method=\"forward-map\""));
        };
        if first > 1 << 53 {
            return Err(Failure::with_hint(format!("`first` is {first}"), "give the number of a press"));
        }
        let (differences, _) = differences(py, &self.skin, frames, baseline, force)?;
        let design = self.skin.skin().design();
        let unlike = differences.baseline.as_ref().and_then(|rest| self.fitted.doubt_of(design, rest));
        if let Some(reason) = &unlike {
            py.import("warnings")?.call_method1("warn", (reason,))?;
        }
        let located = worker::run(py, "locating", 1, |_| Ok(map.locate(&differences.frames, first)?))?;
        let column = |of: &dyn Fn(&Located) -> f64| PyArray1::from_iter(py, located.iter().map(of));
        // Of another skin, or in another unit, no press is more probable than not, and no force is known.
        let (most, unknown) = if unlike.is_some() { (DOUBT, f64::NAN) } else { (1.0, 0.0) };
        let forces: Vec<f64> = located.iter().flat_map(|one| map.force_n(one)).map(|value| value + unknown).collect();
        let positions = located.iter().flat_map(|located| located.position_m).collect();
        let covariances = located.iter().flat_map(|located| located.covariance_m2).flatten().collect();
        let result = PyDict::new(py);
        result.set_item("position_m", arrays::rows(py, positions, &[3], false)?)?;
        result.set_item("covariance_m2", arrays::rows(py, covariances, &[3, 3], false)?)?;
        result.set_item("sd_m", column(&Located::sd_m))?;
        result.set_item("confidence", column(&|located| located.confidence.min(most)))?;
        result.set_item("force_n", PyArray1::from_iter(py, forces.iter().copied().step_by(2)))?;
        result.set_item("force_sd_n", PyArray1::from_iter(py, forces.iter().copied().skip(1).step_by(2)))?;
        result.set_item("misfit", column(&|located| located.misfit))?;
        result.set_item("unlike", PyArray1::from_iter(py, located.iter().map(|located| map.is_unlike(located))))?;
        Ok(result)
    }

    /// The positions whose presses would help a forward map most, (count, 3), m.
    #[pyo3(signature = (count=10))]
    fn suggest<'py>(&self, py: Python<'py>, count: usize) -> Outcome<Bound<'py, PyAny>> {
        let Fitted::ForwardMap(map) = &self.fitted else {
            return Err(Failure::given("only a forward map suggests presses"));
        };
        let places = worker::run(py, "choosing presses", 1, |_| Ok(map.suggest(self.skin.skin(), count)?))?;
        arrays::rows(py, places.concat(), &[3], false)
    }

    /// The calibration as a reconstruction method.
    fn method(&self, py: Python<'_>) -> Outcome<Method> {
        let method = worker::run(py, "preparing the method", 1, |_| {
            let options = MethodOptions::default();
            let (methods, skin) = (dermis_learn::methods(), self.skin.skin());
            Ok(self.fitted.clone().into_method(&methods, skin, IN_MEMORY, &options)?)
        })?;
        Ok(Method::prepared(self.skin.clone(), method, None))
    }

    /// Writes the calibration to a folder, which `Skin.method` and `dermis live --method` read.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> Outcome<()> {
        worker::run(py, "writing", 1, |_| Ok(self.fitted.save(&folder, self.skin.skin().design())?))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let module = slf.py().import("dermis._pickle")?;
        Ok((module.getattr("calibration")?, (slf.get().skin.clone(), module.call_method1("files", (slf,))?)))
    }

    fn __repr__(&self) -> String {
        let labels = match &self.fitted {
            Fitted::ForwardMap(map) => map.quality().labels,
            Fitted::Correction(correction) => correction.quality().labels,
        };
        format!("<dermis.Calibration {:?} of {:?}: {labels} presses>", self.name(), self.skin.skin().design().name)
    }
}

impl From<CalibrateError> for Failure {
    fn from(error: CalibrateError) -> Self {
        match error {
            CalibrateError::Dermis(error) => error.into(),
            CalibrateError::Method(error) => (*error).into(),
            error => Failure::given(error),
        }
    }
}
