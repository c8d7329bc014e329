//! The card of a model: its provenance and its settings.

use crate::input::Input;
use crate::network::Architecture;
use crate::options::{Epoch, Noise, Target, TrainOptions};
use dermis::detect::DetectOptions;
use serde::{Deserialize, Serialize};

/// The complete description of a model without its weights: `card.json` in its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// "dermis model" and the version of the format.
    pub format: String,
    /// The version of this library.
    pub version: String,
    /// The name of the network: "paper", "spots".
    pub name: String,
    /// The skin it was trained for.
    pub skin: SkinRecord,
    /// The architecture of the network.
    #[serde(rename = "plan")]
    pub architecture: Architecture,
    /// The conversion of a difference to its inputs.
    pub input: Input,
    /// The quantity of its output.
    pub target: Target,
    /// Noise and disturbances of its training inputs.
    pub noise: Noise,
    /// Number of symmetries of the skin used for augmentation.
    pub symmetries: usize,
    /// Detection options for its images.
    #[serde(default)]
    pub detection: DetectOptions,
    /// Its training data.
    pub data: Vec<DataRecord>,
    /// The record of its training.
    pub training: TrainingRecord,
}

impl Card {
    /// The version of the format of a model's folder; other versions are not read.
    pub const FORMAT: &str = "dermis model 1";
}

/// The skin of a model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkinRecord {
    /// The design's name.
    pub(crate) design: String,
    /// The mesh's fingerprint, [`Mesh::hash`](dermis::mesh::Mesh::hash).
    pub(crate) mesh: String,
    /// SHA-256 of the protocol as a channel table.
    pub(crate) protocol_sha256: String,
    /// Values of a frame.
    pub(crate) channels: usize,
    /// Values of an image.
    pub(crate) pixels: usize,
}

/// A dataset that a model was trained on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataRecord {
    /// The dataset's identity.
    pub(crate) identity: String,
    /// The distributions of its samples: a recipe, as its TOML file has it.
    pub(crate) recipe: serde_json::Value,
}

/// The record of a training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRecord {
    /// The options.
    pub options: TrainOptions,
    /// Number of training samples.
    pub samples: usize,
    /// Number of test samples.
    pub test_samples: usize,
    /// Variance of the test samples' targets: the loss of a network whose output is always their mean.
    pub target_variance: f64,
    /// The epochs.
    pub epochs: Vec<Epoch>,
}
