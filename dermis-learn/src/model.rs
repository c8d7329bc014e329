//! A trained network: a folder with its weights and its card.

use crate::LearnError;
use crate::card::{Card, SkinRecord};
use crate::inference::Inference;
use crate::input::Input;
use crate::network::Network;
use crate::options::Target;
use crate::shipped;
use crate::tensors::Precision;
use dermis::detect::DetectOptions;
use dermis::files::read_at_most;
use dermis::forward::ForwardModel;
use dermis::frame::{Frame, write_whole};
use dermis::image::{Image, PixelSpace};
use dermis::reconstruct::{Quantity, Reconstruct, ReconstructError, check_lengths};
use dermis::skin::Skin;
use std::path::Path;
use std::sync::Arc;

/// Largest file of a network, bytes.
const LARGEST_FILE: u64 = 512 << 20;

/// The files of a model's folder.
const CARD: &str = "card.json";
const WEIGHTS: &str = "weights.safetensors";

/// A trained network, ready for inference.
#[derive(Debug)]
pub struct Model {
    card: Card,
    network: Network,
    inference: Inference,
    pixels: Arc<PixelSpace>,
}

impl SkinRecord {
    /// The record of a skin.
    pub(crate) fn of(skin: &Skin) -> Self {
        Self::new(&skin.design().name, skin.forward(), skin.pixels())
    }

    /// The skin of a design.
    pub fn new(design: &str, forward: &ForwardModel, pixels: &PixelSpace) -> Self {
        SkinRecord {
            design: design.into(),
            mesh: forward.mesh().hash(),
            protocol_sha256: forward.protocol().sha256(),
            channels: forward.protocol().channel_count(),
            pixels: pixels.len(),
        }
    }
}

impl Model {
    /// A network and its card as a model.
    ///
    /// # Panics
    /// If the card describes another network.
    pub fn new(card: Card, network: Network, pixels: Arc<PixelSpace>) -> Self {
        assert!(
            card.architecture == *network.architecture() && card.skin.pixels == pixels.len(),
            "the card of this network"
        );
        let inference = Inference::new(&network, &card.input, card.target);
        Model { card, network, inference, pixels }
    }

    /// Whether the shipped model of a name was trained for this skin.
    ///
    /// # Errors
    /// A shipped file that is damaged.
    ///
    /// # Panics
    /// For a name that is not shipped.
    pub(crate) fn is_shipped_for(name: &str, skin: &Skin) -> Result<bool, LearnError> {
        let (card, _) = shipped::files(name).expect("a shipped name");
        Ok(parse_card(Path::new(name), card)?.skin.is_that_of(&SkinRecord::of(skin)))
    }

    /// The models that are shipped for a skin, the preferred one first; for most skins there are none.
    ///
    /// # Errors
    /// A shipped file that is damaged.
    pub fn shipped(forward: &ForwardModel, pixels: &Arc<PixelSpace>) -> Result<Vec<Self>, LearnError> {
        let skin = SkinRecord::new("", forward, pixels);
        let mut models = Vec::new();
        for name in shipped::NAMES {
            let (card, weights) = shipped::files(name).expect("every name has its files");
            if parse_card(Path::new(name), card)?.skin.is_that_of(&skin) {
                models.push(Self::parse(Path::new(name), card, weights, forward, Arc::clone(pixels))?);
            }
        }
        Ok(models)
    }

    /// Reads the model in a folder for a skin.
    ///
    /// # Errors
    /// Files that are missing, truncated or of another version; a model for another skin.
    pub fn load(folder: &Path, forward: &ForwardModel, pixels: Arc<PixelSpace>) -> Result<Self, LearnError> {
        let read = |name: &str| {
            let path = folder.join(name);
            read_at_most(&path, LARGEST_FILE).map_err(|source| LearnError::Io { path, source })
        };
        Self::parse(folder, &read(CARD)?, &read(WEIGHTS)?, forward, pixels)
    }

