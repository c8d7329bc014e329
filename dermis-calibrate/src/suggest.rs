//! What more presses would give: where to press next, and the error against the number of labels.

use crate::calibration::{Calibration, Label, LabelFrame, MIN_LABELS};
use crate::error::CalibrateError;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::skin::Skin;
use dermis::stats::mean;
use faer::{Mat, Side};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Parts of the labels of a learning curve, besides all of them.
const PARTS: [usize; 2] = [4, 2];

impl Calibration {
    /// Positions whose presses would reduce the variance of the map most, summed over the pixels of the skin: each is
    /// chosen given those before it (active learning, Cohn 1996, DOI 10.1016/0893-6080(95)00137-9). In the coordinates
    /// of the labels, m.
    ///
    /// # Errors
    /// Labels with a singular covariance.
    pub fn suggest(&self, skin: &Skin, count: usize) -> Result<Vec<Point3>, CalibrateError> {
        let centres = skin.pixels().centres_m.iter();
        let candidates: Vec<Point3> =
            centres.map(|&centre| self.pose.map_or(centre, |pose| pose.to_robot(centre))).collect();
        let mut covariance = self.covariance_after_labels(&candidates)?;
        let mut suggested = Vec::new();
        for _ in 0..count.min(candidates.len()) {
            // The variance of the noise is 1.
            let gain = |column: usize| {
                let squares = covariance.col(column).iter().map(|value| value * value).sum::<f64>();
                squares / (covariance[(column, column)] + 1.0)
            };
            let gains: Vec<f64> = (0..candidates.len()).into_par_iter().map(gain).collect();
            let best = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b])).expect("a skin has pixels");
            suggested.push(candidates[best]);
            let column = covariance.col(best).to_owned();
            let scale = 1.0 / (column[best] + 1.0);
            covariance -= &column * column.transpose() * faer::Scale(scale);
        }
        Ok(suggested)
    }

    /// The covariance of the part of the position at some positions, given the presses of the map.
    fn covariance_after_labels(&self, positions_m: &[Point3]) -> Result<Mat<f64>, CalibrateError> {
        let map = self.locator.map();
        let noise = vec![1.0; map.inputs.len()];
        let known = map.covariance.matrix(&map.inputs, &noise, &map.extent);
        let factor = known
            .llt(Side::Lower)
            .map_err(|_| CalibrateError::Fit("the covariance of the labels is singular".into()))?;
        let mut half = Mat::from_fn(map.inputs.len(), positions_m.len(), |i, j| {
            map.covariance.of_position(map.inputs[i].position_m, positions_m[j])
        });
        factor.L().solve_lower_triangular_in_place(half.as_mut());
        let count = positions_m.len();
        let before = Mat::from_fn(count, count, |i, j| map.covariance.of_position(positions_m[i], positions_m[j]));
        Ok(before - half.transpose() * &half)
    }
}

/// A number of labels and the error that they give.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LearningPoint {
    /// Labelled presses.
    pub labels: usize,
    /// Mean error of presses that are no labels, m.
    pub mean_error_m: f64,
}

/// The error against the number of labels, of a forward map. An entry each for a quarter and a half of the labels
/// (evenly spread; the others are scored), and one for all of them (cross-validated, as `calibration` states it).
///
/// # Errors
/// As [`Calibration::fit`].
pub fn learning_curve(
    skin: &Skin,
    frames: &[Frame],
    labels: &[Label],
    frame: LabelFrame,
    calibration: &Calibration,
) -> Result<Vec<LearningPoint>, CalibrateError> {
    let mut curve = Vec::new();
    for part in PARTS.into_iter().filter(|part| labels.len() / part >= MIN_LABELS) {
        let (chosen, others): (Vec<_>, Vec<_>) = labels.iter().enumerate().partition(|(index, _)| index % part == 0);
        let chosen: Vec<Label> = chosen.into_iter().map(|(_, label)| *label).collect();
        let located = Calibration::fit(skin, frames, &chosen, frame)?.locate(frames, 0)?;
        let error = |(_, label): &(usize, &Label)| distance(located[label.row].position_m, label.position_m);
        let mean_error_m = mean(&others.iter().map(error).collect::<Vec<f64>>());
        curve.push(LearningPoint { labels: chosen.len(), mean_error_m });
    }
    curve.push(LearningPoint { labels: labels.len(), mean_error_m: calibration.quality().mean_error_m });
    Ok(curve)
}

/// The error that twice as many labels would give, m: a power law through the points of a learning curve (least squares
/// of the logarithms), from the last one on. `None` with fewer than two points.
pub fn expected_error_m(curve: &[LearningPoint]) -> Option<f64> {
    let last = curve.last().filter(|_| curve.len() > 1)?;
    let logs: Vec<(f64, f64)> =
        curve.iter().map(|point| ((point.labels as f64).ln(), point.mean_error_m.ln())).collect();
    let [x, y] = [|log: &(f64, f64)| log.0, |log: &(f64, f64)| log.1]
        .map(|of: fn(&(f64, f64)) -> f64| mean(&logs.iter().map(of).collect::<Vec<f64>>()));
    let slope = logs.iter().map(|log| (log.0 - x) * (log.1 - y)).sum::<f64>()
        / logs.iter().map(|log| (log.0 - x).powi(2)).sum::<f64>();
    Some(last.mean_error_m * 2.0_f64.powf(slope.min(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_continued_and_an_error_that_grows_is_not() {
        let point = |labels: usize, mean_error_m: f64| LearningPoint { labels, mean_error_m };
        let curve = [50, 100, 200].map(|labels| point(labels, 0.02 / (labels as f64).sqrt()));
        let expected = expected_error_m(&curve).unwrap();
        assert!((expected - 0.02 / 400.0_f64.sqrt()).abs() < 1e-12, "{expected}");
        assert_eq!(expected_error_m(&[point(50, 1e-3), point(100, 2e-3)]), Some(2e-3));
        assert_eq!(expected_error_m(&curve[..1]), None);
    }
}
