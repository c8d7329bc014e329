//! Several methods prepared for one skin, so that a pipeline can change the method between two frames.

use crate::method::{Method, MethodError, MethodOptions, Methods};
use crate::skin::Skin;
use std::sync::{Mutex, OnceLock, PoisonError};

/// A skin with the methods that a pipeline can change between.
pub struct MethodSet {
    skin: Skin,
    registry: Methods,
    methods: Vec<Prepared>,
    default_name: String,
    /// The name of the additional method.
    extra: Option<String>,
    /// Locked while a method is prepared.
    preparing: Mutex<()>,
}

/// A method that is prepared when it is first needed.
struct Prepared {
    name: String,
    method: OnceLock<Method>,
}

/// The one-step methods of every set.
const READY: [&str; 2] = ["noser", "laplace"];

impl std::fmt::Debug for MethodSet {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<&str> = self.names().collect();
        formatter.debug_struct("MethodSet").field("skin", &self.skin).field("names", &names).finish_non_exhaustive()
    }
}

impl MethodSet {
    /// The default method, the methods of other sources (the shipped networks), NOSER and Laplace, and the method `extra` if it
    /// is not one of these: another linear one, or the folder of a network. The default method and `extra` are prepared, the
    /// others when they are first needed, or by [`prepare`](Self::prepare).
    ///
    /// # Errors
    /// A method that cannot be prepared.
    pub fn new(methods: &Methods, skin: Skin, extra: Option<&str>) -> Result<Self, MethodError> {
        let known = methods.names(&skin)?;
        let default_name = known[0].clone();
        let is_own = |name: &str| name == Methods::REFINED || Methods::LINEAR.contains(&name);
        let is_ready = |name: &&String| **name == default_name || !is_own(name) || READY.contains(&name.as_str());
        let mut names: Vec<String> = known.iter().filter(is_ready).cloned().collect();
        let extra = extra
            .filter(|extra| !Methods::is_default(extra) && !names.iter().any(|name| name == extra))
            .map(str::to_string);
        names.extend(extra.clone());
        let methods_of = |name| Prepared { name, method: OnceLock::new() };
        let set = MethodSet {
            skin,
            registry: methods.clone(),
            methods: names.into_iter().map(methods_of).collect(),
            default_name,
            extra,
            preparing: Mutex::default(),
        };
        set.method("")?;
        set.extra.as_deref().map_or(Ok(()), |extra| set.method(extra).map(drop))?;
        Ok(set)
    }

    /// Prepares all methods, so that a later change of the method takes no time.
    ///
    /// # Errors
    /// A method that cannot be prepared; the others are.
    pub fn prepare(&self) -> Result<(), MethodError> {
        let prepared: Vec<_> = self.methods.iter().map(|one| self.prepared(one).map(drop)).collect();
        prepared.into_iter().collect()
    }

    fn prepared<'a>(&self, one: &'a Prepared) -> Result<&'a Method, MethodError> {
        if let Some(method) = one.method.get() {
            return Ok(method);
        }
        let _one_at_a_time = self.preparing.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(method) = one.method.get() {
            return Ok(method);
        }
        let method = self.registry.method(&self.skin, &one.name, &MethodOptions::default())?;
        Ok(one.method.get_or_init(|| method))
    }

    /// The skin.
    pub fn skin(&self) -> &Skin {
        &self.skin
    }

    /// The names of the methods.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.methods.iter().map(|one| one.name.as_str())
    }

    /// The additional method, if any.
    pub fn extra(&self) -> Option<&Method> {
        let name = self.extra.as_deref()?;
        self.methods.iter().find(|one| one.name == name)?.method.get()
    }

    /// The method with this name; the default one for an empty name or [`Methods::BEST`].
    ///
    /// # Errors
    /// An unknown name; the error lists the available ones. A method that cannot be prepared.
    pub fn method(&self, name: &str) -> Result<&Method, MethodError> {
        let name = if Methods::is_default(name) { &self.default_name } else { name };
        let one = self.methods.iter().find(|one| one.name == name).ok_or_else(|| MethodError::Unknown {
            name: name.into(),
            skin: self.skin.design().name.clone(),
            known: self.names().map(str::to_string).collect(),
        })?;
        self.prepared(one)
    }
}
