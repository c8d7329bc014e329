//! The card of a model: its provenance and its settings.

use crate::input::Input;
use crate::network::Architecture;
use crate::samples::{Noise, Target};
use crate::train::{Epoch, TrainOptions};
use dermis::detect::DetectOptions;
use dermis_sim::dataset::Recipe;
use serde::{Deserialize, Serialize};

/// Everything about a model but its weights: `card.json` in its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// "dermis model" and the version of the format.
    pub format: String,
    /// The version of this library.
    pub version: String,
    /// How the network is called: "paper", "best".
    pub name: String,
    /// The skin it was trained for.
    pub skin: SkinRecord,
    /// The shape of the network.
    pub plan: Architecture,
    /// How a difference becomes its inputs.
    pub input: Input,
    /// What it makes.
    pub target: Target,
    /// What its training inputs were disturbed by.
    pub noise: Noise,
    /// By how many symmetries of the skin each sample was multiplied.
    pub symmetries: usize,
    /// How contacts are found in its images.
    #[serde(default)]
    pub detection: DetectOptions,
    /// What it was trained on.
    pub data: Vec<DataRecord>,
    /// How its training went.
    pub training: TrainingRecord,
}

impl Card {
    /// The version of what stands in a model's folder; another one is not read.
    pub const FORMAT: &str = "dermis model 1";
}

/// The skin of a model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkinRecord {
    /// The design's name.
    pub design: String,
    /// The mesh's fingerprint, [`Mesh::hash`](dermis::mesh::Mesh::hash).
    pub mesh: String,
    /// SHA-256 of the protocol as a channel table.
    pub protocol_sha256: String,
    /// Values of a frame.
    pub channels: usize,
    /// Values of an image.
    pub pixels: usize,
}

/// A dataset that a model was trained on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataRecord {
    /// The dataset's identity.
    pub identity: String,
    /// What it was drawn from.
    pub recipe: Recipe,
}

/// How a training went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRecord {
    /// What was asked for.
    pub options: TrainOptions,
    /// Samples that were trained on.
    pub samples: usize,
    /// Samples that were tested by.
    pub test_samples: usize,
    /// Variance of the test samples' targets, what a network that always makes their mean would lose.
    pub target_variance: f64,
    /// The epochs.
    pub epochs: Vec<Epoch>,
}
