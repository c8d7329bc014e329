//! Seeded streams of random numbers and the deviates drawn from them. A stream depends only on its seed and index, and
//! a deviate has the same bits on every system.
//!
//! ```
//! use dermis_sim::random::{sample_rng, standard_normal};
//!
//! let draw = |seed, index| standard_normal(&mut sample_rng(seed, index));
//! assert_eq!(draw(7, 0), draw(7, 0));
//! assert_ne!(draw(7, 0), draw(7, 1));
//! ```

use crate::elementary::{cos, exp, ln, ln_1p, sin_cos};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// The random numbers of sample `index` for a seed; they depend on nothing else.
pub fn sample_rng(seed: u64, index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    rng
}

/// Uniform between two bounds.
pub fn uniform(rng: &mut impl Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// Between two bounds, uniform in its logarithm.
pub fn log_uniform(rng: &mut impl Rng, [low, high]: [f64; 2]) -> f64 {
    low * exp(ln(high / low) * rng.random::<f64>())
}

/// A standard normal deviate (Box and Muller, 1958, DOI 10.1214/aoms/1177706645).
pub fn standard_normal(rng: &mut impl Rng) -> f64 {
    let (radius, angle_rad) = polar(rng);
    radius * cos(angle_rad)
}

/// Two independent standard normal deviates at the cost of one.
pub(crate) fn standard_normal_pair(rng: &mut impl Rng) -> [f64; 2] {
    let (radius, angle_rad) = polar(rng);
    let (sine, cosine) = sin_cos(angle_rad);
    [radius * cosine, radius * sine]
}

/// A sequence of standard normal deviates, drawn in pairs.
#[derive(Debug, Clone, Default)]
pub struct Normal {
    spare: Option<f64>,
}

impl Normal {
    /// The next deviate, in single precision.
    pub fn next(&mut self, rng: &mut impl Rng) -> f32 {
        let deviate = self.spare.take().unwrap_or_else(|| {
            let [first, second] = standard_normal_pair(rng);
            self.spare = Some(second);
            first
        });
        deviate as f32
    }
}

/// A point of the plane whose coordinates are independent standard normal deviates.
fn polar(rng: &mut impl Rng) -> (f64, f64) {
    let uniform: f64 = rng.random();
    let angle: f64 = rng.random();
    // 1 - u is in (0, 1], so that the logarithm is finite.
    ((-2.0 * ln(1.0 - uniform)).sqrt(), TAU * angle)
}

/// The log-normal factor of mean 1 and a given standard deviation, for a standard normal deviate.
pub(crate) fn log_normal(sd: f64, deviate: f64) -> f64 {
    let variance = ln_1p(sd * sd);
    exp(variance.sqrt() * deviate - 0.5 * variance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::stats::mean_and_sd;

    #[test]
    fn a_sample_depends_on_its_seed_and_index_alone() {
        let draw = |seed, index| standard_normal(&mut sample_rng(seed, index));
        assert_eq!(draw(1, 5), draw(1, 5));
        assert_ne!(draw(1, 5), draw(1, 6));
        assert_ne!(draw(1, 5), draw(2, 5));
        assert_eq!(standard_normal_pair(&mut sample_rng(1, 5))[0], draw(1, 5));
    }

    #[test]
    fn deviates_have_the_moments_of_their_distributions() {
        let mut rng = sample_rng(9, 0);
        let pairs: Vec<[f64; 2]> = (0..20_000).map(|_| standard_normal_pair(&mut rng)).collect();
        let all: Vec<f64> = pairs.iter().flatten().copied().collect();
        // A mean of 40,000 has a standard error of 0.005, a standard deviation one of 0.0035.
        let (mean, sd) = mean_and_sd(&all);
        assert!(mean.abs() < 0.02 && (sd - 1.0).abs() < 0.015, "{mean} {sd}");
        let product = pairs.iter().map(|[a, b]| a * b).sum::<f64>() / 2e4;
        assert!(product.abs() < 0.03, "independent: {product}");
        let (mean, sd) = mean_and_sd(&all.iter().map(|&deviate| log_normal(0.3, deviate)).collect::<Vec<_>>());
        assert!((mean - 1.0).abs() < 0.007 && (sd - 0.3).abs() < 0.009, "{mean} {sd}");
        let logs: Vec<f64> = (0..20_000).map(|_| log_uniform(&mut rng, [0.1, 10.0]).ln() / 10f64.ln()).collect();
        let (mean, sd) = mean_and_sd(&logs);
        assert!(mean.abs() < 0.02 && (sd - 3f64.sqrt().recip()).abs() < 0.01, "{mean} {sd}");
    }
}
