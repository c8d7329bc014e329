//! Import of meshes.

mod cursor;
mod groups;
mod msh;
mod obj;
mod orient;
mod overlap;
mod ply;
mod shape;
mod soup;
mod stl;

use crate::design::{Body, ElectrodeShape, LARGEST_BODY_M, MeshFile, SkinDesign};
use crate::files::{ending, read_at_most};
use crate::geom::Point3;
use crate::geom::vector::{self, bounding_box};
use crate::mesh::{Mesh, MeshError, place};
use cursor::Problem;
use soup::Soup;
use std::path::Path;

pub(crate) use groups::{ELECTRODE, UNGROUPED};

/// Maximum file size, bytes: some tens of millions of cells, far more than a forward model can use.
const LARGEST_FILE: u64 = 256 << 20;

/// The mesh in a file; `unit_m` is the length of the file's unit, m.
///
/// A Gmsh `.msh` file contains physical groups: electrodes (`electrode_<n>`) and regions. An STL, OBJ or PLY file is a
/// surface without electrodes; duplicate vertices are merged and triangles are oriented outwards.
///
/// # Errors
/// A file that cannot be read, is not of the format of its name, or contains no usable mesh.
pub fn load(path: &Path, unit_m: f64) -> Result<Mesh, MeshError> {
    Ok(load_counting(&path.into(), unit_m)?.0)
}

/// The triangles of an STL, OBJ or PLY file as they are, m: shells that meet or overlap, with any orientation.
///
/// # Errors
/// A file that cannot be read, is of another format, or has no triangles.
pub fn load_triangles(path: &Path, unit_m: f64) -> Result<Vec<[Point3; 3]>, MeshError> {
    let in_file = |Problem(message)| MeshError::File { path: path.to_path_buf(), message };
    check_unit(unit_m).map_err(in_file)?;
    let format = Format::of(path).map_err(in_file)?;
    let contents =
        read_at_most(path, LARGEST_FILE).map_err(|source| MeshError::Io { path: path.to_path_buf(), source })?;
    let soup = format.soup(&contents).and_then(|soup| soup.check().map(|()| soup)).map_err(in_file)?;
    let corners = |triangle: &[usize; 3]| triangle.map(|corner| vector::scale(soup.points[corner], unit_m));
    Ok(soup.triangles.iter().map(corners).collect())
}

/// The number of cells of a Gmsh file with another node order than Dermis uses ([`load`] reorders them): tetrahedra of
/// negative volume, triangles of opposite orientation. 0 for other formats, where the order is arbitrary.
///
/// # Errors
/// As [`load`].
pub fn reordered_cells(file: &MeshFile, unit_m: f64) -> Result<usize, MeshError> {
    Ok(load_counting(file, unit_m)?.1)
}

/// As [`load`], of the file of a body.
///
/// # Errors
/// As [`load`].
pub fn load_body(file: &MeshFile, unit_m: f64) -> Result<Mesh, MeshError> {
    Ok(load_counting(file, unit_m)?.0)
}

/// [`load`], with the number of cells that were reordered.
fn load_counting(file: &MeshFile, unit_m: f64) -> Result<(Mesh, usize), MeshError> {
    let path = &file.path;
    let in_file = |Problem(message)| MeshError::File { path: path.clone(), message };
    let format = Format::of(path).map_err(in_file)?;
    check_unit(unit_m).map_err(in_file)?;
    let contents = file.read(LARGEST_FILE).map_err(|source| MeshError::Io { path: path.clone(), source })?;
    format.parse(&contents, unit_m).map_err(in_file)
}

