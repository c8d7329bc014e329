//! Outputs of contacts. None of them can block the pipeline.

pub mod jsonl;
pub mod ros2;
#[cfg(feature = "viewer")]
pub mod viewer;
pub mod watchdog;

#[cfg(all(test, feature = "schema"))]
mod tests;
