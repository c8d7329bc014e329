//! A training from a design, a named network and folders of samples.

use super::{Ablation, Training, TrainingData, TrainingPreset};
use crate::LearnError;
use crate::input::Input;
use crate::model::Model;
use crate::network::Network;
use crate::options::Epoch;
use crate::tensors::Precision;
use dermis::design::SkinDesign;
use dermis::frame::mean;
use dermis::skin::Skin;
use dermis_sim::dataset::{Dataset, GaussianTouches, Recipe, SkinSpread, Skins, Touch};
use dermis_sim::twin::{Twin, TwinOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Seed of the twin whose noise is measured; not used by any benchmark or selection.
const NOISE_SEED: u64 = 3000;
/// Number of untouched frames for the noise.
const NOISE_FRAMES: u64 = 1000;

/// Samples of a streamed epoch and of its test set.
const STREAMED: usize = 100_000;
const STREAMED_TEST: usize = 4096;

/// A network with its preset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NetworkPreset {
    /// [`TrainingPreset::paper`].
    Paper,
    /// [`TrainingPreset::paper_norm_first`].
    PaperNormFirst,
    /// [`TrainingPreset::spots_without`] some components.
    Spots(Vec<Ablation>),
    /// [`TrainingPreset::shapes`], which has no noise of a twin.
    Shapes,
}

/// The samples of a training.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SampleSource {
    /// Folders of finished datasets; without some for the test the last thirtieth of each is held out.
    Folders {
        /// For training.
        training: Vec<PathBuf>,
        /// For the test.
        test: Vec<PathBuf>,
    },
    /// The path of a recipe whose samples are generated during training, or `gaussian`: Gaussian touches on random skins.
    Stream(PathBuf),
}

/// What is trained, and where the model is written.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingRunOptions {
    /// The path of a design file, or a shipped name.
    pub design: String,
    /// The samples.
    pub samples: SampleSource,
    /// The folder for the model.
    pub output: PathBuf,
    /// The network.
    pub network: NetworkPreset,
    /// Digital twin whose noise is added: the path of a file, or a shipped name.
    pub noise: String,
    /// Number of epochs; the preset's without it, as for the other options.
    pub epochs: Option<usize>,
    /// Samples of an epoch.
    pub epoch_samples: Option<usize>,
    /// Learning rate of Adam.
    pub rate: Option<f32>,
    /// Seed of the initial weights, the order of samples and the noise.
    pub seed: Option<u64>,
    /// Precision of the weights in the folder.
    pub precision: Precision,
}

impl Default for TrainingRunOptions {
    /// The paper's network for `cylinder30` with streamed Gaussian touches and the noise of `lab`, written to `model`.
    fn default() -> Self {
        TrainingRunOptions {
            design: "cylinder30".into(),
            samples: SampleSource::Stream("gaussian".into()),
            output: "model".into(),
            network: NetworkPreset::Paper,
            noise: "lab".into(),
            epochs: None,
            epoch_samples: None,
            rate: None,
            seed: None,
            precision: Precision::Single,
        }
    }
}

/// A training and the folder of its model.
///
/// ```no_run
/// use dermis_learn::{NetworkPreset, TrainingRun, TrainingRunOptions};
///
/// let network = NetworkPreset::Spots(Vec::new());
/// let run = TrainingRun::new(TrainingRunOptions { network, epochs: Some(10), ..TrainingRunOptions::default() })?;
/// let mut trainer = run.training().trainer()?;
/// while !trainer.is_done() {
///     trainer.epoch(|_loss| ())?;
/// }
/// run.save(trainer.input(), trainer.network(), trainer.epochs())?;
/// # Ok::<(), dermis_learn::LearnError>(())
/// ```
#[derive(Debug)]
pub struct TrainingRun {
    options: TrainingRunOptions,
    training: Training,
}

impl TrainingRun {
    /// Prepares a training: skin, preset and samples.
    ///
    /// # Errors
    /// A design, a twin, a recipe or a dataset that cannot be read; as [`Training::new`].
    pub fn new(options: TrainingRunOptions) -> Result<Self, LearnError> {
        let skin = Skin::load(&options.design)?;
        let (data, preset) = (options.data(skin.design())?, options.preset(&skin)?);
        let training = Training::new(skin.design(), skin.forward(), Arc::clone(skin.pixels()), preset, data)?;
        Ok(TrainingRun { options, training })
    }

