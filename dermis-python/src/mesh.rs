//! `dermis.Mesh`.

use crate::arrays;
use crate::failure::Outcome;
use dermis::mesh::Cells;
use dermis::skin;
use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::prelude::*;

/// The mesh of a skin.
#[pyclass(frozen, module = "dermis")]
pub struct Mesh {
    skin: skin::Skin,
}

impl Mesh {
    pub fn of(skin: skin::Skin) -> Self {
        Mesh { skin }
    }
}

#[pymethods]
impl Mesh {
    /// Positions of the nodes, (nodes, 3), m.
    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let values = self.skin.mesh().nodes.iter().flatten().copied().collect();
        arrays::rows(py, values, &[3], false)
    }

    /// The nodes of each cell: (cells, 3) triangles or (cells, 4) tetrahedra.
    #[getter]
    fn cells<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let cells = &self.skin.mesh().cells;
        let corners = match cells {
            Cells::Triangles(_) => 3,
            Cells::Tetrahedra(_) => 4,
        };
        let nodes = (0..cells.len()).flat_map(|cell| cells.corners(cell)).map(|&node| node as i64).collect();
        Ok(PyArray1::from_vec(py, nodes).reshape([cells.len(), corners])?.into_any())
    }

    /// Areas of triangles, m2, or volumes of tetrahedra, m3: (cells,).
    #[getter]
    fn measures<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyAny>> {
        let mesh = self.skin.mesh();
        let values: Vec<f64> = (0..mesh.cell_count()).map(|cell| mesh.cell_measure(cell)).collect();
        Ok(PyArray1::from_vec(py, values).into_any())
    }

    /// The nodes of each electrode: a list of arrays.
    #[getter]
    fn electrode_nodes<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, PyArray1<i64>>> {
        let mesh = self.skin.mesh();
        let nodes = |electrode| mesh.electrode_nodes(electrode).into_iter().map(|node| node as i64);
        (0..mesh.electrodes.len()).map(|electrode| PyArray1::from_iter(py, nodes(electrode))).collect()
    }

    /// The mesh as a `meshio.Mesh`, with values per cell by name.
    #[pyo3(signature = (cell_data=None))]
    fn to_meshio<'py>(slf: &Bound<'py, Self>, cell_data: Option<&Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("dermis._exchange")?.call_method1("to_meshio", (slf, cell_data))
    }

    fn __repr__(&self) -> String {
        let mesh = self.skin.mesh();
        let cells = match mesh.cells {
            Cells::Triangles(_) => "triangles",
            Cells::Tetrahedra(_) => "tetrahedra",
        };
        format!("<dermis.Mesh: {} nodes, {} {cells}>", mesh.node_count(), mesh.cell_count())
    }
}
