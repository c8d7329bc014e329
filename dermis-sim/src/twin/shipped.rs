//! Shipped twins.

/// Their names.
pub(super) const NAMES: [&str; 3] = ["ideal", "lab", "harsh"];

/// The text of a shipped twin.
pub(super) fn text(name: &str) -> Option<&'static str> {
    match name {
        "ideal" => Some(include_str!("../../../data/twins/ideal.toml")),
        "lab" => Some(include_str!("../../../data/twins/lab.toml")),
        "harsh" => Some(include_str!("../../../data/twins/harsh.toml")),
        _ => None,
    }
}
