//! Covariance of the channels' responses between two presses.

use dermis::geom::Point3;
use dermis::geom::vector::{distance, dot, sub};
use faer::Mat;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A press as the responses depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct PressInput {
    /// Position, m.
    pub position_m: Point3,
    /// Position of the press before it, m; the [centre](Extent::centre_m) where it is not known.
    pub previous_m: Point3,
    /// Its number in the recording.
    pub number: f64,
}

/// Centre and size of the pressed region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Extent {
    /// Mean position, m.
    pub centre_m: Point3,
    /// Root mean square distance from the centre, m.
    pub radius_m: f64,
}

impl Extent {
    /// The extent of some positions.
    ///
    /// # Panics
    /// Without a position.
    pub(crate) fn of(positions_m: &[Point3]) -> Self {
        let count = positions_m.len() as f64;
        assert!(count > 0.0, "at least one position");
        let sum = |axis: usize| positions_m.iter().map(|position| position[axis]).sum::<f64>();
        let centre_m = [0, 1, 2].map(|axis| sum(axis) / count);
        let square = |position: &Point3| dot(sub(*position, centre_m), sub(*position, centre_m));
        Extent { centre_m, radius_m: (positions_m.iter().map(square).sum::<f64>() / count).sqrt() }
    }

    /// A position relative to the centre, in units of the radius.
    pub(crate) fn relative(&self, position_m: Point3) -> Point3 {
        sub(position_m, self.centre_m).map(|value| value / self.radius_m.max(SMALLEST_RADIUS_M))
    }
}

/// Hyperparameters of the Gaussian process. Variances are relative to the variance of the noise, which is 1.
///
/// The response of a channel is the sum of five independent parts, each with a Matern 5/2 covariance (Rasmussen and
/// Williams 2006, Eq. 4.17) over its own distance `r` in units of its length:
/// - of the position,
/// - of the position of the press before (viscoelastic skins keep part of it),
/// - of the number of the press (drift),
/// - a constant,
/// - of the position, times a linear function of the position before (the press before shifts the response).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Covariance {
    /// Length of the part of the position, m.
    pub position_length_m: f64,
    /// Variance of the part of the position.
    pub position_variance: f64,
    /// Length of the part of the position before, m.
    pub previous_length_m: f64,
    /// Variance of the part of the position before.
    pub previous_variance: f64,
    /// Length of the drift, presses.
    pub drift_length: f64,
    /// Variance of the drift.
    pub drift_variance: f64,
    /// Variance of the constant.
    pub constant_variance: f64,
    /// Length of the part that the position before shifts, m.
    pub shift_length_m: f64,
    /// Variance of the part that the position before shifts, for a position one [radius](Extent::radius_m) off centre.
    pub shift_variance: f64,
}

/// Positions that differ by less are one position, m.
const SMALLEST_RADIUS_M: f64 = 1e-6;
/// Number of hyperparameters.
pub(crate) const PARAMETERS: usize = 9;

impl Covariance {
    /// Typical hyperparameters for a region of a size; the centre of their prior.
    pub(crate) fn typical(extent: &Extent) -> Self {
        let radius_m = extent.radius_m;
        Covariance {
            position_length_m: 0.9 * radius_m,
            position_variance: 20.0,
            previous_length_m: 4.0 * radius_m,
            previous_variance: 0.5,
            drift_length: 800.0,
            drift_variance: 0.3,
            constant_variance: 1.0,
            shift_length_m: 0.9 * radius_m,
            shift_variance: 0.2,
        }
    }

    /// The logarithms, in the order of the fields.
    pub(crate) fn to_log(self) -> [f64; PARAMETERS] {
        [
            self.position_length_m,
            self.position_variance,
            self.previous_length_m,
            self.previous_variance,
            self.drift_length,
            self.drift_variance,
            self.constant_variance,
            self.shift_length_m,
            self.shift_variance,
        ]
        .map(f64::ln)
    }

