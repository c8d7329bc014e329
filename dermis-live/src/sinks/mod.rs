//! Outputs of contacts. None of them can block the pipeline.

pub mod jsonl;
pub mod ros2;
pub mod viewer;
pub mod watchdog;

#[cfg(test)]
mod tests;
