//! The smallest force that a method detects at a fixed rate of false contacts.

use crate::experiment::UNTOUCHED_FRAMES;
use crate::twin::{Press, Twin};
use dermis::contact::GATE_M;
use dermis::detect::{DetectOptions, ImageNoise};
use dermis::frame::{Frame, mean};
use dermis::geom::Point3;
use dermis::image::Image;
use dermis::reconstruct::Reconstruct;
use dermis::stats::{self, inverse_cdf_quantile, sorted};
use rayon::prelude::*;

/// One false contact per hour at 120 frames per second.
pub(crate) const FALSE_CONTACTS_A_FRAME: f64 = 1.0 / (3600.0 * 120.0);
/// The fraction of the untouched frames with the highest peaks, whose tail is extrapolated.
const TAIL: f64 = 0.01;
/// A contact whose peak is this many standard deviations above the threshold is detected 90 % of the time (the 90 %
/// quantile of a normal deviate).
const FOUND_SD: f64 = 1.281_551_565_544_6;
/// Range of the search for the smallest force, N; number of bisections of their ratio.
const FORCES_N: [f64; 2] = [1e-3, 7.0];
const HALVINGS: usize = 12;

/// A method whose images have a known noise.
#[derive(Clone, Copy)]
pub(super) struct Finder<'a> {
    pub method: &'a dyn Reconstruct,
    pub noise: &'a ImageNoise,
}

impl Finder<'_> {
    /// The threshold that an untouched frame exceeds once per hour, in standard deviations of the noise, and its
    /// standard error.
    pub(super) fn threshold(&self, untouched: &[Frame]) -> crate::Result<(f64, f64)> {
        let detection = self.method.detection();
        let highest = |frame: &Frame| Ok(in_sd(&self.method.reconstruct(frame)?, self.noise, &detection, |_| true));
        Ok(threshold(&untouched.par_iter().map(highest).collect::<crate::Result<Vec<f64>>>()?))
    }

    /// The smallest force detected 90 % of the time at a threshold at each of some positions, N; `NaN` if there is
    /// none.
    pub(super) fn least_forces(
        &self,
        twin: &Twin,
        noise_factor: f64,
        places: &[Point3],
        on_step: &(impl Fn(usize) + Sync),
    ) -> crate::Result<Vec<f64>> {
        let (rest, detection) = (twin.clean(&[])?, self.method.detection());
        let pixels = self.method.pixels();
        let least = |&centre_m: &Point3| {
            let is_found = |force_n: f64| {
                let press = Press { centre_m, force_n, tip_radius_m: twin.options().press.tip_radius_m };
                let image = self.method.reconstruct(&(&twin.clean(&[press])? - &rest))?;
                let near = |pixel: usize| pixels.surface.distance_m(pixels.centres_m[pixel], centre_m) <= GATE_M;
                Ok::<bool, crate::Error>(in_sd(&image, self.noise, &detection, near) >= noise_factor + FOUND_SD)
            };
            let force_n = smallest(is_found)?;
            on_step(1);
            Ok(force_n)
        };
        places.par_iter().map(least).collect()
    }
}

/// Differences of untouched frames from the mean of the hundred before them.
pub(super) fn untouched_differences(
    twin: &Twin,
    first_index: u64,
    count: usize,
    on_step: &(impl Fn(usize) + Sync),
) -> crate::Result<Vec<Frame>> {
    let frame = |index: u64| {
        on_step(1);
        twin.frame(&[], first_index + index)
    };
    let frames =
        (0..UNTOUCHED_FRAMES + count as u64).into_par_iter().map(frame).collect::<crate::Result<Vec<Frame>>>()?;
    let (first, rest) = frames.split_at(UNTOUCHED_FRAMES as usize);
    let baseline = mean(first).expect("there are untouched frames");
    Ok(rest.iter().map(|frame| frame - &baseline).collect())
}

