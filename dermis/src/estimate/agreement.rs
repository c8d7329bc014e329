//! How much two frames agree beyond chance.
//!
//! Two frames agree as much as their cosine exceeds that of the same values in a random order:
//!
//! `agreement = (cos(a, b) - c) / (1 - c)`, `c = n mean(a) mean(b) / (|a| |b|)`.
//!
//! It does not depend on units and gains: 1 for proportional frames, about 0 for values in a wrong order, of another skin or of
//! noise. Values larger than five times their median size are limited to it, so that single wrong channels hardly count.

use crate::linalg::dot;
use crate::stats::upper_median;

/// Frames that agree less than this with what they are compared with may be wrong. Untouched frames of real tanks and skins
/// agree with an even model by 0.9 and more, touched ones with their baseline by 0.95 and more.
pub const DOUBTFUL: f64 = 0.6;
/// Values are limited to this many times their median size.
const LARGEST: f64 = 5.0;

/// Values of at most some times their median size.
pub(crate) fn limited(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let values: Vec<f64> = values.collect();
    let most = LARGEST * median_size(values.iter().copied());
    values.into_iter().map(|value| if most.is_finite() { value.clamp(-most, most) } else { value }).collect()
}

pub(crate) fn median_size(values: impl Iterator<Item = f64>) -> f64 {
    upper_median(&values.map(f64::abs).collect::<Vec<f64>>()).unwrap_or(f64::NAN)
}

/// The cosine of two lists of limited values beyond that of the same values in a random order, over the most that is possible. 0
/// without values.
pub fn agreement(a: impl Iterator<Item = f64>, b: impl Iterator<Item = f64>) -> f64 {
    let (a, b) = (limited(a), limited(b));
    let sizes = (dot(&a, &a) * dot(&b, &b)).sqrt();
    let chance = a.iter().sum::<f64>() * b.iter().sum::<f64>() / a.len() as f64 / sizes;
    let agreement = (dot(&a, &b) / sizes - chance) / (1.0 - chance);
    if agreement.is_finite() { agreement } else { 0.0 }
}
