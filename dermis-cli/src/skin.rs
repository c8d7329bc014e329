//! The skin of a command, and conductivity maps for it.

use crate::console::{Progress, warn};
use crate::failure::{Failure, Outcome};
use clap::ValueEnum;
use dermis::frame::read_conductivities;
use dermis::geom::PlaceLimits;
use dermis::skin::Skin;
use std::path::Path;

/// Elements of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Per {
    /// Each pixel of the design's image.
    Pixel,
    /// Each cell of the mesh.
    Cell,
}

/// Prepares the skin of a design, by name or by path.
pub fn load(design: &str) -> Outcome<Skin> {
    let _waiting = Progress::waiting("preparing the skin");
    Ok(Skin::load(design)?)
}

/// Warns of a protocol that cannot tell places apart.
pub fn warn_if_ambiguous(skin: &Skin) -> Outcome {
    if let Some(found) = skin.ambiguity()? {
        warn(&format!("{}: {}; {}", skin.design().name, found.evidence, found.fix));
    }
    Ok(())
}

/// The valid positions of touches on a skin.
pub fn place_limits(skin: &Skin) -> PlaceLimits {
    skin.mesh().place_limits(skin.design().body.surface())
}

/// Conductivity maps from a file, or the untouched skin without one.
pub fn conductivities(skin: &Skin, path: Option<&Path>) -> Outcome<Vec<Vec<f64>>> {
    match path {
        Some(path) => Ok(read_conductivities(path, skin.mesh().cell_count())?),
        None => Ok(vec![skin.forward().rest_conductivity().to_vec()]),
    }
}

/// The only conductivity map of a file, or the untouched skin without one.
pub fn conductivity(skin: &Skin, path: Option<&Path>) -> Outcome<Vec<f64>> {
    let mut maps = conductivities(skin, path)?;
    if maps.len() > 1 {
        let message = format!("{} maps of conductivity, but a Jacobian belongs to one", maps.len());
        return Err(Failure::given(message, Some("give a file with one row")));
    }
    Ok(maps.remove(0))
}
