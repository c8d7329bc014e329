//! Adam's step (Kingma and Ba, 2015, arXiv 1412.6980, Algorithm 1, in the form of its section 2 that Keras uses).

use pulp::{Simd, WithSimd};

/// Parameters of Adam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AdamOptions {
    /// Decay of the mean gradient.
    pub beta1: f32,
    /// Decay of the mean square.
    pub beta2: f32,
    /// Added to the square root of the mean square.
    pub epsilon: f32,
}

impl Default for AdamOptions {
    /// Keras' defaults.
    fn default() -> Self {
        AdamOptions { beta1: 0.9, beta2: 0.999, epsilon: 1e-7 }
    }
}

impl AdamOptions {
    /// The learning rate of step `step` (from 1), corrected for moving averages that start at zero.
    pub(crate) fn corrected(&self, rate: f32, step: u64) -> f32 {
        let (first, second) = (f64::from(self.beta1).powf(step as f64), f64::from(self.beta2).powf(step as f64));
        (f64::from(rate) * (1.0 - second).sqrt() / (1.0 - first)) as f32
    }
}

/// One step of some values.
#[derive(Debug)]
pub(crate) struct AdamStep<'a> {
    /// Parameters of Adam.
    pub options: AdamOptions,
    /// The corrected learning rate.
    pub rate: f32,
    /// The trained values.
    pub values: &'a mut [f32],
    /// The gradient of the loss with respect to each value.
    pub gradient: &'a [f32],
    /// Moving average of the gradient.
    pub mean: &'a mut [f32],
    /// Moving average of its square.
    pub square: &'a mut [f32],
}

impl WithSimd for AdamStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let AdamOptions { beta1, beta2, epsilon } = self.options;
        let moments = self.mean.iter_mut().zip(self.square.iter_mut());
        for ((value, &gradient), (mean, square)) in self.values.iter_mut().zip(self.gradient).zip(moments) {
            *mean += (1.0 - beta1) * (gradient - *mean);
            *square += (1.0 - beta2) * (gradient * gradient - *square);
            *value -= self.rate * *mean / (square.sqrt() + epsilon);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_rate_against_the_gradient_and_a_bowl_is_descended() {
        let options = AdamOptions::default();
        let (mut values, mut mean, mut square) = (vec![1.0f32, -2.0], vec![0.0; 2], vec![0.0; 2]);
        for step in 1..=4000 {
            let gradient = [2.0 * values[0], 0.02 * values[1]];
            let rate = options.corrected(1e-3, step);
            crate::kernel::run(AdamStep {
                options,
                rate,
                values: &mut values,
                gradient: &gradient,
                mean: &mut mean,
                square: &mut square,
            });
            if step == 1 {
                assert!((values[0] - 0.999).abs() < 1e-6 && (values[1] + 1.999).abs() < 1e-6, "{values:?}");
            }
        }
        assert!(values.iter().all(|value| value.abs() < 0.05), "{values:?}");
    }
}
