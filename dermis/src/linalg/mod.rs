//! Sparse Cholesky, symbolic apart from numeric, and small dense algebra.
//!
//! The sparse matrices of this crate are symmetric and positive definite, share one pattern over many values, and
//! often end in a few unknowns (the electrodes) of which only the Schur complement is wanted. [`Symbolic`] holds all
//! that follows from the pattern; [`Factor`] the numbers.

mod assignment;
mod batch;
mod dense;
mod factor;
mod matrix;
mod simd_level;
mod symbolic;

pub use assignment::smallest_total;
pub(crate) use batch::AlignedVec;
pub use batch::{BadLanes, BatchPlan, BatchWorkspace, Entries, LANES};
pub use dense::{cholesky_in_place, invert_spd};
pub(crate) use dense::{eliminate_in_place, subtract_gram};
pub use factor::{Factor, NotPositiveDefinite, Workspace};
pub use matrix::Matrix;
pub use simd_level::SimdLevel;
pub use symbolic::Symbolic;
