//! Meshes from files.

mod cursor;
mod groups;
mod msh;

use crate::mesh::{Mesh, MeshError};
use cursor::Problem;
use std::fs::File;
use std::io::Read;
use std::path::Path;

pub(crate) use groups::ELECTRODE;

/// Largest file that is read, bytes: some tens of millions of cells, far more than a forward model can use.
const LARGEST_FILE: u64 = 1 << 31;

/// The mesh in a file, with the electrodes and regions of its physical groups; `unit_m` is the length of the file's
/// unit, m.
///
/// # Errors
/// A file that cannot be read, is not of the format its name says, or describes no usable mesh.
pub fn load(path: &Path, unit_m: f64) -> Result<Mesh, MeshError> {
    let in_file = |Problem(message)| MeshError::File { path: path.to_path_buf(), message };
    check_unit(unit_m).map_err(in_file)?;
    let extension = extension(path);
    if extension != "msh" {
        return Err(in_file(Problem(format!("a mesh file ends in .msh, not in .{extension}"))));
    }
    let bytes = contents(path)?;
    parse_msh(&bytes, unit_m).map_err(in_file)
}

fn parse_msh(bytes: &[u8], unit_m: f64) -> Result<Mesh, Problem> {
    groups::mesh(&msh::read(bytes)?, unit_m)
}

fn extension(path: &Path) -> String {
    path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

fn check_unit(unit_m: f64) -> Result<(), Problem> {
    if unit_m.is_finite() && unit_m > 0.0 {
        return Ok(());
    }
    Err(Problem(format!("the unit is {unit_m} m: it must be positive and finite; 0.001 for millimetres")))
}

fn contents(path: &Path) -> Result<Vec<u8>, MeshError> {
    let io = |source| MeshError::Io { path: path.to_path_buf(), source };
    let mut bytes = Vec::new();
    // Reading one byte more than allowed tells a file of just that size from a larger or endless one.
    File::open(path).map_err(io)?.take(LARGEST_FILE + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > LARGEST_FILE {
        let message = format!("the file is larger than {} GiB", LARGEST_FILE >> 30);
        return Err(MeshError::File { path: path.to_path_buf(), message });
    }
    Ok(bytes)
}
