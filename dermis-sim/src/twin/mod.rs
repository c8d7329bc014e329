//! Digital twins: simulated skins with realistic touches, imperfections and electronics.
//!
//! The paper's skin is a conductive coating under a grid of highly conductive fabric patches and a layer of foam. A
//! press spreads through the foam and brings some patches into contact with the coating; current then flows through the
//! patch, which is one equipotential with zero net current. This gives effects that the Gaussian touches of
//! [`touch`](crate::touch) do not have: steps of a patch's size, saturation, and touches that do not add up. Other
//! skins are patches of another shape in another lattice, and a continuous layer whose own conductance rises.
//! ```
//! use dermis::design::SkinDesign;
//! use dermis_sim::twin::{Press, Twin, TwinOptions};
//!
//! let design = SkinDesign::load("skin16")?;
//! let mut options = TwinOptions::load("ideal")?;
//! options.mesh_scale = 2.0;
//! let twin = Twin::new(&design, &options, 1)?;
//! let press = Press { centre_m: [0.01, 0.0, 0.0], force_n: 1.0, tip_radius_m: 0.005 };
//! assert!(twin.frame(&[press], 0)? != twin.frame(&[], 0)?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod contact_law;
mod coverage;
pub mod electronics;
mod error;
mod faults;
mod field;
mod foam;
mod imperfections;
mod layer;
mod load;
mod options;
mod patch_shape;
mod patched;
mod patches;
mod press;
mod sheet;
mod shipped;
mod skin;
mod strength;

pub use contact_law::ContactLaw;
pub use error::TwinError;
pub use faults::{CutOptions, FaultOptions, ReferenceOptions, ShortOptions};
pub(crate) use field::FieldPlaces;
pub use foam::{Foam, Indentation};
pub use imperfections::{CoatOptions, DriftOptions, ElectrodeOptions, TemperatureOptions};
pub use layer::LayerOptions;
pub use options::{GaussianOptions, PressOptions, TouchOptions, TwinOptions};
pub use patch_shape::{PatchLattice, PatchShape};
pub use patched::{ContactHistory, MOMENT_DEGREE, PatchedSkin};
pub use patches::PatchOptions;
pub(crate) use press::Footprint;
pub use press::Press;
pub(crate) use press::{FORCES_N, TIP_RADII_M};
pub use skin::Twin;

#[cfg(test)]
mod tests;
