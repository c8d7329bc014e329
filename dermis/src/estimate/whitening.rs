//! Whitening of values with white noise and disturbances.

use crate::linalg::{add_scaled, dot};

/// A linear transform of values with the covariance `I + sum_k u_k u_k'` to values with the covariance `I`.
///
/// Each step makes one disturbance part of the white noise: `I - a u u'` is the inverse square root of `I + u u'` for
/// `a = (1 - 1 / sqrt(1 + u'u)) / u'u`. The disturbances that follow are transformed by it first.
#[derive(Debug, Clone, Default)]
pub struct Whitening {
    /// Of each disturbance `u`, and `a`.
    steps: Vec<(Vec<f64>, f64)>,
}

impl Whitening {
    /// For white noise of 1 and disturbances, each as long as its standard deviation. One that is zero or not finite has no
    /// effect.
    pub fn new(disturbances: impl IntoIterator<Item = Vec<f64>>) -> Self {
        Whitening::default().with(disturbances)
    }

    /// With more disturbances.
    #[must_use]
    pub fn with(mut self, disturbances: impl IntoIterator<Item = Vec<f64>>) -> Self {
        for mut disturbance in disturbances {
            self.apply(&mut disturbance);
            let square = dot(&disturbance, &disturbance);
            if square > 0.0 && square.is_finite() {
                let factor = (1.0 - (1.0 + square).sqrt().recip()) / square;
                self.steps.push((disturbance, factor));
            }
        }
        self
    }

    /// Whitens values.
    ///
    /// # Panics
    /// If a disturbance has more values.
    pub fn apply(&self, values: &mut [f64]) {
        for (disturbance, factor) in &self.steps {
            add(values, disturbance, -factor);
        }
    }

    /// The product of the transposed transform with some values.
    ///
    /// # Panics
    /// As [`apply`](Self::apply).
    pub fn apply_transposed(&self, values: &mut [f64]) {
        for (disturbance, factor) in self.steps.iter().rev() {
            add(values, disturbance, -factor);
        }
    }

    /// The values before they were whitened.
    ///
    /// # Panics
    /// As [`apply`](Self::apply).
    pub fn undo(&self, values: &mut [f64]) {
        for (disturbance, factor) in self.steps.iter().rev() {
            add(values, disturbance, factor / (1.0 - factor * dot(disturbance, disturbance)));
        }
    }
}

/// Adds a direction times the product with it.
fn add(values: &mut [f64], direction: &[f64], factor: f64) {
    add_scaled(values, factor * dot(values, direction), direction);
}
#[cfg(test)]
mod tests {
    use super::*;

    /// Applied to the columns of a square root of the covariance, the transform gives those of an orthogonal matrix:
    /// `T (I + U U') T' = I`.
    #[test]
    fn the_covariance_becomes_the_identity() {
        let count = 7_usize;
        let disturbances: Vec<Vec<f64>> = (0..3)
            .map(|k: i32| (0..count).map(|i| (3.0 * i as f64 + f64::from(k)).sin() * 10f64.powi(k)).collect())
            .collect();
        let whitening = Whitening::new(disturbances.clone());
        let unit = |i: usize| (0..count).map(move |j| f64::from(u8::from(i == j))).collect::<Vec<f64>>();
        let columns: Vec<Vec<f64>> = (0..count).map(unit).chain(disturbances).collect();
        let transformed: Vec<Vec<f64>> = (columns.into_iter())
            .map(|mut column| {
                whitening.apply(&mut column);
                column
            })
            .collect();
        for i in 0..count {
            for j in 0..count {
                let product: f64 = transformed.iter().map(|column| column[i] * column[j]).sum();
                assert!((product - f64::from(u8::from(i == j))).abs() < 1e-10, "{i} {j}: {product}");
            }
        }
    }

    #[test]
    fn the_transposed_transform_has_the_same_products() {
        let [a, b] = [3.0, 11.0].map(|factor| (0..6).map(|i| (factor * f64::from(i)).sin()).collect::<Vec<f64>>());
        let whitening = Whitening::new([a.clone(), b.iter().map(|value| 30.0 * value).collect()]);
        let [mut there, mut back] = [a.clone(), b.clone()];
        whitening.apply(&mut there);
        whitening.apply_transposed(&mut back);
        assert!((dot(&there, &b) - dot(&a, &back)).abs() < 1e-12);
        assert!(there.iter().zip(&a).any(|(there, a)| (there - a).abs() > 0.1));
    }

    #[test]
    fn whitening_is_undone() {
        let values: Vec<f64> = (0..5).map(|i| f64::from(i) - 1.7).collect();
        let whitening = Whitening::new([vec![1.0, 2.0, 0.0, -1.0, 3.0], vec![0.0; 5], vec![0.1, 0.0, 50.0, 2.0, 0.0]]);
        let mut there = values.clone();
        whitening.apply(&mut there);
        assert!((there[2] - values[2]).abs() > 0.1);
        whitening.undo(&mut there);
        assert!(there.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
