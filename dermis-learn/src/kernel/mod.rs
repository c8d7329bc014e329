//! The arithmetic of networks, in single precision: matrix products, convolutions, sums over batches.
//!
//! Loops over vectors are `pulp::WithSimd` implementations, compiled for every instruction set and selected at run
//! time.

pub(crate) mod conv2d;
pub(crate) mod matrix;
#[cfg(feature = "train")]
pub(crate) mod norm;

/// Runs an operation with the best instruction set of this machine.
pub(crate) fn run<O: pulp::WithSimd>(operation: O) -> O::Output {
    pulp::Arch::new().dispatch(operation)
}
