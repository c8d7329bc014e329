//! Estimation: what least squares, noise, scales, drift and whitening are, once for all that use them.

pub mod agreement;
pub mod drift;
pub mod least_squares;
pub mod noise;
pub mod reciprocal_pairs;
pub mod scale;
pub mod whitening;
