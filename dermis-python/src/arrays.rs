//! Arrays in and out.

use crate::failure::{Failure, Outcome};
use dermis::frame::{Differences, Frame, column_order};
use dermis::protocol::Protocol;
use dermis::text::counted;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Rows of numbers that a caller has given: an array of one or two dimensions, or anything that becomes one.
pub struct Rows<'py> {
    array: PyReadonlyArray2<'py, f64>,
    /// One row was given, without the dimension of rows.
    pub is_single: bool,
}

impl<'py> Rows<'py> {
    /// From an argument that must have this many columns.
    pub fn of(value: &Bound<'py, PyAny>, argument: &str, columns: usize) -> Outcome<Self> {
        let array = contiguous(value, argument)?;
        let shape = array.shape().to_vec();
        let is_single = shape.len() == 1;
        if shape.last() != Some(&columns) || shape.len() > 2 {
            let message = format!("`{argument}` has the shape {}", shown(&shape));
            return Err(Failure::with_hint(message, &format!("give ({columns},) or (n, {columns})")));
        }
        let rows = shape.iter().product::<usize>() / columns.max(1);
        let array = array.reshape([rows, columns])?;
        Ok(Rows { array: array.readonly(), is_single })
    }

    /// The values, row after row.
    pub fn values(&self) -> Outcome<&[f64]> {
        self.array.as_slice().map_err(Failure::given)
    }

    /// The rows as frames.
    pub fn frames(&self) -> Outcome<Vec<Frame>> {
        let columns = self.array.shape()[1].max(1);
        Ok(self.values()?.chunks_exact(columns).map(|row| Frame(row.to_vec())).collect())
    }
}

/// Frames, (channels,) or (n, channels). The columns of a table of pandas or polars are those of the channels that their names say.
pub fn frames<'py>(value: &Bound<'py, PyAny>, argument: &str, protocol: &Protocol) -> Outcome<Rows<'py>> {
    let channels = protocol.channel_count();
    let Some(names) = value.getattr_opt("columns")? else { return Rows::of(value, argument, channels) };
    let names = names.try_iter()?.map(|name| Ok(name?.str()?.to_string())).collect::<PyResult<Vec<String>>>()?;
    let order = column_order(&names, protocol).map_err(|why| Failure::given(format!("`{argument}`: {why}")))?;
    let plain = value.py().import("numpy")?.call_method1("asarray", (value,))?;
    match order {
        Some(order) => Rows::of(&plain.call_method1("take", (order, 1))?, argument, channels),
        None => Rows::of(&plain, argument, channels),
    }
}

/// A baseline with an untouched frame for each frame.
#[pyclass(frozen, module = "dermis")]
pub struct Paired {
    baseline: Py<PyAny>,
}

#[pymethods]
impl Paired {
    #[new]
    fn new(baseline: Py<PyAny>) -> Self {
        Paired { baseline }
    }
}

/// The differences of frames from the mean of untouched ones or each from its own, or frames that are differences; and whether
/// one frame was given.
pub fn differences(
    frames: &Bound<'_, PyAny>,
    baseline: Option<&Bound<'_, PyAny>>,
    protocol: &Protocol,
) -> Outcome<(Differences, bool)> {
    let rows = self::frames(frames, "frames", protocol)?;
    let Some(baseline) = baseline else {
        return Ok((Differences::new(rows.frames()?, Vec::new()), rows.is_single));
    };
    let paired = baseline.cast::<Paired>().ok();
    let array = paired.map_or(baseline, |paired| paired.get().baseline.bind(baseline.py()));
    let (frames, untouched) = (rows.frames()?, self::frames(array, "baseline", protocol)?.frames()?);
    if untouched.is_empty() {
        return Err(Failure::given("`baseline` has no frame"));
    }
    if paired.is_none() {
        return Ok((Differences::new(frames, untouched), rows.is_single));
    }
    if untouched.len() != frames.len() {
        let message =
            format!("`baseline` has {} for {}", counted(untouched.len(), "frame"), counted(frames.len(), "frame"));
        return Err(Failure::with_hint(
            message,
            "give an untouched frame for each frame, or their mean without Paired",
        ));
    }
    Ok((Differences::paired(frames, untouched), rows.is_single))
}