/// The mesh of a design whose body is a mesh file.
///
/// A file with its own electrodes (physical groups of a `.msh`) is used without changes. On any other surface the
/// electrodes of the design are placed, and the surface is remeshed to the design's sizes: see [`MeshOptions`].
///
/// # Errors
/// As [`load`]; a body that is not a file; another number of electrodes than the design's; an electrode that is off the
/// surface; a mesh that [`validate`](Mesh::validate) refuses.
///
/// [`MeshOptions`]: crate::design::MeshOptions
pub fn from_design(design: &SkinDesign) -> Result<Mesh, MeshError> {
    let Body::Mesh { file, unit_m } = &design.body else {
        return Err(MeshError::Generate("the body of the design is no mesh file".into()));
    };
    let mesh = load_body(file, *unit_m)?;
    let wrong = |message| MeshError::File { path: file.path.clone(), message };
    check_size(&mesh).map_err(wrong)?;
    let in_file = |error| match error {
        MeshError::Invalid(message) | MeshError::Generate(message) => wrong(message),
        other => other,
    };
    let mut grouped = design.electrodes.iter().map(|electrode| electrode.shape == ElectrodeShape::Group);
    if grouped.any(|is_group| is_group) {
        if mesh.electrodes.len() != design.electrodes.len() {
            let message = format!(
                "the file has {} physical groups {ELECTRODE}0, {ELECTRODE}1, ..., but the design has {} electrodes",
                mesh.electrodes.len(),
                design.electrodes.len()
            );
            return Err(wrong(message));
        }
        mesh.validate().map_err(in_file)?;
        return Ok(mesh);
    }
    let mesh = place::electrodes(&mesh, &design.electrodes, design.mesh).map_err(in_file)?;
    mesh.validate().map_err(in_file)?;
    Ok(mesh)
}

/// Refuses a body that is larger than any skin: nodes far away would be meshed for minutes.
fn check_size(mesh: &Mesh) -> Result<(), String> {
    let used = (0..mesh.cell_count()).flat_map(|cell| mesh.cells.corners(cell)).map(|&node| mesh.nodes[node]);
    let [low_m, high_m] = bounding_box(used);
    for axis in 0..3 {
        let length_m = high_m[axis] - low_m[axis];
        if length_m > LARGEST_BODY_M {
            return Err(format!(
                "the body is {:.3} m long in {}, and a skin has at most {LARGEST_BODY_M} m: check `unit_m` and the nodes",
                length_m,
                ["x", "y", "z"][axis]
            ));
        }
    }
    Ok(())
}

/// The mesh file formats that can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Gmsh, versions 2.2 and 4.1, ASCII and binary.
    Msh,
    /// STL, ASCII and binary.
    Stl,
    /// Wavefront OBJ.
    Obj,
    /// PLY, ASCII and binary.
    Ply,
}

impl Format {
    fn of(path: &Path) -> Result<Self, Problem> {
        match ending(path).as_str() {
            "msh" => Ok(Format::Msh),
            "stl" => Ok(Format::Stl),
            "obj" => Ok(Format::Obj),
            "ply" => Ok(Format::Ply),
            other => Err(Problem(format!("a mesh file ends in .msh, .stl, .obj or .ply, not in `.{other}`"))),
        }
    }

    /// The mesh, and the number of reordered cells.
    fn parse(self, bytes: &[u8], unit_m: f64) -> Result<(Mesh, usize), Problem> {
        match self {
            Format::Msh => groups::mesh(&msh::read(bytes)?, unit_m),
            _ => Ok((self.soup(bytes)?.into_mesh(unit_m)?, 0)),
        }
    }

    fn soup(self, bytes: &[u8]) -> Result<Soup, Problem> {
        match self {
            Format::Msh => Err(Problem("a Gmsh file is no surface of triangles: give STL, OBJ or PLY".into())),
            Format::Stl => stl::read(bytes),
            Format::Obj => obj::read(bytes),
            Format::Ply => ply::read(bytes),
        }
    }
}

/// The mesh in the bytes of a file. As [`load`], with a known format and the file in memory.
///
/// # Errors
/// As [`load`].
pub fn parse(bytes: &[u8], format: Format, unit_m: f64) -> Result<Mesh, MeshError> {
    let wrong = |Problem(message)| MeshError::Invalid(message);
    check_unit(unit_m).map_err(wrong)?;
    Ok(format.parse(bytes, unit_m).map_err(wrong)?.0)
}

fn check_unit(unit_m: f64) -> Result<(), Problem> {
    if unit_m.is_finite() && unit_m > 0.0 {
        return Ok(());
    }
    Err(Problem(format!("the unit is {unit_m} m: it must be positive and finite; 0.001 for millimetres")))
}
