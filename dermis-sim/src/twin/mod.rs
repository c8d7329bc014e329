//! A twin of the skin: touches and electronics that behave like the real ones.
//!
//! The paper's skin is a conductive coat under a grid of highly conductive fabric patches and a layer of foam. A press
//! spreads through the foam and joins some patches to the coat; current then takes the way through the patch, which is
//! one equipotential whose net current is zero. From this follow what the Gaussian touches of [`touch`](crate::touch)
//! do not show: steps of a patch's size, saturation, and touches that do not add up.

mod contact_law;
mod coverage;
pub mod electronics;
mod error;
mod faults;
mod field;
mod imperfections;
mod options;
mod patched;
mod patches;
mod press;
mod shipped;
mod skin;
mod strength;

pub use contact_law::ContactLaw;
pub use error::TwinError;
pub use faults::{CutOptions, FaultOptions};
pub use field::{CorrelatedField, FieldPlaces};
pub use imperfections::{CoatOptions, DriftOptions, ElectrodeOptions, TemperatureOptions};
pub use options::{GaussianOptions, PressOptions, TouchOptions, TwinOptions};
pub use patched::{ContactHistory, MOMENT_DEGREE, PatchedSkin};
pub use patches::{PatchGrid, PatchOptions};
pub use press::{Foam, Footprint, Press};
pub use skin::Twin;

#[cfg(test)]
mod tests;
