//! `dermis train`: training of networks.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::range::{count, number, seed};
use clap::{Args, ValueEnum};
use dermis_learn::{
    Ablation, Epoch, LearnError, Model, NetworkPreset, Precision, SampleSource, Trainer, TrainingRun,
    TrainingRunOptions,
};
use dermis_plot::Picture;
use dermis_plot::chart::Curves;
use serde::Serialize;
use std::path::{Path, PathBuf};

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
    #[arg(long, value_name = "FOLDER", required_unless_present = "stream")]
    data: Vec<PathBuf>,
    /// Generate samples during training from a recipe (TOML), or from `gaussian`: Gaussian touches on random skins.
    #[arg(long, value_name = "RECIPE", conflicts_with_all = ["data", "test"])]
    stream: Option<PathBuf>,
    /// Finished dataset for testing [default: the last thirtieth of each --data]
    #[arg(long, value_name = "FOLDER")]
    test: Vec<PathBuf>,
    /// Folder for the model.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Network and training preset.
    #[arg(long, value_enum, default_value_t = NetworkName::Paper)]
    network: NetworkName,
    /// Ablation: remove a component of the network spots; may be given more than once.
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
    Spots,
    /// For uncalibrated instruments: input normalised by the size of the frame, strong domain randomization instead of
    /// a twin's noise.
    Shapes,
}

/// A component of the network spots.
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
        let waiting = Progress::waiting("preparing");
        let run = TrainingRun::new(self.options()?)?;
        let mut trainer = run.training().trainer()?;
        drop(waiting);
        self.train(&mut trainer, run.training().preset().options.batch)?;
        let model = run.save(trainer.input(), trainer.network(), trainer.epochs())?;
        self.print_summary(&model)
    }

    /// The training that the arguments describe.
    fn options(&self) -> Outcome<TrainingRunOptions> {
        if !self.without.is_empty() && self.network != NetworkName::Spots {
            let message = "--without removes components of the network spots, which other networks do not have";
            return Err(Failure::given(message, Some("add `--network spots`")));
        }
        Ok(TrainingRunOptions {
            design: self.design.clone(),
            samples: match &self.stream {
                Some(recipe) => SampleSource::Stream(recipe.clone()),
                None => SampleSource::Folders { training: self.data.clone(), test: self.test.clone() },
            },
            output: self.output.clone(),
            network: match self.network {
                NetworkName::Paper => NetworkPreset::Paper,
                NetworkName::PaperNormFirst => NetworkPreset::PaperNormFirst,
                NetworkName::Spots => NetworkPreset::Spots(self.without.iter().map(|name| name.ablation()).collect()),
                NetworkName::Shapes => NetworkPreset::Shapes,
            },
            noise: self.noise.clone(),
            epochs: self.epochs,
            epoch_samples: self.epoch_samples,
            rate: self.rate,
            seed: self.seed,
            precision: if self.half { Precision::Half } else { Precision::Single },
        })
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
            losses(trainer.epochs()).write_svg(&self.output.join("losses.svg"))?;
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
        let (done, most) = (record.epochs.len(), record.options.epochs);
        let end = match done < most {
            true => format!("ended after {done} of {most} epochs, as the test loss no longer fell; "),
            false => String::new(),
        };
        let least = record.epochs.iter().map(|epoch| epoch.test_loss).fold(f64::INFINITY, f64::min);
        print(&format!(
            "{}: {} parameters, {end}lowest test loss {least:.4e}, {:.1} % of the target's variance\n",
            self.output.display(),
            model.network().learned_count(),
            100.0 * least / record.target_variance
        ))
    }
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
