//! VTU, the XML format of VTK for unstructured grids, as text
//! (Kitware, VTK file formats, "Unstructured grid").

use super::{CellField, electrode_parts, electrodes_of_cells};
use crate::mesh::{Cells, Mesh};
use crate::text::escaped;
use std::fmt::Display;
use std::io::{self, Write};

pub(super) fn write(mesh: &Mesh, fields: &[CellField], out: &mut dyn Write) -> io::Result<()> {
    let parts = electrode_parts(mesh);
    let corner_lists = || {
        let cells = (0..mesh.cell_count()).map(|cell| mesh.cells.corners(cell));
        cells.chain(parts.iter().map(|part| part.nodes.as_slice()))
    };
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    writeln!(out, "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">")?;
    writeln!(out, "<UnstructuredGrid>")?;
    let cell_count = mesh.cell_count() + parts.len();
    writeln!(out, "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{cell_count}\">", mesh.node_count())?;
    writeln!(out, "<Points>")?;
    let points = mesh.nodes.iter().map(|[x, y, z]| format!("{x:?} {y:?} {z:?}"));
    array(out, "Float64", "Points\" NumberOfComponents=\"3", points)?;
    writeln!(out, "</Points>\n<Cells>")?;
    array(out, "Int64", "connectivity", corner_lists().map(words))?;
    let ends = corner_lists().scan(0, |end, corners| {
        *end += corners.len();
        Some(*end)
    });
    array(out, "Int64", "offsets", ends)?;
    let is_volume = matches!(mesh.cells, Cells::Tetrahedra(_));
    array(
        out,
        "UInt8",
        "types",
        corner_lists().enumerate().map(|(k, c)| vtk_type(c, is_volume && k < mesh.cell_count())),
    )?;
    writeln!(out, "</Cells>\n<CellData>")?;
    let of_cells = electrodes_of_cells(mesh).into_iter().map(|list| list.first().map_or(-1, |&e| e as i64));
    array(out, "Int32", "electrode", of_cells.chain(parts.iter().map(|part| part.electrode as i64)))?;
    for CellField { name, values } in fields {
        // VTK cannot read NaN as text.
        let finite = values.iter().map(|&value| if value.is_finite() { value } else { 0.0 });
        let values = finite.chain(parts.iter().map(|_| 0.0));
        array(out, "Float64", &escaped(name), values.map(|value| format!("{value:?}")))?;
    }
    writeln!(out, "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

/// VTK's cell type of a vertex, line, triangle or tetrahedron.
fn vtk_type(corners: &[usize], is_tetrahedron: bool) -> u8 {
    match corners.len() {
        _ if is_tetrahedron => 10,
        1 => 1,
        2 => 3,
        _ => 5,
    }
}

fn words(corners: &[usize]) -> String {
    corners.iter().map(usize::to_string).collect::<Vec<_>>().join(" ")
}

/// A data array, one item per line.
fn array<T: Display>(out: &mut dyn Write, kind: &str, name: &str, items: impl Iterator<Item = T>) -> io::Result<()> {
    writeln!(out, "<DataArray type=\"{kind}\" Name=\"{name}\" format=\"ascii\">")?;
    for item in items {
        writeln!(out, "{item}")?;
    }
    writeln!(out, "</DataArray>")
}
