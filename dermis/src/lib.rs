//! Touch for robots, from a handful of electrodes.
//!
//! A skin's [design](design::SkinDesign) becomes a [mesh](mesh::Mesh), the mesh a
//! [forward model](forward::ForwardModel); the forward model makes [frames](frame::Frame) of voltages
//! and the Jacobian; a [reconstruction](reconstruct::Reconstruct) makes an [image](image::Image) from a
//! frame; [detection](detect) finds the contacts in it, and [evaluation](evaluate) scores them against
//! the truth.
//!
//! Signs, orders, axes and units are those of `docs/conventions.md`: SI everywhere, indices from 0.

// Layer 0
pub mod geom;
pub mod linalg;
pub mod stats;
// Layer 1
pub mod contact;
pub mod protocol;
// Layer 2
pub mod design;
pub mod frame;
// Layer 3
pub mod mesh;
// Layer 4
pub mod fem;
pub mod image;
// Layer 5
pub mod forward;
// Layer 6
pub mod detect;
pub mod track;
// Layer 7
pub mod reconstruct;
// Layer 8
pub mod skin;
// Layer 9
pub mod method;
// Layer 10
pub mod pipeline;

mod error;
pub use error::{Error, Result};

/// The README's code compiles and does what it says.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
