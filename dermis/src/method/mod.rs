//! Reconstruction methods by name: one registry for every command, the live pipeline and programs.
//!
//! ```
//! use dermis::method::{MethodOptions, Methods};
//! use dermis::skin::Skin;
//!
//! let skin = Skin::load("tank16")?;
//! let method = Methods::linear().method(&skin, "laplace", &MethodOptions::default())?;
//! assert_eq!((method.name(), method.label()), ("laplace", "one-step Laplace"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A crate with more methods, such as `dermis-learn`, adds them with [`Methods::with`].

mod linear;
mod options;
mod set;

pub use options::MethodOptions;
pub use set::MethodSet;

use crate::contact::Contact;
use crate::detect::Detector;
use crate::estimate::noise::{ChannelNoise, NoiseSource};
use crate::estimate::reciprocal_pairs::ReciprocalPairs;
use crate::frame::{Differences, Frame};
use crate::image::Image;
use crate::protocol::Protocol;
use crate::reconstruct::{
    AlphaRule, OneStep, OneStepOptions, Reconstruct, ReconstructError, Refined, WithoutChannels, image_noise_of,
};
use crate::refine::{RefineOptions, Refiner};
use crate::skin::Skin;
use std::fmt;
use std::sync::Arc;
use thiserror::Error;

/// A method that cannot be prepared.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MethodError {
    /// No method of that name for the skin.
    #[error("there is no method `{name}` for the skin `{skin}`: give one of {}, or the folder of a network or a calibration, as in ./{name}", known.join(", "))]
    Unknown {
        /// The name.
        name: String,
        /// The design's name.
        skin: String,
        /// The available names.
        known: Vec<String>,
    },
    /// An option that the method does not have.
    #[error("{method} {message}")]
    Option {
        /// The method's name.
        method: String,
        /// What is wrong, and the fix.
        message: String,
    },
    /// A reconstruction that cannot be set up.
    #[error(transparent)]
    Dermis(#[from] crate::Error),
    /// An error of a [source](MethodSource) of methods.
    #[error(transparent)]
    Source(Box<dyn std::error::Error + Send + Sync>),
}

impl From<ReconstructError> for MethodError {
    fn from(error: ReconstructError) -> Self {
        MethodError::Dermis(error.into())
    }
}

impl MethodError {
    fn option(method: &str, message: impl Into<String>) -> Self {
        MethodError::Option { method: method.into(), message: message.into() }
    }
}

/// The end of the label of a method with refined contacts.
const AND_REFINED: &str = ", refined";

/// A reconstruction method prepared for a skin, with the detection options for its images.
#[derive(Clone)]
pub struct Method {
    name: String,
    label: String,
    reconstruct: Arc<dyn Reconstruct>,
    alpha: Option<f64>,
    alpha_rule: Option<AlphaRule>,
    card: Option<String>,
    /// The parameters of a one-step method, to prepare it again without masked channels.
    one_step: Option<OneStepOptions>,
}

impl fmt::Debug for Method {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Method").field("name", &self.name).field("label", &self.label).finish_non_exhaustive()
    }
}

impl Method {
    /// A method with a name. `label` describes it in tables and plots.
    pub fn new(name: impl Into<String>, label: impl Into<String>, reconstruct: Arc<dyn Reconstruct>) -> Self {
        Method {
            name: name.into(),
            label: label.into(),
            reconstruct,
            alpha: None,
            alpha_rule: None,
            card: None,
            one_step: None,
        }
    }

    /// The same method with its regularization parameter, to be shown with its label.
    #[must_use]
    pub(crate) fn with_alpha(self, alpha: f64) -> Self {
        Method { alpha: Some(alpha), ..self }
    }

    /// The same method with the card of a network, or what identifies a calibration, JSON, which is stored in recordings.
    #[must_use]
    pub fn with_card(self, card: String) -> Self {
        Method { card: Some(card), ..self }
    }

