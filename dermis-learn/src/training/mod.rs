//! A training: a skin, a preset and samples, put together in one way for every program that trains.

mod adam;
mod checkpoint;
pub(crate) mod pass;
mod preset;
mod run;
mod samples;
mod source;
mod symmetry;
mod trainer;

pub use preset::{Ablation, TrainingPreset};
pub use run::{NetworkPreset, SampleSource, TrainingRun, TrainingRunOptions};
pub use samples::{Augmentation, Samples};
pub use source::{Files, Part, Source, Streamed};
pub use symmetry::Symmetries;
pub use trainer::Trainer;

use crate::LearnError;
use crate::card::{SkinRecord, TrainingRecord};
use crate::input::Input;
use crate::model::Model;
use crate::network::Network;
use crate::options::Epoch;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::image::PixelSpace;
use dermis_sim::dataset::{Dataset, Generator, Recipe};
use std::sync::Arc;

/// The origin of training and test samples.
#[derive(Debug)]
pub enum TrainingData {
    /// Files. Without test files the last thirtieth of each dataset is held out.
    Files {
        /// For training.
        training: Vec<Dataset>,
        /// For the test.
        test: Vec<Dataset>,
    },
    /// Samples generated during training: new ones in every epoch; the number of samples of a recipe is that of an
    /// epoch.
    Stream {
        /// For training and for the test.
        recipes: Box<[Recipe; 2]>,
    },
}

/// Skin, preset and samples of a training.
#[derive(Debug)]
pub struct Training {
    skin: SkinRecord,
    pixels: Arc<PixelSpace>,
    preset: TrainingPreset,
    data: Arc<[Dataset]>,
    training: Samples,
    test: Samples,
}

/// Refuses a dataset of another skin, which may have the same mesh.
fn check_design(dataset: &Dataset, design: &SkinDesign) -> Result<(), LearnError> {
    let wrong = |message: String| LearnError::Data { folder: dataset.folder().to_path_buf(), message };
    match dataset.manifest().record.other_table(design).map_err(|error| wrong(error.to_string()))? {
        None => Ok(()),
        Some(table) => Err(wrong(format!(
            "its samples are of another design, with another [{table}] than {:?}: train with that design, or simulate this one anew",
            design.name
        ))),
    }
}

impl Training {
    /// The training of a preset on the skin of a forward model.
    ///
    /// # Errors
    /// Datasets of another design or mesh; recipes that the skin does not allow.
    pub fn new(
        design: &SkinDesign,
        forward: &ForwardModel,
        pixels: Arc<PixelSpace>,
        mut preset: TrainingPreset,
        data: TrainingData,
    ) -> Result<Self, LearnError> {
        let mut datasets: Arc<[Dataset]> = Arc::new([]);
        let sources: [Box<dyn Source>; 2] = match data {
            TrainingData::Files { training, test } => {
                for dataset in training.iter().chain(&test) {
                    check_design(dataset, design)?;
                }
                datasets = training.into();
                let files = |datasets, part| Files::new(datasets, part, forward);
                let (whole, held_out) = (Arc::clone(&datasets), Arc::clone(&datasets));
                match test.is_empty() {
                    true => [Box::new(files(whole, Part::Training)?), Box::new(files(held_out, Part::Test)?)],
                    false => [Box::new(files(whole, Part::All)?), Box::new(files(test.into(), Part::All)?)],
                }
            }
            TrainingData::Stream { recipes } => {
                let stream = |recipe: &Recipe| -> Result<_, LearnError> {
                    let count = usize::try_from(recipe.samples).unwrap_or(usize::MAX);
                    Ok(Box::new(Streamed::new(Generator::new(design, forward, recipe)?, count)))
                };
                [stream(&recipes[0])?, stream(&recipes[1])?]
            }
        };
        let samples = |source| Samples::new(source, forward, &pixels, &preset);
        let [training, test] = sources.map(samples);
        let (training, test) = (training?, test?);
        // A small dataset is one step.
        preset.options.batch = preset.options.batch.min(training.source().len());
        Ok(Training {
            skin: SkinRecord::new(&design.name, forward, &pixels),
            data: datasets,
            training,
            test,
            pixels,
            preset,
        })
    }

    /// The preset.
    pub fn preset(&self) -> &TrainingPreset {
        &self.preset
    }

    /// The training samples.
    pub fn training(&self) -> &Samples {
        &self.training
    }

    /// The test samples.
    pub fn test(&self) -> &Samples {
        &self.test
    }

    /// The network before its first step.
    ///
    /// # Errors
    /// As [`Trainer::new`].
    pub fn trainer(&self) -> Result<Trainer<'_>, LearnError> {
        let TrainingPreset { architecture, input, options, noise, .. } = &self.preset;
        let mut trainer = Trainer::new(architecture, input.clone(), options, &self.training, &self.test)?;
        let datasets: Vec<&str> = self.data.iter().map(|dataset| dataset.manifest().identity.as_str()).collect();
        trainer.origin = serde_json::json!([self.skin, noise, datasets]).to_string();
        Ok(trainer)
    }

    /// The model of a trained network, with the card of this training.
    ///
    /// # Errors
    /// Test samples that cannot be read.
    pub fn model(&self, input: &Input, network: Network, epochs: &[Epoch]) -> Result<Model, LearnError> {
        let record = TrainingRecord {
            options: self.preset.options.clone(),
            samples: self.training.source().len(),
            test_samples: self.test.source().len(),
            target_variance: self.test.target_variance(&self.test.source().order(0, 0))?,
            epochs: epochs.to_vec(),
        };
        let card = self.preset.card(self.skin.clone(), input, &self.data, record);
        Ok(Model::new(card, network, Arc::clone(&self.pixels)))
    }
}
