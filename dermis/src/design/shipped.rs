//! The shipped designs.

/// Their names.
pub(super) const NAMES: [&str; 3] = ["cylinder30", "skin16", "tank16"];

/// The text of a shipped design.
pub(super) fn text(name: &str) -> Option<&'static str> {
    match name {
        "cylinder30" => Some(include_str!("../../../data/designs/cylinder30.toml")),
        "skin16" => Some(include_str!("../../../data/designs/skin16.toml")),
        "tank16" => Some(include_str!("../../../data/designs/tank16.toml")),
        _ => None,
    }
}
