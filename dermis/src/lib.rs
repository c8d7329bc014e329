//! Electrical resistance tomography skins: sensing, from a design to contacts.
//!
//! A skin's [design](design::SkinDesign) becomes a [mesh](mesh::Mesh), the mesh a [forward
//! model](forward::ForwardModel), which gives [frames](frame::Frame) of voltages and the Jacobian. A [skin](skin::Skin)
//! contains these, prepared once. A [method](method::Method) reconstructs an [image](image::Image) from a frame,
//! [detection](detect) finds the contacts in it, and the [pipeline](pipeline::Pipeline) does this for a stream of
//! frames.
//!
//! Signs, orders, axes and units are those of `docs/conventions.md`: SI everywhere, indices from 0.

#![warn(unreachable_pub)]

// Layer 0
pub mod files;
pub mod geom;
pub mod linalg;
pub mod stats;
pub mod text;
// Layer 1
pub mod contact;
pub mod finding;
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
pub mod estimate;
// Layer 7
pub mod detect;
pub mod fit;
pub mod identify;
pub mod refine;
pub mod track;
// Layer 8
pub mod reconstruct;
// Layer 9
pub mod skin;
// Layer 10
pub mod method;
pub mod plausibility;
// Layer 11
pub mod pipeline;

mod error;
pub use error::{Error, Result};

/// The README's code compiles and runs.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