    /// A one-step method.
    fn from_one_step(name: &str, skin: &Skin, options: OneStepOptions) -> Result<Self, MethodError> {
        let method = OneStep::from_linearised(skin.linearised()?, Arc::clone(skin.pixels()), &options)?;
        let (label, alpha) = (method.name(), method.alpha());
        let (alpha_rule, one_step) = (Some(method.alpha_rule()), Some(options));
        Ok(Method { alpha_rule, one_step, ..Method::new(name, label, Arc::new(method)).with_alpha(alpha) })
    }

    /// The same method with its contacts [refined](Refined) without some channels, once it is [adapted](Self::adapted) to
    /// untouched frames.
    ///
    /// # Errors
    /// A skin on which contacts cannot be refined.
    pub fn refined(self, skin: &Skin, excluded: &[usize]) -> Result<Self, MethodError> {
        let options = RefineOptions::default();
        let refined = Refined::new(self.reconstruct, skin.design(), skin.forward(), excluded.to_vec(), options)?;
        let (name, label) = (Methods::REFINED.into(), format!("{}{AND_REFINED}", self.label));
        Ok(Method { name, label, reconstruct: Arc::new(refined), one_step: None, ..self })
    }

    /// The name by which it is selected: `noser`, `spots`, `./my-model`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Checks that it can find contacts of both signs: images of linear methods are positive or negative by the sign of
    /// the change of conductance. Contacts of both signs are not refined.
    ///
    /// # Errors
    /// A method that is not linear.
    pub fn check_both_signs(&self) -> Result<(), MethodError> {
        let message = "finds only touches, not contacts of both signs: give a linear method, as in --method noser";
        let is_linear = Methods::LINEAR.contains(&self.name()) || self.reconstruct.matrix().is_some();
        if is_linear { Ok(()) } else { Err(MethodError::option(self.label(), message)) }
    }

    /// Its display name: "one-step NOSER", "shipped network `spots`".
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Its label and its regularization parameter, with the rule that chose it if the default rule has no solution, or if
    /// the rule often fails on real frames.
    pub fn description(&self) -> String {
        let alpha = self.alpha.map(|alpha| format!(", alpha {alpha:.4}")).unwrap_or_default();
        let rule = match self.alpha_rule {
            Some(rule @ (AlphaRule::AttainableNoiseFigure(_) | AlphaRule::LCurve | AlphaRule::Gcv)) => {
                format!(" ({rule})")
            }
            _ => String::new(),
        };
        format!("{}{alpha}{rule}", self.label)
    }

    /// Its regularization parameter, if it has one.
    pub fn alpha(&self) -> Option<f64> {
        self.alpha
    }

    /// The card of a network, JSON.
    pub fn card(&self) -> Option<&str> {
        self.card.as_deref()
    }

    /// Whether it is a one-step method, which can be prepared again without masked channels.
    pub fn is_one_step(&self) -> bool {
        self.one_step.is_some()
    }

    /// The reconstruction.
    pub fn reconstruct(&self) -> &Arc<dyn Reconstruct> {
        &self.reconstruct
    }

    /// The image of a difference (frame minus baseline, ohm).
    ///
    /// # Errors
    /// A difference of another length than the protocol's, or with values that are not finite; an iteration that fails.
    pub fn image(&self, difference: &Frame) -> Result<Image, ReconstructError> {
        self.reconstruct.reconstruct(difference)
    }

    /// The method adapted to the untouched skin, if it depends on it and the untouched frames are known; see
    /// [`Reconstruct::adapted`]. Where there are too few to refine contacts, its label says nothing of that.
    ///
    /// # Errors
    /// Frames of the wrong length, a forward problem that cannot be solved.
    pub fn adapted(&self, differences: &Differences) -> Result<Method, ReconstructError> {
        let adapted = match &differences.baseline {
            Some(baseline) => self.reconstruct.adapted(baseline, &differences.untouched)?,
            None => None,
        };
        Ok(match adapted {
            Some(reconstruct) => Method { reconstruct, ..self.clone() },
            // Without frames it is adapted later.
            None if differences.frames.is_empty() => self.clone(),
            None => {
                Method { label: self.label.strip_suffix(AND_REFINED).unwrap_or(&self.label).into(), ..self.clone() }
            }
        })
    }

