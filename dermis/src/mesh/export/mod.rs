//! Meshes to files: VTU for ParaView, Gmsh .msh, STL.

mod msh;
mod stl;
mod vtu;

use crate::frame::{TableError, write_whole};
use crate::mesh::{Cells, ElectrodePatch, Mesh, MeshError};
use std::io::Write;
use std::path::Path;

/// Writes a mesh in the format that the file's name asks for.
///
/// - `.vtu`: the cells, then the edges, faces and points of electrodes as cells of their own; cell data `electrode`
///   (its number, -1 for none) and, where given, `conductivity` (0 on cells that only show an electrode);
/// - `.msh`: Gmsh 4.1, ASCII, with the physical groups `electrode_<n>` and the regions, so that
///   [`load`](crate::mesh::import::load) gives the same mesh; the conductivity, where given, as `$ElementData`;
/// - `.stl`: binary, the triangles alone; of a volume its outside. Electrodes and conductivity are lost, positions
///   rounded to single precision.
///
/// Lengths are in metres. The file is written beside its place and renamed when it is whole.
///
/// # Errors
/// Another extension; a conductivity of the wrong length; a file that cannot be written.
pub fn save(mesh: &Mesh, path: &Path, conductivity: Option<&[f64]>) -> Result<(), MeshError> {
    let wrong = |message: String| MeshError::File { path: path.to_path_buf(), message };
    if let Some(values) = conductivity.filter(|values| values.len() != mesh.cell_count()) {
        let message = format!("{} conductivities, but the mesh has {} cells", values.len(), mesh.cell_count());
        return Err(wrong(message));
    }
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    let write = |out: &mut dyn Write| match extension.as_deref() {
        Some("vtu") => vtu::write(mesh, conductivity, out),
        Some("msh") => msh::write(mesh, conductivity, out),
        _ => stl::write(mesh, out),
    };
    if !matches!(extension.as_deref(), Some("vtu" | "msh" | "stl")) {
        return Err(wrong("a mesh is written as .vtu, .msh or .stl".into()));
    }
    write_whole(path, write).map_err(|error| match error {
        TableError::Io { path, source } => MeshError::Io { path, source },
        other => wrong(other.to_string()),
    })
}

/// A part of an electrode that is no cell of the mesh: an edge, a face or a node.
struct Part {
    electrode: usize,
    nodes: Vec<usize>,
}

/// The parts of electrodes that are no cells, in the order of the electrodes.
fn electrode_parts(mesh: &Mesh) -> Vec<Part> {
    let mut parts = Vec::new();
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        let mut push = |nodes: &[usize]| parts.push(Part { electrode, nodes: nodes.to_vec() });
        match patch {
            ElectrodePatch::Cells(_) => {}
            ElectrodePatch::Edges(edges) => edges.iter().for_each(|edge| push(edge)),
            ElectrodePatch::Faces(faces) => faces.iter().for_each(|face| push(face)),
            ElectrodePatch::Node(node) => push(&[*node]),
        }
    }
    parts
}

/// The electrodes that cover a whole cell, by cell.
fn electrodes_of_cells(mesh: &Mesh) -> Vec<Vec<usize>> {
    let mut of_cell = vec![Vec::new(); mesh.cell_count()];
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        if let ElectrodePatch::Cells(cells) = patch {
            cells.iter().for_each(|&cell| of_cell[cell].push(electrode));
        }
    }
    of_cell
}

/// The triangles of a surface, or those on the outside of a volume, counter-clockwise as seen from outside.
fn outside(mesh: &Mesh) -> Vec<[usize; 3]> {
    match &mesh.cells {
        Cells::Triangles(cells) => cells.clone(),
        Cells::Tetrahedra(cells) => {
            let mut faces: Vec<([usize; 3], [usize; 3])> = Vec::with_capacity(4 * cells.len());
            for &[a, b, c, d] in cells {
                for face in [[b, d, c], [a, c, d], [a, d, b], [a, b, c]] {
                    let mut key = face;
                    key.sort_unstable();
                    // abc is seen counter-clockwise from d: from inside.
                    faces.push((key, if face == [a, b, c] { [a, c, b] } else { face }));
                }
            }
            faces.sort_unstable();
            let single = faces.chunk_by(|one, other| one.0 == other.0).filter(|same| same.len() == 1);
            single.map(|same| same[0].1).collect()
        }
    }
}
