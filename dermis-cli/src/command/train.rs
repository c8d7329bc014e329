//! `dermis train`: networks from datasets.

use crate::console::{Progress, print};
use crate::failure::Outcome;
use clap::{Args, ValueEnum};
use dermis::dataset::Dataset;
use dermis::design::SkinDesign;
use dermis::detect::DetectOptions;
use dermis::forward::ForwardModel;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::twin::{Twin, TwinOptions};
use dermis_learn::{Card, DataRecord, Method, Model, Part, Precision, Samples, SkinRecord, Trainer, TrainingRecord};
use std::path::PathBuf;
use std::sync::Arc;

/// Seed of the twin whose noise is measured: none that is reported or selected by.
const NOISE_SEED: u64 = 3000;
/// Untouched frames from which it is measured.
const NOISE_FRAMES: u64 = 1000;

/// The arguments of `dermis train`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    /// A finished dataset of `dermis simulate`; several are learned from together.
    #[arg(long, value_name = "DIR", required = true)]
    data: Vec<PathBuf>,
    /// A finished dataset to test by; without it the last thirtieth of each --data is held out.
    #[arg(long, value_name = "DIR")]
    test: Vec<PathBuf>,
    /// The folder for the model.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The network.
    #[arg(long, value_enum, default_value_t = NetworkName::Paper)]
    network: NetworkName,
    /// The twin whose noise is measured and added: the path of its file, or a shipped name.
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    noise: String,
    /// Most epochs.
    #[arg(long, value_name = "N")]
    epochs: Option<usize>,
    /// Samples of an epoch, drawn anew from all for each.
    #[arg(long, value_name = "N")]
    epoch_samples: Option<usize>,
    /// Adam's rate.
    #[arg(long, value_name = "NUMBER")]
    rate: Option<f32>,
    /// The seed of weights, order and noise.
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Store the weights in half precision: half the bytes.
    #[arg(long)]
    half: bool,
}

/// A network by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum NetworkName {
    /// The paper's four dense layers.
    Paper,
    /// Ours: a linear layer refined by convolutions.
    Best,
}

impl Arguments {
    /// Trains, or goes on with training.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        let waiting = Progress::waiting("preparing");
        let forward = ForwardModel::new(&design, &Mesh::generate(&design)?)?;
        let pixels = PixelSpace::for_design(&design, forward.mesh())?;
        let noise_ohm = noise_ohm(&design, &TwinOptions::load(&self.noise)?)?;
        drop(waiting);
        let mut method = match self.network {
            NetworkName::Paper => Method::paper(forward.protocol(), &pixels, noise_ohm),
            NetworkName::Best => Method::best(&design, forward.protocol(), &pixels, noise_ohm),
        };
        let options = &mut method.options;
        options.epochs = self.epochs.unwrap_or(options.epochs);
        options.epoch_samples = self.epoch_samples.or(options.epoch_samples);
        options.rate = self.rate.unwrap_or(options.rate);
        options.seed = self.seed.unwrap_or(options.seed);
        let open =
            |folders: &[PathBuf]| folders.iter().map(|folder| Dataset::open(folder)).collect::<Result<Vec<_>, _>>();
        let (data, test) = (open(&self.data)?, open(&self.test)?);
        let samples = |datasets, part| {
            let (noise, symmetries) = (method.noise.clone(), method.symmetries.clone());
            Samples::new(datasets, part, &forward, &pixels, method.target, noise, symmetries)
        };
        let (training, test) = match test.is_empty() {
            true => (samples(&data, Part::Training)?, samples(&data, Part::Test)?),
            false => (samples(&data, Part::All)?, samples(&test, Part::All)?),
        };
        let mut trainer = Trainer::new(&method.plan, method.input.clone(), &method.options, &training, &test)?;
        std::fs::create_dir_all(&self.output)
            .map_err(|source| dermis_learn::LearnError::Io { path: self.output.clone(), source })?;
        let checkpoint = self.output.join("checkpoint.safetensors");
        trainer.resume(&checkpoint)?;
        while !trainer.is_done() {
            let progress = Progress::with_rate("samples", (trainer.steps_per_epoch() * method.options.batch) as u64);
            let epoch = trainer.epoch(|_| progress.steps(method.options.batch as u64))?;
            drop(progress);
            trainer.save(&checkpoint)?;
            print(&format!(
                "epoch {:3}: training {:.4e}, test {:.4e}, {:.0} s\n",
                trainer.epochs().len(),
                epoch.training_loss,
                epoch.test_loss,
                epoch.seconds
            ))?;
        }
        let record = |dataset: &Dataset| DataRecord {
            identity: dataset.manifest().identity.clone(),
            recipe: dataset.manifest().record.recipe.clone(),
        };
        let card = Card {
            format: Card::FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            name: method.name.into(),
            skin: SkinRecord::new(&design.name, &forward, &pixels),
            plan: method.plan.clone(),
            input: trainer.input().clone(),
            target: method.target,
            noise: method.noise.clone(),
            symmetries: method.symmetries.as_ref().map_or(1, dermis_learn::Symmetries::len),
            detection: DetectOptions::default(),
            data: data.iter().map(record).collect(),
            training: TrainingRecord {
                options: method.options.clone(),
                samples: training.len(),
                test_samples: test.len(),
                target_variance: test.target_variance()?,
                epochs: trainer.epochs().to_vec(),
            },
        };
        let model = Model::new(card, trainer.network().clone(), Arc::new(pixels.clone()));
        model.save(&self.output, if self.half { Precision::Half } else { Precision::Single })?;
        Ok(())
    }
}

/// The standard deviation of each channel of a twin's untouched frames, ohm.
fn noise_ohm(design: &SkinDesign, options: &TwinOptions) -> Outcome<Vec<f32>> {
    let twin = Twin::new(design, options, NOISE_SEED)?;
    let frames = (0..NOISE_FRAMES).map(|index| twin.frame(&[], index)).collect::<dermis::Result<Vec<_>>>()?;
    let mean = dermis::frame::mean(&frames).expect("there are frames");
    let sd = |channel: usize| {
        let square: f64 = frames.iter().map(|frame| (frame[channel] - mean[channel]).powi(2)).sum();
        (square / (NOISE_FRAMES - 1) as f64).sqrt() as f32
    };
    Ok((0..mean.len()).map(sd).collect())
}
