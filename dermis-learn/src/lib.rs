//! Networks that turn the frames of a skin into images of touch: their shape, training and use.

mod checkpoint;
mod error;
mod input;
mod kernel;
mod network;
mod recipe;
mod samples;
mod symmetry;
mod tensors;
mod train;
mod train_pass;

pub use error::LearnError;
pub use input::Input;
pub use network::{CHANNELS_TOGETHER, LayerPlan, Network, Plan, RefinementPlan, Tensor};
pub use recipe::Method;
pub use samples::{Disturb, Noise, Part, Samples, Target};
pub use symmetry::Symmetries;
pub use tensors::Precision;
pub use train::{Epoch, Schedule, TrainOptions, Trainer};
pub use train_pass::{Batch, Pass};
