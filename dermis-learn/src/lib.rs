//! Neural networks that reconstruct images of touch from the frames of a skin: architecture, training and inference.

#![warn(unreachable_pub)]

mod card;
mod checkpoint;
mod error;
mod inference;
mod input;
mod kernel;
mod methods;
mod model;
mod network;
mod onnx;
mod preset;
mod samples;
mod shipped;
mod source;
mod symmetry;
mod tensors;
mod train;
mod train_pass;
mod training;

pub use card::{Card, DataRecord, SkinRecord, TrainingRecord};
pub use error::LearnError;
pub use inference::Inference;
pub use input::Input;
pub use methods::methods;
pub use model::Model;
pub use network::{Architecture, LayerSpec, Network, RefinementSpec, Tensor};
pub use preset::{Ablation, TrainingPreset};
pub use samples::{Augmentation, DomainRandomization, Noise, Samples, Target};
pub use shipped::files as shipped_files;
pub use source::{Files, Part, Source, Streamed};
pub use symmetry::Symmetries;
pub use tensors::Precision;
pub use train::{Epoch, Schedule, TrainOptions, Trainer};
pub use training::{Training, TrainingData};