    /// A model from the bytes of its two files; errors contain `folder`.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub(crate) fn parse(
        folder: &Path,
        card: &[u8],
        weights: &[u8],
        forward: &ForwardModel,
        pixels: Arc<PixelSpace>,
    ) -> Result<Self, LearnError> {
        let card = parse_card(&folder.join(CARD), card)?;
        card.skin.check(folder, &SkinRecord::new(&card.skin.design, forward, &pixels))?;
        let network = Network::parse(&card.architecture, &folder.join(WEIGHTS), weights)?;
        Ok(Model::new(card, network, pixels))
    }

    /// Whether a folder has the card of a network.
    pub(crate) fn is_folder(folder: &Path) -> bool {
        folder.join(CARD).is_file()
    }

    /// Writes the model into a folder, which is created if missing. Matrices and convolutions are stored in the given
    /// precision, all other values in single precision.
    ///
    /// # Errors
    /// A folder or file that cannot be written.
    pub fn save(&self, folder: &Path, precision: Precision) -> Result<(), LearnError> {
        std::fs::create_dir_all(folder).map_err(|source| LearnError::io(folder, source))?;
        let weights = self.network.to_safetensors(precision);
        write_whole(&folder.join(WEIGHTS), |out| out.write_all(&weights)).map_err(dermis::Error::from)?;
        self.save_card(folder)
    }

    /// Writes only the card into the model's folder.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn save_card(&self, folder: &Path) -> Result<(), LearnError> {
        let text = serde_json::to_string_pretty(&self.card).expect("a card is JSON");
        let written = write_whole(&folder.join(CARD), |out| out.write_all(text.as_bytes()));
        written.map_err(|error| LearnError::Dermis(error.into()))
    }

    /// Its card.
    pub fn card(&self) -> &Card {
        &self.card
    }

    /// The same network with other detection options for its images.
    #[must_use]
    pub fn with_detection(mut self, detection: DetectOptions) -> Self {
        self.card.detection = detection;
        self
    }

    /// The same network without some channels, which are replaced by their twins.
    ///
    /// # Errors
    /// An input without a remaining channel, for a network that is not scale-free.
    pub fn without(&self, left_out: &[usize]) -> Result<Self, LearnError> {
        let input = self.card.input.without(left_out);
        if let Some(empty) = input.channels.iter().position(Vec::is_empty).filter(|_| !input.scale_free) {
            let channels = &self.card.input.channels[empty];
            let message = format!("no twin stands for the channels {channels:?}: leave out fewer");
            return Err(LearnError::model(Path::new(&self.card.name), message));
        }
        Ok(self.with_input(input))
    }

    /// The same network for an instrument whose channels have different amplitudes ([`Input::matched`]); no effect on a
    /// network that is not scale-free.
    #[must_use]
    pub fn matched(&self, differences: &[Frame]) -> Self {
        if !self.card.input.scale_free {
            return self.with_input(self.card.input.clone());
        }
        let differences: Vec<Vec<f32>> =
            differences.iter().map(|frame| frame.iter().map(|&value| value as f32).collect()).collect();
        self.with_input(self.card.input.matched(&differences))
    }

    fn with_input(&self, input: Input) -> Self {
        let inference = Inference::new(&self.network, &input, self.card.target);
        let card = Card { input, ..self.card.clone() };
        Model { card, network: self.network.clone(), inference, pixels: Arc::clone(&self.pixels) }
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The images of many differences, faster than one by one.
    ///
    /// # Errors
    /// A difference of the wrong length or with values that are not finite.
    pub fn images(&self, differences: &[Frame]) -> Result<Vec<Image>, ReconstructError> {
        for difference in differences {
            check_lengths(difference, self.card.skin.channels, &[], 0)?;
        }
        let all: Vec<f64> = differences.iter().flat_map(|difference| difference.iter().copied()).collect();
        let mut values = vec![0.0; differences.len() * self.pixels.len()];
        self.inference.images_into(&all, &mut values);
        let image = |values: &[f64]| Image { space: Arc::clone(&self.pixels), values: values.to_vec() };
        Ok(values.chunks_exact(self.pixels.len()).map(image).collect())
    }
}

impl Reconstruct for Model {
    fn name(&self) -> String {
        format!("network `{}`", self.card.name)
    }

    fn pixels(&self) -> &Arc<PixelSpace> {
        &self.pixels
    }

    fn quantity(&self) -> Quantity {
        match self.card.target {
            Target::Conductance => Quantity::Change,
            Target::Touches { .. } => Quantity::Touch,
        }
    }

    fn detection(&self) -> DetectOptions {
        self.card.detection.clone()
    }

    fn reconstruct_into(&self, difference: &[f64], values: &mut [f64]) -> Result<(), ReconstructError> {
        check_lengths(difference, self.card.skin.channels, values, self.pixels.len())?;
        self.inference.image_into(difference, values);
        Ok(())
    }
}

fn parse_card(path: &Path, bytes: &[u8]) -> Result<Card, LearnError> {
    let wrong = |message: String| LearnError::model(path, message);
    let value: serde_json::Value =
        serde_json::from_slice(bytes).map_err(|error| wrong(format!("damaged or cut off: {error}")))?;
    if value["format"] != Card::FORMAT {
        return Err(wrong(format!("its format is {}, this program reads \"{}\"", value["format"], Card::FORMAT)));
    }
    let card: Card = serde_json::from_value(value).map_err(|error| wrong(format!("no model's card: {error}")))?;
    card.architecture.check().map_err(|message| wrong(format!("no network has its `plan`: {message}")))?;
    card.detection.check().map_err(|message| wrong(format!("its detection: {message}")))?;
    let Card { input, architecture, skin, .. } = &card;
    let fits = input.len() == architecture.inputs()
        && input.mean_ohm.len() == input.len()
        && input.sd_ohm.len() == input.len();
    let are_there = input.channels.iter().all(|list| !list.is_empty() && list.iter().all(|&c| c < skin.channels));
    if !fits || !are_there || architecture.outputs() != skin.pixels {
        return Err(wrong("its `plan`, its `input` and its `skin` do not fit together".into()));
    }
    Ok(card)
}

impl SkinRecord {
    /// Whether two skins are the same except for their names.
    fn is_that_of(&self, other: &SkinRecord) -> bool {
        *self == SkinRecord { design: self.design.clone(), ..other.clone() }
    }

    /// Refuses a skin that is not this one.
    fn check(&self, folder: &Path, asked: &SkinRecord) -> Result<(), LearnError> {
        let parts = [
            ("mesh", &self.mesh, &asked.mesh),
            ("protocol", &self.protocol_sha256, &asked.protocol_sha256),
            ("pixels", &self.pixels.to_string(), &asked.pixels.to_string()),
        ];
        match parts.iter().find(|(_, own, asked)| own != asked) {
            None => Ok(()),
            Some((part, own, asked)) => {
                let own = format!("it was trained for the skin `{}`, whose {part} is {own}, not {asked}", self.design);
                Err(LearnError::model(folder, format!("{own}; train one for this skin with `dermis train`")))
            }
        }
    }
}
