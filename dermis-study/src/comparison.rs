//! The methods that pages set side by side, and what each makes of recorded presses.

use crate::Result;
use crate::progress::Progress;
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::detect::Detector;
use dermis::forward::ForwardModel;
use dermis::frame::Frame;
use dermis::image::{Image, PixelSpace};
use dermis::reconstruct::{Alpha, Linearised, OneStep, OneStepOptions, Prior, Quantity, Reconstruct, image_noise};
use dermis_learn::{Card, Model};
use dermis_sim::evaluate::{Score, score};
use dermis_sim::experiment::Recording;
use rayon::prelude::*;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

/// A method under the name that people read.
pub struct Named {
    /// Its name for programs and files: "noser".
    pub key: String,
    /// Its name for people: "linear, NOSER".
    pub name: String,
    /// The method.
    pub reconstruct: Box<dyn Reconstruct>,
    /// Its alpha, where it has one.
    pub alpha: Option<f64>,
    /// What a network says of itself.
    pub card: Option<Card>,
    /// What tells it from every other method of its name: its alpha or its weights.
    pub identity: String,
}

/// The linear methods of the paper: NOSER and a spatial high-pass filter, which is what Laplace's prior is.
pub const LINEAR: [(&str, &str, Prior); 2] =
    [("noser", "linear, NOSER", Prior::Noser { exponent: 0.5 }), ("laplace", "linear, Laplace", Prior::Laplace)];

impl Named {
    /// A linear method by its place in [`LINEAR`].
    pub fn linear(
        which: usize,
        design: &SkinDesign,
        model: &Linearised,
        pixels: &Arc<PixelSpace>,
        alpha: Alpha,
    ) -> Result<Self> {
        let (key, name, prior) = LINEAR[which];
        let options = OneStepOptions { prior, alpha, touch: design.sheet.touch, ..OneStepOptions::default() };
        let method = OneStep::from_linearised(model, Arc::clone(pixels), &options)?;
        let alpha = Some(method.alpha());
        Ok(Named {
            key: key.into(),
            name: name.into(),
            identity: format!("{:?}, alpha {}", options.prior, method.alpha()),
            reconstruct: Box::new(method),
            alpha,
            card: None,
        })
    }

    /// A trained network.
    pub fn network(model: Model) -> Self {
        let card = model.card().clone();
        let name = match card.name.as_str() {
            "paper" => "paper's network".to_string(),
            "best" => "best network".to_string(),
            other => format!("network {other}"),
        };
        // A card's name comes from a file, and becomes part of the names of others.
        let key = card.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
        let mut hasher = DefaultHasher::new();
        let weights = model.network().tensors().into_iter().flat_map(|tensor| tensor.values);
        weights.for_each(|weight| weight.to_bits().hash(&mut hasher));
        // What is found in its images depends on how they are read too.
        format!("{:?}", card.detection).hash(&mut hasher);
        Named {
            key,
            name,
            identity: format!("weights {:016x}", hasher.finish()),
            reconstruct: Box::new(model),
            alpha: None,
            card: Some(card),
        }
    }

    /// Its name with its alpha.
    pub fn how(&self) -> String {
        self.alpha.map_or_else(|| self.name.clone(), |alpha| format!("{}, alpha {alpha:.3}", self.name))
    }

    /// The image of every frame of a recording.
    pub fn images(&self, recording: &Recording, progress: &dyn Progress) -> Result<Vec<Image>> {
        let task = progress.begin("reconstructing", recording.frames.len());
        let image = |frame: &Frame| {
            let image = self.reconstruct.reconstruct(&(frame - &recording.baseline));
            task.advance(1);
            Ok(image?)
        };
        recording.frames.par_iter().map(image).collect()
    }

    /// The detector for its images, told of their noise by the differences of untouched frames from their baseline.
    pub fn detector(&self, untouched: &[Frame]) -> Result<Detector> {
        let detector = Detector::new(self.reconstruct.detection());
        let noise = image_noise(&*self.reconstruct, untouched)?;
        Ok(match noise {
            Some(noise) => detector.with_noise(noise),
            None => detector,
        })
    }
}

/// The methods that need no choice on this skin: the linear one, and the networks that are shipped for it.
pub fn shipped(
    design: &SkinDesign,
    forward: &ForwardModel,
    model: &Linearised,
    pixels: &Arc<PixelSpace>,
) -> Result<Vec<Named>> {
    let mut methods = vec![Named::linear(0, design, model, pixels, Alpha::Auto)?];
    methods.extend(shipped_networks(forward, pixels)?);
    Ok(methods)
}

/// The networks that are shipped for this skin.
pub fn shipped_networks(forward: &ForwardModel, pixels: &Arc<PixelSpace>) -> Result<Vec<Named>> {
    Ok(Model::shipped(forward, pixels)?.into_iter().map(Named::network).collect())
}

/// What one method made of some presses.
pub struct Shown {
    /// The method's name for people.
    pub name: String,
    /// The same with its alpha.
    pub how: String,
    /// The image of each frame.
    pub images: Vec<Image>,
    /// What their values are.
    pub quantity: Quantity,
    /// The contacts found in each image.
    pub contacts: Vec<Vec<Contact>>,
    /// The score.
    pub score: Score,
}

impl Shown {
    /// Makes the images of a recording, finds the contacts in them and scores them.
    pub fn of(
        method: &Named,
        recording: &Recording,
        truth: &[Vec<Contact>],
        detector: &Detector,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let images = method.images(recording, progress)?;
        let contacts = images.par_iter().map(|image| detector.detect(image)).collect();
        let score = score(&images, truth, detector, &method.name, method.alpha)?;
        let quantity = method.reconstruct.quantity();
        Ok(Shown { name: method.name.clone(), how: method.how(), images, quantity, contacts, score })
    }
}
