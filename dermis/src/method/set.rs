//! Several methods prepared for one skin, so that a pipeline can change the method between two frames.

use crate::method::{Method, MethodError, MethodOptions, Methods};
use crate::skin::Skin;

/// A skin with the methods that a pipeline can change between.
#[derive(Debug)]
pub struct MethodSet {
    skin: Skin,
    methods: Vec<Method>,
    default_name: String,
    /// The name of the additional method.
    extra: Option<String>,
}

/// The one-step methods that are always prepared.
const READY: [&str; 2] = ["noser", "laplace"];

impl MethodSet {
    /// Prepares the default method, the methods of other sources (the shipped networks), NOSER and Laplace, and the method
    /// `extra` if it is not one of these: another linear one, or the folder of a network.
    ///
    /// # Errors
    /// A method that cannot be prepared.
    pub fn new(methods: &Methods, skin: Skin, extra: Option<&str>) -> Result<Self, MethodError> {
        let known = methods.names(&skin)?;
        let default_name = known[0].clone();
        let is_own = |name: &str| name == Methods::REFINED || Methods::LINEAR.contains(&name);
        let is_ready = |name: &&str| *name == default_name || !is_own(name) || READY.contains(name);
        let mut names: Vec<&str> = known.iter().map(String::as_str).filter(is_ready).collect();
        let extra = extra.filter(|extra| !extra.is_empty() && !names.contains(extra));
        names.extend(extra);
        let prepared = names.iter().map(|name| methods.method(&skin, name, &MethodOptions::default()));
        let methods = prepared.collect::<Result<Vec<Method>, MethodError>>()?;
        let extra = extra.map(str::to_string);
        Ok(MethodSet { skin, methods, default_name, extra })
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        &self.skin
    }

    /// The names of the methods.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.methods.iter().map(Method::name)
    }

    /// The additional method, if any.
    pub fn extra(&self) -> Option<&Method> {
        let name = self.extra.as_deref()?;
        self.methods.iter().find(|method| method.name() == name)
    }

    /// The method with this name; the default one for an empty name.
    ///
    /// # Errors
    /// An unknown name; the error lists the available ones.
    pub fn method(&self, name: &str) -> Result<&Method, MethodError> {
        let name = if name.is_empty() { &self.default_name } else { name };
        self.methods.iter().find(|method| method.name() == name).ok_or_else(|| MethodError::Unknown {
            name: name.into(),
            skin: self.skin.design().name.clone(),
            known: self.names().map(str::to_string).collect(),
        })
    }
}
