//! Binary STL.

use crate::geom::Point3;
use crate::geom::vector::{cross, normalize, sub};
use crate::mesh::Mesh;
use std::io::{self, Write};

pub(super) fn write(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let faces = mesh.outer_faces().into_iter();
    write_stl(&faces.map(|(face, _)| face.map(|node| mesh.nodes[node])).collect::<Vec<_>>(), "dermis, in m", out)
}

/// Writes triangles as a binary STL file, in the unit of their corners, which the title of at most 80 bytes should name.
///
/// # Errors
/// Those of the writer; more triangles than the format can count.
///
/// # Panics
/// If the title is longer.
pub fn write_stl(triangles: &[[Point3; 3]], title: &str, out: &mut dyn Write) -> io::Result<()> {
    let count = u32::try_from(triangles.len()).map_err(|_| io::Error::other("too many triangles for an STL file"))?;
    let mut header = [b' '; 80];
    // A binary file must not start with "solid".
    header[..title.len()].copy_from_slice(title.as_bytes());
    out.write_all(&header)?;
    out.write_all(&count.to_le_bytes())?;
    for &[a, b, c] in triangles {
        let normal = normalize(cross(sub(b, a), sub(c, a)));
        for coordinate in [normal, a, b, c].into_iter().flatten() {
            out.write_all(&(coordinate as f32).to_le_bytes())?;
        }
        out.write_all(&[0; 2])?;
    }
    Ok(())
}
