//! Simulated skins: touch models, measurement noise, digital twins, datasets, experiments, and scores of methods on
//! them.
//!
//! Sensing does not need this crate: it generates the frames for training, testing and comparing methods.

#![warn(unreachable_pub)]

// Layer 0
pub mod elementary;
// Layer 1
mod quadrature;
pub mod random;
// Layer 2
pub mod touch;
// Layer 3
pub mod noise;
// Layer 4
pub mod twin;
// Layer 5
pub mod bound;
pub mod dataset;
pub mod experiment;
// Layer 6
pub mod evaluate;
pub mod optimise;

mod error;
pub use error::{Error, Result};

/// The code examples of the book compile.
#[cfg(doctest)]
#[doc = include_str!("../../docs/datasets.md")]
struct Datasets;