    /// Skin, preset and samples.
    pub fn training(&self) -> &Training {
        &self.training
    }

    /// The folder for the model.
    pub fn output(&self) -> &Path {
        &self.options.output
    }

    /// Writes the model of a trained network into the folder.
    ///
    /// # Errors
    /// A folder that cannot be written, test samples that cannot be read.
    pub fn save(&self, input: &Input, network: Network, epochs: &[Epoch]) -> Result<Model, LearnError> {
        let model = self.training.model(input, network, epochs)?;
        model.save(&self.options.output, self.options.precision)?;
        Ok(model)
    }
}

impl TrainingRunOptions {
    /// The preset with the options that were given.
    fn preset(&self, skin: &Skin) -> Result<TrainingPreset, LearnError> {
        let (design, pixels) = (skin.design(), skin.pixels());
        let (protocol, noise) = (&design.protocol, || noise_ohm(design, &self.noise));
        let mut preset = match &self.network {
            NetworkPreset::Paper => TrainingPreset::paper(protocol, pixels, noise()?),
            NetworkPreset::PaperNormFirst => TrainingPreset::paper_norm_first(protocol, pixels, noise()?),
            NetworkPreset::Spots(without) => TrainingPreset::spots_without(without, design, protocol, pixels, noise()?),
            NetworkPreset::Shapes => TrainingPreset::shapes(protocol, pixels),
        };
        let options = &mut preset.options;
        options.epochs = self.epochs.unwrap_or(options.epochs);
        options.epoch_samples = self.epoch_samples.or(options.epoch_samples);
        options.rate = self.rate.unwrap_or(options.rate);
        options.seed = self.seed.unwrap_or(options.seed);
        Ok(preset)
    }

    /// The datasets, or the recipes of streamed samples.
    fn data(&self, design: &SkinDesign) -> Result<TrainingData, LearnError> {
        let recipe = match &self.samples {
            SampleSource::Folders { training, test } => {
                let open =
                    |folders: &[PathBuf]| folders.iter().map(|folder| Dataset::open(folder)).collect::<Result<_, _>>();
                return Ok(TrainingData::Files { training: open(training)?, test: open(test)? });
            }
            SampleSource::Stream(recipe) => recipe,
        };
        let recipe = |seed: u64, samples: usize| -> Result<Recipe, LearnError> {
            let samples = samples as u64;
            if recipe.to_str() != Some("gaussian") {
                return Ok(Recipe::load(recipe, seed, samples)?);
            }
            let touch = Touch::Gaussian(GaussianTouches::for_effect(design.sheet.touch));
            Ok(Recipe { seed, samples, touch, skins: Skins::Random(SkinSpread::for_design(design)) })
        };
        let seed = 2 * self.seed.unwrap_or_default();
        let training = recipe(seed, self.epoch_samples.unwrap_or(STREAMED))?;
        Ok(TrainingData::Stream { recipes: Box::new([training, recipe(seed + 1, STREAMED_TEST)?]) })
    }
}

/// The standard deviation of each channel of a twin's untouched frames, ohm.
fn noise_ohm(design: &SkinDesign, twin: &str) -> Result<Vec<f32>, LearnError> {
    let options = TwinOptions::load(twin).map_err(dermis::Error::from)?;
    let twin = Twin::new(design, &options, NOISE_SEED)?;
    let frames = (0..NOISE_FRAMES).map(|index| twin.frame(&[], index)).collect::<dermis_sim::Result<Vec<_>>>()?;
    let mean = mean(&frames).expect("there are frames");
    let sd = |channel: usize| {
        let square: f64 = frames.iter().map(|frame| (frame[channel] - mean[channel]).powi(2)).sum();
        (square / (NOISE_FRAMES - 1) as f64).sqrt() as f32
    };
    Ok((0..mean.len()).map(sd).collect())
}
