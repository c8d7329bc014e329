//! Values that are too small or too large against the model.

use dermis::finding::{Finding, FindingKind};
use dermis::stats::upper_median;
use faer::Mat;

/// The untouched values of a sound recording are within this factor of those of the model: sheets differ.
const FACTOR: f64 = 30.0;
/// Changes of a sound recording are between these parts of the model's untouched values.
const CHANGES: [f64; 2] = [1e-4, 30.0];

/// Untouched values over those of the model.
pub(crate) fn of_untouched(untouched: &[f64], model: &[f64]) -> Option<Finding> {
    let ratio = median_size(untouched.iter().copied()) / median_size(model.iter().copied());
    let is_wrong = ratio.is_finite() && !(1.0 / FACTOR..=FACTOR).contains(&ratio);
    let evidence = "median untouched value over that of the model".to_string();
    is_wrong.then(|| Finding::new(FindingKind::Magnitude, ratio, evidence, unit(ratio)))
}

/// Changes over the untouched values of the model.
pub(crate) fn of_changes(differences: &Mat<f64>, model: &[f64]) -> Option<Finding> {
    let rows: Vec<f64> = (0..differences.nrows())
        .map(|row| (differences.row(row).iter().map(|v| v * v).sum::<f64>() / differences.ncols() as f64).sqrt())
        .collect();
    let ratio = upper_median(&rows)? / median_size(model.iter().copied());
    let is_wrong = ratio.is_finite() && ratio > 0.0 && !(CHANGES[0]..=CHANGES[1]).contains(&ratio);
    let evidence = "median change over the median untouched value of the model; 0.001 to 1 is usual".to_string();
    // Which thousand is meant cannot be told from changes alone.
    let likely = if ratio < 1.0 { 1e-3 } else { 1e3 };
    is_wrong.then(|| Finding::new(FindingKind::Magnitude, ratio, evidence, unit(likely)))
}

fn median_size(values: impl Iterator<Item = f64>) -> f64 {
    upper_median(&values.map(f64::abs).collect::<Vec<_>>()).unwrap_or(f64::NAN)
}

/// The likely unit of values that are too large by a factor.
fn unit(ratio: f64) -> String {
    let power = (ratio.log10() / 3.0).round() as i32;
    match power {
        -1 => "likely unit: kilo-ohm, or volts at a drive current of 1 mA; multiply the values by 1000 (frames are in ohm)".into(),
        1 => "likely unit: milliohm, or millivolts at 1 A; divide the values by 1000 (frames are in ohm)".into(),
        -2 => "likely unit: megohm, or volts at a drive current of 1 uA; multiply the values by 1e6 (frames are in ohm)".into(),
        2 => "likely unit: microvolts at 1 A; divide the values by 1e6 (frames are in ohm)".into(),
        _ => format!(
            "a gain, counts of a converter, or another sheet: divide the values by {ratio:.3e}, or correct \
             sheet.sheet_resistance_ohm"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_is_a_unit_and_thirty_is_not() {
        let model = [100.0, -120.0, 90.0, -80.0];
        let scaled = |factor: f64| model.map(|value| factor * value);
        assert!(of_untouched(&scaled(0.2), &model).is_none() && of_untouched(&scaled(-8.0), &model).is_none());
        let small = of_untouched(&scaled(1e-3), &model).unwrap();
        assert!((small.value - 1e-3).abs() < 1e-12 && small.fix.contains("multiply the values by 1000"));
        assert!(of_untouched(&scaled(1e3), &model).unwrap().fix.contains("milliohm"));
        let changes = Mat::from_fn(5, 4, |_, j| 1e-6 * model[j]);
        assert!(of_changes(&changes, &model).is_some());
        assert!(of_changes(&(changes * 1e4), &model).is_none());
    }
}
