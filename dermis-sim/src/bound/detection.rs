//! The smallest force that is found.

use super::{Bounds, difference, smallest};
use crate::elementary::erfc;
use crate::twin::Press;
use dermis::geom::Point3;
use dermis::linalg::dot;
use dermis::stats::bisect;
use std::f64::consts::SQRT_2;

/// Probability that a press of the smallest force is found in a frame.
const FOUND: f64 = 0.9;
/// Forces between which the smallest is sought, N.
pub(super) const FORCES_N: [f64; 2] = [1e-4, 20.0];
/// Relative accuracy of the smallest force.
const ACCURACY: f64 = 1e-3;

impl Bounds {
    /// The smallest force at a place that is found in 90 % of the frames at one false alarm an hour; `None` if 20 N are
    /// not.
    ///
    /// For a known change `d` of the frame the best test compares `d' R^-1 x` with a threshold (Neyman and Pearson; Kay,
    /// Fundamentals of Statistical Signal Processing: Detection Theory, 1998, section 4.4): `sqrt(d' R^-1 d)` must be the
    /// sum of both normal quantiles. One test is made for each of `places` places.
    ///
    /// # Errors
    /// A place off the skin.
    pub fn smallest_force_n(&self, place_m: Point3, places: usize) -> crate::Result<Option<f64>> {
        self.smallest_force_up_to(place_m, places, FORCES_N[1])
    }

    /// The same, `None` if it is above a force.
    pub(super) fn smallest_force_up_to(
        &self,
        place_m: Point3,
        places: usize,
        most_n: f64,
    ) -> crate::Result<Option<f64>> {
        let needed = self.threshold(places) + normal_quantile(1.0 - FOUND);
        let deflection = |force_n: f64| self.deflection(&Press { force_n, ..self.press(place_m) });
        // Foam that a strong press would crush: the largest force that it bears.
        let [low, mut high] = [FORCES_N[0], most_n];
        while self.clean(&[Press { force_n: high, ..self.press(place_m) }]).is_err() && high > low {
            high *= 0.7;
        }
        if high <= low {
            return Ok(None);
        }
        smallest([low, high], needed, 1.0, ACCURACY, deflection)
    }

    /// The probability with which a press is found in a frame at one false alarm an hour, by the test of
    /// [`smallest_force_n`](Self::smallest_force_n).
    ///
    /// # Errors
    /// A press that the twin cannot simulate.
    pub fn probability_found(&self, press: &Press, places: usize) -> crate::Result<f64> {
        Ok(0.5 * erfc((self.threshold(places) - self.deflection(press)?) / SQRT_2))
    }

    /// `sqrt(d' R^-1 d)` of a press: the mean of the test in units of its standard deviation.
    fn deflection(&self, press: &Press) -> crate::Result<f64> {
        let frame = self.clean(std::slice::from_ref(press))?;
        let change = self.precision.whiten(difference(&frame, &self.physics.untouched));
        Ok(dot(&change, &change).sqrt())
    }

    /// The threshold of the test for one false alarm an hour in tests for some places.
    fn threshold(&self, places: usize) -> f64 {
        normal_quantile(1.0 / (self.frames_per_hour() * places as f64))
    }

    /// Number of means of frames an hour.
    fn frames_per_hour(&self) -> f64 {
        3600.0 * self.physics.twin.options().electronics.frame_rate_hz / self.options.frames as f64
    }
}

/// The value that a standard normal variable exceeds with a probability below one half.
pub(super) fn normal_quantile(probability: f64) -> f64 {
    bisect([0.0, 40.0], 100, |value| 0.5 * erfc(value / SQRT_2) <= probability)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_the_normal_distribution() {
        for (probability, quantile) in [(0.5, 0.0), (0.158_655_253_931_457, 1.0), (1e-9, 5.997_807_015)] {
            assert!((normal_quantile(probability) - quantile).abs() < 1e-8, "{probability}");
        }
    }
}
