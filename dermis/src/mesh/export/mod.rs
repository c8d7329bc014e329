//! Export of meshes: VTU for ParaView, Gmsh .msh, STL.

mod msh;
mod stl;
mod vtu;

pub use stl::write_stl;

use crate::files::{ending, write_whole};
use crate::mesh::{ElectrodePatch, Mesh, MeshError};
use std::io::Write;
use std::path::Path;

/// Writes a mesh in the format given by the file's extension.
///
/// - `.vtu`: the cells, then the edges, faces and points of electrodes as separate cells; cell data `electrode` (its
///   number, -1 for none) and, if given, `conductivity` (0 on cells that only show an electrode);
/// - `.msh`: Gmsh 4.1, ASCII, with the physical groups `electrode_<n>` and the regions, so that
///   [`load`](crate::mesh::import::load) gives the same mesh; the conductivity, if given, as `$ElementData`;
/// - `.stl`: binary, only the triangles; for a volume its outer surface. Electrodes and conductivity are lost,
///   positions are rounded to single precision.
///
/// Lengths are in metres. A temporary file is written and renamed when it is complete.
///
/// # Errors
/// Another extension; a conductivity of the wrong length; a file that cannot be written.
pub fn save(mesh: &Mesh, path: &Path, conductivity: Option<&[f64]>) -> Result<(), MeshError> {
    let fields: Vec<CellField> =
        conductivity.iter().map(|&values| CellField { name: "conductivity".into(), values: values.to_vec() }).collect();
    check_fields(mesh, path, &fields)?;
    match ending(path).as_str() {
        "vtu" => write(path, |out| vtu::write(mesh, &fields, out)),
        "msh" => write(path, |out| msh::write(mesh, conductivity, out)),
        "stl" => write(path, |out| stl::write(mesh, out)),
        other => Err(unknown_extension(path, "a mesh", other, ".vtu, .msh or .stl")),
    }
}

/// Values of a quantity for every cell of a mesh, with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct CellField {
    /// Name of the data array.
    pub name: String,
    /// A value for each cell, in the order of the mesh.
    pub values: Vec<f64>,
}

/// Writes values of the cells of a mesh as a `.vtu` file for ParaView: the mesh as in [`save`], with a cell data array
/// for each field. Cells that only show an electrode, and values that are not finite, are written as 0.
///
/// ```
/// use dermis::design::SkinDesign;
/// use dermis::image::{Image, PixelSpace};
/// use dermis::mesh::Mesh;
/// use dermis::mesh::export::{CellField, save_cell_fields};
/// use std::sync::Arc;
///
/// let mut design = SkinDesign::shipped("cylinder30").unwrap();
/// design.mesh = design.mesh.scaled(2.0);
/// let mesh = Mesh::generate(&design)?;
/// let space = Arc::new(PixelSpace::for_design(&design, &mesh)?);
/// let image = Image { values: vec![0.5; space.len()], space };
///
/// let path = std::env::temp_dir().join(format!("dermis-{}.vtu", std::process::id()));
/// let fields = [CellField { name: "frame 0".into(), values: image.to_cells(mesh.cell_count()) }];
/// save_cell_fields(&mesh, &path, &fields)?;
/// assert!(std::fs::read_to_string(&path).unwrap().contains("Name=\"frame 0\""));
/// # std::fs::remove_file(&path).unwrap();
/// # Ok::<(), dermis::Error>(())
/// ```
///
/// # Errors
/// Another extension; a field of the wrong length; two fields of one name; a file that cannot be written.
pub fn save_cell_fields(mesh: &Mesh, path: &Path, fields: &[CellField]) -> Result<(), MeshError> {
    check_fields(mesh, path, fields)?;
    match ending(path).as_str() {
        "vtu" => write(path, |out| vtu::write(mesh, fields, out)),
        other => Err(unknown_extension(path, "values of cells", other, ".vtu")),
    }
}

fn file_error(path: &Path, message: String) -> MeshError {
    MeshError::File { path: path.to_path_buf(), message }
}

fn unknown_extension(path: &Path, what: &str, extension: &str, known: &str) -> MeshError {
    let is = if what.ends_with('s') { "are" } else { "is" };
    file_error(path, format!("{what} {is} written as {known}, not as `.{extension}`"))
}

fn check_fields(mesh: &Mesh, path: &Path, fields: &[CellField]) -> Result<(), MeshError> {
    for (index, CellField { name, values }) in fields.iter().enumerate() {
        if values.len() != mesh.cell_count() {
            let message = format!("{} values of `{name}`, but the mesh has {} cells", values.len(), mesh.cell_count());
            return Err(file_error(path, message));
        }
        if fields[..index].iter().any(|other| other.name == *name) {
            return Err(file_error(path, format!("two fields have the name `{name}`")));
        }
    }
    Ok(())
}

fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), MeshError> {
    write_whole(path, fill).map_err(|source| MeshError::Io { path: path.to_path_buf(), source })
}

/// A part of an electrode that is not a cell of the mesh: an edge, a face or a node.
struct Part {
    electrode: usize,
    nodes: Vec<usize>,
}

/// The parts of electrodes that are not cells, in the order of the electrodes.
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
