//! The models that come with the library, for the paper's skin.

/// Their names.
pub const NAMES: [&str; 2] = ["paper", "best"];

/// The card and the weights of a model by its name.
pub fn files(name: &str) -> Option<(&'static [u8], &'static [u8])> {
    match name {
        "paper" => Some((
            include_bytes!("../models/cylinder30/paper/card.json"),
            include_bytes!("../models/cylinder30/paper/weights.safetensors"),
        )),
        "best" => Some((
            include_bytes!("../models/cylinder30/best/card.json"),
            include_bytes!("../models/cylinder30/best/weights.safetensors"),
        )),
        _ => None,
    }
}