    /// The detector for its images, with their [noise](crate::reconstruct::image_noise) in untouched frames, if there are any.
    ///
    /// # Errors
    /// A reconstruction that fails on a frame.
    pub fn detector(&self, untouched: &[Frame], protocol: &Protocol) -> Result<Detector, ReconstructError> {
        let detector = Detector::new(self.reconstruct.detection());
        match ChannelNoise::of(untouched, protocol) {
            Some(noise) => {
                let rest = crate::frame::mean(untouched);
                self.with_noise(detector, &noise, untouched, rest.as_ref(), protocol)
            }
            None => Ok(detector),
        }
    }

    /// The detector for differences, with the noise that they and their untouched frames show. Where that is unknown, or the
    /// differences are doubtful, no contact is more probable than not.
    ///
    /// # Errors
    /// A reconstruction that fails on a frame.
    pub fn detector_of(&self, differences: &Differences, protocol: &Protocol) -> Result<Detector, ReconstructError> {
        let detector = Detector::new(self.reconstruct.detection());
        let Some(noise) = ChannelNoise::of_differences(differences, protocol) else { return Ok(detector) };
        let is_doubtful = differences.is_doubtful || noise.source() == NoiseSource::Assumed;
        let detector = if is_doubtful { detector.with_doubt() } else { detector };
        self.with_noise(detector, &noise, &differences.rest(), differences.baseline.as_ref(), protocol)
    }

    /// A detector that knows the noise of the channels in its images and, if untouched frames scatter, spikes and noise of frames.
    fn with_noise(
        &self,
        detector: Detector,
        noise: &ChannelNoise,
        untouched: &[Frame],
        rest: Option<&Frame>,
        protocol: &Protocol,
    ) -> Result<Detector, ReconstructError> {
        let detector = match noise.source() {
            NoiseSource::Scatter => {
                let pairs = ReciprocalPairs::new(protocol, &noise.sd_of_difference_ohm());
                detector.with_reciprocal_pairs(match rest {
                    Some(rest) => pairs.with_rest(rest),
                    None => pairs,
                })
            }
            NoiseSource::Reciprocity | NoiseSource::Frames | NoiseSource::Assumed => detector,
        };
        Ok(match image_noise_of(self.reconstruct.as_ref(), noise, untouched)? {
            Some(noise) => detector.with_noise(noise),
            None => detector,
        })
    }

    /// The contacts of a difference (frame minus baseline, ohm), with the [detector](Self::detector) of its images; the
    /// [reconstruction](Self::reconstruct) gives them with its image.
    ///
    /// # Errors
    /// As [`image`](Self::image).
    pub fn contacts(&self, difference: &Frame, detector: &Detector) -> Result<Vec<Contact>, ReconstructError> {
        Ok(self.reconstruct.image_and_contacts(difference, detector)?.1)
    }

    /// The method for a skin with some masked channels. A one-step method is prepared again without them; for any other
    /// method their values are predicted from the remaining channels ([`WithoutChannels`]).
    ///
    /// # Errors
    /// Too few channels left.
    pub fn without_channels(&self, skin: &Skin, masked: &[usize]) -> Result<Method, MethodError> {
        if masked.is_empty() {
            return Ok(self.clone());
        }
        if let Some(options) = &self.one_step {
            return Self::from_one_step(
                &self.name,
                skin,
                OneStepOptions { excluded: masked.to_vec(), ..options.clone() },
            );
        }
        let filled = WithoutChannels::new(Arc::clone(&self.reconstruct), skin.linearised()?, masked.to_vec())?;
        Ok(Method { reconstruct: Arc::new(filled), ..self.clone() })
    }
}

/// A source of methods in addition to the linear ones.
pub trait MethodSource: Send + Sync {
    /// The names of its methods for a skin, the best first.
    ///
    /// # Errors
    /// A shipped file that is damaged.
    fn names(&self, skin: &Skin) -> Result<Vec<String>, MethodError>;

