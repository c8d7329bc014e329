//! Pictures of skins: laid out flat and in space, as SVG and PNG.
//!
//! A [`Drawing`] turns a design, its mesh and what was computed on it into a [`Scene`]; a [`View`] draws the scene.

pub mod chart;
pub mod colour;
mod drawing;
mod error;
mod field;
mod frame;
pub mod scene;
mod solid;
pub mod svg;
mod unrolled;

pub use drawing::Drawing;
pub use error::PlotError;
pub use scene::{Key, Scene};
pub use solid::Camera;
pub use svg::Picture;

use dermis::design::{Body, SkinDesign};
use dermis::mesh::Mesh;

/// From where a scene is looked at.
#[derive(Debug, Clone, PartialEq)]
pub enum View {
    /// Laid out flat.
    Unrolled,
    /// In space, from outside; from several sides, side by side.
    Solid(Vec<Camera>),
}

impl View {
    /// In space, from the sides that show the skin well.
    pub fn solid(design: &SkinDesign, mesh: &Mesh) -> Self {
        let camera = |azimuth: f64, elevation: f64| Camera {
            azimuth_rad: azimuth.to_radians(),
            elevation_rad: elevation.to_radians(),
        };
        let lies_flat = mesh.nodes.iter().all(|node| node[2] == mesh.nodes[0][2]);
        View::Solid(match design.body {
            // From both sides: all of the wall is seen.
            Body::Cylinder { .. } => vec![camera(20.0, 22.0), camera(200.0, 22.0)],
            Body::Mesh { .. } if !lies_flat => vec![camera(-55.0, 25.0), camera(125.0, 25.0)],
            // With x to the right and y to the back.
            _ => vec![camera(-75.0, 42.0)],
        })
    }

    /// The scene, drawn.
    ///
    /// # Errors
    /// A flat layout of a body that is known only by its mesh.
    pub fn draw(&self, scene: &Scene, design: &SkinDesign) -> Result<Picture, PlotError> {
        match self {
            View::Unrolled => unrolled::draw(scene, design),
            View::Solid(cameras) => Ok(solid::draw(scene, cameras)),
        }
    }
}

#[cfg(test)]
mod tests;
