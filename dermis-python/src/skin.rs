//! `dermis.Skin`.

use crate::arrays::{self, Rows};
use crate::calibration::{Calibration, Presses};
use crate::contacts;
use crate::failure::{Failure, Outcome};
use crate::mesh::Mesh;
use crate::method::{self, Method, method_name};
use crate::picture;
use crate::samples::Samples;
use crate::simulation::Simulation;
use crate::solution::{Parameters, Solution};
use crate::twin::{self, Twin};
use crate::worker;
use dermis::design::{Electrode, SkinDesign};
use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use dermis::forward::Matrix;
use dermis::method::MethodOptions;
use dermis::reconstruct::Alpha;
use dermis::skin;
use dermis_sim::dataset::Recipe;
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::exceptions::{PyAttributeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{IntoPyDict, PyDict, PyList, PyString};
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Arc;

/// A skin prepared for computing. A clone shares all data with the original.
#[pyclass(frozen, module = "dermis")]
#[derive(Clone)]
pub struct Skin {
    skin: skin::Skin,
    /// The path of the design: relative paths in it start from its folder.
    path: Arc<str>,
    /// The Jacobian of the untouched skin per pixel, and per cell.
    jacobians: Arc<[PyOnceLock<Py<PyAny>>; 2]>,
}

/// Columns of a Jacobian.
#[derive(Debug, Clone, Copy)]
enum Per {
    Pixel = 0,
    Cell = 1,
}

impl Per {
    fn of(name: &str) -> Outcome<Self> {
        match name {
            "pixel" => Ok(Per::Pixel),
            "cell" => Ok(Per::Cell),
            _ => Err(Failure::with_hint(format!("`per` is {name:?}"), "give \"pixel\" or \"cell\"")),
        }
    }

    fn jacobian(self, skin: &skin::Skin, conductivity: &[f64]) -> Outcome<Matrix> {
        Ok(match self {
            Per::Pixel => skin.forward().pixel_jacobian(conductivity, skin.pixels())?,
            Per::Cell => skin.forward().jacobian(conductivity)?,
        })
    }
}

impl Skin {
    /// A prepared skin; `path` is that of its design.
    pub fn prepared(skin: skin::Skin, path: &str) -> Self {
        Skin { skin, path: path.into(), jacobians: Arc::new([PyOnceLock::new(), PyOnceLock::new()]) }
    }

    /// The prepared skin.
    pub fn skin(&self) -> &skin::Skin {
        &self.skin
    }

    fn cell_count(&self) -> usize {
        self.skin.mesh().cell_count()
    }

    fn channel_count(&self) -> usize {
        self.skin.design().protocol.channel_count()
    }
}

/// The name of a twin; that of the usual one if it is not given.
fn twin_name<'py>(py: Python<'py>, name: Option<&Bound<'py, PyAny>>) -> Bound<'py, PyAny> {
    name.cloned().unwrap_or_else(|| PyString::new(py, "lab").into_any())
}

/// What TOML has no word for: the keys that lead to it, and the value.
fn unwritable(value: &Bound<'_, PyAny>, keys: &str) -> PyResult<Option<String>> {
    if let Ok(table) = value.cast::<PyDict>() {
        for (key, value) in table {
            let name = if keys.is_empty() { key.to_string() } else { format!("{keys}.{key}") };
            if let Some(found) = unwritable(&value, &name)? {
                return Ok(Some(found));
            }
        }
    } else if let Ok(list) = value.cast::<PyList>() {
        for (index, value) in list.iter().enumerate() {
            if let Some(found) = unwritable(&value, &format!("{keys}[{index}]"))? {
                return Ok(Some(found));
            }
        }
    } else if value.is_none() || value.extract::<f64>().is_ok_and(|number| !number.is_finite()) {
        return Ok(Some(format!("`{keys}` is {value}")));
    }
    Ok(None)
}

/// The text of a TOML file that was given as a dict, through JSON; arrays are lists.
fn toml_text(keys: &Bound<'_, PyDict>) -> Outcome<String> {
    let py = keys.py();
    if let Some(found) = unwritable(keys, "")? {
        return Err(Failure::with_hint(found, "give a number or a text, or leave the key out"));
    }
    let list_of_array = py.import("operator")?.call_method1("methodcaller", ("tolist",))?;
    let options = [("default", list_of_array)].into_py_dict(py)?;
    // What is no array has no `tolist`.
    let of_value = |error: PyErr| match error.is_instance_of::<PyAttributeError>(py) {
        true => PyTypeError::new_err(format!("give numbers, texts, lists, dicts and arrays: {}", error.value(py))),
        false => error,
    };
    let json = py.import("json")?.call_method("dumps", (keys,), Some(&options)).map_err(of_value)?;
    let json: String = json.extract()?;
    let value: toml::Value = serde_json::from_str(&json).map_err(Failure::given)?;
    toml::to_string(&value).map_err(Failure::given)
}

/// The text of a recipe, the path of a file or a dict with its keys, and its path for messages.
fn recipe_text(recipe: &Bound<'_, PyAny>) -> Outcome<(String, PathBuf)> {
    if let Ok(recipe) = recipe.cast::<PyDict>() {
        return Ok((toml_text(recipe)?, PathBuf::from("recipe")));
    }
    let path: PathBuf = recipe.extract().map_err(|_| {
        Failure::with_hint("`recipe` is no path", "give the path of a recipe file, or a dict with its keys")
    })?;
    let text = read_text_at_most(&path, MAX_SETTINGS_BYTES)
        .map_err(|error| Failure::given(format!("{}: {error}", path.display())))?;
    Ok((text, path))
}

#[pymethods]
impl Skin {
    #[doc = stub_doc!(Skin.load)]
    #[staticmethod]
    fn load(py: Python<'_>, design: &Bound<'_, PyAny>) -> Outcome<Self> {
        if let Ok(design) = design.cast::<PyDict>() {
            return Skin::parse(py, &toml_text(design)?, "design");
        }
        let path = py.import("os")?.call_method1("fspath", (design,))?;
        let name: String = path.cast::<PyString>().map_err(Failure::given)?.extract()?;
        let text = SkinDesign::text_of(&name)?;
        Skin::parse(py, &text, &name)
    }

    /// Prepares the skin of the text of a design file; relative paths in it start from the folder of `path`.
    #[staticmethod]
    #[pyo3(signature = (text, path="design"))]
    fn parse(py: Python<'_>, text: &str, path: &str) -> Outcome<Self> {
        let skin = worker::run(py, "preparing the skin", 1, |_| Ok(skin::Skin::parse(text, path)?))?;
        Ok(Skin::prepared(skin, path))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> Outcome<(Bound<'py, PyAny>, (String, String))> {
        let Skin { skin, path, .. } = slf.get();
        let text = skin.design_text().ok_or_else(|| Failure::given("a skin without a design file"))?;
        let path = std::path::absolute(&**path).map_or_else(|_| path.to_string(), |path| path.display().to_string());
        Ok((slf.get_type().getattr("parse")?, (text.to_string(), path)))
    }

    /// The names of the shipped designs.
    #[staticmethod]
    fn shipped() -> Vec<&'static str> {
        SkinDesign::SHIPPED.to_vec()
    }

    /// Name of the design.
    #[getter]
    fn name(&self) -> &str {
        &self.skin.design().name
    }

    /// The text of the design file.
    #[getter]
    fn design(&self) -> Option<&str> {
        self.skin.design_text()
    }

    /// Positions of the electrodes' centres, (electrodes, 3), m.
    #[getter]
    fn electrodes<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        // Groups of a mesh file have no stated centre.
        let centre = |(index, electrode): (usize, &Electrode)| match electrode.centre_m.iter().all(|x| x.is_finite()) {
            true => electrode.centre_m,
            false => self.skin.mesh().electrode_centre(index),
        };
        let values = self.skin.design().electrodes.iter().enumerate().flat_map(centre).collect();
        arrays::rows(py, values, &[3], false)
    }

    /// The electrodes of each channel, (channels, 4): source, sink, plus, minus.
    #[getter]
    fn channels<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let channels = self.skin.design().protocol.channels().iter();
        let electrodes = channels.flat_map(|channel| [channel.drive, channel.measure].concat());
        let electrodes: Vec<i64> = electrodes.map(|electrode| electrode as i64).collect();
        Ok(PyArray1::from_vec(py, electrodes).reshape([self.channel_count(), 4])?.into_any())
    }

    /// The mesh of the forward model.
    #[getter]
    fn mesh(&self) -> Mesh {
        Mesh::of(self.skin.clone())
    }

    /// Conductivity of each cell of the untouched skin, (cells,): S on surfaces, S/m in volumes.
    #[getter]
    fn rest_conductivity<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        PyArray1::from_slice(py, self.skin.forward().rest_conductivity()).into_any()
    }

    /// Centres of the pixels of images, (pixels, 3), m.
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let values = self.skin.pixels().centres_m.iter().flatten().copied().collect();
        arrays::rows(py, values, &[3], false)
    }

    /// Names of the reconstruction methods, the best first.
    #[getter]
    fn methods(&self) -> Outcome<Vec<String>> {
        Ok(dermis_learn::methods().names(&self.skin)?)
    }

    #[doc = stub_doc!(Skin.forward)]
    #[pyo3(signature = (conductivity=None))]
    fn forward<'py>(&self, py: Python<'py>, conductivity: Option<&Bound<'py, PyAny>>) -> Outcome<Bound<'py, PyAny>> {
        let (cells, channels, forward) = (self.cell_count(), self.channel_count(), self.skin.forward());
        let given = conductivity.map(|given| Rows::of(given, "conductivity", cells)).transpose()?;
        let values = given.as_ref().map_or(Ok(forward.rest_conductivity()), Rows::values)?;
        let is_single = given.as_ref().is_none_or(|rows| rows.is_single);
        let count = values.len() / cells;
        let frames = worker::run(py, "solving", count, |watch| {
            let map = |map: usize| {
                watch.check()?;
                Ok::<_, Failure>(Cow::Borrowed(&values[map * cells..(map + 1) * cells]))
            };
            let mut frames = vec![0.0; count * channels];
            forward.solve_many_into(map, |done| watch.steps(done), &mut frames)?;
            Ok(frames)
        })?;
        arrays::rows(py, frames, &[channels], is_single)
    }

    #[doc = stub_doc!(Skin.solve)]
    #[pyo3(signature = (conductivity, *, contact_impedance=None, nodes=None))]
    fn solve(
        &self,
        py: Python<'_>,
        conductivity: &Bound<'_, PyAny>,
        contact_impedance: Option<&Bound<'_, PyAny>>,
        nodes: Option<&Bound<'_, PyAny>>,
    ) -> Outcome<Solution> {
        Solution::of(py, &self.skin, &Parameters { conductivity, contact_impedance, nodes })
    }

    /// Contact impedance of each electrode, (electrodes,): ohm m2 on areas, ohm m on edges.
    #[getter]
    fn contact_impedance<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        PyArray1::from_slice(py, self.skin.forward().contact_impedances()).into_any()
    }

    #[doc = stub_doc!(Skin.jacobian)]
    #[pyo3(signature = (conductivity=None, *, per="pixel"))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        conductivity: Option<&Bound<'py, PyAny>>,
        per: &str,
    ) -> Outcome<Bound<'py, PyAny>> {
        let per = Per::of(per)?;
        let compute = |conductivity: &[f64]| {
            let matrix = worker::run(py, "computing the Jacobian", 1, |_| per.jacobian(&self.skin, conductivity))?;
            Ok::<_, Failure>(arrays::matrix(py, matrix.values, matrix.columns)?.into_any())
        };
        if let Some(given) = conductivity {
            let rows = Rows::of(given, "conductivity", self.cell_count())?;
            let values = rows.values()?;
            if values.len() != self.cell_count() {
                return Err(Failure::with_hint("`conductivity` has more than one row", "a Jacobian belongs to one"));
            }
            return compute(values);
        }
        let shared = self.jacobians[per as usize].get_or_try_init(py, || {
            let rest = self.skin.forward().rest_conductivity();
            Ok::<_, Failure>(arrays::read_only(compute(rest)?)?.unbind())
        })?;
        Ok(shared.bind(py).clone())
    }

    #[doc = stub_doc!(Skin.touched_conductivity)]
    #[pyo3(signature = (positions, *, amplitude=0.5, width_m=0.008))]
    fn touched_conductivity<'py>(
        &self,
        py: Python<'py>,
        positions: &Bound<'py, PyAny>,
        amplitude: f64,
        width_m: f64,
    ) -> Outcome<Bound<'py, PyAny>> {
        let rows = Rows::of(positions, "positions", 3)?;
        let (positions, _) = rows.values()?.as_chunks::<3>();
        let touch = |&centre_m: &[f64; 3]| GaussianTouch { centre_m, amplitude, width_m };
        let touches: Vec<GaussianTouch> = positions.iter().map(touch).collect();
        contacts::check_places("positions", positions, &self.skin)?;
        let (design, rest) = (self.skin.design(), self.skin.forward().rest_conductivity());
        let surface = design.body.surface();
        let map = worker::run(py, "touching", 1, |_| {
            Ok(touched_conductivity(self.skin.mesh(), &surface, design.sheet.touch, rest, &touches)?)
        })?;
        Ok(PyArray1::from_vec(py, map).into_any())
    }

    #[doc = stub_doc!(Skin.method)]
    #[pyo3(signature = (name=None, *, alpha=None))]
    fn method(&self, py: Python<'_>, name: Option<&Bound<'_, PyAny>>, alpha: Option<f64>) -> Outcome<Method> {
        let name = method_name(py, name)?.unwrap_or_default();
        if let Some(alpha) = alpha.filter(|alpha| !(*alpha > 0.0 && alpha.is_finite())) {
            return Err(Failure::with_hint(format!("`alpha` is {alpha}"), "give a positive number"));
        }
        let options = MethodOptions { alpha: alpha.map_or(Alpha::Auto, Alpha::Given), ..MethodOptions::default() };
        let skin = &self.skin;
        let method =
            worker::run(py, "preparing the method", 1, |_| Ok(dermis_learn::methods().method(skin, &name, &options)?))?;
        Ok(Method::prepared(self.clone(), method, alpha))
    }

    #[doc = stub_doc!(Skin.twin)]
    #[pyo3(signature = (name=None, *, seed))]
    fn twin(&self, py: Python<'_>, name: Option<&Bound<'_, PyAny>>, seed: u64) -> Outcome<Twin> {
        Twin::of(py, self, &twin_name(py, name), seed)
    }

    #[doc = stub_doc!(Skin.experiment)]
    #[pyo3(signature = (name=None, *, seed))]
    fn experiment<'py>(
        &self,
        py: Python<'py>,
        name: Option<&Bound<'py, PyAny>>,
        seed: u64,
    ) -> Outcome<Bound<'py, PyDict>> {
        twin::experiment(py, self, &twin_name(py, name), seed)
    }

    #[doc = stub_doc!(Skin.calibrate)]
    #[pyo3(signature = (frames, positions, baseline=None, *, force_n=None, rows=None, method=None, robot_frame=false, force=false))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn calibrate(
        &self,
        py: Python<'_>,
        frames: &Bound<'_, PyAny>,
        positions: &Bound<'_, PyAny>,
        baseline: Option<&Bound<'_, PyAny>>,
        force_n: Option<&Bound<'_, PyAny>>,
        rows: Option<&Bound<'_, PyAny>>,
        method: Option<&str>,
        robot_frame: bool,
        force: bool,
    ) -> Outcome<Calibration> {
        let (differences, _) = method::differences(py, self, frames, baseline, force)?;
        let presses = Presses { positions, force_n, rows, in_robot_frame: robot_frame };
        Calibration::fit(py, self, &differences, &presses, method, force)
    }

    /// Reads a calibration of this skin from its folder.
    fn calibration(&self, py: Python<'_>, folder: PathBuf) -> Outcome<Calibration> {
        Calibration::load(py, self, folder)
    }

    #[doc = stub_doc!(Skin.samples)]
    fn samples(&self, py: Python<'_>, recipe: &Bound<'_, PyAny>, seed: u64) -> Outcome<Samples> {
        let (text, path) = recipe_text(recipe)?;
        Samples::of(py, self, &text, &path, seed)
    }

    #[doc = stub_doc!(Skin.simulation)]
    fn simulation(&self, py: Python<'_>, recipe: &Bound<'_, PyAny>, seed: u64, samples: u64) -> Outcome<Simulation> {
        let (text, path) = recipe_text(recipe)?;
        Simulation::of(py, self, &Recipe::parse(&text, &path, seed, samples)?)
    }

    /// A picture of the skin: `electrodes`, `mesh` or `sensitivity`, as the text of an SVG.
    #[pyo3(signature = (what="electrodes"))]
    fn svg(&self, py: Python<'_>, what: &str) -> Outcome<String> {
        picture::of_skin(py, &self.skin, what)
    }

    fn _repr_html_(&self, py: Python<'_>) -> Outcome<String> {
        self.svg(py, "electrodes")
    }

    fn __repr__(&self) -> String {
        let (electrodes, channels) = (self.skin.design().electrodes.len(), self.channel_count());
        let cells = self.cell_count();
        format!("<dermis.Skin {:?}: {electrodes} electrodes, {channels} channels, {cells} cells>", self.name())
    }
}
