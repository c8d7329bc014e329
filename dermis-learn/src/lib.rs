//! Neural networks that reconstruct images of touch from the frames of a skin: architecture, inference and, with the
//! feature `train`, training.

#![warn(unreachable_pub)]
#![cfg_attr(not(feature = "train"), expect(dead_code, reason = "the backward passes of the kernels are for training"))]

mod card;
mod error;
mod inference;
mod input;
mod kernel;
mod methods;
mod model;
mod network;
mod onnx;
mod options;
mod shipped;
mod tensors;
#[cfg(feature = "train")]
mod training;

pub use card::{Card, DataRecord, SkinRecord, TrainingRecord};
pub use error::LearnError;
pub use inference::Inference;
pub use input::Input;
pub use methods::methods;
pub use model::Model;
pub use network::{Architecture, LayerSpec, Network, RefinementSpec, Tensor};
pub use options::{DomainRandomization, Epoch, Noise, Schedule, Target, TrainOptions};
pub use shipped::files as shipped_files;
pub use tensors::Precision;
#[cfg(feature = "train")]
pub use training::{
    Ablation, Augmentation, Files, NetworkPreset, Part, SampleSource, Samples, Source, Streamed, Symmetries, Trainer,
    Training, TrainingData, TrainingPreset, TrainingRun, TrainingRunOptions,
};
