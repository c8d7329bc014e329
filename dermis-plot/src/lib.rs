//! Pictures of skins: laid out flat and in space, as SVG and PNG.
//!
//! A [`Drawing`] turns a design, its mesh and what was computed on it into a [`Scene`]; a [`View`] draws the scene.

mod camera;
pub mod chart;
pub mod colour;
mod drawing;
mod error;
mod field;
mod frame;
mod projection;
pub mod scene;
mod solid;
pub mod svg;
mod unrolled;

pub use camera::Camera;
pub use drawing::Drawing;
pub use error::PlotError;
pub use scene::{Key, Scene};
pub use svg::Picture;

use dermis::design::SkinDesign;

/// How a scene is seen.
#[derive(Debug, Clone, PartialEq)]
pub enum View {
    /// Laid out flat.
    Unrolled,
    /// In space, from as many sides as it takes to see all that is marked: [`Camera::for_scene`].
    Solid,
    /// In space, from given sides, side by side.
    From(Vec<Camera>),
}

impl View {
    /// Draws the scene.
    ///
    /// # Errors
    /// A flat layout of a body that is known only by its mesh.
    pub fn draw(&self, scene: &Scene, design: &SkinDesign) -> Result<Picture, PlotError> {
        match self {
            View::Unrolled => unrolled::draw(scene, design),
            View::Solid => Ok(solid::draw(scene, &Camera::for_scene(scene))),
            View::From(cameras) => Ok(solid::draw(scene, cameras)),
        }
    }
}

#[cfg(test)]
mod tests;
