//! `dermis train`: training of networks.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::range::{count, number, seed};
use clap::{Args, ValueEnum};
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::write_whole;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis_learn::{Ablation, Epoch, LearnError, Model, Precision, Trainer, Training, TrainingData, TrainingPreset};
use dermis_plot::Picture;
use dermis_plot::chart::Curves;
use dermis_sim::dataset::{Dataset, GaussianTouches, Recipe, SkinSpread, Skins, Touch};
use dermis_sim::twin::{Twin, TwinOptions};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Seed of the twin whose noise is measured; not used by any benchmark or selection.
const NOISE_SEED: u64 = 3000;
/// Number of untouched frames for the noise.
const NOISE_FRAMES: u64 = 1000;

/// Samples of a streamed epoch and of its test set.
const STREAMED: usize = 100_000;
const STREAMED_TEST: usize = 4096;

/// The arguments of `dermis train`.
#[derive(Debug, Args)]
#[command(
    after_help = "An interrupted training continues after its last epoch when it is started again with the same \
    arguments, with identical losses."
)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Finished dataset of `dermis simulate`; may be given more than once.
    #[arg(long, value_name = "DIR", required_unless_present = "stream")]
    data: Vec<PathBuf>,
    /// Generate samples during training from a recipe (TOML), or from `gaussian`: Gaussian touches on random skins.
    #[arg(long, value_name = "RECIPE", conflicts_with_all = ["data", "test"])]
    stream: Option<PathBuf>,
    /// Finished dataset for testing [default: the last thirtieth of each --data]
    #[arg(long, value_name = "DIR")]
    test: Vec<PathBuf>,
    /// Folder for the model.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Network and training preset.
    #[arg(long, value_enum, default_value_t = NetworkName::Paper)]
    network: NetworkName,
    /// Ablation: remove a component of the best network; may be given more than once.
    #[arg(long, value_enum, value_name = "COMPONENT")]
    without: Vec<AblationName>,
    /// Digital twin whose noise is added: the path of a file, or a shipped name.
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    noise: String,
    /// Number of epochs.
    #[arg(long, value_name = "N", value_parser = count(1..=1_000_000usize))]
    epochs: Option<usize>,
    /// Samples of an epoch, drawn at random for each epoch.
    #[arg(long, value_name = "N", value_parser = count(1..=1_000_000_000usize))]
    epoch_samples: Option<usize>,
    /// Learning rate of Adam.
    #[arg(long, value_name = "NUMBER", value_parser = number(1e-9..=1.0f32))]
    rate: Option<f32>,
    /// Seed of the initial weights, the order of samples and the noise.
    #[arg(long, value_name = "S", value_parser = seed)]
    seed: Option<u64>,
    /// Store the weights in half precision.
    #[arg(long)]
    half: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A network by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum NetworkName {
    /// The paper's four dense layers.
    Paper,
    /// Alternative reading of the paper: batch normalisation before four of the five dense layers.
    PaperNormFirst,
    /// A linear layer refined by convolutions, trained with domain randomization.
    Best,
    /// For uncalibrated instruments: input normalised by the size of the frame, strong domain randomization instead of
    /// a twin's noise.
    Shapes,
}

/// A component of the best network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum AblationName {
    /// Averaging of reciprocal channels.
    Reciprocity,
    /// Convolutions after the linear layer; without them, the paper's dense layers.
    Refinement,
    /// Touches as the target; without them, the change of conductance and no symmetries.
    Touches,
    /// Augmentation by the symmetries of the skin.
    Symmetries,
    /// Noise of several levels, drift of coat and contacts; without it, white noise.
    Disturbance,
}

impl AblationName {
    fn ablation(self) -> Ablation {
        match self {
            AblationName::Reciprocity => Ablation::Reciprocity,
            AblationName::Refinement => Ablation::Refinement,
            AblationName::Touches => Ablation::Touches,
            AblationName::Symmetries => Ablation::Symmetries,
            AblationName::Disturbance => Ablation::Disturbance,
        }
    }
}