    /// Prepares the method with this name, or of a folder if the name is a path; `None` for an unknown name.
    ///
    /// # Errors
    /// A method that cannot be prepared for the skin.
    fn method(&self, skin: &Skin, name: &str, options: &MethodOptions) -> Result<Option<Method>, MethodError>;
}

/// The registry: the linear methods, and those of other sources.
#[derive(Clone, Default)]
pub struct Methods {
    sources: Vec<Arc<dyn MethodSource>>,
}

impl Methods {
    /// The name of the best other method of a skin with its contacts [refined](Refined).
    pub const REFINED: &'static str = "refined";
    /// Another name of the [default](Self::default_name) method of a skin.
    pub const BEST: &'static str = "best";
    /// The names of the linear methods, which are available for every skin.
    pub const LINEAR: &[&str] = linear::NAMES;

    /// The linear methods only.
    pub fn linear() -> Self {
        Self::default()
    }

    /// The same registry with the methods of another source, which are preferred.
    #[must_use]
    pub fn with(mut self, source: impl MethodSource + 'static) -> Self {
        self.sources.push(Arc::new(source));
        self
    }

    /// The names of all methods for a skin, the preferred one first: [`REFINED`](Self::REFINED) where contacts can be refined.
    ///
    /// # Errors
    /// A source whose names cannot be read.
    pub fn names(&self, skin: &Skin) -> Result<Vec<String>, MethodError> {
        let mut names = self.own_names(skin)?;
        if Refiner::check(skin.forward()).is_ok() {
            names.insert(0, Self::REFINED.into());
        }
        Ok(names)
    }

    /// The name of the best method without refinement.
    ///
    /// # Errors
    /// As [`names`](Self::names).
    pub fn unrefined_name(&self, skin: &Skin) -> Result<String, MethodError> {
        Ok(self.own_names(skin)?.swap_remove(0))
    }

    /// The names without refinement.
    fn own_names(&self, skin: &Skin) -> Result<Vec<String>, MethodError> {
        let mut names = Vec::new();
        for source in self.sources.iter().rev() {
            names.extend(source.names(skin)?);
        }
        let preferred = linear::default_name(skin);
        names.push(preferred.into());
        names.extend(Self::LINEAR.iter().filter(|name| **name != preferred).map(|name| name.to_string()));
        Ok(names)
    }

    /// The name of the default method: the first of [`names`](Self::names).
    ///
    /// # Errors
    /// As [`names`](Self::names).
    pub fn default_name(&self, skin: &Skin) -> Result<String, MethodError> {
        Ok(self.names(skin)?.swap_remove(0))
    }

    /// Whether a name asks for the default method.
    pub fn is_default(name: &str) -> bool {
        name.is_empty() || name == Self::BEST
    }

    /// Prepares a method for a skin. `name` is one of [`names`](Self::names), the path of a network's folder
    /// (`./my-model`), or empty or [`BEST`](Self::BEST) for the [default](Self::default_name).
    ///
    /// # Errors
    /// An unknown name, options that the method does not have, a method that does not fit the skin.
    pub fn method(&self, skin: &Skin, name: &str, options: &MethodOptions) -> Result<Method, MethodError> {
        if Self::is_default(name) {
            return self.method(skin, &self.default_name(skin)?, options);
        }
        if name == Self::REFINED {
            return self.method(skin, &self.unrefined_name(skin)?, options)?.refined(skin, &options.excluded);
        }
        options.check(skin)?;
        if let Some(method) = linear::method(skin, name, options)? {
            return Ok(method);
        }
        for source in self.sources.iter().rev() {
            if let Some(method) = source.method(skin, name, options)? {
                return Ok(method);
            }
        }
        if is_path(name) {
            return Err(MethodError::option(name, "is not the folder of a network or of a calibration"));
        }
        let (name, skin_name) = (name.to_string(), skin.design().name.clone());
        Err(MethodError::Unknown { name, skin: skin_name, known: self.names(skin)? })
    }
}

/// Whether the name of a method is the path of a folder: it contains a path separator.
pub fn is_path(name: &str) -> bool {
    name.contains(std::path::is_separator)
}

#[cfg(test)]
mod tests;