    /// Whether it was stored whole.
    pub(crate) fn is_consistent(&self) -> bool {
        self.to_log().iter().all(|log| log.is_finite())
    }

    pub(crate) fn from_log(log: &[f64]) -> Self {
        let value = |index: usize| log[index].exp();
        Covariance {
            position_length_m: value(0),
            position_variance: value(1),
            previous_length_m: value(2),
            previous_variance: value(3),
            drift_length: value(4),
            drift_variance: value(5),
            constant_variance: value(6),
            shift_length_m: value(7),
            shift_variance: value(8),
        }
    }

    /// The covariance of the part of the position.
    pub(crate) fn of_position(&self, a: Point3, b: Point3) -> f64 {
        self.position_variance * matern(distance(a, b) / self.position_length_m)
    }

    /// The covariance of the part that the position before shifts, without the factor of the positions before.
    pub(crate) fn of_shift(&self, a: Point3, b: Point3) -> f64 {
        self.shift_variance * matern(distance(a, b) / self.shift_length_m)
    }

    /// The covariance of the parts that do not depend on the position: press before, drift, constant.
    pub(crate) fn of_history(&self, a: &PressInput, b: &PressInput) -> f64 {
        self.previous_variance * matern(distance(a.previous_m, b.previous_m) / self.previous_length_m)
            + self.drift_variance * matern((a.number - b.number).abs() / self.drift_length)
            + self.constant_variance
    }

    /// The covariance of two presses.
    pub(crate) fn of(&self, a: &PressInput, b: &PressInput, extent: &Extent) -> f64 {
        let factor = dot(extent.relative(a.previous_m), extent.relative(b.previous_m));
        self.of_position(a.position_m, b.position_m)
            + self.of_history(a, b)
            + factor * self.of_shift(a.position_m, b.position_m)
    }

    /// The covariance matrix of some presses with their noise on the diagonal.
    pub(crate) fn matrix(&self, inputs: &[PressInput], noise: &[f64], extent: &Extent) -> Mat<f64> {
        let count = inputs.len();
        let columns: Vec<Vec<f64>> = (0..count)
            .into_par_iter()
            .map(|j| (j..count).map(|i| self.of(&inputs[i], &inputs[j], extent)).collect())
            .collect();
        Mat::from_fn(count, count, |i, j| {
            let (low, high) = (i.min(j), i.max(j));
            columns[low][high - low] + if i == j { noise[i] } else { 0.0 }
        })
    }
}

/// The Matern 5/2 correlation at a distance in units of the length.
pub(crate) fn matern(distance: f64) -> f64 {
    let scaled = 5.0_f64.sqrt() * distance;
    (1.0 + scaled + scaled * scaled / 3.0) * (-scaled).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matern_has_its_known_values_and_slope() {
        // At r = length: (1 + sqrt 5 + 5/3) exp(-sqrt 5).
        assert!((matern(1.0) - 0.523_994_108_831_6).abs() < 1e-9, "{}", matern(1.0));
        // 1 - (5/6) r^2 near zero.
        let h = 1e-3;
        assert!(((1.0 - matern(h)) / (h * h) - 5.0 / 6.0).abs() < 1e-2);
    }

    #[test]
    fn the_matrix_is_positive_definite() {
        let inputs: Vec<PressInput> = (0..40)
            .map(|k| {
                let at = |k: f64| [0.03 * (1.3 * k).cos(), 0.02 * (2.1 * k).sin(), 0.0];
                PressInput { position_m: at(k as f64), previous_m: at(k as f64 - 1.0), number: k as f64 }
            })
            .collect();
        let extent = Extent::of(&inputs.iter().map(|input| input.position_m).collect::<Vec<_>>());
        let matrix = Covariance::typical(&extent).matrix(&inputs, &[1e-9; 40], &extent);
        assert!(matrix.llt(faer::Side::Lower).is_ok());
    }
}