/// The smallest force for which a condition holds, by bisection in the logarithm; `NaN` if it holds for no force.
fn smallest(holds: impl Fn(f64) -> crate::Result<bool>) -> crate::Result<f64> {
    let [mut low, mut high] = FORCES_N;
    if !holds(high)? {
        return Ok(f64::NAN);
    }
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if holds(middle)? { high = middle } else { low = middle }
    }
    Ok(high)
}

/// The highest ratio of an image to its noise among the pixels that are high enough for the detector; peaks of noise are
/// about equally strong, so its least strength is left out. If the image
/// is the square of the noisy quantity (touches as spots in its square root), the square root is divided by its noise:
/// the signed square of a normal deviate of standard deviation s has `sqrt(3) s^2`.
fn in_sd(image: &Image, noise: &ImageNoise, detection: &DetectOptions, counts: impl Fn(usize) -> bool) -> f64 {
    let highest = image.values.iter().copied().fold(0.0, f64::max);
    let least = detection.peak_fraction * highest;
    let pixels = image.values.iter().zip(noise.sd()).enumerate();
    let most = pixels
        .filter(|(pixel, (value, _))| **value >= least && counts(*pixel))
        .map(|(_, (value, sd))| value / sd)
        .fold(0.0, f64::max);
    if detection.spot_width_m.is_some() { (3f64.sqrt() * most).sqrt() } else { most }
}

/// The peak that an untouched frame exceeds once per hour, and its standard error: beyond a high quantile the tail of
/// such a distribution decreases exponentially (peaks over threshold: Pickands, 1975, DOI 10.1214/aos/1176343003, with
/// shape 0, the limit of normal maxima, from which it deviates upwards).
fn threshold(peaks: &[f64]) -> (f64, f64) {
    let sorted = sorted(peaks.iter().copied());
    let count = ((sorted.len() as f64 * TAIL).round() as usize).clamp(1, sorted.len());
    let begin = sorted[sorted.len() - count];
    let excess = stats::mean(&sorted[sorted.len() - count..]) - begin;
    let part = count as f64 / sorted.len() as f64;
    let further = (part / FALSE_CONTACTS_A_FRAME).ln().max(0.0);
    (begin + excess * further, excess * further / (count as f64).sqrt())
}

/// Median and 95th percentile of the smallest forces detected at some positions, N; a position without one counts as
/// infinite.
pub(super) fn median_and_p95(forces_n: &[f64]) -> [f64; 2] {
    let forces = sorted(forces_n.iter().map(|force| if force.is_nan() { f64::INFINITY } else { *force }));
    [0.5, 0.95].map(|part| inverse_cdf_quantile(&forces, part).unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{sample_rng, standard_normal};

    #[test]
    fn the_threshold_is_exceeded_once_an_hour() {
        // Maximum of 50 independent normal deviates: P(max > k) = 1 - Phi(k)^50 = 1 / 432,000 at k = 5.374 (Phi(-5.374)
        // = 3.85e-8 and 50 times that 1 / 519,000; at 5.34 it is 1 / 430,000).
        let peak = |frame: u64| {
            let mut rng = sample_rng(3, frame);
            (0..50).map(|_| standard_normal(&mut rng)).fold(0.0, f64::max)
        };
        let (factor, error) = threshold(&(0..40_000).map(peak).collect::<Vec<f64>>());
        println!("threshold {factor:.2} +- {error:.2}, exactly 5.34");
        assert!(factor > 5.34 - 2.0 * error && factor < 5.34 + 0.35 + 2.0 * error, "{factor} +- {error}");
    }

    #[test]
    fn the_smallest_force_is_found_by_halving() {
        let found = smallest(|force| Ok(force >= 0.37)).expect("no error");
        assert!((found / 0.37 - 1.0).abs() < 3e-3 && found >= 0.37, "{found}");
        assert!(smallest(|_| Ok(false)).expect("no error").is_nan());
        assert_eq!(median_and_p95(&[0.1, 0.2, f64::NAN]), [0.2, f64::INFINITY]);
        assert!(median_and_p95(&[])[0].is_nan());
    }
}
