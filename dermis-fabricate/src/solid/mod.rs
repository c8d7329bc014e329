//! The base: a watertight solid below the coat, with electrode bores, wire channels and, where asked for, a flange.

mod base;
mod channel;
mod clean;
mod cutter;
mod shell;
mod threemf;

pub use base::{base, designed_genus};
pub(crate) use channel::most_wires;

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;
use dermis::geom::Point3;
use dermis::mesh::export::write_stl;
use manifold_rust::manifold::Manifold;

/// A closed surface of triangles, counter-clockwise as seen from outside. Lengths in mm, in the precision of STL files.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Places of the corners, mm; no two are equal.
    pub(crate) corners_mm: Vec<[f32; 3]>,
    /// Triangles, as indices of corners.
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// Corners that are closer to each other or to an edge are removed, mm: a fiftieth of what a printer resolves, and far more
/// than `f32` rounds, so that no two corners become one and no normal is lost in rounding.
const FINEST_MM: f64 = 1e-3;

impl Solid {
    fn of(manifold: &Manifold) -> Self {
        let mesh = manifold.simplify(FINEST_MM).get_mesh_gl64(-1);
        let stride = mesh.num_prop as usize;
        let corners: Vec<Point3> =
            mesh.vert_properties.chunks(stride).map(|corner| [corner[0], corner[1], corner[2]]).collect();
        let mut triangles: Vec<[u32; 3]> =
            mesh.tri_verts.chunks(3).map(|corners| [corners[0], corners[1], corners[2]].map(|k| k as u32)).collect();
        clean::without_short_edges(&corners, &mut triangles, FINEST_MM);
        Solid::of_used(&corners, triangles)
    }

    /// The solid with the corners that its triangles use, in their order.
    fn of_used(corners: &[Point3], mut triangles: Vec<[u32; 3]>) -> Self {
        let mut number = vec![u32::MAX; corners.len()];
        let mut corners_mm = Vec::with_capacity(corners.len());
        for corner in triangles.iter_mut().flatten() {
            let place = *corner as usize;
            if number[place] == u32::MAX {
                number[place] = corners_mm.len() as u32;
                corners_mm.push(corners[place].map(|value| value as f32));
            }
            *corner = number[place];
        }
        Solid { corners_mm, triangles }
    }

    /// Corners of a triangle, mm.
    pub(crate) fn triangle_mm(&self, triangle: usize) -> [Point3; 3] {
        self.triangles[triangle].map(|corner| self.corners_mm[corner as usize].map(f64::from))
    }

    /// Volume, mm3.
    pub(crate) fn volume_mm3(&self) -> f64 {
        dermis::geom::vector::volume((0..self.triangles.len()).map(|triangle| self.triangle_mm(triangle)))
    }

    /// Genus of a closed surface of one part, by Euler's formula.
    pub(crate) fn genus(&self) -> i64 {
        let euler = self.corners_mm.len() as i64 - self.triangles.len() as i64 / 2;
        1 - euler / 2
    }

    /// Whether every edge has one triangle on each side.
    pub(crate) fn is_closed(&self) -> bool {
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

fn stl(solid: &Solid) -> Result<Vec<u8>, FabricateError> {
    let triangles: Vec<[Point3; 3]> = (0..solid.triangles.len()).map(|triangle| solid.triangle_mm(triangle)).collect();
    let mut bytes = Vec::new();
    write_stl(&triangles, "binary STL, mm", &mut bytes).map_err(|error| FabricateError::Internal(error.to_string()))?;
    Ok(bytes)
}

/// The base as STL and 3MF.
///
/// # Errors
/// A base that cannot be made as designed.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    let solid = fabrication.base()?;
    let name = &fabrication.design.name;
    Ok(vec![
        OutputFile::new("base.stl", "base to print: binary STL, mm", stl(solid)?),
        OutputFile::new("base.3mf", "base to print: 3MF with its unit", threemf::bytes(solid, name)?),
    ])
}

#[cfg(test)]
mod tests;
