//! The factor between a measured frame and that of a model.

use crate::linalg::dot;

/// The factor that minimises the sum of the absolute differences `|measured - factor model|`: the median of the ratios,
/// weighted by the model's absolute values. A touch or some wrong channels hardly change it. `NaN` without a channel whose
/// model is not 0.
pub fn robust(measured: &[f64], model: &[f64], channels: impl IntoIterator<Item = usize>) -> f64 {
    let used = channels.into_iter().filter(|&channel| model[channel] != 0.0);
    let mut ratios: Vec<(f64, f64)> =
        used.map(|channel| (measured[channel] / model[channel], model[channel].abs())).collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut left = 0.5 * ratios.iter().map(|(_, weight)| weight).sum::<f64>();
    let reached = ratios.iter().find(|(_, weight)| {
        left -= weight;
        left <= 0.0
    });
    reached.map_or(f64::NAN, |(ratio, _)| *ratio)
}

/// The factor that minimises `|measured - factor model|^2`; `NaN` for a model of zeros.
///
/// # Panics
/// If the lists differ in length.
pub fn least_squares(measured: &[f64], model: &[f64]) -> f64 {
    assert_eq!(measured.len(), model.len(), "a value of the model for each");
    dot(measured, model) / dot(model, model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_find_a_factor_and_the_robust_one_bears_wrong_channels() {
        let model: Vec<f64> = (0..12).map(|channel| [5.0, -2.0, 1.0][channel % 3]).collect();
        let mut measured: Vec<f64> = model.iter().map(|value| 1.7 * value).collect();
        let exact = least_squares(&measured, &model);
        assert!((exact - 1.7).abs() < 1e-12);
        measured[3] = -40.0;
        measured[7] = 300.0;
        assert!((robust(&measured, &model, 0..12) - 1.7).abs() < 1e-12);
        assert!((least_squares(&measured, &model) - 1.7).abs() > 1.0);
        assert!(robust(&measured, &[0.0; 12], 0..12).is_nan());
    }
}
