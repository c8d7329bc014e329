//! Demonstrations of Dermis, and the comparison of methods on simulated skins, with pictures and tables.
//!
//! - [`demo`]: the paper's 900 indentations in simulation, and the objects in recordings of a real tank;
//! - [`comparison`]: the methods that reports compare, and their results;
//! - [`plots`]: pictures of an experiment;
//! - [`metrics`]: the figures of a method on a digital twin.
//!
//! Nothing here prints. Long computations report to a [`Progress`].

#![warn(unreachable_pub)]

pub mod comparison;
pub mod demo;
mod error;
pub mod metrics;
pub mod plots;
pub mod progress;

pub use error::{Error, Result};
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
///
/// # Errors
/// A value that JSON cannot represent.
pub fn to_json(value: &impl serde::Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(value).map_err(|error| Error::Internal(error.to_string()))?;
    Ok(format!("{text}\n"))
}
