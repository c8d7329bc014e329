//! The shipped models: `paper` and `spots` for the paper's skin, `shapes` for `skin16`.

/// Their names, the preferred ones first.
pub(crate) const NAMES: [&str; 3] = ["spots", "paper", "shapes"];

/// The card and the weights of a model. Statics: a constant would be copied into every crate that [`files`] is inlined into.
type Files = (&'static [u8], &'static [u8]);

static PAPER: Files = (
    include_bytes!("../models/cylinder30/paper/card.json"),
    include_bytes!("../models/cylinder30/paper/weights.safetensors"),
);
static SPOTS: Files = (
    include_bytes!("../models/cylinder30/spots/card.json"),
    include_bytes!("../models/cylinder30/spots/weights.safetensors"),
);
static SHAPES: Files = (
    include_bytes!("../models/skin16/shapes/card.json"),
    include_bytes!("../models/skin16/shapes/weights.safetensors"),
);

/// The card and the weights of a model by its name.
pub fn files(name: &str) -> Option<(&'static [u8], &'static [u8])> {
    match name {
        "paper" => Some(PAPER),
        "spots" => Some(SPOTS),
        "shapes" => Some(SHAPES),
        _ => None,
    }
}
