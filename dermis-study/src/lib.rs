//! The study of the paper “An ERT-based Robotic Skin with Sparsely Distributed Electrodes”: its experiments on
//! simulated skins, compared with the figures in the paper.
//!
//! - [`demo`]: the paper's 900 indentations in simulation, and the objects in recordings of a real tank;
//! - [`reproduce`]: sections II to IV of the paper on digital twins, as a page and as numbers;
//! - [`metrics`]: the figures for the comparison of methods.
//!
//! Nothing here prints. Long computations report to a [`Progress`].

#![warn(unreachable_pub)]

mod comparison;
pub mod demo;
mod error;
pub mod metrics;
mod plots;
pub mod progress;
pub mod reproduce;

pub use error::{Error, Result};
pub use plots::localisation_scene;
pub use progress::{Progress, Task};

/// The results of a study: a table with remarks, and the numbers as JSON.
#[derive(Debug, Clone)]
pub struct StudyOutput {
    /// Text for a terminal.
    pub text: String,
    /// JSON, SI units.
    pub json: String,
}

/// A value as JSON, with a trailing newline.
pub(crate) fn to_json(value: &impl serde::Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Error::Internal(error.to_string()))?;
    Ok(format!("{text}\n"))
}
