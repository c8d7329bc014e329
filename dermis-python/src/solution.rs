//! `dermis.Solution`: frames that can be differentiated.

use crate::arrays::{self, Rows};
use crate::failure::{Failure, Outcome};
use crate::worker;
use dermis::forward::Solutions;
use dermis::geom::Point3;
use dermis::geom::vector::{cross, dot, sub};
use dermis::mesh::Mesh;
use dermis::text::counted;
use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::borrow::Cow;

/// Frames of conductivities, with what gradients need.
#[pyclass(frozen, module = "dermis")]
pub struct Solution {
    frames: Py<PyAny>,
    solutions: Solutions,
    is_single: bool,
}

/// What may be changed between solutions.
pub struct Parameters<'a, 'py> {
    pub conductivity: &'a Bound<'py, PyAny>,
    pub contact_impedance: Option<&'a Bound<'py, PyAny>>,
    pub nodes: Option<&'a Bound<'py, PyAny>>,
}

impl Solution {
    /// Solves the model of a skin with some parameters.
    pub fn of(py: Python<'_>, skin: &dermis::skin::Skin, parameters: &Parameters<'_, '_>) -> Outcome<Self> {
        let Parameters { conductivity, contact_impedance, nodes } = parameters;
        let forward = skin.forward();
        let (cells, channels) = (skin.mesh().cell_count(), forward.protocol().channel_count());
        let is_changed = contact_impedance.is_some() || nodes.is_some();
        let contacts = contact_impedance.map(|given| one_row(given, "contact_impedance", skin.mesh().electrodes.len()));
        let contacts = contacts.transpose()?.unwrap_or_else(|| forward.contact_impedances().to_vec());
        let nodes = match nodes {
            None => skin.mesh().nodes.clone(),
            Some(nodes) => {
                let rows = Rows::of(nodes, "nodes", 3)?;
                let moved = rows.values()?.as_chunks::<3>().0.to_vec();
                check_cells(skin.mesh(), &moved)?;
                moved
            }
        };
        let model = match is_changed {
            true => worker::run_short(py, || {
                Ok(forward.with_parameters(&nodes, &contacts, forward.rest_conductivity())?)
            })?,
            false => forward.clone(),
        };
        let rows = Rows::of(conductivity, "conductivity", cells)?;
        let values = rows.values()?;
        let count = values.len() / cells;
        let (frames, solutions) = worker::run(py, "solving", count, |watch| {
            let map = |map: usize| {
                watch.check()?;
                Ok::<_, Failure>(Cow::Borrowed(&values[map * cells..(map + 1) * cells]))
            };
            model.solve_many_kept(count, map, |done| watch.steps(done))
        })?;
        let frames = frames.into_iter().flat_map(|frame| frame.0).collect();
        let frames = arrays::read_only(arrays::rows(py, frames, &[channels], rows.is_single)?)?.unbind();
        Ok(Solution { frames, solutions, is_single: rows.is_single })
    }
}

/// Refuses places of the nodes of a mesh that turn one of its cells over; the model refuses all else that is no mesh.
fn check_cells(mesh: &Mesh, moved: &[Point3]) -> Outcome<()> {
    if moved.len() != mesh.node_count() {
        return Ok(());
    }
    let is_turned = |cell: &usize| {
        let corners = mesh.cells.corners(*cell);
        let edges = |nodes: &[Point3]| -> Vec<Point3> {
            corners[1..].iter().map(|&node| sub(nodes[node], nodes[corners[0]])).collect()
        };
        let (before, after) = (edges(&mesh.nodes), edges(moved));
        let normal = |edges: &[Point3]| cross(edges[0], edges[1]);
        match (before.get(2), after.get(2)) {
            (Some(&b), Some(&a)) => dot(normal(&before), b) * dot(normal(&after), a) < 0.0,
            _ => dot(normal(&before), normal(&after)) < 0.0,
        }
    };
    match (0..mesh.cell_count()).filter(is_turned).count() {
        0 => Ok(()),
        turned => {
            let message = format!("`nodes` turns {} of {} over", counted(turned, "cell"), mesh.cell_count());
            Err(Failure::with_hint(message, "move the nodes by less than a cell, or make a mesh of the new design"))
        }
    }
}

/// An argument that is one row.
fn one_row(given: &Bound<'_, PyAny>, argument: &str, columns: usize) -> Outcome<Vec<f64>> {
    let rows = Rows::of(given, argument, columns)?;
    if !rows.is_single {
        return Err(Failure::with_hint(format!("`{argument}` has rows"), &format!("give ({columns},)")));
    }
    Ok(rows.values()?.to_vec())
}

#[pymethods]
impl Solution {
    /// The frames, (n, channels) or (channels,), ohm; read-only.
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        self.frames.bind(py).clone()
    }

    #[doc = stub_doc!(Solution.gradient)]
    #[pyo3(signature = (by_frame, *, parameters=false))]
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        by_frame: &Bound<'py, PyAny>,
        parameters: bool,
    ) -> Outcome<Bound<'py, PyDict>> {
        let model = self.solutions.model();
        let channels = model.protocol().channel_count();
        let rows = Rows::of(by_frame, "by_frame", channels)?;
        let values = rows.values()?;
        let count = self.solutions.len();
        if values.len() != count * channels || rows.is_single != self.is_single {
            let message = format!("`by_frame` has {} rows", values.len() / channels);
            return Err(Failure::with_hint(message, "give the shape of the frames"));
        }
        let of = |number: usize| &values[number * channels..(number + 1) * channels];
        let cells = model.mesh().cell_count();
        let result = PyDict::new(py);
        if !parameters {
            let by_conductivity =
                worker::run(py, "differentiating", 1, |_| Ok(self.solutions.conductivity_gradients(of).concat()))?;
            result.set_item("conductivity", arrays::rows(py, by_conductivity, &[cells], self.is_single)?)?;
            return Ok(result);
        }
        let gradients = worker::run(py, "differentiating", 1, |_| Ok(self.solutions.gradients(of)))?;
        let by_conductivity = gradients.iter().flat_map(|one| one.conductivity.iter().copied()).collect();
        result.set_item("conductivity", arrays::rows(py, by_conductivity, &[cells], self.is_single)?)?;
        // One set of parameters for all frames: the sum over the frames.
        let mut contacts = vec![0.0; model.contact_impedances().len()];
        let mut nodes = vec![[0.0; 3]; model.mesh().node_count()];
        for one in &gradients {
            contacts.iter_mut().zip(&one.contact_impedances).for_each(|(sum, value)| *sum += value);
            nodes.as_flattened_mut().iter_mut().zip(one.nodes.as_flattened()).for_each(|(sum, value)| *sum += value);
        }
        result.set_item("contact_impedance", PyArray1::from_vec(py, contacts))?;
        result.set_item("nodes", PyArray1::from_vec(py, nodes.as_flattened().to_vec()).reshape([nodes.len(), 3])?)?;
        Ok(result)
    }

    fn __repr__(&self) -> String {
        format!("<dermis.Solution: {} frames>", self.solutions.len())
    }
}
