//! Sparse Cholesky with separate symbolic and numeric parts, and small dense algebra.
//!
//! The sparse matrices of this crate are symmetric and positive definite, have one pattern for many sets of values, and
//! often end with a few unknowns (the electrodes) of which only the Schur complement is needed. [`Symbolic`] contains
//! the results that depend on the pattern only; [`Factor`] the numbers.

mod assignment;
mod batch;
mod cholesky;
mod dense;
mod dissection;
mod distinct;
mod factor;
mod matrix;
mod normal;
mod pivoted;
mod schur_update;
mod simd_level;
mod substitution;
mod symbolic;
mod tile;

pub use assignment::smallest_total;
pub(crate) use batch::{AlignedVec, pseudo_inverses};
pub use batch::{BadLanes, BatchFactor, BatchPlan, BatchWorkspace, Entries, LANES};
pub use cholesky::Cholesky;
pub(crate) use dense::eliminate_in_place;
pub(crate) use distinct::DistinctColumns;
pub(crate) use factor::Workspace;
pub use factor::{Factor, NotPositiveDefinite};
pub use matrix::Matrix;
pub use normal::dot;
pub(crate) use normal::{add_scaled, gram, products};
pub(crate) use pivoted::semidefinite_root;
pub(crate) use schur_update::UpdateMemory;
pub use simd_level::SimdLevel;
pub(crate) use substitution::SparseColumns;
pub use symbolic::Symbolic;