/// The results as JSON.
#[derive(Serialize)]
struct Summary<'a> {
    model: &'a Path,
    name: &'a str,
    learned_values: usize,
    samples: usize,
    test_samples: usize,
    target_variance: f64,
    epochs: &'a [Epoch],
}

impl Arguments {
    /// Trains or resumes training, and writes the model.
    pub fn run(self) -> Outcome {
        let training = self.training()?;
        let waiting = Progress::waiting("preparing");
        let mut trainer = training.trainer()?;
        drop(waiting);
        self.train(&mut trainer, training.preset().options.batch)?;
        let model = training.model(trainer.input(), trainer.network(), trainer.epochs())?;
        self.save(&model)?;
        self.print_summary(&model)
    }

    /// The training that the arguments describe.
    pub fn training(&self) -> Outcome<Training> {
        if !self.without.is_empty() && self.network != NetworkName::Best {
            let message = "--without removes components of the best network, which other networks do not have";
            return Err(Failure::given(message, Some("add `--network best`")));
        }
        let design = SkinDesign::load(&self.design)?;
        let data = self.data(&design)?;
        let _waiting = Progress::waiting("preparing");
        let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
        let pixels = Arc::new(PixelSpace::for_design(&design, forward.mesh())?);
        let preset = self.preset(&design, &forward, &pixels)?;
        Ok(Training::new(&design, &forward, pixels, preset, data)?)
    }

    /// The folder for the model.
    pub fn output(&self) -> &Path {
        &self.output
    }

    /// Writes the model of a trained network into the folder.
    pub fn save(&self, model: &Model) -> Outcome {
        Ok(model.save(&self.output, if self.half { Precision::Half } else { Precision::Single })?)
    }

    /// The preset with the options that were given.
    fn preset(&self, design: &SkinDesign, forward: &ForwardModel, pixels: &PixelSpace) -> Outcome<TrainingPreset> {
        let noise_ohm = || noise_ohm(design, &TwinOptions::load(&self.noise)?);
        let mut preset = match self.network {
            NetworkName::Paper => TrainingPreset::paper(forward.protocol(), pixels, noise_ohm()?),
            NetworkName::PaperNormFirst => TrainingPreset::paper_norm_first(forward.protocol(), pixels, noise_ohm()?),
            NetworkName::Best => {
                let without: Vec<Ablation> = self.without.iter().map(|name| name.ablation()).collect();
                TrainingPreset::best_without(&without, design, forward.protocol(), pixels, noise_ohm()?)
            }
            NetworkName::Shapes => TrainingPreset::shapes(forward.protocol(), pixels),
        };
        let options = &mut preset.options;
        options.epochs = self.epochs.unwrap_or(options.epochs);
        options.epoch_samples = self.epoch_samples.or(options.epoch_samples);
        options.rate = self.rate.unwrap_or(options.rate);
        options.seed = self.seed.unwrap_or(options.seed);
        Ok(preset)
    }

    /// The datasets, or the recipes of streamed samples.
    fn data(&self, design: &SkinDesign) -> Outcome<TrainingData> {
        let Some(recipe) = &self.stream else {
            let open =
                |folders: &[PathBuf]| folders.iter().map(|folder| Dataset::open(folder)).collect::<Result<Vec<_>, _>>();
            return Ok(TrainingData::Files { training: open(&self.data)?, test: open(&self.test)? });
        };
        let recipe = |seed: u64, samples: usize| -> Outcome<Recipe> {
            let samples = samples as u64;
            match recipe.to_str() {
                Some("gaussian") => {
                    let touch = Touch::Gaussian(GaussianTouches::for_effect(design.sheet.touch));
                    Ok(Recipe { seed, samples, touch, skins: Skins::Random(SkinSpread::usual()) })
                }
                _ => Ok(Recipe::load(recipe, seed, samples)?),
            }
        };
        let seed = 2 * self.seed.unwrap_or_default();
        let training = recipe(seed, self.epoch_samples.unwrap_or(STREAMED))?;
        Ok(TrainingData::Stream { recipes: Box::new([training, recipe(seed + 1, STREAMED_TEST)?]) })
    }

