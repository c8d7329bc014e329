//! Binary STL.

use super::outside;
use crate::geom::vector::{cross, normalize, sub};
use crate::mesh::Mesh;
use std::io::{self, Write};

pub(super) fn write(mesh: &Mesh, out: &mut dyn Write) -> io::Result<()> {
    let triangles = outside(mesh);
    let count = u32::try_from(triangles.len()).map_err(|_| io::Error::other("too many triangles for an STL file"))?;
    let mut header = [b' '; 80];
    // A binary file must not start with "solid".
    header[..12].copy_from_slice(b"dermis, in m");
    out.write_all(&header)?;
    out.write_all(&count.to_le_bytes())?;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|node| mesh.nodes[node]);
        let normal = normalize(cross(sub(b, a), sub(c, a)));
        for coordinate in [normal, a, b, c].into_iter().flatten() {
            out.write_all(&(coordinate as f32).to_le_bytes())?;
        }
        out.write_all(&[0; 2])?;
    }
    Ok(())
}
