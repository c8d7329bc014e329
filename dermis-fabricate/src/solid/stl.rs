//! Binary STL: 80 bytes, the number of triangles, and for each its normal, its corners and two bytes.

use crate::solid::Solid;
use dermis::geom::vector::{cross, normalize, sub};

/// The file. The header must not begin with `solid`, by which programs know text.
pub(crate) fn bytes(solid: &Solid) -> Vec<u8> {
    let mut bytes = b"binary STL, mm".to_vec();
    bytes.resize(80, 0);
    bytes.extend((solid.triangles.len() as u32).to_le_bytes());
    for triangle in 0..solid.triangles.len() {
        let [a, b, c] = solid.triangle_mm(triangle);
        let normal = normalize(cross(sub(b, a), sub(c, a))).map(|value| value as f32);
        let corners = solid.triangles[triangle].map(|corner| solid.corners_mm[corner as usize]);
        for value in normal.into_iter().chain(corners.into_iter().flatten()) {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}
