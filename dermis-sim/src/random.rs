//! Seeded streams of random numbers. A stream depends on its seed and index alone.
//!
//! ```
//! use dermis_sim::random::{sample_rng, standard_normal};
//!
//! let draw = |seed, index| standard_normal(&mut sample_rng(seed, index));
//! assert_eq!(draw(7, 0), draw(7, 0));
//! assert_ne!(draw(7, 0), draw(7, 1));
//! ```

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// The random numbers of sample `index` under a seed; they depend on nothing else.
pub fn sample_rng(seed: u64, index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    rng
}

/// A standard normal deviate (Box and Muller, 1958, DOI 10.1214/aoms/1177706645).
pub fn standard_normal(rng: &mut ChaCha8Rng) -> f64 {
    let uniform: f64 = rng.random();
    let angle: f64 = rng.random();
    // 1 - u lies in (0, 1], so that the logarithm is finite.
    (-2.0 * (1.0 - uniform).ln()).sqrt() * (TAU * angle).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_depends_on_its_seed_and_index_alone() {
        let draw = |seed, index| standard_normal(&mut sample_rng(seed, index));
        assert_eq!(draw(1, 5), draw(1, 5));
        assert_ne!(draw(1, 5), draw(1, 6));
        assert_ne!(draw(1, 5), draw(2, 5));
    }
}
