//! The shipped networks and those of a folder, as methods of the registry.

use crate::model::Model;
use crate::shipped;
use dermis::method::{Method, MethodError, MethodOptions, MethodSource, Methods, is_path};
use dermis::skin::Skin;
use dermis_calibrate::Calibrations;
use std::path::Path;
use std::sync::Arc;

/// The registry of all methods: the linear ones, the shipped networks, and networks and calibrations in folders.
///
/// ```
/// use dermis::method::MethodOptions;
/// use dermis::skin::Skin;
///
/// let skin = Skin::load("cylinder30")?;
/// let methods = dermis_learn::methods();
/// assert_eq!(methods.default_name(&skin)?, "refined"); // the contacts of `spots`, refined
/// let method = methods.method(&skin, "paper", &MethodOptions::default())?;
/// assert_eq!(method.label(), "shipped network `paper`");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn methods() -> Methods {
    let uncalibrated = || Methods::linear().with(Networks);
    uncalibrated().with(Calibrations::of(uncalibrated()))
}

/// The shipped networks, and networks in folders.
struct Networks;

impl MethodSource for Networks {
    fn names(&self, skin: &Skin) -> Result<Vec<String>, MethodError> {
        shipped::NAMES
            .into_iter()
            .filter_map(|name| match Model::is_shipped_for(name, skin) {
                Ok(fits) => fits.then(|| Ok(name.to_string())),
                Err(error) => Some(Err(error.into())),
            })
            .collect()
    }

    fn method(&self, skin: &Skin, name: &str, options: &MethodOptions) -> Result<Option<Method>, MethodError> {
        let label = match (shipped::files(name).is_some(), is_path(name)) {
            (true, _) => format!("shipped network `{name}`"),
            (false, true) if Model::is_folder(Path::new(name)) => format!("network in {name}"),
            (false, _) => return Ok(None),
        };
        options.check_not_linear(name)?;
        let model = Model::named(name, skin)?;
        // Without some channels it is still the same network.
        let card = serde_json::to_string_pretty(model.card()).expect("a card is JSON");
        Ok(Some(Method::new(name, label, Arc::new(model.without(&options.excluded)?)).with_card(card)))
    }
}

impl From<crate::LearnError> for MethodError {
    fn from(error: crate::LearnError) -> Self {
        MethodError::Source(Box::new(error))
    }
}

impl Model {
    /// A model by the name of a shipped one, or by the path of its folder.
    ///
    /// # Errors
    /// As [`load`](Self::load); a shipped model of another skin.
    pub fn named(name: &str, skin: &Skin) -> Result<Self, crate::LearnError> {
        match shipped::files(name) {
            Some((card, weights)) => {
                Self::parse(Path::new(name), card, weights, skin.forward(), Arc::clone(skin.pixels()))
            }
            None => Self::load(Path::new(name), skin.forward(), Arc::clone(skin.pixels())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_come_first_and_a_name_is_no_folder() {
        let skin = Skin::load("cylinder30").unwrap();
        let names = methods().names(&skin).unwrap();
        assert_eq!(names[..5], ["refined", "spots", "paper", "noser", "laplace"]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("paper");
        let shipped = Model::named("spots", &skin).unwrap();
        shipped.save(&path, crate::Precision::Half).unwrap();
        let path = path.to_str().unwrap();
        let own = methods().method(&skin, path, &MethodOptions::default()).unwrap();
        assert_eq!((own.name(), own.label()), (path, format!("network in {path}").as_str()));
        assert!(own.card().unwrap().contains("\"spots\""), "the card is the folder's");
        let alpha = MethodOptions { alpha: dermis::reconstruct::Alpha::Given(0.1), ..MethodOptions::default() };
        let error = methods().method(&skin, "spots", &alpha).unwrap_err().to_string();
        assert!(error.contains("spots has no regularization parameter"), "{error}");
    }

    #[test]
    fn a_shipped_network_of_another_skin_is_refused_by_name() {
        let skin = Skin::load("tank16").unwrap();
        assert_eq!(methods().default_name(&skin).unwrap(), "refined");
        let error = methods().method(&skin, "spots", &MethodOptions::default()).unwrap_err().to_string();
        assert!(error.contains("trained for the skin `cylinder30`"), "{error}");
    }
}