    /// Trains epoch by epoch, with a checkpoint and a plot of the losses after each.
    fn train(&self, trainer: &mut Trainer<'_>, batch: usize) -> Outcome {
        std::fs::create_dir_all(&self.output).map_err(|source| LearnError::Io { path: self.output.clone(), source })?;
        let checkpoint = self.output.join("checkpoint.safetensors");
        if trainer.resume(&checkpoint)? && !self.json {
            print(&format!("resuming after epoch {}\n", trainer.epochs().len()))?;
        }
        while !trainer.is_done() {
            let number = trainer.epochs().len() + 1;
            let progress = Progress::with_rate("", (trainer.steps_per_epoch() * batch) as u64);
            let epoch = trainer.epoch(|loss| {
                progress.show(&format!("epoch {number}, loss {loss:.3e}"));
                progress.steps(batch as u64);
            })?;
            drop(progress);
            trainer.save(&checkpoint)?;
            write_losses(&self.output, trainer.epochs())?;
            if !self.json {
                let Epoch { training_loss, test_loss, seconds } = epoch;
                let rate = (trainer.steps_per_epoch() * batch) as f64 / seconds;
                print(&format!(
                    "epoch {number:3}: training loss {training_loss:.4e}, test loss {test_loss:.4e}, {seconds:.0} s \
                     ({rate:.0} samples/s including the test)\n"
                ))?;
            }
        }
        Ok(())
    }

    fn print_summary(&self, model: &Model) -> Outcome {
        let record = &model.card().training;
        if self.json {
            return print_json(&Summary {
                model: &self.output,
                name: &model.card().name,
                learned_values: model.network().learned_count(),
                samples: record.samples,
                test_samples: record.test_samples,
                target_variance: record.target_variance,
                epochs: &record.epochs,
            });
        }
        let least = record.epochs.iter().map(|epoch| epoch.test_loss).fold(f64::INFINITY, f64::min);
        print(&format!(
            "{}: {} parameters, lowest test loss {least:.4e}, {:.1} % of the target's variance\n",
            self.output.display(),
            model.network().learned_count(),
            100.0 * least / record.target_variance
        ))
    }
}

/// Writes the plot of the losses into a folder.
pub fn write_losses(folder: &Path, epochs: &[Epoch]) -> Outcome {
    let picture = losses(epochs);
    Ok(write_whole(&folder.join("losses.svg"), |out| out.write_all(picture.to_svg().as_bytes()))?)
}

/// The losses against the epoch.
fn losses(epochs: &[Epoch]) -> Picture {
    let curve = |name: &str, of: fn(&Epoch) -> f64| {
        let place = |(number, epoch): (usize, &Epoch)| [number as f64 + 1.0, of(epoch)];
        (name.to_string(), epochs.iter().enumerate().map(place).collect::<Vec<_>>())
    };
    let curves = vec![curve("training", |epoch| epoch.training_loss), curve("test", |epoch| epoch.test_loss)];
    let left = "mean square error";
    Curves {
        title: "Loss",
        subtitle: "on inputs with noise",
        below: "epoch",
        left,
        logarithmic: true,
        shown: vec![],
        curves,
    }
    .draw()
}

/// The standard deviation of each channel of a twin's untouched frames, ohm.
fn noise_ohm(design: &SkinDesign, options: &TwinOptions) -> Outcome<Vec<f32>> {
    let twin = Twin::new(design, options, NOISE_SEED)?;
    let frames = (0..NOISE_FRAMES).map(|index| twin.frame(&[], index)).collect::<dermis_sim::Result<Vec<_>>>()?;
    let mean = dermis::frame::mean(&frames).expect("there are frames");
    let sd = |channel: usize| {
        let square: f64 = frames.iter().map(|frame| (frame[channel] - mean[channel]).powi(2)).sum();
        (square / (NOISE_FRAMES - 1) as f64).sqrt() as f32
    };
    Ok((0..mean.len()).map(sd).collect())
}
