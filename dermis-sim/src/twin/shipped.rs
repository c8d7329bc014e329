//! Shipped twins.

/// Their names.
pub(super) const NAMES: [&str; 5] = ["ideal", "lab", "lab-b", "lab-c", "harsh"];

/// The text of a shipped twin.
pub(super) fn text(name: &str) -> Option<&'static str> {
    match name {
        "ideal" => Some(include_str!("../../twins/ideal.toml")),
        "lab" => Some(include_str!("../../twins/lab.toml")),
        "lab-b" => Some(include_str!("../../twins/lab-b.toml")),
        "lab-c" => Some(include_str!("../../twins/lab-c.toml")),
        "harsh" => Some(include_str!("../../twins/harsh.toml")),
        _ => None,
    }
}
