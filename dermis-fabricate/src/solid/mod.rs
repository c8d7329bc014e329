//! The base: a watertight solid below the coat, with electrode bores, wire channels and, where asked for, a flange.

mod base;
mod channel;
mod cutter;
mod shell;
mod stl;
mod threemf;

pub use base::{base, designed_genus};

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;
use dermis::geom::Point3;
use manifold_rust::manifold::Manifold;

/// A closed surface of triangles, counter-clockwise as seen from outside. Lengths in mm, in the precision of STL files.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Places of the corners, mm; no two are equal.
    pub corners_mm: Vec<[f32; 3]>,
    /// Triangles, as indices of corners.
    pub triangles: Vec<[u32; 3]>,
}

/// Edges shorter than this are removed, mm: a tenth of what a printer resolves, and longer than the rounding of `f32` to
/// half a metre, so that no two corners become one.
const SHORTEST_EDGE_MM: f64 = 1e-4;

impl Solid {
    fn of(manifold: &Manifold) -> Self {
        let mesh = manifold.simplify(SHORTEST_EDGE_MM).get_mesh_gl(-1);
        let stride = mesh.num_prop as usize;
        let corners_mm = mesh.vert_properties.chunks(stride).map(|corner| [corner[0], corner[1], corner[2]]).collect();
        let triangles = mesh.tri_verts.chunks(3).map(|corners| [corners[0], corners[1], corners[2]]).collect();
        Solid { corners_mm, triangles }
    }

    /// Corners of a triangle, mm.
    pub fn triangle_mm(&self, triangle: usize) -> [Point3; 3] {
        self.triangles[triangle].map(|corner| self.corners_mm[corner as usize].map(f64::from))
    }

    /// Volume, mm3.
    pub fn volume_mm3(&self) -> f64 {
        use dermis::geom::vector::{cross, dot};
        let of = |triangle: usize| {
            let [a, b, c] = self.triangle_mm(triangle);
            dot(a, cross(b, c)) / 6.0
        };
        (0..self.triangles.len()).map(of).sum()
    }

    /// Genus of a closed surface of one part, by Euler's formula.
    pub fn genus(&self) -> i64 {
        let euler = self.corners_mm.len() as i64 - self.triangles.len() as i64 / 2;
        1 - euler / 2
    }

    /// Whether every edge has one triangle on each side.
    pub fn is_closed(&self) -> bool {
        let mut edges = std::collections::HashSet::new();
        for &[a, b, c] in &self.triangles {
            for edge in [[a, b], [b, c], [c, a]] {
                if !edges.remove(&[edge[1], edge[0]]) && !edges.insert(edge) {
                    return false;
                }
            }
        }
        edges.is_empty()
    }
}

/// The base as STL and 3MF.
///
/// # Errors
/// A base that cannot be made as designed.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    let solid = base(fabrication)?;
    let name = &fabrication.design.name;
    Ok(vec![
        OutputFile::new("base.stl", "base to print: binary STL, mm", stl::bytes(&solid)),
        OutputFile::new("base.3mf", "base to print: 3MF with its unit", threemf::bytes(&solid, name)?),
    ])
}

#[cfg(test)]
mod tests;
