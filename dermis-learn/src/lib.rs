//! Networks that turn the frames of a skin into images of touch: their shape, training and use.

mod card;
mod checkpoint;
mod error;
mod inference;
mod input;
mod kernel;
mod model;
mod network;
mod onnx;
mod recipe;
mod samples;
mod shipped;
mod source;
mod symmetry;
mod tensors;
mod train;
mod train_pass;

pub use card::{Card, DataRecord, SkinRecord, TrainingRecord};
pub use error::LearnError;
pub use inference::Inference;
pub use input::Input;
pub use model::Model;
pub use network::{CHANNELS_TOGETHER, LayerPlan, Network, Plan, RefinementPlan, Tensor};
pub use recipe::{Ingredient, Method};
pub use samples::{Disturb, Misfit, Noise, Samples, Target};
pub use source::{Files, Part, Source, Streamed};
pub use symmetry::Symmetries;
pub use tensors::Precision;
pub use train::{Epoch, Schedule, TrainOptions, Trainer};
pub use train_pass::{Batch, Pass};
