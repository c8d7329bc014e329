//! The methods that the reports compare, and their results on recorded presses.

use crate::Result;
use crate::progress::Progress;
use dermis::contact::Contact;
use dermis::detect::Detector;
use dermis::frame::Frame;
use dermis::image::Image;
use dermis::method::{Method, MethodOptions, Methods};
use dermis::reconstruct::{Alpha, Quantity};
use dermis::skin::Skin;
use dermis_learn::{Card, Model};
use dermis_sim::evaluate::{Score, score_contacts};
use dermis_sim::experiment::Recording;
use rayon::prelude::*;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

/// A method with its name in tables and pictures.
pub struct Named {
    /// Its identifier, also used in file names: "noser".
    pub key: String,
    /// Its name in tables and pictures: "linear, NOSER".
    pub name: String,
    /// The method.
    pub method: Method,
    /// The card of a network.
    pub card: Option<Card>,
    /// Identifies the method among others of the same name: its alpha or its weights.
    pub identity: String,
}

/// The linear methods of the paper, by their names in the registry and in tables: NOSER, and the Laplace prior, which
/// is a spatial high-pass filter.
pub const LINEAR: [(&str, &str); 2] = [("noser", "linear, NOSER"), ("laplace", "linear, Laplace")];

impl Named {
    /// A linear method by its index in [`LINEAR`].
    ///
    /// # Errors
    /// A skin whose forward problem cannot be solved.
    pub fn linear(which: usize, skin: &Skin, alpha: Alpha) -> Result<Self> {
        let (key, name) = LINEAR[which];
        let method = Methods::linear().method(skin, key, &MethodOptions { alpha, ..MethodOptions::default() })?;
        let identity = format!("alpha {:?}", method.alpha());
        Ok(Named { key: key.into(), name: name.into(), method, card: None, identity })
    }

    /// A trained network.
    pub fn network(model: Model) -> Self {
        let card = model.card().clone();
        let name = match card.name.as_str() {
            "paper" => "paper's network".to_string(),
            "spots" => "network of spots".to_string(),
            other => format!("network {other}"),
        };
        // The name on the card comes from a file and becomes part of file names.
        let key: String = card.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
        let mut hasher = DefaultHasher::new();
        let weights = model.network().tensors().into_iter().flat_map(|tensor| tensor.values);
        weights.for_each(|weight| weight.to_bits().hash(&mut hasher));
        // The contacts in its images also depend on the detection options.
        format!("{:?}", card.detection).hash(&mut hasher);
        let method = Method::new(key.clone(), name.clone(), Arc::new(model));
        Named { key, name, method, card: Some(card), identity: format!("weights {:016x}", hasher.finish()) }
    }

    /// Its name with its alpha.
    pub fn how(&self) -> String {
        self.method.alpha().map_or_else(|| self.name.clone(), |alpha| format!("{}, alpha {alpha:.3}", self.name))
    }
}

/// The default method of a skin, the linear one, and the paper's network.
///
/// # Errors
/// A skin whose forward problem cannot be solved; a shipped file that is damaged.
pub fn for_the_demo(skin: &Skin) -> Result<Vec<Named>> {
    let methods = dermis_learn::methods();
    let key = methods.default_name(skin)?;
    let method = methods.method(skin, &key, &MethodOptions::default())?;
    let default = Named { name: format!("default: {}", method.name()), identity: key.clone(), key, method, card: None };
    let paper = shipped_networks(skin)?.into_iter().find(|network| network.key == "paper");
    Ok([default, Named::linear(0, skin, Alpha::Auto)?].into_iter().chain(paper).collect())
}

/// The shipped networks for this skin, the preferred one last.
///
/// # Errors
/// A shipped file that is damaged.
pub fn shipped_networks(skin: &Skin) -> Result<Vec<Named>> {
    Ok(Model::shipped(skin.forward(), skin.pixels())?.into_iter().rev().map(Named::network).collect())
}

/// The results of one method on some presses.
pub struct Shown {
    /// The method's name in tables and pictures.
    pub name: String,
    /// The same with its alpha, if any.
    pub how: String,
    /// The image of each frame.
    pub images: Vec<Image>,
    /// Quantity of their values.
    pub quantity: Quantity,
    /// The detected contacts of each image.
    pub contacts: Vec<Vec<Contact>>,
    /// The score.
    pub score: Score,
}

impl Shown {
    /// Computes the images and the contacts of a recording, and scores them.
    pub fn of(
        method: &Named,
        recording: &Recording,
        truth: &[Vec<Contact>],
        detector: &Detector,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let task = progress.begin("reconstructing", recording.frames.len());
        let of_frame = |frame: &Frame| {
            let found = method.method.reconstruct().image_and_contacts(&(frame - &recording.baseline), detector);
            task.advance(1);
            found
        };
        let found = recording.frames.par_iter().map(of_frame).collect::<std::result::Result<Vec<_>, _>>()?;
        let (images, contacts): (Vec<Image>, Vec<Vec<Contact>>) = found.into_iter().unzip();
        let score = score_contacts(&images, &contacts, truth, &method.name, method.method.alpha())?;
        let quantity = method.method.reconstruct().quantity();
        Ok(Shown { name: method.name.clone(), how: method.how(), images, quantity, contacts, score })
    }
}
