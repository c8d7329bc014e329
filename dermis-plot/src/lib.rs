//! Pictures of skins, unrolled and in 3D, and charts; as SVG and PNG.
//!
//! A [`Drawing`] converts a design, its mesh and computed fields to a [`Scene`]; a [`View`] draws the scene as a
//! [`Picture`].
//! [`Picture`].
//!
//! ```
//! use dermis::design::{Body, SkinDesign};
//! use dermis::mesh::Mesh;
//! use dermis_plot::{Drawing, View};
//!
//! let design = SkinDesign::shipped("cylinder30").expect("a shipped design");
//! let mesh = Mesh::generate(&design)?;
//! let scene = Drawing::new(&design, &mesh).electrodes().titled("Electrodes", "");
//! let svg = View::Solid.draw(&scene, &design)?.to_svg();
//! // Enough views to show the number of every electrode.
//! assert!((0..30).all(|number| svg.contains(&format!(">{number}</text>"))));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! PNG files need the feature `png`, which is on by default.

#![warn(unreachable_pub)]

mod camera;
pub mod chart;
mod colour;
mod drawing;
mod error;
mod errors;
mod field;
mod frame;
mod projection;
pub mod report;
mod scene;
mod solid;
mod svg;
mod unrolled;

pub use camera::Camera;
pub use colour::{Colour, Scale};
pub use drawing::Drawing;
pub use error::PlotError;
pub use errors::PressError;
pub use scene::{Key, Scene};
pub use svg::Picture;

use dermis::design::{Body, SkinDesign};
use dermis::skin::Skin;

/// View of a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum View {
    /// Unrolled.
    Unrolled,
    /// Unrolled; a body without a flat layout projected on the plane of its two longest axes.
    Flat,
    /// In 3D, with enough views to show all marks: [`Camera::for_scene`].
    Solid,
    /// In 3D with given cameras, side by side.
    From(Vec<Camera>),
}

impl View {
    /// The usual view of a scene: unrolled, where the body of its design has a flat layout or is flat.
    pub fn of(scene: &Scene, design: &SkinDesign) -> Self {
        if matches!(design.body, Body::Mesh { .. }) && !scene.is_flat() { View::Solid } else { View::Unrolled }
    }

    /// Draws the scene.
    ///
    /// # Errors
    /// A flat layout of a body from a mesh file that is not flat.
    pub fn draw(&self, scene: &Scene, design: &SkinDesign) -> Result<Picture, PlotError> {
        match self {
            View::Unrolled => unrolled::draw(scene, design),
            View::Flat => Ok(unrolled::draw_flat(scene, design)),
            View::Solid => Ok(solid::draw(scene, &Camera::for_scene(scene))),
            View::From(cameras) => Ok(solid::draw(scene, cameras)),
        }
    }
}

/// A value for each pixel of a skin, in its usual view.
///
/// ```
/// use dermis::skin::Skin;
/// use dermis_plot::{Key, Scale, skin_map};
///
/// let skin = Skin::load("tank16")?;
/// let areas = &skin.pixels().areas;
/// let key = Key { scale: Scale::sequential(areas.iter().copied()), label: "area (m2)".into() };
/// assert!(skin_map(&skin, areas, key, "Pixels", "")?.to_svg().contains(">Pixels</text>"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// None for a valid design.
pub fn skin_map(
    skin: &Skin,
    values: &[f64],
    key: Key,
    title: impl Into<String>,
    subtitle: impl Into<String>,
) -> Result<Picture, PlotError> {
    let scene = Drawing::new(skin.design(), skin.mesh()).field(skin.pixels(), values, key).titled(title, subtitle);
    View::of(&scene, skin.design()).draw(&scene, skin.design())
}

#[cfg(test)]
mod tests;
