//! The shipped designs.

/// Their names.
pub(super) const NAMES: [&str; 3] = ["cylinder30", "skin16", "tank16"];

/// The text of a shipped design.
pub(super) fn text(name: &str) -> Option<&'static str> {
    match name {
        "cylinder30" => Some(include_str!("../../designs/cylinder30.toml")),
        "skin16" => Some(include_str!("../../designs/skin16.toml")),
        "tank16" => Some(include_str!("../../designs/tank16.toml")),
        _ => None,
    }
}

/// The body of a design from a mesh file: a sleeve around a forearm, an STL file in mm.
pub const FOREARM_STL: &[u8] = include_bytes!("../../designs/forearm.stl");
