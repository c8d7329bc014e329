//! Datasets for training: samples drawn from a seed, solved in batches, and written to crash-safe files.
//!
//! A [`Recipe`] contains the distributions of the samples; a [`Generator`] generates sample `i` from `(seed, i)` only,
//! so that the bytes are the same for any number of threads and any split into [`Shard`]s on one instruction set.
//! [`Run`] writes them to files of 8,192 samples, each written completely or not at all; [`finish`] reads them back,
//! checks them and writes the [`Manifest`]; [`simulate`] does all but the last. [`Generator::stream`] gives the same samples without files.
//!
//! `docs/datasets.md` describes the file format, for use without this library.
//!
//! ```
//! use dermis::design::TouchEffect;
//! use dermis_sim::dataset::{GaussianTouches, Recipe, Skins, Touch};
//!
//! let touch = Touch::Gaussian(GaussianTouches::for_effect(TouchEffect::ConductanceRises));
//! let recipe = Recipe { seed: 1, samples: 8192, touch, skins: Skins::Even };
//! recipe.check(TouchEffect::ConductanceRises)?;
//! assert!(Recipe { samples: 0, ..recipe }.check(TouchEffect::ConductanceRises).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod file;
mod finish;
mod gaussian;
mod generator;
#[cfg(test)]
mod golden;
mod places;
mod press_target;
mod pressed;
mod quadrature;
mod raster;
mod reader;
mod recipe;
mod record;
mod run;
mod sample;
mod simulate;
mod skins;
mod target;
#[cfg(test)]
mod tests;

pub use error::DatasetError;
pub use finish::{Checked, FileRecord, Manifest, Statistics, finish, verify};
pub use generator::{Generator, Stream, Worker};
pub use reader::Dataset;
pub use recipe::{GaussianTouches, MAX_TOUCHES, PatchTouches, Recipe, SkinSpread, Skins, Together, Touch};
pub use record::{DesignRecord, MeshRecord, PixelRecord, Record, TensorRecord};
pub use run::{Run, RunReport, Shard};
pub use sample::{Sample, SampleTouch, TOUCH_COLUMNS, TouchKind, TouchRow};
pub use simulate::{Simulated, simulate};