/// An argument as a contiguous array of float64; shared where it is one already.
fn contiguous<'py>(value: &Bound<'py, PyAny>, argument: &str) -> Outcome<Bound<'py, PyArrayDyn<f64>>> {
    let py = value.py();
    let numpy = py.import("numpy")?;
    let refused = |why: &dyn std::fmt::Display| {
        Failure::with_hint(format!("`{argument}` is no array of real numbers: {why}"), "give numbers")
    };
    let plain = numpy.call_method1("asarray", (value,)).map_err(|error| refused(&error.value(py)))?;
    let dtype = plain.getattr("dtype")?;
    let kind: char = dtype.getattr("kind")?.extract()?;
    if value.is_none() || !"biufO".contains(kind) {
        return Err(refused(&dtype));
    }
    if value.hasattr("mask")? && numpy.getattr("ma")?.call_method1("is_masked", (value,))?.is_truthy()? {
        return Err(Failure::with_hint(
            format!("`{argument}` has masked values"),
            "leave their rows out, or give the values",
        ));
    }
    let options = PyDict::new(py);
    options.set_item("dtype", "float64")?;
    // Contiguous and aligned.
    options.set_item("requirements", ["C", "A"])?;
    match numpy.call_method("require", (plain,), Some(&options)) {
        Ok(array) => Ok(array.cast_into::<PyArrayDyn<f64>>().map_err(|error| refused(&error))?),
        Err(error) => Err(refused(&error.value(py))),
    }
}

/// A shape as Python writes it.
fn shown(shape: &[usize]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Values of rows as an array, without a copy.
pub fn matrix(py: Python<'_>, values: Vec<f64>, columns: usize) -> Outcome<Bound<'_, PyArray2<f64>>> {
    let rows = values.len() / columns.max(1);
    Ok(PyArray1::from_vec(py, values).reshape([rows, columns])?)
}

/// Rows of values, or one row if one was asked for.
pub fn rows<'py>(py: Python<'py>, values: Vec<f64>, shape: &[usize], is_single: bool) -> Outcome<Bound<'py, PyAny>> {
    let count = values.len() / shape.iter().product::<usize>().max(1);
    let whole: Vec<usize> = if is_single { shape.to_vec() } else { [&[count], shape].concat() };
    Ok(PyArray1::from_vec(py, values).reshape(whole)?.into_any())
}

/// Makes an array read-only, for values that are shared.
pub fn read_only<'py>(array: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let keywords = PyDict::new(array.py());
    keywords.set_item("write", false)?;
    array.call_method("setflags", (), Some(&keywords))?;
    Ok(array)
}

/// Most values of a result: 8 GiB.
const MAX_VALUES: usize = 1 << 30;

/// Refuses a result of some rows that no memory holds, before any of it is computed; `argument` is what asks for them.
pub fn check_size(argument: &str, rows: u64, columns: usize) -> Outcome<()> {
    let most = MAX_VALUES / columns.max(1);
    if rows <= most as u64 {
        return Ok(());
    }
    Err(Failure::with_hint(
        format!("`{argument}` asks for {rows} rows of {columns} values"),
        &format!("ask for at most {most}"),
    ))
}

/// A number for each row: one for all, or an array.
pub struct Column(Vec<f64>);

impl Column {
    /// From an argument with a number for each of `count` rows, one number, or nothing.
    pub fn of(value: Option<&Bound<'_, PyAny>>, argument: &str, count: usize, default: f64) -> Outcome<Self> {
        let Some(value) = value else { return Ok(Column(vec![default])) };
        let array = contiguous(value, argument)?;
        let shape = array.shape().to_vec();
        if !(shape.is_empty() || shape == [count]) {
            let message = format!("`{argument}` has the shape {}", shown(&shape));
            return Err(Failure::with_hint(message, &format!("give one number, or ({count},)")));
        }
        Ok(Column(array.readonly().as_slice().map_err(Failure::given)?.to_vec()))
    }

    /// The number of a row.
    pub fn at(&self, row: usize) -> f64 {
        self.0[if self.0.len() == 1 { 0 } else { row }]
    }
}

/// Indices from an argument with `count` whole numbers from 0 on.
pub fn indices(value: &Bound<'_, PyAny>, argument: &str, count: usize) -> Outcome<Vec<usize>> {
    let array = value.py().import("numpy")?.call_method1("asarray", (value,))?;
    if array.getattr("dtype")?.getattr("kind")?.extract::<char>()? == 'b' {
        let fix = "give numpy.flatnonzero of it";
        return Err(Failure::with_hint(format!("`{argument}` has truth values, not indices"), fix));
    }
    let column = Column::of(Some(value), argument, count, 0.0)?;
    let index = |row: usize| {
        let number = column.at(row);
        // Beyond this number of frames no memory suffices.
        match number >= 0.0 && number.fract() == 0.0 && number < 1e7 {
            true => Ok(number as usize),
            false => Err(Failure::given(format!("`{argument}` has {number}: indices are whole numbers from 0 to 1e7"))),
        }
    };
    (0..count).map(index).collect()
}
