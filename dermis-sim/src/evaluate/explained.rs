//! The fraction of the variance of target images that a method's images explain.

/// Fit of images to their targets, with one gain for all.
///
/// With `x` the pixels of all images and `t` those of all targets, the gain is `g = sum x t / sum x^2`, and the
/// unexplained fraction of the variance `sum (g x - t)^2 / sum (t - mean t)^2`: 1 - R^2. A network trained on these
/// targets has a gain of about one; a linear image is blurred and scaled, and the gain corrects the scale.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GainFit {
    pixels: f64,
    image_square: f64,
    product: f64,
    target: f64,
    target_square: f64,
}

impl GainFit {
    /// Adds an image and its target.
    ///
    /// # Panics
    /// If their lengths differ.
    pub fn add(&mut self, image: &[f64], target: &[f64]) {
        assert_eq!(image.len(), target.len(), "an image and its target");
        self.pixels += image.len() as f64;
        for (x, t) in image.iter().zip(target) {
            self.image_square += x * x;
            self.product += x * t;
            self.target += t;
            self.target_square += t * t;
        }
    }

    /// Adds the sums of another fit.
    pub fn merge(&mut self, other: &GainFit) {
        self.pixels += other.pixels;
        self.image_square += other.image_square;
        self.product += other.product;
        self.target += other.target;
        self.target_square += other.target_square;
    }

    /// The least-squares gain of the images.
    pub fn gain(&self) -> f64 {
        self.product / self.image_square
    }

    /// Variance of the targets' pixels.
    pub fn target_variance(&self) -> f64 {
        (self.target_square - self.target * self.target / self.pixels) / self.pixels
    }

    /// The fraction of the targets' variance that the images do not explain, with the best gain; `NaN` without a
    /// target.
    pub fn unexplained(&self) -> f64 {
        (self.target_square - self.gain() * self.product) / self.pixels / self.target_variance()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{sample_rng, standard_normal};

    #[test]
    fn noise_that_is_added_is_what_stays_unexplained() {
        // x = a t + n: with the best gain the fraction s^2 / (a^2 + s^2) of a target of variance one and mean zero is
        // unexplained.
        let mut rng = sample_rng(8, 0);
        let (a, s) = (0.2, 0.1);
        let mut fit = GainFit::default();
        for _ in 0..200 {
            let target: Vec<f64> = (0..500).map(|_| standard_normal(&mut rng)).collect();
            let image: Vec<f64> = target.iter().map(|t| a * t + s * standard_normal(&mut rng)).collect();
            fit.add(&image, &target);
        }
        assert!((fit.unexplained() - 0.2).abs() < 0.005, "{}", fit.unexplained());
        assert!((fit.gain() - a / (a * a + s * s)).abs() < 0.02, "{}", fit.gain());
        assert!((fit.target_variance() - 1.0).abs() < 0.02);
        let mut same = GainFit::default();
        same.add(&[1.0, 3.0, 0.0], &[2.0, 6.0, 0.0]);
        assert!(same.unexplained().abs() < 1e-12 && (same.gain() - 2.0).abs() < 1e-12);
        assert!(GainFit::default().unexplained().is_nan());
    }
}
