//! All that a workshop needs to build a skin, from its design: the printed base, cut patterns of fabric and foam, a drill
//! template, tables for wiring and first tests, robot descriptions.
//!
//! A [`Fabrication`] is what is to be made. Each module of outputs gives [files](OutputFile) of it; [`write_folder`]
//! writes them all, or nothing.

#![warn(unreachable_pub)]

mod body;
pub mod electrical;
mod error;
mod folder;
mod grooves;
pub mod guide;
mod model;
mod notes;
pub mod outline;
mod patches;
pub mod robot;
pub mod sheet;
pub mod solid;

pub use body::BodyMesh;
pub use error::FabricateError;
pub use folder::{Manifest, ManifestEntry, OutputFile, check_free, write_folder};
pub use model::{Bore, FabricatedElectrode, Fabrication};
pub use notes::notes;
pub use patches::Patch;

/// A kind of outputs: what is shown while they are made, and the function that makes them.
pub type Part = (&'static str, fn(&Fabrication) -> Result<Vec<OutputFile>, FabricateError>);

/// Every kind of outputs, in the order of the manifest.
pub const PARTS: [Part; 5] = [
    ("base", solid::files),
    ("cut patterns", sheet::files),
    ("tables", electrical::files),
    ("robot description", robot::files),
    ("guide", guide::files),
];
